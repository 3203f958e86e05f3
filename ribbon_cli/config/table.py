"""The one table of what a config may say; reader, `ribbon schema` and the reference's table follow from it.

A new key is a row here, and a field of the record in `types.py` that holds it. The keys of recipes are in
their own files.
"""

from __future__ import annotations

from dataclasses import replace

from ribbon_cli.config.types import METRICS, STOPS, Arclength, SpectrumRequest
from ribbon_cli.keys import (
    HALF_WIDTH,
    SEGMENTS,
    Either,
    Flag,
    Integer,
    Items,
    Key,
    Number,
    Section,
    Text,
    Word,
)
from ribbon_cli.recipes import RECIPES

STATE_FILES = (".npz", ".h5")
_SUFFIX = "|".join("".join(f"[{c}{c.upper()}]" if c.isalpha() else c for c in s[1:]) for s in STATE_FILES)
_STATE = "a state, as RUN:LABEL or 'RUN@b=0.5,N=400', or the path of a .npz or .h5 file"

NAME = Text(
    "1 to 64 of the characters A-Z a-z 0-9 . _ - and begin with a letter or digit",
    "[A-Za-z0-9][A-Za-z0-9._-]*",
    64,
)
WIDTH_LIST = Items(HALF_WIDTH, 10_000)
LEVEL_LIST = Items(SEGMENTS, 20)  # more doublings than lie between the fewest and the most segments

# fmt: off
RECIPE = Key("recipe", Word(tuple(RECIPES)), "way to make the first state",
             required=f"{', '.join(RECIPES)}, or start from a state: {{state: ...}}")
STATE = Section((
    Key("state", Text(_STATE, rf"[^/\x00-\x1f]*|[^\x00-\x1f]*\.(?:{_SUFFIX})", 1024),
        "stored state to start from; the path of a file is seen from the config's folder",
        required=_STATE, examples=("my-band:12", "my-band@b=0.5,N=400", "start.npz")),
    Key("saddle", Word(("leave", "keep")),
        "where the state is a saddle, go down to a minimum, or begin the branch at the saddle", "leave"),
), "a state", "a stored state, with its own segments and half-width")
RANGE = Section((
    Key("from", HALF_WIDTH, "first half-width of the range", required="the first half-width"),
    Key("to", HALF_WIDTH, "last half-width of the range", required="the last half-width"),
    Key("steps", Integer(1, WIDTH_LIST.at_most - 1), "number of equal steps",
        required="the number of steps"),
), about="half-widths at equal distances")
ARCLENGTH = Section((
    Key("to", HALF_WIDTH,
        "half-width to go towards; the branch ends where b leaves the range of this, the start's and "
        "`back_to`", required="the half-width to go towards"),
    Key("back_to", HALF_WIDTH, "the other end of the range"),
    Key("both", Flag(), "go the other way too, to `back_to`", Arclength.both),
    Key("at", Items(HALF_WIDTH, 1000, once=True),
        "half-widths to meet exactly, each time that the branch passes them; they become equilibria"),
    Key("max_step", Number(below=1.0, limit="the longest step along a branch"),
        "longest step, in the root mean square change of tangents and rulings", Arclength.max_step),
    Key("steps", Integer(1, 100_000), "steps at most, on each branch", Arclength.steps),
    Key("stop_at", Items(Word(STOPS), len(STOPS)), "end at the first of these events"),
    Key("switch", Integer(0, 5),
        "follow the branches that cross at branch points too, to both sides, so many times over",
        Arclength.switch),
))
BRANCH = Section((
    Key("arclength", ARCLENGTH, "follow the branch through the first state, around its folds"),
), about="pseudo-arclength continuation in the half-width")
LEVELS_AT = Section((
    Key("levels", LEVEL_LIST, "numbers of segments", required="the numbers of segments"),
    # Any number: what the widths do not hold is said of it whatever its size.
    Key("at", Items(Number(), WIDTH_LIST.at_most, once=True), "half-widths that are refined",
        otherwise="all"),
))
TOPOLOGY = Section((
    Key("half_twists", Integer(-100, 100), "n half-twists, Lk = n/2, the sign is the handedness",
        required="0 for a cylinder, 1 or -1 for a Moebius band", examples=(1, 0, -1, 3)),
))
GUESS = Either((
    *(Section((replace(RECIPE, takes=Word((name,))), *recipe.all_keys), name, recipe.about)
      for name, recipe in RECIPES.items()),
    STATE,
), "a mapping {recipe: ..., segments: ..., half_width: ...}")
WIDTHS = Either((WIDTH_LIST, RANGE, BRANCH),
    "a list as [0.1, 0.2, 0.5], a range as {from: 0.1, to: 1.5, steps: 28} "
    "or a branch as {arclength: {to: 0.2}}")
REFINEMENT = Either((LEVEL_LIST, LEVELS_AT),
    "a list as [50, 100, 200], or {levels: [50, 100, 200], at: [0.5]}")
SPECTRUM = Section((
    Key("modes", Integer(0, 1000), "lowest modes stored with each equilibrium", SpectrumRequest.modes),
    Key("full_up_to", Integer(0, 2000), "up to which N the whole spectrum is stored",
        SpectrumRequest.full_up_to),
    Key("metrics", Items(Word(METRICS), len(METRICS), once=True), "metrics of the spectra",
        SpectrumRequest.metrics),
))
CONFIG = Section((
    Key("name", NAME, "name of the run", otherwise="the file's stem"),
    Key("topology", TOPOLOGY, "kind of closed band",
        required="{half_twists: 1} for a Moebius band, 0 for a cylinder"),
    Key("length", Number(1e-9, 1e9, "the limit for a length"),  # far from overflow, and so are its powers
        "length of the midline", "2*pi"),
    Key("discretisation", Word(("thesis", "value-average")),
        "the energy's quadrature: F at the average of ξ, as published; or the average of F, which has a "
        "smaller error and no checkerboard modes", "thesis"),
    Key("initial_guess", GUESS,
        "where the first state comes from: a recipe with its settings, or a stored state",
        required="a recipe, as {recipe: twist, segments: 50, half_width: 0.1}",
        examples=({"recipe": "twist", "segments": 50, "half_width": 0.1},)),
    Key("widths", WIDTHS,
        "half-widths b in the order of solving (back to one of them is a new solve); or a range of them; "
        "or a branch", otherwise="the guess's",
        examples=([0.1, 0.2, 0.5], {"from": 0.1, "to": 1.5, "steps": 28}, {"arclength": {"to": 0.2}})),
    Key("refinement", REFINEMENT,
        "numbers of segments N, the guess's first and each double the one before; or these with the "
        "widths that are refined", otherwise="the guess's N",
        examples=([50, 100, 200], {"levels": [50, 100, 200], "at": [0.5]})),
    Key("spectrum", SPECTRUM, "how much of the eigen-spectrum to store"),
    Key("contact", Word(("record", "stop")), "when the band meets itself, note it and go on; or stop",
        "record"),
))

"""The one table of config keys; reader, `ribbon schema` and the reference's table follow from it.

A new key is a row here, and a field of the record in `types.py` that holds it. The keys of recipes are in
their own files.
"""

from __future__ import annotations

from dataclasses import replace

from ribbon_cli.config.types import CONTACT_KINDS, METRICS, STOPS, Arclength, SpectrumRequest
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
    Vector,
    Word,
)
from ribbon_cli.parts import FINISHES, PARAMETERS, STARTS, Ends, Loads
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
SIGNED = Number(-1e9, above=None, high=1e9)
VALUES = {name: HALF_WIDTH if name == "half_width" else SIGNED for name in PARAMETERS}
"""What each parameter may be."""
LEVEL_LIST = Items(SEGMENTS, 20)  # more doublings than lie between the fewest and the most segments

# fmt: off
RECIPE = Key("recipe", Word(tuple(RECIPES)), "way to make the first state",
             required=f"{', '.join(RECIPES)}, or start from a state: {{state: ...}}")
STATE = Section((
    Key("state", Text(_STATE, rf"[^/\x00-\x1f]*|[^\x00-\x1f]*\.(?:{_SUFFIX})", 1024),
        "stored state to start from; the path of a file is relative to the config's folder",
        required=_STATE, examples=("my-band:12", "my-band@b=0.5,N=400", "start.npz")),
    Key("saddle", Word(("leave", "keep")),
        "if the state is a saddle: descend to a minimum, or begin the branch at the saddle", "leave"),
), "a state", "a stored state, with its own segments and half-width")
RANGE = Section((
    Key("from", HALF_WIDTH, "first half-width of the range", required="the first half-width"),
    Key("to", HALF_WIDTH, "last half-width of the range", required="the last half-width"),
    Key("steps", Integer(1, WIDTH_LIST.at_most - 1), "number of equal steps",
        required="the number of steps"),
), about="half-widths at equal distances")



def arclength(value: Number, noun: str, *more: Key) -> Section:
    """The keys of a branch in a parameter that takes such values."""
    return Section((
        *more,
        Key("to", value,
            f"{noun} to go towards; the branch ends where it leaves the range of this, the start's and "
            "`back_to`", required=f"the {noun} to go towards"),
        Key("back_to", value, "the other end of the range"),
        Key("both", Flag(), "follow the branch in the other direction too, to `back_to`", Arclength.both),
        Key("at", Items(value, 1000, once=True),
            f"{noun}s to reach exactly, each time that the branch passes them; they become equilibria"),
        *_ALONG,
    ))


_ALONG = (
    Key("max_step", Number(below=1.0, limit="the longest step along a branch"),
        "longest step, in the root mean square change of tangents and rulings", Arclength.max_step),
    Key("steps", Integer(1, 100_000), "largest number of steps on each branch", Arclength.steps),
    Key("stop_at", Items(Word(STOPS), len(STOPS)), "end at the first of these events"),
    Key("switch", Integer(0, 5),
        "also follow the branches that cross at branch points, to both sides, to this depth",
        Arclength.switch),
)
ARCLENGTH = arclength(HALF_WIDTH, "half-width")
PARAMETER = Key("parameter", Word(tuple(PARAMETERS)), "parameter that the branch is followed in",
                Arclength.parameter)
ARCLENGTHS = {name: arclength(VALUES[name], "half-width" if name == "half_width" else "value", PARAMETER)
              for name in PARAMETERS}
"""A branch in each parameter."""
BRANCH = Section((
    Key("arclength", ARCLENGTH, "follow the branch through the first state, around its folds"),
), about="pseudo-arclength continuation in the half-width")
LEVELS_AT = Section((
    Key("levels", LEVEL_LIST, "numbers of segments", required="the numbers of segments"),
    # Any number: one that is not among the widths is reported whatever its size.
    Key("at", Items(Number(), WIDTH_LIST.at_most, once=True), "half-widths that are refined",
        otherwise="all"),
))
STEPPED = {name: Section((
    Key("to", value, f"the {name} to go to", required=f"the {name} to go to"),
    Key("steps", Integer(1, 10_000), "number of equal steps", otherwise="as the solver needs"),
)) for name, value in VALUES.items()}
LEG = Section((
    *(Key(name, Either((value, STEPPED[name]), "a value, or {to: ..., steps: ...}"), PARAMETERS[name].meaning)
      for name, value in VALUES.items()),
    Key("arclength", Section(ARCLENGTHS["span"].keys, about="of the last leg"),
        "follow the branch in one parameter, around its folds"),
), about="parameters that move together from where they are")
LEGS = Items(LEG, 1000)
ENDS = Section((
    Key("start", Word(STARTS), "how the start is held", Ends.start),
    Key("end", Word(FINISHES), "how the end is held: a hinge is free to turn about the ruling", Ends.end),
    Key("span", SIGNED, "place of the end along the start's tangent", otherwise="required, unless free"),
    Key("lift", SIGNED, "its place across the start's tangent and ruling", 0),
    Key("shear", SIGNED, "its place along the start's ruling", 0),
    Key("twist", SIGNED, "turn of the end's frame about the start's tangent, in radians", 0),
    Key("tilt", SIGNED, "turn of the end's frame about the ruling, before the twist, in radians", 0),
    Key("start_eta", SIGNED, "cotangent of the angle between ruling and tangent at the start", 0),
    Key("end_eta", SIGNED, "cotangent of the angle between ruling and tangent at the end", 0),
))
MATERIAL = Section((
    Key("natural_curvature", SIGNED, "curvature of the midline without loads, in 1/length", 0),
    Key("poisson", Number(-1.0, above=-1.0, high=0.5),
        "Poisson's ratio; it matters only with a natural curvature", 0),
))
LOADS = Section((
    Key("gravity", SIGNED, "weight per area over 2D, in 1/length^3, with the plate's stiffness D", 0),
    Key("gravity_direction", Vector(SIGNED), "direction of the weight, of any length",
        Loads.gravity_direction),
    Key("end_force", Vector(SIGNED), "dead force on the end's midpoint over 2D, in 1/length",
        Loads.end_force),
    Key("point_force", Vector(SIGNED), "dead force on a point of the midline over 2D, in 1/length",
        Loads.point_force),
    Key("point_at", Number(below=1.0, limit="the midline's end"),
        "where it acts, as a fraction of the length from the start", Loads.point_at),
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
    Key("full_up_to", Integer(0, 2000), "largest N at which the whole spectrum is stored",
        SpectrumRequest.full_up_to),
    Key("metrics", Items(Word(METRICS), len(METRICS), once=True), "metrics of the spectra",
        SpectrumRequest.metrics),
))
GAP = Section((
    Key("gap", Number(above=None, unit="length"),
        "least distance of facets that rest on each other, for instance the thickness of the paper",
        required="the least distance of facets, as {gap: 0.02}"),
), about="contact forces at a least distance")
CONTACT = Either((Word(CONTACT_KINDS), GAP), "record, stop, forces or {gap: 0.02}")
CONFIG = Section((
    Key("name", NAME, "name of the run", otherwise="the file's stem"),
    Key("topology", Either((TOPOLOGY, Word(("open",)))), "kind of closed band; or an open strip",
        required="{half_twists: 1} for a Moebius band, 0 for a cylinder, open for a strip",
        examples=({"half_twists": 1}, "open")),
    Key("length", Number(1e-9, 1e9, "the limit for a length"),  # far from overflow, and so are its powers
        "length of the midline", "2*pi"),
    Key("discretisation", Word(("thesis", "value-average")),
        "the energy's quadrature: F at the average of ξ, as published; or the average of F, which has a "
        "smaller error and no checkerboard modes", "thesis"),
    Key("ends", ENDS, "how a strip is held: x is along the start's tangent, z along its ruling, y = z × x; "
        "angles in radians", otherwise="required for a strip"),
    Key("material", MATERIAL, "what the strip is made of"),
    Key("loads", LOADS, "dead loads on a strip, in the start's frame"),
    Key("initial_guess", GUESS,
        "where the first state comes from: a recipe with its settings, or a stored state",
        required="a recipe, as {recipe: twist, segments: 50, half_width: 0.1}",
        examples=({"recipe": "twist", "segments": 50, "half_width": 0.1},)),
    Key("widths", WIDTHS,
        "half-widths b in the order of solving (back to one of them is a new solve); or a range of them; "
        "or a branch", otherwise="the guess's",
        examples=([0.1, 0.2, 0.5], {"from": 0.1, "to": 1.5, "steps": 28}, {"arclength": {"to": 0.2}})),
    Key("schedule", LEGS,
        "legs, in place of `widths`: each moves the parameters that it names, together, from where they are; "
        "the last may be a branch",
        examples=([{"shear": {"to": 0.3, "steps": 15}}, {"half_width": 0.1}],)),
    Key("refinement", REFINEMENT,
        "numbers of segments N, the guess's first and each double the one before; or these with the "
        "widths that are refined", otherwise="the guess's N",
        examples=([50, 100, 200], {"levels": [50, 100, 200], "at": [0.5]})),
    Key("spectrum", SPECTRUM, "how much of the eigen-spectrum to store"),
    Key("contact", CONTACT,
        "when the band meets itself: record it and go on, stop, or let it rest on itself with forces, at a "
        "gap of zero or a given one", "record"),
))

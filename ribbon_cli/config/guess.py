"""The section `initial_guess`: a recipe with its settings, or a stored state."""

from __future__ import annotations

import os

from ribbon_cli.config.document import Node
from ribbon_cli.config.reader import Limit, Reader
from ribbon_cli.config.recipes import RECIPES, Count, topology_problem
from ribbon_cli.config.types import Guess

STATE_FILES = (".npz", ".h5")
SADDLES = ("leave", "keep")
_MAX_STATE = 1024  # characters of a reference or path
_STATE = "a state, as RUN:LABEL or 'RUN@b=0.5,N=400', or the path of a .npz or .h5 file"
_NO_GUESS = Guess("")


def initial_guess(
    reader: Reader, node: Node | None, half_twists: int | None, limit: Limit | None, folder: str
) -> Guess:
    """The initial guess, without what is wrong in it. `folder` is the config file's own."""
    if node is None:
        return _NO_GUESS
    if node.kind != "mapping":
        reader.mapping(node, "initial_guess", ("recipe", "segments", "half_width"))
        return _NO_GUESS
    given: dict[str, Node] = {}
    for key, value in zip(node.items[::2], node.items[1::2], strict=True):
        given.setdefault(key.text, value)
    if "state" in given and "recipe" not in given:
        return _state(reader, node, list(given), folder)
    return _recipe(reader, node, given, half_twists, limit)


def _recipe(
    reader: Reader, node: Node, given: dict[str, Node], half_twists: int | None, limit: Limit | None
) -> Guess:
    name = given["recipe"].text if "recipe" in given and given["recipe"].text in RECIPES else ""
    recipes = [RECIPES[name]] if name else list(RECIPES.values())
    settings = {key: setting for recipe in recipes for key, setting in recipe.settings.items()}
    required = {"recipe": f"{', '.join(RECIPES)}, or start from a state: {{state: ...}}"}
    if name:
        required |= {key: setting.expected for key, setting in settings.items() if setting.default is None}
    refused = {
        "state": "cannot stand beside a recipe: keep one of the two",
        "saddle": "goes with a state, {state: ..., saddle: keep}: what a recipe leads to is not kept as one",
    }
    found = reader.mapping(
        node, "initial_guess", ("recipe", *settings), required=required, refused=refused, what=name
    )
    values: dict[str, int | None] = {}
    half_width = None
    for key, setting in settings.items():
        field = f"initial_guess.{key}"
        if isinstance(setting, Count):
            values[key] = setting.default
            if key in found:
                values[key] = reader.integer(found[key], field, setting.low, setting.high)
                if setting.even and (values[key] or 0) % 2:
                    reader.report(found[key], field, f"must be even for the recipe {name}, got {values[key]}")
        elif key in found:
            half_width = reader.positive(found[key], field, limit)
    if "recipe" in found and _check_recipe(reader, found["recipe"], half_twists) and half_twists is not None:
        _check_size(reader, found, name, half_twists, values.get("segments"), half_width, limit)
    return Guess(name, values.get("segments"), half_width, values.get("steps"))


def _check_recipe(reader: Reader, node: Node, half_twists: int | None) -> bool:
    """Whether there is such a recipe and it fits the topology, as far as that is known."""
    name = reader.word(node, "initial_guess.recipe", RECIPES)
    misfit = topology_problem(name, half_twists) if name and half_twists is not None else None
    if misfit:
        reader.report(node, "initial_guess.recipe", misfit)
    return name is not None and misfit is None


def _check_size(
    reader: Reader,
    found: dict[str, Node],
    name: str,
    half_twists: int,
    segments: int | None,
    half_width: float | None,
    length: Limit | None,
) -> None:
    """Report a mesh too coarse, or a band too wide, for so many half-twists."""
    recipe, bands = RECIPES[name], f"{name} with {abs(half_twists)} half-twists"
    if segments is not None and segments < recipe.fewest(half_twists):
        reader.report(
            found["segments"],
            "initial_guess.segments",
            f"must be at least {recipe.fewest(half_twists)} for {bands}, got {segments}",
        )
    if half_width is not None and length is not None:
        widest = recipe.widest(half_twists) * length[0]
        if half_width >= widest:
            reader.report(
                found["half_width"],
                "initial_guess.half_width",
                f"must be less than {widest:.6g}, where the rulings of {bands} meet, got {half_width:g}",
            )


def _state(reader: Reader, node: Node, given: list[str], folder: str) -> Guess:
    """A stored state, which brings its own segments and half-width."""
    settings = [key for recipe in RECIPES.values() for key in recipe.settings]
    refused = dict.fromkeys(settings, "does not go with a state: remove it")
    refused |= dict.fromkeys(("segments", "half_width"), "comes with the state: remove it")
    # In braces a comma ends the value: {state: RUN@b=0.5,N=400} gives a key "N=400".
    refused |= {
        key: "is cut off from the reference: put the whole of it in quotes" for key in given if "=" in key
    }
    found = reader.mapping(
        node,
        "initial_guess",
        ("state", "saddle"),
        required={"state": _STATE},
        refused=refused,
        what="a state",
    )
    saddle = reader.word(found["saddle"], "initial_guess.saddle", SADDLES) if "saddle" in found else None
    text = reader.text(found["state"], "initial_guess.state", _STATE) if "state" in found else None
    if text is None:
        return _NO_GUESS
    is_file = text.lower().endswith(STATE_FILES)
    if len(text) > _MAX_STATE or ("/" in text and not is_file):
        reader.wrong(found["state"], "initial_guess.state", f"must be {_STATE}")
        return _NO_GUESS
    opened = os.path.abspath(os.path.join(folder, os.path.expanduser(text))) if is_file else text
    where = found["state"]
    return Guess(
        "state",
        state=opened,
        state_as_written=text,
        keep_saddle=saddle == "keep",
        line=where.line,
        column=where.column,
    )

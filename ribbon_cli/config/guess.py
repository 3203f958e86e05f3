"""The section `initial_guess`: a recipe with its settings, or a stored state."""

from __future__ import annotations

import os
from dataclasses import replace

from ribbon_cli.config.document import Node
from ribbon_cli.config.keys import Section
from ribbon_cli.config.reader import Found, Limit, Reader
from ribbon_cli.config.recipes import EVEN_SEGMENTS, RECIPES, topology_problem
from ribbon_cli.config.table import GUESS, RECIPE, STATE, STATE_FILES
from ribbon_cli.config.types import Guess

_NO_GUESS = Guess("")


def initial_guess(
    reader: Reader, node: Node | None, half_twists: int | None, limit: Limit | None, folder: str
) -> Guess:
    """The initial guess, without what is wrong in it. `folder` is the config file's own."""
    if node is None:
        return _NO_GUESS
    if node.kind != "mapping":
        reader.wrong(node, "initial_guess", f"must be {GUESS.expected}")
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
    keys = {key.name: key for recipe in recipes for key in recipe.keys}
    if not name:
        keys = {key.name: replace(key, required="") for key in keys.values()}
    refused = {
        "state": "cannot stand beside a recipe: keep one of the two",
        "saddle": "goes with a state, {state: ..., saddle: keep}: what a recipe leads to is not kept as one",
    }
    section = Section((RECIPE, *keys.values()), name)
    found = reader.section(node, "initial_guess", section, refused)
    segments: int | None = found.read("segments")
    if keys["segments"].takes == EVEN_SEGMENTS and (segments or 0) % 2:
        even = f"must be even for the recipe {name}, got {segments}"
        reader.report(found.nodes["segments"], found.path("segments"), even)
    half_width: float | None = found.read("half_width", limit)
    steps: int | None = found.read("steps") if "steps" in keys else None
    if _check_recipe(reader, found, half_twists) and half_twists is not None:
        _check_size(reader, found.nodes, name, half_twists, segments, half_width, limit)
    return Guess(name, segments, half_width, steps)


def _check_recipe(reader: Reader, found: Found, half_twists: int | None) -> bool:
    """Whether there is such a recipe and it fits the topology, as far as that is known."""
    name: str | None = found.read("recipe")
    misfit = topology_problem(name, half_twists) if name and half_twists is not None else None
    if misfit:
        reader.report(found.nodes["recipe"], found.path("recipe"), misfit)
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
    settings = [key.name for recipe in RECIPES.values() for key in recipe.keys]
    refused = dict.fromkeys(settings, "does not go with a state: remove it")
    refused |= dict.fromkeys(("segments", "half_width"), "comes with the state: remove it")
    # In braces a comma ends the value: {state: RUN@b=0.5,N=400} gives a key "N=400".
    refused |= {
        key: "is cut off from the reference: put the whole of it in quotes" for key in given if "=" in key
    }
    found = reader.section(node, "initial_guess", STATE, refused)
    saddle, text = found.read("saddle"), found.read("state")
    if text is None:
        return _NO_GUESS
    is_file = text.lower().endswith(STATE_FILES)
    opened = os.path.abspath(os.path.join(folder, os.path.expanduser(text))) if is_file else text
    where = found.nodes["state"]
    return Guess(
        "state",
        state=opened,
        state_as_written=text,
        keep_saddle=saddle == "keep",
        line=where.line,
        column=where.column,
    )

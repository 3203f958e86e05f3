"""The section `initial_guess`: a recipe with its settings, or a stored state."""

from __future__ import annotations

import math
import os
from dataclasses import replace

from ribbon_cli.config.document import Node
from ribbon_cli.config.reader import Reader
from ribbon_cli.config.strips import Topology
from ribbon_cli.config.table import GUESS, RECIPE, STATE, STATE_FILES
from ribbon_cli.config.types import Guess
from ribbon_cli.keys import Section
from ribbon_cli.recipes import RECIPES

_NO_GUESS = Guess("")


def initial_guess(reader: Reader, node: Node | None, half_twists: Topology, folder: str) -> Guess:
    """The initial guess, without its mistakes. `folder` is the config file's own."""
    if node is None:
        return _NO_GUESS
    if node.kind != "mapping":
        reader.wrong(node, "initial_guess", f"must be {GUESS.expected}")
        return _NO_GUESS
    given: dict[str, str] = {}
    for key, value in zip(node.items[::2], node.items[1::2], strict=True):
        given.setdefault(key.text, value.text)
    if "state" in given and "recipe" not in given:
        return _state(reader, node, list(given), folder)
    return _recipe(reader, node, given.get("recipe", ""), half_twists)


def report_unheld(reader: Reader, node: Node | None, guess: Guess, forces: bool) -> None:
    """Report a recipe whose band rests on itself where contact forces are off."""
    card = RECIPES.get(guess.recipe)
    if forces or node is None or card is None or not card.resting:
        return
    where = next(
        value for key, value in zip(node.items[::2], node.items[1::2], strict=True) if key.text == "recipe"
    )
    message = f"{card.name} rests on itself from the beginning: it needs contact: forces"
    reader.report(where, "initial_guess.recipe", message)


def _recipe(reader: Reader, node: Node, named: str, half_twists: Topology) -> Guess:
    """A recipe with its settings; for an unknown recipe, the settings of all recipes are accepted."""
    name = named if named in RECIPES else ""
    recipes = [RECIPES[name]] if name else list(RECIPES.values())
    keys = {key.name: key for recipe in recipes for key in recipe.all_keys}
    if not name:
        keys = {key.name: replace(key, required="") for key in keys.values()}
    refused = {
        "state": "cannot be combined with a recipe: keep one of the two",
        "saddle": "goes with a state, {state: ..., saddle: keep}: the result of a recipe is not kept as one",
    }
    found = reader.section(node, "initial_guess", Section((RECIPE, *keys.values()), name), refused)
    values = found.values()
    known, settings = values.pop("recipe") is not None, values
    guess = Guess(name, settings.pop("segments"), settings.pop("half_width"), settings)
    if name and RECIPES[name].segments.even and (guess.segments or 0) % 2:
        found.report("segments", f"must be even for the recipe {name}, got {guess.segments}")
    if not known or half_twists is None:
        return guess
    if misfit := _misfit(name, half_twists):
        found.report("recipe", misfit)
        return guess
    if isinstance(half_twists, str):
        return guess
    recipe, bands = RECIPES[name], f"{name} with {abs(half_twists)} half-twists"
    fewest, widest = recipe.fewest(half_twists), recipe.widest(half_twists) * (reader.length or math.inf)
    if guess.segments is not None and guess.segments < fewest:
        found.report("segments", f"must be at least {fewest} for {bands}, got {guess.segments}")
    if guess.half_width is not None and guess.half_width >= widest:
        meet = f"where the rulings of {bands} meet, got {guess.half_width:g}"
        found.report("half_width", f"must be less than {widest:.6g}, {meet}")
    return guess


def _misfit(name: str, topology: int | str) -> str | None:
    """Why the recipe cannot make a strip, or this number of half-twists, and which can; None if it can."""

    def fits(other: str) -> bool:
        recipe = RECIPES[other]
        return recipe.open if isinstance(topology, str) else not recipe.open and recipe.fits(topology)

    if fits(name):
        return None
    recipe, others = RECIPES[name], list(filter(fits, RECIPES))
    hint = (
        f"take {' or '.join(others)}" if others else "no recipe makes these: start from a state, {state: ...}"
    )
    needs = "needs topology open" if recipe.open else f"needs half_twists {recipe.half_twists}"
    needs += (
        f", got {topology if isinstance(topology, str) or not recipe.open else f'half_twists {topology}'}"
    )
    return f"{name} does not fit the topology: {needs}; {hint}"


def _state(reader: Reader, node: Node, given: list[str], folder: str) -> Guess:
    """A stored state, which has its own segments and half-width."""
    settings = [key.name for recipe in RECIPES.values() for key in recipe.all_keys]
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

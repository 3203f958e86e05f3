"""Initial guesses, one file each: the recipe's card and its mathematics, which waits until it is needed."""

from . import cylinder, eversion, figure_eight, schoenke, strip, twist
from .recipe import Recipe

RECIPES: dict[str, Recipe] = {
    card.name: card
    for card in (cylinder.CARD, twist.CARD, eversion.CARD, schoenke.CARD, figure_eight.CARD, strip.CARD)
}
"""All recipes; a new one is a file in this folder and its card here."""

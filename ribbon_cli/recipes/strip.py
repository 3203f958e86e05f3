"""The strip between its ends: a planar elastica."""

from __future__ import annotations

from typing import TYPE_CHECKING

from .recipe import NotMadeError, Recipe, Settings, Way

if TYPE_CHECKING:
    from ..model.band import Band


def _way(_band: Band, _half_twists: int, _settings: Settings) -> Way:
    raise NotMadeError("open strips are not solved yet")


CARD = Recipe(
    name="strip",
    about="the planar elastica between the ends of an open strip, under its loads, buckled to +y",
    half_twists="open",
    fits=lambda _: False,
    passes="nothing",
    freed="strip",
    way=_way,
    open=True,
)

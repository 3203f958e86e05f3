"""Whether two states of a run are one minimum on two grids, where parentage does not tell."""

from __future__ import annotations

from ..solver import kinship
from ..store import Run
from ..study.acceptance import options_for
from ..study.records import state_of


def another_minimum(run: Run, coarse: int, fine: int) -> str:
    """How the state `fine` is another minimum than `coarse`, both labels, in words; empty where it is not."""
    records = [run.load(label) for label in (coarse, fine)]
    options = options_for(records[0].half_twists)
    found = kinship.another_minimum(state_of(records[0]), state_of(records[1]), options)
    return "" if found is None else str(found)

"""Which states of a run stand in its convergence table."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from cli_support import ribbon_json
from store_support import make_record, make_run

from ribbon_cli.analysis import run_table, table_entries
from ribbon_cli.store import Run


def run_of(root: Path, *places: tuple[float, int]) -> Run:
    """A run with equilibria at these half-widths and N, each from the one before."""
    run = make_run(root)
    with run.writing():
        for label, (half_width, n) in enumerate(places, 1):
            run.commit(make_record(label, n=n, half_width=half_width, stage=f"state {label}", events=()))
    return run


def test_half_widths_that_are_nearly_one_have_one_row_each(tmp_path):
    """0.1 and the next are one, and so are the next and the last; the first and the last are not."""
    near, far = 0.1 * (1 + 0.9e-9), 0.1 * (1 + 1.8e-9)
    run = run_of(tmp_path, (0.1, 8), (near, 8), (far, 8), (far, 16))
    assert [(entry.half_width, entry.label) for entry in table_entries(run)] == [(0.1, 2), (far, 3), (far, 4)]
    assert [row.half_width for row in run_table(run).rows] == [0.1, far, far]
    shown = ribbon_json("convergence-table", "mobius", "--runs", tmp_path)
    assert [row["segments"] for row in shown["rows"]] == [8, 8, 16]


@pytest.mark.parametrize("energy", [math.nan, 1.0])
def test_a_state_refined_from_another_minimum_says_so(tmp_path, energy):
    run = make_run(tmp_path)
    with run.writing():
        run.commit(make_record(1, n=8, energy=energy, events=()))
        run.commit(make_record(2, n=16, parent=1, events=()))
        run.commit(make_record(3, n=8, parent=None, events=()))
    coarse, fine = table_entries(run)
    assert (coarse.label, coarse.breaks) == (3, "")
    assert fine.breaks == f"another minimum: refined from state 1 with E = {energy:.9g}"

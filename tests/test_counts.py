"""What a solve, a spectrum and a commit cost, counted: seconds are for `make bench`."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import pytest
from spectral_support import Place, pi_band
from store_support import make_record

from ribbon_cli.config import parse_config
from ribbon_cli.model.band import Discretisation
from ribbon_cli.solver import inertia, linear, pencil, spectra, tangent_basis
from ribbon_cli.solver.continuation import to_segments
from ribbon_cli.solver.newton import Options
from ribbon_cli.store import Run, hdf5
from ribbon_cli.study import solve_config

METRICS = ("euclidean", "physical")
TABLE = """\
name: counted
topology: {half_twists: 1}
initial_guess: {recipe: twist, segments: 50, half_width: 0.2, steps: 20}
widths: [0.2, 0.5]
refinement: [50, 100]
spectrum: {modes: 12, full_up_to: 0}
"""


@pytest.fixture(scope="module")
def place() -> Place:
    return pi_band(50, Discretisation.THESIS)


@pytest.fixture
def counts(monkeypatch: pytest.MonkeyPatch) -> Callable[..., Counter[str]]:
    """Counts calls, from then on, of functions given as (owner, name)."""

    def watch(*functions: tuple[object, str]) -> Counter[str]:
        found: Counter[str] = Counter()
        for owner, name in functions:
            call = getattr(owner, name)

            def counted(*args, name=name, call=call, **kwargs):
                found[name] += 1
                return call(*args, **kwargs)

            monkeypatch.setattr(owner, name, counted)
        return found

    return watch


def test_steps_and_factorisations_of_a_refinement(place: Place, counts) -> None:
    """A factorisation a step, one for the start's multipliers, and one for the certificate."""
    found = counts((linear.Factor, "_factor"), (inertia, "BlockReduction"))
    move = to_segments(place.problem.state(place.x), 100, Options())
    assert move.result.certified
    assert move.steps <= 6
    assert found["_factor"] <= move.steps + 2
    assert found["BlockReduction"] == 0


def test_the_lowest_modes_take_one_reduction_of_the_matrix_and_one_a_metric(place: Place, counts) -> None:
    """That of K serves in all metrics; those of the metrics bound the residuals. Pivots count."""
    found = counts((pencil, "BlockReduction"), (pencil, "Factor"), (spectra, "largest_eigenpairs"))
    spectra.lowest_spectra(place.problem, place.x, place.local, METRICS, 12)
    assert found == {"BlockReduction": 1 + len(METRICS), "Factor": len(METRICS), "largest_eigenpairs": 2}


def test_full_spectra_of_bands_take_no_factorisation_of_all_normals(place: Place, counts) -> None:
    found = counts((tangent_basis, "null_space"), (tangent_basis.FoldedBasis, "congruent"))
    spectra.full_spectra(place.problem, place.x, place.local, METRICS, 12)
    assert found == {"congruent": 1 + len(METRICS)}


def test_files_and_syncs_of_commits(tmp_path: Path, counts) -> None:
    """A file, its folder and the log are synced, and nothing is opened that was written."""
    run = Run.create_or_open(tmp_path, "counted", "0" * 8, "", "")
    with run.writing():
        found = counts((os, "fsync"), (os, "link"), (hdf5, "read_bytes"))
        for label in range(1, 6):
            run.commit(make_record(label))
    assert found == {"fsync": 5 * 3, "link": 5}


def test_templates_and_steps_of_a_table(tmp_path: Path, counts) -> None:
    """States of one layout share a template of their file."""
    hdf5._blank.cache_clear()
    outcome = solve_config(parse_config(TABLE, "table.yaml"), tmp_path, second_process=False)
    states = outcome.run.states(all=True)
    assert outcome.exit_code == 0
    assert len(states) == 1 + 20 + 4
    assert sum(state.newton_steps for state in states) <= 110
    assert hdf5._blank.cache_info().misses <= 6

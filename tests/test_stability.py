"""Verdicts on states: stable, unstable with the right index, undecided and why; modes by name and parity."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from spectral_support import Place, covered_ring, pi_band, ring_place
from test_closed_forms import solved_figure_eight

from ribbon_cli.analysis.mode_limits import run_spectra, spectral_convergence
from ribbon_cli.analysis.stability import Stability, stability_of, told_of
from ribbon_cli.analysis.verdict import judge
from ribbon_cli.errors import UsageError
from ribbon_cli.model.band import Discretisation
from ribbon_cli.model.metrics import METRICS
from ribbon_cli.model.problem import Problem
from ribbon_cli.report.spectra import Mode
from ribbon_cli.solver.inertia import Inertia
from ribbon_cli.solver.prolongation import Phase
from ribbon_cli.solver.spectra import Spectrum, lowest_spectrum
from ribbon_cli.store import Run, StateRecord
from ribbon_cli.study.clock import Clock
from ribbon_cli.study.records import Reached, build_record

VALUE_AVERAGE, THESIS = Discretisation.VALUE_AVERAGE, Discretisation.THESIS
TRUSTED = Inertia(0, 1e-3, 1e-9)


def record_of(place: Place, label: int = 1, half_twists: int = 0, kind: str = "equilibrium") -> StateRecord:
    reached = Reached(place.problem, place.result, kind, "test", "test", half_twists)
    return build_record(label, reached, Clock((), None), None)


def stability(place: Place, **options: object) -> Stability:
    return stability_of(record_of(place), **options)  # type: ignore[arg-type]


# --- verdicts on states ---


@pytest.mark.parametrize("rule", [VALUE_AVERAGE, THESIS])
def test_the_pi_band_is_stable(rule: Discretisation) -> None:
    found = stability(pi_band(100, rule))
    assert (found.verdict.kind, found.verdict.negative) == ("stable", 0)
    assert found.verdict.gap == pytest.approx(1.073, abs=3e-3)
    assert found.verdict.sentence.startswith("stable minimum modulo symmetries with gap 1.07")
    assert "sliding" in found.verdict.sentence
    assert ("checkerboard" in found.verdict.sentence) == (rule is THESIS)
    assert found.symmetries.name == "C2"
    assert all(mode.parity in ("s", "a") for mode in found.modes)


def test_the_saddle_of_the_grid_is_unstable() -> None:
    """At b = 0.5, N = 400, E = 5.151432747, where other solvers report success."""
    place = pi_band(400, THESIS, Phase.NODE)
    assert place.result.energy == pytest.approx(5.151432747, abs=1e-9)
    found = stability(place)
    assert (found.verdict.kind, found.verdict.negative) == ("unstable", 1)
    assert found.verdict.sentence.startswith("index 1: no minimum, the sliding mode has -0.000377")
    assert "half a facet" in found.verdict.sentence
    assert found.modes[0].sliding_overlap > 0.999
    assert found.vectors.shape[1:] == (400, 7)


def test_a_coarse_planar_figure_eight_is_unstable() -> None:
    eight = solved_figure_eight(12, 0.5)
    found = stability(Place(Problem(eight.state.band), eight))
    assert (found.verdict.kind, found.verdict.negative) == ("unstable", 1)
    assert found.modes[0].value < -found.modes[0].bound


@pytest.mark.parametrize("metric", list(METRICS))
def test_signs_do_not_depend_on_the_metric(metric: str) -> None:
    found = stability(covered_ring(80, 4, 0.1, VALUE_AVERAGE), metric=metric, modes=4)
    assert (found.verdict.kind, found.verdict.negative) == ("unstable", 2)
    assert found.verdict.sentence.startswith("index 2: no minimum")
    assert found.modes[1].value == pytest.approx(found.modes[0].value, rel=1e-6)


def test_fewer_modes_than_the_index() -> None:
    found = stability(covered_ring(80, 4, 0.1, VALUE_AVERAGE), modes=1)
    assert (found.verdict.kind, found.verdict.negative) == ("unstable", 2)


def test_a_fine_figure_eight_is_undecided() -> None:
    """Its sliding mode falls below roundoff, and nothing is said that is not known."""
    eight = solved_figure_eight(160, 0.1)
    found = stability(Place(Problem(eight.state.band), eight))
    assert (found.verdict.kind, found.verdict.negative) == ("undecided", None)
    assert "under its error bound" in found.verdict.sentence
    assert "all other modes are positive, the lowest" in found.verdict.sentence


def test_a_state_that_is_not_stationary_is_undecided() -> None:
    record = replace(record_of(ring_place(20, 0.3, THESIS)), kkt_residual=1e-3)
    found = stability_of(record).verdict
    assert (found.kind, found.negative) == ("undecided", None)
    assert "not stationary (gradient 1.0e-03" in found.sentence


# --- verdicts on figures ---


def mode(value: float, label: str = "mode", bound: float = 1e-9) -> Mode:
    return Mode(value, 0.0, bound, label, 0.0, 0.0, {})


ROTATIONS = (mode(0.0, "rotation", 0.0),) * 3


def test_what_decides() -> None:
    stable = judge(
        (*ROTATIONS, mode(1e-3, "sliding"), mode(0.5, "checkerboard"), mode(1.0)), TRUSTED, [], False
    )
    assert (stable.kind, stable.gap, stable.negative) == ("stable", 1.0, 0)
    assert "sliding, free in the continuum, costs 0.001" in stable.sentence
    assert "1 checkerboard mode, of" in stable.sentence
    assert "hidden" not in stable.sentence
    alternating = judge((replace(mode(0.5), hidden=0.754),), TRUSTED, [], False)
    assert (alternating.kind, alternating.gap) == ("stable", 0.5)
    assert "gap 0.5 of a mode that alternates over few facets (hidden 0.75)" in alternating.sentence
    short = judge((*ROTATIONS, mode(1e-3, "sliding")), TRUSTED, [], False)
    assert (short.kind, short.gap) == ("stable", None)
    assert "not among the modes computed" in short.sentence


@pytest.mark.parametrize(
    ("modes", "inertia", "words"),
    [
        ((mode(1e-10),), TRUSTED, "a mode has 1.0e-10, under its error bound 1.0e-09"),
        ((mode(-1e-10, "sliding"), mode(1.0)), Inertia(1, 1e-3, 1e-9), "the sliding mode has -1.0e-10"),
        (
            (mode(1.0),),
            Inertia(0, 1e-15, 1.0),
            "the inertia is not trusted (measured roundoff 1.0e+00, pivot gap 1.0e-15)",
        ),
        ((mode(-1.0), mode(1.0)), TRUSTED, "the inertia counts 0 negative, the spectrum 1"),
        ((mode(-1.0), mode(1.0)), Inertia(2, 1e-3, 1e-9), "the inertia counts 2 negative, the spectrum 1"),
    ],
)
def test_what_leaves_it_undecided(modes: tuple[Mode, ...], inertia: Inertia, words: str) -> None:
    found = judge((*ROTATIONS, *modes), inertia, [], False)
    assert (found.kind, found.negative) == ("undecided", None)
    assert words in found.sentence


def test_many_negative_modes_are_counted_by_inertia() -> None:
    found = judge((mode(-2.0), mode(-1.0)), Inertia(7, 1e-3, 1e-9), [], False)
    assert (found.kind, found.negative) == ("unstable", 7)
    assert found.sentence.endswith("; ...")
    assert judge((mode(-2.0), mode(-1.0)), Inertia(7, 1e-3, 1e-9), [], True).kind == "undecided"


# --- modes ---


def test_pairs_of_a_ring_are_told_apart_by_parity() -> None:
    """In each pair one mode is symmetric under the half-turn found, one antisymmetric."""
    found = stability(ring_place(24, 0.3, VALUE_AVERAGE), modes=8)
    names = list(found.symmetry_names)
    half_turn = names.index("C2")
    signs = [m.parity[half_turn] for m in found.modes[3:]]
    assert all({a, b} == {"s", "a"} for a, b in zip(signs[::2], signs[1::2], strict=True))


@pytest.mark.parametrize("modes", [7, 8])
def test_parities_do_not_depend_on_the_basis_that_was_found(modes: int, monkeypatch) -> None:
    """Inside an eigenvalue any basis may be found; of the last one, perhaps cut, as well."""

    def turned(*arguments: object) -> Spectrum:
        spectrum = lowest_spectrum(*arguments)  # type: ignore[arg-type]
        vectors = spectrum.vectors.copy()
        for k in range(3, len(vectors) - 1, 2):
            c, s = np.cos(0.4 + k), np.sin(0.4 + k)
            vectors[k : k + 2] = np.einsum("ij,jkl->ikl", [[c, s], [-s, c]], vectors[k : k + 2])
        return replace(spectrum, vectors=vectors)

    monkeypatch.setattr("ribbon_cli.analysis.stability.lowest_spectrum", turned)
    place = ring_place(24, 0.3, VALUE_AVERAGE)
    found = stability(place, modes=modes)
    assert np.abs([m.symmetry["C2"] for m in found.modes]) == pytest.approx(np.ones(3 + modes))
    v = found.vectors.reshape(len(found.vectors), -1)[3:]
    gram = v @ (METRICS["physical"].matrix(found.state) @ v.T)
    assert gram == pytest.approx(np.eye(modes), abs=1e-9)


def test_a_pair_that_the_list_cuts_has_a_parity_too() -> None:
    found = stability(ring_place(24, 0.3, VALUE_AVERAGE), modes=3)
    assert abs(found.modes[-1].symmetry["C2"]) == pytest.approx(1.0)


def test_rotations_have_no_parity_where_they_have_no_length() -> None:
    """In folding coordinates they do not move at all; noise divided by noise is no number to show."""
    found = stability(pi_band(100, THESIS), metric="folding", modes=4)
    rotations, others = found.modes[:3], found.modes[3:]
    assert [mode.label for mode in rotations] == ["rotation"] * 3
    assert all(np.isnan(value) for mode in rotations for value in mode.symmetry.values())
    assert all(mode.parity in ("s", "a") for mode in others)


def test_modes_have_unit_length_and_their_values() -> None:
    place = pi_band(100, VALUE_AVERAGE)
    found = stability(place)
    mass = METRICS["physical"].matrix(found.state)
    hessian = place.problem.hessian_matrix(place.local)
    for m, v in zip(found.modes, found.vectors.reshape(len(found.vectors), -1), strict=True):
        assert v @ (mass @ v) == pytest.approx(1.0)
        if m.label != "rotation":
            assert v @ (hessian @ v) == pytest.approx(m.value, rel=1e-6, abs=1e-9)


def test_what_is_refused() -> None:
    record = record_of(ring_place(12, 0.3, THESIS))
    for change, options, words in (
        ({}, {"metric": "riemann"}, "no metric 'riemann': there are euclidean, physical, folding"),
        ({}, {"modes": 0}, "at least 1"),
        ({"kind": "auxiliary"}, {}, "auxiliary"),
        ({"segments": 5000}, {"full": True}, "at most 1600 segments"),
    ):
        with pytest.raises(UsageError, match=words):
            stability_of(replace(record, **change), **options)  # type: ignore[arg-type]


def test_the_document_is_plain() -> None:
    place = ring_place(30, 0.3, THESIS)
    document = told_of(record_of(place), stability(place, modes=5), "ring-1").document()
    assert len(document["modes"]) == 8
    assert document["symmetry"]["group"] == "D30h"
    assert len(document["symmetry"]["elements"]) == 64


# --- runs ---


@pytest.fixture
def run(tmp_path: Path) -> Run:
    made = Run.create_or_open(tmp_path, "pi", "0" * 8, "", "")
    with made.writing():
        for label, n in enumerate((50, 100, 200, 400), 1):
            made.commit(record_of(pi_band(n, VALUE_AVERAGE), label, 1))
    return made


def test_convergence_of_a_run(run: Run) -> None:
    table, uncertified = spectral_convergence(run)
    sliding, *modes = table.sequences
    assert [item.label for item in table.sequences] == ["sliding"] + ["mode"] * 5
    assert sliding.limit is None
    assert all(order > 1.5 for order in sliding.orders if order is not None)
    for item in modes:
        assert item.segments == (50, 100, 200, 400)
        assert all(1.8 < order < 2.3 for order in item.orders if order is not None)
        assert item.settled
        assert abs(item.values[-1] - (item.limit or 0.0)) < 1e-3
    assert (table.notes, uncertified) == ((), ())


def test_states_without_certificate_are_left_out(run: Run) -> None:
    with run.writing():
        run.commit(record_of(pi_band(800, VALUE_AVERAGE, Phase.NODE), 5, 1))
    table, uncertified = spectral_convergence(run, modes=2)
    assert [item.segments[-1] for item in table.sequences] == [400, 400]
    assert uncertified == ("pi:5: no certificate at b = 0.5, N = 800: left out",)


def test_whole_spectra_of_a_run(tmp_path: Path) -> None:
    made = Run.create_or_open(tmp_path, "ring", "0" * 8, "", "")
    with pytest.raises(UsageError, match="no equilibria yet"):
        run_spectra(made, "euclidean")
    with pytest.raises(UsageError, match="no equilibria yet"):
        spectral_convergence(made)
    with made.writing():
        for label, n in enumerate((20, 40), 1):
            made.commit(record_of(ring_place(n, 0.3, THESIS), label))
    found = run_spectra(made, "euclidean")
    assert [len(s.modes) for s in found.states] == [37, 77]
    assert all(s.complete for s in found.states)
    assert np.all(np.diff([m.value for m in found.states[0].modes]) >= 0)

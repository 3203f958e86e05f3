"""Spectra: against closed forms, dense algebra and inertia; bounds, metrics, checkerboards."""

from __future__ import annotations

import itertools
import math
import tracemalloc

import numpy as np
import pytest
from numeric_support import Array, load, ring
from scipy import linalg, sparse
from spectral_support import RULES, Place, covered_ring, pi_band, ring_place, ring_values

from ribbon_cli.model.band import Discretisation
from ribbon_cli.model.geometry import geometry
from ribbon_cli.model.metrics import METRICS, folding_differential, lengths, metric_named
from ribbon_cli.model.problem import Problem
from ribbon_cli.solver.inertia import inertia
from ribbon_cli.solver.kkt import KKTMatrix
from ribbon_cli.solver.lanczos import largest_eigenpairs
from ribbon_cli.solver.linear import Factor
from ribbon_cli.solver.pencil import Pencil
from ribbon_cli.solver.prolongation import Phase
from ribbon_cli.solver.spectra import (
    Spectrum,
    _none_missing,
    full_spectra,
    hidden_share,
    lowest_spectrum,
    mode_label,
    sliding_overlap,
)

VALUE_AVERAGE, THESIS = Discretisation.VALUE_AVERAGE, Discretisation.THESIS


def full(place: Place, metric: str = "physical", keep: int = 12) -> Spectrum:
    return full_spectra(place.problem, place.x, place.local, (metric,), keep)[0]


def lowest(place: Place, metric: str = "physical", count: int = 12) -> Spectrum:
    return lowest_spectrum(place.problem, place.x, place.local, metric, count)


def named(spectrum: Spectrum, label: str) -> Array:
    return spectrum.values[[k for k, word in enumerate(spectrum.labels) if word == label]]


# --- the ring, in closed form ---


@pytest.mark.parametrize(("half_width", "length"), [(0.3, math.tau), (0.8, 5.0)])
def test_the_rings_spectrum_is_that_of_its_linearisation(half_width: float, length: float) -> None:
    """Two Richardson steps over N = 40, 80, 160: 4 digits asked for, 5 found."""
    places = (ring_place(n, half_width, VALUE_AVERAGE, length) for n in (40, 80, 160))
    values = [named(lowest(place), "mode") for place in places]
    once = [(4.0 * fine - coarse) / 3.0 for coarse, fine in itertools.pairwise(values)]
    twice = (16.0 * once[1] - once[0]) / 15.0
    expected = ring_values(half_width, length)[:12]
    assert once[1] == pytest.approx(expected, rel=1e-4)
    assert twice == pytest.approx(expected, rel=1e-5)


def test_euclidean_eigenvalues_of_the_ring() -> None:
    """Over h the smallest tends to b k^2 / 3 where the energy sees xi, and to zero, as h^2, where not."""
    smallest = {rule: np.array([named_lowest(n, rule) for n in (20, 40, 80, 160)]) for rule in RULES}
    seen, hidden = smallest[VALUE_AVERAGE], smallest[THESIS]
    assert (4.0 * seen[3] - seen[2]) / 3.0 == pytest.approx(0.3 / 3.0, rel=2e-3)
    orders = np.log2(hidden[:-1] / hidden[1:])
    assert orders[-1] == pytest.approx(2.0, abs=0.05)
    assert hidden[-1] < 0.03 * seen[-1]


def named_lowest(segments: int, rule: Discretisation) -> float:
    spectrum = full(ring_place(segments, 0.3, rule), "euclidean", 0)
    return float(
        min(v for v, label in zip(spectrum.values, spectrum.labels, strict=True) if label != "rotation")
    ) / (math.tau / segments)


def test_checkerboards_of_the_ring_have_a_limit_of_their_own() -> None:
    """eta = +-a costs b kappa^2 2 eta^2 and no xi: 2 b k^2, at second order."""
    found = np.array([named(full(ring_place(n, 0.3, THESIS)), "checkerboard")[0] for n in (40, 80, 160)])
    assert (4.0 * found[2] - found[1]) / 3.0 == pytest.approx(2.0 * 0.3, rel=1e-5)
    assert np.log2((found[1] - found[0]) / (found[2] - found[1])) == pytest.approx(2.0, abs=0.05)


@pytest.mark.parametrize("times", [4, 5])
@pytest.mark.parametrize("rule", RULES)
def test_a_ring_covered_several_times_has_index_two(times: int, rule: Discretisation) -> None:
    """One pair of waves, m = 1 - 1/times, lowers the energy: in closed form, and the same by every count."""
    values = []
    for n in (100, 200):
        place = covered_ring(n, times, 0.1, rule)
        spectrum = lowest(place, count=6)
        values.append(spectrum.values[:2])
        assert place.result.negative == 2
    expected = ring_values(0.1, math.tau, times)[:2]
    assert expected[0] < 0.0
    assert (4.0 * values[1] - values[0]) / 3.0 == pytest.approx(expected, rel=2e-3)


# --- agreement of inertia, dense algebra and Lanczos ---


def test_set(segments: int, rule: Discretisation) -> list[tuple[str, Place, int]]:
    """States of index 0, 1 and 2."""
    return [
        ("pi band", pi_band(segments, rule), 0),
        ("pi band, saddle of the grid", pi_band(segments, rule, Phase.NODE), 1),
        ("ring", ring_place(segments, 0.3, rule), 0),
        ("ring covered four times", covered_ring(segments, 4, 0.1, rule), 2),
    ]


test_set.__test__ = False  # type: ignore[attr-defined]


def check_agreement(segments: int, rule: Discretisation) -> None:
    metrics = ("physical", "euclidean")
    for name, place, index in test_set(segments, rule):
        local, rotations = place.local, place.problem.rotations(place.x)
        matrix = KKTMatrix(place.problem, local, rotations)
        counted = inertia(matrix)
        assert (counted.negative, counted.trusted) == (index, True), name
        assert Factor(matrix).proves_index() == index, name
        for every in full_spectra(place.problem, place.x, local, metrics, 0):
            few = lowest_spectrum(place.problem, place.x, local, every.metric, 8)
            for spectrum in (few, every):
                assert int((spectrum.values < -spectrum.bounds).sum()) == index, (name, every.metric)
                others = [k for k, label in enumerate(spectrum.labels) if label != "rotation"]
                assert (np.abs(spectrum.values) > spectrum.bounds)[others].all(), (name, every.metric)
            # A bound of either leaves room for roundoff of dense algebra, relative to the largest eigenvalue.
            room = few.bounds + every.bounds[: few.values.size] + 1e-14 * every.values[-1]
            assert (np.abs(few.values - every.values[: few.values.size]) <= room).all(), (name, every.metric)


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize(
    "segments", [60, pytest.param(100, marks=pytest.mark.long), pytest.param(200, marks=pytest.mark.long)]
)
def test_inertia_dense_algebra_and_lanczos_agree(segments: int, rule: Discretisation) -> None:
    check_agreement(segments, rule)


@pytest.mark.slow
@pytest.mark.large
@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("segments", [400, 800])
def test_they_agree_on_fine_grids(segments: int, rule: Discretisation) -> None:
    check_agreement(segments, rule)


@pytest.mark.parametrize("segments", [8, 9, 12])
def test_spectra_of_coarse_bands_are_complete(segments: int) -> None:
    place = ring_place(segments, 0.2, VALUE_AVERAGE)
    every, asked = full(place), lowest(place, count=2 * segments)
    assert asked.values.size == 2 * segments - 3
    assert asked.values == pytest.approx(every.values, rel=1e-9, abs=1e-10)


def test_the_folding_metric_by_both_ways() -> None:
    place = pi_band(100, THESIS, Phase.NODE)
    few, every = lowest(place, "folding", 8), full(place, "folding")
    assert few.values == pytest.approx(every.values[: few.values.size], rel=1e-8, abs=1e-10)
    assert few.labels[0] == "sliding"


# --- convergence ---


@pytest.mark.parametrize("rule", RULES)
def test_physical_eigenvalues_of_the_pi_band_converge(rule: Discretisation) -> None:
    """All but sliding at order 2, which falls; under `thesis` the checkerboards are told from them."""
    spectra = {n: lowest(pi_band(n, rule), count=12) for n in (50, 100, 200, 400)}
    sliding = [float(named(s, "sliding")[0]) for s in spectra.values()]
    assert all(b < 0.6 * a for a, b in itertools.pairwise(sliding))
    assert all(s.sliding_overlap.max() > 0.999 for s in spectra.values())
    modes = np.array([named(s, "mode")[:5] for s in spectra.values()])
    changes = np.diff(modes, axis=0)
    if rule is VALUE_AVERAGE:
        orders = np.log2(changes[:-1] / changes[1:])
        assert ((orders > 1.8) & (orders < 2.3)).all()
    assert (np.abs(changes[-1]) < 5e-3 * modes[-1]).all()
    limits = [1.07205, 1.33538, 2.07951, 2.66834, 3.02235]
    assert modes[-1] == pytest.approx(limits, rel=1e-3)


def test_checkerboards_are_those_that_the_other_rule_does_not_have() -> None:
    """Labelled without it, and then compared: without them the two rules have the same list to 3 %."""
    thesis, average = full(pi_band(100, THESIS), keep=20), full(pi_band(100, VALUE_AVERAGE), keep=20)
    assert [k for k, label in enumerate(thesis.labels[:15]) if label == "checkerboard"] == [7, 13]
    assert "checkerboard" not in average.labels
    left = [v for v, label in zip(thesis.values, thesis.labels, strict=True) if label != "checkerboard"][:13]
    assert left == pytest.approx(average.values[:13], rel=0.03)
    assert thesis.values[:13] != pytest.approx(average.values[:13], rel=0.1)


def test_what_is_hidden() -> None:
    """All of the checkerboard under `thesis`, nothing under the other rule, and nothing of a constant."""
    for rule, share in ((THESIS, 1.0), (VALUE_AVERAGE, 0.0)):
        problem = Problem(ring(10, 0.3, rule).band)
        moves = np.zeros((10, 7, 2))
        moves[:, 6, 0], moves[:, 6, 1] = (-1.0) ** np.arange(10), 1.0
        hidden, spread = hidden_share(problem, moves.reshape(70, 2))
        assert hidden == pytest.approx([share, 0.0])
        if share:
            assert spread[0] == pytest.approx(10.0)


@pytest.mark.parametrize("turn", np.linspace(0.0, 1.5, 7))
def test_half_hidden_is_no_checkerboard_however_the_pair_is_turned(turn: float) -> None:
    """Waves of N/4 periods are seen and hidden in equal parts: labels must not depend on roundoff."""
    problem = Problem(ring(20, 0.3, THESIS).band)
    moves = np.zeros((20, 7, 1))
    moves[:, 6, 0] = np.cos(0.5 * np.pi * np.arange(20) + turn)
    (hidden,), (spread,) = hidden_share(problem, moves.reshape(140, 1))
    assert hidden == pytest.approx(0.5, abs=1e-13)
    assert mode_label(0.0, hidden, spread) == "mode"
    assert mode_label(0.0, hidden + 1e-6, 20.0) == "checkerboard"


# --- bounds, counts, metrics ---


def test_residuals_bound_the_distance_to_an_eigenvalue() -> None:
    """Also of vectors that are no eigenvectors: Rayleigh quotients of disturbed modes."""
    place = pi_band(50, VALUE_AVERAGE)
    every = full(place, keep=97)
    pencil = Pencil(place.problem, place.x, place.local, metric_named("physical"))
    random = np.random.default_rng(1)
    modes = every.vectors[3:].reshape(-1, place.problem.size).T
    for size in (1e-6, 1e-3, 1e-1):
        vectors = modes[:, :20] + size * modes @ random.standard_normal((modes.shape[1], 20))
        vectors = vectors / lengths(pencil.mass, vectors)
        quotients = np.einsum("ij,ij->j", vectors, pencil.hessian @ vectors)
        bounds = pencil.residuals(quotients, vectors)
        distance = np.abs(every.values[3:, None] - quotients).min(axis=0)
        assert (distance <= bounds * (1 + 1e-6) + 1e-9).all()


def test_a_missing_eigenvalue_is_noticed() -> None:
    place = ring_place(40, 0.3, VALUE_AVERAGE)
    pencil = Pencil(place.problem, place.x, place.local, metric_named("physical"))
    values = full(place).values[3:]
    assert _none_missing(pencil, values[:12], 12)
    for gone in (0, 1, 5, 10):
        assert not _none_missing(pencil, np.delete(values[:13], gone), 12)


def test_lanczos_finds_multiple_eigenvalues_and_exhausts_small_spaces() -> None:
    mass = METRICS["euclidean"].matrix(ring(3, 0.3))  # the identity of order 21
    sizes = np.repeat([5.0, 4.0, 1.0], 7)
    values, vectors = largest_eigenpairs(lambda w: sizes[:, None] * w, mass, 8, dimension=21)
    assert values == pytest.approx(np.repeat([5.0, 4.0], 4))  # a block sees as many of each as it has vectors
    more, _ = largest_eigenpairs(lambda w: sizes[:, None] * w, mass, 3, dimension=13, known=vectors, seed=1)
    assert more == pytest.approx([5.0, 5.0, 5.0])


@pytest.mark.parametrize("name", list(METRICS))
def test_metrics_measure_moves(name: str) -> None:
    state, _ = load("pi-b0.5-N50")
    mass = metric_named(name).matrix(state)
    assert abs(mass - mass.T).max() < 1e-14
    assert linalg.eigvalsh(mass.toarray())[0] > -1e-12
    weights = {"euclidean": [1.0] * 7, "physical": [state.band.h] * 6 + [0.0]}
    if name in weights:
        assert abs(mass - sparse.diags(np.tile(weights[name], state.band.segments))).max() == 0.0


def test_an_unknown_metric_is_refused() -> None:
    with pytest.raises(ValueError, match="known are euclidean, physical, folding"):
        metric_named("riemannian")


def test_the_folding_differential() -> None:
    """Taylor slope of kappa and eta along the sliding shift of the state, and zero along rotations."""
    state, _ = load("pi-b0.5-N50")
    problem, x = Problem(state.band), state.vector()
    derivative = folding_differential(state)
    assert np.abs(derivative @ problem.rotations(x)).max() < 1e-12
    shape, move = geometry(state), np.random.default_rng(2).standard_normal(problem.size)

    def folds(at: Array) -> Array:
        y = at.reshape(-1, 7)
        before = np.roll(y[:, :3], 1, axis=0)
        kappa = np.einsum("ij,ij->i", y[:, 3:6], np.cross(before, y[:, :3])) / state.band.h
        return np.concatenate((kappa, np.einsum("ij,ij->i", y[:, :3], y[:, 3:6])))

    angle = np.abs(shape.kappa_s) * state.band.h * np.sqrt(1.0 + shape.eta**2)
    assert folds(x)[:50] == pytest.approx(shape.kappa_s * np.sinc(angle / np.pi), abs=1e-12)
    assert folds(x)[50:] == pytest.approx(shape.eta)
    errors = [np.abs(folds(x + t * move) - folds(x) - t * (derivative @ move)).max() for t in (1e-3, 1e-4)]
    assert np.log10(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.05)


def test_overlap_with_sliding() -> None:
    place = pi_band(100, VALUE_AVERAGE)
    modes = lowest(place, count=3).vectors.reshape(-1, place.problem.size)
    overlaps = [sliding_overlap(place.problem, place.x, mode) for mode in modes[3:]]
    assert overlaps[0] > 0.9999
    assert max(overlaps[1:]) < 0.01


# --- fine grids ---


@pytest.mark.long
def test_twelve_pairs_on_a_fine_grid() -> None:
    spectrum = lowest(pi_band(3200, VALUE_AVERAGE), count=12)
    assert spectrum.labels[3] == "sliding"
    assert spectrum.residuals.max() < 1e-8 * spectrum.values.max()
    assert spectrum.values[3] > 100.0 * spectrum.bounds[3]
    assert spectrum.values[4:7] == pytest.approx([1.07195881, 1.33538001, 2.0794790], rel=1e-6)


@pytest.mark.long
def test_memory_is_linear() -> None:
    """Twice the segments, twice the memory; a dense Hessian of N = 1600 alone would take 1 GB."""
    peaks = []
    for n in (800, 1600):
        place = ring_place(n, 0.3, VALUE_AVERAGE)
        local = place.local
        lowest_spectrum(place.problem, place.x, local, "physical", 6)
        tracemalloc.start()
        lowest_spectrum(place.problem, place.x, local, "physical", 6)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 2.3 * peaks[0]
    assert peaks[1] < 100e6


# --- against extended precision ---


def exact(place: Place, mass: sparse.csr_matrix, value: float, mode: Array) -> np.longdouble:
    """The eigenvalue next to a computed one: Newton's method on Wv - mu Mv + C^T nu = 0, Cv = 0 and
    |v|_M = 1, its residuals added up in extended precision."""
    problem, local = place.problem, place.local
    rows = np.vstack((problem.jacobian_matrix(local).toarray(), problem.rotations(place.x).T))
    rows /= np.abs(rows).max(axis=1)[:, None]
    hessian, m, n = problem.hessian_matrix(local).toarray(), mass.toarray(), problem.size
    w, mm, c = (a.astype(np.longdouble) for a in (hessian, m, rows))
    scale = np.append(1.0 / np.sqrt(np.abs(hessian).max(axis=1)), np.ones(len(rows) + 1))
    mu, v = np.longdouble(value), mode.astype(np.longdouble)
    excess = value * (m @ mode) - hessian @ mode
    nu = np.linalg.lstsq(rows.T, excess, rcond=None)[0].astype(np.longdouble)
    bordered = np.zeros((scale.size, scale.size))
    for _ in range(4):
        momentum = mm @ v
        residual = np.concatenate((w @ v - mu * momentum + c.T @ nu, c @ v, [(v @ momentum - 1) / 2]))
        bordered[:n, :n] = hessian - float(mu) * m
        bordered[:n, n:-1], bordered[n:-1, :n] = rows.T, rows
        bordered[:n, -1], bordered[-1, :n] = -momentum.astype(float), momentum.astype(float)
        move = scale * np.linalg.solve(
            bordered * scale[:, None] * scale, -scale * residual.astype(np.float64)
        )
        v, nu, mu = v + move[:n], nu + move[n:-1], mu + move[-1]
    assert abs(move[-1]) <= 1e-15 * abs(mu)
    return mu


def test_the_largest_eigenvalues_against_extended_precision() -> None:
    """There modes that keep the constraints to roundoff alone are off by more than their residuals say."""
    place = pi_band(50, THESIS)
    spectrum = full(place, keep=place.problem.size)
    mass = metric_named("physical").matrix(place.problem.state(place.x))
    for k in (15, 54, 95, 96):
        value = spectrum.values[k]
        error = abs(float(exact(place, mass, value, spectrum.vectors[k].ravel()) - value))
        assert error <= 0.1 * spectrum.bounds[k]
        assert error <= 1e-13 * value

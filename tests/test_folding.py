"""Folding coordinates: both ways, closure, its derivative, seam conventions and errors."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numeric_support import Array, load, random_strip, ring, rotation

from ribbon_cli.model import folding
from ribbon_cli.model.band import Band, State
from ribbon_cli.model.diagnostics import taylor_slopes
from ribbon_cli.model.folding import ClosureError, Folding
from ribbon_cli.model.problem import Problem

CASES = [(20, 1, 0.3), (33, 1, 0.1), (30, -1, 0.1), (51, -1, 0.05)]
ROUNDOFF = 2e-12


def strips() -> list[State]:
    made = [random_strip(Band(n, b, sigma=sigma), seed) for seed, (n, sigma, b) in enumerate(CASES)]
    return [*made, ring(17, 0.4), load("pi-b0.1-N50")[0], load("pi-b0.5-N50")[0]]


def folded(state: State) -> State:
    """The state folded up again from its angles, in its own place."""
    return folding.to_state(state.band, folding.from_state(state), folding.facet_frames(state)[0])


@pytest.mark.parametrize("state", strips())
def test_folded_strips_are_bands(state: State) -> None:
    """Any closed folding satisfies all constraints of (2.19)."""
    problem = Problem(state.band)
    assert np.abs(problem.constraints(state.vector())).max() < 1e-9
    again = folded(state)
    assert np.abs(problem.constraints(again.vector())[:-3]).max() < 1e-9


@pytest.mark.parametrize("state", strips())
def test_state_to_folding_and_back(state: State) -> None:
    again = folded(state)
    np.testing.assert_allclose(again.u, state.u, atol=ROUNDOFF * state.band.segments)
    np.testing.assert_allclose(again.g, state.g, atol=ROUNDOFF * state.band.segments)
    np.testing.assert_allclose(np.tanh(again.xi), np.tanh(state.xi), atol=1e-9)


@pytest.mark.parametrize("state", strips())
def test_folding_to_state_and_back(state: State) -> None:
    fold = folding.from_state(state)
    again = folding.from_state(folding.to_state(state.band, fold, rotation(3)))
    np.testing.assert_allclose(again.theta, fold.theta, atol=1e-11)
    np.testing.assert_allclose(again.eta, fold.eta, atol=1e-11)


@pytest.mark.parametrize("state", strips())
def test_closed_bands_close(state: State) -> None:
    fold = folding.from_state(state)
    assert np.abs(folding.closure(fold, state.band.sigma)[0]).max() < 1e-10
    assert np.abs(folding.closure(fold, -state.band.sigma)[0]).max() > 0.5


def test_energy_of_a_fold_is_by_angle_and_eta() -> None:
    """Q_h = sum (b/h) (1 - cos theta_i) (1 + eta_i^2) F(mean xi), Koldaev (2022), (2.13)-(2.15)."""
    for state in strips():
        fold, band = folding.from_state(state), state.band
        before = np.concatenate((band.sigma * state.xi[-1:], state.xi[:-1]))
        mean = 0.5 * (state.xi + before)
        factor = np.array([x / math.tanh(x) if abs(x) > 1e-6 else 1.0 for x in mean])
        expected = band.half_width / band.h * (1.0 - np.cos(fold.theta)) * (1.0 + fold.eta**2) @ factor
        assert Problem(band).energy(state.vector()) == pytest.approx(expected, rel=1e-10)


@pytest.mark.parametrize("shift", [1, 7, 49])
@pytest.mark.parametrize("name", ["pi-b0.1-N50", "pi-b0.5-N50"])
def test_moving_the_seam_carries_sigma(name: str, shift: int) -> None:
    """On a one-sided band the nodes that pass the seam change side: theta and eta change sign."""
    state, _ = load(name)
    moved_g, moved_xi = np.roll(state.g, -shift, axis=0), np.roll(state.xi, -shift)
    moved_g[-shift:] *= -1.0
    moved_xi[-shift:] *= -1.0
    moved = State(state.band, np.roll(state.u, -shift, axis=0), moved_g, moved_xi)
    old, new = folding.from_state(state), folding.from_state(moved)
    sign = np.where(np.arange(50) >= 50 - shift, -1.0, 1.0)
    np.testing.assert_allclose(new.theta, sign * np.roll(old.theta, -shift), atol=1e-12)
    np.testing.assert_allclose(new.eta, sign * np.roll(old.eta, -shift), atol=1e-12)


def test_ring_has_equal_angles_and_a_mirror_turns_them_round() -> None:
    fold = folding.from_state(ring(12, 0.2))
    np.testing.assert_allclose(fold.theta, math.tau / 12, atol=1e-14)
    assert not fold.eta.any()
    state = random_strip(Band(20, 0.2), 4)
    mirrored = State(state.band, state.u * [1, 1, -1], state.g * [1, 1, -1], state.xi)
    np.testing.assert_allclose(folding.from_state(mirrored).eta, folding.from_state(state).eta, atol=1e-13)
    np.testing.assert_allclose(
        folding.from_state(mirrored).theta, -folding.from_state(state).theta, atol=1e-11
    )


@pytest.mark.parametrize("sigma", [1, -1])
@pytest.mark.parametrize("segments", [5, 24])
def test_closure_derivative_by_taylor_slopes(segments: int, sigma: int) -> None:
    rng = np.random.default_rng(segments + sigma)
    x = rng.uniform(-1.0, 1.0, 2 * segments)
    d = rng.standard_normal(2 * segments) / math.sqrt(segments)

    def residual(y: Array) -> Array:
        return folding.closure(Folding(y[:segments], y[segments:]), sigma)[0]

    _, jacobian = folding.closure(Folding(x[:segments], x[segments:]), sigma)
    slopes = taylor_slopes(residual, x, d, [jacobian @ d])
    assert [s.slope for s in slopes] == pytest.approx([1.0, 2.0], abs=0.03)


@pytest.mark.parametrize("sigma", [1, -1])
def test_closing_is_a_small_change(sigma: int) -> None:
    """A disturbance of size e is answered by a change of size e, and a closed strip is left alone."""
    state = random_strip(Band(40, 0.05, sigma=sigma), 9)
    fold = folding.from_state(state)
    same = folding.close(fold, sigma, tolerance=1e-11)
    assert same is fold
    rng = np.random.default_rng(2)
    for size in (1e-2, 1e-4):
        off = Folding(fold.theta * (1.0 + size * rng.standard_normal(40)), fold.eta)
        closed = folding.close(off, sigma)
        assert np.abs(folding.closure(closed, sigma)[0]).max() < 1e-11
        assert np.abs(closed.theta - fold.theta).max() < 3.0 * size
        assert np.abs(closed.eta - fold.eta).max() < 30.0 * size


def test_a_strip_that_cannot_close_is_reported() -> None:
    state = random_strip(Band(20, 0.1), 1)
    fold = folding.from_state(state)
    with pytest.raises(ClosureError, match="does not close"):
        folding.close(Folding(0.5 * fold.theta, fold.eta), 1, steps=2)


def test_rulings_that_meet_are_reported_with_their_facet() -> None:
    state = random_strip(Band(20, 0.1), 1)
    worst = int(np.argmax(np.abs(state.xi)))
    with pytest.raises(ClosureError, match=rf"facet {worst + 1}: b \|eta'\| = "):
        folding.to_state(Band(20, 50.0), folding.from_state(state))


@pytest.mark.parametrize("bad", ["u", "g", "xi"])
def test_states_of_wrong_shape_are_refused(bad: str) -> None:
    arrays = {"u": np.zeros((5, 3)), "g": np.zeros((5, 3)), "xi": np.zeros(5)}
    arrays[bad] = arrays[bad][:-1]
    with pytest.raises(ValueError, match="state of 5 segments"):
        State(Band(5, 0.1), **arrays)


def test_vectors_pack_and_unpack() -> None:
    state, multipliers = load("pi-b0.5-N50")
    again = State.from_vector(state.band, state.vector())
    for name in ("u", "g", "xi"):
        np.testing.assert_array_equal(getattr(again, name), getattr(state, name))
    packed = multipliers.vector()
    np.testing.assert_array_equal(type(multipliers).from_vector(state.band, packed).vector(), packed)
    np.testing.assert_array_equal(packed[:5], [getattr(multipliers, f"lambda_{k}")[0] for k in range(1, 6)])
    assert not type(multipliers).zeros(state.band).vector().any()
    np.testing.assert_array_equal(state.next_rulings()[-1], -state.g[0])

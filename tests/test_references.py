"""The references themselves: against other formulas, linear theory, derivatives and other integrators."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from references import curved, heavy
from references.helix import Helix, whole_turns
from references.planar import buckled, euler_load
from references.singular import branch_point_in_span, fold_in_tilt, shot
from scipy.integrate import quad, solve_ivp
from scipy.spatial.transform import Rotation

B, L = 0.05, 1.3
SPANS = (0.95, 0.75, 0.5, 0.2, -0.3)


def slope(function, at: float, step: float = 1e-4) -> float:
    """A derivative by central differences of fourth order."""
    near = function(at + step) - function(at - step)
    far = function(at + 2 * step) - function(at - 2 * step)
    return (8 * near - far) / (12 * step)


@pytest.mark.parametrize("span", SPANS)
def test_the_buckled_strip_is_what_its_integrals_say(span: float) -> None:
    strip = buckled(span * L, B, L)
    assert strip.span == pytest.approx(span * L, abs=1e-13)

    def over(function, part: float = 1.0) -> float:
        return quad(lambda s: float(function(np.array(s))), 0, part * L, epsabs=1e-13, limit=200)[0]

    assert over(lambda s: np.cos(strip.angle(s))) == pytest.approx(span * L, abs=1e-12)
    assert over(lambda s: np.sin(strip.angle(s))) == pytest.approx(0, abs=1e-12)
    assert over(lambda s: np.sin(strip.angle(s)), 0.5) == pytest.approx(strip.height, abs=1e-12)
    assert over(lambda s: 0.5 * B * strip.curvature(s) ** 2) == pytest.approx(strip.energy, rel=1e-12)


@pytest.mark.parametrize("span", SPANS)
def test_the_buckled_strip_shot_from_its_start_meets_its_end(span: float) -> None:
    strip = buckled(span * L, B, L)

    def rates(s: float, z: np.ndarray) -> list[float]:
        return [z[1], strip.force[0] * math.sin(z[0]) / B, math.cos(z[0]), math.sin(z[0])]

    first = [0.0, strip.moment[2] / B, 0.0, 0.0]
    last = solve_ivp(rates, (0, L), first, method="DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
    assert last == pytest.approx([0.0, strip.moment[2] / B, span * L, 0.0], abs=1e-8)


@pytest.mark.parametrize("span", SPANS)
def test_the_buckled_strips_force_is_the_slope_of_its_energy(span: float) -> None:
    found = slope(lambda d: buckled(d, B, L).energy, span * L)
    assert found == pytest.approx(buckled(span * L, B, L).force[0], rel=1e-8)


def test_the_buckled_strip_begins_at_eulers_load() -> None:
    for short in (1e-4, 1e-5):
        # P = P_Euler (1 + short/2 + O(short^2)), Love, section 264, for short = 1 - span/l.
        force = buckled((1 - short) * L, B, L).force[0]
        assert force == pytest.approx(euler_load(B, L) * (1 + short / 2), rel=2 * short**2 + 1e-12)


@pytest.mark.parametrize("eta", [-1.2, -0.3, 0.5, 1.0])
@pytest.mark.parametrize("curvature", [0.7, 4.0])
def test_the_helixs_reactions_are_the_slopes_of_its_energy(curvature: float, eta: float) -> None:
    here = Helix(curvature, eta, B, L)
    for vary in (lambda p: Helix(curvature + p, eta, B, L), lambda p: Helix(curvature, eta + p, B, L)):
        moved = np.array([slope(lambda p, k=k, vary=vary: vary(p).point(L)[k], 0.0) for k in range(3)])
        turn = [slope(lambda p, k=k, vary=vary: _turned(here, vary(p))[k], 0.0) for k in range(3)]
        gained = here.force @ moved + here.moment @ np.array(turn)
        assert gained == pytest.approx(slope(lambda p, vary=vary: vary(p).energy, 0.0), rel=1e-8)


def _turned(one: Helix, other: Helix) -> np.ndarray:
    """The rotation vector from the end's frame of one helix to that of another."""
    return Rotation.from_matrix(other.frame(L) @ one.frame(L).T).as_rotvec()


def test_the_helix_balances_and_is_what_its_frame_says() -> None:
    helix = Helix(3.0, 0.6, B, L)
    end = helix.point(L)
    assert helix.start_moment + helix.moment + np.cross(end, helix.force) == pytest.approx(0, abs=1e-14)
    summed = [quad(lambda s, k=k: helix.frame(s)[k, 0], 0, L, epsabs=1e-13)[0] for k in range(3)]
    assert end == pytest.approx(summed, abs=1e-12)
    assert helix.ruling(0.4) == pytest.approx(helix.ruling(0.0), abs=1e-14)
    size = B * 9 * 0.6 * (1 + 0.36) ** 2.5
    assert np.linalg.norm(helix.force) == pytest.approx(size, rel=1e-14)


def test_the_helix_of_whole_turns_ends_with_the_frame_it_started_with() -> None:
    helix = whole_turns(0.8, B, 2, L)
    assert helix.frame(L) == pytest.approx(np.eye(3), abs=1e-13)
    assert helix.point(L) == pytest.approx(L / 1.64 * np.array([0.64, 0, 0.8]), abs=1e-13)
    gained = helix.force @ [slope(lambda e, k=k: whole_turns(e, B, 2, L).point(L)[k], 0.8) for k in range(3)]
    assert gained == pytest.approx(slope(lambda e: whole_turns(e, B, 2, L).energy, 0.8), rel=1e-9)


def test_the_moment_of_the_helix_keeps_its_components_along_the_strip() -> None:
    """Forces and moments balance at every s, by the law for constant kappa and eta."""
    helix = Helix(2.0, 0.5, B, L)
    for s in np.linspace(0, L, 5):
        moment = -helix.start_moment + np.cross(helix.force, helix.point(s))
        assert helix.frame(s).T @ moment == pytest.approx(-helix.start_moment, abs=1e-13)


@pytest.mark.parametrize("curvature", [0.5, 2.0, 4.0])
def test_arcs_and_folded_arcs_have_the_slopes_of_their_energies(curvature: float) -> None:
    k0 = 0.8
    arc = curved.Arc(curvature, B, k0, L)
    found = slope(lambda c: curved.Arc(c, B, k0, L).energy, curvature)
    assert found == pytest.approx(L * arc.moment[2], abs=1e-11)

    def folded(turn: float, n: int = 20) -> curved.FoldedArc:
        return curved.FoldedArc(n, turn, B, k0, L)

    turn = curvature * L / 20
    work = folded(turn).moment * slope(lambda d: folded(d).tilt, turn)
    assert work == pytest.approx(slope(lambda d: folded(d).energy, turn), rel=1e-9, abs=1e-12)
    errors = []
    for n in (400, 800):
        fine = folded(curvature * L / n, n)
        at = curved.Arc(fine.tilt / L, B, k0, L)
        errors.append(
            [fine.energy - at.energy, fine.moment - at.moment[2], fine.span - at.span, fine.lift - at.lift]
        )
    ratio = np.array(errors[0]) / np.array(errors[1])
    assert ratio == pytest.approx(4, abs=0.05)


def test_rings_tend_to_the_continuous_ring() -> None:
    for k0 in (0.0, 1.0, -2.5):
        exact = curved.ring_energy(B, k0, L)
        errors = [curved.discrete_ring_energy(n, B, k0, L) - exact for n in (100, 200)]
        assert errors[0] / errors[1] == pytest.approx(4, abs=0.01)
        summed = quad(lambda s, k0=k0: 0.5 * B * (math.tau / L - k0) ** 2, 0, L)[0]
        assert exact == pytest.approx(summed, rel=1e-13)


@pytest.mark.parametrize("poisson", [0.0, 0.3, 0.5])
@pytest.mark.parametrize(("eta", "slant"), [(0.0, 0.0), (0.7, 0.5), (-1.1, -2.0)])
def test_the_terms_of_natural_curvature_are_integrals_of_the_plates_density(
    poisson: float, eta: float, slant: float
) -> None:
    """The density of docs/strips.md summed across the strip, with `slant` for eta'."""
    kappa, k0 = 1.7, 0.9
    tangent = np.array([1.0, 0.0])
    ruling = np.array([eta, 1.0]) / math.hypot(1.0, eta)
    across = np.array([ruling[1], -ruling[0]])

    def density(v: float, natural: float) -> float:
        bent = kappa * (1 + eta**2) / (1 + v * slant) * np.outer(across, across)
        strain = bent - natural * np.outer(tangent, tangent)
        value = ((1 - poisson) * (strain**2).sum() + poisson * np.trace(strain) ** 2) / 4
        return value * (1 + v * slant)

    added = quad(lambda v: density(v, k0) - density(v, 0.0), -B, B, epsabs=1e-14)[0]
    linear = -B * k0 * kappa * ((1 - poisson) + poisson * (1 + eta**2))
    assert added == pytest.approx(linear + B * k0**2 / 2, rel=1e-12)


def test_the_weightless_strip_is_the_elastica() -> None:
    found = heavy.clamped_clamped(0.6 * L, B, 0.0, length=L)
    exact = buckled(0.6 * L, B, L)
    assert found.bending == found.energy == pytest.approx(exact.energy, rel=1e-10)
    assert found.force == pytest.approx(exact.force, rel=1e-10, abs=1e-12)
    assert found.moment == pytest.approx(exact.moment, rel=1e-10)


@pytest.mark.parametrize(("side", "gravity"), [(1, 5.0), (-1, 5.0), (-1, 100.0)])
def test_the_heavy_strip_balances_and_its_potential_has_the_right_slopes(side: int, gravity: float) -> None:
    def at(span: float = 0.7, lift: float = 0.0, tilt: float = 0.0, weight: float = gravity) -> heavy.Heavy:
        return heavy.clamped_clamped(span, B, weight, side=side, lift=lift, tilt=tilt)

    here = at(lift=0.02, tilt=0.03)
    assert here.energy == pytest.approx(here.bending + 2 * B * gravity * here.lifted, rel=1e-13)
    assert here.force[1] + here.start_force[1] == pytest.approx(2 * B * gravity, rel=1e-12)
    centre = quad(lambda s: (1 - s) * math.cos(float(here.angle(np.array(s)))), 0, 1, epsabs=1e-10)[0]
    turning = here.start_moment[2] + here.moment[2] - 2 * B * gravity * centre
    turning += here.end[0] * here.force[1] - here.end[1] * here.force[0]
    assert turning == pytest.approx(0, abs=1e-8)
    # One direction in which all four change, each by another amount.
    change = {"span": 1.0, "lift": 0.7, "tilt": -0.4, "weight": 2.0}
    where = {"span": 0.7, "lift": 0.02, "tilt": 0.03, "weight": gravity}
    belongs = {
        "span": here.force[0],
        "lift": here.force[1],
        "tilt": here.moment[2],
        "weight": 2 * B * here.lifted,
    }
    found = slope(lambda p: at(**{k: where[k] + p * change[k] for k in where}).energy, 0.0, 2e-3)
    assert found == pytest.approx(sum(belongs[k] * change[k] for k in where), rel=1e-7)


def test_the_heavy_cantilever_sags_as_linear_theory_says() -> None:
    gravity, force = 1e-3, 1e-5
    sagging = heavy.cantilever(B, gravity, length=L)
    assert sagging.end[1] == pytest.approx(-(2 * B * gravity) * L**4 / (8 * B), rel=1e-5)
    pulled = heavy.cantilever(B, end_force=(0.0, force), length=L)
    assert pulled.end[1] == pytest.approx(force * L**3 / (3 * B), rel=1e-5)
    # Half of a linear spring's load potential is stored.
    assert pulled.bending == pytest.approx(force * pulled.end[1] / 2, rel=1e-5)
    assert pulled.energy == pytest.approx(-force * pulled.end[1] / 2, rel=1e-5)


@pytest.mark.parametrize(
    ("gravity", "end_force"), [(20.0, (0.0, 0.0)), (0.0, (0.1, 0.4)), (4.0, (-0.1, 0.2))]
)
def test_the_cantilever_shot_from_its_start_meets_a_free_end(
    gravity: float, end_force: tuple[float, float]
) -> None:
    found = heavy.cantilever(B, gravity, end_force=end_force)

    def rates(s: float, z: np.ndarray) -> list[float]:
        n_y = -found.start_force[1] + 2 * B * gravity * s
        turning = (-found.start_force[0] * math.sin(z[0]) - n_y * math.cos(z[0])) / B
        return [z[1], turning, math.cos(z[0]), math.sin(z[0]), 0.5 * B * z[1] ** 2]

    first = [0.0, -found.start_moment[2] / B, 0.0, 0.0, 0.0]
    last = solve_ivp(rates, (0, 1), first, method="DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
    assert last == pytest.approx([found.tilt, 0.0, *found.end, found.bending], abs=1e-8)
    assert found.force == pytest.approx((*end_force, 0.0), abs=1e-12)


def _determinant(
    p: list[float], rows: tuple[int, ...] = (0, 2, 3), columns: tuple[int, ...] = (0, 1, 2)
) -> float:
    return float(np.linalg.det(shot(np.array(p))[1][np.ix_(rows, columns)]))


def test_the_determinant_of_shooting_vanishes_where_equilibria_are_known_to_be_critical() -> None:
    """At Euler's load of the flat strip, and at span 0, where every start on the figure-eight will do."""
    loads = [-4 * math.pi**2 * (1 + k) for k in (-1e-3, 0, 1e-3)]
    # The flat strip does not move along x.
    flat = [_determinant([0.0, load, 0.0], (0, 3), (0, 2)) for load in loads]
    assert flat[0] * flat[2] < 0
    assert abs(flat[1]) < 1e-10
    eights = []
    for span in (-1e-3, 0.0, 1e-3):
        strip = buckled(span, 1.0)
        eights.append(_determinant([strip.moment[2], strip.force[0], 0.0]))
    assert eights[0] * eights[2] < 0
    assert abs(eights[1]) < 1e-9


def test_a_fold_in_tilt_is_where_two_equilibria_meet() -> None:
    fold = fold_in_tilt(0.75, 0.0, (7.9, -65.0, 8.9, 0.89))
    assert (fold.span, fold.lift) == pytest.approx((0.75, 0.0), abs=1e-9)
    # The branch of equilibria passes the fold with a turn in the tilt, and the energy has a cusp there:
    # dE/dtilt is the moment on both sides.
    tilts, energies = [], []
    for push in (-1e-2, 1e-2):
        p = np.array([_start_curvature(fold), *fold.force])
        p[2] += push
        for _ in range(6):
            z, d = shot(p)
            p[:2] -= np.linalg.solve(d[[2, 3], :2], z[[2, 3]] - [0.75, 0.0])
        z = shot(p)[0]
        tilts.append(z[0])
        energies.append(z[4])
    assert max(tilts) < fold.tilt
    assert np.array(energies) - fold.energy == pytest.approx(
        fold.moment * (np.array(tilts) - fold.tilt), rel=0.05
    )


def _start_curvature(critical) -> float:
    """theta'(0) from the balance of moments: m(0) = m(1) + r x n."""
    return critical.moment + critical.span * critical.force[1] - critical.lift * critical.force[0]


@pytest.mark.parametrize("lift", [0.1, 0.3])
def test_the_branch_point_is_a_critical_equilibrium_with_the_half_turns_symmetry(lift: float) -> None:
    found = branch_point_in_span(lift)
    p = np.array([0.0, *found.force])
    z, d = shot(p)
    assert z == pytest.approx([0.0, 0.0, found.span, found.lift, found.energy], abs=1e-10)
    assert found.lift == pytest.approx(lift, abs=1e-12)
    singular = np.linalg.svd(d[[0, 2, 3]])[1]
    assert singular[2] < 1e-9 * singular[0] < 1e-3 * singular[1]


def test_the_branch_point_is_where_auto_finds_it() -> None:
    """The values that tests/auto prints."""
    found = branch_point_in_span(0.3)
    assert found.span == pytest.approx(0.928439303, abs=2e-9)
    assert found.force == pytest.approx((-38.0286588, -12.2879303), abs=1e-5)


def test_the_page_on_strips_has_the_critical_points() -> None:
    page = (Path(__file__).parents[1] / "docs" / "strips.md").read_text(encoding="utf-8")
    lines = [line for line in page.splitlines() if line.startswith(("| fold", "| branch"))]
    lines = [line for line in lines if "±" not in line]  # those are limits of our branches
    written = [[float(cell.replace("−", "-")) for cell in line.split("|")[2:-1]] for line in lines]
    eight = buckled(0.0, 1.0)
    found = [
        fold_in_tilt(0.75, 0.0, (7.9, -65.0, 8.9, 0.89)),
        fold_in_tilt(0.75, 0.3, (10.8, -68.4, -19.4, 1.2)),
        branch_point_in_span(0.3),
    ]
    rows = [[f.span, f.lift, f.tilt, f.energy, *f.force] for f in found]
    rows.append([0.0, 0.0, 0.0, eight.energy, *eight.force[:2]])
    assert np.array(written) == pytest.approx(np.array(rows), abs=6e-8)

"""States, problems and moves that the tests of model and solver share."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ribbon_cli.model import folding
from ribbon_cli.model.band import Band, Discretisation, Multipliers, State
from ribbon_cli.model.problem import LocalDerivatives, Prescription, Problem
from ribbon_cli.recipes.cylinder import cylinder
from ribbon_cli.solver.continuation import to_segments
from ribbon_cli.solver.kkt import KKTMatrix
from ribbon_cli.solver.newton import Options
from ribbon_cli.solver.status import Result

Array = NDArray[np.float64]
DATA = Path(__file__).parent / "data"
E3 = np.array([0.0, 0.0, 1.0])


def load(name: str) -> tuple[State, Multipliers]:
    """A state kept in tests/data, with its multipliers."""
    with np.load(DATA / f"{name}.npz") as z:
        band = Band(len(z["u"]), float(z["half_width"]), float(z["length"]), int(z["sigma"]))
        return State(band, z["u"], z["g"], z["xi"]), Multipliers.from_vector(band, z["multipliers"])


def named_multipliers(result: Result) -> Multipliers:
    """A result's multipliers by name, normalised as in (1.58)."""
    return Multipliers.from_vector(result.state.band, result.multipliers)


@lru_cache(maxsize=1)
def ladder() -> dict[int, tuple[State, Multipliers]]:
    """The pi band of half-width 0.5 at N = 50, 100, 200, 400."""
    states = {50: load("pi-b0.5-N50")}
    for n in (100, 200, 400):
        found = to_segments(states[n // 2][0], n, Options()).result
        assert found.certified
        states[n] = found.state, named_multipliers(found)
    return states


def rotation(seed: int) -> Array:
    """A proper rotation, fixed by its seed."""
    q, r = np.linalg.qr(np.random.default_rng(seed).standard_normal((3, 3)))
    q = q * np.sign(np.diag(r))
    return q * np.linalg.det(q)


def unit(seed: int) -> Array:
    v = np.random.default_rng(seed).standard_normal(3)
    return v / np.linalg.norm(v)


def twist_prescription(turn: float) -> Prescription:
    """Both rulings at the open seam, turned against each other by an angle, exactly opposite at pi."""
    seam = -E3 if turn == np.pi else np.array([0.0, np.sin(turn), np.cos(turn)])
    return Prescription({0: E3}, seam=seam)


def ring(segments: int, half_width: float, rule: Discretisation = Discretisation.THESIS) -> State:
    return cylinder(Band(segments, half_width, discretisation=rule))


def random_strip(band: Band, seed: int, amplitude: float = 0.1) -> State:
    """A closed isometric band: a ring, or a threefold band for sigma = -1, folded at random and closed."""
    rng = np.random.default_rng(seed)
    n = band.segments
    s = np.arange(n) / n
    waves = np.cos(2.0 * np.pi * (np.outer(s, np.arange(1, 4)) + rng.random(3)))
    theta = np.full(n, 2.0 * np.pi / n)
    eta = np.zeros(n)
    if band.sigma < 0:
        base, _ = load("pi-b0.1-N50")
        fold = folding.from_state(base)
        at = 50.0 * s
        theta = np.interp(at, np.arange(51), np.append(fold.theta, -fold.theta[0])) * 50.0 / n
        eta = np.interp(at, np.arange(51), np.append(fold.eta, -fold.eta[0]))
        waves = waves * np.sin(np.pi * s)[:, None]  # antiperiodic, zero at the seam
    theta = theta * (1.0 + amplitude * waves @ rng.standard_normal(3))
    eta = eta + amplitude * waves @ rng.standard_normal(3)
    return folding.to_state(band, folding.close(folding.Folding(theta, eta), band.sigma), rotation(seed))


def with_rule(state: State, rule: Discretisation) -> State:
    return replace(state, band=replace(state.band, discretisation=rule))


def assemble(problem: Problem, x: Array, multipliers: Array) -> tuple[LocalDerivatives, Array, KKTMatrix]:
    """Derivatives, gauge and KKT matrix at a point."""
    local = problem.local_derivatives(x, multipliers)
    rotations = problem.rotations(x)
    return local, rotations, KKTMatrix(problem, local, rotations)

"""`python -m bench.survey`: looks for equilibria of bands with one half-twist from random starts.

A start is a random strip, closed in folding coordinates and kept where its linking number is +-1/2. From it
the k lowest modes of the projected Hessian are climbed and all others descended (Cerjan & Miller 1981), so
that what is found has mostly index k. Dense algebra, O(N^3) a step: for coarse meshes, N up to 60 or so.
docs/everted-moebius.md says what came of it.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy

from ribbon_cli.model.band import Array, Band, State
from ribbon_cli.model.contact import self_contact
from ribbon_cli.model.folding import ClosureError, Folding, close, from_state, to_state
from ribbon_cli.model.problem import Problem
from ribbon_cli.model.topology import linking_number
from ribbon_cli.solver.kkt import FactorisationError, KKTMatrix
from ribbon_cli.solver.linear import Factor
from ribbon_cli.solver.newton import Options, change, estimate_multipliers, inverted_facets, solve
from ribbon_cli.solver.saddle_free import null_space

STEP_LIMIT = 0.15
MOST_STEPS = 120
RESIDUAL = 1e-9
SAME_ENERGY = 1e-5
"""Energies of one equilibrium found twice, relative."""


@dataclass(frozen=True)
class Found:
    """A stationary band: its state, energy Q_h, index and number of inflections."""

    state: State
    energy: float
    index: int
    inflections: int

    @property
    def key(self) -> tuple[int, int, int]:
        """What tells one from another."""
        return round(self.energy / SAME_ENERGY), self.index, self.inflections


def smooth_start(band: Band, rng: np.random.Generator) -> Folding:
    """Curvature and eta as sums of the four longest antiperiodic waves."""
    s = (np.arange(band.segments) + 0.5) / band.segments
    kappa, eta = np.zeros(band.segments), np.zeros(band.segments)
    for m in range(4):
        wave = np.stack((np.cos((2 * m + 1) * np.pi * s), np.sin((2 * m + 1) * np.pi * s)))
        kappa += rng.normal(size=2) @ wave
        eta += rng.normal(size=2) @ wave / (m + 1)
    return _scaled(band, kappa, eta, rng)


def units_start(band: Band, rng: np.random.Generator) -> Folding:
    """Three inflections anywhere, curvatures of alternating sign between them and any eta."""
    ends = np.sort(rng.uniform(size=3))
    while min(*np.diff(ends), 1.0 - (ends[2] - ends[0])) < 0.12:
        ends = np.sort(rng.uniform(size=3))
    bend, skew, turn = rng.uniform(0.5, 1.5, 3), 0.8 * rng.normal(size=3), 0.8 * rng.normal(size=3)
    s = (np.arange(band.segments) + 0.5) / band.segments
    unit = np.searchsorted(ends, s) - 1
    side = np.where(unit < 0, -1.0, 1.0)  # before the first inflection it is the last unit, seen turned over
    start = np.where(unit < 0, ends[2] - 1.0, ends[unit])
    stop = np.where(unit < 0, ends[0], np.where(unit == 2, ends[0] + 1.0, ends[np.minimum(unit + 1, 2)]))
    unit %= 3
    t = np.pi * (s - start) / (stop - start)
    kappa = side * (-1.0) ** unit * bend[unit] * np.sin(t)
    eta = side * (skew[unit] * np.sin(t) + turn[unit] * np.sin(2 * t))
    return _scaled(band, kappa, eta, rng)


def _scaled(band: Band, kappa: Array, eta: Array, rng: np.random.Generator) -> Folding:
    """Fold angles of a curvature and eta brought to random sizes, in units of 2 pi / length."""
    kappa = kappa * (rng.uniform(1.2, 2.2) * math.tau / band.length / np.sqrt(np.mean(kappa**2)))
    eta = eta * (rng.uniform(0.2, 1.0) / np.sqrt(np.mean(eta**2)))
    return Folding(kappa * band.h * np.sqrt(1.0 + eta**2), eta)


STARTS = {"smooth": smooth_start, "units": units_start}


def linking(state: State) -> float:
    """Lk, not a number where the band is open or passes through itself."""
    try:
        return linking_number(state.u, state.g, state.band.sigma, state.band.h).linking_number
    except ValueError:
        return math.nan


def inflections(state: State) -> int:
    """How often the fold angle changes its sign along the closed strip."""
    side = np.sign(from_state(state).theta)
    return int((side != np.append(side[1:], state.band.sigma * side[0])).sum())


def random_band(band: Band, rng: np.random.Generator) -> State | None:
    """A random band with Lk = 1/2, or the mirror image of one with -1/2; None if the dice fall otherwise."""
    made = STARTS[list(STARTS)[int(rng.integers(len(STARTS)))]](band, rng)
    try:
        folding = close(made, band.sigma)
        state = to_state(band, folding)
    except (ClosureError, np.linalg.LinAlgError):
        return None
    lk = linking(state)
    if not abs(abs(lk) - 0.5) < 1e-6:
        return None
    return state if lk > 0 else to_state(band, Folding(-folding.theta, folding.eta))


def climbed(problem: Problem, x: Array, modes: int) -> Found | str:
    """The stationary band met by climbing so many modes from x (7N,), or a word why there is none."""
    limit = STEP_LIMIT
    for _ in range(MOST_STEPS):
        try:
            multipliers = estimate_multipliers(problem, x)
        except FactorisationError:
            return "degenerate"
        local = problem.local_derivatives(x, multipliers)
        gradient = problem.lagrangian_gradient(local, multipliers)
        basis = null_space(problem, local, problem.rotations(x))
        hessian = problem.hessian_matrix(local)
        values, vectors = scipy.linalg.eigh(basis.T @ (hessian @ basis))
        if max(np.abs(gradient).max(), np.abs(problem.constraints(x)).max()) < RESIDUAL:
            state = problem.state(x)
            return Found(state, local.energy, int((values < 0).sum()), inflections(state))
        slopes = vectors.T @ (basis.T @ gradient)
        step = -slopes / np.maximum(np.abs(values), 1e-8)
        step[:modes] *= -1.0
        trial = drawn_back(problem, x, basis @ (vectors @ step), limit)
        if trial is None:
            limit *= 0.5
            if limit < 1e-3:
                return "stuck"
            continue
        x = trial
        if abs(linking(problem.state(x)) - 0.5) > 0.25:
            return "passed through itself"
    return "not in time"


def drawn_back(problem: Problem, x: Array, move: Array, limit: float) -> Array | None:
    """A move no longer than the limit, drawn back to the constraints; None where that fails."""
    y = x + move * min(1.0, limit / change(x, move))
    local = problem.local_derivatives(x, None)
    try:
        normal = Factor(KKTMatrix(problem, local, np.zeros((problem.size, 0))).with_unit_metric())
        for _ in range(8):
            back = np.concatenate((np.zeros(problem.size), -problem.weighted_constraints(y)))
            y = y + normal.solve(back)[: problem.size]
            if not np.isfinite(y).all():
                return None
            if np.abs(problem.constraints(y)).max() < 1e-12:
                break
    except FactorisationError:
        return None
    if (inverted_facets(problem, y) <= 0).any() or change(x, y - x) > 3 * limit:
        return None
    return y


def survey(
    band: Band, seed: int, starts: int, climbs: Sequence[int]
) -> tuple[dict[tuple[int, int, int], Found], Counter[tuple[int, int, int]], Counter[str]]:
    """What `starts` random bands led to: the equilibria, how often each, and how the others ended."""
    rng, problem = np.random.default_rng(seed), Problem(band)
    found: dict[tuple[int, int, int], Found] = {}
    often: Counter[tuple[int, int, int]] = Counter()
    others: Counter[str] = Counter()
    done = 0
    while done < starts:
        state = random_band(band, rng)
        if state is None:
            continue
        done += 1
        # A few steps down take the worst wrinkles out; how many decides how far from a minimum it starts.
        few = Options(max_steps=int(rng.integers(3, 15)), leave_saddles=0)
        x = solve(problem, state.vector(), None, few).x
        if not abs(linking(problem.state(x)) - 0.5) < 0.25:
            others["passed through itself"] += 1
            continue
        for modes in climbs:
            end = climbed(problem, x, modes)
            if isinstance(end, str):
                others[end] += 1
            else:
                found.setdefault(end.key, end)
                often[end.key] += 1
        if sys.stderr.isatty():
            print(f"\r{done} of {starts} starts, {len(found)} equilibria", end="", file=sys.stderr)
    return found, often, others


def lines(found: dict[tuple[int, int, int], Found], often: Counter[tuple[int, int, int]]) -> list[str]:
    """The equilibria as a table, lowest energy first."""
    out = ["         E   index  inflections  contact  found"]
    for key in sorted(found):
        one = found[key]
        problem, state = Problem(one.state.band), one.state
        end = problem.end_ruling(state.vector())
        touch = self_contact(state.u, state.g, end, state.band.half_width, state.band.h).contact
        row = f"{one.energy:10.6f}  {one.index:6d}  {one.inflections:11d}  {'yes' if touch else 'no':>7}"
        out.append(f"{row}  {often[key]:5d}")
    return out


def main(arguments: Sequence[str] | None = None) -> None:
    """Survey one mesh, print what was found, and keep the states if asked to."""
    parser = argparse.ArgumentParser(prog="python -m bench.survey", description=__doc__)
    parser.add_argument("--half-width", type=float, default=0.2)
    parser.add_argument("--segments", type=int, default=40)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--starts", type=int, default=100)
    parser.add_argument("--climb", type=int, nargs="+", default=[1, 2, 3])
    parser.add_argument("--output", type=Path, help="a folder for the states found, as npz files")
    given = parser.parse_args(arguments)
    band = Band(given.segments, given.half_width, math.tau, -1)
    found, often, others = survey(band, given.seed, given.starts, given.climb)
    print("\n".join(lines(found, often)))
    print("; ".join(f"{word}: {count}" for word, count in sorted(others.items())))
    if given.output is not None:
        given.output.mkdir(parents=True, exist_ok=True)
        for key, one in found.items():
            save(given.output / f"N{given.segments}-E{one.energy:.6f}-index{key[1]}.npz", one.state)


def save(path: Path, state: State) -> None:
    """A state as the npz file that a config can start from."""
    band = state.band
    np.savez_compressed(
        path,
        u=state.u,
        g=state.g,
        xi=state.xi,
        half_width=band.half_width,
        length=band.length,
        sigma=band.sigma,
        discretisation=str(band.discretisation),
    )


if __name__ == "__main__":
    main()

"""Taylor slopes of every energy term, every kind of end, both rules and every parameter.

Terms are those of `TERMS`: a new one is tested here without a word about it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ribbon_cli.model.band import Array, Band, Discretisation
from ribbon_cli.model.bending import Bending
from ribbon_cli.model.diagnostics import problem_slopes, taylor_slopes
from ribbon_cli.model.entries import hessian_places
from ribbon_cli.model.problem import Problem
from ribbon_cli.model.rates import rates
from ribbon_cli.model.stencil import SIZE
from ribbon_cli.model.term import Term
from ribbon_cli.model.terms import TERMS
from ribbon_cli.parts import FINISHES, HALF_WIDTH, STARTS, Ends, Loads, Material, Parts

PARTS = Parts(
    Ends("clamped", "clamped", 0.7, 0.1, 0.05, 0.3, 0.2, 0.1, -0.2),
    Material(1.3, 0.3),
    Loads(2.0, (0.0, -1.0, 0.5), (0.3, 0.2, 0.1), (1.0, 2.0, 3.0), 0.43),
)
STEPS = np.logspace(-3.0, 0.0, 16)
KINDS = [(start, end) for start in STARTS for end in FINISHES]


def strip(rule: Discretisation = Discretisation.THESIS, start: str = "clamped", end: str = "clamped") -> Band:
    assert PARTS.ends is not None
    parts = replace(PARTS, ends=replace(PARTS.ends, start=start, end=end))
    return Band(9, 0.08, 1.0, 0, rule, parts)


def wherever(kind: type[Term]) -> Band:
    """A strip with an end at which there is something of a term."""
    found = next((strip(end=end) for end in FINISHES if kind(strip(end=end)).active), None)
    assert found is not None, f"{kind.__name__} is active at no end of a strip with all of its parameters"
    return found


def point(problem: Problem) -> tuple[Array, Array, Array]:
    """An x that is no equilibrium nor isometric, multipliers, and a direction."""
    rng = np.random.default_rng(1)
    x = problem.impose(rng.standard_normal(problem.size))
    return x, rng.standard_normal(problem.rows), rng.standard_normal(problem.size)


def whole(hessian: Array) -> Array:
    """Local Hessians (M,14,14) from their entries on and above the diagonal."""
    upper = np.triu(hessian.transpose(2, 0, 1))
    return upper + np.triu(upper, 1).transpose(0, 2, 1)


@pytest.mark.parametrize("kind", TERMS, ids=lambda term: term.__name__)
def test_a_terms_derivatives_in_the_local_vectors(kind: type[Term]) -> None:
    term = kind(wherever(kind))
    rng = np.random.default_rng(2)
    local, along = (rng.standard_normal((SIZE, 10)) for _ in range(2))
    hessian = np.zeros((SIZE, SIZE, 10))
    term.add_hessian(local, hessian)
    pushed = np.einsum("kij,jk->ik", whole(hessian), along)
    gradient = term.gradient(local)
    values = taylor_slopes(
        lambda y: float(term.values(y).sum()),
        local,
        along,
        [float((gradient * along).sum()), float((pushed * along).sum())],
    )
    assert min(values[1].slope - 2, values[2].slope - 3) > -0.1
    assert taylor_slopes(term.gradient, local, along, [pushed])[1].slope > 1.9


@pytest.mark.parametrize("kind", TERMS, ids=lambda term: term.__name__)
def test_a_terms_hessian_stays_within_the_couplings_that_it_declares(kind: type[Term]) -> None:
    """What lies elsewhere would be left out of the assembled matrix without a word."""
    term = kind(wherever(kind))
    hessian = np.zeros((SIZE, SIZE, 10))
    term.add_hessian(np.random.default_rng(3).standard_normal((SIZE, 10)), hessian)
    kept = np.zeros((SIZE, SIZE), dtype=bool)
    kept[hessian_places(term.couplings)] = True
    assert not np.triu(np.abs(hessian).max(axis=2))[~kept].any()


@pytest.mark.parametrize("kind", [Bending, *TERMS], ids=lambda term: term.__name__)
def test_a_terms_rates(kind: type[Term]) -> None:
    """By every parameter of the problem, and zero by those that it does not name."""
    band = wherever(kind)
    local = np.random.default_rng(4).standard_normal((SIZE, 10))
    for name, value in band.parameters.items():
        rate, by_local = kind(band).rate(name, local)
        if name not in (HALF_WIDTH, *kind.parameters):
            assert (rate, float(np.abs(by_local).max())) == (0.0, 0.0)
        unit = 0.05 if name == HALF_WIDTH else 1.0

        def at(t: Array, name: str = name, value: float = value) -> Term:
            return kind(band.with_parameter(name, value + float(t[0])))

        second = kind(band).second_rate(name, local)
        values = taylor_slopes(
            lambda t, at=at: float(at(t).values(local).sum()),
            np.zeros(1),
            np.array([unit]),
            [unit * rate, unit**2 * second],
            STEPS,
        )
        gradients = taylor_slopes(
            lambda t, at=at: at(t).gradient(local),
            np.zeros(1),
            np.array([unit]),
            [unit * by_local],
            STEPS,
        )
        assert min(values[1].slope - 2, values[2].slope - 3, gradients[1].slope - 2) > -0.1, name


@pytest.mark.parametrize("rule", Discretisation)
@pytest.mark.parametrize(("start", "end"), KINDS)
def test_a_strips_derivatives(start: str, end: str, rule: Discretisation) -> None:
    problem = Problem(strip(rule, start, end))
    slopes = problem_slopes(problem, *point(problem))
    expected = {"energy": 2, "constraints": 2, "lagrangian": 3, "gradient": 2}
    for name, order in expected.items():
        assert slopes[name] > order - 0.1, (name, slopes)


@pytest.mark.parametrize(("start", "end"), KINDS)
def test_the_rates_by_every_parameter(start: str, end: str) -> None:
    band = strip(Discretisation.VALUE_AVERAGE, start, end)
    check_rates(band)


def test_the_rates_of_a_closed_band_with_natural_curvature() -> None:
    band = Band(9, 0.08, 1.0, 1, parts=Parts(material=Material(1.3, 0.3)))
    assert list(band.parameters) == [HALF_WIDTH, "natural_curvature"]
    check_rates(band)
    problem = Problem(band)
    assert problem_slopes(problem, *point(problem))["lagrangian"] > 2.9


def check_rates(band: Band) -> None:
    """L_p, d_p grad L, d_p c and L_pp."""
    here = Problem(band)
    x, multipliers, _ = point(here)
    gradient = here.gradient(x)
    for name, value in band.parameters.items():
        unit = 0.05 if name == HALF_WIDTH else 1.0

        def moved(t: Array, name: str = name, value: float = value) -> tuple[Problem, Array]:
            problem = Problem(band.with_parameter(name, value + float(t[0])))
            return problem, problem.impose(x)

        def lagrangian(t: Array, moved=moved) -> float:
            problem, y = moved(t)
            return problem.energy(y) - float(multipliers @ problem.weighted_constraints(y))

        def conditions(t: Array, moved=moved) -> Array:
            problem, y = moved(t)
            local = problem.local_derivatives(y, None)
            return np.concatenate((problem.lagrangian_gradient(local, multipliers), local.constraints))

        found = rates(here, x, multipliers, gradient, name)
        start, along = np.zeros(1), np.array([unit])
        expansion = [unit * found.lagrangian, unit**2 * found.second]
        slopes = unit * np.concatenate((found.gradient, found.constraints))
        values = taylor_slopes(lagrangian, start, along, expansion, STEPS)
        residuals = taylor_slopes(conditions, start, along, [slopes], STEPS)
        assert min(values[1].slope - 2, values[2].slope - 3, residuals[1].slope - 2) > -0.1, name

"""What contacts do for a minimum: with their rows none falls, without them some do; none can be left out."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest
import scipy
from resting_support import resting

from ribbon_cli.model.touching import Shape
from ribbon_cli.model.touching_audit import audit
from ribbon_cli.solver.inertia import inertia
from ribbon_cli.solver.newton import Options, solve
from ribbon_cli.solver.resting import RestingProblem
from ribbon_cli.solver.resting_certificate import certified
from ribbon_cli.solver.resting_kkt import kkt_matrix
from ribbon_cli.solver.resting_set import Rest, rest_at
from ribbon_cli.solver.status import Status

PI, THREE = "pi-b1.65-N100", "3pi-b0.9-N120"
APART = 0.02


@lru_cache
def _rest(name: str, gap: float) -> Rest:
    state, pairs, *_ = resting(name + (f"-gap{gap}" if gap else ""))
    problem = RestingProblem(state.band, pairs, gap)
    result = solve(problem, state.vector(), None, Options(leave_saddles=0))
    own, forces = problem.split(result.multipliers)
    return rest_at(result.state, own, pairs, forces, gap)


@pytest.mark.parametrize(
    ("gap", "out", "falling"),
    [
        (0.0, [4], 1),
        pytest.param(0.0, [0, 1, 2, 3, 4, 5], 3, marks=pytest.mark.long),
        pytest.param(APART, [0, 1], 1, marks=pytest.mark.long),
        (APART, [0, 1, 2, 3, 4, 5], 3),
    ],
)
def test_minima_that_fall_without_rows(gap, out, falling):
    """3 pi bands that touch, and that keep a gap: dense algebra and counts agree on the same Hessian, with
    all that forces add to it."""
    rest = _rest(THREE, gap)
    order = np.array([k for k in range(6) if k not in out] + out)
    problem = RestingProblem(rest.band, rest.pairs.take(order), gap)
    x, multipliers = rest.result.x, np.concatenate((rest.multipliers, rest.forces[order]))
    local = problem.local_derivatives(x, multipliers)
    rotations = problem.rotations(x)
    rows, hessian = problem.jacobian_matrix(local).toarray(), problem.hessian_matrix(local)
    for kept, expected in ((6, 0), (6 - len(out), falling)):
        basis = scipy.linalg.null_space(np.vstack((rows[: problem.base.rows + kept], rotations.T)))
        values = np.linalg.eigvalsh(basis.T @ (hessian @ basis))
        counted = inertia(kkt_matrix(problem, local.keeping(kept), rotations))
        assert (values < 0).sum() == counted.negative == expected
        assert counted.trusted
    assert rest.result.status is Status.MINIMUM


@pytest.mark.parametrize(
    ("name", "gap"),
    [
        (PI, 0.0),
        *(
            pytest.param(*case, marks=pytest.mark.long)
            for case in ((THREE, 0.0), (PI, APART), (THREE, APART))
        ),
    ],
)
def test_no_contact_with_a_force_can_be_left_out(name, gap):
    """Where it was it is not stationary, and where that leads to features cross or come nearer."""
    rest = _rest(name, gap)
    assert rest.forces.min() > 0.1
    for k in range(len(rest.pairs)):
        keep = np.arange(len(rest.pairs)) != k
        fewer = RestingProblem(rest.band, rest.pairs.take(keep), gap)
        point = np.concatenate((rest.multipliers, rest.forces[keep]))
        for steps in (0, 12):
            options = Options(max_steps=steps, leave_saddles=0)
            result = solve(fewer, rest.result.x, point, options)
            seen = audit(Shape.of(result.state, gap), gap + 1e-9)
            assert not certified(fewer, result, seen).certified

"""The peer of the benchmark: the same discrete problem, solved by CasADi and IPOPT at their best.

Unknowns are u, g, xi of N facets (7N), constraints 5N + 3, the energy is Q_h with q_i = |u_i - u_{i-1}|^2/2;
both discretisations are there. What helps the peer, each measured on the bands of Table 3.1:

- One node's energy, constraints and their exact derivatives are SX functions, mapped over the nodes; constant
  sparse matrices gather them into gradient, Jacobian and Hessian. At N = 3200 that builds in 0.2 s where
  differentiating the whole problem takes 6 s, and evaluates as fast.
- The half-width is a parameter: one build serves all widths.
- With multipliers at hand, IPOPT starts from them and three components are fixed to hold the rotations;
  without multipliers it estimates them itself, and then the fixed components do harm: they are left free.
- No scaling of the problem, MUMPS (SPRAL takes five times as long), tolerance 1e-9, and 1e-8 where
  rounding allows no better.

IPOPT certifies nothing: a success may be a saddle or another minimum than the one sought.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy import sparse

Array = NDArray[np.float64]

TOLERANCE = 1e-9
OPTIONS: dict[str, Any] = {
    "print_time": False,
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    "ipopt.tol": TOLERANCE,
    "ipopt.acceptable_tol": 10 * TOLERANCE,
    "ipopt.max_iter": 500,
    "ipopt.linear_solver": "mumps",
    "ipopt.nlp_scaling_method": "none",
}

# Local unknowns of node i: u_{i-1}, xi_{i-1}, u_i, g_i, xi_i, g_{i+1}.
_LOCAL = 14
_SERIES_BELOW = 0.1


@dataclass(frozen=True)
class Start:
    """A state to start from: `u` (N,3), `g` (N,3), `xi` (N,)."""

    u: Array
    g: Array
    xi: Array

    def packed(self) -> Array:
        """The 7N unknowns, node after node."""
        return np.hstack([self.u, self.g, self.xi[:, None]]).ravel()


@dataclass(frozen=True)
class PeerResult(Start):
    """What IPOPT returned.

    `success` and `status` are IPOPT's own. `multipliers` (5N + 3,) are those of L = Q_h + multipliers .
    constraints: five a node in the order of `_constraints`, then the closure's. `seconds` is the solve alone.
    """

    success: bool
    status: str
    multipliers: Array
    energy: float
    iterations: int
    seconds: float


@dataclass(frozen=True)
class Peer:
    """The built problem for one N, seam sign and discretisation; every half-width is solved by it."""

    segments: int
    sigma: int
    rule: str
    length: float
    build_seconds: float
    _cold: ca.Function = field(repr=False)
    _warm: ca.Function = field(repr=False)

    def solve(self, start: Start, half_width: float, multipliers: Array | None = None) -> PeerResult:
        """Solve at `half_width` from `start`; the result lies in the start's orientation.

        Raises ValueError if the start has another number of facets.
        """
        n = self.segments
        if start.u.shape != (n, 3) or start.g.shape != (n, 3) or start.xi.shape != (n,):
            raise ValueError(f"the start has {len(start.u)} facets, the problem {n}")
        frame = np.eye(3) if multipliers is None else _frame(start)
        turned = Start(start.u @ frame.T, start.g @ frame.T, start.xi).packed()
        arguments: dict[str, Any] = {"x0": turned, "p": half_width, "lbg": 0.0, "ubg": 0.0}
        solver = self._cold
        if multipliers is not None:
            solver = self._warm
            upper = np.full(7 * n, np.inf)
            upper[[1, 2, 4]] = 0.0  # u_1 along the first axis, g_1 in the plane of first and third
            arguments |= {"lbx": -upper, "ubx": upper}
            arguments["lam_g0"] = np.concatenate([multipliers[:-3], frame @ multipliers[-3:]])
        began = time.perf_counter()
        answer = solver(**arguments)
        seconds = time.perf_counter() - began
        stats = solver.stats()
        x = np.array(answer["x"]).reshape(n, 7)
        dual = np.array(answer["lam_g"]).ravel()
        return PeerResult(
            u=x[:, :3] @ frame,
            g=x[:, 3:6] @ frame,
            xi=x[:, 6].copy(),
            success=bool(stats["success"]),
            status=str(stats["return_status"]),
            multipliers=np.concatenate([dual[:-3], frame.T @ dual[-3:]]),
            energy=float(answer["f"]),
            iterations=int(stats["iter_count"]),
            seconds=seconds,
        )


def build(segments: int, sigma: int, rule: str = "thesis", length: float = 2 * math.pi) -> Peer:
    """Build the problem; `rule` is "thesis" or "value-average".

    Raises ValueError for another rule or sign, or fewer than three facets.
    """
    if rule not in ("thesis", "value-average") or sigma not in (-1, 1) or segments < 3:
        raise ValueError(f"no problem with rule {rule!r}, sigma = {sigma}, N = {segments}")
    began = time.perf_counter()
    problem, derivatives = _problem(segments, sigma, rule, length)
    options = {**OPTIONS, **derivatives}
    cold = ca.nlpsol("cold", "ipopt", problem, options)
    warm = ca.nlpsol("warm", "ipopt", problem, {**options, "ipopt.warm_start_init_point": "yes"})
    return Peer(segments, sigma, rule, length, time.perf_counter() - began, cold, warm)


def _frame(start: Start) -> Array:
    """Rotation (3,3) that takes u_1 to the first axis and the part of g_1 across it to the third."""
    first = start.u[0] / np.linalg.norm(start.u[0])
    across = start.g[0] - (start.g[0] @ first) * first
    third = across / np.linalg.norm(across)
    return np.vstack([first, np.cross(third, first), third])


def stiffening(x: ca.SX) -> ca.SX:
    """F(x) = x/tanh x; the untaken branch is evaluated at 1, so that no derivative divides by zero.

    Up to |x| = 0.1 the series to x^10 is exact to 1e-17, and in its second derivative to 1e-14.
    """
    small = ca.fabs(x) < _SERIES_BELOW
    safe = ca.if_else(small, 1.0, x)
    s = x * x
    series = 1 + s * (1 / 3 + s * (-1 / 45 + s * (2 / 945 + s * (-1 / 4725 + s * (2 / 93555)))))
    return ca.if_else(small, series, safe / ca.tanh(safe))


def _energy(z: ca.SX, parameters: ca.SX, rule: str) -> ca.SX:
    """Node i's term of Q_h, Koldaev (2022), (2.14), at its 14 local unknowns."""
    u_before, xi_before, u, g, xi = z[0:3], parameters[0] * z[3], z[4:7], z[7:10], z[10]
    half_width, h = parameters[2], parameters[3]
    turn = u - u_before
    if rule == "thesis":
        factor = stiffening((xi + xi_before) / 2)
    else:
        factor = (stiffening(xi) + stiffening(xi_before)) / 2
    return ca.dot(turn, turn) / 2 * ca.dot(g, g) ** 2 * half_width * factor / h


def _constraints(z: ca.SX, parameters: ca.SX) -> ca.SX:
    """Node i's five constraints, Koldaev (2022), (2.19), at its 14 local unknowns."""
    u_before, u, g, xi, g_after = z[0:3], z[4:7], z[7:10], z[10], parameters[1] * z[11:14]
    half_width, h = parameters[2], parameters[3]
    slope = ca.dot(u, g)
    return ca.vertcat(
        ca.dot(u, u) - 1,
        ca.dot(g, g) - slope**2 - 1,
        ca.dot(u - u_before, g),
        ca.dot(ca.cross(u, g), g_after),
        half_width / h * (ca.dot(u, g_after) - slope) - ca.tanh(xi),
    )


def _problem(n: int, sigma: int, rule: str, length: float) -> tuple[dict[str, ca.MX], dict[str, ca.Function]]:
    """The problem for `nlpsol`, and its gradient, Jacobian and Hessian as `nlpsol` wants them."""
    z, parameters = ca.SX.sym("z", _LOCAL), ca.SX.sym("parameters", 4)
    weight, lam = ca.SX.sym("weight"), ca.SX.sym("lam", 5)
    energy, constraints = _energy(z, parameters, rule), _constraints(z, parameters)
    jacobian = ca.jacobian(constraints, z)
    hessian = ca.triu(ca.hessian(weight * energy + ca.dot(lam, constraints), z)[0])

    def mapped(name: str, inputs: list[ca.SX], outputs: list[ca.SX]) -> ca.Function:
        return ca.Function(name, inputs, outputs, {"cse": True}).map(n)

    nodes = np.arange(7 * n).reshape(n, 7)
    before, after = np.roll(nodes, 1, axis=0), np.roll(nodes, -1, axis=0)
    local = np.hstack([before[:, :3], before[:, 6:], nodes, after[:, 3:6]])
    signs = np.ones((2, n))
    signs[0, 0] = signs[1, -1] = sigma  # xi_0 = sigma xi_N and g_{N+1} = sigma g_1

    x, b = ca.MX.sym("x", 7 * n), ca.MX.sym("b")
    weights, duals = ca.MX.sym("weights"), ca.MX.sym("duals", 5 * n + 3)
    at = ca.reshape(x[local.ravel().tolist()], _LOCAL, n)
    given = ca.vertcat(ca.DM(signs), ca.repmat(b, 1, n), ca.DM.ones(1, n) * (length / n))
    closure = ca.sum2(ca.reshape(x, 7, n)[:3, :])

    f = ca.sum2(mapped("f", [z, parameters], [energy])(at, given))
    g = ca.vertcat(ca.vec(mapped("g", [z, parameters], [constraints])(at, given)), closure)
    slopes = ca.vec(mapped("df", [z, parameters], [ca.gradient(energy, z)])(at, given))
    gradient = ca.densify(gather(local, np.zeros_like(local), slopes, (7 * n, 1)))

    rows, columns = (np.array(k) for k in jacobian.sparsity().get_triplet())
    blocks = ca.vec(mapped("dg", [z, parameters], [jacobian.nz[:]])(at, given))
    down = np.append((5 * np.arange(n)[:, None] + rows).ravel(), np.tile(5 * n + np.arange(3), n))
    across = np.append(local[:, columns].ravel(), nodes[:, :3].ravel())
    j = gather(down, across, ca.vertcat(blocks, ca.DM.ones(3 * n)), (5 * n + 3, 7 * n))

    rows, columns = (local[:, np.array(k)] for k in hessian.sparsity().get_triplet())
    curvature = mapped("ddf", [z, parameters, weight, lam], [hessian.nz[:]])
    blocks = ca.vec(curvature(at, given, ca.repmat(weights, 1, n), ca.reshape(duals[: 5 * n], 5, n)))
    hess = gather(np.minimum(rows, columns), np.maximum(rows, columns), blocks, (7 * n, 7 * n))
    return {"x": x, "p": b, "f": f, "g": g}, {
        "grad_f": ca.Function("nlp_grad_f", [x, b], [f, gradient], ["x", "p"], ["f", "grad_f_x"]),
        "jac_g": ca.Function("nlp_jac_g", [x, b], [g, j], ["x", "p"], ["g", "jac_g_x"]),
        "hess_lag": ca.Function(
            "nlp_hess_l",
            [x, b, weights, duals],
            [hess],
            ["x", "p", "lam_f", "lam_g"],
            ["triu_hess_gamma_x_x"],
        ),
    }


def gather(
    rows: NDArray[np.int64], columns: NDArray[np.int64], values: ca.MX, shape: tuple[int, int]
) -> ca.MX:
    """The sparse matrix that sums `values` (k, 1) at (`rows`, `columns`), both of size k."""
    rows, columns = rows.ravel(), columns.ravel()
    pattern = sparse.csc_matrix((np.ones(rows.size), (rows, columns)), shape=shape)
    pattern.sum_duplicates()
    places = np.repeat(np.arange(shape[1]), np.diff(pattern.indptr)) * shape[0] + pattern.indices
    target = np.searchsorted(places, columns * shape[0] + rows)
    # One entry a column: column k of the summing matrix adds value k to its place.
    summing = ca.Sparsity(places.size, rows.size, list(range(rows.size + 1)), target.tolist())
    layout = ca.Sparsity(*shape, pattern.indptr.tolist(), pattern.indices.tolist())
    return ca.MX(layout, ca.mtimes(ca.DM(summing, 1.0), values))


WIDTHS = (0.1, 0.2, 0.5, 0.8, 1.0, 1.5)
LEVELS = (50, 100, 200, 400)
_SMALLEST_STEP = 1e-3


@dataclass
class Tally:
    """What a series of solves gave, and what it cost: building, successes and failures apart."""

    results: dict[tuple[float, int], PeerResult] = field(default_factory=dict)
    failures: list[str] = field(default_factory=list)
    build_seconds: float = 0.0
    useful_seconds: float = 0.0
    failed_seconds: float = 0.0
    iterations: int = 0

    def build(self, segments: int, sigma: int, rule: str, length: float) -> Peer:
        """Build a problem on this account."""
        peer = build(segments, sigma, rule, length)
        self.build_seconds += peer.build_seconds
        return peer

    def solve(
        self, peer: Peer, start: Start, half_width: float, multipliers: Array | None
    ) -> PeerResult | None:
        """Solve on this account; None for a failure."""
        result = peer.solve(start, half_width, multipliers)
        self.iterations += result.iterations
        if result.success:
            self.useful_seconds += result.seconds
            return result
        self.failed_seconds += result.seconds
        self.failures.append(f"b = {half_width:g}, N = {peer.segments}: {result.status}")
        return None


def split_facets(state: PeerResult, sigma: int) -> tuple[Start, Array]:
    """Start and multipliers for 2N facets, Koldaev (2022), section 3.1: each facet becomes two.

    The ruling between them is the mean of its neighbours. The halves share each multiplier equally: most
    constraints stand for h times a continuous one; for the other two (fold and triple product) keeping the
    multiplier as it is was tried and costs IPOPT half as many iterations again.
    """
    after = np.vstack([state.g[1:], sigma * state.g[:1]])
    rulings = np.stack([state.g, (state.g + after) / 2], axis=1).reshape(-1, 3)
    shared = np.repeat(state.multipliers[:-3].reshape(-1, 5), 2, axis=0).ravel()
    start = Start(np.repeat(state.u, 2, axis=0), rulings, np.repeat(state.xi, 2))
    return start, np.append(shared, state.multipliers[-3:]) / 2


def table_own_way(
    start: Start,
    sigma: int = -1,
    rule: str = "thesis",
    widths: tuple[float, ...] = WIDTHS,
    levels: tuple[int, ...] = LEVELS,
    length: float = 2 * math.pi,
) -> Tally:
    """All of Table 3.1 as a user of IPOPT would get it, from `start` with `levels[0]` facets at `widths[0]`.

    Continuation over the widths on the coarsest level, halving a step that fails; at each width the facets
    are split from level to level. What could not be reached is missing in `results`.
    """
    tally = Tally()
    peers = [tally.build(n, sigma, rule, length) for n in levels]
    state = tally.solve(peers[0], start, widths[0], None)
    for k, half_width in enumerate(widths):
        if state is not None and k > 0:
            state = _continue(tally, peers[0], state, widths[k - 1], half_width)
        if state is None:
            break
        tally.results[half_width, levels[0]] = state
        coarse = state
        for peer in peers[1:]:
            earlier = tally.results.get((widths[k - 1], peer.segments)) if k > 0 else None
            fine = _refine(tally, peer, coarse, earlier, half_width)
            if fine is None:
                break
            tally.results[half_width, peer.segments] = coarse = fine
    return tally


def _continue(tally: Tally, peer: Peer, state: PeerResult, here: float, target: float) -> PeerResult | None:
    """Take `state` from width `here` to `target`, halving the step while it fails."""
    reach = target
    while True:
        result = tally.solve(peer, state, reach, state.multipliers)
        if result is None:
            reach = (here + reach) / 2
            if abs(reach - here) < _SMALLEST_STEP:
                return None
        elif reach == target:
            return result
        else:
            state, here, reach = result, reach, target


def _refine(
    tally: Tally, peer: Peer, coarse: PeerResult, earlier: PeerResult | None, half_width: float
) -> PeerResult | None:
    """Solve on twice the facets: with multipliers, else without, else from the width before on this grid."""
    start, multipliers = split_facets(coarse, peer.sigma)
    result = tally.solve(peer, start, half_width, multipliers) or tally.solve(peer, start, half_width, None)
    if result is None and earlier is not None:
        result = tally.solve(peer, earlier, half_width, earlier.multipliers)
    return result


def from_guesses(
    guesses: list[tuple[Start, float, int]], sigma: int, rule: str = "thesis", length: float = 2 * math.pi
) -> Tally:
    """Solve from each (start, half-width, N) as it stands, building once for each N.

    The multipliers are IPOPT's least-squares estimate, which a good start makes good ones.
    """
    tally = Tally()
    peers = {n: tally.build(n, sigma, rule, length) for n in sorted({n for _, _, n in guesses})}
    for start, half_width, n in guesses:
        result = tally.solve(peers[n], start, half_width, None)
        if result is not None:
            tally.results[half_width, n] = result
    return tally

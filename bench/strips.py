"""The peer's side for strips between clamps: the same discrete problem, solved by CasADi and IPOPT.

Facets 1..N lie between nodes 1..N+1, whose first and last rulings are held. Inner nodes are those of a band.
The folds between a clamp's tangent and its neighbouring facet span half a cell: q |g|^4 b F(xi) 2/h with the
xi of that facet under both rules. Unknowns are (u_1, xi_1), then (g_i, u_i, xi_i) for nodes 2..N: 7N - 3.
Constraints are 5N + 3: |u|^2 = 1, the triple product and the stretching for each facet, |g|^2 - (g.u)^2 = 1
for each inner node, no fold across its ruling for each node, and h sum u = the end's place.

What helps the peer is as in `peer`: exact derivatives of one node's functions mapped over the nodes, width
and place of the end as parameters of one build, multipliers of the last step as a start. The clamps leave no
motion free, so that nothing has to be fixed.
"""

from __future__ import annotations

import math
import sys
import time
from dataclasses import dataclass, field
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from .peer import OPTIONS, gather, stiffening

Array = NDArray[np.float64]
Index = NDArray[np.int64]
RULES = ("thesis", "value-average")
_PLACES = 15
"""Parameters after the half-width: the end's place, t_A, g_1, t_B, g_{N+1}."""


@dataclass(frozen=True)
class Clamps:
    """The end's place (3,) in the start's frame, and tangents and rulings (3,) of both clamps."""

    place: Array
    tangents: tuple[Array, Array] = (np.array([1.0, 0.0, 0.0]), np.array([1.0, 0.0, 0.0]))
    rulings: tuple[Array, Array] = (np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, 1.0]))

    def packed(self) -> Array:
        """The parameters after the half-width."""
        (first, last), (start, end) = self.tangents, self.rulings
        return np.concatenate((self.place, first, start, last, end))


@dataclass(frozen=True)
class StripStart:
    """A state to start from: `u` (N,3), `g` (N+1,3) with both held rulings, `xi` (N,)."""

    u: Array
    g: Array
    xi: Array

    def packed(self) -> Array:
        """The 7N - 3 unknowns, node after node."""
        nodes = np.hstack([self.g[:-1], self.u, self.xi[:, None]])
        return nodes.ravel()[3:]


@dataclass(frozen=True)
class StripResult(StripStart):
    """What IPOPT returned; `force` (3,) is what the end's clamp exerts, dE/dplace."""

    success: bool
    status: str
    multipliers: Array
    force: Array
    energy: float
    iterations: int
    seconds: float


@dataclass(frozen=True)
class StripPeer:
    """The built problem for one N, length and rule."""

    segments: int
    rule: str
    length: float
    build_seconds: float
    _cold: ca.Function = field(repr=False)
    _warm: ca.Function = field(repr=False)

    def solve(
        self, start: StripStart, half_width: float, clamps: Clamps, multipliers: Array | None = None
    ) -> StripResult:
        """Solve from `start`, warm where multipliers are given."""
        n = self.segments
        values = np.concatenate(([half_width], clamps.packed()))
        arguments: dict[str, Any] = {"x0": start.packed(), "p": values, "lbg": 0.0, "ubg": 0.0}
        solver = self._cold
        if multipliers is not None:
            solver, arguments["lam_g0"] = self._warm, multipliers
        began = time.perf_counter()
        answer = solver(**arguments)
        seconds = time.perf_counter() - began
        stats = solver.stats()
        x = np.array(answer["x"]).ravel()
        nodes = np.concatenate((clamps.rulings[0], x)).reshape(n, 7)
        dual = np.array(answer["lam_g"]).ravel()
        return StripResult(
            u=nodes[:, 3:6].copy(),
            g=np.vstack((nodes[:, :3], clamps.rulings[1])),
            xi=nodes[:, 6].copy(),
            success=bool(stats["success"]),
            status=str(stats["return_status"]),
            multipliers=dual,
            force=-dual[-3:],
            energy=float(answer["f"]),
            iterations=int(stats["iter_count"]),
            seconds=seconds,
        )


@dataclass(frozen=True)
class _Part:
    """Functions of one kind of node: local symbols, their places (k, size), energy and constraints."""

    name: str
    local: ca.SX
    places: Index
    given: ca.SX
    values: ca.MX
    energy: ca.SX
    constraints: ca.SX


def build(segments: int, rule: str = "thesis", length: float = 1.0) -> StripPeer:
    """Build the problem. Raises ValueError for another rule or fewer than three facets."""
    if rule not in RULES or segments < 3:
        raise ValueError(f"no problem with rule {rule!r}, N = {segments}")
    began = time.perf_counter()
    problem, derivatives = _problem(segments, rule, length)
    options = {**OPTIONS, **derivatives}
    cold = ca.nlpsol("cold", "ipopt", problem, options)
    warm = ca.nlpsol("warm", "ipopt", problem, {**options, "ipopt.warm_start_init_point": "yes"})
    return StripPeer(segments, rule, length, time.perf_counter() - began, cold, warm)


def _fold(u_before: ca.SX, u: ca.SX, g: ca.SX, factor: ca.SX, b: ca.SX, h: ca.SX) -> ca.SX:
    turn = u - u_before
    return ca.dot(turn, turn) / 2 * ca.dot(g, g) ** 2 * b * factor / h


def _facet(u: ca.SX, xi: ca.SX, g: ca.SX, g_after: ca.SX, b: ca.SX, h: ca.SX) -> list[ca.SX]:
    stretch = b / h * ca.dot(u, g_after - g) - ca.tanh(xi)
    return [ca.dot(u, u) - 1, ca.dot(ca.cross(u, g), g_after), stretch]


def _inner(rule: str, places: Index, values: ca.MX) -> _Part:
    """Node i = 2..N with facet i - 1 before it: u, xi of it, then g, u, xi of the node."""
    z, p = ca.SX.sym("inner", 11), ca.SX.sym("given", 2)
    u_before, xi_before, g, u, xi = z[:3], z[3], z[4:7], z[7:10], z[10]
    if rule == "thesis":
        factor = stiffening((xi + xi_before) / 2)
    else:
        factor = (stiffening(xi) + stiffening(xi_before)) / 2
    rows = ca.vertcat(ca.dot(g, g) - ca.dot(g, u) ** 2 - 1, ca.dot(u - u_before, g))
    return _Part("inner", z, places, p, values, _fold(u_before, u, g, factor, p[0], p[1]), rows)


def _middle(places: Index, values: ca.MX) -> _Part:
    """Facet i = 2..N-1 between free rulings: g, u, xi, next g."""
    z, p = ca.SX.sym("facet", 10), ca.SX.sym("given", 2)
    rows = _facet(z[3:6], z[6], z[:3], z[7:10], p[0], p[1])
    return _Part("facet", z, places, p, values, ca.SX(0), ca.vertcat(*rows))


def _end(name: str, at_start: bool, places: Index, values: ca.MX) -> _Part:
    """A clamp's fold and facet: u, xi of the facet and its free ruling; given are b, h, tangent, ruling."""
    z, p = ca.SX.sym(name, 7), ca.SX.sym("given", 8)
    u, xi, free, tangent, held = z[:3], z[3], z[4:7], p[2:5], p[5:8]
    between = (held, free) if at_start else (free, held)
    rows = [ca.dot(u - tangent, held), *_facet(u, xi, *between, p[0], p[1])]
    energy = _fold(tangent, u, held, stiffening(xi), p[0], p[1] / 2)
    return _Part(name, z, places, p, values, energy, ca.vertcat(*rows))


def _parts(n: int, rule: str, length: float, p: ca.MX) -> list[_Part]:
    nodes = np.arange(7 * n).reshape(n, 7) - 3  # -3..-1 would be g_1, which is held
    g, rest = nodes[:, :3], nodes[:, 3:]
    common = ca.vertcat(p[0], length / n)
    last = np.concatenate((rest[-1], g[-1]))[None]
    return [
        _inner(rule, np.hstack((rest[:-1], nodes[1:])), ca.repmat(common, 1, n - 1)),
        _middle(np.hstack((nodes[1:-1], g[2:])), ca.repmat(common, 1, n - 2)),
        _end("start", True, np.concatenate((rest[0], g[1]))[None], ca.vertcat(common, p[4:10])),
        _end("end", False, last, ca.vertcat(common, p[10:16])),
    ]


def _problem(n: int, rule: str, length: float) -> tuple[dict[str, ca.MX], dict[str, ca.Function]]:
    """The problem for `nlpsol`, and its gradient, Jacobian and Hessian as `nlpsol` wants them."""
    size = 7 * n - 3
    x, p = ca.MX.sym("x", size), ca.MX.sym("p", 1 + _PLACES)
    weight, duals = ca.MX.sym("weight"), ca.MX.sym("duals", 5 * n + 3)
    energy, rows = ca.MX(0), []
    slopes: list[tuple[Index, Index, ca.MX]] = []
    jacobian: list[tuple[Index, Index, ca.MX]] = []
    hessian: list[tuple[Index, Index, ca.MX]] = []
    first = 0
    for part in _parts(n, rule, length, p):
        count, places, z = len(part.places), part.places, part.local
        many = part.constraints.numel()
        scale, lam = ca.SX.sym("scale"), ca.SX.sym("lam", many)
        at = ca.reshape(x[places.ravel().tolist()], z.numel(), count)
        at_duals = ca.reshape(duals[first : first + many * count], many, count)
        scales = ca.repmat(weight, 1, count)

        def mapped(out: ca.SX, part: _Part = part, extra: tuple[ca.SX, ...] = ()) -> ca.Function:
            inputs = [part.local, part.given, *extra]
            return ca.Function(part.name, inputs, [out], {"cse": True}).map(len(part.places))

        energy += ca.sum2(mapped(part.energy)(at, part.values))
        rows.append(ca.vec(mapped(part.constraints)(at, part.values)))
        gradient = ca.densify(ca.gradient(part.energy, z))
        slopes.append((places, np.zeros_like(places), ca.vec(mapped(gradient)(at, part.values))))
        block = ca.jacobian(part.constraints, z)
        down, across = (np.array(k) for k in block.sparsity().get_triplet())
        under = first + many * np.arange(count)[:, None] + down
        jacobian.append((under, places[:, across], ca.vec(mapped(block.nz[:])(at, part.values))))
        block = ca.triu(ca.hessian(scale * part.energy + ca.dot(lam, part.constraints), z)[0])
        down, across = (places[:, np.array(k)] for k in block.sparsity().get_triplet())
        curved = mapped(block.nz[:], extra=(scale, lam))(at, part.values, scales, at_duals)
        hessian.append((np.minimum(down, across), np.maximum(down, across), ca.vec(curved)))
        first += many * count
    u = np.arange(7 * n).reshape(n, 7)[:, 3:6] - 3
    h = length / n
    closing = ca.sum2(ca.reshape(x[u.ravel().tolist()], 3, n)) * h - p[1:4]
    jacobian.append((np.tile(first + np.arange(3), n), u, ca.MX(ca.DM.ones(3 * n) * h)))
    g = ca.vertcat(*rows, closing)

    def assembled(entries: list[tuple[Index, Index, ca.MX]], shape: tuple[int, int]) -> ca.MX:
        down, across = (np.concatenate([e[k].ravel() for e in entries]) for k in (0, 1))
        return gather(down, across, ca.vertcat(*(e[2] for e in entries)), shape)

    slope = ca.densify(assembled(slopes, (size, 1)))
    j, curvature = assembled(jacobian, (5 * n + 3, size)), assembled(hessian, (size, size))
    names = ["x", "p", "lam_f", "lam_g"]
    return {"x": x, "p": p, "f": energy, "g": g}, {
        "grad_f": ca.Function("nlp_grad_f", [x, p], [energy, slope], names[:2], ["f", "grad_f_x"]),
        "jac_g": ca.Function("nlp_jac_g", [x, p], [g, j], names[:2], ["g", "jac_g_x"]),
        "hess_lag": ca.Function(
            "nlp_hess_l", [x, p, weight, duals], [curvature], names, ["triu_hess_gamma_x_x"]
        ),
    }


def planar_start(segments: int, span: float, length: float = 1.0) -> StripStart:
    """A planar strip of about this span: theta = a sin(2 pi s/l), whose mean cosine is J_0(a)."""
    s = (np.arange(segments) + 0.5) / segments
    angle = math.sqrt(4.0 * (1.0 - span / length)) * np.sin(2.0 * math.pi * s)
    u = np.column_stack((np.cos(angle), np.sin(angle), np.zeros(segments)))
    return StripStart(u, np.tile([0.0, 0.0, 1.0], (segments + 1, 1)), np.zeros(segments))


@dataclass
class Path:
    """States along a path, and what they cost: solves that failed apart."""

    states: list[StripResult] = field(default_factory=list)
    failures: list[str] = field(default_factory=list)
    seconds: float = 0.0
    failed_seconds: float = 0.0
    iterations: int = 0

    def take(self, result: StripResult, where: str) -> bool:
        """Count a solve, and keep its state if it succeeded; whether it did."""
        self.iterations += result.iterations
        if result.success:
            self.seconds += result.seconds
            self.states.append(result)
        else:
            self.failed_seconds += result.seconds
            self.failures.append(f"{where}: {result.status}")
        return result.success


def shear_path(
    peer: StripPeer, start: StripStart, span: float, half_width: float, shear: float, steps: int
) -> Path:
    """From `start` at shear 0 to `shear` in equal steps, each from the last state and its multipliers, and
    without these where that fails; the path ends where both fail."""
    path = Path()
    state, multipliers = start, None
    for k in range(steps + 1):
        clamps = Clamps(np.array([span, 0.0, shear * k / steps]))
        for warm in (multipliers, None) if multipliers is not None else (None,):
            result = peer.solve(state, half_width, clamps, warm)
            if path.take(result, f"shear {shear * k / steps:.3f}"):
                break
        else:
            return path
        state, multipliers = result, result.multipliers
    return path


def main() -> None:
    """`python -m bench.strips [N ...]`: the path to shear 0.3 at span 0.75, b = 0.05, in 20 steps."""
    for n in [int(word) for word in sys.argv[1:]] or [200]:
        for rule in RULES:
            peer = build(n, rule)
            path = shear_path(peer, planar_start(n, 0.75), 0.75, 0.05, 0.3, 20)
            print(
                f"N = {n}, {rule}: {len(path.states)} states, {path.iterations} iterations, "
                f"{path.seconds:.2f} s and {path.failed_seconds:.2f} s in {len(path.failures)} failures"
            )
            for k in range(0, len(path.states), 5):
                shear, state = 0.3 * k / 20, path.states[k]
                print(f"  shear {shear:.3f}: E = {state.energy:.10f}, force {state.force}, {state.status}")


if __name__ == "__main__":
    main()

"""What an equilibrium of the continuum must fulfil, evaluated on a discrete one.

The Euler-Lagrange equations (1.61)-(1.63) of Koldaev (2022), with the errata of docs/errata.md, as functions
of arclength on the reconstructed band, and the matching conditions (1.64)-(1.66) at its seam. At the discrete
places and by centred differences the same equations hold to the solver's tolerance: there they are what the
solver solves. Here derivatives are those of splines, and what is left measures the distance to the continuum.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from .band import Array, Discretisation, Multipliers, State
from .constraints import sech_squared
from .energy import coth_factor
from .multiplier_theory import fields_of
from .reconstruction import Reconstruction
from .splines import BandSpline
from .staggered import behind, facets, nodes

_SIDE = 5
"""Points of the one-sided polynomials at the seam: their order, 4 for derivatives, exceeds the scheme's."""


@dataclass(frozen=True)
class EquilibriumResiduals:
    """Left-hand sides at arclengths alpha (n,), zero in the continuum.

    `force` (n,3) is (1.61) integrated once, its constant being the closure force:
    (zeta_d'' - lambda_3 g)' + 2 lambda_1 d' - 2 lambda_2 eta g + lambda_4 (g x g') + b lambda_5 g' + gamma;
    `balance` (n,3) its derivative, (1.61) itself; `moment` (n,3) is (1.62); `slope` (n,) is (1.63) without
    the factor xi.
    """

    force: Array
    balance: Array
    moment: Array
    slope: Array


@dataclass(frozen=True)
class SeamConditions:
    """Mismatches (3,) at the seam, the limits at l and at 0 taken from their own sides alone.

    `moment` is (1.64), zeta_d'' - lambda_3 g; `force` is (1.65) as corrected, `ruling` (1.66) as corrected,
    lambda_4 (d' x g) + b lambda_5 d' at l less sigma times the same at 0, and `ruling_unsigned` the same
    without sigma. `start` and `finish` are (1.65)'s limits at 0 and l plus gamma, zero in the continuum.
    """

    moment: Array
    force: Array
    ruling: Array
    ruling_unsigned: Array
    start: Array
    finish: Array


def nodal_moment(state: State) -> Array:
    """zeta_d'' (N,3) at the nodes, b |g|^4 F d'' with d'' = (u_i - u_{i-1})/h, as in the discrete energy."""
    band = state.band
    previous = behind(state.xi, band.sigma)
    if band.discretisation is Discretisation.THESIS:
        f = coth_factor(0.5 * (previous + state.xi))[0]
    else:
        f = 0.5 * (coth_factor(previous)[0] + coth_factor(state.xi)[0])
    size2 = np.einsum("ij,ij->i", state.g, state.g)
    out: Array = (band.half_width / band.h * size2**2 * f)[:, None] * (state.u - behind(state.u, 1))
    return out


class Equilibrium:
    """The fields of an equilibrium and its multipliers as splines.

    With `eliminate_xi`, xi and lambda_5 follow from the surface alone, by tanh xi = b d'.g' and (1.63), and
    their discrete values do not enter: the equations are then those of Wunderlich's energy (1.48), of whose
    density -b lambda_5 is the derivative with respect to eta'. Raises ValueError where they have no value,
    rulings of the reconstructed surface meeting at its edge.
    """

    def __init__(self, state: State, multipliers: Multipliers, *, eliminate_xi: bool = False) -> None:
        band = state.band
        field = fields_of(state, multipliers)
        self.band = band
        self.gamma = field.gamma
        self.shape = Reconstruction(state)
        moment, five = nodal_moment(state), field.lambda_5
        self._xi: Callable[[Array], Array] = self.shape.xi
        if eliminate_xi:
            moment = self._moment_of_shape(nodes(band))
            five = self._lambda_5_of_shape(facets(band))
            self._xi = self._xi_of_shape
        self._one = BandSpline(band, field.lambda_1, 0.5, 1)
        self._two = BandSpline(band, field.lambda_2, 0.0, 1)
        self._three = BandSpline(band, field.lambda_3, 0.0, band.sigma)
        self._four = BandSpline(band, field.lambda_4, 0.5, 1)
        self._five = BandSpline(band, five, 0.5, band.sigma)
        self._bracket = BandSpline(band, moment - field.lambda_3[:, None] * state.g, 0.0, 1)

    def residuals(self, alpha: Array) -> EquilibriumResiduals:
        """Residuals at arclengths alpha (n,)."""
        b, shape = self.band.half_width, self.shape
        u, du = shape.tangent(alpha), shape.tangent(alpha, 1)
        g, dg, ddg = shape.ruling(alpha), shape.ruling(alpha, 1), shape.ruling(alpha, 2)
        xi = self._xi(alpha)
        f, f1, _ = coth_factor(xi)
        one, done = self._columns(self._one, alpha)
        two, dtwo = self._columns(self._two, alpha)
        three = self._three(alpha)[:, None]
        four, dfour = self._columns(self._four, alpha)
        five, dfive = self._columns(self._five, alpha)
        eta, deta = _column(u, g), _column(du, g) + _column(u, dg)
        bend, size2 = _column(du, du), _column(g, g)
        cross = np.cross(g, dg)

        force = self._bracket(alpha, 1) + 2.0 * one * u - 2.0 * two * eta * g
        force += four * cross + b * five * dg + self.gamma
        balance = self._bracket(alpha, 2) + 2.0 * (done * u + one * du)
        balance -= 2.0 * ((dtwo * eta + two * deta) * g + two * eta * dg)
        balance += dfour * cross + four * np.cross(g, ddg) + b * (dfive * dg + five * ddg)
        moment = dfour * np.cross(u, g) + four * (np.cross(du, g) + np.cross(u, dg))
        moment += b * (dfive * u + five * du) + (2.0 * b * bend * size2 * f[:, None]) * g
        moment -= 2.0 * two * (g - eta * u) + three * du
        slope = (0.5 * b * bend * size2**2)[:, 0] * f1 + five[:, 0] * sech_squared(xi)
        return EquilibriumResiduals(force, balance, moment, slope)

    @staticmethod
    def _columns(spline: BandSpline, alpha: Array) -> tuple[Array, Array]:
        """A scalar field and its derivative as columns (n,1)."""
        return spline(alpha)[:, None], spline(alpha, 1)[:, None]

    def _xi_of_shape(self, alpha: Array) -> Array:
        """xi (n,) by (1.52). Raises ValueError."""
        rise = self.band.half_width * _column(self.shape.tangent(alpha), self.shape.ruling(alpha, 1))[:, 0]
        if np.any(np.abs(rise) >= 1.0):
            raise ValueError("rulings of the reconstructed surface meet at its edge: it has no xi there")
        out: Array = np.arctanh(rise)
        return out

    def _moment_of_shape(self, alpha: Array) -> Array:
        """zeta_d'' (n,3) of the reconstructed surface."""
        du, g = self.shape.tangent(alpha, 1), self.shape.ruling(alpha)
        f = coth_factor(self._xi_of_shape(alpha))[0][:, None]
        out: Array = self.band.half_width * _column(g, g) ** 2 * f * du
        return out

    def _lambda_5_of_shape(self, alpha: Array) -> Array:
        """lambda_5 (n,) by (1.63) on the reconstructed surface."""
        du, g = self.shape.tangent(alpha, 1), self.shape.ruling(alpha)
        xi = self._xi_of_shape(alpha)
        bend = (_column(du, du) * _column(g, g) ** 2)[:, 0]
        out: Array = -0.5 * self.band.half_width * bend * coth_factor(xi)[1] / sech_squared(xi)
        return out


def seam_conditions(state: State, multipliers: Multipliers) -> SeamConditions:
    """The matching conditions at the seam of a band of at least 12 facets.

    Each limit is that of polynomials through the nearest five values on its own side; what the stencil across
    the seam has computed at the seam's node is not used, but for g_1 and g_{N+1} = sigma g_1 themselves.
    """
    band = state.band
    b, sigma = band.half_width, band.sigma
    field = fields_of(state, multipliers)
    bracket = nodal_moment(state) - field.lambda_3[:, None] * state.g
    rulings = np.vstack((state.g, sigma * state.g[:1]))
    limits = []
    for end in (False, True):
        u = _limit(state.u, 0.5, end)
        g = rulings[-1 if end else 0]
        dg = _limit(rulings, 0.0, end, 1) / band.h
        # The first node is the seam's own: its values are left out at either end.
        p, dp = _limit(bracket[1:], 1.0, end), _limit(bracket[1:], 1.0, end, 1) / band.h
        one, four, five = (_limit(v, 0.5, end) for v in (field.lambda_1, field.lambda_4, field.lambda_5))
        two = _limit(field.lambda_2[1:], 1.0, end)
        eta = u @ g
        force = dp + 2.0 * one * u - 2.0 * two * eta * g + four * np.cross(g, dg) + b * five * dg
        limits.append((p, force, four * np.cross(u, g) + b * five * u))
    start, finish = limits
    return SeamConditions(
        moment=finish[0] - start[0],
        force=finish[1] - start[1],
        ruling=finish[2] - sigma * start[2],
        ruling_unsigned=finish[2] - start[2],
        start=start[1] + field.gamma,
        finish=finish[1] + field.gamma,
    )


def moved_seam(state: State, multipliers: Multipliers, node: int) -> tuple[State, Multipliers]:
    """The same band with its seam at another node, 0 <= node < N.

    What is odd in g changes sign between the old seam and the new one.
    """
    sigma = state.band.sigma
    sign = np.where(np.arange(state.band.segments) < node, sigma, 1)

    def even(values: Array) -> Array:
        return np.roll(values, -node, axis=0)

    def odd(values: Array) -> Array:
        return np.roll(values * sign.reshape(-1, *[1] * (values.ndim - 1)), -node, axis=0)

    moved = replace(
        multipliers,
        lambda_1=even(multipliers.lambda_1),
        lambda_2=even(multipliers.lambda_2),
        lambda_3=odd(multipliers.lambda_3),
        lambda_4=even(multipliers.lambda_4),
        lambda_5=odd(multipliers.lambda_5),
    )
    return State(state.band, even(state.u), odd(state.g), odd(state.xi)), moved


def _limit(values: Array, offset: float, end: bool, derivative: int = 0) -> Array:
    """Limit at the seam of values (n, ...) at offset, 1 + offset, ... steps from it, or its slope per step.

    With `end` the values are those before the seam, the last of them `offset` steps away.
    """
    near = values[::-1][:_SIDE] if end else values[:_SIDE]
    places = offset + np.arange(_SIDE)
    weights = np.linalg.inv(np.vander(places, increasing=True))[derivative]
    out: Array = (-1.0 if end and derivative else 1.0) * np.tensordot(weights, near, axes=1)
    return out


def _column(a: Array, c: Array) -> Array:
    """Scalar products (n,1) of vectors (n,3)."""
    out: Array = np.einsum("ij,ij->i", a, c)[:, None]
    return out

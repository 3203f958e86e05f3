"""The helical strip between clamps that lie on it.

Frame (T, N, B) along the midline with Darboux vector Omega = tau T + kappa B; the rulings are B + eta T with
eta = tau/kappa. The energy per length is f = (b/2) kappa^2 (1 + eta^2)^2 V(b eta'), where
V(x) = log((1 + x)/(1 - x))/(2 x) = 1 + x^2/3 + ... (Wunderlich 1962). V is even, so df/deta' and its
derivative along s vanish where eta is constant, and the equations are those of the narrow strip,
f = (b/2) (kappa^2 + tau^2)^2/kappa^2 (Sadowsky 1930):

    m_T = df/dtau   = 2 b kappa eta (1 + eta^2),
    m_B = df/dkappa = b kappa (1 + eta^2)(1 - eta^2),

and m_N is the multiplier of the condition that the geodesic curvature vanishes. With constant components
the balances m' + T x n = 0 and n' = 0 read Omega x m + T x n = 0 and Omega x n = 0. Their components are

    T: -kappa m_N = 0,    N: kappa m_T - tau m_B - n_B = 0,    B: tau m_N + n_N = 0,

so m_N = n_N = 0, n_B = kappa m_T - tau m_B = b kappa^2 eta (1 + eta^2)^2, and n is parallel to Omega:

    n = b kappa^2 eta (1 + eta^2)^2 (eta T + B),    |n| = b kappa^2 |eta| (1 + eta^2)^(5/2).

The end's clamp exerts n and m, the start's -n and -m. As df/deta' = 0, neither clamp has to turn the ruling
against the tangent: the derivatives of the energy in both etas vanish. When kappa and tau change, the end
moves by dr and turns by dphi, and dE = n . dr + m . dphi.

R_x(twist) R_z(tilt) takes e_z to a direction across e_x, which the helix's B is at its end where
kappa tau (1 - cos(omega l)) = 0, omega^2 = kappa^2 + tau^2: on arcs and after whole turns alone.
After whole turns the end's frame is the start's, and the end lies at l/(1 + eta^2) (eta^2, 0, eta).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Helix:
    """A strip of constant curvature kappa > 0 and torsion eta kappa."""

    curvature: float
    eta: float
    half_width: float
    length: float = 1.0

    @property
    def darboux(self) -> Array:
        """Omega (3,) in the start's frame; it is the same in space and along the strip."""
        return self.curvature * np.array([self.eta, 0.0, 1.0])

    @property
    def energy(self) -> float:
        """b l kappa^2 (1 + eta^2)^2 / 2."""
        return 0.5 * self.half_width * self.length * (self.curvature * (1.0 + self.eta**2)) ** 2

    @property
    def force(self) -> Array:
        """n (3,)."""
        return self.half_width * self.curvature * self.eta * (1.0 + self.eta**2) ** 2 * self.darboux

    @property
    def start_moment(self) -> Array:
        """-m at the start (3,)."""
        wide = self.half_width * self.curvature * (1.0 + self.eta**2)
        return -wide * np.array([2.0 * self.eta, 0.0, 1.0 - self.eta**2])

    @property
    def moment(self) -> Array:
        """m at the end (3,): the components at the start, turned with the frame."""
        found: Array = -self.frame(self.length) @ self.start_moment
        return found

    def frame(self, s: float) -> Array:
        """(3,3), columns T, N, B at arclength s."""
        found: Array = Rotation.from_rotvec(s * self.darboux).as_matrix()
        return found

    def point(self, s: float) -> Array:
        """The midline (3,) at arclength s: a turn about and a shift along the unit axis a of Omega."""
        rate = float(np.linalg.norm(self.darboux))
        a = self.darboux / rate
        along = a[0] * a
        across = np.array([1.0, 0.0, 0.0]) - along
        turn = rate * s
        moved: Array = (
            s * along + (math.sin(turn) * across + (1 - math.cos(turn)) * np.cross(a, across)) / rate
        )
        return moved

    def ruling(self, s: float) -> Array:
        """B + eta T (3,) at arclength s: parallel to Omega, the same everywhere."""
        frame = self.frame(s)
        found: Array = frame[:, 2] + self.eta * frame[:, 0]
        return found


def whole_turns(eta: float, half_width: float, turns: int = 1, length: float = 1.0) -> Helix:
    """The helix that ends after whole turns, with the frame that it starts with (twist = 0, tilt = 0)."""
    return Helix(2.0 * math.pi * turns / (length * math.hypot(1.0, eta)), eta, half_width, length)

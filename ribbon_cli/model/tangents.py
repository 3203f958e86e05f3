"""Moves that keep the constraints of a closed band, in coordinates of the strip's own.

Facet 1 is held. A change of the fold at node k turns all that follows about the ruling g_k. A change of eta_k
moves g_k within its facet, and turns what follows by as much as the fold's condition needs. Each of these
fulfils all constraints, linearised where the band is, but those of node 1 with facet N and the sum of u: six
rows (`closure`) are left. In place of eta_k stand eta_1 and xi_1..xi_N, as tanh xi_k is b/h times the rise of
eta: sums of xi are gentle, and differences of eta, times b/h cosh^2 xi, lose their digits.

A coordinate that acts from node k on does so by four constants alone: with a rotation a and a rise e of eta,
facet i >= k turns by omega_i = a + O_i e, and g_i moves by e / p_i in its facet, with O and p of the band. So
the moves of all coordinates are running sums of constants. A matrix that couples neighbouring nodes is, as a
form in the coordinates, a product of factors with four columns beside its diagonal: O(N^2) operations.
"""

from __future__ import annotations

import numpy as np

from .band import Array
from .constraints import sech_squared
from .entries import PER_NODE
from .problem import LocalDerivatives, Problem
from .stencil import Seam

XI = 4
"""Place of a facet's own xi behind the four constants (a, e)."""


class Tangents:
    """Moves (7N,) of a closed band at x (7N,) in 2N coordinates: folds at nodes 2..N, eta_1, xi_1..xi_N.

    `closure` (6, 2N) are the constraints' rows that are left. Raises LinAlgError where rulings lie along the
    midline.
    """

    def __init__(self, problem: Problem, x: Array, local: LocalDerivatives) -> None:
        if problem.stencil.seam is not Seam.CLOSED or problem.fixed.any():
            raise ValueError("coordinates are for closed bands of which nothing is held")
        band, y = problem.band, x.reshape(-1, 7)
        n = self.segments = band.segments
        u, g = y[:, :3], y[:, 3:6]
        gu, uu, gg = (np.einsum("ij,ij->i", *pair) for pair in ((g, u), (u, u), (g, g)))
        # Of g_k + t (u_k + c g_k), |g|^2 - (g.u)^2 stays as it is, also where |u_k| is not quite one.
        along = u - (gu * (1.0 - uu) / (gg - gu * gu))[:, None] * g
        unit = np.einsum("ij,ij->i", u, along)[:, None]  # p, of which xi's row sees the change
        axis, spin = _turns(u, g, along)
        turned = np.cumsum(spin / unit, axis=0)  # O
        self._moved = np.zeros((n, 7, XI + 1))
        for first, v in ((0, u), (3, g)):
            for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
                self._moved[:, first + i, j], self._moved[:, first + j, i] = v[:, k], -v[:, k]
            self._moved[:, first : first + 3, 3] = np.cross(turned, v)
        self._moved[:, 3:6, 3] += along / unit
        self._moved[:, 6, XI] = 1.0
        rise = (band.h / band.half_width) * sech_squared(y[:, 6])
        self._constants = np.zeros((n, 4, 2))
        self._constants[:, :3, 0] = axis
        self._constants[0, 3, 1] = unit[0, 0]
        self._constants[1:, 3, 1] = rise[:-1]
        self._constants[1:, :3, 1] = -turned[:-1] * rise[:-1, None]
        rows = problem.jacobian_matrix(local).tocsr()
        last, closing = PER_NODE * (n - 1), PER_NODE * n
        left = rows[[2, last + 3, last + 4, closing, closing + 1, closing + 2]]
        self.closure: Array = self.pull(left.toarray().T).T

    @property
    def size(self) -> int:
        """The number of coordinates, 2N."""
        return 2 * self.segments

    def moves(self, coordinates: Array) -> Array:
        """The moves (7N, k) of coordinates (2N, k)."""
        n, count = self.segments, coordinates.shape[1]
        pairs = np.zeros((n, 2, count))
        pairs[1:, 0], pairs[:, 1] = coordinates[: n - 1], coordinates[n - 1 : -1]
        fields = np.empty((n, XI + 1, count))
        fields[:, :XI], fields[:, XI] = _running(self._constants @ pairs), coordinates[n:]
        return (self._moved @ fields).reshape(7 * n, count)

    def pull(self, forces: Array) -> Array:
        """The transpose of `moves`: forces (7N, k) on the coordinates, (2N, k)."""
        n, count = self.segments, forces.shape[1]
        fields = self._moved.transpose(0, 2, 1) @ forces.reshape(n, 7, count)
        following = _running(fields[::-1, :XI])[::-1]
        pairs = self._constants.transpose(0, 2, 1) @ following
        out = np.zeros((2 * n, count))
        out[: n - 1], out[n - 1 : -1] = pairs[1:, 0], pairs[:, 1]
        out[n:] += fields[:, XI]
        return out

    def congruent(self, diagonal: Array, coupling: Array) -> Array:
        """A symmetric matrix (7N, 7N) as a form in the coordinates, (2N, 2N).

        Given are, node by node, its `diagonal` (N,7,7) and `coupling` to the next (N,7,7), round the circle.
        """
        n, moved = self.segments, self._moved
        transposed = moved.transpose(0, 2, 1)
        here, ahead = transposed @ diagonal @ moved, transposed @ coupling @ np.roll(moved, -1, axis=0)
        seam = ahead[-1].copy()
        ahead[-1] = 0.0
        behind = np.roll(ahead, 1, axis=0)
        summed = self._summed(here, ahead, behind, seam[:XI, :XI])
        beside = self._beside(here, ahead, behind, seam)
        out = np.zeros((2 * n, 2 * n))
        out[:-1, :-1] = summed[1:, 1:]
        out[n:, :-1] += beside[:, 1:]
        out[:-1, n:] += beside[:, 1:].T
        node, following = np.arange(n, 2 * n), np.roll(np.arange(n, 2 * n), -1)
        out[node, node] += here[:, XI, XI]
        coupled = np.append(ahead[:-1, XI, XI], seam[XI, XI])
        np.add.at(out, (node, following), coupled)
        np.add.at(out, (following, node), coupled)
        return out

    def _summed(self, here: Array, ahead: Array, behind: Array, seam: Array) -> Array:
        """The form of what acts from a node on by its constants, those of folds first, (2N, 2N).

        For nodes m < l it is C_m^T R_l C_l with R_l the sum over all pairs of nodes from l on, those of l
        with the one before it included.
        """
        n, constants = self.segments, self._constants
        pairs = (here + ahead.transpose(0, 2, 1) + behind)[:, :XI, :XI]
        rest = np.cumsum(pairs[::-1], axis=0)[::-1]
        columns = constants.transpose(2, 0, 1).reshape(2 * n, XI)
        images = (rest @ constants).transpose(2, 0, 1).reshape(2 * n, XI)
        form = (columns @ images.T).reshape(2, n, 2, n)
        # Node 1 meets facet N across the seam, wherever the other coordinate begins to act.
        form[:, 0] += np.einsum("fa,gf,lgb->abl", constants[0], seam, constants)
        form *= np.triu(np.ones((n, n)), 1)[:, None]
        form = form + form.transpose(2, 3, 0, 1)
        own = rest - behind[:, :XI, :XI]
        own[0] += seam + seam.T
        node = np.arange(n)
        form[:, node, :, node] = constants.transpose(0, 2, 1) @ own @ constants
        return form.reshape(2 * n, 2 * n)

    def _beside(self, here: Array, ahead: Array, behind: Array, seam: Array) -> Array:
        """The form of each facet's own xi with what acts from a node on, (N, 2N)."""
        n, constants = self.segments, self._constants
        after, before = ahead[:, XI, :XI], behind[:, :XI, XI]
        columns = constants.transpose(2, 0, 1).reshape(2 * n, XI)
        form = ((here[:, XI, :XI] + after + before) @ columns.T).reshape(n, 2, n)
        form *= np.tri(n)[:, None]
        node = np.arange(n)
        form[node, :, node] -= np.einsum("nf,nfa->na", before, constants)
        form[node[:-1], :, node[1:]] = np.einsum("nf,nfa->na", after[:-1], constants[1:])
        form[-1, :, 0] += seam[XI, :XI] @ constants[0]
        form[0] += np.einsum("f,nfa->an", seam[:XI, XI], constants)
        return form.reshape(n, 2 * n)


def _running(values: Array) -> Array:
    """Running sums along the first axis, in place: a third of the time of `cumsum` where rows are long."""
    for k in range(1, values.shape[0]):
        values[k] += values[k - 1]
    return values


def _turns(u: Array, g: Array, along: Array) -> tuple[Array, Array]:
    """How facets from node k on turn with the fold at k, and with its eta; (N, 3) each, zero at node 1.

    With the fold they turn about the ruling. When g_k moves by `along`, they turn about an axis at right
    angles to g_k, such that (u_k - u_{k-1}).g_k and (u_{k-1} x g_{k-1}).g_k stay as they are.
    """
    before = np.roll(u, 1, axis=0)
    normal = np.cross(before, np.roll(g, 1, axis=0))
    system = np.stack((np.cross(g, before), np.cross(g, normal), g), axis=1)
    right = np.zeros((u.shape[0], 3, 1))
    right[:, 0, 0] = np.einsum("ij,ij->i", u - before, along)
    right[:, 1, 0] = -np.einsum("ij,ij->i", normal, along)
    spin = np.linalg.solve(system, right)[..., 0]
    axis = g / np.sqrt(np.einsum("ij,ij->i", g, g))[:, None]
    spin[0] = axis[0] = 0.0
    return np.asarray(axis, dtype=np.float64), np.asarray(spin, dtype=np.float64)

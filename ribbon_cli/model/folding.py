"""Folding coordinates: a discrete band as a strip folded N times, Koldaev (2022), section 2.1.1.

Node i is folded by the angle theta_i about its ruling (eta_i, 0, 1) / sqrt(1 + eta_i^2) in the facet
frame (t, n, b). Frames are the products of these rotations, so any 2N numbers give an isometric
open strip; closure is 3 + 3 equations. Curvature is kappa h = theta / sqrt(1 + eta^2) and torsion
tau = kappa eta.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .band import Array, Band, State
from .stencil import cross_rows

XI_ROUNDOFF = 4.0
"""Roundoff of b eta', in units of eps (b/h) (|g_i| + |g_{i+1}|): three products of differences."""


class ClosureError(ValueError):
    """A strip could not be closed, or its rulings meet inside the strip."""


@dataclass(frozen=True)
class Folding:
    """Fold angles theta (N,) in radians and eta = u.g (N,) at the nodes."""

    theta: Array
    eta: Array

    def curvature(self, h: float) -> Array:
        """Signed curvature (N,) at the nodes of facets of length h, kappa h = theta / sqrt(1 + eta^2)."""
        out: Array = self.theta / (h * np.sqrt(1.0 + self.eta**2))
        return out


def rotations(theta: Array, eta: Array) -> Array:
    """Fold rotations (N,3,3) in the facet frame (Rodrigues)."""
    w = 1.0 / np.sqrt(1.0 + eta**2)
    ax, az = eta * w, w
    c, s = np.cos(theta), np.sin(theta)
    v = 1.0 - c
    out = np.empty((theta.size, 3, 3))
    out[:, 0, 0], out[:, 0, 1], out[:, 0, 2] = c + ax * ax * v, -az * s, ax * az * v
    out[:, 1, 0], out[:, 1, 1], out[:, 1, 2] = az * s, c, -ax * s
    out[:, 2, 0], out[:, 2, 1], out[:, 2, 2] = ax * az * v, ax * s, c + az * az * v
    return out


def _scan(rotations: Array) -> Array:
    """Running products R_1, R_1 R_2, ... (N,3,3) in log2 N vectorised sweeps."""
    out = rotations.copy()
    step = 1
    while step < out.shape[0]:
        out[step:] = out[:-step] @ out[step:]
        step *= 2
    return out


def frames(folding: Folding, first: Array) -> Array:
    """Facet frames (N,3,3), columns (t, n, b) of facets 1..N; `first` (3,3) is facet 1's.

    Fold 1 sits at the seam, between facet N and facet 1, and is not used here.
    """
    r = rotations(folding.theta, folding.eta)
    r[0] = first
    return _scan(r)


def from_state(state: State) -> Folding:
    """Fold angles and eta of a state; at the seam facet N is seen from facet 1's side by sigma."""
    u, g, sigma = state.u, state.g, state.band.sigma
    frame = facet_frames(state)
    before = np.roll(frame, 1, axis=0)
    before[0, :, 1:] *= sigma
    return Folding(angles(before[:, :, 1], frame[:, :, 1], g), np.einsum("ij,ij->i", u, g))


def angles(before: Array, after: Array, g: Array) -> Array:
    """Fold angles (n,) about rulings g (n,3) from the facets' normals before them to those after, (n,3)
    each."""
    axis = g / np.linalg.norm(g, axis=1)[:, None]
    turned = np.einsum("ij,ij->i", cross_rows(before, after), axis)
    out: Array = np.arctan2(turned, np.einsum("ij,ij->i", before, after))
    return out


def facet_frames(state: State) -> Array:
    """Frames (N,3,3) of the facets, columns t = u, n = b x t, b = the ruling's part normal to u."""
    b = state.g - np.einsum("ij,ij->i", state.g, state.u)[:, None] * state.u
    b = b / np.linalg.norm(b, axis=1)[:, None]
    return np.stack((state.u, cross_rows(b, state.u), b), axis=2)


def closure(folding: Folding, sigma: int, *, by_eta: bool = True) -> tuple[Array, Array]:
    """How far a strip is from closing, (12,): the seam's frame mismatch (9) and the mean tangent (3); and its
    Jacobian (12, 2N) in (theta, eta), or (12, N) in theta alone.

    The frame after fold 1 at the far end must be facet 1's with normal and binormal times sigma.
    The full 3x3 mismatch is used since its skew part also vanishes at half-turns.
    """
    residual, ends = _closed_frames(folding, sigma)
    return residual, _closure_rows(folding, ends, by_eta=by_eta)


def _closed_frames(folding: Folding, sigma: int) -> tuple[Array, tuple[Array, Array, Array]]:
    """The residual (12,); the frames (N,3,3), those (N,3,3) that folds start from, and the end's (3,3)."""
    turn = np.diag([1.0, sigma, sigma])
    r = rotations(folding.theta, folding.eta)
    first = r[0].copy()
    r[0] = np.eye(3)
    f = _scan(r)
    before = np.roll(f, 1, axis=0)
    before[0] = f[-1] @ turn
    end = before[0] @ first
    residual = np.concatenate(((end - np.eye(3)).ravel(), f[:, :, 0].mean(axis=0)))
    return residual, (f, before, end)


def _closure_rows(folding: Folding, ends: tuple[Array, Array, Array], *, by_eta: bool) -> Array:
    """The Jacobian of `closure`, whose frames these are."""
    n = folding.theta.size
    f, before, end = ends
    spin = np.ascontiguousarray(spins(before, folding, by_eta=by_eta).transpose(2, 1, 0))
    downstream = np.cumsum(f[::-1, :, 0], axis=0)[::-1] / n
    downstream[0] = 0.0  # fold 1 is the last one met, no tangent follows it
    # Each column of the frame, and the end of the midline, turn by spin x what they are.
    turning = np.empty((4, 3, *spin.shape[1:]))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        turning[:3, i] = spin[j] * end[k][:, None, None]
        turning[:3, i] -= spin[k] * end[j][:, None, None]
        turning[3, i] = spin[j] * downstream[:, k] - spin[k] * downstream[:, j]
    return np.concatenate((turning[:3].swapaxes(0, 1).reshape(9, -1), turning[3].reshape(3, -1)))


def spins(before: Array, folding: Folding, *, by_eta: bool = True) -> Array:
    """Infinitesimal rotation vectors (N,2,3), in space, of unit changes of theta_i and eta_i; (N,1,3) without
    those of eta.

    `before` (N,3,3) are the frames that the folds start from. The vectors are the fold's axis a itself, and
    for eta that of dR R^T = [v]x with v = sin(theta) a' + (1 - cos(theta)) a x a', a' = da/deta.
    """
    w = 1.0 / np.sqrt(1.0 + folding.eta**2)
    zero = np.zeros(folding.theta.size)
    axis = np.stack((folding.eta * w, zero, w), axis=1)
    if not by_eta:
        return np.asarray(np.einsum("nij,nkj->nki", before, axis[:, None]))
    daxis = np.stack((w**3, zero, -folding.eta * w**3), axis=1)
    s, c = np.sin(folding.theta)[:, None], np.cos(folding.theta)[:, None]
    spin = np.stack((axis, s * daxis + (1.0 - c) * np.cross(axis, daxis)), axis=1)
    out: Array = np.einsum("nij,nkj->nki", before, spin)
    return out


def close(folding: Folding, sigma: int, *, tolerance: float = 1e-13, steps: int = 30) -> Folding:
    """Restore closure by Gauss-Newton steps of least change in theta.

    Eta stays: near an inflection b |eta'| comes close to 1, and rulings that change would cross.
    `tolerance` bounds the residual of `closure`; where roundoff keeps it above that, 1e-11 will do.
    Raises ClosureError if the residual does not fall to that in `steps` steps.
    """
    current = folding
    scale = 1.0 / folding.theta.size
    best = np.inf
    for _ in range(steps):
        residual, ends = _closed_frames(current, sigma)
        size = float(np.abs(residual).max())
        if size <= tolerance or (size < 1e-11 and size >= 0.5 * best):
            return current
        best = min(best, size)
        jacobian = _closure_rows(current, ends, by_eta=False)
        step = scale * np.linalg.lstsq(jacobian * scale, -residual, rcond=1e-9)[0]
        limit = min(1.0, 0.3 / max(float(np.abs(step).max()), 1e-300))
        current = Folding(current.theta + limit * step, current.eta)
    raise ClosureError(f"the strip does not close: residual {best:.1e} after {steps} steps")


def xi_from_rulings(band: Band, u: Array, g: Array) -> Array:
    """The xi (N,) that satisfies (b/h) u_i.(g_{i+1} - g_i) = tanh xi_i.

    Raises ClosureError where rulings meet inside the strip, |b eta'| >= 1.
    """
    following = np.roll(g, -1, axis=0)
    following[-1] *= band.sigma
    return xi_between(band, u, g, following)


def xi_between(band: Band, u: Array, g: Array, following: Array) -> Array:
    """The xi (N,) of facets between rulings g_i and g_{i+1}, (N,3) each; raises as `xi_from_rulings`."""
    t = (band.half_width / band.h) * np.einsum("ij,ij->i", u, following - g)
    worst = int(np.argmax(np.abs(t)))
    # Rulings that meet have no finite xi, as tanh xi = b eta'; nor have those that may meet but for roundoff.
    sizes = np.sqrt(np.einsum("ij,ij->i", g, g)) + np.sqrt(np.einsum("ij,ij->i", following, following))
    noise = XI_ROUNDOFF * np.finfo(float).eps * (band.half_width / band.h) * float(sizes[worst])
    if 1.0 - abs(t[worst]) <= noise:
        raise ClosureError(
            f"rulings meet inside the strip at facet {worst + 1}: b |eta'| = {abs(t[worst]):.4g}"
        )
    xi: Array = np.arctanh(t)
    return xi


def to_state(band: Band, folding: Folding, first: Array | None = None) -> State:
    """Fold the strip up; the folding must close (see `close`). `first` (3,3) is facet 1's frame.

    Raises ClosureError where rulings meet inside the strip.
    """
    f = frames(folding, np.eye(3) if first is None else first)
    u = np.ascontiguousarray(f[:, :, 0])
    g = folding.eta[:, None] * u + f[:, :, 2]
    return State(band, u, g, xi_from_rulings(band, u, g))

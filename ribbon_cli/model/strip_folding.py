"""Folding coordinates of a strip with ends: N+1 folds, those at nodes 1 and N+1 against the clamps' frames.

Fold i turns by theta_i about the ruling (eta_i, 0, 1) / sqrt(1 + eta_i^2), as in `folding`. At a hinge, and
at a free end, theta is the angle from the frame that a clamp would have there, and costs nothing. At clamps
the fold spans half a cell, so that the curvature there is theta / (h/2) / sqrt(1 + eta^2).
"""

from __future__ import annotations

import numpy as np

from ..parts import CLAMPED, FREE, Ends
from . import folding
from .band import Array, Band, State
from .ends import displacement, finish_frame, rotation
from .folding import ClosureError, Folding, facet_frames, frames, rotations

STEPS = 40
TOLERANCE = 1e-13


def from_state(state: State) -> Folding:
    """Fold angles and eta (N+1,) of a strip; those of a free end are zero and u_N.g_{N+1}."""
    ends, end_ruling = _ends(state.band), state.g_end
    assert end_ruling is not None
    frame = facet_frames(state)
    g = np.vstack((state.g, end_ruling))
    after = rotation(ends) if ends.end != FREE else frame[-1]
    normals = np.vstack((np.eye(3)[1], frame[:, :, 1], after[:, 1]))
    theta = folding.angles(normals[:-1], normals[1:], g)
    eta = np.einsum("ij,ij->i", np.vstack((state.u, state.u[-1:])), g)
    return Folding(theta, eta)


def curvature(folded: Folding, band: Band) -> Array:
    """Curvature (N+1,) at the nodes, in 1/length; at hinges and free ends the natural one, without a
    moment."""
    ends, out = _ends(band), folded.curvature(band.h)
    natural = band.parts.material.natural_curvature
    out[0] = 2.0 * out[0] if ends.start == CLAMPED else natural
    out[-1] = 2.0 * out[-1] if ends.end == CLAMPED else natural
    return out


def angles(kappa: Array, eta: Array, band: Band, first: float) -> Array:
    """Fold angles (N+1,) of curvatures at nodes; `first` is that at a hinged start."""
    theta = kappa * band.h * np.sqrt(1.0 + eta**2)
    theta[[0, -1]] *= 0.5
    if _ends(band).start != CLAMPED:
        theta[0] = first
    return theta


def hold(folded: Folding, band: Band, slack: float = 0.0) -> Folding:
    """Bring a strip's end to its place by Gauss-Newton steps of least change in theta.

    With `slack` the etas between the ends change too, by that weight: they leave a plane, which fold angles
    about rulings across it do not. Raises ClosureError if the end does not come there.
    """
    ends = _ends(band)
    if ends.end == FREE:
        return folded
    current, best, n = folded, np.inf, band.segments
    scale = np.concatenate((np.ones(n), np.full(n, slack * n)))
    scale[n] = 0.0
    for _ in range(STEPS):
        residual, jacobian = _misfit(current, band, ends)
        size = float(np.abs(residual).max())
        if size <= TOLERANCE or (size < 1e-11 and size >= 0.5 * best):
            return current
        best = min(best, size)
        step = scale * np.linalg.lstsq(jacobian * scale, -residual, rcond=1e-9)[0]
        step *= min(1.0, 0.3 / max(float(np.abs(step).max()), 1e-300))
        current = Folding(current.theta + np.append(step[:n], 0.0), current.eta + np.append(step[n:], 0.0))
    raise ClosureError(f"the strip does not reach its end: it is off by {best:.1e} after {STEPS} steps")


def to_state(band: Band, folded: Folding) -> State:
    """Fold the strip up from its start. Raises ClosureError where rulings meet inside the strip."""
    ends = _ends(band)
    f = _frames(folded)
    u = np.ascontiguousarray(f[:, :, 0])
    g = folded.eta[:-1, None] * u + f[:, :, 2]
    # A held ruling is what it is held at, to the last digit; a free one lies in the last facet.
    g[0] = np.array([ends.start_eta, 0.0, 1.0])
    last = finish_frame(ends).ruling if ends.end != FREE else folded.eta[-1] * u[-1] + f[-1, :, 2]
    return State(band, u, g, folding.xi_between(band, u, g, np.vstack((g[1:], last))), last)


def _ends(band: Band) -> Ends:
    if band.parts.ends is None:
        raise ValueError("a closed band has no ends")
    return band.parts.ends


def _frames(folded: Folding) -> Array:
    """Frames (N,3,3) of the facets, from the start's."""
    return frames(Folding(folded.theta[:-1], folded.eta[:-1]), rotations(folded.theta[:1], folded.eta[:1])[0])


def _misfit(folded: Folding, band: Band, ends: Ends) -> tuple[Array, Array]:
    """How far the end is from its place (6,): its ruling (3) and midpoint by the length (3); and the Jacobian
    (6, 2N) in the fold angles and etas of nodes 1 to N."""
    f = _frames(folded)
    before = np.concatenate((np.eye(3)[None], f[:-1]))
    tangent = f[:, :, 0]
    spin = folding.spins(before, Folding(folded.theta[:-1], folded.eta[:-1]))
    last = ends.end_eta * tangent[-1] + f[-1, :, 2]
    downstream = np.cumsum(tangent[::-1], axis=0)[::-1] / band.segments
    residual = np.concatenate(
        (last - finish_frame(ends).ruling, tangent.mean(axis=0) - displacement(ends) / band.length)
    )
    rows = np.concatenate((np.cross(spin, last), np.cross(spin, downstream[:, None])), axis=2)
    return residual, rows.transpose(2, 1, 0).reshape(6, -1)

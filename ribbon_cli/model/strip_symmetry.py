"""Symmetries of strips with ends: first those of what holds and loads them, then which of them a state has.

A strip can be run through backwards and turned over (g -> -g), never shifted. What holds it, the clamps'
tangents, rulings and places and the directions of its loads, is data: an orthogonal map Q with a relabelling
that carries the data over is a symmetry of the problem, and turns one of its states into another.
"""

from __future__ import annotations

import itertools

import numpy as np

from ..parts import CLAMPED, FREE, Ends, Parts
from .band import Array, State
from .ends import displacement, finish_frame, start_frame
from .point_group import element_name, nearest_orthogonal
from .symmetry import EXACT, Symmetry, SymmetryGroup

HELD = 1e-9
"""Largest difference up to which a map carries one end over to the other."""
RANK = 1e-6
"""Part of the largest singular value below which directions do not determine a map."""


def strip_symmetries(state: State) -> SymmetryGroup:
    """The symmetry group of a strip's state. The grid breaks none: relabelling maps it onto itself."""
    found = [s for s in strip_images(state, state) if s.residual < EXACT]
    found.sort(key=lambda s: (not s.is_identity, not s.proper, s.reverse, s.flip))
    return SymmetryGroup(tuple(found), ())


def strip_images(state: State, other: State) -> list[Symmetry]:
    """Every symmetry of the problem, with how far it is from bringing a state onto another of the same strip:
    phi(y) = Q y' to within the residual."""
    parts = state.band.parts
    found = []
    for reverse, flip in itertools.product((False, True), repeat=2):
        for q in _maps(parts, state, other, reverse, flip):
            moved, target = _vectors(state, reverse, flip), _vectors(other, False, False) @ q.T
            size = float((moved**2).sum())
            residual = float(np.sqrt(((moved - target) ** 2).sum() / size))
            found.append(Symmetry(element_name(q), q, 0.0, reverse, flip, residual, True))
    return found


def _vectors(state: State, reverse: bool, flip: bool) -> Array:
    """u (N) and g (N+1) of a strip, relabelled, in rows."""
    assert state.g_end is not None
    u, g = state.u, np.vstack((state.g, state.g_end))
    if reverse:
        u, g = -u[::-1], g[::-1]
    return np.vstack((u, -g if flip else g))


def _maps(parts: Parts, state: State, other: State, reverse: bool, flip: bool) -> list[Array]:
    """Orthogonal maps that carry over what holds and loads the strip, for one relabelling.

    Where that does not determine a map, as for a strip that may turn about its hinge, the states do.
    """
    ends = parts.ends
    assert ends is not None
    loads = parts.loads
    if reverse and (ends.start != ends.end or any(loads.end_force) or _off_middle(parts)):
        return []
    plain, relabelled = _data(ends, False, False), _data(ends, reverse, flip)
    forces = np.array(_directions(parts)).reshape(-1, 3)
    here, there = np.vstack((plain, forces)), np.vstack((relabelled, forces))
    correlation = there.T @ here
    singular = np.linalg.svd(correlation, compute_uv=False)
    if singular[1] <= RANK * singular[0]:
        correlation = correlation + _vectors(state, reverse, flip).T @ _vectors(other, False, False)
    natural = parts.material.natural_curvature != 0.0
    found = []
    for determinant, (matrices, _) in nearest_orthogonal(correlation[None]).items():
        q = matrices[0]
        # The signed curvature changes sign with each of these, and with an odd number of them.
        bends_back = (reverse != flip) != (determinant < 0)
        if np.abs(here @ q.T - there).max() <= HELD and not (natural and bends_back):
            found.append(q)
    return found


def _data(ends: Ends, reverse: bool, flip: bool) -> Array:
    """Rulings, tangents and the way from start to end, as far as they are held, in rows, relabelled."""
    start, finish = start_frame(ends), finish_frame(ends)
    side = -1.0 if flip else 1.0
    if ends.end == FREE:
        return np.array([side * start.ruling, *([start.tangent] if ends.start == CLAMPED else [])])
    rulings, way = [start.ruling, finish.ruling], displacement(ends)
    tangents = [(ends.start, start.tangent), (ends.end, finish.tangent)]
    if reverse:
        rulings, way = rulings[::-1], -way
        tangents = [(kind, -t) for kind, t in tangents[::-1]]
    return np.array([*(side * g for g in rulings), way, *(t for kind, t in tangents if kind == CLAMPED)])


def _off_middle(parts: Parts) -> bool:
    """Whether a point force acts elsewhere than in the middle."""
    return any(parts.loads.point_force) and parts.loads.point_at != 0.5


def _directions(parts: Parts) -> list[Array]:
    """Directions of the loads that act, of length one."""
    loads = parts.loads
    acting = [loads.end_force, loads.point_force, loads.gravity_direction if loads.gravity else (0.0,) * 3]
    return [np.array(v) / np.linalg.norm(v) for v in acting if any(v)]

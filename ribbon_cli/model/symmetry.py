"""Symmetries of a state, found after the fact: never imposed, each with its residual.

A closed strip of N facets can be relabelled: shifted along itself by k facets, run through backwards, and
turned over (g -> -g; on one-sided bands that is a shift by the whole length). A state is symmetric if a
relabelling phi and an orthogonal map Q give phi(u, g) = Q (u, g). For every relabelling the best Q follows
from the 3 x 3 matrix sum phi(y)_i y_i^T, and these matrices for all shifts at once from Fourier transforms:
the search costs O(N log N). Shifts by a part of a facet are looked at by interpolation: what the band is
symmetric under but its grid is not shows there.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from .band import Array, State
from .point_group import distinct, element_name, group_name, nearest_orthogonal

EXACT = 1e-6
"""Largest root-mean-square residual of a symmetry of the discrete state: solver tolerances and no more."""
NEAR = 0.1
"""Largest residual of a symmetry that the grid breaks."""
NEAR_ANGLE = 0.02
"""Radians by which the angle of such a one may miss a fraction of a turn."""
FINEST = 8
MOST_SHIFTS = 40_000
"""Shifts are looked at by an eighth of a facet, or more coarsely where that would be too many."""
MOST_NEAR = 64
LARGE_GROUP = 12
MOST_CHECKED = 512
"""Shifts of which the residual is taken from the vectors; on rings of many facets from the transform."""


@dataclass(frozen=True, eq=False)
class Symmetry:
    """One symmetry: relabelling, orthogonal map `matrix` Q (3,3), and how well it holds.

    The relabelling shifts by `shift` facets; `reverse` runs backwards, node `shift` going to node 0;
    `flip` turns the strip over (two-sided bands). `residual` is the root mean square of
    |phi(y)_i - Q y_i| over |y_i|, y = (u, g). `exact` says that it maps the grid onto itself.
    """

    name: str
    matrix: Array
    shift: float
    reverse: bool
    flip: bool
    residual: float
    exact: bool

    @property
    def is_identity(self) -> bool:
        """Whether nothing moves."""
        return self.name == "E" and self.shift == 0 and not (self.reverse or self.flip)

    @property
    def proper(self) -> bool:
        """Whether it is a rotation, not a reflection."""
        return bool(np.linalg.det(self.matrix) > 0)

    def in_words(self) -> str:
        """What is done to a state: `numbered from node 4, backwards, mirrored`."""
        words = [f"numbered from node {round(self.shift) + 1}"] if self.shift else []
        words += ["backwards"] * self.reverse + ["turned over"] * self.flip
        return ", ".join([*words, "turned" if self.proper else "mirrored"])

    def relabelled(self, moves: Array, sigma: int) -> Array:
        """phi of moves (N, 7, ...). Raises ValueError where the grid is not mapped onto itself."""
        if not self.exact:
            raise ValueError(f"{self.name} does not map the grid onto itself")
        if sigma == 0:
            return self._relabelled_strip(moves)
        n, shift = moves.shape[0], round(self.shift)
        node = np.arange(n)
        rulings = shift - node if self.reverse else shift + node
        facets = rulings - 1 if self.reverse else rulings
        out = np.empty_like(moves)
        extra = -1.0 if self.flip else 1.0
        shape = (n, *[1] * (moves.ndim - 1))

        def seam(index: np.ndarray) -> Array:
            return (extra * np.where((index // n) % 2, float(sigma), 1.0)).reshape(shape)

        out[:, :3] = moves[facets % n, :3] * (-1.0 if self.reverse else 1.0)
        out[:, 3:6] = moves[rulings % n, 3:6] * seam(rulings)
        out[:, 6:] = moves[facets % n, 6:] * seam(facets)
        return out

    def _relabelled_strip(self, moves: Array) -> Array:
        """phi of a strip's moves: where it is run backwards both end rulings are held, and do not move."""
        out = moves.copy()
        if self.reverse:
            out[:, :3], out[1:, 3:6], out[:, 6:] = -moves[::-1, :3], moves[:0:-1, 3:6], moves[::-1, 6:]
        if self.flip:
            out[:, 3:] *= -1.0
        return out

    def apply(self, moves: Array, sigma: int) -> Array:
        """T v = Q^T phi(v) of moves (N, 7, ...): the state itself has T y = y."""
        out = self.relabelled(moves, sigma)
        for first in (0, 3):
            part = out[:, first : first + 3]
            out[:, first : first + 3] = np.einsum("ji,nj...->ni...", self.matrix, part)
        return out


@dataclass(frozen=True)
class SymmetryGroup:
    """All symmetries found, the identity first; `near` ones are broken by the grid alone."""

    exact: tuple[Symmetry, ...]
    near: tuple[Symmetry, ...]

    @property
    def order(self) -> int:
        """Number of exact symmetries, the identity counted."""
        return len(self.exact)

    @cached_property
    def name(self) -> str:
        """Schoenflies' symbol of the exact symmetries."""
        return group_name(distinct([s.matrix for s in self.exact]))

    @cached_property
    def near_name(self) -> str:
        """Schoenflies' symbol of all symmetries, those included that the grid breaks."""
        return group_name(distinct([s.matrix for s in (*self.exact, *self.near)])) if self.near else self.name

    @property
    def residual(self) -> float:
        """Largest residual of the exact symmetries."""
        return max(s.residual for s in self.exact)

    @property
    def near_residual(self) -> float | None:
        """Largest residual of those that the grid breaks; None without any."""
        return max((s.residual for s in self.near), default=None)

    def generators(self) -> tuple[Symmetry, ...]:
        """Symmetries to tell modes by: all but identity and inverses in a small group, else one of a kind."""
        others = [s for s in self.exact if not s.is_identity]
        kept: list[Symmetry] = []
        if self.order > LARGE_GROUP:
            kinds: dict[tuple[bool, bool, bool], Symmetry] = {}
            for s in sorted(others, key=lambda s: abs(s.shift)):
                kinds.setdefault((s.proper, s.reverse, s.flip), s)
            kept = [s for s in kinds.values() if s.name != "E"]
        else:
            for s in others:
                if not any(np.abs(s.matrix @ t.matrix - np.eye(3)).max() < 1e-3 for t in kept):
                    kept.append(s)
        return tuple(kept)


def find_symmetries(state: State) -> SymmetryGroup:
    """The symmetry group of a closed band's state; prescribed rulings and open seams are not looked at."""
    exact: list[Symmetry] = []
    near: list[Symmetry] = []
    for reverse in (False, True):
        for flip in (False, True) if state.band.sigma > 0 else (False,):
            here, there = _of_one_kind(state, reverse, flip)
            exact += here
            near += there
    exact.sort(key=lambda s: (not s.is_identity, not s.proper, s.reverse, s.flip, s.shift))
    if len(exact) >= state.band.segments:  # a ring: every shift is a symmetry
        near = []
    near.sort(key=lambda s: s.residual)
    return SymmetryGroup(tuple(exact), tuple(near[:MOST_NEAR]))


def nearest_image(found: list[Symmetry]) -> Symmetry:
    """Of images, the plainest of those that are nearest."""
    best = min(image.residual for image in found)
    return min((image for image in found if image.residual <= best + EXACT), key=_plainest)


def find_image(state: State, other: State, renumbered: bool = True) -> Symmetry:
    """The relabelling phi and the orthogonal map Q that bring one state nearest to another of the same band,
    which is closed.

    phi(y) = Q y' to within the residual, so that `apply` turns moves of `state` into moves of `other`. Of
    relabellings that do equally well, as on symmetric shapes, it is the one that changes least. All stay as
    they are, and only Q is looked for, unless `renumbered`.
    """
    if not renumbered:
        correlation = state.u.T @ other.u + state.g.T @ other.g
        return min(_images(state, other, correlation[None], False, False), key=_plainest)
    found: list[Symmetry] = []
    for reverse in (False, True):
        for flip in (False, True) if state.band.sigma > 0 else (False,):
            found += _images(state, other, _correlations(state, other, reverse, flip, 1), reverse, flip)
    return nearest_image(found)


def _plainest(image: Symmetry) -> tuple[bool, bool, bool, bool, float]:
    """Key by which images of one residual are ordered: as little renumbered as can be, and no reflection."""
    return image.residual > EXACT, not image.proper, image.flip, image.reverse, image.shift


def _images(state: State, other: State, correlation: Array, reverse: bool, flip: bool) -> list[Symmetry]:
    """For each shift the best map onto another state, as a rotation and as a reflection."""
    size = float((state.u**2).sum() + (state.g**2).sum() + (other.u**2).sum() + (other.g**2).sum())
    found = []
    for matrices, traces in nearest_orthogonal(correlation).values():
        residuals = np.sqrt(np.maximum(2.0 - 4.0 * traces / size, 0.0))
        found += [
            Symmetry("image", q, float(shift), reverse, flip, float(residual), True)
            for shift, (q, residual) in enumerate(zip(matrices, residuals, strict=True))
        ]
    return found


def _doubled(state: State) -> tuple[Array, Array]:
    """u and g (P,3) over one period of labels: N, or 2N with the seam's sign on one-sided bands."""
    if state.band.sigma > 0:
        return state.u, state.g
    return np.vstack((state.u, state.u)), np.vstack((state.g, -state.g))


def _correlations(state: State, other: State, reverse: bool, flip: bool, parts: int) -> Array:
    """Matrices sum_i phi(y)_i y'_i^T (P parts, 3, 3) for shifts by 0, 1, 2, ... parts of a facet; y' is of
    the other state.
    """
    u, g = _doubled(state)
    period = u.shape[0]
    half = state.band.segments / period
    frequency = np.arange(period // 2 + 1)
    fu, fg = np.fft.rfft(u, axis=0), np.fft.rfft(g, axis=0)
    tu, tg = (np.fft.rfft(part, axis=0) for part in _doubled(other))
    sign = -1.0 if flip else 1.0
    if reverse:  # u'_i = -u_{s-1-i}, g'_i = g_{s-i}: convolutions
        late = np.exp(-2j * np.pi * frequency / period)[:, None, None]
        spectrum = sign * fg[:, :, None] * tg[:, None, :] - late * fu[:, :, None] * tu[:, None, :]
    else:
        spectrum = sign * fg[:, :, None] * tg[:, None, :].conj() + fu[:, :, None] * tu[:, None, :].conj()
    if period % 2 == 0 and parts > 1:
        spectrum[-1] *= 0.5  # Nyquist's frequency stands for two once the transform is padded
    out: Array = np.fft.irfft(spectrum, n=parts * period, axis=0) * (parts * half)
    return out


def _of_one_kind(state: State, reverse: bool, flip: bool) -> tuple[list[Symmetry], list[Symmetry]]:
    """Exact symmetries of one kind of relabelling, and those between grid points or broken by the grid."""
    period = _doubled(state)[0].shape[0]
    parts = min(FINEST, max(1, MOST_SHIFTS // period))
    size = float((state.u**2).sum() + (state.g**2).sum())
    correlation = _correlations(state, state, reverse, flip, parts)
    exact: list[Symmetry] = []
    near: list[Symmetry] = []
    for matrices, traces in nearest_orthogonal(correlation).values():
        squares = np.maximum(2.0 - 2.0 * traces / size, 0.0)
        chosen = np.flatnonzero(squares[::parts] < (100.0 * EXACT) ** 2)
        here = [
            Symmetry(
                element_name(q), q, float(shift), reverse, flip, float(np.sqrt(squares[parts * shift])), True
            )
            for shift, q in ((int(shift), matrices[parts * shift]) for shift in chosen)
        ]
        if len(here) <= MOST_CHECKED:
            here = [replace(s, residual=_residual(state, s, size)) for s in here]
        here = [s for s in here if s.residual < EXACT]
        exact += here
        taken = np.array([s.shift for s in here])
        lowest = (squares < np.roll(squares, 1)) & (squares <= np.roll(squares, -1)) & (squares < NEAR**2)
        for place in np.flatnonzero(lowest):
            apart = (taken - place / parts + 0.5 * period) % period - 0.5 * period
            if (np.abs(apart) <= 1.0).any():
                continue
            residual, q = float(np.sqrt(_bottom(squares, int(place)))), matrices[place]
            name = element_name(q, NEAR_ANGLE)
            near.append(Symmetry(name, q, place / parts, reverse, flip, residual, exact=False))
    return exact, near


def _bottom(squares: Array, place: int) -> float:
    """Lowest value of the parabola through a minimum and its neighbours."""
    left, middle, right = (float(squares[(place + k) % squares.size]) for k in (-1, 0, 1))
    bend = left - 2.0 * middle + right
    return max(middle - (left - right) ** 2 / (8.0 * bend), 0.0) if bend > 0 else middle


def _residual(state: State, found: Symmetry, size: float) -> float:
    """The residual of a symmetry that maps the grid onto itself, from the vectors."""
    y = state.vector().reshape(-1, 7)
    image = found.relabelled(y, state.band.sigma)
    moved = np.hstack((y[:, :3] @ found.matrix.T, y[:, 3:6] @ found.matrix.T))
    return float(np.sqrt(((image[:, :6] - moved) ** 2).sum() / size))

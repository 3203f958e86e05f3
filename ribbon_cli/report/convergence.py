"""Convergence of the energy under refinement (Koldaev (2022), section 3.6), and its extrapolation.

Pure functions over numbers: they read no file, and import only the standard library.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

from ribbon_cli.facts import same_width

ORDER = 2
"""Theoretical order of the discrete energy, E_N = E + c2 h^2 + c4 h^4 + ... (Koldaev (2022), section 2.2)."""

ORDER_TOLERANCE = 0.25
"""Largest |observed order - 2| that counts as settled.

With E_N = E + c2 h^2 + c4 h^4 and x = c4 h^2 / c2 at the finest level, the ratio of the last two differences
is 4 (1 + 20 x)/(1 + 5 x), and Richardson's correction is wrong by the fraction 4 x/(1 + 5 x). An order of
2 +- 0.25 means x = 0.013 or -0.010, hence a correction that is right to 5 %.
"""

STEADY_ORDER = 0.05
"""Largest |observed order - 2|, twice in a row, that needs no check of h/b: bands without layers (rings)."""
LAYER_RESOLUTION = 0.04
"""Largest h/b at which the boundary layers of width b beside an inflection are resolved.

The energies of the pi band at b = 0.1 are not of second order before N is about 1600 (h/b = 0.039): they rise
to N = 400 and fall afterwards.
"""

FALL = 2.0**ORDER
"""Ratio of successive differences once the order has settled."""

SOLVER_FLOOR = 1e-11
"""Relative size below which a difference of energies comes from the solver's tolerance, not from the grid."""


Others = tuple[tuple[str, float | None], ...]
"""Parameters by name."""


@dataclass(frozen=True)
class Entry:
    """Energy Q_h of one state: `half_width` b, `segments` N, `energy` (None or not finite: unknown).

    `breaks` is empty, or says why the state is not on the branch of the entry with N/2. `others` are the
    parameters besides b in which the entries of a table differ: energies of different values are never mixed.
    """

    half_width: float
    segments: int
    energy: float | None
    certified: bool
    label: int | str | None = None
    breaks: str = ""
    others: Others = ()


@dataclass(frozen=True)
class Row:
    """One line of the table; None stands for what the given energies do not determine.

    `delta` = |E_N - E_2N| (3.11), `ratio` = Delta_N / Delta_2N, `order` = log2(ratio). If the two differences
    have opposite signs, there is no order, and `note` says so. If one of the energies belongs to another
    minimum, there is neither ratio nor order, and `note` says whether `delta` is affected. `certified` is
    that of E_N alone. `note` names every energy in `delta` that has no certificate. The row is `doubtful` if
    `delta` uses such an energy, or one of another minimum.
    """

    half_width: float
    segments: int
    energy: float | None
    delta: float | None
    ratio: float | None
    order: float | None
    certified: bool
    label: int | str | None
    note: str
    doubtful: bool = False
    others: Others = ()


@dataclass(frozen=True)
class Extrapolation:
    """What the energies of one half-width say about N -> infinity.

    `energy` +- `error`: Richardson's value if `settled`, else the finest certified energy with a bar for the
    change that refinement may still bring; None where nothing can be said. `order` is the order observed in
    the three finest energies (None: too few of them, or differences that show none), `segments` the finest N
    used, `reason` why the order is taken as settled or not.
    """

    half_width: float
    segments: int | None
    energy: float | None
    error: float | None
    order: float | None
    settled: bool
    reason: str
    others: Others = ()


@dataclass(frozen=True)
class Table:
    """Rows by half-width in the order of first appearance, N ascending, and an extrapolation for each."""

    rows: tuple[Row, ...]
    extrapolations: tuple[Extrapolation, ...]
    length: float


def convergence_rows(entries: Iterable[Entry], length: float = 2 * math.pi) -> Table:
    """The convergence table of `entries`, bands of midline length `length`.

    Raises ValueError if a half-width has two entries of one N: the choice between states is the caller's.
    """
    rows: list[Row] = []
    extrapolations = []
    for half_width, others, group in _groups(entries):
        rows.extend(replace(_row(half_width, n, group), others=others) for n in sorted(group))
        extrapolations.append(replace(_extrapolate(half_width, group, length), others=others))
    return Table(tuple(rows), tuple(extrapolations), length)


def _groups(entries: Iterable[Entry]) -> list[tuple[float, Others, dict[int, Entry]]]:
    groups: list[tuple[float, Others, dict[int, Entry]]] = []
    for entry in entries:
        known = (
            group for b, others, group in groups if same_width(b, entry.half_width) and others == entry.others
        )
        group = next(known, None)
        if group is None:
            group = {}
            groups.append((entry.half_width, entry.others, group))
        if entry.segments in group:
            raise ValueError(f"two entries for b = {entry.half_width:g}, N = {entry.segments}")
        group[entry.segments] = entry
    return groups


def _energy(group: Mapping[int, Entry], segments: int) -> float | None:
    entry = group.get(segments)
    if entry is None or entry.energy is None or not math.isfinite(entry.energy):
        return None
    return entry.energy


def _change(group: Mapping[int, Entry], segments: int) -> float | None:
    """E_2N - E_N with its sign, or None."""
    coarse, fine = _energy(group, segments), _energy(group, 2 * segments)
    return None if coarse is None or fine is None else fine - coarse


def _row(half_width: float, segments: int, group: Mapping[int, Entry]) -> Row:
    here, there = _change(group, segments), _change(group, 2 * segments)
    broken = [n for n in (2 * segments, 4 * segments) if n in group and group[n].breaks]
    ratio = abs(here / there) if here is not None and there and not broken else None
    turns = here is not None and there is not None and here * there < 0 and not broken
    used = (segments,) if here is None else (segments, 2 * segments)
    notes = [f"no certificate: E_{n}" for n in used if not group[n].certified]
    if 2 * segments in broken:
        notes.append(f"E_{2 * segments} is not on the branch of E_{segments}: {group[2 * segments].breaks}")
    if turns:
        notes.append("the difference changes sign: no order")
    return Row(
        half_width=half_width,
        segments=segments,
        energy=_energy(group, segments),
        delta=None if here is None else abs(here),
        ratio=ratio,
        order=math.log2(ratio) if ratio and not turns else None,
        certified=group[segments].certified,
        label=group[segments].label,
        note="; ".join(notes),
        doubtful=2 * segments in broken or not all(group[n].certified for n in used),
    )


def _extrapolate(half_width: float, group: Mapping[int, Entry], length: float) -> Extrapolation:
    """Extrapolate from the certified energies at N, N/2, N/4, N being the finest certified."""
    certified = {n: energy for n in group if group[n].certified and (energy := _energy(group, n)) is not None}
    if not certified:
        return Extrapolation(half_width, None, None, None, None, False, "no energy has a certificate")
    finest = max(certified)
    chain = [finest]
    while chain[0] % 2 == 0 and chain[0] // 2 in certified and not group[chain[0]].breaks:
        chain.insert(0, chain[0] // 2)
    energies = [certified[n] for n in chain]
    skipped = sorted(n for n in group if n > finest)
    aside = "" if not skipped else f"; without N = {', '.join(map(str, skipped))}, which has no certificate"
    if group[chain[0]].breaks:
        aside += f"; without N < {chain[0]}, another minimum"
    if len(chain) < 3:
        lacking = " and ".join(str(finest * 2**k) for k in range(1, 4 - len(chain)))
        reason = f"an order needs certified energies at N = {lacking} as well{aside}"
        return Extrapolation(half_width, finest, energies[-1], None, None, False, reason)
    error, order, unsettled = _judge(energies, length / finest / half_width)
    if unsettled:
        return Extrapolation(half_width, finest, energies[-1], error, order, False, unsettled + aside)
    correction = 0.0 if order is None else (energies[-1] - energies[-2]) / (FALL - 1)
    reason = (
        "the last differences are below the solver's tolerance"
        if order is None
        else f"the order is {order:.2f}: Richardson with order 2"
    )
    return Extrapolation(half_width, finest, energies[-1] + correction, error, order, True, reason + aside)


def _judge(energies: Sequence[float], mesh: float) -> tuple[float | None, float | None, str]:
    """(error bar, observed order, why the order has not settled) of three or more energies, N doubling.

    `mesh` is h/b on the finest level. The reason is empty if the order has settled; then the order is None
    where the differences are too small to show one.
    """
    changes = [fine - coarse for coarse, fine in itertools.pairwise(energies)]
    previous, last = changes[-2:]
    floor = SOLVER_FLOOR * abs(energies[-1])
    if max(abs(previous), abs(last)) <= floor:
        return floor, None, ""
    order = math.log2(previous / last) if previous * last > 0 else None
    octaves = 0 if _steady(changes) else max(0, math.ceil(math.log2(mesh / LAYER_RESOLUTION)))
    doubts = []
    if len({change > 0 for change in changes[-3:]}) > 1:
        doubts.append("the differences E_2N - E_N change sign")
    if octaves:
        doubts.append(f"h/b = {mesh:.3g} exceeds {LAYER_RESOLUTION:g}, layers of width b are not resolved")
    if order is not None and abs(order - ORDER) > ORDER_TOLERANCE:
        doubts.append(f"the observed order {order:.2f} is not {ORDER} to within {ORDER_TOLERANCE:g}")
    if doubts or order is None:
        return (
            _unsettled_error(previous, last, octaves),
            order,
            "; ".join(doubts) or "the last difference is 0",
        )
    # Richardson's value one level earlier is wrong by 16 times as much if the next term is of order 4;
    # the factor 1/3 instead of 1/15 covers a remainder that falls at order 2 only.
    step = last + (last - previous) / (FALL - 1)
    return max(abs(step) / (FALL - 1), floor), order, ""


def _steady(changes: Sequence[float]) -> bool:
    """Whether the last three differences fall at order 2 so evenly that no unresolved layer is at work.

    A cancellation shows order 2 once by chance, not twice to within STEADY_ORDER.
    """
    if len(changes) < 3 or len({change > 0 for change in changes[-3:]}) > 1 or 0.0 in changes[-3:]:
        return False
    orders = [math.log2(a / b) for a, b in itertools.pairwise(changes[-3:])]
    return all(abs(order - ORDER) <= STEADY_ORDER for order in orders)


def _unsettled_error(previous: float, last: float, octaves: int) -> float | None:
    """A bar about the finest energy while the order has not settled.

    If the last difference is below a quarter of the one before, this counts as a cancellation, and the
    quarter is used as its size. On an unresolved grid, the bar is one difference of that size for each octave
    until h/b is small enough for a rate to hold, and one for everything after it: the sum of a tail that
    falls at first order. On a resolved grid, it is the sum of such a tail, or of one that falls at the
    observed rate if that is slower. If the last two differences have opposite signs there, it is the larger
    of them. If they have one sign and do not fall, nothing bounds the error: None.
    """
    size = max(abs(last), abs(previous) / FALL)
    if octaves:
        return size * (octaves + 1)
    if previous * last <= 0:
        return max(abs(last), abs(previous))
    if abs(previous) <= abs(last):
        return None
    return size * max(1.0, 1.0 / (abs(previous) / size - 1.0))

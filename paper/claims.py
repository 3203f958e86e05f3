"""What chapter 3 of Koldaev (2022) says of its bands, held against stored states.

Each function returns checks: the claim in a few words, what must be found for it to hold, what was found with
its numbers, and whether they agree; None where the data cannot decide. The thesis names no tolerances: those
asked for here are ours, and stand in `expected`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from ribbon_cli.export.fields import even_window, field, inflections
from ribbon_cli.export.mesh import ODD_FIELDS

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ribbon_cli.store import SpectrumRecord, StateRecord, Summary

    Array = NDArray[np.float64]

MULTIPLIERS = tuple(f"lambda_{k}" for k in range(1, 6))
PERIODIC = 0.01
"""Largest mismatch, relative to the field's largest value, that counts as (anti)periodic."""
NEAR = 2.0
"""Facets within which an extremum counts as lying at an inflection."""
LARGEST = 0.999
"""Share of the largest modulus that counts as the largest."""
NEARLY_ACTIVE = 0.95
"""Least |tanh xi| of a constraint that counts as nearly active."""
VANISHES = 0.05
"""Share of the largest modulus, at the node next to a zero, below which a field counts as vanishing there."""
CENTRE = 0.1
"""Distance from the centre, relative to the surface's farthest point, that counts as at the centre."""
SHRINKS, STAYS = 0.8, 0.8
"""Ratio of eigenvalues from one N to the next below which they shrink, and from which they do not."""


@dataclass(frozen=True)
class Check:
    """A claim, what has to be found for it to hold, what was found, and whether they agree (None: not
    decided); `note` says why where they do not, or what is arguable.
    """

    claim: str
    expected: str
    found: str
    agrees: bool | None
    note: str = ""


def _where(record: StateRecord) -> str:
    return f"b = {record.half_width:g}, N = {record.segments}"


def _facet(record: StateRecord) -> float:
    """Length h of a facet."""
    return record.length / record.segments


def _places(record: StateRecord) -> Array:
    """Inflections in the window in which figures are drawn, ascending."""
    window = even_window(record)
    first = window.first * _facet(record)
    return np.sort((inflections(record) - first + window.offset) % record.length)


def inflection_count(record: StateRecord, expected: int) -> Check:
    """How often the signed curvature changes sign."""
    places = _places(record)
    shown = ", ".join(f"{alpha:.4f}" for alpha in places)
    word = {1: "one inflection point", 2: "two points", 3: "three inflection points"}[expected]
    return Check(
        f"{word}, where the signed curvature vanishes ({_where(record)})",
        f"{expected} change{'s' if expected > 1 else ''} of sign of kappa_s once round",
        f"{places.size}, at alpha = {shown}" if places.size else "none",
        bool(places.size == expected),
    )


def half_a_band_apart(record: StateRecord) -> Check:
    """Whether two inflections lie opposite to each other: with the origin chosen, at pi/2 and 3 pi/2."""
    places = _places(record)
    if places.size != 2:
        return Check("the two points lie half a band apart", "two points", f"{places.size}", False)
    gap, h = float(places[1] - places[0]), _facet(record)
    return Check(
        "the two points lie near alpha = 1.5 and 4.7, half a band apart",
        f"apart by l/2 = {record.length / 2:.5f} to one facet, h = {h:.5f}",
        f"{places[0]:.4f} and {places[1]:.4f}, apart by {gap:.5f}",
        abs(gap - record.length / 2) <= h,
        "the origin is ours to choose, and chosen so that they lie evenly",
    )


def torsion_vanishes(record: StateRecord) -> Check:
    """The torsion at the nodes next to the inflections, against its largest value.

    tau = kappa_s eta vanishes with kappa_s wherever eta is finite; what is left at a node falls with h.
    """
    shares = _torsion_shares(record, 0)
    return Check(
        f"the torsion vanishes at the inflection ({_where(record)})",
        f"|tau| at the nearest node below {100 * VANISHES:g} % of its largest",
        f"{', '.join(f'{100 * share:.3g} %' for share in shares)}",
        bool(shares and max(shares) < VANISHES),
    )


def torsion_dips(record: StateRecord) -> Check:
    """Whether the torsion falls at the inflections without dropping to zero at a node."""
    at, beside = _torsion_shares(record, 0), _torsion_shares(record, 3)
    return Check(
        f"the torsion falls at the two points, but not to zero ({_where(record)})",
        "|tau| at the nearest nodes above zero, and below that three nodes further",
        f"nearest node: {', '.join(f'{100 * share:.3g} %' for share in at)} of the largest |tau|; three "
        f"nodes further: {', '.join(f'{100 * share:.3g} %' for share in beside)}",
        bool(at and min(at) > 0 and all(low < high for low, high in zip(at, beside, strict=True))),
        "tau = kappa_s eta is zero where kappa_s is: what is left at a node is the grid's doing"
        + _coarse(record),
    )


def _torsion_shares(record: StateRecord, further: int) -> list[float]:
    """|tau| relative to its largest, so many nodes beyond the node nearest to each inflection."""
    alpha, tau = field(record, "tau", even_window(record))
    size = np.abs(tau) / float(np.abs(tau).max())
    nearest = [int(np.argmin(np.abs(alpha - place))) for place in _places(record)]
    sides = (-further, further)
    return [float(max(size[(k + side) % record.segments] for side in sides)) for k in nearest]


def _coarse(record: StateRecord) -> str:
    """A warning where facets are longer than half the layers beside inflections, of width b."""
    ratio = _facet(record) / record.half_width
    return f"; h = {ratio:.2f} b does not resolve layers of width b" if ratio > 0.5 else ""


def extremum_at_inflections(record: StateRecord, names: Sequence[str] = MULTIPLIERS) -> list[Check]:
    """Whether multipliers have a local extremum within `NEAR` facets of each inflection."""
    h = _facet(record)
    checks = []
    for name in names:
        alpha, values = _second_order(record, name)
        distances = [_distance_to_extremum(alpha, values, place) / h for place in _places(record)]
        worst = max(distances, default=math.inf)
        checks.append(
            Check(
                f"{name} has a local extremum at each inflection ({_where(record)})",
                f"a change of sign of its slope within {NEAR:g} facets",
                f"nearest: {', '.join(f'{d:.2f}' for d in distances)} facets away",
                bool(worst <= NEAR),
                "of lambda_3 - h lambda_2 eta, the field at second order (docs/errata.md)"
                if name == "lambda_3"
                else "",
            )
        )
    return checks


def _second_order(record: StateRecord, name: str) -> tuple[Array, Array]:
    """A multiplier at second order: lambda_3 less h lambda_2 eta (docs/errata.md)."""
    window = even_window(record)
    alpha, values = field(record, name, window)
    if name == "lambda_3":
        values = (
            values - _facet(record) * field(record, "lambda_2", window)[1] * field(record, "eta", window)[1]
        )
    return alpha, values


def _distance_to_extremum(alpha: Array, values: Array, place: float) -> float:
    """Distance from a place to the nearest point where the slope changes sign."""
    slope = np.diff(values)
    turns = np.flatnonzero(slope[1:] * slope[:-1] <= 0) + 1
    return float(np.abs(alpha[turns] - place).min()) if turns.size else math.inf


def largest_at_inflections(record: StateRecord, names: Sequence[str]) -> list[Check]:
    """Whether multipliers have their largest modulus at every inflection, to `LARGEST`."""
    window, places, h = even_window(record), _places(record), _facet(record)
    checks = []
    for name in names:
        alpha, values = field(record, name, window)
        size = np.abs(values)
        at = float(alpha[int(size.argmax())])
        distance = float(np.abs(places - at).min()) / h
        beside = [float(size[np.argmin(np.abs(alpha - p))]) / float(size.max()) for p in places]
        shares = ", ".join(f"{100 * share:.4g} %" for share in beside)
        checks.append(
            Check(
                f"|{name}| is largest at each inflection ({_where(record)})",
                f"at the nearest node or facet {100 * LARGEST:g} % of its largest value, or more",
                f"largest at alpha = {at:.4f}, {distance:.1f} facets away; at inflections {shares} of that",
                bool(min(beside, default=0.0) >= LARGEST),
                _coarse(record).removeprefix("; "),
            )
        )
    return checks


def injectivity_nearly_active(record: StateRecord) -> Check:
    """The largest |b eta'| = |tanh xi|, and where: 1 is where rulings meet at the edge."""
    alpha, xi = field(record, "xi", even_window(record))
    value = np.abs(np.tanh(xi))
    at = float(alpha[int(value.argmax())])
    distance = min((abs(at - place) for place in _places(record)), default=math.inf)
    near = distance <= max(NEAR * _facet(record), record.half_width)
    return Check(
        f"the injectivity constraint is nearly active close to an inflection ({_where(record)})",
        f"largest |tanh xi| above {NEARLY_ACTIVE:g}, within b or {NEAR:g} facets of an inflection",
        f"1 - {1.0 - value.max():.2g}, {distance:.3g} from an inflection",
        bool(value.max() > NEARLY_ACTIVE and near),
    )


def shifted(record: StateRecord, name: str, parts: int, sign: int) -> tuple[float, float]:
    """Mismatch of f(alpha + l/parts) - sign f(alpha), relative to the largest |f|, and of its best shift.

    `parts` must divide N. On a one-sided band fields that are odd in g are continued past the seam with their
    sign changed.
    """
    _, values = field(record, name, even_window(record))
    odd = record.sigma < 0 and name in ODD_FIELDS
    step = record.segments // parts
    moved = np.roll(values, -step)
    if odd:
        moved[-step:] *= -1.0
    size = float(np.abs(values).max())
    return float(np.abs(moved - sign * values).max()) / size, size


def period(record: StateRecord, name: str, parts: int, sign: int, claim: str, note: str = "") -> Check:
    """Whether a field repeats, up to `sign`, after l/parts."""
    mismatch, size = shifted(record, name, parts, sign)
    holds = mismatch <= PERIODIC
    return Check(
        f"{claim} ({_where(record)})",
        f"mismatch at most {100 * PERIODIC:g} % of the largest |{name}|",
        f"{100 * mismatch:.3g} % of the largest |{name}| = {size:.4g}",
        bool(holds),
        "" if holds else note,
    )


def half_turn_symmetry(record: StateRecord) -> Check:
    """What holds in place of the periodicity: kappa_s is odd and tau even about the inflection."""
    window = even_window(record)
    (place,) = _places(record)
    worst = []
    for name, sign in (("kappa_s", -1.0), ("tau", 1.0)):
        alpha, values = field(record, name, window)
        s = np.linspace(0.05, 0.45 * record.length, 200)
        before = np.interp(place - s, alpha, values)
        after = np.interp(place + s, alpha, values)
        worst.append(float(np.abs(after - sign * before).max() / np.abs(values).max()))
    return Check(
        f"the flip symmetry that others assumed, a half-turn about the inflection ({_where(record)})",
        f"kappa_s odd and tau even about it, mismatch at most {100 * PERIODIC:g} % of the largest",
        f"{100 * worst[0]:.2g} % of kappa_s and {100 * worst[1]:.2g} % of tau",
        bool(max(worst) <= PERIODIC),
        "this symmetry is what the thesis takes its periodicities to support; it holds",
    )


def certified_minima(records: Sequence[StateRecord]) -> Check:
    """Whether all eigenvalues of the projected Hessians are positive, by exact count."""
    negative = [record.negative_eigenvalues for record in records]
    return Check(
        "the eigenvalues of the projected Hessian are positive: local minima of the discrete problem",
        "no negative eigenvalue, counted by an exact elimination, and a certificate",
        f"negative: {', '.join('?' if n is None else str(n) for n in negative)}; "
        f"certified: {sum(record.certified for record in records)} of {len(records)}",
        all(record.certified for record in records),
    )


def contact_width(states: Sequence[Summary], printed: str, note: str = "") -> Check:
    """Whether the first self-contact, the least certified width that touches on the finest N, is as printed.

    `states` are the summaries of a run, the bisection's states included; agreement is to the printed digits.
    """
    touching: dict[int, float] = {}
    for state in states:
        if state.self_contact and state.certified:
            known = touching.get(state.segments, math.inf)
            touching[state.segments] = min(known, state.half_width)
    found = ", ".join(f"b = {touching[n]:.5f} (N = {n})" for n in sorted(touching)) or "no contact"
    digits = len(printed.partition(".")[2])
    agrees = bool(touching) and f"{touching[max(touching)]:.{digits}f}" == printed
    why = "" if agrees else f"at b = {printed} it does not touch yet; "
    return Check(
        f"the band first touches itself at b = {printed}",
        f"bisected to 1e-5, b = {printed} to these digits on the finest mesh",
        found,
        agrees,
        f"{why}{note}",
    )


def contact_at_the_centre(record: StateRecord) -> Check:
    """Where the nearest far parts are: the surface's distance from its centre, against its size."""
    surface = record.midline[:-1, None] + np.linspace(-1, 1, 41)[None, :, None] * (
        record.half_width * record.g[:, None]
    )
    centre = record.midline[:-1].mean(axis=0)
    distance = np.linalg.norm(surface - centre, axis=2)
    return Check(
        f"the contact comes at the centre of the band ({_where(record)})",
        f"the surface within {CENTRE:g} of its farthest point's distance from the centre",
        f"{distance.min():.3g} of {distance.max():.3g}: {distance.min() / distance.max():.3g}; clearance of "
        f"facets far along the band {record.clearance:.2g}",
        bool(distance.min() < CENTRE * distance.max()),
    )


def eigenvalues(spectrum: SpectrumRecord) -> Array:
    """Eigenvalues ascending, rotations left out."""
    kept = [v for v, label in zip(spectrum.values, spectrum.labels, strict=True) if label != "rotation"]
    return np.array(kept)


def half_vanish(spectra: Sequence[tuple[int, Array]], what: str) -> list[Check]:
    """Whether the lower half of the spectra falls with N while the upper does not.

    Compared are the values at a quarter and at three quarters of each sorted spectrum.
    """
    positive = all(values[0] > 0 for _, values in spectra)
    least = ", ".join(f"{values[0]:.3g} (N = {n})" for n, values in spectra)
    low = [float(np.quantile(values, 0.25)) for _, values in spectra]
    high = [float(np.quantile(values, 0.75)) for _, values in spectra]
    ratios = [a / b for a, b in zip(low[1:], low[:-1], strict=True)]
    return [
        Check(f"{what}: all eigenvalues are positive", "the least above zero", f"least: {least}", positive),
        Check(
            f"{what}: about half of the eigenvalues shrink as N grows",
            f"at a quarter of the spectrum by {SHRINKS:g} or less from one N to the next; at three quarters "
            f"not below {STAYS:g} in all",
            f"at a quarter by {', '.join(f'{r:.2f}' for r in ratios)}, at three quarters by "
            f"{', '.join(f'{a / b:.2f}' for a, b in zip(high[1:], high[:-1], strict=True))}",
            all(r <= SHRINKS for r in ratios) and high[-1] >= STAYS * high[0],
            "a property of the metric, which weighs xi and scales with h, and not of the bands: with "
            "h (|du|^2 + |dg|^2) each mode's eigenvalue converges",
        ),
    ]


def cured(vanishing: Sequence[float], converging: Sequence[float], limit: float) -> list[Check]:
    """Whether a ring's smallest Euclidean eigenvalues over h vanish under one rule, N doubled from one to the
    next, and converge to `limit` under the other.
    """
    orders = [math.log2(a / b) for a, b in pairwise(vanishing)]
    errors = [value - limit for value in converging]
    falls = [a / b for a, b in pairwise(errors)]
    return [
        Check(
            "not in the thesis: under its rule the ring's smallest eigenvalue over h tends to zero",
            "falling with an order above 1.5 in 1/N",
            f"{_numbers(vanishing)}: orders {', '.join(f'{order:.2f}' for order in orders)}",
            min(orders) > 1.5,
            "the energy does not see what alternates from facet to facet",
        ),
        Check(
            f"and under value-average to b k^2/3 = {limit:g}",
            "the difference falls by more than 3 from one N to the next, and ends below 5 %",
            f"{_numbers(converging)}: the difference falls by {', '.join(f'{fall:.2f}' for fall in falls)}",
            min(falls) > 3 and abs(errors[-1]) < 0.05 * limit,
        ),
    ]


def _numbers(values: Sequence[float]) -> str:
    return ", ".join(f"{value:.4g}" for value in values)

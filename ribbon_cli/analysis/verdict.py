"""From modes with error bounds and an inertia to a verdict in a sentence."""

from __future__ import annotations

from dataclasses import dataclass

from ..report.spectra import Mode
from ..solver.inertia import Inertia
from ..solver.spectra import CHECKERBOARD_SHARE


@dataclass(frozen=True)
class Verdict:
    """`kind` is stable, unstable or undecided, `sentence` says it with its reasons.

    `negative` is the number of negative eigenvalues, rotations left out, None where undecided; `gap` the
    lowest eigenvalue apart from rotations, sliding and checkerboard modes, if it was computed.
    """

    kind: str
    sentence: str
    negative: int | None
    gap: float | None


def judge(modes: tuple[Mode, ...], counted: Inertia, doubts: list[str], complete: bool) -> Verdict:
    """The verdict on modes in ascending order, rotations among them, and the inertia of W_c.

    `doubts` are reasons against any verdict; `complete` says that the modes are all there are.
    """
    doubts = list(doubts)
    others = [mode for mode in modes if mode.label != "rotation"]
    unsure = [mode for mode in others if abs(mode.value) <= mode.bound]
    negative = [mode for mode in others if mode.value < -mode.bound]
    doubts += [
        f"{_called(mode)} has {mode.value:.1e}, under its error bound {mode.bound:.1e}" for mode in unsure
    ]
    if not counted.trusted:
        measured = f"measured roundoff {counted.roundoff:.1e}, pivot gap {counted.gap:.1e}"
        doubts.append(f"the inertia is not trusted ({measured})")
    elif not unsure and counted.negative != len(negative):
        more = counted.negative > len(negative) and len(negative) == len(others) and not complete
        if not more:
            doubts.append(f"the inertia counts {counted.negative} negative, the spectrum {len(negative)}")
    lowest = next((mode for mode in others if mode.label == "mode"), None)
    gap = None if lowest is None else lowest.value
    if doubts:
        words = "undecided: " + "; ".join(doubts)
        rest = [mode for mode in others if mode not in unsure]
        if unsure and rest and all(mode.value > mode.bound for mode in rest):
            words += f"; all other modes are positive, the lowest {rest[0].value:.6g}"
        return Verdict("undecided", words, None, gap)
    if counted.negative:
        return Verdict("unstable", _unstable(negative, counted.negative), counted.negative, gap)
    return Verdict("stable", _stable(others, lowest), 0, gap)


def _called(mode: Mode) -> str:
    return {"mode": "a mode", "sliding": "the sliding mode"}.get(mode.label, f"a {mode.label} mode")


def _unstable(negative: list[Mode], count: int) -> str:
    shown = "; ".join(f"{_called(mode)} has {mode.value:.6g}" for mode in negative[:4])
    words = f"index {count}: no minimum, {shown}" + ("; ..." if count > 4 else "")
    if count == 1 and negative[0].label == "sliding":
        words += (
            ". The only way down is along the band: a saddle of the grid, with a lower twin half a facet on"
        )
    return words


def _stable(others: list[Mode], gap: Mode | None) -> str:
    shown = "not among the modes computed" if gap is None else f"{gap.value:.6g}"
    words = f"stable minimum modulo symmetries with gap {shown}"
    if gap is not None and gap.hidden > CHECKERBOARD_SHARE:
        words += f" of a mode that alternates over few facets (hidden {gap.hidden:.2f}), a value of this grid"
    sliding = [mode for mode in others if mode.label == "sliding"]
    checkerboard = [mode for mode in others if mode.label == "checkerboard"]
    if sliding:
        words += f"; sliding, free in the continuum, costs {sliding[0].value:.3g} on this grid"
    if checkerboard:
        lowest = checkerboard[0].value
        modes = "1 checkerboard mode" if len(checkerboard) == 1 else f"{len(checkerboard)} checkerboard modes"
        words += f"; {modes}, of the discretisation, from {lowest:.6g}"
    return words

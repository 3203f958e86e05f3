"""The section and the picture of `bench.scaling`."""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt

from .document import Part
from .level import MODES
from .scaling import EXPONENT, FIT_FROM, GIB, KIB, KIB_FROM, SECONDS, Level, Scaling
from .tables import Rule, milliseconds, table

PICTURE = "benchmarks-scaling.png"
QUANTITIES = (("seconds", "a level's time"), ("step", "a step's time"), ("grown", "a level's memory"))


def scaling_part(found: Scaling, folder: Path) -> Part:
    """The part of the page; its picture is drawn into the page's folder."""
    draw(found, folder / PICTURE)
    return Part("scaling", _rules(found), _section(found))


def _rules(found: Scaling) -> list[Rule]:
    """What is required of fine grids, with the figures found."""
    seconds, finest = sum(level.seconds for level in found.ours), found.ours[-1].segments
    most = max(level.whole for level in found.ours) / 1024
    out = [
        (f"every level to N = {finest} certified, in {SECONDS:g} s: {seconds:.1f} s", seconds <= SECONDS),
        (f"in {GIB:g} GiB: {most:.2f} GiB", most <= GIB),
    ]
    for name, words in (("step", "time of a step"), ("grown", "memory")):
        slope = found.exponent(name)
        if slope is not None:
            text = f"exponent of the {words} from N = {FIT_FROM} on at most {EXPONENT:g}: {slope:.2f}"
            out.append((text, slope <= EXPONENT))
    fine = [level.share for level in found.ours if level.segments >= KIB_FROM]
    if fine:
        text = f"at most {KIB:g} KiB a segment from N = {KIB_FROM} on: {max(fine):.1f}"
        out.append((text, max(fine) <= KIB))
    out += [
        (f"N = 3200 from N = 1600 within a second: {level.seconds:.2f} s", level.seconds < 1)
        for level in found.ours
        if level.segments == 3200
    ]
    out += [
        (f"its {MODES} lowest modes within a second: {level.modes:.2f} s", level.modes < 1)
        for level in found.ours
        if level.modes is not None
    ]
    return out


def _section(found: Scaling) -> str:
    """The section, Markdown."""
    theirs = {level.segments: level for level in found.peer}
    lines = [(*_row(level), *_peers(theirs.get(level.segments), level)) for level in found.ours]
    head = ("N", "seconds", "steps", "ms a step", "MiB", "KiB a segment")
    peer = ("peer, seconds", "iterations", "ms each", "MiB", "energy off")
    slopes = [(words, found.exponent(name)) for name, words in QUANTITIES]
    fitted = ", ".join(f"{words} {slope:.2f}" for words, slope in slopes if slope is not None)
    return f"""## Scaling

The band of b = {found.half_width:g} is refined level by level. Each level is a process of its own, which
begins with the stored state of the level before and has one thread. Its seconds hold prolongation,
certificate and symbolic factorisation, but no files and no spectra. The lowest modes are those of the
physical metric, with the count that none is missing. Its memory is by how much it raises the peak of a
process that has everything loaded. A step is from one Newton iterate to the next: derivatives,
matrix, factors and solution. Medians of five runs up to N = 800, of three up to 3200. The peer begins with
the same prolongation, in a process of its own; its building counts in memory alone. An iteration of it may
take several factorisations, and on fine grids the start nearly meets its tolerance, which is not scaled with
N. *Energy off* is relative to ours.{_ended(found)}

![Time and memory over the number of segments]({PICTURE})

{_fitted(fitted)}{_limit(found)}

{table((*head, *peer), lines)}"""


def _ended(found: Scaling) -> str:
    return f" It goes no further: {found.peer_end}." if found.peer_end else ""


def _fitted(fitted: str) -> str:
    return f"Exponents fitted from N = {FIT_FROM} on: {fitted}.\n" if fitted else ""


def _limit(found: Scaling) -> str:
    if len(found.ours) < 3:
        return ""
    energy, error = found.limit()
    return (
        f"The energies tend to {energy:.9f}, by Richardson's extrapolation of the two finest levels. That of "
        f"the two before differs by {error:.0e}."
    )


def _row(level: Level) -> tuple[str, ...]:
    memory = f"{level.grown:.1f}", f"{level.share:.1f}"
    step = milliseconds(level.step)
    return str(level.segments), f"{level.seconds:.2f}", str(level.steps), step, *memory


def _peers(level: Level | None, ours: Level) -> tuple[str, ...]:
    if level is None:
        return "", "", "", "", ""
    failed = f" ({level.failed})" if level.failed else ""
    seconds = f"{level.seconds:.2f}{failed}"
    off = f"{abs(level.energy - ours.energy) / ours.energy:.0e}"
    return seconds, str(level.steps), milliseconds(level.step), f"{level.grown:.0f}", off


def draw(found: Scaling, path: Path) -> None:
    """Times and memory over N, both of ours and the peer's, in double logarithmic axes."""
    figure, (times, memory) = plt.subplots(1, 2, figsize=(7.0, 3.1), dpi=200, layout="constrained")
    for levels, colour, who in ((found.ours, "#1b4f72", "ribbon"), (found.peer, "#b9541b", "CasADi, IPOPT")):
        n = [level.segments for level in levels]
        times.plot(n, [level.seconds for level in levels], "o-", color=colour, label=f"{who}: a level")
        each = "a step" if who == "ribbon" else "an iteration"
        times.plot(n, [level.step for level in levels], "o--", mfc="w", color=colour, label=f"{who}: {each}")
        memory.plot(n, [level.grown for level in levels], "o-", color=colour, label=who)
    for axes, words, name in ((times, "seconds", "seconds"), (memory, "MiB", "grown")):
        fine = [level for level in found.ours if level.segments >= FIT_FROM]
        if fine:
            n = [level.segments for level in fine]
            start = 0.35 * getattr(fine[-1], name) / n[-1]
            axes.plot(n, [start * m for m in n], ":", color="0.45", label="proportional to N")
        axes.set(xscale="log", yscale="log", xlabel="segments N", ylabel=words)
        axes.grid(True, which="major", color="0.9", linewidth=0.6)
        for line in axes.lines:
            line.set(markersize=3.5, linewidth=1.1)
        axes.legend(fontsize=7, frameon=False, loc="upper left")
    times.set_ylim(top=3e3)  # room for the legend
    figure.savefig(path)
    plt.close(figure)

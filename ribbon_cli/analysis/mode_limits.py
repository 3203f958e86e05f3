"""The lowest eigenvalues of a run's equilibria under refinement: orders, limits, the decay of sliding."""

from __future__ import annotations

import math
from dataclasses import replace

from ..errors import UsageError
from ..report.convergence import Entry, Extrapolation, convergence_rows
from ..report.spectra import ModeSequence, RunSpectra, SpectralTable
from ..store import Run
from ..store.refs import no_equilibria
from .energies import table_entries
from .stability import DEFAULT_METRIC, Stability, stability_of, told_of

DEFAULT_MODES = 6
SPARE = 12
"""Modes computed beyond those wanted: under `thesis` checkerboard modes stand between the others."""


def spectral_convergence(
    run: Run, metric: str = DEFAULT_METRIC, modes: int = DEFAULT_MODES
) -> tuple[SpectralTable, tuple[str, ...]]:
    """The `modes` lowest eigenvalues besides rotations at each place of a run, over its levels.

    Modes are numbered by their order within their label, so that checkerboard modes, which the limit does
    not have, do not shift the others. Also which states have no certificate and are left out. Raises
    UsageError for a run without equilibria.
    """
    entries = _entries(run)
    sequences: list[ModeSequence] = []
    notes: list[str] = []
    uncertified: list[str] = []
    formula, length = "", 2.0 * math.pi
    for place in dict.fromkeys((entry.half_width, entry.others) for entry in entries):
        half_width, others = place
        levels: list[tuple[int, Stability]] = []
        here = [entry for entry in entries if (entry.half_width, entry.others) == place]
        for entry in sorted(here, key=lambda e: e.segments):
            where = f"b = {half_width:g}" + "".join(f", {name} = {value:g}" for name, value in others)
            where += f", N = {entry.segments}"
            if not entry.certified:
                uncertified.append(f"{run.short_name}:{entry.label}: no certificate at {where}: left out")
                continue
            found = stability_of(run.load(int(entry.label or 0)), metric, modes + SPARE)
            formula, length = found.formula, found.state.band.length
            levels.append((entry.segments, found))
            notes += [f"{where}: {note}" for note in _symmetry_notes(found)]
        sequences += [replace(s, others=others) for s in _sequences(half_width, levels, modes, length)]
    return SpectralTable(run.name, metric, formula, tuple(sequences), tuple(notes)), tuple(uncertified)


def _entries(run: Run) -> list[Entry]:
    """The run's equilibria, one for each place. Raises UsageError where there is none."""
    entries = table_entries(run)
    if not entries:
        raise UsageError(no_equilibria(run))
    return entries


def _symmetry_notes(found: Stability) -> list[str]:
    """A symmetry that the grid breaks splits what would be double."""
    group = found.symmetries
    if group.near_name == group.name:
        return []
    return [
        f"the symmetry is {group.name} on this grid and {group.near_name} but for "
        f"{group.near_residual:.1e}: multiple eigenvalues split"
    ]


def _sequences(
    half_width: float, levels: list[tuple[int, Stability]], modes: int, length: float
) -> list[ModeSequence]:
    """Sequences at one half-width: sliding first, then modes, then what is left of checkerboards."""
    out: list[ModeSequence] = []
    wanted = modes
    for label in ("sliding", "mode", "checkerboard"):
        listed = [(n, [m for m in found.modes if m.label == label]) for n, found in levels]
        most = min(
            max((len(found) for _, found in listed), default=0), wanted if label != "checkerboard" else modes
        )
        for number in range(most):
            there = [(n, found[number]) for n, found in listed if len(found) > number]
            grid = tuple(n for n, _ in there)
            values = tuple(mode.value for _, mode in there)
            known = dict(zip(grid, values, strict=True))
            limit = None if label == "checkerboard" else _limit(half_width, known, length)
            out.append(
                ModeSequence(
                    half_width,
                    label,
                    number + 1,
                    there[-1][1].parity,
                    grid,
                    values,
                    tuple(mode.bound for _, mode in there),
                    tuple(mode.sliding_overlap for _, mode in there),
                    tuple(_decay(known, n) if label == "sliding" else _order(known, n) for n in grid),
                    None if limit is None or label == "sliding" else limit.energy,
                    None if limit is None or label == "sliding" else limit.error,
                    limit is not None and limit.settled and label != "sliding",
                    _reason(label, limit),
                )
            )
        if label == "sliding":
            wanted -= most
    return out


def _reason(label: str, limit: Extrapolation | None) -> str:
    if label == "sliding":
        return "a symmetry of the continuum, which has it at zero"
    if limit is None:
        return "of the discretisation, without a limit"
    # The judgement is that of energies, whose sentences name them.
    return limit.reason.replace("E_2N - E_N", "from N to 2N").replace("energies", "values")


def _limit(half_width: float, known: dict[int, float], length: float) -> Extrapolation:
    entries = [Entry(half_width, n, value, True) for n, value in known.items()]
    return convergence_rows(entries, length).extrapolations[0]


def _order(known: dict[int, float], n: int) -> float | None:
    """log2 of the ratio of two successive differences, None where they differ in sign or are missing."""
    if 2 * n not in known or 4 * n not in known:
        return None
    here, there = known[2 * n] - known[n], known[4 * n] - known[2 * n]
    return math.log2(here / there) if here * there > 0 else None


def _decay(known: dict[int, float], n: int) -> float | None:
    """log2(value_N / value_2N) of a value that falls to zero."""
    if 2 * n not in known or known[n] * known[2 * n] <= 0:
        return None
    return math.log2(known[n] / known[2 * n])


def run_spectra(run: Run, metric: str) -> RunSpectra:
    """All 2N - 3 eigenvalues of each of a run's equilibria, the latest at each half-width and N.

    In the Euclidean metric these are the data of Koldaev (2022), Figure 3.14. Raises UsageError for a run
    without equilibria, or with one that has too many segments for dense algebra.
    """
    entries = _entries(run)
    records = [run.load(int(entry.label or 0)) for entry in entries]
    states = (told_of(record, stability_of(record, metric, full=True), run.name) for record in records)
    return RunSpectra(run.name, metric, tuple(states))

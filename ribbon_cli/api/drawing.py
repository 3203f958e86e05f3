"""From a reference or a state to a picture with its caption."""

from __future__ import annotations

import os
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

from ribbon_cli import analysis, export, plot
from ribbon_cli.api.names import PLOT_KINDS
from ribbon_cli.errors import RibbonWarning, UsageError
from ribbon_cli.store import Run, StateRecord, suggest

_SEEN = ("shape", "family", "mode")
_ON_ONE_GRID = ("geometry", "multipliers", "branch", "family")
_OF_A_RUN = ("convergence", "branch", "family")
_OF_RUNS = ("spectrum", "branch")
"""Kinds that have a view; that can show a run's states of one N; that show a run and no state; that show
several runs."""


@dataclass(frozen=True)
class Named:
    """What a reference names: a run and no state, or one state and its run, None outside of one."""

    ref: str
    run: Run | None
    states: tuple[StateRecord, ...] = ()

    @property
    def stem(self) -> str:
        """Name of a default file without its ending: RUN, RUN-LABEL, or of its file outside of a run."""
        if self.run is None:
            return os.path.splitext(os.path.basename(self.ref))[0]
        return "-".join([self.run.short_name, *(str(record.label) for record in self.states)])

    @property
    def name(self) -> str:
        """RUN:LABEL of a state, or its file's name outside of a run."""
        return f"{self.run.name}:{self.states[0].label}" if self.run else os.path.basename(self.ref)


def check_kind(
    kind: str, index: int | None, view: object, segments: int | None, others: Sequence[object]
) -> None:
    """Refuse an unknown kind of picture, and an option that would do nothing for it. Raises UsageError."""
    if kind not in PLOT_KINDS:
        known = ", ".join(PLOT_KINDS)
        raise UsageError(f"no kind of picture {kind!r} (known: {known}){suggest(kind, PLOT_KINDS)}")
    if index and kind != "mode":
        raise UsageError("--index goes with the kind mode")
    if view and kind not in _SEEN:
        raise UsageError(f"--view does nothing for {kind}: it is for {', '.join(_SEEN)}")
    if segments and kind not in _ON_ONE_GRID:
        raise UsageError(f"--segments does nothing for {kind}: it is for {', '.join(_ON_ONE_GRID)} of a run")
    if others and kind in _OF_A_RUN and kind not in _OF_RUNS:
        raise UsageError(f"--with does nothing for {kind}, which shows a run: it goes with a state")


def check_title(title: str | None) -> None:
    """Refuse an empty title. Raises UsageError."""
    if title is not None and not title.strip():
        raise UsageError("--title is empty: leave it out, or say what the picture shows")


def source_of(
    kind: str,
    first: Named,
    others: Sequence[Named] = (),
    angles: tuple[float, float] | None = None,
    segments: int | None = None,
    index: int | None = None,
) -> plot.kinds.Source:
    """What the first reference and the `others` name. Raises UsageError."""
    run, states = first.run, first.states
    if others and kind == "branch" and states:
        raise UsageError(f"branch shows runs: name the run of {first.ref}")
    beside: tuple[Run, ...] = ()
    names: tuple[str, ...] = ()
    run_names: tuple[str, ...] = ()
    if others and not states:
        if kind not in _OF_RUNS:
            raise UsageError("--with goes with a state, and the reference names a run")
        if any(other.states for other in others):
            raise UsageError("--with needs a run beside a run, not a state")
        beside = tuple(other.run for other in others if other.run)
    elif others:
        if any(not other.states for other in others):
            raise UsageError("--with needs a state, not a run")
        given = [first, *others]
        states = tuple(record for each in given for record in each.states)
        if run is None or any(other.run is None or other.run.path != run.path for other in others):
            run = None
            names = tuple(each.name for each in given)
            texts = zip(plot.labels.run_texts([each.run for each in given]), given, strict=True)
            run_names = tuple(text or plot.labels.plain(os.path.basename(each.ref)) for text, each in texts)
    if segments and states and kind not in _OF_A_RUN:
        raise UsageError("--segments goes with a run, and the reference names a state")
    mode = partial(_mode, index=index)
    return plot.kinds.Source(
        run,
        states,
        analysis.run_table,
        analysis.multiplier_curves,
        mode,
        angles,
        segments,
        beside,
        names,
        run_names,
    )


def figure_of(
    kind: str,
    first: Named,
    others: Sequence[Named],
    style: str,
    view: tuple[float, float] | None,
    segments: int | None,
    index: int | None,
    width: float | None,
    title: str | None,
    caption: bool,
) -> plot.canvas.Figure:
    """The picture of a run or state, for programs; warns of bands that meet themselves.

    Raises UsageError.
    """
    check_kind(kind, index, view, segments, others)
    check_title(title)
    look = plot.figure.find_style(style)
    look = look if width is None else plot.style.of_width(look, width)
    picture = plot.kinds.draw(kind, source_of(kind, first, others, view, segments, index), look)
    warning = export.words.contact_warning(picture.states)
    if warning:
        warnings.warn(warning, RibbonWarning, stacklevel=3)
    return picture.dressed(look, caption, title)


def _mode(record: StateRecord, index: int | None) -> plot.modes.ModeShape:
    """A mode of a state by its number in `ribbon spectrum`, else the lowest that is not a rotation.

    Raises UsageError as `ribbon spectrum` does.
    """
    found = analysis.stability_of(record, modes=max(12, index or 1))
    if index is None:
        index = 1 + next(k for k, mode in enumerate(found.modes) if mode.label != "rotation")
    if index > len(found.vectors):
        raise UsageError(f"--index {index}: the state has {len(found.vectors)} modes")
    mode = found.modes[index - 1]
    words = {"s": "symmetric under", "a": "antisymmetric under", "x": "mixed with its like by"}
    names = {
        word: [name for sign, name in zip(mode.parity, mode.symmetry, strict=True) if sign == letter]
        for letter, word in words.items()
    }
    symmetries = tuple(f"{word} {' and '.join(under)}" for word, under in names.items() if under)
    return plot.modes.ModeShape(
        index,
        mode.value,
        mode.bound,
        f"{found.metric} metric",
        mode.label,
        () if mode.label == "rotation" else symmetries,
        found.verdict.sentence,
        found.vectors[index - 1],
    )

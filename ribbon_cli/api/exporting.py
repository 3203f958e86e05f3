"""States and runs in the formats of other programs."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field

from ribbon_cli import export as exports
from ribbon_cli import plot, store
from ribbon_cli.api.drawing import Named
from ribbon_cli.api.names import EXPORT_FORMATS
from ribbon_cli.api.targets import IN_PYTHON, OVERWRITE, check_target
from ribbon_cli.errors import RibbonWarning, UsageError
from ribbon_cli.store import Run, StateRecord, suggest, typed, write_atomic
from ribbon_cli.text import visible


@dataclass(frozen=True)
class Exported:
    """The files written, the states in them, what has to be said of them as numbers and in words, and a
    sentence on bands that meet themselves, empty where none do.
    """

    format: str
    paths: tuple[str, ...]
    states: tuple[StateRecord, ...] = field(repr=False)
    facts: exports.solid.Facts | None = None
    remarks: tuple[str, ...] = ()
    warning: str = ""


def format_of(form: str | None, path: str | None) -> str:
    """The format that is asked for; else the one that the file's suffix names.

    Raises UsageError where there is neither, and where the suffix is another format's.
    """
    suffix = os.path.splitext(path or "")[1].removeprefix(".").lower()
    if form in EXPORT_FORMATS and suffix in EXPORT_FORMATS and suffix != form:
        raise UsageError(f"{path}: its suffix is that of the format {suffix}, and {form} is asked for")
    if not form and path and not suffix:
        raise UsageError(f"{path}: its suffix names the format: one of .{', .'.join(EXPORT_FORMATS)}")
    return form or suffix


def check_format(form: str, options: exports.formats.Options) -> None:
    """Refuse an unknown format, and an option that does nothing for it. Raises UsageError."""
    if form not in EXPORT_FORMATS:
        known = f"known: {', '.join(EXPORT_FORMATS)}"
        raise UsageError(f"no format {form!r} ({known}){suggest(form, EXPORT_FORMATS)}")
    if form != "npz":
        exports.formats.check_options(form, options)
    elif options != exports.formats.Options():
        raise UsageError("npz has no options: it holds the state as it is")


def export(
    form: str,
    named: Named,
    options: exports.formats.Options,
    path: str | None = None,
    overwrite: bool = False,
    tell: Callable[[str], object] = lambda text: None,
    hint: str = OVERWRITE,
) -> Exported:
    """Write what a reference names, by default to RUN-LABEL.FORMAT here.

    Of a run, formats that take several get its states of one N, by width; `tell` is called with which these
    are. `hint` says what to do about a file that exists. Raises UsageError, StoreError.
    """
    check_format(form, options)
    run, states = named.run, named.states
    if not states:
        assert run is not None
        if form == "npz":
            raise UsageError(f"npz takes one state: name one of {run.name}, as in {typed(run)}:1")
        states, rest = exports.formats.states_of_run(form, run, options)
        tell(f"{_title(run, states)}, N = {states[0].segments}{rest}; --segments takes another N")
    elif options.segments is not None:
        raise UsageError("--segments goes with a run, and the reference names a state")
    target = path or f"{named.stem}.{form}"
    check_target(target, overwrite, hint)
    if form == "npz":
        store.export_npz(states[0], target, overwrite)
        return Exported(form, (target,), states, warning=exports.words.contact_warning(states))
    writer = exports.formats.FORMATS[form]
    job = exports.formats.Job(states, _title(run, states), run.name if run else None, options)
    paths = _write(target, writer.write(job), overwrite, hint)
    facts, words = writer.remarks(job)
    return Exported(form, paths, states, facts, tuple(words), exports.words.contact_warning(states))


def _title(run: Run | None, states: tuple[StateRecord, ...]) -> str:
    """What a file says of its data, in one line whatever a state from elsewhere holds."""
    return visible(plot.figure.state_caption(states, run.name if run else None))


def _write(path: str, data: list[bytes], overwrite: bool, hint: str) -> tuple[str, ...]:
    """Write the files, numbered where there are several, and return their names."""
    stem, suffix = os.path.splitext(path)
    paths = [path] if len(data) == 1 else [f"{stem}-{k}{suffix}" for k in range(1, len(data) + 1)]
    for name in paths:
        check_target(name, overwrite, hint)
    for name, content in zip(paths, data, strict=True):
        write_atomic(name, content, overwrite=overwrite)
    return tuple(paths)


def export_to(
    path: str | os.PathLike[str],
    form: str | None,
    named: Named,
    options: exports.formats.Options,
    overwrite: bool,
) -> Exported:
    """As `export`, for programs: the format is the suffix's unless given, and what the command line says on
    standard error of bands that meet themselves is a warning.
    """
    target = os.fspath(path)
    done = export(format_of(form, target), named, options, target, overwrite, hint=IN_PYTHON)
    if done.warning:
        warnings.warn(done.warning, RibbonWarning, stacklevel=3)
    return done

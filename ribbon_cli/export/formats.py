"""What `ribbon export` can write: each format, what it takes, and its files."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from ribbon_cli.errors import UsageError
from ribbon_cli.export.fold import fold_bytes
from ribbon_cli.export.gltf import glb_bytes
from ribbon_cli.export.meshes import obj_bytes, ply_bytes, stl_bytes
from ribbon_cli.export.pattern import fold_pattern
from ribbon_cli.export.series import branch, left_out
from ribbon_cli.export.sheet import pages
from ribbon_cli.export.solid import Solid, printed, remarks
from ribbon_cli.export.svg import pattern_pdf, pattern_svg
from ribbon_cli.export.text import csv_bytes, json_bytes
from ribbon_cli.export.viewer import viewer_html
from ribbon_cli.export.vtkhdf import vtkhdf_bytes
from ribbon_cli.store import Run, StateRecord
from ribbon_cli.store.refs import typed

MOST_STATES = 400
"""Most states that an export of a run takes."""


@dataclass(frozen=True)
class Options:
    """What the formats can be told; None stands for a format's own choice.

    `size` length of the midline and `thickness` of the wall in millimetres; `paper` a sheet's name;
    `segments` the N of a run's states.
    """

    size: float | None = None
    thickness: float | None = None
    paper: str | None = None
    segments: int | None = None


@dataclass(frozen=True)
class Format:
    """A format: how it is written, whether it takes a whole run, and which options it heeds.

    `write` returns the files' bytes, one but for a pattern on pages; `remarks` what has to be said of them,
    as numbers and in words.
    """

    write: Callable[[Sequence[StateRecord], str, str | None, Options], list[bytes]]
    series: bool = False
    options: tuple[str, ...] = ()
    remarks: Callable[[StateRecord, Options], tuple[dict[str, float], list[str]]] | None = None


STL_SIZE, STL_THICKNESS, PATTERN_SIZE = 200.0, 1.0, 500.0
"""Defaults in millimetres: what fits common printers, and a strip of two sheets of A4."""


def _obj(states: Sequence[StateRecord], title: str, run: str | None, options: Options) -> list[bytes]:

    return [obj_bytes(states[0], title)]


def _ply(states: Sequence[StateRecord], title: str, run: str | None, options: Options) -> list[bytes]:

    return [ply_bytes(states[0], title)]


def _solid(state: StateRecord, options: Options) -> Solid:

    size = STL_SIZE if options.size is None else options.size
    thickness = STL_THICKNESS if options.thickness is None else options.thickness
    return printed(state, size, thickness)


def _stl(states: Sequence[StateRecord], title: str, run: str | None, options: Options) -> list[bytes]:

    return [stl_bytes(states[0], title, _solid(states[0], options))]


def _stl_remarks(state: StateRecord, options: Options) -> tuple[dict[str, float], list[str]]:

    return remarks(state, _solid(state, options))


def _vtkhdf(states: Sequence[StateRecord], title: str, run: str | None, options: Options) -> list[bytes]:

    return [vtkhdf_bytes(states, title)]


def _csv(states: Sequence[StateRecord], title: str, run: str | None, options: Options) -> list[bytes]:

    return [csv_bytes(states[0], run)]


def _json(states: Sequence[StateRecord], title: str, run: str | None, options: Options) -> list[bytes]:

    return [json_bytes(states[0], run)]


def _svg(states: Sequence[StateRecord], title: str, run: str | None, options: Options) -> list[bytes]:

    pattern = fold_pattern(states[0], PATTERN_SIZE if options.size is None else options.size)
    found = pages(pattern, options.paper)[2]
    return [pattern_svg(pattern, title, options.paper, page.number) for page in found]


def _pdf(states: Sequence[StateRecord], title: str, run: str | None, options: Options) -> list[bytes]:

    pattern = fold_pattern(states[0], PATTERN_SIZE if options.size is None else options.size)
    return [pattern_pdf(pattern, title, options.paper or "A4")]


def _html(states: Sequence[StateRecord], title: str, run: str | None, options: Options) -> list[bytes]:

    return [viewer_html(states, title, run)]


def _fold(states: Sequence[StateRecord], title: str, run: str | None, options: Options) -> list[bytes]:

    return [fold_bytes(states[0], title, run)]


def _glb(states: Sequence[StateRecord], title: str, run: str | None, options: Options) -> list[bytes]:

    return [glb_bytes(states[0], title, run)]


FORMATS = {
    "obj": Format(_obj),
    "stl": Format(_stl, options=("size", "thickness"), remarks=_stl_remarks),
    "ply": Format(_ply),
    "glb": Format(_glb),
    "vtkhdf": Format(_vtkhdf, True, ("segments",)),
    "csv": Format(_csv),
    "json": Format(_json),
    "svg": Format(_svg, options=("size", "paper")),
    "pdf": Format(_pdf, options=("size", "paper")),
    "fold": Format(_fold),
    "html": Format(_html, True, ("segments",)),
}
"""Formats but for npz, which is the store's own. A new format is a new row."""


def check_options(name: str, options: Options) -> None:
    """Raise UsageError for an option that the format does not heed."""
    for option in ("size", "thickness", "paper", "segments"):
        if getattr(options, option) is not None and option not in FORMATS[name].options:
            fitting = [known for known, form in FORMATS.items() if option in form.options]
            raise UsageError(f"--{option} does nothing for {name}: it is for {', '.join(fitting)}")


def states_of_run(name: str, run: Run, options: Options) -> tuple[tuple[StateRecord, ...], str]:
    """The states that a format takes of a run, by width, and words on those that these stand for.

    Raises UsageError for a format of single states.
    """
    found = branch(run, options.segments)
    if not FORMATS[name].series:
        example = f"{typed(run)}:{found[-1].label}"
        raise UsageError(f"{name} takes one state: name one of {run.name}, for instance {example}")
    if len(found) > MOST_STATES:
        raise UsageError(f"{run.name} has {len(found)} widths, and {name} takes at most {MOST_STATES}")
    return tuple(run.load(state.label) for state in found), left_out(run, found)

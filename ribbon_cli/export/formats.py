"""What `ribbon export` can write: each format, what it takes, and its files."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

from ribbon_cli.errors import UsageError
from ribbon_cli.export.fold import fold_bytes
from ribbon_cli.export.gltf import glb_bytes
from ribbon_cli.export.meshes import obj_bytes, ply_bytes, stl_bytes
from ribbon_cli.export.pattern import Pattern, fold_pattern
from ribbon_cli.export.series import branch, left_out
from ribbon_cli.export.sheet import pages
from ribbon_cli.export.solid import Facts, Solid, printed, remarks
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
class Job:
    """What is to be written: states, a line on them, the name of their run, and what was asked for."""

    states: Sequence[StateRecord]
    title: str
    run: str | None
    options: Options

    @property
    def state(self) -> StateRecord:
        """The state, for formats of one."""
        return self.states[0]

    @cached_property
    def solid(self) -> Solid:
        """The state as something to print."""
        size = STL_SIZE if self.options.size is None else self.options.size
        thickness = STL_THICKNESS if self.options.thickness is None else self.options.thickness
        return printed(self.state, size, thickness)

    @property
    def pattern(self) -> Pattern:
        """The state as a strip to fold."""
        return fold_pattern(self.state, PATTERN_SIZE if self.options.size is None else self.options.size)


@dataclass(frozen=True)
class Format:
    """A format: how it is written, whether it takes a whole run, and which options it heeds.

    `write` returns the files' bytes, one but for a pattern on pages; `remarks` what has to be said of them,
    as numbers and in words.
    """

    write: Callable[[Job], list[bytes]]
    series: bool = False
    options: tuple[str, ...] = ()
    remarks: Callable[[Job], tuple[Facts | None, list[str]]] = lambda job: (None, [])


STL_SIZE, STL_THICKNESS, PATTERN_SIZE = 200.0, 1.0, 500.0
"""Defaults in millimetres: what fits common printers, and a strip of two sheets of A4."""


def _svg(job: Job) -> list[bytes]:
    """A file for each page."""
    pattern, paper = job.pattern, job.options.paper
    found = pages(pattern, paper)[2]
    return [pattern_svg(pattern, job.title, paper, page.number) for page in found]


def _pdf(job: Job) -> list[bytes]:
    """All pages in one file."""
    return [pattern_pdf(job.pattern, job.title, job.options.paper or "A4")]


FORMATS = {
    "obj": Format(lambda job: [obj_bytes(job.state, job.title)]),
    "stl": Format(
        lambda job: [stl_bytes(job.state, job.title, job.solid)],
        options=("size", "thickness"),
        remarks=lambda job: remarks(job.state, job.solid),
    ),
    "ply": Format(lambda job: [ply_bytes(job.state, job.title)]),
    "glb": Format(lambda job: [glb_bytes(job.state, job.title, job.run)]),
    "vtkhdf": Format(lambda job: [vtkhdf_bytes(job.states, job.title)], True, ("segments",)),
    "csv": Format(lambda job: [csv_bytes(job.state, job.run)]),
    "json": Format(lambda job: [json_bytes(job.state, job.run)]),
    "svg": Format(_svg, options=("size", "paper")),
    "pdf": Format(_pdf, options=("size", "paper")),
    "fold": Format(lambda job: [fold_bytes(job.state, job.title, job.run)]),
    "html": Format(lambda job: [viewer_html(job.states, job.title, job.run)], True, ("segments",)),
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

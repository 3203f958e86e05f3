"""From a file or text to a `Config`, or to all the mistakes in it at once."""

from __future__ import annotations

import math
import os
from pathlib import Path

from ribbon_cli.config import sections, strips
from ribbon_cli.config.document import MAX_BYTES, Node, position, read_document
from ribbon_cli.config.guess import initial_guess, report_unheld
from ribbon_cli.config.mistakes import Mistakes, near_miss, shown
from ribbon_cli.config.reader import Reader
from ribbon_cli.config.schedule import half_widths_of, schedule
from ribbon_cli.config.table import CONFIG, NAME, SPECTRUM
from ribbon_cli.config.types import Arclength, Config, Leg, SpectrumRequest

_OF_SWEEPS = {"vary": "makes this a sweep: `ribbon sweep` runs it"}


def load_config(path: str | os.PathLike[str]) -> Config:
    """Read and check the config at `path`. Raises ConfigError with everything that is wrong."""
    file = os.fsdecode(path)
    return parse_config(read_text(file, Mistakes(file)), file)


def read_text(file: str, mistakes: Mistakes) -> str:
    """The text of a file. Raises ConfigError where it cannot be read."""
    data = _read(file, mistakes)
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError as error:
        _report_not_utf8(data, error.start, mistakes)
        raise mistakes.error() from None


def parse_config(text: str, path: str | os.PathLike[str]) -> Config:
    """Check a config given as text; `path` names it in messages and gives the folder of relative paths.

    Raises ConfigError with everything that is wrong.
    """
    path = os.fsdecode(path)
    mistakes = Mistakes(path)
    root = read_document(text, mistakes)
    if root is None:
        raise mistakes.error()
    return config_of(root, mistakes, text, path)


def config_of(root: Node, mistakes: Mistakes, text: str, path: str) -> Config:
    """Check a config given as a tree. Raises ConfigError with everything that is wrong."""
    reader = Reader(mistakes)
    found = reader.section(root, "", CONFIG, _OF_SWEEPS)
    top = found.nodes
    name = found.read("name") if "name" in top else _stem(reader, root, path)
    kind = strips.topology(reader, top.get("topology"))
    reader.length = found.read("length")
    guess = initial_guess(reader, top.get("initial_guess"), kind, os.path.dirname(path))
    parts = strips.parts(reader, root, found, kind)
    if parts is not None and guess.recipe == "strip":
        strips.report_not_planar(reader, found, parts)
    widths: tuple[float, ...] | None = ()
    legs: tuple[Leg, ...] = ()
    branch: Arclength | None = None
    if "schedule" not in top:
        given = sections.widths(reader, top.get("widths"), guess)
        if isinstance(given, Arclength):
            branch = given
        else:
            widths = given
    elif "widths" in top:
        found.report("schedule", "cannot be combined with widths, its short form: keep one of the two")
    elif parts is not None:
        legs, branch = schedule(reader, top["schedule"], kind, parts, guess.half_width or math.nan)
    ends = half_widths_of(legs, guess.half_width) if legs else widths
    refinement = sections.refinement(reader, top.get("refinement"), guess, ends)
    if branch and not legs and len(refinement.levels) > 1:
        found.report("refinement", "a branch is followed on one level: leave it out, use `ribbon refine`")
    if guess.keep_saddle and (legs or not branch):
        branches = "keep goes with a branch, widths: {arclength: {to: ...}}"
        keep = f"{branches}: other schedules go from minimum to minimum"
        reader.report(top["initial_guess"], "initial_guess.saddle", keep)
    spectrum = SpectrumRequest()
    if "spectrum" in top:
        spectrum = SpectrumRequest(**reader.section(top["spectrum"], "spectrum", SPECTRUM).values())
    discretisation = found.read("discretisation")
    contact = sections.contact(reader, top.get("contact"))
    if contact is not None:
        report_unheld(reader, top.get("initial_guess"), guess, contact.forces)
    if mistakes.found or kind is None or reader.length is None or widths is None:
        raise mistakes.error()
    if parts is None or contact is None:
        raise mistakes.error()
    return Config(
        name=name,
        half_twists=0 if isinstance(kind, str) else kind,
        length=reader.length,
        discretisation=discretisation,
        guess=guess,
        widths=widths,
        refinement=refinement,
        spectrum=spectrum,
        contact=contact,
        text=text,
        path=path,
        arclength=branch,
        parts=parts,
        schedule=legs,
    )


def _stem(reader: Reader, root: Node, path: str) -> str:
    """The file's stem, a run's name by default; it becomes a folder's, so no path can hide in it."""
    stem = Path(path).stem
    if not NAME.fits(stem):
        mistake = f"is missing, and the file's {stem[:40]!a} cannot be used for it"
        reader.report(root, "name", f"{mistake}: give {NAME.expected}")
    return stem


def _read(file: str, mistakes: Mistakes) -> bytes:
    try:
        with open(file, "rb") as stream:
            data = stream.read(MAX_BYTES + 1)
    except FileNotFoundError:
        mistakes.add(0, 0, "", f"no such file{_other_file(file)}")
    except IsADirectoryError:
        mistakes.add(0, 0, "", "is a folder: name a config file in it")
    except PermissionError:
        mistakes.add(0, 0, "", "cannot be read: permission denied")
    except (OSError, ValueError) as error:  # ValueError: a NUL in the path
        mistakes.add(0, 0, "", f"cannot be read: {getattr(error, 'strerror', None) or error}")
    else:
        if len(data) <= MAX_BYTES:
            return data
        mistakes.add(0, 0, "", "larger than 1 MiB, which no config needs")
    raise mistakes.error() from None


def _other_file(file: str) -> str:
    """A hint at a config nearby with almost the same name."""
    folder, name = os.path.split(file)
    try:
        near = [entry for entry in os.listdir(folder or ".") if entry.endswith((".yaml", ".yml"))]
    except OSError:
        return ""
    meant = next((entry for entry in near if os.path.splitext(entry)[0] == name), None)
    meant = meant or near_miss(name, near[:1000])
    return f": did you mean {shown(os.path.join(folder, meant))}?" if meant else ""


def _report_not_utf8(data: bytes, offset: int, mistakes: Mistakes) -> None:
    before = data[:offset].decode("utf-8").removeprefix("\ufeff")
    byte = f"byte 0x{data[offset]:02x} at offset {offset}"
    encoding = " (it looks like UTF-16)" if data[:2] in (b"\xff\xfe", b"\xfe\xff") else ""
    mistakes.add(*position(before, len(before)), "", f"not UTF-8, {byte}{encoding}: save the file in UTF-8")

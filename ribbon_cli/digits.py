"""Numbers as people read them, in one place: by significant digits, however small they are.

Programs get full precision (JSON, CSV, npz, HDF5); what is here is for tables, captions, messages and pages.
"""

from __future__ import annotations

import math
import re

ENERGY = 9
"""Digits of an energy: as many decimals, and never fewer significant ones."""
PLAIN_FROM = 1e-4
"""Size from which a number is written out, as Python's `g` has it; smaller ones have an exponent."""
LONGEST = 15
"""Digits that a double always holds."""

_POWER = r"(?<![\w.])([+-]?\d+(?:\.\d+)?)e([+-]?\d+)(?![\w.])"


def fixed(value: float, places: int) -> str:
    """A number to `places` decimals, and to as many significant digits where it is below 0.1.

    >>> fixed(5.151432684, 9), fixed(0.0123456789012, 9), fixed(8.949797385e-06, 9)
    ('5.151432684', '0.0123456789', '8.94979739e-06')
    """
    size = abs(value)
    if not math.isfinite(value) or size == 0.0:
        return f"{value:.{places}f}"
    if size < PLAIN_FROM:
        return f"{value:.{places - 1}e}"
    if size < 0.1:
        return f"{value:#.{places}g}"
    return f"{value:.{places}f}" if size < 10.0 ** (LONGEST - places) else f"{value:.{LONGEST}g}"


def energy(value: float) -> str:
    """An energy, as every table, caption and message shows it."""
    return fixed(value, ENERGY)


def significant(value: float, digits: int = ENERGY) -> str:
    """A number to significant digits, trailing zeros left out."""
    return f"{value:.{digits}g}"


def with_error(value: float, error: float | None) -> str:
    """`value +- error`, the error to two digits and the value to the same place."""
    if error is None:
        return f"{energy(value)} (no error bar)"
    if error == 0.0:
        return f"{value!r} +- 0"
    place = 1 - math.floor(math.log10(error))
    if 0.0 < abs(value) < PLAIN_FROM:
        return f"{value:.{max(0, place + math.floor(math.log10(abs(value))))}e} +- {error:.1e}"
    return f"{value:.{max(0, place)}f} +- {error:.1e}"


def powers(text: str) -> str:
    """A text with its numbers such as 8.95e-06 as powers of ten, for LaTeX and for Matplotlib.

    >>> powers("E = 8.95e-06")
    'E = $8.95 \\\\times 10^{-6}$'
    """
    return re.sub(_POWER, lambda found: rf"${found[1]} \times 10^{{{int(found[2])}}}$", text)


def duration(seconds: float) -> str:
    """A time as people say it: 0.4 s, 12 s, 3 min 20 s, 2 h 05 min."""
    if seconds < 9.95:
        return f"{seconds:.1f} s"
    minutes, rest = divmod(round(seconds), 60)
    if minutes == 0:
        return f"{rest} s"
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes:02} min" if hours else f"{minutes} min {rest:02} s"


def memory(size: float) -> str:
    """A number of bytes as people say it: 225 MiB, 3.5 GiB."""
    return f"{size / 2**20:.0f} MiB" if size < 2**30 else f"{size / 2**30:.1f} GiB"

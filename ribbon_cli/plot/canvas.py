"""The figures that pictures are drawn in."""

from __future__ import annotations

import io

import matplotlib.figure

INCH = 96
"""Pixels of an inch on a page of a browser."""
SHARP = 2
"""Pixels of the image for each of these, for screens that have as many."""


class Figure(matplotlib.figure.Figure):
    """A figure of matplotlib that shows itself in notebooks, pyplot or not."""

    def _repr_png_(self) -> tuple[bytes, dict[str, int]]:
        """The picture, and its size on the page."""
        buffer = io.BytesIO()
        self.savefig(buffer, format="png", dpi=SHARP * INCH)
        wide, tall = self.get_size_inches()
        return buffer.getvalue(), {"width": round(INCH * wide), "height": round(INCH * tall)}

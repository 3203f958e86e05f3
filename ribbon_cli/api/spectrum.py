"""The spectrum of a state: eigenvalues with bounds, modes with names, and a verdict."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ribbon_cli import analysis
from ribbon_cli.api.extras import extra
from ribbon_cli.pages import html
from ribbon_cli.store import StateRecord
from ribbon_cli.text import visible

if TYPE_CHECKING:
    from pandas import DataFrame
    from xarray import Dataset


@dataclass(frozen=True, eq=False, repr=False)
class Spectrum:
    """What `ribbon spectrum STATE` finds, rotations included; `found` holds all of it.

    `found.vectors` (m, N, 7) are the modes, `found.symmetries` the symmetries of the band.
    """

    record: StateRecord
    found: analysis.Stability
    run: str | None = None

    @property
    def metric(self) -> str:
        """The metric's name."""
        return self.found.metric

    @property
    def values(self) -> NDArray[np.float64]:
        """Eigenvalues (k,), ascending."""
        return np.array([mode.value for mode in self.found.modes])

    @property
    def bounds(self) -> NDArray[np.float64]:
        """Bounds (k,) of the eigenvalues' errors, roundoff included."""
        return np.array([mode.bound for mode in self.found.modes])

    @property
    def labels(self) -> tuple[str, ...]:
        """Names (k,) of the modes."""
        return tuple(mode.label for mode in self.found.modes)

    @property
    def stability(self) -> str:
        """`stable`, `unstable` or `undecided`."""
        return self.found.verdict.kind

    @property
    def verdict(self) -> str:
        """Stability in a sentence, with its reasons."""
        return self.found.verdict.sentence

    def document(self) -> dict[str, Any]:
        """What `ribbon spectrum STATE --json` prints."""
        return analysis.told_of(self.record, self.found, self.run).document()

    def table(self) -> DataFrame:
        """A row a mode, with a column for each symmetry. Raises ImportError without pandas."""
        pandas = extra("pandas", "spectrum.table()")
        names = ("value", "bound", "residual", "label", "sliding_overlap", "hidden")
        rows = [
            {name: getattr(mode, name) for name in names}
            | {f"symmetry_{name}": value for name, value in mode.symmetry.items()}
            for mode in self.found.modes
        ]
        return pandas.DataFrame(rows, index=pandas.RangeIndex(1, len(rows) + 1, name="mode"))

    def to_xarray(self) -> Dataset:
        """Eigenvalues and modes over `mode`, `node` and `unknown`. Raises ImportError without xarray."""
        xarray = extra("xarray", "spectrum.to_xarray()")
        stored = len(self.found.vectors)
        numbers = range(1, len(self.found.modes) + 1)
        unknowns = ["u_x", "u_y", "u_z", "g_x", "g_y", "g_z", "xi"]
        made: Dataset = xarray.Dataset(
            {
                "value": ("mode", self.values),
                "bound": ("mode", self.bounds),
                "label": ("mode", list(self.labels)),
                "vector": (("vector_mode", "node", "unknown"), self.found.vectors),
            },
            {"mode": list(numbers), "vector_mode": list(numbers)[:stored], "unknown": unknowns},
            {"metric": self.metric, "verdict": self.verdict},
        )
        return made

    def __repr__(self) -> str:
        place = f"b = {self.record.half_width:.10g}, N = {self.record.segments}"
        kinds = f"{len(self.found.modes)} modes in the {self.metric} metric"
        return visible(f"<spectrum of state {self.record.label}, {place}: {kinds}; {self.verdict}>")

    def _repr_html_(self) -> str:
        rows: list[tuple[html.Cell, ...]] = [
            ((str(k), "n"), (f"{mode.value:.6g}", "n"), (f"{mode.bound:.1e}", "n"), mode.label)
            for k, mode in enumerate(self.found.modes, start=1)
        ]
        return html.paragraph(self.verdict) + html.table(("mode", "value", "bound", "name"), rows)

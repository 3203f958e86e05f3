"""Kinds of picture and formats of export by name, without what draws and writes them: help lists them."""

from __future__ import annotations

PLOT_KINDS = (
    "shape",
    "geometry",
    "multipliers",
    "spectrum",
    "convergence",
    "branch",
    "family",
    "mode",
    "pattern",
    "contacts",
    "table",
    "shapes",
)
"""Kinds of picture, as in `plot.kinds.KINDS`."""
OF_TABLES = ("table", "shapes")
"""Those of several runs and of sweeps."""
EXPORT_FORMATS = ("npz", "vtkhdf", "obj", "stl", "ply", "glb", "csv", "json", "svg", "pdf", "fold", "html")
"""Formats of `export.formats` and npz, which are the files' suffixes as well."""
SCRIPTS = ("slurm",)
"""Schedulers that `ribbon sweep --script` writes for."""

"""The tables of docs/format.md, rendered from the format's table."""

from __future__ import annotations

from ribbon_cli.store.layout import (
    BRANCH,
    CONTACTS,
    DIMENSIONS,
    ENDS,
    LOADS,
    MATERIAL,
    PROVENANCE,
    SPECTRUM,
    STATE,
)


def layout_markdown() -> str:
    """Return the table of docs/format.md: one Markdown row for every dataset."""
    rows = ["| path | type | dimensions | equation | description |", "|---|---|---|---|---|"]
    for item in (*STATE, *ENDS, *MATERIAL, *LOADS, *SPECTRUM, *BRANCH, *CONTACTS):
        shape = "(" + ", ".join(item.dims) + (",)" if len(item.dims) == 1 else ")")
        kind = f"{item.dtype}, optional" if item.optional else item.dtype
        description = item.description.replace("|", "\\|")
        rows.append(f"| `{item.path}` | {kind} | {shape} | {item.equation} | {description} |")
    for key, description in PROVENANCE.items():
        rows.append(f"| `/provenance/{key}` | scalar, optional | () | none | {description} |")
    return "\n".join(rows) + "\n"


def dimensions_markdown() -> str:
    """Return the table of the dimensions in docs/format.md."""
    rows = ["| scale | size | type | description |", "|---|---|---|---|"]
    for name, dimension in DIMENSIONS.items():
        rows.append(f"| `{name}` | {dimension.size} | {dimension.dtype} | {dimension.description} |")
    return "\n".join(rows) + "\n"

"""States as CSV and JSON."""

from __future__ import annotations

import csv
import io
import json
from typing import Any

import numpy as np

from ribbon_cli.export.mesh import FACET_FIELDS, NODE_FIELDS, end_value, field_values
from ribbon_cli.parts import HALF_WIDTH
from ribbon_cli.store import StateRecord, Summary, content_sha256
from ribbon_cli.store.log import to_json
from ribbon_cli.text import visible

_ARRAYS = ("u", "g", "xi", "g_end", "midline", "kappa_s", "tau", "eta", "eta_prime")
_MULTIPLIERS = ("lambda_1", "lambda_2", "lambda_3", "lambda_4", "lambda_5", "gamma")
_OF_STATE = (
    "half_width",
    "length",
    "segments",
    "sigma",
    "linking_number",
    "twist",
    "writhe",
    "energy",
    "certified",
    "self_contact",
)


def csv_bytes(record: StateRecord, run: str | None) -> bytes:
    """The fields as CSV with its header in the first line, one row for node i and facet i; of an open
    strip one more for its end, with nothing of a facet.

    `alpha_node` and `alpha_facet` say where the two lie: fields of a node stand left of those of its facet.
    The last columns are of the state, the same in every row: readers take lines of `#` for data. `twist` is
    Tw in turns, a strip's parameters are `parameter_twist` and so on, as in tables. Numbers are written so
    that they read back exactly.
    """
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    h = record.length / record.segments
    index = np.arange(record.segments)
    columns: dict[str, list[Any]] = {"i": (index + 1).tolist(), "alpha_node": (h * index).tolist()}
    for name in ("midline", "g"):
        values = getattr(record, name)[: record.segments]
        columns |= {f"{name}_{axis}": values[:, k].tolist() for k, axis in enumerate("xyz")}
    columns |= {name: field_values(record, name).tolist() for name in NODE_FIELDS}
    columns["alpha_facet"] = (h * (index + 0.5)).tolist()
    columns |= {f"u_{axis}": record.u[:, k].tolist() for k, axis in enumerate("xyz")}
    columns |= {name: getattr(record, name).tolist() for name in FACET_FIELDS}
    state = {"run": run or "", "label": record.label}
    state |= {name: visible(getattr(record, name)) for name in ("kind", "status")}
    state |= {name: getattr(record, name) for name in _OF_STATE}
    if record.parts.ends is not None:
        _end_row(record, columns)
        state["twist_plus_writhe"] = state.pop("linking_number")
        others = ((name, value) for name, value in record.parameters.items() if name != HALF_WIDTH)
        state |= {f"parameter_{name}": value for name, value in others}
        state["bending_energy"] = record.energy if record.bending_energy is None else record.bending_energy
    state["content_sha256"] = content_sha256(record)
    columns |= {name: [value] * len(columns["i"]) for name, value in state.items()}
    writer.writerow(columns)
    writer.writerows(zip(*columns.values(), strict=True))
    return out.getvalue().encode()


def _end_row(record: StateRecord, columns: dict[str, list[Any]]) -> None:
    """Add the row of an open strip's end ruling, behind which there is no facet."""
    row = {"i": record.segments + 1, "alpha_node": record.length}
    row |= {f"midline_{axis}": record.midline[-1, k].item() for k, axis in enumerate("xyz")}
    row |= {f"g_{axis}": record.g_end[k].item() for k, axis in enumerate("xyz")}
    row |= {name: end_value(record, name) for name in NODE_FIELDS}
    for name, values in columns.items():
        values.append(row.get(name, ""))


def json_bytes(record: StateRecord, run: str | None) -> bytes:
    """What `ribbon show --json` says of a state, with its arrays under `arrays` and its `spectra`."""
    document = Summary.of(record).listed(run)
    document["arrays"] = {name: getattr(record, name).tolist() for name in (*_ARRAYS, *_MULTIPLIERS)}
    if record.parts.ends is not None:
        document["lambda_end"] = record.lambda_end
    document["spectra"] = {
        spectrum.metric: {
            "complete": spectrum.complete,
            "values": spectrum.values.tolist(),
            "residuals": spectrum.residuals.tolist(),
            "labels": list(spectrum.labels),
            "sliding_overlap": spectrum.sliding_overlap.tolist(),
        }
        for spectrum in record.spectra
    }
    return (json.dumps(to_json(document), indent=1, allow_nan=False) + "\n").encode()

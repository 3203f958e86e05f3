"""Records for the tests of the store: right in shape, random in content."""

from __future__ import annotations

import hashlib
import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ribbon_cli.store import Contacts, Run, SpectrumRecord, StateRecord, Summary
from ribbon_cli.store.log import LogReader

CONFIG = "name: mobius\n"
RESOLVED = "name: mobius\nlength: 6.283185307179586\n"


def make_spectrum(
    rng: np.random.Generator, n: int, metric: str, k: int = 6, m: int | None = 6
) -> SpectrumRecord:
    return SpectrumRecord(
        metric=metric,
        complete=False,
        values=np.sort(rng.normal(size=k)),
        residuals=rng.random(k) * 1e-12,
        labels=("rotation", "rotation", "rotation", "sliding", "Lk ≠ 0", "")[:k],
        sliding_overlap=rng.random(k),
        vectors=None if m is None else rng.normal(size=(m, n, 7)),
    )


def make_contacts(k: int = 3, **changes: Any) -> Contacts:
    """k contacts of a band with ten facets."""
    fields: dict[str, Any] = {
        "first": np.array([[0, 3], [1, 4], [1, 6]])[:k],
        "second": np.array([[2, 7], [1, 20], [1, 9]])[:k],
        "sign": np.array([1, -1, 1])[:k],
        "force": np.array([2.5, 0.0, 1e-3])[:k],
        "value": np.array([0.0, -1e-17, 1e-16])[:k],
        "gap": 0.0,
        "excluded": 0.005 * 2 * math.pi,
        "clearance": 0.0,
        "penetration": 1e-17,
    }
    return Contacts(**(fields | changes))


def make_summary(**changes: Any) -> Summary:
    """A state without its file."""
    return replace(Summary.of(make_record()), **changes)


def make_record(label: int = 1, n: int = 10, **changes: Any) -> StateRecord:
    rng = np.random.default_rng(label)
    names = (
        "xi",
        "lambda_1",
        "lambda_2",
        "lambda_3",
        "lambda_4",
        "lambda_5",
        "kappa_s",
        "tau",
        "eta",
        "eta_prime",
    )
    arrays = {name: rng.normal(size=n) for name in names}
    arrays |= {name: rng.normal(size=(n, 3)) for name in ("u", "g")}
    arrays |= {name: rng.normal(size=3) for name in ("gamma", "g_end")}
    fields: dict[str, Any] = dict(
        label=label,
        kind="equilibrium",
        status="minimum",
        message="A certified minimum: κ changes sign once.",
        certified=True,
        half_width=0.5,
        length=2 * math.pi,
        sigma=-1,
        segments=n,
        half_twists=1,
        discretisation="thesis",
        stage="b = 0.5",
        energy=5.151432747,
        kkt_residual=3e-13,
        constraint_residual=1e-15,
        negative_eigenvalues=0,
        smallest_facet=0.25,
        inverted_facets=0,
        linking_number=0.5,
        twist=0.375,
        writhe=0.125,
        self_contact=False,
        clearance=0.75,
        midline=rng.normal(size=(n + 1, 3)),
        spectra=(make_spectrum(rng, n, "physical"), make_spectrum(rng, n, "euclidean", m=None)),
        parent=None if label == 1 else label - 1,
        parent_ref=None,
        method="natural continuation",
        newton_steps=5,
        events=("grid phase", "step halved"),
        provenance={"argv": "ribbon solve mobius.yaml", "wall_seconds": 1.25, "git_dirty": 0},
        **arrays,
    )
    return StateRecord(**(fields | changes))


def make_run(root: Path, states: int = 0, name: str = "mobius", hash8: str = "0123abcd") -> Run:
    run = Run.create_or_open(root, name, hash8, CONFIG, RESOLVED)
    with run.writing():
        for label in range(1, states + 1):
            run.commit(make_record(label))
    return run


def relative_files(folder: Path) -> set[str]:
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}


def reseal(path: Path, version: str = "1.4", **changes: Any) -> None:
    """Make the hash in a state file's head that of its bytes, its summary `changes` richer, and its version
    another.
    """
    data = path.read_bytes()
    line, _, rest = data.partition(b"\n")
    if not line.startswith(b"ribbon-state ") or len(line) != 88:
        return
    text, _, _ = rest.partition(b"\n")
    summary = json.dumps(json.loads(text) | changes, ensure_ascii=False, separators=(",", ":")).encode()
    rest = (summary + b"\n").ljust(2048 - 89, b"\0") + rest[2048 - 89 :]
    line = line.replace(b" 1.4 ", f" {version} ".encode())
    path.write_bytes(line[:-64] + hashlib.sha256(rest).hexdigest().encode() + b"\n" + rest)


def read_log(path: Path) -> list[dict[str, Any]]:
    """A log's entries in order."""
    return [event.document for event in LogReader(path).events()]

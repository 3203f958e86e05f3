"""Runs and states on disk: layout, atomic writes, references, provenance.

Importing this imports neither NumPy nor h5py: listings and completions do without them.
"""

from ribbon_cli.store.atomic import write_atomic
from ribbon_cli.store.content import content_sha256
from ribbon_cli.store.hdf5 import decode, encode
from ribbon_cli.store.layout import FORMAT, FORMAT_VERSION, layout_markdown
from ribbon_cli.store.npz import export_npz, load_npz, write_arrays
from ribbon_cli.store.provenance import gather
from ribbon_cli.store.record import KINDS, METRICS, BranchRecord, SpectrumRecord, StateRecord
from ribbon_cli.store.refs import (
    find_run,
    find_states,
    list_runs,
    names_state,
    resolve_state,
    suggest,
    typed,
)
from ribbon_cli.store.root import runs_root
from ribbon_cli.store.run import Run
from ribbon_cli.store.summaries import BranchSummary, Summary

__all__ = [
    "FORMAT",
    "FORMAT_VERSION",
    "KINDS",
    "METRICS",
    "BranchRecord",
    "BranchSummary",
    "Run",
    "SpectrumRecord",
    "StateRecord",
    "Summary",
    "content_sha256",
    "decode",
    "encode",
    "export_npz",
    "find_run",
    "find_states",
    "gather",
    "layout_markdown",
    "list_runs",
    "load_npz",
    "names_state",
    "resolve_state",
    "runs_root",
    "suggest",
    "typed",
    "write_arrays",
    "write_atomic",
]

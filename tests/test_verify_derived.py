"""`ribbon verify` against forged files whose hashes are right: eigenvalues, tangents, kinds."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ribbon_cli.store import StateRecord, decode, encode
from ribbon_cli.store.hdf5 import decode_bytes
from ribbon_cli.store.layout import BRANCH
from ribbon_cli.verify.recompute import verify_record

DATA = Path(__file__).parent / "data"
BRANCH_POINT = DATA / "format-1.1" / "frozen-branch-e83cb1ed" / "states" / "0002.h5"
SADDLE = DATA / "format-1.0" / "frozen-3b93991c" / "states" / "0005.h5"
HELD = DATA / "format-1.0" / "frozen-3b93991c" / "states" / "0004.h5"
FREE = DATA / "format-1.0" / "frozen-3b93991c" / "states" / "0006.h5"

CHOSEN = {"name", "type", "arclength", "next_step"}
"""What a point alone does not tell of its branch; an arclength needs the points before."""


def changed(value):
    """A little more of a number, or of the largest one of an array."""
    array = np.array(value)
    place = np.argmax(np.abs(array))
    array.flat[place] = array.flat[place] * 1.001 + 1e-3
    return array if array.ndim else array.item()


def noticed(record: StateRecord) -> bool:
    """Whether a forged record cannot be stored or is found out."""
    try:
        stored = decode_bytes(encode(record), "forged")
    except ValueError:
        return True
    return bool(verify_record(stored))


def test_what_a_point_says_of_its_branch_is_recomputed():
    record = decode(BRANCH_POINT)
    assert verify_record(record) == []
    for item in BRANCH:
        value = getattr(record.branch, item.field)
        if item.field not in CHOSEN and value is not None:
            forged = replace(record.branch, **{item.field: changed(value)})
            assert noticed(replace(record, branch=forged)), item.path


@pytest.mark.parametrize("path", [BRANCH_POINT, FREE], ids=["branch", "free"])
@pytest.mark.parametrize("with_modes", [True, False])
def test_eigenvalues_are_recomputed_with_or_without_modes(path, with_modes):
    record = decode(path)
    if not with_modes:
        record = replace(record, spectra=tuple(replace(s, vectors=None) for s in record.spectra))
        assert verify_record(record) == []
    for k, spectrum in enumerate(record.spectra):
        others = [j for j, label in enumerate(spectrum.labels) if label != "rotation"]
        end = spectrum.values[-1]  # of values nearly equal to it, a list may hold any number
        for j in [j for j in others if spectrum.values[j] < end - 1e-3 * abs(end)]:
            keep = np.arange(len(spectrum.values)) != j
            less = replace(
                spectrum,
                values=spectrum.values[keep],
                residuals=spectrum.residuals[keep],
                labels=tuple(np.array(spectrum.labels)[keep]),
                sliding_overlap=spectrum.sliding_overlap[keep],
                vectors=None if spectrum.vectors is None else spectrum.vectors[keep[: len(spectrum.vectors)]],
            )
            values = spectrum.values.copy()
            values[j:] = values[j:] * 1.001 + 1e-3
            for forged in (less, replace(spectrum, values=values), replace(less, complete=True)):
                spectra = (*record.spectra[:k], forged, *record.spectra[k + 1 :])
                assert noticed(replace(record, spectra=spectra)), (spectrum.metric, j)


def test_a_kind_follows_from_what_was_held():
    held, saddle, free = map(decode, (HELD, SADDLE, FREE))
    for kind in ("equilibrium", "intermediate", "saddle"):
        assert noticed(replace(held, kind=kind)), kind
    assert noticed(replace(free, kind="saddle"))
    assert noticed(replace(free, kind="auxiliary"))
    assert noticed(replace(saddle, kind="auxiliary"))
    assert noticed(replace(saddle, status="stalled", kind="equilibrium"))
    assert noticed(replace(saddle, negative_eigenvalues=None))

"""State files that are damaged, hostile, or from another version: one line, and nothing else is touched."""

from __future__ import annotations

from contextlib import suppress

import h5py
import numpy as np
import pytest
from store_support import make_record, make_run, reseal

from ribbon_cli.errors import StoreError
from ribbon_cli.store import content_sha256, decode, encode
from ribbon_cli.store import hdf5 as store_hdf5
from ribbon_cli.store.content import values_sha256


@pytest.fixture
def path(tmp_path):
    path = tmp_path / "state.h5"
    path.write_bytes(encode(make_record(spectra=())))
    return path


def refused(path, match: str, sealed: bool = True) -> None:
    if sealed and path.is_file():
        reseal(path)
    with pytest.raises(StoreError, match=match) as caught:
        decode(path)
    assert "\n" not in str(caught.value)
    assert str(path) in str(caught.value)


def rehash(file: h5py.File) -> None:
    """Make the stored hash agree with what the file holds now."""
    values = store_hdf5._read_values(file)
    file.attrs["content_sha256"] = np.bytes_(values_sha256(values))
    file.flush()


def test_flipped_bytes_never_pass_unnoticed(tmp_path):
    """Either the file is refused, or it still says what was stored; the log's hash sees every flip."""
    run = make_run(tmp_path, states=1)
    path = run.state_path(1)
    good = path.read_bytes()
    content = content_sha256(run.load(1))
    rng = np.random.default_rng(1)
    loose = tmp_path / "loose.h5"
    refusals = 0
    for position in rng.choice(len(good), size=400, replace=False):
        bad = bytearray(good)
        bad[position] ^= 1 << rng.integers(8)
        loose.write_bytes(bad)
        try:
            read = content_sha256(decode(loose))
        except StoreError:
            refusals += 1
        else:
            assert read == content
    assert refusals == 400
    path.write_bytes(bad)
    with pytest.raises(StoreError, match="not the bytes that were committed"):
        run.load(1)


@pytest.mark.parametrize("keep", [0, 1, 7, 100, 2000, -1])
def test_truncated_files_are_refused(path, keep):
    path.write_bytes(path.read_bytes()[:keep])
    refused(path, "damaged, or not a state file", sealed=False)


def test_missing_file_and_folder_are_refused(tmp_path):
    refused(tmp_path / "none.h5", "cannot be read: No such file")
    refused(tmp_path, "not a file")


def test_file_larger_than_any_state_is_refused(path, monkeypatch):
    monkeypatch.setattr(store_hdf5, "MAX_BYTES", 1000)
    refused(path, "larger than any state file")


def test_newer_major_version_is_refused_and_newer_minor_read(path):
    with h5py.File(path, "r+") as file:
        file.attrs["format_version"] = np.bytes_("1.7")
        file["state/novelty"] = 3.0
        rehash(file)
    with h5py.File(path) as file:
        content = file.attrs["content_sha256"].decode()
    reseal(path, "1.7", content_sha256=content, novelty=3.0)
    assert decode(path).label == 1
    with h5py.File(path, "r+") as file:
        file.attrs["format_version"] = np.bytes_("2.0")
    refused(path, r"format 2.0, newer than 1.4: update ribbon")


@pytest.mark.parametrize("version", ["", "one", "x" * 300])
def test_nonsense_version_is_refused(path, version):
    with h5py.File(path, "r+") as file:
        file.attrs["format_version"] = np.bytes_(version)
    refused(path, "damaged, or not a state file")


def test_other_hdf5_files_are_refused(path):
    with h5py.File(path, "w") as file:
        file["x"] = 1.0
    refused(path, "root attribute 'format' is missing")
    with h5py.File(path, "r+") as file:
        file.attrs["format"] = np.bytes_("other")
        file.attrs["format_version"] = np.bytes_("1.0")
    refused(path, "its format is 'other'")
    with h5py.File(path, "r+") as file:
        file.attrs["format"] = np.arange(3)
    refused(path, "is not a short text")


def test_changed_value_is_refused(path):
    with h5py.File(path, "r+") as file:
        file["state/energy"][...] = 1.0
    refused(path, "does not match its content_sha256")


def test_added_dataset_is_refused_unless_hashed(path):
    with h5py.File(path, "r+") as file:
        file["state/extra"] = 1.0
    refused(path, "does not match its content_sha256")


@pytest.mark.parametrize(
    ("name", "value", "match"),
    [
        ("state/energy", None, "/state/energy is missing"),
        ("state/segments", None, "/state/segments is missing"),
        ("state/segments", np.int64(11), r"/state/u has shape|/state/g has shape|has shape"),
        ("state/energy", np.int64(3), "/state/energy is int64, expected float64"),
        ("state/u", np.zeros((3, 10)), r"/state/u has shape \(3, 10\)"),
        ("state/u", np.zeros((10, 3), dtype=">f8"), "has dtype >f8"),
        ("state/u", np.zeros((10, 3), dtype="f4"), "has dtype float32"),
        ("origin/kind", np.bytes_("nonsense"), "kind must be one of"),
        ("origin/events", np.full((2, 2), b"x"), "more than one dimension"),
        ("provenance/argv", np.zeros(3), "must be a scalar"),
    ],
)
def test_rehashed_nonsense_is_refused(path, name, value, match):
    with h5py.File(path, "r+") as file:
        del file[name]
        if value is not None:
            file[name] = value
        with suppress(ValueError):
            rehash(file)
    refused(path, match)


def test_links_out_of_the_file_are_refused_unfollowed(path, tmp_path):
    with h5py.File(tmp_path / "other.h5", "w") as other:
        other["u"] = np.zeros((10, 3))
    with h5py.File(path, "r+") as file:
        file["state/link"] = h5py.ExternalLink(str(tmp_path / "other.h5"), "/u")
    refused(path, "/state/link is a soft or external link")
    with h5py.File(path, "r+") as file:
        del file["state/link"]
        file["state/link"] = h5py.SoftLink("/state/u")
    refused(path, "/state/link is a soft or external link")


def test_data_outside_the_file_is_refused_unread(path, tmp_path):
    secret = tmp_path / "secret"
    secret.write_bytes(b"\0" * 800)
    with h5py.File(path, "r+") as file:
        file.create_dataset("state/raw", (100,), "f8", external=[(str(secret), 0, 800)])
    refused(path, "keeps its data outside the file")
    with h5py.File(path, "r+") as file:
        del file["state/raw"]
        virtual = h5py.VirtualLayout((10,), "f8")
        virtual[:] = h5py.VirtualSource(str(tmp_path / "other.h5"), "x", (10,))
        file.create_virtual_dataset("state/raw", virtual)
    refused(path, "keeps its data outside the file")


def test_giant_shapes_are_refused_before_they_are_read(path):
    with h5py.File(path, "r+") as file:
        file.create_dataset("state/huge", (2**40,), "f8", chunks=(1024,), compression="gzip")
    refused(path, "more than any state")


def test_strange_types_filters_and_loops_are_refused(path):
    with h5py.File(path, "r+") as file:
        file["state/text"] = "of variable length"
    refused(path, "/state/text has dtype object")
    with h5py.File(path, "r+") as file:
        del file["state/text"]
        file.create_dataset("state/packed", data=np.zeros(100), chunks=(100,), scaleoffset=3)
    refused(path, "a filter that no state file uses")
    with h5py.File(path, "r+") as file:
        del file["state/packed"]
        file["state/null"] = h5py.Empty("f8")
    refused(path, "has no shape")
    with h5py.File(path, "r+") as file:
        del file["state/null"]
        file["state/type"] = np.dtype("f8")
    refused(path, "neither group nor dataset")
    with h5py.File(path, "r+") as file:
        del file["state/type"]
        file["state/again"] = file["/"]
    refused(path, "/state/again is another object once more, or leads in a circle")
    with h5py.File(path, "r+") as file:
        del file["state/again"]
        file["state/twin"] = file["state/u"]
    refused(path, "/state/[a-z]+ is another object once more")

"""npz exports: exact, deterministic, and read back without trust."""

from __future__ import annotations

import io
import math
import zipfile

import numpy as np
import pytest
from store_support import make_record

from ribbon_cli.errors import StoreError
from ribbon_cli.store import content_sha256, export_npz, load_npz

N = 10


@pytest.fixture
def path(tmp_path):
    return tmp_path / "state.npz"


def minimal(**changes):
    rng = np.random.default_rng(3)
    fields = {
        "u": rng.normal(size=(N, 3)),
        "g": rng.normal(size=(N, 3)),
        "xi": rng.normal(size=N),
        "half_width": 0.1,
        "sigma": -1.0,
    }
    return {name: value for name, value in (fields | changes).items() if value is not None}


def test_export_holds_what_others_rely_on(path):
    record = make_record(negative_eigenvalues=None)
    export_npz(record, path)
    with np.load(path, allow_pickle=False) as found:
        for name in ("u", "g", "xi", "lambda_1", "lambda_2", "lambda_3", "lambda_4", "lambda_5", "gamma"):
            np.testing.assert_array_equal(found[name], getattr(record, name))
        for name in ("half_width", "length", "sigma", "discretisation", "energy", "linking_number", "label"):
            assert found[name][()] == getattr(record, name)
        for name in ("kind", "status", "certified", "kkt_residual", "constraint_residual"):
            assert found[name][()] == getattr(record, name)
        assert found["negative_eigenvalues"][()] == -1
        assert found["content_sha256"][()] == content_sha256(record)


def test_export_is_deterministic_and_replaces_only_when_asked(path, tmp_path):
    export_npz(make_record(), path)
    export_npz(make_record(), tmp_path / "again.npz")
    assert path.read_bytes() == (tmp_path / "again.npz").read_bytes()
    with pytest.raises(StoreError, match="exists already and is not replaced"):
        export_npz(make_record(2), path)
    assert path.read_bytes() == (tmp_path / "again.npz").read_bytes()
    export_npz(make_record(2), path, overwrite=True)
    np.testing.assert_array_equal(load_npz(path)["u"], make_record(2).u)


def test_round_trip(path):
    record = make_record(discretisation="value-average", length=3.0)
    export_npz(record, path)
    found = load_npz(path)
    for name in ("u", "g", "xi", "g_end", "lambda_3", "gamma"):
        assert found[name].tobytes() == getattr(record, name).tobytes()
    assert {name: found[name] for name in ("half_width", "length", "sigma", "discretisation")} == {
        "half_width": 0.5,
        "length": 3.0,
        "sigma": -1,
        "discretisation": "value-average",
    }


@pytest.mark.parametrize("save", [np.savez, np.savez_compressed])
def test_the_least_that_is_needed(path, save):
    save(path, **minimal(u=np.asfortranarray(minimal()["u"]), xi=np.arange(N)))
    found = load_npz(path)
    assert found.keys() == {"u", "g", "xi", "half_width", "sigma", "length", "discretisation"}
    assert (found["sigma"], found["length"], found["discretisation"]) == (-1, 2 * math.pi, "thesis")
    assert isinstance(found["sigma"], int)
    assert found["xi"].dtype == np.float64
    np.testing.assert_array_equal(found["u"], minimal()["u"])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"u": None, "sigma": None}, "it has no u, sigma"),
        ({"u": np.zeros((N, 2))}, r"u is float64 \(10, 2\), expected numbers \(10, 3\)"),
        ({"g": np.zeros((N + 1, 3))}, "g is float64"),
        ({"xi": np.zeros(2)}, "N at least 3"),
        ({"xi": 1.0}, "N at least 3"),
        ({"xi": np.full(N, np.nan)}, "xi is not finite"),
        ({"u": np.zeros((N, 3), dtype=complex)}, "u.npy is not an array of numbers or text"),
        ({"u": np.full((N, 3), "x")}, "expected numbers"),
        ({"u": np.array([None])}, "u.npy is not an array of numbers or text"),
        ({"sigma": 2}, r"sigma must be \+1 or -1, or 0 of an open strip, got 2"),
        ({"sigma": "a"}, "expected one number"),
        ({"half_width": -1}, "half_width must be positive and finite, got -1"),
        ({"half_width": math.inf}, "half_width must be positive"),
        ({"half_width": [0.1]}, "expected one number"),
        ({"length": 0}, "length must be positive"),
        ({"discretisation": "other"}, "discretisation must be thesis or value-average, got other"),
        ({"discretisation": 1}, "expected one text"),
    ],
)
def test_what_is_no_state_is_refused(path, changes, message):
    np.savez(path, **minimal(**changes))
    with pytest.raises(StoreError, match=message) as caught:
        load_npz(path)
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith(str(path))


def test_missing_and_foreign_files_are_refused(path):
    with pytest.raises(StoreError, match="cannot be read: No such file"):
        load_npz(path)
    path.write_bytes(b"no zip")
    with pytest.raises(StoreError, match="not a state"):
        load_npz(path)


def rewrite(path, name: str, data: bytes, compression: int = zipfile.ZIP_STORED) -> None:
    np.savez(path, **minimal(**{name: None}))
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr(f"{name}.npy", data, compression)


def npy(array: np.ndarray) -> bytes:
    buffer = io.BytesIO()
    np.save(buffer, array)
    return buffer.getvalue()


def test_arrays_that_claim_more_than_they_hold_are_refused(path, monkeypatch):
    data = npy(np.zeros((N, 3)))
    rewrite(path, "u", data.replace(b"(10, 3), }", b"(2000000000000, 3), }")[: len(data)])
    with pytest.raises(StoreError, match="not a state"):
        load_npz(path)
    rewrite(path, "u", data[:-8])
    with pytest.raises(StoreError, match="not an array of numbers"):
        load_npz(path)
    rewrite(path, "u", data, zipfile.ZIP_BZIP2)
    with pytest.raises(StoreError, match="packed in a way"):
        load_npz(path)
    rewrite(path, "u", data.replace(b"NUMPY\x01", b"NUMPY\x07"))
    with pytest.raises(StoreError, match="npy version"):
        load_npz(path)
    np.savez(path, **minimal())
    monkeypatch.setattr("ribbon_cli.store.npz.MAX_BYTES", 100)
    with pytest.raises(StoreError, match="too large"):
        load_npz(path)


def test_damaged_files_are_refused_or_unchanged(path):
    export_npz(make_record(), path)
    good = path.read_bytes()
    whole = load_npz(path)
    rng = np.random.default_rng(2)
    for position in rng.choice(len(good), size=300, replace=False):
        bad = bytearray(good)
        bad[position] ^= 1 << rng.integers(8)
        path.write_bytes(bad)
        try:
            found = load_npz(path)
        except StoreError:
            continue
        for name in ("u", "g", "xi"):
            np.testing.assert_array_equal(found[name], whole[name])

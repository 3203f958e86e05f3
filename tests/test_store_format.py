"""State files: exact, deterministic, readable by others, and as docs/format.md says."""

from __future__ import annotations

import json
import math
import re
import subprocess
import sys
import time
from dataclasses import fields, replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from format_tables import dimensions_markdown, layout_markdown
from store_support import make_contacts, make_record, make_spectrum

from ribbon_cli.parts import Ends, Loads, Material
from ribbon_cli.store import (
    BranchRecord,
    BranchSummary,
    Contacts,
    SpectrumRecord,
    StateRecord,
    Summary,
    content_sha256,
    decode,
    encode,
    write_atomic,
)
from ribbon_cli.store.hdf5 import _blank, decode_bytes
from ribbon_cli.store.layout import (
    BRANCH,
    CONTACTS,
    DIMENSIONS,
    ENDS,
    LOADS,
    MATERIAL,
    REACTIONS,
    SPECTRUM,
    STATE,
)

OF_STRIPS = ("bending_energy", "lambda_end", *REACTIONS)
FORMAT_PAGE = Path(__file__).parent.parent / "docs" / "format.md"


def assert_same(a: object, b: object) -> None:
    for field in fields(a):
        x, y = getattr(a, field.name), getattr(b, field.name)
        if isinstance(x, np.ndarray):
            assert x.dtype == y.dtype
            assert x.shape == y.shape
            assert x.tobytes() == y.tobytes()
        elif isinstance(x, Contacts):
            assert_same(x, y)
        elif field.name == "spectra":
            assert len(x) == len(y)
            for s, t in zip(x, y, strict=True):
                assert_same(s, t)
        else:
            assert x == y or (math.isnan(x) and math.isnan(y))
            assert type(x) is type(y)


@pytest.fixture
def stored(tmp_path):
    def store(record: StateRecord) -> Path:
        path = tmp_path / "state.h5"
        write_atomic(path, encode(record), overwrite=True)
        return path

    return store


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"negative_eigenvalues": None, "certified": False, "status": "not-finite"},
        {"energy": math.nan, "clearance": math.inf, "xi": np.full(10, np.nan), "twist": -0.0},
        {"parent": 7, "parent_ref": "möbius:3", "events": (), "spectra": (), "provenance": {}, "message": ""},
        {"spectra": (make_spectrum(np.random.default_rng(0), 10, "euclidean", k=6, m=2),)},
        {"provenance": {"version_numpy": "2.0", "bytes": 2**40, "seconds": 1e-300, "empty": ""}},
        {"contacts": make_contacts()},
        {"contacts": make_contacts(0)},
    ],
)
def test_round_trip_is_exact(stored, changes):
    record = make_record(**changes)
    assert_same(decode(stored(record)), record)


def test_empty_spectrum_round_trips(stored):
    none = np.zeros(0)
    spectrum = SpectrumRecord(
        metric="physical", complete=False, values=none, residuals=none, labels=(), sliding_overlap=none
    )
    record = make_record(spectra=(spectrum,))
    assert_same(decode(stored(record)), record)


def test_the_same_record_gives_the_same_bytes_at_another_time_and_in_another_process():
    first = encode(make_record())
    time.sleep(1.1)  # HDF5's times count seconds
    assert encode(make_record()) == first
    code = "import sys; from store_support import *; from ribbon_cli.store import encode;"
    code += "sys.stdout.buffer.write(encode(make_record()))"
    here = str(Path(__file__).parent)
    other = subprocess.run([sys.executable, "-c", code], cwd=here, capture_output=True, check=True)
    assert other.stdout == first


def test_bytes_do_not_depend_on_what_was_encoded_before():
    """Neither on the first of a layout, nor on others of the same and of other layouts before it."""
    records = [make_record(), make_record(2, message="", stage="b = 0.25"), make_record(n=11), make_record(3)]
    records.append(make_record(4, events=(), event_kinds=(), spectra=()))
    first = []
    for record in records:
        _blank.cache_clear()
        first.append(encode(record))
    for _ in range(2):
        assert [encode(record) for record in reversed(records)] == first[::-1]
    assert _blank.cache_info().hits > len(records)


def test_reencoding_what_was_read_gives_the_same_bytes(stored):
    path = stored(make_record())
    assert encode(decode(path)) == path.read_bytes()


def test_content_hash_leaves_provenance_out_and_nothing_else():
    record = make_record()
    first = content_sha256(record)
    assert content_sha256(replace(record, provenance={"argv": "another", "extra": 3})) == first
    seen = {first}
    changes = [
        {"label": 2},
        {"energy": np.nextafter(record.energy, 9)},
        {"message": record.message + " "},
        {"negative_eigenvalues": None},
        {"certified": False},
        {"events": ("grid phasestep halved",)},
        {"spectra": record.spectra[:1]},
        {"u": record.u * -1},
        {"twist": -record.twist},
    ]
    for change in changes:
        seen.add(content_sha256(replace(record, **change)))
    assert len(seen) == len(changes) + 1


def test_root_attributes_and_description_of_every_dataset(stored):
    record = make_record(n=50)
    path = stored(record)
    with h5py.File(path) as file:
        assert file.attrs["format"] == b"ribbon-state"
        assert file.attrs["format_version"] == b"1.4"
        assert file.attrs["content_sha256"].decode() == content_sha256(record)
        paths = []

        def check(name: str, node: h5py.HLObject) -> None:
            if not isinstance(node, h5py.Dataset):
                return
            paths.append("/" + name)
            assert node.attrs["units"] == b"1"
            assert len(node.attrs["description"]) > 4
            assert len(node.attrs["equation"]) > 3
            if node.shape:
                assert node.fletcher32
            assert (node.compression == "gzip") == (node.size > 64)

        file.visititems(check)
        np.testing.assert_array_equal(file["state/u"][()], record.u)
        assert file["certificate/certified"][()] is np.True_
    optional = ("parent", "parent_ref", "prescribed", "seam_open", "cut_node", "g_cut", *OF_STRIPS)
    expected = [item.path for item in STATE if item.field not in optional]
    paths = [path for path in paths if path.rpartition("/")[2] not in DIMENSIONS]
    assert {path for path in paths if not path.startswith(("/spectra", "/provenance"))} == set(expected)


def test_table_covers_every_field_of_the_records():
    state = {item.field for item in STATE} | {"spectra", "branch", "provenance", "event_kinds", "parts"}
    state |= {"contacts"}
    assert state == {field.name for field in fields(StateRecord)}
    assert {item.field for item in SPECTRUM} | {"metric"} == {field.name for field in fields(SpectrumRecord)}
    assert {item.field for item in BRANCH} == {field.name for field in fields(BranchRecord)}
    assert [item.field for item in CONTACTS] == [field.name for field in fields(Contacts)]
    for items, kind in ((ENDS, Ends), (MATERIAL, Material), (LOADS, Loads)):
        assert [item.field for item in items] == [field.name for field in fields(kind)]
    assert all(
        item.equation == "none" or any(c.isdigit() or c == "=" for c in item.equation) for item in STATE
    )


def test_documented_table_is_the_code_s():
    page = FORMAT_PAGE.read_text(encoding="utf-8")
    table = page.split("<!-- layout:begin -->\n")[1].split("<!-- layout:end -->")[0]
    assert table == layout_markdown()


def test_documented_dimensions_are_the_code_s():
    page = FORMAT_PAGE.read_text(encoding="utf-8")
    table = page.split("<!-- dimensions:begin -->\n")[1].split("<!-- dimensions:end -->")[0]
    assert table == dimensions_markdown()


def test_documented_hash_is_the_code_s(stored):
    page = FORMAT_PAGE.read_text(encoding="utf-8")
    (code,) = [
        block for block in re.findall(r"```python\n(.*?)```", page, re.DOTALL) if "def content" in block
    ]
    space: dict = {}
    exec(code, space)
    record = make_record(n=30, parent=3)
    assert space["content_sha256"](stored(record)) == content_sha256(record)


def test_arrays_become_contiguous_float64():
    record = make_record(u=np.asfortranarray(np.ones((10, 3), dtype=np.float32)), xi=list(range(10)))
    assert record.u.dtype == record.xi.dtype == np.float64
    assert record.u.flags.c_contiguous


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"g": np.zeros((9, 3))}, r"/state/g has shape \(9, 3\), expected \(N, 3\) = \(10, 3\)"),
        ({"midline": np.zeros((10, 3))}, "/geometry/midline has shape"),
        ({"sigma": -0.5}, "/topology/sigma must be int64"),
        ({"status": "a\0b"}, "null character"),
        ({"provenance": {"Bad Key": 1}}, "lower-case"),
        ({"provenance": {"key": None}}, "must be str, int or float"),
        ({"spectra": (make_spectrum(np.random.default_rng(0), 10, "physical", k=3, m=4),)}, "4 modes for 3"),
        ({"spectra": (make_spectrum(np.random.default_rng(0), 9, "physical"),)}, "vectors has shape"),
    ],
)
def test_what_does_not_fit_the_table_is_not_written(changes, message):
    with pytest.raises(ValueError, match=message):
        encode(make_record(**changes))


@pytest.mark.parametrize(
    "changes", [{"kind": "equilibria"}, {"label": 0}, {"spectra": make_record().spectra[:1] * 2}]
)
def test_records_check_themselves(changes):
    with pytest.raises(ValueError, match=r"kind must|labels start|at most one"):
        make_record(**changes)


def test_unknown_metric_is_refused():
    with pytest.raises(ValueError, match="metric must be one of"):
        make_spectrum(np.random.default_rng(0), 10, "h1")


def test_summary_has_the_promised_fields_and_is_json():
    state = Summary.of(make_record(clearance=math.nan, negative_eigenvalues=None)).listed("mobius-0123abcd")
    promised = """half_width segments length topology energy status kkt_residual constraint_residual
        negative_eigenvalues linking_number twist writhe self_contact label run kind discretisation
        content_sha256 certified message stage parent method newton_steps inverted_facets smallest_facet
        clearance events"""
    assert set(promised.split()) <= state.keys()
    assert state["topology"] == {"half_twists": 1, "sigma": -1}
    assert state["clearance"] is None
    assert state["negative_eigenvalues"] is None
    assert state["events"] == ["grid phase", "step halved"]
    assert state["run"] == "mobius-0123abcd"


def test_summaries_have_the_fields_that_the_layout_marks():
    marked = [item.field for item in STATE if item.summary]
    assert [field.name for field in fields(Summary)] == [
        *(*marked, "event_kinds", "branch", "content_sha256"),
        *("others", "bending_energy", *REACTIONS),
        *("contacts", "contact_force", "contact_gap", "penetration"),
    ]
    on_branch = [item.field for item in BRANCH if item.summary]
    assert [field.name for field in fields(BranchSummary)] == [*on_branch, "parameter"]


def test_a_summary_is_read_back_and_what_a_newer_version_added_is_passed_over():
    state = Summary.of(make_record(clearance=math.nan, negative_eigenvalues=None))
    document = json.loads(json.dumps(state.to_dict()))
    assert Summary.read(document) == state
    assert state.agrees(document | {"later": [1.5]})
    assert Summary.read(document | {"later": [1.5], "to_dict": 1}).to_dict() == document
    for key in document.keys() - {
        "event_kinds",
        "parameters",
        "bending_energy",
    }:  # which earlier formats lack
        with pytest.raises(ValueError, match=r"of another type|no state with a label"):
            Summary.read({name: value for name, value in document.items() if name != key})


def test_a_summary_of_an_earlier_format_has_the_kinds_that_its_sentences_tell():
    state = Summary.of(make_record(events=("reached b = 0.5", "something else")))
    assert state.event_kinds == ("width-reached", "unknown")
    document = state.to_dict()
    for wrong in (None, "width-reached", [], ["unknown"], ["unknown", 1]):
        with pytest.raises(ValueError, match="event_kinds of state 1 is missing, or of another type"):
            Summary.read(document | {"event_kinds": wrong})
        assert not state.agrees(document | {"event_kinds": wrong})
    del document["event_kinds"]
    assert Summary.read(document) == state
    assert state.agrees(document)


def test_importing_the_store_is_light():
    code = "import ribbon_cli.store, sys; sys.exit(bool({'numpy', 'h5py', 'filelock'} & sys.modules.keys()))"
    subprocess.run([sys.executable, "-c", code], check=True)


def test_a_point_of_a_branch_survives_the_file():
    """Also without what an ordinary step does not have; a state off any branch has none of it."""
    rng = np.random.default_rng(8)
    plain = make_record(1)
    n = plain.segments
    step = BranchRecord(
        name="branch up",
        type="step",
        arclength=0.25,
        half_width_rate=-0.5,
        next_step=0.01,
        tangent=rng.normal(size=(n, 7)),
    )
    fold = replace(
        step,
        type="fold",
        index_before=0,
        index_after=1,
        lowest_eigenvalue=1e-13,
        sliding_overlap=0.5,
        soft_mode=rng.normal(size=(n, 7)),
    )
    for branch in (step, fold):
        record = replace(plain, branch=branch)
        back = decode_bytes(encode(record), "memory")
        assert back.branch is not None
        for field in fields(BranchRecord):
            np.testing.assert_array_equal(getattr(back.branch, field.name), getattr(branch, field.name))
        assert content_sha256(back) == content_sha256(record) != content_sha256(plain)
        assert Summary.of(back).branch.type == branch.type
    assert decode_bytes(encode(plain), "memory").branch is None
    assert "branch" not in Summary.of(plain).to_dict()
    with pytest.raises(ValueError, match="type must be one of"):
        replace(step, type="bend")

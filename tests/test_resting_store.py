"""Bands that rest on themselves in the store: files, summaries, verification, comparison, listings."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cli_support import ribbon, ribbon_json
from resting_support import resting_record
from store_support import make_contacts, make_record, make_run

import ribbon_cli
from ribbon_cli.config import ConfigError, ContactRequest, parse_config
from ribbon_cli.errors import StoreError
from ribbon_cli.export.words import meeting
from ribbon_cli.store import (
    Contacts,
    StateRecord,
    Summary,
    content_sha256,
    decode,
    encode,
    export_npz,
    load_npz,
    write_atomic,
)
from ribbon_cli.store.hdf5 import decode_bytes
from ribbon_cli.study.records import rest_of
from ribbon_cli.verify import judge
from ribbon_cli.verify.recompute import verify_record

DATA = Path(__file__).parent / "data"
PI, THREE = "pi-b1.65-N100", "3pi-b0.9-N120"
CONFIG = "topology: {half_twists: 1}\ninitial_guess: {recipe: twist, segments: 50, half_width: 0.1}\n"


@pytest.fixture(scope="module")
def record() -> StateRecord:
    """The pi band at rest on four contacts, a certified minimum."""
    return resting_record(PI)


@pytest.fixture(scope="module")
def undecided(record) -> StateRecord:
    """The same band with its features on the wrong sides, held by forces that pull."""
    kept = record.contacts
    turned = {name: -getattr(kept, name) for name in ("sign", "force", "value")}
    contacts = Contacts(**(vars(kept) | turned))
    return replace(record, contacts=contacts, status="undecided", certified=False, negative_eigenvalues=None)


# --- files and summaries ---


def test_a_state_at_rest_survives_the_file(record, tmp_path):
    write_atomic(tmp_path / "x.h5", encode(record))
    again = decode(tmp_path / "x.h5")
    for name in vars(record.contacts):
        one, two = getattr(record.contacts, name), getattr(again.contacts, name)
        np.testing.assert_array_equal(one, two)
        assert np.asarray(one).dtype == np.asarray(two).dtype
    assert content_sha256(again) == content_sha256(record)
    assert encode(again) == encode(record)
    assert again.contacts.names()[1] == "vertex 21 with facet 49"


def test_what_a_state_at_rest_says(record):
    assert (record.status, record.certified, record.self_contact) == ("minimum", True, True)
    assert "At rest on 4 contacts, with forces of 82.6484 in all." in record.message
    state = Summary.of(record)
    assert (state.contacts, state.contact_gap, state.self_contact) == (4, 0.0, True)
    assert state.contact_force == pytest.approx(82.648416, rel=1e-7)
    assert state.clearance == record.contacts.clearance < 1e-9
    assert state.penetration <= 1e-9 * record.length
    assert Summary.read(state.to_dict()) == state
    assert meeting(state) == meeting(record) == "rests on itself at 4 contacts, forces of 82.6484 in all"


def test_contacts_of_no_state_are_refused():
    document = Summary.of(make_record(contacts=make_contacts())).to_dict()
    for name, value in (
        ("contacts", -1),
        ("contact_force", "3"),
        ("penetration", True),
        ("contact_gap", 1e999),
    ):
        with pytest.raises(ValueError, match=f"{name} of state 1 is missing"):
            Summary.read(document | {name: value})


def test_states_without_contact_forces_say_nothing_of_them():
    """Their content hashes and summaries are as before; a state with forces that touches nothing differs."""
    plain, off = make_record(), make_record(contacts=make_contacts(0))
    told = {"contacts", "contact_force", "contact_gap", "penetration"}
    assert not told & Summary.of(plain).to_dict().keys()
    for path in (DATA / "format-1.3").glob("*/states/*.h5"):
        older = decode(path)
        assert f'"content_sha256":"{content_sha256(older)}"'.encode() in path.read_bytes()
        assert older.contacts is None
    assert told <= Summary.of(off).to_dict().keys()
    assert content_sha256(off) != content_sha256(plain)
    assert decode_bytes(encode(plain), "x.h5").contacts is None
    assert len(decode_bytes(encode(off), "x.h5").contacts) == 0


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"sign": np.array([1, 0, 1])}, "3 signs"),
        ({"force": np.zeros(2)}, "2 pairs"),
        ({"first": np.array([[2, 3], [1, 4], [1, 6]])}, "vertices and edges"),
        ({"second": np.array([[3, 7], [1, 20], [1, 9]])}, "kind 0, 1 or 2"),
        ({"second": np.array([[2.5, 7], [1, 20], [1, 9]])}, "integers"),
        ({"first": np.array([[1, 6]] * 3), "second": np.array([[1, 9]] * 3)}, "touches twice"),
    ],
)
def test_contacts_check_themselves(changes, message):
    with pytest.raises(ValueError, match=message):
        make_contacts(**changes)


@pytest.mark.parametrize(("kind", "number"), [(0, 20), (1, 30), (1, -1)])
def test_features_that_a_band_lacks_are_refused(kind, number):
    first = np.array([[kind, number]])
    contacts = make_contacts(1, first=first, second=np.array([[1, 9]]))
    with pytest.raises(ValueError, match="which the band lacks"):
        make_record(contacts=contacts)


# --- verification ---


def with_contacts(record: StateRecord, **changes) -> StateRecord:
    return replace(record, contacts=Contacts(**(vars(record.contacts) | changes)))


def test_states_at_rest_are_verified(record, undecided):
    assert verify_record(record) == []
    assert verify_record(undecided) == []
    three = resting_record(THREE)
    assert "which can be shared out in other ways, since contacts depend on each other" in three.message
    assert three.certified
    assert verify_record(three) == []


def moved(values: np.ndarray, by: float) -> np.ndarray:
    out = values.copy()
    out[1] += by
    return out


@pytest.mark.parametrize(
    ("name", "change", "says"),
    [
        ("value", lambda v: moved(v, 1e-8), r"/contacts/value[1] (vertex 21"),
        ("force", lambda v: moved(v, 1e-5), "kkt_residual is"),
        ("force", lambda v: moved(v, -1e3), "pulls"),
        ("sign", lambda v: -v, "kkt_residual is"),
        ("gap", lambda v: 1e-6, "constraint_residual is"),
        ("excluded", lambda v: 0.5 * v, "/contacts/excluded is"),
        ("clearance", lambda v: 1e-6, "/contacts/clearance is"),
        ("penetration", lambda v: 1e-8, "/contacts/penetration is"),
        ("second", lambda v: v + np.outer([1, 0, 0, 0], [0, 1]), "kkt_residual is"),
    ],
)
def test_a_wrong_number_of_a_contact_is_named(record, name, change, says):
    wrong = with_contacts(record, **{name: change(getattr(record.contacts, name))})
    assert any(says in line for line in verify_record(wrong)), verify_record(wrong)


def test_wrong_claims_about_contact_are_named(record, undecided):
    def said(of: StateRecord, **changes) -> str:
        return "\n".join(verify_record(replace(of, **changes)))

    assert "kkt_residual" in said(record, contacts=None)
    fewer = {key: value[:3] for key, value in vars(record.contacts).items() if np.ndim(value)}
    assert "kkt_residual" in "\n".join(verify_record(with_contacts(record, **fewer)))
    assert "self_contact is false with 4 contacts" in said(record, self_contact=False)
    assert "clearance is 0.1, and /contacts/clearance" in said(record, clearance=0.1)
    claim = {"status": "minimum", "certified": True, "negative_eigenvalues": 0}
    pulled = said(undecided, **claim)
    assert "certified, but /contacts/force[0] (vertex 19 with facet 49) pulls: -" in pulled
    assert "status is minimum, recomputed undecided (A force pulls" in pulled
    lost = {"status": "gap-lost", "certified": False, "kind": "intermediate"}
    assert "status is gap-lost, but no more than" in said(record, **lost)
    crossed = said(record, half_width=1.651)
    assert "recomputed gap-lost" in crossed
    assert "/contacts/penetration is" in crossed


# --- comparison ---


def test_states_at_rest_are_compared(record):
    assert judge(record, replace(record, label=2)).answer == "identical"
    nearly = with_contacts(record, force=record.contacts.force * (1 + 1e-13))
    assert judge(record, nearly).answer == "same to rounding"
    other = judge(record, with_contacts(record, force=moved(record.contacts.force, 1e-3)))
    assert other.answer == "different"
    fewer = {key: value[:3] for key, value in vars(record.contacts).items() if np.ndim(value)}
    assert judge(record, with_contacts(record, **fewer)).largest_in == "/contacts"
    assert judge(record, replace(record, contacts=None)).largest_in == "/contacts"


def test_a_stored_state_is_a_shape_at_rest_again(record):
    rest = rest_of(record)
    assert rest.result.certified
    assert len(rest.pairs) == 4
    np.testing.assert_allclose(rest.forces, record.contacts.force, rtol=1e-9)


# --- the command line ---


@pytest.fixture
def run(tmp_path, monkeypatch, record):
    """A run with a band without forces, one that touches nothing, and one at rest, in ./runs."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("RIBBON_RUNS", raising=False)
    made = make_run(tmp_path / "runs")
    with made.writing():
        made.commit(make_record(1))
        made.commit(make_record(2, contacts=make_contacts(0)))
        made.commit(replace(record, label=3))
    return made


def test_listings_tell_contacts_and_forces(run):
    table = ribbon("ls", "mobius").stdout.splitlines()
    assert "contact    force" in table[0]
    assert [line.split()[5:8] for line in table[1:3]] == [["0.5", "no", "-"], ["0.5", "no", "0"]]
    assert "at 4  82.6484" in table[3]
    rows = ribbon_json("ls", "mobius")
    assert [row.get("contacts") for row in rows] == [None, 0, 4]
    assert rows[2]["contact_force"] == pytest.approx(82.648416)


def test_a_state_at_rest_is_shown(run):
    page = ribbon("show", "mobius:3").stdout
    assert "yes, rests on itself at 4 contacts, forces of 82.6484 in all" in page
    assert "vertex 21 with facet 49" in page
    document = ribbon_json("show", "mobius:3")
    assert len(document["contact_pairs"]) == document["contacts"] == 4
    first = document["contact_pairs"][1]
    assert (first["first"], first["second"]) == ([0, 21], [2, 49])
    assert "contact_pairs" not in ribbon_json("show", "mobius:1")
    assert "touches or passes" not in page


def test_tables_and_npz_have_contacts(run, record):
    rows = ribbon_json("table", "mobius", "--where", "contact_force > 1")["rows"]
    assert [row["contacts"] for row in rows] == [4]
    assert ribbon("export", "mobius:3", "--to", "npz", "-o", "x.npz").exit_code == 0
    with np.load("x.npz") as found:
        np.testing.assert_array_equal(found["contact_first"], record.contacts.first)
        np.testing.assert_array_equal(found["contact_second"], record.contacts.second)
        np.testing.assert_array_equal(found["contact_force"], record.contacts.force)
        assert found["contact_gap"] == 0.0
    assert ribbon("export", "mobius:1", "--to", "npz", "-o", "y.npz").exit_code == 0
    with np.load("y.npz") as found:
        assert not [name for name in found if name.startswith("contact")]


def test_frames_datasets_and_states_have_contacts(run):
    opened = ribbon_cli.open("mobius")
    frame = opened.table()
    assert frame.contacts.tolist()[1:] == [0, 4]
    assert frame.contacts.isna().tolist() == [True, False, False]
    assert frame.contact_force[2] == pytest.approx(82.648416)
    dataset = opened.to_xarray(grid=False)
    assert np.isnan(dataset.contacts[0])
    assert dataset.penetration.values[2] <= 1e-9
    state = opened.state(3)
    assert state.contacts.total_force == pytest.approx(82.648416)
    assert "rests on itself at 4 contacts" in state._repr_html_()


def test_other_contact_is_refused_where_a_band_rests(run):
    for option, why in (("record", "not stationary"), ("gap=0.02", "cannot be changed there")):
        result = ribbon("continue", "mobius:3", "--to", "1.66", "--contact", option)
        assert result.exit_code == 2
        assert why in result.stderr
    for wrong in ("force", "gap", "gap=-1", "gap=x"):
        result = ribbon("continue", "mobius:3", "--to", "1.66", "--contact", wrong)
        assert result.exit_code == 2
        assert "--contact: " in result.stderr
    assert "did you mean forces" in ribbon("continue", "mobius:3", "--to", "1", "--contact", "force").stderr


# --- configs ---


@pytest.mark.parametrize(
    ("text", "request_", "said"),
    [
        ("record", ContactRequest("record"), "record"),
        ("forces", ContactRequest("forces", 0.0), "forces"),
        ("{gap: 0}", ContactRequest("forces", 0.0), "forces"),
        ("{gap: pi/100}", ContactRequest("forces", np.pi / 100), {"gap": np.pi / 100}),
    ],
)
def test_contact_in_configs(text, request_, said):
    config = parse_config(f"{CONFIG}contact: {text}\n", "x.yaml")
    assert config.contact == request_
    assert config.resolved()["contact"] == said


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("force", "x.yaml:3:10: contact: must be record, stop or forces, got force, did you mean forces?"),
        ("0.02", "x.yaml:3:10: contact: must be record, stop, forces or {gap: 0.02}, got 0.02"),
        ("[forces]", "x.yaml:3:10: contact: must be record, stop, forces or {gap: 0.02}, got a list"),
        ("{gap: -0.1}", "x.yaml:3:16: contact.gap: must be at least 0, got -0.1"),
        ("{gap: 7}", "x.yaml:3:16: contact.gap: must be < 6.28319, the band's length, got 7"),
        ("{gp: 7}", "x.yaml:3:11: contact.gp: unknown key: did you mean gap?"),
        ("{}", "x.yaml:3:10: contact.gap: is missing: give the least distance of facets, as {gap: 0.02}"),
    ],
)
def test_mistakes_in_contact(text, message):
    with pytest.raises(ConfigError) as error:
        parse_config(f"{CONFIG}contact: {text}\n", "x.yaml")
    assert str(error.value) == message


def test_contact_forces_go_with_arclength():
    asked = parse_config(f"{CONFIG}widths: {{arclength: {{to: 0.2}}}}\ncontact: forces\n", "x.yaml")
    assert (asked.contact.forces, asked.arclength.to) == (True, 0.2)


def test_check_says_that_contact_forces_are_on(tmp_path):
    for text, words in (("forces", "which may touch (a gap of 0)"), ("{gap: 0.02}", "at least 0.02 apart")):
        path = tmp_path / "x.yaml"
        path.write_text(f"{CONFIG}contact: {text}\n")
        assert (
            f"contact forces are on: the band may rest on itself, with facets {words}"
            in ribbon("check", str(path)).stderr
        )
    path.write_text(CONFIG)
    assert "forces" not in ribbon("check", str(path)).output


def test_contacts_come_back_from_npz(record, tmp_path):
    path = tmp_path / "x.npz"
    export_npz(record, path)
    again = load_npz(path)["contacts"]
    for name, value in vars(record.contacts).items():
        np.testing.assert_array_equal(getattr(again, name), value)
    with np.load(path) as found:
        arrays = dict(found)
    odd = {"contact_gap": -1.0, "contact_force": np.full(4, np.nan), "contact_sign": np.array(["a"] * 4)}
    odd |= {"contact_first": np.full((4, 2), 1000), "contact_second": None, "contact_excluded": np.ones(1)}
    for name, value in odd.items():
        changed = {key: kept for key, kept in (arrays | {name: value}).items() if kept is not None}
        np.savez(path, **changed)
        with pytest.raises(StoreError, match=r"x\.npz: not a state: .*contact"):
            load_npz(path)

"""`ribbon verify`: every stored number that does not follow from the shape is named, and nothing else is."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cli_support import ribbon, ribbon_json

from ribbon_cli.store import Run, StateRecord, decode, encode, write_atomic
from ribbon_cli.store.layout import STATE
from ribbon_cli.verify.recompute import verify_record

FROZEN = Path(__file__).parent / "data" / "format-1.0"
EQUILIBRIUM, SADDLE, AUXILIARY = 6, 5, 2
FREE = {"label", "parent", "newton_steps", "stage", "method", "message", "events", "kind", "parent_ref"}
"""Fields that no shape determines."""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A solved run of six states in ./runs: a twist, the saddle it ends on, and the minimum."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("RIBBON_RUNS", raising=False)
    shutil.copytree(FROZEN, tmp_path / "runs")
    return tmp_path


@pytest.fixture(scope="module")
def records() -> dict[int, StateRecord]:
    (path,) = FROZEN.iterdir()
    run = Run.open(path)
    return {label: run.load(label) for label in run.entries()}


def changed(record: StateRecord, name: str) -> StateRecord | None:
    """The record with one field a little wrong; None where another value cannot be stored."""
    value = getattr(record, name)
    if isinstance(value, np.ndarray):
        wrong = value.copy()
        wrong.flat[wrong.size // 2] = (
            not wrong.flat[wrong.size // 2] if wrong.dtype == bool else value.max() + 1e-6
        )
    elif isinstance(value, bool):
        wrong = not value
    elif isinstance(value, int):
        wrong = -value if name == "sigma" else value + 1  # a band with sigma 0 has ends
    elif isinstance(value, float):
        wrong = value * (1 + 1e-6) + 1e-7
    else:
        return None
    return replace(record, **{name: wrong})


def test_states_as_solved_are_in_order(records):
    for record in records.values():
        assert verify_record(record) == []


@pytest.mark.parametrize("label", [AUXILIARY, SADDLE, EQUILIBRIUM])
@pytest.mark.parametrize("name", [item.field for item in STATE if item.field not in FREE])
def test_a_wrong_number_is_noticed(records, name, label):
    wrong = changed(records[label], name)
    if wrong is not None:
        if name in ("segments",):
            with pytest.raises(ValueError, match="has shape"):
                encode(wrong)
        else:
            assert verify_record(wrong)


def test_a_saddle_that_claims_to_be_a_minimum_is_found_out(records):
    saddle = records[SADDLE]
    claim = replace(saddle, kind="equilibrium", status="minimum", certified=True, negative_eigenvalues=0)
    assert verify_record(claim) == ["negative_eigenvalues is 0, recomputed 1"]


def test_another_band_under_the_same_name_is_found_out(records):
    record = records[EQUILIBRIUM]
    mirrored = replace(record, u=record.u * [1, 1, -1], g=record.g * [1, 1, -1])
    assert any("linking_number" in line for line in verify_record(mirrored))


def test_modes_that_are_none_are_found_out(records):
    record = records[EQUILIBRIUM]
    first, second = record.spectra
    moved = replace(first, values=first.values + np.linspace(0.0, 1e-3, len(first.values)))
    assert any("its mode gives" in line for line in verify_record(replace(record, spectra=(moved, second))))
    vectors = second.vectors.copy()
    vectors[-1, 3] += 1e-3
    bent = replace(second, vectors=vectors)
    assert verify_record(replace(record, spectra=(first, bent)))


def test_spectra_that_say_something_else_than_their_modes_are_found_out(records):
    record = records[EQUILIBRIUM]
    first, second = record.spectra
    turn, mode = first.labels.index("rotation"), first.labels.index("mode")

    def said(**changes) -> list[str]:
        return verify_record(replace(record, spectra=(replace(first, **changes), second)))

    def labelled(k: int, word: str) -> tuple[str, ...]:
        return (*first.labels[:k], word, *first.labels[k + 1 :])

    def moved(k: int, by) -> np.ndarray:
        vectors = first.vectors.copy()
        vectors[k] = by(vectors[k])
        return vectors

    bent = np.zeros_like(first.vectors[turn])
    bent[3, 1] = 1e-3
    name = "/spectra/euclidean"
    assert said(vectors=moved(turn, lambda v: v + bent)) == [
        f"{name}/vectors[{turn}] is no rotation of unit length"
    ]
    assert said(vectors=moved(turn, lambda v: 2.0 * v)) == [
        f"{name}/vectors[{turn}] is no rotation of unit length"
    ]
    assert any("unit length and orth" in line for line in said(vectors=moved(mode, lambda v: 1.001 * v)))
    assert any(
        "unit length and orth" in line
        for line in said(vectors=moved(mode + 1, lambda v: first.vectors[mode]))
    )
    assert said(labels=labelled(mode, "checkerboard")) == [
        f"{name}/labels[{mode}] is checkerboard, its mode is mode"
    ]
    assert any("labels do not agree" in line for line in said(labels=labelled(mode, "sliding")))
    assert any("none of rotation, sliding" in line for line in said(labels=labelled(mode, "modus")))
    assert any("has 4 rotations, the shape 3" in line for line in said(labels=labelled(mode, "rotation")))
    residuals = first.residuals.copy()
    residuals[mode] = 1e-3
    assert any(f"residuals[{mode}] is 0.001" in line for line in said(residuals=residuals))


def test_values_that_are_not_finite_are_a_line_and_no_error(records):
    record = records[EQUILIBRIUM]
    for name in ("u", "g", "xi", "lambda_3"):
        assert verify_record(replace(record, **{name: np.full_like(getattr(record, name), np.nan)}))
    assert verify_record(replace(record, half_width=-1.0)) == [
        "cannot be recomputed: half-width must be positive and finite, got -1.0"
    ]


def test_verify_does_not_call_nothing_in_order(folder):
    result = ribbon("verify", "--runs", "nowhere")
    assert (result.exit_code, result.stdout) == (0, "")
    assert result.stderr == "no runs in nowhere (see --runs): nothing to verify\n"


def test_verify_says_that_all_is_in_order(folder):
    for words, what in (
        (("all",), "1 run, 6 states"),
        ((), "1 run, 6 states"),
        (("frozen",), "1 run, 6 states"),
    ):
        result = ribbon("verify", *words)
        assert (result.exit_code, result.stdout) == (0, "")
        assert f"{what}: all in order" in result.stderr
    assert ribbon("verify", "frozen:6").exit_code == 0
    assert ribbon_json("verify", "frozen@b=0.1") == {
        "ok": True,
        "runs": 0,
        "states": 1,
        "problems": [],
        "notes": [],
    }


def test_verify_names_every_damage_and_exits_with_4(folder):
    run = Run.open(next((folder / "runs").iterdir()))
    data = bytearray(run.state_path(2).read_bytes())
    data[len(data) // 2] ^= 1
    run.state_path(2).write_bytes(data)
    run.state_path(3).unlink()
    (run.path / "config.yaml").write_text("name: other\n")
    (run.path / ".tmp-left").write_bytes(b"x")
    document = ribbon_json("verify", code=4)
    assert not document["ok"]
    assert [(Path(p["where"]).name, p["what"].partition(":")[0]) for p in document["problems"]] == [
        ("config.yaml", "not the bytes that the run was made with"),
        ("0002.h5", "damaged"),
        ("0003.h5", "cannot be read"),
    ]
    assert [Path(note["where"]).name for note in document["notes"]] == [".tmp-left"]
    result = ribbon("verify", "frozen")
    assert result.exit_code == 4
    assert "3 problems in 1 run, 6 states" in result.stderr
    assert ribbon("verify", "frozen:1").exit_code == 0
    assert ribbon("verify", "frozen:2").exit_code == 4


def test_verify_goes_on_past_a_damaged_log(folder):
    (next((folder / "runs").iterdir()) / "log.jsonl").write_text("garbage\n")
    document = ribbon_json("verify", code=4)
    assert "damaged line" in document["problems"][0]["what"]


def test_a_file_outside_a_run_is_checked_to_the_last_byte(tmp_path, records):
    path = tmp_path / "loose.h5"
    data = encode(records[EQUILIBRIUM])
    rng = np.random.default_rng(3)
    write_atomic(path, data)
    assert ribbon("verify", path).exit_code == 0
    for position in rng.choice(len(data), size=60, replace=False):
        bad = bytearray(data)
        bad[position] ^= 1 << rng.integers(8)
        write_atomic(path, bytes(bad), overwrite=True)
        assert ribbon("verify", path).exit_code == 4


def test_what_cannot_be_verified_is_a_usage_error(folder):
    assert ribbon("verify", "nothing").exit_code == 2
    assert ribbon("verify", "frozen:99").exit_code == 2
    np.savez(folder / "x.npz", u=1)
    assert "carries no hash" in ribbon("verify", "x.npz").stderr


def test_frozen_files_of_the_first_version_are_read(records):
    (path,) = FROZEN.glob("*/states/0006.h5")
    record = decode(path)
    assert f"{record.energy:.9f}" == "0.864281650"
    assert record.prescribed is None
    assert record.segments == 12

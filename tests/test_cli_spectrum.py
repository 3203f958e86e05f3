"""`ribbon spectrum`: text, JSON, CSV, Markdown, npz; convergence of runs; what is refused."""

from __future__ import annotations

import csv
import io
from pathlib import Path

import numpy as np
import pytest
from cli_support import QUICK_MOBIUS, QUICK_RING, ribbon, ribbon_json

from ribbon_cli.cli.spectrum_command import METRICS
from ribbon_cli.model.metrics import METRICS as KNOWN


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("spectra")
    for name, text in (("ring", QUICK_RING), ("mobius", QUICK_MOBIUS)):
        (folder / f"{name}.yaml").write_text(text, encoding="utf-8")
        assert ribbon("--runs", folder / "runs", "solve", folder / f"{name}.yaml", "-q").exit_code == 0
    return folder / "runs"


def rows(text: str) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(text)))


def test_the_metrics_are_those_of_the_model() -> None:
    assert set(METRICS) == set(KNOWN)


def test_a_state_in_json(runs: Path) -> None:
    document = ribbon_json("--runs", runs, "spectrum", "mobius@b=0.2,N=48")
    assert {"metric", "negative", "verdict", "modes"} <= document.keys()
    assert (document["metric"], document["negative"], document["stability"]) == ("physical", 0, "stable")
    assert len(document["modes"]) == 15
    values = [mode["value"] for mode in document["modes"]]
    assert values == sorted(values)
    assert {"value", "residual", "label", "sliding_overlap"} <= document["modes"][0].keys()
    labels = [mode["label"] for mode in document["modes"]]
    assert labels.count("rotation") == 3
    assert labels.count("sliding") == 1
    assert document["gap"] == pytest.approx(
        min(v for v, w in zip(values, labels, strict=True) if w == "mode")
    )


def test_a_state_in_text_ends_in_the_verdict(runs: Path) -> None:
    done = ribbon("--runs", runs, "spectrum", "mobius@b=0.2,N=48", "--modes", "4")
    assert done.exit_code == 0
    lines = done.stdout.splitlines()
    assert lines[-1].startswith("stable minimum modulo symmetries with gap 0.")
    assert lines[1].startswith("symmetry C2, order 2, residual")
    assert sum("rotation" in line for line in lines) == 3
    markdown = ribbon("--runs", runs, "spectrum", "mobius@b=0.2,N=48", "--format", "markdown").stdout
    assert "| ---: |" in markdown
    assert "**stable minimum" in markdown


def test_all_eigenvalues_of_a_state(runs: Path) -> None:
    done = ribbon(
        "--runs", runs, "spectrum", "ring@b=0.5,N=24", "--full", "--metric", "euclidean", "--format", "csv"
    )
    found = rows(done.stdout)
    assert len(found) == 2 * 24 - 3
    assert (found[0]["position"], found[-1]["position"]) == ("0.0", "1.0")
    assert {"value", "bound", "label", "hidden"} <= found[0].keys()


def test_all_eigenvalues_of_a_run(runs: Path, tmp_path: Path) -> None:
    target = tmp_path / "figure.csv"
    done = ribbon("--runs", runs, "spectrum", "ring", "--full", "--format", "csv", "-o", target)
    assert (done.exit_code, done.stdout) == (0, "")
    found = rows(target.read_text(encoding="utf-8"))
    assert {row["segments"] for row in found} == {"12", "24"}
    assert len(found) == 2 * (2 * 12 - 6) + 2 * (2 * 24 - 6)
    text = ribbon("--runs", runs, "spectrum", "ring", "--full").stdout
    assert "lowest/h" in text
    assert len(ribbon_json("--runs", runs, "spectrum", "ring", "--full")["states"]) == 4
    assert (
        "symmetry D24h" in ribbon("--runs", runs, "spectrum", "ring", "--full", "--format", "markdown").stdout
    )


def test_convergence(runs: Path) -> None:
    document = ribbon_json("--runs", runs, "spectrum", "ring", "--convergence", "--modes", "4")
    first = document["sequences"][0]
    assert (first["label"], first["segments"]) == ("mode", [12, 24])
    assert first["values"][0] == pytest.approx(document["sequences"][1]["values"][0])  # double
    text = ribbon("--runs", runs, "spectrum", "mobius", "--convergence").stdout
    assert "sliding: a symmetry of the continuum, which has it at zero" in text
    assert "N = 24" in text
    assert "| mode | parity |" in ribbon(
        "--runs", runs, "spectrum", "ring", "--convergence", "--format", "markdown"
    ).stdout.replace("---:", "")
    found = rows(ribbon("--runs", runs, "spectrum", "ring", "--convergence", "--format", "csv").stdout)
    assert {"half_width", "label", "segments", "value", "order", "limit"} <= found[0].keys()


def test_modes_as_arrays(runs: Path, tmp_path: Path) -> None:
    """A file of its own that names the state; it is never replaced."""
    target = tmp_path / "modes.npz"
    command = (
        "--runs",
        runs,
        "spectrum",
        "mobius@b=0.2,N=48",
        "--modes",
        "5",
        "--format",
        "npz",
        "-o",
        target,
    )
    assert ribbon(*command).exit_code == 0
    with np.load(target) as found:
        assert found["vectors"].shape == (8, 48, 7)
        assert found["values"].shape == found["bounds"].shape == found["labels"].shape == (8,)
        assert str(found["verdict"]).startswith("stable")
        named = ribbon_json("--runs", runs, "show", "mobius@b=0.2,N=48")["content_sha256"]
        assert str(found["content_sha256"]) == named
    again = ribbon(*command)
    assert again.exit_code == 2
    assert "exists already" in again.stderr


@pytest.mark.parametrize(
    ("args", "words"),
    [
        (("mobius", "--modes", "3"), "is a run: name one of its states"),
        (("mobius:1",), "auxiliary"),
        (("ring:1", "--full", "--modes", "3"), "leave out --modes"),
        (("ring:1", "--format", "csv", "--json"), "exclude each other"),
        (("ring:1", "--format", "npz"), "with -o"),
        (("ring:1", "--metric", "riemann"), "riemann"),
        (("ring:1", "--modes", "0"), "--modes"),
    ],
)
def test_what_is_refused(runs: Path, args: tuple[str, ...], words: str) -> None:
    done = ribbon("--runs", runs, "spectrum", *args)
    assert done.exit_code == 2
    assert words in done.stderr
    assert done.stdout == ""

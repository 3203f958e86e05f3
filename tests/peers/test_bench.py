"""The benchmark runs: a few small solves by both contestants, and a document of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bench import run
from bench.machine import machine, versions

pytestmark = pytest.mark.peers


def test_a_quick_benchmark_writes_its_document(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "benchmarks.md"
    with np.errstate(all="warn", under="ignore", over="ignore", invalid="ignore", divide="ignore"):
        assert run.main(["--quick", "-o", str(path)]) == 0
    text = path.read_text(encoding="utf-8")
    assert text.count("\n## ") == 5
    assert machine() in text
    assert versions() in text
    assert "missing" not in text
    assert "| 0.2 | 100 |" in text
    said = capsys.readouterr()
    assert said.out.count("\n") == 4
    assert "single solves" in said.err


def test_the_machine_is_named_in_words() -> None:
    words = machine()
    assert "-core" in words
    assert words.endswith("Linux") or "," in words
    assert "casadi" in versions()

"""Folds and branch points by AUTO-07p against the references; run by `make test-auto`."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

HERE = Path(__file__).parent
sys.path.append(str(HERE.parent))
from references.planar import buckled  # noqa: E402
from references.singular import branch_point_in_span, fold_in_tilt  # noqa: E402

pytestmark = pytest.mark.auto


@pytest.fixture(scope="module")
def found() -> dict[str, dict]:
    python = os.environ.get("AUTO_PYTHON")
    if python is None:
        pytest.skip("AUTO_PYTHON names no Python that has bifpy")
    command = [python, str(HERE / "elastica.py")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.mark.parametrize(
    ("name", "lift", "guess"),
    [("fold", 0.0, (7.9, -65.0, 8.9, 0.89)), ("fold, lifted", 0.3, (7.0, -68.4, -19.4, 1.2))],
)
def test_the_folds_in_the_tilt(found: dict, name: str, lift: float, guess: tuple) -> None:
    by_auto, exact = found[name], fold_in_tilt(0.75, lift, guess)
    assert [by_auto[k] for k in ("span", "lift")] == pytest.approx([0.75, lift], abs=1e-8)
    assert by_auto["tilt"] == pytest.approx(exact.tilt, rel=1e-8)
    assert by_auto["energy"] == pytest.approx(exact.energy, rel=1e-6)
    assert by_auto["force"] == pytest.approx(exact.force, rel=1e-5)


def test_the_branch_points_in_the_span(found: dict) -> None:
    by_auto, exact = found["branch point, lifted"], branch_point_in_span(0.3)
    assert by_auto["span"] == pytest.approx(exact.span, rel=1e-8)
    assert by_auto["energy"] == pytest.approx(exact.energy, rel=1e-6)
    assert by_auto["force"] == pytest.approx(exact.force, rel=1e-5)
    eight = buckled(0.0, 1.0)
    assert found["branch point"]["span"] == pytest.approx(0.0, abs=1e-5)
    assert found["branch point"]["energy"] == pytest.approx(eight.energy, rel=1e-5)


def test_the_crossing_branch_has_the_half_turns_symmetry(found: dict) -> None:
    """By balance of moments both clamps' moments are half of chord times force there."""
    here = found["symmetric, lifted"]
    assert here["span"] == pytest.approx(0.8, abs=1e-8)
    lever = here["span"] * here["force"][1] - here["lift"] * here["force"][0]
    assert here["moment"] == pytest.approx(-lever / 2, rel=1e-6)

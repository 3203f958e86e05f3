"""Folds and branch points by AUTO-07p against the references, and ours against AUTO's (`make test-auto`).

AUTO's points are exact to 1e-8. Ours are located on branches followed by arclength at N = 50 to 400, and
extrapolated to N -> infinity.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

HERE = Path(__file__).parent
sys.path.append(str(HERE.parent))
import strip_points as ours  # noqa: E402
from references.planar import buckled  # noqa: E402
from references.singular import branch_point_in_span, fold_in_tilt  # noqa: E402

pytestmark = pytest.mark.auto
ACCURACY = 1e-5


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


OURS = {
    "fold": ("tilt", lambda n: ours.fold_in_tilt(n, 0.0).point),
    "fold, lifted": ("tilt", lambda n: ours.fold_in_tilt(n, 0.3).point),
    "branch point, lifted": ("span", lambda n: ours.branch_point_in_span(n).point),
    "branch point": ("span", lambda n: ours.branch_point_of_the_eight(n).point),
}


@pytest.mark.parametrize("name", OURS)
def test_our_points_tend_to_those_of_auto(found: dict, name: str, figure: Callable[[str], None]) -> None:
    parameter, located = OURS[name]
    by_auto, limit = found[name], ours.limit(located)
    figure(f"{parameter} by AUTO {by_auto[parameter]:.10f}, ours {limit}")
    assert limit.value[0] == pytest.approx(by_auto[parameter], abs=ACCURACY)
    assert limit.error[0] < ACCURACY
    assert limit.orders[:, 0] == pytest.approx(3.0 if name == "branch point" else 2.0, abs=0.05)
    assert limit.value[1] == pytest.approx(by_auto["energy"], rel=ACCURACY)
    # Components may vanish: force and moment are compared as one vector, relative to its length.
    wrench = np.array([*by_auto["force"], by_auto["moment"]])
    assert np.linalg.norm(limit.value[2:] - wrench) < ACCURACY * np.linalg.norm(wrench)


def test_the_branches_beyond_the_branch_point_are_those_of_auto(
    found: dict, figure: Callable[[str], None]
) -> None:
    """The symmetric strips, which AUTO reaches by switching; and those without, which ours does, to both
    sides."""
    beyond = ours.extrapolated(lambda n: ours.described(ours.symmetric(n, 0.8)))
    figure(f"symmetric: energy, force x, y, moment: {beyond}")
    wanted = found["symmetric, lifted"]
    assert beyond.value == pytest.approx([wanted["energy"], *wanted["force"], wanted["moment"]], rel=ACCURACY)
    # A half turn takes one side to the other, and its clamps to each other: their moments are exchanged.
    pair = ours.extrapolated(
        lambda n: np.concatenate([ours.described(point) for point in ours.sides(n, 0.75)])
    )
    figure(f"to both sides: energy, force x, y, moment: {pair}")
    one, other = pair.value[:4], pair.value[4:]
    assert one[:3] == pytest.approx(other[:3], rel=1e-8)
    wanted = found["lifted"]
    for side in (one, other):
        assert side[:3] == pytest.approx([wanted["energy"], *wanted["force"]], rel=ACCURACY)
    nearest = min(one[3], other[3], key=lambda moment: abs(moment - wanted["moment"]))
    assert nearest == pytest.approx(wanted["moment"], rel=ACCURACY)

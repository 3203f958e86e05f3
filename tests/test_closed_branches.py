"""Closed branches: followed once, and no further."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from cli_support import ribbon, ribbon_json

from ribbon_cli.study.closed_branches import repeated, turns

CONFIG = f"""\
name: slide
topology: {{half_twists: -1}}
initial_guess: {{state: {Path(__file__).parent / "data" / "pi-b0.5-N50.npz"}}}
widths: [0.5, 0.8, 1.2]
spectrum: {{modes: 0, full_up_to: 0}}
"""


def turn(b: float, energy: float, *kappa: float, rate: float = 0.0, type: str = "fold") -> SimpleNamespace:
    """What of a stored state matters here."""
    branch = SimpleNamespace(type=type, half_width_rate=rate)
    return SimpleNamespace(half_width=b, energy=energy, kappa_s=np.array(kappa), branch=branch)


LOW, HIGH, TOP = turn(1.0, 5.0, 1.0, -2.0, 3.0), turn(1.1, 6.0, 0.0, 1.0, 4.0), turn(1.3, 7.0, 0.0, 0.0, 5.0)
MIRRORED = turn(1.0 + 1e-9, 5.0, -3.0, -1.0, 2.0)


@pytest.mark.parametrize(
    ("course", "before"),
    [
        ([LOW, HIGH, MIRRORED], None),  # the other side of a symmetric shape
        ([LOW, HIGH, MIRRORED, HIGH], HIGH),
        ([LOW, HIGH, MIRRORED, TOP], None),  # behind which there is something new
        ([LOW, LOW, HIGH, MIRRORED, MIRRORED], None),  # each vertex met as a fold and as a branch point
        ([LOW, LOW, HIGH, HIGH, MIRRORED, HIGH], HIGH),
        ([TOP, LOW, HIGH, LOW, HIGH], HIGH),
        (
            [LOW, HIGH, turn(1.0, 5.0, 1.0, 1.0, 3.0), HIGH],
            None,
        ),  # another shape, by chance as wide and stiff
        ([LOW, HIGH, turn(1.0 + 1e-6, 5.0, 1.0, -2.0, 3.0), HIGH], None),
    ],
)
def test_two_turns_in_a_row_tell(course, before):
    assert repeated(course) is before


def test_what_a_turn_is():
    assert turns(LOW)
    assert turns(turn(1.0, 5.0, type="branch-point", rate=2e-5))
    assert not turns(turn(1.0, 5.0, type="branch-point", rate=-0.1))
    assert not turns(turn(1.0, 5.0, type="width"))
    assert not turns(SimpleNamespace(branch=None))


@pytest.mark.long
def test_the_sliding_branch_is_closed(tmp_path):
    """It joins the two grid phases of the pi band, and goes on to the next facet as it came from the last."""
    (tmp_path / "slide.yaml").write_text(CONFIG)
    options = ("--runs", tmp_path / "runs", "-q")
    ribbon_json("solve", tmp_path / "slide.yaml", *options)
    words = (
        "continue",
        "slide@b=1.2,N=50",
        "--to",
        "1.23",
        "--back-to",
        "1.19",
        "--arclength",
        "--switch",
        "1",
    )
    # The end of the range is not reached, and need not be.
    result = ribbon(*words, *options)
    assert (result.exit_code, result.stderr) == (0, "")
    assert "The branch is closed: it repeats itself" in result.stdout
    main, plus, minus = ribbon_json("show", "slide", *options)["branches"]
    assert (main["reason"], main["half_width"]) == ("range", 1.23)
    for side in (plus, minus):
        assert side["reason"] == "closed"
        assert side["message"].startswith("The branch is closed")
        met = [p["half_width"] for p in side["points"] if p["type"] in ("fold", "branch-point")]
        # At a vertex its fold and the mode that crosses there may be located apart, by less than b is known.
        turning = [b for k, b in enumerate(met) if k == 0 or abs(b - met[k - 1]) > 2e-9]
        assert turning == pytest.approx([1.216085412, 1.215923131, 1.216085412], abs=2e-9)
        assert all(abs(p["linking_number"] + 0.5) < 1e-6 for p in side["points"])
    again = ribbon_json(*words, *options)
    assert again["new_states"] == 0

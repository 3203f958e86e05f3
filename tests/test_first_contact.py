"""The width of first contact: bracketed on the branch, on every level, and the limit that levels tend to."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path

import pytest

from ribbon_cli.config import SpectrumRequest, load_config, parse_config
from ribbon_cli.model.contact import self_contact
from ribbon_cli.solver.continuation import to_band, to_width
from ribbon_cli.solver.newton import Options
from ribbon_cli.solver.status import Status
from ribbon_cli.study import solve_config
from ribbon_cli.study.contact import WITHIN, extrapolated
from ribbon_cli.study.records import multipliers_of, state_of

ROOT = Path(__file__).parent.parent
CONFIG = """
name: touching
topology: {{half_twists: 3}}
length: {length}
initial_guess: {{recipe: schoenke, segments: 60, half_width: {start}}}
widths: {widths}
refinement: {levels}
spectrum: {{modes: 0, full_up_to: 0}}
contact: {contact}
"""


def solved(
    root: Path,
    *,
    widths: str = "[0.65, 0.68]",
    levels: str = "[60]",
    contact: str = "record",
    length: str = "2*pi",
    start: str = "0.5",
):
    text = CONFIG.format(widths=widths, levels=levels, contact=contact, length=length, start=start)
    return solve_config(parse_config(text, "touching.yaml"), root)


def located(run) -> list[dict]:
    return [s for s in run.states(all=True) if any("first contact" in event for event in s.events)]


def test_three_pi_bands_meet_in_the_middle_on_two_levels(tmp_path: Path) -> None:
    """N = 60 and 120: the last bracket is 1e-5 wide, and the free end of it is free."""
    levels = "{levels: [60, 120], at: [0.65]}"
    outcome = solved(tmp_path, levels=levels, contact="stop")
    assert outcome.exit_code == 0
    first, second = located(outcome.run)
    assert (first.half_width, first.segments) == (pytest.approx(0.6640, abs=2e-5), 60)
    assert (second.half_width, second.segments) == (pytest.approx(0.66471, abs=2e-5), 120)
    for state in (first, second):
        assert (state.kind, state.certified, state.self_contact) == ("intermediate", True, True)
        assert state.linking_number == pytest.approx(1.5, abs=1e-9)
    record = outcome.run.load(first.label)
    narrower = to_width(
        state_of(record), multipliers_of(record), record.half_width - 1.01 * WITHIN, Options()
    )
    state = narrower.result.state
    free = self_contact(state.u, state.g, -state.g[0], state.band.half_width, state.band.h)
    assert not free.contact
    assert 0.0 < free.clearance < 1e-4  # the clearance falls to zero with the width, here at the middle
    assert re.search(
        r"first contact at b = 0\.6640\d* \(N = 60\), b = 0\.6647\d* \(N = 120\)", outcome.notes[0]
    )
    again = solved(tmp_path, levels=levels, contact="stop")
    assert again.new_states == 0
    assert again.notes[0] == outcome.notes[0]


@pytest.mark.large
def test_the_pi_band_meets_itself_at_the_documented_widths(tmp_path: Path) -> None:
    """All four levels of docs/recipes.md; at N = 400 sliding costs next to nothing at b = 1.514."""
    config = load_config(ROOT / "configs" / "mobius-pi-contact.yaml")
    outcome = solve_config(replace(config, spectrum=SpectrumRequest(0, 0)), tmp_path)
    found = [(state.segments, f"{state.half_width:.5f}") for state in located(outcome.run)]
    assert found == [(50, "1.50430"), (100, "1.50955"), (200, "1.51177"), (400, "1.51238")]
    assert "tending to 1.51261 +- 0.0002, with order 1.88" in outcome.notes[-2]
    page = (ROOT / "docs" / "recipes.md").read_text(encoding="utf-8")
    assert f"| {' | '.join(width for _, width in found)} | 1.5126 ± 0.0002 |" in page


def test_contact_is_recorded_going_down_as_well(tmp_path: Path) -> None:
    outcome = solved(tmp_path, widths="[0.68, 0.65]", start="0.68")
    assert outcome.exit_code == 0
    (state,) = located(outcome.run)
    assert state.half_width == pytest.approx(0.6640, abs=2e-5)
    assert state.self_contact
    assert outcome.run.states()[-1].label == state.parent  # that without contact


def test_the_width_scales_with_the_length(tmp_path: Path) -> None:
    outcome = solved(tmp_path, widths="[0.325/pi, 0.34/pi]", length="1", start="0.325/pi")
    (state,) = located(outcome.run)
    assert state.half_width * 2 * math.pi == pytest.approx(0.6640, abs=2e-5)


def test_without_contact_nothing_is_located(tmp_path: Path) -> None:
    assert located(solved(tmp_path, widths="[0.6, 0.65]").run) == []


def test_a_step_that_fails_is_told_and_the_schedule_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from ribbon_cli.study import stepping as module

    def blocked(state, multipliers, band, *rest):
        move = to_band(state, multipliers, band, *rest)
        named = band.half_width in (0.65, 0.68)
        return move if named else replace(move, result=replace(move.result, status=Status.STALLED))

    monkeypatch.setattr(module, "to_band", blocked)
    outcome = solved(tmp_path)
    assert outcome.exit_code == 0
    assert "not located, at b = 0.665: Stalled" in outcome.notes[0]
    assert located(outcome.run) == []


def test_limits_need_a_trend() -> None:
    """b_N = 1 - 3/N^2 has the limit 1 and order 2."""
    found = extrapolated([1 - 3 / n**2 for n in (10, 20, 40)])
    assert found is not None
    assert found == pytest.approx((1.0, 3 / 40**2, 2.0))
    assert extrapolated([1.0, 1.1]) is None
    assert extrapolated([1.0, 1.1, 1.3]) is None  # it grows
    assert extrapolated([1.0, 1.1, 1.05]) is None  # it turns
    assert extrapolated([1.0, 1.1, 1.1]) is None
    assert extrapolated([1.0, 1.0001, 1.00012]) is None  # it is no larger than the brackets

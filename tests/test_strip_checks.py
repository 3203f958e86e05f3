"""verify, compare, rerun, pack and spectra of open strips."""

from __future__ import annotations

import signal
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cli_support import content_hashes, ribbon, ribbon_json, run, spawn, stop_after
from picture_support import run_named, states_of
from strip_runs import SHEARED, strips

from ribbon_cli.analysis.stability import stability_of
from ribbon_cli.model.strip_symmetry import strip_symmetries
from ribbon_cli.parts import Ends, Loads, Material, Parts
from ribbon_cli.report.comparison import IDENTICAL, SAME
from ribbon_cli.solver.arclength import nearest
from ribbon_cli.store import StateRecord
from ribbon_cli.study.clock import Clock
from ribbon_cli.study.records import Problem, Reached, build_record, state_of
from ribbon_cli.verify.recompute import verify_record
from ribbon_cli.verify.sameness import judge

__all__ = ["strips"]


def states(root: Path, name: str) -> list[StateRecord]:
    return states_of(root, name, "equilibrium")


def test_solved_strips_verify(strips: Path) -> None:
    result = ribbon("verify", "--runs", strips)
    assert result.exit_code == 0, result.stderr


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"reaction_force": [1.0, 2.0, 3.0]}, "reaction_force"),
        ({"start_moment": [0.0, 0.0, 0.0]}, "start_moment"),
        ({"lambda_end": 5.0}, "kkt_residual"),
        ({"half_twists": 2}, "half_twists"),
        ({"g_end": [0.0, 0.1, 1.0]}, "constraint_residual"),
        ({"parts": Parts(Ends(span=0.7, shear=0.06))}, "constraint_residual"),
    ],
)
def test_what_does_not_follow_from_a_strip_is_found(
    strips: Path, change: dict[str, object], told: str
) -> None:
    record = states(strips, "sheared")[1]
    assert verify_record(record) == []
    assert any(told in line for line in verify_record(replace(record, **change)))  # type: ignore[arg-type]


def test_bending_energy_is_verified_where_there_are_loads(strips: Path) -> None:
    record = states(strips, "cantilever")[0]
    assert record.bending_energy is not None
    assert record.bending_energy > 0 > record.energy
    wrong = replace(record, bending_energy=1.01 * record.bending_energy)
    assert any(line.startswith("bending_energy") for line in verify_record(wrong))


def test_a_branch_in_another_parameter_has_its_tangent(strips: Path) -> None:
    record = next(r for r in states_of(strips, "branch", "intermediate") if r.branch)
    assert record.branch is not None
    assert record.branch.parameter == "span"
    assert verify_record(record) == []
    for name in (None, "lift"):
        wrong = replace(record, branch=replace(record.branch, parameter=name))
        assert any("/branch/tangent" in line for line in verify_record(wrong))


def test_symmetries_of_clamps_and_what_shear_leaves(strips: Path) -> None:
    flat, sheared = states_of(strips, "branch")[-1], states(strips, "sheared")[-1]
    planar = strip_symmetries(state_of(flat))
    assert (planar.name, planar.order) == ("C2v", 4)
    found = {(s.name, s.reverse, s.flip): np.round(np.diag(s.matrix), 6).tolist() for s in planar.exact}
    assert found["sigma", True, False] == [-1.0, 1.0, 1.0]
    assert found["sigma", False, True] == [1.0, 1.0, -1.0]
    assert found["C2", True, True] == [-1.0, 1.0, -1.0]
    left = strip_symmetries(state_of(sheared))
    assert (left.name, left.order, left.near) == ("C2", 2, ())
    assert left.exact[1].reverse
    assert left.residual < 1e-9


@pytest.mark.parametrize(
    ("parts", "name"),
    [
        (Parts(Ends(span=0.7), loads=Loads(gravity=1e-3)), "C2v"),
        (Parts(Ends(span=0.7), loads=Loads(gravity=1e-3, gravity_direction=(0.0, 0.0, 1.0))), "Cs"),
        (Parts(Ends(span=0.7), loads=Loads(gravity=1e-3, gravity_direction=(1.0, 0.0, 0.0))), "Cs"),
        (Parts(Ends(span=0.7), Material(natural_curvature=0.1)), "C2v"),
        (Parts(Ends("hinged", "clamped", span=0.7)), "Cs"),
        (Parts(Ends(span=0.7), loads=Loads(point_force=(0.0, 1.0, 0.0), point_at=0.25)), "Cs"),
    ],
)
def test_a_symmetry_of_the_shape_alone_is_none_of_the_problem(strips: Path, parts: Parts, name: str) -> None:
    """What loads and supports break is no symmetry, however symmetric the shape."""
    state = state_of(states_of(strips, "branch")[-1])
    ends = parts.ends
    assert ends is not None
    ends = replace(ends, span=state.band.parameter("span"))
    band = replace(state.band, parts=replace(parts, ends=ends))
    assert strip_symmetries(replace(state, band=band)).name == name


@pytest.mark.parametrize("name", ["sheared", "cantilever"])
def test_modes_of_a_strip_slide_and_turn_nowhere(strips: Path, name: str) -> None:
    found = stability_of(states(strips, name)[-1], modes=4)
    assert {mode.label for mode in found.modes} == {"mode"}
    assert all(mode.sliding_overlap == 0.0 for mode in found.modes)
    characters = [value for mode in found.modes for value in mode.symmetry.values()]
    assert characters
    np.testing.assert_allclose(np.abs(characters), 1.0, atol=1e-6)


def test_spectra_name_the_problem_and_have_no_column_of_sliding(strips: Path) -> None:
    text = ribbon("spectrum", "sheared:3", "--modes", "2", "--runs", strips).stdout
    assert text.startswith("b = 0.05, span = 0.75, shear = 0.06, N = 20, value-average; ")
    assert "sliding" not in text
    assert ribbon_json("spectrum", "sheared:3", "--runs", strips)["parameters"]["shear"] == 0.06
    (branch,) = run_named(strips, "branch").path.parent.glob("branch-*")
    assert "sliding" not in ribbon("show", branch.name, "--runs", strips).stdout


def test_targets_of_a_schedule_are_told_by_their_place(strips: Path, tmp_path: Path) -> None:
    (tmp_path / "sheared.yaml").write_text(SHEARED)
    text = ribbon("solve", tmp_path / "sheared.yaml", "-q", "--runs", strips).stdout
    rows = [line.strip().partition("  ")[0] for line in text.splitlines()]
    first, second, last = (f"b = {b}, shear = {s}" for b, s in ((0.05, 0.03), (0.05, 0.06), (0.06, 0.06)))
    assert rows == ["place", first, second, second, last, last]


def test_spectra_under_refinement_do_not_mix_problems(strips: Path) -> None:
    """Two values of the shear at one half-width have a table each."""
    told = ribbon_json("spectrum", "sheared", "--convergence", "--modes", "1", "--runs", strips)
    first = [s for s in told["sequences"] if (s["label"], s["number"]) == ("mode", 1)]
    places = [(s["half_width"], s["parameters"]["shear"], s["segments"]) for s in first]
    assert places[1:] == [(0.05, 0.03, [20]), (0.05, 0.06, [20, 40]), (0.06, 0.06, [20, 40])]
    assert places[0][:2] == (0.05, 0.0)
    text = ribbon("spectrum", "sheared", "--convergence", "--modes", "1", "--runs", strips).stdout
    assert "b = 0.05, shear = 0.03, physical metric" in text


def test_an_image_is_the_same_state(strips: Path) -> None:
    """Buckled to the other side it is the same by a half-turn that swaps the ends."""
    first = states_of(strips, "branch")[-1]
    state = state_of(first)
    mirror = np.array([1.0, -1.0, 1.0])
    other = replace(state, u=state.u * mirror, g=state.g * mirror, g_end=first.g_end * mirror)
    problem = Problem(state.band)
    reached = Reached(problem, nearest(other), first.kind, first.stage, first.method, 0)
    second = replace(
        build_record(1, reached, Clock((), None), None),
        spectra=(),
        branch=None,
        status=first.status,
        certified=first.certified,
        negative_eigenvalues=first.negative_eigenvalues,
    )
    verdict = judge(replace(first, spectra=(), branch=None), second)
    assert (verdict.answer, verdict.image) == (SAME, "backwards, turned")


@pytest.mark.parametrize(
    "name",
    ["lambda_end", "bending_energy", "reaction_force", "reaction_moment", "start_force", "start_moment"],
)
def test_compare_looks_at_what_strips_have_more(strips: Path, name: str) -> None:
    first = states(strips, "cantilever")[-1]
    changed = np.asarray(getattr(first, name)) + 1e-3
    other = replace(first, **{name: changed if changed.ndim else float(changed)})
    assert judge(first, other).answer not in (IDENTICAL, SAME)


@pytest.mark.parametrize(
    "parts",
    [
        Parts(Ends("hinged", "clamped", span=0.75, shear=0.06)),
        Parts(Ends(span=0.75, shear=0.06), Material(poisson=0.3)),
        Parts(Ends(span=0.75, shear=0.06), loads=Loads(gravity_direction=(0.0, 0.0, -1.0))),
        Parts(Ends(span=0.75, shear=0.0601)),
        Parts(Ends(span=0.75, shear=0.06), loads=Loads(gravity=1e-3)),
    ],
)
def test_compare_looks_at_the_problem(strips: Path, parts: Parts) -> None:
    first = states(strips, "sheared")[-1]
    assert judge(first, replace(first, parts=parts)).answer not in (IDENTICAL, SAME)


def test_other_places_of_the_end_are_other_states(strips: Path) -> None:
    first, second = states(strips, "sheared")[:2]
    assert judge(first, first).answer == IDENTICAL
    verdict = judge(first, second)
    assert verdict.answer not in (IDENTICAL, SAME)


def test_a_strip_goes_through_pack_rm_unpack_and_rerun(strips: Path, tmp_path: Path) -> None:
    packed, other = tmp_path / "packed.h5", tmp_path / "runs"
    assert ribbon("pack", "cantilever", "-o", packed, "--runs", strips).exit_code == 0
    assert ribbon("unpack", packed, "--runs", other).exit_code == 0
    assert content_hashes(other) == {
        state.label: state.content_sha256 for state in run_named(strips, "cantilever").states(all=True)
    }
    assert ribbon("verify", "--runs", other).exit_code == 0
    assert ribbon("repair", "cantilever", "--runs", other).exit_code == 0
    assert ribbon_json("rerun", "cantilever", "--runs", other, "--json")["answer"] == "identical"
    assert ribbon("rm", "cantilever", "--runs", other, "--yes").exit_code == 0


@pytest.mark.parametrize("counts", [(2,), pytest.param((1, 3), marks=pytest.mark.long)])
def test_killed_and_resumed_a_strip_ends_with_the_same_bytes(
    strips: Path, tmp_path: Path, counts: tuple[int, ...]
) -> None:
    (tmp_path / "sheared.yaml").write_text(SHEARED)
    for count in counts:
        with spawn("solve", "sheared.yaml", "-q", cwd=tmp_path) as process:
            stop_after(process, tmp_path, count, signal.SIGKILL)
    assert run("solve", "sheared.yaml", "-q", cwd=tmp_path).returncode == 0
    expected = {state.label: state.content_sha256 for state in run_named(strips, "sheared").states(all=True)}
    assert content_hashes(tmp_path / "runs") == expected

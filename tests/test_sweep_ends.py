"""A state on the way of a sweep's point is not the point's: in grids, tables and pictures."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from cli_support import ribbon
from store_support import make_summary
from table_runs import SWEEP, walk

import ribbon_cli
from ribbon_cli.api.aims import Aims
from ribbon_cli.api.gathering import gathered, sources
from ribbon_cli.config import load_sweep, parse_config
from ribbon_cli.plot.fields import Choice, chosen, curves
from ribbon_cli.store import Summary, keep_sweep
from ribbon_cli.study import solve_config

FAILED = "legs-span0.97-shear0.2"
MISSED = f"legs: targets not reached at 1 of 4 points: {FAILED}; 1 of 4 points not run yet"
KEYS = ("ends.span", "schedule.0.shear")


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = walk(tmp_path_factory.mktemp("runs"))
    done = ribbon("continue", f"{FAILED}:1", "--in", "shear", "--to", "0.001", "--runs", str(root))
    assert done.exit_code == 0, done.stderr
    return root


def test_a_cell_has_a_state_only_at_the_end_of_its_schedule(root: Path) -> None:
    data = ribbon_cli.open_sweep("legs", root).to_xarray()
    assert data["energy"].dims == KEYS
    # Neither the start, nor what was continued by hand, nor what lies further up than a negative target.
    assert data["energy"].notnull().values.tolist() == [[True, True], [False, False]]
    assert data["certified"].values.tolist() == [[True, True], [False, False]]
    assert data["parameter_shear"].values[0].tolist() == [-0.1, 0.2]
    assert np.isnan(data["label"].values[1]).all()


def test_a_key_stands_beside_the_states_of_which_it_is_true(root: Path) -> None:
    rows = gathered(sources(root, ["legs"]))
    found = [(row["ends.span"], row["schedule.0.shear"], row["parameter_shear"]) for row in rows.rows]
    assert found == [
        *[(0.6, None, 0.0), (0.6, -0.1, -0.1), (0.6, None, 0.0), (0.6, 0.2, 0.2)],
        *[(0.97, None, 0.0), (0.97, None, 0.001)],
    ]
    assert next(c for c in rows.columns if c.name == KEYS[1]).dtype == "float64"
    assert len(rows.where("schedule.0.shear == 0.2").rows) == 1
    done = ribbon("table", "legs", "--columns", f"{KEYS[1]},energy", "--runs", str(root))
    assert done.stdout.splitlines()[1].split()[0] == "-"
    assert done.stderr == f"{MISSED}\n"


@pytest.mark.parametrize(("over", "by"), [KEYS, KEYS[::-1]])
def test_a_picture_over_a_key_leaves_out_states_on_the_way(root: Path, over: str, by: str) -> None:
    table = gathered(sources(root, ["legs"]))
    drawn = [row for _, found in curves(table, chosen(table, Choice(over=over, by=(by,)))) for row in found]
    assert sorted(row["parameter_shear"] for row in drawn) == [-0.1, 0.2]


def test_a_picture_tells_of_points_that_failed_and_of_those_not_run(root: Path, tmp_path: Path) -> None:
    for kind in ("table", "shapes"):
        done = ribbon("plot", "legs", kind, "-o", str(tmp_path / f"{kind}.svg"), "--runs", str(root))
        assert (done.exit_code, MISSED in done.stderr) == (0, True), done.stderr
    assert ribbon_cli.open_sweep("legs", root).plot("table", over=KEYS[1]) is not None


def test_shapes_have_titles_beside_each_other_and_each_state_once(root: Path) -> None:
    figure = ribbon_cli.open_sweep("legs", root).plot("shapes", caption=False)
    titles = [axes.title for axes in figure.axes if axes.get_title()]
    texts = [title.get_text().replace("\n", ", ") for title in titles]
    assert texts == [
        f"span = {span}, shear = {shear}"
        for span, shear in [("0.6", "-0.1"), ("0.6", "0"), ("0.6", "0.2"), ("0.97", "0"), ("0.97", "0.001")]
    ]
    figure.canvas.draw()
    boxes = [title.get_window_extent() for title in titles]
    assert not any(one.overlaps(other) for one, other in combinations(boxes, 2))
    assert all(box.x0 >= 0 and box.x1 <= figure.bbox.x1 for box in boxes)


def test_states_along_a_path_are_told_apart_by_their_own_parameters(root: Path) -> None:
    table = gathered(sources(root, ["legs"]))
    found = chosen(table, Choice())
    assert found.over.name == "parameter_shear"
    assert [column.name for column in found.by] == ["ends.span"]
    ((_, path), _) = curves(table, found)
    assert [row["parameter_shear"] for row in path] == [-0.1, 0.0, 0.2]


SCHEDULE = """
topology: open
length: 1
ends: {span: 0.6}
initial_guess: {recipe: strip, segments: 12, half_width: 0.1}
schedule: [%s]
"""


def aims(*legs: str) -> Aims:
    return Aims.of_config(parse_config(SCHEDULE % ", ".join(legs), "legs.yaml"))


def at(**others: float) -> Summary:
    state = make_summary(half_width=0.1, segments=12, length=1.0)
    return replace(state, others={"span": 0.6, "shear": 0.0, "twist": 0.0, **others})


def test_a_schedule_that_comes_back_ends_where_it_comes_back_to() -> None:
    there_and_back = aims("{twist: 0.5}", "{twist: 0.2}")
    key = "schedule.0.twist"  # which is what the state has gone through
    assert there_and_back.holds(key, 0.5, at(twist=0.2))
    assert not there_and_back.holds(key, 0.5, at(twist=0.5))
    assert there_and_back.is_end(at(twist=0.2), [key])
    assert not there_and_back.is_end(at(twist=0.5), [key])
    assert there_and_back.holds("ends.span", 0.6, at(twist=0.5))
    assert not there_and_back.holds("ends.span", 0.6, at(twist=0.2, span=0.5))
    assert aims("{span: 0.5}").holds("ends.span", 0.6, at(span=0.5))  # which the schedule moves


def test_a_key_of_a_branch_is_no_key_of_its_start() -> None:
    followed = aims("{shear: 0.1}", "{arclength: {parameter: twist, to: 1, at: [0.3]}}")
    start, met = at(shear=0.1), at(shear=0.1, twist=0.3)
    assert not followed.is_end(start, ["schedule.1.arclength.to"])
    assert followed.is_end(met, ["schedule.1.arclength.to"])
    assert not followed.holds("schedule.1.arclength.to", 1.0, start)
    assert followed.holds("schedule.0.shear", 0.1, start)
    assert not followed.missed([start])


def test_a_mesh_that_was_not_reached_is_missed() -> None:
    config = parse_config(SCHEDULE % "{shear: 0.1}" + "refinement: [12, 24]", "legs.yaml")
    coarse = at(shear=0.1)
    assert Aims.of_config(config).missed([coarse])
    assert not Aims.of_config(config).missed([coarse, replace(coarse, segments=24)])


def test_a_state_continued_to_another_width_leaves_its_point(tmp_path: Path) -> None:
    (tmp_path / "fam.yaml").write_text(SWEEP)
    sweep = load_sweep(tmp_path / "fam.yaml")
    keep_sweep(tmp_path, sweep)
    solve_config(sweep.points[0].config, tmp_path)
    ribbon("continue", f"{sweep.points[0].run}:1", "--to", "0.12", "--runs", str(tmp_path))
    rows = gathered(sources(tmp_path, ["fam"]))
    widths = [(row["initial_guess.half_width"], row["half_width"]) for row in rows.rows]
    assert widths == [(0.1, 0.1), (None, 0.12)]
    assert rows.missed == ("fam: 5 of 6 points not run yet",)
    data = ribbon_cli.open_sweep("fam", tmp_path).to_xarray()
    assert data["energy"].dims[-1] == "initial_guess.half_width"
    assert int(data["energy"].notnull().sum()) == 1

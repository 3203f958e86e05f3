"""Pictures over runs and sweeps: fields of their table, and shapes beside each other."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from cli_support import ribbon
from table_runs import fill

import ribbon_cli
from ribbon_cli.errors import UsageError
from ribbon_cli.plot.fields import Choice, axis_text, chosen, curves, fields_figure
from ribbon_cli.plot.figure import find_style
from ribbon_cli.plot.style import MOST_LOOKS
from ribbon_cli.report.rows import Column, Rows


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return fill(tmp_path_factory.mktemp("runs"))


COLUMNS = (
    *(Column("initial_guess.half_width", "float64"), Column("topology.half_twists", "int64")),
    *(Column("initial_guess.recipe", "utf-8"), Column("segments", "int64"), Column("energy", "float64")),
    *(Column("certified", "bool"), Column("run", "utf-8")),
)
KEYS = ("topology.half_twists", "initial_guess.recipe", "initial_guess.half_width", "segments")


def row(b: float, n: int, segments: int = 12, energy: float | None = None, certified: bool = True) -> dict:
    recipe = "twist" if n else "cylinder"
    value = 10 * n + b if energy is None else energy
    values = (b, n, recipe, segments, value, certified, f"run-{b}-{n}")
    return {column.name: part for column, part in zip(COLUMNS, values, strict=True)}


def rows(*found: dict) -> Rows:
    return Rows(COLUMNS, found, (), KEYS)


GRID = rows(*(row(b, n) for n in (0, 1) for b in (0.3, 0.1, 0.2)))


def test_what_is_left_open_follows_from_what_varies() -> None:
    found = chosen(GRID, Choice())
    assert (found.of.name, found.over.name) == ("energy", "initial_guess.half_width")
    assert [column.name for column in found.by] == ["topology.half_twists"]  # with which the recipe goes
    assert found.title.startswith("Energy over initial_guess.half_width, a curve for each")


def test_a_curve_for_each_value_in_order() -> None:
    found = curves(GRID, chosen(GRID, Choice()))
    assert [name for name, _ in found] == [(0,), (1,)]
    for (n,), points in found:
        assert [p["initial_guess.half_width"] for p in points] == [0.1, 0.2, 0.3]
        assert [p["energy"] for p in points] == pytest.approx([10 * n + b for b in (0.1, 0.2, 0.3)])


def test_of_several_states_the_finest_certified_one_is_drawn() -> None:
    table = rows(
        row(0.1, 0, 12, 1.0),
        row(0.1, 0, 24, 2.0, certified=False),
        row(0.1, 0, 24, 3.0),
        row(0.2, 0, 12, 5.0),
    )
    ((_, points),) = curves(table, chosen(table, Choice(by=())))
    assert [p["energy"] for p in points] == [3.0, 5.0]
    by_mesh = curves(table, chosen(table, Choice(by=("segments",))))
    assert [len(points) for _, points in by_mesh] == [2, 1]


def test_figures_have_a_line_for_each_curve_and_open_marks() -> None:
    table = rows(row(0.1, 0), row(0.2, 0, certified=False), row(0.1, 1), row(0.2, 1))
    figure = fields_figure(table, chosen(table, Choice()), find_style("paper"))
    (axes,) = figure.axes
    drawn = [line for line in axes.lines if line.get_marker() in ("", "None")]
    assert [list(line.get_xdata()) for line in drawn] == [[0.1, 0.2], [0.1, 0.2]]
    open_marks = [line for line in axes.lines if line.get_markerfacecolor() == "white"]
    assert sum(len(line.get_xdata()) for line in open_marks) == 1
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == [
        *("half twists = 0", "half twists = 1", "no certificate"),
    ]
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("$b$", "$E$")


def test_open_marks_have_no_certificate_however_many_curves_there_are() -> None:
    table = rows(*(row(b, n) for n in range(MOST_LOOKS) for b in (0.1, 0.2)), row(0.3, 9, certified=False))
    figure = fields_figure(table, chosen(table, Choice()), find_style("paper"))
    found = [line for line in figure.axes[0].lines if line.get_markerfacecolor() == "white"]
    found = [line for line in found if line.get_marker() not in ("", "None") and len(line.get_xdata())]
    assert [list(line.get_xdata()) for line in found] == [[0.3]]
    entries = [line for line in figure.legends[0].get_lines() if line.get_markerfacecolor() == "white"]
    assert [line.get_label() for line in entries] == ["no certificate"]


def test_columns_by_their_last_word_and_keys_of_schedules_whole() -> None:
    names = ("ends.twist", "kkt_residual", "segments", "parameter_twist", "schedule.0.twist.to", "widths.0")
    assert [axis_text(name) for name in names] == [
        *("twist", "kkt residual", "$N$", "twist", "schedule.0.twist.to", "widths.0"),
    ]


@pytest.mark.parametrize(
    ("choice", "message"),
    [
        (Choice(of="enrgy"), "did you mean energy"),
        (Choice(of="run"), "not a number: it cannot be drawn"),
        (Choice(over="initial_guess.recipe"), "--by takes it"),
        (Choice(by=("half_width",)), "no column 'half_width'"),
    ],
)
def test_columns_that_cannot_be_drawn_are_refused(choice: Choice, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        chosen(GRID, choice)


def test_too_many_curves_are_refused() -> None:
    table = rows(*(row(b, n) for n in range(40) for b in (0.1, 0.2)))
    with pytest.raises(UsageError, match="tells 28 curves apart, and there are 40"):
        curves(table, chosen(table, Choice()))


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["fam", "shape"], "fam is a sweep: of sweeps there are table and shapes"),
        (["ring", "shape", "--of", "energy"], "--of goes with the kind table"),
        (["fam", "shapes", "--by", "energy"], "--by goes with the kind table"),
        (["ring", "branch", "--where", "energy < 5"], "--where goes with the kinds table and shapes"),
        (["fam", "table", "--where", "energy < 0"], "no equilibria to draw where energy < 0"),
        (["fam", "table", "--segments", "12"], "--segments does nothing for table"),
    ],
)
def test_options_that_do_nothing_are_refused(root: Path, words: list[str], message: str) -> None:
    done = ribbon("plot", *words, "--runs", str(root))
    assert (done.exit_code, message in done.stderr) == (2, True), done.stderr


def test_pictures_of_a_sweep(root: Path, tmp_path: Path) -> None:
    for words in (["table", "--of", "eigenvalue_1"], ["shapes", "--where", "initial_guess.half_width < 0.5"]):
        path = tmp_path / f"{words[0]}.svg"
        done = ribbon("plot", "fam", *words, "-o", str(path), "--runs", str(root))
        assert done.exit_code == 0, done.stderr
        assert path.read_text().startswith("<?xml")
    assert "4 of 4 certified" in done.stderr
    assert "b = 0.2" in done.stderr
    assert "$" not in done.stderr


def test_the_door_for_programs_draws_the_same(root: Path) -> None:
    sweep = ribbon_cli.open_sweep("fam", root)
    figure = sweep.plot(of="energy", by=["discretisation"], caption=False)
    lines = [line for line in figure.axes[0].lines if line.get_linestyle() != "None"]
    assert [list(line.get_xdata()) for line in lines] == [[0.1, 0.2, 1.0], [0.1, 0.2]]
    assert all(np.diff(line.get_ydata()).min() > 0 for line in lines)
    with pytest.raises(UsageError, match="sweeps have the kinds table and shapes"):
        sweep.plot("branch")


def test_runs_beside_each_other_are_one_table(root: Path, tmp_path: Path) -> None:
    path = tmp_path / "both.svg"
    words = ["ring", "table", "--with", "fam", "--over", "half_width", "--by", "run", "-o", str(path)]
    done = ribbon("plot", *words, "--runs", str(root))
    assert done.exit_code == 0, done.stderr
    assert "6 runs, 9 states" in done.stderr

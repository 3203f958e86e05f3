"""No two curves of a picture look alike, whatever its kind; widths in millimetres, titles, several runs."""

from __future__ import annotations

import re
from dataclasses import replace
from itertools import combinations
from pathlib import Path
from typing import Any

import pytest
from cli_support import ribbon, ribbon_json
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.legend import Legend
from matplotlib.lines import Line2D
from picture_support import run_named, solved, states_of  # noqa: F401
from PIL import Image
from resting_support import resting_record
from store_support import make_summary

from ribbon_cli.errors import UsageError
from ribbon_cli.plot.branches import arclength_figure
from ribbon_cli.plot.fields import Choice
from ribbon_cli.plot.figure import dressed
from ribbon_cli.plot.kinds import KINDS, Source, draw
from ribbon_cli.plot.labels import panel_titles
from ribbon_cli.plot.levels import convergence_figure
from ribbon_cli.plot.modes import ModeShape
from ribbon_cli.plot.runs import MOST_RUNS, runs_figure
from ribbon_cli.plot.style import MOST_LOOKS, STYLES, branch_look, line_look, marked_look, of_width, styled
from ribbon_cli.report.convergence import Entry, Table, convergence_rows
from ribbon_cli.report.rows import Column, Rows
from ribbon_cli.store import Summary

STYLE = STYLES["paper"]
LATER = ("shapes", "table", "spectrum")
"""Kinds that take long to be drawn, and whose letters are those of other kinds."""


def look(line: Line2D) -> tuple[str, str, str, str]:
    """Colour, marker, dashes and fill of a curve."""
    marker = str(line.get_marker()).replace("None", "")
    fill = to_hex(line.get_markerfacecolor()) if marker and line.get_fillstyle() != "none" else ""
    return to_hex(line.get_color()), marker, repr(line._dash_pattern), fill


def curves(axes: Axes) -> list[Line2D]:
    """The labelled curves of a panel."""
    return [line for line in axes.get_lines() if not str(line.get_label()).startswith("_")]


def assert_told_apart(figure: Figure, grey: bool = False) -> int:
    """Labelled curves of a panel, and entries of a legend, differ two by two; the most that there are."""
    legends = [legend for legend in (*figure.legends, *(a.get_legend() for a in figure.axes)) if legend]
    most = 0
    for lines in (*map(curves, figure.axes), *map(Legend.get_lines, legends)):
        most = max(most, len(lines))
        for one, other in combinations(lines, 2):
            assert look(one)[grey:] != look(other)[grey:], (one.get_label(), other.get_label())
    return most


def widths(count: int) -> Table:
    """A table of so many half-widths at three N."""
    return convergence_rows(
        Entry(0.1 + 0.01 * k, 50 * 2**j, 5.0 + k - 0.1 / 4**j, True, 3 * k + j)
        for k in range(count)
        for j in range(3)
    )


def course(name: str, b: float, **more: Any) -> list[Summary]:
    """A branch of four points from b on."""
    like = {"energy": 2.0 + b, "clearance": 0.1, "negative_eigenvalues": 0, "segments": 24} | more
    first = make_summary(**like)
    return [replace(first, label=k + 1, half_width=b + 0.1 * k) for k in range(4)]


def source_of(kind: str, root: Path) -> Source:
    """What a kind shows when it shows as much as it can."""
    run, states = run_named(root, "mobius"), states_of(root, "mobius")
    state = states[-1]
    many = tuple(replace(state, half_width=0.1 + 0.01 * k) for k in range(MOST_LOOKS))
    shown = () if kind in ("convergence", "branch", "family") else many
    shown = (state,) if kind in ("pattern", "mode") else shown
    shown = (resting_record("pi-b1.65-N100"),) if kind == "contacts" else shown

    def curves_of(record: Any) -> Any:
        raise UsageError("none")

    def mode_of(record: Any) -> ModeShape:
        move = 0.01 * record.u[:, [0, 1, 2, 0, 1, 2, 0]]
        return ModeShape(4, 1.0, 0.1, "physical metric", "mode", (), "", move)

    names = ("half_width", "energy", "segments", "run")
    lines = [(0.1 * k, 1.0 + k * n, n, "mobius") for n in range(MOST_LOOKS) for k in range(3)]
    rows = Rows(
        tuple(Column(name, "float64") for name in names),
        tuple(dict(zip(names, line, strict=True)) for line in lines),
    )
    return Source(
        run,
        shown,
        lambda run: widths(MOST_LOOKS),
        curves_of,
        mode_of,
        names=("state",) * len(shown),
        rows=rows,
        choice=Choice("energy", "half_width", ("segments",)),
    )


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind not in ("shape", "mode")])
def test_no_two_curves_of_any_kind_look_alike(kind, solved):  # noqa: F811
    figure = draw(kind, source_of(kind, solved), STYLE).figure
    most = assert_told_apart(figure)
    if kind in ("geometry", "multipliers", "spectrum", "convergence"):
        assert most >= MOST_LOOKS


def test_curves_are_told_apart_in_grey(solved):  # noqa: F811
    for kind in ("geometry", "spectrum", "convergence"):
        assert_told_apart(draw(kind, source_of(kind, solved), STYLE).figure, grey=True)


def test_sequences_of_looks_do_not_repeat():
    for sequence in (marked_look, lambda k: line_look(k, 100)):
        looks = [look(Line2D([], [], **sequence(k))) for k in range(MOST_LOOKS)]
        assert len({found[1:] for found in looks}) == MOST_LOOKS
        assert len({found[0] for found in looks[:7]}) == 7
    assert len({look(Line2D([], [], **branch_look(k))) for k in range(MOST_LOOKS)}) == MOST_LOOKS


def test_branches_are_told_apart_where_they_lie_on_each_other():
    """Dashes say how stable a branch is; colours and marks, at different points, which it is."""
    figure = arclength_figure({f"branch {k}": course("x", 0.1) for k in range(MOST_LOOKS)}, {}, STYLE)
    assert_told_apart(figure)
    names = [text.get_text() for text in figure.legends[0].get_texts()]
    assert names[:2] == ["1 branch 0", "2 branch 1"]
    marked = [line for line in figure.axes[0].get_lines() if line.get_marker() not in ("", "None")]
    assert len({look(line) for line in marked}) == MOST_LOOKS


def test_convergence_of_fourteen_widths_shows_all_and_of_many_says_which_it_lacks(solved):  # noqa: F811
    assert assert_told_apart(convergence_figure(widths(14), STYLE)) == 14
    source = replace(source_of("convergence", solved), table=lambda run: widths(MOST_LOOKS + 2))
    picture = draw("convergence", source, STYLE)
    assert len(curves(picture.figure.axes[0])) == MOST_LOOKS
    assert re.search(r", 28 of 30 half-widths, without b = 0\.\d+, 0\.\d+$", picture.title)


def test_too_many_states_are_refused(solved):  # noqa: F811
    source = source_of("geometry", solved)
    more = replace(source, states=(*source.states, source.states[0]))
    for kind in ("geometry", "multipliers", "spectrum"):
        with pytest.raises(UsageError, match=f"{kind} tells 28 states apart, and 29 are named"):
            draw(kind, more, STYLE)


def test_titles_of_shapes_say_what_differs(solved):  # noqa: F811
    state, twist = states_of(solved, "mobius")[-1], states_of(solved, "mobius", "auxiliary")[-1]
    three = replace(state, half_twists=-3)
    for records, runs, titles in (
        ([state, three], ("one", "two"), ["π band", "−3π band"]),
        ([state, state], ("one", "two"), ["one", "two"]),
        ([state, replace(state, half_width=0.3)], (), ["$b$ = 0.2", "$b$ = 0.3"]),
        ([three, replace(state, segments=24)], (), ["−3π band, $N$ = 48", "π band, $N$ = 24"]),
        ([state, replace(twist, half_width=0.2, segments=48)], (), ["equilibrium", "twist 10/10"]),
        ([state, replace(state, label=99)], (), [f"state {state.label}", "state 99"]),
        (
            [state, replace(state, half_width=0.3, certified=False)],
            (),
            ["$b$ = 0.2", "$b$ = 0.3, no certificate"],
        ),
    ):
        found = panel_titles(records, runs, 14)
        assert [title.replace("\n", ", ") for title in found] == titles


# --- widths and titles ---


@pytest.mark.parametrize(
    ("kind", "width"),
    [
        pytest.param(kind, width, marks=pytest.mark.long if width == 178 or kind in LATER else ())
        for kind in KINDS
        for width in (86, 178)
    ],
)
def test_a_picture_is_as_wide_as_asked_and_its_letters_legible(kind, width, solved):  # noqa: F811
    style = of_width(STYLE, width)
    source = source_of(kind, solved)
    if kind in ("shape", "geometry", "multipliers", "spectrum"):
        source = replace(source, states=source.states[:3])
    figure = dressed(draw(kind, source, style).figure, style, "A caption of some length. " * 6, "A title")
    assert figure.get_figwidth() * 25.4 == pytest.approx(width, rel=1e-12)
    with styled(style):  # ticks are chosen by the style's letters
        figure.draw_without_rendering()
        page = figure.bbox
        for text in figure.findobj(lambda artist: hasattr(artist, "get_fontsize") and artist.get_visible()):
            if not text.get_text():
                continue
            assert text.get_fontsize() >= 6.0
        for axes in figure.axes:
            box = axes.get_tightbbox()
            if box is not None and axes.axison:
                assert page.x0 - 1 <= box.x0
                assert box.x1 <= page.x1 + 1
        for legend in figure.legends:
            box = legend.get_window_extent()
            assert page.x0 <= box.x0
            assert box.x1 <= page.x1
            assert all(not axes.get_window_extent().overlaps(box) for axes in figure.axes)


@pytest.mark.long
def test_files_are_as_wide_as_asked(solved, tmp_path):  # noqa: F811
    words = ("plot", "mobius", "family", "--width", "86", "--title", "Bands: $5 & _{", "--runs", solved)
    for form in ("svg", "pdf", "png"):
        assert ribbon(*words, "-o", tmp_path / f"x.{form}").exit_code == 0
    svg = (tmp_path / "x.svg").read_text(encoding="utf-8")
    assert float(re.search(r'width="([\d.]+)pt"', svg)[1]) == pytest.approx(86 / 25.4 * 72, abs=1e-5)
    assert "<dc:title>Bands: $5 &amp; _{</dc:title>" in svg
    assert svg.count("Bands: $5 &amp; _{") >= 2
    box = re.search(rb"/MediaBox \[ 0 0 ([\d.]+) ", (tmp_path / "x.pdf").read_bytes())
    assert float(box[1]) == pytest.approx(86 / 25.4 * 72, abs=1e-6)
    with Image.open(tmp_path / "x.png") as image:
        assert image.width / image.info["dpi"][0] * 25.4 == pytest.approx(86, abs=25.4 / 300)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (
            ("mobius", "family", "--width", "30"),
            "--width 30: a picture in the style paper is 51 to 1000 mm wide",
        ),
        (("mobius", "family", "--width", "86", "--style", "talk"), "in the style talk is 96 to 1000 mm wide"),
        (("mobius", "family", "--width", "nan"), "--width nan: a picture in the style paper is 51 to"),
        (("mobius", "family", "--width", "8.6cm"), "--width 8.6cm: expected a number of millimetres"),
        (("mobius@b=0.2,N=48", "mode", "--width", "86", "-o", "x.gif"), "--width does nothing for a film"),
        (("mobius", "family", "--title", " "), "--title is empty"),
        (("mobius", "branch", "--with", "mobius"), "--with names a run that is there already"),
        (("mobius:1", "branch", "--with", "ring"), "branch shows runs: name the run of mobius:1"),
        (("mobius", "branch", "--with", "ring:1"), "--with needs a run beside a run"),
        (("mobius", "branch", "--with", "ring", "--segments", "25"), "has no equilibrium with N = 25"),
    ],
)
def test_what_cannot_be_had_is_refused_in_one_line(words, message, solved, tmp_path, monkeypatch):  # noqa: F811
    monkeypatch.chdir(tmp_path)
    result = ribbon("plot", *words, "--runs", solved)
    assert result.exit_code == 2
    assert message in result.stderr
    assert result.stderr.count("\n") == 1
    assert not list(tmp_path.iterdir())


# --- runs beside each other ---


def test_a_branch_beside_another_runs_names_both(solved, tmp_path):  # noqa: F811
    path = tmp_path / "x.svg"
    document = ribbon_json("plot", "mobius", "branch", "--with", "ring", "-o", path, "--runs", solved)
    mobius, ring = run_named(solved, "mobius"), run_named(solved, "ring")
    assert document["caption"] == (
        f"{mobius.name}, N = 48 (2 of 2 certified); {ring.name}, N = 24 (2 of 2 certified)"
    )
    source = Source(mobius, (), pytest.fail, pytest.fail, beside=(ring,))
    figure = draw("branch", source, STYLE).figure
    entries = [text.get_text().replace("\n", ", ") for text in figure.legends[0].get_texts()]
    assert entries == ["mobius, π band, $N$ = 48", "ring, untwisted, $N$ = 24"]
    (axes,) = figure.axes
    drawn = {tuple(line.get_ydata()) for line in axes.get_lines()}
    for run, n in ((mobius, 48), (ring, 24)):
        assert tuple(s.energy for s in run.states() if s.segments == n) in drawn
    assert_told_apart(figure, grey=True)


def test_runs_in_one_panel_say_what_is_not_certified_or_touches():
    names = [f"run {k}" for k in range(MOST_RUNS)]
    runs = [[course("x", 0.1 * k)] for k in range(MOST_RUNS)]
    figure = runs_figure(names, ["π band"] * MOST_RUNS, runs, STYLE)
    assert [text.get_text() for text in figure.legends[0].get_texts()] == names
    assert_told_apart(figure, grey=True)
    bad = course("x", 0.3, certified=False, self_contact=True, negative_eigenvalues=1)
    figure = runs_figure(names[:2], ["π band"] * 2, [runs[0], [bad]], STYLE)
    entries = [text.get_text() for text in figure.legends[0].get_texts()]
    assert entries == ["run 0", "run 1", "stable", "index 1", "no certificate", "self-contact"]

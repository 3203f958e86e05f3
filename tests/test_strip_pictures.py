"""Pictures of open strips: supports, both ends, parameters in captions, axes and legends."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cli_support import ribbon, ribbon_json
from matplotlib.collections import PolyCollection
from picture_support import run_named, states_of
from strip_runs import strips

import ribbon_cli as ribbon_api
from ribbon_cli import analysis, plot
from ribbon_cli.export.mesh import facet_corners
from ribbon_cli.export.series import along, branch, courses, levels
from ribbon_cli.export.view import chosen_view, strip_axes
from ribbon_cli.pages.run import run_page
from ribbon_cli.parts import Ends, Loads, Parts
from ribbon_cli.plot.branches import arclength_figure
from ribbon_cli.plot.canvas import Figure
from ribbon_cli.plot.kinds import Source
from ribbon_cli.plot.labels import band_text, place_texts
from ribbon_cli.plot.modes import displaced
from ribbon_cli.plot.pictures import Panel, family_figure, shapes_figure
from ribbon_cli.plot.shape import draw_shape
from ribbon_cli.plot.style import STYLES
from ribbon_cli.plot.supports import plates
from ribbon_cli.store import Run, StateRecord

__all__ = ["strips"]
PAPER = STYLES["paper"]


def last(root: Path, name: str) -> StateRecord:
    return states_of(root, name)[-1]


def source(root: Path, name: str, *states: StateRecord, beside: tuple[str, ...] = ()) -> Source:
    return Source(
        run_named(root, name),
        states,
        analysis.run_table,
        analysis.multiplier_curves,
        beside=tuple(run_named(root, other) for other in beside),
    )


def draw(kind: str, given: Source) -> plot.kinds.Picture:
    return plot.kinds.draw(kind, given, PAPER)


def test_clamps_are_plates_beyond_the_strip_along_its_rulings(strips: Path) -> None:
    record = last(strips, "sheared")
    start, end = plates(record)
    assert start[:, 0].max() == pytest.approx(0.0, abs=1e-12)
    assert start[:, 0].min() < 0.0
    assert end[:2].mean(axis=0) == pytest.approx(record.midline[-1])
    assert end[2:, 0].min() > record.midline[-1, 0]
    assert np.cross(end[1] - end[0], record.g_end) == pytest.approx(np.zeros(3), abs=1e-12)
    assert len(plates(last(strips, "cantilever"))) == 1
    assert len(plates(last(strips, "branch"))) == 0


def test_a_turned_clamp_leads_away_along_its_tangent(strips: Path) -> None:
    ends = Ends(span=0.75, twist=0.5 * np.pi, tilt=0.5 * np.pi)
    turned = plates(replace(last(strips, "sheared"), parts=Parts(ends)))[1]
    away = turned[2:].mean(axis=0) - turned[:2].mean(axis=0)
    assert away / np.linalg.norm(away) == pytest.approx([0.0, 0.0, 1.0], abs=1e-12)


@pytest.mark.parametrize(
    ("name", "polygons", "pins"), [("sheared", 2, 0), ("cantilever", 1, 0), ("branch", 0, 2)]
)
def test_shapes_are_drawn_with_what_holds_them(strips: Path, name: str, polygons: int, pins: int) -> None:
    record = last(strips, name)
    axes = Figure().subplots()
    draw_shape(axes, record, PAPER)
    (painted,) = (item for item in axes.collections if isinstance(item, PolyCollection))
    plate = sum(tuple(np.round(c[:3], 3)) == (0.725, 0.725, 0.725) for c in painted.get_facecolor())
    assert plate == polygons
    assert sum(line.get_marker() == "o" for line in axes.lines) == pins


def test_curves_reach_the_end_and_a_held_ruling_has_no_multiplier(strips: Path) -> None:
    record = last(strips, "sheared")
    kappa = draw("geometry", source(strips, "sheared", record)).figure.axes[0].get_lines()[1]
    assert (len(kappa.get_xdata()), kappa.get_xdata()[-1]) == (record.segments + 1, record.length)
    assert kappa.get_ydata()[-1] == pytest.approx(kappa.get_ydata()[0], abs=1e-9)
    lambda_2 = draw("multipliers", source(strips, "sheared", record)).figure.axes[1].get_lines()[1]
    assert np.isnan(lambda_2.get_ydata()[0])
    assert np.isfinite(lambda_2.get_ydata()[1:]).all()


def test_captions_name_what_is_not_zero(strips: Path) -> None:
    caption = draw("shape", source(strips, "sheared", last(strips, "sheared"))).caption
    assert "b = 0.06, span = 0.75, shear = 0.06, N = 40, Tw + Wr = " in caption
    assert "lift" not in caption
    assert "Lk" not in caption
    assert (
        "end_force_y = 0.2" in draw("shape", source(strips, "cantilever", last(strips, "cantilever"))).caption
    )


def test_a_branch_has_the_axis_of_its_parameter(strips: Path) -> None:
    for name, parameter in (("sheared", "shear"), ("cantilever", "end force y"), ("branch", "span")):
        picture = draw("branch", source(strips, name))
        panels = 4 if name == "branch" else 3
        assert [axes.get_xlabel() for axes in picture.figure.axes] == [parameter] * panels
        assert picture.figure.axes[0].get_title(loc="left") == "$E$"
        assert parameter in picture.title


def test_a_branch_between_ends_shows_the_force_across(strips: Path) -> None:
    """Sides of a branch point that are each other's image have one energy and opposite forces."""
    (points,) = courses(run_named(strips, "branch")).values()
    forces = [3.0 * (-1) ** k for k, _ in enumerate(points)]
    moved = [
        replace(point, reaction_force=(0.0, force, 0.0)) for point, force in zip(points, forces, strict=True)
    ]
    for given, panels in ((moved, 4), ([replace(moved[0], reaction_force=None), *moved[1:]], 3)):
        figure = arclength_figure({"up": given}, {}, PAPER, "span")
        assert len(figure.axes) == panels
        if panels == 4:
            drawn = np.concatenate([line.get_ydata() for line in figure.axes[3].get_lines()[:-1]])
            assert set(drawn) == set(forces)


def test_a_branch_does_not_mix_problems(strips: Path) -> None:
    """The leg in the half-width is of other problems than that in shear."""
    parameter, states = along(branch(run_named(strips, "sheared"), 20))
    assert parameter == "shear"
    assert {state.half_width for state in states} == {0.05}
    for group in levels(run_named(strips, "sheared")):
        assert len({(state.half_width, state.parameters["shear"]) for state in group}) == 1


def test_runs_in_one_diagram_share_their_parameter(strips: Path) -> None:
    result = ribbon("plot", "sheared", "branch", "--with", "branch", "--runs", strips)
    assert result.exit_code == 2
    assert "branch has one axis" in result.stderr


def test_convergence_tells_the_place(strips: Path) -> None:
    picture = draw("convergence", source(strips, "sheared"))
    labels = picture.figure.axes[0].get_legend_handles_labels()[1]
    assert any("shear = " in label for label in labels)


def test_labels_tell_states_by_their_parameters(strips: Path) -> None:
    states = branch(run_named(strips, "cantilever"))
    assert place_texts(states)[-1] == "end force y = 0.2"
    assert band_text(0, 0) == "strip"


def test_a_strip_is_seen_in_its_start_s_frame_with_its_weight_downwards(strips: Path) -> None:
    record = last(strips, "sheared")
    for direction in ((0.0, -1.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, -1.0), (0.36, 0.48, 0.8)):
        loads = Loads(gravity_direction=direction)
        axes = strip_axes(replace(record, parts=replace(record.parts, loads=loads)))
        np.testing.assert_allclose(axes[1], -np.array(direction), atol=1e-12)
        np.testing.assert_allclose(np.linalg.inv(axes), axes.T, atol=1e-12)
        assert np.linalg.det(axes) == pytest.approx(1.0)
    view = chosen_view(facet_corners(record), (0.0, 0.0), strip_axes(record))
    np.testing.assert_allclose(view.axes, np.eye(3), atol=1e-12)
    # Not turned onto each other: clamps stay where they are.
    figure = shapes_figure([Panel(record, "a"), Panel(record, "b")], PAPER, aligned=True, angles=(0.0, 0.0))
    assert figure.axes[0].get_xlim() == figure.axes[1].get_xlim()


def test_titles_of_a_family_fit_their_shapes_in_the_order_of_the_schedule(strips: Path) -> None:
    picture = draw("family", source(strips, "sheared"))
    titles = [axes.get_title() for axes in picture.figure.axes]
    assert [title.replace("\n", ", ") for title in titles] == [
        "$b$ = 0.05, shear = 0",
        "$b$ = 0.05, shear = 0.03",
        "$b$ = 0.05, shear = 0.06",
        "$b$ = 0.06, shear = 0.06",
    ]
    record, length = last(strips, "sheared"), 0.123456
    moved = [replace(record, parts=Parts(Ends(span=length + k, shear=length + k))) for k in range(4)]
    assert [axes.get_title().count("\n") for axes in family_figure(moved, PAPER).axes] == [1] * 4


def test_a_mode_moves_no_clamp(strips: Path) -> None:
    record = last(strips, "sheared")
    found = analysis.stability_of(record, modes=1)
    moved = displaced(record, found.vectors[0], 0.1)
    np.testing.assert_array_equal(moved.g[0], record.g[0])
    np.testing.assert_allclose(moved.g_end, record.g_end, atol=1e-12)
    np.testing.assert_allclose(moved.midline[[0, -1]], record.midline[[0, -1]], atol=1e-9)


def test_notions_of_closed_bands_alone_are_refused_in_a_line(strips: Path) -> None:
    result = ribbon("verify", "sheared:3", "--continuum", "--runs", strips)
    assert result.exit_code == 2
    assert "a strip with ends" in result.stderr
    with pytest.raises(Exception, match="a strip with ends"):
        analysis.multiplier_curves(last(strips, "sheared"))


def test_show_says_what_a_strip_is(strips: Path) -> None:
    shown = ribbon_json("show", "sheared:3", "--runs", strips, "--json")
    assert shown["topology"] == {"open": True}
    assert shown["parameters"]["shear"] == 0.06
    words = ribbon("show", "sheared:3", "--runs", strips).stdout
    assert "twist_plus_writhe" in words
    assert "linking" not in words
    listed = ribbon("ls", "sheared", "--runs", strips).stdout
    assert "Tw + Wr" in listed
    assert "Lk" not in listed


@pytest.mark.parametrize(
    ("name", "parameter"),
    [
        ("cantilever", "end_force_y"),
        pytest.param("sheared", "shear", marks=pytest.mark.long),
        pytest.param("branch", "span", marks=pytest.mark.long),
    ],
)
def test_pages_show_parameters_and_no_linking_number(strips: Path, name: str, parameter: str) -> None:
    page = run_page(run_named(strips, name)).decode()
    assert f">{parameter}</th>" in page or name == "branch"
    assert "Tw + Wr found" in page
    assert ">Lk<" not in page


def test_a_page_names_what_was_not_reached(strips: Path, tmp_path: Path, monkeypatch) -> None:
    for part in ("_shapes", "_pictures", "_convergence"):  # which take seconds to draw
        monkeypatch.setattr(f"ribbon_cli.pages.run.{part}", lambda *_: [])
    run = Run(shutil.copytree(run_named(strips, "cantilever").path, tmp_path / "cantilever-00000000"))
    last = run.states()[-1]
    with run.writing():
        run.remove_states((last.label,), ())
        run.log_event("ended", exit_code=3, missed=[[last.half_width, last.segments]])
    page = run_page(run).decode()
    assert '<p class="no">1 of 3 targets not reached: end_force_y = 0.2.</p>' in page


def test_notebooks_show_parameters_and_no_linking_number(strips: Path) -> None:
    run = ribbon_api.open("sheared", runs=strips)
    html = run._repr_html_()
    assert ">shear</th>" in html
    assert "Tw + Wr" in html
    assert "shear = 0.06" in run.state(3)._repr_html_()

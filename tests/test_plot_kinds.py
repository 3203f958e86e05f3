"""`ribbon plot` and `ribbon report`, on small runs."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cli_support import ribbon, ribbon_json
from matplotlib.figure import Figure
from picture_support import run_named, solved, states_of  # noqa: F401

from ribbon_cli.cli.export_command import EXPORT_FORMATS
from ribbon_cli.cli.plot_command import PLOT_KINDS
from ribbon_cli.errors import UsageError
from ribbon_cli.export.formats import FORMATS
from ribbon_cli.plot.branches import _tame
from ribbon_cli.plot.curves import geometry_figure
from ribbon_cli.plot.figure import add_caption, state_caption
from ribbon_cli.plot.kinds import KINDS, Source, draw
from ribbon_cli.plot.levels import lowest_value
from ribbon_cli.plot.pictures import Panel, shapes_figure
from ribbon_cli.plot.style import STYLES, styled

ROOT = Path(__file__).parent.parent
OF_A_STATE = ("shape", "geometry", "multipliers", "spectrum", "mode", "pattern")
OF_A_RUN = ("geometry", "multipliers", "spectrum", "convergence", "branch", "family")


def test_help_names_what_there_is():
    assert tuple(KINDS) == PLOT_KINDS
    assert {"npz", *FORMATS} == set(EXPORT_FORMATS)


@pytest.mark.parametrize(
    ("ref", "kind"),
    [*(("mobius@b=0.2,N=48", kind) for kind in OF_A_STATE), *(("mobius", kind) for kind in OF_A_RUN)],
)
def test_every_kind_is_drawn(ref, kind, solved, tmp_path):  # noqa: F811
    path = tmp_path / "picture.svg"
    words = ("plot", ref, kind, "-o", path, "--runs", solved)
    document = ribbon_json(*words)
    assert document["path"] == str(path)
    assert document["run"] == run_named(solved, "mobius").name
    first = path.read_text(encoding="utf-8")
    # The caption says what is shown, in the picture and in the file's own words.
    assert document["run"] in first
    assert re.search(r"<dc:title>\w", first)


def test_shapes_in_a_row_are_named_by_what_differs(solved, tmp_path):  # noqa: F811
    """Auxiliary states, where they need it, by their stages; the caption names all of them."""
    path = tmp_path / "row.svg"
    words = ("plot", "mobius:5", "shape", "--with", "mobius:10", "--with", "mobius@b=0.2,N=48", "-o", path)
    document = ribbon_json(*words, "--runs", solved)
    assert document["labels"][:2] == [5, 10]
    assert len(document["labels"]) == 3
    text = path.read_text(encoding="utf-8")
    for stage in ("twist 5/10", "twist 10/10"):
        assert stage in text
    assert "refined to" not in text


@pytest.mark.long
def test_the_same_picture_has_the_same_bytes(solved, tmp_path):  # noqa: F811
    for form in ("pdf", "svg", "png"):
        paths = [tmp_path / f"{k}.{form}" for k in range(2)]
        for path in paths:
            assert ribbon("plot", "ring:1", "geometry", "-o", path, "--runs", solved).exit_code == 0
        assert paths[0].read_bytes() == paths[1].read_bytes()


@pytest.mark.parametrize("form", ["pdf", "png"])
@pytest.mark.parametrize("style", ["paper", "talk"])
def test_formats_and_styles(form, style, solved, tmp_path):  # noqa: F811
    path = tmp_path / f"picture.{form}"
    result = ribbon("plot", "ring@b=0.5,N=24", "shape", "--style", style, "-o", path, "--runs", solved)
    assert result.exit_code == 0
    assert result.stdout.strip() == str(path)
    assert "certified minimum" in result.stderr
    assert path.read_bytes()[:4] == {"pdf": b"%PDF", "png": b"\x89PNG"}[form]


def test_a_caption_can_be_left_out(solved, tmp_path):  # noqa: F811
    path = tmp_path / "picture.svg"
    ribbon("plot", "ring:1", "shape", "--no-caption", "-o", path, "--runs", solved)
    assert "<text" in path.read_text(encoding="utf-8")
    assert not re.search(r"<text[^>]*>Shape\.", path.read_text(encoding="utf-8"))


def test_several_states_on_one_picture(solved, tmp_path):  # noqa: F811
    words = ("plot", "mobius@b=0.1,N=24", "geometry", "--with", "mobius@b=0.1,N=48", "--runs", solved)
    document = ribbon_json(*words, "-o", tmp_path / "picture.svg")
    assert len(document["labels"]) == 2
    mixed = ribbon_json(*words[:-2], "--with", "ring:1", "--runs", solved, "-o", tmp_path / "mixed.svg")
    assert mixed["run"] is None


@pytest.mark.parametrize("ref", ["mobius:1", "mobius:4"])
def test_auxiliary_states_are_drawn(ref, solved, tmp_path):  # noqa: F811
    for kind in ("shape", "geometry", "multipliers"):
        assert ribbon("plot", ref, kind, "-o", tmp_path / f"{kind}.svg", "--runs", solved).exit_code == 0


def test_a_minimum_of_an_auxiliary_problem_is_not_called_one_of_the_band(solved, tmp_path):  # noqa: F811
    words = ("plot", "mobius:4", "shape", "--runs", solved, "-o")
    assert "no equilibrium of the band" in ribbon_json(*words, tmp_path / "one.svg")["caption"]
    adrift = replace(states_of(solved, "mobius", "auxiliary")[0], linking_number=float("nan"))
    assert "Lk" not in state_caption([adrift], "mobius")
    row = ribbon_json(*words, tmp_path / "row.svg", "--with", "mobius@b=0.2,N=48")
    assert row["caption"].endswith("(1 of 2 certified, 1 auxiliary)")
    page = tmp_path / "page.html"
    assert ribbon("export", "mobius:4", "--to", "html", "-o", page, "--runs", solved).exit_code == 0
    text = page.read_text(encoding="utf-8")
    assert "no equilibrium of the band" in text
    assert "certified minimum" not in text


def test_what_was_only_constructed_has_no_multipliers_to_draw(solved):  # noqa: F811
    record = states_of(solved, "mobius", "auxiliary")[0]
    made = replace(record, gamma=np.full(3, np.nan), status="constructed")
    source = Source(None, (made,), lambda run: pytest.fail("drawn"), lambda state: pytest.fail("drawn"))
    with pytest.raises(UsageError, match="has no multipliers: it was constructed, not solved for"):
        draw("multipliers", source, STYLES["paper"])


def test_no_curvature_is_drawn_where_the_band_is_cut(solved):  # noqa: F811
    """A closed band has a fold at node 1; of an open one what is stored there is of no fold."""
    (cut, *_), (closed, *_) = states_of(solved, "mobius", "auxiliary"), states_of(solved, "mobius")
    for record, gaps in ((cut, 1), (closed, 0)):
        with styled(STYLES["paper"]):
            axes = geometry_figure([record], STYLES["paper"]).axes
        curves = [line.get_ydata() for panel in axes for line in panel.lines if len(line.get_ydata()) > 2]
        assert [int(np.isnan(curve).sum()) for curve in curves] == [gaps, gaps, gaps, 0]


def test_a_far_eigenvalue_hides_no_loss_of_stability():
    """Two branches of ordinary values keep a linear scale; one that goes to -9000 does not flatten them."""
    for values, scale in (([0.01, -0.7, -0.04], "linear"), ([0.01, -0.7, -0.04, -9000.0], "asinh")):
        axes = Figure().subplots()
        axes.plot(values)
        axes.plot([0.02, np.nan, -0.03])
        _tame(axes)
        assert axes.get_yscale() == scale


@pytest.mark.parametrize("style", STYLES)
@pytest.mark.parametrize("count", [1, 2, 4])
@pytest.mark.parametrize("title", ["b = 0.3", "b = 0.3,\nrefined to N = 160"])
def test_titles_stay_inside_whatever_the_caption(style, count, title, solved):  # noqa: F811
    records = [*states_of(solved, "ring"), *states_of(solved, "mobius") * 2][:count]
    with styled(STYLES[style]):
        figure = shapes_figure([Panel(record, title) for record in records], STYLES[style], aligned=False)
        add_caption(figure, "A caption of some length. " * 6, STYLES[style])
        figure.draw_without_rendering()
    for axes in figure.axes:
        assert axes.title.get_window_extent().y1 <= figure.bbox.height


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("mobius", "shap"), "no kind of picture 'shap'"),
        (("mobius", "shape"), "shape shows one state: name one of mobius-"),
        (
            ("mobius:1", "shape", "--style", "papre"),
            "no style 'papre' (known: paper, talk); did you mean paper?",
        ),
        (("mobius:1", "shape", "-o", "x.jpg"), "a picture's file ends in .pdf, .svg or .png"),
        (
            ("mobius:1", "shape", "-o", "x.gif"),
            "only modes move; a picture's file ends in .pdf, .svg or .png",
        ),
        (("mobius@b=0.2,N=48", "mode", "-o", "x.jpg"), "a picture's file ends in .pdf, .svg, .png or .gif"),
        (("mobius@b=0.2,N=48", "shape", "--index", "4"), "--index goes with the kind mode"),
        (("ring@b=0.1,N=12", "mode", "--index", "60"), "--index 60: the state has 21 modes"),
        (("mobius", "mode"), "mode shows one state"),
        (("mobius:1", "mode"), "an auxiliary state, with prescribed rulings, has no spectrum"),
        (("mobius", "spectrum", "--with", "mobius:1"), "--with needs a run beside a run"),
        (("mobius:1", "shape", "--view", "12"), "expected two numbers of degrees"),
        (("mobius:1", "shape", "--view", "0,91"), "the elevation lies between"),
        (("mobius:1", "spectrum"), "state 1 has no spectrum: spectra are stored with equilibria"),
        (("mobius:1", "pattern"), "state 1 has an open seam"),
        (("mobius", "branch", "--segments", "25"), "has no equilibrium with N = 25: it has N = 24, 48"),
        (("mobius", "shape", "--with", "mobius:1"), "--with goes with a state"),
        (("mobius:1", "family", "--with", "mobius:2"), "--with does nothing for family, which shows a run"),
        (
            ("mobius", "geometry", "--view", "3,4"),
            "--view does nothing for geometry: it is for shape",
        ),
        (("mobius:1", "mode", "--segments", "24"), "--segments does nothing for mode: it is for geometry"),
        (("mobius", "spectrum", "--segments", "24"), "--segments does nothing for spectrum"),
        (("mobius:1", "geometry", "--segments", "24"), "--segments goes with a run"),
        (("mobius:1", "shape", "-o", "none/x.pdf"), "its folder does not exist: make it first, or choose"),
        (("nothing", "family"), "no run 'nothing'"),
    ],
)
def test_what_cannot_be_drawn(words, message, solved, tmp_path, monkeypatch):  # noqa: F811
    monkeypatch.chdir(tmp_path)
    result = ribbon("plot", *words, "--runs", solved)
    assert result.exit_code == 2
    assert message in result.stderr
    assert not list(tmp_path.iterdir())


def test_the_lowest_elastic_eigenvalue_is_no_rotation(solved):  # noqa: F811
    for state in states_of(solved, "mobius"):
        (physical,) = (s for s in state.spectra if s.metric == "physical")
        value = lowest_value(state, "rotation", "sliding")
        assert value in physical.values
        assert physical.labels[list(physical.values).index(value)] == "mode"


# --- pages ---


@pytest.mark.long
def test_a_report_needs_nothing_else(solved, tmp_path):  # noqa: F811
    path = tmp_path / "page.html"
    assert ribbon_json("report", "mobius", "-o", path, "--runs", solved)["path"] == str(path)
    text = path.read_text(encoding="utf-8")
    run = run_named(solved, "mobius")
    assert run.name in text
    for state in run.states():
        assert f'<td class="n">{state.energy:.9f}</td>' in text
    assert text.count("data:image/png;base64,") >= 6
    assert "recipe: twist" in text
    assert "version_numpy" in text
    # Nothing is fetched: every source is inside the page, and the browser is told so.
    assert not re.search(r"""(src|href)=["'](?!data:)""", text)
    assert "default-src 'none'" in text
    assert ribbon("report", "mobius", "-o", path, "--runs", solved).exit_code == 2

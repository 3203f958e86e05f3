"""What pictures say of the states on them: names that tell them apart, certificates, scales with numbers."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cli_support import QUICK_RING, ribbon, ribbon_json
from matplotlib.figure import Figure
from picture_support import run_named, solved, states_of  # noqa: F401
from store_support import make_record, make_spectrum, make_summary

from ribbon_cli import solve
from ribbon_cli.config import parse_config
from ribbon_cli.export.formats import FORMATS
from ribbon_cli.plot.branches import arclength_figure
from ribbon_cli.plot.curves import geometry_figure, multipliers_figure
from ribbon_cli.plot.flat import FEW_FOLDS, draw_pattern
from ribbon_cli.plot.kinds import Source, draw
from ribbon_cli.plot.labels import panel_titles
from ribbon_cli.plot.levels import convergence_figure, draw_spectra, spectrum_figure, spectrum_of
from ribbon_cli.plot.pictures import family_figure
from ribbon_cli.plot.style import STYLES, styled
from ribbon_cli.report.convergence import Entry, convergence_rows
from ribbon_cli.store import StateRecord, Summary, encode

STYLE = STYLES["paper"]


def legend(figure: Figure) -> list[str]:
    """The entries of a figure's legend."""
    return [text.get_text() for text in figure.legends[0].get_texts()]


def is_inside(figure: Figure) -> bool:
    """Whether a figure's legend lies on it whole."""
    figure.draw_without_rendering()
    box = figure.legends[0].get_window_extent()
    return box.x0 >= 0 and box.x1 <= figure.bbox.width


def test_curves_of_a_legend_can_be_told_apart(solved):  # noqa: F811
    state = states_of(solved, "mobius")[-1]
    nearly = replace(state, half_width=state.half_width * (1 + 1e-5))
    ruled = replace(state, discretisation="value-average")
    for others in ([nearly], [ruled], [state], [nearly, ruled, replace(state, label=99)]):
        names = legend(geometry_figure([state, *others], STYLE))
        assert len(set(names)) == len(others) + 1
    assert any("value-average" in name for name in legend(geometry_figure([state, ruled], STYLE)))


def test_what_has_no_certificate_is_said_where_certified_states_stand(solved):  # noqa: F811
    state, auxiliary = states_of(solved, "mobius")[-1], states_of(solved, "mobius", "auxiliary")[-1]
    saddle = replace(state, certified=False, status="saddle", half_width=0.3)
    for figure in (geometry_figure([state, saddle], STYLE), multipliers_figure([state, saddle], STYLE)):
        assert [name.endswith("no certificate") for name in legend(figure)] == [False, True]
    assert legend(geometry_figure([state, auxiliary], STYLE))[1].endswith("auxiliary")
    titles = [axes.get_title() for axes in family_figure([state, saddle], STYLE).axes]
    assert ["no certificate" in title for title in titles] == [False, True]
    source = Source(None, (state, saddle), pytest.fail, pytest.fail)
    titles = [axes.get_title() for axes in draw("shape", source, STYLE).figure.axes]
    assert ["no certificate" in title for title in titles] == [False, True]


@pytest.mark.long
@pytest.mark.parametrize("style", STYLES)
def test_legends_stay_inside(style, solved):  # noqa: F811
    state = states_of(solved, "mobius")[-1]
    many = [replace(state, half_width=0.1 + 0.01 * k, certified=k % 2 == 0) for k in range(6)]
    many.append(replace(state, segments=48, half_width=0.9, discretisation="value-average"))
    with styled(STYLES[style]):
        assert is_inside(geometry_figure(many, STYLES[style]))
        assert is_inside(multipliers_figure(many, STYLES[style]))
        assert is_inside(spectrum_figure([many], STYLES[style]))


def test_lengths_that_differ_have_room_and_numbers(solved):  # noqa: F811
    state = states_of(solved, "ring")[-1]
    longer = replace(state, length=2 * state.length, midline=2 * state.midline, half_width=1.0)
    for records in ([state, longer], [longer, state]):
        axes = geometry_figure(records, STYLE).axes[0]
        assert axes.get_xlim() == (0.0, longer.length)
        assert "ℓ" not in "".join(text.get_text() for text in axes.get_xticklabels())


def table(*energies: float, certified: bool = True, breaks: str = ""):
    """A table of one width, N = 50, 100, ...; the last energy is what `certified` and `breaks` speak of."""
    last = len(energies) - 1
    return convergence_rows(
        Entry(0.5, 50 * 2**k, e, k < last or certified, k, breaks if k == last else "")
        for k, e in enumerate(energies)
    )


@pytest.mark.parametrize(
    ("change", "rings"),
    [({}, []), ({"certified": False}, [100]), ({"breaks": "another minimum"}, [100])],
)
def test_differences_that_mean_little_are_ringed(change, rings):
    axes = convergence_figure(table(5.0, 5.1, 5.12, **change), STYLE).axes[0]
    ringed = [line for line in axes.get_lines() if "no certificate" in str(line.get_label())]
    assert [n for line in ringed for n in line.get_xdata()] == rings


def test_a_difference_of_zero_is_told():
    axes = convergence_figure(table(5.0, 5.1, 5.1), STYLE).axes[0]
    assert "0 at $N$ = 100" in axes.get_legend().get_texts()[0].get_text()
    assert convergence_figure(table(5.0, 5.0), STYLE).axes[0].get_legend().get_texts()


@pytest.mark.parametrize("energies", [(5.0, 5.031, 5.036), (5.0, 5.0031), (5.0, 5.2, 5.2001)])
def test_a_logarithmic_scale_has_numbers(energies):
    figure = convergence_figure(table(*energies), STYLE)
    figure.draw_without_rendering()
    low, high = figure.axes[0].get_ylim()
    assert sum(low <= tick <= high for tick in figure.axes[0].get_yticks()) >= 2
    for line in figure.axes[0].get_lines():
        assert low <= min(line.get_ydata()) <= max(line.get_ydata()) <= high


def test_rows_of_spectra_place_their_modes_alike(solved):  # noqa: F811
    """A whole spectrum above the lowest modes of another: both are numbered, since they share their scale."""
    whole, part = states_of(solved, "ring")[0], states_of(solved, "mobius")[-1]
    assert spectrum_of(whole, "euclidean").complete
    assert not spectrum_of(part, "euclidean").complete
    panels = spectrum_figure([[whole], [part]], STYLE, ["ring", "mobius"]).axes
    for axes in panels:
        for line in axes.get_lines():
            assert line.get_xdata()[:2].tolist() == [1.0, 2.0]
    assert {axes.get_title().split("\n")[1].split(",")[0] for axes in panels} == {"ring", "mobius"}
    alone = spectrum_figure([[whole]], STYLE).axes[0].get_lines()[0]
    assert alone.get_xdata()[[0, -1]].tolist() == [0.0, 1.0]


def test_rows_of_other_meshes_have_legends_of_their_own(solved):  # noqa: F811
    """A line's look says which mesh it is in its own row alone."""
    coarse, fine = states_of(solved, "ring")[0], states_of(solved, "ring")[-1]
    assert coarse.segments != fine.segments
    alike = replace(fine, discretisation="value-average")
    figure = spectrum_figure([[coarse], [fine]], STYLE, ["one", "other"])
    texts = [axes.get_legend().get_texts()[0].get_text() for axes in figure.axes[::2]]
    assert [f"$N$ = {state.segments}" in text for state, text in zip((coarse, fine), texts, strict=True)] == [
        True
    ] * 2
    assert not figure.legends
    assert legend(spectrum_figure([[fine], [alike]], STYLE, ["one", "other"]))


def test_branches_are_numbered_in_the_legend():
    def course(*places: tuple[float, float]) -> list[Summary]:
        return [make_summary(half_width=b, energy=e, negative_eigenvalues=0) for b, e in places]

    up, mirrored = course((0.1, 0.2), (0.2, 0.5)), course((0.1, 0.2), (0.2, 0.5))
    down = course((0.1, 0.2), (0.05, 0.1))
    figure = arclength_figure({"up": up, "down": down, "mirrored": mirrored}, {}, STYLE)
    assert legend(figure)[:3] == ["1 up", "2 down", "3 mirrored"]
    assert not figure.axes[0].texts  # which would hide curves


def test_the_contact_drawn_is_that_of_the_mesh_drawn(solved, monkeypatch):  # noqa: F811
    run = run_named(solved, "mobius")
    found = {all: run.states(all) for all in (False, True)}
    states = found[True]
    met = replace(
        states[-1],
        self_contact=True,
        certified=True,
        kind="intermediate",
        stage="contact between b = 0.1 and b = 0.2",
    )
    located = [
        replace(met, segments=n, half_width=b, events=(event,), event_kinds=(kind,))
        for n, b, kind, event in (
            (24, 0.15, "first-contact", "first contact: facets 3 and 9 meet"),
            (24, 0.18, "contact-ends", "contact ends: facets 3 and 9 meet"),
            (48, 0.16, "first-contact", "first contact: facets 5 and 18 meet"),
        )
    ]
    monkeypatch.setattr(type(run), "states", lambda self, all=False: [*found[all], *located * all])
    for n, b in ((24, "0.15"), (48, "0.16")):
        source = Source(run, (), pytest.fail, pytest.fail, segments=n)
        assert f"first contact, $b$ = {b}" in legend(draw("branch", source, STYLE).figure)


def test_widths_that_are_left_out_are_counted(solved, monkeypatch):  # noqa: F811
    monkeypatch.setattr("ribbon_cli.plot.kinds.MOST_CURVES", 1 + 1)
    monkeypatch.setattr("ribbon_cli.plot.kinds.MOST_SHAPES", 1 + 1)
    run = run_named(solved, "mobius")
    states = run.states()
    more = [replace(state, half_width=state.half_width + 0.05) for state in states]
    source = Source(run, (), pytest.fail, pytest.fail)
    for kind in ("geometry", "family"):
        assert "of 2" not in draw(kind, source, STYLE).title
    monkeypatch.setattr(type(run), "states", lambda self, all=False: [*states, *more])
    for kind in ("geometry", "family"):
        assert draw(kind, source, STYLE).title.endswith(", 2 of 4 half-widths, without b = 0.15, 0.2")


def test_states_of_other_branches_at_the_same_width_are_counted(solved, monkeypatch):  # noqa: F811
    run = run_named(solved, "mobius")
    states = run.states()
    again = [replace(state, label=1, certified=False) for state in states if state.half_width == 0.2]
    source = Source(run, (), pytest.fail, pytest.fail, segments=48)
    assert draw("branch", source, STYLE).title == "Branch in the width"
    monkeypatch.setattr(type(run), "states", lambda self, all=False: [*states, *again])
    for kind in ("branch", "family", "geometry"):
        assert draw(kind, source, STYLE).title.endswith("; without 1 more at the same b and N")
    result = ribbon("export", "mobius", "--to", "html", "-o", "/dev/null/x", "--runs", solved)
    assert "without 1 more at the same b and N; --segments" in result.stderr


def test_the_captions_of_several_runs_name_them(solved, tmp_path, monkeypatch):  # noqa: F811
    monkeypatch.chdir(tmp_path)
    words = ("plot", "mobius@b=0.2,N=48", "geometry", "--with", "ring:1", "--runs", solved)
    document = ribbon_json(*words)
    label = states_of(solved, "mobius")[-1].label
    ring, mobius = run_named(solved, "ring").name, run_named(solved, "mobius").name
    assert document["caption"] == f"{mobius}:{label}, {ring}:1 (2 of 2 certified)"
    # A name cut at the point of a width would be another state's as well.
    assert document["path"] == f"mobius-{label}-geometry.pdf"
    rows = ribbon_json("plot", "ring", "spectrum", "--with", "mobius", "-o", "rows.svg", "--runs", solved)
    assert f"below, {mobius}:" in Path("rows.svg").read_text(encoding="utf-8")
    assert rows["run"] == ring


def test_an_open_seam_has_no_linking_number(solved, tmp_path):  # noqa: F811
    words = ("shape", "--runs", solved, "-o", tmp_path / "x.svg", "--overwrite")
    assert "Tw + Wr = " in ribbon_json("plot", "mobius:4", *words)["caption"]
    assert "Lk = 0.5" in ribbon_json("plot", "mobius@b=0.2,N=48", *words)["caption"]


def test_letters_tell_the_folds_of_a_dense_pattern(solved):  # noqa: F811
    from ribbon_cli.export.pattern import fold_pattern

    state = states_of(solved, "mobius")[-1]
    pattern = fold_pattern(state, 250.0)
    many = replace(
        pattern,
        folds=np.repeat(pattern.folds, 40, axis=0),
        angles=np.repeat(pattern.angles, 40),
    )
    assert len(many.angles) > FEW_FOLDS
    axes = Figure().subplots()
    draw_pattern(axes, many, STYLE)
    signs = set(np.sign(many.angles).tolist())
    assert {text.get_text() for text in axes.texts} == {"M" if sign > 0 else "V" for sign in signs}
    # Lines that overlap hide how sharp the folds are.
    apart = STYLE.width * 72 / len(many.angles)
    assert all(width <= apart for lines in axes.collections for width in lines.get_linewidths())


@pytest.fixture
def wrong(solved, tmp_path) -> Path:  # noqa: F811
    """The file of a state whose solve went wrong."""
    state: StateRecord = states_of(solved, "mobius")[-1]
    u = state.u.copy()
    u[3] = np.nan
    path = tmp_path / "wrong.h5"
    path.write_bytes(encode(replace(state, u=u, energy=np.nan, certified=False, status="stalled")))
    return path


@pytest.mark.parametrize("kind", ["shape", "geometry", "multipliers", "mode", "pattern"])
def test_a_state_that_went_wrong_has_no_picture(kind, wrong, tmp_path):
    result = ribbon("plot", wrong, kind, "-o", tmp_path / "x.png")
    assert result.exit_code == 2
    assert "holds values that are not finite (stalled)" in result.stderr
    assert not (tmp_path / "x.png").exists()


@pytest.mark.parametrize("form", [*FORMATS])
def test_a_state_that_went_wrong_is_exported_as_numbers_alone(form, wrong, tmp_path):
    path = tmp_path / f"x.{form}"
    result = ribbon("export", wrong, "--to", form, "-o", path)
    assert result.exit_code == (0 if form in ("csv", "json") else 2)
    assert path.exists() == (result.exit_code == 0)
    assert "Error:" not in result.stderr


def test_texts_of_a_state_are_no_formulas(solved, tmp_path):  # noqa: F811
    """A stage or status with dollar signs is text; as a formula it might be none."""
    state = replace(states_of(solved, "mobius", "auxiliary")[-1], certified=False, status="a $_{$ b")
    path, other = tmp_path / "odd $_{$.h5", tmp_path / "odd $_{$ too.h5"
    stages = [replace(state, stage="c $_{$ d"), replace(state, stage="e")]
    for file, record in zip((path, other), stages, strict=True):
        file.write_bytes(encode(record))
    assert panel_titles(stages, (), 20) == [r"c \$_{\$ d", "e"]
    for more in ((), ("--with", other)):
        result = ribbon("plot", path, "shape", *more, "-o", tmp_path / "x.svg", "--overwrite")
        assert result.exit_code == 0, result.stderr
    assert ">odd $_{$ too.h5" in (tmp_path / "x.svg").read_text(encoding="utf-8")


@pytest.mark.parametrize("form", ["obj", "ply", "csv"])
def test_a_status_adds_no_lines_to_a_file(form, solved, tmp_path):  # noqa: F811
    state = states_of(solved, "ring")[0]
    sizes = []
    for status in ("stalled", "stalled\nv 9 9 9\n# 1,2,3"):
        source, path = tmp_path / "given.h5", tmp_path / f"x{len(sizes)}.{form}"
        source.write_bytes(encode(replace(state, certified=False, status=status)))
        assert ribbon("export", source, "--to", form, "-o", path).exit_code == 0
        sizes.append(path.read_bytes().count(b"\n"))
    assert sizes[0] == sizes[1]


@pytest.mark.long
def test_a_report_calls_rounding_zero(tmp_path):
    with np.errstate(all="raise", under="ignore"):
        run = solve(parse_config(QUICK_RING, "test"), runs=tmp_path).run
    path = tmp_path / "page.html"
    assert ribbon("report", run.name, "-o", path, "--runs", tmp_path).exit_code == 0
    text = path.read_text(encoding="utf-8")
    assert "Linking numbers found: 0." in text
    assert not re.search(r'<td class="n">-?\d[\d.]*e-1\d</td><td class="n">[\d.]+</td></tr>', text)


@pytest.mark.parametrize(("counts", "marked"), [((10, 20), True), ((10, 100), False)])
def test_modes_are_marked_one_by_one_in_every_spectrum_or_in_none(counts, marked):
    """Marks on the coarsest mesh alone would look as if they meant something."""
    rng = np.random.default_rng(3)
    records = []
    for k, n in enumerate(counts, start=1):
        spectrum = make_spectrum(rng, n, "physical", 6, None)
        values = np.abs(rng.normal(size=n)) + 1.0
        full = replace(
            spectrum, values=values, residuals=0 * values, labels=("",) * n, sliding_overlap=0 * values
        )
        records.append(make_record(k, n=8 * k, spectra=(full,)))
    axes = Figure().subplots()
    draw_spectra(axes, records, "physical")
    assert [line.get_marker() not in ("", "None") for line in axes.get_lines()] == [marked] * len(counts)


@pytest.mark.parametrize(
    ("changes", "words", "said"),
    [
        ({"u": 1e200}, ("plot", "pattern"), "holds values beyond any length (minimum): there is no shape"),
        (
            {"u": 0.0},
            ("plot", "shape"),
            "holds tangents or rulings of no length (minimum): there is no shape",
        ),
        ({"discretisation": "x"}, ("spectrum",), "no discretisation 'x' is known here: update ribbon"),
    ],
)
def test_a_file_that_holds_no_shape_says_so(changes, words, said, solved, tmp_path):  # noqa: F811
    state: StateRecord = states_of(solved, "mobius")[-1]
    if "u" in changes:
        u = state.u.copy()
        u[3] = changes["u"]
        changes = {"u": u}
    path = tmp_path / "odd.h5"
    path.write_bytes(encode(replace(state, **changes)))
    command, *kind = words
    result = ribbon(command, path, *kind, *(("-o", tmp_path / "x.png") if kind else ()))
    assert (result.exit_code, said in result.stderr) == (2, True), result.output


@pytest.mark.parametrize(("count", "scale"), [(6, "linear"), (100, "log")])
def test_modes_are_numbered_by_whole_numbers(count, scale):
    spectrum = make_spectrum(np.random.default_rng(3), count, "physical", 6, None)
    values = 1.0 + np.arange(float(count))
    full = replace(
        spectrum, values=values, residuals=0 * values, labels=("",) * count, sliding_overlap=0 * values
    )
    figure = Figure()
    axes = figure.subplots()
    draw_spectra(axes, [make_record(1, n=8, spectra=(full,))], "physical")
    figure.canvas.draw()
    assert axes.get_xscale() == scale
    texts = [label.get_text() for label in axes.get_xticklabels()]
    assert [text for text in texts if text and not re.fullmatch(r"0\.0?1|[0-9]+", text)] == []

"""Pictures of modes, of multipliers over their formulas, of spectra row by row and of branches with folds."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from cli_support import ribbon_json
from picture_support import solved, states_of  # noqa: F401
from PIL import Image
from store_support import make_summary

from ribbon_cli.analysis import multiplier_curves, stability_of
from ribbon_cli.errors import UsageError
from ribbon_cli.export.mesh import facet_corners, is_closed
from ribbon_cli.plot import modes
from ribbon_cli.plot.branches import _stretches, arclength_figure
from ribbon_cli.plot.curves import multipliers_figure
from ribbon_cli.plot.modes import LARGEST, STEPS, ModeShape, amplitude, displaced, mode_animation, mode_figure
from ribbon_cli.plot.style import STYLES
from ribbon_cli.store import BranchSummary

BAND = "mobius@b=0.2,N=48"
STYLE = STYLES["paper"]


def test_the_mode_is_that_of_ribbon_spectrum(solved, tmp_path):  # noqa: F811
    table = ribbon_json("spectrum", BAND, "--runs", solved)["modes"]
    words = ("plot", BAND, "mode", "--runs", solved)
    lowest = ribbon_json(*words, "-o", tmp_path / "lowest.svg")["mode"]
    assert lowest["number"] == 1 + next(k for k, m in enumerate(table) if m["label"] != "rotation")
    shown = ribbon_json(*words, "--index", "5", "-o", tmp_path / "five.svg")["mode"]
    assert (shown["value"], shown["label"]) == (table[4]["value"], table[4]["label"])
    sign = "symmetric" if table[4]["symmetry"]["C2"] > 0 else "antisymmetric"
    assert shown["symmetries"] == [f"{sign} under C2"]
    text = (tmp_path / "five.svg").read_text()
    assert "Mode 5" in text
    assert f"{sign} under C2" in text
    turn = ribbon_json(*words, "--index", "2", "-o", tmp_path / "turn.svg")["mode"]
    assert (turn["label"], turn["value"]) == ("rotation", 0.0)


def modes_of(record, count=4):
    """The lowest modes of a state as pictures take them."""
    found = stability_of(record, modes=count)
    return [
        ModeShape(k + 1, m.value, m.bound, "physical metric", m.label, (), "", found.vectors[k])
        for k, m in enumerate(found.modes)
    ]


def test_a_moved_shape_is_a_closed_band_to_first_order(solved):  # noqa: F811
    record = states_of(solved, "mobius")[-1]
    mode = modes_of(record)[-1]
    size = amplitude(record, mode.move)
    moved = displaced(record, mode.move, size)
    assert is_closed(moved)
    travel = np.linalg.norm(facet_corners(moved) - facet_corners(record), axis=2).max()
    assert travel == pytest.approx(LARGEST * record.length, rel=1e-12)
    assert np.array_equal(displaced(record, mode.move, 0.0).u, record.u)
    # What the constraints ask is broken at second order alone.
    errors = []
    for share in (0.1, 0.05):
        small = displaced(record, mode.move, share * size)
        length = np.abs(np.einsum("ij,ij->i", small.u, small.u) - 1.0).max()
        flat = np.einsum("ij,ij->i", np.cross(small.u, small.g), np.vstack((small.g[1:], small.g_end)))
        errors.append((length, np.abs(flat).max()))
    assert np.array(errors[0]) / np.array(errors[1]) == pytest.approx(4.0, rel=0.1)


def test_a_rotation_moves_the_band_as_a_whole(solved):  # noqa: F811
    record = states_of(solved, "ring")[-1]
    mode = modes_of(record)[0]
    assert mode.label == "rotation"
    move = facet_corners(displaced(record, mode.move, 1.0)) - facet_corners(record)
    points = facet_corners(record).reshape(-1, 3)
    points = points - points.mean(axis=0)
    # delta x = W x with W skew.
    w = np.linalg.lstsq(points, move.reshape(-1, 3), rcond=None)[0]
    assert np.abs(w + w.T).max() < 1e-8
    assert points @ w == pytest.approx(move.reshape(-1, 3), abs=1e-8)


@pytest.mark.long
def test_an_animation_is_one_period(solved, tmp_path):  # noqa: F811
    path = tmp_path / "mode.gif"
    ribbon_json("plot", BAND, "mode", "--runs", solved, "-o", path)
    with Image.open(path) as film:
        assert film.n_frames == STEPS
        assert film.info["loop"] == 0
        assert b"mode" in film.info["comment"] or b"sliding" in film.info["comment"]
        frames = []
        for k in range(STEPS):
            film.seek(k)
            frames.append(np.asarray(film.convert("RGB"), dtype=int))
    # There and back: the same pictures on both ways, and the ends are farthest from rest.
    quarter = STEPS // 4
    assert np.array_equal(frames[1], frames[2 * quarter - 1])
    assert np.array_equal(frames[0], frames[2 * quarter])
    distance = [np.abs(frame - frames[0]).sum() for frame in frames]
    assert min(distance[quarter], distance[3 * quarter]) > max(distance[1], distance[-1]) > 0


def test_a_mode_without_a_caption(solved, monkeypatch):  # noqa: F811
    monkeypatch.setattr(modes, "STEPS", 4)
    record = states_of(solved, "ring")[0]
    mode = modes_of(record)[-1]
    assert len(mode_figure(record, mode, STYLE).axes) == 5
    film = mode_animation(record, mode, STYLE, None)
    assert film.startswith(b"GIF89a")
    assert mode_animation(record, mode, STYLE, None) == film


def test_an_unstable_mode_is_called_so():
    move = np.zeros((3, 7))
    assert "unstable mode" in ModeShape(1, -0.2, 1e-9, "physical metric", "mode", (), "", move).title
    assert "unstable" not in ModeShape(1, -1e-10, 1e-9, "physical metric", "mode", (), "", move).title
    assert "sliding" in ModeShape(1, -0.2, 1e-9, "physical metric", "sliding", (), "", move).title


def test_multipliers_lie_on_their_formulas(solved):  # noqa: F811
    record = states_of(solved, "mobius")[-1]
    curves = multiplier_curves(record)
    figure = multipliers_figure([record], STYLE, [curves])
    for axes, curve in zip(figure.axes, curves, strict=False):
        _, computed, theory = axes.get_lines()
        assert theory.get_label() == "explicit formulas"
        assert np.array_equal(computed.get_xdata(), theory.get_xdata())
        # The formulas are turned and shifted as the multipliers are: far from inflections they agree.
        there = np.sort(np.abs(computed.get_ydata() - theory.get_ydata()))
        expected = np.sort(np.abs(curve.computed - curve.theory))
        assert there == pytest.approx(expected, rel=1e-9, abs=1e-12)
        low, high = axes.get_ylim()
        assert low <= computed.get_ydata().min() <= computed.get_ydata().max() <= high
        assert high - low < 1.3 * np.ptp(np.append(computed.get_ydata(), 0.0))
    plain = multipliers_figure([record], STYLE)
    assert all(len(axes.get_lines()) == 2 for axes in plain.axes[:5])
    assert plain.axes[2].get_title("left") != figure.axes[2].get_title("left")


def test_spectra_of_runs_stand_in_rows(solved, tmp_path):  # noqa: F811
    path = tmp_path / "rows.svg"
    document = ribbon_json("plot", "ring", "spectrum", "--with", "mobius", "-o", path, "--runs", solved)
    text = path.read_text()
    assert text.count("ring, untwisted") == 2
    assert text.count("mobius, π band") == 2
    assert "below, mobius" in text
    assert len(document["labels"]) == 2


def point(b, negative, kind=None, before=None, after=None):
    """A summary of a point on a branch."""
    branch = BranchSummary("up", kind, 0.0, 1.0, before, after, 0.1, None) if kind else None
    return make_summary(half_width=b, energy=1.0, clearance=0.1, negative_eigenvalues=negative, branch=branch)


def test_dashes_tell_the_index():
    around = [point(0.1, 0), point(0.2, 0, "step"), point(0.3, None, "fold", 0, 1), point(0.2, 1, "step")]
    assert _stretches(around) == [0, 0, 1]
    # A branch that begins at another's branch point has its own index from the first step on.
    crossing = [point(0.1, None, "branch-point", 0, 1), point(0.1, 2, "step"), point(0.2, None, "step")]
    assert _stretches(crossing) == [2, 2]
    assert _stretches([point(0.1, 0), point(0.2, 1, "step")]) == [None]
    figure = arclength_figure({"branch up": around, "other": crossing}, {1: None}, STYLE)
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert labels == [
        "1 branch up",
        "2 other",
        "stable",
        "index 1",
        "index 2 or more",
        "fold",
        "branch point",
    ]


def test_formulas_that_a_state_lacks_are_left_out(solved):  # noqa: F811
    from ribbon_cli.plot.kinds import Source, draw

    def none(record):
        raise UsageError("no formulas")

    record = states_of(solved, "mobius")[-1]
    source = Source(None, (record,), SimpleNamespace, none)
    assert draw("multipliers", source, STYLE).title == "Lagrange multipliers"

"""The printed fold pattern, folded back."""

from __future__ import annotations

import itertools
import json
import re
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cli_support import ribbon
from picture_support import solved, states_of  # noqa: F401

from ribbon_cli.errors import UsageError
from ribbon_cli.export.pattern import fold_pattern
from ribbon_cli.export.svg import OVERLAP, PAPERS, pages, pattern_pdf, pattern_svg
from ribbon_cli.model.folding import Folding, frames

SVG = "{http://www.w3.org/2000/svg}"


def lines(data: bytes, kind: str) -> list[tuple[dict[str, str], np.ndarray]]:
    """Lines of a class in an SVG: attributes and ends (2, 2) on the pattern, y upwards, in millimetres."""
    root = ET.fromstring(data)
    origin = json.loads(root.findtext(f"{SVG}metadata"))
    found = []
    for item in root.iter(f"{SVG}line"):
        if item.get("class", "").split()[0] == kind:
            ends = np.array([[float(item.get(f"x{k}")), float(item.get(f"y{k}"))] for k in (1, 2)])
            ends = (ends - [origin["origin_x"], origin["origin_y"]]) * [1, -1]
            found.append((dict(item.attrib), ends))
    return found


def folded(folds, glue, half_width: float, length: float) -> tuple[np.ndarray, np.ndarray]:
    """Tangents and rulings of the strip folded up from lines and angles alone; facet 1 stays where it is."""
    (first,) = (ends for attributes, ends in glue if attributes["data-end"] == "first")
    ends = [first, *(ends for _, ends in folds)]
    eta = np.array([(e[0, 0] - e[1, 0]) / (e[0, 1] - e[1, 1]) for e in ends])
    degrees = [float(glue[0][0]["data-angle"]), *(float(a["data-angle"]) for a, _ in folds)]
    middle = np.array([e.mean(axis=0) for e in ends])
    np.testing.assert_allclose(middle[:, 0], np.arange(len(ends)) * length / len(ends), atol=1e-6)
    np.testing.assert_allclose(np.abs([e[:, 1] for e in ends]), half_width, atol=1e-6)
    frame = frames(Folding(np.radians(degrees), eta), np.eye(3))
    return frame[:, :, 0], eta[:, None] * frame[:, :, 0] + frame[:, :, 2]


@pytest.mark.parametrize("name", ["mobius", "ring"])
def test_the_pattern_folds_back_to_the_state(name, solved):  # noqa: F811
    state = states_of(solved, name)[-1]
    data = pattern_svg(fold_pattern(state, 432.1), "a band")
    scale = 432.1 / state.length
    u, g = folded(lines(data, "fold"), lines(data, "glue"), state.half_width * scale, 432.1)
    # Facet 1's frame, as the model lays it: t, n = b x t, b.
    b = state.g[0] - (state.g[0] @ state.u[0]) * state.u[0]
    b /= np.linalg.norm(b)
    turn = np.stack((state.u[0], np.cross(b, state.u[0]), b))
    np.testing.assert_allclose(u @ turn, state.u, atol=1e-6)
    np.testing.assert_allclose(g @ turn, state.g, atol=1e-6)
    # The ends meet: the last facet's far ruling is the first one, turned round on a one-sided band.
    (last,) = (ends for a, ends in lines(data, "glue") if a["data-end"] == "last")
    eta_end = (last[0, 0] - last[1, 0]) / (last[0, 1] - last[1, 1])
    assert eta_end == pytest.approx(state.sigma * state.eta[0], abs=1e-6)
    assert np.abs(u.sum(axis=0)).max() < 1e-6


def test_mountains_and_valleys(solved):  # noqa: F811
    """Bending towards g x u is bending away from the reader, who sees the side that u x g points to."""
    state = states_of(solved, "ring")[0]
    kinds = {item[0]["class"] for item in lines(pattern_svg(fold_pattern(state, 300.0), "a ring"), "fold")}
    inward = -state.midline[:-1] + state.midline[:-1].mean(axis=0)
    bends_to_reader = (np.einsum("ij,ij->i", inward, np.cross(state.u, state.g)) > 0).all()
    assert kinds == {"fold valley" if bends_to_reader else "fold mountain"}


def test_letters_say_which_corners_meet(solved):  # noqa: F811
    for name, swapped in (("mobius", True), ("ring", False)):
        data = pattern_svg(fold_pattern(states_of(solved, name)[-1], 300.0), "a band").decode()
        found = re.findall(r'<text x="([\d.]+)" y="([\d.]+)"[^>]*>([AB])<', data)
        upper = [letter for _, y, letter in sorted(found, key=lambda t: float(t[0])) if letter]
        tops = sorted(found, key=lambda t: float(t[1]))[:2]
        letters = [letter for _, _, letter in sorted(tops, key=lambda t: float(t[0]))]
        assert letters == (["A", "B"] if swapped else ["A", "A"])
        assert sorted(upper) == ["A", "A", "B", "B"]


@pytest.mark.parametrize(
    ("name", "linking_number", "told"),
    [
        ("mobius", 0.5, "by half a turn, right-handed, and"),
        ("mobius", -1.5, "by 3 half-turns, left-handed, and"),
        ("ring", 0.0, "Glue the flap under the other end"),
        ("ring", 1.0, "by 2 half-turns, right-handed, and"),
    ],
)
def test_ends_are_turned_as_often_as_the_band_is_twisted(name, linking_number, told, solved):  # noqa: F811
    state = replace(states_of(solved, name)[-1], linking_number=linking_number)
    assert told in pattern_svg(fold_pattern(state, 300.0), "a band").decode()


def test_what_is_said_above_a_short_strip_has_room(solved):  # noqa: F811
    data = pattern_svg(fold_pattern(states_of(solved, "mobius")[-1], 40.0), "a band " * 20).decode()
    (wide,) = re.findall(r'width="([\d.]+)mm"', data)
    letters = max(map(len, re.findall(r'font-size="2.8"[^>]*>([^<]*)<', data)))
    assert float(wide) > 20 + 2.8 * 0.5 * letters


def test_folds_of_a_fine_mesh_stay_lines(solved):  # noqa: F811
    state = states_of(solved, "mobius")[-1]
    for size, said in ((300.0, False), (40.0, True)):
        data = pattern_svg(fold_pattern(state, size), "a band")
        widths = {float(a["stroke-width"]) for a, _ in lines(data, "fold")}
        assert max(widths) <= min(0.2, 0.5 * size / state.segments)
        assert (b"mm apart: by hand" in data) == said


@pytest.mark.parametrize("paper", PAPERS)
def test_pages_cover_the_strip(paper, solved):  # noqa: F811
    state = states_of(solved, "mobius")[-1]
    pattern = fold_pattern(state, 700.0)
    wide, tall, found = pages(pattern, paper)
    left, _, right, _ = pattern.box
    assert found[0].left == left
    assert found[-1].right == right
    for one, other in itertools.pairwise(found):
        assert one.right - other.left == pytest.approx(OVERLAP)
    seen = set()
    for page in found:
        data = pattern_svg(pattern, "a band", paper, page.number)
        assert f'width="{wide:.3f}mm" height="{tall:.3f}mm"'.encode() in data
        for attributes, ends in lines(data, "fold"):
            node = int(attributes["data-node"])
            np.testing.assert_allclose(ends, pattern.folds[node - 2], atol=1e-6)
            seen.add(node)
    assert seen == set(range(2, state.segments + 1))


def test_the_pdf_has_true_scale(solved):  # noqa: F811
    pattern = fold_pattern(states_of(solved, "mobius")[-1], 500.0)
    data = pattern_pdf(pattern, "a band", "A4")
    boxes = [tuple(map(float, box)) for box in re.findall(rb"/MediaBox \[ 0 0 ([\d.]+) ([\d.]+) \]", data)]
    assert len(boxes) == len(pages(pattern, "A4")[2]) == 2
    for wide, tall in boxes:
        assert (wide / 72 * 25.4, tall / 72 * 25.4) == pytest.approx((297.0, 210.0), abs=0.01)


def test_an_open_strip_has_no_pattern(solved):  # noqa: F811
    with pytest.raises(UsageError, match="open seam"):
        fold_pattern(states_of(solved, "mobius", "auxiliary")[0], 300.0)


def test_pages_become_files(solved, tmp_path: Path):  # noqa: F811
    words = ("export", "mobius@b=0.2,N=24", "--to", "svg", "--paper", "A4", "--size", "600", "--runs", solved)
    result = ribbon(*words, "-o", tmp_path / "strip.svg")
    assert result.exit_code == 0
    names = [Path(line).name for line in result.stdout.splitlines()]
    assert names == ["strip-1.svg", "strip-2.svg", "strip-3.svg"]
    assert sorted(path.name for path in tmp_path.iterdir()) == names

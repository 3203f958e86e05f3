"""The printed fold pattern, folded back."""

from __future__ import annotations

import itertools
import json
import re
import xml.etree.ElementTree as ET
import zlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cli_support import ribbon
from matplotlib.path import Path as MplPath
from picture_support import solved, states_of  # noqa: F401

from ribbon_cli.errors import UsageError
from ribbon_cli.export.pattern import fold_pattern
from ribbon_cli.export.sheet import HEADER, MARGIN, OVERLAP, PAPERS, pages
from ribbon_cli.export.svg import pattern_pdf, pattern_svg
from ribbon_cli.model.folding import Folding, frames

SVG = "{http://www.w3.org/2000/svg}"
INKSCAPE = "{http://www.inkscape.org/namespaces/inkscape}"


def lines(data: bytes, key: str = "class") -> list[tuple[dict[str, str], np.ndarray]]:
    """Lines with an attribute: all of these, and ends (2, 2) on the pattern, y upwards, in millimetres."""
    root = ET.fromstring(data)
    origin = json.loads(root.findtext(f"{SVG}metadata"))
    found = []
    for item in root.iter(f"{SVG}line"):
        if key in item.attrib:
            ends = np.array([[float(item.get(f"x{k}")), float(item.get(f"y{k}"))] for k in (1, 2)])
            ends = (ends - [origin["origin_x"], origin["origin_y"]]) * [1, -1]
            found.append((dict(item.attrib), ends))
    # Layers hold folds of a kind; along the strip they alternate.
    return sorted(found, key=lambda line: int(line[0].get("data-node", 0)))


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
    u, g = folded(lines(data, "data-node"), lines(data, "data-end"), state.half_width * scale, 432.1)
    # Facet 1's frame, as the model lays it: t, n = b x t, b.
    b = state.g[0] - (state.g[0] @ state.u[0]) * state.u[0]
    b /= np.linalg.norm(b)
    turn = np.stack((state.u[0], np.cross(b, state.u[0]), b))
    np.testing.assert_allclose(u @ turn, state.u, atol=1e-6)
    np.testing.assert_allclose(g @ turn, state.g, atol=1e-6)
    # The ends meet: the last facet's far ruling is the first one, turned round on a one-sided band.
    (last,) = (ends for a, ends in lines(data, "data-end") if a["data-end"] == "last")
    eta_end = (last[0, 0] - last[1, 0]) / (last[0, 1] - last[1, 1])
    assert eta_end == pytest.approx(state.sigma * state.eta[0], abs=1e-6)
    assert np.abs(u.sum(axis=0)).max() < 1e-6


def test_mountains_and_valleys(solved):  # noqa: F811
    """Bending towards g x u is bending away from the reader, who sees the side that u x g points to."""
    state = states_of(solved, "ring")[0]
    data = pattern_svg(fold_pattern(state, 300.0), "a ring")
    kinds = {attributes["class"] for attributes, _ in lines(data, "data-node")}
    inward = -state.midline[:-1] + state.midline[:-1].mean(axis=0)
    bends_to_reader = (np.einsum("ij,ij->i", inward, np.cross(state.u, state.g)) > 0).all()
    assert kinds == {"valley" if bends_to_reader else "mountain"}


def test_letters_say_which_corners_meet(solved):  # noqa: F811
    for name, swapped in (("mobius", True), ("ring", False)):
        data = pattern_svg(fold_pattern(states_of(solved, name)[-1], 300.0), "a band").decode()
        found = re.findall(r'<text class="text" x="([\d.]+)" y="([\d.]+)"[^>]*>([AB])<', data)
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
        widths = {float(a["stroke-width"]) for a, _ in lines(data, "data-node")}
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
    seen: dict[int, list[np.ndarray]] = {}
    for page in found:
        data = pattern_svg(pattern, "a band", paper, page.number)
        assert f'width="{wide:.3f}mm" height="{tall:.3f}mm"'.encode() in data
        for attributes, ends in lines(data, "data-node"):
            seen.setdefault(int(attributes["data-node"]), []).append(ends)
    # Each fold is there from end to end, in parts where a page ends.
    assert set(seen) == set(range(2, state.segments + 1))
    for node, parts in seen.items():
        upper, lower = pattern.folds[node - 2]
        along = (lower - upper) / np.dot(lower - upper, lower - upper)
        spans = sorted(tuple((part - upper) @ along) for part in parts)
        for part, span in zip(parts, [(part - upper) @ along for part in parts], strict=True):
            np.testing.assert_allclose(upper + np.outer(span, lower - upper), part, atol=1e-6)
        assert spans[0][0] == pytest.approx(0.0, abs=1e-6)
        assert max(end for _, end in spans) == pytest.approx(1.0, abs=1e-6)
        assert all(other[0] <= one[1] + 1e-6 for one, other in itertools.pairwise(spans))


def every_page(state, size: float, paper: str | None) -> list[bytes]:
    pattern = fold_pattern(state, size)
    return [pattern_svg(pattern, "a band", paper, page.number) for page in pages(pattern, paper)[2]]


@pytest.mark.parametrize("paper", [None, *PAPERS])
@pytest.mark.parametrize("name", ["mobius", "ring"])
def test_a_cutter_can_go_by_colours(name, paper, solved):  # noqa: F811
    """One colour each for what is cut, folded either way, glued and read, in layers; no window."""
    sheets = every_page(states_of(solved, name)[-1], 600.0, paper)
    assert (len(sheets) > 1) == (paper is not None)
    pairs = set()
    for data in sheets:
        root = ET.fromstring(data)
        assert b"clip" not in data
        assert not list(root.iter(f"{SVG}use"))
        drawn = {item.tag for item in root.iter()} - {
            f"{SVG}{tag}" for tag in ("svg", "g", "title", "metadata")
        }
        assert drawn == {f"{SVG}line", f"{SVG}text"}
        for group in root.iter(f"{SVG}g"):
            assert group.get(f"{INKSCAPE}groupmode") == "layer"
            for item in group:
                assert item.get("class") == group.get("id") == group.get(f"{INKSCAPE}label")
                pairs.add((item.get("class"), item.get("stroke") or item.get("fill")))
    kinds, colours = zip(*pairs, strict=True)
    assert len(set(kinds)) == len(set(colours)) == len(pairs)
    assert {"cut", "glue", "text"} < set(kinds) <= {"cut", "mountain", "valley", "flat", "glue", "text"}


@pytest.mark.parametrize("paper", [None, *PAPERS])
def test_no_line_leaves_its_page(paper, solved):  # noqa: F811
    state = states_of(solved, "mobius")[-1]
    # The flap of a slanted end stands out of the strip.
    slanted = replace(state, eta=np.append(2.0, state.eta[1:]))
    for data in every_page(state, 700.0, paper) + every_page(slanted, 300.0, paper):
        root = ET.fromstring(data)
        wide, tall = (float(root.get(key)[:-2]) for key in ("width", "height"))
        assert root.get("viewBox") == f"0 0 {wide:.3f} {tall:.3f}"
        for line in root.iter(f"{SVG}line"):
            x, y = ([float(line.get(f"{axis}{k}")) for k in (1, 2)] for axis in "xy")
            assert MARGIN - 1e-3 <= min(x) <= max(x) <= wide - MARGIN + 1e-3
            if line.get("class") == "text" or "data-legend" in line.attrib:
                assert 3.0 - 1e-3 <= min(y) <= max(y) <= tall - 3.0 + 1e-3
            else:
                assert MARGIN + HEADER - 1e-3 <= min(y) <= max(y) <= tall - MARGIN + 1e-3


@pytest.mark.parametrize("paper", [None, "A4"])
def test_every_page_has_a_legend_and_bars_of_known_length(paper, solved):  # noqa: F811
    for data in every_page(states_of(solved, "mobius")[-1], 600.0, paper):
        root = ET.fromstring(data)
        bars = {a["data-scale"]: np.linalg.norm(ends[1] - ends[0]) for a, ends in lines(data, "data-scale")}
        assert bars == pytest.approx({"10 mm": 10.0, "1 in": 25.4}, abs=1e-8)
        samples = {a["class"]: a["data-legend"] for a, _ in lines(data, "data-legend")}
        assert samples == {
            **{"cut": "cut", "mountain": "mountain fold", "valley": "valley fold", "glue": "glue"}
        }
        texts = {item.text for item in root.iter(f"{SVG}text")}
        assert texts >= {*samples.values(), *bars}


@pytest.mark.parametrize("name", ["mobius", "ring"])
def test_what_is_cut_is_one_outline_around_strip_and_flap(name, solved):  # noqa: F811
    """Cut along the cuts, the strip with its flap is one piece: nothing else than folds crosses it."""
    pattern = fold_pattern(states_of(solved, name)[-1], 400.0)
    data = pattern_svg(pattern, "a band")
    cuts = [e for a, e in lines(data) if a["class"] == "cut" and "data-legend" not in a]
    ends: dict[tuple[float, ...], int] = {}
    for end in np.round(np.concatenate(cuts), 6).tolist():
        ends[tuple(end)] = ends.get(tuple(end), 0) + 1
    assert len(cuts) == 6
    assert set(ends.values()) == {2}
    corners = [*pattern.first, *pattern.tab]
    assert set(ends) == {tuple(np.round(corner, 6).tolist()) for corner in corners}
    area = 2 * pattern.half_width * pattern.length
    outline = np.array([pattern.first[0], *pattern.tab, pattern.first[1]])
    x, y = outline.T
    assert abs(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1))) / 2 > area
    # The flap's own border with the strip is a fold, and its glue lies inside of it.
    ((seam, joint),) = [(a, e) for a, e in lines(data, "data-end") if a["data-end"] == "last"]
    assert seam["class"] in ("mountain", "valley")
    np.testing.assert_allclose(joint, pattern.tab[[0, 3]], atol=1e-6)
    glue = [e for a, e in lines(data) if a["class"] == "glue" and "data-legend" not in a]
    assert len(glue) == 3
    tab = MplPath(pattern.tab)
    assert all(tab.contains_points(line).all() for line in glue)


@pytest.mark.parametrize("name", ["mobius", "ring"])
def test_the_flap_folds_onto_the_facet_that_it_is_glued_to(name, solved):  # noqa: F811
    """Folded the way of its line, the flap lies in the plane of facet 1."""
    state = states_of(solved, name)[-1]
    data = pattern_svg(fold_pattern(state, 400.0), "a band")
    ends = {a["data-end"]: a for a, _ in lines(data, "data-end")}
    angle = abs(float(ends["last"]["data-angle"]))
    signed = angle if ends["last"]["class"] == "mountain" else -angle
    folds = lines(data, "data-node")
    (last,) = (e for a, e in lines(data, "data-end") if a["data-end"] == "last")
    eta = [(e[0, 0] - e[1, 0]) / (e[0, 1] - e[1, 1]) for e in (*(e for _, e in folds), last)]
    degrees = [0.0, *(float(a["data-angle"]) for a, _ in folds), signed]
    frame = frames(Folding(np.radians(degrees), np.array([0.0, *eta])), np.eye(3))
    # Columns t, n, b: the direction is that of facet 1 again, the printed side turned if there is but one.
    np.testing.assert_allclose(frame[-1][:, 0], frame[0][:, 0], atol=1e-6)
    np.testing.assert_allclose(frame[-1][:, 1], state.sigma * frame[0][:, 1], atol=1e-6)


def test_the_pdf_has_true_scale(solved):  # noqa: F811
    pattern = fold_pattern(states_of(solved, "mobius")[-1], 500.0)
    data = pattern_pdf(pattern, "a band", "A4")
    boxes = [tuple(map(float, box)) for box in re.findall(rb"/MediaBox \[ 0 0 ([\d.]+) ([\d.]+) \]", data)]
    assert len(boxes) == len(pages(pattern, "A4")[2]) == 2
    for wide, tall in boxes:
        assert (wide / 72 * 25.4, tall / 72 * 25.4) == pytest.approx((297.0, 210.0), abs=0.01)


def test_the_pdf_embeds_its_fonts_and_hides_nothing(solved):  # noqa: F811
    """TrueType, as other pictures have it, and no window other than the page."""
    data = pattern_pdf(fold_pattern(states_of(solved, "mobius")[-1], 500.0), "a $band$", "A4")
    assert b"/FontFile2" in data
    assert b"/Type3" not in data
    streams = [
        zlib.decompress(part) for part in re.findall(rb"stream\r?\n(x.*?)\r?\nendstream", data, re.DOTALL)
    ]
    pages_ = [stream for stream in streams if b" l\n" in stream]
    assert len(pages_) == 2
    assert not any(re.search(rb"(?m)^W\*? n|\bW n\b", stream) for stream in pages_)


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

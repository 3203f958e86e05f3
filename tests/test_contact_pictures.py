"""Bands that rest on themselves in pictures and exports: places of contact, forces, maps, branches."""

from __future__ import annotations

import base64
import io
import json
import re
from dataclasses import replace

import h5py
import numpy as np
import pytest
import trimesh
from matplotlib.collections import PathCollection, PolyCollection
from resting_support import resting_record
from store_support import make_summary

from ribbon_cli import analysis
from ribbon_cli.errors import UsageError
from ribbon_cli.export.arrows import LONGEST, arrow_triangles, per_force
from ribbon_cli.export.contacts import counted, gathered, touching
from ribbon_cli.export.fields import Window, even_window
from ribbon_cli.export.gltf import glb_bytes
from ribbon_cli.export.mesh import facet_corners, facet_normals
from ribbon_cli.export.view import chosen_view
from ribbon_cli.export.viewer import viewer_html
from ribbon_cli.export.vtkhdf import vtkhdf_bytes
from ribbon_cli.export.words import contact_warning, verdict
from ribbon_cli.model.band import Band, State
from ribbon_cli.model.touching import Shape
from ribbon_cli.model.touching_gaps import Pairs, arguments, gaps, places, vectors
from ribbon_cli.plot.canvas import Figure
from ribbon_cli.plot.contacts import contacts_figure
from ribbon_cli.plot.kinds import Source, draw
from ribbon_cli.plot.levels import branch_figure
from ribbon_cli.plot.shape import draw_shape
from ribbon_cli.plot.style import STYLES
from ribbon_cli.store import StateRecord

PAPER = STYLES["paper"]
NAMES = ("pi-b1.65-N100", "3pi-b0.9-N120")


@pytest.fixture(params=NAMES)
def record(request: pytest.FixtureRequest) -> StateRecord:
    """Vertices in facets, and vertices and edges that meet edges."""
    return resting_record(request.param)


@pytest.fixture(params=[NAMES[0], pytest.param(NAMES[1], marks=pytest.mark.long)])
def drawn(request: pytest.FixtureRequest) -> StateRecord:
    """The same for what takes its time to be drawn."""
    return resting_record(request.param)


def source(*states: StateRecord) -> Source:
    return Source(None, states, analysis.run_table, analysis.multiplier_curves)


def without_contacts(record: StateRecord) -> StateRecord:
    """The state as one that touches nothing, computed with contact forces."""
    none = record.contacts
    assert none is not None
    fewer = {name: getattr(none, name)[:0] for name in ("first", "second", "sign", "force", "value")}
    return replace(record, contacts=replace(none, **fewer, clearance=0.1), self_contact=False)


def test_places_are_those_of_the_gaps(record):
    """Both places are a gap apart, along the normal, and lie on the features."""
    found = touching(record)
    contacts = record.contacts
    apart = found.places[:, 0] - found.places[:, 1]
    np.testing.assert_allclose((apart * found.normals).sum(1), contacts.value, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(apart, axis=1), np.abs(contacts.value), atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(found.normals, axis=1), 1.0)
    band = Band(record.segments, record.half_width, sigma=record.sigma)
    shape = Shape.of(State(band, record.u, record.g, record.xi))
    pairs = Pairs(contacts.first, contacts.second, contacts.sign.astype(float))
    at = places(shape, pairs)
    for k, (kind, number) in enumerate(contacts.first.tolist()):
        if kind == 0:
            expected = shape.vertices[number]
        else:
            ends = shape.vertices[np.array(shape.edge_ends(np.array([number]))).ravel()]
            expected = ends[0] + at[k, 0] * (ends[1] - ends[0])
        np.testing.assert_allclose(found.places[k, 0], expected, atol=1e-9)


def test_a_force_does_work_where_its_gap_opens(record):
    """The force on the first feature is the derivative of f g by the place of that feature."""
    contacts, found = record.contacts, touching(record)
    band = Band(record.segments, record.half_width, sigma=record.sigma)
    shape = Shape.of(State(band, record.u, record.g, record.xi))
    what = arguments(Pairs(contacts.first, contacts.second, contacts.sign.astype(float)))
    gradient = gaps(vectors(shape, what), what, contacts.sign.astype(float), record.half_width).gradient
    # The first of a gap's six vectors is the node that its first feature hangs on.
    np.testing.assert_allclose(contacts.force[:, None] * gradient[:, 0], found.arrows[1][::2], atol=1e-9)
    np.testing.assert_array_equal(found.arrows[1][::2], -found.arrows[1][1::2])


def test_flat_places_fold_up_to_those_in_space(record):
    """On its facet a flat place is the place in space; it lies in the strip and far from the other."""
    found = touching(record)
    h = record.length / record.segments
    for k in range(len(found)):
        for side in (0, 1):
            s, y = found.flat[k, side]
            assert abs(y) <= record.half_width + 1e-9
            feature = (record.contacts.first, record.contacts.second)[side][k]
            facet = int(feature[1]) // (2, 3, 1)[int(feature[0])]
            along = s - h * facet - y * record.eta[facet]
            place = record.midline[facet] + along * record.u[facet] + y * record.g[facet]
            np.testing.assert_allclose(place, found.places[k, side], atol=1e-9)
    assert (np.linalg.norm(found.flat[:, 0] - found.flat[:, 1], axis=1) > record.contacts.excluded).all()


def test_counting_on_turns_the_strip_over_at_the_seam(record):
    flat = touching(record).flat
    same = counted(record, flat, Window(0, 0.0, 1))
    h = record.length / record.segments
    moved = counted(record, flat, Window(7, 0.3 * h, 1))
    assert ((moved[..., 0] >= 0) & (moved[..., 0] < record.length)).all()
    step = moved[..., 0] - same[..., 0] + 6.7 * h
    came_round = step > 0.5 * record.length
    np.testing.assert_allclose(np.where(came_round, step - record.length, step), 0.0, atol=1e-9)
    assert came_round.any() or NAMES[0] not in record.stage
    np.testing.assert_array_equal(moved[..., 1], np.where(came_round, record.sigma, 1) * same[..., 1])
    np.testing.assert_array_equal(counted(record, flat, Window(7, 0.3 * h, -1))[..., 1], -moved[..., 1])


def test_neighbouring_contacts_are_one_place():
    pi, three = map(resting_record, NAMES)
    assert [group.tolist() for group in gathered(pi, touching(pi).flat)] == [[0, 1], [2, 3]]
    groups = gathered(three, touching(three).flat)
    assert sorted(np.concatenate(groups).tolist()) == list(range(6))
    assert len(groups) == 3


def test_arrows_are_closed_and_point_outwards():
    places = np.zeros((3, 3))
    ways = np.array([[0.5, 0.0, 0.0], [0.0, 0.02, 0.0], [0.0, 0.0, 0.0]])
    corners, normals = arrow_triangles(places, ways, 6.28)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0)
    body = trimesh.Trimesh(
        corners[: len(corners) // 2].reshape(-1, 3), np.arange(3 * len(corners) // 2).reshape(-1, 3)
    )
    assert body.bounds[1, 0] == pytest.approx(0.5)
    assert body.volume > 0.0
    # What no length has is left out, and a short arrow is slender.
    assert np.abs(corners[len(corners) // 2 :, :, 0]).max() < 0.02


def test_the_longest_arrow_has_one_length(record):
    """Of several states the same length stands for the same force."""
    each = per_force([record])
    assert each * record.contacts.force.max() == pytest.approx(LONGEST * record.length)
    weaker = replace(record, contacts=replace(record.contacts, force=0.1 * record.contacts.force))
    assert per_force([weaker, record]) == each
    assert per_force([without_contacts(record)]) == 0.0


def test_shapes_have_arrows_in_the_picture(drawn):
    figure = Figure()
    axes = figure.subplots()
    view = chosen_view(facet_corners(drawn), None)
    draw_shape(axes, drawn, PAPER, view)
    bare = len(axes.collections)
    axes = Figure().subplots()
    draw_shape(axes, drawn, PAPER, view, each=per_force([drawn]))
    heads = [c for c in axes.collections if isinstance(c, PolyCollection)][1:]
    assert len(axes.collections) > bare
    assert 0 < len(heads) <= 2 * len(drawn.contacts)
    (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
    for head in heads:
        x, y = head.get_paths()[0].vertices.T
        assert left <= x.min() < x.max() <= right
        assert low <= y.min() < y.max() <= high


def test_the_key_of_forces_has_their_scale(drawn):
    picture = draw("shape", source(drawn), PAPER)
    (axes,) = picture.figure.axes
    (text,) = [t for t in axes.texts if t.get_text().startswith("force ")]
    force = float(text.get_text().removeprefix("force "))
    arrow = [c for c in axes.collections if isinstance(c, PolyCollection)][-1].get_paths()[0].vertices
    assert arrow[:, 0].max() - axes.get_xlim()[0] == pytest.approx(force * per_force([drawn]))
    assert 0.3 * LONGEST * drawn.length < force * per_force([drawn]) <= LONGEST * drawn.length
    row = draw("shape", source(drawn, drawn), PAPER).figure
    (legend,) = row.legends
    assert f"longest {drawn.contacts.force.max():.3g}" in legend.get_texts()[0].get_text()
    assert not draw("shape", source(without_contacts(drawn)), PAPER).figure.axes[0].lines[1:]


def test_a_map_has_each_contact_twice_and_its_places_on_the_strip(drawn):
    figure = contacts_figure(drawn, PAPER)
    plane, strip = figure.axes[:2]
    flat = counted(drawn, touching(drawn).flat, even_window(drawn))
    one, other = [
        np.sort(c.get_offsets().data.view(complex).ravel())
        for c in plane.collections
        if isinstance(c, PathCollection)
    ]
    pairs = flat[:, 0, 0] + 1j * flat[:, 1, 0]
    np.testing.assert_allclose(one, np.sort(pairs))
    np.testing.assert_allclose(np.sort(other.imag + 1j * other.real), np.sort(pairs))
    marked = np.concatenate(
        [c.get_offsets().data for c in strip.collections if isinstance(c, PathCollection)]
    )
    assert sorted(map(tuple, marked.round(9))) == sorted(map(tuple, flat.reshape(-1, 2).round(9)))
    count = len(gathered(drawn, touching(drawn).flat))
    numbers = [text.get_text() for text in plane.texts]
    assert sorted(numbers) == sorted(2 * [str(k + 1) for k in range(count)])
    # On the strip, where three contacts share three places, each place has both of its numbers.
    assert sorted(n for text in strip.texts for n in text.get_text().split(", ")) == sorted(numbers)
    assert len(strip.texts) == {4: 4, 6: 3}[len(pairs)]
    figure.draw_without_rendering()
    assert plane.get_position().x0 == pytest.approx(strip.get_position().x0)
    assert plane.get_position().x1 == pytest.approx(strip.get_position().x1)


def test_rulings_of_a_map_are_those_of_the_strip(record):
    """Each ruling of a map runs from edge to edge with the slope eta of a stored node."""
    strip = contacts_figure(record, PAPER).axes[1]
    lines = np.array(strip.collections[0].get_segments())
    assert np.allclose(np.abs(lines[:, :, 1]), record.half_width)
    slopes = (lines[:, 1, 0] - lines[:, 0, 0]) / (lines[:, 1, 1] - lines[:, 0, 1])
    assert np.abs(np.abs(slopes)[:, None] - np.abs(record.eta)).min(axis=1).max() < 1e-9
    # At both ends of the map the same rulings, upside down on a one-sided band.
    inside = (lines.mean(axis=1)[:, 0] >= 0) & (lines.mean(axis=1)[:, 0] < record.length)
    assert inside.sum() == len(lines) // 3


def test_what_was_computed_without_forces_has_no_map(record):
    free = replace(record, contacts=None)
    with pytest.raises(UsageError, match="computed without contact forces"):
        draw("contacts", source(free), PAPER)
    picture = draw("contacts", source(without_contacts(record)), PAPER)
    assert picture.title.startswith("No contact")


def test_words_tell_rest_from_passage(record):
    assert verdict(record).endswith(f"forces of {record.contacts.total_force:.6g} in all")
    assert contact_warning([record]) == ""
    free = replace(record, contacts=None)
    assert "no contact forces" in verdict(free)
    assert "no contact forces" in contact_warning([free])
    assert "itself" not in verdict(without_contacts(record))


def test_vtkhdf_has_a_point_for_each_sheet_of_a_contact(record):
    touched = touching(record)
    free = replace(record, contacts=None, self_contact=False)
    with h5py.File(io.BytesIO(vtkhdf_bytes([record, without_contacts(record)], "a band"))) as file:
        root = file["VTKHDF"]
        n, count = record.segments, 2 * len(touched)
        assert root["NumberOfPoints"][:].tolist() == [2 * n + count, 2 * n]
        assert root["NumberOfCells"][:].tolist() == [n + count, n]
        assert root["Types"][:].tolist() == n * [9] + count * [1] + n * [9]
        np.testing.assert_array_equal(root["Points"][2 * n : 2 * n + count], touched.arrows[0])
        force = root["PointData/contact_force"][:]
        np.testing.assert_array_equal(force[2 * n : 2 * n + count], touched.arrows[1])
        assert not force[: 2 * n].any()
        assert root["PointData/contact"][2 * n : 2 * n + 4].tolist() == [1, 1, 2, 2]
        offsets = root["Offsets"][: n + count + 1]
        assert np.diff(offsets).tolist() == n * [4] + count * [1]
        assert root["Connectivity"][4 * n : 4 * n + count].tolist() == list(range(2 * n, 2 * n + count))
        assert root["Steps/ConnectivityIdOffsets"][:].ravel().tolist() == [0, 4 * n + count]
        assert root["CellData/facet"][n : n + count].tolist() == count * [0]
        assert root["FieldData/contacts"][:].tolist() == [len(touched), 0]
    with h5py.File(io.BytesIO(vtkhdf_bytes([free], "a band"))) as file:
        assert "contact" not in file["VTKHDF/PointData"]


def test_gltf_has_a_mesh_of_arrows(record):
    scene = trimesh.load_scene(io.BytesIO(glb_bytes(record, "a band", None)), file_type="glb", process=False)
    band, forces = (scene.geometry[name] for name in ("band", "forces"))
    assert len(band.faces) == 2 * record.segments
    tips = touching(record).arrows[0] + per_force([record]) * touching(record).arrows[1]
    far = np.linalg.norm(forces.vertices[:, None] - tips[None], axis=2).min(axis=0)
    assert far.max() < 1e-6
    free = glb_bytes(without_contacts(record), "a band", None)
    assert list(trimesh.load_scene(io.BytesIO(free), file_type="glb").geometry) == ["band"]


def test_the_viewer_has_the_arrows_where_the_band_is(record):
    page = viewer_html([record, without_contacts(record)], "a band", None).decode()
    states = json.loads(re.search(r'type="application/json">(.*?)</script>', page, re.S)[1])["states"]
    arrows = np.frombuffer(base64.b64decode(states[0]["arrows"]), "<f4").reshape(-1, 3, 3)
    corners = np.frombuffer(base64.b64decode(states[0]["corners"]), "<f4").reshape(-1, 3)
    assert len(arrows) % (2 * len(record.contacts)) == 0
    # The shape was shifted alone: arrows begin as far from the same vertices as they do in space.
    shift = facet_corners(record).reshape(-1, 3)[0] - corners[0]
    tips = touching(record).arrows[0] + per_force([record]) * touching(record).arrows[1] - shift
    assert np.linalg.norm(arrows.reshape(-1, 3)[:, None] - tips, axis=2).min(axis=0).max() < 1e-5
    assert states[0]["forces"] == record.contacts.force.tolist()
    assert states[1]["arrows"] == ""
    assert states[1]["forces"] == []


def test_normals_lead_from_sheet_to_sheet(record):
    """A vertex that a facet holds up is pushed along the facet's normal."""
    found = touching(record)
    for k, (kind, number) in enumerate(record.contacts.second.tolist()):
        if kind == 2:
            assert abs(found.normals[k] @ facet_normals(record)[number]) == pytest.approx(1.0)


def test_a_branch_with_forces_marks_what_touches_and_lifts():
    rows = [
        (1.5, 42.0, 0, 0.0, ()),
        (1.51, 42.4, 0, 0.0, ("touch",)),
        (1.55, 50.0, 3, 8.0, ()),
        (1.6, 61.0, 2, 30.0, ()),
    ]
    states = [
        make_summary(
            label=k + 1, half_width=b, energy=e, contacts=count, contact_force=force, event_kinds=kinds,
            events=("",) * len(kinds), self_contact=count > 0, certified=True, status="minimum",
        )
        for k, (b, e, count, force, kinds) in enumerate(rows)
    ]  # fmt: skip
    changes = [s for s in states if s.event_kinds]
    figure = branch_figure(states, [1.0] * 4, PAPER, changes=changes)
    assert [axes.get_title(loc="left") for axes in figure.axes][3] == "contact force"
    force = figure.axes[3]
    np.testing.assert_array_equal(force.get_lines()[0].get_ydata(), [0.0, 0.0, 8.0, 30.0])
    labels = [line.get_label() for line in force.get_lines()]
    assert labels.count("touch") == 1
    assert "lift" not in labels
    assert "self-contact" not in labels  # what rests on itself is no warning
    without = [replace(s, contacts=None, contact_force=None) for s in states]
    figure = branch_figure(without, [1.0] * 4, PAPER)
    assert len(figure.axes) == 3
    assert "self-contact" in [line.get_label() for line in figure.axes[0].get_lines()]

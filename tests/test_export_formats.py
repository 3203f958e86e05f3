"""Exports, read back by other programs' readers."""

from __future__ import annotations

import base64
import csv
import io
import json
import re
import warnings
from dataclasses import replace
from pathlib import Path

import meshio
import numpy as np
import pandas
import pytest
import trimesh
from cli_support import ribbon, ribbon_json
from picture_support import solved, states_of, written  # noqa: F401

from ribbon_cli.errors import UsageError
from ribbon_cli.export.formats import FORMATS
from ribbon_cli.export.mesh import facet_corners, is_closed, strip
from ribbon_cli.export.meshes import obj_bytes, ply_bytes, stl_bytes
from ribbon_cli.export.solid import printed, solid
from ribbon_cli.export.text import csv_bytes, json_bytes
from ribbon_cli.export.viewer import viewer_html
from ribbon_cli.report.convergence import Table
from ribbon_cli.report.tables import as_csv
from ribbon_cli.store import StateRecord, Summary, content_sha256


@pytest.fixture(params=["mobius", "ring", "open"])
def state(request: pytest.FixtureRequest, solved: Path) -> StateRecord:  # noqa: F811
    """A one-sided band, a two-sided one, and a strip whose seam is open."""
    if request.param == "open":
        return states_of(solved, "mobius", "auxiliary")[4]
    return states_of(solved, request.param)[-1]


def read_mesh(data: bytes, suffix: str, tmp_path: Path):
    """A file as meshio reads it."""
    path = tmp_path / f"band{suffix}"
    path.write_bytes(data)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return meshio.read(path)


def test_facets_are_flat_and_the_seam_is_joined(state):
    mesh = strip(state)
    assert mesh.closed == is_closed(state) == (state.kind == "equilibrium")
    corners = mesh.points[mesh.quads]
    np.testing.assert_allclose(corners, facet_corners(state), atol=1e-9)
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    out_of_plane = np.einsum("ij,ij->i", across, corners[:, 3] - corners[:, 0])
    assert np.abs(out_of_plane).max() < 1e-9


def test_obj_is_read_back(state, tmp_path):
    read = read_mesh(obj_bytes(state, "a band"), ".obj", tmp_path)
    mesh = strip(state)
    np.testing.assert_array_equal(read.points, mesh.points)
    (cells,) = read.cells
    assert cells.type == "quad"
    np.testing.assert_array_equal(cells.data, mesh.quads)


def test_ply_is_read_back(state):
    read = trimesh.load(io.BytesIO(ply_bytes(state, "a band")), file_type="ply", process=False)
    mesh = strip(state)
    np.testing.assert_array_equal(read.vertices, mesh.points)
    # trimesh cuts each quadrilateral in two.
    assert len(read.faces) == 2 * state.segments
    assert {
        frozenset(face) <= frozenset(quad)
        for face, quad in zip(read.faces[: state.segments].tolist(), mesh.quads.tolist(), strict=True)
    } == {True}
    raw = read.metadata["_ply_raw"]
    np.testing.assert_array_equal(
        raw["vertex"]["data"]["eta"][: 2 * state.segments : 2], written(state, "eta")
    )
    np.testing.assert_array_equal(np.ravel(raw["face"]["data"]["lambda_5"]), state.lambda_5)


def test_the_solid_is_watertight_and_oriented(state, tmp_path):
    path = tmp_path / "band.stl"
    path.write_bytes(stl_bytes(state, "a band", printed(state, 200.0, 1.0)))
    body = solid(state, state.length / 200.0)
    exact = trimesh.Trimesh(body.points, body.triangles, process=False)
    for mesh in (exact, trimesh.load_mesh(path)):
        assert mesh.is_watertight
        assert mesh.is_winding_consistent
    # A flat wall has thickness times area; a thin one's folds change that by little.
    area = 2 * state.half_width * state.length
    thin = solid(state, 0.005)
    assert trimesh.Trimesh(thin.points, thin.triangles, process=False).volume == pytest.approx(
        area * 0.005, rel=5e-4
    )
    # A closed band's skin is a torus, an open strip's a sphere.
    assert exact.euler_number == (0 if is_closed(state) else 2)


def test_no_solid_begins_with_the_word_of_text_files(solved, tmp_path):  # noqa: F811
    """A run may be called solid-ring; readers go by the first five letters."""
    state = states_of(solved, "ring")[-1]
    data = stl_bytes(state, f"solid-ring-{'0' * 60}:3, b = 0.5", printed(state, 200.0, 1.0))
    assert not data.startswith(b"solid")
    assert content_sha256(state)[:12].encode() in data[:80]
    assert len(read_mesh(data, ".stl", tmp_path).cells[0].data) == int.from_bytes(data[80:84], "little")


def test_walls_keep_their_thickness(state):
    thickness = 0.02
    body = solid(state, thickness)
    assert body.joined == 0
    points = body.points
    corners = facet_corners(state)
    normal = np.cross(state.g, state.u)
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    heights = np.einsum("ij,ij->i", points.reshape(-1, 4, 3)[: state.segments, 0] - corners[:, 1], normal)
    np.testing.assert_allclose(heights, thickness / 2, rtol=1e-9)


@pytest.mark.parametrize("thickness", [0.0, -1.0, float("nan")])
def test_no_thickness_no_solid(solved, thickness):  # noqa: F811
    with pytest.raises(UsageError, match="thickness must be positive"):
        solid(states_of(solved, "ring")[0], thickness)


def test_no_wall_thicker_than_the_band_is_wide(solved):  # noqa: F811
    (ring, *_) = states_of(solved, "ring")
    solid(ring, 1.99 * ring.half_width)
    with pytest.raises(UsageError, match="less than the band's width 2 b, got 1 times"):
        solid(ring, 2.0 * ring.half_width)


def test_csv_holds_every_field_exactly(state):
    rows = list(csv.DictReader(io.StringIO(csv_bytes(state, "run-1").decode())))
    assert len(rows) == state.segments
    for name in ("kappa_s", "tau", "eta", "eta_prime", "xi", "lambda_1", "lambda_3"):
        np.testing.assert_array_equal([float(row[name]) for row in rows], written(state, name))
    np.testing.assert_array_equal([float(row["midline_y"]) for row in rows], state.midline[:-1, 1])
    h = state.length / state.segments
    assert float(rows[2]["alpha_facet"]) == pytest.approx(2.5 * h)
    # Which state it is, in every row: files can be joined, and none begins with lines that are no table.
    expected = {"run": "run-1", "label": str(state.label), "kind": state.kind, "energy": repr(state.energy)}
    expected |= {"twist": repr(state.twist), "writhe": repr(state.writhe)}
    expected |= {"certified": str(state.certified), "content_sha256": content_sha256(state)}
    assert all(expected.items() <= row.items() for row in rows)


def test_pandas_reads_every_csv_without_being_told_anything(solved, tmp_path):  # noqa: F811
    tables = {}
    for name, words in {
        "state": ("export", "mobius@b=0.2,N=24", "--to", "csv"),
        "convergence": ("convergence-table", "mobius", "--format", "csv"),
        "spectrum": ("spectrum", "mobius@b=0.2,N=24", "--format", "csv"),
        "spectra": ("spectrum", "mobius", "--full", "--format", "csv"),
        "orders": ("spectrum", "mobius", "--convergence", "--format", "csv"),
    }.items():
        path = tmp_path / f"{name}.csv"
        assert ribbon(*words, "-o", path, "--runs", solved).exit_code == 0, name
        found = tables[name] = pandas.read_csv(path)
        rows = list(csv.DictReader(io.StringIO(path.read_text(encoding="utf-8"))))
        assert list(found.columns) == list(rows[0])
        assert len(found) == len(rows) > 1
        assert found.index.equals(pandas.RangeIndex(len(rows)))
        for column in found.select_dtypes("float"):
            values = [float(row[column] or "nan") for row in rows]
            # Older ones round what they read: docs/format.md.
            np.testing.assert_allclose(found[column], values, rtol=1e-12)
    (state,) = [s for s in states_of(solved, "mobius") if (s.half_width, s.segments) == (0.2, 24)]
    assert set(tables["state"]["content_sha256"]) == {content_sha256(state)}
    assert tables["state"]["certified"].all()
    assert tables["convergence"]["certified"].dtype == bool
    assert tables["spectrum"]["value"].dtype == float


def test_a_table_without_rows_is_a_csv_file_still(tmp_path):
    path = tmp_path / "empty.csv"
    path.write_text(as_csv(Table((), (), 1.0)), encoding="utf-8")
    assert pandas.read_csv(path).columns[:3].tolist() == ["half_width", "segments", "energy"]


def test_nothing_is_made_up_for_a_cut(solved):  # noqa: F811
    """Where there are no folds or multipliers, the viewer's page holds not-a-number and no zero."""
    cut = states_of(solved, "mobius", "auxiliary")[4]
    made = replace(cut, **{f"lambda_{k}": np.full(cut.segments, np.nan) for k in range(1, 6)})
    page = viewer_html([made], "a strip", None).decode()
    found = json.loads(re.search(r'id="data" type="application/json">(.*?)</script>', page)[1])
    fields = {
        name: np.frombuffer(base64.b64decode(text), "<f4")
        for name, text in found["states"][0]["fields"].items()
    }
    for name in ("kappa_s", "tau", "eta"):
        assert np.isnan(fields[name]).tolist() == [True] + [False] * (cut.segments - 1)
    assert np.isfinite(fields["eta_prime"]).all()
    assert all(np.isnan(fields[f"lambda_{k}"]).all() for k in range(1, 6))


def test_json_holds_the_summary_and_the_arrays(state):
    document = json.loads(json_bytes(state, "run-1"))
    assert document["content_sha256"] == content_sha256(state)
    assert {key: document[key] for key in Summary.of(state).listed("run-1")} == Summary.of(state).listed(
        "run-1"
    )
    np.testing.assert_array_equal(document["arrays"]["g"], state.g)
    assert document["arrays"].keys() >= {"lambda_1", "gamma", "midline", "g_end"}
    for spectrum in state.spectra:
        np.testing.assert_array_equal(document["spectra"][spectrum.metric]["values"], spectrum.values)


def test_json_has_no_nan(state):
    json.loads(json_bytes(replace(state, twist=float("nan")), None), parse_constant=pytest.fail)


@pytest.mark.parametrize("form", [*FORMATS])
def test_every_format_from_the_command_line(form, solved, tmp_path):  # noqa: F811
    path = tmp_path / f"band.{form}"
    words = ("export", "mobius@b=0.2,N=24", "--to", form, "-o", path, "--runs", solved)
    assert ribbon_json(*words)["path"] == str(path)
    first = path.read_bytes()
    assert len(first) > 1000
    result = ribbon(*words)
    assert result.exit_code == 2
    assert "exists already" in result.stderr
    assert ribbon(*words, "--overwrite").exit_code == 0
    assert path.read_bytes() == first  # the same state gives the same bytes


def test_a_run_is_exported_as_a_series(solved, tmp_path):  # noqa: F811
    words = ("export", "mobius", "--to", "vtkhdf", "-o", tmp_path / "a.vtkhdf", "--runs", solved)
    assert len(ribbon_json(*words)["states"]) == 2
    result = ribbon("export", "mobius", "--to", "obj", "--runs", solved)
    assert result.exit_code == 2
    assert "obj takes one state" in result.stderr


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--to", "obj", "--size", "3"), "--size does nothing for obj: it is for stl, svg, pdf"),
        (("--to", "svg", "--paper", "A5"), "no paper 'A5' (known: A4, Letter)"),
        (("--to", "pdf", "--size", "9000"), "take a smaller --size"),
        (("--to", "pdf", "--size", "-1"), "a size must be a positive number"),
        (("--to", "stl", "--thickness", "0"), "a thickness must be positive"),
        (("--to", "npz", "--size", "1"), "npz has no options"),
        (("--to", "vtkhdf", "--segments", "24"), "--segments goes with a run"),
    ],
)
def test_options_that_make_no_sense(words, message, solved, tmp_path):  # noqa: F811
    result = ribbon("export", "mobius@b=0.2,N=24", *words, "-o", tmp_path / "x", "--runs", solved)
    assert result.exit_code == 2
    assert message in result.stderr
    assert not list(tmp_path.iterdir())

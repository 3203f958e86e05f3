"""Exports of open strips, read back: areas, energies, folds and ends."""

from __future__ import annotations

import csv
import io
import json
import re
from pathlib import Path

import h5py
import numpy as np
import pytest
from cli_support import ribbon
from picture_support import states_of
from strip_runs import strips

from ribbon_cli.export.gltf import glb_bytes
from ribbon_cli.export.mesh import end_value, facet_corners, strip
from ribbon_cli.export.meshes import obj_bytes, ply_bytes
from ribbon_cli.export.pattern import fold_pattern
from ribbon_cli.export.solid import printed
from ribbon_cli.export.svg import pattern_svg
from ribbon_cli.export.text import csv_bytes, json_bytes
from ribbon_cli.export.viewer import viewer_html
from ribbon_cli.export.vtkhdf import vtkhdf_bytes
from ribbon_cli.store import StateRecord

__all__ = ["strips"]
Array = np.ndarray
NAMES = ("sheared", "cantilever", "branch")


def last(root: Path, name: str) -> StateRecord:
    return states_of(root, name)[-1]


def area(corners: Array) -> float:
    """Area of flat quadrilaterals (n, 4, 3)."""
    across = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    return float(0.5 * np.linalg.norm(across, axis=1).sum())


def strip_area(record: StateRecord) -> float:
    return 2.0 * record.half_width * record.length


@pytest.mark.parametrize("name", NAMES)
def test_surfaces_have_all_rulings_and_the_strips_area(strips: Path, name: str) -> None:
    record = last(strips, name)
    n = record.segments
    lines = obj_bytes(record, "x").decode().splitlines()
    points = np.array([line.split()[1:] for line in lines if line.startswith("v ")], dtype=float)
    quads = np.array([line.split()[1:] for line in lines if line.startswith("f ")], dtype=int) - 1
    assert points.shape == (2 * (n + 1), 3)
    assert area(points[quads]) == pytest.approx(strip_area(record), rel=1e-9)
    np.testing.assert_allclose(points[-1] - points[-2], 2 * record.half_width * record.g_end, atol=1e-12)
    assert f"element vertex {2 * (n + 1)}".encode() in ply_bytes(record, "x")
    assert len(glb_bytes(record, "x", None)) > 100
    body = printed(record, 200.0, 1.0)
    corners = body.points[body.triangles]
    volume = float(np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6)
    assert volume == pytest.approx(strip_area(record) * 200.0**2 / record.length**2, rel=0.03)


@pytest.mark.parametrize("name", NAMES)
def test_vtkhdf_reads_back_with_area_energy_and_parameters(strips: Path, name: str) -> None:
    records = [r for r in states_of(strips, name) if r.segments == 20][:2]
    with h5py.File(io.BytesIO(vtkhdf_bytes(records, "x"))) as file:
        root = file["VTKHDF"]
        count = 2 * (records[0].segments + 1)
        first = root["Points"][:count]
        cells = root["Connectivity"][:].reshape(-1, 4)[: records[0].segments]
        assert area(first[cells]) == pytest.approx(strip_area(records[0]), rel=1e-9)
        assert root["FieldData/energy"][0] == records[0].energy
        kappa = root["PointData/kappa_s"][:count]
        assert np.isfinite(kappa).all()
        for parameter in records[0].parameters:
            own = parameter if parameter == "half_width" else f"parameter_{parameter}"
            stored = root[f"FieldData/{own}"][:].tolist()
            assert stored == [record.parameters[parameter] for record in records]
        # Tw and not the angle of the end, which has the same name among the parameters.
        twist, writhe = root["FieldData/twist"][:], root["FieldData/writhe"][:]
        assert twist.tolist() == [record.twist for record in records]
        np.testing.assert_allclose(twist + writhe, root["FieldData/linking_number"][:], atol=1e-12)
        if name == "cantilever":
            assert root["Steps/Values"][:].tolist() == [r.parameters["end_force_y"] for r in records]


def test_the_end_has_the_curvature_of_the_start_by_symmetry(strips: Path) -> None:
    for name in ("sheared", "branch"):
        record = last(strips, name)
        for field in ("kappa_s", "tau"):
            assert end_value(record, field) == pytest.approx(getattr(record, field)[0], abs=1e-9)
    assert last(strips, "sheared").kappa_s[0] != 0.0
    free = last(strips, "cantilever")
    assert end_value(free, "kappa_s") == 0.0
    assert np.isnan(end_value(free, "lambda_3"))


@pytest.mark.parametrize("name", NAMES)
def test_the_bending_energy_follows_from_the_pattern_alone(strips: Path, name: str) -> None:
    """Narrow strips: E is about b / 2 sum theta^2 / h, twice that where a fold spans half a cell."""
    record = last(strips, name)
    pattern = fold_pattern(record, 1000.0 * record.length)
    h = record.length / record.segments
    folds = np.radians(pattern.angles)
    clamps = np.radians([pattern.seam, pattern.end])
    found = record.half_width / (2 * h) * (float((folds**2).sum()) + 2 * float((clamps**2).sum()))
    bending = record.energy if record.bending_energy is None else record.bending_energy
    assert found == pytest.approx(bending, rel=0.1 if name == "sheared" else 5e-3)


def folded(pattern: object, record: StateRecord) -> Array:
    """The midline's directions (N, 3) of the folded pattern, from its first clamp."""
    eta = 0.5 * (pattern.folds[:, 0, 0] - pattern.folds[:, 1, 0]) / pattern.half_width  # type: ignore[attr-defined]
    etas = np.concatenate(([record.parts.ends.start_eta], eta))  # type: ignore[union-attr]
    angles = np.radians(np.concatenate(([pattern.seam], pattern.angles)))  # type: ignore[attr-defined]
    frame, out = np.eye(3), []
    for lean, angle in zip(etas, angles, strict=True):
        axis = np.array([lean, 0.0, 1.0]) / np.hypot(lean, 1.0)
        skew = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
        frame = frame @ (np.eye(3) + np.sin(angle) * skew + (1 - np.cos(angle)) * skew @ skew)
        out.append(frame[:, 0])
    return np.array(out)


@pytest.mark.parametrize("name", ["sheared", "cantilever"])
def test_the_pattern_folds_from_its_clamp_to_the_state(strips: Path, name: str) -> None:
    record = last(strips, name)
    np.testing.assert_allclose(folded(fold_pattern(record, 500.0), record), record.u, atol=1e-7)


def test_the_pattern_marks_clamps_and_has_no_glue(strips: Path) -> None:
    clamped = pattern_svg(fold_pattern(last(strips, "sheared"), 300.0), "x", None, 1).decode()
    assert len(re.findall(r'data-held="clamped" data-angle="', clamped)) == 2
    assert 'id="glue"' not in clamped
    assert "its flap lies in a clamp up to the fold" in clamped
    half_free = pattern_svg(fold_pattern(last(strips, "cantilever"), 300.0), "x", None, 1).decode()
    assert re.search(r'class="cut" data-end="last" data-held="free"', half_free)
    hinged = pattern_svg(fold_pattern(last(strips, "branch"), 300.0), "x", None, 1).decode()
    assert len(re.findall(r'class="cut" data-end="\w+" data-held="hinged"', hinged)) == 2


def test_fold_files_say_how_the_ends_are_held(strips: Path, tmp_path: Path) -> None:
    path = tmp_path / "x.fold"
    assert ribbon("export", "sheared:3", "--to", "fold", "-o", path, "--runs", strips).exit_code == 0
    document = json.loads(path.read_text())
    ends = document["frame_ribbon:ends"]
    assert (ends["start"]["held"], ends["end"]["edge"]) == ("clamped", 20)
    assert ends["start"]["foldAngle"] == pytest.approx(ends["end"]["foldAngle"], abs=1e-7)
    assert "frame_ribbon:seam" not in document
    assert len(document["vertices_coords"]) == 42


@pytest.mark.parametrize("name", NAMES)
def test_csv_and_json_have_the_end_and_the_parameters(strips: Path, name: str) -> None:
    record = last(strips, name)
    rows = list(csv.DictReader(io.StringIO(csv_bytes(record, "x").decode())))
    assert len(rows) == record.segments + 1
    assert [float(rows[-1][f"g_{axis}"]) for axis in "xyz"] == record.g_end.tolist()
    assert rows[-1]["xi"] == ""
    assert "linking_number" not in rows[0]
    for parameter, value in record.parameters.items():
        assert float(rows[0][parameter if parameter == "half_width" else f"parameter_{parameter}"]) == value
    row = {name: float(rows[0][name]) for name in ("twist", "writhe", "twist_plus_writhe")}
    assert row == {"twist": record.twist, "writhe": record.writhe, "twist_plus_writhe": record.linking_number}
    assert (name == "sheared") == (abs(record.twist) > 1e-3)
    document = json.loads(json_bytes(record, "x"))
    assert document["parameters"] == record.parameters
    assert document["arrays"]["lambda_2"][0] is None
    assert document["lambda_end"] == record.lambda_end


def test_the_viewer_has_every_facet(strips: Path) -> None:
    record = last(strips, "cantilever")
    page = viewer_html([record], "x", None).decode()
    assert '"ends":[19]' in page
    assert strip(record).last == (19,)
    assert facet_corners(record).shape == (20, 4, 3)

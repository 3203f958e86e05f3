"""VTKHDF files as VTK reads them, the library behind ParaView."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from cli_support import ribbon_json
from picture_support import solved, states_of, written  # noqa: F401
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkIOHDF import vtkHDFReader

from ribbon_cli import solve
from ribbon_cli.config import load_config
from ribbon_cli.export.mesh import strip
from ribbon_cli.export.vtkhdf import vtkhdf_bytes
from ribbon_cli.store import list_runs

pytestmark = pytest.mark.peers

START = Path(__file__).parent.parent / "data" / "everted-b0.04-N40.npz"
BRANCH = f"""\
topology: {{half_twists: 0}}
initial_guess: {{state: {START}}}
widths: {{arclength: {{to: 0.06, back_to: 0.03, both: true}}}}
spectrum: {{modes: 0, full_up_to: 0}}
"""


def test_vtk_reads_a_branch_as_a_series(solved, tmp_path):  # noqa: F811
    states = [s for s in states_of(solved, "mobius") if s.segments == 48]
    # Steps of different sizes, among them an open strip.
    states.append(states_of(solved, "mobius", "auxiliary")[3])
    path = tmp_path / "branch.vtkhdf"
    path.write_bytes(vtkhdf_bytes(states, "a branch"))
    reader = vtkHDFReader()
    reader.SetFileName(str(path))
    reader.UpdateInformation()
    assert reader.GetNumberOfSteps() == len(states) == 3
    for k, state in enumerate(states):
        reader.SetStep(k)
        reader.Update()
        assert reader.GetTimeValue() == state.half_width
        grid = reader.GetOutputDataObject(0)
        mesh = strip(state)
        np.testing.assert_array_equal(vtk_to_numpy(grid.GetPoints().GetData()), mesh.points)
        assert grid.GetNumberOfCells() == state.segments
        assert grid.GetCellType(0) == 9
        cell = grid.GetCell(state.segments - 1)
        assert [cell.GetPointId(i) for i in range(4)] == mesh.quads[-1].tolist()
        cells, points = grid.GetCellData(), grid.GetPointData()
        assert {cells.GetArrayName(i) for i in range(cells.GetNumberOfArrays())} == {
            *("eta_prime", "xi", "lambda_1", "lambda_4", "lambda_5", "normal", "facet")
        }
        np.testing.assert_array_equal(vtk_to_numpy(cells.GetArray("xi")), state.xi)
        eta = vtk_to_numpy(points.GetArray("eta"))
        np.testing.assert_array_equal(eta[: 2 * state.segments : 2], written(state, "eta"))
        # The ruling that ends an open strip is no node: nothing is made up for it.
        assert np.isnan(eta[2 * state.segments :]).all()
        energy = grid.GetFieldData().GetArray("energy")
        assert energy.GetNumberOfTuples() == 1
        assert energy.GetTuple1(0) == state.energy


def test_a_branch_stored_out_of_order_is_a_series_by_width(tmp_path):
    config = tmp_path / "branch.yaml"
    config.write_text(BRANCH, encoding="utf-8")
    solve(load_config(config), runs=tmp_path / "runs")
    (run,) = list_runs(tmp_path / "runs")
    stored = [s.half_width for s in run.states()]
    assert stored != sorted(stored)
    path = tmp_path / "branch.vtkhdf"
    ribbon_json("export", "branch", "--to", "vtkhdf", "-o", path, "--runs", tmp_path / "runs")
    reader = vtkHDFReader()
    reader.SetFileName(str(path))
    reader.UpdateInformation()
    times = []
    for k in range(reader.GetNumberOfSteps()):
        reader.SetStep(k)
        reader.Update()
        times.append(reader.GetTimeValue())
        field = reader.GetOutputDataObject(0).GetFieldData()
        assert field.GetArray("half_width").GetTuple1(0) == times[-1]
    assert times == sorted(set(stored))

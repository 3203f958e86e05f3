#!/bin/sh
# Guess: a series written by vtkHDFWriter with times 0.1, 0.2, 0.5, 0.8 has these times, and the reader asked
#   for 0.8 gives the step of 0.8.
# Version: vtk 9.7.2, numpy 2.4.6, h5py 3.16.0.
# Behaviour: Steps/Values are written as float32. Those of 0.2 and 0.8 lie above the double, and the reader
#   takes the last step not after the time asked for: that is the step before. Nothing is said; 0.1 and 0.5
#   come out right by luck of rounding.
# What to do: write Steps/Values as float64 by h5py, or ask by the times that the reader lists. Do not save a
#   series again through VTK.
# Seen:
#   Steps/Values: float32
#   asked for 0.1: given the step of 0.1
#   asked for 0.2: given the step of 0.1
#   asked for 0.5: given the step of 0.5
#   asked for 0.8: given the step of 0.5
set -eu
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
cd "$dir"
python3 -m venv v
v/bin/pip -qq install numpy==2.4.6 h5py==3.16.0 vtk==9.7.2
cat > see.py <<'E'
import h5py
from vtkmodules.util.vtkAlgorithm import VTKPythonAlgorithmBase
from vtkmodules.vtkCommonCore import vtkDoubleArray, vtkPoints
from vtkmodules.vtkCommonDataModel import VTK_QUAD, vtkUnstructuredGrid
from vtkmodules.vtkCommonExecutionModel import vtkStreamingDemandDrivenPipeline as Pipeline
from vtkmodules.vtkIOHDF import vtkHDFReader, vtkHDFWriter

TIMES = (0.1, 0.2, 0.5, 0.8)


class Widths(VTKPythonAlgorithmBase):
    """A facet whose width is the time."""

    def __init__(self):
        super().__init__(nInputPorts=0, nOutputPorts=1, outputType="vtkUnstructuredGrid")

    def RequestInformation(self, request, inputs, outputs):
        info = outputs.GetInformationObject(0)
        info.Remove(Pipeline.TIME_STEPS())
        for time in TIMES:
            info.Append(Pipeline.TIME_STEPS(), time)
        info.Append(Pipeline.TIME_RANGE(), TIMES[0])
        info.Append(Pipeline.TIME_RANGE(), TIMES[-1])
        return 1

    def RequestData(self, request, inputs, outputs):
        info = outputs.GetInformationObject(0)
        asked = Pipeline.UPDATE_TIME_STEP()
        time = info.Get(asked) if info.Has(asked) else TIMES[0]
        points = vtkPoints()
        for x, y in ((0, 0), (1, 0), (1, time), (0, time)):
            points.InsertNextPoint(x, y, 0)
        width = vtkDoubleArray()
        width.SetName("width")
        width.InsertNextValue(time)
        grid = vtkUnstructuredGrid()
        grid.SetPoints(points)
        grid.InsertNextCell(VTK_QUAD, 4, [0, 1, 2, 3])
        grid.GetCellData().AddArray(width)
        vtkUnstructuredGrid.GetData(outputs).ShallowCopy(grid)
        return 1


source, writer, reader = Widths(), vtkHDFWriter(), vtkHDFReader()
writer.SetInputConnection(source.GetOutputPort())
writer.SetFileName("series.vtkhdf")
writer.SetWriteAllTimeSteps(True)
writer.Write()
with h5py.File("series.vtkhdf") as file:
    kind = str(file["VTKHDF/Steps/Values"].dtype)
print("Steps/Values:", kind)
reader.SetFileName("series.vtkhdf")
given = []
for time in TIMES:
    reader.UpdateTimeStep(time)
    given.append(reader.GetOutputDataObject(0).GetCellData().GetArray("width").GetValue(0))
    print(f"asked for {time}: given the step of {given[-1]}")
if (kind, given) != ("float32", [0.1, 0.1, 0.5, 0.5]):
    raise SystemExit("changed: not as recorded")
E
v/bin/python see.py

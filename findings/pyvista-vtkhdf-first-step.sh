#!/bin/sh
# Guess: PyVista's reader of a VTKHDF series has time values and a method to take one of them, as its readers of
#   PVD, EnSight and CGNS series have; or reading a series warns.
# Version: pyvista 0.49.1, vtk 9.7.2, h5py 3.16.0, numpy 2.4.6.
# Behaviour: pyvista.read() returns the first step. HDFReader is no TimeReader; it has neither time values nor a
#   way to choose one. The reader of VTK inside has both.
# What to do: HDFReader.reader.SetStep(k) before read(); the number of steps is reader.reader.GetNumberOfSteps().
#   SetStep() has to come before each read().
# Seen:
#   read(): area 0.1, reader of time steps: False
#   steps inside: 3, areas 0.1, 0.2, 0.5
set -eu
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
cd "$dir"
python3 -m venv v
v/bin/pip -qq install numpy==2.4.6 h5py==3.16.0 vtk==9.7.2 pyvista==0.49.1
cat > see.py <<'E'
import h5py
import numpy as np
import pyvista

# A facet that is 1 long and 0.1, 0.2 and 0.5 wide at three steps.
WIDTHS = (0.1, 0.2, 0.5)
steps = len(WIDTHS)
with h5py.File("series.vtkhdf", "w") as file:
    root = file.create_group("VTKHDF", track_order=True)
    root.attrs["Version"] = (2, 3)
    root.attrs.create("Type", b"UnstructuredGrid", dtype="S16")
    points = np.array([[(0, 0, 0), (1, 0, 0), (1, b, 0), (0, b, 0)] for b in WIDTHS], dtype=float)
    root["Points"] = points.reshape(-1, 3)
    root["Types"] = np.full(steps, 9, dtype=np.uint8)
    root["Connectivity"] = np.tile(np.arange(4), steps)
    root["Offsets"] = np.tile([0, 4], steps)
    root["NumberOfPoints"] = np.full(steps, 4)
    root["NumberOfCells"] = np.full(steps, 1)
    root["NumberOfConnectivityIds"] = np.full(steps, 4)
    time = root.create_group("Steps")
    time.attrs["NSteps"] = steps
    time["Values"] = np.array(WIDTHS)
    time["PartOffsets"] = np.arange(steps)
    time["NumberOfParts"] = np.ones(steps, dtype=int)
    time["PointOffsets"] = 4 * np.arange(steps)
    time["CellOffsets"] = np.arange(steps).reshape(-1, 1)
    time["ConnectivityIdOffsets"] = 4 * np.arange(steps).reshape(-1, 1)

reader = pyvista.get_reader("series.vtkhdf")
timed = isinstance(reader, pyvista.TimeReader)
area = round(pyvista.read("series.vtkhdf").area, 6)
print(f"read(): area {area}, reader of time steps: {timed}")
areas = []
for k in range(steps):
    reader.reader.SetStep(k)
    areas.append(round(reader.read().area, 6))
inside = reader.reader.GetNumberOfSteps()
print(f"steps inside: {inside}, areas {', '.join(map(str, areas))}")
if (timed, area, inside, areas) != (False, 0.1, 3, [0.1, 0.2, 0.5]):
    raise SystemExit("changed: not as recorded")
E
v/bin/python see.py

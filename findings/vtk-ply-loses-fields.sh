#!/bin/sh
# Guess: vtkPLYReader (ParaView, PyVista) reads "property double x" in double precision and further properties
#   of vertices and faces as point and cell data, or warns; at least as well as the reader of OBJ, which knows
#   less.
# Version: vtk 9.7.2, numpy 2.4.6.
# Behaviour: points are float32, and the fields are gone, both without a message. The reader of OBJ keeps
#   float64.
# What to do: for fields or digits take VTKHDF, for geometry alone OBJ.
# Seen:
#   PLY: points float32, largest error 1.2e-08, point data [], cell data []
#   OBJ: points float64, largest error 0.0e+00, point data [], cell data ['GroupIds']
set -eu
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
cd "$dir"
python3 -m venv v
v/bin/pip -qq install numpy==2.4.6 vtk==9.7.2
cat > see.py <<'E'
from pathlib import Path

import numpy as np
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkIOGeometry import vtkOBJReader
from vtkmodules.vtkIOPLY import vtkPLYReader

points = np.array([[0, 0, 0], [0.1, 0, 0], [0.1, 0.7, 0.3], [0, 0.7, 0.3]])
Path("band.ply").write_text(
    "ply\nformat ascii 1.0\nelement vertex 4\nproperty double x\nproperty double y\nproperty double z\n"
    "property double kappa\nelement face 1\nproperty list uchar int vertex_indices\nproperty double xi\nend_header\n"
    + "".join("%.17g %.17g %.17g 1.5\n" % tuple(p) for p in points)
    + "4 0 1 2 3 0.25\n"
)
Path("band.obj").write_text("".join("v %.17g %.17g %.17g\n" % tuple(p) for p in points) + "f 1 2 3 4\n")
seen = []
for name, reader in (("PLY", vtkPLYReader()), ("OBJ", vtkOBJReader())):
    reader.SetFileName(f"band.{name.lower()}")
    reader.Update()
    surface = reader.GetOutput()
    read = vtk_to_numpy(surface.GetPoints().GetData())
    fields = [
        [data.GetArrayName(i) for i in range(data.GetNumberOfArrays())]
        for data in (surface.GetPointData(), surface.GetCellData())
    ]
    error = abs(read - points).max()
    print(f"{name}: points {read.dtype}, largest error {error:.1e}, point data {fields[0]}, cell data {fields[1]}")
    seen.append((str(read.dtype), fields, bool(error > 0)))
if seen != [("float32", [[], []], True), ("float64", [[], ["GroupIds"]], False)]:
    raise SystemExit("changed: not as recorded")
E
v/bin/python see.py

#!/bin/sh
# Guess: the curvature filter (ParaView's Curvature, PyVista's curvature()) gives 1/2 for the mean and 0 for
#   the Gaussian curvature of an open cylinder of radius 1, up to the sign and the error of the mesh.
# Version: vtk 9.7.2, numpy 2.4.6.
# Behaviour: the rim is treated as if the surface went on round it. Gauss's angle defect is 2 pi less the
#   angles there too, in place of pi, and is divided by a third of the area: 100 in place of 0. The mean
#   curvature of the rim is half too large. A band that is one facet wide consists of its rim. Quadrilaterals
#   are taken as triangles without a word: the mean is three times too large, and the Gaussian curvature of
#   the two ends of one ruling differs.
# What to do: triangulate, leave out points on the rim; of bands one facet wide take curvature from the fold
#   angles.
# Seen (exact: mean 0.5, Gaussian 0):
#   one facet wide, triangles       mean 0.750 to 0.750, Gaussian 100.0 to 100.0
#   one facet wide, quadrilaterals  mean 1.501 to 1.501, Gaussian 158.3 to 583.8
#   four wide, triangles, inner     mean 0.500 to 0.500, Gaussian   0.0 to   0.0
set -eu
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
cd "$dir"
python3 -m venv v
v/bin/pip -qq install numpy==2.4.6 vtk==9.7.2
cat > see.py <<'E'
import numpy as np
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkCommonCore import vtkPoints
from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData
from vtkmodules.vtkFiltersCore import vtkTriangleFilter
from vtkmodules.vtkFiltersGeneral import vtkCurvatures


def cylinder(n, wide):
    points, cells = vtkPoints(), vtkCellArray()
    points.SetDataTypeToDouble()
    for i in range(n):
        for z in np.linspace(-0.3, 0.3, wide + 1):
            points.InsertNextPoint(np.cos(2 * np.pi * i / n), np.sin(2 * np.pi * i / n), z)
    for i in range(n):
        for j in range(wide):
            a, b = (wide + 1) * i + j, (wide + 1) * ((i + 1) % n) + j
            cells.InsertNextCell(4, [a, a + 1, b + 1, b])
    surface = vtkPolyData()
    surface.SetPoints(points)
    surface.SetPolys(cells)
    return surface


def curvatures(surface, triangulate):
    if triangulate:
        triangles = vtkTriangleFilter()
        triangles.SetInputData(surface)
        triangles.Update()
        surface = triangles.GetOutput()
    found = []
    for kind, name in ((1, "Mean_Curvature"), (0, "Gauss_Curvature")):
        bend = vtkCurvatures()
        bend.SetInputData(surface)
        bend.SetCurvatureType(kind)
        bend.Update()
        found.append(vtk_to_numpy(bend.GetOutput().GetPointData().GetArray(name)).copy())
    return abs(found[0]), found[1]


inner = np.arange(60 * 5) % 5 % 4 != 0
seen = []
for title, wide, triangulate, which in (
    ("one facet wide, triangles", 1, True, slice(None)),
    ("one facet wide, quadrilaterals", 1, False, slice(None)),
    ("four wide, triangles, inner", 4, True, inner),
):
    mean, gauss = (values[which] for values in curvatures(cylinder(60, wide), triangulate))
    row = [mean.min(), mean.max(), abs(gauss).min(), abs(gauss).max()]
    print(f"{title:31s} mean {row[0]:.3f} to {row[1]:.3f}, Gaussian {row[2]:5.1f} to {row[3]:5.1f}")
    seen.append(row)
recorded = [[0.750, 0.750, 100.0, 100.0], [1.501, 1.501, 158.3, 583.8], [0.500, 0.500, 0.0, 0.0]]
if not np.allclose(seen, recorded, rtol=1e-3, atol=1e-3):
    raise SystemExit("changed: not as recorded")
E
v/bin/python see.py

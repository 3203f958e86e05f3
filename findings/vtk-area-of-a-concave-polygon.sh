#!/bin/sh
# Guess: the area of a flat polygon, such as the pattern of a curved strip, is right where it is concave too, and does
#   not depend on the point that comes first. PyVista triangulates concave polygons rightly.
# Version: vtk 9.7.2, pyvista 0.49.1, numpy 2.4.6.
# Behaviour: vtkCellSizeFilter and vtkIntegrateAttributes (PyVista's area, compute_cell_sizes and integrate_data) add
#   the triangles from the first point to each edge, all with positive sign. The area of a half ring is 20 times too
#   large, and that of an L depends on the first point. Integrals of fields are wrong likewise, on concave
#   quadrilaterals too. There is no message. vtkPolygon.ComputeArea is right.
# What to do: triangulate() before any area or integral.
# Seen:
#   polygon                               exact   area  integral of 1  triangulated
#   half ring, radii 1.9 and 2            0.611     12             12         0.611
#   L, from its outer corner                  5      5              5             5
#   L, from the next corner                   5      9              9             5
#   quadrilateral                             1      1              1             1
#   quadrilateral, from the next corner       1      1              3             1
#   square                                    1      1              1             1
set -eu
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
cd "$dir"
python3 -m venv v
v/bin/pip -qq install numpy==2.4.6 vtk==9.7.2 pyvista==0.49.1
cat > see.py <<'E'
import numpy as np
import pyvista

angle = np.linspace(0, np.pi, 30)
arc = np.c_[np.cos(angle), np.sin(angle)]
corner = np.array([(0, 0), (3, 0), (3, 1), (1, 1), (1, 3), (0, 3)])
arrow = np.array([(0, 0), (2, 0), (0.5, 0.5), (0, 2)])
SHAPES = {
    "half ring, radii 1.9 and 2": np.concatenate([2 * arc, 1.9 * arc[::-1]]),
    "L, from its outer corner": corner,
    "L, from the next corner": np.roll(corner, -1, axis=0),
    "quadrilateral": arrow,
    "quadrilateral, from the next corner": np.roll(arrow, -1, axis=0),
    "square": np.array([(0, 0), (1, 0), (1, 1), (0, 1)]),
}
print(f"{'polygon':36s}  exact   area  integral of 1  triangulated")
seen = {}
for name, plane in SHAPES.items():
    x, y = plane.T
    exact = float(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2
    polygon = pyvista.PolyData(np.c_[plane, 0 * x].astype(float), [len(plane), *range(len(plane))])
    polygon.cell_data["one"] = [1.0]
    row = (exact, polygon.area, float(polygon.integrate_data()["one"][0]), polygon.triangulate().area)
    print(f"{name:36s}  {row[0]:5.3g}  {row[1]:5.3g}  {row[2]:13.3g}  {row[3]:12.3g}")
    seen[name] = [round(value / exact, 1) for value in row[1:]]
if list(seen.values()) != [[19.6, 19.6, 1], [1, 1, 1], [1.8, 1.8, 1], [1, 1, 1], [1, 3, 1], [1, 1, 1]]:
    raise SystemExit("changed: not as recorded")
E
v/bin/python see.py

#!/bin/sh
# Guess: the gradient of a field on lines is that along the line: of the arc length it is the tangent, of length 1,
#   as the gradient on triangles lies in their plane. ParaView's manual says of its filter: "the gradient is computed
#   with the cell derivatives".
# Version: vtk 9.7.2, pyvista 0.49.1, numpy 2.4.6.
# Behaviour: each component is the difference of the values divided by the difference of that coordinate: of the arc
#   length on a line in the direction (1, 1, 0) it is (1.4, 1.4, 0), not (0.7, 0.7, 0). Where a curve runs nearly
#   across an axis the component along this axis has no bound: the rate of a twist along the centre line of a strip
#   is dozens of times too large at some points. There is no message. ParaView's Gradient is the same filter
#   (vtkGradientFilter).
# What to do: numpy.gradient(values, arc length); or take the derivative along the centre line on the triangles.
# Seen (the gradient of the arc length, the largest of its points):
#   line                    segments  one polyline  exact
#   straight, (1, 0, 0)            1             1      1
#   straight, (1, 1, 0)            2             2      1
#   straight, (10, 1, 0)        10.1          10.1      1
#   helix                       73.5            65      1
set -eu
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
cd "$dir"
python3 -m venv v
v/bin/pip -qq install numpy==2.4.6 vtk==9.7.2 pyvista==0.49.1
cat > see.py <<'E'
import numpy as np
import pyvista

COUNT = 200


def gradient(points, joined):
    """The gradient of the arc length on a line, given as one cell or as segments."""
    arc_length = np.r_[0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))]
    at = np.arange(len(points))
    cells = np.r_[len(at), at] if joined else np.c_[0 * at[1:] + 2, at[:-1], at[1:]].ravel()
    line = pyvista.PolyData(points, lines=cells)
    line.point_data["s"] = arc_length
    return line.compute_derivative("s")["gradient"]


def straight(*direction):
    return np.linspace(0, 1, COUNT)[:, None] * np.array(direction, float) / np.linalg.norm(direction)


angle = np.linspace(0.1, 6.1, COUNT)
helix = np.c_[np.cos(angle), np.sin(angle), 0.2 * angle] / 1.04**0.5
print("line                    segments  one polyline  exact")
seen = []
for name, points in {
    "straight, (1, 0, 0)": straight(1, 0, 0),
    "straight, (1, 1, 0)": straight(1, 1, 0),
    "straight, (10, 1, 0)": straight(10, 1, 0),
    "helix": helix,
}.items():
    lengths = [np.linalg.norm(gradient(points, joined), axis=1).max() for joined in (False, True)]
    row = [float(f"{length:.3g}") for length in lengths]
    print(f"{name:22s}  {row[0]:8g}  {row[1]:12g}      1")
    seen.append(row)
if seen[:3] != [[1, 1], [2, 2], [10.1, 10.1]] or min(seen[3]) < 50:
    raise SystemExit("changed: not as recorded")
E
v/bin/python see.py

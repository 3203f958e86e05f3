#!/bin/sh
# Guess: on a flat polygon of any number of corners the gradient of the field x + 2 y is (1, 2, 0), as on triangles and
#   quadrilaterals, and a probe inside gives x + 2 y.
# Version: vtk 9.7.2, pyvista 0.49.1, numpy 2.4.6.
# Behaviour: with five corners or more the gradient at the points has at most 15 % of its length, and another
#   direction. Probes (vtkProbeFilter, PyVista's sample) interpolate with weights by distance, which do not give a
#   linear field back either. There is no message. ParaView's Gradient is the same filter (vtkGradientFilter).
# What to do: triangulate() first.
# Seen:
#   corners  length of the gradient, exactly 2.236  triangulated  error of a probe
#         3                         2.236 to 2.236         2.236            0.0000
#         4                         2.236 to 2.236         2.236            0.0000
#         5                         0.000 to 0.115         2.236            0.0448
#         6                         0.040 to 0.144         2.236            0.0317
#        12                         0.080 to 0.329         2.236            0.0001
set -eu
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
cd "$dir"
python3 -m venv v
v/bin/pip -qq install numpy==2.4.6 vtk==9.7.2 pyvista==0.49.1
cat > see.py <<'E'
import numpy as np
import pyvista

INSIDE = np.array([(0.3, 0.1, 0.0), (-0.4, 0.2, 0.0), (0.2, -0.3, 0.0)])


def field(points):
    return points @ np.array([1.0, 2.0, 0.0])


seen = []
print("corners  length of the gradient, exactly 2.236  triangulated  error of a probe")
for corners in (3, 4, 5, 6, 12):
    angle = np.linspace(0, 2 * np.pi, corners, endpoint=False) + 0.3
    points = np.c_[np.cos(angle), np.sin(angle), 0 * angle]
    polygon = pyvista.PolyData(points, np.r_[corners, np.arange(corners)])
    polygon.point_data["f"] = field(points)
    whole, parts = (
        np.linalg.norm(mesh.compute_derivative("f")["gradient"], axis=1) for mesh in (polygon, polygon.triangulate())
    )
    error = np.abs(pyvista.PolyData(INSIDE).sample(polygon)["f"] - field(INSIDE)).max()
    lengths = f"{whole.min():.3f} to {whole.max():.3f}"
    print(f"{corners:7d}  {lengths:>37s}  {parts.max():12.3f}  {error:16.4f}")
    seen.append((np.allclose(whole, 5**0.5), whole.max() < 0.4, np.allclose(parts, 5**0.5), error > 1e-3))
if seen != [(True, False, True, False)] * 2 + [(False, True, True, True)] * 2 + [(False, True, True, False)]:
    raise SystemExit("changed: not as recorded")
E
v/bin/python see.py

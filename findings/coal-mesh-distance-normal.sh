#!/bin/sh
# Guess: after coal.distance() the normal of the result is the unit vector from the first shape to the second, for two
#   meshes as for a mesh and a box; where it is not computed, it stays NaN as in a new result.
# Version: coal 3.0.3, numpy 2.4.6.
# Behaviour: for two meshes the distance and the nearest points are right, and the normal is overwritten by
#   numbers that mean nothing, mostly such as 7e-310, which pass for a null vector and add nothing to a sum of forces. The
#   normals of coal.collide() are set.
# What to do: take the difference of the nearest points, divided by the distance.
# Seen:
#   mesh and box:   distance 0.1, from nearest points 0 0 1, normal is that: True, NaN: False
#   mesh and mesh:  distance 0.1, from nearest points 0 0 1, normal is that: False, NaN: False
set -eu
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
cd "$dir"
python3 -m venv v
v/bin/pip -qq install numpy==2.4.6 coal==3.0.3
cat > see.py <<'E'
import coal
import numpy as np


def sheet(side, z):
    """A square about the z axis, of two triangles."""
    corners = side / 2 * np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) + [0, 0, z]
    points, triangles = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
    for corner in corners:
        points.append(corner)
    for triangle in ((0, 1, 2), (0, 2, 3)):
        triangles.append(coal.Triangle(*triangle))
    mesh = coal.BVHModelOBBRSS()
    mesh.beginModel(2, 4)
    mesh.addSubModel(points, triangles)
    mesh.endModel()
    return mesh


here, above = coal.Transform3s(), coal.Transform3s()
above.setTranslation(np.array([0.0, 0, 0.2]))
as_recorded = bool(np.isnan(coal.DistanceResult().normal).all())
for name, other, place, is_set in (
    ("mesh and box:", coal.Box(0.6, 0.6, 0.2), above, True),
    ("mesh and mesh:", sheet(0.6, 0.1), here, False),
):
    result = coal.DistanceResult()
    distance = coal.distance(sheet(1.0, 0.0), here, other, place, coal.DistanceRequest(), result)
    between = (result.getNearestPoint2() - result.getNearestPoint1()) / distance
    close, undefined = np.allclose(result.normal, between, atol=1e-6), bool(np.isnan(result.normal).any())
    direction = " ".join(f"{abs(x):.0f}" for x in between)
    print(f"{name:15s} distance {distance:.4g}, from nearest points {direction}, "
          f"normal is that: {close}, NaN: {undefined}")
    as_recorded &= np.allclose(between, [0, 0, 1], atol=1e-6) and close == is_set and not undefined
if not as_recorded:
    raise SystemExit("changed: not as recorded")
E
v/bin/python see.py

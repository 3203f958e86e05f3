#!/bin/sh
# Guess: is_self_intersecting() finds every pair of triangles that cross, but for neighbours along an edge. Facets
#   of a strip whose rulings meet in a point, as in the fan of a cone, share that point alone and can cross.
# Version: open3d-cpu 0.20.0, numpy 2.4.6.
# Behaviour: triangles that share one point are never looked at. A cone of paper, wound on until its end has
#   passed through its beginning, does not intersect itself for Open3D: its triangles share the apex. The same
#   triangles cut off below the apex do.
# What to do: give each triangle three points of its own, a thousandth nearer to its middle (at a
#   millionth all neighbours count as crossing).
# Seen:
#   to its apex:    self-intersecting False, pairs 0
#   without apex:   self-intersecting True, pairs 3
#   points of own:  self-intersecting True, pairs 1
set -eu
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
cd "$dir"
python3 -m venv v
v/bin/pip -qq install numpy==2.4.6 open3d-cpu==0.20.0
cat > see.py <<'E'
import numpy as np
import open3d

# Rulings of a cone: the last ones go through the first facets.
turn = np.linspace(0.0, 2.2 * np.pi, 23)
radius = np.linspace(1.0, 1.4, 23)
radius[-2:] = 0.9
rim = np.stack([radius * np.cos(turn), radius * np.sin(turn), np.full(23, -1.0)], axis=1)


def apex():
    """A triangle a facet, all with the apex."""
    points = np.concatenate(([[0.0, 0.0, 0.0]], rim))
    return points, [(0, i, i + 1) for i in range(1, 23)]


def cut():
    """Facets from a fifth of the height on, two triangles each."""
    points = np.concatenate((0.2 * rim, rim))
    return points, [t for i in range(22) for t in ((i, i + 23, i + 24), (i, i + 24, i + 1))]


def own():
    """The triangles to the apex, each a little smaller and with points of its own."""
    points, triangles = apex()
    corners = points[np.array(triangles)]
    corners += 1e-3 * (corners.mean(axis=1, keepdims=True) - corners)
    return corners.reshape(-1, 3), np.arange(66).reshape(22, 3)


seen = []
for name, (points, triangles) in (("to its apex:", apex()), ("without apex:", cut()), ("points of own:", own())):
    mesh = open3d.geometry.TriangleMesh(
        open3d.utility.Vector3dVector(points), open3d.utility.Vector3iVector(np.array(triangles))
    )
    pairs = len(np.asarray(mesh.get_self_intersecting_triangles()))
    print(f"{name:15s} self-intersecting {mesh.is_self_intersecting()}, pairs {pairs}")
    seen.append((mesh.is_self_intersecting(), pairs > 0))
if seen != [(False, False), (True, True), (True, True)]:
    raise SystemExit("changed: not as recorded")
E
v/bin/python see.py

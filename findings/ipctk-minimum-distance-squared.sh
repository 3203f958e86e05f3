#!/bin/sh
# Guess: NormalCollisions.compute_minimum_distance() is a distance, in the unit of the dhat given to build(). Its
#   docstring says: "The minimum distance between any non-adjacent elements".
# Version: ipctk 1.6.1, numpy 2.4.6.
# Behaviour: it is the distance squared: 0.0001 for two sheets 0.01 apart, which build() finds with a dhat just over
#   0.01. The docstrings of the functions for single pairs, such as point_triangle_distance, say "squared";
#   this one does not.
# What to do: take the root, before it is reported or compared with a thickness.
# Seen:
#   sheets 0.01 apart: minimum distance 0.0001
#   dhat 0.0101: 3 collisions, dhat 0.0099: 0 collisions
set -eu
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
cd "$dir"
python3 -m venv v
v/bin/pip -qq install numpy==2.4.6 ipctk==1.6.1
cat > see.py <<'E'
import ipctk
import numpy as np

# Two parallel triangles, one above the other.
GAP = 0.01
corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
points = np.concatenate([corners, corners + [0.2, 0.2, GAP]])
faces = np.array([[0, 1, 2], [3, 4, 5]])
mesh = ipctk.CollisionMesh(points, ipctk.edges(faces), faces)


def collisions(dhat):
    found = ipctk.NormalCollisions()
    found.build(mesh, points, dhat)
    return found


distance = collisions(0.02).compute_minimum_distance(mesh, points)
above, below = len(collisions(1.01 * GAP)), len(collisions(0.99 * GAP))
print(f"sheets {GAP:g} apart: minimum distance {distance:g}")
print(f"dhat {1.01 * GAP:g}: {above} collisions, dhat {0.99 * GAP:g}: {below} collisions")
docs = ipctk.NormalCollisions.compute_minimum_distance.__doc__
if abs(distance - GAP**2) > 1e-12 or above == 0 or below != 0 or "squared" in docs:
    raise SystemExit("changed: not as recorded")
E
v/bin/python see.py

#!/bin/sh
# Guess: the filter that selects self-intersecting faces selects those of a strip that is folded flat onto itself:
#   its pieces lie on each other and share a whole area. Or faces in one plane are a case that it warns of.
# Version: pymeshlab 2025.7.post1, numpy 2.4.6.
# Behaviour: faces in one plane never intersect. A strip of three pieces, folded flat so that the third lies across
#   the first (all points at z = 0), has no self-intersecting face. With one end of the third piece 1e-6 above
#   the plane and the other as far below, so that it goes through, faces of both pieces are found.
# What to do: test overlaps in a plane in two dimensions, or displace one of the pieces.
# Seen:
#   flat:  0 of 6 faces self-intersecting
#   bent:  3 of 6 faces self-intersecting
set -eu
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
cd "$dir"
python3 -m venv v
v/bin/pip -qq install numpy==2.4.6 pymeshlab==2025.7.post1
cat > see.py <<'E'
import numpy as np
import pymeshlab

# A strip of three straight pieces in the plane, each two triangles; the third crosses the first.
root = 3.0**0.5
points = np.array(
    [
        (0.0, 0.0), (0.0, 1.0), (6.0, 0.0), (6.0 + 1.0 / root, 1.0),
        (4.0, 2.0 * root), (4.0 - 1.0 / root, 2.0 * root + 1.0), (1.6, -2.2), (0.5, -1.6),
    ]
)
faces = np.array([(0, 2, 3), (0, 3, 1), (2, 4, 5), (2, 5, 3), (4, 6, 7), (4, 7, 5)])

seen = []
for name, lift in (("flat", 0.0), ("bent", 1e-6)):
    height = np.zeros(8)
    height[4:6], height[6:] = lift, -lift
    meshes = pymeshlab.MeshSet()
    meshes.add_mesh(pymeshlab.Mesh(np.c_[points, height], faces))
    meshes.compute_selection_by_self_intersections_per_face()
    count = meshes.current_mesh().selected_face_number()
    print(f"{name}:  {count} of {len(faces)} faces self-intersecting")
    seen.append(count > 0)
if seen != [False, True]:
    raise SystemExit("changed: not as recorded")
E
v/bin/python see.py

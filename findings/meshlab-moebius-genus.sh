#!/bin/sh
# Guess: topological measures tell a Moebius band from a disk, or say that it cannot be oriented; and the
#   filter that orients faces coherently fails on a one-sided surface, or warns.
# Version: pymeshlab 2025.7.post1, numpy 2.4.6.
# Behaviour: "genus" is a whole number, as if the surface could be oriented. A Moebius band has V - E + F = 0 and
#   one hole, so that (2 - holes - V + E - F) / 2 is 1/2, and what is given is 0: two-manifold, one part, one hole,
#   genus 0, all of it as of a disk. The filter meshing_re_orient_faces_coherently returns without a word;
#   some neighbours still are opposed.
# What to do: compute V - E + F from the three counts beside it (1 of a disk, 0 of this), and count edges that
#   both of their faces run through in the same direction.
# Seen:
#   disk    genus 0, holes 1, two-manifold True, V - E + F = 1, oriented: opposed edges 0
#   Moebius genus 0, holes 1, two-manifold True, V - E + F = 0, oriented: opposed edges 1
set -eu
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
cd "$dir"
python3 -m venv v
v/bin/pip -qq install numpy==2.4.6 pymeshlab==2025.7.post1
cat > see.py <<'E'
from collections import Counter

import numpy as np
import pymeshlab


def strip(n, closed):
    """n quadrilaterals in two triangles each: a Moebius band, or where not closed a disk."""
    t = (2 * np.pi if closed else np.pi) * np.arange(n + (not closed)) / n
    middle = np.c_[np.cos(t), np.sin(t), 0 * t]
    across = np.cos(t / 2)[:, None] * middle + np.sin(t / 2)[:, None] * [0.0, 0.0, 1.0]
    points = np.stack([middle - 0.3 * across, middle + 0.3 * across], axis=1).reshape(-1, 3)
    ends = [(2 * i, 2 * i + 1) for i in range(len(t))] + ([(1, 0)] if closed else [])
    faces = []
    for (a, b), (c, d) in zip(ends, ends[1:]):
        faces += [(a, b, d), (a, d, c)]
    return points, np.array(faces)


seen = []
for name, closed in (("disk", False), ("Moebius", True)):
    meshes = pymeshlab.MeshSet()
    meshes.add_mesh(pymeshlab.Mesh(*strip(30, closed)))
    meshes.meshing_re_orient_faces_coherently()
    m = meshes.get_topological_measures()
    faces = meshes.current_mesh().face_matrix()
    edges = Counter((int(f[i]), int(f[i - 2])) for f in faces for i in range(3))
    opposed = sum(1 for times in edges.values() if times == 2)
    characteristic = m["vertices_number"] - m["edges_number"] + m["faces_number"]
    print(
        f"{name:7s} genus {m['genus']}, holes {m['number_holes']}, two-manifold {m['is_mesh_two_manifold']}, "
        f"V - E + F = {characteristic}, oriented: opposed edges {opposed}"
    )
    seen.append((m["genus"], m["number_holes"], m["is_mesh_two_manifold"], characteristic, opposed > 0))
if seen != [(0, 1, True, 1, False), (0, 1, True, 0, True)]:
    raise SystemExit("changed: not as recorded")
E
v/bin/python see.py

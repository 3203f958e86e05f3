#!/bin/sh
# Guess: Open3D, whose meshes are of triangles, splits the quadrilaterals of an OBJ file, as it does those of
#   a PLY file; or it fails.
# Version: open3d-cpu 0.20.0, numpy 2.4.6.
# Behaviour: open3d.io.read_triangle_mesh returns a mesh without points and triangles. There is a line of
#   level INFO and neither a warning nor an exception; the area is 0.0. The same file has both triangles when
#   read through open3d.t.io, and so has the same surface as PLY.
# What to do: read OBJ by open3d.t.io.read_triangle_mesh, or give it PLY.
# Seen:
#   io,   quad.ply: 4 points, 2 triangles, area 1.0
#   io,   quad.obj: 0 points, 0 triangles, area 0.0
#   t.io, quad.obj: 4 points, 2 triangles, area 1.0
set -eu
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
cd "$dir"
python3 -m venv v
v/bin/pip -qq install numpy==2.4.6 open3d-cpu==0.20.0
cat > see.py <<'E'
from pathlib import Path

import open3d

points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
Path("quad.obj").write_text("".join("v %d %d %d\n" % p for p in points) + "f 1 2 3 4\n")
Path("quad.ply").write_text(
    "ply\nformat ascii 1.0\nelement vertex 4\nproperty double x\nproperty double y\nproperty double z\n"
    "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    + "".join("%d %d %d\n" % p for p in points)
    + "4 0 1 2 3\n"
)
seen = []
for title, reader, name in (
    ("io", open3d.io, "quad.ply"),
    ("io", open3d.io, "quad.obj"),
    ("t.io", open3d.t.io, "quad.obj"),
):
    mesh = reader.read_triangle_mesh(name)
    mesh = mesh.to_legacy() if title == "t.io" else mesh
    row = (len(mesh.vertices), len(mesh.triangles), mesh.get_surface_area())
    print(f"{title + ',':5s} {name}: {row[0]} points, {row[1]} triangles, area {row[2]}")
    seen.append(row)
if seen != [(4, 2, 1.0), (0, 0, 0.0), (4, 2, 1.0)]:
    raise SystemExit("changed: not as recorded")
E
v/bin/python see.py > out 2> err || { cat out err; exit 1; }
grep area out

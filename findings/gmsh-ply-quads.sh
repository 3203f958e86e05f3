#!/bin/sh
# Guess: gmsh reads two quadrilaterals from a PLY file as it does from OFF or OBJ, or says that it cannot.
# Version: gmsh 4.15.2.
# Behaviour: of each quadrilateral the first three corners are taken for a triangle. The reader reports two
#   triangles and no warning; half of the area is gone, in a zigzag of holes.
# What to do: give gmsh OFF or OBJ; check the number of elements and the area after an import.
# Seen:
#   quads.off: Quadrilateral 4 x 2, area 2
#   quads.ply: Triangle 3 x 2, area 1
set -eu
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
cd "$dir"
python3 -m venv v
v/bin/pip -qq install numpy==2.4.6 gmsh==4.15.2
cat > see.py <<'E'
from pathlib import Path

import gmsh

points = "0 0 0\n1 0 0\n1 1 0\n0 1 0\n2 0 0\n2 1 0\n"
faces = "4 0 1 2 3\n4 1 4 5 2\n"
header = (
    "ply\nformat ascii 1.0\nelement vertex 6\nproperty double x\nproperty double y\nproperty double z\n"
    "element face 2\nproperty list uchar int vertex_indices\nend_header\n"
)
Path("quads.ply").write_text(header + points + faces)
Path("quads.off").write_text("OFF\n6 2 0\n" + points + faces)
gmsh.initialize()
gmsh.option.setNumber("General.Terminal", 0)
seen = []
for name in ("quads.off", "quads.ply"):
    gmsh.clear()
    gmsh.logger.start()
    gmsh.merge(name)
    warnings = [line for line in gmsh.logger.get() if line.startswith(("Warning", "Error"))]
    gmsh.logger.stop()
    ((kind,), (tags,), _) = gmsh.model.mesh.getElements()
    area = float(sum(gmsh.model.mesh.getElementQualities(tags, "volume")))
    title = gmsh.model.mesh.getElementProperties(kind)[0]
    print(f"{name}: {title} x {len(tags)}, area {area:g}", *warnings)
    seen.append((title, len(tags), round(area, 12), len(warnings)))
gmsh.finalize()
if seen != [("Quadrilateral 4", 2, 2.0, 0), ("Triangle 3", 2, 1.0, 0)]:
    raise SystemExit("changed: not as recorded")
E
v/bin/python see.py

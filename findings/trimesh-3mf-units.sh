#!/bin/sh
# Guess: a mesh in metres is written to a 3MF file with unit="meter", or in converted numbers: 3MF is taken in place of
#   STL because it says what a number means, and trimesh's reader takes mesh.units from there.
# Version: trimesh 5.2.0, numpy 2.4.6, networkx 3.6.1, lxml 6.1.3.
# Behaviour: the exporter writes unit="millimeter" and the numbers as they are, whatever mesh.units is. A strip of
#   0.2 m is 0.2 mm long for a slicer, and for trimesh once the file was read and saved. Nothing is said. A glTF
#   file keeps mesh.units.
# What to do: mesh.convert_units("millimeter") before the export.
# Seen:
#   strip in meter             0.2 meter
#   glTF, read again           0.2 meter
#   3MF, read again            0.2 millimeter
#   converted, 3MF             200 millimeter
set -eu
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
cd "$dir"
python3 -m venv v
v/bin/pip -qq install numpy==2.4.6 trimesh==5.2.0 networkx==3.6.1 lxml==6.1.3
cat > see.py <<'E'
import warnings

import trimesh

warnings.simplefilter("error")


def saved(mesh, name):
    mesh.export(name)
    return trimesh.load_scene(name)


strip = trimesh.creation.box((0.2, 0.02, 0.001))
strip.units = "meter"
converted = strip.copy()
converted.convert_units("millimeter")
seen = []
for name, part in (
    ("strip in meter", strip),
    ("glTF, read again", saved(strip, "strip.glb")),
    ("3MF, read again", saved(strip, "strip.3mf")),
    ("converted, 3MF", saved(converted, "converted.3mf")),
):
    seen.append((float(f"{part.extents.max():.6g}"), part.units))
    print(f"{name:26s} {seen[-1][0]:g} {seen[-1][1]}")
if seen != [(0.2, "meter"), (0.2, "meter"), (0.2, "millimeter"), (200.0, "millimeter")]:
    raise SystemExit("changed: not as recorded")
E
v/bin/python see.py

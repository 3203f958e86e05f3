#!/bin/sh
# Guess: trimesh reads the pattern of a strip, drawn once in a block of a DXF file and inserted turned, scaled or
#   mirrored for each cut, at the place that the file gives it; or it says that it cannot.
# Version: trimesh 5.2.0, numpy 2.4.6, ezdxf 1.4.5, networkx 3.6.1.
# Behaviour: only a block that is inserted as it is lies right. The angle is taken clockwise, the place is scaled
#   together with the block, and the base point of the block is left out. What is mirrored is written in a system of
#   coordinates with the extrusion (0, 0, -1), which is not looked at either: an arc is not mirrored. There is no
#   message, and lengths and areas are right, so that a check of these finds nothing.
# What to do: explode blocks first (ezdxf: insert.explode()); of what is mirrored make polylines by
#   ezdxf.path.make_path. Compare the bounds with ezdxf.bbox.extents.
# Seen (an L of 3 by 2 inserted at (100, 10), and an arc; least x and y, largest x and y):
#                         ezdxf               trimesh             trimesh, exploded
#   as it is              100  10  103   12   100  10  103   12   100  10  103   12
#   turned by 90 degrees   98  10  100   13   100   7  102   10    98  10  100   13
#   twice as large        100  10  106   14   200  20  206   24   100  10  106   14
#   base point (3, 0)      97  10  100   12   100  10  103   12    97  10  100   12
#   mirrored               97  10  100   12  -103  10 -100   12  -100  10  -97   12
#   mirrored arc           -6   5   -4    6     4   5    6    6     4   5    6    6
set -eu
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
cd "$dir"
python3 -m venv v
v/bin/pip -qq install numpy==2.4.6 trimesh==5.2.0 ezdxf==1.4.5 networkx==3.6.1
cat > see.py <<'E'
import ezdxf
import ezdxf.bbox
import trimesh

PIECE = [(0, 0), (3, 0), (3, 1), (1, 1), (1, 2), (0, 2)]


def inserted(base=(0, 0), **how):
    """A drawing with the piece in a block, inserted at (100, 10)."""
    drawing = ezdxf.new()
    drawing.blocks.new("PIECE", base_point=base).add_lwpolyline(PIECE, close=True)
    drawing.modelspace().add_blockref("PIECE", (100, 10), dxfattribs=how)
    return drawing


def arc():
    """The upper half of a circle about (5, 5), mirrored: about (-5, 5)."""
    drawing = ezdxf.new()
    drawing.modelspace().add_arc((5, 5), 1, 0, 180, dxfattribs={"extrusion": (0, 0, -1)})
    return drawing


def rounded(corners):
    return tuple(round(float(corner[axis])) for corner in corners for axis in (0, 1))


def exploded(drawing):
    for insert in drawing.modelspace().query("INSERT"):
        insert.explode()
    return drawing


def read(drawing):
    drawing.saveas("pattern.dxf")
    return rounded(trimesh.load("pattern.dxf").bounds)


print(f"{'':20s}  {'ezdxf':18s}  {'trimesh':18s}  trimesh, exploded")
differing = []
for name, make in {
    "as it is": inserted,
    "turned by 90 degrees": lambda: inserted(rotation=90),
    "twice as large": lambda: inserted(xscale=2, yscale=2),
    "base point (3, 0)": lambda: inserted(base=(3, 0)),
    "mirrored": lambda: inserted(xscale=-1),
    "mirrored arc": arc,
}.items():
    box = ezdxf.bbox.extents(make().modelspace())
    right, given, apart = rounded((box.extmin, box.extmax)), read(make()), read(exploded(make()))
    print(f"{name:20s}" + "".join("  {:4d}{:4d}{:5d}{:5d}".format(*box) for box in (right, given, apart)))
    differing.append((right != given, right != apart))
if differing != [(False, False), (True, False), (True, False), (True, False), (True, True), (True, True)]:
    raise SystemExit("changed: not as recorded")
E
v/bin/python see.py

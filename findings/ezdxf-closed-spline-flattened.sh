#!/bin/sh
# Guess: the points that flattening() makes of a closed SPLINE of a DXF file run round it once and end where they begin.
#   The documentation of set_closed() says: "start and end at your first control point".
# Version: ezdxf 1.4.5, trimesh 5.2.0, scipy 1.17.1, numpy 2.4.6.
# Behaviour: a closed spline as set_closed() makes it has evenly spaced knots, of which the first three and the last
#   three intervals lie outside the curve. flattening() runs through them too: a ring begins at a control point, though
#   the curve passes through none, is run round 1.4 times, and ends elsewhere. ezdxf.path.make_path(), of which drawings
#   and exports are made, does the same; so does trimesh with the file, by a way of its own. approximate() of the
#   same object stays on the curve. There is no message.
# What to do: spline.construction_tool().approximate(n); or write rims as splines with clamped knots, or as polylines.
# Seen (12 control points on the unit circle, written and read again):
#   by                     length  turns  radius            gap at the end
#   scipy, on the curve     6.002  1.000  0.9551 to 0.9553  0.000
#   approximate(400)        6.002  1.000  0.9551 to 0.9553  0.000
#   flattening(1e-4)        9.384  1.402  0.8730 to 1.0000  1.893
#   make_path, flattened    9.384  1.402  0.8731 to 1.0000  1.893
#   trimesh's load_path     9.742
set -eu
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
cd "$dir"
python3 -m venv v
v/bin/pip -qq install numpy==2.4.6 scipy==1.17.1 ezdxf==1.4.5 trimesh==5.2.0 networkx==3.6.1
cat > see.py <<'E'
import ezdxf
import numpy as np
import trimesh
from ezdxf.path import make_path
from scipy.interpolate import BSpline

angle = np.linspace(0, 2 * np.pi, 12, endpoint=False)
drawing = ezdxf.new()
drawing.modelspace().add_spline().set_closed(np.c_[np.cos(angle), np.sin(angle), 0 * angle])
drawing.saveas("ring.dxf")

(ring,) = ezdxf.readfile("ring.dxf").modelspace()
tool = ring.construction_tool()
knots, control = np.array(tool.knots()), np.array([tuple(point) for point in tool.control_points])
curve = BSpline(knots, control, 3)(np.linspace(knots[3], knots[len(control)], 2001))
print("by                     length  turns  radius            gap at the end")
seen = []
for name, points in (
    ("scipy, on the curve", curve),
    ("approximate(400)", tool.approximate(400)),
    ("flattening(1e-4)", ring.flattening(1e-4)),
    ("make_path, flattened", make_path(ring).flattening(1e-4)),
):
    x, y, _ = np.array([tuple(point) for point in points]).T
    length, radius = np.hypot(np.diff(x), np.diff(y)).sum(), np.hypot(x, y)
    turns = np.ptp(np.unwrap(np.arctan2(y, x))) / (2 * np.pi)
    gap = np.hypot(x[-1] - x[0], y[-1] - y[0])
    print(f"{name:21s}  {length:6.3f}  {turns:.3f}  {radius.min():.4f} to {radius.max():.4f}  {gap:.3f}")
    seen.append((round(float(length), 2), bool(gap > 1)))
length = trimesh.load_path("ring.dxf").length
print(f"trimesh's load_path    {length:6.3f}")
if seen != [(6.0, False), (6.0, False), (9.38, True), (9.38, True)] or not 9.7 < length < 9.8 or not ring.closed:
    raise SystemExit("changed: not as recorded")
E
v/bin/python see.py

#!/bin/sh
# Guess: splprep(points.T, s=0, per=1) lays a closed curve through all points given, such as the nodes of a closed rod
#   without the first one repeated; or it raises, as make_interp_spline does: "First and last points does not match".
# Version: scipy 1.17.1, numpy 2.4.6.
# Behaviour: the last point is replaced by the first one, in the caller's array too. The curve leaves it out, and all
#   that is computed from the array later has an edge of length 0. The warning of this is off by default (quiet=1). Its
#   documentation says only "Values of y[m-1] and w[m-1] are not used". Of a list of columns the last point is left
#   out as well, and the array stays.
# What to do: repeat the first point at the end, in a copy.
# Seen:
#   8 points of a circle        last point        curve's radius
#   before                       0.7071 -0.7071
#   splprep, points.T            1.0000  0.0000   0.949 to 1.007
#   splprep, list of columns     0.7071 -0.7071   0.949 to 1.007
#   splprep, first repeated      0.7071 -0.7071   0.999 to 1.000
set -eu
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
cd "$dir"
python3 -m venv v
v/bin/pip -qq install numpy==2.4.6 scipy==1.17.1
cat > see.py <<'E'
import warnings

import numpy as np
from scipy.interpolate import make_interp_spline, splev, splprep

warnings.simplefilter("error")
angle = 2 * np.pi * np.arange(8) / 8
circle = np.c_[np.cos(angle), np.sin(angle)]


def radii(data):
    curve, _ = splprep(data, s=0, per=1)
    radius = np.hypot(*splev(np.linspace(0, 1, 1000), curve))
    return float(radius.min()), float(radius.max())


print(f"8 points of a circle        {'last point':16s}  curve's radius")
print(f"before                      {circle[-1, 0]:7.4f} {circle[-1, 1]:7.4f}")
seen = {}
for name, data in {
    "points.T": lambda points: points.T,
    "list of columns": lambda points: [points[:, 0], points[:, 1]],
    "first repeated": lambda points: np.r_[points, points[:1]].T,
}.items():
    points = circle.copy()
    least, largest = radii(data(points))
    last = points[-1]
    print(f"splprep, {name:18s} {last[0]:7.4f} {last[1]:7.4f}   {least:.3f} to {largest:.3f}")
    seen[name] = (np.array_equal(points, circle), np.array_equal(last, circle[0]), largest - least > 0.03)
try:
    make_interp_spline(angle, circle, bc_type="periodic")
    raised = False
except ValueError as error:
    raised = "does not match" in str(error)
expected = {
    "points.T": (False, True, True),
    "list of columns": (True, False, True),
    "first repeated": (True, False, False),
}
if seen != expected or not raised:
    raise SystemExit("changed: not as recorded")
E
v/bin/python see.py

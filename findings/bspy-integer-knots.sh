#!/bin/sh
# Guess: bspy's Spline gives the same curve whether its knots are written 0 and 1 or 0.0 and 1.0: "A list of the lists
#   of the knots of the spline"; likewise its coefficients, "array-like".
# Version: bspy 5.0.1, numpy 2.4.6, scipy 1.17.1.
# Behaviour: knots keep their kind of number, and the basis functions get that of the knots. With knots written without
#   a point they are whole numbers, cut off: the curve is right at its end and 0 before it, its length is 0, and so is
#   the area of a surface. With whole coefficients and knots with a point, values and derivative() are right, but
#   jacobian() is cut off, and so is what is made of the spline: a knot inserted or a piece cut out moves the curve.
#   There is no message.
# What to do: Spline(..., [np.array(k, float) for k in knots], np.array(coefs, float)).
# Seen (cubic with the control points (0, 0, 0), (1, 2, 0), (2, 0, 1), (3, 1, 3), at 0.4):
#                               at 0.4                    derivative                jacobian
#   all with a point            1.200   0.928   0.480    3.000  -0.240   2.400    3.000  -0.240   2.400
#   whole knots                 0.000   0.000   0.000    0.000   0.000   0.000    0.000   0.000   0.000
#   whole coefficients          1.200   0.928   0.480    3.000  -0.240   2.400    3.000   0.000   2.000
#     with a knot at 0.5        0.704   0.864   0.256    2.880  -0.720   1.920    2.000   0.000   1.000
#     trimmed to 0.25 to 0.75   0.000   0.000   0.000    0.000   0.000   0.000    0.000   0.000   0.000
#   length: all with a point 4.9128, whole knots 0.0000
set -eu
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
cd "$dir"
python3 -m venv v
v/bin/pip -qq install numpy==2.4.6 scipy==1.17.1 bspy==5.0.1
cat > see.py <<'E'
import numpy as np
from bspy import Spline

KNOTS, POINTS = [0, 0, 0, 0, 1, 1, 1, 1], [[0, 1, 2, 3], [0, 2, 0, 1], [0, 0, 1, 3]]


def cubic(knots, points):
    return Spline(1, 3, [4], [4], [knots], points)


fine = cubic(np.array(KNOTS, float), np.array(POINTS, float))
whole_knots = cubic(KNOTS, np.array(POINTS, float))
whole_points = cubic(np.array(KNOTS, float), POINTS)
print(f"{'':26s}  at 0.4                    derivative                jacobian")
seen = {}
for name, curve in (
    ("all with a point", fine),
    ("whole knots", whole_knots),
    ("whole coefficients", whole_points),
    ("  with a knot at 0.5", whole_points.insert_knots([[0.5]])),
    ("  trimmed to 0.25 to 0.75", whole_points.trim([[0.25, 0.75]])),
):
    values = np.array([curve(0.4), curve.derivative([1], 0.4), curve.jacobian([0.4]).ravel()], float)
    print(f"{name:26s}" + "  ".join("{:7.3f} {:7.3f} {:7.3f}".format(*(row + 0.0)) for row in values))
    seen[name.strip()] = values
lengths = fine.integral(), whole_knots.integral()
print("length: all with a point {:.4f}, whole knots {:.4f}".format(*lengths))
right = seen["all with a point"]
as_recorded = (
    np.allclose(right, [[1.2, 0.928, 0.48], [3, -0.24, 2.4], [3, -0.24, 2.4]])
    and not seen["whole knots"].any()
    and np.allclose(whole_knots(1.0), fine(1.0))
    and np.allclose(seen["whole coefficients"][:2], right[:2])
    and abs(seen["whole coefficients"] - right)[2].max() > 0.3
    and abs(seen["with a knot at 0.5"] - right)[0].max() > 0.4
    and abs(seen["trimmed to 0.25 to 0.75"] - right)[0].max() > 0.4
    and all(np.allclose(made(0.4), right[0]) for made in (fine.insert_knots([[0.5]]), fine.trim([[0.25, 0.75]])))
    and lengths[0] > 4.9
    and lengths[1] == 0
)
if not as_recorded:
    raise SystemExit("changed: not as recorded")
E
v/bin/python see.py

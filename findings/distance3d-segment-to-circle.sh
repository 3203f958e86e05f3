#!/bin/sh
# Guess: distance3d.distance.line_segment_to_circle, "the shortest distance between line segment and circle", is that
#   distance, but for rounding, as its distance of two segments or of two triangles is.
# Version: distance3d 0.9.1, numpy 2.4.6, scipy 1.17.1.
# Behaviour: a line may come near a circle twice. The function takes the nearer place of the endless line; if it is not
#   on the segment, the end of the segment is taken, and the other place, which is on it, is forgotten. A rod that
#   passes a ring at 0.30 is said to be 1.02 away. Besides, the place is sought in 8 halvings only: a line that meets
#   the circle is found to miss it by up to 0.4 % of the radius. There is no message.
# What to do: distances of segments to a polygon of many edges, by line_segment_to_line_segment; or divide the segment
#   where it is nearest to the centre, and polish the result.
# Seen (ring of radius 1 about the z axis):
#   segment                                distance3d  exact
#   (0, 0, 0.2) to (2, 0, 0.4)             1.0198      0.2985
#   (0, 0.2, 0.2) to (2, 0.2, 0.4)         0.8246      0.2964
#   (-2, 0.2, 0) to (2, 0.2, 0.4)          0.1015      0.1015
#   (0, 0.5, 0) to (2, 0.5, 0)             0.5000      0.0000
#   (-2, 0.5, 0) to (2, 0.5, 0)            0.0013      0.0000
set -eu
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
cd "$dir"
python3 -m venv v
v/bin/pip -qq install numpy==2.4.6 scipy==1.17.1 distance3d==0.9.1
cat > see.py <<'E'
import warnings

import numpy as np
from scipy.optimize import minimize_scalar

warnings.simplefilter("ignore")  # numba speaks of how numbers lie in memory
from distance3d.distance import line_segment_to_circle  # noqa: E402


def exact(start, end):
    """Distance to the unit circle about the z axis: the least of many brackets, each polished."""

    def distance(t):
        x, y, z = start + t * (end - start)
        return np.hypot(np.hypot(x, y) - 1, z)

    grid = np.linspace(0, 1, 401)
    least = min(range(len(grid)), key=lambda i: distance(grid[i]))
    bounds = grid[max(least - 1, 0)], grid[min(least + 1, 400)]
    return minimize_scalar(distance, bounds=bounds, method="bounded", options={"xatol": 1e-12}).fun


print("segment                                distance3d  exact")
seen = []
for start, end in (
    ((0, 0, 0.2), (2, 0, 0.4)),
    ((0, 0.2, 0.2), (2, 0.2, 0.4)),
    ((-2, 0.2, 0), (2, 0.2, 0.4)),
    ((0, 0.5, 0), (2, 0.5, 0)),
    ((-2, 0.5, 0), (2, 0.5, 0)),
):
    p, q = np.array(start, float), np.array(end, float)
    given = line_segment_to_circle(p, q, np.zeros(3), 1.0, np.array([0.0, 0.0, 1.0]))[0]
    wanted = exact(p, q)
    print(f"{f'{start} to {end}':37s}  {given:.4f}      {wanted:.4f}")
    seen.append(round(given - wanted, 4))
if min(seen[0], seen[1], seen[3]) < 0.49 or abs(seen[2]) > 1e-3 or not 5e-4 < seen[4] < 5e-3:
    raise SystemExit("changed: not as recorded")
E
v/bin/python see.py

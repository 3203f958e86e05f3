#!/bin/sh
# Guess: link, twist and writhe of a rod whose last node coincides with its first are those of the closed rod,
#   and Lk = Tw + Wr is a whole number. The docstring says: for other words than its three, "program uses the
#   center line".
# Version: pyelastica 1.0.0, numpy 2.4.6.
# Behaviour: compute_link adds a straight segment at either end, and the curves stay open. On a plane ring
#   with one turn the link comes out near 2 with "next_tangent", the default of the rod's method, and near 0
#   with "net_tangent". None adds nothing, and the number still is not whole; twist leaves out the joint of
#   the last element to the first. Any other word raises NotImplementedError.
# What to do: for closed rods take none of these numbers; sum Gauss's integral over pairs of edges of two
#   closed polygons.
# Seen:
#   elements     twist  link, next_tangent  link, net_tangent  link, None
#         40    0.9750              1.9738             0.0263      0.9806
#         80    0.9875              1.9863             0.0138      0.9901
#        160    0.9937              1.9925             0.0075      0.9950
#   type_of_additional_segment="none": NotImplementedError
set -eu
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
cd "$dir"
python3 -m venv v
v/bin/pip -qq install numpy==2.4.6 pyelastica==1.0.0
cat > see.py <<'E'
import warnings

import numpy as np
from elastica.rod.knot_theory import compute_link, compute_twist, compute_writhe

warnings.simplefilter("ignore")
as_recorded = True
print("elements     twist  link, next_tangent  link, net_tangent  link, None")
for n in (40, 80, 160):
    t = 2 * np.pi * np.arange(n + 1) / n
    nodes = np.c_[np.cos(t), np.sin(t), 0 * t]
    middle = (t[:-1] + t[1:]) / 2
    radial = np.c_[np.cos(middle), np.sin(middle), 0 * middle]
    # one turn about the tangent, along a plane circle: Lk = Tw = 1, Wr = 0
    normals = np.cos(middle)[:, None] * radial - np.sin(middle)[:, None] * [0.0, 0.0, 1.0]
    line, normals = nodes.T[None].copy(), normals.T[None].copy()
    twist = compute_twist(line, normals)[0][0]
    links = [
        compute_link(line, normals, np.full((1, n), 0.1), 2 * np.pi, word)[0]
        for word in ("next_tangent", "net_tangent", None)
    ]
    print(f"{n:8d}  {twist:8.4f}  {links[0]:18.4f}  {links[1]:17.4f}  {links[2]:10.4f}")
    as_recorded &= abs(twist - (1 - 1 / n)) < 1e-6 and links[0] > 1.9 and links[1] < 0.1 and 1e-3 < 1 - links[2] < 0.1
try:
    compute_writhe(line, 1.0, "none")
    as_recorded = False
except NotImplementedError as error:
    print(f'type_of_additional_segment="none": {type(error).__name__}')
if not as_recorded:
    raise SystemExit("changed: not as recorded")
E
v/bin/python see.py 2> err || { cat err; exit 1; }

#!/bin/sh
# Guess: igl.segment_segment_intersect, "Determine whether two 3D line segments intersect", with "eps  precision", says
#   that two rods which pass each other at a distance of half their length do not intersect.
# Version: libigl 2.6.3, numpy 2.4.6, scipy 1.17.1.
# Behaviour: it does not compare the two points. The parameters t and u are quotients of lengths of cross products,
#   which are the true ones in a plane only; with a distance they grow, and the answer is yes as long as neither
#   exceeds 1. For segments that cross above each other's middle this is so up to 0.86 of their length, and more where
#   they cross nearer to their beginnings. eps does not help. Segments that do intersect are all found, with the right
#   t and u, so that a test with such ones, or in a plane, finds nothing. There is no message.
# What to do: compare the points p + t r and q + u s, or use igl.simplex_simplex_squared_distance.
# Seen (segments of length 1 that cross at right angles above each other's middle; then 2000 pairs of random ones):
#   distance         says    t       u       between the points
#   0.0              True    0.5000  0.5000  0.0000
#   0.1              True    0.5099  0.5099  0.1010
#   0.5              True    0.7071  0.7071  0.5795
#   0.9              False   1.0296  1.0296  1.1708
#   random, apart    91 said to intersect, the farthest at a distance of 2.21
#   random, crossing 2000 of 2000 said to intersect
set -eu
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
cd "$dir"
python3 -m venv v
v/bin/pip -qq install numpy==2.4.6 scipy==1.17.1 libigl==2.6.3
cat > see.py <<'E'
import igl
import numpy as np


def intersect(p, r, q, s):
    return igl.segment_segment_intersect(*(np.reshape(v, (1, 3)).astype(float) for v in (p, r, q, s)))


def distance(p, r, q, s):
    return igl.simplex_simplex_squared_distance(np.array([p, p + r]), np.array([q, q + s]))[0] ** 0.5


print("distance         says    t       u       between the points")
said = []
for height in (0.0, 0.1, 0.5, 0.9):
    p, r, q, s = np.array([[0, 0, 0], [1, 0, 0], [0.5, -0.5, height], [0, 1, 0]])
    hit, t, u = intersect(p, r, q, s)
    between = np.linalg.norm(p + t * r - q - u * s)
    print(f"{height:.1f}              {hit!s:6s}  {t:.4f}  {u:.4f}  {between:.4f}")
    assert abs(distance(p, r, q, s) - height) < 1e-12
    said.append(hit)
random = np.random.default_rng(0)
apart, crossing = [], 0
for p, r, q, s in random.normal(size=(2000, 4, 3)):
    if intersect(p, r, q, s)[0]:
        apart.append(distance(p, r, q, s))
    t, u = random.uniform(0.01, 0.99, 2)
    hit, *at = intersect(p, r, p + t * r - u * s, s)
    crossing += hit and np.allclose(at, [t, u])
print(f"random, apart    {len(apart)} said to intersect, the farthest at a distance of {max(apart):.2f}")
print(f"random, crossing {crossing} of 2000 said to intersect")
if said != [True, True, True, False] or len(apart) < 20 or max(apart) < 1 or min(apart) < 1e-6 or crossing != 2000:
    raise SystemExit("changed: not as recorded")
E
v/bin/python see.py

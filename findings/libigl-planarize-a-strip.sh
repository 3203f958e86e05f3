#!/bin/sh
# Guess: igl.planarize_quad_mesh makes a strip of quadrilaterals as planar as the threshold asks for, "moving vertices
#   so that each quad becomes as planar as possible", as it does for a mesh of two rows; and the largest value of
#   igl.quad_planarity tells how far from planar a mesh is: "distance between the two diagonals of the quad divided by
#   the average of the diagonals' lengths (0 for a perfectly planar quad)".
# Version: libigl 2.6.3, numpy 2.4.6, scipy 1.17.1.
# Behaviour: a strip of one row comes back exactly as it was, of any length, with any number of iterations. So do
#   some meshes of more rows, as one of 7 by 3. The matrix of the method has no inverse, since a shift of all vertices
#   changes no shape; whether its factorization fails depends on rounding. There is no message.
#   quad_planarity has a sign, which depends on the hand of the twist and on the corner that a quad begins with. All
#   values of a strip twisted one way are negative: max() < threshold calls it planar, and the strip that was not made
#   planar passes this check.
# What to do: compare the result with the input, and look at abs(quad_planarity(...)); planarize by another method.
# Seen (helicoid with a quarter turn; threshold 1e-3, 1000 iterations; planarity: the least and the largest):
#   quads     before              moved by  after
#    1 by 1   -0.3333 to -0.3333  0.0000    -0.3333 to -0.3333
#   10 by 1   -0.0772 to -0.0772  0.0000    -0.0772 to -0.0772
#   10 by 1    0.0772 to  0.0772  0.0000     0.0772 to  0.0772   (twisted the other way)
#   40 by 1   -0.0196 to -0.0196  0.0000    -0.0196 to -0.0196
#   10 by 2   -0.0715 to -0.0715  0.3419    -0.0010 to -0.0001
#   10 by 2    0.0715 to  0.0715  0.3419     0.0001 to  0.0010   (twisted the other way)
#    7 by 3   -0.0853 to -0.0814  0.0000    -0.0853 to -0.0814
set -eu
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
cd "$dir"
python3 -m venv v
v/bin/pip -qq install numpy==2.4.6 scipy==1.17.1 libigl==2.6.3
cat > see.py <<'E'
import igl
import numpy as np


def helicoid(along, rows, hand=1):
    """Quadrilaterals of a strip of width 1 and length 2 with a quarter turn."""
    turn, n = hand * np.pi / 2 / along, rows + 1
    across = np.linspace(-0.5, 0.5, n)
    points = [[2 * i / along, w * np.cos(turn * i), w * np.sin(turn * i)] for i in range(along + 1) for w in across]
    corners = [i * n + j for i in range(along) for j in range(rows)]
    return np.array(points), np.array([[k, k + n, k + n + 1, k + 1] for k in corners])


print("quads     before              moved by  after")
seen = {}
for along, rows, hand in ((1, 1, 1), (10, 1, 1), (10, 1, -1), (40, 1, 1), (10, 2, 1), (10, 2, -1), (7, 3, 1)):
    points, quads = helicoid(along, rows, hand)
    made = igl.planarize_quad_mesh(points, quads, 1000, 1e-3)
    before, after = (igl.quad_planarity(corners, quads) for corners in (points, made))
    moved = abs(made - points).max()
    text = [f"{values.min():7.4f} to {values.max():7.4f}" for values in (before, after)]
    print(f"{along:2d} by {rows}   {text[0]}  {moved:.4f}    {text[1]}{'   (twisted the other way)' * (hand < 0)}")
    seen[along, rows, hand] = (moved, before, after)
as_recorded = (
    all((seen[case][0] == 0) == (case[1] == 1) for case in seen if case[1] < 3)
    and all(seen[along, 1, 1][2].max() < 0 < 0.01 < abs(seen[along, 1, 1][2]).max() for along in (1, 10, 40))
    and seen[10, 1, -1][1].min() > 0.01
    and all(abs(seen[10, 2, hand][2]).max() < 1e-3 for hand in (1, -1))
)
if not as_recorded:
    raise SystemExit("changed: not as recorded")
E
v/bin/python see.py

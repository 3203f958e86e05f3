#!/bin/sh
# Guess: the triangles of a Moebius band cannot all be oriented alike, but neither its rim nor the modulus of its
#   curvature depends on that. The mesh is manifold, as is_edge_manifold says, and boundary_loop gives "the boundary
#   loop with the most vertices for a manifold mesh": the whole rim, since there is one.
# Version: libigl 2.6.3, numpy 2.4.6, scipy 1.17.1.
# Behaviour: loops follow oriented edges, and these do not go on at the seam. The loop is half of the rim and
#   closes across the band; boundary_loop_all gives each other point as a loop of its own. At the seam the faces around
#   a point disagree on the normal, and principal_curvature is 500 times too large there, the more so the finer
#   the mesh. There is no error, and the list of bad points is empty.
# What to do: chain the edges that belong to one face, without their direction. Take curvature from a band that is
#   cut open at another ruling.
# Seen:
#   half turns  rim edges  loops, points each        rim  boundary_loop  |k| at seam  elsewhere
#            1        120  61 and 59 of 1          12.71           6.95        719.0        1.4
#            2        120  60 and 1 of 60          13.14           6.57          1.4        2.1
set -eu
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
cd "$dir"
python3 -m venv v
v/bin/pip -qq install numpy==2.4.6 scipy==1.17.1 libigl==2.6.3
cat > see.py <<'E'
import igl
import numpy as np

ALONG, ACROSS = 60, 6


def band(half_turns):
    """A band about the unit circle, 0.6 wide. A Moebius band meets its first ruling turned round."""
    angle, height = np.arange(ALONG) * 2 * np.pi / ALONG, np.linspace(-0.3, 0.3, ACROSS + 1)
    turn = half_turns * angle[:, None] / 2
    out = 1 + height * np.cos(turn)
    points = np.stack([out * np.cos(angle)[:, None], out * np.sin(angle)[:, None], height * np.sin(turn)], axis=-1)
    here = np.arange(ALONG * (ACROSS + 1)).reshape(ALONG, -1)
    there = np.roll(here, -1, axis=0)
    if half_turns % 2:
        there[-1] = there[-1, ::-1]
    a, b, c, d = (part.ravel() for part in (here[:, :-1], there[:, :-1], there[:, 1:], here[:, 1:]))
    return points.reshape(-1, 3), np.concatenate([np.c_[a, b, c], np.c_[a, c, d]])


def length(points, start, end):
    return float(np.linalg.norm(points[start] - points[end], axis=1).sum())


print("half turns  rim edges  loops, points each        rim  boundary_loop  |k| at seam  elsewhere")
seen = {}
for half_turns in (1, 2):
    points, faces = band(half_turns)
    sides = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    edges, times = np.unique(sides, axis=0, return_counts=True)
    rim = edges[times == 1]
    sizes = sorted((len(loop) for loop in igl.boundary_loop_all(faces)), reverse=True)
    longest = igl.boundary_loop(faces)
    _, _, first, second, bad = igl.principal_curvature(points, faces)
    curvature = np.maximum(abs(first), abs(second)).reshape(ALONG, -1)
    row = (
        length(points, *rim.T),
        length(points, longest, np.roll(longest, -1)),
        float(curvature[0].max()),
        float(curvature[1:].max()),
    )
    text = f"{sizes[0]} and {len(sizes) - 1} of {sizes[1]}"
    print(f"{half_turns:10d}  {len(rim):9d}  {text:20s}  {row[0]:7.2f}  {row[1]:13.2f}  {row[2]:11.1f}  {row[3]:9.1f}")
    seen[half_turns] = (sizes, row, len(bad), bool(igl.is_edge_manifold(faces)[0]))
(one, (rim, loop, seam, rest), bad, manifold), (two, (_, _, seam_2, rest_2), _, _) = seen[1], seen[2]
as_recorded = (
    one == [61] + 59 * [1]
    and loop < 0.6 * rim
    and seam > 100 * rest
    and bad == 0
    and manifold
    and two == [60, 60]
    and seam_2 < 2 * rest_2
)
if not as_recorded:
    raise SystemExit("changed: not as recorded")
E
v/bin/python see.py

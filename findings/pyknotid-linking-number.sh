#!/bin/sh
# Guess: the linking number of the two edges of a closed band with one full turn is +1 or -1 by its
#   handedness, and Link.linking_number() of a package for knots says so.
# Version: pyknotid 0.5.3 (the newest), numpy 1.23.5, Python 3.11.
# Behaviour: the number is twice the linking number and never negative. Each crossing is listed once for each
#   of the two curves, and the sum over both lists is halved, not divided by four; then the modulus is taken.
#   A band and its mirror image cannot be told apart.
# What to do: halve it and take the sign from elsewhere, or sum Gauss's integral over pairs of edges.
# Seen:
#   turns   1: Gauss's integral  1.000000, pyknotid 2
#   turns  -1: Gauss's integral -1.000000, pyknotid 2
#   turns   2: Gauss's integral  2.000000, pyknotid 4
set -eu
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
cd "$dir"
python3.11 -m venv v
v/bin/pip -qq install numpy==1.23.5 scipy==1.15.3 pyknotid==0.5.3
cat > see.py <<'E'
import numpy as np
from pyknotid.spacecurves import Link


def gauss_integral(first, second, steps=1200):
    """(1 / 4 pi) of the double integral of (a - b) . (a' x b') / |a - b|^3, by the trapezium rule."""
    s = 2 * np.pi * np.arange(steps) / steps
    a, b = first(s), second(s)
    da, db = ((f(s + 1e-5) - f(s - 1e-5)) / 2e-5 for f in (first, second))
    r = a[:, None] - b[None]
    volume = np.einsum("ijk,ijk->ij", r, np.cross(da[:, None], db[None]))
    return (volume / np.linalg.norm(r, axis=2) ** 3).sum() * (2 * np.pi / steps) ** 2 / (4 * np.pi)


def edge(side, turns):
    def curve(s):
        radial = np.c_[np.cos(s), np.sin(s), 0 * s]
        across = np.cos(turns * s)[:, None] * radial - np.sin(turns * s)[:, None] * [0.0, 0.0, 1.0]
        # turned into a general position, so that no crossing of the projection lies at a vertex
        return (radial + 0.3 * side * across) @ np.linalg.qr(np.array([[3.0, 1, 2], [1, 4, 1], [2, 0, 5]]))[0]

    return curve


s = 2 * np.pi * np.arange(60) / 60
seen = []
for turns in (1, -1, 2):
    first, second = edge(-1, turns), edge(1, turns)
    exact = gauss_integral(first, second)
    given = Link([first(s), second(s)], verbose=False).linking_number()
    print(f"turns {turns:3d}: Gauss's integral {exact:9.6f}, pyknotid {given}")
    seen.append((round(exact), given))
if seen != [(1, 2), (-1, 2), (2, 4)]:
    raise SystemExit("changed: not as recorded")
E
v/bin/python see.py > out 2> err || { cat out err; exit 1; }
grep turns out

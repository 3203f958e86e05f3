#!/bin/sh
# Guess: writhe(curve) has the sign of Gauss's integral, positive where right-handed crossings prevail, and a
#   closed curve may repeat its first point.
# Version: PyWrithe 0.0.3 (the newest), numpy 2.4.6.
# Behaviour: the sign is the mirror image's. With Tw and Lk of the usual signs, Lk = Tw + Wr fails by 2 Wr without
#   a word. If the first point is repeated at the end, 0.25 is added or is missing, by how the curve lies:
#   normals of length zero pass as zeros and leave half of a solid angle in the sum.
# What to do: change the sign, and leave the last point off.
# Seen:
#   Gauss's integral of the smooth trefoil  -3.354126
#   pywrithe, 160 points                     3.354165
#   pywrithe, first point repeated           3.604165
set -eu
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
cd "$dir"
python3 -m venv v
v/bin/pip -qq install numpy==2.4.6 jax==0.10.2 PyWrithe==0.0.3
cat > see.py <<'E'
import numpy as np
import pywrithe


def trefoil(n):
    t = 2 * np.pi * np.arange(n) / n
    return np.c_[np.sin(t) + 2 * np.sin(2 * t), np.cos(t) - 2 * np.cos(2 * t), -np.sin(3 * t)]


def gauss_integral(n=600):
    """(1 / 4 pi) of the double integral of (x - y) . (x' x y') / |x - y|^3, whose integrand vanishes at x = y."""
    t = 2 * np.pi * np.arange(n) / n
    x = trefoil(n)
    d = np.c_[np.cos(t) + 4 * np.cos(2 * t), -np.sin(t) + 4 * np.sin(2 * t), -3 * np.cos(3 * t)]
    total = 0.0
    for i in range(n):
        r = np.delete(x[i] - x, i, axis=0)
        volume = np.einsum("ij,ij->i", r, np.cross(d[i], np.delete(d, i, axis=0)))
        total += (volume / np.linalg.norm(r, axis=1) ** 3).sum()
    return total * (2 * np.pi / n) ** 2 / (4 * np.pi)


points = trefoil(160)
exact, open_list, closed_list = gauss_integral(), pywrithe.writhe(points), pywrithe.writhe(np.r_[points, points[:1]])
print(f"Gauss's integral of the smooth trefoil  {exact:9.6f}")
print(f"pywrithe, 160 points                    {open_list:9.6f}")
print(f"pywrithe, first point repeated          {closed_list:9.6f}")
if abs(exact + open_list) > 1e-3 or abs(abs(open_list - closed_list) - 0.25) > 1e-6:
    raise SystemExit("changed: not as recorded")
E
v/bin/python see.py

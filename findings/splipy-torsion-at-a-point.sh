#!/bin/sh
# Guess: Curve.torsion(t) at one t is the number that torsion([t]) gives for it, as Curve.curvature is: the docstring
#   says of t "float or [float]".
# Version: splipy 1.10.1, numpy 2.4.6, scipy 1.17.1.
# Behaviour: at a single number the torsion is 0, up to rounding, of every curve in space. There (v x a) is
#   multiplied by a in place of its derivative, and the two are orthogonal. A list of one number gives the right
#   value. There is no message: a helix passes for a plane curve.
# What to do: give torsion() a list.
# Seen (a helix of radius 1 and pitch 2 pi 0.2, of torsion 0.2 / 1.04):
#   exact            curvature 0.9615  torsion 0.1923
#   list of numbers  curvature 0.9616  torsion 0.1923
#   one number       curvature 0.9616  torsion 0.0000
set -eu
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
cd "$dir"
python3 -m venv v
v/bin/pip -qq install numpy==2.4.6 scipy==1.17.1 splipy==1.10.1
cat > see.py <<'E'
import numpy as np
from splipy import curve_factory

rise = 0.2
helix = curve_factory.fit(lambda t: np.c_[np.cos(t), np.sin(t), rise * t], 0, 6, rtol=1e-9)
places = [0.5, 2.0, 5.5]
rows = {
    "exact": ([1 / (1 + rise**2)] * 3, [rise / (1 + rise**2)] * 3),
    "list of numbers": (helix.curvature(places), helix.torsion(places)),
    "one number": ([helix.curvature(t) for t in places], [helix.torsion(t) for t in places]),
}
for name, (curvature, torsion) in rows.items():
    print(f"{name:15s}  curvature {curvature[1]:.4f}  torsion {abs(torsion[1]):.4f}")
as_recorded = (
    np.allclose(rows["list of numbers"], rows["exact"], rtol=1e-3)
    and np.allclose(rows["one number"][0], rows["exact"][0], rtol=1e-3)
    and np.abs(rows["one number"][1]).max() < 1e-9
)
if not as_recorded:
    raise SystemExit("changed: not as recorded")
E
v/bin/python see.py

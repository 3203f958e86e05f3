#!/bin/sh
# Guess: eigsh(K, k, M=G, sigma=0, mode="buckling") gives the k least buckling loads of K x = lambda G x: sigma=0 is
#   how the least eigenvalues are asked for in the normal mode. Or it raises, or warns.
# Version: scipy 1.17.1, numpy 2.4.6.
# Behaviour: every load is exactly 0, without an error or a warning. In this mode the solver looks for
#   mu = w / (w - sigma), which is 1 for each w where sigma is 0, and turns mu back into w. A shift that is small
#   beside the loads loses digits in the same way: half a percent at 1e-9.
# What to do: give a sigma of the size of the least load, and check K x - lambda G x.
# Seen:
#   sigma  loads (exactly 9.8645, 39.3973, 88.4163)
#   0      0, 0, 0
#   1e-09  9.821, 39.191, 88.2349
#   1e-06  9.8628, 39.3955, 88.4144
#   5      9.8645, 39.3973, 88.4163
set -eu
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
cd "$dir"
python3 -m venv v
v/bin/pip -qq install numpy==2.4.6 scipy==1.17.1
cat > see.py <<'E'
import warnings

import numpy as np
from scipy.linalg import eigh
from scipy.sparse import diags_array
from scipy.sparse.linalg import eigsh

warnings.simplefilter("error")
# Pinned column of 40 pieces: the loads tend to pi^2, 4 pi^2, 9 pi^2.
n = 40
geometric = diags_array([-1.0, 2.0, -1.0], offsets=[-1, 0, 1], shape=(n - 1, n - 1)).tocsc() * n**2
stiffness = (geometric @ geometric).tocsc()
start = np.random.default_rng(0).normal(size=n - 1)
exact = eigh(stiffness.toarray(), geometric.toarray(), eigvals_only=True)[:3]


def text(loads):
    return ", ".join(f"{load:.4f}".rstrip("0").rstrip(".") for load in loads)


print(f"sigma  loads (exactly {text(exact)})")
seen = {}
for sigma in (0.0, 1e-9, 1e-6, 5.0):
    seen[sigma] = eigsh(stiffness, 3, M=geometric, sigma=sigma, mode="buckling", v0=start)[0]
    print(f"{sigma:<5g}  {text(seen[sigma])}")
as_recorded = (
    not seen[0.0].any()
    and 1e-3 < abs(seen[1e-9] / exact - 1).max() < 0.1
    and abs(seen[1e-6] / exact - 1).max() > 1e-5
    and abs(seen[5.0] / exact - 1).max() < 1e-9
)
if not as_recorded:
    raise SystemExit("changed: not as recorded")
E
v/bin/python see.py

#!/bin/sh
# Guess: minres stops when ||Ax - b|| <= rtol ||b||, as cg and gmres do, and says info = 0 only then. The docstring
#   says: "The algorithm terminates when the relative residual is below rtol", and 0 is "successful exit".
# Version: scipy 1.17.1, numpy 2.4.6.
# Behaviour: it compares the residual with rtol ||A|| ||x||. Where stiff and soft modes lie far apart, that is more than
#   ||b||: a beam of 200 pieces under a uniform load is hardly bent when minres reports success, and its residual
#   is 98 % of the load. With rtol=1e-10 the residual is still 25 %. info is 0 too for a right-hand side that no
#   x fits, as that of two contradicting constraints in a KKT matrix.
# What to do: compute ||Ax - b|| / ||b|| afterwards, whatever info says; or solve such a system by factorisation.
# Seen:
#   beam, 5/384 = 0.01302   deflection  info  ||Kx - f|| / ||f||
#   spsolve                  0.0130211
#   cg                       0.0130211     0  under 1e-5
#   gmres                    0.0130211     0  under 1e-5
#   minres                 7.14571e-07     0  0.976
#   minres, rtol=1e-10       0.0120414     0  0.245
#   contradicting rows: minres info 0, residual 0.316; gmres info 40
set -eu
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
cd "$dir"
python3 -m venv v
v/bin/pip -qq install numpy==2.4.6 scipy==1.17.1
cat > see.py <<'E'
import numpy as np
from scipy.sparse import diags_array
from scipy.sparse.linalg import cg, gmres, minres, spsolve

# Pinned beam of length 1 and stiffness 1 under the load 1: the deflection in the middle is 5/384.
n = 200
second = diags_array([1.0, -2.0, 1.0], offsets=[-1, 0, 1], shape=(n - 1, n - 1)) * n**2
stiffness, load = (second @ second).tocsc(), np.ones(n - 1)


def residual(matrix, x, b):
    return float(np.linalg.norm(matrix @ x - b) / np.linalg.norm(b))


print("beam, 5/384 = 0.01302   deflection  info  ||Kx - f|| / ||f||")
exact = spsolve(stiffness, load)[n // 2 - 1]
print(f"{'spsolve':20s}  {exact:12.6g}")
seen = {}
for name, (x, info) in {
    "cg": cg(stiffness, load, maxiter=100 * n),
    "gmres": gmres(stiffness, load, restart=n),
    "minres": minres(stiffness, load),
    "minres, rtol=1e-10": minres(stiffness, load, rtol=1e-10),
}.items():
    deflection, rest = x[n // 2 - 1], residual(stiffness, x, load)
    print(f"{name:20s}  {deflection:12.6g}  {info:4d}  {'under 1e-5' if rest < 1e-5 else format(rest, '.3f')}")
    seen[name] = (info, float(deflection), rest)
kkt = np.array([[2.0, 0, 1, 1], [0, 3, 0, 0], [1, 0, 0, 0], [1, 0, 0, 0]])  # x = 1 and x = 2
right = np.array([0.0, 0, 1, 2])
(x, info), (_, other) = minres(kkt, right), gmres(kkt, right)
print(f"contradicting rows: minres info {info}, residual {residual(kkt, x, right):.3f}; gmres info {other}")
as_recorded = (
    all(seen[name][0] == 0 and seen[name][2] < 1e-5 for name in ("cg", "gmres"))
    and seen["minres"][0] == 0
    and seen["minres"][1] < 0.01 * exact
    and seen["minres"][2] > 0.9
    and seen["minres, rtol=1e-10"][0] == 0
    and seen["minres, rtol=1e-10"][2] > 0.1
    and info == 0
    and other > 0
)
if not as_recorded:
    raise SystemExit("changed: not as recorded")
E
v/bin/python see.py

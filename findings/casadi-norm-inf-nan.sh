#!/bin/sh
# Guess: norm_inf of a residual with a NaN in it is NaN, as norm_1 and norm_2 are and as numpy's is, so that
#   "norm_inf(r) < tolerance" does not pass.
# Version: casadi 3.8.2, numpy 2.4.6.
# Behaviour: NaN entries are left out: the norm is that of the other entries, and 0 where all are NaN. It is the
#   same for numbers (DM) and for expressions in functions (MX). A step to a place where the model is not defined
#   looks converged.
# What to do: test with norm_2, or look for NaN first.
# Seen:
#   residual          norm_inf    norm_1    norm_2  numpy's norm of order inf
#   [1e-09, 2e-09]       2e-09     3e-09  2.24e-09     2e-09
#   [nan, 2e-09]         2e-09       nan       nan       nan
#   [2e-09, nan]         2e-09       nan       nan       nan
#   [nan, nan]               0       nan       nan       nan
set -eu
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
cd "$dir"
python3 -m venv v
v/bin/pip -qq install numpy==2.4.6 casadi==3.8.2
cat > see.py <<'E'
import casadi
import numpy as np

nan = float("nan")
norms = (casadi.norm_inf, casadi.norm_1, casadi.norm_2)
x = casadi.MX.sym("x", 2)
compiled = casadi.Function("norms", [x], [norm(x) for norm in norms])
print(f"{'residual':16s}  norm_inf    norm_1    norm_2  numpy's norm of order inf")
as_recorded = True
for residual, expected in (([1e-9, 2e-9], 2e-9), ([nan, 2e-9], 2e-9), ([2e-9, nan], 2e-9), ([nan, nan], 0.0)):
    direct = [float(norm(casadi.DM(residual))) for norm in norms]
    row = [*direct, float(np.linalg.norm(residual, np.inf))]
    print(f"{residual!s:16s}  " + "  ".join(f"{value:8.3g}" for value in row))
    as_recorded &= np.array_equal(direct, [float(value) for value in compiled(residual)], equal_nan=True)
    as_recorded &= row[0] == expected and np.isnan(row[1:]).all() == np.isnan(residual).any()
if not as_recorded:
    raise SystemExit("changed: not as recorded")
E
v/bin/python see.py

#!/bin/sh
# Guess: ellipj(u, m) is periodic, |sn| <= 1 and |cn| <= 1; near m = 1, where an elastica with few inflections
#   lives, at worst some digits are lost.
# Version: scipy 1.17.1, numpy 2.4.6, mpmath 1.3.0.
# Behaviour: from 1 - m < 1e-10 on, an expansion about m = 1 is used that holds only for u well below K(m),
#   but it is used for all u. At 2 K cn is -2, at 3 K it is -8e5, and sn stays above 1. At 1 - m = 1e-9 all is
#   right.
# What to do: take u modulo 4 K and reflect it into [0, K] first, or use mpmath where 1 - m < 1e-9.
# Seen:
#   1 - m   u / K              sn              cn     cn by mpmath
#   1e-09       2     2.82819e-08              -1               -1
#   1e-09       3              -1    -1.34133e-12     -1.34153e-12
#   1e-11       2               1              -2               -1
#   1e-11       3               1    -2.52982e+06      3.92472e-13
set -eu
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
cd "$dir"
python3 -m venv v
v/bin/pip -qq install numpy==2.4.6 scipy==1.17.1 mpmath==1.3.0
cat > see.py <<'E'
import mpmath
import numpy as np
from scipy.special import ellipj, ellipkm1

mpmath.mp.dps = 40
print("1 - m   u / K              sn              cn     cn by mpmath")
errors = []
for complement in (1e-9, 1e-11):
    m = 1 - complement
    for periods in (2, 3):
        u = periods * ellipkm1(complement)
        sn, cn, _, _ = ellipj(u, m)
        exact = float(mpmath.ellipfun("cn", mpmath.mpf(u), m=mpmath.mpf(m)))
        print(f"{complement:.0e}  {periods:6d}  {sn:14.6g}  {cn:14.6g}  {exact:15.6g}")
        errors.append(abs(cn - exact))
if not (max(errors[:2]) < 1e-12 and np.isclose(errors[2], 1, rtol=1e-3) and errors[3] > 1e6):
    raise SystemExit("changed: not as recorded")
E
v/bin/python see.py

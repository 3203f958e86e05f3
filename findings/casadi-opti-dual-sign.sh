#!/bin/sh
# Guess: the multiplier of a constraint that holds with equality is the same whether it was written ==, >= or within
#   bounds, as lam_g of nlpsol is: a contact that pushes has the force of the gap that is kept in its place.
# Version: casadi 3.8.2, numpy 2.4.6.
# Behaviour: Opti.dual() is the multiplier of the one-sided form that Opti makes of each constraint: negative for
#   a lower bound given by ==, positive for one given by >=, and of a bounded one there are two numbers, the
#   first for the lower bound. nlpsol's lam_g has one sign for all three. Which side stands on the left makes no difference.
# What to do: take forces as the derivative of the minimum by the right-hand side; check the sign with ==
#   and with >= apart. Here it is d(x^2)/dx = 2 at x = 1.
# Seen:
#   Opti   x == 1:      dual -2
#   Opti   1 == x:      dual -2
#   Opti   x >= 1:      dual 2
#   Opti   1 <= x:      dual 2
#   Opti   1 <= x <= 5: dual 2, 0
#   nlpsol x == 1:      lam_g -2
#   nlpsol x >= 1:      lam_g -2
set -eu
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
cd "$dir"
python3 -m venv v
v/bin/pip -qq install numpy==2.4.6 casadi==3.8.2
cat > see.py <<'E'
import casadi
import numpy as np

QUIET = {"print_time": 0}
SILENT = {"print_level": 0, "sb": "yes"}
FORMS = {
    "x == 1": lambda opti, x: x == 1,
    "1 == x": lambda opti, x: 1 == x,
    "x >= 1": lambda opti, x: x >= 1,
    "1 <= x": lambda opti, x: 1 <= x,
    "1 <= x <= 5": lambda opti, x: opti.bounded(1, x, 5),
}
seen = []
for name, form in FORMS.items():
    opti = casadi.Opti()
    x = opti.variable()
    opti.minimize(x**2)
    constraint = form(opti, x)
    opti.subject_to(constraint)
    opti.set_initial(x, 2)
    opti.solver("ipopt", QUIET, SILENT)
    dual = np.round(np.atleast_1d(opti.solve().value(opti.dual(constraint)))).astype(int).tolist()
    print(f"Opti   {name + ':':12s} dual {', '.join(map(str, dual))}")
    seen.append(dual)
for name, upper in (("x == 1", 1.0), ("x >= 1", np.inf)):
    x = casadi.SX.sym("x")
    solve = casadi.nlpsol("solve", "ipopt", {"x": x, "f": x**2, "g": x}, {**QUIET, "ipopt": SILENT})
    dual = round(float(solve(x0=2, lbg=1, ubg=upper)["lam_g"]))
    print(f"nlpsol {name + ':':12s} lam_g {dual}")
    seen.append(dual)
if seen != [[-2], [-2], [2], [2], [2, 0], -2, -2]:
    raise SystemExit("changed: not as recorded")
E
v/bin/python see.py

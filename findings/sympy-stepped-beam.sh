#!/bin/sh
# Guess: the deflection of a beam made of pieces by Beam.join() is the integral of its slope, and 0 where bc_deflection
#   says so, as that of a beam in one piece is. The docstring of join() says: "This method can be used to form beams
#   having Discontinuous values of Elastic modulus or Second moment".
# Version: sympy 1.14.0, mpmath 1.3.0.
# Behaviour: for a cantilever of two pieces of different second moment the slope is right, and the deflection has the
#   other sign. On two supports bc_deflection is not looked at: the beam is taken as clamped at its beginning, and
#   its end is off the support. There is no message. Two pieces that are alike become one, which is right.
# What to do: give a clamped Beam a Piecewise as second_moment, without join(). On two supports integrate
#   bending_moment() / second_moment yourself.
# Seen (a force 1; pieces of length 1 with these second moments):
#   cantilever, at its end  deflection  exact  slope  exact
#   1 + 1                          8/3    8/3      2      2
#   2 + 1                         -3/2    3/2    5/4    5/4
#   2 + 1, Piecewise               3/2    3/2    5/4    5/4
#   on two supports, 1 + 1: deflection 0 at the first and 0 at the second
#   on two supports, 2 + 1: deflection 0 at the first and -1/3 at the second
set -eu
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
cd "$dir"
python3 -m venv v
v/bin/pip -qq install sympy==1.14.0 mpmath==1.3.0
cat > see.py <<'E'
from sympy import Piecewise, Rational, integrate, symbols
from sympy.physics.continuum_mechanics.beam import Beam

x, force, moment, left, right = symbols("x F M A B")


def joined(first, second):
    return Beam(1, 1, first).join(Beam(1, 1, second), "fixed")


def cantilever(beam):
    """Deflection and slope at the end, under a force 1 there."""
    beam.apply_load(1, 2, -1)
    beam.apply_load(force, 0, -1)
    beam.apply_load(moment, 0, -2)
    beam.bc_deflection, beam.bc_slope = [(0, 0)], [(0, 0)]
    beam.solve_for_reaction_loads(force, moment)
    return beam.deflection().subs(x, 2), beam.slope().subs(x, 2)


def supported(beam):
    """Deflections at both supports, under a force 1 in the middle."""
    beam.apply_load(1, 1, -1)
    beam.apply_load(left, 0, -1)
    beam.apply_load(right, 2, -1)
    beam.bc_deflection = [(0, 0), (2, 0)]
    beam.solve_for_reaction_loads(left, right)
    return beam.deflection().subs(x, 0), beam.deflection().subs(x, 2)


def exact(first, second):
    """The same for the cantilever: the integrals of m^2 / I and m / I for the moment m = 2 - x."""
    powers = (2 - x) ** 2, 2 - x
    return tuple(integrate(m, (x, 0, 1)) / first + integrate(m, (x, 1, 2)) / second for m in powers)


seen = []
print("cantilever, at its end  deflection  exact  slope  exact")
for name, beam, inertias in (
    ("1 + 1", joined(1, 1), (1, 1)),
    ("2 + 1", joined(2, 1), (2, 1)),
    ("2 + 1, Piecewise", Beam(2, 1, Piecewise((2, x <= 1), (1, x <= 2))), (2, 1)),
):
    (deflection, slope), (lowering, turn) = cantilever(beam), exact(*inertias)
    print(f"{name:22s}  {deflection!s:>10s}  {lowering!s:>5s}  {slope!s:>5s}  {turn!s:>5s}")
    seen.append((Rational(deflection) / lowering, Rational(slope) / turn))
for name, beam in (("1 + 1", joined(1, 1)), ("2 + 1", joined(2, 1))):
    ends = supported(beam)
    print(f"on two supports, {name}: deflection {ends[0]} at the first and {ends[1]} at the second")
    seen.append(ends)
if seen != [(1, 1), (-1, 1), (1, 1), (0, 0), (0, Rational(-1, 3))]:
    raise SystemExit("changed: not as recorded")
E
v/bin/python see.py

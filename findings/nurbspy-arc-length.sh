#!/bin/sh
# Guess: nurbspy's get_arclength(), "the arc length of a parametric curve in the interval [u1,u2] using numerical
#   quadrature", is the length to some digits, whatever the curve; and the lengths of two halves add up to that of the
#   whole.
# Version: nurbspy 1.5.0, numpy 2.4.6, scipy 1.17.1.
# Behaviour: the quadrature has 10 points for the whole curve, however many spans or turns it has, and does not look
#   at its error. A curve of one span is right, one turn of a helix to 0.2 %. With more turns or folds than points the
#   result depends on where the points fall, here up to 17 % to either side. Points, derivatives, curvature and torsion
#   are right. There is no message.
# What to do: sum get_arclength(u1, u2) over the spans between knots; where a span is sharply bent, over parts of it.
# Seen (cubic curves: helices, and lines folded to and fro; the length by a polygon of 200000 edges):
#   curve           get_arclength  two halves  over the spans   polygon
#   arch, 1 span           2.0000      2.0000          2.0000    2.0000
#   helix, 1 turn          5.9980      6.0083          6.0086    6.0086
#   helix, 10 turns       59.2845     59.9252         60.0998   60.0998
#   helix, 20 turns      119.2006    119.3766        120.2012  120.2012
#   folds, 10              1.9122      1.7809          1.7685    1.7633
#   folds, 40              5.6084      5.5950          6.7852    6.7807
#   folds, 100            19.6067     13.6218         16.8184   16.8154
set -eu
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
cd "$dir"
python3 -m venv v
v/bin/pip -qq install numpy==2.4.6 scipy==1.17.1 nurbspy==1.5.0
cat > see.py <<'E'
import numpy as np
from nurbspy import NurbsCurve


def cubic(points):
    """The curve and its knots."""
    spans = len(points) - 3
    knots = np.concatenate([[0] * 3, np.linspace(0, 1, spans + 1), [1] * 3])
    return NurbsCurve(control_points=np.array(points, float).T, degree=3, knots=knots), knots[3:-3]


def helix(turns, each=12):
    angle = np.linspace(0, 2 * np.pi * turns, each * turns + 1)
    return np.c_[np.cos(angle), np.sin(angle), 0.05 * angle]


def folded(folds):
    return [(0.01 * i, 0.5 * (i % 2), 0) for i in range(folds + 1)]


print("curve           get_arclength  two halves  over the spans   polygon")
errors = {}
for name, points in {
    "arch, 1 span": [(0, 0, 0), (0, 1, 0), (1, 1, 0), (1, 0, 0)],
    "helix, 1 turn": helix(1),
    "helix, 10 turns": helix(10),
    "helix, 20 turns": helix(20),
    "folds, 10": folded(10),
    "folds, 40": folded(40),
    "folds, 100": folded(100),
}.items():
    curve, knots = cubic(points)
    whole = curve.get_arclength()
    halves = curve.get_arclength(0, 0.5) + curve.get_arclength(0.5, 1)
    spans = sum(curve.get_arclength(a, b) for a, b in zip(knots[:-1], knots[1:], strict=True))
    edges = np.diff(curve.get_value(np.linspace(0, 1, 200_001)), axis=1)
    exact = np.linalg.norm(edges, axis=0).sum()
    print(f"{name:16s}{whole:13.4f} {halves:11.4f} {spans:15.4f} {exact:9.4f}")
    errors[name] = whole / exact - 1, halves / whole - 1, spans / exact - 1
whole = {name: error[0] for name, error in errors.items()}
as_recorded = (
    all(abs(error[2]) < 5e-3 for error in errors.values())
    and abs(whole["arch, 1 span"]) < 1e-4
    and abs(whole["helix, 1 turn"]) < 1e-2
    and whole["folds, 40"] < -0.1
    and whole["folds, 100"] > 0.1
    and abs(errors["folds, 100"][1]) > 0.1
)
if not as_recorded:
    raise SystemExit("changed: not as recorded")
E
v/bin/python see.py

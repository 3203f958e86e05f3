#!/bin/sh
# Guess: make_splprep(points.T, s=0, bc_type="periodic") is the closed curve that splprep gives with per=1: the
#   documentation says "The values and the first k-1 derivatives at the ends are equivalent".
# Version: scipy 1.17.1, numpy 2.4.6.
# Behaviour: with s=0 the word "periodic" is not looked at, and what comes is the not-a-knot spline. The closed curve
#   has a kink where it begins, and its curvature there is 16 % too large for a circle, not 6 %. There is no
#   message, nor where the points do not close. With s > 0, however small, the curve is closed smoothly.
# What to do: make_interp_spline(u, points, bc_type="periodic"), or splprep with the first point repeated.
# Seen:
#   a circle by 8 points               kink at the seam  curvature there
#   splprep, per=1                             0.00 deg            1.057
#   make_interp_spline, periodic               0.00 deg            1.057
#   make_splprep, periodic                     6.64 deg            1.160
#   make_splprep, not-a-knot                   6.64 deg            1.160
#   make_splprep, periodic, s=1e-20            0.00 deg            1.057
set -eu
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
cd "$dir"
python3 -m venv v
v/bin/pip -qq install numpy==2.4.6 scipy==1.17.1
cat > see.py <<'E'
import warnings

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline, make_splprep, splprep

warnings.simplefilter("error")
angle = 2 * np.pi * np.arange(9) / 8
points = np.c_[np.cos(angle), np.sin(angle)]
points[-1] = points[0]


def old():
    (knots, coefficients, degree), _ = splprep(points.T, s=0, per=1)
    return BSpline(knots, np.stack(coefficients), degree, axis=1)


def new(s, **options):
    return make_splprep(points.T, s=s, **options)[0]


def at(curve, u, order):
    x, y = np.reshape(curve(u, order), 2)
    return complex(x, y)


def curvature(curve, u):
    first, second = at(curve, u, 1), at(curve, u, 2)
    return (first.conjugate() * second).imag / abs(first) ** 3


print(f"{'a circle by 8 points':33s}  kink at the seam  curvature there")
kinks = []
for name, curve in {
    "splprep, per=1": old(),
    "make_interp_spline, periodic": make_interp_spline(np.linspace(0, 1, 9), points, bc_type="periodic"),
    "make_splprep, periodic": new(0, bc_type="periodic"),
    "make_splprep, not-a-knot": new(0, bc_type="not-a-knot"),
    "make_splprep, periodic, s=1e-20": new(1e-20, bc_type="periodic"),
}.items():
    kink = abs(np.degrees(np.angle(at(curve, 0.0, 1) / at(curve, 1.0, 1))))
    print(f"{name:33s}  {kink:12.2f} deg  {curvature(curve, 0.0):15.3f}")
    kinks.append(round(float(kink), 2))
open_ends = make_splprep(points[:-1].T, s=0, bc_type="periodic")[0]
closed = abs(at(open_ends, 0.0, 0) - at(open_ends, 1.0, 0)) < 0.1
if kinks != [0.0, 0.0, 6.64, 6.64, 0.0] or closed:
    raise SystemExit("changed: not as recorded")
E
v/bin/python see.py

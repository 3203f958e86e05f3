#!/bin/sh
# Guess: reverse() runs through the same curve in the other direction. The docstring says: "Swap the direction of a
#   parameter by making it go in the reverse direction. The parametric domain remains unchanged."
# Version: splipy 1.10.1, numpy 2.4.6, scipy 1.17.1.
# Behaviour: of a curve that is periodic it makes another curve. The control points are put in reverse order, but not
#   shifted against the knots, as those of a periodic curve have to be where the knots are not evenly spaced, and
#   the parameter 0 lies elsewhere. The circle made by circle() becomes a square around it, a ring surface a square
#   tube. A closed cubic through uneven points is bent otherwise. Nothing is said; open curves are right.
# What to do: split(t) the curve before it is reversed: that makes it open; or evaluate at end - t.
# Seen:
#   curve                     length  reversed  radius        reversed
#   circle()                  6.2832    7.9995  1.000..1.000  1.000..1.414
#   circle(type="p4C1")       6.2832    6.4601  1.000..1.000  0.955..1.090
#   the same circle, split    6.2832    6.2832  1.000..1.000  1.000..1.000
#   ring of height 0.5: area 3.1416, reversed along the circle 3.9998
set -eu
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
cd "$dir"
python3 -m venv v
v/bin/pip -qq install numpy==2.4.6 scipy==1.17.1 splipy==1.10.1
cat > see.py <<'E'
import numpy as np
from splipy import curve_factory, surface_factory


def radius(curve):
    """The least and the largest distance from the middle."""
    distance = np.linalg.norm(curve(np.linspace(curve.start(0), curve.end(0), 401)), axis=1)
    return f"{distance.min():.3f}..{distance.max():.3f}"


circle = curve_factory.circle()
curves = {
    "circle()": circle,
    'circle(type="p4C1")': curve_factory.circle(type="p4C1"),
    "the same circle, split": circle.clone().split(0.0),
}
print("curve                     length  reversed  radius        reversed")
seen = {}
for name, curve in curves.items():
    back = curve.clone().reverse()
    seen[name] = (round(curve.length(), 3), round(back.length(), 3), radius(curve), radius(back))
    print(f"{name:24s}  {curve.length():.4f}  {back.length():8.4f}  {radius(curve)}  {radius(back)}")
ring = surface_factory.edge_curves(circle, circle.clone().set_dimension(3) + (0, 0, 0.5))
areas = ring.area(), ring.clone().reverse("u").area()
print(f"ring of height 0.5: area {areas[0]:.4f}, reversed along the circle {areas[1]:.4f}")
as_recorded = (
    seen["circle()"] == (6.283, 8.0, "1.000..1.000", "1.000..1.414")
    and seen['circle(type="p4C1")'] == (6.283, 6.46, "1.000..1.000", "0.955..1.090")
    and seen["the same circle, split"] == (6.283, 6.283, "1.000..1.000", "1.000..1.000")
    and np.allclose(areas, (np.pi, 4), atol=1e-3)
)
if not as_recorded:
    raise SystemExit("changed: not as recorded")
E
v/bin/python see.py

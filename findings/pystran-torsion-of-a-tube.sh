#!/bin/sh
# Guess: pystran.section.rect_tube(H, B, th, tb), "cross section characteristics for an rectangular tube", gives the
#   torsion constant of a thin-walled tube by Bredt's formula, good to some per cent, as its other sections do.
# Version: pystran 0.3.1, sectionproperties 3.10.2, numpy 2.4.6, scipy 1.17.1.
# Behaviour: Bredt's formula wants the area within the middle of the wall; here it gets that of the hole. The formula is
#   otherwise that of handbooks, 2 t t' (H - t)^2 (B - t')^2 / (H t' + ...). A flat tube, as of a strip folded round
#   and joined, twists twice as far as it should. Area and moments of inertia are right; so are the torsion
#   constants of circular_tube and rectangle. There is no message.
# What to do: J = 4 (H - t)^2 (B - t)^2 t / (2 (H - t + B - t)), given to beam_3d_section as J; or sectionproperties.
# Seen (mm; J in mm^4, by pystran, by Bredt's formula and by finite elements of sectionproperties):
#   tube               pystran      Bredt    elements   pystran / elements
#   100 x 100 x 2      1733360    1882384     1900814   0.91
#   100 x 100 x 10     4551111    7290000     7725034   0.59
#   100 x 50 x 5        925714    1305402     1355187   0.68
#   100 x 50 x 10       886154    1993846     2184888   0.41
#   100 x 20 x 4         87058     168521      177569   0.49
#   others, pystran / elements: circular tube 1.00, strip of 10 x 1 1.00
set -eu
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
cd "$dir"
python3 -m venv v
v/bin/pip -qq install numpy==2.4.6 scipy==1.17.1 pystran==0.3.1 sectionproperties==3.10.2
cat > see.py <<'E'
from pystran.section import circular_tube, rect_tube, rectangle
from sectionproperties.analysis import Section
from sectionproperties.pre.library import circular_hollow_section, rectangular_hollow_section, rectangular_section


def elements(shape, size):
    """Area, second moments and torsion constant."""
    shape.create_mesh(mesh_sizes=[size])
    section = Section(shape)
    section.calculate_geometric_properties()
    section.calculate_warping_properties()
    return section.get_area(), *section.get_ic()[:2], section.get_j()


print("tube               pystran      Bredt    elements   pystran / elements")
ratios = []
for high, wide, thick in ((100, 100, 2), (100, 100, 10), (100, 50, 5), (100, 50, 10), (100, 20, 4)):
    area, _, second_y, second_z, torsion = rect_tube(high, wide, thick, thick)
    tube = rectangular_hollow_section(d=high, b=wide, t=thick, r_out=0, n_r=1)
    given = elements(tube, thick**2 / 4)
    middle = (high - thick) * (wide - thick)
    bredt = 4 * middle**2 * thick / (2 * (high + wide - 2 * thick))
    name = f"{high} x {wide} x {thick}"
    print(f"{name:16s}{torsion:10.0f} {bredt:10.0f}  {given[3]:10.0f}   {torsion / given[3]:.2f}")
    same = all(abs(a / b - 1) < 1e-6 for a, b in zip((area, second_y, second_z), given[:3], strict=True))
    ratios.append((torsion / given[3], bredt / given[3], same))
ring = circular_tube(40, 50)[4] / elements(circular_hollow_section(d=100, t=10, n=128), 10)[3]
strip = rectangle(10, 1)[4] / elements(rectangular_section(d=10, b=1), 0.1)[3]
print(f"others, pystran / elements: circular tube {ring:.2f}, strip of 10 x 1 {strip:.2f}")
as_recorded = (
    all(same and exact > 0.9 and given < 0.93 * exact for given, exact, same in ratios)
    and min(given for given, _, _ in ratios) < 0.45
    and abs(ring - 1) < 0.01
    and abs(strip - 1) < 0.01
)
if not as_recorded:
    raise SystemExit("changed: not as recorded")
E
v/bin/python see.py

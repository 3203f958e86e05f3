#!/bin/sh
# Guess: the natural frequencies of a beam do not depend on the unit of length, and tend to a limit when it is divided
#   into more members. analyze_modal says: "Any loads applied in this direction [...] will be converted to mass."
# Version: PyNiteFEA 3.2.0, numpy 2.4.6, scipy 1.17.1.
# Behaviour: a member's load is lumped to its ends as m (1 - x) / L where m (L - x) / L is meant: a length is subtracted
#   from 1. For a uniform load, x = L / 2, the first end gets too much below L = 1, nothing at L = 2, and a negative
#   mass beyond; the other end is right. Self-weight takes another path and is right in bending; in torsion its
#   inertia is made of the torsion constant J where the polar moment Iy + Iz belongs, so that a strip is as fast as
#   a tube: J / (Iy + Iz) of this strip is 0.04. There is no message.
# What to do: give masses as nodal loads, or as self-weight of a changed density; compute frequencies of torsion
#   elsewhere.
# Seen (steel strip of 1 m x 20 mm x 2 mm, clamped at one end; Hz):
#   first frequency, by the theory of beams    1.631
#   self-weight, 8 members, in m / in mm       1.631  1.631
#   self-weight, 16 members, in m / in mm      1.631  1.631
#   uniform load, 8 members, in m / in mm      0.639  3.163
#   uniform load, 16 members, in m / in mm     0.432  4.317
#   first of torsion, exact / self-weight      150.8  783.8
set -eu
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
cd "$dir"
python3 -m venv v
v/bin/pip -qq install numpy==2.4.6 scipy==1.17.1 PyNiteFEA==3.2.0
cat > see.py <<'E'
import numpy as np
from Pynite import FEModel3D


def strip(members, unit, self_weight, modes):
    """First frequency with `unit` in a metre, by Pynite and by theory; first frequency of torsion, likewise."""
    length, width, thickness = 1.0 * unit, 0.02 * unit, 0.002 * unit
    elastic, density = 2e11 / unit, 7850 / unit**3
    shear = elastic / 2.6
    area, stiff, soft = width * thickness, thickness * width**3 / 12, width * thickness**3 / 12
    torsion = width * thickness**3 / 3 * (1 - 0.63 * thickness / width)
    model = FEModel3D()
    model.add_material("steel", elastic, shear, 0.3, density)
    model.add_section("strip", area, stiff, soft, torsion)
    for i in range(members + 1):
        model.add_node(f"N{i}", length * i / members, 0, 0)
    for i in range(members):
        model.add_member(f"M{i}", f"N{i}", f"N{i + 1}", "steel", "strip")
    model.def_support("N0", *[True] * 6)
    model.add_load_combo("Combo 1", {"weight": 1.0})
    if self_weight:
        model.add_member_self_weight("FY", -1.0, "weight")
    else:
        for i in range(members):
            model.add_member_dist_load(f"M{i}", "FY", -density * area, -density * area, case="weight")
    model.analyze_modal(modes)
    bending = 1.8751040687**2 * np.sqrt(elastic * soft / (density * area)) / (2 * np.pi * length**2)
    twisting = np.sqrt(shear * torsion / (density * (stiff + soft))) / (4 * length)
    tip = model.nodes[f"N{members}"]
    turns = [np.abs([turn[f"Mode {i + 1}"] for turn in (tip.RX, tip.RY, tip.RZ)]) for i in range(modes)]
    twists = [frequency for frequency, turn in zip(model.frequencies, turns, strict=True) if turn[0] > max(turn[1:])]
    return model.frequencies[0], bending, twists[0] if twists else None, twisting


seen = {}
print(f"first frequency, by the theory of beams    {strip(8, 1, True, 4)[1]:.3f}")
for self_weight, name in ((True, "self-weight,"), (False, "uniform load,")):
    for members in (8, 16):
        row = [strip(members, unit, self_weight, 4)[0] for unit in (1, 1000)]
        print(f"{f'{name} {members} members, in m / in mm':41s}  {row[0]:.3f}  {row[1]:.3f}")
        seen[self_weight, members] = row
_, bending, twists, twisting = strip(8, 1, True, 20)
print(f"first of torsion, exact / self-weight      {twisting:.1f}  {twists:.1f}")
as_recorded = (
    all(abs(value / bending - 1) < 1e-3 for members in (8, 16) for value in seen[True, members])
    and seen[False, 16][0] < 0.75 * seen[False, 8][0] < 0.4 * bending
    and seen[False, 16][1] > 1.2 * seen[False, 8][1] > 2 * bending
    and twists > 5 * twisting
)
if not as_recorded:
    raise SystemExit("changed: not as recorded")
E
v/bin/python see.py

#!/bin/sh
# Guess: in FramAT, a load with "local_sys": True acts along the axes of the beam, as pressure on a curved strip or wind
#   on a column does. The key is part of its description of loads, and checked: {"local_sys": 1} raises TypeError.
# Version: framat 0.5, model-framework 0.0.20, commonlibs 0.6.3, numpy 2.4.6, scipy 1.17.1.
# Behaviour: the key has no effect. For a point load it is dropped on the way to the element, for a distributed one
#   handed on; the element looks for "loc_system", which nothing sets. All loads act along the global axes: a load
#   across a column presses it along its axis. Besides, the end moments of a distributed load are taken as if the beam
#   ran along x: a load along a column bends it, by a third of what the load would do across it where the column is one
#   element, and less with more. There is no message.
# What to do: turn loads into global axes, for each element of a curved beam, and give them as point loads at nodes.
# Seen (cantilever in the x-y plane, load along its local y; deflection of the tip, in units of F L^3 / 3 E I and
#   q L^4 / 8 E I, along the beam and across it, where 0 and 1 are right):
#   angle to x    point load        distributed      the same, one element
#    0 degrees    0.0000   1.0000   0.0000   1.0000   0.0000   1.0000
#   60 degrees    0.0260   0.5000   0.0346   0.4974   0.0346   0.3333
#   90 degrees    0.0300   0.0000   0.0400   0.0052   0.0400   0.3333
set -eu
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
cd "$dir"
python3 -m venv v
v/bin/pip -qq install numpy==2.4.6 scipy==1.17.1 framat==0.5 model-framework==0.0.20 commonlibs==0.6.3
cat > see.py <<'E'
import logging

import numpy as np
from framat import Model

logging.disable(logging.INFO)
E, AREA, SECOND = 1e9, 1.0, 1e-2


def tip(degrees, kind, elements=8, local=True):
    """Deflection of the tip of a cantilever of length 1, along it and across it."""
    along = np.array([np.cos(np.radians(degrees)), np.sin(np.radians(degrees)), 0])
    model = Model()
    material = model.add_feature("material", uid="steel")
    for key, value in {"E": E, "G": 4e8, "rho": 1.0}.items():
        material.set(key, value)
    section = model.add_feature("cross_section", uid="strip")
    for key, value in {"A": AREA, "Iy": SECOND, "Iz": SECOND, "J": SECOND}.items():
        section.set(key, value)
    beam = model.add_feature("beam")
    beam.add("node", [0.0, 0.0, 0.0], uid="root")
    beam.add("node", [float(value) for value in along], uid="tip")
    beam.set("nelem", elements)
    span = {"from": "root", "to": "tip"}
    beam.add("material", span | {"uid": "steel"})
    beam.add("cross_section", span | {"uid": "strip"})
    beam.add("orientation", span | {"up": [0, 0, 1]})
    load = {"load": [0, 1, 0, 0, 0, 0], "local_sys": local}
    beam.add(kind, load | ({"at": "tip"} if kind == "point_load" else span))
    model.set_feature("bc").add("fix", {"node": "root", "fix": ["all"]})
    model.set_feature("post_proc")
    model.run()
    moved = np.ravel(model.results.get("tensors").get("U"))[-6:-3]
    unit = 1 / (3 if kind == "point_load" else 8) / (E * SECOND)
    return np.array([moved @ along, moved @ np.cross([0, 0, 1], along)]) / unit


print("angle to x    point load        distributed      the same, one element")
seen, without = {}, {}
cases = (("point_load", 8), ("distr_load", 8), ("distr_load", 1))
for degrees in (0, 60, 90):
    seen[degrees] = np.array([tip(degrees, *case) for case in cases])
    without[degrees] = np.array([tip(degrees, *case, local=False) for case in cases])
    print(f"{degrees:2d} degrees    " + "   ".join(f"{value:.4f}" for value in abs(seen[degrees]).ravel()))
as_recorded = (
    np.allclose(seen[0], [[0, 1]] * 3)
    and np.allclose(seen[60][0, 1], 0.5)
    and np.allclose(seen[90][:2, 1], 0, atol=0.01)
    and abs(seen[90][2, 1]) > 0.3
    and all(np.allclose(seen[degrees], without[degrees]) for degrees in seen)
)
if not as_recorded:
    raise SystemExit("changed: not as recorded")
E
v/bin/python see.py

#!/bin/sh
# Guess: rowan.to_euler gives angles from which from_euler makes the same rotation, but for rounding; only at the pole
#   itself, where two of the angles turn about one axis, is there a choice. The docstring says: "in cases where
#   gimbal lock arises, to_euler adopts the convention that gamma = 0".
# Version: rowan 1.3.2, numpy 2.4.6, scipy 1.17.1.
# Behaviour: the choice is made wherever the sine, or cosine, of the middle angle is below 0.001. The tilt that is left
#   keeps its size and loses its direction: the rotation is off by up to twice the tilt, 0.1 degrees. Frames of a
#   nearly straight rod come back bent elsewhere. There is no message.
# What to do: scipy's Rotation.as_euler, or keep quaternions.
# Seen (frames tilted in all directions; the largest rotation between a frame and the one made of its angles):
#   tilt     zxz, rowan  zxz, scipy  zyx, rowan  zyx, scipy
#   0.002    under 1e-7  under 1e-7  under 1e-7  under 1e-7
#   0.0009       0.0018  under 1e-7      0.0018  under 1e-7
#   0.0001       0.0002  under 1e-7      0.0002  under 1e-7
#   1e-06         2e-06  under 1e-7       2e-06  under 1e-7
set -eu
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
cd "$dir"
python3 -m venv v
v/bin/pip -qq install numpy==2.4.6 scipy==1.17.1 rowan==1.3.2
cat > see.py <<'E'
import warnings

import numpy as np
import rowan
from scipy.spatial.transform import Rotation


def off(frames, again):
    return float((again * frames.inv()).magnitude().max())


warnings.simplefilter("ignore")  # scipy says so when it meets the pole
turn = np.linspace(0, 2 * np.pi, 25)
print("tilt     zxz, rowan  zxz, scipy  zyx, rowan  zyx, scipy")
seen = []
for tilt in (2e-3, 9e-4, 1e-4, 1e-6):
    row = []
    for names, middle in (("ZXZ", tilt), ("ZYX", np.pi / 2 - tilt)):
        frames = Rotation.from_euler(names, np.c_[0 * turn + 0.3, 0 * turn + middle, turn])
        angles = rowan.to_euler(frames.as_quat(scalar_first=True), names.lower(), "intrinsic")
        again = Rotation.from_quat(rowan.from_euler(*angles.T, names.lower(), "intrinsic"), scalar_first=True)
        row += [off(frames, again), off(frames, Rotation.from_euler(names, frames.as_euler(names)))]
    print(f"{tilt:<7g}" + "".join(f"  {'under 1e-7' if value < 1e-7 else format(value, '10.2g')}" for value in row))
    seen.append([value > 1.9 * tilt for value in row])
if seen != [[False] * 4] + [[True, False, True, False]] * 3:
    raise SystemExit("changed: not as recorded")
E
v/bin/python see.py

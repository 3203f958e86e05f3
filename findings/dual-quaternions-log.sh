#!/bin/sh
# Guess: in dual_quaternions, exp(log(q)) is q, as for the frames of a strip one would mean or interpolate through log;
#   exp(w/2) twice is exp(w); and (a / b) * b is a. The README of the package has log lead from SE(3) to its Lie
#   algebra, and exp back.
# Version: dual_quaternions 0.4.0, pyquaternion 0.9.9, numpy 2.4.6, scipy 1.17.1.
# Behaviour: rotations are right; translations are not. The log of a translation is 0, and so is the dual part for a
#   screw along an axis through the origin. Otherwise the translation along the axis is lost, and that across it is
#   turned and scaled. exp moves by twice the dual part, as if rotation and translation were independent: exp(w/2)
#   twice is another motion than exp(w). a / b divides the dual part as if factors could be exchanged. exp(log(q)) is
#   a unit dual quaternion, so that a check of the norm finds nothing. pow(), sclerp() and inverse() are right.
# What to do: screw(), pow() and sclerp(); a * b.inverse(); logm and expm of scipy with homogeneous_matrix().
# Seen (translations of motions that turn by an angle about z and move by a vector):
#   motion                 exp(log(q))              expm(logm(q))
#   0.0, (1, 2, 3)          0.000  0.000  0.000      1.000  2.000  3.000
#   0.8, (0, 0, 3)          0.000  0.000  0.000      0.000  0.000  3.000
#   0.8, (1, 2, 3)         -0.566  0.662  0.000      1.000  2.000  3.000
#   exp(w)                  1.000  0.000  0.000
#   exp(w/2) twice          0.961  0.195  0.000
#   a                       1.000  2.000  3.000
#   (a / b) * b             1.673  0.531  2.850
#   a * b.inverse() * b     1.000  2.000  3.000
set -eu
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
cd "$dir"
python3 -m venv v
v/bin/pip -qq install numpy==2.4.6 scipy==1.17.1 pyquaternion==0.9.9 dual_quaternions==0.4.0
cat > see.py <<'E'
import numpy as np
from dual_quaternions import DualQuaternion
from pyquaternion import Quaternion
from scipy.linalg import expm, logm


def motion(axis, angle, translation):
    turn = Quaternion(axis=axis, angle=angle)
    return DualQuaternion.from_quat_pose_array([*turn.elements, *translation])


def text(translation):
    return " ".join(f"{value + 0.0:6.3f}" for value in np.round(np.array(translation, float), 3))


print("motion                exp(log(q))              expm(logm(q))")
seen = []
for angle, move in ((0.0, (1, 2, 3)), (0.8, (0, 0, 3)), (0.8, (1, 2, 3))):
    q = motion([0, 0, 1], angle, move)
    back = q.log().exp()
    right = expm(logm(q.homogeneous_matrix()))
    print(f"{angle}, {str(move):16s}  {text(back.translation())}     {text(right[:3, 3].real)}")
    assert np.allclose(right, q.homogeneous_matrix()) and back.is_normalized
    seen.append((back.q_r == q.q_r, *(round(float(value), 3) + 0.0 for value in back.translation())))
whole = DualQuaternion(Quaternion(0, 0, 0, 0.4), Quaternion(0, 0.5, 0, 0)).exp()
half = DualQuaternion(Quaternion(0, 0, 0, 0.2), Quaternion(0, 0.25, 0, 0)).exp()
print(f"exp(w)                {text(whole.translation())}\nexp(w/2) twice        {text((half * half).translation())}")
a, b = motion([0, 0, 1], 0.8, (1, 2, 3)), motion([1, 0, 0], 0.5, (0, 1, 0))
quotient, right = (a / b) * b, a * b.inverse() * b
for name, q in (("a", a), ("(a / b) * b", quotient), ("a * b.inverse() * b", right)):
    print(f"{name:22s}{text(q.translation())}")
as_recorded = (
    seen == [(True, 0, 0, 0), (True, 0, 0, 0), (True, -0.566, 0.662, 0)]
    and (half * half).q_r == whole.q_r
    and abs(np.array((half * half).translation()) - whole.translation()).max() > 0.1
    and abs(np.array(quotient.translation()) - a.translation()).max() > 0.1
    and np.allclose(np.array(right.translation(), float), a.translation())
    and np.allclose(np.array((a.pow(0.5) * a.pow(0.5)).translation(), float), a.translation())
)
if not as_recorded:
    raise SystemExit("changed: not as recorded")
E
v/bin/python see.py

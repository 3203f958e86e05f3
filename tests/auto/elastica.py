"""Folds and branch points of the planar elastica between clamps, by AUTO-07p; prints them as JSON.

Run by the Python of an environment of its own, which has AUTO by way of bifpy: see `make test-auto`.
For unit length and stiffness the boundary-value problem is

    theta' = kappa, kappa' = n_x sin theta - n_y cos theta, x' = cos theta, y' = sin theta, e' = kappa^2/2,
    theta = x = y = e = 0 at the start, theta = tilt, x = span, y = lift at the end:

five equations with seven conditions, so that one place (span, lift or tilt) moves together with n_x and n_y.
Forces are in units of 100, so that they do not dominate AUTO's arclength.
"""

from __future__ import annotations

import json
import math
import sys

from bifpy import auto
from scipy.optimize import brentq
from scipy.special import ellipe, ellipeinc, ellipj, ellipk

SPAN, TILT, FORCE_X, FORCE_Y, LIFT = range(1, 6)
NAMES = {SPAN: "span", TILT: "tilt", LIFT: "lift"}
FORCE_UNIT = 100.0
# `epss` is how near to a point sought a secant method has to come along the branch. Near folds and branch
# points AUTO's Newton steps do not converge well enough for the smaller value.
AT_VALUES = {"epsl": 1e-9, "epsu": 1e-9, "epss": 1e-8}
AT_FOLDS = {"epsl": 1e-9, "epsu": 1e-9, "epss": 1e-6}
AT_BRANCH_POINTS = {"epsl": 1e-8, "epsu": 1e-8, "epss": 1e-4, "dsmax": 0.1}
SETTINGS = {
    "ips": auto.IPS_GENERAL_BVP,
    **{"ndim": 5, "npar": 5, "nbc": 7, "nint": 0, "nmx": 100, "ntst": 40, "ncol": 4, "iad": 3},
    **{"ilp": 1, "isp": 2, "mxbf": 0, "iads": 1, "itmx": 10, "itnw": 7, "nwtn": 3, "jac": 0},
    **{"ds": 0.02, "dsmin": 1e-4, "dsmax": 0.3, "rl0": -9.0, "rl1": 9.0, "a0": -1e300, "a1": 1e300},
    **{"iid": 2, "iplt": 0},
}


def rates(z, p):
    force_x, force_y = FORCE_UNIT * p[FORCE_X - 1], FORCE_UNIT * p[FORCE_Y - 1]
    turning = force_x * math.sin(z[0]) - force_y * math.cos(z[0])
    return [z[1], turning, math.cos(z[0]), math.sin(z[0]), 0.5 * z[1] ** 2]


def conditions(a, b, p):
    return [a[0], a[2], a[3], a[4], b[0] - p[TILT - 1], b[2] - p[SPAN - 1], b[3] - p[LIFT - 1]]


def buckled(span):
    """What AUTO starts from: the symmetric strip of some span, buckled to +y, in elliptic functions."""
    m = brentq(lambda m: 2 * ellipe(m) / ellipk(m) - 1 - span, 1e-9, 1 - 1e-9, xtol=1e-15)
    q, k = 4 * float(ellipk(m)), math.sqrt(m)

    def start(z, p, s):
        sn, cn, _, amplitude = (float(value) for value in ellipj(q * s, m))
        # int (1 - 2 m sn^2) = 2 E(am)/q - s, and int 2 m cn^2 q^2 = 2 q (E(am) - (1 - m) q s).
        second = float(ellipeinc(amplitude, m))
        z[0], z[1] = 2 * math.asin(k * sn), 2 * k * q * cn
        z[2], z[3], z[4] = 2 * second / q - s, 2 * k * (1 - cn) / q, 2 * q * (second - (1 - m) * q * s)
        p[SPAN - 1], p[TILT - 1], p[LIFT - 1] = span, 0.0, 0.0
        p[FORCE_X - 1], p[FORCE_Y - 1] = -q * q / FORCE_UNIT, 0.0

    return start


def follow(origin, moving, settings, **more):
    """Move one place, from a point or from the buckled strip of some span."""
    given = {"icu": [moving, FORCE_X, FORCE_Y], "bcnd": conditions, **more}
    if isinstance(origin, float):
        return auto.run(rates, buckled(origin), SETTINGS | settings, **given)
    return auto.restart(rates, SETTINGS | settings, restart_point=origin, **{"isw": 1, **given})


def one(found, kind):
    """The first point of a kind."""
    for branch in found.branches:
        for point in branch.points:
            if point.point_type is kind:
                return point
    sys.exit(f"AUTO found no {kind.name}")


def described(point):
    """What is compared: places, forces, energy and the end's moment."""
    values = point.all_parameters
    last = point.boundary_value_solution.state[-1]
    return {
        **{name: values[k - 1] for k, name in NAMES.items()},
        "force": [FORCE_UNIT * values[FORCE_X - 1], FORCE_UNIT * values[FORCE_Y - 1]],
        "energy": last[4],
        "moment": last[1],
    }


def main():
    """Both folds in the tilt, at lift 0 and 0.3, and both branch points in the span."""
    raised = follow(0.75, LIFT, AT_VALUES, uzstop={LIFT: [0.3]})
    lifted = one(raised, auto.PointType.USER_SPECIFIED_VALUE)
    points = {"lifted": lifted}
    for name, point in (("fold", 0.75), ("fold, lifted", lifted)):
        points[name] = one(follow(point, TILT, AT_FOLDS), auto.PointType.FOLD)
    upward = follow(lifted, SPAN, {**AT_BRANCH_POINTS, "rl1": 0.95})
    points["branch point, lifted"] = one(upward, auto.PointType.BRANCH_POINT)
    down = follow(0.2, SPAN, {**AT_BRANCH_POINTS, "ds": -0.02, "rl0": -0.05})
    points["branch point"] = one(down, auto.PointType.BRANCH_POINT)
    # The branch that crosses the one followed upward: strips with the half turn's symmetry.
    crossing = follow(
        points["branch point, lifted"],
        SPAN,
        {**AT_VALUES, "ds": -0.02, "dsmax": 0.1},
        isw=-1,
        uzstop={SPAN: [0.8]},
    )
    points["symmetric, lifted"] = one(crossing, auto.PointType.USER_SPECIFIED_VALUE)
    json.dump({name: described(point) for name, point in points.items()}, sys.stdout, indent=1)


if __name__ == "__main__":
    main()

"""docs/errata.md: the corrected formulas by symbolic identities; tests/test_errata.py has computed bands.

Frames: t = d', n = g x t, b = t x n with g = eta t + b, g' = eta' t and tau = kappa eta, (1.26)-(1.32).
"""

from __future__ import annotations

import pytest
import sympy as sp
from sympy import Matrix, cosh, tanh

pytestmark = pytest.mark.peers

s, b, h, kappa, eta, slope, xi = sp.symbols("s b h kappa eta eta' xi", positive=True)
gamma = Matrix(sp.symbols("gamma:3"))
lam = [sp.Function(f"lambda_{k}")(s) for k in range(6)]  # lambda_0 is not used
U, V, G, H = (Matrix(sp.symbols(f"{name}:3", real=True)) for name in "uvgp")  # d', d'', g, g'
F = sp.Function("F")


def along(name: str) -> Matrix:
    """A vector field along the midline."""
    return Matrix([sp.Function(f"{name}{k}")(s) for k in range(3)])


def gradient(expression: sp.Expr, variables: Matrix) -> Matrix:
    return Matrix([sp.diff(expression, v) for v in variables])


def is_zero(expression: sp.Expr | Matrix) -> bool:
    return all(sp.expand(sp.simplify(entry)) == 0 for entry in Matrix([expression]))


ZETA = b / 2 * V.dot(V) * G.dot(G) ** 2 * F(xi)  # (1.60)
LAGRANGIAN = (  # the integrand of (1.58)
    ZETA
    - lam[1] * (U.dot(U) - 1)
    - lam[2] * (G.dot(G) - U.dot(G) ** 2 - 1)
    - lam[3] * V.dot(G)
    - lam[4] * U.cross(G).dot(H)
    - lam[5] * (b * U.dot(H) - tanh(xi))
    - gamma.dot(U)
)


def on_fields(expression: sp.Expr | Matrix) -> sp.Expr | Matrix:
    """Put fields along the midline in place of the independent symbols."""
    u, g = along("u"), along("g")
    values = [*zip(U, u, strict=True), *zip(G, g, strict=True)]
    values += [*zip(V, u.diff(s), strict=True), *zip(H, g.diff(s), strict=True)]
    return expression.subs(values)


# --- chapter 1 ---


def test_derivative_of_tanh() -> None:
    """(1.63), (1.70): no factor xi."""
    assert is_zero(sp.diff(tanh(xi), xi) - 1 / cosh(xi) ** 2)
    stationarity = sp.diff(LAGRANGIAN, xi)
    assert is_zero(stationarity - sp.diff(ZETA, xi) - lam[5] / cosh(xi) ** 2)


def test_factor_b_of_the_energy_density() -> None:
    """(1.53)-(1.54): H^2 da integrated over a ruling, by its derivative in b and its value at b = 0."""
    beta = sp.Symbol("beta")
    curvature = kappa * (1 + eta**2) / (2 * (1 + beta * slope))  # (1.46)
    across = sp.expand_log(sp.log((1 + b * slope) / (1 - b * slope)), force=True)
    density = kappa**2 * (1 + eta**2) ** 2 / (4 * slope) * across
    integrand = curvature**2 * (1 + beta * slope)
    assert is_zero(sp.diff(density, b) - integrand.subs(beta, b) - integrand.subs(beta, -b))
    assert density.subs(b, 0) == 0
    # With b eta' = tanh xi, log((1 + tanh xi) / (1 - tanh xi)) is 2 xi:
    assert is_zero(sp.diff(sp.log((1 + tanh(xi)) / (1 - tanh(xi))), xi) - 2)
    corrected = b / 2 * kappa**2 * (1 + eta**2) ** 2 * xi / tanh(xi)
    printed = kappa**2 * (1 + eta**2) ** 2 / (4 * tanh(xi)) * 2 * xi  # (1.53): 1/(b eta') without b before it
    assert is_zero(kappa**2 * (1 + eta**2) ** 2 / (4 * tanh(xi) / b) * 2 * xi - corrected)
    assert is_zero(b * printed - corrected)


def test_variation_of_the_lambda_4_term() -> None:
    """(1.59): the triple product's variation has g x g', g' x d' and d' x g, all with the same sign."""
    small = sp.Symbol("epsilon")
    du, dg, dp = (Matrix(sp.symbols(f"{name}:3")) for name in ("du", "dg", "dp"))
    moved = (U + small * du).cross(G + small * dg).dot(H + small * dp)
    variation = sp.diff(moved, small).subs(small, 0)
    assert is_zero(variation - G.cross(H).dot(du) - H.cross(U).dot(dg) - U.cross(G).dot(dp))
    assert not is_zero(variation - G.cross(H).dot(du) - H.cross(U).dot(dg) + U.cross(G).dot(dp))


def test_equilibrium_along_the_directrix_and_lambda_1() -> None:
    """(1.61) integrated once with gamma; (1.65), (1.78) follow from it."""
    momentum = on_fields(gradient(LAGRANGIAN, V))  # zeta_d'' - lambda_3 g
    force = on_fields(gradient(LAGRANGIAN, U))
    u, g = along("u"), along("g")
    stationarity = force - momentum.diff(s)
    eta_ = u.dot(g)
    bracket = (  # what (1.61) differentiates
        momentum.diff(s)
        + 2 * lam[1] * u
        - 2 * lam[2] * eta_ * g
        + lam[4] * g.cross(g.diff(s))
        + b * lam[5] * g.diff(s)
    )
    assert is_zero(sp.expand(stationarity + bracket + gamma))
    formula = (
        -momentum.diff(s).dot(u) + 2 * lam[2] * eta_**2 - b * lam[5] * u.dot(g.diff(s)) - gamma.dot(u)
    ) / 2
    constraints = -2 * lam[1] * (u.dot(u) - 1) - lam[4] * g.cross(g.diff(s)).dot(u)
    assert is_zero(sp.expand(stationarity.dot(u) - 2 * (formula - lam[1]) - constraints))
    twisting = 2 * lam[2] * eta_ * g
    others = 2 * lam[1] * u + lam[4] * g.cross(g.diff(s)) + b * lam[5] * g.diff(s)
    assert is_zero(sp.expand(momentum.diff(s) - twisting + others - bracket))
    printed = momentum.diff(s) - twisting - others  # (1.65)
    assert not is_zero(sp.expand(printed - bracket))
    assert not is_zero(sp.expand(printed + bracket))


def test_matching_condition_of_the_rulings() -> None:
    """(1.66): the boundary term beside delta g is dL/dg', not what is printed."""
    assert is_zero(gradient(LAGRANGIAN, H) + lam[4] * U.cross(G) + b * lam[5] * U)


def test_lambda_2_to_lambda_5_in_the_darboux_frame() -> None:
    """(1.72)-(1.77) without the factor xi, by components of (1.62) along t, n, b."""
    k, e = sp.Function("kappa")(s), sp.Function("eta")(s)
    stiff = 2 * b * k**2 * (1 + e**2) * F(xi)  # zeta_g = stiff g
    t, n, normal = Matrix([1, 0, 0]), Matrix([0, 1, 0]), Matrix([0, 0, 1])
    turn = Matrix([[0, -k, 0], [k, 0, -k * e], [0, k * e, 0]])  # (1.26)-(1.28) with tau = kappa eta

    def derivative(v: Matrix) -> Matrix:
        return v.diff(s) + turn * v

    g = e * t + normal
    assert is_zero(derivative(g) - e.diff(s) * t)
    rest = stiff * g - 2 * lam[2] * (g - e * t) - lam[3] * k * n
    equation = derivative(lam[4] * t.cross(g) + b * lam[5] * t) + rest
    four = -(b * lam[5].diff(s) + stiff * e) / k
    two = (stiff * (1 + e**2) + b * lam[5].diff(s) * e) / 2
    three = b * lam[5] - lam[4].diff(s) / k
    assert sp.expand(equation[0].subs(lam[4], four)) == 0
    assert sp.expand((equation[2].subs(lam[4], four)).subs(lam[2], two)) == 0
    assert sp.expand(equation[1].subs(lam[3], three)) == 0
    # (1.78) in this frame: zeta_d'' = b kappa |g|^4 F n.
    pull = derivative(b * k * (1 + e**2) ** 2 * F(xi) * n - lam[3] * g)
    assert is_zero(-pull[0] - b * k**2 * (1 + e**2) ** 2 * F(xi) - (lam[3] * e).diff(s))


def test_formulas_fulfil_equilibrium_identically_and_gamma_is_what_is_left() -> None:
    """(1.70)-(1.78) as functions of kappa, eta and xi: (1.62), and (1.61) along t, vanish for any shape."""
    k, e, x = (sp.Function(name)(s) for name in ("kappa", "eta", "xi"))
    size, f, f1 = 1 + e**2, F(x), sp.diff(F(xi), xi).subs(xi, x)
    stiff, moment = 2 * b * k**2 * size * f, b * k * size**2 * f
    five = -b / 2 * k**2 * size**2 * f1 * cosh(x) ** 2
    four = -(b * five.diff(s) + stiff * e) / k
    three = b * five - four.diff(s) / k
    two = (stiff * size + b * five.diff(s) * e) / 2
    t, n, normal = Matrix([1, 0, 0]), Matrix([0, 1, 0]), Matrix([0, 0, 1])
    turn = Matrix([[0, -k, 0], [k, 0, -k * e], [0, k * e, 0]])

    def derivative(v: Matrix) -> Matrix:
        return v.diff(s) + turn * v

    g = e * t + normal
    rulings = derivative(four * t.cross(g) + b * five * t) + stiff * g
    rulings -= 2 * two * (g - e * t) + three * k * n
    assert all(sp.expand(entry) == 0 for entry in rulings)
    pull = -gamma[0]  # (1.78), gamma in the frame (t, n, e)
    one = (moment * k + (three * e).diff(s) + 2 * two * e**2 - b * five * e.diff(s) + pull) / 2
    slope = e.diff(s)
    bracket = derivative(moment * n - three * g) + 2 * one * t - 2 * two * e * g
    bracket += four * g.cross(slope * t) + b * five * slope * t
    assert sp.expand(bracket[0] + gamma[0]) == 0
    assert sp.expand(bracket[1] - (moment.diff(s) + four * slope)) == 0  # -gamma.n
    assert sp.expand(bracket[2] - (moment * k * e - three.diff(s) - 2 * two * e)) == 0  # -gamma.e


def test_lambda_5_is_conjugate_to_the_slope_of_eta() -> None:
    """(1.63) eliminates xi: -b lambda_5 is the derivative of Wunderlich's density (1.48) in eta'."""
    rise = sp.Symbol("x", positive=True)
    density = b / 2 * kappa**2 * (1 + eta**2) ** 2 * sp.atanh(rise) / rise  # rise = b eta'
    factor = sp.diff(xi / tanh(xi), xi)
    five = -b / 2 * kappa**2 * (1 + eta**2) ** 2 * factor * cosh(xi) ** 2
    conjugate = b * sp.diff(density, rise)  # b d/d(b eta')
    difference = (conjugate + b * five.subs(xi, sp.atanh(rise))).subs(
        {b: 2, kappa: 3, eta: sp.Rational(1, 2)}
    )
    for value in (sp.Rational(1, 7), sp.Rational(1, 2), sp.Rational(9, 10)):
        assert abs(sp.N(difference.subs(rise, value), 30)) < 1e-25


def test_how_fast_rulings_meet_at_an_inflection() -> None:
    """1 - (b eta')^2 = sech^2 xi = m^2 F' / (2 b |g|^4 F^2 (-lambda_5)), with F ~ xi and F' ~ 1."""
    size, factor, rate = sp.symbols("size F F1", positive=True)
    moment = b * kappa * size**2 * factor
    five = -b / 2 * kappa**2 * size**2 * rate * cosh(xi) ** 2
    sech = moment**2 * rate / (2 * b * size**2 * factor**2 * -five)
    assert is_zero(sech - 1 / cosh(xi) ** 2)
    large = xi / tanh(xi)
    assert sp.limit(large / xi, xi, sp.oo) == 1
    assert sp.limit(sp.diff(large, xi), xi, sp.oo) == 1


# --- chapters 2 and 3 ---


def test_factor_two_of_q() -> None:
    """(2.13)-(2.16): with Q_h = sum q rho^4 a / h the first term of q is half of |u_i - u_{i-1}|^2."""
    on_sphere = {V[2] ** 2: 1 - V[0] ** 2 - V[1] ** 2, U[2] ** 2: 1 - U[0] ** 2 - U[1] ** 2}
    jump = (U - V).dot(U - V)
    assert sp.expand(sp.expand(jump - 2 * (1 - U.dot(V))).subs(on_sphere)) == 0
    density = b / 2 * jump / h**2 * h  # b/2 |d''|^2 over one step, with |g| = F = 1
    assert is_zero(density - b * (jump / 2) / h)


def test_the_other_form_of_q_has_no_lower_bound() -> None:
    size = sp.Symbol("t", positive=True)
    assert sp.limit(1 - (size * U).dot(size * U).subs({U[0]: 1, U[1]: 0, U[2]: 0}), size, sp.oo) == -sp.oo


def test_normalisation_of_lambda_1() -> None:
    """(2.47) against (1.58): |u| - 1 has half the gradient of |u|^2 - 1."""
    one = gradient(sp.sqrt(U.dot(U)) - 1, U)
    two = gradient(U.dot(U) - 1, U)
    assert is_zero((two - 2 * one).subs({U[0]: sp.Rational(3, 5), U[1]: 0, U[2]: sp.Rational(4, 5)}))


def test_a_unit_ruling_makes_its_constraint_degenerate() -> None:
    """|g|^2 = (g.u)^2 + 1 with a prescribed unit g: zero value and zero gradient in u together."""
    value = G.dot(G) - G.dot(U) ** 2 - 1
    at = {G[0]: 0, G[1]: 0, G[2]: 1}
    assert is_zero(value.subs(at) + U[2] ** 2)
    assert is_zero(gradient(value, U).subs(at).subs(U[2], 0))
    assert not is_zero(gradient(G.dot(U), U).subs(at).subs(U[2], 0))


def test_the_printed_signed_curvature_vanishes() -> None:
    """(3.1) with g' : zero, since g' is parallel to d'."""
    assert is_zero(V.dot((slope * U).cross(U)))

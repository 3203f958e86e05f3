"""Stored states against the continuum: what `ribbon verify --continuum` measures."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ..errors import UsageError
from ..model.band import Array, Multipliers, State
from ..model.equilibrium import Equilibrium, EquilibriumResiduals, moved_seam, seam_conditions
from ..model.geometry import geometry
from ..model.multiplier_theory import MultiplierCurve, fields_of, theoretical_multipliers
from ..model.multiplier_theory import multiplier_curves as _curves
from ..model.reconstruction import Reconstruction
from ..model.splines import BandSpline
from ..model.staggered import at_least, distance_to, facets, far_half, inflections, nodes
from ..report.continuum import Continuum, Quantity
from ..store import Run, StateRecord
from ..study.records import multipliers_of, state_of
from .energies import table_entries

BETWEEN = 8
"""Points a facet at which fields are looked at between nodes and middles of facets."""
NEAR = 1 / 16
"""The inner zone leaves out what is nearer to an inflection than this part of the length."""
FEWEST = 12
"""Fewest segments: the one-sided polynomials at the seam need five values on either side."""

CONSTRAINTS, ENERGY, MULTIPLIERS = "constraints", "energy", "multipliers less their formulas"
BALANCE, ELIMINATED, SEAM = "Euler-Lagrange equations", "the same, xi eliminated", "mismatch at the seam"
LIMITS = "multipliers as they are"

_CONSTRAINTS = {
    "ruling": ("|g|^2 - (g.d')^2 - 1", "(2.38)", nodes, 0),
    "fold": ("d''.g", "(2.39)", nodes, 1),
    "flat": ("(d' x g).g'", "(2.40)", facets, 1),
    "slope": ("b d'.g' - tanh xi", "(2.41)", facets, 1),
}
"""Name, equation, places of second order, and how often 1/h multiplies the solver's tolerance."""
_FORMULAS = {
    "lambda_1": ("(1.78)", 4),
    "lambda_2": ("(1.75)", 2),
    "lambda_3": ("(1.77)", 3),
    "lambda_4": ("(1.76)", 2),
    "lambda_5": ("(1.70)", 1),
    "gamma": ("(1.61)", 4),
}
"""Equation of each formula, and how many differences along the band it takes of u."""
EPSILON = float(np.finfo(np.float64).eps)
_BALANCE = {
    "force": ("(1.61) integrated", "(1.61)", 2),
    "balance": ("(1.61)", "(1.61)", 3),
    "moment": ("(1.62)", "(1.62)", 2),
    "slope": ("(1.63)", "(1.63)", 1),
}
"""Name, equation, and how often 1/h multiplies the solver's tolerance."""


def continuum_of(record: StateRecord, name: str = "") -> Continuum:
    """Measure how far a stored state is from the continuum; `name` is what messages call it.

    Raises UsageError for a state with an open seam or prescribed rulings, which is no equilibrium of the free
    band, and for fewer than FEWEST segments.
    """
    name = name or f"state {record.label}"
    _check_free(record, name)
    if record.segments < FEWEST:
        raise UsageError(f"{name}: has {record.segments} segments; --continuum needs at least {FEWEST}")
    state = state_of(record)
    measure = _Measure(
        state, _multipliers(record), max(record.kkt_residual, record.constraint_residual, 1e-15)
    )
    return Continuum(
        label=record.label,
        half_width=record.half_width,
        length=record.length,
        sigma=record.sigma,
        segments=record.segments,
        discretisation=record.discretisation,
        certified=record.certified,
        inflections=tuple(measure.inflections.tolist()),
        quantities=tuple(measure.quantities(record.energy)),
    )


def continuum_of_run(run: Run) -> list[Continuum]:
    """The same for a run: for each width and N the state that its convergence table shows."""
    labels = [int(entry.label) for entry in table_entries(run) if entry.label is not None]
    return [continuum_of(run.load(label), f"{run.short_name}:{label}") for label in labels]


def multiplier_curves(record: StateRecord) -> tuple[MultiplierCurve, ...]:
    """lambda_1..lambda_5 of a stored state beside their explicit formulas, for plots.

    Each curve has arrays (N,) `alpha`, `computed`, `theory`, `distance` and `far`; see
    `ribbon_cli.model.multiplier_theory.MultiplierCurve`. Raises UsageError for an auxiliary state.
    """
    _check_free(record, f"state {record.label}")
    return _curves(state_of(record), _multipliers(record))


def equilibrium_residuals(
    record: StateRecord, alpha: Array, *, eliminate_xi: bool = False
) -> EquilibriumResiduals:
    """Residuals of (1.61)-(1.63) for a stored state at arclengths alpha (n,), as functions for plots.

    See `ribbon_cli.model.equilibrium.EquilibriumResiduals`. Raises UsageError for an auxiliary state, and
    ValueError where xi is to be eliminated and rulings of the reconstructed surface meet.
    """
    _check_free(record, f"state {record.label}")
    return Equilibrium(state_of(record), _multipliers(record), eliminate_xi=eliminate_xi).residuals(alpha)


def _multipliers(record: StateRecord) -> Multipliers:
    return Multipliers.from_vector(state_of(record).band, multipliers_of(record))


def _check_free(record: StateRecord, name: str) -> None:
    """Raise UsageError for a strip with ends, an open seam, prescribed rulings or contacts that push, or one
    that went wrong.
    """
    if record.parts.ends is not None:
        raise UsageError(f"{name}: a strip with ends: the continuum's equations are those of closed bands")
    if not all(
        np.isfinite(values).all() for values in (record.u, record.g, record.xi, multipliers_of(record))
    ):
        raise UsageError(f"{name}: holds values that are not finite ({record.status}): there is no shape")
    if record.contacts is not None and len(record.contacts):
        held = f"{name}: rests on itself with {len(record.contacts)} contacts"
        raise UsageError(f"{held}: the continuum's equations here are those without contact forces")
    if record.kind == "auxiliary":
        raise UsageError(f"{name}: auxiliary, with prescribed rulings: the continuum is that of free bands")


class _Measure:
    """One state's quantities; `tolerance` is the residual to which it solves its equations."""

    def __init__(self, state: State, multipliers: Multipliers, tolerance: float) -> None:
        self.state, self.multipliers, self.tolerance = state, multipliers, tolerance
        self.band = state.band
        self.inflections = inflections(geometry(state).kappa_s, self.band.length, self.band.sigma)
        points = BETWEEN * self.band.segments
        self.between: Array = self.band.length / points * (np.arange(points, dtype=np.float64) + 0.5)

    def quantities(self, energy: float) -> Iterator[Quantity]:
        """All of them, section by section."""
        shape = Reconstruction(self.state)
        yield from self._constraints(shape)
        yield from self._energies(shape, energy)
        yield from self._multipliers()
        yield from self._limits()
        found = Equilibrium(self.state, self.multipliers).residuals(self.between)
        yield from self._balance(BALANCE, found)
        try:
            found = Equilibrium(self.state, self.multipliers, eliminate_xi=True).residuals(self.between)
        except ValueError:
            # Rulings of the interpolated surface meet: there is no xi to eliminate, hence no number.
            void = np.full((self.between.size, 3), np.nan)
            found = EquilibriumResiduals(void, void, void, void[:, 0])
        yield from self._balance(ELIMINATED, found)
        yield from self._seam()

    def _zones(self, alpha: Array) -> dict[str, NDArray[np.bool_]]:
        """Zones by name, from the farthest half of the band to all of it; without inflections all alone."""
        everywhere = np.ones(alpha.shape, dtype=bool)
        if not self.inflections.size:
            return {"all": everywhere}
        distance = distance_to(self.band, self.inflections, alpha)
        return {
            "far half": far_half(distance),
            f"s >= l/{round(1 / NEAR)}": at_least(distance, NEAR * self.band.length),
            "all": everywhere,
        }

    def _noise(self, divisions: int) -> float:
        return self.tolerance / self.band.h**divisions

    def _largest(
        self, section: str, name: str, equation: str, alpha: Array, values: Array, floor: float
    ) -> Iterator[Quantity]:
        """The largest size of a field, of numbers (n,) or vectors (n,3), in each zone."""
        size = np.linalg.norm(values.reshape(len(alpha), -1), axis=1)
        for zone, inside in self._zones(alpha).items():
            largest = float(size[inside].max()) if inside.any() else float("nan")
            yield Quantity(section, name, equation, zone, largest, floor)

    def _constraints(self, shape: Reconstruction) -> Iterator[Quantity]:
        everywhere = shape.constraints(self.between)
        name = "|d'|^2 - 1, between"
        yield from self._largest(
            CONSTRAINTS, name, "(1.34)", self.between, everywhere.tangent, self._noise(0)
        )
        for key, (name, equation, grid, divisions) in _CONSTRAINTS.items():
            alpha, where = grid(self.band), "nodes" if grid is nodes else "facets"
            floor, values = self._noise(divisions), getattr(shape.constraints(alpha), key)
            yield from self._largest(CONSTRAINTS, f"{name}, {where}", equation, alpha, values, floor)
            values = getattr(everywhere, key)
            yield from self._largest(CONSTRAINTS, f"{name}, between", equation, self.between, values, floor)
        closure = float(np.linalg.norm(shape.closure()))
        yield Quantity(CONSTRAINTS, "|d(l) - d(0)|", "(2.42)", "", closure, self._noise(0) * self.band.length)

    def _energies(self, shape: Reconstruction, energy: float) -> Iterator[Quantity]:
        alpha, weight = shape.quadrature()
        density = shape.density(alpha)
        total = float(weight @ density)
        yield Quantity(ENERGY, "Q of the surface", "(1.57)", "", total, 1e-12 * total, limit=True)
        yield Quantity(ENERGY, "Q - Q_h", "(2.46)", "", total - energy, 1e-13 * total)
        excess = shape.surface_density(alpha) - density
        for zone, inside in self._zones(alpha).items():
            value = float(weight[inside] @ excess[inside])
            yield Quantity(ENERGY, "int H^2 da - Q", "(1.40)", zone, value, 1e-13 * total)

    def _multipliers(self) -> Iterator[Quantity]:
        # Formulas take no multiplier in: what limits them is rounding, once more divided by h each.
        rounding = {name: EPSILON / self.band.h**divisions for name, (_, divisions) in _FORMULAS.items()}
        for curve in _curves(self.state, self.multipliers):
            name, equation, floor = curve.name, _FORMULAS[curve.name][0], rounding[curve.name]
            difference = curve.computed - curve.theory
            yield from self._largest(MULTIPLIERS, name, equation, curve.alpha, difference, floor)
            if name == "lambda_3":
                stored, name = self.multipliers.lambda_3 - curve.theory, "lambda_3 as stored"
                yield from self._largest(MULTIPLIERS, name, "(2.47)", curve.alpha, stored, floor)
        gamma = theoretical_multipliers(self.state).gamma
        force = float(np.linalg.norm(self.multipliers.gamma - gamma))
        yield Quantity(MULTIPLIERS, "gamma", _FORMULAS["gamma"][0], "", force, rounding["gamma"])

    def _limits(self) -> Iterator[Quantity]:
        """Sizes of the discrete multipliers where their formulas fail, at inflections, else everywhere."""
        found = fields_of(self.state, self.multipliers)
        sigma = self.band.sigma
        for name, offset, sign in (
            ("lambda_1", 0.5, 1),
            ("lambda_2", 0.0, 1),
            ("lambda_3", 0.0, sigma),
            ("lambda_4", 0.5, 1),
            ("lambda_5", 0.5, sigma),
        ):
            values, zone = getattr(found, name), "largest"
            if self.inflections.size:
                values, zone = BandSpline(self.band, values, offset, sign)(self.inflections), "inflection"
            size = float(np.abs(values).max())
            yield Quantity(LIMITS, f"|{name}|", "(1.58)", zone, size, self._noise(1), limit=True)
        force = float(np.linalg.norm(found.gamma))
        yield Quantity(LIMITS, "|gamma|", "(1.58)", "", force, self._noise(1), limit=True)

    def _balance(self, section: str, found: EquilibriumResiduals) -> Iterator[Quantity]:
        for key, (name, equation, divisions) in _BALANCE.items():
            if key == "slope" and section == ELIMINATED:
                continue
            floor, values = self._noise(divisions), getattr(found, key)
            yield from self._largest(section, name, equation, self.between, values, floor)

    def _seam(self) -> Iterator[Quantity]:
        """At the seam as stored, and with it moved to the nodes nearest to and farthest from inflections."""
        places = {"as stored": 0}
        if self.inflections.size:
            steps = distance_to(self.band, self.inflections, nodes(self.band)) / self.band.h
            # Rounded, so that of nodes that lie alike the first is taken whatever the last digits are.
            steps = np.round(steps, 6)
            places |= {"at inflection": int(np.argmin(steps)), "moved away": int(np.argmax(steps))}
        for zone, node in places.items():
            found = seam_conditions(*moved_seam(self.state, self.multipliers, node))
            yield self._gap("zeta_d'' - lambda_3 g", "(1.64)", zone, found.moment, 1)
            yield self._gap("(1.65) as corrected", "(1.65)", zone, found.force, 2)
            ends = max(found.start, found.finish, key=np.linalg.norm)
            yield self._gap("(1.65) plus gamma", "(1.61)", zone, ends, 2)
            yield self._gap("(1.66) as corrected", "(1.66)", zone, found.ruling, 1)
            if self.band.sigma < 0:
                yield self._gap("(1.66) without sigma", "(1.66)", zone, found.ruling_unsigned, 1)

    def _gap(self, name: str, equation: str, zone: str, mismatch: Array, divisions: int) -> Quantity:
        return Quantity(SEAM, name, equation, zone, float(np.linalg.norm(mismatch)), self._noise(divisions))

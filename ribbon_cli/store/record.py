"""What the store keeps of a state, as frozen values without a file.

Arrays are float64 and C-contiguous after construction. N is the number of facets. Multipliers are
normalised as lambda_i and gamma of Koldaev (2022), (1.58), with |u|^2 - 1. Everything is dimensionless
but `half_width` and `length`, which share one unit of length.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from ribbon_cli.facts import kinds_of
from ribbon_cli.parts import CLOSED, HALF_WIDTH, Parts
from ribbon_cli.store.contacts import Contacts
from ribbon_cli.store.layout import KINDS, REACTIONS

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

METRICS = ("euclidean", "physical")
"""Metrics in which a spectrum may be given."""

_UNKNOWNS = ("u", "g", "xi", "g_end")
_MULTIPLIERS = ("lambda_1", "lambda_2", "lambda_3", "lambda_4", "lambda_5", "gamma")
_GEOMETRY = ("midline", "kappa_s", "tau", "eta", "eta_prime")


def _to_float64(instance: object, names: tuple[str, ...]) -> None:
    """Replace the named fields of a frozen dataclass by contiguous float64 arrays."""
    import numpy as np

    for name in names:
        object.__setattr__(instance, name, np.ascontiguousarray(getattr(instance, name), dtype=np.float64))


@dataclass(frozen=True, eq=False, kw_only=True)
class SpectrumRecord:
    """Lowest k, or all, eigenpairs of the projected Hessian W_c, Koldaev (2022), (2.58), in one metric.

    `values` (k,) ascend; `residuals` (k,) are their residual norms; `labels` (k,) name the modes
    (`rotation`, `sliding`, ...); `sliding_overlap` (k,) lies in [0, 1]; `vectors` (m, N, 7) with m <= k
    hold the lowest m modes as (u, g, xi) per node, or None. Raises ValueError for an unknown metric.
    """

    metric: str
    complete: bool
    values: Array
    residuals: Array
    labels: tuple[str, ...]
    sliding_overlap: Array
    vectors: Array | None = None

    def __post_init__(self) -> None:
        if self.metric not in METRICS:
            raise ValueError(f"metric must be one of {', '.join(METRICS)}, got {self.metric!r}")
        _to_float64(self, ("values", "residuals", "sliding_overlap"))
        if self.vectors is not None:
            _to_float64(self, ("vectors",))
        object.__setattr__(self, "labels", tuple(str(label) for label in self.labels))


POINT_TYPES = ("step", "width", "value", "fold", "branch-point", "contact", "touch", "lift")
"""Types of a point on a branch."""


@dataclass(frozen=True, eq=False, kw_only=True)
class BranchRecord:
    """What a state is on its branch, a curve of stationary points with b, or a `parameter`, as an unknown.

    `tangent` (N, 7) in (u, g, xi) and `half_width_rate`, the parameter's, make the unit tangent; lengths are
    those of arclength continuation. layout.py explains `index_before`, `index_after`, `soft_mode` (N, 7) and
    `sliding_overlap`. Raises ValueError for an unknown type.
    """

    name: str
    type: str
    arclength: float
    half_width_rate: float
    next_step: float
    tangent: Array
    index_before: int | None = None
    index_after: int | None = None
    lowest_eigenvalue: float | None = None
    sliding_overlap: float | None = None
    soft_mode: Array | None = None
    parameter: str | None = None

    def __post_init__(self) -> None:
        if self.type not in POINT_TYPES:
            raise ValueError(f"type must be one of {', '.join(POINT_TYPES)}, got {self.type!r}")
        _to_float64(self, ("tangent",) if self.soft_mode is None else ("tangent", "soft_mode"))


@dataclass(frozen=True, eq=False, kw_only=True)
class StateRecord:
    """One stored state with everything that is known of it; see docs/format.md for every field.

    `label` counts 1, 2, 3, ... in the order stored. `g_end` (3,) is the ruling g_{N+1}: sigma g_1 when the
    seam is closed, prescribed while it is open (`seam_open`; None means closed). `prescribed` (N,) marks
    rulings that an auxiliary problem holds; None means none. `cut_node` and `g_cut` (3,) belong to bands in
    two pieces alone. `spectra` are kept in the order of their metrics' names.
    `parts` are ends, material and loads; a strip has ends, sigma 0 and no half-twists, and reactions (3,) of
    what holds it. `bending_energy` is given where `energy` is more than that. `contacts` are those of a band
    computed with contact forces, which may touch nothing; None means without.
    `event_kinds` are words for `events`, one each; None means what the sentences of older files tell.
    `provenance` says which program made the state, where and when; it is no part of the scientific content.
    Raises ValueError for an unknown kind, a label below 1, two spectra in a metric, a closed band's ends, or
    contacts of features that the band does not have.
    """

    label: int
    kind: str
    status: str
    message: str
    certified: bool
    half_width: float
    length: float
    sigma: int
    segments: int
    half_twists: int
    discretisation: str
    stage: str
    u: Array
    g: Array
    xi: Array
    lambda_1: Array
    lambda_2: Array
    lambda_3: Array
    lambda_4: Array
    lambda_5: Array
    gamma: Array
    g_end: Array
    energy: float
    kkt_residual: float
    constraint_residual: float
    negative_eigenvalues: int | None
    smallest_facet: float
    inverted_facets: int
    linking_number: float
    twist: float
    writhe: float
    self_contact: bool
    clearance: float
    midline: Array
    kappa_s: Array
    tau: Array
    eta: Array
    eta_prime: Array
    cut_node: int | None = None
    g_cut: Array | None = None
    spectra: tuple[SpectrumRecord, ...] = ()
    branch: BranchRecord | None = None
    parent: int | None = None
    parent_ref: str | None = None
    method: str = ""
    newton_steps: int = 0
    events: tuple[str, ...] = ()
    event_kinds: tuple[str, ...] | None = None
    prescribed: NDArray[np.bool_] | None = None
    seam_open: bool | None = None
    parts: Parts = CLOSED
    bending_energy: float | None = None
    lambda_end: float | None = None
    reaction_force: Array | None = None
    reaction_moment: Array | None = None
    start_force: Array | None = None
    start_moment: Array | None = None
    contacts: Contacts | None = None
    provenance: Mapping[str, str | int | float] = field(default_factory=dict)

    @property
    def parameters(self) -> dict[str, float]:
        """All parameters that the problem has, by name."""
        names = self.parts.names(self.sigma)
        others = {name: self.parts.value(name) for name in names if name != HALF_WIDTH}
        return {HALF_WIDTH: self.half_width, **others}

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise ValueError(f"kind must be one of {', '.join(KINDS)}, got {self.kind!r}")
        if self.label < 1:
            raise ValueError(f"labels start at 1, got {self.label}")
        if (self.sigma == 0) != (self.parts.ends is not None):
            raise ValueError("a strip has sigma 0 and ends, a closed band neither")
        if self.contacts is not None:
            self.contacts.check(self.segments, self.sigma != 0)
        spectra = tuple(sorted(self.spectra, key=lambda spectrum: spectrum.metric))
        if len({spectrum.metric for spectrum in spectra}) < len(spectra):
            raise ValueError("a state holds at most one spectrum in each metric")
        object.__setattr__(self, "spectra", spectra)
        object.__setattr__(self, "events", tuple(str(event) for event in self.events))
        object.__setattr__(self, "event_kinds", kinds_of(self.events, self.event_kinds))
        _to_float64(self, _UNKNOWNS + _MULTIPLIERS + _GEOMETRY)
        _to_float64(self, tuple(name for name in ("g_cut", *REACTIONS) if getattr(self, name) is not None))
        if self.prescribed is not None:
            import numpy as np

            object.__setattr__(self, "prescribed", np.ascontiguousarray(self.prescribed, dtype=np.bool_))

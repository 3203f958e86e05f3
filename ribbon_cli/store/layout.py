"""The one table of what a state file holds; writer, reader, documentation and JSON all follow from it.

An item's record field is the last part of its path, so that no second list of names can disagree.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from typing import Literal

FORMAT = "ribbon-state"
FORMAT_VERSION = "1.4"
"""major.minor: readers refuse a newer major, and skip what a newer minor adds."""

Dtype = Literal["float64", "int64", "bool", "utf-8"]

KINDS = ("equilibrium", "intermediate", "auxiliary", "saddle")
"""Kinds of state, in the words of `ribbon ls`."""
REACTIONS = ("reaction_force", "reaction_moment", "start_force", "start_moment")
"""Fields with the forces and moments at the ends of a strip."""


@dataclass(frozen=True)
class Dimension:
    """An axis that arrays share, with the dataset that is its scale in every group of such arrays.

    `size` is a number or a symbol: N facets, N+1 nodes with both ends of the seam, k eigenvalues, m stored
    modes, e events, c contacts.
    """

    size: str | int
    dtype: Dtype
    equation: str
    description: str


DIMENSIONS = {
    "facet": Dimension(
        "N", "float64", "Koldaev (2022), (2.3)", "arc length (i - 1/2) h at the middle of facet i"
    ),
    "node": Dimension("N", "float64", "Koldaev (2022), (2.3)", "arc length (i - 1) h at node i"),
    "vertex": Dimension("N+1", "float64", "Koldaev (2022), (2.3)", "arc length (i - 1) h, i = 1..N+1"),
    "xyz": Dimension(3, "utf-8", "none", "Cartesian components"),
    "unknown": Dimension(7, "utf-8", "none", "unknowns of a node, as in a mode"),
    "event": Dimension("e", "int64", "none", "number of the event"),
    "eigenvalue": Dimension("k", "int64", "none", "number of the eigenvalue, ascending"),
    "mode": Dimension("m", "int64", "none", "number of the eigenvalue that the mode belongs to"),
    "contact": Dimension("c", "int64", "none", "number of the contact"),
    "feature": Dimension(2, "utf-8", "none", "kind and number of a feature"),
}
"""Dimensions by name; a scale's dataset bears the name of its dimension.

Names are never used for anything else.
"""

EVENTS, KINDS_OF_EVENTS = "/origin/events", "kinds"
"""The dataset with the sentences of events, and its attribute with a word for each; 1.0 and 1.1 lack it."""

SIGNALS = {
    "/state": "u",
    "/multipliers": "lambda_1",
    "/geometry": "kappa_s",
    "/spectra/euclidean": "values",
    "/spectra/physical": "values",
    "/contacts": "force",
}
"""The array that a viewer shows of a group, as in NeXus; the group's `axes` are that array's dimensions."""


@dataclass(frozen=True)
class Item:
    """One dataset of a state file; `dims` names its axes, none for a scalar.

    An `optional` item whose value is None is absent from the file. Those in `summary` appear in the log and
    in `ribbon ls` and `ribbon show`.
    """

    path: str
    dtype: Dtype
    dims: tuple[str, ...]
    equation: str
    description: str
    units: str = "1"
    optional: bool = False
    summary: bool = False

    @property
    def shape(self) -> tuple[str | int, ...]:
        """Numbers and symbols, an axis each."""
        return tuple(DIMENSIONS[dim].size for dim in self.dims)

    @property
    def group(self) -> str:
        """Path of the group that the dataset is in."""
        return self.path.rpartition("/")[0]

    @property
    def field(self) -> str:
        """Name of the record's attribute."""
        return self.path.rpartition("/")[2]


def _items(rows: tuple[tuple[str, Dtype, str, str, str, str], ...]) -> tuple[Item, ...]:
    """Rows of (path, dtype, dims, flags, equation, description); flags: o optional, s in the summary.

    An equation that is a bare number in parentheses is one of Koldaev (2022).
    """
    items = []
    for path, dtype, dims, flags, equation, description in rows:
        source = f"Koldaev (2022), {equation}" if equation.startswith("(") else equation or "none"
        items.append(
            Item(
                path,
                dtype,
                tuple(dims.split()),
                source,
                description,
                optional="o" in flags,
                summary="s" in flags,
            )
        )
    return tuple(items)


# fmt: off
STATE = _items((
    ("/origin/label", "int64", "", "s", "",
     "number of the state in its run, 1, 2, 3, ... in the order stored"),
    ("/origin/kind", "utf-8", "", "s", "",
     "equilibrium, intermediate, auxiliary (prescribed rulings, open seam) or saddle (met and left)"),
    ("/origin/stage", "utf-8", "", "s", "",
     "stage of the run that made the state, for instance `twist 3/50` or `b = 0.5`"),
    ("/state/half_width", "float64", "", "s", "(1.48)",
     "half-width b of the strip, in the unit of `length`"),
    ("/state/segments", "int64", "", "s", "(2.3)",
     "number N of flat facets; h = length/N"),
    ("/state/length", "float64", "", "s", "(1.11)",
     "length l of the midline"),
    ("/state/discretisation", "utf-8", "", "s", "(2.15)",
     "rule for xi at a node: thesis (F of the average) or value-average (average of F)"),
    ("/topology/half_twists", "int64", "", "s", "Lk = n/2",
     "half-twists n that the run asks for; the sign is the handedness"),
    ("/topology/sigma", "int64", "", "s", "(2.1)-(2.2)",
     "+1 orientable, -1 one-sided: g_{N+1} = sigma g_1 and xi_0 = sigma xi_N"),
    ("/state/energy", "float64", "", "s", "(2.14)",
     "Q_h with q_i = |u_i - u_{i-1}|^2 / 2, not divided by pi b"),
    ("/state/bending_energy", "float64", "", "o", "",
     "elastic energy, int H^2 da and what a natural curvature adds to it, without loads; "
     "absent: neither is there, and `energy` is int H^2 da"),
    ("/certificate/status", "utf-8", "", "s", "",
     "outcome in one word: minimum, saddle, stalled, ..."),
    ("/certificate/message", "utf-8", "", "s", "",
     "outcome as a sentence"),
    ("/certificate/certified", "bool", "", "s", "(2.58)",
     "stationary within tolerance, positive definite on the constraints and no facet inverted"),
    ("/certificate/kkt_residual", "float64", "", "s", "(2.54)",
     "largest component of the Lagrangian's gradient over (u, g, xi)"),
    ("/certificate/constraint_residual", "float64", "", "s", "(2.19)",
     "largest component of the constraints"),
    ("/certificate/negative_eigenvalues", "int64", "", "os", "(2.58)",
     "negative eigenvalues of the projected Hessian, rotations left out, sliding counted; absent: unknown"),
    ("/certificate/smallest_facet", "float64", "", "s", "(2.18), fourth, with its sign",
     "smallest (u_i x g_i).(u_i x g_{i+1}) over facets; positive when no facet is inverted"),
    ("/certificate/inverted_facets", "int64", "", "s", "(2.18), fourth, with its sign",
     "number of facets with (u_i x g_i).(u_i x g_{i+1}) <= 0"),
    ("/topology/linking_number", "float64", "", "s", "Calugareanu (1961), Lk = Tw + Wr",
     "linking number of midline and edge, half-integer on one-sided bands"),
    ("/topology/twist", "float64", "", "s", "Calugareanu (1961), Lk = Tw + Wr",
     "twist Tw of the rulings about the midline, in turns"),
    ("/topology/writhe", "float64", "", "s", "Calugareanu (1961), Lk = Tw + Wr",
     "writhe Wr of the midline"),
    ("/topology/self_contact", "bool", "", "s", "",
     "whether facets more than max(3, N/20) apart along the band meet"),
    ("/topology/clearance", "float64", "", "s", "",
     "smallest distance of facets more than max(3, N/20) apart along the band, in the unit of `length`"),
    ("/origin/parent", "int64", "", "os", "",
     "label in the same run of the state this one was reached from; absent: none"),
    ("/origin/parent_ref", "utf-8", "", "os", "",
     "reference to a parent outside the run; absent: none"),
    ("/origin/method", "utf-8", "", "s", "",
     "how the state was reached from its parent"),
    ("/origin/newton_steps", "int64", "", "s", "(2.56)",
     "Newton steps taken to reach the state from its guess"),
    ("/origin/events", "utf-8", "event", "s", "",
     "what happened on the way, in order, for instance `grid phase`"),
    ("/state/u", "float64", "facet xyz", "", "(2.5)",
     "tangent u_i of facet i, at alpha_{i+1/2}"),
    ("/state/g", "float64", "node xyz", "", "(2.3)",
     "ruling g_i at node i; b g_i leads from the midline to the edge"),
    ("/state/xi", "float64", "facet", "", "(2.10)",
     "xi_i of facet i with tanh xi_i = (b/h) u_i.(g_{i+1} - g_i)"),
    ("/state/g_end", "float64", "xyz", "", "(2.2)",
     "ruling g_{N+1}: sigma g_1 when the seam is closed, prescribed while it is open"),
    ("/state/cut_node", "int64", "", "o", "",
     "node, from 1, at which a band that is open at its seam is cut once more: facets from there on are a "
     "second piece, placed as `midline` says; absent: none"),
    ("/state/g_cut", "float64", "xyz", "o", "",
     "ruling at which the first piece of a cut band ends; absent: none"),
    ("/state/prescribed", "bool", "node", "o", "(3.9)-(3.10)",
     "whether ruling g_i is prescribed; absent: none is"),
    ("/state/seam_open", "bool", "", "o", "(3.9)-(3.10)",
     "whether the seam is open, with g_end prescribed; absent: it is closed"),
    ("/multipliers/lambda_1", "float64", "facet", "", "(1.58)",
     "multiplier of |u_i|^2 - 1, at facets"),
    ("/multipliers/lambda_2", "float64", "node", "", "(1.58)",
     "multiplier of |g_i|^2 - (g_i.u_i)^2 - 1, at nodes"),
    ("/multipliers/lambda_3", "float64", "node", "", "(1.58)",
     "multiplier of d''.g, discretely (u_i - u_{i-1}).g_i / h, at nodes; "
     "lambda_3 - h lambda_2 eta is the field to order 2"),
    ("/multipliers/lambda_4", "float64", "facet", "", "(1.58)",
     "multiplier of (d' x g).g', discretely (u_i x g_i).g_{i+1} / h, at facets"),
    ("/multipliers/lambda_5", "float64", "facet", "", "(1.58)",
     "multiplier of b d'.g' - tanh xi, at facets"),
    ("/multipliers/gamma", "float64", "xyz", "", "(1.58)",
     "closure force, multiplier of the integral of d'"),
    ("/multipliers/lambda_end", "float64", "", "o", "",
     "multiplier of a strip's end row, (t_B - u_N).g_{N+1}, of a free end |g_{N+1}|^2 - (g_{N+1}.u_N)^2 - 1; "
     "absent: a closed band"),
    ("/reactions/reaction_force", "float64", "xyz", "o", "",
     "force that the support of the end exerts on an open strip, in the start's frame; "
     "absent: a closed band"),
    ("/reactions/reaction_moment", "float64", "xyz", "o", "",
     "moment that it exerts, about the end's midpoint"),
    ("/reactions/start_force", "float64", "xyz", "o", "",
     "force that the support of the start exerts, from the start's own rows"),
    ("/reactions/start_moment", "float64", "xyz", "o", "",
     "moment that it exerts, about the start's midpoint"),
    ("/geometry/midline", "float64", "vertex xyz", "", "(2.17)",
     "midline's vertices d_1..d_{N+1}, d_{i+1} = d_i + h u_i, in the unit of `length`"),
    ("/geometry/kappa_s", "float64", "node", "", "(3.1), reading g for g'",
     "signed curvature of the midline at nodes"),
    ("/geometry/tau", "float64", "node", "", "(3.1)",
     "torsion of the midline at nodes, kappa_s eta"),
    ("/geometry/eta", "float64", "node", "", "(3.1)",
     "eta = d'.g at nodes, cotangent of the angle from tangent to ruling"),
    ("/geometry/eta_prime", "float64", "facet", "", "(3.1)",
     "eta' = d'.g' at facets"),
))
"""Datasets of a state, in the order in which summaries show them."""

ENDS = _items((
    ("/ends/start", "utf-8", "", "", "", "how the start is held: clamped, or hinged about its ruling"),
    ("/ends/end", "utf-8", "", "", "", "how the end is held: clamped, hinged or free"),
    ("/ends/span", "float64", "", "", "",
     "place of the end along the start's tangent, in the unit of `length`; not a number where it is free"),
    ("/ends/lift", "float64", "", "", "", "place of the end across the start's tangent and ruling"),
    ("/ends/shear", "float64", "", "", "", "place of the end along the start's ruling"),
    ("/ends/twist", "float64", "", "", "", "turn of the end's frame, R_x(twist) R_z(tilt), in radians"),
    ("/ends/tilt", "float64", "", "", "", "turn of the end's frame about z, before the twist, in radians"),
    ("/ends/start_eta", "float64", "", "", "", "cotangent of the angle from tangent to ruling at the start"),
    ("/ends/end_eta", "float64", "", "", "", "cotangent of the angle from tangent to ruling at the end"),
))
"""Datasets of an open strip's ends: all of them. A closed band has none."""

MATERIAL = _items((
    ("/material/natural_curvature", "float64", "", "", "", "curvature without loads, in 1/length"),
    ("/material/poisson", "float64", "", "", "", "Poisson's ratio"),
))
"""Datasets of the material of an open strip, or of a closed band if one is not zero: all, or none."""

LOADS = _items((
    ("/loads/gravity", "float64", "", "", "", "weight per area"),
    ("/loads/gravity_direction", "float64", "xyz", "", "", "unit vector of the weight, in the start's frame"),
    ("/loads/end_force", "float64", "xyz", "", "", "dead force on the end's midpoint"),
    ("/loads/point_force", "float64", "xyz", "", "", "dead force on a point of the midline"),
    ("/loads/point_at", "float64", "", "", "", "where it acts, as a part of the length from the start"),
))
"""Datasets of an open strip's loads: all, or none."""

SPECTRUM = _items((
    ("/spectra/METRIC/complete", "bool", "", "", "(2.58)",
     "whether every eigenvalue of the projected Hessian is listed, not only the lowest"),
    ("/spectra/METRIC/values", "float64", "eigenvalue", "", "(2.58)",
     "eigenvalues of the projected Hessian, ascending"),
    ("/spectra/METRIC/residuals", "float64", "eigenvalue", "", "(2.58)",
     "residuals of the eigenpairs in the dual metric: an eigenvalue lies within that distance"),
    ("/spectra/METRIC/labels", "utf-8", "eigenvalue", "", "",
     "what each mode is: rotation, sliding, checkerboard (of the discretisation) or mode"),
    ("/spectra/METRIC/sliding_overlap", "float64", "eigenvalue", "", "",
     "overlap of each mode with sliding the shape along the band, 0 to 1"),
    ("/spectra/METRIC/vectors", "float64", "mode node unknown", "o", "(2.58)",
     "the lowest m <= k modes, (u, g, xi) per node; absent: not kept"),
))
"""Datasets of one spectrum; METRIC is `euclidean` or `physical`."""

BRANCH = _items((
    ("/branch/name", "utf-8", "", "s", "",
     "branch of the run that the state is a point of"),
    ("/branch/type", "utf-8", "", "s", "",
     "step, width or value (asked for), fold, branch-point or contact"),
    ("/branch/arclength", "float64", "", "s", "",
     "length of the branch from its start to the point"),
    ("/branch/half_width_rate", "float64", "", "s", "",
     "derivative of b, or of `parameter`, by the branch's length, zero at folds"),
    ("/branch/next_step", "float64", "", "", "",
     "length of the step to be tried from here"),
    ("/branch/tangent", "float64", "node unknown", "", "",
     "the branch's unit tangent in (u, g, xi), with `half_width_rate` its component in the parameter"),
    ("/branch/index_before", "int64", "", "os", "",
     "negative eigenvalues just before a fold or branch point; absent: another point, or unknown"),
    ("/branch/index_after", "int64", "", "os", "",
     "negative eigenvalues just after it"),
    ("/branch/lowest_eigenvalue", "float64", "", "os", "(2.58)",
     "lowest eigenvalue in the physical metric, rotations left out; absent: not determined"),
    ("/branch/sliding_overlap", "float64", "", "os", "",
     "overlap with sliding, 0 to 1, of the mode that is soft at a fold or branch point, else of the lowest"),
    ("/branch/soft_mode", "float64", "node unknown", "o", "",
     "the mode in (u, g, xi) that is soft at a fold or branch point, of length one; absent elsewhere"),
    ("/branch/parameter", "utf-8", "", "o", "",
     "the parameter in which the branch is followed; absent: the half-width"),
))
"""Datasets of a point on a branch: all of those that are not optional, or none."""

CONTACTS = _items((
    ("/contacts/first", "int64", "contact feature", "", "",
     "the feature that each gap is measured from, a vertex or an edge: its kind (0 vertex, 1 edge, 2 facet) "
     "and its number from 0: vertex 2k is r_k - b g_k and 2k + 1 is r_k + b g_k, edge 3k the ruling at node "
     "k, edges 3k + 1 and 3k + 2 the lower and the upper side of facet k"),
    ("/contacts/second", "int64", "contact feature", "", "",
     "the feature that it is measured to, likewise; a facet is always the second"),
    ("/contacts/sign", "int64", "contact", "", "g = s D.n",
     "+1 or -1, the sign s with which the gap is positive on the side where the features are to stay"),
    ("/contacts/force", "float64", "contact", "", "L = Q - lambda.c - f.(g - gap)",
     "multiplier f of the kept gap, in 1/length; f >= 0 pushes the features apart"),
    ("/contacts/value", "float64", "contact", "", "g = s D.n",
     "the gap, in the unit of `length`, with n = (p x q)/|p x q|: D leads from the second feature to the "
     "first, p and q are u and g of the facet, or the directions of the edges; of a vertex with an edge or a "
     "vertex, their distance"),
    ("/contacts/gap", "float64", "", "", "g = gap",
     "value at which each gap is kept: 0, or the least distance asked for, in the unit of `length`"),
    ("/contacts/excluded", "float64", "", "", "0.005 l + (pi/2) gap",
     "distance on the flat strip from which pairs of features count, in the unit of `length`"),
    ("/contacts/clearance", "float64", "", "", "",
     "least distance of features that count, in the unit of `length`; 0 where they cross"),
    ("/contacts/penetration", "float64", "", "", "",
     "greatest depth of an edge through a facet over all pairs that count, in the unit of `length`"),
))
"""Datasets of a band computed with contact forces, whether it touches itself or not: all, or none."""

_WITH_FORCES = {
    "/certificate/certified":
     "stationary with forces within tolerance, no force pulls, no crossing, positive definite on the null "
     "space of constraints and kept gaps, and no facet inverted",
    "/certificate/constraint_residual": "largest component of the constraints, and of the gaps less `gap`",
    "/certificate/negative_eigenvalues":
     "negative eigenvalues of the projected Hessian, kept gaps being among the constraints, rotations left "
     "out, sliding counted; absent: unknown",
    "/topology/self_contact": "whether the band rests on itself or crosses itself",
    "/topology/clearance": "as /contacts/clearance",
    "/branch/type": "step, width or value (asked for), fold, branch-point, touch or lift",
}
"""Descriptions of datasets whose meaning changes with contact forces."""
# fmt: on


@cache
def as_with_forces(items: tuple[Item, ...]) -> tuple[Item, ...]:
    """The items as a band computed with contact forces has them."""
    return tuple(replace(item, description=_WITH_FORCES.get(item.path, item.description)) for item in items)


PROVENANCE = {
    "argv": "command line",
    "blas": "BLAS library that NumPy was built with",
    "blas_threads": "threads that BLAS was allowed by the environment",
    "code_dirty": "1 when the program's working copy had uncommitted changes",
    "code_revision": "revision of the working copy that the program ran from",
    "config_resolved": "the run's config with every default filled in",
    "config_sha256": "SHA-256 of the run's config as written",
    "config_text": "the run's config as written",
    "cpu_seconds": "processor time",
    "git_dirty": "1 when the config's repository had uncommitted changes",
    "git_revision": "revision of the repository that holds the config",
    "hostname": "name of the machine",
    "machine": "processor architecture",
    "peak_memory_bytes": "largest resident memory",
    "platform": "operating system",
    "started": "start of the command, UTC",
    "version_hdf5": "version of the HDF5 library",
    "version_python": "version of Python",
    "version_ribbon": "version of the program",
    "wall_seconds": "elapsed time",
}
"""Known keys of /provenance; a writer may add others, each a scalar."""


def provenance_item(key: str, value: str | int | float) -> Item:
    """Item of a provenance entry, its dtype taken from the value. Raises ValueError for another type."""
    if isinstance(value, str):
        dtype: Dtype = "utf-8"
    elif isinstance(value, int):
        dtype = "int64"
    elif isinstance(value, float):
        dtype = "float64"
    else:
        raise ValueError(f"provenance {key!r} must be str, int or float, got {type(value).__name__}")
    package = key.removeprefix("version_")
    default = f"version of {package}" if package != key else "given by the program that wrote the file"
    return Item(f"/provenance/{key}", dtype, (), "none", PROVENANCE.get(key, default))

"""A state's summary, as in the log, `ribbon ls` and `ribbon show`."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields
from operator import itemgetter
from typing import TYPE_CHECKING, Any

from ribbon_cli.facts import kinds_of
from ribbon_cli.parts import CLOSED, FREE, HALF_WIDTH, PARAMETERS, Ends, Parts
from ribbon_cli.store.layout import BRANCH, REACTIONS, STATE, Dtype, Item

if TYPE_CHECKING:
    from ribbon_cli.store.contacts import Contacts
    from ribbon_cli.store.record import StateRecord

_TOPOLOGY = ("half_twists", "sigma")
_OPEN = {"open": True}
"""The topology of strips in JSON."""
Vector = tuple[float | None, ...]
_NONE: set[type] = {type(None)}
_JSON: dict[str, set[type]] = {
    "bool": {bool},
    "utf-8": {str},
    "int64": {int},
    "float64": {int, float} | _NONE,
}
"""What a value may be in JSON, by the type that it has in a file; not-a-number is null."""
LABELS = 10**12
"""Bound of the labels that a line may name."""
_LARGEST = 2**63
"""Bound of whole numbers, as in a file."""
_LARGEST_FLOAT = 1e100
"""Bound of numbers, far beyond what a computation can end with: their products and ratios fit a float."""
_SMALL = 1e15
_FARTHEST = 1e30
"""Bound of parameters and lengths, and of 1/lengths; configs admit 1e9."""
_LENGTHS = ("half_width", "length")
OF_CONTACTS: dict[str, Dtype] = {
    "contacts": "int64",
    "contact_force": "float64",
    "contact_gap": "float64",
    "penetration": "float64",
}
"""What a summary says of a state with contact forces, and of no other: types as in a file."""
_NUMBER = frozenset(_JSON["float64"])
_FINITE = _NUMBER - _NONE


class Fields:
    """Fields of a part of a line, each with the types that it may be of; a bool is no int here.

    A log has thousands of lines alike: types that were found in order once are looked up.
    """

    def __init__(self, types: Mapping[str, Iterable[type]]) -> None:
        self._types = {name: frozenset(allowed) for name, allowed in types.items()}
        self._names = tuple(types)
        self._values = itemgetter(*types)
        self._by_types: dict[tuple[type, ...], tuple[list[int], ...]] = {}

    def checked(self, found: Any, of: str) -> dict[str, Any]:
        """These fields of a part of a line; what else it says is left out. Raises ValueError, as `pairs`."""
        return dict(self.pairs(found, of))

    def pairs(self, found: Any, of: str) -> Iterable[tuple[str, Any]]:
        """Names and values of these fields, as `dict.update` takes them.

        Raises ValueError, with the words `of` behind a field's name, unless all are there, each of one of its
        types.
        """
        found = found if isinstance(found, dict) else {}
        try:
            values = self._values(found)
        except KeyError as error:
            raise ValueError(f"{error.args[0]} {of}") from None
        numbers, lists = self._places(values, of)
        # All at once, and one by one only where something may not fit.
        if not (are_small([values[k] for k in numbers]) and all(map(are_texts, [values[k] for k in lists]))):
            for name, value in zip(self._names, values, strict=True):
                if not fits(value):
                    raise ValueError(f"{name} {of}")
        return zip(self._names, values, strict=True)

    def _places(self, values: tuple[Any, ...], of: str) -> tuple[list[int], ...]:
        """Where numbers and lists are among the values. Raises ValueError for a type that is not allowed."""
        found = tuple(map(type, values))
        places = self._by_types.get(found)
        if places is None:
            for name, one in zip(self._names, found, strict=True):
                if one not in self._types[name]:
                    raise ValueError(f"{name} {of}")
            kinds: tuple[set[type], ...] = ({float, int}, {list})
            places = tuple([k for k, one in enumerate(found) if one in kind] for kind in kinds)
            self._by_types[found] = places
        return places


def are_small(numbers: Iterable[float]) -> bool:
    """Whether numbers are far below any bound, as nearly all are."""
    try:
        return math.hypot(*numbers) < _SMALL
    except OverflowError:  # an integer beyond any float
        return False


def fits(value: Any) -> bool:
    """Whether a value could be a state's: 1e999 could not."""
    if type(value) is float:
        return abs(value) <= _LARGEST_FLOAT
    if type(value) is int:
        return -_LARGEST <= value < _LARGEST
    return type(value) is not list or are_texts(value)


def _types(items: Iterable[Item]) -> dict[str, set[type]]:
    """The types by field; no class is taken for another, as bool is for int by `isinstance`."""
    found = {}
    for item in items:
        types: set[type] = {list} if item.dims else _JSON[item.dtype]
        found[item.field] = types | _NONE if item.optional else types
    return found


_OF_STATE = Fields(
    {
        **_types(item for item in STATE if item.summary and item.field not in _TOPOLOGY),
        "content_sha256": {str},
    }
)
_OF_BRANCH = Fields(_types(item for item in BRANCH if item.summary))
_OF_CONTACTS = Fields({name: _JSON[dtype] for name, dtype in OF_CONTACTS.items()})
_KEYS = tuple(
    dict.fromkeys("topology" if item.field in _TOPOLOGY else item.field for item in STATE if item.summary)
)
"""Keys of every state's document but the last, in their order."""
_PROBLEMS = ((1, CLOSED), (-1, CLOSED), (0, Parts(Ends())), (0, Parts(Ends(end=FREE))))
_NAMES: dict[int, dict[frozenset[str], tuple[str, ...]]] = {}
"""The names that `parameters` may have, by sigma, with those besides the half-width in their order."""
for _sigma, _parts in _PROBLEMS:
    _names = _parts.names(_sigma)
    _NAMES.setdefault(_sigma, {})[frozenset(_names)] = _names[1:]
_values = itemgetter(*(_TOPOLOGY[0] if key == "topology" else key for key in _KEYS))


@dataclass(frozen=True)
class BranchSummary:
    """What a state is on its branch: the fields of `BranchRecord` that layout.py marks.

    None stands for what is absent, or is not a number.
    """

    name: str
    type: str
    arclength: float | None
    half_width_rate: float | None
    index_before: int | None
    index_after: int | None
    lowest_eigenvalue: float | None
    sliding_overlap: float | None
    parameter: str | None = None

    def to_dict(self) -> dict[str, Any]:
        """The fields for JSON; the parameter only where it is not the half-width."""
        return {name: value for name, value in vars(self).items() if name != "parameter" or value is not None}


@dataclass(frozen=True)
class Summary:
    """What is known about a state without reading its file: the fields of `StateRecord` that layout.py marks.

    `Run.load` reads the rest. None stands for what is absent, or is not a number.
    """

    label: int
    kind: str
    stage: str
    half_width: float
    segments: int
    length: float
    discretisation: str
    half_twists: int
    sigma: int
    energy: float | None
    status: str
    message: str
    certified: bool
    kkt_residual: float | None
    constraint_residual: float | None
    negative_eigenvalues: int | None
    smallest_facet: float | None
    inverted_facets: int
    linking_number: float | None
    twist: float | None
    writhe: float | None
    self_contact: bool
    clearance: float | None
    parent: int | None
    parent_ref: str | None
    method: str
    newton_steps: int
    events: tuple[str, ...]
    event_kinds: tuple[str, ...]
    branch: BranchSummary | None
    content_sha256: str
    others: Mapping[str, float | None] = field(default_factory=dict, hash=False)
    bending_energy: float | None = None
    reaction_force: Vector | None = None
    reaction_moment: Vector | None = None
    start_force: Vector | None = None
    start_moment: Vector | None = None
    contacts: int | None = None
    contact_force: float | None = None
    contact_gap: float | None = None
    penetration: float | None = None

    @property
    def with_forces(self) -> bool:
        """Whether it was computed with contact forces, touching or not."""
        return self.contacts is not None

    @property
    def parameters(self) -> dict[str, float | None]:
        """All parameters that the problem has, by name: the half-width and `others`."""
        return {HALF_WIDTH: self.half_width, **self.others}

    @classmethod
    def of(cls, record: StateRecord, content: str | None = None) -> Summary:
        """The summary of a record; `content` is its content hash where that is known, or is left empty."""
        if content is None:
            from ribbon_cli.store.content import content_sha256

            content = content_sha256(record)
        values = {item.field: _plain(record, item) for item in STATE if item.summary}
        values["event_kinds"] = tuple(record.event_kinds or ())
        branch = None
        if record.branch is not None:
            branch = BranchSummary(
                **{item.field: _plain(record.branch, item) for item in BRANCH if item.summary},
                parameter=record.branch.parameter,
            )
        others = {name: value for name, value in record.parameters.items() if name != HALF_WIDTH}
        values["others"] = {name: _finite(value) for name, value in others.items()}
        bending = record.energy if record.bending_energy is None else record.bending_energy
        values["bending_energy"] = _finite(bending)
        for name in REACTIONS:
            reaction = getattr(record, name)
            values[name] = None if reaction is None else tuple(map(_finite, map(float, reaction)))
        values |= _of_contacts(record.contacts)
        return cls(**values, branch=branch, content_sha256=content)

    @classmethod
    def read(cls, document: Any) -> Summary:
        """The summary that `to_dict` wrote; what a newer version has put into it is passed over.

        Raises ValueError unless every field is there, and of its type.
        """
        if not isinstance(document, dict) or not is_label(document.get("label")):
            raise ValueError("it has no state with a label")
        of = f"of state {document['label']} is missing, or of another type"
        # Into one dictionary, which becomes the summary's own: a log has thousands.
        values = _UNKNOWN.copy()
        values.update(_OF_STATE.pairs(document, of))
        if values["segments"] < 1:
            raise ValueError(f"segments of state {document['label']} is not positive")
        for name in _LENGTHS:
            if not 1.0 / _FARTHEST <= (values[name] or 0) <= _FARTHEST:
                raise ValueError(f"{name} of state {document['label']} is not positive, or beyond any length")
        topology = document.get("topology")
        if topology == _OPEN:
            values["half_twists"] = values["sigma"] = 0
        else:
            for name in _TOPOLOGY:
                value = values[name] = topology.get(name) if isinstance(topology, dict) else None
                if type(value) is not int or not fits(value):
                    raise ValueError(f"{name} {of}")
            if values["sigma"] not in (1, -1):
                raise ValueError(f"sigma {of}")
        parent = values["parent"]
        if parent is not None and not 0 < parent < document["label"]:
            raise ValueError(f"state {parent}, the parent of state {document['label']}, is not earlier")
        _add_newer(document, values, of)
        values["events"] = tuple(values["events"])
        values["event_kinds"] = _kinds(document, values["events"], of)
        on_branch = document.get("branch")
        if on_branch is not None:
            if values["parent"] is None:
                raise ValueError(f"state {document['label']} is a point of a branch, and has no parent")
            parameter = on_branch.get("parameter") if isinstance(on_branch, dict) else None
            if parameter is not None and parameter not in PARAMETERS:
                raise ValueError(f"the branch's parameter {of}")
            values["branch"] = BranchSummary(**_OF_BRANCH.checked(on_branch, of), parameter=parameter)
        summary = object.__new__(cls)
        object.__setattr__(summary, "__dict__", values)
        return summary

    def to_dict(self) -> dict[str, Any]:
        """The summary for JSON, as in the log.

        Keys are in the order of layout.py, with `half_twists` and `sigma` together under `topology`, and
        those of a point on a branch under `branch`, which other states lack.
        """
        known = vars(self)
        document = dict(zip(_KEYS, _values(known), strict=True))
        document["topology"] = {name: known[name] for name in _TOPOLOGY} if self.sigma else dict(_OPEN)
        document["parameters"] = self.parameters
        document["bending_energy"] = self.bending_energy
        document |= {name: list(known[name]) for name in REACTIONS if known[name] is not None}
        if self.contacts is not None:
            document |= {name: known[name] for name in OF_CONTACTS}
        document["events"] = list(self.events)
        document["event_kinds"] = list(self.event_kinds)
        if self.branch is not None:
            document["branch"] = self.branch.to_dict()
        document["content_sha256"] = self.content_sha256
        return document

    def listed(self, run: str | None) -> dict[str, Any]:
        """The summary for JSON, as `ribbon ls` and `ribbon show` give it of a state of a run."""
        return {"run": run, **self.to_dict()}

    def agrees(self, document: Mapping[str, Any]) -> bool:
        """Whether a stored document is this summary; what a newer version has put into it is passed over."""
        known = {**self.added(), **document}
        return all(key in known and known[key] == value for key, value in self.to_dict().items())

    def added(self) -> dict[str, Any]:
        """What summaries of earlier formats lack: kinds of events, which its sentences tell, and what strips
        brought.
        """
        mine = self.to_dict()
        brought = {name: mine[name] for name in ("parameters", "bending_energy")}
        return {"event_kinds": list(kinds_of(self.events)), **brought}


_UNKNOWN: dict[str, Any] = dict.fromkeys(item.name for item in fields(Summary))


def _add_newer(document: dict[str, Any], values: dict[str, Any], of: str) -> None:
    """Add parameters, bending energy and reactions, of which earlier formats of closed bands say nothing, and
    what is said of contacts.

    Raises ValueError unless they are numbers, or null.
    """
    known = _NAMES[values["sigma"]]
    if "parameters" in document:
        parameters = document["parameters"]
    else:
        parameters = {HALF_WIDTH: values["half_width"], **dict.fromkeys(next(iter(known.values())), 0.0)}
    names = known.get(frozenset(parameters)) if isinstance(parameters, dict) else None
    if names is None:
        raise ValueError(f"parameters {of}")
    for value in parameters.values():
        if type(value) not in _FINITE or not abs(value) <= _FARTHEST:
            raise ValueError(f"parameters {of}")
    numbers = [document.get("bending_energy", values["energy"])]
    values["bending_energy"] = numbers[0]
    for name in REACTIONS:
        vector = document.get(name)
        if vector is not None:
            if not isinstance(vector, list) or len(vector) != 3:
                raise ValueError(f"a reaction {of}")
            numbers += vector
            values[name] = tuple(vector)
    for value in numbers:
        if type(value) not in _NUMBER or not fits(value):
            raise ValueError(f"bending_energy or a reaction {of}")
    values["others"] = {name: parameters[name] for name in names}
    if document.get("contacts") is not None:
        values.update(_OF_CONTACTS.pairs(document, of))
        if values["contacts"] < 0:
            raise ValueError(f"contacts {of}")


def varying(states: Iterable[Summary]) -> tuple[str, ...]:
    """The parameters besides the half-width that have more than one value, in the order of their table."""
    rows = {tuple(state.others.items()): state.others for state in states}.values()
    return tuple(name for name in PARAMETERS if len({row.get(name) for row in rows}) > 1)


def _of_contacts(contacts: Contacts | None) -> dict[str, Any]:
    """The fields of a summary that tell of contacts, None without forces."""
    if contacts is None:
        return dict.fromkeys(OF_CONTACTS)
    numbers = (contacts.total_force, contacts.gap, contacts.penetration)
    return dict(zip(OF_CONTACTS, (len(contacts), *map(_finite, map(float, numbers))), strict=True))


def _finite(value: float) -> float | None:
    """A number, None where it is none or beyond what a summary takes."""
    return value if abs(value) <= _LARGEST_FLOAT else None


def _kinds(document: dict[str, Any], events: tuple[str, ...], of: str) -> tuple[str, ...]:
    """The kinds of a summary's events, which earlier formats lack. Raises ValueError unless each has one."""
    kinds = document.get("event_kinds") if "event_kinds" in document else list(kinds_of(events))
    if not isinstance(kinds, list) or not are_texts(kinds) or len(kinds) != len(events):
        raise ValueError(f"event_kinds {of}")
    return tuple(kinds)


def _plain(record: object, item: Item) -> Any:
    """A field in Python's own types; what is not a number is None."""
    value = getattr(record, item.field)
    if value is None or item.dtype == "utf-8":
        return value
    if item.dtype == "float64":
        return _finite(float(value))
    return int(value) if item.dtype == "int64" else bool(value)


def are_texts(values: list[Any]) -> bool:
    """Whether all values of a list are texts."""
    return not values or all(isinstance(text, str) for text in values)


def is_label(value: Any) -> bool:
    """Whether a value can be a state's label."""
    return isinstance(value, int) and not isinstance(value, bool) and 0 < value < LABELS

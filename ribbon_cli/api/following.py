"""Branches: the request to follow a state, and the result."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from typing import TYPE_CHECKING

from ribbon_cli import api, study
from ribbon_cli.api.extras import extra
from ribbon_cli.config import CONTACT_KINDS, FORCES, STOPS, Arclength, ContactRequest
from ribbon_cli.errors import UsageError
from ribbon_cli.expression import ExpressionError, evaluate
from ribbon_cli.pages import html
from ribbon_cli.pages.columns import OF_STATES, contact, listing
from ribbon_cli.parts import HALF_WIDTH, PARAMETERS
from ribbon_cli.store import suggest
from ribbon_cli.text import visible

if TYPE_CHECKING:
    from pandas import DataFrame


def request(
    to: float,
    arclength: bool = False,
    back_to: float | None = None,
    both: bool = False,
    at: Sequence[float] = (),
    stop_at: Sequence[str] = (),
    max_step: float | None = None,
    steps: int | None = None,
    switch: int | None = None,
    in_: str | None = None,
) -> Arclength:
    """The request of `ribbon continue`. Raises UsageError for options that exclude each other."""
    name = HALF_WIDTH if in_ in (None, "b") else str(in_)
    if name not in PARAMETERS:
        raise UsageError(f"--in: no parameter {name!r}{suggest(name, PARAMETERS)}")
    for option, value in (("--to", to), ("--back-to", back_to), *(("--at", value) for value in at)):
        if name == HALF_WIDTH and value is not None and not value > 0.0:
            raise UsageError(f"{option}: must be > 0, the half-width, got {value:g}")
    for option, value in (("--max-step", max_step), ("--steps", steps)):
        if value is not None and not 0 < value < math.inf:
            raise UsageError(f"{option}: must be positive, got {value:g}")
    own = {"--back-to": back_to, "--both": both, "--max-step": max_step, "--steps": steps, "--switch": switch}
    given = [option for option, value in own.items() if value]
    if not arclength and given:
        raise UsageError(f"{given[0]} needs --arclength")
    for word in stop_at:
        if word not in STOPS:
            known = f"known: {', '.join(STOPS)}"
            raise UsageError(f"no event {word!r} to stop at ({known}){suggest(word, STOPS)}")
    if not arclength and {"fold", "stability-lost"} & set(stop_at):
        raise UsageError("--stop-at fold and --stop-at stability-lost need --arclength")
    if both and back_to is None:
        what = "half-width" if name == HALF_WIDTH else name
        raise UsageError(f"--both needs --back-to B, the {what} to go to the other way")
    default = Arclength(to)
    return Arclength(
        to=to,
        back_to=back_to,
        both=both,
        at=tuple(at),
        max_step=max_step or default.max_step,
        steps=steps or default.steps,
        stop_at=tuple(word for word in STOPS if word in stop_at),
        switch=switch or 0,
        parameter=name,
    )


def contact_request(asked: str | None) -> ContactRequest | None:
    """What `ribbon continue --contact` asks for: `forces`, `gap=0.02` or `record`. Raises UsageError."""
    if asked is None:
        return None
    kinds = tuple(kind for kind in CONTACT_KINDS if kind != "stop")
    if asked in kinds:
        return ContactRequest(asked)
    name, equals, text = asked.partition("=")
    if name != "gap" or not equals:
        known = ("forces", "gap=0.02", "record")
        raise UsageError(f"--contact: must be {', '.join(known)}, got {asked!r}{suggest(asked, kinds)}")
    try:
        gap = evaluate(text)
    except ExpressionError as error:
        raise UsageError(f"--contact: gap must be a number such as 0.02, got {text!r} ({error})") from error
    if gap < 0.0:
        raise UsageError(f"--contact: gap must be at least 0, got {gap:g}")
    return ContactRequest(FORCES, abs(gap))


@dataclass(frozen=True, eq=False, repr=False)
class Followed:
    """The branches that were followed from a state, and the run that they are in.

    `outcome` holds their points and ends as `ribbon continue --json` tells them.
    """

    run: api.OpenRun
    outcome: study.Outcome

    @property
    def branches(self) -> tuple[study.Course, ...]:
        """Each branch with its points, and why and where it ends."""
        return self.outcome.branches

    @property
    def states(self) -> tuple[api.OpenState, ...]:
        """The states at the first branch's points, in order; their files are read."""
        return tuple(self.run.state(point.label) for point in self.branches[0].points)

    def table(self) -> DataFrame:
        """A row a point: branch, label, b, energy, index, contact and so on. Raises ImportError without
        pandas.
        """
        pandas = extra("pandas", "followed.table()")
        rows = [{"branch": c.name} | asdict(point) for c in self.branches for point in c.points]
        table = pandas.DataFrame(
            rows, columns=["branch", *(field.name for field in fields(study.outcome.CoursePoint))]
        )
        for name in ("negative_eigenvalues", "index_before", "index_after"):
            table[name] = table[name].astype("Int64")
        numbers = ("lowest_eigenvalue", "sliding_overlap", "linking_number", "clearance", "arclength")
        return table.astype(dict.fromkeys(("half_width", "energy", *numbers), "float64"))

    def _lines(self) -> list[str]:
        """A line on each branch."""
        lines = []
        for c in self.branches:
            points = f"{len(c.points)} point{'s' * (len(c.points) != 1)}{_contacts(c)}"
            lines.append(f"{c.name}: {points}, ends at {c.place} ({c.reason}): {c.message}")
        return lines

    def __repr__(self) -> str:
        return visible(f"<followed in {self.run.name}: {'; '.join(self._lines())}>")

    def _repr_html_(self) -> str:
        parts = []
        for line, course in zip(self._lines(), self.branches, strict=True):
            parts += [html.paragraph(line), listing(_POINTS, course.points)]
        return "".join(parts)


_POINTS = {
    "label": OF_STATES["label"],
    "type": lambda point: point.type,
    **{name: OF_STATES[name] for name in ("b", "E", "status")},
    "negative eigenvalues": lambda point: "–" if (k := point.negative_eigenvalues) is None else str(k),
    "self-contact": contact,
}


def _contacts(course: study.Course) -> str:
    """A note on the points of a branch at which the band meets itself."""
    meeting = sum(point.self_contact and point.contacts is None for point in course.points)
    return f" ({meeting} of them in self-contact without forces)" if meeting else ""

"""Why a stage was not reached, as a value: how the solve ended, where, and the sentence that follows from it.

The sentences of statuses are stored with states, which are never changed; what is advised here may be.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from ..parts import HALF_WIDTH, PARAMETERS
from ..store import Summary
from .plan import place_name

if TYPE_CHECKING:  # a finished run does without the solver
    from ..solver.status import Status
    from .walk import Ended

_MORE = "Take {}more segments N (`segments`), or another recipe or state to start from"
_RESTS = "with `contact: forces` a band rests on itself and does not pass through"
_REMEDIES = {
    **dict.fromkeys(("other-shape", "stalled", "iteration-limit", "not-finite"), f"{_MORE}."),
    **dict.fromkeys(("gap-lost", "no-rest"), f"{_MORE}."),
    "left-topology": f"{_MORE}; {_RESTS}.",
    "left-branch": "Take {}or follow the branch by arclength.",
    "inverted-facet": "Take more segments N, or a narrower band.",
    "saddle": f"Another N may have a minimum; {_RESTS}. "
    "`widths: {{arclength: ...}}` goes on along saddles.",
    "undecided": "`ribbon spectrum` shows the mode in question; another N may decide.",
}
"""What to do about a solve that ended so, by the word of its status."""
_SENTENCES = {
    "solve": "{stage}: {message}",
    "state": "{stage}: {said}",
    "refinement": "{stage}: {message}: take more or fewer segments",
    "construction": "{stage}: {message}",
    "located": "{stage}: not located, at {symbol} = {end:.12g}: {message}",
    "step": "a step from {here} to {there} failed: {message}",
    "way": "no step from {here} towards {there} succeeds. {message}",
    "turn": "no step from {turn} {start:.10g}/{count} succeeds: {message}",
    "other-branch": "every step from {symbol} = {start:.12g} towards {symbol} = {end:.12g} leads to another "
    "branch, and nothing stored tells of a fold: natural continuation ends, its last state is {label}; "
    "`ribbon continue {state} {option}--to {end:.12g} --arclength`, or `{config}` in a config, follows the "
    "branch itself{soft}",
    "fold": "the branch seems to turn back (fold) near {symbol} = {near:.6g}: natural continuation towards "
    "{symbol} = {end:.12g} ends, its last state is {label} at {symbol} = {start:.12g}; `ribbon continue "
    "{state} {option}--to {end:.12g} --arclength`, or `{config}` in a config, continues around it",
}
"""Kinds of failures with their sentences; `message` is the status's, with its detail."""
CHECKERBOARDS = (
    "the softest modes stored are checkerboards, which belong to the mesh and which "
    "`discretisation: value-average` does not have"
)
"""What is said of a state of the rule `thesis` from which steps end on other branches."""


@dataclass(frozen=True)
class Failure:
    """A stage that was not reached: its kind, with the numbers of its sentence in `values`, and its status.

    `status` is None where nothing was solved, and `detail` then the whole message. `smaller` says where
    smaller steps are had, None where there are none. `attempt` is the end of the solve where it is of use.
    """

    kind: str
    status: Status | None
    detail: str
    values: Mapping[str, Any] = field(default_factory=dict)
    smaller: str | None = ""
    attempt: Ended | None = field(default=None, compare=False, repr=False)

    @property
    def message(self) -> str:
        """How the solve ended."""
        return self.detail if self.status is None else f"{self.status.sentence} {self.detail}".strip()

    @property
    def bare(self) -> str:
        """What failed and how, without advice."""
        return _SENTENCES[self.kind].format(message=self.message, **self.values)

    @property
    def sentence(self) -> str:
        """What failed, how, and what to do about it."""
        remedy = None if self.status is None else _REMEDIES.get(self.status.value)
        if remedy is None or self.kind in ("fold", "other-branch", "located"):
            return self.bare
        where = f" ({self.smaller})" if self.smaller else ""
        return f"{self.bare} {remedy.format('' if self.smaller is None else f'smaller steps{where}, ')}"


def way_facts(here: Mapping[str, float | None], target: Mapping[str, float]) -> dict[str, Any]:
    """The values of a failed step from a place to a target: `start` and `end` of the parameter that moves
    first, and both places in words."""
    first = next(iter(target))
    start = {name: here[name] or 0.0 for name in target}
    there = place_name(target)
    if len(target) == 1:
        there = there.partition(" = ")[2]
    return {"start": start[first], "end": target[first], "here": place_name(start), "there": there}


def halved_kind(target: Mapping[str, float]) -> str:
    """The kind of event that tells of a step to a target that was halved, without its last word."""
    return "width" if tuple(target) == (HALF_WIDTH,) else "step"


def fold_facts(
    run: str, current: Summary, name: str, start: float, end: float, beyond: float, soft: bool = False
) -> dict[str, Any]:
    """The values of a way that ends between a state and a value of a parameter at which another branch was
    met; `soft` says that the state's softest modes are checkerboards."""
    width = name == HALF_WIDTH
    config = f"widths: {{arclength: {{to: {end:.12g}}}}}"
    if not width:
        config = f"schedule: [{{arclength: {{parameter: {name}, to: {end:.12g}}}}}]"
    return {
        "near": 0.5 * (start + beyond),
        "start": start,
        "end": end,
        "label": current.label,
        "state": f"{run}:{current.label}",
        "symbol": PARAMETERS[name].symbol,
        "option": "" if width else f"--in {name} ",
        "config": config,
        "soft": f"; {CHECKERBOARDS}" if soft else "",
    }


def failure_of(state: Summary, stage: str, smaller: str | None = "") -> Failure:
    """A state that was stored without a certificate, as the failure of its stage."""
    from ..solver.status import Status

    return Failure("state", Status(state.status), "", {"stage": stage, "said": state.message}, smaller)

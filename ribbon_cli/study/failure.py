"""Why a stage was not reached, as a value: how the solve ended, where, and the sentence that follows from it.

The sentences of statuses are stored with states, which are never changed; what is advised here may be.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from ..store import Summary

if TYPE_CHECKING:  # a finished run does without the solver
    from ..solver.status import Status
    from .walk import Ended

_MORE = "more segments N (`segments`), or another recipe or state to start from"
_REMEDIES = {
    "left-topology": f"Take smaller steps{{}}, {_MORE}.",
    "other-shape": f"Take smaller steps{{}}, {_MORE}.",
    "stalled": f"Take smaller steps{{}}, {_MORE}.",
    "iteration-limit": f"Take smaller steps{{}}, {_MORE}.",
    "not-finite": f"Take smaller steps{{}}, {_MORE}.",
    "left-branch": "Take smaller steps{}, or follow the branch by arclength.",
    "inverted-facet": "Take more segments N, or a narrower band.",
    "saddle": "Another N may have a minimum; `widths: {{arclength: ...}}` goes on along saddles.",
    "undecided": "`ribbon spectrum` shows the mode in question; another N may decide.",
}
"""What to do about a solve that ended so, by the word of its status."""
_SENTENCES = {
    "solve": "{stage}: {message}",
    "state": "{stage}: {said}",
    "refinement": "{stage}: {message}: take more or fewer segments",
    "construction": "{stage}: {message}",
    "located": "{stage}: not located, at b = {end:.12g}: {message}",
    "step": "a step from b = {start:.12g} to {end:.12g} failed: {message}",
    "width": "no step from b = {start:.12g} towards {end:.12g} succeeds. {message}",
    "turn": "no step from {turn} {start:.10g}/{count} succeeds: {message}",
    "fold": "the branch seems to turn back (fold) near b = {near:.6g}: natural continuation towards "
    "b = {end:.12g} ends, its last state is {label} at b = {start:.12g}; `ribbon continue {state} --to "
    "{end:.12g} --arclength`, or `widths: {{arclength: {{to: {end:.12g}}}}}` in a config, goes on around it",
}
"""Kinds of failures with their sentences; `message` is the status's, with its detail."""


@dataclass(frozen=True)
class Failure:
    """A stage that was not reached: its kind, with the numbers of its sentence in `values`, and its status.

    `status` is None where nothing was solved, and `detail` then the whole message. `smaller` says where
    smaller steps are had. `attempt` is the end of the solve where it is of use.
    """

    kind: str
    status: Status | None
    detail: str
    values: Mapping[str, Any] = field(default_factory=dict)
    smaller: str = ""
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
        if remedy is None or self.kind in ("fold", "located"):
            return self.bare
        return f"{self.bare} {remedy.format(f' ({self.smaller})' if self.smaller else '')}"


def failure_of(state: Summary, stage: str, smaller: str = "") -> Failure:
    """A state that was stored without a certificate, as the failure of its stage."""
    from ..solver.status import Status

    return Failure("state", Status(state.status), "", {"stage": stage, "said": state.message}, smaller)

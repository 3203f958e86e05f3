"""`ribbon compare`: two states or two runs, field by field."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import click

from ribbon_cli import api, report, store, verify
from ribbon_cli.cli.completion import complete_any
from ribbon_cli.cli.output import emit, emit_json, say, teller
from ribbon_cli.cli.render import MISSING, columns, energy, number
from ribbon_cli.cli.settings import Settings, common_options, pass_settings
from ribbon_cli.errors import TargetError, UsageError

_LONGEST = 40


exact_option = click.option(
    "--exact", is_flag=True, help="Require equal bytes: `same to rounding` then gives exit code 3, too."
)


@click.command()
@click.argument("first", metavar="REF", shell_complete=complete_any)
@click.argument("second", metavar="REF", shell_complete=complete_any)
@exact_option
@common_options
@pass_settings
def compare(settings: Settings, first: str, second: str, exact: bool) -> int:
    """Compare two states or two runs.

    For two states, the fields that differ are listed, arrays with their largest difference. For two runs,
    the states of equal stages are compared. The answer is `identical` (all that was computed agrees to the
    last bit), `same to rounding` with the largest relative difference, or `different` (exit code 3).
    """
    kinds = {store.names_state(first), store.names_state(second)}
    if len(kinds) > 1:
        raise UsageError("compare: name two states or two runs, not one of each")
    return (_states if kinds == {True} else _runs)(settings, first, second, exact)


def _states(settings: Settings, first: str, second: str, exact: bool) -> int:
    one, two = (api.open_state(ref, settings.runs, teller(settings))[1] for ref in (first, second))
    pairs, judgement = report.comparison.compare_states(one, two), verify.judge(one, two)
    if settings.json:
        document = {"first": first, "second": second, "equal": judgement.answer == "identical"}
        emit_json(document | asdict(judgement) | {"fields": [asdict(pair) for pair in pairs]})
    else:
        differing = [pair for pair in pairs if not pair.equal]
        if differing:
            emit(_fields_table(differing))
        say(settings, f"{len(pairs) - len(differing)} of {len(pairs)} fields are equal")
    return answer(settings, judgement, exact)


def _runs(settings: Settings, first: str, second: str, exact: bool) -> int:
    one, two = store.find_run(settings.root, first), store.find_run(settings.root, second)
    pairs = verify.judge_runs(one, two)
    if settings.json:
        document = {"first": one.name, "second": two.name, "equal": all(pair.equal for pair in pairs)}
        emit_json(document | pairs_answer(pairs) | {"states": list(map(pair_document, pairs))})
    else:
        emit(pairs_table(pairs))
        say(settings, f"{sum(pair.equal for pair in pairs)} of {len(pairs)} states are equal")
    return answer_of_pairs(settings, pairs, exact)


def answer(settings: Settings, judgement: report.comparison.Judgement, exact: bool, where: str = "") -> int:
    """Print one of the three answers with its reason, except for JSON; return the exit code."""
    if not settings.json:
        emit(f"{judgement.answer}{_reason(judgement, where)}")
    good = ("identical",) if exact else ("identical", "same to rounding")
    return 0 if judgement.answer in good else TargetError.exit_code


def answer_of_pairs(settings: Settings, pairs: Sequence[report.comparison.StatePair], exact: bool) -> int:
    """The same of two runs."""
    judgement, pair = report.comparison.decided(pairs)
    where = pair.stage if pair else ""
    if pair and None in (pair.first, pair.second):
        where += " is in only one of them"
    return answer(settings, judgement, exact, where)


def _reason(judgement: report.comparison.Judgement, where: str) -> str:
    """The reason of an answer: the largest relative difference and its place, or a fact that differs."""
    largest, path = judgement.largest_relative_difference, judgement.largest_in
    if judgement.answer == "identical":
        return ""
    if path is None:
        return f" ({where})"
    place = f"{path} of {where}" if where else path
    image = f"; the second is an image of the first, {judgement.image}" if judgement.image else ""
    if largest is None:
        return f" (in {place})"
    return f" (largest relative difference {largest:.1e}, in {place}{image})"


def pairs_answer(pairs: Sequence[report.comparison.StatePair]) -> dict[str, Any]:
    """The answer of two runs for a program, with the stage that decides it."""
    judgement, pair = report.comparison.decided(pairs)
    return asdict(judgement) | {"largest_in_stage": pair.stage if pair else None}


def pair_document(pair: report.comparison.StatePair) -> dict[str, Any]:
    """A pair of states for a program, its judgement among its own keys."""
    return {key: value for key, value in asdict(pair).items() if key != "judgement"} | asdict(pair.judgement)


def pairs_table(pairs: Sequence[report.comparison.StatePair]) -> str:
    """States of two runs side by side."""
    rows = []
    for pair in pairs:
        one, two = pair.energies
        apart = None if one is None or two is None else two - one
        answer = pair.judgement.answer + (" (image)" if pair.judgement.image else "")
        labels = [number(pair.first), number(pair.second)]
        rows.append([pair.stage, *labels, energy(one), energy(two), number(apart, ".1e"), answer])
    return columns(["stage", "label", "label'", "E", "E'", "E' - E", "answer"], rows)


def _fields_table(pairs: Sequence[report.comparison.FieldPair]) -> str:
    """Fields that differ."""
    rows = [
        [pair.path, _brief(pair.first), _brief(pair.second), number(pair.difference, ".3g")] for pair in pairs
    ]
    return columns(["field", "first", "second", "difference"], rows)


def _brief(value: Any) -> str:
    """A value on one short line; of an array its shape."""
    if value is None:
        return MISSING
    text = " ".join((f"{value:.10g}" if isinstance(value, float) else str(value)).split())
    return text if len(text) <= _LONGEST else text[: _LONGEST - 3] + "..."

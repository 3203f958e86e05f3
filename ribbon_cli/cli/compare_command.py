"""`ribbon compare`: two states or two runs, field by field."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import click

from ribbon_cli.cli.completion import complete_any
from ribbon_cli.cli.output import emit, emit_json, say, teller
from ribbon_cli.cli.settings import Settings, common_options, pass_settings
from ribbon_cli.errors import UsageError

if TYPE_CHECKING:
    from ribbon_cli.report.comparison import FieldPair, StatePair

_LONGEST = 40


@click.command()
@click.argument("first", metavar="REF", shell_complete=complete_any)
@click.argument("second", metavar="REF", shell_complete=complete_any)
@common_options
@pass_settings
def compare(settings: Settings, first: str, second: str) -> None:
    """Compare two states or two runs.

    Of states, what differs is listed, arrays with their largest difference; of runs, the states that ended
    the same stages. Equal means to the last bit.
    """
    from ribbon_cli.store import names_state

    kinds = {names_state(first), names_state(second)}
    if len(kinds) > 1:
        raise UsageError("compare: name two states or two runs, not one of each")
    if kinds == {True}:
        _states(settings, first, second)
    else:
        _runs(settings, first, second)


def _states(settings: Settings, first: str, second: str) -> None:
    from ribbon_cli.api import open_state
    from ribbon_cli.report.comparison import compare_states, same_science

    one, two = (open_state(ref, settings.runs, teller(settings))[1] for ref in (first, second))
    pairs = compare_states(one, two)
    differing = [pair for pair in pairs if not pair.equal]
    if settings.json:
        document = {"first": first, "second": second, "equal": same_science(pairs)}
        emit_json(document | {"fields": [asdict(pair) for pair in pairs]})
        return
    if differing:
        emit(_fields_table(differing))
    verdict = "all that was computed is equal" if same_science(pairs) else "they differ"
    say(settings, f"{len(pairs) - len(differing)} of {len(pairs)} fields are equal: {verdict}")


def _runs(settings: Settings, first: str, second: str) -> None:
    from ribbon_cli.report.comparison import compare_runs
    from ribbon_cli.store import find_run

    one, two = find_run(settings.root, first), find_run(settings.root, second)
    pairs = compare_runs(one, two)
    if settings.json:
        document = {"first": one.name, "second": two.name, "equal": all(pair.equal for pair in pairs)}
        emit_json(document | {"states": [asdict(pair) for pair in pairs]})
        return
    emit(pairs_table(pairs))
    say(settings, f"{sum(pair.equal for pair in pairs)} of {len(pairs)} states are equal")


def pairs_table(pairs: Sequence[StatePair]) -> str:
    """States of two runs side by side."""
    from ribbon_cli.cli.render import MISSING, columns, number

    rows = []
    for pair in pairs:
        one, two = pair.energies
        apart = None if one is None or two is None else two - one
        rows.append(
            [
                pair.stage,
                number(pair.first),
                number(pair.second),
                number(one, ".9f"),
                number(two, ".9f"),
                MISSING if apart is None else f"{apart:.1e}",
                "yes" if pair.equal else "no",
            ]
        )
    return columns(["stage", "label", "label'", "E", "E'", "E' - E", "equal"], rows)


def _fields_table(pairs: Sequence[FieldPair]) -> str:
    """Fields that differ."""
    from ribbon_cli.cli.render import MISSING, columns

    rows = [
        [
            pair.path,
            _brief(pair.first),
            _brief(pair.second),
            MISSING if pair.difference is None else f"{pair.difference:.3g}",
        ]
        for pair in pairs
    ]
    return columns(["field", "first", "second", "difference"], rows)


def _brief(value: Any) -> str:
    """A value on one short line; of an array its shape."""
    from ribbon_cli.cli.render import MISSING

    if value is None:
        return MISSING
    text = " ".join((f"{value:.10g}" if isinstance(value, float) else str(value)).split())
    return text if len(text) <= _LONGEST else text[: _LONGEST - 3] + "..."

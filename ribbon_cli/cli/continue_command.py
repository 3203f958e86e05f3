"""`ribbon continue`: from a stored state to other widths, or in another parameter."""

from __future__ import annotations

from typing import Any

import click

from ribbon_cli import api, store, study
from ribbon_cli.cli.completion import complete_contact, complete_parameter, complete_state
from ribbon_cli.cli.numbers import finite, positive, several, whole
from ribbon_cli.cli.progress import progress
from ribbon_cli.cli.render import branch_text
from ribbon_cli.cli.settings import Settings, common_options, pass_settings
from ribbon_cli.cli.solve_commands import conclude

_STOPS = ("fold", "stability-lost", "contact")


@click.command("continue")
@click.argument("state", shell_complete=complete_state)
@click.option("--in", "in_", metavar="NAME", shell_complete=complete_parameter, help="Parameter to move (b).")
@click.option(
    "--to",
    metavar="B",
    required=True,
    callback=finite,
    help="Half-width, or value of the parameter, to go to.",
)
@click.option("--arclength", is_flag=True, help="Follow the branch itself, around folds.")
@click.option("--back-to", metavar="B", callback=finite, help="Other end of the range.")
@click.option("--both", is_flag=True, help="Follow the branch in both directions, to --to and to --back-to.")
@click.option(
    "--at", metavar="B", multiple=True, callback=several, help="Compute a state at exactly this value."
)
@click.option("--stop-at", type=click.Choice(_STOPS), multiple=True, help="Stop at the first such event.")
@click.option("--max-step", metavar="S", callback=positive, help="Longest step along the branch (0.1).")
@click.option("--steps", metavar="K", callback=whole(1), help="Largest number of steps (500).")
@click.option(
    "--switch",
    metavar="K",
    callback=whole(0),
    help="Also follow branches that cross this one, to the depth K.",
)
@click.option(
    "--contact",
    metavar="KIND",
    shell_complete=complete_contact,
    help="forces, or gap=G: let the band rest on itself, its facets at least G apart.",
)
@common_options
@pass_settings
def continue_(settings: Settings, /, state: str, contact: str | None, **asked: Any) -> int:
    """Continue a stored STATE in width or in another parameter.

    The results are added to its run. With --in, as in --in twist --to pi, B is a value of that parameter.

    With --contact the band may come to rest on itself; without it, contact is as at STATE.

    The same command resumes. Without --arclength, each value is reached from the one before, and the
    continuation ends at the first fold. Unstable points on a branch are not failures; the exit code is 3 if
    even the shortest step fails, or if no branch met a value of --at and no event ended one.
    """
    wanted, forces = api.following.request(**asked), api.following.contact_request(contact)
    settings.commits = True
    study.hold_memory()
    with progress(settings) as shown:
        outcome = study.continue_state(
            settings.root,
            state,
            wanted,
            natural=not asked["arclength"],
            contact=forces,
            progress=shown,
            argv=settings.argv,
        )
    first: study.Course = outcome.branches[0]

    def document() -> dict[str, Any]:
        end = {"reason": first.reason, "half_width": first.half_width, "message": first.message}
        if first.value is not None:
            end |= {"parameter": first.parameter, "value": first.value}
        return {"points": [point.to_dict() for point in first.points], "end": end}

    def text() -> str:
        return "\n\n".join(map(branch_text, outcome.branches))

    more = f"`ribbon show {store.typed(outcome.run)}` shows its branches"
    return conclude(settings, outcome, document, text, more, outcome.failures)

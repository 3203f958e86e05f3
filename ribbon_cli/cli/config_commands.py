"""`ribbon init`, `ribbon check` and `ribbon schema`: configs before anything is solved."""

from __future__ import annotations

import os
from dataclasses import asdict

import click

from ribbon_cli import config as configs
from ribbon_cli import store, study
from ribbon_cli.api.targets import check_target
from ribbon_cli.cli.completion import complete_file, complete_template
from ribbon_cli.cli.output import emit, emit_json, json_text, say, teller
from ribbon_cli.cli.render import plan_table
from ribbon_cli.cli.settings import Settings, common_options, pass_settings
from ribbon_cli.digits import duration
from ribbon_cli.errors import UsageError

_DEFAULT_TEMPLATE = "mobius-pi"


@click.command()
@click.argument("template", default=_DEFAULT_TEMPLATE, shell_complete=complete_template)
@click.option("-o", "--output", metavar="PATH", shell_complete=complete_file, help="Default: TEMPLATE.yaml.")
@click.option("--list", "listing", is_flag=True, help="List the templates and write nothing.")
@common_options
@pass_settings
def init(settings: Settings, template: str, output: str | None, listing: bool) -> None:
    """Write a commented config to start from.

    TEMPLATE is mobius-pi by default; --list lists the templates. The run is named after the file.
    """
    known = configs.templates()
    if listing:
        width = max(map(len, known))
        lines = (f"{name:{width}}  {configs.about_template(text)}" for name, text in known.items())
        emit_json(list(known)) if settings.json else emit("\n".join(lines))
        return
    if template not in known:
        hint = store.suggest(template, known) or f": there are {', '.join(known)}"
        raise UsageError(f"no template {template!r}{hint}")
    path = output or f"{template}.yaml"
    check_target(path, overwrite=False, hint="choose another with -o")
    stem = os.path.splitext(os.path.basename(path))[0]
    store.write_atomic(path, configs.template(template, stem).encode())
    emit_json({"path": path, "template": template}) if settings.json else emit(path)
    say(settings, f"written; `ribbon check {path}` shows what it will do")
    beside = os.path.join(os.path.dirname(path), configs.SCHEMA_FILE)
    if not os.path.lexists(beside):
        say(settings, f"`ribbon schema -o {beside}` lets editors check and complete it")


@click.command()
@click.option("-o", "--output", metavar="PATH", shell_complete=complete_file, help="Write to a file.")
@click.option("--overwrite", is_flag=True, help="Replace a file that exists.")
@common_options
@pass_settings
def schema(settings: Settings, output: str | None, overwrite: bool) -> None:
    """Print the JSON Schema of configs, for editors.

    Templates name the file ribbon.schema.json beside them in their first line, which VS Code, Neovim and
    other editors with yaml-language-server read:

    \b
      ribbon schema -o ribbon.schema.json
    """
    if output is None:
        emit_json(configs.schema())
        return
    check_target(output, overwrite)
    store.write_atomic(output, json_text(configs.schema()).encode(), overwrite=overwrite)
    emit_json({"path": output}) if settings.json else emit(output)


@click.command()
@click.argument("config", shell_complete=complete_file)
@common_options
@pass_settings
def check(settings: Settings, config: str) -> None:
    """Validate CONFIG; print its stages and their cost."""
    try:
        loaded = configs.load_config(config)
    except configs.ConfigError as error:
        if settings.json:
            problems = [
                {"line": found.line, "column": found.column, "field": found.field, "message": found.message}
                for found in error.mistakes
            ]
            emit_json({"valid": False, "path": config, "problems": problems})
        raise
    _show_plan(settings, loaded)


def _show_plan(settings: Settings, config: configs.Config) -> None:
    """Print what `ribbon solve` will do with a config."""
    band = study.given_band(config, settings.root, teller(settings))
    plan = study.plan_of(config, None if band is None else (band.half_width, band.segments))
    run, notes = f"{config.name}-{config.hash8()}", [*plan.notes, *_on_contact(config.contact)]
    if settings.json:
        document = {
            "valid": True,
            "path": config.path,
            "run": run,
            "config": config.resolved(),
            "stages": [asdict(stage) for stage in plan.stages],
            "cost_seconds": plan.cost,
            "notes": notes,
        }
        emit_json(document)
        return
    emit(
        f"{config.path}: valid, run {run}\n\n{plan_table(plan.stages, settings.verbose)}\n\n"
        f"{len(plan.stages)} stage{'s' * (len(plan.stages) != 1)}, about {duration(plan.cost)} on one core"
    )
    for note in notes:
        say(settings, note)


def _on_contact(contact: configs.ContactRequest) -> list[str]:
    """A note where contact forces are on."""
    if not contact.forces:
        return []
    apart = f"at least {contact.gap:.10g} apart" if contact.gap else "which may touch (a gap of 0)"
    return [f"contact forces are on: the band may rest on itself, with facets {apart}"]

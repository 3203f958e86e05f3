"""In the rooms above the store no mapping by strings stands for a record: what is left, and why."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import ribbon_cli

PACKAGE = Path(ribbon_cli.__file__).parent
ROOMS = ("study", "analysis", "verify", "report", "plot", "export", "cli")
MAPPINGS = {"dict", "Mapping", "MutableMapping", "defaultdict", "OrderedDict", "Counter", "TypedDict"}

REASONS = {
    "names of stages, branches, causes or labels of lines": """
        study.branch._numbered study.branch_tables.courses study.journal.Journal.__init__ plot.branches._names
        plot.branches.arclength_figure plot.kinds._followed plot.levels._entries export.series.courses
        study.status.Standing study.status._targets study.status._counts study.status._ends
        study.status._planned report.spectra._reasons cli.render.history_lines cli.render.gathered
        cli.render.counts_text""",
    "provenance: facts by name, of this version and of others": """
        study.clock study.clock.Clock study.clock.Clock.facts study.journal.Journal.__init__
        study.walk.Walk.__init__""",
    "settings by their path, of configs of any version": """
        study.config_changes._settings study.config_changes._flat study.config_changes._differences""",
    "the numbers that a sentence names": """
        study.failure.Failure study.failure.fold_facts study.failure.way_facts""",
    "fields of a record by name, whichever they are": """
        verify.recompute._closed_up verify.recompute._compare""",
    "arrays or quantities by name, whichever they are": """
        analysis.continuum._Measure._zones analysis.stability.arrays_of report.continuum.state_text
        export.gltf._fields export.mesh.node_fields export.mesh.facet_fields export.vtkhdf._Step
        export.vtkhdf._step""",
    "symmetries by name": "analysis.stability._characters report.spectra.Mode",
    "columns of a table by name": """
        report.tables.records report.tables._record report.tables.csv_text report.rows report.rows.Rows
        report.rows.records report.where._Reader.__init__ report.where._Reader._side report.where.condition
        report.where.Condition.__call__ plot.fields._column plot.fields._goes_with plot.fields._rank
        plot.fields.curves export.text.csv_bytes
        export.text._end_row""",
    "values of parameters, of those that a problem has or that a leg moves": """
        report.tables._nested study.failure.halved_kind study.outcome.CoursePoint study.plan.Goal
        study.plan.Goal.distance study.plan.Goal.holds study.plan.Goal.reached study.plan.Goal.ways
        study.plan.PlannedStage study.plan._stage study.plan._stays study.plan.goals study.plan.place_name
        study.solve._Study._levels study.solve._Study._missed study.solve._Study._words study.solve._known
        plot.kinds._one_parameter plot.levels.PlacedAt plot.labels.parameter_column
        plot.labels.Placed.parameters study.stepping._stage study.stepping.moved study.stepping.step_to
        study.walk.Stage study.stepping.step_from study.resting.step study.resting._chosen
        study.resting._ended study.resting.changes study.touch_down._Way study.touch_down._Way.at
        analysis.stability._others report.spectra.StateSpectrum""",
    "functions by the name that a user gives": "report.tables plot.kinds",
    "keywords and settings of matplotlib": """
        plot.canvas.Figure._repr_png_ plot.curves._formulas plot.figure.image plot.levels._mark
        plot.runs.runs_figure plot.style.styled plot.style.marked_look plot.style.line_look
        plot.style.branch_look plot.style._look""",
    "attributes of an SVG element": "export.sheet.Line",
    "JSON of formats that others define": """
        export.fold.fold_bytes export.fold._faces export.fold._edges export.fold._seam export.fold._ends
        export.gltf._layout""",
    "JSON, made of records where it is written": """
        study.status.Standing.to_dict study.outcome.CoursePoint.to_dict study.outcome.Course.to_dict
        report.spectra.Told.document export.viewer._state
        report.spectra.StateSpectrum.document report.spectra.RunSpectra.document
        report.spectra.SpectralTable.document
        cli.compare_command.pairs_answer cli.compare_command.pair_document
        cli.continuum_command._show_state cli.continuum_command._show_run cli.plot_command._mode_document
        cli.solve_commands.conclude cli.solve_commands.report.document
        cli.continue_command.continue_.document cli.store_commands._contact_pairs cli.store_commands._spectra
        cli.verify_command.document""",
    "names and values of JSON, as lines": "cli.render.listing cli.render._listing_lines",
}


def test_no_mapping_stands_for_a_record() -> None:
    """A new one needs a reason here; what has known keys is a dataclass."""
    known = {name for names in REASONS.values() for name in names.split()}
    found = {
        name for room in ROOMS for path in sorted((PACKAGE / room).rglob("*.py")) for name in places(path)
    }
    assert found == known


def places(path: Path) -> Iterator[str]:
    """The functions, classes and modules whose annotations name a mapping by strings."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    known = {
        alias.asname or alias.name
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
        if alias.name in ALIASES.get((node.module or "").split(".")[-1], ())
    } | set(ALIASES.get(path.stem, ()))
    yield from _annotated(tree, f"{path.parent.name}.{path.stem}", known)


def _annotated(node: ast.AST, where: str, known: set[str]) -> Iterator[str]:
    for child in ast.iter_child_nodes(node):
        scope = isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef)
        here = f"{where}.{child.name}" if scope else where  # type: ignore[attr-defined]
        annotations: list[ast.expr | None] = []
        if isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef):
            arguments = child.args
            every = [*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs]
            annotations = [child.returns, *(argument.annotation for argument in every)]
        elif isinstance(child, ast.AnnAssign):
            annotations = [child.annotation]
        elif isinstance(child, ast.ClassDef):
            annotations = list(child.bases)
        elif isinstance(child, ast.Assign) and _named(child) in known:
            annotations = [child.value]
        if any(by_string(annotation, known) for annotation in annotations if annotation):
            yield here
        yield from _annotated(child, here, known)


def _named(node: ast.Assign) -> str:
    return node.targets[0].id if isinstance(node.targets[0], ast.Name) else ""


def by_string(annotation: ast.expr, known: set[str]) -> bool:
    """Whether a mapping by strings, or by anything, is part of an annotation."""
    for node in ast.walk(annotation):
        if isinstance(node, ast.Name) and (node.id in known or node.id == "TypedDict"):
            return True
        if isinstance(node, ast.Subscript) and ast.unparse(node.value).split(".")[-1] in MAPPINGS:
            key = node.slice.elts[0] if isinstance(node.slice, ast.Tuple) else node.slice
            if isinstance(key, ast.Name) and key.id in ("str", "Any", "object"):
                return True
    return False


def _aliases() -> dict[str, set[str]]:
    """The names by module that stand for such mappings in the whole package."""
    found: dict[str, set[str]] = {}
    for path in PACKAGE.rglob("*.py"):
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            plain = isinstance(node, ast.Assign) and isinstance(node.value, ast.Subscript | ast.BinOp)
            if plain and _named(node) and by_string(node.value, set()):  # type: ignore[union-attr, arg-type]
                found.setdefault(path.stem, set()).add(_named(node))  # type: ignore[arg-type]
    return found


ALIASES = _aliases()


def test_aliases_are_seen() -> None:
    assert {"clock": {"Origin"}, "provenance": {"Facts"}, "recipe": {"Settings"}} == ALIASES

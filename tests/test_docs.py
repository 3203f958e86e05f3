"""Every example in the documentation runs, and what it lists is what there is.

Blocks marked `sh` and `python` are executed page by page, in order, in one folder. A `text` block after one
is its output: blanks count once, and `...` stands for anything, on a line of its own for any lines. `yaml`
blocks are whole configs; one that begins with `# NAME.yaml` is written to that file. Lines that set a clone
up (`make`, `. .venv/bin/activate`) are checked and not run.
"""

from __future__ import annotations

import ast
import importlib
import os
import re
import subprocess
import sys
from dataclasses import dataclass, replace
from pathlib import Path

import command_pages
import pytest
from cli_support import environment

from paper.table import compare_with_thesis, texts, thesis_table
from ribbon_cli import errors, load_state
from ribbon_cli import open as open_run
from ribbon_cli.config import (
    RECIPES,
    SpectrumRequest,
    load_cluster,
    load_config,
    load_sweep,
    parse_config,
)
from ribbon_cli.config.table import CONFIG
from ribbon_cli.report.convergence import Entry
from ribbon_cli.solver.status import Status
from ribbon_cli.store.layout import BRANCH, CONTACTS, ENDS, LOADS, MATERIAL, SPECTRUM, STATE
from ribbon_cli.study import solve_config

ROOT = Path(__file__).parent.parent
TOP = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "CHANGELOG.md"]
PAGES = [*TOP, *sorted(ROOT.glob("docs/**/*.md"))]
BLOCK = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
LANGUAGES = {"sh", "python", "text", "yaml"}
SETUP = re.compile(r"make( [A-Z]+=\S+)* (?P<target>[a-z][a-z0-9.-]*)|\. \.venv/bin/activate")
TARGET = re.compile(r"^([a-z][a-z0-9.-]*):(?!=)", re.MULTILINE)


@dataclass(frozen=True)
class Block:
    language: str
    text: str
    line: int


def read(path: Path) -> str:
    return path.read_text(encoding="utf-8")


def blocks(path: Path) -> list[Block]:
    text = read(path)
    return [Block(m[1], m[2], text.count("\n", 0, m.start()) + 1) for m in BLOCK.finditer(text)]


def page_name(path: Path) -> str:
    return str(path.relative_to(ROOT))


REFERENCE = ROOT / "docs" / "reference"


# --- examples ---


@pytest.fixture
def shell(tmp_path: Path) -> dict[str, str]:
    """An environment in which `ribbon` is this interpreter's."""
    folder = tmp_path / "bin"
    folder.mkdir()
    script = folder / "ribbon"
    script.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m ribbon_cli "$@"\n', encoding="utf-8")
    script.chmod(0o755)
    path = os.pathsep.join([str(folder), os.environ["PATH"]])
    # Told that warnings are errors, pyparsing looks for faults in matplotlib's grammars.
    warnings = "error,ignore:::pyparsing"
    return environment(PATH=path, PYTHONPATH=str(ROOT), PYTHONWARNINGS=warnings, TERM="dumb")


def marks(page: Path) -> tuple[pytest.MarkDecorator, ...]:
    """Examples of pages that users meet first are in `make test`, the others' in `make test-docs`, but for
    the gallery of strips: it takes a third of their time, and is in `make test-long`.
    """
    if page.parent == ROOT:
        return ()
    return (pytest.mark.long if page.name == "strips-gallery.md" else pytest.mark.docs,)


@pytest.mark.parametrize(
    "page", [pytest.param(page, id=page_name(page), marks=marks(page)) for page in PAGES]
)
def test_the_examples_run(page: Path, tmp_path: Path, shell: dict[str, str]) -> None:
    folder = tmp_path / "work"
    folder.mkdir()
    (folder / "configs").symlink_to(ROOT / "configs")  # commands are given in the folder of the clone
    output: str | None = None
    for block in blocks(page):
        where = f"{page_name(page)}:{block.line}"
        assert block.language in LANGUAGES, f"{where}: block marked {block.language!r}"
        if block.language == "yaml":
            write_config(block.text, folder)
        elif block.language == "text":
            assert output is None or matches(block.text, output), f"{where}: the output is\n{output}"
            output = None
        else:
            command = command_of(block)
            output = run_command(command, folder, shell, where) if command else None


def write_config(text: str, folder: Path) -> None:
    """Check a config, and keep it where it names a file; sweeps and settings of clusters as well."""
    named = re.match(r"# (\S+\.yaml)\n", text)
    if named:
        (folder / named[1]).write_text(text, encoding="utf-8")
        others = {"vary": load_sweep, "jobs": load_cluster}
        for key, load in others.items():
            if re.search(rf"^{key}:", text, re.MULTILINE):
                load(folder / named[1])
                return
    parse_config(text, named[1] if named else "example.yaml")


def command_of(block: Block) -> list[str]:
    """What to run for a block; nothing if all its lines set a clone up."""
    if block.language == "python":
        return [sys.executable, "-c", block.text]
    lines = [line for line in block.text.splitlines() if not SETUP.fullmatch(line)]
    return ["bash", "-euo", "pipefail", "-c", "\n".join(lines)] if lines else []


def run_command(command: list[str], folder: Path, env: dict[str, str], where: str) -> str:
    done = subprocess.run(
        command, cwd=folder, env=env, capture_output=True, text=True, timeout=600, check=False
    )
    assert done.returncode == 0, f"{where}: exit code {done.returncode}\n{done.stdout}{done.stderr}"
    return done.stdout


def matches(expected: str, output: str) -> bool:
    """Whether an output is the one shown, `...` standing for anything."""
    pattern = ""
    for line in expected.splitlines():
        if line.strip() == "...":
            pattern += r"(?:.*\n)*"
        else:
            pattern += re.escape(" ".join(line.split())).replace(r"\.\.\.", ".*") + r"\n"
    flat = "".join(" ".join(line.split()) + "\n" for line in output.splitlines())
    return re.fullmatch(pattern, flat) is not None


def test_outputs_are_really_compared() -> None:
    assert matches("a  b\n...\nc ... e\n", "a b\nx\ny\nc d e\n")
    assert matches("a\n...\n", "a\n")
    assert not matches("a b\n", "a c\n")
    assert not matches("a\n", "a\nb\n")


@pytest.mark.docs
def test_table_3_1_is_what_the_command_prints(tmp_path: Path) -> None:
    """The excerpt's lines, solved for at their widths, without spectra to be quick."""
    (excerpt,) = [b.text for b in blocks(ROOT / "README.md") if b.language == "text" and "thesis" in b.text]
    shown = [" ".join(line.split()) for line in excerpt.splitlines() if line.strip()]
    config = load_config(ROOT / "configs" / "mobius-pi.yaml")
    config = replace(config, widths=(0.1, 0.2, 0.5), spectrum=SpectrumRequest(0, 0))
    config = replace(config, refinement=replace(config.refinement, at=(0.1, 0.5)))
    solve_config(config, tmp_path)
    solve_config(load_config(ROOT / "configs" / "paper" / "mobius-pi-second-minimum.yaml"), tmp_path)
    second = load_state("mobius-pi-second-minimum@b=0.1,N=50", tmp_path)
    entry = Entry(second.half_width, second.segments, second.energy, second.certified, second.label)
    table = open_run("mobius-pi", tmp_path).convergence()
    printed = texts(table, compare_with_thesis(table, thesis_table(), entry))["txt"]
    assert set(shown) <= {" ".join(line.split()) for line in printed.splitlines()}
    assert len(shown) > 10


# --- what the pages list ---


def test_make_targets_exist() -> None:
    listed = subprocess.run(
        ["make", "--print-data-base", "--dry-run", "help"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
    )
    targets = set(TARGET.findall(listed.stdout))
    assert {"help", "setup", "test", "lint", "bench", "clean", "table-3.1"} <= targets
    for page in PAGES:
        lines = [line for b in blocks(page) if b.language == "sh" for line in b.text.splitlines()]
        named = {m["target"] for m in map(SETUP.fullmatch, lines) if m and m["target"]}
        named |= {m["target"] for m in SETUP.finditer(" ".join(re.findall(r"`(make [^`]+)`", read(page))))}
        assert named <= targets, page_name(page)


@pytest.mark.parametrize("target", ["help", "setup", "table-3.1", "test", "lint", "bench", "clean"])
def test_make_can_plan(target: str) -> None:
    done = subprocess.run(
        ["make", "--dry-run", target], cwd=ROOT, capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == 0, done.stderr


def test_the_readme_is_short() -> None:
    assert len(read(ROOT / "README.md").splitlines()) < 200


def test_the_reference_of_commands_is_that_of_click() -> None:
    """`python tests/command_pages.py > docs/reference/commands.md` writes it anew."""
    assert read(REFERENCE / "commands.md") == command_pages.page()


def test_the_reference_names_every_key_and_recipe() -> None:
    section = read(REFERENCE / "config.md").partition("## The keys")[2].partition("\n## ")[0]
    named = dict.fromkeys(re.match(r"\| `(\w+)", row)[1] for row in rows(section))  # type: ignore[index]
    assert list(named) == [key.name for key in CONFIG.keys]
    assert set(re.findall(r"recipe: ([\w-]+)", section)) == set(RECIPES)


def test_the_page_on_recipes_has_a_row_and_a_section_for_each() -> None:
    page = read(ROOT / "docs" / "recipes.md")
    for name, card in RECIPES.items():
        assert f"\n{card.row} " in page
        assert f"\n## {name}\n" in page


def test_the_reference_names_every_exit_code() -> None:
    listed = {
        int(code)
        for row in rows(read(REFERENCE / "exit-codes.md"))
        for code in re.findall(r"\d+", row.split("|")[1])
    }
    leaves = {leaf.exit_code for leaf in errors.RibbonError.__subclasses__()}
    assert listed == leaves | {0, errors.RibbonError.exit_code, 130, 143}


def test_every_page_is_in_the_list_of_pages() -> None:
    """docs/README.md lists them, and the site's navigation follows it."""
    listed = {
        (ROOT / "docs" / link).resolve()
        for link in re.findall(r"^- .*?\]\(([^)]+)\)", read(ROOT / "docs" / "README.md"), re.M)
    }
    pages = {*PAGES, *ROOT.glob("docs/*.ipynb"), *ROOT.glob("docs/**/*.rst")}
    assert listed - {ROOT / "findings" / "README.md"} == pages - {
        ROOT / "README.md",
        ROOT / "docs" / "README.md",
    }


def rows(section: str) -> list[str]:
    """Rows of the first table in a text, without its head."""
    table = [line for line in section.splitlines() if line.startswith("|")]
    return table[2:]


def test_notation_names_every_dataset() -> None:
    named = set(re.findall(r"`(/\w+(?:/\w+)+)`", read(ROOT / "docs" / "notation.md")))
    assert named == {item.path for item in (*STATE, *ENDS, *MATERIAL, *LOADS, *SPECTRUM, *BRANCH, *CONTACTS)}


def test_statuses_are_listed() -> None:
    section = read(ROOT / "docs" / "solver.md").partition("## Statuses")[2].partition("\n## ")[0]
    assert {row.split("`")[1] for row in rows(section)} == {status.value for status in Status}


def test_constants_are_those_of_the_code() -> None:
    section = read(ROOT / "docs" / "solver.md").partition("## Constants")[2]
    table = rows(section)
    assert len(table) > 15
    for row in table:
        name, shown = (cell.strip().strip("`") for cell in row.split("|")[1:3])
        assert constant(name) == value(shown), name


def constant(name: str) -> object:
    """The value of MODULE.NAME or MODULE.CLASS.FIELD."""
    parts = name.split(".")
    path, rest = (parts[:2], parts[2:])
    found: object = importlib.import_module(".".join(["ribbon_cli", *path]))
    for part in rest:
        found = getattr(found, part)
    return found


def value(text: str) -> object:
    """A number or tuple as printed, `2**-14` included."""
    base, power, exponent = text.partition("**")
    return float(base) ** float(exponent) if power else ast.literal_eval(text)


# --- links ---


def anchors(path: Path) -> set[str]:
    """Anchors of a page as GitHub makes them, and those written out."""
    text = BLOCK.sub("", read(path))
    heads = re.findall(r"^#+ (.*)$", text, re.MULTILINE)
    slugs = {re.sub(r"[^\w\- ]", "", head.lower()).replace(" ", "-") for head in heads}
    return slugs | set(re.findall(r'<a id="([^"]+)">', text))


@pytest.mark.parametrize("page", PAGES, ids=page_name)
def test_links_lead_somewhere(page: Path) -> None:
    for link in re.findall(r"\]\(([^)\s]+)\)", BLOCK.sub("", read(page))):
        if link.startswith("https://"):
            continue
        file, _, anchor = link.partition("#")
        target = (page.parent / file).resolve() if file else page
        assert target.is_file(), link
        assert not anchor or anchor in anchors(target), link

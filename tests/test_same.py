"""The comparison of two builds: equal ones are equal, and whatever is doctored in a result is told."""

from __future__ import annotations

import json
import shutil
import subprocess
from collections.abc import Callable
from dataclasses import replace
from hashlib import sha256
from pathlib import Path

import h5py
import numpy as np
import pytest
import yaml

from bench.same.__main__ import main
from bench.same.builds import commit_build, resolved
from bench.same.cases import ROOT, CaseError, read_cases
from bench.same.differences import KINDS, Difference, compare
from bench.same.expect import read_expected, split
from bench.same.observe import Observation, kept
from bench.same.report import details
from ribbon_cli.cli.main import cli
from ribbon_cli.config import RECIPES

CASES = """\
sets:
  exports: ["export {} --to npz -o ring.npz"]
cases:
  - case: ring
    files:
      ring.yaml: |
        topology: {half_twists: 0}
        initial_guess: {recipe: cylinder, segments: 12, half_width: 0.1}
        spectrum: {modes: 0, full_up_to: 0}
    run:
      - solve ring.yaml --json
      - exports: ring:1
      - show nothing => 2
"""
STATE = "runs/ring-*/states/0001.h5"
SOLVE = "solve ring.yaml --json"


@pytest.fixture(scope="module")
def observed(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, int]:
    """The present tree compared with itself on one case: the folder of results, and the exit code."""
    folder = tmp_path_factory.mktemp("same")
    (folder / "cases.yaml").write_text(CASES)
    words = ("--cases", folder / "cases.yaml", "--cache", folder / "cache", "--no-speed")
    return folder / "cache", main([str(ROOT), *map(str, words)])


@pytest.fixture
def doctored(observed: tuple[Path, int], tmp_path: Path) -> tuple[Observation, Observation]:
    """What came of the case, and a copy of it to change."""
    cache, _ = observed
    shutil.copytree(cache / "present" / "cases" / "ring", tmp_path / "ring")
    before, after = kept(cache / "folder" / "cases" / "ring"), kept(tmp_path / "ring")
    assert before is not None
    assert after is not None
    return before, after


def found(before: Observation, after: Observation) -> dict[str, list[tuple[str, str, str]]]:
    """Where, path and detail of the differences, by kind."""
    by_kind: dict[str, list[tuple[str, str, str]]] = {}
    for d in compare("ring", before, after).differences:
        by_kind.setdefault(d.kind, []).append((d.where, d.path, d.detail))
    return by_kind


def printed(observation: Observation, text: str, **changes: object) -> Observation:
    """An observation in which a step printed or ended otherwise."""
    assert any(step.text == text for step in observation.steps)
    steps = (replace(step, **changes) if step.text == text else step for step in observation.steps)
    return replace(observation, steps=tuple(steps))


def change_state(work: Path, change: Callable[[h5py.File], None]) -> None:
    """Change a state file, and its head, so that it is whole."""
    (path,) = work.glob(STATE)
    with h5py.File(path, "r+") as file:
        change(file)
    head, _, rest = path.read_bytes().partition(b"\n")
    path.write_bytes(head[:-64] + sha256(rest).hexdigest().encode() + b"\n" + rest)


@pytest.mark.long
def test_a_build_is_the_same_as_itself(observed, doctored) -> None:
    assert observed[1] == 0
    compared = compare("ring", *doctored)
    assert compared.differences == ()
    assert (compared.states, compared.steps, compared.documents) == (1, 3, 1)


@pytest.mark.long
def test_a_dataset_that_differs_in_one_bit_is_told(doctored) -> None:
    def change(file: h5py.File) -> None:
        file["state/u"][3, 1] = np.nextafter(file["state/u"][3, 1], 2.0)
        file["geometry/kappa_s"][0] = np.nan

    change_state(doctored[1].work, change)
    told = found(*doctored)
    assert set(told) == {"dataset"}
    (kappa, u) = told["dataset"]
    assert kappa[0].startswith("runs/ring-")
    assert kappa[0].endswith(": cylinder")
    assert kappa[1:] == (
        "/geometry/kappa_s",
        "1 of 12 values differ, at 0; largest difference 0; 1 numbers became not finite",
    )
    assert u[1] == "/state/u"
    assert u[2].startswith("1 of 36 values differ, at 10; largest difference ")


@pytest.mark.long
def test_datasets_and_attributes_that_come_and_go_are_told(doctored) -> None:
    def change(file: h5py.File) -> None:
        file["state/new"] = 1.5
        del file["certificate/message"]
        file.attrs["format_version"] = np.bytes_("9.9")

    change_state(doctored[1].work, change)
    told = found(*doctored)
    assert [row[1] for row in told["dataset"]] == ["/certificate/message", "/state/new"]
    assert [row[2].split(":")[0] for row in told["dataset"]] == ["removed", "added"]
    assert ("/@format_version", '"1.4" -> "9.9"') in [row[1:] for row in told["attribute"]]


@pytest.mark.long
def test_a_state_that_is_missing_or_damaged_is_told(doctored) -> None:
    (path,) = doctored[1].work.glob(STATE)
    path.write_bytes(path.read_bytes()[:-1] + b"?")
    rows = found(*doctored)["state"]
    assert sorted((where.split(": ")[1], how) for where, _, how in rows) == [
        ("0001.h5 (damaged)", "added"),
        ("cylinder", "missing"),
    ]
    path.unlink()
    assert [how for *_, how in found(*doctored)["state"]] == ["missing"]


@pytest.mark.long
def test_an_exit_code_and_a_message_are_told(doctored) -> None:
    before, after = doctored
    after = printed(after, "show nothing", code=1, stderr="ribbon: what?\n")
    told = found(before, after)
    assert told.pop("exit") == [("show nothing", "", "2 -> 1")]
    ((where, path, detail),) = told.pop("message")
    assert (where, path) == ("show nothing", "line 1")
    assert detail.endswith('-> ["ribbon: what?"]')
    assert told == {}


@pytest.mark.long
def test_json_that_was_changed_removed_and_added_is_told_apart(doctored) -> None:
    before, after = doctored
    (step,) = (step for step in after.steps if step.text == SOLVE)
    document = json.loads(step.stdout)
    (state,) = document["states"]
    del state["status"]
    state |= {"energy": 0.5, "parent": False, "new": {"a": [1]}}
    told = found(before, printed(after, SOLVE, stdout=json.dumps(document)))
    assert set(told) == {"json", "json-added"}
    assert told["json-added"] == [(SOLVE, "states.0.new", 'added: {"a": [1]}')]
    assert [(path, how.split()[-1]) for _, path, how in told["json"]] == [
        ("states.0.energy", "0.5"),
        ("states.0.status", '"minimum"'),
        ("states.0.parent", "false"),
    ]


@pytest.mark.long
def test_files_that_differ_are_told(doctored) -> None:
    before, after = doctored
    with np.load(after.work / "ring.npz") as file:
        arrays = dict(file)
    np.savez(after.work / "ring.npz", **arrays | {"u": arrays["u"] + 1.0})
    (after.work / "new.txt").write_text("new\n")
    (config,) = after.work.glob("runs/*/resolved.yaml")
    config.write_text(config.read_text().replace("contact: record", "contact: stop"))
    rows = {where.split("/")[-1]: (path, how) for where, path, how in found(before, after)["file"]}
    assert rows["new.txt"] == ("", "added")
    assert rows["ring.npz"] == ("u", "36 of 36 values differ, at 0, 1, 2, ...; largest difference 1")
    assert '["contact: record"] -> ["contact: stop"]' in rows["resolved.yaml"][1]


def test_expected_differences_are_left_out_and_those_of_no_use_are_told(tmp_path: Path) -> None:
    path = tmp_path / "expected.yaml"
    path.write_text(
        "- {kind: json*, path: '*.new', reason: a new key}\n"
        "- {kind: dataset, path: /origin/events, detail: '* -> *', reason: facts}\n"
    )
    new = Difference("json-added", "ring", SOLVE, "0.new", "added: 1")
    old = Difference("json", "ring", SOLVE, "0.energy", "1.0 -> 2.0")
    left, covered = split([new, old], read_expected(path))
    assert left == [old]
    assert covered == [1, 0]
    for wrong in ("- {kind: jason, reason: no}", "- {pth: x, reason: no}", "- {path: x}", "- {reason: no}"):
        path.write_text(wrong)
        with pytest.raises(CaseError):
            read_expected(path)


def test_like_differences_are_one_line() -> None:
    rows = [Difference("json", "ring", SOLVE, f"{k}.energy", "1.0 -> 2.0") for k in range(50)]
    rows.append(Difference("exit", "ring", "solve ring.yaml", "", "0 -> 3"))
    assert list(details(rows, whole=False)) == [
        "",
        f"{KINDS['exit']}: 1",
        "  ring: solve ring.yaml: 0 -> 3",
        "",
        f"{KINDS['json']}: 50",
        f"  50 times, first ring: {SOLVE}: 0.energy: 1.0 -> 2.0",
    ]
    assert len(list(details(rows, whole=True))) == 55


def test_a_commit_is_built_as_it_was_committed(tmp_path: Path) -> None:
    repository, module = tmp_path / "repository", tmp_path / "repository" / "ribbon_cli" / "__init__.py"
    module.parent.mkdir(parents=True)
    module.write_text("old = 1\n")

    def git(*words: str) -> None:
        who = ("-c", "user.name=A", "-c", "user.email=a@example.org", "-c", "commit.gpgsign=false")
        subprocess.run(["git", *who, *words], cwd=repository, check=True, capture_output=True)

    git("init", "-b", "main")
    git("add", ".")
    git("commit", "-m", "one")
    first = resolved(None, repository)
    git("checkout", "-b", "change")
    module.write_text("new = 1\n")
    git("commit", "-am", "two")
    assert resolved(None, repository) == first != resolved("HEAD", repository)
    build = commit_build(first, tmp_path / "cache", repository)
    assert (build.tree / "ribbon_cli" / "__init__.py").read_text() == "old = 1\n"
    with pytest.raises(CaseError, match="no commit"):
        resolved("nowhere", repository)


def test_the_cases_have_every_command_recipe_and_rule() -> None:
    cases = read_cases()
    commands = {step.words[0] for case in cases for step in case.steps if step.action == "ribbon"}
    assert set(cli.commands) <= commands
    texts = [data for case in cases for name, data in case.files.items() if name.endswith(".yaml")]
    configs = []
    for text in texts:
        try:
            configs.append(yaml.safe_load(text))
        except yaml.YAMLError:
            continue  # one that is broken on purpose
    assert {config.get("discretisation", "thesis") for config in configs} == {"thesis", "value-average"}
    closed = {name for name, recipe in RECIPES.items() if not recipe.open}  # older builds know no others
    assert closed <= {config.get("initial_guess", {}).get("recipe") for config in configs} - {None}
    assert {config.get("contact") for config in configs} >= {"record", "stop"}
    assert len({case.name for case in cases if case.quick}) < len(cases)


@pytest.mark.parametrize(
    "wrong", ["cases: [{case: a, run: [{peel: b}]}]", "cases: [{case: a, on: []}]", "a: b"]
)
def test_a_wrong_list_of_cases_is_one_line(tmp_path: Path, capsys, wrong: str) -> None:
    path = tmp_path / "cases.yaml"
    path.write_text(wrong)
    assert main(["--cases", str(path), "--cache", str(tmp_path / "cache")]) == 2
    assert capsys.readouterr().err.startswith("same: ")

"""Lines of a log that were forged with the right checksum: whatever they say, every command ends in a line,
and `repair` and `solve` bring the run back.
"""

from __future__ import annotations

import copy
import hashlib
import json
import random
import shutil
import zlib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from cli_support import ribbon
from fault_support import limited
from store_support import read_log, reseal

from ribbon_cli.cli.main import cli
from ribbon_cli.errors import StoreError
from ribbon_cli.store import Run, list_runs
from ribbon_cli.store.hdf5 import encoded

CONFIG = """\
name: forged
topology: {half_twists: 0}
initial_guess: {recipe: cylinder, segments: 8, half_width: 0.1}
widths: {arclength: {to: 0.11}}
spectrum: {modes: 2, full_up_to: 0}
"""
READERS = (
    ("ls",),
    ("ls", "--json"),
    ("ls", "forged", "--all"),
    ("ls", "forged@b=0.1"),
    ("show", "forged"),
    ("show", "forged", "--json"),
    ("show", "forged:1"),
    ("show", "forged@N=8"),
    ("verify", "forged"),
    ("convergence-table", "forged"),
)
DOCUMENTED = {0, 2, 3, 4}


@pytest.fixture(scope="module")
def made(tmp_path_factory) -> Path:
    """A folder with a small run, solved here, so that children find everything imported."""
    folder = tmp_path_factory.mktemp("made")
    (folder / "forged.yaml").write_text(CONFIG)
    assert ribbon("solve", folder / "forged.yaml", "--runs", folder / "runs").exit_code == 0
    for words in (*READERS, ("repair", "forged")):
        assert ribbon(*words, "--runs", folder / "runs").exit_code == 0, words
    return folder


def shapes(run: Run) -> dict[tuple[str, str], str]:
    """Hash of the unknowns of every state by kind and stage, each read and checked."""
    found = {}
    for label in run.entries():
        record = run.load(label)
        unknowns = (record.u, record.g, record.xi, record.lambda_1, record.gamma)
        digest = hashlib.sha256(b"".join(part.tobytes() for part in unknowns)).hexdigest()
        found[record.kind, record.stage] = digest
    return found


# --- mutations ---

Lines = list[Any]
"""The entries of a log; what is bytes stands as it is."""


def sealed(entry: Any, ascii_only: bool = False) -> bytes:
    """An entry's line with its checksum; what JSON has no number for as Python writes it."""
    if isinstance(entry, bytes):
        body = entry
    else:
        body = json.dumps(entry, ensure_ascii=ascii_only, separators=(",", ":")).encode(
            errors="surrogatepass"
        )
    return body[:-1] + f',"crc32":"{zlib.crc32(body):08x}"}}\n'.encode()


def odd(chance: random.Random) -> Any:
    """A value of any type, of any size."""
    return chance.choice(
        [
            *(None, True, False, 0, 1, -1, 2, 7, 10**11, 10**12 - 1, 2**63, -(2**63) - 1, 10**400),
            *(0.1, -0.0, 1e308, 1e999, -1e999, float("nan"), 5e-324),
            *("", "x", "x" * 100_000, "\x1b[2J", "a\nb", "\0", "\ud800", "\u202eevil", "<script>", "../../x"),
            *([], {}, [[]], [1], ["x"], {"label": 1}, {"x": {"x": {}}}, ["\ud800"], [None, 1]),
            *("minimum", "saddle", "equilibrium", "auxiliary", "1.9", "0" * 64),
        ]
    )


def deep(chance: random.Random) -> bytes:
    """A line nested deeper than Python goes."""
    depth = chance.choice([50, 900, 100_000])
    return b'{"event":"note","time":"","x":' + b"[" * depth + b"]" * depth + b"}"


def places(value: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Paths of everything inside of a value."""
    found = [path] if path else []
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, item in items:
        found += places(item, (*path, key))
    return found


def change(chance: random.Random, entry: Any) -> None:
    """Another value for a field, no field, or a field more."""
    *way, last = chance.choice(places(entry))
    owner = entry
    for key in way:
        owner = owner[key]
    match chance.randrange(4):
        case 0 | 1:
            owner[last] = odd(chance)
        case 2:
            del owner[last]
        case _ if isinstance(owner, dict):
            owner[chance.choice(["new", "label", "time", "state", "\ud800", "crc32"])] = odd(chance)


def mutate(chance: random.Random, entries: Lines, honest: Lines) -> Lines:
    """Forge one thing in a log, be it forged already."""
    entries = copy.deepcopy(entries)
    if not entries or not all(isinstance(entry, dict) and entry for entry in entries):
        return entries
    k = chance.randrange(len(entries))
    match chance.randrange(16):
        case 0 | 1 | 2 | 3 | 4 | 5 | 6:
            change(chance, entries[k])
        case 7:
            del entries[k]
        case 8:
            entries.insert(chance.randrange(len(entries) + 1), copy.deepcopy(entries[k]))
        case 9:
            chance.shuffle(entries)
        case 10:
            twice = copy.deepcopy(entries[k])
            change(chance, twice)
            entries.insert(chance.randrange(len(entries) + 1), twice)
        case 11:
            lost = {"event": "state-lost", "time": "x", "label": chance.choice([1, 2, 3, 7, 10**12 - 1])}
            entries.insert(chance.randrange(len(entries) + 1), lost)
        case 12:
            end = next(entry for entry in honest if entry["event"] == "branch-end")
            field = chance.choice(["branch", "start", "reason", "half_width", "message"])
            entries.append({**end, field: odd(chance)})
        case 13:
            entries[k] = chance.choice(
                [deep(chance), b"{}", b"[]", b"nul", b'{"event":"a","time":"\xff"}', b"\0\0"]
            )
        case 14:
            label = chance.choice([1, 2, 3, 9, 12345, 10**12 - 1])
            more = copy.deepcopy(next(entry for entry in honest if entry["event"] == "state"))
            more["state"]["label"], more["file"] = label, f"states/{label:04d}.h5"
            entries.insert(chance.randrange(len(entries) + 1), more)
        case _:
            entries.append({"event": chance.choice(["ended", "note", ""]), "time": "", "missed": odd(chance)})
    return entries


def commands(root: Path, *lines: tuple[str, ...]) -> Callable[[], int]:
    """Each command in this process; how each ended is printed behind what it says."""

    def action() -> int:
        for words in lines:
            try:
                cli.main([*words, "--runs", str(root)])
            except SystemExit as left:
                print(f"\n#{left.code or 0} {' '.join(words)}", flush=True)
        return 0

    return action


def codes(output: str) -> dict[str, int]:
    """The exit code of each command."""
    ends = [line[1:].split(" ", 1) for line in output.splitlines() if line.startswith("#")]
    return {words: int(code) for code, words in ends}


def forge(folder: Path, made: Path, count: int, seed: int) -> dict[int, int]:
    """Forge so many logs; how often `verify` ended with each code."""
    chance = random.Random(seed)
    (run,) = list_runs(made / "runs")
    expected, honest = shapes(run), read_log(run.log_path)
    root = folder / "runs"
    seen: dict[int, int] = {}
    for k in range(count):
        shutil.rmtree(root, ignore_errors=True)
        shutil.copytree(made / "runs", root)
        entries = honest
        for _ in range(chance.choice((1, 1, 2))):
            entries = mutate(chance, entries, honest)
        ascii_only = chance.random() < 0.5
        (root / run.name / "log.jsonl").write_bytes(b"".join(sealed(entry, ascii_only) for entry in entries))
        mend = (("repair", "forged"), ("verify", "forged"), ("solve", str(made / "forged.yaml"), "-q"))
        read = limited(commands(root, *READERS), folder)
        mended = limited(commands(root, *mend, ("verify", "forged", "-q")), folder)
        where = f"forgery {k} of seed {seed}: {read.output}\n{mended.output}"
        for ended in (read, mended):
            assert ended.code == 0, where
            assert "Traceback" not in ended.output, where
            assert "internal error" not in ended.output, where
            assert set(codes(ended.output).values()) <= DOCUMENTED, where
        assert len(codes(read.output)) == len(READERS), where
        assert set(codes(mended.output).values()) == {0}, where
        (found,) = list_runs(root)
        assert shapes(found) == expected, where
        code = codes(read.output)["verify forged"]
        seen[code] = seen.get(code, 0) + 1
    return seen


@pytest.mark.long
def test_forged_lines_do_no_harm(tmp_path, made):
    assert forge(tmp_path, made, 4, seed=1)[4] >= 1


@pytest.mark.faults
@pytest.mark.parametrize("part", range(10))
def test_two_thousand_forged_logs(tmp_path, made, figure, part):
    """Two hundred of the two thousand."""
    seen = forge(tmp_path, made, 200, seed=2 + part)
    figure(f"exit codes of verify {seen}")
    assert seen[4] > 60


# --- one by one ---


@pytest.fixture
def forged(tmp_path, made, monkeypatch) -> Run:
    """A copy of the run, to forge."""
    monkeypatch.chdir(tmp_path)
    shutil.copytree(made / "runs", tmp_path / "runs")
    (run,) = list_runs(tmp_path / "runs")
    return run


def of_state(**changes: Any) -> Callable[[Lines], None]:
    return lambda entries: entries[1]["state"].update(changes)


def of_line(k: int, **changes: Any) -> Callable[[Lines], None]:
    return lambda entries: entries[k].update(changes)


NONSENSE: dict[str, Callable[[Lines], None]] = {
    "no half-width": of_state(half_width=None),
    "a negative half-width": of_state(half_width=-0.1),
    "no facets": of_state(segments=0),
    "an energy beyond any float": of_state(energy=10**400),
    "an infinite linking number": of_state(linking_number=1e999),
    "a residual that is no number": of_state(kkt_residual=float("nan")),
    "half a surrogate pair": of_state(stage="\ud800"),
    "half a pair in a time": of_line(-1, time="\ud800"),
    "a branch's end beyond any float": of_line(3, half_width=10**400),
    "a branch's end in another parameter beyond any float": of_line(3, value=10**400),
    "a bending energy beyond any float": of_state(bending_energy=10**400),
    "a parameter beyond any float": of_state(parameters={"half_width": 10**400}),
    "a parameter that others have left out": of_state(parameters={"half_width": 0.1}),
    "a parameter without a value": of_state(parameters={"half_width": 0.1, "natural_curvature": None}),
    "a parameter of strips": of_state(parameters={"half_width": 0.1, "natural_curvature": 0.0, "shear": 0.0}),
    "a seam that joins nothing": of_state(topology={"half_twists": 0, "sigma": 0}),
    "a state that is its own parent": of_state(parent=1),
    "a truth for the state a branch begins at": of_line(3, start=True),
    "a place beyond any float": of_line(-1, missed=[[0.1, True]]),
    "a version in words": of_line(0, format_version="new"),
    "no version": lambda entries: entries[0].pop("format_version"),
    "half a pair in an unknown event": lambda entries: entries.append({"event": "\ud800", "time": ""}),
    "deep nesting": lambda entries: entries.append(
        b'{"event":"n","time":"","x":' + b"[" * 99 + b"]" * 99 + b"}"
    ),
    "another encoding": lambda entries: entries.append(b'{"event":"n","time":"\xff"}'),
}


@pytest.mark.parametrize("ascii_only", [False, True])
@pytest.mark.parametrize("what", NONSENSE)
def test_nonsense_is_damage(forged, what, ascii_only):
    entries = copy.deepcopy(read_log(forged.log_path))
    NONSENSE[what](entries)
    forged.log_path.write_bytes(b"".join(sealed(entry, ascii_only) for entry in entries))
    with pytest.raises(StoreError, match=r"log.jsonl:\d: damaged line: [^\n]*; `ribbon repair"):
        forged.entries()
    assert forged.repair()
    assert [len(Run.open(forged.path).entries()), Run.open(forged.path).repair()] == [2, []]


def test_brackets_in_a_text_nest_nothing(forged):
    line = sealed({"event": "note", "time": "", "text": '["' + "[{" * 5000 + "\\"})
    forged.log_path.write_bytes(forged.log_path.read_bytes() + line)
    assert len(forged.entries()) == 2


def test_lines_of_a_later_minor_version_are_read(forged, made):
    entries = copy.deepcopy(read_log(forged.log_path))
    entries[0]["format_version"] = "1.7"
    for entry in entries:
        entry["later"] = {"a": [1, None]}
    data, summary = encoded(replace(forged.load(1), status="semi-stable"))
    forged.state_path(1).write_bytes(data)
    entries[1] |= {"sha256": hashlib.sha256(data).hexdigest(), "state": summary.to_dict() | {"later": [1.5]}}
    entries.append({"event": "later", "time": "2031-01-01T00:00:00Z", "what": {"a": [1, {"b": None}]}})
    forged.log_path.write_bytes(b"".join(map(sealed, entries)))
    for words in READERS:
        if words[0] != "verify":  # which knows no such status
            result = ribbon(*words)
            assert result.exit_code == 0, result.output
    assert "semi-stable" in ribbon("ls", "forged").stdout
    assert ribbon("solve", made / "forged.yaml").exit_code == 0


def files(run: Run) -> dict[Path, bytes]:
    """What a run's files hold; where there is none, the lock is an empty one."""
    return {path: path.read_bytes() for path in run.path.rglob("*") if path.is_file() and path.name != "lock"}


def test_a_run_of_a_newer_format_is_left_alone(forged, made):
    entries = copy.deepcopy(read_log(forged.log_path))
    entries[0]["format_version"] = "2.0"
    lines = [*map(sealed, entries), b"a line of another kind\n"]
    forged.log_path.write_bytes(b"".join(lines[:1] + lines[2:-1]))  # without the line on state 1
    (forged.path / "states" / "0001.h5").write_bytes(b"ribbon-state 2.0 xxh3 0123\n")
    (forged.path / ".tmp-of-a-newer-writer").touch()
    before = files(forged)
    for words in (
        ("repair", "forged"),
        ("solve", made / "forged.yaml"),
        ("ls", "forged"),
        ("show", "forged"),
    ):
        result = ribbon(*words)
        assert result.exit_code == 4
        assert "run of format 2.0, this is 1.4: update ribbon" in result.stderr
    assert files(forged) == before


def test_a_state_of_a_newer_format_is_not_put_aside(forged):
    path = forged.state_path(3)
    path.write_bytes(b"ribbon-state 2.0 xxh3 0123\n")
    result = ribbon("repair", "forged")
    assert result.exit_code == 4
    assert "written in format 2.0, newer than 1.4: update ribbon" in result.stderr
    assert path.exists()


@pytest.mark.parametrize("names", [("config.yaml",), ("config.yaml", "resolved.yaml")])
def test_a_first_line_that_names_another_config_yields_to_the_states(forged, names):
    entries = copy.deepcopy(read_log(forged.log_path))
    texts = {name: (forged.path / name).read_bytes() for name in ("config.yaml", "resolved.yaml")}
    entries[0]["files"] |= dict.fromkeys(names, "0" * 64)
    forged.log_path.write_bytes(b"".join(map(sealed, entries)))
    (forged.path / "config.yaml").write_text("name: another\n")
    assert ribbon("verify", "forged").exit_code == 4
    assert ribbon("repair", "forged").exit_code == 0
    assert ribbon("verify", "forged").exit_code == 0
    assert {name: (forged.path / name).read_bytes() for name in texts} == texts


def test_labels_do_not_run_out(forged):
    """A forged line may have lost the last label that there is."""
    entries = read_log(forged.log_path)
    lost = {"event": "state-lost", "time": "", "label": 10**12 - 1}
    forged.log_path.write_bytes(b"".join(map(sealed, [*entries, lost])))
    assert forged.next_label == 3


def test_a_head_that_makes_no_sense_is_damage_though_its_hash_fits(forged):
    """Its line would be one that no reader takes."""
    run, data = forged, forged.state_path(2).read_bytes()
    run.log_path.write_bytes(b"".join(run.log_path.read_bytes().splitlines(keepends=True)[:2]))
    for changes in ({"half_width": "wide"}, {"energy": 10**400}, {"stage": None}, {"branch": [1]}):
        run.state_path(2).write_bytes(data)
        reseal(run.state_path(2), **changes)
        with run.writing():
            assert any("renamed 0002.h5" in remark for remark in run.remarks)
        assert list(run.entries()) == [1]

"""What a good config resolves to, its hash, the templates, spelled numbers, and files."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import math
import os
import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from config_samples import GOOD, MINIMAL, changed, problems_of

from ribbon_cli.config import (
    Config,
    ConfigError,
    ContactRequest,
    Guess,
    Refinement,
    SpectrumRequest,
    dump_resolved,
    load_config,
    parse_config,
    templates,
)
from ribbon_cli.expression import ExpressionError, evaluate

# ---- what a good config resolves to


def test_the_example_of_the_documentation() -> None:
    config = parse_config(GOOD, "somewhere/mobius.yaml")
    assert config == Config(
        name="mobius-pi",
        half_twists=1,
        length=2 * math.pi,
        discretisation="thesis",
        guess=Guess("twist", 50, 0.1, {"steps": 50}),
        widths=(0.1, 0.2, 0.5, 0.8, 1.0, 1.5),
        refinement=Refinement((50, 100, 200, 400)),
        spectrum=SpectrumRequest(12, 200, ("euclidean", "physical")),
        contact=ContactRequest("record"),
        text=GOOD,
        path="somewhere/mobius.yaml",
    )


def test_defaults() -> None:
    config = parse_config(MINIMAL, "runs/band.yaml")
    assert config.name == "band"
    assert config.length == 2 * math.pi
    assert config.discretisation == "thesis"
    assert config.guess == Guess("twist", 50, 0.1, {"steps": 50})
    assert config.widths == (0.1,)
    assert config.refinement == Refinement((50,))
    assert config.spectrum == SpectrumRequest()
    assert config.contact == ContactRequest("record")


def test_a_range_of_widths_follows_the_schedule() -> None:
    config = parse_config(
        changed("[0.1, 0.2, 0.5, 0.8, 1.0, 1.5]", "{from: 0.1, to: 1.5, steps: 28}"), "m.yaml"
    )
    assert len(config.widths) == 29
    assert config.widths[0] == 0.1
    assert config.widths[-1] == 1.5
    assert config.widths == pytest.approx([0.1 + j * 1.4 / 28 for j in range(29)], rel=1e-15)
    same = changed("[0.1, 0.2, 0.5, 0.8, 1.0, 1.5]", str(list(config.widths)))
    assert parse_config(same, "m.yaml").hash8() == config.hash8()


def test_a_range_may_go_down() -> None:
    text = changed("[0.1, 0.2, 0.5, 0.8, 1.0, 1.5]", "{from: 0.5, to: 0.25, steps: 2}")
    assert parse_config(text, "m.yaml").widths == (0.5, 0.375, 0.25)


def test_refinement_at_some_widths_takes_the_widths_as_listed() -> None:
    text = changed("[50, 100, 200, 400]", "{levels: [50, 100], at: [0.50000000001, 1.5]}")
    assert parse_config(text, "m.yaml").refinement == Refinement((50, 100), (0.5, 1.5))


def test_metrics_are_kept_in_one_order() -> None:
    text = changed("full_up_to: 200", "full_up_to: 0, metrics: [physical, euclidean]")
    assert parse_config(text, "m.yaml").spectrum == SpectrumRequest(12, 0)
    text = changed("full_up_to: 200", "metrics: [physical]")
    assert parse_config(text, "m.yaml").spectrum == SpectrumRequest(12, 200, ("physical",))


@pytest.mark.parametrize("reference", ["mobius-pi:12", "'mobius-pi@b=0.5,N=400'", "mobius-pi@b=0.5"])
def test_a_state_by_reference(reference: str) -> None:
    config = parse_config(f"topology: {{half_twists: 3}}\ninitial_guess: {{state: {reference}}}\n", "m.yaml")
    plain = reference.strip("'")
    assert config.guess == Guess("state", state=plain, state_as_written=plain)
    assert config.widths == ()
    assert config.refinement == Refinement(())
    assert parse_config(dump_resolved(config), "m.yaml").hash8() == config.hash8()


@pytest.mark.parametrize("file", ["start.npz", "../start.H5"])
def test_a_state_file_lies_beside_the_config(tmp_path: Path, file: str) -> None:
    text = f"topology: {{half_twists: 1}}\ninitial_guess: {{state: {file}}}\n"
    folder = tmp_path / "configs"
    folder.mkdir()
    (folder / "m.yaml").write_text(text)
    config = load_config(folder / "m.yaml")
    assert config.guess.state == os.path.normpath(folder / file)
    assert config.guess.state_as_written == file
    assert config.resolved()["initial_guess"] == {"state": config.guess.state}
    # The same text means the same run, wherever its folder lies.
    assert config.hash8() == parse_config(text, "elsewhere/m.yaml").hash8()


def test_an_absolute_or_home_path_of_a_state(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", "/home/user")
    for written, opened in (("/data/a.npz", "/data/a.npz"), ("~/a.npz", "/home/user/a.npz")):
        text = f"topology: {{half_twists: 1}}\ninitial_guess: {{state: {written}}}\n"
        assert parse_config(text, "m.yaml").guess.state == opened


@pytest.mark.parametrize("name", ["2024", "no", "1e3", "a.b-c_d", "'007'"])
def test_a_name_is_text_whatever_yaml_would_make_of_it(name: str) -> None:
    config = parse_config(f"name: {name}\n{MINIMAL}", "m.yaml")
    assert config.name == name.strip("'")
    assert parse_config(dump_resolved(config), "m.yaml").name == config.name


def test_json_is_a_config_too() -> None:
    resolved = parse_config(GOOD, "m.yaml").resolved()
    assert parse_config(json.dumps(resolved, indent=1), "m.json").resolved() == resolved


@pytest.mark.parametrize("mark", ["", "\ufeff"])
@pytest.mark.parametrize("newline", ["\n", "\r\n"])
def test_byte_order_mark_and_newlines_change_nothing_but_the_text(
    tmp_path: Path, mark: str, newline: str
) -> None:
    data = (mark + GOOD.replace("\n", newline)).encode()
    (tmp_path / "m.yaml").write_bytes(data)
    config = load_config(tmp_path / "m.yaml")
    assert config.text.encode() == data
    assert config.hash8() == parse_config(GOOD, "m.yaml").hash8()


# ---- resolved, scientific, hash


def test_resolved_is_a_config_with_the_same_meaning() -> None:
    config = parse_config(changed("[50, 100, 200, 400]", "{levels: [50, 100], at: [0.5]}"), "m.yaml")
    again = parse_config(dump_resolved(config), "m.yaml")
    assert dataclasses.replace(again, text=config.text) == config
    assert yaml.safe_load(dump_resolved(config)) == config.resolved()
    assert json.loads(json.dumps(config.resolved())) == config.resolved()


def test_the_hash_is_of_the_scientific_part_alone() -> None:
    config = parse_config(GOOD, "m.yaml")
    canonical = json.dumps(config.scientific(), sort_keys=True, separators=(",", ":"))
    assert config.hash8() == hashlib.sha256(canonical.encode()).hexdigest()[:8] == "713b55d7"
    assert set(config.scientific()) == set(config.resolved()) - {"name"}
    for same in (
        changed("mobius-pi", "other"),
        "# a comment\n" + GOOD,
        changed("2*pi", str(2 * math.pi)),
        changed(", steps: 50", ""),
        changed("0.1, steps", "1e-1, steps"),
    ):
        assert parse_config(same, "m.yaml").hash8() == config.hash8()
    for other in (
        changed("record", "stop"),
        changed("thesis", "value-average"),
        changed("half_twists: 1", "half_twists: -1"),
        changed("steps: 50", "steps: 51"),
        changed(", 400]", "]"),
        changed("modes: 12", "modes: 13"),
    ):
        assert parse_config(other, "m.yaml").hash8() != config.hash8()


def test_records_are_frozen() -> None:
    config = parse_config(GOOD, "m.yaml")
    with pytest.raises(dataclasses.FrozenInstanceError):
        config.name = "x"  # type: ignore[misc]
    assert len({config, parse_config(GOOD, "m.yaml")}) == 1


# ---- templates


def test_every_template_is_a_good_config() -> None:
    found = templates()
    assert {"mobius-pi", "mobius-pi-left", "ring"} <= set(found)
    for name, text in found.items():
        config = parse_config(text, "my-band.yaml")
        assert config.name == name
        assert all(len(line) <= 110 for line in text.splitlines())
        assert text.count("#") > 8


def test_the_first_template_is_table_3_1() -> None:
    config = parse_config(templates()["mobius-pi"], "mobius-pi.yaml")
    assert config.resolved() == parse_config(GOOD, "mobius-pi.yaml").resolved()


# ---- spelled numbers


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("0.5", 0.5),
        (".5", 0.5),
        ("5.", 5.0),
        ("1e-3", 1e-3),
        ("1E+3", 1e3),
        ("pi", math.pi),
        ("2*pi", 2 * math.pi),
        ("2 * pi", 2 * math.pi),
        ("pi/30", math.pi / 30),
        ("-pi", -math.pi),
        ("+1", 1.0),
        ("2*-3", -6.0),
        ("1-2-3", -4.0),
        ("8/4/2", 1.0),
        ("1+2*3", 7.0),
        ("(1+2)*3", 9.0),
        ("(1 + 1/3)*pi", 4 / 3 * math.pi),
        ("((((1))))", 1.0),
    ],
)
def test_numbers(text: str, value: float) -> None:
    assert evaluate(text) == pytest.approx(value, rel=1e-15)


@pytest.mark.parametrize(
    "text",
    [
        *[
            "",
            " ",
            "2pi",
            "pi2",
            "pi pi",
            "1 2",
            "2**3",
            "2^3",
            "()",
            "(1",
            "1)",
            "1+",
            "*2",
            "--1",
            "1e",
            "1e+",
        ],
        *[
            "e3",
            "1/0",
            "1/(1-1)",
            "1e999",
            "1e300*1e300",
            "1e999-1e999",
            "1_000",
            "0x10",
            "010",
            "1:30",
            "1,5",
        ],
        *["٣", "π", "Pi", "exp(1)", "__import__('os')", "1.2.3", "1+" * 60 + "1", "1\n"],
        "(" * 11 + "1" + ")" * 11,
    ],
)
def test_what_is_no_number(text: str) -> None:
    with pytest.raises(ExpressionError):
        evaluate(text)


# ---- files


def file_problem(path: Path | str) -> str:
    with pytest.raises(ConfigError) as caught:
        load_config(path)
    return str(caught.value)


def test_a_missing_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert file_problem("nothing.yaml") == "nothing.yaml: no such file"
    Path("mobius-pi.yaml").write_text(GOOD)
    assert file_problem("mobius.yaml") == "mobius.yaml: no such file: did you mean mobius-pi.yaml?"
    Path("pi.yaml").write_text(GOOD)
    assert file_problem("pi") == "pi: no such file: did you mean pi.yaml?"
    assert file_problem("a\nb\0.yaml") == "'a\\nb\\x00.yaml': cannot be read: embedded null byte"


def test_a_folder_and_a_file_that_cannot_be_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert file_problem(tmp_path) == f"{tmp_path}: is a folder: name a config file in it"

    def refuse(*_: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("builtins.open", refuse)
    assert file_problem("m.yaml") == "m.yaml: cannot be read: permission denied"


def test_other_encodings(tmp_path: Path) -> None:
    path = tmp_path / "m.yaml"
    path.write_bytes("name: x\n# ä Möbius\n".encode()[:-8] + "ö\n".encode("latin-1"))
    assert file_problem(path) == f"{path}:2:5: not UTF-8, byte 0xf6 at offset 13: save the file in UTF-8"
    path.write_bytes(GOOD.encode("utf-16"))
    place = f"{path}:1:1: not UTF-8, byte 0xff at offset 0"
    assert file_problem(path) == f"{place} (it looks like UTF-16): save the file in UTF-8"


def test_a_file_too_large(tmp_path: Path) -> None:
    path = tmp_path / "m.yaml"
    path.write_bytes(GOOD.encode() + b"#" * (1 << 20))
    assert file_problem(path) == f"{path}: larger than 1 MiB, which no config needs"
    assert problems_of("#" * (1 << 20) + "\n") == ["mobius.yaml: larger than 1 MiB, which no config needs"]


@pytest.mark.skipif(not os.path.exists("/dev/zero"), reason="no such device")
def test_an_endless_file_is_not_read_to_its_end() -> None:
    assert file_problem("/dev/zero") == "/dev/zero: larger than 1 MiB, which no config needs"


def test_the_import_is_light() -> None:
    code = "import sys, ribbon_cli.config; print({'numpy', 'scipy', 'h5py'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "set()\n"

"""`ribbon init` and `ribbon check`."""

from __future__ import annotations

from pathlib import Path

import pytest
from cli_support import QUICK_RING, ribbon, ribbon_json

from ribbon_cli.config import load_config, templates


@pytest.fixture(autouse=True)
def _in_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize("name", templates())
def test_init_writes_a_config_that_checks(name, tmp_path):
    result = ribbon("init", name)
    assert (result.exit_code, result.stdout) == (0, f"{name}.yaml\n")
    assert (tmp_path / f"{name}.yaml").read_text() == templates()[name]
    assert load_config(f"{name}.yaml").name == name
    assert ribbon("check", f"{name}.yaml").exit_code == 0


def test_the_run_is_called_as_the_file_that_init_writes():
    ribbon("init", "-o", "my-band.yaml")
    assert load_config("my-band.yaml").name == "my-band"
    template, written = templates()["mobius-pi"], Path("my-band.yaml").read_text()
    assert written == template.replace("\nname: mobius-pi\n", "\nname: my-band\n")
    for name in ("my band.yaml", "null.yaml"):  # no name of a run
        ribbon("init", "ring", "-o", name)
        assert load_config(name).name == "ring"
    ribbon("init", "ring", "-o", "1.5.yaml")
    assert load_config("1.5.yaml").name == "1.5"


def test_init_never_overwrites(tmp_path):
    (tmp_path / "mobius-pi.yaml").write_text("mine")
    result = ribbon("init")
    assert (result.exit_code, result.stdout) == (2, "")
    assert "mobius-pi.yaml: exists already and is not replaced" in result.stderr
    assert (tmp_path / "mobius-pi.yaml").read_text() == "mine"
    assert ribbon_json("init", "ring", "-o", "my.yaml") == {"path": "my.yaml", "template": "ring"}
    assert "its folder does not exist" in ribbon("init", "-o", "none/my.yaml").stderr


def test_init_lists_templates_and_near_misses():
    lines = ribbon("init", "--list").stdout.splitlines()
    assert [line.split()[0] for line in lines] == list(templates())
    assert "strip             A strip clamped at both ends, buckled, then sheared and widened" in lines
    assert all(len(line) <= 120 for line in lines)
    assert ribbon_json("init", "--list") == list(templates())
    assert "no template 'rings'; did you mean ring?" in ribbon("init", "rings").stderr
    assert "no template '3pi'; did you mean mobius-3pi?" in ribbon("init", "3pi").stderr
    result = ribbon("init", "zzz")
    assert result.exit_code == 2
    assert (
        "there are everted-branch, everted-cylinder, mobius-3pi, mobius-pi-left, mobius-pi, ring"
        in result.stderr
    )


def test_check_prints_stages_and_cost(tmp_path):
    (tmp_path / "ring.yaml").write_text(QUICK_RING)
    result = ribbon("check", "ring.yaml")
    assert result.exit_code == 0
    assert "ring.yaml: valid, run ring-" in result.stdout
    assert "about" in result.stdout
    document = ribbon_json("check", "ring.yaml")
    assert document["valid"] is True
    assert document["run"].startswith("ring-")
    assert document["cost_seconds"] > 0
    targets = [
        (stage["half_width"], stage["segments"])
        for stage in document["stages"]
        if stage["kind"] == "equilibrium"
    ]
    assert sorted(set(targets)) == [(0.1, 12), (0.1, 24), (0.5, 12), (0.5, 24)]


def test_check_shortens_long_series():
    ribbon("init")
    short, whole = ribbon("check", "mobius-pi.yaml").stdout, ribbon("check", "mobius-pi.yaml", "-v").stdout
    assert "twist 50/50" in short
    assert "twist 25/50" not in short
    assert "twist 25/50" in whole


def test_check_names_every_problem_with_its_place(tmp_path):
    (tmp_path / "bad.yaml").write_text(QUICK_RING.replace("0.5", "-0.5").replace("half_twists", "half_twist"))
    result = ribbon("check", "bad.yaml", "-q")
    assert (result.exit_code, result.stdout) == (2, "")
    lines = result.stderr.splitlines()
    assert all(line.startswith("bad.yaml:") for line in lines)
    assert any(line.startswith("bad.yaml:4:15: widths[1]: must be > 0, got -0.5") for line in lines)
    document = ribbon_json("check", "bad.yaml", code=2)
    assert document["valid"] is False
    assert {"line": 4, "column": 15} in [
        {key: problem[key] for key in ("line", "column")} for problem in document["problems"]
    ]
    assert len(document["problems"]) == len(lines)


def test_check_opens_a_given_state(tmp_path):
    """What `solve` would refuse is refused; a file of the user's own is bad input, not a damaged store."""
    state = "name: again\ntopology: {half_twists: 1}\ninitial_guess: {state: STATE}\nwidths: [0.1, 0.2]\n"
    known = (Path(__file__).parent.parent / "configs/paper/data/pi-b0.1-N50-second-minimum.npz").as_posix()
    (tmp_path / "good.yaml").write_text(state.replace("STATE", known))
    (tmp_path / "left.yaml").write_text(state.replace("STATE", known).replace("twists: 1", "twists: -1"))
    (tmp_path / "none.yaml").write_text(state.replace("STATE", "nothing:3"))
    (tmp_path / "bad.yaml").write_text(state.replace("STATE", "bad.npz"))
    (tmp_path / "bad.npz").write_bytes(b"not an archive")
    stages = ribbon_json("check", "good.yaml")["stages"]
    assert [(stage["kind"], stage["half_width"], stage["segments"]) for stage in stages] == [
        ("equilibrium", 0.1, 50),
        ("equilibrium", 0.2, 50),
    ]
    for name, words in (
        ("left", "has Lk = 0.5"),
        ("none", "no run 'nothing'"),
        ("bad", "bad.npz: not a state"),
    ):
        for command in ("check", "solve"):
            result = ribbon(command, f"{name}.yaml")
            assert (result.exit_code, result.stdout) == (2, ""), name
            assert words in result.stderr
    assert not (tmp_path / "runs").exists()

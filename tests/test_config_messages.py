"""What each kind of broken config says, to the column."""

from __future__ import annotations

import pickle

import pytest
from config_samples import GOOD, KNOWN, MINIMAL, changed, problems_of

from ribbon_cli.config import (
    ConfigError,
    Mistake,
    parse_config,
)
from ribbon_cli.errors import UsageError


def schoenke(half_twists: int, segments: int, half_width: float) -> str:
    """GOOD with the n-inflection construction in the place of the twist."""
    return changed("half_twists: 1", f"half_twists: {half_twists}").replace(
        "{recipe: twist, segments: 50, half_width: 0.1, steps: 50}",
        f"{{recipe: schoenke, segments: {segments}, half_width: {half_width}}}",
    )


# ---- broken configs: one clear message each


@pytest.mark.parametrize(
    ("text", "line"),
    [
        (  # wrong type
            changed("modes: 12", "modes: many"),
            "mobius.yaml:8:19: spectrum.modes: must be an integer from 0 to 1000, got many",
        ),
        (
            changed("length: 2*pi", "lenght: 2*pi"),
            "mobius.yaml:3:1: lenght: unknown key: did you mean length?",
        ),
        (GOOD + "colour: red\n", f"mobius.yaml:10:1: colour: unknown key: expected {KNOWN}"),
        (GOOD + "length: 3\n", "mobius.yaml:10:1: length: duplicate key, first given on line 3"),
        (
            changed("half_twists: 1", "half_twists: 1, half_twists: 1"),
            "mobius.yaml:2:28: topology.half_twists: duplicate key, first given on line 2",
        ),
        (changed("0.2, 0.5,", "0.2, -0.5,"), "mobius.yaml:6:20: widths[2]: must be > 0, got -0.5"),
        (
            changed("recipe: twist", "recipe: twits"),
            "mobius.yaml:5:25: initial_guess.recipe: must be cylinder, twist, eversion, schoenke, "
            "figure-eight or strip, got twits, did you mean twist?",
        ),
        (
            changed("recipe: twist", "recipe: eversion"),
            "mobius.yaml:5:25: initial_guess.recipe: eversion does not fit the topology: "
            "needs half_twists 0, got 1; take twist",
        ),
        (
            changed("half_twists: 1", "half_twists: 0")
            .replace("recipe: twist, segments: 50", "recipe: eversion, segments: 51")
            .replace("[50, 100, 200, 400]", "[51, 102]"),
            "mobius.yaml:5:45: initial_guess.segments: must be even for the recipe eversion, got 51",
        ),
        (
            changed("half_twists: 1", "half_twists: 0"),
            "mobius.yaml:5:25: initial_guess.recipe: twist does not fit the topology: "
            "needs half_twists 1 or -1, got 0; take cylinder or eversion",
        ),
        (
            changed("half_twists: 1", "half_twists: 2"),
            "mobius.yaml:5:25: initial_guess.recipe: twist does not fit the topology: "
            "needs half_twists 1 or -1, got 2; take figure-eight",
        ),
        (
            changed("half_twists: 1", "half_twists: -3"),
            "mobius.yaml:5:25: initial_guess.recipe: twist does not fit the topology: "
            "needs half_twists 1 or -1, got -3; take schoenke",
        ),
        (
            schoenke(2, 50, 0.1),
            "mobius.yaml:5:25: initial_guess.recipe: schoenke does not fit the topology: "
            "needs half_twists 3 or more, or -3 or less, got 2; take figure-eight",
        ),
        (
            schoenke(7, 50, 0.1),
            "mobius.yaml:5:45: initial_guess.segments: "
            "must be at least 56 for schoenke with 7 half-twists, got 50",
        ),
        (
            schoenke(-5, 50, 0.46),
            "mobius.yaml:5:61: initial_guess.half_width: must be less than 0.4565, "
            "where the rulings of schoenke with 5 half-twists meet, got 0.46",
        ),
        ("", "mobius.yaml:1:1: the file holds no settings; `ribbon init` writes a config to start from"),
        (
            "# only this\n\n",
            "mobius.yaml:1:1: the file holds no settings; `ribbon init` writes a config to start from",
        ),
        ("---\n", "mobius.yaml:1:1: the file holds no settings; `ribbon init` writes a config to start from"),
        (
            changed("topology: {half_twists: 1}", "topology:\n\thalf_twists: 1"),
            "mobius.yaml:3:1: tab character: indent and separate with spaces alone",
        ),
        (
            changed("length: 2", "length:\t2"),
            "mobius.yaml:3:8: tab character: indent and separate with spaces alone",
        ),
        (GOOD + "# \x07", "mobius.yaml:10:3: control character U+0007: remove it"),
        ("a: \x00", "mobius.yaml:1:4: control character U+0000: remove it"),
        ("# \u2028\n", "mobius.yaml:1:3: control character U+2028: remove it"),
        ("a: \ud800\n", "mobius.yaml:1:4: control character U+D800: remove it"),
        (
            "- 1\n- 2\n",
            "mobius.yaml:1:1: must be settings such as 'length: 2*pi', each on its line, got a list",
        ),
        (
            "length 2*pi",
            "mobius.yaml:1:1: must be settings such as 'length: 2*pi', each on its line, got length 2*pi",
        ),
        (
            GOOD + "---\nname: x\n",
            "mobius.yaml:10:1: a second document: a config is one document, without a further '---'",
        ),
        ("%YAML 1.2\n---\n" + GOOD, "mobius.yaml:1:1: YAML directives (%) are not accepted: remove the line"),
        (changed("2*pi", "&l 2*pi"), "mobius.yaml:3:9: anchors (&l) are not accepted: remove it"),
        (changed("2*pi", "*pi"), "mobius.yaml:3:9: aliases (*pi) are not accepted: write the value"),
        (changed("2*pi", "!!float 2"), "mobius.yaml:3:9: tags (!!float) are not accepted: remove it"),
        (changed("2*pi", "! 2"), "mobius.yaml:3:9: tags (!) are not accepted: remove it"),
        (
            changed("2*pi", "!!python/object/apply:os.system [ls]"),
            "mobius.yaml:3:9: tags (!!python/object/apply:os.system) are not accepted: remove it",
        ),
        (changed("2*pi", ""), "mobius.yaml:3:1: length: has no value: give one, or leave the key out"),
        (changed("2*pi", "~"), "mobius.yaml:3:1: length: has no value: give one, or leave the key out"),
        (
            changed("2*pi", "2pi"),
            "mobius.yaml:3:9: length: must be a number such as 0.5, 1e-3, 2*pi or pi/30, got 2pi "
            "(not made of numbers, pi, + - * / and parentheses)",
        ),
        (
            changed("2*pi", "'6.28'"),
            "mobius.yaml:3:9: length: must be a number such as 0.5, 1e-3, 2*pi or pi/30, "
            "got the text '6.28' (in quotes)",
        ),
        (
            changed("2*pi", "yes"),
            "mobius.yaml:3:9: length: must be a number such as 0.5, 1e-3, 2*pi or pi/30, "
            "got yes (to YAML, true or false)",
        ),
        (changed("2*pi", ".nan"), "mobius.yaml:3:9: length: must be finite, got .nan"),
        (changed("2*pi", "-.INF"), "mobius.yaml:3:9: length: must be finite, got -.INF"),
        (
            changed("2*pi", "1e10"),
            "mobius.yaml:3:9: length: must be < 1e+09, the limit for a length, got 1e10",
        ),
        (changed("2*pi", "1e-10"), "mobius.yaml:3:9: length: must be at least 1e-09, got 1e-10"),
        (
            changed("segments: 50", "segments: 50.0"),
            "mobius.yaml:5:42: initial_guess.segments: must be an integer from 8 to 1000000, got 50.0",
        ),
        (
            changed("segments: 50", "segments: " + "9" * 5000),
            "mobius.yaml:5:42: initial_guess.segments: must be an integer from 8 to 1000000, got "
            + "9" * 45
            + "...",
        ),
        (
            changed("half_twists: 1", "half_twists: true"),
            "mobius.yaml:2:25: topology.half_twists: must be an integer from -100 to 100, "
            "got true (to YAML, true or false)",
        ),
        (
            changed("{half_twists: 1}", "1"),
            "mobius.yaml:2:11: topology: must be {half_twists: 1} for a closed band, or open for a strip, "
            "got 1",
        ),
        (
            changed("{half_twists: 1}", "{}"),
            "mobius.yaml:2:11: topology.half_twists: is missing: "
            "give 0 for a cylinder, 1 or -1 for a Moebius band",
        ),
        (
            changed("segments: 50, ", ""),
            "mobius.yaml:5:16: initial_guess.segments: is missing: give an integer from 8 to 1000000",
        ),
        (
            changed("recipe: twist, ", ""),
            "mobius.yaml:5:16: initial_guess.recipe: is missing: "
            "give cylinder, twist, eversion, schoenke, figure-eight, strip, "
            "or start from a state: {state: ...}",
        ),
        (
            changed("half_width: 0.1", "half_width: 7"),
            "mobius.yaml:5:58: initial_guess.half_width: must be < 6.28319, the band's length, got 7",
        ),
        (
            changed("steps: 50", "steps: 0"),
            "mobius.yaml:5:70: initial_guess.steps: must be an integer from 1 to 10000, got 0",
        ),
        (
            changed("0.2, 0.5", "0.5, 0.5"),
            "mobius.yaml:6:20: widths[2]: must differ from the width before it, got 0.5 again",
        ),
        (
            changed("0.2, 0.5", "[], 0.5"),
            "mobius.yaml:6:15: widths[1]: must be a number such as 0.5, 1e-3, 2*pi or pi/30, got a list",
        ),
        (
            changed("[0.1, 0.2, 0.5, 0.8, 1.0, 1.5]", "[]"),
            "mobius.yaml:6:9: widths: must have at least one item, got an empty list",
        ),
        (
            changed("[0.1, 0.2, 0.5, 0.8, 1.0, 1.5]", "0.5"),
            "mobius.yaml:6:9: widths: must be a list as [0.1, 0.2, 0.5], a range as "
            "{from: 0.1, to: 1.5, steps: 28} "
            "or a branch as {arclength: {to: 0.2}}, got 0.5",
        ),
        (
            changed("[0.1, 0.2, 0.5, 0.8, 1.0, 1.5]", "{from: 0.1, to: 0.1, steps: 3}"),
            "mobius.yaml:6:25: widths.to: must differ from widths.from, got 0.1",
        ),
        (
            changed("[0.1, 0.2, 0.5, 0.8, 1.0, 1.5]", "{from: 0.1, to: 0.10000001, steps: 9999}"),
            "mobius.yaml:6:44: widths.steps: must keep the widths distinct, got 9999: take fewer",
        ),
        (
            changed("[0.1, 0.2, 0.5, 0.8, 1.0, 1.5]", "{from: 0.1, to: 1, steps: 10000}"),
            "mobius.yaml:6:35: widths.steps: must be an integer from 1 to 9999, got 10000",
        ),
        (
            changed("[0.1, 0.2, 0.5, 0.8, 1.0, 1.5]", "{arc: {}}"),
            "mobius.yaml:6:10: widths.arc: unknown key: expected from, to or steps",
        ),
        (
            changed("[50, 100, 200, 400]", "[50, 100, 300, 600]"),
            "mobius.yaml:7:23: refinement[2]: must be 200, twice the level before, got 300",
        ),
        (
            changed("[50, 100, 200, 400]", "[60, 120]"),
            "mobius.yaml:7:14: refinement[0]: must be 50, the guess's segments, got 60",
        ),
        (
            changed("[50, 100, 200, 400]", "{levels: [50, 100], at: [0.5, 0.6]}"),
            "mobius.yaml:7:43: refinement.at[1]: must be one of the widths, got 0.6 (nearest: 0.5)",
        ),
        (
            changed("[50, 100, 200, 400]", "{levels: [50], at: [0.5, 5e-1]}"),
            "mobius.yaml:7:38: refinement.at[1]: must be given once, got 5e-1 again",
        ),
        (
            changed("[50, 100, 200, 400]", "{at: [0.5]}"),
            "mobius.yaml:7:13: refinement.levels: is missing: give the numbers of segments",
        ),
        (
            changed("[50, 100, 200, 400]", "4"),
            "mobius.yaml:7:13: refinement: must be a list as [50, 100, 200], or "
            "{levels: [50, 100, 200], at: [0.5]}, got 4",
        ),
        (
            changed("full_up_to: 200", "metrics: [physical, physical]"),
            "mobius.yaml:8:43: spectrum.metrics[1]: must be given once, got physical again",
        ),
        (
            changed("contact: record", "contact: recrod"),
            "mobius.yaml:9:10: contact: must be record, stop or forces, got recrod, did you mean record?",
        ),
        (
            changed("name: mobius-pi", "name: ../x"),
            "mobius.yaml:1:7: name: must be 1 to 64 of the characters A-Z a-z 0-9 . _ - "
            "and begin with a letter or digit, got ../x",
        ),
        (
            changed("name: mobius-pi", 'name: "a\\e[31m\\n"'),
            "mobius.yaml:1:7: name: must be 1 to 64 of the characters A-Z a-z 0-9 . _ - "
            "and begin with a letter or digit, got the text 'a\\x1b[31m\\n' (in quotes)",
        ),
        (
            changed("{modes: 12, full_up_to: 200}", "[12, 200]"),
            "mobius.yaml:8:11: spectrum: "
            "must be a mapping {modes: ..., full_up_to: ..., metrics: ...}, got a list",
        ),
        (
            changed("[50, 100, 200, 400]", "{levels: {a: 1}}"),
            "mobius.yaml:7:22: refinement.levels: must be a list, got a mapping",
        ),
        (
            changed("contact: record", f"contact: '{'r' * 50}'"),
            f"mobius.yaml:9:10: contact: must be record, stop, forces or {{gap: 0.02}}, got the text "
            f"'{'r' * 40}'... (in quotes)",
        ),
        ("? [a]\n: b\n" + GOOD, "mobius.yaml:1:3: a key must be a word, got a list"),
        (
            changed(
                "{recipe: twist, segments: 50, half_width: 0.1, steps: 50}",
                "{recipe: twist, segments: 50, half_width: 0.1, state: x:1}",
            ),
            "mobius.yaml:5:63: initial_guess.state: cannot be combined with a recipe: keep one of the two",
        ),
    ],
)
def test_one_mistake_gives_one_message(text: str, line: str) -> None:
    assert problems_of(text) == [line]


STATE = "topology: {half_twists: 1}\ninitial_guess: "


@pytest.mark.parametrize(
    ("guess", "line"),
    [
        (
            "{state: x:1, half_width: 0.1}",
            "m.yaml:2:29: initial_guess.half_width: comes with the state: remove it",
        ),
        (
            "{state: x:1, steps: 3}",
            "m.yaml:2:29: initial_guess.steps: does not go with a state: remove it",
        ),
        (
            "{state: m@b=0.5,N=400}",
            "m.yaml:2:32: initial_guess.N=400: is cut off from the reference: put the whole of it in quotes",
        ),
        (
            "{state: ../../etc/passwd}",
            "m.yaml:2:24: initial_guess.state: must be a state, as RUN:LABEL or 'RUN@b=0.5,N=400', "
            "or the path of a .npz or .h5 file, got ../../etc/passwd",
        ),
        (
            '{state: "a\\0.npz"}',
            "m.yaml:2:24: initial_guess.state: must be a state, as RUN:LABEL or 'RUN@b=0.5,N=400', "
            "or the path of a .npz or .h5 file, got the text 'a\\x00.npz' (in quotes)",
        ),
        (
            "{recipe: cylinder, segments: 50, half_width: 0.1, steps: 3}\n",
            "m.yaml:2:66: initial_guess.steps: unknown key for cylinder: "
            "expected recipe, segments or half_width",
        ),
        (
            "twist",
            "m.yaml:2:16: initial_guess: "
            "must be a mapping {recipe: ..., segments: ..., half_width: ...}, got twist",
        ),
        (
            "{state: x:1}\nrefinement: {levels: [50], at: [0.5]}",
            "m.yaml:3:33: refinement.at[0]: must be one of the widths, got 0.5, "
            "and there are none: give widths",
        ),
    ],
)
def test_mistakes_about_the_guess(guess: str, line: str) -> None:
    text = STATE + guess
    if "cylinder" in guess:
        text = text.replace("half_twists: 1", "half_twists: 0")
    assert problems_of(text, "m.yaml") == [line]


def test_all_problems_at_once_in_the_order_of_the_file() -> None:
    text = (
        "contact: maybe\n"
        "widths: [0.1, -0.5, x]\n"
        "lenght: 3\n"
        "topology: {half_twists: 0}\n"
        "initial_guess: {recipe: twist, segments: 4, half_width: 0.1}\n"
        "refinement: [50, 90]\n"
        "spectrum: {modes: &a 5}\n"
        "contact: stop\n"
    )
    number = "must be a number such as 0.5, 1e-3, 2*pi or pi/30, got x"
    assert problems_of(text) == [
        "mobius.yaml:1:10: contact: must be record, stop, forces or {gap: 0.02}, got maybe",
        "mobius.yaml:2:15: widths[1]: must be > 0, got -0.5",
        f"mobius.yaml:2:21: widths[2]: {number} (not made of numbers, pi, + - * / and parentheses)",
        "mobius.yaml:3:1: lenght: unknown key: did you mean length?",
        "mobius.yaml:5:25: initial_guess.recipe: twist does not fit the topology: "
        "needs half_twists 1 or -1, got 0; take cylinder or eversion",
        "mobius.yaml:5:42: initial_guess.segments: must be an integer from 8 to 1000000, got 4",
        "mobius.yaml:6:18: refinement[1]: must be 100, twice the level before, got 90",
        "mobius.yaml:7:19: anchors (&a) are not accepted: remove it",
        "mobius.yaml:8:1: contact: duplicate key, first given on line 1",
    ]


def test_missing_sections_are_named() -> None:
    assert problems_of("name: x\n") == [
        "mobius.yaml:1:1: topology: is missing: "
        "give {half_twists: 1} for a Moebius band, 0 for a cylinder, open for a strip",
        "mobius.yaml:1:1: initial_guess: is missing: "
        "give a recipe, as {recipe: twist, segments: 50, half_width: 0.1}",
    ]


def test_a_stem_that_cannot_name_a_run() -> None:
    rule = "give 1 to 64 of the characters A-Z a-z 0-9 . _ - and begin with a letter or digit"
    assert problems_of(MINIMAL, "x/my band.yaml") == [
        f"x/my band.yaml:1:1: name: is missing, and the file's 'my band' cannot be used for it: {rule}"
    ]


def test_the_error_carries_its_problems() -> None:
    with pytest.raises(UsageError) as caught:
        parse_config(changed("0.2, 0.5,", "0.2, -0.5,"), "mobius.yaml")
    error = caught.value
    assert isinstance(error, ConfigError)
    assert error.mistakes == (Mistake(6, 20, "widths[2]", "must be > 0, got -0.5"),)
    assert str(pickle.loads(pickle.dumps(error))) == str(error)

"""Errors carry the line and the path of the key they speak of."""

from pathlib import Path

import pytest
import test_bad_input
import tomlkit
from test_bad_input import CAMPAIGN, MACHINE, mutated

from symfive.campaign import read_campaign
from symfive.errors import InputError
from symfive.machine import read_machine
from symfive.toml_files import parse_toml, toml_text

campaign_folder = test_bad_input.campaign_folder  # a fixture


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('schema = "symfive.machine/1"', 'schema = "other"', "schema"),
        ('name = "m"', "name = ", "TOML"),
        ("structure = \"w C' B' X' b Y Z t\"", 'structure = "XYZ"', "XYZ"),
        ("max_feed = 9000.0", 'max_feed = "fast"', "max_feed"),
        ("max_feed = 9000.0", "max_feed = nan", "finite"),
        ("sigma = 5.0", "sigma = -5.0", "sigma"),
        ('effect = "backlash", axis = "C"', 'effect = "backlash", axis = "Q"', "axis"),
        ("EX0C", "EX0X", "no position of its own"),
    ],
)
def test_lines_are_named(tmp_path, old, new, said):
    text = toml_text(MACHINE, sections=("axes",))
    assert old in text
    path = tmp_path / "machine.toml"
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(InputError, match=said) as caught:
        read_machine(path)
    lines = path.read_text().splitlines()
    assert new.split("=")[0].strip() in lines[caught.value.line - 1], (caught.value.line, lines)


def test_line_of_keys():
    text = '# x\na = 1\n[[run]]\nid = 1\n[run.more]\ny = 2\n[[run]]\nid = 2 # id = 3\n[b."c"]\nd = { e = 1 }\n'
    file = parse_toml(Path("f"), text)
    assert file.line("a") == 2
    assert file.line("run", 0, "id") == 4 and file.line("run", 1, "id") == 8
    assert file.line("run", 0, "more", "y") == 6
    assert file.line("run", 1, "missing") == 7
    assert file.line("b", "c", "d", "e") == 10
    assert file.line("nowhere") == 1


def test_line_of_keys_in_blocks_of_blocks():
    text = "[[run]]\n[[run.s]]\na = 1\n[[run]]\n[[run.s]]\na = 1\n[[run.s]]\na = 1\n[run.s.t]\nb = 1\n"
    file = parse_toml(Path("f"), text)
    assert [file.line("run", 0, "s", 0, "a"), file.line("run", 1, "s", 0, "a"), file.line("run", 1, "s", 1, "a")] == [
        3,
        6,
        8,
    ]
    assert file.line("run", 1, "s", 1, "t", "b") == 10 and file.line("run", 1, "s", 7) == 4


WRONG_IN_A_MACHINE = [  # whatever words stand in the sentence: a drive whose axis is called "viscous", an effect "EX0C"
    ("axes", "C", "drive", "viscous", -1.0),
    ("axes", "X", "travel", [5.0, -5.0]),
    ("axes", "Y", "direction", [0.0, 0.0, 0.0]),
    ("errors", "EAC", "over", ["B", "Q"]),
    ("errors", "EXC", "order", 0),
    ("errors", "EX0C", "mean", "sigma"),
    ("workspace", "spindle_nose", "radius", -1.0),
    ("workspace", "ball_height", [9.0, 1.0]),
    ("model", "effects", 0, "axis", "EX0C"),
]  # fmt: skip
WRONG_IN_A_CAMPAIGN = [
    ("run", 0, "noise_um", "length"),
    ("run", 1, "noise_um", {"id": 1.0}),
    ("run", 0, "setup_sigma_um", "tool_ball", -1.0),
    ("run", 2, "u", [2.0, 0.0, 0.0]),
    ("run", 3, "axis", "Q"),
    ("run", 4, "sensors", 0, {"direction": [1.0, 0.0, 0.0]}),
    ("run", 5, "force_terms", ["mass", "sampling"]),
    ("run", 2, "id", "a"),
    ("run", 4, "file", "a.csv"),
]


@pytest.mark.parametrize("change", WRONG_IN_A_MACHINE, ids=lambda c: ".".join(map(str, c[:-1])))
def test_an_error_carries_the_path_of_its_key(tmp_path, change):
    path = tmp_path / "machine.toml"
    path.write_text(toml_text(mutated(MACHINE, change[:-1], change[-1]), sections=("axes", "errors")))
    with pytest.raises(InputError) as caught:
        read_machine(path)
    assert caught.value.keys == change[:-1]
    written = [key for key in change[:-1] if f"{key} = " in path.read_text()][-1]
    assert f"{written} = " in path.read_text().splitlines()[caught.value.line - 1]


@pytest.mark.parametrize("change", WRONG_IN_A_CAMPAIGN, ids=lambda c: ".".join(map(str, c[:-1])))
@pytest.mark.parametrize("name", ["file", "sampling"])
def test_an_error_carries_the_path_of_its_key_whatever_the_runs_are_called(campaign_folder, change, name):
    data = mutated(CAMPAIGN, change[:-1], change[-1])
    if change[2] != "id":
        data["run"][change[1]]["id"] = name  # a key's name in the sentence is not the key
    path = campaign_folder / "mutated.toml"
    path.write_text(toml_text(data))
    with pytest.raises(InputError) as caught:
        read_campaign(path)
    assert caught.value.keys == change[:-1]
    assert path.read_text().splitlines()[caught.value.line - 1].startswith(f"{change[2]} = ")


def test_comments_are_found_outside_strings_only():
    text = "a = \"# no\" # yes\nb = '''\n# no\n''' # too\n#\nc = \"\\\"#no\" #end\n"
    assert parse_toml(Path("f"), text).comments == ("yes", "too", "", "end")
    assert tomlkit.parse(toml_text({"x": 1}, ["yes", "", "end"]))["x"] == 1

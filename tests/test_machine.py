"""Machines: presets, validation, files read and written without loss."""

import tomllib
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from symfive.errors import InputError
from symfive.machine import (
    ErrorTerm,
    Machine,
    Structure,
    error_names,
    machine_from_data,
    machine_problems,
    machine_to_data,
    make_axis,
    preset,
    presets,
    read_machine,
    unknown_keys,
    write_machine,
)

TEXT = """# a machine with everything
schema = "symfive.machine/1"
name = "full # of things"   # its name
structure = "w C' B' X' Y' b Z t"
note = "kept"

[axes.X]
travel = [-300.0, 300.0]        # mm
max_feed = 15000.0
colour = "blue"                 # unknown
[axes.Y]
[axes.Z]
travel = [-100.0, 400.0]
[axes.B]
origin = [0.0, 0.0, -50.0]
direction = [0.0, 1.0, 1.0]     # nutating
[axes.C]
travel = [-3600.0, 3600.0]
[axes.C.drive]                  # the servo
position_gain = 40.0
velocity_gain = 350.0
integral_time = 0.05
serial = 17

[errors]
EX0C = { sigma = 50.0, mean = 3.0, source = "R-test" }
EXC = { basis = "fourier", order = 2, sigma = 5.0 }
EAC = { over = ["B", "C"], basis = ["polynomial", "fourier"], order = [2, 1], sigma = 20.0 }
EZB = { basis = "bspline", order = 3, knots = [-90.0, 0.0, 90.0], sigma = 10.0 }

[workspace]
table_radius = 150.0
bar_lengths = [50.0, 100.0]
spindle_nose = { radius = 40.0, above_ball = 60.0 }
fixture = "vice"
obstacles = { vice = [[60.0, -50.0, 0.0], [160.0, 50.0, 80.0]] }

[model]
effects = [{ effect = "backlash", axis = "C", width = 41.0 }, "thermal_drift"]
origin = "shop"

[maker]
name = "nobody"
since = 1999-05-27
"""


@pytest.fixture
def full(tmp_path):
    path = tmp_path / "full.toml"
    path.write_text(TEXT)
    return read_machine(path)


def same(a: Machine, b: Machine) -> bool:
    return a == b and machine_to_data(a) == machine_to_data(b)


def test_presets_are_the_eight_designs():
    assert {"wang-li-2016", "oyama-2010", "tsutsumi-2007", "table-bc", "nutating-table"} <= set(presets())
    assert {"head-bc", "mixed-bc", "three-axis"} <= set(presets())


@pytest.mark.parametrize("name", presets())
def test_preset(name, tmp_path):
    machine = preset(name)
    assert not unknown_keys(machine)
    assert all(axis.max_feed and axis.max_acceleration for axis in machine.axes.values())
    assert machine.errors and machine.comments
    workspace = machine.workspace
    assert workspace.table_radius and workspace.ball_height and workspace.tool_length and workspace.bar_lengths
    write_machine(machine, tmp_path / "m.toml")
    assert (tmp_path / "m.toml").read_text() == machine.text
    write_machine(replace(machine, text=""), tmp_path / "m.toml")
    assert same(read_machine(tmp_path / "m.toml"), machine)


def test_structures_of_the_papers():
    assert preset("wang-li-2016").structure.code == "w C' B' X' Y' b Z t"
    assert preset("oyama-2010").structure.code == "w C' B' Y' b X Z t"
    assert preset("tsutsumi-2007").structure.code == "w C' A' Y' b X Z t"


def test_drives_of_paper_3_are_inertia_normalised():
    """SEEDS 3c, set S: X J .028, C .04, Gv 200; C J .025, C .005, Gv 35; Gp 40 and Ti .05 for both."""
    axes = preset("tsutsumi-2007").axes
    for name, inertia, viscous, gain in (("X", 0.028, 0.04, 200.0), ("C", 0.025, 0.005, 35.0)):
        drive = axes[name].drive
        assert (drive.position_gain, drive.velocity_gain, drive.integral_time) == (40.0, gain, 0.05)
        assert drive.viscous == pytest.approx(viscous / inertia, rel=1e-12) and drive.feedforward == 0.0


def test_unknown_preset_names_the_known_ones():
    with pytest.raises(InputError, match=r"table-bc.*three-axis"):
        preset("lathe")


def test_everything_is_read(full):
    assert full.name == "full # of things"
    assert full.axes["X"].extra == {"colour": "blue"}
    assert full.axes["B"].direction == pytest.approx((0.0, 2**-0.5, 2**-0.5))
    assert full.axes["C"].drive.extra == {"serial": 17}
    assert full.errors["EZB"].knots == ((-90.0, 0.0, 90.0),)
    assert full.errors["EAC"].over == ("B", "C")
    assert [e.effect for e in full.effects] == ["backlash", "thermal_drift"]
    assert full.effects[0].options == {"width": 41.0}
    assert set(unknown_keys(full)) == {
        "note", "maker", "model.origin", "axes.X.colour", "axes.C.drive.serial", "errors.EX0C.source",
        "workspace.fixture",
    }  # fmt: skip
    assert full.comments == ("a machine with everything", "its name", "mm", "unknown", "nutating", "the servo")


def test_unchanged_machine_is_written_verbatim(full, tmp_path, monkeypatch):
    monkeypatch.setattr("tomlkit.parse", None)  # which takes longer than all else and has nothing to edit
    write_machine(full, tmp_path / "again.toml")
    assert (tmp_path / "again.toml").read_text() == TEXT


def test_changed_machine_keeps_comments_and_layout(full, tmp_path):
    axes = {**full.axes, "X": replace(full.axes["X"], travel=(-200.0, 300.0))}
    errors = {k: v for k, v in full.errors.items() if k != "EXC"} | {"EY0C": ErrorTerm(name="EY0C", sigma=7.0)}
    changed = replace(full, axes=axes, errors=errors, name="other")
    write_machine(changed, tmp_path / "changed.toml")
    text = (tmp_path / "changed.toml").read_text()
    assert same(read_machine(tmp_path / "changed.toml"), changed)
    assert "travel = [-200.0, 300.0]        # mm" in text.replace("]# mm", "]        # mm")
    assert "direction = [0.0, 1.0, 1.0]     # nutating" in text
    assert read_machine(tmp_path / "changed.toml").comments == full.comments


def test_machine_without_a_file_is_written_in_full(full, tmp_path):
    write_machine(replace(full, text=""), tmp_path / "new.toml")
    again = read_machine(tmp_path / "new.toml")
    assert same(again, full)
    assert again.comments == full.comments
    assert tomllib.loads((tmp_path / "new.toml").read_text())["maker"]["since"].year == 1999


def test_data_round_trip(full):
    assert same(machine_from_data(machine_to_data(full)), replace(full, comments=()))


def test_a_machine_can_be_a_top_level_key_after_tables(tmp_path, full):
    machine = replace(full, text="", extra={"maker": {"name": "x"}, "later": 1, "a.b": 2, 'q"': 3, "": 4})
    write_machine(machine, tmp_path / "m.toml")
    assert read_machine(tmp_path / "m.toml").extra == machine.extra


@pytest.mark.parametrize("code", ["w C' B' X' Y' b Z t", "w b X Y Z A C t", "w J1' J2' b J3 t", "w X’ b Z t"])
def test_structure_round_trip(code):
    structure = Structure.parse(code)
    assert structure.code == code.replace("’", "'")
    assert Structure.parse(structure.code) == structure


@settings(deadline=None)
@given(st.permutations(list("XYZABCUVW")), st.integers(0, 9), st.integers(1, 9))
def test_any_order_on_either_side(names, bed, count):
    used = names[:count]
    bed = min(bed, count)
    structure = Structure(tuple(used[:bed]), tuple(used[bed:]))
    assert Structure.parse(structure.code) == structure
    assert structure.axes == (*reversed(used[:bed]), *used[bed:])
    assert all(structure.carries(n) == ("workpiece" if n in used[:bed] else "tool") for n in used)


@pytest.mark.parametrize(
    "code",
    ["", "w t", "w b t", "C' b Z t", "w C b Z t", "w C' b Z' t", "w C' b b Z t", "w C' C' b Z t", "w 1' b Z t",
     "w C' b Z", "w w' b Z t", "w C'' b Z t"],
)  # fmt: skip
def test_wrong_structures(code):
    with pytest.raises(InputError) as caught:
        Structure.parse(code)
    assert caught.value.remedy


def test_letters_have_their_directions_and_other_names_need_them():
    assert make_axis("A").direction == (1.0, 0.0, 0.0) and make_axis("A").rotary
    assert make_axis("V").direction == (0.0, 1.0, 0.0) and not make_axis("V").rotary
    for name in ("J1", "XY", "AB", "x"):
        with pytest.raises(InputError, match="no kind"):
            make_axis(name)
    assert make_axis("J1", kind="rotary", direction=(0.0, 0.0, 2.0)).direction == (0.0, 0.0, 1.0)


@pytest.mark.parametrize(
    "fields",
    [{"travel": ()}, {"direction": ()}, {"kind": ""}, {"travel": (1.0, 1.0)}, {"max_feed": 0.0}, {"origin": (1.0, 2.0)},
     {"direction": (0.0, 0.0, 0.0)}, {"direction": (float("nan"), 0.0, 1.0)}, {"max_feed": True},
     {"travel": ("0", "1")}, {"max_acceleration": float("inf")}, {"travel": (-(10**400), 10**400)}],
)  # fmt: skip
def test_wrong_axes(fields):
    with pytest.raises(InputError) as caught:
        make_axis("X", **fields)
    assert caught.value.remedy and "axis" in caught.value.problem


@pytest.mark.parametrize(
    "fields",
    [{"name": "EQ0C"}, {"name": "EX0"}, {"sigma": 0.0}, {"sigma": "5"}, {"basis": ("poly",)}, {"order": (0,)},
     {"order": (2.5,)}, {"over": ("C", "C")}, {"basis": ()}, {"knots": ((1.0, 0.0),)}, {"knots": (("a", "b"),)},
     {"mean": float("nan")}],
)  # fmt: skip
def test_wrong_errors(fields):
    right = {"name": "EXC", "sigma": 5.0, "basis": ("fourier",), "order": (2,)}
    with pytest.raises(InputError) as caught:
        ErrorTerm(**{**right, **fields})
    assert caught.value.remedy


def test_an_axis_that_the_structure_lacks_is_named_with_those_it_has(tmp_path):
    file = tmp_path / "machine.toml"
    text = 'schema = "symfive.machine/1"\nname = "m"\nstructure = "w C\' A\' Y\' b X Z t"\n\n[axes.AA]\ntravel = [-30.0, 110.0]\n'
    file.write_text(text)
    with pytest.raises(
        InputError, match=r"machine.toml, line 5: the structure has no axis 'AA'.*use one of Y, A, C, X, Z"
    ):
        read_machine(file)


HEAD = 'schema = "symfive.machine/1"\nname = "m"\nstructure = "w C\' A\' Y\' b X Z t"\n'
AXES = "".join(f"[axes.{name}]\ntravel = [-30.0, 110.0]\n" for name in "CAYXZ")
DRIVE = "[axes.X.drive]\nvelocity_gain = 350.0\nintegral_time = 0.05\n"
SLIPS = [
    (
        AXES + DRIVE + "kv = 40.0\n",
        r"\[axes.X.drive\] has no key 'kv'; did you mean position_gain\? Correct the name\.$",
    ),
    (
        AXES + DRIVE + "postion_gain = 40.0\n",
        r"has no key 'postion_gain'; did you mean position_gain\? Correct the name\.$",
    ),
    (AXES.replace("travel", "travle", 1), r"\[axes.C\] has no key 'travle'; did you mean travel\? Correct the name\.$"),
    (AXES + "[worspace]\ntable_radius = 120.0\n", r"no key 'worspace'; did you mean workspace\? Correct the name\.$"),
    (
        AXES + "[errors]\nEXOC = { sigma = 5.0 }\n",
        r"did you mean EX0C\? This .* location errors EX0C, .*EY0A, .*EB0Z and",
    ),
    (AXES + "[errors]\nEX0B = { sigma = 5.0 }\n", r"axis 'B', which the machine lacks; did you mean EX0C\?"),
    (AXES + "[errors]\nEQ0C = { sigma = 5.0 }\n", r"'EQ0C' is not an error of ISO 230-1; did you mean E.0C\?"),
    (AXES + "[axes.B]\n", r"no axis 'B'; .*give it its place: \"w B' C' A' Y' b X Z t\" if it carries the workpiece"),
    (AXES.replace("[axes.Z]\ntravel = [-30.0, 110.0]\n", ""), r"line 3: axis Z .* has no table; add \[axes.Z\]"),
    (AXES + "[errors]\nEY0A = 50.0\n", r"line 15: errors.EY0A is not a table; write EY0A = \{ sigma = 50.0 \}"),
    (
        AXES + "[workspace]\nspindle_nose = { diameter = 80.0, above_ball = 60.0 }\n",
        r"line 15: .* spindle_nose has an unknown key 'diameter'; give radius and above_ball",
    ),
    (
        AXES + "[workspace.obstacles]\nvice = [[60.0, -50.0, 0.0]]\n",
        r"line 15: obstacle 'vice' is not two corners; write lowest and highest x, y, z in mm: vice = ",
    ),
    (
        AXES + "[workspace.obstacles]\nvice = [[60.0, -50.0, 0.0], [50.0, 50.0, 80.0]]\n",
        r"line 15: obstacle vice: \[60.0, -50.0, 0.0\] is not below \[50.0, 50.0, 80.0\] in x, y and z; put the lowest",
    ),
    (
        AXES + "[workspace]\nobstacles = [1.0]\n",
        r"line 15: workspace: obstacles = \[1.0\] is not a table; write \[workspace.obstacles\]",
    ),
    (
        AXES + "[workspace]\nspindle_nose = { radius = 40.0 }\n",
        r"line 15: .* spindle_nose lacks the key 'above_ball'; give radius and above_ball",
    ),
    (
        AXES + "[workspace]\ntool_length = [120.0, 180.0]\nspindle_nose = { radius = 40.0, above_ball = 260.0 }\n",
        r"line 16: .* above_ball = 260 is more than the tool length of 120 mm; give the height of the spindle nose",
    ),
    (AXES + "[workspace]\ntool_length = [-180.0, -120.0]\n", r"line 15: .* tool_length = -180.0 is not positive"),
]


@pytest.mark.parametrize(("text", "says"), SLIPS, ids=[str(i) for i in range(len(SLIPS))])
def test_a_slip_is_answered_with_what_was_meant(tmp_path, text, says):
    (tmp_path / "m.toml").write_text(HEAD + text)
    with pytest.raises(InputError, match=says):
        read_machine(tmp_path / "m.toml")


def test_all_problems_of_a_file_are_found(tmp_path):
    errors = "[errors]\nEX0C = { sigma = -5.0 }\nEY0C = { sigma = 5.0 }\nEX0X = { sigma = 1.0 }\n"
    text = AXES.replace("travel", "travle", 1) + errors
    (tmp_path / "m.toml").write_text(HEAD + text + "[workspace]\ntable_radius = -1.0\n")
    machine, problems = machine_problems(tmp_path / "m.toml")
    assert machine is not None and list(machine.errors) == ["EY0C"]
    assert [error.line for error in problems] == [5, 15, 17, 19]
    (tmp_path / "m.toml").write_text("schema = ")
    assert machine_problems(tmp_path / "m.toml")[0] is None


@pytest.mark.parametrize("name", presets())
def test_the_suggested_errors_of_every_machine_are_accepted(name):
    machine = preset(name)
    errors = {key: ErrorTerm(name=key, sigma=sigma) for key, sigma in error_names(machine.axes).items()}
    assert len(errors) >= 3 and replace(machine, errors=errors, text="").errors

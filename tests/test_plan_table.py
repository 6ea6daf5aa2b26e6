"""Where a ball may stand: the table belongs to the rotary axis that carries it, wherever that axis stands."""

import math
from dataclasses import replace

import pytest

from symfive.check import check
from symfive.design import plan, plan_circles
from symfive.effects import make_effect
from symfive.errors import InputError
from symfive.machine import Machine, Structure, preset, read_machine, write_machine
from symfive.nc import program
from symfive.plausible import doubts
from symfive.procedures import campaign_of, cone_circle, planar_circle, r_test_grid, rotary_circle, static_ball_bar

CENTRE = (250.0, 200.0)


def off_centre(name: str = "table-bc") -> Machine:
    """A preset whose table, with C in its middle, stands at `CENTRE` of the workpiece frame."""
    machine = preset(name)
    axes = {**machine.axes, "C": replace(machine.axes["C"], origin=(*CENTRE, 0.0))}
    for axis, by in zip("XY", CENTRE, strict=True):
        low, high = axes[axis].travel
        axes[axis] = replace(axes[axis], travel=(low + by, high + by))
    axes["B"] = replace(axes["B"], origin=(CENTRE[0], 0.0, 0.0))
    errors = {k: v for k, v in machine.errors.items() if v.is_location}
    return replace(machine, axes=axes, errors=errors, text="")


def away(machine: Machine, ball: tuple[float, float, float]) -> float:
    return math.dist(ball[:2], machine.axes["C"].origin[:2])


@pytest.mark.parametrize("instrument", ["r_test", pytest.param("ball_bar", marks=pytest.mark.slow)])
def test_balls_of_a_plan_stand_on_the_table_of_an_axis_off_the_origin(instrument: str) -> None:
    machine = off_centre()
    made = plan(machine, instrument=instrument, points=6, setups=2, starts=1, returns=0, anywhere=False, prove=False)
    radius = machine.workspace.table_radius
    assert radius is not None
    assert all(away(machine, run.table_ball) <= radius + 1e-6 for run in made.campaign.runs)
    assert not [said for said in doubts(made.campaign) if "table" in said]


def test_balls_of_every_procedure_stand_on_that_table() -> None:
    machine = off_centre()
    for make in (r_test_grid, static_ball_bar, cone_circle, planar_circle, rotary_circle):
        for run in make(machine):
            assert away(machine, run.table_ball) <= 150.0 + 1e-6, (run.id, run.table_ball)
    circles = plan_circles(
        machine, [make_effect("backlash", "X")], family="planar", count=1, refine=False, certify=False
    )
    assert away(machine, circles.campaign.runs[0].table_ball) <= 150.0
    with pytest.raises(
        InputError, match=r"would be beside the table; keep it within table_radius = 150 mm about \(250"
    ):
        plan_circles(machine, [make_effect("backlash", "X")], family="planar", count=1, centres=((0.0, 0.0, 100.0),))


def test_the_centre_follows_from_the_axis_that_carries_the_table_or_is_given(tmp_path) -> None:
    machine = off_centre()
    assert (machine.table_axis, machine.table_centre) == ("C", CENTRE)
    assert (preset("head-bc").table_axis, preset("head-bc").table_centre) == (None, (0.0, 0.0))
    lying = replace(machine.axes["C"], direction=(0.0, 1.0, 0.0), origin=(30.0, 777.0, -40.0))
    assert replace(machine, axes={**machine.axes, "C": lying}).table_centre == (30.0, 0.0), "any point names the axis"
    given = replace(machine, workspace=replace(machine.workspace, table_centre=(10.0, -20.0)))
    write_machine(given, tmp_path / "machine.toml")
    again = read_machine(tmp_path / "machine.toml")
    assert again.table_centre == (10.0, -20.0) and again.workspace == given.workspace
    assert "table: plane z = 0, radius 150 mm about x = 10, y = −20 mm of the workpiece frame (table_centre)" in str(
        check(tmp_path / "machine.toml")
    )
    with pytest.raises(InputError, match=r"table_centre = \[1.0\] is not 2 finite numbers"):
        replace(machine.workspace, table_centre=(1.0,))  # type: ignore[arg-type]


@pytest.mark.parametrize(("name", "error"), [("B", "EX0B"), ("C", "EX0C")])
def test_an_axis_that_lies_in_the_plane_of_its_table_is_said(name: str, error: str) -> None:
    """The table is the plane z = 0; that of a machine with a horizontal spindle is upright in this frame."""
    whole = preset("table-bc")
    axes = {axis: whole.axes[axis] for axis in (name, *"XYZ")}
    code = Structure.parse(f"w {name}' X' Y' b Z t")
    machine = replace(whole, structure=code, axes=axes, errors={error: whole.errors[error]}, text="")
    made = plan(machine, points=3, setups=1, starts=1, returns=0, anywhere=False, prove=False)
    head = program(machine, made.campaign.runs[0], "linuxcnc", made.post).replace(")\n(", " ")
    for words in (" ".join(made.notes), head):
        assert ("the plane z = 0, which contains axis B:" in words) is (name == "B")


def test_travels_are_printed_as_they_are() -> None:
    machine = preset("table-bc")
    far = {"C": (-100000.0, 100000.0), "X": (-160.25, 300.0)}
    axes = {name: replace(axis, travel=far.get(name, axis.travel)) for name, axis in machine.axes.items()}
    assert "X −160.25…300 mm" in (said := " ".join(str(replace(machine, axes=axes)).split()))
    assert "C −100000…100000 °" in said


def test_check_names_a_nest_beside_the_table() -> None:
    machine = off_centre()
    (run,) = r_test_grid(machine, nests=((20.0, 40.0, 60.0),), grid={"C": (0.0, 5.0)}, seconds_per_pose=60.0)
    (said,) = (said for said in doubts(campaign_of(machine, (run,))) if "table_radius" in said)
    assert said.startswith("run r-test-1: table_ball is 280 mm from the centre of the table (250, 200)")

"""Circles of the procedures: synchronous, planar, rotary and cone, against the papers and closed forms."""

from dataclasses import replace

import numpy as np
import pytest
from lean import without_drives
from test_procedures import SHARED, offset_of

from symfive.campaign import read_campaign
from symfive.errors import InputError
from symfive.machine import Machine, machine_from_data, machine_to_data, preset
from symfive.model import Model
from symfive.procedures import (
    Nominal,
    campaign_of,
    cone_circle,
    planar_circle,
    polar_angle,
    rotary_circle,
    synchronous_circle,
)


def changed(machine: Machine, **axes: dict) -> Machine:
    data = machine_to_data(machine)
    for name, fields in axes.items():
        data["axes"][name] = {**data["axes"][name], **fields}
    return machine_from_data(data)


def spin(run, name):
    return np.gradient(run.commands[name], run.time)


def test_synchronous_circle_lies_on_the_shared_path():
    """Same points: where C agrees, X agrees, though our run-up is smoother than the plant's."""
    shared = read_campaign(SHARED / "dynamic-none" / "fit")
    theirs = shared.run("x110-f800-cw")
    machine = changed(shared.machine, C={"max_acceleration": 1e6})
    ours = synchronous_circle(machine, x_t=55.0, feed=800.0, direction="cw", height=60.0, tool_ball=(0, 0, -130))[0]
    assert ours.table_ball == pytest.approx(theirs.table_ball) and ours.length == theirs.length

    def place(run):
        x, c = run.commands["X"], np.radians(run.commands["C"])
        return np.arctan2(x * np.sin(c), x * np.cos(c) - 55.0), np.hypot(x * np.sin(c), x * np.cos(c) - 55.0)

    assert np.abs(place(ours)[1] - 50.0).max() < 1e-9 and np.abs(place(theirs)[1] - 50.0).max() < 1e-6
    assert np.ptp(np.unwrap(place(ours)[0])) == pytest.approx(np.ptp(np.unwrap(place(theirs)[0])), abs=1e-6)
    assert ours.commands["Z"][0] == pytest.approx(theirs.commands["Z"][0])


FAST = changed(preset("tsutsumi-2007"), C={"max_feed": 1e5, "max_acceleration": 1e6})


def paper_3(x_t, feed=1000.0, **more):
    return synchronous_circle(FAST, x_t=x_t, radius=50.0, feed=feed, direction="ccw", rate_hz=1000.0, **more)[0]


@pytest.mark.parametrize(("x_t", "most"), [(45.0, 11459.2), (55.0, 11459.2), (50.0, 573.0)])
def test_p3_1_speed_of_c(x_t, most):
    assert np.abs(spin(paper_3(x_t), "C")).max() * 60 == pytest.approx(most, abs=0.1)


def test_p3_2_reversals():
    run = paper_3(55.0)
    x, c = run.commands["X"], np.radians(run.commands["C"])
    phi = np.degrees(np.unwrap(np.arctan2(x * np.sin(c), x * np.cos(c) - 55.0)))
    speed = np.diff(run.commands["C"])
    turns = np.flatnonzero((speed[:-1] * speed[1:] < 0) & (phi[1:-1] > 60) & (phi[1:-1] < 300)) + 1
    assert phi[turns] == pytest.approx([155.38, 204.62], abs=0.02)
    speed = np.diff(paper_3(45.0).commands["C"])
    assert speed.min() > -1e-12  # u < 1: C never reverses


@pytest.mark.parametrize(("x_t", "most"), [(45.0, 900.0), (50.0, 1000.0), (55.0, 1000.0)])
def test_p3_3_speed_of_x(x_t, most):
    assert np.abs(spin(paper_3(x_t), "X")).max() * 60 == pytest.approx(most, abs=1.0)


def test_p3_4_speed_and_acceleration_of_theta():
    """Equations (6) and (7) against complex-step derivatives of (3)."""
    phi = np.linspace(-2.9, 2.9, 59)
    for u in (0.9, 1.1):
        first = (1 + u * np.cos(phi)) / (1 + 2 * u * np.cos(phi) + u * u)
        second = u * np.sin(phi) * (1 - u * u) / (1 + 2 * u * np.cos(phi) + u * u) ** 2
        h = 1e-4
        values = [polar_angle(phi + k * h, 50.0 * u, 50.0) for k in (-2, -1, 0, 1, 2)]
        slope = (values[0] - 8 * values[1] + 8 * values[3] - values[4]) / (12 * h)
        bend = (-values[0] + 16 * values[1] - 30 * values[2] + 16 * values[3] - values[4]) / (12 * h * h)
        assert slope == pytest.approx(first, abs=1e-8) and bend == pytest.approx(second, abs=1e-5)


def test_at_equal_radii_x_passes_through_zero():
    run = paper_3(50.0)
    assert run.commands["X"].min() < -40.0
    assert np.ptp(run.commands["C"]) == pytest.approx(240.0, abs=1e-6)  # (360 + 2·60)/2
    assert np.abs(np.linalg.norm(offset_of(FAST, run), axis=1) - 50.0).max() < 1e-9


def test_y_rests_in_a_synchronous_circle():
    for name in ("tsutsumi-2007", "table-bc", "mixed-bc", "nutating-table"):
        run = synchronous_circle(preset(name), radius=50.0)[0]
        assert np.ptp(run.commands["Y"]) < 1e-9 and np.ptp(run.commands["Z"]) < 1e-9
        assert run.commands["X"].min() > 0.0


def test_paper_3_limits():
    """The printed limit of 33 1/min at F = 1000 needs |x_t - r| of at least 4.8 mm (SEEDS, feasibility note)."""
    machine = preset("tsutsumi-2007")
    assert synchronous_circle(machine, x_t=45.0)
    with pytest.raises(InputError, match="axis C would move") as caught:
        synchronous_circle(machine, x_t=46.0)
    feed = float(caught.value.remedy.split()[-2])
    assert synchronous_circle(machine, x_t=46.0, feed=feed) and feed > 800.0


@pytest.mark.parametrize("plane", ["XY", "YZ", "ZX"])
@pytest.mark.parametrize("instrument", ["ball_bar", "grid_encoder"])
def test_planar_circle(plane, instrument):
    machine = preset("three-axis")
    runs = planar_circle(machine, plane=plane, instrument=instrument, radius=100.0, feed=1200.0)
    for run, sense in zip(runs, (1.0, -1.0), strict=True):
        i, j = ("XYZ".index(letter) for letter in plane)
        d = offset_of(machine, run)
        assert np.abs(np.hypot(d[:, i], d[:, j]) - 100.0).max() < 1e-9
        phi = np.unwrap(np.arctan2(d[:, j], d[:, i]))
        partial = instrument == "ball_bar" and plane != "XY"  # the ball stands on a post
        assert phi[-1] - phi[0] == pytest.approx(sense * np.radians(224.0 if partial else 720.0))
        if partial:
            assert np.degrees(np.arcsin(d[:, 2].min() / 100.0)) == pytest.approx(-22.0, abs=0.01)
        rate = np.gradient(phi, run.time)
        middle = slice(run.rows // 3, run.rows // 2)
        assert rate[middle] * 100.0 * 60.0 == pytest.approx(sense * 1200.0, rel=1e-6)
        if instrument == "grid_encoder":
            assert run.length is None and run.u == tuple(np.eye(3)[i]) and run.v == tuple(np.eye(3)[j])
        assert np.ptp(run.commands["X" if plane == "ZX" else "Y"]) == pytest.approx(200.0, abs=1e-2)


def test_two_feeds_and_an_arc_where_an_axis_ends():
    machine = preset("three-axis")
    runs = planar_circle(machine, feed=(500.0, 2000.0))
    assert [run.id for run in runs] == ["xy-f500-ccw", "xy-f500-cw", "xy-f2000-ccw", "xy-f2000-cw"]
    low = machine.axes["Y"].travel[0]
    short = planar_circle(machine, radius=100.0, centre=(0.0, low + 50.0, 110.0), direction="ccw")[0]
    d = offset_of(machine, short)
    phi = np.degrees(np.unwrap(np.arctan2(d[:, 1], d[:, 0])))
    assert np.ptp(phi) == pytest.approx(224.0) and short.commands["Y"].min() > low
    with pytest.raises(InputError, match="travel"):
        planar_circle(machine, radius=100.0, centre=(0.0, low + 50.0, 110.0), sweep_deg=360.0)


def test_a_circle_gets_up_to_its_feed_with_half_of_the_acceleration():
    machine = preset("three-axis")
    run = planar_circle(machine, radius=100.0, feed=6000.0, rate_hz=1000.0, direction="ccw")[0]
    x, y = (run.commands[name] for name in "XY")
    speed = np.hypot(np.gradient(x, run.time), np.gradient(y, run.time))
    push = np.gradient(speed, run.time)
    least = min(machine.axes[name].max_acceleration for name in "XYZ")
    assert speed.max() == pytest.approx(100.0, rel=1e-4) and push.max() == pytest.approx(0.5 * least, rel=0.02)


def test_planar_circle_on_a_turned_table_keeps_the_machines_plane():
    machine = preset("table-bc")
    run = planar_circle(machine, plane="ZX", radius=50.0, hold={"C": 90.0, "B": 0.0}, direction="ccw")[0]
    assert np.ptp(run.commands["Y"]) < 1e-9 and np.ptp(run.commands["X"]) == pytest.approx(100.0, abs=0.01)


TABLES = [("table-bc", "C"), ("table-bc", "B"), ("tsutsumi-2007", "A"), ("nutating-table", "B"), ("mixed-bc", "C")]
HEADS = [("mixed-bc", "B"), ("head-bc", "B"), ("head-bc", "C")]


@pytest.mark.parametrize(("name", "axis"), TABLES + HEADS)
@pytest.mark.parametrize("arrangement", ["radial", "tangential", "axial"])
def test_following_bar_keeps_its_direction_to_the_axis(name, axis, arrangement):
    machine = preset(name)
    run = rotary_circle(machine, axis=axis, arrangement=arrangement, length=100.0, direction="ccw", rate_hz=20.0)[0]
    nominal = Nominal(machine)
    rotation = nominal.workpiece_rotation(run.commands)
    bar = np.einsum("nij,nj->ni", rotation, offset_of(machine, run)) / 100.0
    point, line = nominal.axis_line(axis, {})
    assert bar @ line == pytest.approx(np.full(run.rows, arrangement == "axial") * np.sign(bar[0] @ line), abs=1e-9)
    if arrangement != "axial":  # it turns as far as the axis does
        turn = np.degrees(np.unwrap(np.arctan2(np.cross(bar[0], bar) @ line, bar @ bar[0])))
        assert np.abs(turn[-1]) == pytest.approx(np.ptp(run.commands[axis]), abs=1e-6)
    others = [n for n, a in machine.axes.items() if a.rotary and n != axis]
    assert all(np.ptp(run.commands[n]) == 0.0 for n in others)
    assert point.shape == (3,)


@pytest.mark.parametrize(("name", "axis"), [("table-bc", "C"), ("mixed-bc", "C"), ("mixed-bc", "B"), ("head-bc", "B")])
def test_resting_radial_bar(name, axis):
    machine = preset(name)
    for run in rotary_circle(machine, axis=axis, linear="standing"):
        assert all(np.ptp(run.commands[n]) == 0.0 for n in machine.axes if n != axis)
        assert np.abs(np.linalg.norm(offset_of(machine, run), axis=1) - run.length).max() < 1e-9


@pytest.mark.parametrize("arrangement", ["radial", "tangential", "axial"])
@pytest.mark.parametrize(("name", "axis"), [("table-bc", "C"), ("head-bc", "C")])
def test_resting_bar_on_the_axis(name, axis, arrangement):
    """Paper 1, (16)-(18): the ball on the axis, the bar along one direction of the machine."""
    machine = preset(name)
    ball = (0.0, 0.0, 100.0)
    run = rotary_circle(machine, axis=axis, linear="standing", arrangement=arrangement, table_ball=ball)[0]
    assert all(np.ptp(run.commands[n]) == 0.0 for n in machine.axes if n != axis)
    rotation = Nominal(machine).workpiece_rotation(run.commands)
    bar = np.einsum("nij,nj->ni", rotation, offset_of(machine, run))
    along = {"radial": 0, "tangential": 1, "axial": 2}[arrangement]
    assert np.abs(bar[:, along]) == pytest.approx(np.full(run.rows, run.length), abs=1e-9)


def test_resting_circle_sees_what_paper_1_says():
    """(14)-(15): with the tool ball on C at height h, dR = ±[(x_c + h beta_c) cos c + (y_c - h alpha_c) sin c]."""
    machine, h = without_drives(preset("wang-li-2016")), 120.0
    runs = rotary_circle(machine, axis="C", linear="standing", table_ball=(100.0, 0.0, h), direction="ccw")
    plan = campaign_of(machine, runs)
    model = Model(plan)
    linear = model.linearise(runs[0].id, model.start)
    column = {model.parameters[i].name: linear.jacobian[:, 0, k] for k, i in enumerate(linear.columns)}
    c = np.radians(runs[0].commands["C"])
    cos, sin = np.cos(c), np.sin(c)
    assert np.abs(column["EX0C"]) == pytest.approx(np.abs(cos), abs=1e-9)
    assert np.abs(column["EY0C"]) == pytest.approx(np.abs(sin), abs=1e-9)
    assert column["EB0C"] == pytest.approx(h * column["EX0C"] * 1e-3, abs=1e-9)  # µm per µrad
    assert column["EA0C"] == pytest.approx(-h * column["EY0C"] * 1e-3, abs=1e-9)
    assert column["EX0B"] == pytest.approx(column["EX0C"], abs=1e-9)
    assert column["EA0B"] == pytest.approx(column["EA0C"], abs=1e-9)


@pytest.mark.parametrize(
    "options",
    [{"linear": "standing", "arrangement": "axial", "table_ball": (50.0, 0.0, 80.0)},
     {"linear": "standing", "arrangement": "tangential", "table_ball": (50.0, 0.0, 80.0)},
     {"linear": "standing", "table_ball": (50.0, 0.0, 80.0), "length": 100.0},
     {"linear": "gliding"}, {"arrangement": "diagonal"}, {"axis": "Q"}, {"axis": "X"},
     {"start_deg": 10.0, "end_deg": 5.0},
     {"direction": "up"}, {"feed": 0.0}, {"rate_hz": float("nan")}, {"hold": {"Q": 1.0}}, {"table_ball": (0.0, 1.0)},
     {"axis": "B", "start_deg": -110.0, "end_deg": 0.0}, {"feed": 1e9}, {"start_deg": float("nan")}],
)  # fmt: skip
def test_impossible_rotary_circles(options):
    with pytest.raises(InputError) as caught:
        rotary_circle(preset("table-bc"), **options)
    assert caught.value.remedy


def test_the_suggested_feed_is_possible():
    machine = preset("table-bc")
    for radius in (5.0, 20.0, 100.0):
        with pytest.raises(InputError, match="lower the feed to at most") as caught:
            planar_circle(machine, radius=radius, feed=50_000.0, rate_hz=2000.0)
        assert planar_circle(machine, radius=radius, feed=float(caught.value.remedy.split()[-2]), rate_hz=2000.0)


@pytest.mark.parametrize("rate_hz", [40.0, 2000.0])
def test_a_steep_run_up_is_refused_however_few_rows_it_has(rate_hz: float) -> None:
    """An arc of 220° gets up to its feed within 2°: 40 rows a second did not see it, and the feed advised was refused."""
    machine = preset("three-axis")
    with pytest.raises(InputError, match=r"axis Z would accelerate at 35.* lower the feed to at most") as caught:
        planar_circle(machine, plane="ZX", feed=7940.0, rate_hz=rate_hz)
    assert planar_circle(machine, plane="ZX", feed=float(caught.value.remedy.split()[-2]), rate_hz=rate_hz)


def test_a_table_that_turns_against_iso_841_has_its_ball_above_it() -> None:
    """As the stock trunnion modules of LinuxCNC turn: only the angles of C change their sign."""
    usual = preset("table-bc")
    turned = replace(usual.axes["C"], direction=(0.0, 0.0, -1.0))
    against = replace(usual, axes={**usual.axes, "C": turned}, text="")
    ours, theirs = (synchronous_circle(m, radius=50.0, direction="ccw")[0] for m in (usual, against))
    assert theirs.table_ball == pytest.approx(ours.table_ball)
    assert np.allclose(theirs.commands["Z"], ours.commands["Z"], atol=1e-9)


@pytest.mark.parametrize(
    ("name", "direction"), [("table-bc", 1.0), ("table-bc", -1.0), ("head-bc", 1.0), ("head-bc", -1.0)]
)
def test_an_axial_bar_stands_on_its_table_ball(name: str, direction: float) -> None:
    """The tool comes from above, whichever way C counts and whichever side it carries: below, it went through the ball."""
    machine = preset(name)
    turned = replace(machine.axes["C"], direction=(0.0, 0.0, direction))
    machine = replace(machine, axes={**machine.axes, "C": turned}, text="")
    run = rotary_circle(machine, axis="C", arrangement="axial", feed=500.0, rate_hz=10.0)[0]
    ball = Nominal(machine).ball(run.commands, run.tool_ball)
    assert np.allclose(ball[:, 2] - run.table_ball[2], run.length)


@pytest.mark.parametrize(("low", "high"), [(-3600.0, 3600.0), (-360.0, 360.0), (-215.0, 215.0), (0.0, 430.0)])
@pytest.mark.parametrize("name", ["table-bc", "tsutsumi-2007", "nutating-table"])
def test_a_synchronous_circle_is_turned_into_the_travel_of_its_table(name: str, low: float, high: float) -> None:
    """It turns C by 423°; from -32° on no travel of a table with hoses took it, although that of ±215° is wide enough."""
    machine = changed(preset(name), C={"travel": [low, high]})
    for run in synchronous_circle(machine, radius=50.0, rate_hz=20.0):
        c = run.commands["C"]
        assert low <= c.min() and c.max() <= high and np.ptp(c) == pytest.approx(423.5, abs=0.1)
        assert np.abs(np.linalg.norm(offset_of(machine, run), axis=1) - 50.0).max() < 1e-9
        assert np.ptp(run.commands["Y"]) < 1e-9 and run.commands["X"].min() > 0.0
    first = changed(machine, C={"travel": [-3600.0, 3600.0]})
    start = synchronous_circle(first, radius=50.0, rate_hz=20.0)[0]
    assert start.commands["C"].min() == pytest.approx(-31.7, abs=0.1), "as before where the table turns without end"
    with pytest.raises(InputError, match="axis C would go to"):
        synchronous_circle(changed(machine, C={"travel": [-200.0, 200.0]}), radius=50.0)


def test_heads_cannot_drive_a_synchronous_circle():
    with pytest.raises(InputError, match="carries the tool"):
        synchronous_circle(preset("head-bc"), rotary="C")


@pytest.mark.parametrize("name", ["table-bc", "head-bc", "mixed-bc", "nutating-table"])
@pytest.mark.parametrize(("inclination", "sensitive"), [(10.0, "base"), (30.0, "surface")])
def test_cone_is_a_cone(name, inclination, sensitive):
    machine = preset(name)
    (run,) = cone_circle(
        machine, direction="ccw", inclination_deg=inclination, sensitive=sensitive, feed=300.0, rate_hz=8.0
    )
    nominal = Nominal(machine)
    bar = offset_of(machine, run)
    np.testing.assert_allclose(np.linalg.norm(bar, axis=1), run.length, atol=1e-9)
    tool = np.einsum(
        "nji,nj->ni", nominal.workpiece_rotation(run.commands), nominal.tool_rotation(run.commands)[:, :, 2]
    )
    home = nominal.commands({}, 1)
    upright = nominal.workpiece_rotation(home)[0].T @ nominal.tool_rotation(home)[0]
    lean = np.radians(inclination)
    axis = upright @ np.array([np.sin(lean), 0.0, np.cos(lean)])
    np.testing.assert_allclose(tool @ axis, np.cos(np.radians(15.0)), atol=1e-9)
    height = 0.0 if sensitive == "base" else run.length * np.sin(np.radians(15.0))
    np.testing.assert_allclose(bar @ axis, height, atol=1e-7)
    if sensitive == "surface":
        np.testing.assert_allclose(np.einsum("ni,ni->n", bar, tool), 0.0, atol=1e-7)
    turning = np.ptp(run.commands["C"])
    assert turning > 360.0 if inclination < 15.0 else turning < 180.0
    steps = np.abs(np.diff(np.stack(list(run.commands.values())), axis=1))
    assert steps.max() < 10.0  # one branch, no jumps


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"half_angle_deg": 95.0}, "makes no cone"),
        ({"sensitive": "top"}, "unknown"),
        ({"radius": 0.0}, "is none"),
        ({"inclination_deg": 120.0}, "cannot point the tool"),
        ({"inclination_deg": 14.95}, "close to the pole"),
        ({"feed": 60000.0, "rate_hz": 1000.0}, "lower the feed"),
    ],
)
def test_cones_that_cannot_be(options, says):
    with pytest.raises(InputError, match=says):
        cone_circle(preset("table-bc"), direction="ccw", **{"rate_hz": 8.0, **options})

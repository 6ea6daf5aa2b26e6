"""What `check` says of files that are legal but hardly meant."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from symfive.campaign import Campaign, Run, read_campaign, write_campaign
from symfive.check import check
from symfive.cli import main
from symfive.diagnose import diagnose
from symfive.errors import InputError
from symfive.machine import designed_ball, preset, presets, write_machine
from symfive.plausible import beyond_travel, doubts, out_of_reach, unreadable
from symfive.procedures import Nominal, campaign_of, planar_circle, r_test_grid, static_ball_bar
from symfive.simulate import simulate

CAMPAIGNS = Path(__file__).parent / "data" / "campaigns"

NAMES = sorted(folder.name for folder in CAMPAIGNS.iterdir())


def slipped(campaign: Campaign, **change) -> tuple[str, ...]:
    """The doubts where the first run is changed."""
    return doubts(replace(campaign, runs=(replace(campaign.runs[0], **change), *campaign.runs[1:])))


@pytest.fixture(scope="module")
def bar() -> Campaign:
    return read_campaign(CAMPAIGNS / "static-ball-bar-two-heights" / "fit")


@pytest.fixture(scope="module")
def nests() -> Campaign:
    return read_campaign(CAMPAIGNS / "static-none" / "fit")


@pytest.mark.parametrize("name", NAMES)
def test_nothing_is_said_of_what_is_meant(name):
    assert check(CAMPAIGNS / name / "fit").notes == ()


@pytest.mark.parametrize("name", presets())
def test_the_designed_machine_is_that_of_the_chain(name):
    machine, rng = preset(name), np.random.default_rng(3)
    commands = {a: rng.uniform(*machine.axes[a].travel, size=20) for a in machine.axis_names}
    ball = (1.0, -2.0, -120.0)
    assert designed_ball(machine, commands, ball) == pytest.approx(Nominal(machine).ball(commands, ball), abs=1e-9)


def test_one_recording_in_two_runs(nests):
    first, second = nests.runs[0], replace(nests.runs[0], id="again", file="again.csv")
    for readings in (first.readings, {name: values[::-1] for name, values in first.readings.items()}):
        runs = (first, second.with_readings(readings))
        (said,) = [each for each in doubts(replace(nests, runs=runs)) if "again" in each]
        assert f"those of run {first.id}" in said
    for other in (
        {name: values + np.eye(1, len(values))[0] for name, values in first.readings.items()},
        {name: values[::-1] if name == "dx_um" else values for name, values in first.readings.items()},
    ):
        assert not any("again" in each for each in doubts(replace(nests, runs=(first, second.with_readings(other)))))
    zeros = {name: np.zeros(first.rows) for name in first.readings}
    both = (first.with_readings(zeros), second.with_readings(zeros))
    assert not any("those of run" in each for each in doubts(replace(nests, runs=both)))


def test_balls_that_do_not_fit_the_commands(bar, nests):
    x, y, z = bar.runs[0].tool_ball
    (said,) = slipped(bar, tool_ball=(x, y, z - 30.0))
    assert (
        said.startswith(f"run {bar.runs[0].id}: with its balls and commands the bar would be") and "tool_ball" in said
    )
    (said,) = slipped(nests, table_ball=(0.0, 0.0, 0.0))
    assert "the ball would be" in said and "(stroke ±1 mm)" in said


def test_a_head_with_four_sensors(nests):
    """Each reads along its own direction: 2 mm along x are 1.15 mm along (1, 1, 1)."""
    options = {"directions": [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 1.0, 1.0], [0.0, 1.0, 1.0]]}
    turned = replace(nests.runs[0], options=options, readings={})
    alone = simulate(replace(nests, runs=(turned,))).campaign
    assert doubts(alone) == ()
    rest = {name: np.zeros_like(q) for name, q in turned.commands.items()}
    moved = replace(turned, commands=rest, tool_ball=(2.0, 0.0, -150.0), table_ball=(0.0, 0.0, -150.0))
    (said,) = doubts(replace(nests, runs=(moved,)))
    assert "the ball would be 1.15 mm off" in said


def test_what_no_instrument_can_have_read_is_not_diagnosed(bar):
    """One command that is 40 mm off; two strokes, since a zero may lie at one end of the range."""
    run, axis = bar.runs[0], bar.machine.axis_names[-1]
    wrong = run.commands[axis].copy()
    wrong[7] = wrong[7] + (40.0 if wrong[7] < 0.0 else -40.0)
    spoilt = replace(bar, runs=(replace(run, commands={**run.commands, axis: wrong}), *bar.runs[1:]))
    assert unreadable(bar) is None and "in line 9 of " in (unreadable(spoilt) or "")[0]
    with pytest.raises(InputError, match=r"in line 9 of .* \[workspace\]"):
        diagnose(spoilt)
    x, y, z = run.table_ball
    near = replace(bar, runs=(replace(run, table_ball=(x + 1.5, y, z)), *bar.runs[1:]))
    assert doubts(near) and unreadable(near) is None


def test_commands_in_radian(nests):
    (said,) = slipped(nests, commands={**nests.runs[0].commands, "C": nests.runs[0].commands["C"] / 57.3})
    assert "units of the commands" in said


def test_readings_in_mm_or_nm(bar):
    readings = bar.runs[0].readings
    (said,) = slipped(bar, readings={k: v / 1e3 for k, v in readings.items()})
    assert "they are read as µm: were they written in mm?" in said
    large = {k: v * 1e3 for k, v in readings.items()}
    (said,) = slipped(bar, readings=large)
    assert "beyond the stroke" in said
    problem, remedy = unreadable(replace(bar, runs=(bar.runs[0].with_readings(large), *bar.runs[1:])))
    assert said.startswith(problem) and "[workspace]" in remedy


@pytest.mark.parametrize("verb", [["identify", "--no-figures", "-o", "out"], ["standards"]])
def test_no_verb_evaluates_what_no_instrument_can_have_read(verb, bar, tmp_path, capsys, monkeypatch):
    """A bar of another length: an evaluation would state a misfit of 50 mm, and the errors at their priors."""
    monkeypatch.chdir(tmp_path)
    wrong = tuple(replace(run, length=run.length + 50.0) for run in bar.runs)
    write_campaign(replace(bar, runs=wrong), "measured")
    assert main([verb[0], "measured", *verb[1:]]) == 2
    said = capsys.readouterr()
    assert said.err.count("\n") == 1 and "the bar would be 50" in said.err and not said.out
    assert not (tmp_path / "out").exists()


def test_a_feed_beyond_the_axis():
    circles = read_campaign(CAMPAIGNS / "dynamic-none" / "fit")
    said = slipped(circles, time=circles.runs[0].time / 60.0)
    assert "is commanded at up to" in said[0] and "max_feed" in said[0]


def test_milliseconds_as_seconds():
    circles = read_campaign(CAMPAIGNS / "dynamic-none" / "fit")
    (said,) = slipped(circles, time=circles.runs[0].time * 1e3)
    assert "its rows are" in said and "t_s is in s" in said


def test_a_prior_in_mm(bar):
    name, term = next(iter(bar.machine.errors.items()))
    machine = replace(bar.machine, errors={**bar.machine.errors, name: replace(term, sigma=term.sigma / 1e4)})
    (said,) = doubts(replace(bar, machine=machine))
    assert said.startswith(f"{name}: the prior 1σ") and "not mm" in said


def test_a_grid_encoder_reads_positions():
    """Deviations from the path, mm, and the wrong sign; a circle at a standstill is none."""
    machine = preset("three-axis")
    plan = campaign_of(machine, planar_circle(machine, instrument="grid_encoder", direction="ccw", radius=60.0))
    circle = simulate(plan, seed=1).campaign.runs[0]
    assert not any("path" in said for said in doubts(replace(plan, runs=(circle,))))
    path = 1e3 * designed_ball(machine, circle.commands, circle.tool_ball)
    for factor, less in ((1.0, 1.0), (1e-3, 0.0), (-1.0, 0.0)):
        wrong = {
            name: factor * (circle.readings[name] - less * path[:, i]) for i, name in enumerate(("du_um", "dv_um"))
        }
        campaign = replace(plan, runs=(circle.with_readings(wrong),))
        problem, remedy = unreadable(campaign)
        assert "do not follow the path" in problem and f"{problem}; {remedy}" in doubts(campaign)


def test_a_ball_that_an_axis_cannot_reach_is_a_problem_of_the_plan(tmp_path):
    """The nest was put higher than planned and its file corrected: Z would have to go up with it, by as much."""
    machine = preset("table-bc")
    runs = r_test_grid(machine, grid={"B": (0.0,), "C": (0.0, 90.0)}, nests=((60.0, 0.0, 80.0),), returning=False)
    write_campaign(campaign_of(machine, runs), tmp_path / "plan")
    assert check(tmp_path / "plan").right
    file, highest = tmp_path / "plan" / "campaign.toml", machine.axes["Z"].travel[1]
    needed = float(runs[0].commands["Z"][0]) + 300.0
    assert needed > highest
    file.write_text(file.read_text().replace("[60.0, 0.0, 80.0]", "[60.0, 0.0, 380.0]"))
    (problem,) = check(tmp_path / "plan").problems
    assert f"line 2 of {runs[0].file}" in str(problem)
    assert f"Z at {needed:g} mm, its travel ends at {highest:g} mm" in str(problem)
    bar = replace(static_ball_bar(machine)[0], table_ball=(0.0, 0.0, 700.0))
    assert any("need Z at" in said for said, _ in out_of_reach(machine, bar))
    assert not [*out_of_reach(machine, static_ball_bar(machine)[0])]


def test_heights_and_tools_out_of_reach_are_said_of_the_machine(tmp_path):
    machine = preset("table-bc")
    assert beyond_travel(machine) == ()
    write_machine(
        replace(machine, workspace=replace(machine.workspace, ball_height=(40.0, 900.0)), text=""),
        tmp_path / "machine.toml",
    )
    (said,) = check(tmp_path / "machine.toml").notes
    assert said == (
        "ball_height = 900 mm with a tool of 100 mm over the table's centre needs Z at 1000 mm, its travel ends at 450 mm"
    )
    assert all(beyond_travel(preset(name)) == () for name in presets())


def test_a_sphere_that_stands_elsewhere_is_placed():
    """The readings say where it stands; within what set-up and machine are known to, nothing is said."""
    machine = preset("table-bc")
    tilts = np.array([[0.0, 0.0], [40.0, 0.0], [-40.0, 90.0], [0.0, 180.0]])
    place, tool = np.array([100.0, 30.0, 120.0]), (0.0, 0.0, -150.0)
    held = {"B": tilts[:, 0], "C": tilts[:, 1]}
    planned = Nominal(machine).follow(np.tile(place, (4, 1)), tool, held, "sphere")

    def probed(*off_mm: float) -> Campaign:
        found = Nominal(machine).follow(np.tile(place + off_mm, (4, 1)), tool, held, "sphere")
        readings = {f"{name}_dev_um": 1e3 * (found[name] - planned[name]) for name in "XYZ"}
        run = Run(
            id="sphere-1", instrument=("touch_probe",), sampling="static", time=np.arange(4.0), commands=planned,
            readings=readings, table_ball=(100.0, 30.0, 120.0), tool_ball=tool, noise_um=1.0,
        )  # fmt: skip
        return Campaign(machine=machine, runs=(run,))

    assert doubts(probed(0.1, 0.0, -0.1)) == ()
    (said,) = doubts(probed(0.6, -0.4, 0.3))
    assert said.startswith(
        "run sphere-1: by the readings the sphere stands at (100.600, 29.600, 120.300) mm, 0.781 mm from"
    )

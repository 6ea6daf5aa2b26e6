"""Circles: paths as the procedures make them, exact derivatives, and a refinement that is never worse than the list."""

import functools
import itertools
import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from lean import varying
from pages import HOSTILE, Page

from symfive import design
from symfive.campaign import Campaign, Run, read_campaign
from symfive.design import FAMILIES, CircleShape, Sheet, circle_information, setup_sheet
from symfive.design._circles import typical_values  # exact derivatives against differences need all three
from symfive.design._moved_run import MovedRun
from symfive.design._paths import circle_runs, make_path
from symfive.effects import make_effect
from symfive.errors import InputError
from symfive.machine import preset
from symfive.model import Model
from symfive.motion import drive_response, moved_response
from symfive.nc import Post
from symfive.procedures import campaign_of, cone_circle, linear_positioning, planar_circle, rotary_circle
from tests.plan_checker import check

plan_circles = functools.partial(design.plan_circles, certify=False)
"""Certificates have a file of their own."""
MACHINE = preset("tsutsumi-2007")
LEAN = varying(MACHINE, "EC0Y", "EX0C", "EY0C")
DRIVE = [make_effect("servo_mismatch", "C", gains=("position_gain", "velocity_gain")), make_effect("backlash", "C")]
OF_X = [make_effect("servo_mismatch", "X", gains=("position_gain",)), make_effect("backlash", "X")]
INSIDE = {"ratio": 0.8, "radius": 50.0, "feed": 1400.0, "height": 80.0}
OUTSIDE = {"ratio": 1.25, "radius": 50.0, "feed": 1400.0, "height": 80.0}
PLANAR = {"radius": 50.0, "feed": 2000.0, "x": 10.0, "y": -5.0, "z": 90.0}
CASES = [
    ("synchronous", INSIDE, DRIVE, "ccw"),
    ("synchronous", OUTSIDE, DRIVE, "cw"),
    ("planar", PLANAR, OF_X, "ccw"),
]
NAMES = ["X_T < r", "X_T > r", "planar"]


def test_motion_of_a_drive_moves_with_the_path() -> None:
    gains = {"position_gain": 40.0, "velocity_gain": 35.0, "integral_time": 0.05, "viscous": 0.2, "feedforward": 0.3}
    wanted = ("position_gain", "feedforward", "integral_time")
    share = np.arange(200) / 199.0

    def path(v: np.ndarray) -> tuple[np.ndarray, float]:
        return v[1] * np.sin(6.0 * share * v[1]) + v[0] * share**2 + 0.3 * v[1], 0.02 * v[0]

    v = np.array([1.0, 0.9])
    moved = np.stack(
        [share**2, np.sin(6.0 * share * v[1]) + 6.0 * v[1] * share * np.cos(6.0 * share * v[1]) + 0.3], axis=1
    )
    motion, slopes = moved_response(*_first(path(v), moved), np.array([0.02, 0.0]), gains, wanted)
    assert motion == pytest.approx(drive_response(*path(v), gains, wanted), rel=1e-9, abs=1e-9)
    for j, step in enumerate(1e-5 * np.eye(2)):
        apart = drive_response(*path(v + step), gains, wanted) - drive_response(*path(v - step), gains, wanted)
        size = np.abs(slopes[..., j]).max(axis=0)
        assert np.all(np.abs(apart / 2e-5 - slopes[..., j]).max(axis=0) <= 1e-6 * size + 1e-9)


def _first(path: tuple[np.ndarray, float], moved: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    return path[0], moved, path[1]


@pytest.mark.parametrize("reach", [None, 250.0])
@pytest.mark.parametrize("name", ["table-bc", "nutating-table", "mixed-bc", "tsutsumi-2007", "three-axis", "head-bc"])
def test_a_path_is_the_procedures_path(name: str, reach: float | None) -> None:
    machine = preset(name)
    if reach and "C" in machine.axes:  # hoses, within which a circle is turned about C
        table = replace(machine.axes["C"], travel=(-reach, reach))
        machine = replace(machine, axes={**machine.axes, "C": table}, text="")
    turning = name not in ("three-axis", "head-bc")
    shapes = [CircleShape(family="planar", values=PLANAR)]
    shapes += [CircleShape(family="synchronous", values=v | {"feed": 400.0}) for v in (INSIDE, OUTSIDE) if turning]
    for shape in shapes:
        for run, sense in zip(circle_runs(machine, shape, noise_um=0.3, rate_hz=20.0), ("ccw", "cw"), strict=True):
            path = make_path(machine, shape, sense)
            setting, _ = path.setup(shape.vector)
            shares = (run.time / setting[4])[None, :]
            commands = path.rows.map(run.rows)(np.repeat(shape.vector[:, None], run.rows, axis=1), shares)[0]
            wanted = np.stack([run.commands[n] * machine.axes[n].to_internal for n in machine.axis_names])
            assert np.asarray(commands) == pytest.approx(wanted, abs=1e-9)
            assert setting[:4] == pytest.approx([*run.table_ball, run.length])


def _moved(family: str, values: dict[str, float], effects: list, direction: str) -> tuple[MovedRun, CircleShape, Model]:
    shape = CircleShape(family=family, values=values, direction=direction)
    runs = circle_runs(LEAN, shape, noise_um=0.3, rate_hz=25.0)
    model = Model(Campaign(machine=LEAN, runs=runs), effects)
    path = make_path(LEAN, shape, direction)
    return MovedRun(model, runs[0], path, typical_values(model), 25.0), shape, model


def _at_its_rows(moved: MovedRun, shape: CircleShape) -> Run:
    """The run recorded at N rows over the whole path instead of at the recorder's rate."""
    commands, _ = moved.path.at(shape.vector, moved.rows)
    interval = moved.path.setup(shape.vector)[0][4] / (moved.rows - 1)
    scaled = {n: commands[:, i] / LEAN.axes[n].to_internal for i, n in enumerate(LEAN.axis_names)}
    return replace(moved.run, id=moved.run.id, time=interval * np.arange(moved.rows), commands=scaled)


@pytest.mark.parametrize(("family", "values", "effects", "direction"), CASES, ids=NAMES)
def test_slopes_of_the_sensitivities_against_central_differences(
    family: str, values: dict[str, float], effects: list, direction: str
) -> None:
    """The readings' Jacobian and the weights of the rows, by every variable of the path, against differences of values."""
    moved, shape, model = _moved(family, values, effects, direction)
    J, slopes, weight, weight_slopes = moved.sensitivities(shape.vector)
    line = model.linearise(_at_its_rows(moved, shape), typical_values(model))
    wanted = line.jacobian / model.noise(moved.run)[:, None]
    assert moved.index.tolist() == line.columns.tolist()
    assert np.abs(J - wanted).max() <= 1e-7 * np.abs(wanted).max()
    for j, name in enumerate(FAMILIES[family]):
        step = np.zeros(len(shape.vector))
        step[j] = 1e-6 * max(abs(shape.values[name]), 10.0)
        upper, lower = (moved.sensitivities(shape.vector + sign * step) for sign in (1.0, -1.0))
        for i, exact in ((0, slopes[..., j]), (2, weight_slopes[:, j])):
            difference = (upper[i] - lower[i]) / (2.0 * step[j])
            assert np.abs(difference - exact).max() <= 2e-5 * np.abs(exact).max() + 1e-6, name
    assert weight.sum() == pytest.approx(moved.rows, rel=0.01)


def test_slope_of_the_information_holds_across_reversals() -> None:
    """Over a stretch in which the reversals of C pass several rows, the slopes' sum is the change of what is told of the play."""
    moved, shape, model = _moved("synchronous", OUTSIDE, DRIVE[1:], "ccw")
    shared = [p.name for p in model.parameters if p.kind != "setup"]
    i = shared.index("backlash.C.width")
    low, high, steps = 1.22, 1.28, 40
    rest = shape.vector[1:]
    middles = low + (high - low) * (np.arange(steps) + 0.5) / steps
    slopes = [moved.information(np.array([u, *rest]))[1][0, i, i] for u in middles]
    ends = [moved.information(np.array([u, *rest]))[0][i, i] for u in (low, high)]
    assert ends[1] > 1.2 * ends[0]
    assert np.mean(slopes) * (high - low) == pytest.approx(ends[1] - ends[0], rel=0.1)


def test_refined_circles_are_better_and_keep_the_limits() -> None:
    """The gains of C are seen best where it turns fast: the refinement goes to the axis' greatest feed and not beyond."""
    effects = DRIVE[:1]
    found = plan_circles(LEAN, effects, count=1, ratios=(0.3, 0.6, 0.85), feeds=(1000.0, 3000.0), rate_hz=25.0)
    assert found.value < found.grid_value - 0.1
    (circle,) = found.circles
    speed = np.degrees(circle.feed / 60.0 / abs((circle.ratio - 1.0) * circle.radius)) * 60.0
    assert 0.95 * 11880.0 < speed <= 11880.0
    again = circle_information(LEAN, effects, ratio=circle.ratio, radius=50.0, feed=circle.feed, rate_hz=25.0)
    assert again.matrix == pytest.approx(circle.matrix)


@pytest.mark.parametrize(("reach", "refine"), [(100.0, False), pytest.param(75.0, True, marks=pytest.mark.slow)])
def test_the_ball_stands_on_the_table(reach: float, refine: bool) -> None:
    """Bars of 50 and 100 mm: X_T/r = 1.8 would put the ball beside the table, in the list and after the refinement."""
    small = replace(LEAN, workspace=replace(LEAN.workspace, table_radius=reach), text="")
    options = {"radii": (50.0, 100.0), "ratios": (0.5, 1.2, 1.8), "feeds": (500.0,), "rate_hz": 10.0, "refine": refine}
    found = plan_circles(small, DRIVE[1:], count=1, **options)
    balls = [run.table_ball for circle in found.considered for run in circle.runs]
    balls += [run.table_ball for run in found.campaign.runs]
    assert max(np.hypot(x, y) for x, y, _ in balls) <= reach
    with pytest.raises(InputError, match=r"no circle can be run.*would be beside the table; keep it within table_rad"):
        plan_circles(small, DRIVE[1:], radii=(100.0,), ratios=(1.8,), feeds=(500.0,))


@pytest.mark.slow
@pytest.mark.parametrize("options", [{"robust": "worst"}, {"robust": "mean"}, {"per_minute": True}])
def test_what_circles_are_chosen_for(options: dict) -> None:
    found = plan_circles(
        LEAN, DRIVE, count=1, ratios=(0.8, 1.2), feeds=(800.0, 1500.0), draws=2, rate_hz=20.0, **options
    )
    assert found.value <= found.grid_value
    assert len(found.circles[0].matrices) == (3 if "robust" in options else 1)


def test_planar_circles_with_a_direction_to_choose(tmp_path: Path) -> None:
    found = plan_circles(
        LEAN, OF_X, family="planar", count=2, feeds=(500.0, 4000.0), directions=("ccw", "cw"), rate_hz=20.0, free=("feed",)
    )  # fmt: skip
    assert {run.id.rsplit("-", 1)[1] for run in found.campaign.runs} <= {"ccw", "cw"} and len(found.campaign.runs) == 2
    found.write(tmp_path / "plan", nc=("linuxcnc",))
    data = json.loads((tmp_path / "plan" / "plan.json").read_text())
    assert data["expected"]["backlash.X.width"]["std"] < data["expected"]["backlash.X.width"]["prior_std"]
    assert read_campaign(tmp_path / "plan").rows == found.campaign.rows
    assert "circles of" in str(found)


def test_circles_about_one_ball_follow_each_other() -> None:
    centres = [(0.0, 0.0, 80.0), (40.0, 0.0, 80.0)]
    options = {"centres": centres, "feeds": (500.0, 1000.0, 4000.0), "rate_hz": 10.0, "refine": False}
    found = plan_circles(LEAN, OF_X, family="planar", count=4, **options)
    stand = [(run.table_ball, run.mounting["table_ball"]) for run in found.campaign.runs]
    assert len(stand) == 8 and len(set(stand)) == len(list(itertools.groupby(stand))) == 2


def test_a_ball_that_stays_has_one_error_and_creeps() -> None:
    """Its error does not average out over four circles, and what it may creep by hides a play from both directions."""
    options = {"ratios": (0.8, 1.2), "feeds": (1000.0,), "rate_hz": 10.0, "refine": False}
    found = plan_circles(LEAN, DRIVE, count=4, **options)
    runs = tuple(replace(run, mounting={}) for run in found.campaign.runs)
    promised, anew = found.assessment.sigma, design.assess(replace(found.campaign, runs=runs), effects=DRIVE).sigma
    assert promised["EX0C"] > 2.0 * anew["EX0C"]
    assert promised["backlash.C.width"] == pytest.approx(anew["backlash.C.width"], rel=0.1)


def test_an_axis_that_stands_still_limits_no_circle() -> None:
    """C stands at 0, a degree from the end of its travel."""
    axes = {**LEAN.axes, "C": replace(LEAN.axes["C"], travel=(-1.0, 365.0))}
    options = {"radii": (50.0,), "feeds": (500.0, 1000.0), "rate_hz": 10.0, "count": 1}
    found = plan_circles(replace(LEAN, axes=axes, text=""), OF_X[1:], family="planar", **options)
    assert not any("the travel of C" in note for note in found.notes)


def test_circles_have_a_sheet(tmp_path: Path) -> None:
    options = {"ratios": (1.2,), "feeds": (800.0,), "rate_hz": 20.0, "refine": False}
    found = plan_circles(LEAN, DRIVE[1:], count=1, **options)
    odd = replace(LEAN, name=HOSTILE)
    replace(found, campaign=found.campaign.with_machine(odd)).write(tmp_path, nc=("iso",), overwrite=True)
    first, second = (run.id for run in found.campaign.runs)
    text = (tmp_path / "setup.html").read_text()
    page = Page(text)
    assert page.tags.count("script") == 1 and HOSTILE in page.words
    for words in (
        "2 runs, 1586 readings · about 8 min with set-up", "keep 2 mm apart",
        "table ball at x = 60, y = 0, z = 80 mm", "Bar of 50 mm", "ball bar: dL_um into", "793, one every 50 ms",
        "radius 50 mm, 480° with run-up", "xy of the workpiece frame", "counter-clockwise, viewed from +z",
        "800 mm/min along the circle", "C and X move; the ball is X_T = 60.000 mm from axis C, X_T/r = 60/50 = 1.2",
        "With the tool ball there and no tool offset, the control shows X 60.000, Y 0.000, Z 210.000 mm (A 0°, C 0°)",
        "39.6 s, from rest",
        f"as for run {first}: ", "backlash of axis C (width)", "nc/iso/*.nc", "4580 °/min",
    ):  # fmt: skip
        assert words in page.words, words
    assert page.words.count("Bar of 50 mm") == 1, "the second run has the mounting of the first"
    assert not re.search(r"ball [xyz] of run \S+ is not determined", page.words), "nobody asked for the set-up"
    assert all((tmp_path / "figures" / f"poses-{run}.svg").stat().st_size < 200_000 for run in (first, second))
    assert read_campaign(tmp_path).rows == found.campaign.rows and (tmp_path / "plan.json").is_file()


@pytest.mark.parametrize(
    ("name", "make", "says"),
    [
        ("table-bc", lambda m: planar_circle(m, plane="ZX", direction="cw", rate_hz=8.0, feed=600.0),
         ("zx of the machine frame", "clockwise, viewed from +y", "600 mm/min along the circle")),
        ("table-bc", lambda m: planar_circle(m, instrument="grid_encoder", direction="ccw", centre=(10, 20, 80), rate_hz=8.0),
         ("the middle of the grid plate at x = 10, y = 20, z = 80", "Reading head at 150 mm", "dv_um", "22.361")),
        ("table-bc", lambda m: cone_circle(m, sensitive="surface", direction="ccw", rate_hz=8.0),
         ("radius 96.6 mm", "leaning by 10.0° from xy of the workpiece frame", "viewed from (0.174, 0.000, 0.985)")),
        ("nutating-table", lambda m: rotary_circle(m, arrangement="tangential", direction="cw", rate_hz=8.0),
         ("tangential to axis C, turning with it", "C falling", "1800 °/min of C", "118.638")),
        ("table-bc", lambda m: rotary_circle(m, arrangement="axial", direction="ccw", rate_hz=8.0),
         ("along axis C, turning with it", "C rising")),
        ("head-bc", lambda m: rotary_circle(m, axis="B", direction="ccw", rate_hz=16.0),
         ("zx of the workpiece frame", "from axis B", "270.000", "3142 mm/min along the circle")),
        ("three-axis", linear_positioning, ("laser", "All ")),
    ],
    ids=["planar", "grid encoder", "cone", "rotary", "along the axis", "head", "laser"],
)  # fmt: skip
def test_plans_of_procedures_have_a_sheet(name: str, make: Callable, says: tuple[str, ...]) -> None:
    machine = preset(name)
    words = Page(setup_sheet(Sheet(campaign=campaign_of(machine, make(machine)), post=Post()), {}, ())).words
    for said in says:
        assert said in words, said


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"family": "square"}, 'there are no "square" circles; use one of synchronous, planar'),
        ({"robust": "best"}, "use one of nominal, mean, worst"),
        ({"count": 0}, "count = 0 is too few; give at least 1"),
        ({"free": ("x",)}, "a synchronous circle has no variable x; use ratio, radius, feed, height"),
        ({"ratios": (0.999,), "feeds": (5000.0,)}, "lower the feed to at most"),
        ({"feeds": ()}, "no circle is described"),
        ({"for_": ("EX0C", "EXQ")}, "there is no parameter EXQ"),
    ],
)
def test_circles_that_cannot_be(options: dict, says: str) -> None:
    with pytest.raises(InputError) as caught:
        plan_circles(LEAN, DRIVE, **{"ratios": (0.5,), "feeds": (800.0,), "refine": False, **options})
    assert says in str(caught.value)


def test_effects_without_a_derivative_are_chosen_from_the_list() -> None:
    found = plan_circles(
        LEAN, [make_effect("friction", "C")], count=1, ratios=(0.5, 1.2), feeds=(800.0,), rate_hz=20.0, certify=False
    )
    assert found.value == found.grid_value
    assert "are not refined; choose among the circles given" in found.notes[0]


def test_a_plan_of_circles_says_units_repeats_and_what_it_cannot_see() -> None:
    options = {"feeds": (800.0,), "rate_hz": 20.0, "refine": False, "certify": False}
    repeated = plan_circles(LEAN, DRIVE[1:], ratios=(1.2,), **options)
    text = str(repeated)
    assert "X_T/r 1.2, radius r 50 mm, feed 800 mm/min, height 80 mm; ball at (60, 0) mm on the table" in text
    assert re.search(r"µrad \(\D*100\)", text)
    repeat, slow = repeated.notes
    assert repeat == "circle 2 is a repeat of circle 1: no other candidate adds more"
    assert re.match(r"the expected 1σ assume white noise: slow noise of 0.3 µm .* up to [2-4].* times as large", slow)
    blind = plan_circles(LEAN, DRIVE[1:], family="planar", count=1, **options)
    assert "do not determine backlash of axis C (width): axis C does not move in them" in str(blind)
    assert blind.to_data()["notes"] == list(blind.notes) and blind.notes[0].startswith("WARNING: ")


# --- clearance -------------------------------------------------------------------------------------------------------


def test_a_circle_along_which_bodies_meet_gives_way_to_another(tmp_path: Path) -> None:
    """A whole circle in YZ would carry the bar through what stands under the table ball; the one in XY is clear."""
    machine = preset("three-axis")
    found = plan_circles(
        machine, [make_effect("backlash", "Z"), make_effect("backlash", "Y")], family="planar", count=1, radii=(50.0,),
        planes=("YZ", "XY"), feeds=(1000.0,), rate_hz=20.0, refine=False,
    )  # fmt: skip
    assert {circle.shape.plane for circle in found.circles} == {"XY"}
    found.write(tmp_path / "circles", nc=("linuxcnc",))
    text = next((tmp_path / "circles" / "nc" / "linuxcnc").iterdir()).read_text(encoding="ascii")
    assert "Tested: spindle nose" in text and "NOT CHECKED" not in text.upper().replace("NOT TESTED", "")
    assert check(tmp_path / "circles") == []
    with pytest.raises(InputError, match="no circle can be run: run yz-ccw: bar and cup along the recording"):
        plan_circles(machine, [make_effect("backlash", "Z")], family="planar", count=1, radii=(50.0,), planes=("YZ",),
                     feeds=(1000.0,), rate_hz=20.0, refine=False)  # fmt: skip


@pytest.mark.parametrize(
    ("feeds", "said"),
    [
        ((500.0, 1000.0), ["feed 1000 mm/min is the largest value offered"]),
        ((500.0, 500.0), []),
    ],
)
def test_a_circle_at_the_end_of_its_list_is_said(feeds: tuple[float, ...], said: list[str]) -> None:
    """Lag grows with the feed. The radius was not a choice, so its only value is no end."""
    found = plan_circles(LEAN, DRIVE[:1], count=1, ratios=(0.8,), feeds=feeds, rate_hz=20.0, refine=False)
    assert [note.partition(",")[0] for note in found.notes if "value offered" in note] == said

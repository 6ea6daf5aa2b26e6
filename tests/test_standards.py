"""The numbers of the standards against computations by hand: loops and fractions of this file, nothing of symfive's."""

import csv
import json
import math
import re
import statistics
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from laser_world import laser_run

from symfive.campaign import Campaign, Run, SetupSigma, write_campaign
from symfive.cli import main
from symfive.convert import convert, data_folder
from symfive.errors import InputError
from symfive.identify import identify
from symfive.machine import Machine, preset
from symfive.procedures import (
    campaign_of,
    cone_circle,
    linear_positioning,
    planar_circle,
    r_test_grid,
    rotary_circle,
    synchronous_circle,
)
from symfive.report import _report
from symfive.results import write_identification
from symfive.simulate import simulate
from symfive.standards import (
    FAIL,
    PASS,
    UNDECIDED,
    decided,
    decision,
    standard_values,
    with_uncertainties,
)

EXACT = SetupSigma(table_ball=0.0, tool_ball=0.0, length=0.0)
MACHINE = preset("three-axis")


def _bare(campaign: Campaign, *keep: str) -> Campaign:
    """The machine with these errors alone, the balls where they should be."""
    machine = replace(campaign.machine, errors={n: t for n, t in campaign.machine.errors.items() if n in keep})
    runs = tuple(replace(run, setup_sigma_um=replace(EXACT, length=0.5)) for run in campaign.runs)
    return replace(campaign, machine=machine, runs=runs)


def _circles(run_up_deg: float = 180.0, sweep_deg: float = 360.0, **errors: float | None) -> Campaign:
    runs = planar_circle(MACHINE, radius=100.0, feed=1000.0, rate_hz=20.0, sweep_deg=sweep_deg, run_up_deg=run_up_deg)
    truth = {name: value for name, value in errors.items() if value is not None}  # the others are drawn
    return simulate(_bare(campaign_of(MACHINE, runs), *errors), truth=truth, seed=3).campaign


def _columns(path: Path) -> dict[str, list[float]]:
    with path.open() as stream:
        rows = list(csv.DictReader(stream))
    return {name: [float(row[name]) for row in rows] for name in rows[0]}


def _solved(matrix: list[list[float]], right: list[float]) -> list[float]:
    """Cramer's rule for three unknowns."""

    def det(m: list[list[float]]) -> float:
        (a, b, c), (d, e, f), (g, h, i) = m
        return a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)

    whole = det(matrix)
    return [det([[right[r] if k == c else matrix[r][k] for k in range(3)] for r in range(3)]) / whole for c in range(3)]


def _left_by_hand(points: list[tuple[float, float]]) -> list[float]:
    """Deviations less the centre of their least-squares circle, from the normal equations."""
    rows = [(math.cos(phi), math.sin(phi), 1.0) for phi, _ in points]
    normal = [[sum(r[i] * r[k] for r in rows) for k in range(3)] for i in range(3)]
    right = [sum(r[i] * d for r, (_, d) in zip(rows, points, strict=True)) for i in range(3)]
    a, b, _ = _solved(normal, right)
    return [d - a * r[0] - b * r[1] for r, (_, d) in zip(rows, points, strict=True)]


def _amid(columns: dict[str, list[float]]) -> list[tuple[float, float]]:
    """Angle and deviation of the 360° in the middle of a circle about the origin of X and Y."""
    angles, turned = [], 0.0
    for x, y in zip(columns["X_mm"], columns["Y_mm"], strict=True):
        phi = math.atan2(y, x) + turned
        while angles and phi - angles[-1] > math.pi:
            phi, turned = phi - 2.0 * math.pi, turned - 2.0 * math.pi
        while angles and phi - angles[-1] < -math.pi:
            phi, turned = phi + 2.0 * math.pi, turned + 2.0 * math.pi
        angles.append(phi)
    middle = (min(angles) + max(angles)) / 2.0
    pairs = zip(angles, columns["dL_um"], strict=True)
    return [(phi, d) for phi, d in pairs if abs(phi - middle) <= math.pi + 1e-9]


def test_circular_test_by_hand(tmp_path: Path):
    campaign = _circles(EC0X=60.0, EXX=None)
    write_campaign(campaign, tmp_path / "c")
    found = {value.title: value.value for value in standard_values(campaign)}
    ccw, cw = (_amid(_columns(tmp_path / "c" / f"{name}.csv")) for name in ("xy-ccw", "xy-cw"))
    for title, points in (("G XY CCW", ccw), ("G XY CW", cw), ("G(b) XY", ccw + cw)):
        left = _left_by_hand(points)
        assert found[title] == pytest.approx(max(left) - min(left), abs=0.01)
    left = _left_by_hand(ccw)
    assert found["Fmax XY CCW"] == pytest.approx(max(left), abs=0.01)
    assert found["Fmin XY CCW"] == pytest.approx(min(left), abs=0.01)
    both = _left_by_hand(ccw + cw)
    assert found["D XY"] == pytest.approx(sum(both) / len(both), abs=0.01)
    by_angle = {value.what: value for value in standard_values(campaign) if value.name == "G"}["XY CCW"]
    assert by_angle.conditions["diameter"] == "200 mm" and by_angle.conditions["direction"] == "CCW"
    assert float(by_angle.conditions["feed"].split()[0]) == pytest.approx(1000.0, rel=0.01)
    assert "workpiece frame" in by_angle.conditions["centre"] and "Z 260" in by_angle.conditions["axes at rest"]


def test_squareness_has_the_sign_and_size_of_the_angle_between_the_axes():
    """EC0X = +60 µrad turns +X towards +Y: the angle is 60 µm/m less than 90°. Both ways to find it agree."""
    campaign = _circles(EC0X=60.0)
    (circle,) = (value for value in standard_values(campaign) if value.name.startswith("squareness"))
    identified = identify(campaign)
    (model,) = (value for value in standard_values(identified) if value.what == "(identified)")
    assert circle.name == model.name == "squareness Y to X"
    for value in (circle, model):
        assert value.value == pytest.approx(-60.0, abs=2.0 * value.u) and 0.0 < value.u < 2.0
    g = next(value.value for value in standard_values(campaign) if value.name == "G")
    assert g == pytest.approx(100.0 * 60.0e-3, abs=2.5)  # R·S, and the noise of two readings


def test_the_page_writes_a_value_and_its_uncertainty_as_the_command_does(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(_report, "FIGURES", ())
    campaign = _circles(EC0X=60.0)
    write_identification(identify(campaign), tmp_path)
    page = (tmp_path / "identification.html").read_text()
    for value in standard_values(campaign):
        number, spread = re.search(r"= (\S+) \S+, U = (\S+)", value.words).groups()
        assert re.search(rf">{re.escape(number)}</td>\s*<td[^>]*>{re.escape(spread)}<", page), value.words


def test_a_ball_beside_the_centre_is_no_squareness() -> None:
    """An eccentricity of 0.72 mm adds e²/4R, 1.3 µm, at 2φ: 24 µm/m where nothing is out of square."""
    centred = _circles(EC0X=37.5)
    off = {
        f"setup.{run.id}.table_ball.{axis}": size
        for run in centred.runs
        for axis, size in (("x", 600.0), ("y", -400.0), ("z", 0.0))
    }
    moved = tuple(
        replace(run, setup_sigma_um=SetupSigma(table_ball=1000.0, tool_ball=0.0, length=0.5)) for run in centred.runs
    )
    beside = simulate(replace(centred, runs=moved), truth={"EC0X": 37.5, **off}, seed=3).campaign
    for name in ("squareness Y to X (circle)", "G XY CCW", "G XY CW"):
        right, found = ({v.title: v for v in standard_values(c)}[name] for c in (centred, beside))
        assert abs(found.value - right.value) < 0.1 * right.u, name


def test_a_partial_arc_and_a_bar_without_length_say_so():
    campaign = _circles(run_up_deg=2.0, sweep_deg=220.0, EC0X=60.0)
    free = replace(
        campaign, runs=tuple(replace(r, setup_sigma_um=replace(EXACT, length=1000.0)) for r in campaign.runs)
    )
    values = standard_values(free)
    assert {value.name for value in values} == {"G", "G(b)", "squareness Y to X"}
    g = next(value for value in values if value.name == "G")
    assert "partial arc 2" in g.title and any("not a value of ISO 230-4" in said for said in g.limits)
    assert any("not calibrated" in said for said in g.limits)


def test_readings_left_out_are_told():
    campaign = _circles(EC0X=60.0)
    rows = np.abs(campaign.runs[0].commands["X"]) > 2.0
    cut = [
        replace(r, time=r.time[rows], commands={n: v[rows] for n, v in r.commands.items()},
                readings={n: v[rows] for n, v in r.readings.items()}) for r in campaign.runs[:1]
    ]  # fmt: skip
    (g,) = (value for value in standard_values(replace(campaign, runs=tuple(cut))) if value.name == "G")
    assert any("gaps without readings" in said for said in g.limits)


def _by_hand(up: list[list[float]], down: list[list[float]]) -> dict[str, float]:
    """ISO 230-2 with the standard library: a list of approaches for each target."""
    mean, s = statistics.fmean, statistics.stdev
    xs = [(mean(u), mean(d), s(u), s(d)) for u, d in zip(up, down, strict=True)]
    return {
        "A": max(max(u + 2 * su, d + 2 * sd) for u, d, su, sd in xs)
        - min(min(u - 2 * su, d - 2 * sd) for u, d, su, sd in xs),
        "E": max(max(u, d) for u, d, _, _ in xs) - min(min(u, d) for u, d, _, _ in xs),
        "R": max(max(2 * su + 2 * sd + abs(u - d), 4 * su, 4 * sd) for u, d, su, sd in xs),
        "M": max((u + d) / 2 for u, d, _, _ in xs) - min((u + d) / 2 for u, d, _, _ in xs),
        "B": max(abs(u - d) for u, d, _, _ in xs),
        "A up": max(u + 2 * su for u, _, su, _ in xs) - min(u - 2 * su for u, _, su, _ in xs),
        "E down": max(d for _, d, _, _ in xs) - min(d for _, d, _, _ in xs),
        "R up": max(4 * su for _, _, su, _ in xs),
    }


def test_positioning_by_hand(tmp_path: Path):
    runs = linear_positioning(MACHINE, axis="Y", overrun=3.0)
    campaign = simulate(campaign_of(MACHINE, runs), seed=5).campaign
    write_campaign(campaign, tmp_path / "c")
    columns = _columns(tmp_path / "c" / "y-positioning.csv")
    y, x = columns["Y_mm"], columns["Y_dev_um"]
    stops = sorted(set(y))[1:-1]  # the outermost are the overruns
    rows = range(1, len(y))
    up = [[x[k] for k in rows if y[k] == t and y[k] > y[k - 1]] for t in stops]
    down = [[x[k] for k in rows if y[k] == t and y[k] < y[k - 1]] for t in stops]
    assert {len(each) for each in up + down} == {5}
    found = {value.title.replace("Y", "").replace("  ", " ").strip(): value for value in standard_values(campaign)}
    for name, value in _by_hand(up, down).items():
        assert found[name].value == pytest.approx(value, abs=0.01), name
    # σ/√n of each mean: a difference of two means has σ·√(2/n)
    assert found["B"].u == pytest.approx(2.0 * 0.3 * math.sqrt(2.0 / 5.0), rel=1e-3)


def test_positioning_of_a_rotary_axis_by_hand():
    machine, rng, stops = preset("table-bc"), np.random.default_rng(7), [-170.0, -110.3, -31.7, 42.9, 101.1, 158.2]
    way = [s for _ in range(5) for s in (-175.0, *stops, 175.0, *stops[::-1])] + [-175.0]
    deviation = rng.normal(0.0, 4.0, len(way)) + 20.0 * np.sin(np.radians(way))
    commands = {**{n: np.zeros(len(way)) for n in machine.axes}, "C": np.array(way)}
    run = laser_run("c", commands["C"], deviation, "C", commands=commands, noise_um=1.0)
    rows = range(1, len(way))
    up = [[float(deviation[k]) for k in rows if way[k] == t > way[k - 1]] for t in stops]
    down = [[float(deviation[k]) for k in rows if way[k] == t < way[k - 1]] for t in stops]
    found = {value.title: value for value in standard_values(Campaign(machine=machine, runs=(run,)))}
    for name, value in _by_hand(up, down).items():
        first, _, side = name.partition(" ")
        assert found[f"{first} C {side}".strip()].value == pytest.approx(value, rel=1e-9), name
    computed = found["A C"]
    (own,) = with_uncertainties([computed], {"A": 5.0})  # the user's budget has more than the noise
    assert own.u == 5.0 and [s for s in computed.limits if s not in own.limits] == [
        "U contains the noise of a reading only, not scale, alignment and temperature of the instrument"
    ]
    assert {value.unit for value in found.values()} == {"urad"}
    assert found["A C"].conditions["targets"] == "6 from -170 to 158.2 °" and "µrad" in found["A C"].words


def test_readings_that_are_rounded_alike_are_not_exact():
    """The uncertainty of a range of means of n readings: 2 σ √(2/n), of a reversal the same; the deviations are all equal."""
    machine, stops, cycles = MACHINE, [-200.0, -80.5, 10.0, 90.5, 180.0], 5
    way = np.array([s for _ in range(cycles) for s in (-210.0, *stops, 210.0, *stops[::-1])])
    commands = {"X": way, "Y": 0.0 * way, "Z": 0.0 * way}
    run = laser_run("x", way, np.full(len(way), 1.5), commands=commands, noise_um=0.3)
    found = {value.title: value for value in standard_values(Campaign(machine=machine, runs=(run,)))}
    for name in ("E X", "E X up", "E X down", "B X"):
        assert found[name].value == 0.0
        assert found[name].u == pytest.approx(0.6 * math.sqrt(2.0 / cycles), rel=0.02), name
    assert all(value.u > 0.2 for value in found.values())


REPORTS = {
    "ecmc-iso230/report.md": "X", "ess-xyz/b02_x_target_x.md": "X", "ess-xyz/b02_y_report_target_y.md": "Y",
    "ess-xyz/b02_z_report_z.md": "Z",
}  # fmt: skip


_converted = cache(convert)
"""Several reports are of one recording."""


@pytest.mark.parametrize("name", REPORTS)
def test_real_positioning_is_what_the_reports_of_others_print(name: str):
    """B, R, M and A of each direction as the ecmc scripts computed them, on the readings as these scripts had them (their own
    fit of the scale undone by hand). Their bi-directional A and E take another definition and are computed here."""
    try:
        folder = data_folder()
    except InputError as error:
        pytest.skip(str(error))
    path = folder / f"{name}_ISO230.dat"
    text = path.read_text()
    target = {int(i): float(v) for i, v in re.findall(r"TGT_DATA\[(\d+)\]=(\S+)", text)}
    read = {
        (d, int(i), int(j)): 1e3 * (float(v) - target[int(i)])
        for d, i, j, v in re.findall(r"REF_DATA_(FWD|BWD)\[(\d+),(\d+)\]=(\S+)", text)
    }
    cycles = sorted({j for _, _, j in read})
    up, down = ([[read[d, i, j] for j in cycles] for i in sorted(target)] for d in ("FWD", "BWD"))
    campaign = _converted(name.partition("/")[0])
    run = campaign.run(path.name.partition(".")[0])
    order = [(d, i, j) for j in cycles for d, flip in (("FWD", 1), ("BWD", -1)) for i in sorted(target)[::flip]]
    run = run.with_readings({f"{REPORTS[name]}_dev_um": np.array([read[key] for key in order])})
    machine = replace(campaign.machine, errors={})
    values = {value.title: value.value for value in standard_values(Campaign(machine=machine, runs=(run,)))}
    axis = REPORTS[name]
    for key, value in _by_hand(up, down).items():
        first, _, side = key.partition(" ")
        assert values[f"{first} {axis} {side}".strip()] == pytest.approx(value, abs=0.01), key
    report = (folder / name).read_text() if (folder / name).is_file() else ""
    printed = {
        key: 1e3 * float(v) for key, v in re.findall(r"^\**(B|R|M|A_fwd|A_bwd) = ([0-9.]+) \[mm\]", report, re.M)
    }
    sides = (("A_fwd", f"A {axis} up"), ("A_bwd", f"A {axis} down"))
    exchanged = (("A_fwd", f"A {axis} down"), ("A_bwd", f"A {axis} up"))  # the report has the directions exchanged
    if report:
        assert {"B", "M", "A_fwd", "A_bwd"} <= set(printed)
        assert values[f"B {axis}"] == pytest.approx(printed["B"], abs=0.011)
        assert values[f"M {axis}"] == pytest.approx(printed["M"], abs=0.011)
        assert any(
            all(values[mine] == pytest.approx(printed[theirs], abs=0.02) for theirs, mine in pairs)
            for pairs in (sides, exchanged)
        )


def test_rotary_tests_give_the_range_of_each_reading(tmp_path: Path):
    machine = preset("table-bc")
    runs = (*rotary_circle(machine), *r_test_grid(machine))
    campaign = simulate(campaign_of(machine, runs), seed=1).campaign
    write_campaign(campaign, tmp_path / "c")
    values = standard_values(campaign)
    assert {value.standard for value in values} == {"ISO 10791-6"}
    seen = {value.name for value in values}
    assert "BK2" in seen and all(name.startswith("BK") for name in seen)
    for value in values:
        columns = _columns(tmp_path / "c" / f"{value.runs[0]}.csv")
        column = {"X": "dx_um", "Y": "dy_um", "Z": "dz_um"}.get(value.what, "dL_um")
        assert value.value == pytest.approx(max(columns[column]) - min(columns[column]), abs=0.01)
        assert (value.conditions["feed"] == "none (static readings)") == (not campaign.run(value.runs[0]).dynamic)


def test_decisions_of_iso_14253_1(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    assert [decision(8.0, 1.0, limit) for limit in (9.0, 8.5, 7.5, 6.9)] == [PASS, UNDECIDED, UNDECIDED, FAIL]
    assert decision(-8.0, 1.0, 6.9) == FAIL and decision(8.0, math.nan, 100.0) == UNDECIDED
    campaign = _circles(EC0X=60.0)
    values = standard_values(campaign)
    known = with_uncertainties(values, {"G@xy-ccw": 0.0})
    g = [i for i, v in enumerate(known) if v.name == "G"]
    assert known[g[0]].u == 0.0 and known[g[1]].u == values[g[1]].u
    assert set(decided(values, {"G": 1e-3}).values()) == {(1e-3, FAIL)} and len(decided(values, {"G": 1.0})) == 2
    write_campaign(campaign, tmp_path / "c")
    words = ["standards", str(tmp_path / "c"), "-o", str(tmp_path / "s.json"), "-q"]
    assert main([*words, "--tolerance", "G=20", "--tolerance", "squareness Y to X=60", "--uncertainty", "G=2"]) == 0
    said = capsys.readouterr().out
    assert "tolerance 20 µm: pass" in said and "cannot be decided at this uncertainty" in said
    data = json.loads((tmp_path / "s.json").read_text())
    assert data["schema"] == "symfive.standards/1" and {row["U"] for row in data["values"] if row["name"] == "G"} == {
        2.0
    }
    for option, problem in ((["--tolerance", "H=4"], 'is called "H"'), (["--tolerance", "G"], "NAME=VALUE")):
        assert main([*words, "--json", *option]) == 2
        error = capsys.readouterr().err
        assert problem in error and error.count("\n") == 1


def _named(machine: Machine, run: Run) -> str:
    """What a test of flat readings is called."""
    flat = run.with_readings({"dL_um": np.zeros(run.rows)})
    (value,) = standard_values(Campaign(machine=machine, runs=(flat,)))
    return value.name


@pytest.mark.parametrize(("name", "annex"), [("head-bc", "AK"), ("mixed-bc", "CK"), ("table-bc", "BK")])
def test_rotary_tests_have_their_numbers(name: str, annex: str) -> None:
    """Tilting axis 1, turning axis 2, with one linear axis 3, all five axes 4."""
    machine = preset(name)
    for axis, number in (("B", "1"), ("C", "2")):
        run = rotary_circle(machine, axis=axis, rate_hz=10.0)[0]
        assert _named(machine, run) == f"{annex}{number}"
    assert _named(machine, cone_circle(machine, inclination_deg=10.0, rate_hz=10.0)[0]) == f"{annex}4"


def test_a_table_that_turns_while_one_axis_moves_is_number_3() -> None:
    machine = preset("table-bc")
    assert _named(machine, synchronous_circle(machine, x_t=60.0, radius=50.0, rate_hz=10.0)[0]) == "BK3"

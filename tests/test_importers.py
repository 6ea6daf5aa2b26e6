"""The polar form of a ball bar: read, put back on the programme's positions, identified like a campaign of its own."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from symfive.campaign import Campaign, Run, read_campaign, write_campaign
from symfive.cli import main
from symfive.errors import InputError
from symfive.identify import identify
from symfive.importers import polar_run, read_polar
from symfive.machine import preset, write_machine
from symfive.model import Model
from symfive.motion import RunMotion
from symfive.procedures import campaign_of, planar_circle
from symfive.simulate import simulate

MACHINE = preset("three-axis")
CENTRE, RADIUS, FEED = (0.0, 0.0, 110.0), 100.0, 1000.0


def _circles(overshoot: float = 0.0) -> Campaign:
    runs = planar_circle(
        MACHINE, radius=RADIUS, feed=FEED, centre=CENTRE, rate_hz=20.0, sweep_deg=360.0 + overshoot, run_up_deg=60.0
    )
    return campaign_of(MACHINE, runs)


def _polar(run: Run) -> tuple[np.ndarray, np.ndarray]:
    """What an instrument's software would export of a run: the middle of it, the angle where the axes are, and the deviation."""
    x, y = (RunMotion(run, MACHINE, {}, {}).axis(name).position.value for name in "XY")
    phi = np.unwrap(np.arctan2(y, x))
    steady = np.abs(np.abs(np.gradient(phi, run.time)) - FEED / 60.0 / RADIUS) < 1e-6
    return np.degrees(phi[steady]), run.readings["dL_um"][steady]


def test_positions_and_drives_are_those_of_the_programme():
    """The middle of a circle, cut out and put back: the drives move as in the whole one, from the first row on."""
    (whole, _) = _circles().runs
    whole = replace(whole, options={**whole.options, "between": "curve"})  # of a control, not of the rows of a plan
    x = whole.commands["X"]
    angle, _ = _polar(whole.with_readings({"dL_um": np.zeros(whole.rows)}))
    part = polar_run(MACHINE, angle, np.zeros(len(angle)), centre=CENTRE, radius=RADIUS, feed=FEED, angle_error=0.0)
    first = int(np.argmin(np.abs(x - part.commands["X"][0]) + np.abs(whole.commands["Y"] - part.commands["Y"][0])))
    rows = slice(first, first + part.rows)
    for name in ("X", "Y", "Z"):
        np.testing.assert_allclose(part.commands[name], whole.commands[name][rows], atol=2e-4)
        full, cut = (RunMotion(run, MACHINE, {}, {}).axis(name) for run in (whole, part))
        np.testing.assert_allclose(cut.position.value, full.position.value[rows], atol=2e-4)
        np.testing.assert_allclose(cut.velocity.value, full.velocity.value[rows], atol=3e-4)
    at_rest = RunMotion(replace(part, options={"between": "curve"}), MACHINE, {}, {}).axis("Y").position.value
    moving = RunMotion(part, MACHINE, {}, {}).axis("Y").position.value
    assert np.abs(at_rest - moving)[:3].max() > 1e-2  # else the drive would have to catch up from standstill


def test_a_planned_circle_says_what_the_export_does_not(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    """Radius, feed, centre, plane and direction come from the plan's run, found by the file's name or by its place."""
    plan = simulate(_circles(), truth={"EC0X": 45.0}, seed=4).campaign
    write_campaign(plan, tmp_path / "plan")
    named, listed = [], []
    for i, run in enumerate(plan.runs):
        angle, deviation = _polar(run)
        order = np.argsort(angle)  # as a software that sorts by the angle
        text = "".join(f"{a},{d}\n" for a, d in zip(angle[order], deviation[order], strict=True))
        for name, files in ((f"{run.id}.csv", named), (f"export{i}.csv", listed)):
            (tmp_path / name).write_text(text)
            files.append(str(tmp_path / name))
    words = ["--radius", str(RADIUS), "--feed", str(FEED), "--centre", "0,0,110"]
    words += ["--direction", "ccw", "--direction", "cw"]
    calls = {"plan": named[::-1], "order": listed}
    for name, files in calls.items():
        assert main(["import-polar", str(tmp_path / "plan"), *files, "-o", str(tmp_path / f"by-{name}"), "-q"]) == 0
    assert main(["import-polar", "three-axis", *named, "-o", str(tmp_path / "by-words"), *words, "-q"]) == 0
    told = read_campaign(tmp_path / "by-words")
    for name in calls:
        found = read_campaign(tmp_path / f"by-{name}")
        assert {run.id for run in found.runs} == {run.id for run in plan.runs}
        for run in found.runs:
            other = told.run(run.id)
            assert run.table_ball == CENTRE and run.length == RADIUS
            np.testing.assert_allclose(run.time, other.time, atol=1e-9)
            np.testing.assert_allclose(run.commands["X"], other.commands["X"], atol=1e-6)
    assert main(["import-polar", str(tmp_path / "plan"), listed[0], "-o", str(tmp_path / "none")]) == 2
    assert "name each file as its run" in capsys.readouterr().err and not (tmp_path / "none").exists()


def test_errors_come_out_as_from_the_whole_recording(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    plan = _circles()
    measured = simulate(plan, truth={"EC0X": 45.0}, seed=4)
    files = []
    for run in measured.campaign.runs:
        angle, deviation = _polar(run)
        files.append(tmp_path / f"{run.id}.csv")
        files[-1].write_text(
            "angle;deviation\n" + "\n".join(f"{a:.6f};{d:.3f}" for a, d in zip(angle, deviation, strict=True))
        )
    words = ["import-polar", "three-axis", *files, "-o", tmp_path / "c", "--radius", RADIUS, "--feed", FEED]
    assert main([str(w) for w in [*words, "--centre", "0,0,110", "-q"]]) == 0
    campaign = read_campaign(tmp_path / "c")
    assert {run.options["start"] for run in campaign.runs} == {"moving"}
    found = identify(campaign)
    assert found["EC0X"] == pytest.approx(45.0, abs=4.0 * found.uncertainty("EC0X"))
    assert found.uncertainty("EC0X") < 1.2 * identify(measured.campaign).uncertainty("EC0X") and found.chi2_dof < 1.1
    assert np.abs(Model(campaign).predict_run(campaign.runs[0], Model(campaign).prior_mean)).max() < 2.0


@pytest.mark.parametrize(
    "line", ["{a:.3f},{d:.2f}", "{a:.3f};{d:.2f}", "{a:.3f}\t{d:.2f}", "  {a:.3f}   {d:.2f}", "comma"]
)
def test_columns_are_parted_by_whatever_parts_them(line: str, tmp_path: Path):
    angle, deviation = np.arange(0.0, 360.0, 2.0), np.sin(np.arange(180.0))
    rows = [
        f"{a:.3f};{d:.2f}".replace(".", ",") if line == "comma" else line.format(a=a, d=d)
        for a, d in zip(angle, deviation, strict=True)
    ]
    path = tmp_path / "bar.txt"
    path.write_text("\ufeffBall bar\nRadius 100\n\n" + "\n".join(rows) + "\n\n", encoding="utf-8")
    read_angle, read_deviation = read_polar(path)
    np.testing.assert_allclose(read_angle, angle, atol=1e-3)
    np.testing.assert_allclose(read_deviation, deviation, atol=6e-3)
    assert read_polar(path, unit="mm")[1] == pytest.approx(1e3 * read_deviation)


@pytest.mark.parametrize(
    ("head", "unit", "turn", "micrometres"),
    [
        ("angle deviation", None, 1.0, 1.0),
        ("angle_deg deviation_mm", None, 1.0, 1e3),
        ("Angle [°];Deviation [mil]", None, 1.0, 25.4),
        ("angle (rad);deviation (in)", None, 180.0 / np.pi, 25400.0),
        ("angle (rad);deviation (in)", "um", 180.0 / np.pi, 1.0),
        ("angle;deviation [counts]", "mm", 1.0, 1e3),
    ],
)
def test_the_head_of_an_export_names_its_units(
    tmp_path: Path, head: str, unit: str | None, turn: float, micrometres: float
):
    path = tmp_path / "bar.txt"
    sign = ";" if ";" in head else " "
    path.write_text("\n".join([head, *(f"{0.1 * k:.1f}{sign}{k % 7 - 2.5}" for k in range(60))]), encoding="utf-8")
    angle, deviation = read_polar(path, unit=unit)
    assert angle[10] == pytest.approx(turn) and deviation[0] == pytest.approx(-2.5 * micrometres)


@pytest.mark.parametrize("head", ["angle;deviation [counts]", "angle [mm];deviation"])
def test_a_unit_of_no_such_quantity_is_refused(tmp_path: Path, head: str):
    path = tmp_path / "bar.txt"
    path.write_text("\n".join([head, *(f"{k};0.5" for k in range(60))]), encoding="utf-8")
    with pytest.raises(InputError, match="has the unit") as caught:
        read_polar(path)
    assert caught.value.path == path


def test_bad_files_end_in_one_sentence(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    good = "\n".join(f"{a} 0.5" for a in range(0, 360, 3))
    cases = {
        "text": (good + "\nend of file\n", "line 121", "remove what is no row"),
        "short": ("1 2\n2 3\n", "2 readings", "at least 20"),
        "stands": ("\n".join("10 0.5" for _ in range(40)), "reading 2", "even steps"),
        "turns": (good + "\n" + "\n".join(f"{a} 0.5" for a in range(354, 0, -3)), "reading 121", "even steps"),
        "nan": (good.replace("0.5", "nan", 1), "line 1", "write the reading"),
    }
    for name, (text, place, remedy) in cases.items():
        path = tmp_path / f"{name}.txt"
        path.write_text(text)
        words = ["import-polar", "three-axis", path, "-o", tmp_path / "out", "--radius", 100, "--feed", 1000, "-q"]
        code = main([str(w) for w in words])
        said = capsys.readouterr().err
        assert code == 2 and said.count("\n") == 1 and place in said and remedy in said and path.name in said, said
        assert not (tmp_path / "out").exists()
    with pytest.raises(InputError, match="no circle"):
        polar_run(MACHINE, np.arange(0.0, 360.0, 3.0), np.zeros(120), centre=CENTRE, radius=0.0, feed=1.0)
    with pytest.raises(InputError, match="one deviation per angle"):
        polar_run(MACHINE, np.arange(0.0, 360.0, 3.0), np.zeros(12), centre=CENTRE, radius=100.0, feed=1000.0)
    with pytest.raises(InputError, match=r"no reading is further than 180° .* give a smaller angle_error"):
        polar_run(
            MACHINE,
            np.arange(0.0, 360.0, 2.0),
            np.zeros(180),
            centre=CENTRE,
            radius=RADIUS,
            feed=FEED,
            angle_error=180.0,
        )


ANGLES = range(0, 360, 3)
LACKING = {
    "one": (["{a}"], [], "holds no table of numbers", "export text with at least two columns"),
    "three": (
        ["7", "{a}", "{d}"],
        [],
        "the rows have 3 numbers and 2 columns are named",
        "--columns angle,deviation,-",
    ),
    "commas": (
        ["{a},0,{d},0"],
        [],
        "the rows have 4 numbers",
        "if these are decimal commas, separate the columns by semicolons",
    ),
    "named": (["{a}", "{d}"], ["--columns", "angle"], "do not name angle and deviation", "--columns angle,deviation"),
    "feed": (["{a}", "{d}"], ["--radius", "100"], "angle and deviation are there, feed not", "--feed 1000 (mm/min)"),
    "both": (["{a}", "{d}"], [], "radius and feed not", "add --radius 100 (mm) and --feed 1000 (mm/min)"),
    "turn": (["{a}", "{d}"], ["--direction", "left"], "direction", "ccw, cw"),
    "turns": (["{a}", "{d}"], ["--direction", "cw", "--direction", "cw"], "1 files have 2 directions", "once per file"),
}


def test_a_clockwise_file_is_not_taken_for_a_counter_clockwise_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    """Software that sorts lets the angles rise; falling ones are the motion."""
    plan = simulate(_circles(), seed=4).campaign
    write_campaign(plan, tmp_path / "plan")
    files = []
    for i, run in enumerate(reversed(plan.runs)):  # in the wrong order
        path = tmp_path / f"export{i}.csv"
        path.write_text("".join(f"{a},{d}\n" for a, d in zip(*_polar(run), strict=True)))
        files.append(str(path))
    assert main(["import-polar", str(tmp_path / "plan"), *files, "-o", str(tmp_path / "out"), "-q"]) == 2
    said = capsys.readouterr().err
    assert "export0.csv: the angles fall" in said and "in the order of the plan's runs" in said
    assert not (tmp_path / "out").exists()


def test_the_file_of_another_plane_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    """Arcs of 220° in YZ and ZX begin 90° apart."""
    size = {"radius": RADIUS, "feed": FEED, "centre": CENTRE, "sweep_deg": 220.0}
    yz = planar_circle(MACHINE, plane="YZ", start_deg=-20.0, **size)[0]
    zx = planar_circle(MACHINE, plane="ZX", start_deg=-110.0, **size)[0]
    write_campaign(campaign_of(MACHINE, [yz, zx]), tmp_path / "plan")
    files = []
    for i, first in enumerate((-110.0, -20.0)):  # in the wrong order
        files.append(str(tmp_path / f"export{i}.txt"))
        Path(files[-1]).write_text("".join(f"{first + 0.5 * k},{np.sin(k):.2f}\n" for k in range(441)))
    words = ["import-polar", str(tmp_path / "plan"), "-o", str(tmp_path / "out"), "-q"]
    assert main([*words, *files]) == 2
    assert f"export0.txt: the angle -90.0° lies 68.0° beyond run {yz.id} of the plan" in capsys.readouterr().err
    assert main([*words, *files[::-1]]) == 0
    assert [run.id for run in read_campaign(tmp_path / "out").runs] == [yz.id, zx.id]


def test_a_run_without_a_file_and_one_that_was_stopped_are_noted(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    plan = simulate(_circles(), seed=4).campaign
    write_campaign(plan, tmp_path / "plan")
    rows = {run.id: [f"{a},{d}\n" for a, d in zip(*_polar(run), strict=True)] for run in plan.runs}
    first, second = rows
    path = tmp_path / f"{first}.csv"
    for share, said in ((1.0, False), (0.5, True)):
        path.write_text("".join(rows[first][: int(share * len(rows[first]))]))
        assert main(["import-polar", str(tmp_path / "plan"), str(path), "-o", str(tmp_path / f"m{share}")]) == 0
        notes = [line for line in capsys.readouterr().err.splitlines() if line.startswith("note:")]
        assert sum(f"no file for {second}" in note for note in notes) == 1
        assert any(note.startswith(f"note: {first}: the angles cover") for note in notes) == said, notes


@pytest.mark.parametrize(("option", "value", "right"), [("--radius", "150", "100.02"), ("--plane", "ZX", "XY")])
def test_another_circle_than_the_planned_one_is_refused(
    option: str, value: str, right: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    plan = simulate(_circles(), seed=4).campaign
    write_campaign(plan, tmp_path / "plan")
    path = tmp_path / f"{plan.runs[0].id}.csv"
    path.write_text("".join(f"{a},{d}\n" for a, d in zip(*_polar(plan.runs[0]), strict=True)))
    call = ["import-polar", str(tmp_path / "plan"), str(path), "-o", str(tmp_path / "m"), option]
    assert main([*call, value]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and f"run {plan.runs[0].id} of the plan" in said and not (tmp_path / "m").exists()
    assert main([*call, right]) == 0


def test_what_stays_mounted_in_the_plan_stays_mounted(tmp_path: Path):
    runs = tuple(replace(run, mounting={"tool_ball": "1", "length": "1"}) for run in _circles().runs)
    plan = simulate(replace(_circles(), runs=runs), seed=4).campaign
    write_campaign(plan, tmp_path / "plan")
    for run in plan.runs:
        text = "".join(f"{a},{d}\n" for a, d in zip(*_polar(run), strict=True))
        (tmp_path / f"{run.id}.csv").write_text(text)
    files = [str(tmp_path / f"{run.id}.csv") for run in plan.runs]
    assert main(["import-polar", str(tmp_path / "plan"), *files, "-o", str(tmp_path / "out"), "-q"]) == 0
    for run in read_campaign(tmp_path / "out").runs:
        assert dict(run.mounting) == {"tool_ball": "1", "length": "1"}


def test_lengths_of_the_bar_are_not_taken_for_deviations(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    path = tmp_path / "ccw.csv"
    path.write_text("angle,radius\n" + "".join(f"{a},{RADIUS + 7e-3 * np.sin(np.radians(a)):.6f}\n" for a in ANGLES))
    call = ["import-polar", "three-axis", str(path), "--radius", str(RADIUS), "--feed", "1000", "-o"]
    assert main([*call, str(tmp_path / "c")]) == 0
    assert "if the file holds the bar's length, subtract the radius" in capsys.readouterr().err
    assert main([*call, str(tmp_path / "d"), "--unit", "mm"]) == 2
    assert f"the length of the bar; subtract the radius, {RADIUS:g} mm" in capsys.readouterr().err


@pytest.mark.parametrize("name", LACKING)
def test_what_an_export_lacks_is_named_with_the_option_that_declares_it(name: str, tmp_path: Path, capsys):
    columns, options, says, remedy = LACKING[name]
    path = tmp_path / f"{name}.csv"
    path.write_text("".join(";".join(columns).format(a=a, d=round(np.sin(a), 3)) + "\n" for a in ANGLES))
    assert main(["import-polar", "three-axis", str(path), "-o", str(tmp_path / "out"), *options]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and says in said and remedy in said, said


def test_columns_and_direction_are_declared(tmp_path: Path):
    path = tmp_path / "cw.csv"
    path.write_text("".join(f"{k};{np.sin(a):.4f};{a}\n" for k, a in enumerate(ANGLES)))
    angle, deviation = read_polar(path, columns=("-", "deviation", "angle"), direction="cw")
    assert angle.tolist() == [float(a) for a in reversed(ANGLES)] and deviation[0] == pytest.approx(
        np.sin(357), abs=1e-4
    )
    assert read_polar(path, columns=("-", "deviation", "angle"), direction="ccw")[0][0] == 0.0


@given(st.text(alphabet="0123456789.,;-+e \t\nabc°", max_size=400))
def test_no_text_ends_in_a_traceback(text: str):
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "x.txt"
        path.write_text(text, encoding="utf-8")
        try:
            angle, deviation = read_polar(path)
        except InputError:
            return
        assert len(angle) == len(deviation) >= 20 and np.isfinite(angle).all() and np.isfinite(deviation).all()


def test_a_circle_beyond_the_travel_is_refused_and_deviations_in_mm_are_asked_about(tmp_path, capsys):
    machine = preset("three-axis")
    angle = np.arange(0.0, 360.0, 1.0)
    high = machine.axes["Z"].travel[1] + 400.0
    with pytest.raises(InputError, match=r"axis Z would go to .* its travel is .* change the centre"):
        polar_run(machine, angle, np.zeros(360), centre=(0.0, 0.0, high), radius=100.0, feed=1000.0)
    file = tmp_path / "circle.txt"
    file.write_text("".join(f"{a} {0.004 * np.cos(np.radians(2 * a)):.6f}\n" for a in angle))
    call = ["import-polar", "three-axis", str(file), "-o", str(tmp_path / "c"), "--radius", "100", "--feed", "1000"]
    assert main(call) == 0
    assert "if they are mm, give --unit mm" in capsys.readouterr().err
    assert main([*call[:4], str(tmp_path / "d"), *call[5:], "--unit", "mm"]) == 0
    assert "give --unit mm" not in capsys.readouterr().err


ODD = {
    "radians": (np.radians(ANGLES), ["--feed", "1000"], ["cover 6.23° only; if they are radians"]),
    "fast": (
        ANGLES,
        ["--feed", "150000"],
        ["mm/min, its max_feed is 30000; give --feed in mm/min"],
    ),
    "slow": (
        ANGLES,
        ["--feed", "1.5"],
        ["at 1.5 mm/min one circle takes 7 hours; if the feed is in m/min, give --feed 1500"],
    ),
}


@pytest.mark.parametrize("name", ODD)
def test_what_is_odd_about_a_circle_is_noted_with_the_remedy(name: str, tmp_path: Path, capsys):
    angles, options, says = ODD[name]
    path = tmp_path / f"{name}.txt"
    path.write_text("".join(f"{a:.6f} {3.0 * np.sin(a):.3f}\n" for a in angles))
    machine = replace(MACHINE, axes={n: replace(a, max_feed=30000.0) for n, a in MACHINE.axes.items()})
    write_machine(machine, tmp_path / "machine.toml")
    call = ["import-polar", str(tmp_path / "machine.toml"), str(path), "-o", str(tmp_path / "c"), "--radius", "100"]
    assert main([*call, *options]) == 0
    notes = capsys.readouterr().err
    assert all(words in notes for words in says), notes
    assert main([*call, "--feed", "1000", "-q", "--overwrite"]) == 0
    assert capsys.readouterr().err == ""


def test_two_files_of_one_direction_are_noted(tmp_path: Path, capsys):
    for name, size in (("a", 3.0), ("b", 3.1)):
        (tmp_path / f"{name}.txt").write_text("".join(f"{a} {1.0 + size * np.sin(a):.3f}\n" for a in ANGLES))
    call = ["import-polar", "three-axis", str(tmp_path / "a.txt"), str(tmp_path / "b.txt"), "-o", str(tmp_path / "c")]
    call += ["--radius", "100", "--feed", "1000"]
    assert main(call) == 0
    assert "note: all 2 files go ccw" in capsys.readouterr().err
    assert main([*call, "--direction", "ccw", "--direction", "cw", "--overwrite"]) == 0
    assert "note:" not in capsys.readouterr().err


def test_a_radius_that_was_taken_off_is_noted_and_left_open(tmp_path: Path, capsys):
    """Without it, the lag of the drives that the machine file declares would be sought in a length that is not there."""
    campaign = simulate(_circles(overshoot=20.0), truth={}, seed=4).campaign
    for run, name in zip(campaign.runs, ("ccw", "cw"), strict=True):
        angle, deviation = _polar(run)
        rows = zip(angle, deviation - deviation.mean(), strict=True)
        (tmp_path / f"{name}.txt").write_text("".join(f"{a:.6f} {d:.4f}\n" for a, d in rows))
    call = ["import-polar", "three-axis", *(str(tmp_path / f"{name}.txt") for name in ("ccw", "cw"))]
    call += ["-o", str(tmp_path / "c"), "--radius", "100", "--feed", "1000", "--centre", "0,0,110"]
    assert main(call) == 0
    said = capsys.readouterr().err
    assert "note: no circle has a mean deviation" in said and "give --fitted" in said
    assert main([*call, "--fitted", "--overwrite"]) == 0
    assert "note:" not in capsys.readouterr().err
    read = read_campaign(tmp_path / "c")
    assert all(run.setup_sigma_um.length == run.setup_sigma_um.table_ball == 1000.0 for run in read.runs)
    assert identify(read).chi2_dof < 1.3


def test_one_decimal_mark_throughout_a_file_but_for_its_head(tmp_path):
    rows = [f"{a:.1f};{np.sin(a):.3f}".replace(".", ",") for a in np.arange(0.0, 300.0, 10.5)]
    path = tmp_path / "polar.csv"
    path.write_text("\n".join(["Radius;100.5", *rows]))
    assert read_polar(path)[0][1] == 10.5
    path.write_text("\n".join(["Radius;100.5", *rows[:9], rows[9].replace(",", "."), *rows[10:]]))
    with pytest.raises(InputError, match="has a decimal point, line 2 a decimal comma") as caught:
        read_polar(path)
    assert caught.value.line == 11 and caught.value.path == path

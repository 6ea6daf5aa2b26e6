"""Tables as instruments export them: read, understood, cut into runs, and refused where only a guess would do."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from plant.drives import Drive, follow

from symfive.campaign import Campaign, Run, read_campaign
from symfive.cli import main
from symfive.errors import InputError
from symfive.identify import identify
from symfive.importers import (
    cycles_of,
    every,
    guessed_meanings,
    meanings,
    moved_pieces,
    read_table,
    split,
    taken,
    turns_of,
)
from symfive.machine import preset
from symfive.model import Model
from symfive.procedures import Nominal, r_test_grid
from symfive.standards import standard_values

MACHINE = preset("three-axis")
ANGLES = np.arange(0.0, 360.0, 2.0)


def _run(*words: object) -> int:
    return main([str(word) for word in words])


def _imported(folder: Path, machine: str, *words: object) -> Campaign:
    assert _run("import", machine, *words, "-o", folder / "out", "-q") == 0
    return read_campaign(folder / "out")


@pytest.mark.parametrize("separator", [";", "\t", ",", "  "])
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "cp1252", "utf-16"])
def test_whatever_the_separator_mark_and_encoding(separator: str, encoding: str, tmp_path: Path):
    comma = separator != ","
    rows = [separator.join(f"{v:.3f}".replace(".", "," if comma else ".") for v in (a, np.sin(a))) for a in ANGLES]
    head = f"Ballbar, größe 100\nRadius{separator}100\n\nAngle [°]{separator}Deviation [µm]"
    (tmp_path / "bar.csv").write_bytes("\r\n".join([head.replace("\n", "\r\n"), *rows, ""]).encode(encoding))
    table = read_table(tmp_path / "bar.csv")
    assert table.names == ("Angle", "Deviation") and table.units == ("deg", "um")
    np.testing.assert_allclose(table.numbers, np.stack([ANGLES, np.sin(ANGLES)], axis=1), atol=6e-4)
    columns = taken(table, meanings(table, MACHINE, ()), MACHINE)
    np.testing.assert_allclose(columns["deviation"][:, 0], 1e-3 * np.sin(ANGLES), atol=1e-6)


def test_a_text_counts_where_its_column_is_used(tmp_path: Path, capsys):
    """A laser's software writes the direction, an operator a remark."""
    rows = [f"{k},{'+-'[k % 2]},{50 * k},{0.1 * k},{'ok' if k % 3 else '12'}" for k in range(6)]
    (tmp_path / "laser.csv").write_text("\n".join(["Run,Direction,Target (mm),Error (um),Remark", *rows]))
    table = read_table(tmp_path / "laser.csv")
    assert table.numbers[:, 2].tolist() == [0.0, 50.0, 100.0, 150.0, 200.0, 250.0] and sorted(table.texts) == [1, 4]
    assert guessed_meanings(table, preset("three-axis"))[1].name == "deviation"
    for column, code in (("4", 0), ("5", 2)):
        files = (tmp_path / "laser.csv", "-o", tmp_path / f"out{code}", "--map", f"deviation={column}:um", "--yes")
        assert _run("import", "three-axis", *files, "--axis", "X") == code
    assert "laser.csv, line 3: 'ok' is not a number" in capsys.readouterr().err


def test_a_table_of_a_markdown_report(tmp_path: Path):
    """As the reports of ecmc have it, with a ruled line under the head and with or without outer bars."""
    rows = [
        "i |tgt_pos(i) [mm]|x(i,1) [µm]|x(i,2) [µm]|",
        "--- |--- |:---: |--- |",
        "1|-10.0|-0.5|1.5|",
        "2|0.25|0.5|2|",
    ]
    for outer in ("", "| "):
        (tmp_path / "report.md").write_text("\n".join(outer + row for row in rows))
        table = read_table(tmp_path / "report.md")
        assert table.units == ("", "mm", "um", "um") and table.names[1] == "tgt_pos(i)"
        assert table.numbers.tolist() == [[1.0, -10.0, -0.5, 1.5], [2.0, 0.25, 0.5, 2.0]]


@given(st.binary(max_size=300))
def test_any_file_is_a_table_or_a_sentence(tmp_path_factory, data: bytes):
    path = tmp_path_factory.mktemp("any") / "a.csv"
    path.write_bytes(data)
    try:
        assert read_table(path).numbers.ndim == 2
    except InputError as error:
        assert "\n" not in str(error)


@pytest.mark.parametrize("angles", [[0.0], [], [0, 4, 2, 8, 6, 10, 100, 50, 200]])
def test_a_list_too_short_for_a_circle_is_one_sentence(tmp_path: Path, capsys, recwarn, angles: list[float]):
    (tmp_path / "few.txt").write_text("angle deviation\n" + "".join(f"{a} 1\n" for a in angles))
    words = ["--radius", 100, "--feed", 1000, "--map", "angle=1:deg", "--map", "deviation=2:um"]
    assert _run("import", "three-axis", tmp_path / "few.txt", "-o", tmp_path / "out", *words, "-q") == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and ("at least 20" in said) == bool(angles) and not recwarn.list


def test_both_senses_in_one_file_are_what_import_polar_makes_of_two(tmp_path: Path):
    wave = {"ccw": 3.0 * np.sin(2.0 * np.radians(ANGLES)), "cw": 2.0 * np.cos(2.0 * np.radians(ANGLES))}
    for sense, way in (("ccw", slice(None)), ("cw", slice(None, None, -1))):
        lines = [f"{a:.1f} {d:.4f}" for a, d in zip(ANGLES[way], wave[sense][way], strict=True)]
        (tmp_path / f"{sense}.txt").write_text("\n".join(lines))
    options = ["--radius", 100, "--feed", 1000, "--centre", "0,0,110"]
    files = [tmp_path / "ccw.txt", tmp_path / "cw.txt"]
    assert _run("import-polar", "three-axis", *files, "-o", tmp_path / "polar", *options, "-q") == 0
    wanted = read_campaign(tmp_path / "polar")

    columns = "\n".join(f"{a:.1f};{x:.4f};{y:.4f}" for a, x, y in zip(ANGLES, wave["ccw"], wave["cw"], strict=True))
    (tmp_path / "both.csv").write_text(columns)
    maps = ["--map", "angle=1:deg", "--map", "ccw=2:um", "--map", "cw=3:um"]
    side_by_side = _imported(tmp_path, "three-axis", tmp_path / "both.csv", *options, *maps)
    (tmp_path / "list.txt").write_text("\n".join(path.read_text() for path in files))
    maps = ["--map", "angle=1:deg", "--map", "deviation=2:um"]
    one_list = _imported(tmp_path, "three-axis", tmp_path / "list.txt", *options, *maps, "--overwrite")
    gap = [f"{a + 0.3:.1f} {d:.4f}" for a, d in zip(ANGLES[::-1], wave["cw"][::-1], strict=True)]
    (tmp_path / "gap.txt").write_text("\n".join([files[0].read_text(), *gap]))  # the second begins past the first's end
    gapped = _imported(tmp_path, "three-axis", tmp_path / "gap.txt", *options, *maps, "--overwrite")
    assert len(gapped.runs) == len(one_list.runs) == len(wanted.runs) == 2
    np.testing.assert_allclose(gapped.runs[0].readings["dL_um"], wanted.runs[0].readings["dL_um"], atol=1e-9)
    radians = np.radians(ANGLES)
    (tmp_path / "radii.txt").write_text(
        "\n".join(f"{a:.8f} {100.0 + 1e-3 * d:.7f}" for a, d in zip(radians, wave["ccw"], strict=True))
    )
    maps = ["--map", "angle=1:rad", "--map", "radius=2:mm"]
    radii = _imported(tmp_path, "three-axis", tmp_path / "radii.txt", *options, *maps, "--overwrite")
    for found in (side_by_side.runs, one_list.runs, radii.runs):
        for run, other in zip(found, wanted.runs, strict=False):
            np.testing.assert_allclose(run.readings["dL_um"], other.readings["dL_um"], atol=1e-3)
            for name in run.commands:
                np.testing.assert_allclose(run.commands[name], other.commands[name], atol=1e-5)


def test_a_plate_that_is_turned_is_no_error_of_the_machine(tmp_path: Path):
    """0.3 mrad had been a sensor error with 97 %, and squareness of -297 µrad before."""
    angle = np.linspace(0.0, 2.0 * np.pi, 200)
    x, y = 60.0 * np.cos(angle), 60.0 * np.sin(angle)
    rows = np.column_stack([angle / 0.5, x, y, 1e3 * x + 0.3 * y, 1e3 * y - 0.3 * x])
    (tmp_path / "plate.csv").write_text("t,x,y,u,v\n" + "\n".join(",".join(f"{v:.6f}" for v in row) for row in rows))
    options = [f"--map={name}" for name in ("time=1:s", "X=2:mm", "Y=3:mm", "du=4:um", "dv=5:um")]
    assert _run("import", "three-axis", tmp_path / "plate.csv", "-o", tmp_path / "out", "--static", *options) == 0
    fit = identify(read_campaign(tmp_path / "out"))
    assert fit.rms_um < 0.05 and abs(fit.named["setup.plate.plate.c"]) == pytest.approx(300.0, abs=30.0)


def test_axes_are_driven_along_a_curve_between_rows(tmp_path: Path):
    """A control interpolates more finely than it records: the command bends by some µm between rows."""
    fine = np.arange(0.0, 6.0, 1e-3)
    command = 60.0 * (1.0 - np.cos(np.pi * fine / 1.0) * (1.0 - 0.2 * np.cos(3.0 * fine)))
    command -= command[0]
    names = ("position_gain", "velocity_gain", "integral_time", "viscous", "feedforward")
    drive = Drive(**{name: getattr(MACHINE.axes["X"].drive, name) for name in names})
    late = 1e3 * (follow(drive, command, 1e-3).x - command)
    rows = [f"{fine[k]:.2f},{command[k]:.6f},{late[k]:.3f}" for k in range(0, len(fine), 10)]
    (tmp_path / "x.csv").write_text("\n".join(["time [s],X [mm],X_dev [um]", *rows]))
    campaign = _imported(tmp_path, "three-axis", tmp_path / "x.csv", "--yes", "--noise-um", "0.3")
    lines = replace(campaign, runs=(replace(campaign.runs[0], options=campaign.runs[0].options | {"between": "line"}),))
    curve, chord = (identify(each).rms_um for each in (campaign, lines))
    assert curve < 0.3 and chord > 5.0 * curve


@pytest.mark.parametrize("column, option", [("C_act [deg]", {"encoder_axes": ["C"]}), ("C_torque [Nm]", {"axis": "C"})])
def test_a_recording_of_the_drive_names_its_axis(column: str, option: dict[str, object], tmp_path: Path):
    rows = [f"{0.01 * k:.2f},{0.3 * k:.1f},{0.3 * k:.1f}" for k in range(9)]
    (tmp_path / "c.csv").write_text("\n".join([f"time [s],C [deg],{column}", *rows]))
    campaign = _imported(tmp_path, "table-bc", tmp_path / "c.csv", "--yes")
    assert campaign.runs[0].options == {"between": "curve"} | option
    assert campaign.runs[0].noise(campaign.runs[0].instrument[0]) == pytest.approx(
        np.degrees(0.3e-6) if "deg" in column else 0.3
    )
    assert _run("check", tmp_path / "out", "-q") == 0


def test_a_probe_cycle_shows_the_location_errors(tmp_path: Path, capsys):
    """The centres that an exact machine with these errors would find, solved for here; nothing of the importer's."""
    machine = preset("table-bc")
    kept = {n: machine.errors[n] for n in ("EX0C", "EY0C", "EA0C", "EB0C") if n in machine.errors}
    machine = replace(machine, errors=kept)
    truth = {"EX0C": 40.0, "EY0C": -25.0, "EA0C": 60.0, "EB0C": -30.0}
    poses = [(b, c) for b in (-30.0, 0.0, 30.0) for c in np.arange(0.0, 360.0, 45.0)]
    sphere, rows = (80.0, 0.0, 60.0), []
    nominal = Nominal(machine)
    b, c = (np.array(v) for v in zip(*poses, strict=True))
    ball = (0.0, 0.0, -150.0)
    commands = nominal.follow(np.tile(sphere, (len(poses), 1)), ball, {"B": b, "C": c}, "probe")
    (plan,) = r_test_grid(machine)[:1]
    run = replace(
        plan, commands=commands, time=np.arange(float(len(poses))), readings={}, table_ball=sphere, tool_ball=ball
    )
    for _ in range(4):  # Newton: move the linear axes by what an R-test there would read
        model = Model(Campaign(machine=machine, runs=(run,)))
        off = 1e-3 * model.predict_run(run, model.vector({n: truth[n] for n in truth if n in model.index}))
        turned = np.einsum("nij,nj->ni", nominal.workpiece_rotation(run.commands), off)
        run = replace(
            run, commands={n: v - turned[:, "XYZ".index(n)] if n in "XYZ" else v for n, v in run.commands.items()}
        )
    noise = np.random.default_rng(0).normal(0.0, 5e-4, (len(poses), 3))
    for k, (bk, ck) in enumerate(poses):
        x, y, z = (run.commands[n][k] + noise[k, i] for i, n in enumerate("XYZ"))
        rows.append(f"{k};{bk:.3f};{ck:.3f};{x:.6f};{y:.6f};{z:.6f}")
    (tmp_path / "probe.csv").write_text("\n".join(["pose;B_deg;C_deg;X_found_mm;Y_found_mm;Z_found_mm", *rows]))
    options = ["--centre", "80,0.4,60.2", "--tool-ball", "0,0,-150", "--noise-um", 0.5, "--yes"]
    campaign = _imported(tmp_path, "table-bc", tmp_path / "probe.csv", *options)
    tip = [f"{row.rpartition(';')[0]};{float(row.rpartition(';')[2]) - 150.0:.6f}" for row in rows]
    (tmp_path / "tip.csv").write_text("\n".join(["pose;B_deg;C_deg;X_found_mm;Y_found_mm;Z_found_mm", *tip]))
    words = ["import", "table-bc", tmp_path / "tip.csv", "-o", tmp_path / "tip", "-q", *options]
    assert _run(*words) == 2 and "those of the tip" in capsys.readouterr().err
    words[words.index("0,0,-150")] = "0,0,0"
    assert _run(*words) == 0
    capsys.readouterr()
    wrong = ["import", "table-bc", tmp_path / "probe.csv", "-o", tmp_path / "wrong", *options]
    wrong[wrong.index("0,0,-150")] = "0,0,0"
    assert _run(*wrong) == 0
    said = capsys.readouterr().err
    assert (
        "the centres found are up to" in said and "mm from where table_ball and tool_ball put them; check these" in said
    )
    assert _run("check", tmp_path / "wrong") == 0
    assert "no error in the files; look at the note above" in capsys.readouterr().out
    found = identify(campaign.with_machine(machine))
    for name in kept:
        assert found[name] == pytest.approx(truth[name], abs=4.0 * found.uncertainty(name)), name
    assert found.uncertainty("EX0C") < 2.0


def test_turns_cycles_and_rests_are_runs():
    machine = preset("table-bc")
    time = np.arange(0.0, 30.0, 0.02)
    for speed in (100.0, -100.0):
        angle = 20.0 + speed * time
        commands = Nominal(machine).commands({"C": angle}, len(time))
        run = Run(id="spin", instrument=("r_test",), sampling="dynamic", time=time, commands=commands,
                  readings={f"d{c}_um": np.cos(np.radians(angle)) for c in "xyz"})  # fmt: skip
        plain, even = turns_of(run, machine), turns_of(run, machine, step_deg=4.0)
        assert len(plain) == 8 and all(350.0 < np.ptp(piece.commands["C"]) < 360.0 for piece in plain)
        assert all(piece.repeated_by(even[0]) for piece in even) and even[0].rows == 90
        for piece in even:
            np.testing.assert_allclose(piece.readings["dx_um"], np.cos(np.radians(piece.commands["C"])), atol=2e-3)
            assert np.sign(np.diff(piece.commands["C"])[0]) == np.sign(speed)
    with pytest.raises(InputError, match="whole revolution"):
        turns_of(every(run, 1).part(0, 50), machine)
    with pytest.raises(InputError, match="no sequence"):
        cycles_of(run)
    with pytest.raises(InputError, match='no split "halves"'):
        split(Campaign(machine=machine, runs=(run,)), "halves")
    stops = np.interp(time, [0.0, 3.0, 10.0, 13.0, 20.0, 30.0], [0.0, 0.0, 90.0, 90.0, -90.0, -90.0])
    (first, second) = moved_pieces(replace(run, commands={**commands, "C": stops}))
    assert (first.start_s, second.start_s) == (pytest.approx(3.0, abs=0.05), pytest.approx(13.0, abs=0.05))
    assert first.id == "spin-1" and first.duration == pytest.approx(7.0, abs=0.1)


WRONG = {
    "unit": (["a;d", "1;2", "2;3"], ["--map", "deviation=2"], "has no unit", "--map deviation=2:um"),
    "odd": (["a;d", "1;2", "2;3"], ["--map", "deviation=2:furlong"], "the unit 'furlong'", "um"),
    "meaning": (["a;d", "1;2", "2;3"], ["--map", "speed=2:mm"], "'speed' has no meaning", "deviation"),
    "column": (["a;d", "1;2", "2;3"], ["--map", "angle=9:deg"], "no column is called '9'", "1 a, 2 d"),
    "twice": (["a;d", "1;2", "2;3"], ["--map", "angle=1:deg", "--map", "deviation=1:um"], "column 1 is mapped to angle", "once"),
    "nobody": (["angle [deg];deviation [um]", "1;2", "2;3"], [], "guessed", "--yes, or --map angle=1:deg"),
    "text": (["angle [deg];deviation [um]", "1;2", "2;3", "end;of file"], ["--yes"], "line 4", "write a number"),
    "early": (["angle [deg];deviation [um]", "0;1", "1;n/a", "2;3", "3;4"], ["--yes"], "line 3", "write a number"),
    "first": (["angle [deg];deviation [um]", "0;n/a", "1;2", "2;3"], ["--yes"], "line 2", "write a number"),
    "thousands": (["angle;deviation", "0;1.234,5", "1;1.234,6"], [], "line 2", "none between the thousands"),
    "blank": (["angle [deg];ccw [um];cw [um]", "0;1;5", "1;2;", "2;3;", "3;4;5"], ["--yes"], "line 3: a cell is empty",
              "delete the row"),
    "large": (["t;x", "1764000000000;1", "1764000000001;2"], [], "line 2: '1764000000000' is beyond 1e+12", "write the reading"),
    "instant": (["t;x", "08:61:00;1", "08:62:00;2"], [], "line 2: '08:61:00' is no instant", "hours:minutes:seconds"),
    "back": (["time [s];target [mm];deviation [um]", "0;0;1", "9;100;2", "9;200;3"], ["--yes"],
             "a.csv, line 4: the time does not increase: 9 s after 9 s", "in order of time"),
    "opposite": (["target [mm];measured [mm]", "0;0", "100;-100.01", "200;-199.99"], ["--yes"], "moves by -0.9999 where",
                 "by -1"),
    "inches": (["target [mm];measured [mm]", "0;0", "100;3.937", "200;7.874"], ["--yes"], "moves by 0.03937 where", "unit"),
    "cells": (["1;2", "2;3", "1;2;3"], ["--yes"], "3 cells, the first one has 2", "remove"),
    "none": (["angle [deg];deviation [um]", "1;2", "2;3"], ["--yes"], "needs its radius and feed", "--radius 100"),
    "bar": (["1;150.01", "2;150.02"], ["--map", "angle=1:deg", "--map", "radius=2:mm", "--radius", "100", "--feed", "500"],
            "--radius says 100 mm", "the length of this bar"),
    "empty": (["nothing"], [], "no table of numbers", "two columns"),
    "other": (["x;y", "1;2", "2;3"], ["--map", "X=1:mm"], "hold no reading", "--map dL=3:um"),
    "unknown": (["a;b", "1;2", "2;3"], [], "the names in the header hold no reading", "Z_found and the rotary axes of a probe"),
    "nowhere": (["t;y", "1;2", "2;3"], ["--map", "time=1:s", "--map", "X_dev=2:um"], "no commanded position of X", "--hold X=0"),
    "uncommanded": (["time_s,X_cmd_mm,X_act_mm,X_force_N", "0,1,1,5", "1,2,2,5"], ["--yes", "--hold", "Y=0"],
                    "hold no commanded position of X", "--map X=2:mm"),
    "positions": (["1;1.01", "2;2.02", "4;3.99"], ["--map", "target=1:mm", "--map", "deviation=2:mm"], "these are positions",
                  "--map measured=2:mm"),
    "both": (["1;1.01;1", "2;2.02;2"], ["--map", "target=1:mm", "--map", "up=2:mm", "--map", "down=3:mm"], "are positions", ""),
    "side": (["1;2", "2;3"], ["--map", "target=1:mm"], "or columns up and down", "--map up=2:um --map down=3:um"),
    "split": (["1;2", "2;3"], ["--map", "X=1:mm", "--map", "dL=2:um", "--radius", "100", "--split", "cycles"], "repeats", ""),
}  # fmt: skip


@pytest.mark.parametrize("name", WRONG)
def test_what_cannot_be_guessed_is_asked_for_in_one_sentence(name: str, tmp_path: Path, capsys):
    lines, options, says, remedy = WRONG[name]
    (tmp_path / "a.csv").write_text("\n".join(lines))
    assert _run("import", "three-axis", tmp_path / "a.csv", "-o", tmp_path / "out", "-q", *options) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and says in said and remedy in said, said
    assert not (tmp_path / "out").exists()


def test_what_is_guessed_is_shown_and_asked(tmp_path: Path, monkeypatch, capsys):
    """With a person at the keyboard: yes writes, no leaves nothing; both see what each column is taken for."""
    (tmp_path / "x.csv").write_text("target [mm];deviation [µm];humidity\n0;1;50\n10;2;50\n0;3;50\n")
    monkeypatch.setattr("sys.stdin.isatty", lambda: True, raising=False)
    for answer, code in ((False, 130), (True, 0)):
        monkeypatch.setattr("click.termui.visible_prompt_func", lambda *_, answer=answer: "y" if answer else "n")
        assert (
            _run("import", "three-axis", tmp_path / "x.csv", "-o", tmp_path / "out") == code
            and (tmp_path / "out").exists() is answer
        )
        said = capsys.readouterr().err
        assert "target in mm (guessed)" in said and "deviation in um (guessed)" in said and "not used" in said


def test_circles_of_one_direction_are_noted(tmp_path: Path, capsys):
    (tmp_path / "a.csv").write_text("\n".join(f"{a} {5 + np.sin(a):.4f}" for a in ANGLES))
    (tmp_path / "b.csv").write_text((tmp_path / "a.csv").read_text())
    words = ["import", "three-axis", tmp_path / "a.csv", tmp_path / "b.csv", "-o", tmp_path / "out", "--radius", 100]
    maps = ["--feed", 1000, "--centre", "0,0,110", "--map", "angle=1:deg", "--map", "deviation=2:um"]
    assert _run(*words, *maps) == 0
    assert "all 2 files go ccw" in capsys.readouterr().err
    words[words.index(tmp_path / "out")] = tmp_path / "two"
    assert _run(*words, *maps, "--direction", "ccw", "--direction", "cw") == 0
    assert "files go ccw" not in capsys.readouterr().err
    assert {v.name for v in standard_values(read_campaign(tmp_path / "two"))} >= {"G", "G(b)"}


@pytest.mark.parametrize("verb", ["import", "import-polar"])
def test_files_of_one_name_are_refused(verb: str, tmp_path: Path, capsys):
    """As software writes them, into a folder for each direction."""
    files = [tmp_path / sense / "xy.csv" for sense in ("ccw", "cw")]
    for file in files:
        file.parent.mkdir()
        file.write_text("\n".join(f"{a} {np.sin(a):.4f}" for a in ANGLES))
    assert _run(verb, "three-axis", *files, "-o", tmp_path / "out", "-q") == 2
    assert "two files are called 'xy'" in (said := capsys.readouterr().err) and "rename one" in said


def test_lengths_in_other_units_are_noted(tmp_path: Path, capsys):
    """mm under a head that says µm, and a bar's length in inches."""
    rows = "\n".join(f"{a},{0.004 * np.cos(np.radians(2 * a)):.6f}" for a in ANGLES)
    (tmp_path / "a.csv").write_text(f"angle [deg],deviation [um]\n{rows}")
    words = ["--radius", 3.937, "--feed", 39.4, "--yes", "--centre", "0,0,110"]
    assert _run("import", "three-axis", tmp_path / "a.csv", "-o", tmp_path / "out", *words) == 0
    said = capsys.readouterr().err
    assert "no deviation reaches the noise of 0.3 µm; if they are mm" in said
    assert "one of 100 mm, which is 3.937 in" in said and "give --radius and --centre in mm" in said

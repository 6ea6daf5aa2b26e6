"""Tables and sheets for controls: what they hold, their uncertainty, names that end nothing."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from codegen_world import fitted, isg_error

from symfive.cli import main
from symfive.codegen import TARGETS, codegen, subject_of
from symfive.codegen._subject import axis_lines  # differences of what sheets round
from symfive.effects import make_effect
from symfive.errors import InputError
from symfive.machine import ErrorTerm, preset, read_machine
from symfive.model import FittedModel
from symfive.procedures import campaign_of, r_test_grid


@pytest.mark.parametrize("name", ["table-bc", "three-axis", "head-bc", "wang-li-2016"])
def test_a_control_that_interpolates_the_isg_table_has_the_errors_of_the_model(tmp_path, name) -> None:
    """Between the rows too: C of table-bc turns ten times either way."""
    machine = preset(name)
    waves = {
        f"EX{axis}": ErrorTerm(name=f"EX{axis}", sigma=5.0, over=(axis,), basis=("fourier",), order=(4,))
        for axis in machine.rotary_axes
    }
    model = fitted(replace(machine, errors={**machine.errors, **waves}))
    table, note = codegen(model, tmp_path, target="isg")
    assert isg_error(table, model) < 0.05  # µm: a thousandth of each of up to 30 error motions of some µm
    assert "negate" in note.read_text() and "Draft" in note.read_text() and "nothing was left out" in note.read_text()


def test_the_isg_table_holds_what_a_diagnosis_has_found(tmp_path) -> None:
    machine = preset("table-bc")
    found = (
        make_effect("gravity_sag", axis="B", component="EZB"),
        make_effect("location_error", component="EC0Z"),
        make_effect("scale_error", axis="X"),
    )
    model = fitted(machine, effects=found)
    table, note = codegen(model, tmp_path, target="isg")
    without = replace(model, effects=found[:2])
    assert isg_error(table, without) < 0.02
    left_out = note.read_text().split("Not in the file:")[1]
    assert "scale_error.X" in left_out and "sag" not in left_out and "location" not in left_out


@pytest.mark.parametrize(("control", "held"), [("siemens", ("EY0A", "EB0A")), ("fanuc", ("EY0A",))])
def test_a_sheet_names_what_it_does_not_correct_and_nothing_else(tmp_path, control, held) -> None:
    """A location error that a diagnosis has found stands in the rows like those of the machine file."""
    whole, found = preset("tsutsumi-2007"), ("EY0A", "EB0A", "EC0X")
    machine = replace(whole, errors={n: t for n, t in whole.errors.items() if n not in found})
    effects = tuple(make_effect("location_error", component=name) for name in found)
    (path,) = codegen(fitted(machine, effects=effects), tmp_path, target=control)
    (said,) = re.findall(r"Not corrected by this sheet: ([^<]*)", path.read_text())
    assert [name in said for name in found] == [name not in held for name in found]


def test_an_error_motion_that_no_table_can_hold_is_refused(tmp_path) -> None:
    text = (
        'schema = "symfive.machine/1"\nname = "endless"\nstructure = "w C\' X\' b Z t"\n[axes.X]\n[axes.Z]\n'
        '[axes.C]\ntravel = [-1e7, 1e7]\n[errors]\nEXC = { basis = "fourier", order = 60, sigma = 5.0 }\n'
    )
    (tmp_path / "endless.toml").write_text(text)
    model = fitted(read_machine(tmp_path / "endless.toml"))
    with pytest.raises(InputError, match="error motions of C change too fast"):
        codegen(model, tmp_path / "out", target="isg")
    assert not (tmp_path / "out").exists()


def test_an_axis_without_a_letter_in_the_isg_table_is_refused(tmp_path) -> None:
    text = (
        'schema = "symfive.machine/1"\nname = "quill"\nstructure = "w Y\' X\' b Z W t"\n'
        "[axes.X]\n[axes.Y]\n[axes.Z]\n[axes.W]\n[errors]\nEA0W = { sigma = 50.0 }\n"
    )
    (tmp_path / "quill.toml").write_text(text)
    with pytest.raises(InputError, match="no linear axis called W"):
        codegen(tmp_path / "quill.toml", tmp_path / "out", target="isg")


def test_the_isg_table_says_what_is_within_its_uncertainty(tmp_path) -> None:
    table, note = codegen(fitted(preset("table-bc"), {"EX0C": 1.5, "EA0C": 40.0}), tmp_path, target="isg")
    names, _, said = table.read_text().splitlines()[2:5]
    spread = dict(zip(names.split(), map(float, said.split(": ")[1].split()), strict=True))
    assert spread["X0C"] == 2e-3 and spread["A0C"] == 2e-6  # twice 1 µm and 1 µrad
    (within,) = (line for line in note.read_text().splitlines() if "Within their uncertainty" in line)
    assert "EX0C" in within and "EA0C" not in within


def test_every_pin_of_linuxcnc_has_its_uncertainty(tmp_path) -> None:
    files = codegen(fitted(preset("table-bc"), {"EX0C": 1.5, "EA0C": 40.0}), tmp_path / "fitted", target="linuxcnc")
    lines = next(path for path in files if path.suffix == ".hal").read_text().splitlines()
    said = {line.split()[1]: lines[i - 1] for i, line in enumerate(lines) if line.startswith("setp")}
    assert said["sfkins.EX0C"] == "# U (k = 2) 2 um: within uncertainty"
    assert said["sfkins.EA0C"] == "# U (k = 2) 2 urad"
    files = codegen(preset("table-bc"), tmp_path / "nominal", target="linuxcnc")
    text = next(path for path in files if path.suffix == ".hal").read_text()
    assert "U (k = 2)" not in text  # nothing was measured


def test_the_isg_table_says_what_it_cannot_hold(tmp_path) -> None:
    machine = preset("table-bc")
    mixed = ErrorTerm(name="EAC", sigma=1.0, over=("B", "C"), basis=("polynomial", "fourier"), order=(1, 1))
    _, note = codegen(fitted(replace(machine, errors={**machine.errors, "EAC": mixed})), tmp_path, target="isg")
    assert "EAC: a function of B and C" in note.read_text()


@pytest.mark.parametrize("control", ["siemens", "fanuc", "heidenhain", "haas"])
def test_sheets_print_old_and_new_and_stay_drafts(tmp_path, control) -> None:
    model = fitted(preset("tsutsumi-2007"), {"EX0C": 40.0, "EY0C": -25.0, "EZ0A": 10.0})
    (path,) = codegen(model, tmp_path, target=control)
    assert path.suffix == ".html"  # nothing that a control could load
    text = path.read_text()
    assert "Draft, to be verified" in text
    rows = sheet(text)
    assert rows and all(row["U (k = 2)"] != "not known" for row in rows)
    for row in rows:
        moved = number(row["new"]) - number(row["design"]) if row["enter"].startswith("yes") else 0.0
        assert moved == pytest.approx(number(row["change"]) if moved else 0.0, abs=2e-6)
        assert row["on the control"] == "" and ("larger number" in row["meaning"] or "closes" in row["meaning"])
    changes = {abs(round(1e3 * number(row["change"]))) for row in rows if row["enter"].startswith("yes")}
    assert {40, 25} <= changes
    with pytest.raises(InputError, match="two rotary axes under the workpiece"):
        codegen("head-bc", tmp_path / "other", target=control)


def sheet(text: str) -> list[dict[str, str]]:
    """The rows of a printed sheet, each cell by the name of its column."""
    rows = re.findall(r"<tr[^>]*>(<td.*?)</tr>", text)
    return [
        {h: re.sub(r"<[^>]*>", " ", c).strip() for h, c in re.findall(r"data-head='(.*?)'>(.*?)</td>", r)} for r in rows
    ]


def number(text: str) -> float:
    return float(text.replace("−", "-").replace("mm", ""))


def with_spread(model: FittedModel, **std: float) -> FittedModel:
    """The model with other 1σ of single parameters."""
    return replace(model, covariance=np.diag([std.get(name, 1.0) ** 2 for name in model.names]))


def test_a_sheet_has_no_digit_that_its_uncertainty_does_not_leave(tmp_path) -> None:
    model = fitted(preset("tsutsumi-2007"), {"EX0C": -141.351, "EY0C": 34.999994, "EZ0A": 20.0})
    (path,) = codegen(with_spread(model, EX0C=14.0, EZ0A=300.0), tmp_path, target="haas")
    x, y, z = sheet(path.read_text())
    assert (x["change"], x["U (k = 2)"], x["new"], x["enter"]) == ("−0.141 mm", "0.028 mm", "−0.141 mm", "yes")
    assert y["new"] == "0.035 mm" and y["enter"] == "yes"
    assert (
        z["new"] == "unchanged" and z["enter"] == "no: within uncertainty, not entered" and z["U (k = 2)"] == "0.60 mm"
    )
    assert "Not determined by the readings: EZ0A" in path.read_text()


def test_a_sheet_names_the_effects_that_it_does_not_correct(tmp_path) -> None:
    """The diagnosis says 'enter a compensation': the sheet holds none of a sag, nor of a play."""
    machine = preset("tsutsumi-2007")
    sag = make_effect("gravity_sag", axis="A", component="EZA").prepare(
        campaign_of(machine, r_test_grid(machine, step_deg=90.0))
    )
    model = fitted(machine, {"EX0C": -141.351})
    (path,) = codegen(replace(model, effects=(sag,)), tmp_path / "with", target="siemens")
    assert "Not corrected by this sheet: gravity sag of axis A (EZA)" in path.read_text()
    (path,) = codegen(model, tmp_path / "without", target="siemens")
    assert "Not corrected by this sheet" not in path.read_text()


def test_the_uncertainty_of_a_sheet_is_that_of_its_lines(tmp_path) -> None:
    machine = preset("table-bc")
    model = fitted(machine)
    std = {name: 1.0 + 0.3 * (k % 5) for k, name in enumerate(model.names)}
    (path,) = codegen(with_spread(model, **std), tmp_path, target="siemens")
    rows = {row["parameter"].split()[0]: row for row in sheet(path.read_text())}

    def leaning(values: dict[str, float]) -> float:
        return float(axis_lines(subject_of(replace(model, values=values)))["C"][1].direction[0])

    by_hand = [1e2 * (leaning({**model.values, n: v + 0.01}) - leaning(model.values)) for n, v in model.values.items()]
    expected = 2.0 * np.sqrt(sum((slope * std[n]) ** 2 for slope, n in zip(by_hand, model.names, strict=True)))
    assert number(rows["$TC_CARR10"]["U (k = 2)"]) == pytest.approx(expected, rel=0.02)


def test_a_closing_vector_closes_what_is_entered(tmp_path) -> None:
    model = fitted(preset("table-bc"), {"EX0B": 30.0, "EX0C": 1.2, "EY0C": 25.0, "EZ0B": 12.3456})
    (path,) = codegen(with_spread(model, EX0C=9.0), tmp_path, target="siemens")
    rows = sheet(path.read_text())
    typed = [number(row["new"] if row["enter"].startswith("yes") else row["design"]) for row in rows]
    for k in range(3):
        assert typed[6 + k] == pytest.approx(-typed[k] - typed[3 + k], abs=1e-9)
    assert typed[0] == 0.03 and typed[3] == 0.0


@pytest.mark.parametrize("control", ["siemens", "haas"])
def test_without_a_measurement_no_uncertainty_is_known_and_nothing_entered(tmp_path, control) -> None:
    (path,) = codegen("table-bc", tmp_path, target=control)
    rows = sheet(path.read_text())
    assert "no uncertainty is known" in path.read_text()
    assert all(row["U (k = 2)"] == "not known" and row["new"] == "unchanged" for row in rows)


def test_the_command_line_writes_and_refuses(tmp_path, capsys) -> None:
    assert main(["codegen", "three-axis", "-o", str(tmp_path / "c"), "--prefix", "mill"]) == 0
    assert (tmp_path / "c" / "mill.h").is_file()
    assert str(tmp_path / "c" / "mill.c") in capsys.readouterr().out
    assert main(["codegen", "three-axis", "-o", str(tmp_path / "no"), "--target", "haas"]) == 2
    assert "use the target c or linuxcnc" in capsys.readouterr().err
    assert not (tmp_path / "no").exists()


@pytest.mark.parametrize("name", ["mill\nX0C\n5.0", "mill\r#", "mill\x85setp", "mill\u2028setp", "mill\x1b[2J"])
def test_a_name_of_several_lines_is_refused_before_any_file_is_written(tmp_path, name) -> None:
    """In a table of ISG or in HAL lines it would be a row or a command of its own."""
    with pytest.raises(InputError, match="not one line of printed text"):
        replace(preset("table-bc"), name=name)
    path = tmp_path / "machine.toml"
    path.write_text(
        f"""schema = "symfive.machine/1"\nname = {json.dumps(name)}\nstructure = "w X' b t"\n""", encoding="utf-8"
    )
    with pytest.raises(InputError, match=r"machine\.toml, line 2.*not one line of printed text"):
        codegen(path, tmp_path / "out", target="isg")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("target", list(TARGETS))
def test_no_name_ends_a_comment(tmp_path, target) -> None:
    """Comment ends, HTML, formulas and HAL words in a name stay inside the comment or text that the name stands in."""
    nasty = """*/ int x; /* <script>alert(1)</script> =1+1 "quoted" \\ ?? // # setp ${prefix} µ"""
    written = {}
    for label, name in (("plain", "mill"), ("nasty", nasty)):
        paths = codegen(fitted(replace(preset("table-bc"), name=name)), tmp_path / label, target=target)
        written[label] = {path.name: path.read_text(encoding="utf-8") for path in paths}
    digests = [re.search(r"[0-9a-f]{64}", "".join(texts.values()))[0] for texts in written.values()]
    for file, plain_text in written["plain"].items():
        text = written["nasty"][file].replace(digests[1], digests[0])
        assert "<script>" not in text or not file.endswith(".html")
        lines, others = plain_text.splitlines(), text.splitlines()
        assert len(lines) == len(others)
        changed = [(a, b) for a, b in zip(lines, others, strict=True) if a != b]
        assert len(changed) <= 2 and all("mill" in a for a, _ in changed), changed
        for _, line in changed:  # in C the comment's only end is its own
            if file.endswith((".c", ".h")):
                assert "*/" not in line and "/*" not in line.removeprefix("/*")
            elif file.endswith((".hal", ".csv")):
                assert line.startswith(("#", "//"))

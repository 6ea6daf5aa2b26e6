"""What a user may decide about a plan, in Python and on the command line; what cannot be done is said in one sentence."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from lean import location_only, varying

from symfive.campaign import read_campaign
from symfive.cli import main
from symfive.design import Plan, assess, plan, plan_sweeps, plan_together
from symfive.errors import InputError
from symfive.machine import Structure, Workspace, preset, write_machine
from symfive.nc import Post, program

OYAMA = location_only("oyama-2010")


@pytest.fixture(scope="module")
def made() -> Plan:
    return plan(OYAMA, points=20, starts=1, returns=2)


def test_plan_for_chosen_parameters() -> None:
    quick = {"setups": 1, "starts": 1, "returns": 0, "anywhere": False, "prove": False}
    for_centre = plan(OYAMA, points=8, for_=("EX0C", "EY0C"), criterion="A", **quick)
    assert for_centre.interest == ("EX0C", "EY0C")


@pytest.mark.slow
def test_plan_in_addition_to_a_campaign(made: Plan) -> None:
    more = plan(OYAMA, points=8, setups=1, given=made.campaign, starts=1, returns=0, anywhere=False, prove=False)
    for name in ("EA0B", "EX0C", "EB0C"):
        assert more.assessment.sigma[name] < made.assessment.sigma[name]


@pytest.mark.slow
def test_time_budget_and_a_lost_pose() -> None:
    short = plan(OYAMA, points=24, minutes=7.5, setups=1, starts=1, anywhere=False)
    assert short.minutes <= 7.5 and short.certificate.points < 24
    robust = plan(OYAMA, points=7, setups=1, starts=1, survive=True, returns=0, anywhere=False)
    usual = plan(OYAMA, points=7, setups=1, starts=1, returns=0, anywhere=False)
    assert robust.lost * np.exp(-robust.certificate.value) >= usual.lost * np.exp(-usual.certificate.value) * (
        1.0 - 1e-6
    )


@pytest.mark.parametrize(
    ("change", "options", "says"),
    [
        ({"bar_lengths": ()}, {"instrument": "ball_bar"}, "the workspace lists no bar; add bar_lengths"),
        ({"sensor_range": 1e-3}, {}, "leave the sensor_range at every pose; raise sensor_range"),
        ({"tool_length": (900.0, 950.0)}, {}, "travel of Z is in the way everywhere; move the nest or balls nearer"),
        (
            {"ball_height": (-300.0, -200.0)},
            {},
            "way everywhere; raise ball_height in [workspace] (the table is z = 0 ",
        ),
        ({}, {"for_": ("EXQ",)}, "has no parameter EXQ; use names such as EX0B"),
        ({}, {"points": 1}, "points = 1 is too few; give at least 2"),
        ({}, {"repeats": 100_000}, "repeats = 100000 is too many; give at most 1000"),
        ({}, {"minutes": 1.0}, "1 minutes are too short"),
        ({}, {"minutes": 1e7}, "minutes = 1e+07 min is beyond 1440 min"),
        ({}, {"minutes": float("nan")}, "minutes = nan is not a finite number"),
        ({}, {"instrument": "laser"}, "plans with laser are not designed; use r_test, touch_probe or ball_bar"),
        ({}, {"criterion": "Q"}, 'criterion "Q" is unknown'),
    ],
)
def test_what_cannot_be_done_is_said_in_one_sentence(
    change: dict[str, object], options: dict[str, object], says: str
) -> None:
    workspace = replace(OYAMA.workspace, **change)  # type: ignore[arg-type]
    with pytest.raises(InputError) as caught:
        plan(replace(OYAMA, workspace=workspace, text=""), starts=1, **options)  # type: ignore[arg-type]
    assert says in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"minutes": 1e7}, "minutes = 1e+07 min is beyond 1440 min"),
        ({"minutes": 1440.0}, "give at most 260 minutes, or more setups"),
        ({"minutes": 70.0, "setups": 1}, "more than 1 recording can use: one lasts an hour at most"),
    ],
)
def test_no_recording_is_planned_beyond_an_hour(options: dict[str, float], says: str) -> None:
    with pytest.raises(InputError, match=re.escape(says)):
        plan_sweeps(OYAMA, **options)  # type: ignore[arg-type]


def test_several_instruments_share_a_day_at_most() -> None:
    with pytest.raises(InputError, match="beyond 1440 min"):
        plan_together(OYAMA, minutes=1e7)


def test_a_plan_in_motion_says_what_it_does() -> None:
    def stop(message: str) -> None:
        raise StopIteration(message)

    with pytest.raises(StopIteration, match="comparing 1 mounting"):
        plan_sweeps(OYAMA, minutes=8.0, progress=stop)


def test_a_parameter_that_no_plan_can_see_is_named() -> None:
    machine = preset("oyama-2010")
    term = replace(machine.errors["EX0C"], name="EC0C")
    blind = replace(machine, errors={"EX0C": machine.errors["EX0C"], "EC0C": replace(term, sigma=1e-3)}, text="")
    with pytest.raises(InputError, match="no r_test plan determines EC0C"):
        plan(blind, for_=("EC0C",), starts=1)
    with pytest.raises(InputError, match="no workspace; add"):
        plan(replace(OYAMA, workspace=Workspace(), text=""), starts=1)


@pytest.mark.slow
def test_robust_plans_and_information_per_minute() -> None:
    usual = plan(OYAMA, points=24, starts=1, anywhere=False)
    quick = plan(OYAMA, points=24, starts=1, anywhere=False, per_minute=True)
    assert quick.information_per_minute > usual.information_per_minute and quick.minutes < usual.minutes
    worst = plan(OYAMA, points=8, setups=1, starts=1, returns=0, anywhere=False, robust="worst")
    assert worst.over_prior[1] > 0.99
    with pytest.raises(InputError, match=r"is unknown; use one of nominal, mean, worst"):
        plan(OYAMA, points=8, robust="best")


def _over_the_prior(how: str) -> tuple[float, float]:
    """Mean and largest ψ of a plan on six machines drawn from priors of 1 rad."""
    wide = {name: replace(e, sigma=1e6) if e.angular else e for name, e in OYAMA.errors.items()}
    machine = replace(OYAMA, errors=wide, workspace=replace(OYAMA.workspace, sensor_range=1e6), text="")
    options = {"points": 6, "setups": 1, "starts": 1, "returns": 0, "anywhere": False, "prove": False}
    made = plan(machine, robust=how, **options)
    generator, values = np.random.default_rng(0), []
    for _ in range(6):
        drawn = {n: replace(e, mean=e.sigma * generator.standard_normal()) for n, e in wide.items()}
        values.append(assess(made.campaign.with_machine(replace(machine, errors=drawn, text=""))).value)
    found = float(np.mean(values)), float(np.max(values))
    if how != "nominal":  # whose plan reports two machines only
        assert made.certificate.value - np.log(made.over_prior) == pytest.approx(found, rel=1e-6)
    return found


def test_robust_plans_are_better_on_machines_far_from_the_nominal_one() -> None:
    assert _over_the_prior("mean")[0] < _over_the_prior("nominal")[0]


@pytest.mark.slow
def test_each_way_to_be_robust_is_best_at_its_own() -> None:
    """The mean of ψ is lowest for `mean`, the largest for `worst`."""
    found = {how: _over_the_prior(how) for how in ("nominal", "mean", "worst")}
    assert found["mean"][0] < min(found["nominal"][0], found["worst"][0])
    assert found["worst"][1] < min(found["nominal"][1], found["mean"][1])


def test_a_time_budget_is_used_up() -> None:
    """A budget for two set-ups or for more poses in one: the better of the two is taken, and little time is left over."""
    made = plan(OYAMA, points=80, minutes=9.0, starts=1, anywhere=False, prove=False)
    assert 8.0 <= made.minutes <= 9.0


@pytest.mark.slow
def test_options_of_the_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_machine(OYAMA, tmp_path / "machine.toml")
    words = ["plan", tmp_path / "machine.toml", "-o", tmp_path / "plan", "--instrument", "ball_bar", "--points", 8]
    words += ["--setups", 1, "--bar", 120, "--bar", 200, "--repeats", 2, "--returns", 1, "--noise-um", 0.5, "--survive"]
    words += ["--robust", "mean", "--starts", 1, "--nc", "siemens", "--tool-centre-on", "TRAORI"]
    assert main([str(w) for w in [*words, "--tool-centre-off", "TRAFOOF", "--reversed", "C", "--json", "-q"]]) == 0
    assert json.loads(capsys.readouterr().out)["certificate"]["poses"] == 8
    campaign = read_campaign(tmp_path / "plan")
    (run,) = campaign.runs
    assert run.length in (120.0, 200.0) and run.noise_um == 0.5 and run.rows == 2 * 9
    assert tuple(campaign.machine.workspace.bar_lengths) == (120.0, 200.0)
    text = (tmp_path / "plan" / "nc" / "siemens" / f"{run.id.upper().replace('-', '_')}.mpf").read_text()
    code = "\n".join(line for line in text.split("\n") if not line.startswith(";"))
    assert code.index("TRAFOOF") < code.index("G0 ") < code.index("TRAORI") < code.rindex("TRAFOOF")
    quick = ["plan", str(tmp_path / "machine.toml"), "-o", str(tmp_path / "quick"), "--points", "12", "--starts", "1"]
    assert main([*quick, "-q", "--per-minute", "--minutes", "12"]) == 0
    assert main(["assess", str(tmp_path / "quick"), "--given", str(tmp_path / "plan"), "-q"]) == 0
    said = capsys.readouterr().out
    assert all(f"{name} " in said for name in campaign.machine.errors)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--nc", "okuma"], 'NC dialect "okuma" is unknown'),
        (["--reversed", "X"], "the machine has no rotary axis X to reverse; use one of B, C"),
        (["--bar", "-5", "--instrument", "ball_bar"], "Invalid value for '--bar': '-5' is not a number from 1e-12"),
        (["--bar", "900", "--instrument", "ball_bar"], "the shortest bar is 900 mm"),
        (["--noise-um", "0"], "Invalid value for '--noise-um': '0' is not a number from 1e-12"),
        (["--minutes", "4"], "4 minutes are too short for one set-up (5 min) and two poses; give at least 6 minutes"),
        (["--circles", "synchronous"], "none is named; add --effect backlash:C"),
        (["--circles", "synchronous", "--effect", "backlash:Q"], "speaks of axis 'Q'"),
        (["--circles", "square", "--effect", "backlash:C"], "use one of iso-230-4, synchronous, planar"),
    ],
)
def test_the_command_line_says_what_to_change(
    words: list[str], says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["plan", "oyama-2010", "-o", str(tmp_path / "p"), "-q", *words]) == 2
    said = capsys.readouterr()
    assert says in said.err and said.err.count("\n") == 1 and said.out == "" and not (tmp_path / "p").exists()


@pytest.mark.slow
def test_circles_on_the_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    whole = preset("tsutsumi-2007")
    write_machine(varying(whole, "EX0C", "EY0C"), tmp_path / "machine.toml")
    words = ["plan", str(tmp_path / "machine.toml"), "-o", str(tmp_path / "plan"), "--nc", "linuxcnc", "--no-proof"]
    assert main([*words, "--circles", "planar", "--effect", "backlash:X", "--count", "1", "--bar", "50", "-q"]) == 0
    assert "backlash of axis X (width)" in capsys.readouterr().out
    programs = {path.stem for path in (tmp_path / "plan" / "nc" / "linuxcnc").glob("*.ngc")}
    assert len(programs) == 3 and any(
        n.endswith("-and-1-more") for n in programs
    )  # one a direction, both with the bar on


@pytest.mark.parametrize(
    ("options", "unused"),
    [
        (["--speed", "5"], "--speed"),
        (["--plane", "ZX"], "--plane"),
        (["--bar", "100"], "--bar is for ball_bar"),
        (["--index", "--instrument", "ball_bar"], "--index is for r_test"),
        (["--probe-tool", "3"], "--probe-tool is for touch_probe"),
        (["--circles", "iso-230-4", "--minutes", "5"], "--minutes"),
        (["--circles", "iso-230-4", "--given", "earlier"], "--given"),
        (["--circles", "planar", "--effect", "backlash:X", "--repeats", "2"], "--repeats"),
        (["--tool-centre-on", "TRAORI"], "--tool-centre-off"),
        (["--tool-centre-off", "TRAFOOF"], "--tool-centre-on"),
        (["--tool-centre", "--nc", "heidenhain"], "depends on your machine; give --tool-centre-on"),
        (["--in-motion", "--minutes", "1e7"], "minutes = 1e+07 min is beyond 1440 min"),
        (["--in-motion", "--minutes", "1440"], "give at most 260 minutes"),
        (["--dwell", "1e9"], "dwell_s = 1e+09 s is beyond 3600 s"),
        (["--machine-top", "1e9"], "no machine tool is larger than 100 m"),
        (["--instrument", "touch_probe", "--tip-radius", "1e9"], "tip_radius = 1e+09 mm"),
        (["--circles", "iso-230-4", "--sweep", "400"], "--sweep"),
    ],
)
def test_an_option_that_does_nothing_or_harm_is_refused(
    options: list[str], unused: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["plan", "table-bc", "-o", str(tmp_path / "p"), *options]) == 2
    assert unused in capsys.readouterr().err and not (tmp_path / "p").exists()


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--instrument", "touch_probe"], "a touch probe moves X, Y"),
        (["--tool-centre"], "tool-centre control moves X, Y"),
    ],
)
def test_what_moves_x_y_and_z_is_refused_without_these(
    options: list[str], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = Path("designs/machines/table-bc.toml").read_text().partition("[errors]")
    text = (
        re.sub(r"\bX\b", "U", text[0]),
        "[errors]\nEX0C = { sigma = 50.0 }\n",
        text[2][text[2].index("[workspace]") :],
    )
    (tmp_path / "odd.toml").write_text("".join(text))
    assert main(["plan", str(tmp_path / "odd.toml"), "-o", str(tmp_path / "plan"), *options]) == 2
    assert said in capsys.readouterr().err


@pytest.mark.parametrize("name", ["W", pytest.param("J5", marks=pytest.mark.slow)])
def test_axes_without_an_address_have_a_plan_and_no_programs(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A rotary axis called W would be driven in mm/min. Programs that are asked for are refused before any search."""
    text = Path("designs/machines/table-bc.toml").read_text().partition("[errors]")
    axes = (
        text[0].replace("C'", f"{name}'").replace("[axes.C]", f'[axes.{name}]\nkind = "rotary"\ndirection = [0, 0, 1]')
    )
    errors = f"[errors]\nEX0{name} = {{ sigma = 50.0 }}\n"
    (tmp_path / "odd.toml").write_text(axes + errors + text[2][text[2].index("[workspace]") :])
    asked = ["plan", str(tmp_path / "odd.toml"), "--points", "4", "--starts", "1", "--no-proof", "-o"]
    assert main([*asked, str(tmp_path / "refused"), "--nc", "iso"]) == 2
    said = capsys.readouterr().err
    assert f"axis {name} has no NC address; name rotary axes by A, B, C" in said and "criterion" not in said
    assert not (tmp_path / "refused").exists()
    assert main([*asked, str(tmp_path / "plan")]) == 0
    assert f"note: no programs: axis {name}" in capsys.readouterr().err
    assert (tmp_path / "plan" / "setup.html").is_file() and not (tmp_path / "plan" / "nc").exists()


def test_a_quill_that_no_test_needs_stands_still_inside_its_reach() -> None:
    """Its travel begins at 0: it rests off that end, as every linear axis keeps, and no block of the program moves it."""
    six = location_only("table-bc")
    quill = replace(six.axes["Z"], name="W", travel=(0.0, 150.0))
    machine = replace(six, structure=Structure.parse("w C' B' X' Y' b Z W t"), axes={**six.axes, "W": quill}, text="")
    made = plan(machine, points=4, setups=1, starts=1, prove=False, anywhere=False)
    (run,) = made.campaign.runs
    assert np.all(run.commands["W"] == machine.workspace.clearance)
    assert set(re.findall(r"W(-?[\d.]+)", program(machine, run, "iso", Post()))) == {"2.0000"}

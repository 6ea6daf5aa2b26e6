"""Plans until an error is known well enough: what is asked is reached, more is asked for more poses, and what limits is said."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from lean import varying

from symfive.campaign import SetupSigma
from symfive.cli import main
from symfive.design import Plan, assess, plan, plan_until
from symfive.errors import InputError
from symfive.machine import Machine, preset, write_machine
from symfive.simulate import simulate

QUICK: dict[str, Any] = {"points": 12, "setups": 1, "starts": 1, "anywhere": False, "prove": False}


def _few_errors() -> Machine:
    machine = preset("table-bc")
    return replace(machine, errors={n: t for n, t in machine.errors.items() if n[2] == "0" and n[3] in "BC"}, text="")


MACHINE = _few_errors()
ASKED = {"EX0C": 0.3, "EA0C": 2.0}


@pytest.fixture(scope="module")
def made() -> Plan:
    return plan_until(MACHINE, ASKED, **QUICK)


@pytest.mark.slow
def test_what_is_asked_is_reached_with_few_poses(made: Plan) -> None:
    assert all(made.assessment.sigma[name] <= asked for name, asked in ASKED.items())
    assert made.certificate.points < 12
    assert made.interest == ("EX0C", "EA0C")
    assert f"{made.certificate.points} poses are the fewest found" in made.notes[0]
    ordinary = plan(MACHINE, **(QUICK | {"points": made.certificate.points - 1}))
    assert any(ordinary.assessment.sigma[name] > asked for name, asked in ASKED.items())


@pytest.fixture(scope="module")
def finest() -> Plan:
    return plan_until(MACHINE, {name: 0.5 * asked for name, asked in ASKED.items()}, **QUICK)


@pytest.mark.slow
def test_half_the_uncertainty_takes_more_poses(made: Plan, finest: Plan) -> None:
    assert finest.certificate.points > made.certificate.points


@pytest.mark.slow
def test_what_was_measured_before_counts(finest: Plan) -> None:
    """With a first run at hand fewer poses are left; where it is enough none are."""
    first = simulate(plan(MACHINE, **(QUICK | {"points": 6})).campaign, seed=1).campaign
    finer = {name: 0.5 * asked for name, asked in ASKED.items()}
    rest = plan_until(MACHINE, finer, given=first, **QUICK)
    assert rest.certificate.points < finest.certificate.points
    assert all(rest.assessment.sigma[name] <= asked for name, asked in finer.items())
    with pytest.raises(InputError, match=r"already known.*by the campaign given.*no measurement is needed"):
        plan_until(MACHINE, {"EX0C": 1.01 * assess(first).sigma["EX0C"]}, given=first, **QUICK)


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        ({"EZ0B": 5.0}, r"EZ0B cannot be known to 5 µm \(1σ\).*the tool's length limits it.*--tool-length-sigma"),
        ({"EX0C": 0.03}, r"needs more than 12 poses for 0.03 µm.*the noise limits it"),
        ({"EX0C": 60.0}, r"is already known to 50 µm by its prior"),
        ({"EX0Q": 1.0}, "no parameter EX0Q"),
        ({"EX0C": float("nan")}, "not a finite number"),
        ({"EX0C": -1.0}, "not positive"),
    ],
)
def test_what_cannot_be_is_said_with_what_limits_it(asked: dict[str, float], said: str) -> None:
    with pytest.raises(InputError, match=said):
        plan_until(MACHINE, asked, **QUICK)


@pytest.mark.slow
def test_a_measured_tool_lifts_the_limit() -> None:
    found = plan_until(MACHINE, {"EZ0B": 5.0}, setup_sigma=SetupSigma(tool_length=2.0), **QUICK)
    assert found.assessment.sigma["EZ0B"] <= 5.0


@pytest.mark.slow
def test_the_option(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder, whole = tmp_path / "plan", preset("tsutsumi-2007")
    few = varying(whole, "EXX", "EA0C")
    write_machine(few, tmp_path / "machine.toml")
    quick = ["--points", "8", "--starts", "1", "--no-proof", "-q", "-o", str(folder)]
    assert (
        main(["plan", str(tmp_path / "machine.toml"), "--until", "EXX=5um", "--until", "EA0C = 20 µrad", *quick]) == 0
    )
    assert "fewest found" in capsys.readouterr().out and (folder / "setup.html").exists()
    for words, said in (
        (["EX0C=1urad"], "the unit of EX0C is um"),
        (["EX0C"], "is not NAME=1σ"),
        (["EX0C=1", "--part", "x.ngc"], "no such file"),
        (["EX0C=1", "--criterion", "A"], "has no criterion of its own"),
        (["EX0C=1", "--circles", "planar"], "--until has no use in a plan of circles"),
    ):
        assert main(["plan", "tsutsumi-2007", "-o", str(tmp_path / "other"), "--until", *words]) == 2
        assert said in capsys.readouterr().err

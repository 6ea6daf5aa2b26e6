"""Readings that are reversed, exchanged or in another unit: said with the run, and not said where physics is missing instead."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from laser_world import axis_alone, laser_run
from lean import location_only

from symfive.campaign import Campaign, read_campaign
from symfive.diagnose import diagnose
from symfive.effects import make_effect
from symfive.identify import identify, wiring_doubts
from symfive.instruments import INSTRUMENTS
from symfive.machine import Machine, preset
from symfive.procedures import campaign_of, r_test_grid
from symfive.report import diagnosis_text
from symfive.simulate import simulate

READY = Path(__file__).parents[1] / "designs" / "plans" / "head-bc-r-test-36"
COLUMNS = ("dx_um", "dy_um", "dz_um")
PLACES = np.array([-300.0, -221.0, -148.0, -77.0, 3.0, 71.0, 152.0, 219.0, 300.0])


def planned(machine: Machine) -> Campaign:
    """One grid of nests, in two runs."""
    grid, *_ = r_test_grid(machine, step_deg=60.0, returning=False)
    return campaign_of(machine, [replace(grid, id=name, file=f"{name}.csv") for name in ("one", "two")])


MACHINE = preset("tsutsumi-2007")
PLAN = planned(MACHINE)


def wired(campaign: Campaign, order: tuple[str, str, str], signs: tuple[float, float, float], *runs: str) -> Campaign:
    """The campaign with what is in `order` and `signs` in the place of dx, dy, dz of some runs."""

    def read(name: str) -> dict[str, np.ndarray]:
        readings = campaign.run(name).readings
        return {c: s * readings[o] for c, o, s in zip(COLUMNS, order, signs, strict=True)}

    return replace(campaign, runs=tuple(r.with_readings(read(r.id)) if r.id in runs else r for r in campaign.runs))


@pytest.mark.parametrize(
    ("order", "signs", "runs", "says"),
    [
        (COLUMNS, (-1.0, 1.0, 1.0), ("one",), "run one: dx reversed in sign would explain"),
        (("dy_um", "dx_um", "dz_um"), (1.0, 1.0, 1.0), ("two",), "run two: dx and dy exchanged would explain"),
        (("dy_um", "dx_um", "dz_um"), (1.0, 1.0, -1.0), ("one",), "dx and dy exchanged, dz reversed in sign would"),
        (COLUMNS, (1.0, 1.0, -1.0), ("one", "two"), "all runs: dz reversed in sign would explain"),
        (("dy_um", "dz_um", "dx_um"), (1.0, 1.0, 1.0), ("one",), "dx, dy, dz in the order"),
    ],
)
def test_it_is_said_which_sensor_of_which_run(order, signs, runs, says) -> None:
    measured = simulate(PLAN, seed=2).campaign
    found = identify(wired(measured, order, signs, *runs))
    assert len(wiring_doubts(found)) == 1
    assert any(says in note for note in found.notes), found.notes


@pytest.mark.parametrize(("lines", "says"), [(-1, "further down"), (1, "further up")])
@pytest.mark.parametrize("runs", [("two",), ("one", "two")])
def test_readings_that_stand_a_line_off_are_said(lines: int, says: str, runs: tuple[str, ...]) -> None:
    """The first reading was forgotten, or taken twice; the last line holds what was read last, or has none left."""
    measured = simulate(PLAN, seed=2).campaign

    def moved(values: np.ndarray) -> np.ndarray:
        return np.concatenate([values[:1], values[:-1]] if lines > 0 else [values[1:], values[-1:]])

    off = [r.with_readings({n: moved(v) for n, v in r.readings.items()}) if r.id in runs else r for r in measured.runs]
    (said,) = wiring_doubts(identify(replace(measured, runs=tuple(off))))
    place = "all runs" if len(runs) > 1 else "run two"
    assert said.startswith(f"{place}: every reading one line {says} would explain")


def test_a_reversed_sensor_is_said_where_the_fit_excludes_what_contradicts_it() -> None:
    """Thirteen poses hardly tell 35 unknowns: beside nine readings that count as outliers these explain all others."""
    measured, runs = simulate(read_campaign(READY), seed=1).campaign, []
    for run in measured.runs:
        thinned = replace(
            run,
            commands={name: values[::3] for name, values in run.commands.items()},
            readings={name: values[::3] for name, values in run.readings.items()},
            time=None if run.time is None else np.asarray(run.time)[::3],
        )
        runs.append(thinned.with_readings({**thinned.readings, "dx_um": -thinned.readings["dx_um"]}))
    found = identify(replace(measured, runs=tuple(runs)))
    assert found.chi2_dof < 2.0 and len(found.outliers) > 3
    (said,) = wiring_doubts(found)
    assert said.startswith("all runs: dx reversed in sign would explain")


def test_sensors_with_directions_of_their_own_are_not_looked_at() -> None:
    options = {"directions": [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.6, 0.8, 0.0]]}
    run = replace(PLAN.runs[0], options=options)
    measured = simulate(replace(PLAN, runs=(run,)), seed=3).campaign
    assert len(measured.runs[0].readings) == 4
    far = {name: -values for name, values in measured.runs[0].readings.items()}
    assert wiring_doubts(identify(replace(measured, runs=(measured.runs[0].with_readings(far),)))) == ()


def positioned(*factors: float) -> Campaign:
    """A positioning test of an axis with a known course in each run, its readings times a factor, under noise of which a part
    is slow."""
    way, rng, runs = np.concatenate([PLACES, PLACES[::-1]] * 3), np.random.default_rng(8), []
    for number, factor in enumerate(factors):
        slow = 0.2 * np.sin(0.3 * np.arange(len(way)) + number)
        read = 12.0 * way / 310.0 - 9.0 * (way / 310.0) ** 2 + slow + rng.normal(0.0, 0.3, len(way))
        runs.append(laser_run(f"r{number}", way, factor * read, noise_um=0.3))
    return Campaign(machine=axis_alone(-310.0, 310.0, sigma_um=10.0, order=2), runs=tuple(runs))


@pytest.mark.parametrize(
    ("factors", "says"),
    [
        ((1.0, 1.0, -1.0), ["run r2: X_dev reversed in sign would explain"]),
        ((1.0, -1.0), ["run r0 or run r1: X_dev reversed in sign would explain"]),
        ((1.0, 1000.0), ["run r1: X_dev 1000 times too large would explain"]),
        ((1.0, 0.001, 1.0), ["run r1: X_dev 1000 times too small would explain"]),
        ((1.0, 1.0), []),
    ],
)
def test_a_laser_s_file_of_another_sign_or_unit_is_said(factors, says) -> None:
    doubts = wiring_doubts(identify(positioned(*factors)))
    assert len(doubts) == len(says) and all(d.startswith(s) for d, s in zip(doubts, says, strict=True)), doubts


def test_a_new_instrument_s_file_is_asked_after_too(monkeypatch: pytest.MonkeyPatch) -> None:
    class Level(type(INSTRUMENTS["laser"])):
        name = "level"

    monkeypatch.setitem(INSTRUMENTS, "level", Level())
    made = positioned(1.0, 1.0, -1.0)
    new = replace(made, runs=tuple(replace(run, instrument=("level",)) for run in made.runs))
    (said,) = wiring_doubts(identify(new))
    assert said.startswith("run r2: X_dev reversed in sign would explain")


def test_an_axis_that_grows_holds_no_other_readings() -> None:
    made = positioned(1.0, 1.0, 1.0)
    runs = []
    for number, run in enumerate(made.runs):
        grown = run.readings["X_dev_um"] + 6.0 * number * run.commands["X"] / 310.0
        runs.append(run.with_readings({"X_dev_um": grown}))
    found = identify(replace(made, runs=tuple(runs)))
    assert found.chi2_dof > 10.0
    assert wiring_doubts(found) == ()


def test_right_wiring_is_not_doubted() -> None:
    assert wiring_doubts(identify(simulate(PLAN, seed=3).campaign)) == ()


@pytest.mark.parametrize(
    "effect",
    [{"effect": "lateral_play", "component": "EYA"}, {"effect": "gravity_sag", "axis": "A", "component": "EZA"}],
)
def test_missing_physics_is_no_wiring(effect) -> None:
    options = {name: value for name, value in effect.items() if name != "effect"}
    missing = make_effect(effect["effect"], **options)
    names = [p.name for p in missing.parameters(PLAN)]
    measured = simulate(PLAN, truth=dict.fromkeys(names, 60.0), effects=[missing], seed=4).campaign
    found = identify(measured)
    assert found.chi2_dof > 20.0
    assert wiring_doubts(found) == ()


@pytest.mark.slow
def test_the_next_step_of_a_diagnosis_is_the_wiring() -> None:
    measured = wired(simulate(planned(location_only("table-bc")), seed=2).campaign, COLUMNS, (-1.0, 1.0, 1.0), "one")
    said = " ".join(diagnosis_text(diagnose(measured)).split())
    assert said.startswith("Check a recording first. Run one: dx reversed in sign") and "If it is right: " in said
    assert "Next: run one: dx reversed in sign" in said


def beside_physics(factors: tuple[float, ...]) -> Campaign:
    """The positioning test with a reversal value of 3 µm and a screw's error of 2 µm every 37 mm."""
    made, runs = positioned(*factors), []
    for run, factor in zip(made.runs, factors, strict=True):
        x = run.commands["X"]
        steps = np.sign(np.diff(x, prepend=2.0 * x[0] - x[1]))
        up = steps[np.maximum.accumulate(np.where(steps != 0.0, np.arange(len(x)), 0))]
        more = factor * (1.5 * up + 2.0 * np.sin(2.0 * np.pi * x / 37.0))
        runs.append(run.with_readings({"X_dev_um": run.readings["X_dev_um"] + more}))
    return replace(made, runs=tuple(runs))


@pytest.mark.slow
def test_a_reversed_run_is_said_beside_other_physics() -> None:
    assert wiring_doubts(identify(beside_physics((1.0, -1.0, 1.0)))) == ()
    (said,) = diagnose(beside_physics((1.0, -1.0, 1.0))).other_readings
    assert said.startswith("run r1: X_dev reversed in sign would explain")
    right = diagnose(beside_physics((1.0, 1.0, 1.0)))
    assert right.other_readings == () and ("backlash", "X") in {(f.name, f.axis) for f in right.findings}


@pytest.mark.slow
def test_a_reversed_sensor_is_said_beside_a_play() -> None:
    play = make_effect("lateral_play", component="EYA")
    measured = simulate(PLAN, truth={p.name: 20.0 for p in play.parameters(PLAN)}, effects=[play], seed=4).campaign
    assert wiring_doubts(identify(wired(measured, COLUMNS, (-1.0, 1.0, 1.0), "one"))) == ()
    found = diagnose(wired(measured, COLUMNS, (-1.0, 1.0, 1.0), "one"))
    assert found.other_readings[0].startswith("run one: dx reversed in sign would explain")


def test_a_large_zero_is_no_other_unit() -> None:
    """1000 times the readings leave 1000 times as much of them, however large the zero that a fit takes away."""
    made, rng = positioned(1.0, 1.0), np.random.default_rng(2)
    more = {run.id: 5000.0 + rng.normal(0.0, 0.3, run.rows) for run in made.runs}
    runs = [run.with_readings({"X_dev_um": run.readings["X_dev_um"] + more[run.id]}) for run in made.runs]
    found = identify(replace(made, runs=tuple(runs)))
    assert found.chi2_dof > 1.5
    assert wiring_doubts(found, [make_effect("backlash", "X")]) == ()

"""Time that was not recorded is no coordinate (`clock = "none"`); an instrument may start its own (`clock_sigma_ms`)."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import plant
import pytest
from lean import without_drives
from test_outliers import NOISE_UM, campaign, positioning
from test_real_recordings import recordings

from symfive.campaign import Campaign, SetupSigma, read_campaign, write_campaign
from symfive.check import check
from symfive.convert import convert
from symfive.diagnose import diagnose, partitions
from symfive.effects import Effect, make_effect
from symfive.errors import InputError
from symfive.identify import identify
from symfive.importers import polar_run
from symfive.inference import Noise
from symfive.machine import preset
from symfive.model import Model
from symfive.motion import (
    Acceleration,
    Command,
    Late,
    Play,
    Position,
    PreSliding,
    ReversalAhead,
    ReversalDistance,
    ReversalTime,
    RunMotion,
    Signal,
    Velocity,
)
from symfive.posterior import baseline, candidates, expanded, moments_about
from symfive.procedures import campaign_of, planar_circle, r_test_grid
from symfive.report import _report, identification_report
from symfive.simulate import simulate


def unclocked(plan: Campaign) -> Campaign:
    """The same without its clock."""
    return replace(plan, runs=tuple(replace(run, clock="none", start_s=0.0) for run in plan.runs))


def tour(seed: int = 1) -> Campaign:
    """An R-test at rest during which the tool drifts."""
    machine = preset("oyama-2010")
    plan = campaign_of(machine, r_test_grid(machine, step_deg=60.0))
    span = max(run.start_s + run.time[-1] for run in plan.runs)
    drift = {"thermal_drift.amplitude.x": 15.0, "thermal_drift.time_constant_s": 0.4 * span}
    return simulate(plan, truth=drift, effects=[make_effect("thermal_drift")], seed=seed).campaign


def test_the_declaration_survives_the_disk_and_is_written_only_where_it_is_made(tmp_path: Path) -> None:
    plan = tour()
    first = replace(plan.runs[0], clock="none")
    write_campaign(replace(plan, runs=(first, *plan.runs[1:])), tmp_path / "c")
    text = (tmp_path / "c" / "campaign.toml").read_text(encoding="utf-8")
    assert text.count("clock") == 1 and 'clock = "none"' in text
    again = read_campaign(tmp_path / "c")
    assert [run.has_clock for run in again.runs] == [False] + [True] * (len(plan.runs) - 1)
    assert again.notes == ()
    assert "static, clock not recorded" in str(check(tmp_path / "c"))


@pytest.mark.parametrize(("clock", "said"), [('"none"', "constant rate"), ('"utc"', "clock"), ("7", "clock")])
def test_a_wrong_declaration_is_one_sentence_with_its_place(clock: str, said: str, tmp_path: Path) -> None:
    machine = preset("three-axis")
    write_campaign(campaign_of(machine, planar_circle(machine, direction="ccw")), tmp_path / "c")
    file = tmp_path / "c" / "campaign.toml"
    file.write_text(file.read_text().replace("[[run]]", f"[[run]]\nclock = {clock}"))
    with pytest.raises(InputError, match=rf"campaign.toml, line \d+: .*{said}"):
        read_campaign(tmp_path / "c")


def test_nothing_that_acts_over_time_is_looked_for_where_there_is_none() -> None:
    plan = tour()

    def looked_for(plan: Campaign) -> tuple[set[str], set[str]]:
        moments = moments_about(expanded(baseline(plan), (), candidates(plan))[0], candidates(plan))
        effects = [term.effect for term in moments.terms]
        timed = {e.id for e in effects if e.over_time or e.id in ("setup_shift", "vibration")}
        return timed, {name for e in effects if e.unidentified for name in e.over}

    acting, courses = looked_for(plan)
    assert {"thermal_drift", "setup_shift"} <= acting and "t" in courses
    # a slip of the ball shows between two rows, and a drift over the rows of its run: their order was recorded
    assert looked_for(unclocked(plan)) == ({"setup_shift"}, courses - {"t"} | {"row"})
    assert "time" not in " ".join(partitions(unclocked(plan)))


def test_an_effect_over_time_leaves_a_run_without_a_clock_alone() -> None:
    plan = tour()
    mixed = replace(plan, runs=(replace(plan.runs[0], clock="none"), *plan.runs[1:]))
    for effect, size in (
        (make_effect("thermal_drift"), {"thermal_drift.amplitude.x": 9.0}),
        (make_effect("location_error", component="EX0C", drift=True), {"location_error.EX0C.value": 9.0}),
        (make_effect("unknown", over=("t",)), None),
    ):
        model = Model(mixed, [effect])
        size = size or {p.name: 9.0 for p in model.effects[0].parameters(mixed)}
        change = model.contribution(model.effects[0], model.vector(size))
        assert np.abs(change[plan.runs[0].id]).max() == 0.0 < np.abs(change[plan.runs[1].id]).max()


def test_numbers_that_only_order_the_rows_change_nothing() -> None:
    plan = unclocked(campaign(positioning()))
    rng = np.random.default_rng(3)
    other = [replace(run, time=np.cumsum(rng.uniform(0.1, 90.0, run.rows))) for run in plan.runs]
    first, second = (identify(c, noise="repeats") for c in (plan, replace(plan, runs=tuple(other))))
    assert plan.repeats == replace(plan, runs=tuple(other)).repeats != ()
    np.testing.assert_allclose(first.values, second.values, rtol=1e-12)
    np.testing.assert_allclose(first.std, second.std, rtol=1e-12)


def test_rows_count_and_not_the_numbers_that_order_them() -> None:
    plan, rng = unclocked(tour()), np.random.default_rng(3)
    other = [replace(run, time=np.cumsum(rng.uniform(0.1, 90.0, run.rows))) for run in plan.runs]
    renumbered, run = replace(plan, runs=tuple(other)), plan.runs[0]
    shift, drift = make_effect("setup_shift", run=run.id, row=8), make_effect("unknown", over=("row",), run=run.id)
    for effect in (shift, drift):
        models = [Model(each, [effect]) for each in (plan, renumbered)]
        size = {p.name: 9.0 for p in models[0].effects[0].parameters(plan)}
        one, two = (m.contribution(m.effects[0], m.vector(size)) for m in models)
        assert np.ptp(one[run.id]) > 1.0 and not any(one[each.id].any() for each in plan.runs[1:])
        np.testing.assert_allclose(one[run.id], two[run.id], atol=1e-12)


def test_slow_noise_without_a_clock_lasts_rows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_report, "FIGURES", ())
    found = identify(unclocked(campaign(positioning())))
    slow = Noise(NOISE_UM, 0.5, 7.0, NOISE_UM)
    found = replace(found, noises=dict.fromkeys(found.noises, slow))
    assert "7.00 rows" in identification_report(found, tmp_path).read_text()
    noise = found.to_data()["noise"]["cycle-1.laser"]
    assert noise["rows_correlated"] == 7.0 and "time_constant_s" not in noise
    clocked = replace(found, model=Model(campaign(positioning())))
    assert "rows" not in clocked.to_data()["noise"]["cycle-1.laser"]


@pytest.mark.slow
def test_a_diagnosis_without_a_clock_finds_nothing_over_time() -> None:
    """With it, the drift has its name."""
    with_clock = diagnose(tour())
    assert [f.name for f in with_clock.findings] == ["thermal_drift"]
    found = diagnose(unclocked(tour()))
    assert "t" not in {f.coordinate for f in found.findings}
    assert not {"thermal_drift", "setup_shift", "vibration"} & {f.name for f in found.findings}
    assert " s " not in " ".join(f.says for f in found.findings)


def two_nests(folder: Path, effects: list[dict], step_deg: float = 90.0) -> tuple[Campaign, Campaign]:
    """Two R-tests of the independent plant, and the same without their clocks."""
    machine = plant.static_table()
    poses = plant.grid_poses(np.arange(-90, 91, 45.0), np.arange(0, 316, step_deg))
    runs = [
        plant.r_test(machine, "nest1", nest=(90, -20, 50), poses=poses, start_s=0.0),
        plant.r_test(machine, "nest2", nest=(50, 40, 150), poses=poses, start_s=1500.0),
    ]
    plant.write_campaign(folder / "c", machine, runs, {"EX0B": 30.0, "EA0C": -40.0}, None, effects, seed=3)
    recorded = read_campaign(folder / "c")
    return recorded, unclocked(recorded)


def test_a_slip_without_a_clock_is_found_at_its_row(tmp_path: Path) -> None:
    """The table ball of the second run slips by 5.4 µm between two readings of 0.4 µm."""
    shift = [4.0, -3.0, 2.0]
    recorded, plan = two_nests(tmp_path, [{"effect": "setup_shift", "run": "nest2", "t_s": 200.0, "shift": shift}])
    found = diagnose(plan)
    (finding,) = found.findings
    assert finding.name == "setup_shift" and finding.confidence > 0.95 and finding.runs == ("nest2",)
    first = int(np.flatnonzero(recorded.runs[1].time >= 200.0)[0])
    assert finding.coordinate == "row in nest2"
    assert finding.parameters["row"].value == first + 1 and "t_s" not in finding.parameters
    assert f"row {first + 1}" in finding.says and " s " not in finding.says
    said = finding.parameters["shift"]
    away = np.subtract(said.value, shift) / said.std
    assert np.abs(away).max() < 3.0 and max(said.std) < 0.2
    assert found.fit.chi2_dof_before > 4.0 and found.fit.chi2_dof_after < 1.1


def test_nothing_slips_in_a_clean_campaign_without_a_clock(tmp_path: Path) -> None:
    _, plan = two_nests(tmp_path, [])
    found = diagnose(plan)
    assert not found.mismatch and found.findings == ()


@pytest.mark.slow
def test_a_slow_drift_without_a_clock_is_no_slip(tmp_path: Path) -> None:
    drift = {"effect": "thermal_drift", "amplitude": 12.0, "direction": [0.0, 0.6, 0.8], "time_constant_s": 900.0}
    _, plan = two_nests(tmp_path, [drift], step_deg=45.0)
    found = diagnose(plan)
    assert {f.name for f in found.findings} == {"unknown"}
    assert {f.coordinate for f in found.findings} <= {"row in nest1", "row in nest2"}
    rows = next(f for f in found.findings if f.runs == ("nest1",))
    assert np.abs(rows.parameters["direction"].value) == pytest.approx([0.0, 0.6, 0.8], abs=0.15)
    assert "setup_shift" not in {r.effect for f in found.findings for r in f.rivals if r.confidence > 0.05}


@pytest.mark.parametrize(
    ("name", "options", "said"),
    [
        ("setup_shift", {"row": 1}, "row = 1 lies outside the run"),
        ("setup_shift", {"row": 5, "t_s": 9.0}, "a row has no clock"),
        ("setup_shift", {"row": 5, "shape": "creep"}, "a row has no clock"),
        ("unknown", {"over": ("row",), "run": None}, "within one run"),
        ("unknown", {"over": ("t",)}, "within one run"),
    ],
)
def test_rows_are_of_a_run_without_a_clock(name: str, options: dict, said: str) -> None:
    plan = unclocked(tour())
    with pytest.raises(InputError, match=said):
        Model(plan, [make_effect(name, **{"run": plan.runs[0].id, **options})])


def test_rows_do_not_replace_a_clock_that_was_recorded() -> None:
    plan = tour()
    run = plan.runs[0].id
    assert not any(make_effect("setup_shift", run=run, row=5).applies(each) for each in plan.runs)
    with pytest.raises(InputError, match="no run has these coordinates"):
        Model(plan, [make_effect("unknown", over=("row",), run=run)])


@pytest.mark.parametrize("name", ["ecmc-iso230", "irb120-tracker", "mukca/panda_1"])
def test_converters_declare_what_was_not_recorded(name: str) -> None:
    recordings(name)
    assert not any(run.has_clock for run in convert(name).runs)


def test_converters_keep_the_clocks_that_were() -> None:
    recordings("ess-xyz")
    runs = convert("ess-xyz").runs
    assert {run.has_clock: run.id[-4:] for run in runs if "stops" in run.id or run.dynamic} == {True: "scan"}
    assert not any(run.has_clock for run in runs if not run.dynamic and "stops" not in run.id)


def late_circles(sigma: float) -> Campaign:
    """Circles of a machine with play and friction whose bar knows the control's clock to 1σ of `sigma` ms."""
    machine = preset("three-axis")
    runs = planar_circle(machine, radius=100.0, feed=2000.0, rate_hz=50.0)
    return campaign_of(machine, [replace(run, clock_sigma_ms=sigma) for run in runs])


def worn() -> list[Effect]:
    return [make_effect("backlash", "X"), make_effect("friction", "X"), make_effect("friction", "Y")]


WORN = {"backlash.X.width": 12.0, "friction.X.coulomb": 60.0, "friction.Y.coulomb": 60.0}


def test_the_clock_of_a_run_is_found_with_play_and_friction() -> None:
    """Each run has its own, beside what turns sharply as the axes reverse: 1σ of 0.3 µm a reading."""
    plan = late_circles(20.0)
    late = dict(zip((run.id for run in plan.runs), (4.0, -7.0), strict=False))
    truth = {f"setup.{name}.clock": value for name, value in late.items()} | WORN
    measured = simulate(plan, truth=truth, effects=worn(), seed=1).campaign
    found = identify(Model(measured, worn()), noise="declared")
    assert found.converged
    for name, value in truth.items():
        assert abs(found[name] - value) < 4.0 * found.uncertainty(name)
    assert all(found.uncertainty(f"setup.{name}.clock") < 1.0 for name in late)


def test_a_delay_is_the_latency_of_the_whole_campaign() -> None:
    plan = late_circles(20.0)
    own = {f"setup.{run.id}.clock": 5.0 for run in plan.runs}
    alone = Model(plan, worn()).predict(own | WORN)
    latency = Model(late_circles(0.0), [*worn(), make_effect("latency")]).predict({"latency.delay_ms": 5.0} | WORN)
    for run in plan.runs:
        np.testing.assert_allclose(alone[run.id], latency[run.id], atol=1e-9)
        assert np.ptp(alone[run.id] - Model(plan, worn()).predict(WORN)[run.id]) > 0.1


def test_slopes_in_the_clock_are_exact_but_where_an_axis_turns() -> None:
    model = Model(late_circles(20.0), worn())
    run, step = model.campaign.runs[0], 1e-3
    name = f"setup.{run.id}.clock"
    at = WORN | {name: 3.3}
    line = model.linearise(run, model.vector(at))
    ahead, back = (model.predict_run(run, model.vector(at | {name: 3.3 + by})) for by in (step, -step))
    wrong = np.abs(
        line.jacobian[:, 0, list(line.columns).index(model.index[name])] - (ahead - back)[:, 0] / (2.0 * step)
    )
    assert np.mean(wrong > 1e-4 * np.abs(ahead - back).max() / step) < 0.01


@pytest.mark.parametrize("driven", [True, False], ids=["drive", "no drive"])
@pytest.mark.parametrize("what", ["delay", "drift"])
@pytest.mark.parametrize(
    "signal",
    [
        Position("X"), Velocity("X"), Acceleration("X"), Command("X"), ReversalDistance("X"), ReversalTime("X"),
        ReversalAhead("X"), Play("X", "width"), PreSliding("X", "distance"),
    ],
    ids=lambda signal: type(signal).__name__,
)  # fmt: skip
def test_a_signal_knows_its_slope_in_the_delay(signal: Signal, what: str, driven: bool) -> None:
    """Against the difference of the signal at two delays or drifts, but for rows about which a direction changes in between."""
    plan = late_circles(20.0)
    machine = plan.machine if driven else without_drives(plan.machine)
    motion = RunMotion(plan.runs[0], machine, {}, {"width": 30.0, "distance": 20.0})
    run, step = plan.runs[0], 1e-3 * plan.runs[0].interval
    late = Late(4e-3, 2e-3, run.start_s + run.time[0], run.duration, ("delay",), ("drift",))
    slope = motion.late(late).series(signal).tangents.get(what, 0.0)
    at = getattr(late, what)
    ahead, back = (motion.late(late._replace(**{what: at + by})).series(signal).value for by in (step, -step))
    wanted = (ahead - back) / (2.0 * step)
    scale = np.quantile(np.abs(wanted), 0.95)
    assert scale > 0.0 or isinstance(signal, Command)
    assert np.mean(np.abs(slope - wanted) > 2e-3 * scale + 1e-12) < 0.02


def test_a_clock_is_kept_in_the_campaign_s_file(tmp_path: Path) -> None:
    write_campaign(late_circles(12.5), tmp_path / "plan")
    assert [run.clock_sigma_ms for run in read_campaign(tmp_path / "plan").runs] == [12.5, 12.5]


def test_a_polar_export_knows_its_angle_as_far_as_is_said() -> None:
    """Half a degree at 2σ, on 100 mm and at 2000 mm/min: 13.1 ms."""
    angle = np.arange(0.0, 360.0, 1.0)
    options = {"centre": (0.0, 0.0, 80.0), "radius": 100.0, "feed": 2000.0}
    run = polar_run(preset("three-axis"), angle, np.zeros(360), **options)
    assert run.clock_sigma_ms == pytest.approx(13.09, abs=0.01)
    assert polar_run(preset("three-axis"), angle, np.zeros(360), angle_error=0.0, **options).clock_sigma_ms == 0.0


def test_a_polar_export_may_stretch_its_angles() -> None:
    """The software knows the begin and the end of the arc to some ms each, and takes the feed for constant in between."""
    angle, stretch = np.arange(0.0, 360.0, 1.0), 1e-3
    true = np.radians(180.0 + (1.0 + stretch) * (angle - 180.0))
    read = 1e3 * (np.hypot(100.0 * np.cos(true) - 0.2, 100.0 * np.sin(true)) - 100.0)  # 0.2 mm off its centre
    machine = replace(preset("three-axis"), errors={})
    run = polar_run(
        machine, angle, read, centre=(0.0, 0.0, 80.0), radius=100.0, feed=2000.0, noise_um=0.01,
        setup_sigma_um=SetupSigma(table_ball=200.0, tool_ball=20.0, length=0.5),
    )  # fmt: skip
    fit = identify(Campaign(machine=machine, runs=(run,)), noise="declared")
    assert fit.rms_um < 0.03
    assert fit.named[f"setup.{run.id}.clock_drift"] == pytest.approx(-1e3 * stretch * run.duration, rel=0.1)


def test_a_polar_export_does_not_know_the_lag_of_drives_that_are_not_stated() -> None:
    """The angle is that of the bar, which is where the axes are: 20 to 50 ms after their command, however fast they go."""
    machine = preset("three-axis")
    bare = without_drives(machine)
    angle, options = np.arange(0.0, 360.0, 1.0), {"centre": (0.0, 0.0, 80.0), "radius": 100.0}
    slow, fast = (
        polar_run(bare, angle, np.zeros(360), feed=feed, **options).clock_sigma_ms for feed in (2000.0, 20000.0)
    )
    assert slow == pytest.approx(np.hypot(13.09, 25.0), abs=0.01)
    assert fast == pytest.approx(25.0, abs=0.1)


@pytest.mark.parametrize("value", [-1.0, np.nan, "5", 1e9])
def test_a_clock_is_a_standard_deviation(value: object) -> None:
    run = late_circles(0.0).runs[0]
    with pytest.raises(InputError, match=f"run {run.id}: clock_sigma_ms = .* is not a standard deviation"):
        replace(run, clock_sigma_ms=value)


def test_axes_that_rest_need_no_clock() -> None:
    run = r_test_grid(preset("table-bc"))[0]
    with pytest.raises(InputError, match="clock_sigma_ms in a run whose axes rest"):
        replace(run, clock_sigma_ms=1.0)

"""Figures and reports: they are drawn, say what they show with units, escape what users wrote and are written whole."""

import re
from dataclasses import replace
from pathlib import Path

import matplotlib
import numpy as np
import pytest
from pages import HOSTILE, Page

from symfive.campaign import Campaign, Run, read_campaign
from symfive.circles import CircleFinder, grouped
from symfive.errors import InputError
from symfive.identify import Confounding, Identification, Outlier, identify
from symfive.machine import ErrorTerm, Machine, Structure, make_axis
from symfive.model import Model
from symfive.report import (
    _report,
    correlation_matrix,
    error_motion_bands,
    identification_report,
    identification_text,
    parameters_chart,
    polar_trace,
    prediction_chart,
    residual_spectrum,
    residuals_over_coordinates,
    residuals_over_time,
    save_figures,
)
from symfive.report._evidence import gap_table  # lost rows

CAMPAIGNS = Path(__file__).parent / "data" / "campaigns"
PLANAR = ("xy-f800-ccw-1", "xy-f800-cw-1", "xy-f2400-ccw-1", "xy-f2400-cw-2")
SYNCHRONOUS = ("x090-f800-ccw", "x110-f800-cw", "x110-f1600-ccw")
PNG = b"\x89PNG\r\n\x1a\n"


@pytest.fixture(scope="module")
def planar() -> Identification:
    campaign = read_campaign(CAMPAIGNS / "planar-none" / "fit")
    return identify(campaign.select(*PLANAR), noise="declared")


@pytest.fixture(scope="module")
def small() -> Identification:
    return identify(read_campaign(CAMPAIGNS / "static-ball-bar-two-heights" / "fit"))


@pytest.fixture(scope="module")
def page_of_small(small, tmp_path_factory) -> str:
    return identification_report(small, tmp_path_factory.mktemp("report")).read_text()


@pytest.fixture(scope="module")
def static() -> Identification:
    return identify(read_campaign(CAMPAIGNS / "static-none" / "fit"))


@pytest.fixture(scope="module")
def backlash() -> Identification:
    return identify(read_campaign(CAMPAIGNS / "dynamic-backlash" / "fit").select(*SYNCHRONOUS))


def texts(figure) -> str:
    """Every word of a figure."""
    return "\n".join(text.get_text() for text in figure.findobj(matplotlib.text.Text))


def panels(figure) -> list:
    return [axes for axes in figure.axes if axes.get_visible() and axes.get_label() != "<colorbar>"]


def test_residuals_over_time_has_one_panel_a_run_with_units_and_marks_outliers(planar):
    odd = Outlier("xy-f800-cw-1", 10, "dL_um", 0.5, 5.5)
    figure = residuals_over_time(replace(planar, outliers=(odd,)))
    assert len(panels(figure)) == len(planar.model.campaign.runs)
    words = texts(figure)
    assert "time in the run / s" in words and "µm" in words and "xy-f2400-cw-2" in words
    assert "excluded outlier" in words and "±2σ of the declared noise" in words and "beyond the panel" in words
    assert len(panels(residuals_over_time(planar, "xy-f800-cw-1"))) == 1


def test_a_run_that_is_not_there_is_named(planar):
    with pytest.raises(InputError, match='no run "elsewhere"'):
        residuals_over_time(planar, "elsewhere")


def test_residuals_over_coordinates_has_one_panel_for_each_moving_axis_and_column(static, backlash):
    figure = residuals_over_coordinates(static)
    assert len(panels(figure)) == 3 * 5
    words = texts(figure)
    assert all(label in words for label in ("dx / µm", "dy / µm", "dz / µm", "B / °", "C / °", "X / mm"))
    folded = texts(residuals_over_coordinates(backlash))
    assert "C over one revolution / °" in folded and "A /" not in folded and "one row in 2" in folded


def test_backlash_shows_as_two_lines(backlash):
    """The means over X of the two directions part by more than the noise."""
    axes = next(a for a in residuals_over_coordinates(backlash).axes if a.get_xlabel().startswith("X"))
    up, down = (line for line in axes.lines if line.get_linewidth() == 1.5)
    at = np.linspace(30.0, 50.0, 5)
    assert np.all(np.interp(at, *up.get_data()) - np.interp(at, *down.get_data()) > 0.2)


def test_polar_trace_states_magnification_and_rings_and_overlays_both_senses(planar):
    figure = polar_trace(planar)
    assert len(panels(figure)) == 6
    words = texts(figure)
    assert words.count("1 ring = ") == 6 and "×" in words and "R = 100 mm, 800 mm/min; angle of the bar" in words
    assert "xy-f800-ccw-1 (CCW)" in words and "xy-f800-cw-1 (CW)" in words and "+Y" in words
    before = texts(polar_trace(planar.model.campaign, ["xy-f800-ccw-1"]))
    assert "after the fit" not in before and "1 ring" in before


def test_polar_magnification_is_what_is_drawn(planar):
    """A ring of so many µm is drawn that many µm times the magnification away from the circle."""
    figure = polar_trace(planar, "xy-f800-ccw-1")
    axes = panels(figure)[0]
    shown = re.search(r"×([\d ]+) · 1 ring = ([\d.]+) µm", axes.get_title()).groups()
    magnification, ring = float(shown[0].replace(" ", "")), float(shown[1])
    rings = [line.get_data() for line in axes.lines if len(line.get_xdata()) == 121]
    radii = sorted(float(np.hypot(*ring).mean()) for ring in rings)
    assert np.diff(radii) * 100e3 == pytest.approx(magnification * ring, rel=0.06)


def test_circles_are_found_in_the_plane_and_about_a_rotary_axis(planar, backlash, static):
    finder = CircleFinder(planar.model.machine)
    circles = [finder.find(run) for run in planar.model.campaign.runs]
    assert [c.sense for c in circles] == [1, -1, 1, -1]
    assert all(c.radius == pytest.approx(100.0) and c.marks == ("+X", "+Y") for c in circles)
    assert len(grouped(circles)) == 3
    synchronous = [CircleFinder(backlash.model.machine).find(run) for run in backlash.model.campaign.runs]
    assert all(c.radius == pytest.approx(50.0, rel=1e-3) and c.over == "angle of the bar" for c in synchronous)
    with pytest.raises(InputError, match="measured circle"):
        polar_trace(static)


def test_a_rotary_run_with_the_bar_fixed_in_the_table_counts_by_the_axis():
    machine = Machine(
        name="table", structure=Structure.parse("w C' b X t"),
        axes={"C": make_axis("C"), "X": make_axis("X")}, errors={"EX0C": ErrorTerm(name="EX0C", sigma=20.0)},
    )  # fmt: skip
    turn = np.linspace(0.0, 360.0, 400)
    run = Run(
        id="c", instrument=("ball_bar",), sampling="dynamic", time=np.arange(400) * 0.02, table_ball=(80.0, 0.0, 0.0),
        commands={"C": turn, "X": np.zeros(400)}, length=80.0,
    )  # fmt: skip
    campaign = Campaign(machine=machine, runs=(run,))
    circle = CircleFinder(machine).find(run)
    assert circle.over == "coordinate of C" and circle.radius == pytest.approx(80.0) and circle.feed_unit == "°/min"
    readings = {"dL_um": Model(campaign).predict({"EX0C": 5.0})["c"][:, 0]}
    figure = polar_trace(replace(campaign, runs=(run.with_readings(readings),)))
    assert "coordinate of C" in texts(figure)


def test_run_up_and_run_out_do_not_count_in_the_height_of_a_circle(planar):
    """ISO 230-4: complete circles, here one of a turn and a half; a jerk as the machine starts is none of it."""
    campaign = planar.model.campaign
    finder, run = CircleFinder(campaign.machine), campaign.runs[0]
    time = np.arange(0.0, 40.0, 0.05)
    angle = 3.0 * np.pi * time / time[-1]
    commands = dict(run.commands)
    commands |= {n: np.full(len(time), commands[n][0]) for n in commands}
    radius = finder.find(run).radius
    commands |= {"X": run.table_ball[0] + radius * np.cos(angle), "Y": run.table_ball[1] + radius * np.sin(angle)}
    circle = finder.find(replace(run, time=time, commands=commands, readings={}, tool_ball=run.tool_ball))
    counted = circle.evaluated
    assert circle.turns == pytest.approx(1.5, rel=1e-6) and counted.mean() == pytest.approx(1.0 / 1.5, abs=0.01)
    assert np.ptp(circle.angle[counted]) == pytest.approx(2.0 * np.pi, abs=0.05)
    assert counted[len(time) // 2] and not counted[0] and not counted[-1]
    short = finder.find(replace(run, time=time[:400], commands={n: c[:400] for n, c in commands.items()}, readings={}))
    assert short.turns < 1.0 and short.evaluated.all()


def test_error_motions_are_bands_and_maps(planar, static):
    figure = error_motion_bands(planar)
    words = texts(figure)
    assert len(panels(figure)) == 1 and "EXX / µm" in words and "X / mm" in words and "95 %" in words
    with pytest.raises(InputError, match="no error motion"):
        error_motion_bands(static)
    term = ErrorTerm(name="EZB", sigma=5.0, basis=("polynomial", "fourier"), order=(2, 1), over=("B", "C"))
    machine = replace(static.model.machine, errors={"EZB": term})
    figure = error_motion_bands(identify(static.model.campaign.with_machine(machine), noise="declared"))
    assert len(panels(figure)) == 2 and "1σ of EZB" in texts(figure)


def test_correlations_put_the_machine_first_and_group_the_setup(static):
    figure = correlation_matrix(static)
    labels = [tick.get_text() for tick in panels(figure)[0].get_yticklabels()]
    assert labels[:8] == [p.name for p in static.parameters[:8]] and len(labels) == len(static.parameters)
    words = texts(figure)
    assert "nest1" in words and "correlation (−1 … 1)" in words


def test_parameters_are_drawn_a_panel_a_unit(static):
    figure = parameters_chart(static)
    assert [axes.get_xlabel() for axes in panels(figure)] == ["µm", "µrad"]
    assert "EX0C" in texts(figure) and "prior ±1σ" in texts(figure)
    assert "zero x of run nest1" in texts(parameters_chart(static, setup=True))


def test_spectrum_is_over_frequency_and_order(planar, static):
    figure = residual_spectrum(planar)
    assert [axes.get_title(loc="left") for axes in panels(figure)] == ["over frequency", "over order"]
    words = texts(figure)
    assert "frequency / (1/s)" in words and "amplitude / µm" in words and "$" not in words
    assert len(panels(residual_spectrum(static))) == 1


def test_spectrum_finds_amplitudes(planar):
    """A tone of 1 µm at 5 per second and one of order 7 come out with their size."""
    campaign = planar.model.campaign.select("xy-f800-ccw-1")
    run = campaign.runs[0]
    angle = CircleFinder(campaign.machine).find(run).angle
    tone = np.sin(2.0 * np.pi * 5.0 * run.time) + 2.0 * np.cos(7.0 * angle)
    result = replace(planar, model=Model(campaign), residuals={run.id: tone[:, None]}, outliers=())
    time, order = panels(residual_spectrum(result))
    frequency, amplitude = time.lines[0].get_data()
    assert amplitude[np.argmin(abs(frequency - 5.0))] == pytest.approx(1.0, rel=0.02)
    assert order.lines[0].get_ydata()[6] == pytest.approx(2.0, rel=0.02)


def _noise_only(static: Identification, degrees: np.ndarray, seed: int) -> Identification:
    """Declared white noise and nothing else, read by an R-test at these angles of C."""
    machine = static.model.machine
    run = static.model.campaign.runs[0]
    held = {name: np.zeros(len(degrees)) for name in machine.axes} | {"C": degrees}
    rows = np.arange(len(degrees))
    run = replace(run, time=rows.astype(float), commands=held, readings=dict.fromkeys(run.readings, 0.0 * rows))
    noise = np.random.default_rng(seed).normal(0.0, run.noise("r_test"), (len(rows), 3))
    model = Model(replace(static.model.campaign, runs=(run,)))
    return replace(static, model=model, residuals={run.id: noise}, outliers=())


def test_spectrum_of_noise_at_few_uneven_angles_stays_below_its_line(static):
    """A planned R-test: the orders that its angles cannot separate are not drawn, and noise makes no peak."""
    uneven = np.array([0.0, 12.0, 55.0, 61.0, 110.0, 118.0, 171.0, 180.0, 232.0, 240.0, 298.0, 306.0])
    above = 0
    for seed in range(40):
        (axes,) = panels(residual_spectrum(_noise_only(static, np.repeat(uneven, 2), seed)))
        height, line = axes.lines[0].get_ydata(), axes.patches[0].get_data().values
        assert 1 <= len(height) == len(line) <= (len(uneven) - 2) // 2 and height.max() < 0.8
        above += bool(np.any(height > line))
    assert above <= 2
    (axes,) = panels(residual_spectrum(_noise_only(static, np.arange(0.0, 360.0, 10.0), 1)))
    assert len(axes.lines[0].get_ydata()) > 8, "even angles tell more orders apart"
    with pytest.raises(InputError, match="goes round"):
        residual_spectrum(_noise_only(static, np.array([0.0, 1.0, 2.0, 70.0, 140.0, 210.0, 280.0, 285.0]), 1))


def test_prediction_chart_states_the_rms_and_checks_shapes():
    measured = np.zeros((50, 2))
    figure = prediction_chart(measured, measured + 0.5, names=["dx", "dy"], noise=0.3, along="time / s", title="check")
    words = texts(figure)
    assert len(panels(figure)) == 4 and words.count("RMS 0.5, declared noise 0.3 µm") == 2 and "dy / µm" in words
    with pytest.raises(InputError, match="do not match"):
        prediction_chart(measured, measured[:-1])


def test_figures_leave_the_callers_settings_alone(static):
    before = dict(matplotlib.rcParams)
    parameters_chart(static)
    assert dict(matplotlib.rcParams) == before


def test_save_figures_writes_every_format_whole(small, tmp_path):
    paths = save_figures(small, tmp_path / "figures", formats=("png", "svg"))
    drawn = list(dict.fromkeys(path.stem for path in paths))
    assert "parameters" in drawn and "error-motions" not in drawn, "no error motion, no figure of one"
    assert [path.name for path in paths] == [f"{name}.{ending}" for name in drawn for ending in ("png", "svg")]
    assert paths[0].read_bytes().startswith(PNG) and paths[1].read_text().rstrip().endswith("</svg>")
    assert sorted(tmp_path.rglob("*")) == sorted([tmp_path / "figures", *paths])
    with pytest.raises(InputError, match="gif"):
        save_figures(small, tmp_path, formats=("gif",))


def test_report_says_what_the_data_say(backlash, tmp_path):
    path = identification_report(backlash, tmp_path)
    text = path.read_text()
    page = Page(text)
    assert path.name == "identification.html" and len(text) < 3_000_000 and list(tmp_path.iterdir()) == [path]
    assert page.tags.count("table") == 6 and page.tags.count("figure") == 7 and page.tags.count("svg") == 7
    assert backlash.inseparable and all(said in page.words for said in backlash.inseparable)
    for word in ("EX0C", "µrad", "95 % interval", "χ²/dof", "x110-f800-cw.csv", "correlation time / s", "declared"):
        assert word in page.words
    assert "larger than the declared noise" in page.words and "$" not in page.words.replace("$_", "")
    assert not re.search(r'(src|href)="(?!data:|#)', text.replace('xlink:href="data:', "")), "loads nothing"
    assert "prefers-color-scheme: dark" in text and "@media print" in text and "data-sort=" in text


def test_a_report_is_the_same_every_time(small, page_of_small, tmp_path):
    assert identification_report(small, tmp_path).read_text() == page_of_small
    assert 'id="polar-trace-' in page_of_small and "var(--ink)" in page_of_small


def test_report_escapes_what_users_wrote(small, tmp_path):
    campaign = small.model.campaign
    machine = replace(campaign.machine, name=HOSTILE)
    evil = replace(campaign.runs[0], file="<img src=x onerror=alert(1)>.csv")
    object.__setattr__(evil, "id", "<b onclick=alert(2)>$x^$</b>")  # the reader would refuse it
    campaign = replace(campaign, machine=machine, name=HOSTILE, notes=(HOSTILE,), runs=(evil, campaign.runs[1]))
    result = identify(campaign, noise="declared")
    odd = Confounding((replace(result.parameters[0], called=HOSTILE),), (1.0,), 0.0, True)
    result = replace(
        result,
        outliers=(Outlier(evil.id, 3, "dL_um", 12.0, 30.0),),
        notes=(HOSTILE,),
        confounded=(odd,),
    )
    text = identification_report(result, tmp_path).read_text()
    page = Page(text)
    assert page.tags.count("script") == 1 and not {"img", "b"} & set(page.tags)
    assert not any(name.startswith("on") for name, _ in page.attributes)
    assert page.words.count(HOSTILE) >= 4 and "<img src=x onerror=alert(1)>.csv" in page.words
    assert "Content-Security-Policy" in text and "script-src 'sha256-" in text


def verdict(result: Identification) -> str:
    """The first paragraph of what `identify` prints, as one line."""
    return " ".join(identification_text(result).partition("\n\n")[0].split())


def test_verdict_is_honest(static, backlash):
    assert verdict(static).startswith("The model explains the readings down to the declared noise: ")
    assert "does not explain" in verdict(backlash) and "symfive diagnose" in verdict(backlash)
    assert "EA0C" in verdict(backlash)
    for changed, said in (
        ({"chi2_dof": 1.08, "dof": 20000.0}, "almost down to the declared noise"),
        ({"chi2_dof": 0.5}, "the declared noise is probably too large"),
        ({"dof": 1.0}, "too few readings"),
    ):
        assert said in verdict(replace(static, **changed))
    assert verdict(replace(static, converged=False)).startswith("The fit did not converge")
    left_out = replace(
        static, outliers=(Outlier("nest1", 3, "dx_um", 80.0, 200.0),), rms={"um": 11.1}, rms_kept={"um": 0.06}
    )
    assert "residual RMS 0.06 µm (11.1 µm with the excluded outliers), χ²/dof" in verdict(left_out)
    assert re.search("EA0C .* orientation of axis C about X", identification_text(static))


def test_few_poses_are_points_with_their_number(small):
    figure = residuals_over_time(small)
    first = small.model.campaign.runs[0]
    axes = panels(figure)[0]
    lines = [line for line in axes.lines if line.get_gid()]
    assert lines and all(line.get_linestyle() == "None" and line.get_marker() == "o" for line in lines)
    assert len(lines[0].get_xdata()) == first.rows and axes.collections, "a stem for each pose"
    assert "number of the pose" in texts(figure) and "time in the run" not in texts(figure)


@pytest.mark.parametrize(
    ("name", "words"), [("residuals-over-time", "[^<:]*"), ("residuals-over-coordinates", r", C −?[\d.]+ °")]
)
def test_hovering_tells_pose_line_and_residual(small, page_of_small, name: str, words: str):
    drawn = page_of_small.partition(f'<figure id="{name}"')[2].partition("</figure>")[0]
    said = re.findall("<title>([^<]*)</title></use>", drawn)
    assert len(said) == sum(run.rows for run in small.model.campaign.runs)
    assert all(re.fullmatch(rf"[\w-]+, pose \d+ \(line \d+\){words}: .*dL −?[\d.]+ µm", tip) for tip in said), said[0]


def test_what_identify_prints_has_a_verdict_and_the_band(small):
    said = identification_text(small)
    assert verdict(small).startswith("The model ") and max(map(len, said.partition("\n\n")[0].splitlines())) <= 100
    assert "noise alone gives 1 ± " in said and "e-" not in said
    assert all(re.search(rf"^{re.escape(p.name)} .* µ", said, re.M) for p in small.parameters if p.run is None)


def test_lost_rows_are_named_by_file_and_row(static):
    campaign = static.model.campaign
    assert gap_table(campaign) == ""
    run = campaign.runs[0]
    time = np.arange(run.rows) * 0.01
    time[20:] += 0.05
    dynamic = replace(run, sampling="dynamic", time=time)
    said = Page(gap_table(replace(campaign, runs=(dynamic,)))).words
    assert "nest1.csv" in said and "60" in said and "rows lost" in said


def test_identification_report_draws_each_figure_once(static, tmp_path, monkeypatch):
    counted = []

    def counting(drawing):
        return replace(drawing, draw=lambda result: counted.append(drawing.name) or drawing.draw(result))

    wanted = ("residual-spectrum",)
    monkeypatch.setattr(_report, "FIGURES", [counting(d) for d in _report.FIGURES if d.name in wanted])
    identification_report(static, tmp_path, figures=tmp_path / "figures")
    assert counted == list(wanted)
    assert sorted(p.name for p in (tmp_path / "figures").iterdir()) == ["residual-spectrum.png"]
    saved = save_figures(static, tmp_path / "figures")
    assert [p.stem for p in saved] == list(wanted)

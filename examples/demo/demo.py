"""The main job from end to end, on one machine: `python3 go.py demo` (or `python examples/demo/demo.py`).

The measurement of a tilting rotary table is planned and done in simulation; its errors are identified with their
uncertainties and predict a run that the fit has not seen. Then the same machine sags under gravity, which its baseline
model does not know, and the diagnosis has to find out. Where the public recording of a real drive is at hand, its mass
and friction are identified too. Pictures and results go to `demo-results/`.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from symfive.campaign import Campaign, write_campaign
from symfive.convert import convert
from symfive.design import Plan, plan
from symfive.diagnose import Diagnosis, diagnose
from symfive.drawing.render import rendered
from symfive.effects import make_effect
from symfive.errors import InputError
from symfive.identify import Identification, Prediction, fitted_model, identify, predict
from symfive.machine import Machine, preset
from symfive.model import write_model
from symfive.outputs import write_bytes, write_json
from symfive.procedures import campaign_of, planar_circle, r_test_grid, rotary_circle
from symfive.report import (
    diagnosis_report,
    identification_report,
    plot_signature,
    prediction_chart,
    residuals_over_coordinates,
    save_figures,
)
from symfive.simulate import Simulation, simulate

SEED = 7
SAG = make_effect("gravity_sag", "B", component="EXB")
SAG_UM = {"gravity_sag.B.EXB.sin": 9.0, "gravity_sag.B.EXB.one_minus_cos": 4.0}
"""What the concealed sag does: µm at a full change of gravity, horizontally and vertically."""
PUBLISHED = {"mass": 95.11, "viscous": 203.5, "coulomb": 20.39, "offset": -3.16}
"""Least-squares values of A. Janot, M. Gautier & M. Brunot 2019 for the EMPS recording: kg, N s/m, N, N."""
UNITS = {"um": "µm", "urad": "µrad", "deg": "°"}


def make_plan(machine: Machine, *, points: int = 40, rate_hz: float = 10.0) -> tuple[Plan, Campaign]:
    """R-test poses chosen for what they tell, and with them ball-bar circles of C and in the XY plane."""
    chosen = plan(machine, instrument="r_test", points=points, noise_um=0.4, starts=1)
    runs = (
        *chosen.campaign.runs,
        *rotary_circle(machine, axis="C", rate_hz=rate_hz),
        *planar_circle(machine, plane="XY", feed=2000.0, rate_hz=rate_hz),
    )
    return chosen, campaign_of(machine, runs, name="demo")


def held_out(machine: Machine, truth: Mapping[str, float], *, rate_hz: float = 10.0, seed: int = SEED + 1) -> Campaign:
    """A circle in another plane, measured on the same machine, that the fit does not see."""
    runs = planar_circle(machine, plane="ZX", feed=2000.0, rate_hz=rate_hz, direction="ccw")
    machine_only = {name: value for name, value in truth.items() if not name.startswith("setup.")}
    return simulate(campaign_of(machine, runs, name="held-out"), truth=machine_only, seed=seed).campaign


def table_of_errors(result: Identification, truth: Mapping[str, float]) -> list[str]:
    """Identified location errors with 95 % bands beside the truth, as lines of text."""
    lines = [f"  {'error':<6} {'identified':>12} {'95 % band':>22} {'truth':>10}"]
    for parameter in result.parameters:
        if parameter.kind == "location_error":
            name, unit = parameter.name, UNITS[parameter.unit]
            low, high = result.interval(name)
            lines.append(
                f"  {name:<6} {result[name]:9.2f} {unit:<4} [{low:8.2f}, {high:8.2f}] {unit:<4} {truth[name]:7.2f} {unit}"
            )
    return lines


def share_covered(result: Identification, truth: Mapping[str, float]) -> tuple[int, int]:
    """How many of the machine's parameters have their true value inside the 95 % band, of how many."""
    names = [p.name for p in result.parameters if p.run is None]
    inside = [low <= truth[name] <= high for name in names for low, high in [result.interval(name)]]
    return sum(inside), len(inside)


def conceal(machine: Machine, *, step_deg: float = 30.0, seed: int = SEED + 2) -> Simulation:
    """R-tests over a grid of B and C on the same machine, sagging; its baseline knows location errors only."""
    rigid = replace(machine, errors={term.name: term for term in machine.location_errors})
    campaign = campaign_of(rigid, r_test_grid(rigid, step_deg=step_deg), name="sagging")
    return simulate(campaign, truth=SAG_UM, effects=[SAG], seed=seed)


def lines_of_diagnosis(found: Diagnosis, truth: Mapping[str, float]) -> list[str]:
    """What was found, how well it explains the readings, and how the geometry moved."""
    fit = found.fit
    lines = [f"  {found.summary}", f"  residual rms {fit.rms_before_um:.2f} µm before, {fit.rms_after_um:.2f} µm after"]
    before, after = fit.heldout_rms_before_um, fit.heldout_rms_after_um
    if before is not None and after is not None:
        lines.append(f"  runs left out in turn: rms {before:.2f} µm before, {after:.2f} µm after")
    lines.append(f"  noise of one reading {found.noise_um:.2f} µm")
    units = {p.name: UNITS.get(p.unit, p.unit) for p in found.after.parameters}
    for finding in found.findings:
        for name, (old, new) in finding.moved.items():
            lines.append(
                f"  {name} moved from {old:.1f} to {new:.1f} {units[name]}, true {truth[name]:.1f} {units[name]}"
            )
    return lines


def real_drive(data: Path | None = None) -> Identification:
    """Mass, friction and offset of the EMPS axis from its recording. Raises `InputError` where that is absent."""
    return identify(convert("emps", data))


def lines_of_drive(result: Identification) -> list[str]:
    """Identified beside published values, 1σ, and the force that the four terms leave over."""
    lines = []
    for parameter in (p for p in result.parameters if p.kind == "drive"):
        term, name, unit = parameter.name.rsplit(".", 1)[-1], parameter.name, parameter.unit
        value, std = result[name], result.uncertainty(name)
        lines.append(f"  {term:<8} {value:8.2f} ± {std:.2f} {unit:<6} (published {PUBLISHED[term]:g} {unit})")
    run = result.model.campaign.runs[0]
    names = [column.name for column in result.model.columns(run)]
    force = result.residuals[run.id][:, names.index("X_force_N")]
    lines.append(f"  force residual {np.sqrt(np.mean(force**2)):.2f} N rms over {run.rows} rows")
    return lines


def save_picture(figure: Figure, path: Path) -> None:
    """One figure as PNG; `figure.savefig` lays it out and draws it twice."""
    write_bytes(path, rendered(figure, "png", {}, 110.0))


def save_identification(result: Identification, folder: Path) -> None:
    """The identification as data, model, page and figures."""
    write_json(folder / "identification.json", result.to_data())
    write_model(fitted_model(result), folder / "model.json")
    identification_report(result, folder, figures=folder / "figures")


def save_prediction(prediction: Prediction, measured: Campaign, folder: Path) -> None:
    """Measured and predicted readings of each held-out run as a picture."""
    folder.mkdir(parents=True, exist_ok=True)
    for run in measured.runs:
        other = prediction.campaign.run(run.id)
        names = list(run.readings)
        figure = prediction_chart(
            np.stack([run.readings[name] for name in names], axis=1),
            np.stack([other.readings[name] for name in names], axis=1),
            at=run.time, along="time / s", names=names, noise=run.noise(run.instrument[0]), title=f"held-out run {run.id}",
        )  # fmt: skip
        save_picture(figure, folder / f"held-out-{run.id}.png")


def save_diagnosis(found: Diagnosis, folder: Path) -> None:
    """The diagnosis as data and page, the residuals over the axes before and after, what the sag does by itself."""
    write_json(folder / "diagnosis.json", found.to_data())
    diagnosis_report(found, folder)
    save_picture(residuals_over_coordinates(found.before), folder / "residuals-before.png")
    save_picture(residuals_over_coordinates(found.after), folder / "residuals-after.png")
    save_picture(plot_signature(SAG, found.before.model.campaign), folder / "signature-of-the-sag.png")


def main(arguments: list[str] | None = None) -> int:
    """Run the story and say what comes out."""
    parser = argparse.ArgumentParser(description="From a machine file to identified errors and a diagnosis.")
    parser.add_argument("-o", "--output", type=Path, default=Path("demo-results"), help="folder for the results")
    folder: Path = parser.parse_args(arguments).output
    begin = time.perf_counter()

    machine = preset("table-bc")
    print(f"1 Machine: {machine.name}, {machine.structure.code}")
    chosen, campaign = make_plan(machine)
    minutes = sum(run.duration for run in campaign.runs) / 60.0
    print(f"2 Plan: {len(campaign.runs)} runs, {campaign.rows} rows, {minutes:.0f} min of measuring")
    share = 100.0 * chosen.certificate.efficiency
    print(
        f"  R-test poses: certified to reach {share:.1f} % of what the best {chosen.certificate.points} poses determine"
    )
    measured = simulate(campaign, seed=SEED)
    write_campaign(measured.campaign, folder / "measured", overwrite=True)
    print(f"3 Measured in simulation with drawn errors and white noise (seed {SEED}): {folder / 'measured'}")

    result = identify(measured.campaign)
    print("4 Identified location errors (all parameters in identification.json)")
    print("\n".join(table_of_errors(result, measured.truth)))
    inside, count = share_covered(result, measured.truth)
    print(f"  {inside} of {count} true values lie inside their 95 % band")
    print(f"  residual rms {result.rms_um:.3f} µm, chi²/dof {result.chi2_dof:.3f} against the declared noise")
    save_identification(result, folder / "identified")

    check = held_out(machine, measured.truth)
    prediction = predict(fitted_model(result), check)
    print("5 Prediction of runs that were not fitted (only their set-up is)")
    for run in check.runs:
        print(f"  {run.id}: rms {prediction.rms[run.id]:.3f} µm, noise {run.noise(run.instrument[0]):.3f} µm")
    save_prediction(prediction, check, folder / "predicted")

    sizes = ", ".join(f"{name.rsplit('.', 1)[-1]} {value:g} µm" for name, value in SAG_UM.items())
    print(f"6 Concealed: the table sags along x as B tilts ({sizes}). The baseline holds location errors only.")
    sagging = conceal(machine)
    found = diagnose(sagging.campaign)
    print("\n".join(lines_of_diagnosis(found, sagging.truth)))
    save_diagnosis(found, folder / "diagnosed")

    print("7 A real drive: EMPS ball-screw axis (A. Janot, M. Gautier & M. Brunot 2019)")
    try:
        drive = real_drive()
        print("\n".join(lines_of_drive(drive)))
        save_figures(drive, folder / "drive")
    except InputError:
        print("  Skipped (optional): real recordings are not on this computer.")

    print(f"Done in {time.perf_counter() - begin:.0f} s. Pictures and data: {folder.resolve()}")
    return 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except InputError as error:
        sys.exit(f"demo: {error}")

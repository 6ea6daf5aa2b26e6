"""Instruments in motion against themselves at rest in the same minutes, and what the independent plant says of the promised 1σ.

    python benchmarks/sweeps.py                      # two criteria, five machines, 40 machines drawn from the priors for each
    python benchmarks/sweeps.py --quick              # one machine, 5 drawn
    python benchmarks/sweeps.py table-bc --minutes 8
    python benchmarks/sweeps.py table-bc --instrument ball_bar --poses 48

By machine and criterion: the certified efficiency of the sweeps, and how many times as large the variance (criterion, per
parameter) of the plan at rest is, by `assess` with white noise only (which favours it), and of poses with weights of any size;
`--poses`: the plan at rest has so many, in as many minutes as they take.
Then the plant (`tests/plant`: own chain, own drives) draws errors and set-up from the priors, position gains (10 %), a delay
(5 ms) and slow noise (0.3 µm, 1 s), reads the recording, and symfive identifies: rms of errors over stated and over promised
1σ, and the share of 95 % intervals that hold the truth.
"""

from __future__ import annotations

import argparse
import copy
import math
import sys

import numpy as np
from parts import UNKNOWN_UM, Array, Plant, simulate_run
from plant import NoiseOptions
from timing import timed

from symfive.campaign import Campaign
from symfive.design import Assessment, SweepPlan, plan, plan_sweeps
from symfive.identify import identify
from symfive.machine import preset

MACHINES = ("table-bc", "head-bc", "nutating-table", "tsutsumi-2007", "oyama-2010")
GAIN, DELAY_MS, NOISE = 0.1, 5.0, NoiseOptions(coloured_um=0.3, correlation_s=1.0)
FINE = 5


def size(assessment: Assessment, criterion: str) -> float:
    """ψ of all errors of the machine."""
    place = [i for i, p in enumerate(assessment.parameters) if p.kind not in ("setup", "effect")]
    scale = np.array([assessment.parameters[i].sigma for i in place])
    S = assessment.covariance[np.ix_(place, place)] / np.outer(scale, scale)
    return float(np.linalg.slogdet(S)[1]) / len(place) if criterion == "D" else math.log(np.trace(S) / len(place))


def read(plant: Plant, made: SweepPlan, names: list[str], seed: int) -> tuple[Campaign, dict[str, float]]:
    """The recordings with readings, and the errors that made them."""
    generator = np.random.default_rng(seed)
    truth, data = plant.drawn(names, generator), copy.deepcopy(plant.data)
    for axis in data["axes"].values():
        if "drive" in axis:
            axis["drive"]["position_gain"] *= 1.0 + GAIN * generator.standard_normal()
    runs = []
    for number, run in enumerate(made.campaign.runs):
        bar, sigma = run.length is not None, run.setup_sigma_um
        spec = {
            "id": run.id, "instrument": run.instrument[0], "sampling": "dynamic", "t_s": run.time, "command": run.commands,
            "table_ball": run.table_ball, "tool_ball": run.tool_ball, "noise_um": run.noise_um, "length": run.length or 0.0,
            "setup_um": {
                "table_ball": list(bar * sigma.table_ball * generator.standard_normal(3)),
                "length": bar * sigma.length * generator.standard_normal(),
                "zero": [] if bar else list(UNKNOWN_UM * generator.standard_normal(3)),
                "tool_ball": list(sigma.tool * generator.standard_normal(3)),
            },
        }  # fmt: skip
        delay = {"effect": "latency", "delay_ms": DELAY_MS * generator.standard_normal()}
        values = simulate_run(
            data, spec, plant.location(truth), plant.motions(truth), [delay], seed=1000 * number + seed, noise_options=NOISE,
            oversample=FINE,
        ).values  # fmt: skip
        columns = ("dL_um",) if bar else ("dx_um", "dy_um", "dz_um")
        runs.append(run.with_readings(dict(zip(columns, values.T, strict=True))))
    return Campaign(machine=made.campaign.machine, runs=tuple(runs)), truth


def covered(plant: Plant, made: SweepPlan, machines: int) -> tuple[float, float, float]:
    """Root mean squares of errors over stated and promised 1σ, share within 95 % intervals."""
    names = [p.name for p in made.assessment.parameters if p.kind not in ("setup", "effect")]
    stated, promised = np.zeros((2, machines, len(names)))
    for seed in range(machines):
        campaign, truth = read(plant, made, names, seed)
        found = identify(campaign, effects=made.effects)
        off: Array = np.array([found[name] - truth[name] for name in names])
        stated[seed] = off / [found.uncertainty(name) for name in names]
        promised[seed] = off / [made.assessment.sigma[name] for name in names]
    return (
        float(np.sqrt(np.mean(stated**2))),
        float(np.sqrt(np.mean(promised**2))),
        float(np.mean(np.abs(stated) < 1.96)),
    )


def compare(name: str, instrument: str, minutes: float, poses: int | None, machines: int) -> None:
    """The rows of one machine; `poses` at rest, or as many as take as long."""
    plant = Plant(preset(name))
    for criterion in ("D", "A"):
        options = {"instrument": instrument, "minutes": minutes, "criterion": criterion}
        spent, made = timed(lambda: plan_sweeps(name, **options), 1)  # noqa: B023
        assert made.certificate is not None
        rest = plan(
            name, instrument=instrument, minutes=None if poses else minutes, points=poses or 200, starts=1,
            criterion=criterion, anywhere=False, prove=False,
        )  # fmt: skip
        ratio = math.exp(size(rest.assessment, criterion) - size(made.assessment, criterion))
        stated, promised, share = covered(plant, made, machines)
        print(
            f"{name:15} {criterion} {sum(len(s) - 1 for s in made.stops):4d} sweeps in {len(made.stops)} {made.minutes:5.1f} min "
            f"≥ {made.certificate.efficiency:.3f} | "
            f"{rest.certificate.points:3d} poses {rest.minutes:5.1f} min {ratio:6.2f} (any weights {made.at_rest:.2f}) | "
            f"{stated:.3f} {promised:.3f} {100.0 * share:5.1f} % | {spent:4.0f} s",
            flush=True,
        )


def main(arguments: list[str] | None = None) -> int:
    """Parse the options and measure."""
    parser = argparse.ArgumentParser(
        description="Instruments in motion against those at rest, by the independent plant."
    )
    parser.add_argument("machines", nargs="*", default=list(MACHINES), help="presets with two rotary axes")
    parser.add_argument("--instrument", default="r_test", choices=("r_test", "ball_bar"))
    parser.add_argument("--poses", type=int, help="of the plan at rest (default: as many as take the same minutes)")
    parser.add_argument("--minutes", type=float, default=8.0)
    parser.add_argument("--drawn", type=int, default=40, help="machines drawn for each plan")
    parser.add_argument("--quick", action="store_true", help="one machine, 5 drawn")
    options = parser.parse_args(arguments)
    drawn = 5 if options.quick else options.drawn
    print(
        f"{options.minutes:g} min; {drawn} machines drawn; rms of errors over stated and promised 1σ, within 95 % intervals"
    )
    for name in options.machines[: 1 if options.quick else None]:
        compare(name, options.instrument, options.minutes, options.poses, drawn)
    return 0


if __name__ == "__main__":
    sys.exit(main())

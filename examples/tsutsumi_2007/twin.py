"""The same machine in symfive: its preset, its effects, and recordings of the paper's drives on symfive's plans."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from symfive.campaign import Campaign, Run, SetupSigma
from symfive.effects import Effect, make_effect
from symfive.machine import Machine, preset
from symfive.model import Model
from symfive.procedures import campaign_of, synchronous_circle

from .drives import PAPER, Drives, behind_the_gear, driven
from .path import Circle
from .readings import Case, bar_um

Array = NDArray[np.float64]
BASELINE = ("EX0C", "EY0C", "EXX")
"""What the baseline may vary: the paper's dx and dy, and the scale of X."""
SETUP = SetupSigma(table_ball=40.0, tool_ball=1.0, length=0.5)
"""µm: the table's ball is laid on the tool's, so it shares the eccentricity; the tool's ball is trued to the spindle."""
RUN_UP_DEG = 20.0
STEP_S = 1e-4
AMID = 0.5
"""Where in its play C begins a recording."""


def paper_machine() -> Machine:
    """ZX/YAC with the drives of table 1, its C axis beside the machine's origin, all else square and straight."""
    machine = preset("tsutsumi-2007")
    return replace(machine, errors={name: machine.errors[name] for name in BASELINE})


def plan(machine: Machine, x_t: Sequence[float], *, direction: str = "both", rate_hz: float = 20.0) -> Campaign:
    """The paper's circles (r = 50 mm, 1000 mm/min) as a campaign without readings."""
    runs: list[Run] = []
    for place in x_t:
        runs += synchronous_circle(
            machine, x_t=place, radius=50.0, feed=1000.0, direction=direction, run_up_deg=RUN_UP_DEG, rate_hz=rate_hz,
            setup_sigma_um=SETUP,
        )  # fmt: skip
    return campaign_of(machine, runs, name="synchronous circles")


def circle_of(run: Run) -> Circle:
    """The circle of a run (its feed is not needed where commands are given)."""
    return Circle(run.table_ball[0], float(run.length or 0.0), direction=-1 if run.id.endswith("-cw") else 1)


def phi_deg(run: Run) -> Array:
    """φ degree (N,) of a run's commands, continuous, 0…360 in its lap."""
    x, c = run.commands["X"], np.radians(run.commands["C"])
    phi = np.degrees(np.unwrap(np.arctan2(x * np.sin(c), x * np.cos(c) - run.table_ball[0])))
    return phi + (360.0 if circle_of(run).direction < 0 else 0.0)


@dataclass(frozen=True, kw_only=True)
class Concealed:
    """What a recorded machine really is: its `drives`, with (`hard`) friction, worm and play or without, its eccentricity
    `dx_um` and `dy_um`, the `seed` of the noise."""

    drives: Drives = PAPER
    hard: bool = True
    dx_um: float = 0.0
    dy_um: float = 0.0
    seed: int = 1

    def case(self, run: Run) -> Case:
        """What to simulate in a run."""
        return Case(circle_of(run), self.drives, friction=self.hard, worm=self.hard, play=self.hard)


def _outputs(jobs: Sequence[tuple[Run, Case]]) -> list[tuple[Array, Array]]:
    """X_out mm and C_out rad (N,) for every run and case; the runs must have one rate and as many rows each."""
    first = jobs[0][0].time
    commands = [run.commands["X"] for run, _ in jobs] + [np.radians(run.commands["C"]) for run, _ in jobs]
    loops = [case.loop("x") for _, case in jobs] + [case.loop("c") for _, case in jobs]
    moved = driven(loops, np.column_stack(commands), float(first[1] - first[0]), step_s=STEP_S, moving=False)
    return [
        (moved[:, k], behind_the_gear(moved[:, len(jobs) + k], case.gear, start=AMID))
        for k, (_, case) in enumerate(jobs)
    ]


def recorded(plan: Campaign, machines: Sequence[Concealed]) -> tuple[Campaign, ...]:
    """The plan with readings of each of the machines, by the paper's drives, with white noise."""
    jobs = [(run, machine.case(run)) for machine in machines for run in plan.runs]
    outputs = iter(_outputs(jobs))
    campaigns = []
    for machine in machines:
        generator = np.random.default_rng(machine.seed)
        runs = []
        for run in plan.runs:
            x, c = next(outputs)
            um = bar_um(x, c, circle_of(run), dx_um=machine.dx_um, dy_um=machine.dy_um)
            runs.append(run.with_readings({"dL_um": um + run.noise("ball_bar") * generator.standard_normal(run.rows)}))
        campaigns.append(replace(plan, runs=tuple(runs)))
    return tuple(campaigns)


def every(campaign: Campaign, rows: int) -> Campaign:
    """The same recordings kept at every so many rows: the machine moved as before, the file knows less of its path."""
    kept = slice(None, None, rows)
    runs = [
        replace(
            run, time=run.time[kept], commands={name: values[kept] for name, values in run.commands.items()},
            readings={name: values[kept] for name, values in run.readings.items()},
        )
        for run in campaign.runs
    ]  # fmt: skip
    return replace(campaign, runs=tuple(runs))


def effects_of(case: Case) -> tuple[tuple[Effect, ...], dict[str, float]]:
    """What of `case` symfive's baseline does not hold, as effects, and their parameters in the file's units."""
    effects: list[Effect] = []
    values: dict[str, float] = {}
    gear = case.gear
    if case.friction:
        effects += [make_effect("friction", "X"), make_effect("friction", "C")]
        values |= {"friction.X.coulomb": case.drives.x.coulomb, "friction.C.coulomb": case.drives.c.coulomb}
    if gear.fluctuation:
        effects.append(make_effect("transmission_error", "C", period=360.0 / gear.teeth))
        values |= {"transmission_error.C.sin": 1e6 * gear.fluctuation, "transmission_error.C.cos": 0.0}
    if gear.backlash:
        effects.append(make_effect("backlash", "C"))
        values["backlash.C.width"] = 1e6 * gear.backlash
    return tuple(effects), values


def chain_gap_um(dx_um: float, dy_um: float) -> float:
    """Largest difference of (11) to (13) from symfive's exact chain over a commanded circle at X_T/r = 0.9, µm.

    The axes follow their commands; the table's ball lies where the tool's ball was at C = 0.
    """
    machine = without_drives(paper_machine())
    [run] = plan(machine, [45.0], direction="ccw").runs
    model = Model(campaign_of(machine, [run]))
    [run] = model.campaign.runs
    ball = f"setup.{run.id}.table_ball"
    values = {"EX0C": dx_um, "EY0C": dy_um, f"{ball}.x": -dx_um, f"{ball}.y": -dy_um}
    ours = model.predict_run(run, model.vector(values))[:, 0]
    theirs = bar_um(run.commands["X"], np.radians(run.commands["C"]), circle_of(run), dx_um=dx_um, dy_um=dy_um)
    return float(np.abs(ours - theirs).max())


def without_drives(machine: Machine) -> Machine:
    """The machine whose axes are where they are commanded to be: what a fit of the geometry alone believes."""
    return replace(machine, axes={name: replace(axis, drive=None) for name, axis in machine.axes.items()})


@dataclass(frozen=True)
class Comparison:
    """symfive beside the paper's drives over φ `deg` (N,) in [0, 360]: `ours` and `theirs` µm (N,), and the `play_um` (N,)
    by which the paper's play, which touches on the positive flank, turns the table by b/2 from symfive's, which is centred."""

    deg: Array
    ours: Array
    theirs: Array
    play_um: Array

    @property
    def left_um(self) -> Array:
        """What differs beside that turn, µm (N,)."""
        return self.ours - self.theirs + self.play_um

    @property
    def worst_um(self) -> float:
        """Its largest magnitude, µm."""
        return float(np.abs(self.left_um).max())

    @property
    def where_deg(self) -> float:
        """φ of that, degree."""
        return float(self.deg[np.argmax(np.abs(self.left_um))])


def compare(cases: Sequence[Case], *, rate_hz: float = 100.0) -> tuple[Comparison, ...]:
    """A lap of each case by symfive and by the example's drives, on the same commanded rows, without noise."""
    machine = paper_machine()
    runs = [
        plan(machine, [case.circle.x_t], direction="ccw" if case.circle.direction > 0 else "cw", rate_hz=rate_hz).runs[
            0
        ]
        for case in cases
    ]
    found = []
    jobs = list(zip(runs, cases, strict=True))
    for (run, case), (x, c) in zip(jobs, _outputs(jobs), strict=True):
        effects, values = effects_of(case)
        model = Model(campaign_of(machine, [run]), effects)
        ours = model.predict_run(model.campaign.runs[0], model.vector(values))[:, 0]
        theirs = bar_um(x, c, case.circle)
        play = theirs - bar_um(x, c - case.gear.backlash / 2.0, case.circle)
        deg = phi_deg(run)
        lap = (deg >= 0.0) & (deg <= 360.0)
        found.append(Comparison(deg[lap], ours[lap], theirs[lap], play[lap]))
    return tuple(found)

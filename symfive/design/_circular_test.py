"""The circular test of ISO 230-4 as a plan: circles in planes of the linear axes, both directions, at one or more feeds."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from symfive.campaign import Campaign, Run
from symfive.design._assess import Assessment, assess, assessment_data
from symfive.design._circle_words import sigma_words
from symfive.design._sweeps import SLOW_S, noise_data, nuisances, recording_noise, without_drive
from symfive.design._write import SCHEMA, Written, write_recordings
from symfive.effects import Effect
from symfive.errors import InputError
from symfive.given import machine_given
from symfive.inference import Noise
from symfive.machine import Machine
from symfive.model import effect_to_data
from symfive.nc import Post
from symfive.procedures import campaign_of, left_in_place, planar_circle
from symfive.screen import listed
from symfive.threads import one_thread

WHOLE_DEG = 360.0
SEEN = 0.5
"""What a test tells: 1σ at most this share of the prior's."""


@dataclass(frozen=True, repr=False)
class CircularTest(Written):
    """A circular test: the `campaign` without readings; its `assessment`, with lag of the drives as a nuisance
    (`effects`, to be identified too) and correlated `noise`; `notes` in plain words."""

    campaign: Campaign
    effects: tuple[Effect, ...]
    noise: Noise
    assessment: Assessment
    notes: tuple[str, ...] = ()

    @property
    def minutes(self) -> float:
        """Time of the recordings, without set-up."""
        return sum(run.duration for run in self.campaign.runs) / 60.0

    def to_data(self) -> dict[str, Any]:
        """plan.json as nested mappings."""
        return {
            "schema": SCHEMA, "machine": self.campaign.machine.name, "minutes": self.minutes,
            "noise": noise_data(self.noise), "effects": [effect_to_data(effect) for effect in self.effects],
            **assessment_data(self.assessment), "notes": list(self.notes),
        }  # fmt: skip

    def _write_into(self, folder: Path, nc: tuple[str, ...], post: Post | None) -> None:
        write_recordings(self.campaign, self.assessment, self.to_data(), folder, nc, post)

    def __str__(self) -> str:
        lines = [f"circular test, {len(self.campaign.runs)} recordings, {self.minutes:.1f} min without set-up"]
        lines += listed([f"  {run.id}: {_words(run)}" for run in self.campaign.runs], "test.campaign.runs")
        sigma = self.assessment.sigma
        determined = [p for p in self.assessment.parameters if p.kind != "setup" and sigma[p.name] < SEEN * p.sigma]
        lines += sigma_words(determined, sigma)
        return "\n".join([*lines, *self.notes])


def _words(run: Run) -> str:
    x, y, z = (round(v, 3) + 0.0 for v in run.table_ball)
    return f"bar {run.length:g} mm, table ball at ({x:g}, {y:g}, {z:g}) mm, {run.duration:.0f} s"


@one_thread
def circular_test(
    machine: Machine | Path | str, *, planes: Sequence[str] = ("XY",), feeds: Sequence[float] = (1000.0,),
    radius: float | None = None, sweep_deg: float | None = None, centre: Sequence[float] | None = None,
    noise_um: float = 0.3, coloured_um: float | None = None, correlation_s: float = SLOW_S, rate_hz: float = 50.0,
) -> CircularTest:  # fmt: skip
    """Circles by the control's own interpolation in each of `planes`, at each of `feeds` (mm/min), in both directions.

    `radius` mm, the bar's length; `sweep_deg` of the data: 360 for the full circle of ISO 230-4, 220 where the table or a limit
    of travel is in the way (default: 360 in XY, 220 in the vertical planes); `centre` mm, the table ball in the workpiece frame;
    `noise_um`, `coloured_um` and `correlation_s` as in `plan_sweeps`.
    Raises `InputError` where an axis cannot follow or has too little travel.
    """
    machine, noise = machine_given(machine), recording_noise(noise_um, coloured_um, correlation_s)
    if not planes or not feeds:
        raise InputError("a circular test needs a plane and a feed", remedy="give XY and 1000 mm/min")
    if len(set(planes)) < len(planes) or len(set(feeds)) < len(feeds):
        raise InputError("a plane or a feed is named twice", remedy="name each once")
    runs = [
        run
        for plane in planes
        for run in planar_circle(
            machine, plane=plane, radius=radius, feed=tuple(feeds), sweep_deg=sweep_deg, centre=centre, rate_hz=rate_hz,
            noise_um=noise_um,
        )
    ]  # fmt: skip
    campaign = campaign_of(machine, [*left_in_place(runs)], "circular test")
    effects = nuisances(machine, delay=False)
    expected = assess(campaign, effects=effects, noise=noise)
    return CircularTest(campaign, effects, noise, expected, tuple(_notes(machine, runs)))


def _notes(machine: Machine, runs: Sequence[Run]) -> Iterable[str]:
    """Which of the circles are no test by the standard, and how to identify them."""
    from symfive.circles import CircleFinder

    finder = CircleFinder(machine)
    short = [run.id for run in runs if (circle := finder.find(run)) is not None and circle.turns < 1.0]
    if short:
        yield f"partial arcs, not a circular test by ISO 230-4, which has {WHOLE_DEG:g}°: {', '.join(short)}"
    yield from without_drive(machine)
    yield "identify with --effects plan.json: lag of the drives is estimated with the geometry"

"""Recordings of the independent plant with its effects, and their diagnoses."""

from pathlib import Path

import numpy as np
import plant
import pytest

from examples.blind_study.cases import Case, write_case
from symfive.campaign import Campaign, read_campaign
from symfive.diagnose import Diagnosis, diagnose


def wrong(what: str) -> pytest.MarkDecorator:
    """What the diagnosis does instead of what it should, until it is mended."""
    return pytest.mark.xfail(strict=False, reason=f"not reached: {what}")


POSES = plant.grid_poses(np.arange(-90, 91, 30.0), np.arange(0, 331, 30.0))


def read_by_the_plant(
    folder: Path,
    machine: dict,
    runs: list[dict],
    effects: list[dict],
    seed: int = 5,
    options: plant.NoiseOptions | None = None,
    errors: dict[str, float] | None = None,
) -> Campaign:
    more = {} if options is None else {"noise_options": options}
    plant.write_campaign(folder, machine, runs, errors or {}, None, effects, seed=seed, **more)
    return read_campaign(folder)


def grid_runs(machine: dict, poses: np.ndarray = POSES) -> list[dict]:
    return [
        plant.r_test(machine, "nest1", nest=(90, -20, 50), poses=poses, start_s=0.0),
        plant.r_test(machine, "nest2", nest=(50, 40, 150), poses=poses, start_s=1500.0),
    ]


def bar_runs(machine: dict) -> list[dict]:
    """Three bars at rest."""
    return [
        plant.static_ball_bar(
            machine, f"bar-{word}", table_ball=ball, direction=way, poses=np.vstack([POSES, POSES[::-1]]), start_s=1500.0 * i,
            axes=("B", "C"), noise_um=0.3, length=100.0,
        )
        for i, (word, way, ball) in enumerate((
            ("x", (1.0, 0.0, 0.0), (0.0, 0.0, 140.0)), ("y", (0.0, 1.0, 0.0), (80.0, 0.0, 60.0)),
            ("z", (0.0, 0.0, 1.0), (60.0, 50.0, 40.0)),
        ))
    ]  # fmt: skip


def circle_runs(machine: dict, feeds: tuple[float, ...], **more: float) -> list[dict]:
    return [
        plant.planar_circle(machine, f"xy-f{f:g}-{'ccw' if d > 0 else 'cw'}", feed=f, direction=d, **more)
        for f in feeds
        for d in (1, -1)
    ]


def names_of(found: Diagnosis) -> list[tuple[str, str | None]]:
    return [(f.name, f.axis) for f in found.findings]


def diagnosed(case: Case, folder: Path) -> Diagnosis:
    write_case(case, folder)
    return diagnose(read_campaign(folder / "fit"))

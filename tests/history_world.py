"""Machines with a past, for the tests of the history: results as folders, or visits drawn from a linear test."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from symfive.history import MachineId, Visit
from symfive.machine import Machine, preset
from symfive.model import FittedModel, write_model

DAY = 86400.0
NAMES = ("EX0B", "EZ0B", "EA0B", "EC0B", "EX0C", "EY0C", "EA0C", "EB0C")
UNITS = tuple("urad" if name[1] in "ABC" else "um" for name in NAMES)
ANGLE = np.array([unit == "urad" for unit in UNITS])
PRIOR = np.where(ANGLE, 80.0, 40.0)


def results(folder: Path, number: int = 0, *, name: str = "plant", values: Sequence[float] | None = None) -> Path:
    """A folder of results as `identify` leaves it, without its figures; `number` makes it differ from others."""
    whole = preset("table-bc")
    terms = {n: t for n, t in whole.errors.items() if t.is_location and n in NAMES}
    machine: Machine = replace(whole, name=name, errors=terms, text="")
    names = tuple(terms)
    value = np.random.default_rng(number).normal(0.0, 5.0, len(names)) if values is None else np.asarray(values, float)
    std = dict.fromkeys(names, 0.3)
    units = {n: "urad" if t.angular else "um" for n, t in terms.items()}
    model = FittedModel(
        machine, (), dict(zip(names, map(float, value), strict=True)), std, units, names, 0.09 * np.eye(len(names))
    )
    folder.mkdir(parents=True)
    write_model(model, folder / "model.json")
    entries = {n: {"value": float(v), "std": 0.3, "unit": units[n], "prior": terms[n].sigma, "prior_mean": 0.0}
               for n, v in zip(names, value, strict=True)}  # fmt: skip
    data = {
        "schema": "symfive.identification/1",
        "parameters": entries,
        "rms_um": 0.4,
        "rms": {"um": 0.4},
        "chi2_dof": 1.0,
    }
    (folder / "identification.json").write_text(json.dumps(data))
    return folder


@dataclass
class Past:
    """A machine measured again and again by one linear test, µm and µrad: `ageing` a year, `seasons` per °C, `scatter` from visit
    to visit, steps as (visit, name, size)."""

    seed: int
    visits: int = 60
    days: float = 7.0
    ageing: float = 1.0
    seasons: float = 0.3
    scatter: float = 0.2
    steps: Sequence[tuple[int, str, float]] = ()
    blind: Sequence[str] = ()
    name: str = "plant"
    recorded: bool = True
    stage: dict[int, str] = field(default_factory=dict)

    def drawn(self) -> list[Visit]:
        """The visits; the test sees nothing of the errors in `blind` but their sum."""
        rng, k = np.random.default_rng(self.seed), len(NAMES)
        size = 1.0 + 9.0 * ANGLE
        slopes = rng.normal(size=(24, k)) / size
        for name in self.blind[1:]:
            slopes[:, NAMES.index(name)] = slopes[:, NAMES.index(self.blind[0])]
        covariance = np.linalg.inv(slopes.T @ slopes / 0.3**2 + np.diag(PRIOR**-2.0))
        begin, ageing = rng.normal(size=k) * 0.5 * PRIOR, rng.normal(size=k) * self.ageing * size
        seasons = rng.normal(size=k) * self.seasons * size
        machine = MachineId(name=self.name, structure="w C' B' X' Y' b Z t")
        found = []
        for number in range(self.visits):
            time = number * self.days * DAY
            years = time / (365.25 * DAY)
            warm = 20.0 + 6.0 * np.sin(2.0 * np.pi * years) + rng.normal()
            truth = begin + ageing * years + seasons * (warm - 20.0) + self.scatter * size * rng.normal(size=k)
            for at, name, step in self.steps:
                truth[NAMES.index(name)] += step * (number >= at)
            y = slopes @ truth + 0.3 * rng.normal(size=24)
            found.append(
                Visit(
                    machine=machine, time=time, results=f"{self.seed * 10_000 + number:064x}", names=NAMES, units=UNITS,
                    values=covariance @ slopes.T @ y / 0.3**2, priors=PRIOR, means=0.0 * PRIOR, covariance=covariance,
                    temperature=float(warm) if self.recorded else None, stage=self.stage.get(number, ""),
                )
            )  # fmt: skip
        return found

"""Readings that were taken in the same way: what they all show is the machine's and no accident of one of them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symfive.model import Model
from symfive.motion import approach
from symfive.runs import Run

__all__ = ["Alike", "alike", "repeats_say_so"]

Array = NDArray[np.float64]
Key = tuple[str, str]
POSE_DIGITS = 9


@dataclass(frozen=True)
class Alike:
    """Recordings of one instrument at one set-up: by recording, the number of what was done in each row (N,). Rows of all of
    them with the same number were read in the same way."""

    numbers: Mapping[Key, NDArray[np.int64]]

    def others(self, key: Key, row: int) -> Iterator[tuple[Key, NDArray[np.int64]]]:
        """The other rows that were read in the same way as one, by recording."""
        number = self.numbers[key][row]
        for other, numbers in self.numbers.items():
            rows = np.flatnonzero(numbers == number)
            yield other, rows[rows != row] if other == key else rows


def alike(model: Model, keys: Sequence[Key]) -> dict[Key, list[Alike]]:
    """In which ways each recording repeats itself or others: at rest by the pose and the sides from which its axes came, and by
    the pose alone; in motion row by row where whole runs repeat each other."""
    repeats = {id: group for group in model.campaign.repeats for id in group}
    groups: dict[object, list[Key]] = {}
    for id, instrument in keys:
        run = model.campaign.run(id)
        setting = repeats.get(id, id) if run.dynamic else _setting(run, model)
        groups.setdefault((instrument, setting), []).append((id, instrument))
    found: dict[Key, list[Alike]] = {key: [] for key in keys}
    for members in groups.values():
        runs = [model.campaign.run(id) for id, _ in members]
        for numbers in _in_motion(runs) if runs[0].dynamic else _at_rest(runs):
            same = Alike(dict(zip(members, numbers, strict=True)))
            for key in members:
                found[key].append(same)
    return found


def _setting(run: Run, model: Model) -> str:
    """What runs at rest have in common that can be compared reading by reading."""
    columns = tuple(column.name for column in model.columns(run))
    return repr((columns, run.table_ball, run.tool_ball, run.length, run.u, run.v))


def _at_rest(runs: Sequence[Run]) -> Iterator[list[NDArray[np.int64]]]:
    axes = list(runs[0].commands)
    poses = np.concatenate([np.stack([run.commands[a] for a in axes], axis=1) for run in runs])
    sides = np.concatenate([np.stack([approach(run.commands[a]) for a in axes], axis=1) for run in runs])
    ends = np.cumsum([run.rows for run in runs])[:-1]
    for table in (np.hstack([poses, sides]), poses):
        number = np.unique(np.round(table, POSE_DIGITS), axis=0, return_inverse=True)[1].reshape(-1)
        yield np.split(number.astype(np.int64), ends)


def _in_motion(runs: Sequence[Run]) -> Iterator[list[NDArray[np.int64]]]:
    if len(runs) > 1:
        yield [np.arange(run.rows) for run in runs]


def repeats_say_so(
    key: Key, row: int, column: int, innovations: Mapping[Key, Array], ways: Sequence[Alike], limit: float
) -> bool:
    """Whether most other readings of the same kind lie where one does that is beyond `limit` σ: beyond it too, to the same side,
    or no further than it from the one. `innovations` (N, ny) by recording, in σ."""
    own = float(innovations[key][row, column])
    least = min(limit, abs(own) - limit)
    for way in ways:
        others = [innovations[other][rows, column] for other, rows in way.others(key, row)]
        read = np.concatenate(others)
        if read.size and float(np.median(read)) * np.sign(own) > least:
            return True
    return False

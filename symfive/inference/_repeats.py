"""Readings that were taken in the same way: what they all show is the machine's and no accident of one of them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from symfive.arrays import Array, Indices
from symfive.inference._noise import Block, Key
from symfive.model import Model
from symfive.motion import approach
from symfive.runs import Run

POSE_DIGITS = 9
FEWEST = 3
"""Readings of one kind among which an odd one can be recognised."""
POLISHINGS = 10
EFFICIENCY = 0.37
"""Of the median absolute deviation beside the standard deviation (F. R. Hampel 1974): so many degrees of freedom count."""


@dataclass(frozen=True)
class Alike:
    """Recordings of one instrument at one set-up: by recording, the number of what was done in each row (N,). Rows of all of
    them with the same number were read in the same way."""

    numbers: Mapping[Key, Indices]

    def others(self, key: Key, row: int) -> Iterator[tuple[Key, Indices]]:
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


def _at_rest(runs: Sequence[Run]) -> Iterator[list[Indices]]:
    axes = list(runs[0].commands)
    poses = np.concatenate([np.stack([run.commands[a] for a in axes], axis=1) for run in runs])
    sides = np.concatenate([np.stack([approach(run.commands[a]) for a in axes], axis=1) for run in runs])
    ends = np.cumsum([run.rows for run in runs])[:-1]
    for table in (np.hstack([poses, sides]), poses):
        number = np.unique(np.round(table, POSE_DIGITS), axis=0, return_inverse=True)[1].reshape(-1)
        yield np.split(number.astype(np.int64), ends)


def _in_motion(runs: Sequence[Run]) -> Iterator[list[Indices]]:
    if len(runs) > 1:
        yield [np.arange(run.rows) for run in runs]


def contrasts(blocks: Mapping[Key, Block], repeats: Iterable[Sequence[str]]) -> list[Block]:
    """Orthonormal contrasts of repeated runs: what the model lacks and both share cancels."""
    found = []
    for group in repeats:
        for name in {instrument for _, instrument in blocks}:
            members = [blocks[run, name] for run in group if (run, name) in blocks]
            for count in range(1, len(members)):
                weights = np.array([1.0] * count + [-float(count)]) / np.sqrt(count * (count + 1.0))
                found.append(_contrast(members[: count + 1], weights))
    return found


def _contrast(blocks: Sequence[Block], weights: Array) -> Block:
    """The weighted sum of blocks with one shape, over the columns of all of them."""
    columns = np.unique(np.concatenate([b.columns for b in blocks]))
    residual = np.asarray(sum(w * b.residual for w, b in zip(weights, blocks, strict=True)))
    jacobian = np.zeros((*residual.shape, len(columns)))
    for w, b in zip(weights, blocks, strict=True):
        jacobian[:, :, np.searchsorted(columns, b.columns)] += w * b.jacobian
    left_out = np.any([b.left_out for b in blocks], axis=0)
    return Block(residual, jacobian, columns, blocks[0].interval, left_out)


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


def alone_among_repeats(
    residuals: Mapping[Key, Array], ways: Mapping[Key, Sequence[Alike]], least: Mapping[Key, float], level: float
) -> dict[Key, Array]:
    """By how much static readings differ from what the same place, reached from the same side, showed at other times (N, ny), in
    units of the limit that noise exceeds with probability `level`: beyond ±1 a reading stands alone, whatever the model lacks.

    Median polish (J. W. Tukey 1977) removes what all readings of a place share and what all of a recording share; the scale is
    the median absolute deviation of all that is left, at `least` the declared noise, the limit Student's.
    """
    found = {key: np.zeros(values.shape) for key, values in residuals.items()}
    same = {id(way): way for key in residuals for way in ways[key][:1]}
    for way in same.values():
        keys = list(way.numbers)
        number = np.concatenate([way.numbers[key] for key in keys])
        owner = np.repeat(np.arange(len(keys)), [len(way.numbers[key]) for key in keys])
        count = Counter(number.tolist())
        several = np.array([count[n] >= FEWEST for n in number.tolist()])
        if several.any():
            values = np.concatenate([residuals[key] for key in keys])
            beyond = np.zeros(values.shape)
            floor = max(least[key] for key in keys)
            for j in range(values.shape[1]):
                beyond[several, j] = _beyond(values[several, j], number[several], owner[several], floor, level)
            ends = np.cumsum([len(residuals[key]) for key in keys])[:-1]
            found |= dict(zip(keys, np.split(beyond, ends), strict=True))
    return found


def _beyond(values: Array, place: Indices, owner: Indices, floor: float, level: float) -> Array:
    """What median polish leaves of readings (n,), over the limit."""
    from scipy.special import stdtrit

    rest, groups = values.copy(), [np.unique(by, return_inverse=True)[1] for by in (place, owner)]
    for _ in range(POLISHINGS):
        for by in groups:
            order = np.argsort(by, kind="stable")
            medians = [float(np.median(rest[part])) for part in np.split(order, np.cumsum(np.bincount(by))[:-1])]
            rest -= np.array(medians)[by]
    dof = len(rest) - sum(int(by.max()) + 1 for by in groups) + 1
    if dof < 1:
        return np.zeros(len(rest))
    scale = max(1.4826 * float(np.median(np.abs(rest))) * (len(rest) / dof) ** 0.5, floor)
    limit = -float(stdtrit(max(EFFICIENCY * dof, 1.0), 0.5 * level / len(rest)))
    return np.asarray(rest / (scale * limit))

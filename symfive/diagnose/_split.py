"""Splits of a campaign: which readings are fitted, and which are held out to judge what was found."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from itertools import pairwise

import numpy as np

from symfive.arrays import Flags
from symfive.campaign import Campaign, Run
from symfive.diagnose._groups import kind_of
from symfive.errors import InputError
from symfive.importers import cycles_of
from symfive.instruments import instruments_of

Rows = Flags
SHOWN = 6
"""Held-out runs whose names are written out, at most."""
HOW = "write half, cycles, or runs:NAME,NAME with names or patterns (*) of runs"


@dataclass(frozen=True)
class Split:
    """A way to part a campaign: `learn` says of each run which of its rows (N,) are fitted; the others are held out and
    predicted. `label` says what is held out."""

    label: str
    learn: Callable[[Run], Rows]

    def fitted(self, campaign: Campaign) -> Campaign:
        """What is fitted, as a campaign: whole runs, or their first rows.

        Raises `InputError` where nothing is fitted, nothing is held out, or rows of a run are fitted behind held-out ones.
        """
        runs, held = list[Run](), False
        for run in campaign.runs:
            rows = self.learn(run)
            count = int(rows.sum())
            if not rows[:count].all():
                raise InputError(
                    f"run {run.id}: the fitted rows are not its first ones", remedy="hold out what follows them"
                )
            held |= count < run.rows
            if count:
                runs.append(run if count == run.rows else run.part(0, count))
        if not runs:
            raise InputError(f"nothing is left to fit without {self.label}", remedy="hold out fewer runs")
        if not held:
            raise InputError(f"no run is held out by {self.label}", remedy=HOW)
        return replace(campaign, runs=tuple(runs))


def parted(campaign: Campaign, how: str | Split) -> tuple[Campaign, Split]:
    """The campaign and its split.

    `how`: `half` holds out the second half of every run that is long enough; `cycles` every other one of the runs that are of
    one kind, runs at rest that repeat their targets cut into their cycles (ISO 230-2); `runs:NAMES` the runs of these names or
    patterns, separated by commas. Raises `InputError` for any other one, and for a name that no run has.
    """
    if isinstance(how, Split):
        return campaign, how
    kind, _, names = how.partition(":")
    if how == "half":
        return campaign, _halves(campaign)
    if how == "cycles":
        return _cycles(campaign)
    if kind == "runs" and names:
        return campaign, runs_of(campaign, names.split(","))
    raise InputError(f'"{how}" is no way to hold out readings', remedy=HOW)


def first_half(run: Run) -> Rows:
    """The first half of a run's rows (N,)."""
    return np.asarray(np.arange(run.rows) < run.rows // 2)


def _halves(campaign: Campaign) -> Split:
    """A run is long enough if half of it has more readings than zeros and set-up errors of its own."""
    long = set[str]()
    for run in campaign.runs:
        each = instruments_of(run)
        columns = sum(len(i.columns(run, campaign.machine)) for i in each)
        own = {p.name for i in each for p in i.parameters(run, campaign.machine)}
        if (run.rows // 2) * columns > len(own):
            long.add(run.id)
    if not long:
        raise InputError("no run is long enough to be halved", remedy="hold out whole runs, as runs:NAME,NAME")
    return Split(
        "the second half of each run", lambda run: first_half(run) if run.id in long else np.ones(run.rows, dtype=bool)
    )


def _cycles(campaign: Campaign) -> tuple[Campaign, Split]:
    cut = replace(campaign, runs=tuple(piece for run in campaign.runs for piece in _cycles_of(run)))
    seen: dict[str, int] = {}
    held = set[str]()
    for run in cut.runs:
        kind = kind_of(run, cut)
        seen[kind] = seen.get(kind, 0) + 1
        if seen[kind] % 2 == 0:
            held.add(run.id)
    if not held:
        raise InputError("no two runs are of one kind, and no static run repeats its targets", remedy="write half")
    what = "run" if len(cut.runs) == len(campaign.runs) else "cycle"
    return cut, Split(f"every other {what}", lambda run: np.full(run.rows, run.id not in held))


def _cycles_of(run: Run) -> list[Run]:
    """The cycles of a run at rest that repeats its targets, all rows kept; of another one the run.

    A cycle begins where its first row was approached from the same side as its second, as the first row of a run counts.
    """
    try:
        period = run.rows if run.dynamic else cycles_of(run)[0].rows
    except InputError:
        return [run]
    sides = np.sign(np.diff(np.stack(list(run.commands.values())), axis=1))  # of rows 1, 2, …
    same = [k for k in range(1, min(period, run.rows - 2)) if np.array_equal(sides[:, k - 1], sides[:, k])]
    edges = [0, *range(same[0] + period, run.rows - 1, period), run.rows] if same else [0, run.rows]
    pieces = list[Run]()
    for number, (first, last) in enumerate(pairwise(edges), start=1):
        piece, name = run.part(first, last), f"{run.id}-cycle-{number}"
        begin = float(piece.time[0])
        pieces.append(replace(piece, id=name, file=f"{name}.csv", time=piece.time - begin, start_s=run.start_s + begin))
    return pieces if len(pieces) > 1 else [run]


def runs_of(campaign: Campaign, names: list[str]) -> Split:
    """Runs held out by their names or patterns."""
    held = set[str]()
    for name in (name.strip() for name in names):
        found = {run.id for run in campaign.runs if run.id == name or fnmatchcase(run.id, name)}
        if not found:
            known = ", ".join(run.id for run in campaign.runs)
            raise InputError(f'there is no run "{name}" to hold out', remedy=f"use one of {known}")
        held |= found
    some = sorted(held, key=[run.id for run in campaign.runs].index)
    label = f"{'run' if len(some) == 1 else 'runs'} {', '.join(some)}" if len(some) <= SHOWN else f"{len(some)} runs"
    return Split(label, lambda run: np.full(run.rows, run.id not in held))

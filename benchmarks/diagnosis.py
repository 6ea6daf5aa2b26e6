"""Diagnosis of the open campaigns by symfive and by simple rivals: right, false and missed names, and time, in one run.

    .venv/bin/python benchmarks/diagnosis.py [--quick] [--peers PYTHON]
    .venv/bin/python benchmarks/diagnosis.py --blocks

The rivals are those of the blind study (`examples/blind_study/rivals.py`): greedy BIC over symfive's own exact tangents, with
white noise, with noise whitened once, and with an ARMA(1,1) fitted anew and clipped outliers. PySINDy (where PYTHON has it)
thresholds the same tangents, made orthogonal to the baseline and of unit length. The campaigns were written by an independent
plant. A name is word and axis; those of a set-up that is wrong count as any other. CPU seconds; the rivals' share the tangents.

`--blocks` times instead what a diagnosis is made of, on 24 000 rows of ball-bar circles: the catalogue linearised about a fit,
whitened Gram matrices of that, and of 500 columns. Least of three.
"""

from __future__ import annotations

import os

os.environ |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}

import argparse
import json
import sys
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import numpy as np
from identify import RATE_HZ, ROWS, SEED, plan
from timing import timed

from examples.blind_study.rivals import PYSINDY, RIVALS, Name, System, pysindy, search
from symfive.campaign import read_campaign
from symfive.diagnose import diagnose
from symfive.identify import identify
from symfive.posterior._noise import grams, nodes_of
from symfive.posterior._tables import Tables
from symfive.posterior._terms import candidates
from symfive.simulate import simulate
from symfive.threads import one_thread

CAMPAIGNS = Path(__file__).resolve().parent.parent / "tests" / "data" / "campaigns"
QUICK = ("static-none", "static-sag-and-drift")
COLUMNS = 500


@dataclass
class Tally:
    """Names over all campaigns: right, false, missed; campaigns without an effect that got a name; CPU seconds."""

    right: int = 0
    false: int = 0
    missed: int = 0
    alarms: int = 0
    seconds: float = 0.0
    skipped: str = ""

    def add(self, found: Iterable[Name], truth: set[Name], seconds: float) -> None:
        """One campaign more."""
        names = set(found)
        self.right += len(names & truth)
        self.false += len(names - truth)
        self.missed += len(truth - names)
        self.alarms += bool(names) and not truth
        self.seconds += seconds


def compete(campaigns: Iterable[str], python: str | None) -> dict[str, Tally]:
    """Everybody's tally."""
    tallies = {name: Tally() for name in ("symfive", *RIVALS, PYSINDY)}
    for name in campaigns:
        truth_file = json.loads((CAMPAIGNS / name / "truth.json").read_text())
        truth = {(e["effect"], e["axis"]) for e in truth_file["effects"]}
        campaign = read_campaign(CAMPAIGNS / name / "fit")
        seconds, found = timed(lambda: diagnose(campaign), 1)  # noqa: B023
        said = [(f.name, f.axis) for f in found.findings]
        tallies["symfive"].add(said, truth, seconds)
        _say(name, truth, "symfive", said)
        shared, system = timed(lambda: System.of(campaign), 1)  # noqa: B023
        for rival in RIVALS:
            seconds, said = timed(lambda: search(system, rival), 1)  # noqa: B023
            tallies[rival].add(said, truth, shared + seconds)
            _say(name, truth, rival, said)
        if tallies[PYSINDY].skipped:
            continue
        try:
            if python is None:
                raise RuntimeError("give --peers PYTHON (an environment with pysindy)")
            said, seconds = pysindy(system, python)
            tallies[PYSINDY].add(said, truth, shared + seconds)
            _say(name, truth, PYSINDY, said)
        except RuntimeError as error:
            tallies[PYSINDY].skipped = f"skipped: {error}"
    return tallies


def _say(campaign: str, truth: set[Name], who: str, said: Iterable[Name]) -> None:
    words = ", ".join(f"{n} {a or ''}".strip() for n, a in sorted(set(said), key=str)) or "nothing"
    held = ", ".join(f"{n} {a or ''}".strip() for n, a in sorted(truth, key=str)) or "nothing"
    print(f"{campaign:28} ({held}) {who}: {words}", flush=True)


def campaigns(quick: bool) -> list[str]:
    """All open campaigns, or two."""
    return list(QUICK) if quick else sorted(path.name for path in CAMPAIGNS.iterdir())


@one_thread
def blocks() -> None:
    """What a diagnosis of 24 000 rows is made of, in CPU seconds."""
    measured = simulate(plan(ROWS), seed=SEED).campaign
    fit, forms = identify(measured), candidates(measured).forms
    nodes = nodes_of(max(run.duration for run in measured.runs))
    tables = list(Tables(fit, [], forms))
    size = max(table.rows.shape[2] for table in tables)
    columns = np.random.default_rng(0).standard_normal((ROWS, 1, COLUMNS))
    for what, work in {
        f"{len(forms)} forms linearised, up to {size} columns": lambda: list(Tables(fit, [], forms)),
        f"their Gram matrices, {len(nodes)} nodes": lambda: [grams(t.rows, t.interval, nodes) for t in tables],
        f"Gram matrices of {COLUMNS} columns, {len(nodes)} nodes": lambda: grams(columns, 1.0 / RATE_HZ, nodes),
    }.items():
        print(f"{what:45} {timed(work)[0]:.2f} s")


def main() -> None:
    """Parse the options and print."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--quick", action="store_true", help="two campaigns")
    options.add_argument("--peers", metavar="PYTHON", help="a Python that has pysindy")
    options.add_argument("--blocks", action="store_true", help="linearisation and Gram matrices of 24 000 rows instead")
    chosen = options.parse_args()
    if chosen.blocks:
        blocks()
        return
    for name, tally in compete(campaigns(chosen.quick), chosen.peers).items():
        print(f"{name:15} {tally}")


if __name__ == "__main__":
    main()

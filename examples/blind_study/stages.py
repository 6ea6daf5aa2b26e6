"""The stages of one case, each a function of plain arguments that a worker can run: seal, judge, open, look again."""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import plant
from plant.reader import read_campaign as read_plan

from symfive.effects import EFFECTS

from .cases import make_case, write_case
from .controls import first_name
from .effects import Spec
from .judge import judge, judge_again
from .oracle import oracle
from .plans import Setting
from .recorded import judge_recorded
from .rivals import compete
from .score import Name, as_well, f1_table, names_of
from .span import inseparable, oversized
from .store import Store


def seal(root: Path, seed: int, id: str) -> None:
    """Makes the case and seals its answer."""
    store = Store(root)
    if not store.has("seals", id):
        shutil.rmtree(store.case(id), ignore_errors=True)
        store.seal(id, write_case(make_case(seed, id), store.case(id)))


def verdict(root: Path, id: str) -> None:
    """symfive's verdict, then the oracle's fit and the next test, which need the answer."""
    store = Store(root)
    if not store.has("verdicts", id):
        store.put("verdicts", id, judge(store.case(id), next_test=root / "next" / id))
    if not store.has("oracles", id):
        store.put("oracles", id, _opened(store, id))
    if not store.has("again", id):
        store.put("again", id, _look_again(store, id))


def _opened(store: Store, id: str) -> dict[str, object]:
    """What needs the answer beside the verdict: the oracle's geometry, and where each finding acts."""
    answer, findings = store.open(id), store.get("verdicts", id)["diagnosis"]["findings"]
    known = oracle(store.case(id), answer) or {}
    alike = _alike(store.case(id), answer) if answer["stratum"] == "alias" else {"inseparable": [], "oversized": []}
    return {**known, "f1": f1_table(store.case(id) / "fit", findings, answer["facts"]), **alike}


def _alike(case: Path, answer: Mapping[str, Any]) -> dict[str, list[Name]]:
    """Names that give the same readings as the truth: those that no measurement separates from it, those far larger."""
    machine, runs = read_plan(case / "fit")
    errors = answer["location_errors_um_urad"], answer["error_motions_um_urad"]
    setting = Setting(answer["kind"], answer["topology"], machine, runs, [], plant.PLAIN, *errors)
    (spec,), (fact,) = answer["effects"], answer["facts"]
    names = names_of(fact)
    return {
        "inseparable": [name for name in inseparable(setting, spec) if name in names],
        "oversized": [name for name in oversized(setting, spec) if name in names],
    }


def control(root: Path, id: str) -> None:
    """The verdicts with the true effects taken out of the catalogue, and then, too, every name that explains the readings nearly
    as well as the better one of oracle and verdict."""
    store = Store(root)
    if store.has("controls", id):
        return
    exclude = {name for spec in store.open(id)["effects"] for name in without(spec)}
    known = store.get("oracles", id).get("chi2_dof")
    with_truth = min(store.get("verdicts", id)["diagnosis"]["fit"]["chi2_dof_after"], known or np.inf)
    rounds: list[dict[str, object]] = []
    while len(rounds) < ROUNDS:
        found = judge(store.case(id), exclude=sorted(exclude))
        rounds.append({"excluded": sorted(exclude), **found})
        named = first_name(found)
        if named is None or not as_well(found["diagnosis"]["fit"]["chi2_dof_after"], with_truth):
            break
        exclude |= sisters(named)
    store.put("controls", id, rounds)


def recorded(root: Path, seed: int, id: str) -> None:
    """The verdict on a case without an effect, with the noise of a real instrument."""
    store = Store(root)
    if not store.has("recorded", id):
        store.put("recorded", id, judge_recorded(seed, id))


def rivals(root: Path, peers: str | None, id: str) -> None:
    """What the simple rivals say of the same recordings; `peers` a Python that has PySINDy."""
    store = Store(root)
    if not store.has("rivals", id):
        store.put("rivals", id, compete(store.case(id), peers))


ROUNDS = 10
"""A name, and those that replace it, are excluded one after the other so many times at most."""


def sisters(name: str) -> frozenset[str]:
    """Ids of the library that are reported under the same word as one of them: they are excluded together."""
    word = EFFECTS[name].reported_as or name
    return frozenset(id for id, effect in EFFECTS.items() if (effect.reported_as or id) == word)


def without(spec: Spec) -> frozenset[str]:
    """Ids of the library that know a true effect."""
    words = {"compensation_table_step": "table_step", "reversal_pulse": "reversal_spike"}
    return sisters(words.get(spec["effect"], spec["effect"]))


def _look_again(store: Store, id: str) -> dict[str, object] | None:
    """The plant measures the test that the diagnosis asked for, and symfive looks at both; alias cases only."""
    plan = store.root / "next" / id
    answer = store.open(id)
    if answer["stratum"] != "alias" or not plan.is_dir():
        return None
    machine, runs = read_plan(plan)
    measured = store.root / "measured" / id
    plant.write_campaign(
        measured, machine, runs, answer["location_errors_um_urad"], answer["error_motions_um_urad"], answer["effects"],
        seed=answer["seed"] + 1, noise_options=plant.NoiseOptions(**answer["noise"]),
    )  # fmt: skip
    (measured / "truth.json").unlink()
    return judge_again(store.case(id), measured)

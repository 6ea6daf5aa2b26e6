"""The blind study as a challenge that anybody can enter: campaigns in, one `diagnosis.json` a campaign out, one command scores.

    python -m examples.blind_study.challenge write CHALLENGE --cases 42 --answers ANSWERS.json
    python -m examples.blind_study.challenge enter CHALLENGE symfive -o ENTRY --workers 2
    python -m examples.blind_study.challenge score CHALLENGE ANSWERS.json ENTRY ANOTHER_ENTRY ...

`write` draws the cases of the study (or takes those of a study's folder, `--study`), gives them numbers that say nothing, and
keeps the answers in a file of their own, whose SHA-256 stands in `challenge.json`. An entry is a folder with
`NUMBER/diagnosis.json` for every campaign; `enter` writes those of symfive and of its simple rivals, others bring their own.

Of every finding of a `diagnosis.json` the score reads `effect`, `axis`, `confidence` (1 if it is not stated), what it cannot be
distinguished from (`alias`: names, or `rivals` of 5 % or more), and for `unknown` the `coordinate`. The group of a finding is its
name with these. A true effect has a group as well: its name and all names that give the same readings. A case scores

    sum of |stated and true| / |stated or true| over the pairs of finding and effect, divided by the larger of both numbers

so 1 is a complete ambiguity group without a false member for every effect and nothing beside it, as in the competitions of the DX
workshops (T. Kurtoglu et al. 2009); a campaign without an effect scores 1 without a finding, else 0.
"""

from __future__ import annotations

import argparse
import json
import secrets
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import linear_sum_assignment

from symfive.campaign import read_campaign
from symfive.errors import InputError
from symfive.executors import executor, finished

from . import stages
from .cases import STRATA, case_ids
from .others import coordinates
from .rivals import SIMPLE, System, said_of
from .score import CONFIDENT, Name, key_name, names_of
from .store import Store, digest

SCHEMA = "symfive.challenge/1"
LISTED = 0.05
"""Confidence from which a rival belongs to what is stated."""
UNKNOWN: Name = ("unknown", None)


# --- write ---------------------------------------------------------------------------------------------------
def write(folder: Path, answers: Path, ids: Sequence[str], study: Path | None, seed: int, workers: int) -> None:
    """The campaigns of these cases under numbers in random order, and their answers; `study` has cases, else they are drawn."""
    for path in (folder, answers):
        if path.exists():
            raise InputError(f"{path} is there already", remedy="name another one, or remove it")
    if answers.resolve().is_relative_to(folder.resolve()):
        raise InputError(f"{answers} lies in the challenge, where everybody reads it", remedy="keep it elsewhere")
    with tempfile.TemporaryDirectory(dir=folder.resolve().parent) as place:
        store = Store(study or Path(place) / "study")
        drawn = [i for i in ids if not store.has("seals", i)]
        if study is not None and drawn:
            raise InputError(f"{study} has no case {drawn[0]}", remedy="run the study first, or leave --study away")
        with executor(workers) as pool:
            for _, outcome in finished(pool, stages.seal, [(store.root, seed, i) for i in drawn]):
                if isinstance(outcome, Exception):
                    raise outcome
        order = [ids[k] for k in np.random.default_rng(secrets.randbits(64)).permutation(len(ids))]
        numbers = {f"{k:04d}": id for k, id in enumerate(order, start=1)}
        made = Path(place) / "challenge"
        for number, id in numbers.items():
            shutil.copytree(store.case(id) / "fit", made / "campaigns" / number)
        solutions = {
            number: _answer(json.loads((store.root / "answers" / f"{id}.json").read_text()))
            for number, id in numbers.items()
        }
        text = json.dumps({"schema": SCHEMA, "answers": solutions}, indent=1)
        head = {"schema": SCHEMA, "campaigns": list(numbers), "answers_sha256": digest(text.encode())}
        (made / "challenge.json").write_text(json.dumps(head, indent=1))
        answers.write_text(text)
        made.rename(folder)


def _answer(answer: Mapping[str, Any]) -> dict[str, Any]:
    """What the score needs of a case's answer: its stratum and every effect's group (and coordinates, where it has no name)."""
    if answer["stratum"] == "outside":
        (spec,) = answer["effects"]
        effects = [{"names": [UNKNOWN], "coordinates": sorted(coordinates(spec))}]
    else:
        effects = [{"names": sorted(set(names_of(fact)), key=str)} for fact in answer["facts"]]
    return {"case": answer["id"], "stratum": answer["stratum"], "effects": effects}


# --- enter ---------------------------------------------------------------------------------------------------
def symfive(campaign: Path) -> dict[str, Any]:
    """The diagnosis of symfive."""
    from symfive.diagnose import diagnose

    return diagnose(read_campaign(campaign)).to_data()


def _rival(name: str) -> Callable[[Path], dict[str, Any]]:
    def entrant(campaign: Path) -> dict[str, Any]:
        said = said_of(System.of(read_campaign(campaign)), name)
        return {"findings": [{"effect": effect, "axis": axis, "confidence": 1.0} for effect, axis in said]}

    return entrant


ENTRANTS: Mapping[str, Callable[[Path], dict[str, Any]]] = {
    "symfive": symfive,
    **{name: _rival(name) for name in SIMPLE},
}


def _one(entrant: str, challenge: Path, number: str, entry: Path) -> None:
    found = ENTRANTS[entrant](challenge / "campaigns" / number)
    (entry / number).mkdir(parents=True, exist_ok=True)
    draft = entry / number / ".diagnosis.json"
    draft.write_text(json.dumps(found, default=float))
    draft.rename(entry / number / "diagnosis.json")


def enter(challenge: Path, entrant: str, entry: Path, workers: int) -> Iterator[str]:
    """Diagnose every campaign that the entry has no diagnosis of; the numbers of those that failed, with what they said."""
    wanted = [n for n in _challenge(challenge)["campaigns"] if not (entry / n / "diagnosis.json").is_file()]
    with executor(workers, fresh=True) as pool:
        tasks = [(entrant, challenge, number, entry) for number in wanted]
        for done, (task, outcome) in enumerate(finished(pool, _one, tasks), start=1):
            print(f"{done} of {len(tasks)}: {wanted[task]}", file=sys.stderr, flush=True)
            if isinstance(outcome, Exception):
                yield f"{wanted[task]}: {type(outcome).__name__}: {outcome}"


# --- score ---------------------------------------------------------------------------------------------------
@dataclass(frozen=True)
class Mark:
    """What an entry gets for a case. `wrong`: it states a name above 90 % that is no true effect's; `brier`: mean square of
    confidence minus truth over its names, NaN without one."""

    stratum: str
    points: float
    wrong: bool
    brier: float
    entered: bool = True


def stated(finding: Mapping[str, Any]) -> set[Name]:
    """The group of a finding: its name, and those from which it says that it cannot be distinguished."""
    rivals = [r for r in finding.get("rivals", ()) if float(r.get("confidence", 0.0)) >= LISTED]
    names = {(str(one["effect"]), one.get("axis")) for one in (finding, *rivals)}
    return names | {
        key_name(a) if isinstance(a, str) else (str(a["effect"]), a.get("axis")) for a in finding.get("alias", ())
    }


def coordinate(finding: Mapping[str, Any]) -> set[str]:
    """The coordinates over which a finding changes, as `where.coordinate` of symfive's, or `coordinate`."""
    where = finding.get("where", {})
    return set(str(where.get("coordinate", finding.get("coordinate", ""))).split(", "))


def _agreement(finding: Mapping[str, Any], effect: Mapping[str, Any]) -> float:
    names = {(e, a) for e, a in effect["names"]}
    if "coordinates" in effect:  # `unknown`, over a right coordinate
        return float(finding["effect"] == UNKNOWN[0] and bool(coordinate(finding) & set(effect["coordinates"])))
    group = stated(finding)
    return len(group & names) / len(group | names)


def mark(answer: Mapping[str, Any], diagnosis: Mapping[str, Any] | None) -> Mark:
    """The score of one case; no diagnosis, no points."""
    effects = answer["effects"]
    if diagnosis is None:
        return Mark(answer["stratum"], 0.0, False, float("nan"), entered=False)
    findings = diagnosis["findings"]
    table = np.array([[_agreement(f, e) for e in effects] for f in findings]).reshape(len(findings), len(effects))
    most = max(table.shape)
    points = float(table[linear_sum_assignment(table, maximize=True)].sum()) / most if most else 1.0
    true = {(e, a) for effect in effects for e, a in effect["names"]}
    named = [
        (float(f.get("confidence", 1.0)), (str(f["effect"]), f.get("axis")) in true)
        for f in findings
        if f["effect"] != UNKNOWN[0]
    ]
    wrong = any(confidence >= CONFIDENT and not right for confidence, right in named)
    brier = float(np.mean([(confidence - right) ** 2 for confidence, right in named])) if named else float("nan")
    return Mark(answer["stratum"], points, wrong, brier)


def marks(challenge: Path, answers: Path, entry: Path) -> list[Mark]:
    """An entry's marks for all campaigns. Raises `InputError` where the answers are not those of the challenge."""
    head, text = _challenge(challenge), answers.read_text()
    if digest(text.encode()) != head["answers_sha256"]:
        raise InputError(
            f"{answers} are not the answers of this challenge", remedy="its SHA-256 stands in challenge.json"
        )
    solutions = json.loads(text)["answers"]
    return [mark(solutions[number], _diagnosis(entry / number / "diagnosis.json")) for number in head["campaigns"]]


def _diagnosis(path: Path) -> dict[str, Any] | None:
    if not path.is_file():
        return None
    try:
        found = json.loads(path.read_text())
        for finding in found["findings"]:
            stated(finding), float(finding.get("confidence", 1.0))
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        problem = f"{path} is no diagnosis ({type(error).__name__}: {error})"
        raise InputError(
            problem, remedy='it needs {"findings": [{"effect": …, "axis": …, "confidence": …}, …]}'
        ) from None
    return found


def _challenge(folder: Path) -> dict[str, Any]:
    path = folder / "challenge.json"
    if not path.is_file() or (found := json.loads(path.read_text())).get("schema") != SCHEMA:
        raise InputError(f"{folder} is no challenge", remedy="name the folder that `write` made")
    return found


def table(entries: Mapping[str, Sequence[Mark]]) -> str:
    """A line for every figure, a column for every entry (Markdown)."""
    strata = [s for s in STRATA if any(m.stratum == s for ms in entries.values() for m in ms)]
    count = {s: sum(m.stratum == s for m in next(iter(entries.values()))) for s in strata}
    rows: list[tuple[str, Callable[[Sequence[Mark]], str]]] = [
        ("score, mean over the cases", lambda ms: f"{np.mean([m.points for m in ms]):.3f}"),
        ("complete groups without a false member", lambda ms: _percent([m.points == 1.0 for m in ms])),
        *(
            (f"… of `{s}` ({count[s]})", lambda ms, s=s: _percent([m.points == 1.0 for m in ms if m.stratum == s]))
            for s in strata
        ),  # type: ignore[misc]
        ("cases with a wrong name above 0.9", lambda ms: f"{sum(m.wrong for m in ms)} of {len(ms)}"),
        ("Brier score of the names (0 is best)", lambda ms: _mean([m.brier for m in ms])),
        ("campaigns without a diagnosis", lambda ms: str(sum(not m.entered for m in ms))),
    ]
    lines = ["| | " + " | ".join(entries) + " |", "| --- |" + " --- |" * len(entries)]
    return "\n".join(
        [*lines, *(f"| {what} | " + " | ".join(of(ms) for ms in entries.values()) + " |" for what, of in rows)]
    )


def _percent(hits: Sequence[bool]) -> str:
    return f"{100.0 * np.mean(hits):.0f} %"


def _mean(values: Sequence[float]) -> str:
    kept = [v for v in values if np.isfinite(v)]
    return f"{np.mean(kept):.3f}" if kept else "no name"


def main(arguments: Sequence[str] | None = None) -> int:
    """Write, enter or score; 0 unless an entrant failed on a campaign."""
    parser = argparse.ArgumentParser(
        prog="python -m examples.blind_study.challenge", description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )  # fmt: skip
    verbs = parser.add_subparsers(dest="verb", required=True)
    one = verbs.add_parser("write", help="draw campaigns and keep their answers apart")
    one.add_argument("challenge", type=Path)
    one.add_argument("--answers", type=Path, required=True)
    one.add_argument("--cases", type=int, default=420)
    one.add_argument("--study", type=Path, help="take the cases of this study instead of new ones")
    one.add_argument("--seed", type=int, help="of the cases, secret; default: random")
    two = verbs.add_parser("enter", help="diagnose all campaigns by an entrant that is built in")
    two.add_argument("challenge", type=Path)
    two.add_argument("entrant", choices=ENTRANTS)
    two.add_argument("-o", "--output", type=Path, required=True)
    for verb in (one, two):
        verb.add_argument("--workers", type=int, default=1, metavar="W", help="processes; 0: none but this one")
    three = verbs.add_parser("score", help="compare entries with the answers")
    three.add_argument("challenge", type=Path)
    three.add_argument("answers", type=Path)
    three.add_argument("entries", type=Path, nargs="+")
    options = parser.parse_args(arguments)
    if options.verb == "write":
        seed = secrets.randbits(63) if options.seed is None else options.seed
        write(options.challenge, options.answers, case_ids(options.cases), options.study, seed, options.workers)
    elif options.verb == "enter":
        failed = list(enter(options.challenge, options.entrant, options.output, options.workers))
        print(*failed, sep="\n", end="", file=sys.stderr)
        return int(bool(failed))
    else:
        print(table({entry.name: marks(options.challenge, options.answers, entry) for entry in options.entries}))
    return 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except InputError as error:
        sys.exit(f"challenge: {error}")

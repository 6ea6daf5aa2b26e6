"""A finding in words: one wording for the summary, the terminal and the report."""

from __future__ import annotations

import numpy as np

from symfive.diagnose._finding import Finding
from symfive.effects import LINKS, Unknown, Varying, coordinate_words, effect_words, form_words
from symfive.identify import Identification
from symfive.machine import Machine
from symfive.numbers import in_words, percent, plain_number, rounded, unit_words, with_std

SHOWN_NUMBERS, SHOWN_MOVES, SHOWN_RIVALS, SHOWN_RUNS = 4, 3, 3, 6
SHOWN_RIVAL = 0.01
"""A less probable rival is not named in words."""
HUGE = 30.0
"""What is so many times its usual size is hardly that: its unit or its cause is another one."""


def facts_of(finding: Finding, after: Identification) -> dict[str, str]:
    """A finding in words: heading → a short answer, without those that have none. Terminal and report print the same.

    `after` is the fit with all findings.
    """
    machine = after.model.machine
    words, numbers, vectors = _sizes(finding, after)
    sizes = [*words, *numbers[:SHOWN_NUMBERS], *vectors, *_discrepancies(finding)]
    sizes += _beyond_usual(finding, after)
    hidden = [f"geometry and set-up absorbed {percent(1.0 - finding.visible)} of it"] if finding.visible < 0.999 else []
    hidden += [", ".join(_moves(finding, after)[:SHOWN_MOVES])] if finding.moved else []
    law = finding.effect.of if isinstance(finding.effect, Varying) else finding.effect
    if law.hidden_by and not finding.unidentified:
        hidden.append(f"in general: {law.hidden_by.rstrip('.')}")
    same = _as_good(finding, machine)
    likely = [r for r in finding.rivals if r.confidence >= SHOWN_RIVAL and r.words != same]
    rivals = [f"{r.words} {percent(r.confidence)}" for r in likely[:SHOWN_RIVALS]]
    test = [f"record {finding.next_test}"] if finding.next_test else []
    test += [finding.test.says] if finding.test is not None else []
    answers = {
        "what": _deed(finding),
        "where": f"in {place_words(finding, machine)}, over {coordinate_words(finding.coordinate)}, {_runs(finding, after)}",
        "how large": ", ".join(sizes),
        "how sure": "; otherwise ".join(
            [_sure(finding, machine) + _component_is_open(finding), *filter(None, [" or ".join(rivals)])]
        ),
        "share": f"{percent(finding.share)} of the deviation (mean square)",
        "hidden by": "; ".join(hidden),
        "not separated": f"from {', '.join(form_words(key, machine) for key in finding.alias)}"
        if finding.alias
        else "",
        "what to do": _to_do(finding),
        "next test": ": ".join(test),
    }
    return {question: answer for question, answer in answers.items() if answer}


def sentence_of(finding: Finding, after: Identification) -> str:
    """One sentence: name, axis, the two main values, how sure, what hid it."""
    words, numbers, _ = _sizes(finding, after)
    text = ", ".join([*words, *numbers[:2], *_discrepancies(finding), _sure(finding, after.model.machine)])
    for said in _beyond_usual(finding, after):
        text += f"; {said}"
    if finding.moved:
        text += f"; before, the geometry absorbed it ({_moves(finding, after)[0]})"
    elif finding.visible < 0.5:
        text += f"; before, the geometry absorbed {percent(1.0 - finding.visible)} of it"
    return f"{finding.title}: {text}."


def _deed(finding: Finding) -> str:
    """What its effect does; of an unidentified one, which effects it resembles, and that it may be several."""
    laws = [effect.of if isinstance(effect, Varying) else effect for effect in finding.effects]
    known = dict.fromkeys(effect_words(e.vocabulary, e.belongs_to) for e in laws if not e.unidentified)
    several = "one cause or several" if finding.further else ""
    if finding.unidentified and known:
        return "; ".join(filter(None, (several, f"no known effect fits alone; resembles {', '.join(known)}")))
    return several or finding.effect.advice(finding.parameters)[0]


def _to_do(finding: Finding) -> str:
    """What a service engineer does about it; nothing before a test that separates its name from its rivals."""
    known = not finding.unidentified or finding.effect.unidentified
    action = finding.effect.advice(finding.parameters)[1] if known else Unknown.action
    if not action or finding.test is None:
        return action
    sure = "record the next test; if it confirms this cause" if finding.next_test else "if it is this cause"
    return f"{sure}, {action}"


def _sure(finding: Finding, machine: Machine) -> str:
    """How probable the name is; where another one fits as well, that only experience puts it first."""
    said = f"confidence {percent(finding.confidence)}"
    if finding.unidentified:
        said += " that it exists; its cause is unknown"
    if same := _as_good(finding, machine):
        chance = [f" ({percent(r.confidence)})" for r in finding.rivals if r.words == same]
        said += f", by experience: it cannot be distinguished from {same}{''.join(chance)} in this test"
    return said


def _as_good(finding: Finding, machine: Machine) -> str:
    """The name that fits as well where only experience puts the finding's first."""
    return form_words(finding.alias[0], machine) if finding.by_experience and not finding.unidentified else ""


def _component_is_open(finding: Finding) -> str:
    """Other components under the same name that the test does not separate."""
    stem, _, own = finding.effect.key.rpartition(".")
    split = (key.rpartition(".") for key in finding.alias if "component" in finding.parameters)
    others = [other for start, _, other in split if (start, other[2:]) == (stem, own[2:])]
    return f" (component open: not separated from {' and '.join(others)})" if others else ""


def _sizes(finding: Finding, after: Identification) -> tuple[list[str], list[str], list[str]]:
    """Its parameters: words, numbers, several numbers at once. Numbers within 2σ of 0 only where no other one stands out, and
    then by how many σ all amplitudes together do. Of a cause that several terms describe, what they do to the readings."""
    if finding.further:
        most = dict[str, float]()
        for run, part in finding.contribution.items():
            off = np.abs(part - np.median(part, axis=0)).max(axis=0)
            for column, size in zip(after.model.columns(run), off.tolist(), strict=True):
                most[column.unit] = max(most.get(column.unit, 0.0), size)
        seen = [f"{plain_number(size, unit_words(unit))} {unit_words(unit)}" for unit, size in most.items() if size]
        return [f"up to {' and '.join(seen)} of the readings, by {1 + len(finding.further)} terms"], [], []
    words, clear, faint, vectors = list[str](), list[str](), list[str](), list[str]()
    numbers = clear
    for name, quantity in finding.parameters.items():
        if quantity.aside:
            continue
        q = quantity.said
        said = f"{finding.effect.quantity_words(name, q.unit)} {in_words(q.value, q.std, q.unit or '')}".strip()
        if isinstance(q.value, (str, tuple)):
            (words if isinstance(q.value, str) else vectors).append(said)
            continue
        if quantity.unit != "rad":  # a phase is as clear as the amplitude before it
            numbers = faint if isinstance(q.std, (int, float)) and abs(q.value) < 2.0 * q.std else clear
        numbers.append(said)
    if not clear and faint:
        faint.insert(1, f"together {plain_number(finding.sigmas, 'σ')}σ from zero")
    return words, clear or faint, vectors


def _discrepancies(finding: Finding) -> list[str]:
    """What its law is off by."""
    found = [(coordinate_words(effect.coordinate), quantities["rms"]) for effect, quantities in finding.discrepancies]
    return [f"discrepancy {in_words(q.value, q.std, q.unit or '')} rms over {over}" for over, q in found]


def _beyond_usual(finding: Finding, after: Identification) -> list[str]:
    """What to do about an effect that is far larger than usual, even by 2σ less; an unidentified one has no usual size."""
    if finding.unidentified:
        return []
    campaign, values = after.model.campaign, after.named
    for p in finding.effect.amplitudes(campaign):
        off = values[p.name] - p.mean
        values[p.name] = p.mean + float(np.sign(off)) * max(abs(off) - 2.0 * after.uncertainty(p.name), 0.0)
    usual = finding.effect.times_usual(campaign, values)
    if usual <= HUGE:
        return []
    return [f"at least {plain_number(usual)} times its usual size: check the units, or look for another cause"]


def _moves(finding: Finding, after: Identification) -> list[str]:
    """How the geometry changes with it in the model, as `EX0C 4.61 → 3.75 ± 0.06 µm`."""
    said = []
    for name, (old, new) in finding.moved.items():
        std, p = after.uncertainty(name), after.parameters[after.model.index[name]]
        said.append(f"{p.what} {rounded(old, std, p.unit)} → {with_std(new, std, p.unit)}")
    return said


def place_words(finding: Finding, machine: Machine) -> str:
    """The affected link of the chain, from the stage at which the effect enters and its axis."""
    stage, axis = finding.effect.stage, finding.axis if finding.axis in machine.axes else None
    if finding.effect.in_the_drive:
        return f"the drive of {axis}" if axis else "all drives alike"
    if stage == "drive":
        return "the instrument's clock"
    if stage in ("reading", "recording"):
        return "the instrument's reading" if stage == "reading" else "the recorder"
    if finding.effect.link == LINKS[-1]:
        return "the set-up"
    if axis is None:
        return "the structure between workpiece and tool"
    return f"axis {axis}, behind its drive" if stage == "axis" else f"the structure that axis {axis} carries"


def _runs(finding: Finding, after: Identification) -> str:
    """The runs in which it acts."""
    names = finding.runs
    if len(names) == len(after.model.campaign.runs) > 1:
        return "in all runs"
    more = f" and {len(names) - SHOWN_RUNS} more" if len(names) > SHOWN_RUNS else ""
    return f"in run{'s' if names[1:] else ''} {', '.join(names[:SHOWN_RUNS])}{more}"

"""A card for each finding: cause, size, confidence, location, change of geometry, next step."""

from __future__ import annotations

from collections.abc import Sequence

from markupsafe import Markup

from symfive.diagnose import Diagnosis, Finding, RivalName, facts_of
from symfive.effects import Quantity, coordinate_words
from symfive.machine import Machine
from symfive.numbers import in_words, percent, plain_number, rounded, unit_words
from symfive.report._evidence import moved_table
from symfive.report._page import fragment
from symfive.report._tables import Cell, table
from symfive.screen import plural

MOST_RIVALS = 6
LEAST_RIVAL = 1e-4
MOST_INTERVALS = 40
MOST_TESTS = 30
_ALONG = 0.985


def card(number: int, finding: Finding, diagnosis: Diagnosis, picture: Markup) -> Markup:
    """One finding as an HTML article; `picture` is its embedded figure."""
    shown = [r for r in finding.rivals if r.confidence >= LEAST_RIVAL][:MOST_RIVALS]
    rest = len(finding.rivals) - len(shown)
    return fragment(
        "card",
        number=number,
        title=finding.title,
        share=percent(finding.share),
        percent=100.0 * finding.share,
        tiles=_tiles(finding),
        facts=_facts(finding, diagnosis),
        parameters=_parameters(finding),
        intervals=_intervals(finding),
        sections=plural(len(finding.intervals[:MOST_INTERVALS]), "section"),
        moved=moved_table(finding, diagnosis.after) if finding.moved else "",
        picture=picture,
        alternatives=_alternatives(shown, rest) if shown else "",
        rest=rest,
        next_test=_next(finding),
    )


def _tiles(finding: Finding) -> list[tuple[str, str]]:
    judged = ", by experience" if finding.by_experience else ""
    return [
        (f"confidence in the name{judged}", percent(finding.confidence)),
        ("visible share (geometry and set-up absorb the rest)", percent(finding.visible)),
    ]


def _parameters(finding: Finding) -> str:
    rows: list[list[str | Cell]] = []
    parts = ((finding.effect, finding.parameters), *finding.further)
    for number, (effect, parameters) in enumerate(parts, start=1):
        for name, quantity in parameters.items():
            if not quantity.aside:
                part = f" (part {number})" if finding.further else ""
                rows.append([(effect.quantity_words(name, quantity.unit) or name) + part, *_words(quantity.said)])
    for effect, parameters in finding.discrepancies:
        value, std, unit = _words(parameters["rms"])
        rows.append([f"discrepancy over {coordinate_words(effect.coordinate)}, rms", value, std, unit])
    return table("Parameters", ["parameter", "value", "± 1σ", "unit"], rows) if rows else ""


def _words(quantity: Quantity) -> tuple[str | Cell, str | Cell, str]:
    """Value, 1σ and unit of a quantity; several numbers stand in one cell."""
    value, std = quantity.value, quantity.std
    unit = unit_words(quantity.unit or "")
    unit = "" if unit == "1" else unit
    if isinstance(value, str):
        return value, "", unit
    if isinstance(value, tuple):
        spreads = in_words(std, std, spread=False) if isinstance(std, tuple) else ""
        return in_words(value, std, spread=False), spreads, unit
    spread = float(std) if isinstance(std, (int, float)) else 0.0
    return (
        Cell(rounded(value, spread, quantity.unit or ""), value),
        Cell(rounded(spread, spread), spread) if spread else "",
        unit,
    )


def _facts(finding: Finding, diagnosis: Diagnosis) -> dict[str, str]:
    facts = facts_of(finding, diagnosis.after)
    facts.pop("next test", "")  # a box of its own
    direction = _direction(finding, diagnosis.after.model.machine)
    if direction:
        facts["where"] += f"; {direction}"
    return facts


def _direction(finding: Finding, machine: Machine) -> str:
    if finding.direction is None:
        return ""
    vector = ", ".join(f"{v + 0.0:.2f}".replace("-0.00", "0.00").replace("-", "−") for v in finding.direction)
    best = max(range(3), key=lambda i: abs(finding.direction[i]))  # type: ignore[index]
    own = finding.axis in machine.axes and finding.effect.stage in ("drive", "axis")
    turning = own and machine.axes[str(finding.axis)].rotary
    component = getattr(finding.effect, "component", None)
    turning |= isinstance(component, str) and component[1] in "ABC"
    if abs(finding.direction[best]) <= _ALONG:
        return f"in the machine's frame: ({vector})"
    return f"{'about' if turning else 'along'} {'XYZ'[best]} of the machine: ({vector})"


def _intervals(finding: Finding) -> str:
    if not finding.intervals:
        return ""
    rows: list[list[str | Cell]] = [
        [i.run, Cell(f"{i.begin_s:.2f}", i.begin_s), Cell(f"{i.end_s:.2f}", i.end_s)]
        for i in finding.intervals[:MOST_INTERVALS]
    ]
    return table("Sections with more than half of its largest deviation", ["run", "from / s", "to / s"], rows)


def _alternatives(shown: Sequence[RivalName], rest: int) -> Markup:
    rows: list[list[str | Cell]] = [
        [r.effect.replace("_", " "), r.axis or "–", r.component or "–",
         Cell(f"{plain_number(100.0 * r.confidence)} %", r.confidence)]
        for r in shown
    ]  # fmt: skip
    more = f" ({rest} more below 0.01 %)" if rest else ""
    return table(f"Alternatives{more}", ["effect", "axis", "component", "confidence"], rows)


def _next(finding: Finding) -> dict[str, str] | None:
    """What to record next, the folder of its plan, and a table of the other tests."""
    test = finding.test
    if test is None and not finding.next_test:
        return None
    says = f"{test.says[:1].upper() + test.says[1:]}." if test is not None else ""
    others = ""
    if test is not None and len(test.table) > 1:
        rows: list[list[str | Cell]] = [[s.name, Cell(f"{s.sigmas:.1f}", s.sigmas)] for s in test.table[:MOST_TESTS]]
        nearest = " from the nearest alternative" if len(test.each) > 1 else ""
        others = table("Possible next tests", ["test", f"expected separation{nearest} / σ"], rows)
    return {"says": says, "folder": finding.next_test or "", "others": others}

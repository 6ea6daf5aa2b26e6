"""What the set-up sheet tells the operator, against the files and the programs."""

import html
import re
from collections.abc import Iterator

import numpy as np

from ._events import Finding
from ._path import Path
from ._plan import Plan, Run

NUMBER = r"(-?[\d.]+)"
NO_LENGTH = r"(no|without a) tool (length|offset)"
AGAIN = re.compile(r"The same mounting as for run ([^ :]+):")
"""Ball, tool and bar stand as the sheet says of an earlier run."""
POSES = re.compile(r'<table class="poses-list">(.*?)</table>', re.S)
TURNS = re.compile(rf"\b([ABC]) from {NUMBER}° to {NUMBER}°")
ROUNDED_MM = 6e-4
"""Places are stated to 0.001 mm."""


def sheet(plan: Plan, paths: list[Path]) -> Iterator[Finding]:
    """Each run's ball, tool and bar as in campaign.toml, and the programs' datum and tool length as the sheet says."""
    file = plan.folder / "setup.html"
    if not file.exists():
        return
    page = file.read_text(encoding="utf-8")
    text = re.sub(r"<(svg|style|script).*?</\1>|<[^>]+>", " ", page, flags=re.S)
    text = re.sub(r"\s+", " ", html.unescape(text))
    for run, table in zip((run for run in plan.runs if run.static), POSES.findall(page), strict=False):
        yield from (Finding("sheet", file, 0, f"run {run.table['id']}: {says}") for says in _poses(plan, run, table))
    starts = [(run, text.find(f"Run {run.table['id']} ")) for run in plan.runs]
    for k, (run, start) in enumerate(starts):
        if start < 0:
            yield Finding("sheet", file, 0, f"run {run.table['id']} is not on the sheet")
            continue
        end = starts[k + 1][1] if k + 1 < len(starts) else len(text)
        part = text[start : end if end > start else len(text)]
        if (again := AGAIN.search(part)) is not None:
            part += next((text[at:start] for other, at in starts[:k] if other.table["id"] == again[1]), "")
        for says in _differs(plan, run, part):
            yield Finding("sheet", file, 0, f"run {run.table['id']}: {says}")
    fixed = [path for path in paths if not any(e.text in ("TCP on", "length taken out") for e in path.events)]
    offsets = {path.dialect for path in fixed if any(e.text in ("G43", "D1", "length on") for e in path.events)}
    if offsets and re.search(NO_LENGTH, text, re.I):
        yield Finding(
            "sheet",
            file,
            0,
            f"it says that no tool length is called, the {', '.join(sorted(offsets))} programs call one",
        )
    if not offsets and paths and not re.search(NO_LENGTH, text, re.I):
        yield Finding(
            "sheet", file, 0, "it does not say that X Y Z are positions of the spindle nose, without a tool length"
        )


def _poses(plan: Plan, run: Run, table: str) -> Iterator[str]:
    """The table of poses, line by line as the file."""
    heads = re.findall(r"<th>(\w+) / (?:mm|°)</th>", table)
    rows = [re.findall(r'<td class="n">([^<]*)</td>', line) for line in table.split("<tr>") if "<td" in line]
    lines, shown = [row[1] for row in rows], np.array([row[-len(heads) :] for row in rows], float)
    wanted = run.rows[:, [plan.machine.names.index(name) for name in heads]]
    if sorted(heads) != sorted(plan.machine.names) or lines != [str(k + 2) for k in range(len(run.rows))]:
        yield f"its table has the axes {', '.join(heads)} and {len(rows)} lines"
    elif (off := np.abs(shown - wanted).max(axis=1)).max() > 6e-4:
        yield f"line {int(off.argmax()) + 2} of its file is another pose in the table"


def _differs(plan: Plan, run: Run, part: str) -> Iterator[str]:
    if not (run.bar or run.nest):
        return
    wanted = [(rf"x = {NUMBER}, y = {NUMBER}, z = {NUMBER} mm", "the table ball or nest", run.table_ball)]
    wanted += [(rf"ball at {NUMBER} mm below the spindle nose", "the tool's length", -run.tool_ball[2:])]
    wanted += [(rf"Bar of {NUMBER} mm", "the bar", np.array([run.table.get("length", 0.0)]))] if run.bar else []
    for pattern, name, value in wanted:
        found = re.search(pattern, part)
        if found is None:
            yield f"{name} is not on the sheet"
        elif np.abs(np.array(found.groups(), float) - value).max() > ROUNDED_MM:
            yield f"{name} is {' '.join(found.groups())} mm on the sheet, {np.round(value, 3).tolist()} mm in campaign.toml"
    for name, low, high in TURNS.findall(part):
        angles = run.rows[:, plan.machine.names.index(name)]
        ends = (float(low), float(high)), (-float(high), -float(low))  # the control may count the other way
        if not any(a - 1e-3 <= angles.min() and angles.max() <= b + 1e-3 for a, b in ends):
            yield f"{name} turns beyond {low}° to {high}°"
    if found := re.search(rf"control shows X {NUMBER}, Y {NUMBER}, Z {NUMBER} mm", part):
        at_zero = np.zeros((1, len(plan.machine.names)))
        there = plan.machine.following(at_zero, run.table_ball[None, :], run.tool_ball)[0]
        there = there[[plan.machine.names.index(name) for name in "XYZ"]]
        if np.abs(np.array(found.groups(), float) - there).max() > 0.01:
            yield f"the control would show {np.round(there, 3).tolist()} mm with the ball in its place, the sheet says {found[0]}"

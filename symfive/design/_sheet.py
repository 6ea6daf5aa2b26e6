"""The set-up sheet: one page with all that the person at the machine has to know, for poses and for recordings alike."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from html import escape

import numpy as np
from numpy.typing import NDArray

from symfive.campaign import Campaign, Run
from symfive.design._assess import Assessment
from symfive.design._pose_table import mounted_before, pose_table
from symfive.design._schedule import SETUP_S
from symfive.drawing import PAGE_STYLE, SCRIPT, poses_figure
from symfive.errors import InputError
from symfive.instruments import instruments_of
from symfive.machine import Machine
from symfive.nc import LETTERS, UNCHECKED, Post, collision_warning, series_of, upright_axis, which_point
from symfive.numbers import plain_number, unit_words
from symfive.procedures import PAUSE_S, Nominal

__all__ = ["Sheet", "setup_sheet"]

Array = NDArray[np.float64]
STANDS = {
    "r_test": "nest",
    "touch_probe": "sphere",
    "ball_bar": "table ball",
    "grid_encoder": "middle of the grid plate",
}
"""What stands on the table, by instrument."""
STILL = 1e-3
"""What moves by less, mm or degree, stands still; directions that differ by less are one."""
STYLE = """
body { font-size: 14px; line-height: 1.45; } main { max-width: 62rem; }
h2 { margin: 1.4rem 0 .3rem; } ol { margin: .2rem 0; padding-left: 1.6rem; }
section > svg { display: block; max-width: 100%; height: auto; background: #fdfefe; border-radius: .3rem; }
.facts { margin: .5rem 0; display: grid; grid-template-columns: minmax(5rem, max-content) 1fr; gap: .1rem 1.1rem; }
.facts dt { color: var(--faint); } .facts dd { margin: 0; overflow-wrap: anywhere; color: var(--ink); }
td.again { font-weight: 600; }
@media screen and (max-width: 62rem) { table { display: block; overflow-x: auto; } }
@media screen and (prefers-color-scheme: dark) { section > svg { filter: invert(.9) hue-rotate(180deg); } }
@media print { section { break-inside: avoid; } }
"""


@dataclass(frozen=True, kw_only=True)
class Sheet:
    """What a sheet is about: the `campaign` without readings, `post` what the user decided about its programs, `facts` for the
    head, `worth` a sentence, the `assessment` (without it nothing is expected), `notes` about the ways."""

    campaign: Campaign
    post: Post
    facts: str = ""
    worth: str = ""
    assessment: Assessment | None = None
    notes: Sequence[str] = ()


def setup_sheet(sheet: Sheet, pictures: Mapping[str, str], programs: Sequence[str]) -> str:
    """One HTML page that loads nothing; its script turns the picture of all poses. All text from files is escaped.

    `pictures` run → SVG, of those that have one; `programs` their names.
    """
    campaign, machine = sheet.campaign, sheet.campaign.machine
    title = f"Set-up sheet: {machine.name}"
    nominal, poses = Nominal(machine), poses_figure(campaign)
    parts = [
        '<!doctype html><html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{escape(title)}</title>",
        f"<style>{PAGE_STYLE}{STYLE}</style></head><body><main><h1>{escape(title)}</h1>",
        f'<p class="quiet">{escape(machine.structure.code)} · {escape(_facts(sheet))}</p>',
        *_unchecked(sheet),
        f"<p>{escape(sheet.worth)}.</p>" if sheet.worth else "",
        *(_run(sheet, nominal, run, pictures.get(run.id, "")) for run in campaign.runs),
        f"<section><h2>All poses</h2>{poses}</section>" if poses else "",
        _expected(sheet.assessment) if sheet.assessment is not None else "",
        _clearances(sheet),
    ]
    if programs:
        parts.append(f"<h2>Programs</h2><p>{', '.join(f'<code>{escape(p)}</code>' for p in programs)}</p>")
    parts.append(f"<script>{SCRIPT}</script></main></body></html>\n")
    return "\n".join(part for part in parts if part)


def _facts(sheet: Sheet) -> str:
    """Instruments, how much there is to read, how long it takes."""
    runs = sheet.campaign.runs
    used = _names(name for run in runs for name in run.instrument)
    minutes = sum(_minutes(sheet, run) for run in runs)
    count = f"{len(runs)} run{'s' if len(runs) > 1 else ''}, {sheet.campaign.rows} readings"
    return f"{used} · {sheet.facts or f'{count} · about {minutes:.0f} min with set-up'}"


def _names(instruments: Iterable[str]) -> str:
    return ", ".join("R-test" if name == "r_test" else name.replace("_", " ") for name in dict.fromkeys(instruments))


def _minutes(sheet: Sheet, run: Run) -> float:
    """A run with its set-up; a recording with the mounting of an earlier one needs a pause alone."""
    stays = run.dynamic and mounted_before(sheet.campaign.runs, run) is not None
    return (run.duration + (PAUSE_S if stays else SETUP_S)) / 60.0


def _run(sheet: Sheet, nominal: Nominal, run: Run, picture: str) -> str:
    stands = next((STANDS[name] for name in run.instrument if name in STANDS), "")
    again = mounted_before(sheet.campaign.runs, run)
    stays = run.dynamic and again is not None
    machine = nominal.machine
    steps = ["Work offset: the workpiece frame's origin, with all rotary axes at 0."]
    programmed = set(machine.axis_names) <= set(LETTERS)
    if programmed:
        steps.append(f"In the program {escape(which_point(machine, run, sheet.post))}.")
    if again is not None:
        what = "leave everything in place" if stays else "remove it and mount it again (a new set-up error)"
        steps.append(f"The same mounting as for run {escape(again.id)}: {what}.")
    if stands and not stays:
        x, y, z = (f"{v:.1f}".removesuffix(".0") for v in run.table_ball)
        steps.append(f"Mount the {stands} at x = {x}, y = {y}, z = {z} mm of the workpiece frame (±1 mm).")
        end = "Reading head" if "grid_encoder" in run.instrument else "Tool ball"
        steps.append(f"{end} at {-run.tool_ball[2]:.0f} mm below the spindle nose.")
    if run.length is not None and not stays:
        steps.append(f"Bar of {run.length:g} mm, calibrated length entered.")
    if run.spindle is not None:
        steps.append(
            "The spindle is oriented: the run-out of the tool ball is read at "
            f"{' and '.join(f'{angle:g}°' for angle in np.unique(run.spindle))}. Where the program stops for it, turn the "
            "spindle by hand; the ball stays in its place."
        )
    steps += _start(sheet, run)
    if programmed:
        for series in series_of(machine, sheet.campaign.runs):
            names = escape("+".join(r.id for r in series))
            if run in series:
                steps.append(f"Or the program {names}: all {len(series)} circles of this mounting, the bar stays on.")
        steps += _moves(machine, sheet.post)
    places = _places(nominal, run, stands) if stands and not stays else ""
    drawing = picture[picture.index("<svg") :] if picture else ""
    table = _recording(nominal, run) if run.dynamic else pose_table(sheet.campaign, run, sheet.post)
    head = f"<h2>Run {escape(run.id)} · {run.rows} rows · {_minutes(sheet, run):.0f} min</h2>"
    listed = "".join(f"<li>{step}</li>" for step in steps)
    return f"<section>{head}<ol>{listed}</ol>{places}{drawing}{table}</section>"


def _start(sheet: Sheet, run: Run) -> list[str]:
    name = escape(run.id)
    if "touch_probe" not in run.instrument:
        return [f"Start the program of run {name}; it stops where you seat the instrument."]
    post = sheet.post
    return [
        f"Sphere of radius {post.sphere_radius:g} mm, tip of radius {post.tip_radius:g} mm, probe switched on, spindle locked.",
        f"Start the program of run {name}; it stops above the sphere, then touches it. Its head says where it logs.",
        "Bring the log back and import it: <code>symfive import-touches PLAN LOG -o measured</code>.",
    ]


def _moves(machine: Machine, post: Post) -> list[str]:
    """The first and the last moves of every program, in their order."""
    up = escape(upright_axis(machine))
    rotary = " and ".join(escape(name) for name in machine.axis_names if machine.axes[name].rotary)
    turned, home = (f"{rotary}, then ", f", then {rotary} to 0") if rotary else ("", "")
    top = f"machine coordinate {post.machine_top:g} (ISO: its reference point)"
    return [
        f"First moves, not tested: {up} alone to the top of its travel, {top}, then {turned}the plane, then {up} down; the "
        "program stops before the slow move into position.",
        f"Last moves: back along the same path, no tool offset, {up} alone to the top{home}.",
    ]


def _places(nominal: Nominal, run: Run, stands: str) -> str:
    """Where it stands: in the workpiece frame, by the positions of the linear axes, and seen from each rotary axis."""
    axes = nominal.machine.axes
    rows = [_row("workpiece frame", run.table_ball)]
    rows += [
        _row(f"from axis {escape(name)}", across, float(np.linalg.norm(across)))
        for name, across in _from_axes(nominal, run).items()
    ]
    head = "".join(f"<th>{word}</th>" for word in ("", "x / mm", "y / mm", "z / mm", "distance / mm"))
    there = sorted(_over_the_ball(nominal, run).items())
    linear = ", ".join(f"{escape(name)} {_digits(q[0])}" for name, q in there if not axes[name].rotary)
    rotary = ", ".join(f"{escape(name)} {q[0]:g}°" for name, q in there if axes[name].rotary)
    said = (
        f"<p>With the tool ball there and no tool offset, the control shows {linear} mm{f' ({rotary})' if rotary else ''}.</p>"
        if linear
        else ""
    )
    return f"<table><caption>The {stands}</caption><tr>{head}</tr>{''.join(rows)}</table>{said}"


def _over_the_ball(nominal: Nominal, run: Run) -> dict[str, Array]:
    """Positions of the axes, (1,) each, at which the tool's ball stands where the table's does; none where they cannot."""
    try:
        return nominal.follow(np.array([run.table_ball]), run.tool_ball, {}, "the table ball")
    except InputError:
        return {}


def _from_axes(nominal: Nominal, run: Run) -> dict[str, Array]:
    """From each rotary axis square across to the ball, (3,) mm in the machine frame, rotary axes at home."""
    at = _over_the_ball(nominal, run) or nominal.commands({}, 1)
    ball = nominal.workpiece_origin(at)[0] + nominal.workpiece_rotation(at)[0] @ np.asarray(run.table_ball)
    found = {}
    for name, axis in nominal.machine.axes.items():
        if axis.rotary:
            foot, along = nominal.axis_line(name, at)
            found[name] = ball - foot - (ball - foot) @ along * along
    return found


def _row(name: str, vector: Sequence[float] | Array, distance: float | None = None) -> str:
    numbers = [*map(_digits, vector), "" if distance is None else _digits(distance)]
    cells = "".join(f'<td class="n">{number}</td>' for number in numbers)
    return f"<tr><td>{name}</td>{cells}</tr>"


def _digits(value: float) -> str:
    """mm or degree to 0.001."""
    return f"{round(float(value), 3) + 0.0:.3f}"


def _recording(nominal: Nominal, run: Run) -> str:
    """A recording: what is read, along which path, how each axis moves."""
    machine = nominal.machine
    columns = [column.name for i in instruments_of(run) for column in i.columns(run, machine)]
    facts = {
        "Instrument": f"{_names(run.instrument)}: {', '.join(columns)} into {run.file}",
        "Readings": f"{run.rows}, one every {plain_number(1e3 * run.interval)} ms",
        **_path(nominal, run),
        "Duration": f"{run.duration:.1f} s, from rest to rest",
    }
    listed = "".join(f"<dt>{question}</dt><dd>{escape(answer)}</dd>" for question, answer in facts.items())
    heads = "".join(f"<th>{h}</th>" for h in ("axis", "start", "lowest", "highest", "end", "fastest"))
    rows = ""
    for name in sorted(machine.axis_names, key=lambda name: not machine.axes[name].rotary):
        q, unit = run.commands[name], unit_words(machine.axes[name].unit)
        cells = "".join(f'<td class="n">{_digits(v)}</td>' for v in (q[0], q.min(), q.max(), q[-1]))
        fast = f"{plain_number(run.fastest(q))} {unit}/min" if np.ptp(q) > STILL else "stands still"
        rows += f"<tr><td>{escape(name)} / {unit}</td>{cells}<td>{fast}</td></tr>"
    return f'<dl class="facts">{listed}</dl><table><tr>{heads}</tr>{rows}</table>'


def _path(nominal: Nominal, run: Run) -> dict[str, str]:
    """Radius, plane, direction and feed of the tool ball's path, as the workpiece sees it (the machine where only linear axes
    move)."""
    machine = nominal.machine
    moving = [name for name, q in run.commands.items() if np.ptp(q) > STILL]
    turning = [name for name in moving if machine.axes[name].rotary]
    way = nominal.ball(run.commands, run.tool_ball) - np.asarray(run.table_ball)
    if not turning:
        way = way @ nominal.workpiece_rotation(run.commands)[0].T
    frame = "workpiece frame" if turning else "machine frame"
    _, spread, axes = np.linalg.svd(way - way.mean(axis=0), full_matrices=False)
    wide = spread / np.sqrt(run.rows) > STILL
    if not wide[1]:
        if not wide[0]:
            return _carried(nominal, run, turning, way[0])
        line = way @ axes[0]
        return {
            "Path": f"straight, {plain_number(np.ptp(line))} mm",
            "Feed": f"{plain_number(run.fastest(line))} mm/min",
        }
    normal = axes[2] * np.sign(axes[2][np.argmax(np.abs(axes[2]))])
    ring = way - np.outer(way @ normal, normal)
    radius = np.linalg.norm(ring, axis=1)
    if wide[2] or np.ptp(radius) > STILL:
        return {}
    main = int(np.argmax(normal))
    lean = np.degrees(np.arccos(min(1.0, normal[main])))
    plane, towards = ("yz", "zx", "xy")[main], f"+{'xyz'[main]}"
    if lean > STILL:
        towards = f"({', '.join(map(_digits, normal))})"
        plane = f"leaning by {lean:.1f}° from {plane}"
    u = ring[0] / radius[0]
    phi = np.unwrap(np.arctan2(ring @ np.cross(normal, u), ring @ u))
    sense = "counter-clockwise" if phi[-1] > phi[0] else "clockwise"
    facts = {
        "Circle": f"radius {plain_number(radius[0], 'mm')} mm, {np.degrees(np.ptp(phi)):.0f}° with run-up and run-out",
        "Plane": f"{plane} of the {frame}",
        "Direction": f"{sense}, seen against {towards}",
        "Feed": f"{plain_number(run.fastest(radius[0] * phi))} mm/min along the circle",
    }
    if len(moving) == 2 and len(turning) == 1 and run.length is not None:
        x_t = float(np.linalg.norm(_from_axes(nominal, run)[turning[0]]))
        together = f"{turning[0]} and {next(n for n in moving if n not in turning)} move"
        ratio = f"X_T/r = {plain_number(x_t)}/{plain_number(run.length)} = {plain_number(x_t / run.length)}"
        facts["Together"] = f"{together}; the ball is X_T = {_digits(x_t)} mm from axis {turning[0]}, {ratio}"
    return facts


def _carried(nominal: Nominal, run: Run, turning: Sequence[str], bar: Array) -> dict[str, str]:
    """The tool's ball rests beside the workpiece: how the bar lies to the axis that turns."""
    if len(turning) != 1:
        return {}
    (name,) = turning
    q, home = run.commands[name], nominal.commands({}, 1)
    _, along = nominal.axis_line(name, home)
    across = _from_axes(nominal, run)[name]
    bar = nominal.workpiece_rotation(home)[0] @ bar / max(float(np.linalg.norm(bar)), STILL)
    outward = abs(bar @ across) / max(float(np.linalg.norm(across)), STILL)
    lies = (
        "along"
        if abs(bar @ along) > 0.999
        else "tangential to"
        if outward < STILL < np.linalg.norm(across)
        else "radial to"
    )
    return {
        "Bar": f"{lies} axis {name}, turning with it",
        "Direction": f"{name} {'rising' if q[-1] > q[0] else 'falling'}",
        "Feed": f"{plain_number(run.fastest(q))} {unit_words(nominal.machine.axes[name].unit)}/min of {name}",
    }


def _expected(assessment: Assessment) -> str:
    sigma = assessment.sigma
    rows = "".join(
        f'<tr><td>{escape(p.name)}</td><td class="n">{plain_number(sigma[p.name], p.unit)}</td>'
        f'<td class="n">{plain_number(p.sigma, p.unit)}</td><td>{escape(unit_words(p.unit))}</td></tr>'
        for p in assessment.parameters
        if p.kind in ("effect", "location_error")
    )
    centre = assessment.tool_centre_um
    tail = ""
    if centre is not None:
        tail += "<p>Tool centre point over the workspace: "
        tail += f"1σ {centre[0]:.2g} µm on average, {centre[1]:.2g} µm at worst.</p>"
    for axis, number in assessment.valuation.items():
        tail += f"<p>Quality number of axis {escape(axis)}: {number:.1f} (4 or more is good, below 2 poor).</p>"
    if assessment.confounded:
        words = "".join(f"<li>{escape(c.words)}</li>" for c in assessment.confounded)
        tail += f"<p>Not separable by these readings:</p><ul>{words}</ul>"
    return f"<h2>What to expect</h2><table><tr><th>error</th><th>1σ after</th><th>prior 1σ</th><th></th></tr>{rows}</table>{tail}"


def _unchecked(sheet: Sheet) -> list[str]:
    campaign = sheet.campaign
    words = " ".join(
        collision_warning(campaign.machine, sheet.post, recorded=any(run.dynamic for run in campaign.runs))
    )
    return [f'<p class="warning">{escape(words)}</p>'] if words.startswith(UNCHECKED) else []


def _clearances(sheet: Sheet) -> str:
    workspace, post = sheet.campaign.machine.workspace, sheet.post
    notes = "".join(f"<li>{escape(note)}</li>" for note in sheet.notes)
    notes = f"<ul>{notes}</ul>" if notes else ""
    if workspace.spindle_nose is None or not post.tested:
        return f"<h2>Clearances</h2><p>Not checked, see above.</p>{notes}"
    words = ", ".join(f"{escape(str(key))} {value:g} mm" for key, value in workspace.spindle_nose.items())
    thick = ", ".join(
        f"{name} {'a line' if radius is None else f'of radius {radius:g} mm'}"
        for name, radius in (("post", workspace.post_radius), ("tool", workspace.tool_radius))
    )
    recorded = any(run.dynamic for run in sheet.campaign.runs)
    untested = collision_warning(sheet.campaign.machine, post, recorded=recorded)[-1]
    return (
        f"<h2>Clearances</h2><p>Spindle nose as a cylinder ({words}), {thick}, table and bar keep apart at every pose and on "
        f"every move of the programs from above the first pose to above the last. {escape(untested)}</p>{notes}"
    )

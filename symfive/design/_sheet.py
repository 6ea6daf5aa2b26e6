"""The set-up sheet: one page with all that the person at the machine has to know."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from html import escape
from typing import TYPE_CHECKING

from symfive.campaign import Run
from symfive.design._pose_table import mounted_before, pose_table
from symfive.design._schedule import SETUP_S
from symfive.drawing import SCRIPT, poses_figure
from symfive.nc import Post, collision_warning
from symfive.nc._warning import UNCHECKED
from symfive.numbers import plain_number, unit_words

if TYPE_CHECKING:
    from symfive.design._plan import Plan

__all__ = ["setup_sheet"]

STYLE = """
body { font: 13px/1.45 system-ui, sans-serif; max-width: 62rem; margin: 1.5rem auto; padding: 0 1rem; color: #1a1a1a }
h1 { font-size: 1.3rem; margin-bottom: 0 } h2 { font-size: 1.05rem; margin: 1.2rem 0 .3rem }
table { border-collapse: collapse } td, th { padding: .15rem .8rem .15rem 0; text-align: left; vertical-align: top }
th { font-weight: 600 } td.n { text-align: right; font-variant-numeric: tabular-nums } svg { max-width: 100%; height: auto }
ol { margin: .2rem 0 } .quiet, figcaption { color: #555 } figure { margin: .6rem 0 }
.warning { border: 2px solid #b00020; padding: .4rem .7rem; font-weight: 600 }
td.again { font-weight: 600 } .poses-list td, .poses-list th { border-bottom: 1px solid #ddd; padding-right: 1.1rem }
@media print { .poses-list thead { display: table-header-group } .poses-list tr { break-inside: avoid }
  body { margin: 0; max-width: none } h2 { break-after: avoid } section { break-inside: avoid } }
"""


def setup_sheet(plan: Plan, pictures: Mapping[str, str], programs: Sequence[str], post: Post) -> str:
    """One HTML page that loads nothing; its script turns the picture of all poses. All text from files is escaped.

    `pictures` run → SVG, `programs` their names, `post` what the user decided about them.
    """
    title = f"Set-up sheet: {plan.machine.name}"
    name = {"r_test": "R-test", "ball_bar": "ball bar"}.get(plan.instrument, plan.instrument)
    parts = [
        f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>{escape(title)}</title>',
        f"<style>{STYLE}</style></head><body><h1>{escape(title)}</h1>",
        f'<p class="quiet">{escape(plan.machine.structure.code)} · {escape(name)} · {plan.certificate.points} poses, '
        f"{plan.campaign.rows} readings with return poses · about {plan.minutes:.0f} min with set-up</p>",
        *_unchecked(plan, post),
        f"<p>Certificate: {escape(plan.certificate.says)}.</p>",
        *(_run(plan, run, pictures[run.id], post) for run in plan.campaign.runs),
        f"<section><h2>All poses</h2>{poses_figure(plan.campaign)}</section>",
        _expected(plan),
        _clearances(plan),
    ]
    if programs:
        parts.append(f"<h2>Programs</h2><p>{', '.join(f'<code>{escape(p)}</code>' for p in programs)}</p>")
    parts.append(f"<script>{SCRIPT}</script></body></html>\n")
    return "\n".join(parts)


def _run(plan: Plan, run: Run, picture: str, post: Post) -> str:
    x, y, z = run.table_ball
    steps = [
        "Work offset: the workpiece frame's origin, with all rotary axes at 0.",
        f"Stand the {'nest' if plan.instrument == 'r_test' else 'table ball'} at x = {x:.0f}, y = {y:.0f}, z = {z:.0f} mm "
        "of the workpiece frame (±1 mm).",
        f"Tool ball at {-run.tool_ball[2]:.0f} mm below the spindle nose.",
    ]
    if run.length is not None:
        steps.append(f"Bar of {run.length:g} mm, calibrated length entered.")
    steps.append(f"Start the program of run {escape(run.id)}; it stops where the instrument is to be seated.")
    again = mounted_before(plan.campaign.runs, run)
    if again is not None:
        steps.insert(
            1, f"The same mounting as for run {escape(again.id)}: take off and mount again, its error is drawn anew."
        )
    drawing = picture[picture.index("<svg") :]
    minutes = (run.duration + SETUP_S) / 60.0
    return (
        f"<section><h2>Run {escape(run.id)} · {run.rows} rows · {minutes:.0f} min</h2><ol>"
        + "".join(f"<li>{step}</li>" for step in steps)
        + f"</ol>{drawing}{pose_table(plan.campaign, run, post)}</section>"
    )


def _expected(plan: Plan) -> str:
    sigma = plan.assessment.sigma
    rows = "".join(
        f'<tr><td>{escape(p.name)}</td><td class="n">{plain_number(sigma[p.name], p.unit)}</td>'
        f'<td class="n">{plain_number(p.sigma, p.unit)}</td><td>{escape(unit_words(p.unit))}</td></tr>'
        for p in plan.assessment.parameters
        if p.kind == "location_error"
    )
    centre = plan.assessment.tool_centre_um
    tail = ""
    if centre is not None:
        tail += "<p>Tool centre point over the workspace: "
        tail += f"1σ {centre[0]:.2g} µm on average, {centre[1]:.2g} µm at worst.</p>"
    for axis, number in plan.assessment.valuation.items():
        tail += f"<p>Valuation number of {escape(axis)}: {number:.1f} (from 4 on good, below 2 poor).</p>"
    if plan.assessment.confounded:
        words = "".join(f"<li>{escape(c.words)}</li>" for c in plan.assessment.confounded)
        tail += f"<p>What stays confounded:</p><ul>{words}</ul>"
    return f"<h2>What to expect</h2><table><tr><th>error</th><th>1σ after</th><th>before</th><th></th></tr>{rows}</table>{tail}"


def _unchecked(plan: Plan, post: Post) -> list[str]:
    words = " ".join(collision_warning(plan.machine, plan.campaign.runs[0], replace(post, blocked={})))
    return [f'<p class="warning">{escape(words)}</p>'] if words.startswith(UNCHECKED) else []


def _clearances(plan: Plan) -> str:
    workspace = plan.machine.workspace
    if workspace.spindle_nose is None:
        return "<h2>Clearances</h2><p>Not checked, see above.</p>"
    words = ", ".join(f"{escape(str(key))} {value:g} mm" for key, value in workspace.spindle_nose.items())
    thick = ", ".join(
        f"{name} {'a line' if radius is None else f'of radius {radius:g} mm'}"
        for name, radius in (("post", workspace.post_radius), ("tool", workspace.tool_radius))
    )
    notes = "".join(f"<li>{escape(note)}</li>" for note in plan.notes if note.startswith("run "))
    kept = "keep apart, but for what stands below," if plan.blocked else "keep apart"
    return (
        f"<h2>Clearances</h2><p>Spindle nose as a cylinder ({words}), {thick}, table and bar {kept} at every pose, on the ways "
        f"between them, on approach and on retract ({plan.post.retract_mm:g} mm). Clamps, cables and the nest's sensors are not "
        "known: run the program in air first. The way to the first pose is yours.</p>"
        + (f"<ul>{notes}</ul>" if notes else "")
    )

"""The set-up sheet: one page for the operator, for static poses and recordings."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from typing import Any

import numpy as np

from symfive.campaign import Campaign, Run
from symfive.design._assess import Assessment
from symfive.design._mounting import (
    STILL,
    digits,
    from_axes,
    mounted_before,
    over_the_ball,
    path_facts,
    pose_table,
    short,
)
from symfive.design._schedule import SETUP_S
from symfive.drawing import PAGE_STYLE, SCRIPT, poses_figure, templates
from symfive.instruments import columns_of, has_bar, instruments_of, is_probed, mounted, mounted_instrument
from symfive.machine import Machine
from symfive.nc import (
    UNCHECKED,
    Post,
    addressed,
    circle_of,
    collision_warning,
    retract_words,
    rotary_ranges,
    series_name,
    series_of,
    turned_against,
    upright_axis,
    which_point,
    word_order,
)
from symfive.numbers import plain_number, unit_words
from symfive.procedures import PAUSE_S, Nominal
from symfive.runs import instrument_words
from symfive.screen import plural

DRY_RUN = "Dry-run the programs without the instrument first."
BEFORE = (
    "Bring the machine to its operating temperature first. If a run is interrupted, discard its readings and repeat it from its "
    "start; if what stands on the table or in the spindle was touched, repeat every run of that mounting."
)


@dataclass(frozen=True, kw_only=True)
class Sheet:
    """Content of a sheet: the `campaign` without readings, `post` the user's choices for its programs, `facts` for the
    head, `worth` a sentence, the `assessment` (None: no expected uncertainty), `notes` on the moves, `part` the expected
    error along the part."""

    campaign: Campaign
    post: Post
    facts: str = ""
    worth: str = ""
    assessment: Assessment | None = None
    notes: Sequence[str] = ()
    part: Mapping[str, Any] | None = None


def setup_sheet(sheet: Sheet, pictures: Mapping[str, str], programs: Sequence[str]) -> str:
    """One HTML page that loads nothing; its script turns the picture of all poses. All text from files is escaped.

    `pictures` run → SVG, of those that have one; `programs` their names.
    """
    from markupsafe import Markup

    campaign, nominal = sheet.campaign, Nominal(sheet.campaign.machine)
    own = (files("symfive.design") / "templates" / "sheet.css").read_text(encoding="utf-8")
    drawn = {name: Markup(picture[picture.index("<svg") :]) for name, picture in pictures.items()}
    runs = [_run(sheet, nominal, run) | {"picture": drawn.get(run.id, "")} for run in campaign.runs]
    return templates("symfive.design").get_template("sheet.html").render(
        title=f"Set-up sheet: {campaign.machine.name}", style=Markup(PAGE_STYLE + own), script=Markup(SCRIPT),
        structure=campaign.machine.structure.code, facts=_facts(sheet), before=BEFORE, unchecked=_unchecked(sheet),
        worth=sheet.worth, runs=runs,
        picture=Markup(poses_figure(campaign)), clearances=_clearances(sheet), notes=sheet.notes, programs=programs,
        part=sheet.part,
        expected=_expected(sheet.assessment) if sheet.assessment is not None else None,
    )  # fmt: skip


def _facts(sheet: Sheet) -> str:
    """Instruments, number of readings, time."""
    runs = sheet.campaign.runs
    used = _names(name for run in runs for name in run.instrument)
    minutes = sum(_minutes(sheet, run) for run in runs)
    count = f"{plural(len(runs), 'run')}, {sheet.campaign.rows} readings"
    return f"{used} · {sheet.facts or f'{count} · about {minutes:.0f} min with set-up'}"


def _names(instruments: Iterable[str]) -> str:
    return ", ".join(map(instrument_words, dict.fromkeys(instruments)))


def _minutes(sheet: Sheet, run: Run) -> float:
    """A run with its set-up; a recording with the mounting of an earlier one needs a pause alone."""
    return (run.duration + (PAUSE_S if _stays(sheet, run) else SETUP_S)) / 60.0


def _stays(sheet: Sheet, run: Run) -> bool:
    """Whether a recording needs nothing mounted anew."""
    return run.dynamic and mounted_before(sheet.campaign.runs, run) is not None


def _run(sheet: Sheet, nominal: Nominal, run: Run) -> dict[str, Any]:
    """What the page shows of a run."""
    stands, _ = mounted(run)
    return {
        "id": run.id, "rows": run.rows, "minutes": f"{_minutes(sheet, run):.0f}",
        "steps": _steps(sheet, nominal, run, stands),
        "places": _ball_positions(nominal, run, stands) if stands and not _stays(sheet, run) else None,
        "recording": _recording(nominal, run) if run.dynamic else None,
        "poses": None if run.dynamic else pose_table(sheet.campaign, run, sheet.post),
    }  # fmt: skip


def _steps(sheet: Sheet, nominal: Nominal, run: Run, stands: str) -> list[str]:
    """What the operator does, in order."""
    machine, again = sheet.campaign.machine, mounted_before(sheet.campaign.runs, run)
    programmed, stays = addressed(machine), _stays(sheet, run)
    steps = ["Work offset: origin of the workpiece frame, with all rotary axes at 0."]
    if programmed:
        steps.append(f"In the program: {which_point(machine, run, sheet.post)}.")
        steps += [f"{said}." for said in turned_against(sheet.post)]
    _, held = mounted(run)
    if again is not None:
        tool = "calibrate the probe again" if is_probed(run) else f"remount the {held}"
        anew = f"remount the {stands}, {tool} (new set-up errors)"
        still = f"leave {stands} and {held} in place" if stands else "leave everything in place"
        steps.append(f"The same mounting as for run {again.id}: {still if stays else anew}.")
    if stands and not stays:
        steps += _place(run, stands)
        steps.append(f"{held[0].upper()}{held[1:]} at {short(-run.tool_ball[2])} mm below the spindle nose.")
    same = [
        ids[0] for ids in sheet.campaign.alike("tool_ball") if run.id in ids[1:]
    ]  # an error of its own for each run
    if stands and again is None and same:
        anew = "Calibrate it again" if is_probed(run) else "Remount it in the spindle"
        steps.append(
            f"{anew}: the expected uncertainties assume that its set-up error is new. If it stays as in run {same[0]}, write "
            'mounting = { tool_ball = "1" } into both runs in campaign.toml.'
        )
    if run.length is not None and not stays:
        entered = "in the ball-bar software" if _polar(machine, run) else f"as length of run {run.id} in campaign.toml"
        steps.append(
            f"Bar of {run.length:g} mm: enter its calibrated length {entered}. Readings are relative to it; do not set them to "
            "zero."
        )
    if run.spindle is not None:
        steps.append(
            "The spindle is indexed: the run-out of the tool ball is read at "
            f"{' and '.join(f'{angle:g}°' for angle in np.unique(run.spindle))}. Where the program stops for it, turn the "
            "spindle by hand; the ball stays in the nest."
        )
    if "r_test" in run.instrument:
        steps.append(_lean(nominal, run, stands))
    steps += [*mounted_instrument(run).start(run, machine), *_imported(machine, run, sheet.post)]
    if not programmed:
        return steps
    for series in series_of(machine, sheet.campaign.runs):
        if run in series:
            steps.append(
                f"Or run the program {series_name(series)}: the {len(series)} circles of this mounting, each a recording of its "
                "own; the bar stays mounted."
            )
    return steps + _moves(machine, run, sheet.post)


def _polar(machine: Machine, run: Run) -> bool:
    """Whether the software of a ball bar knows the run as a circle."""
    return has_bar(run) and circle_of(machine, run) is not None


def _imported(machine: Machine, run: Run, post: Post) -> list[str]:
    """How the instrument's own file gets into the campaign, where nobody has to write row by row."""
    if has_bar(run) and circle_of(machine, run) is not None:
        return [
            f"Export deviation over angle into a file that is called {run.id}, one for each run, and import them: symfive "
            "import-polar PLAN FILES -o measured."
        ]
    if not run.dynamic and "r_test" in run.instrument and post.at_pose != "stop":
        return [
            "Read by hand, or record the whole run into one file, from before pose 1 until after the last, and import the files "
            f"of all runs in their order: symfive import-rests PLAN FILES --dwell {post.dwell_s:g} -o measured."
        ]
    return []


def _place(run: Run, stands: str) -> list[str]:
    """Position of the ball or nest on the table, and how well it must be known."""
    x, y, z = map(short, run.table_ball)
    there = f"Mount the {stands} at x = {x}, y = {y}, z = {z} mm of the workpiece frame"
    sigma, (_, held) = next(i.place_sigma(run) for i in instruments_of(run) if i.stands), mounted(run)
    if sigma is None:
        return [f"{there}, within 1 mm: the readings determine its exact position."]
    found = (
        f"{there}, within 1 mm. Probe its centre with the rotary axes as below, and compare with what the control shows there."
        if is_probed(run)  # no tip gets into a sphere
        else f"{there}: drive the {held} there and lock the {stands} under it."
    )
    return [
        found,
        f"The evaluation assumes that this position is known to {plain_number(sigma)} µm (1σ). If the {stands} is off by up to "
        f"1 mm, enter its position as table_ball of run {run.id} in campaign.toml. If you know it less well, enter 1σ in "
        "setup_sigma_um.",
    ]


def _lean(nominal: Nominal, run: Run, stands: str) -> str:
    """Tilt of the tool from the axis of an R-test's nest, and its limit."""
    opening = nominal.machine.workspace.nest_opening
    upright = nominal.seen_from_workpiece(run.commands, nominal.tool_rotation(run.commands)[:, :, 2])[:, 2]
    tilt = np.degrees(np.arccos(np.clip(upright.min(), -1.0, 1.0)))
    tilts = f"The tool tilts up to {tilt:.0f}° from the upright axis of the {stands}"
    if opening is not None:
        return f"{tilts}; {opening:g}° are allowed (nest_opening)."
    return f"{tilts}: check that its sensors leave room for that, or state nest_opening in [workspace] and plan again."


def _moves(machine: Machine, run: Run, post: Post) -> list[str]:
    """The first and the last moves of a run's program, in their order, its retracts and how far its rotary axes turn."""
    up = upright_axis(machine)
    rotary = [name for name in machine.axis_names if machine.axes[name].rotary]
    turned = f"{' and '.join(rotary)}, then " if rotary else ""
    home = ", then " + " and ".join(f"{name} to {machine.home(name):g}°" for name in rotary) if rotary else ""
    ranges = rotary_ranges(machine, run, post)
    top = f"machine coordinate {post.machine_top:g} (ISO: its reference point)"
    return [
        f"First moves, not checked for collisions: {up} alone to the top of its travel, {top}, then {turned}the axes of the "
        f"plane, then {up} down; the program stops before the slow move into position.",
        f"Last moves: back along the same path, no tool offset, {up} alone to the top{home}.",
        *(f"{said}." for said in (retract_words(machine, run, post) if run.id in post.ways else "", ranges) if said),
    ]


def _ball_positions(nominal: Nominal, run: Run, stands: str) -> dict[str, Any]:
    """Its position in the workpiece frame, from each rotary axis, and as the linear axes show it."""
    axes = nominal.machine.axes
    rows = [("workpiece frame", [*map(digits, run.table_ball), ""])]
    rows += [
        (f"from axis {name}", [*map(digits, across), digits(float(np.linalg.norm(across)))])
        for name, across in from_axes(nominal, run).items()
    ]
    there = sorted(over_the_ball(nominal, run).items())
    linear = ", ".join(f"{name} {digits(q[0])}" for name, q in there if not axes[name].rotary)
    rotary = ", ".join(f"{name} {q[0]:g}°" for name, q in there if axes[name].rotary)
    shown = f"{linear} mm{f' ({rotary})' if rotary else ''}" if linear else ""
    return {"stands": stands, "held": mounted(run)[1], "rows": rows, "shown": shown}


def _recording(nominal: Nominal, run: Run) -> dict[str, Any]:
    """A recording: what is read, along which path, how each axis moves."""
    machine, axes = nominal.machine, []
    columns = [column.name for column in columns_of(run, machine)]
    facts = {
        "Instrument": f"{_names(run.instrument)}: {', '.join(columns)} into {run.file}",
        "Readings": f"{run.rows}, one every {plain_number(1e3 * run.interval)} ms",
        **path_facts(nominal, run),
        "Duration": f"{run.duration:.1f} s, from rest to rest",
    }
    for name in word_order(machine):
        q, unit = run.commands[name], unit_words(machine.axes[name].unit)
        fast = f"{plain_number(run.fastest(q))} {unit}/min" if np.ptp(q) > STILL else "at rest"
        numbers = [digits(v) for v in (q[0], q.min(), q.max(), q[-1])]
        axes.append({"name": f"{name} / {unit}", "numbers": numbers, "fastest": fast})
    return {"facts": facts, "axes": axes}


def _expected(assessment: Assessment) -> dict[str, Any]:
    """Expected uncertainty of the machine's errors."""
    sigma, words = assessment.sigma, assessment.tool_centre_words
    sentences = [] if assessment.tool_centre_um is None else [f"{words[0].upper()}{words[1:]}."]
    sentences += [
        f"Quality number of axis {axis}: {number:.1f} (4 or more is good, below 2 poor)."
        for axis, number in assessment.valuation.items()
    ]
    errors = [
        (p.what, plain_number(sigma[p.name], p.unit), plain_number(p.sigma, p.unit), unit_words(p.unit))
        for p in assessment.parameters
        if p.kind in ("effect", "location_error")
    ]
    return {"errors": errors, "sentences": sentences, "confounded": assessment.inseparable}


def _unchecked(sheet: Sheet) -> str:
    """The warning where collisions could not be looked for."""
    campaign = sheet.campaign
    words = " ".join(collision_warning(campaign.machine, sheet.post, campaign.runs))
    return f"{words} {DRY_RUN}" if words.startswith(UNCHECKED) else ""


def _thickness(sheet: Sheet) -> list[tuple[str, float | None]]:
    """Bodies with their radius, mm; None: a line."""
    workspace = sheet.campaign.machine.workspace
    bodies = [("post", workspace.post_radius), ("tool", workspace.tool_radius)]
    if any(has_bar(run) for run in sheet.campaign.runs):
        bodies.append(("bar", workspace.bar_radius))
    return bodies


def _table(sheet: Sheet) -> str:
    """Where the table is taken to be, in words."""
    machine = sheet.campaign.machine
    x, y = machine.table_centre
    wide = machine.workspace.table_radius
    about = "" if wide is None else f" within {wide:g} mm of x = {x:g}, y = {y:g} mm"
    return f"the table (plane z = 0 of the workpiece frame{about})"


def _clearances(sheet: Sheet) -> str:
    """Which bodies keep apart, and where."""
    workspace, post = sheet.campaign.machine.workspace, sheet.post
    if workspace.spindle_nose is None or not post.tested:
        return "Not checked; see above."
    radius, above = (workspace.spindle_nose[key] for key in ("radius", "above_ball"))
    held = next((held for _, held in map(mounted, sheet.campaign.runs) if held), "tool ball")
    nose = f"radius {radius:g} mm, from {above:g} mm above the {held} up"
    thick = ", ".join(
        [
            *(
                f"{name} ({'a line' if radius is None else f'radius {radius:g} mm'})"
                for name, radius in _thickness(sheet)
            ),
            *(f"{name} (a box)" for name in workspace.obstacles or {}),
        ]
    )
    untested = " ".join(collision_warning(sheet.campaign.machine, post, sheet.campaign.runs)[1:])
    return (
        f"Spindle nose (a cylinder: {nose}), {thick} and {_table(sheet)} keep {workspace.clearance:g} mm apart, and linear "
        f"axes {workspace.clearance:g} mm from the ends of their travel, at every pose and on every move of the programs from "
        f"above the first pose to above the last; less only where the measurement itself needs it. {untested} {DRY_RUN}"
    )

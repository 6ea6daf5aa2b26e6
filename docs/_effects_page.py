"""The effects page: formula, parameters and picture of every effect, from docstrings and model."""

from __future__ import annotations

import inspect
import textwrap
from pathlib import Path

from symfive.campaign import Campaign
from symfive.effects import EFFECTS, Effect, Form, make_effect
from symfive.errors import InputError
from symfive.machine import preset
from symfive.procedures import campaign_of, planar_circle, r_test_grid, rotary_circle
from symfive.report import plot_signature

PICTURES = "_build/effects"
OPTIONS: dict[str, tuple[str | None, dict[str, object]]] = {
    "backlash": ("C", {}),
    "transmission_error": ("X", {"period": 10.0}),
    "servo_mismatch": ("C", {}),
    "friction": ("X", {}),
    "location_error": (None, {"component": "EC0Y"}),
    "error_motion": ("C", {"component": "EZC", "basis": ("fourier",), "order": (2,)}),
    "scale_error": ("X", {}),
    "gravity_sag": ("B", {"component": "EXB"}),
    "setup_shift": (None, {"run": "xy-ccw", "t_s": 20.0}),
    "lateral_play": (None, {"component": "EYX"}),
    "vibration": (None, {"frequency_hz": 3.0}),
    "inertial_compliance": ("X", {}),
    "structural_resonance": ("X", {"frequency_hz": 4.0, "damping": 0.05}),
    "unknown": (None, {"over": ("B",)}),
    "reversal_spike": ("X", {}),
    "table_step": ("X", {"at": 20.0, "ramp": 10.0}),
    "counterbalance": ("X", {}),
    "eccentric_mass": ("C", {}),
    "force_delay": ("X", {}),
    "force_friction": ("X", {}),
    "force_ripple": ("X", {"period": 10.0}),
    "force_vibration": ("X", {"frequency_hz": 7.0}),
    "gravity_torque": ("B", {}),
    "held_friction": ("X", {}),
    "load_inertia": ("B", {}),
    "load_moment": ("Y", {}),
    "varying": (None, {"of": make_effect("backlash", "C"), "over": "B"}),
}
"""Axis and options with which an effect is drawn that needs options, or is seen better so than in its first form."""


def campaign() -> Campaign:
    """The short campaign of the pictures."""
    machine = preset("table-bc")
    runs = (
        *r_test_grid(machine, grid={"B": (-90.0, -45.0, 0.0, 45.0, 90.0), "C": (0.0, 90.0, 180.0, 270.0)})[:1],
        *planar_circle(machine, plane="XY", feed=3000.0, rate_hz=25.0),
        *rotary_circle(machine, axis="C", feed=3600.0, rate_hz=25.0),
    )
    return campaign_of(machine, runs, name="pictures")


def effects_page(source: Path) -> str:
    """Markdown of all effects; their pictures are drawn into the build folder."""
    folder = source / PICTURES
    folder.mkdir(parents=True, exist_ok=True)
    plan = campaign()
    return "\n".join(_section(identity, plan, folder) for identity in EFFECTS)


def drawn(identity: str, plan: Campaign) -> Effect:
    """The effect as it is listed; else the plain one, its first candidate that can join, or the plain one on the first axis where
    it can. Raises `InputError` where none can."""
    if identity in OPTIONS:
        axis, options = OPTIONS[identity]
        return make_effect(identity, axis, **options).prepare(plan)
    kind = EFFECTS[identity]
    problem = InputError(f"effect {identity}: it acts nowhere in this campaign")
    forms = [form for form in kind.candidates(plan) if isinstance(form, Form)]
    axes = plan.machine.axis_names if kind.needs_axis else ()
    for effect in (None, *(form.effect for form in forms), *axes):
        try:
            made = effect if isinstance(effect, Effect) else make_effect(identity, effect)
            return made.prepare(plan)
        except InputError as error:
            problem = error
    raise problem


def _section(identity: str, plan: Campaign, folder: Path) -> str:
    kind = EFFECTS[identity]
    module = inspect.getmodule(kind)
    head = textwrap.dedent(inspect.getdoc(module) or "").strip().split("\n\n")[0].replace("\n", " ")
    lines = [f"## {identity}", "", head, "", inspect.getdoc(kind) or "", ""]
    if kind.reported_as:
        lines += [f"Reported as `{kind.reported_as}`.", ""]
    if kind.hidden_by:
        lines += [f"*Hidden by:* {kind.hidden_by}.", ""]
    if kind.action:
        lines += [f"*What to do:* {kind.action}.", ""]
    try:
        effect = drawn(identity, plan)
    except InputError as error:
        return "\n".join([*lines, f"Not drawn here: {error}", ""])
    return "\n".join([*lines, *_parameters(effect, plan), *_picture(effect, plan, folder)])


def _parameters(effect: Effect, plan: Campaign) -> list[str]:
    parameters = effect.parameters(plan)
    if not parameters:
        return []
    rows = [
        f"| `{p.name.removeprefix(effect.key + '.')}` | {p.unit} | {p.mean:g} | {p.sigma:g} |" for p in parameters[:9]
    ]
    more = [f"| … {len(parameters) - 9} more | | | |"] if len(parameters) > 9 else []
    return ["| parameter | unit | prior mean | prior 1σ |", "| --- | --- | --- | --- |", *rows, *more, ""]


def _picture(effect: Effect, plan: Campaign, folder: Path) -> list[str]:
    name = f"{effect.id}.svg"
    drawn = ", ".join(f"{key} = {value}" for key, value in OPTIONS.get(effect.id, (None, {}))[1].items())
    plot_signature(effect, plan).savefig(folder / name)
    where = f" of axis {effect.axis}" if effect.axis else ""
    return [f"![{effect.id}{where}]({PICTURES}/{name})", "", f"*{effect.id}{where}{': ' + drawn if drawn else ''}*", ""]

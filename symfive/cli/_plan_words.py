"""What the words of `symfive plan` mean: part, 1σ asked for, set-up errors, axes, bars, effects."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from symfive.cli import _common as cli
from symfive.errors import InputError, among

if TYPE_CHECKING:
    from symfive.campaign import SetupSigma
    from symfive.effects import Effect
    from symfive.machine import Machine
    from symfive.toolpath import ToolPath

NO_SHIFT = "0,0,0"
CIRCULAR_TEST = "iso-230-4"
SIGMAS = ("tool_ball_sigma", "tool_length_sigma", "table_ball_sigma", "zero_sigma", "length_sigma")
CHOSEN = ("instrument", "criterion", "wanted", "given", "minutes", "no_proof", *SIGMAS)
SEARCHED = ("returns", "starts", "seed", "workers", "scheduler")
SLOW_NOISE = ("coloured_um", "correlation_s")
USED = {
    "a plan of poses": (
        *CHOSEN, *SEARCHED, "points", "until", "per_minute", "setups", "bars", "repeats", "index", "survive", "robust", "frame",
        "part",
    ),
    "a plan with several instruments": (*CHOSEN, *SEARCHED, "setups"),
    "a plan in motion": (*CHOSEN, *SLOW_NOISE, "in_motion", "setups", "bars", "speeds"),
    "a circular test": (*SLOW_NOISE, "circles", "planes", "feeds", "sweep", "bars"),
    "a plan of circles": (
        "circles", "planes", "feeds", "effects", "count", "bars", "criterion", "wanted", "robust", "per_minute", "no_proof",
    ),
}  # fmt: skip
"""Options that not every plan uses, by kind of plan."""
OF_INSTRUMENT = {
    "ball_bar": ("bars", "length_sigma"),
    "r_test": ("index", "frame", "zero_sigma"),
    "touch_probe": ("sphere_radius", "tip_radius", "probe_on", "probe_off", "probe_tool"),
}
"""Options that only one instrument has."""
LISTS = ("instrument", "wanted")
"""Options that are names between commas."""


def names_in(words: str) -> tuple[str, ...]:
    """Names between commas."""
    return tuple(name.strip() for name in words.split(",") if name.strip())


def refuse_unused(context: click.Context, instruments: Sequence[str]) -> None:
    """Refuse options that the kind of plan asked for, or its instruments, would not use. Raises `InputError`."""
    asked = context.params
    if asked["in_motion"]:
        kind = "a plan in motion"
    elif asked["circles"] is not None:
        kind = "a circular test" if asked["circles"] == CIRCULAR_TEST else "a plan of circles"
    else:
        kind = "a plan with several instruments" if len(instruments) > 1 else "a plan of poses"
    for name in LISTS:
        for option in _given(context, [name]) if not names_in(asked[name]) else ():
            raise InputError(f'{option} "{asked[name]}" names nothing', remedy=f"name something, or leave out {option}")
    unused = {name for names in USED.values() for name in names} - set(USED[kind])
    for option in _given(context, sorted(unused)):
        raise InputError(f"{option} has no use in {kind}", remedy=f"leave out {option}")
    instruments = ("ball_bar",) if asked["circles"] is not None else instruments
    for instrument, names in OF_INSTRUMENT.items():
        for option in _given(context, names) if instrument not in instruments else ():
            raise InputError(
                f"{option} is for {instrument}", remedy=f"leave out {option}, or add --instrument {instrument}"
            )


def _given(context: click.Context, names: Sequence[str]) -> list[str]:
    """Options of these names that the command line has."""
    return [
        parameter.opts[0]
        for parameter in context.command.params
        if parameter.name in names and context.get_parameter_source(parameter.name) is ParameterSource.COMMANDLINE
    ]


def part_of(
    machine: Machine, path: Path | None, *,
    part_tool: float | None, part_zero: str, part_tool_centre: bool, part_datum: bool,
) -> ToolPath | None:  # fmt: skip
    """The part's tool path. Raises `InputError` for options of a part without one."""
    from symfive.toolpath import read_tool_path

    if path is None:
        if part_tool is not None or part_tool_centre or part_datum or part_zero != NO_SHIFT:
            problem = "--part-tool, --part-zero, --part-tool-centre and --part-datum belong to a part and none is given"
            raise InputError(problem, remedy="add --part FILE")
        return None
    zero = cli.point_of("--part-zero", part_zero)
    return read_tool_path(
        path, machine, tool_length=part_tool, zero=zero, tool_centre=part_tool_centre, datum=part_datum
    )


def until_of(words: Sequence[str]) -> dict[str, float]:
    """NAME=1σ with its unit, as `EX0C=2um`, by name. Raises `InputError` for what is none, and for a unit of another kind."""
    found = {}
    for word in words:
        name, _, size = word.partition("=")
        number = size.replace("µ", "u").removesuffix("um").removesuffix("urad").strip()
        unit = size.replace("µ", "u").strip().removeprefix(number).strip()
        own = "urad" if name.strip()[1:2] in ("A", "B", "C") else "um"
        if unit not in ("", own):
            raise InputError(
                f"--until {word}: the unit of {name} is {own}", remedy=f"write --until {name}={number}{own}"
            )
        try:
            found[name.strip()] = float(number)
        except ValueError:
            raise InputError(f"--until {word} is not NAME=1σ", remedy="write --until EX0C=2um") from None
    return found


def setup_sigma_of(given: Mapping[str, float | None]) -> SetupSigma:
    """Set-up errors as the options give them (`tool_ball_sigma`, …), the others as usual."""
    from symfive.campaign import SetupSigma

    known: dict[str, Any] = {name.removesuffix("_sigma"): sigma for name, sigma in given.items() if sigma is not None}
    return SetupSigma(**known)


def rotary_of(machine: Machine, names: str) -> tuple[str, ...]:
    found = names_in(names)
    for name in found:
        among(name, machine.rotary_axes, f"the machine has no rotary axis {name} to reverse")
    return found


def one_bar(bars: Sequence[float]) -> float | None:
    if len(bars) > 1:
        raise InputError(f"a circular test has one bar, {len(bars)} are given", remedy="give --bar once")
    return bars[0] if bars else None


def bars_of(machine: Machine) -> tuple[float, ...]:
    return machine.workspace.bar_lengths or (50.0,)


def effects_of(words: Sequence[str], family: str) -> list[Effect]:
    from symfive.design import FAMILIES
    from symfive.effects import make_effect

    among(family, [CIRCULAR_TEST, *FAMILIES], f'there are no "{family}" circles')
    if not words:
        raise InputError("circles are chosen for effects and none is named", remedy="add --effect backlash:C")
    return [make_effect(name, axis or None) for name, _, axis in (word.partition(":") for word in words)]

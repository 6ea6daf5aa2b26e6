"""What the words of `symfive plan` mean: part, 1σ asked for, set-up errors, axes, bars, effects."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from symfive.cli._common import point_of
from symfive.errors import InputError

if TYPE_CHECKING:
    from symfive.campaign import SetupSigma
    from symfive.effects import Effect
    from symfive.machine import Machine
    from symfive.toolpath import ToolPath

NO_SHIFT = "0,0,0"
CIRCULAR_TEST = "iso-230-4"
ALONE = ("part", "until", "per_minute", "bars", "points", "setups", "repeats", "frame", "index", "survive", "robust")
"""Options of a plan with one instrument."""
AT_REST = (
    "part", "until", "per_minute", "points", "repeats", "frame", "index", "survive", "robust", "returns", "circles", "starts",
    "seed", "workers",
)  # fmt: skip
"""Options of a plan at rest, and of circles."""


def names_in(words: str) -> tuple[str, ...]:
    """Names between commas."""
    return tuple(name.strip() for name in words.split(",") if name.strip())


def refuse_with_several(context: click.Context) -> None:
    """Refuse options that a plan with several instruments has not, and one without minutes to share. Raises `InputError`."""
    for option in _given(context, ALONE):
        raise InputError(f"{option} is for one instrument", remedy=f"leave out {option}, or name one instrument")
    if context.params["minutes"] is None:
        raise InputError("several instruments need minutes to share", remedy="add --minutes, as --minutes 20")


def refuse_in_motion(context: click.Context) -> None:
    """Refuse options that a plan in motion has not. Raises `InputError`."""
    for option in _given(context, AT_REST):
        raise InputError(f"a plan in motion has no {option}", remedy=f"leave out {option}, or --in-motion")


def _given(context: click.Context, names: Sequence[str]) -> list[str]:
    """Options of these names that the command line has."""
    return [
        parameter.opts[0]
        for parameter in context.command.params
        if parameter.name in names and context.get_parameter_source(parameter.name) is ParameterSource.COMMANDLINE
    ]


def part_of(
    machine: Machine, path: Path | None, circles: str | None, *,
    part_tool: float | None, part_zero: str, part_tool_centre: bool, part_datum: bool,
) -> ToolPath | None:  # fmt: skip
    """The part's tool path. Raises `InputError` for options of a part without one, and with circles."""
    from symfive.toolpath import read_tool_path

    if path is None:
        if part_tool is not None or part_tool_centre or part_datum or part_zero != NO_SHIFT:
            problem = "--part-tool, --part-zero, --part-tool-centre and --part-datum belong to a part and none is given"
            raise InputError(problem, remedy="add --part FILE")
        return None
    if circles is not None:
        raise InputError("a plan for a part has poses, no circles", remedy="leave out --circles, or --part")
    zero = point_of("--part-zero", part_zero)
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
        if name not in machine.rotary_axes:
            there = ", ".join(machine.rotary_axes) or "none"
            raise InputError(f"the machine has no rotary axis {name} to reverse", remedy=f"use one of {there}")
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

    if family not in FAMILIES:
        problem = f'there are no "{family}" circles'
        raise InputError(problem, remedy=f"use one of {', '.join([CIRCULAR_TEST, *FAMILIES])}")
    if not words:
        raise InputError("circles are chosen for effects and none is named", remedy="add --effect backlash:C")
    return [make_effect(name, axis or None) for name, _, axis in (word.partition(":") for word in words)]

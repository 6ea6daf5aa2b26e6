"""Target `linuxcnc`: a kinematics component for halcompile, one HAL pin per error, over the C sources of target `c`."""

from __future__ import annotations

import re

import numpy as np

from symfive.codegen._sources import Sources, filled
from symfive.codegen._subject import Subject
from symfive.compiled.scalar import number
from symfive.errors import InputError

WORLD = "XYZABCUVW"
LONGEST_PIN = 47  # HAL_NAME_LEN


def linuxcnc_files(subject: Subject, prefix: str) -> dict[str, str]:
    """File names and their text. Raises `InputError` for axes that LinuxCNC has no letter for, or without X, Y and Z."""
    sources = Sources(subject, prefix)
    _check(sources)
    letters = [letter for letter in WORLD if letter in subject.axes]
    pins = pin_names(subject, prefix)
    names = {**sources.names, "joints": " ".join(letters)}
    hal = [
        f"# HAL lines for {prefix}kins, made by symfive. Values: um and urad; 0 switches an error off.",
        f"loadrt {prefix}kins",
        f"# net tool-length motion.tooloffset.z => {prefix}kins.tool-offset",
        "# net kinematics motion.analog-out-03 => motion.switchkins-type",
        "# M68 E3 Q0: words are the tool centre point; M68 E3 Q1: the axes' positions; M66 E0 L0 after each.",
    ]
    spread = () if subject.covariance is None else subject.expanded(np.eye(len(pins)))
    if len(spread):
        hal.append("# U is the expanded uncertainty (k = 2), from the fit alone; a value within it may as well be 0.")
    for i, (pin, value) in enumerate(zip(pins, subject.values, strict=True)):
        if len(spread):
            within = ": within uncertainty" if abs(value) < spread[i] else ""
            hal.append(f"# U (k = 2) {float(f'{spread[i]:.2g}'):g} {subject.parameters[i].unit}{within}")
        hal.append(f"setp {prefix}kins.{pin} {number(value)}")
    return {
        f"{prefix}.h": sources.header(),
        f"{prefix}.c": sources.source(),
        f"{prefix}_kins.c": filled("kins.c", **names, **_assignments(subject, letters, prefix.upper())),
        f"{prefix}kins.comp": filled(
            "kins.comp", pin_names=",\n".join(f'        "{pin}"' for pin in pins or [""]),
            comp_machine=re.sub(r"[^A-Za-z0-9 .,-]", " ", subject.machine.name), **names,
        ),
        f"{prefix}kins.hal": "\n".join(hal) + "\n",
    }  # fmt: skip


def pin_names(subject: Subject, prefix: str) -> list[str]:
    """One HAL name per parameter: its own name with what HAL does not take turned into `-`, each once."""
    room = LONGEST_PIN - len(f"{prefix}kins.")
    found: list[str] = []
    for i, parameter in enumerate(subject.parameters):
        name = re.sub(r"[^A-Za-z0-9.]+", "-", parameter.name).strip("-")
        found.append(name if len(name) <= room and name not in found else f"p{i}")
    return found


def _check(sources: Sources) -> None:
    machine = sources.machine
    for name in machine.axis_names:
        if name not in WORLD or machine.axes[name].rotary != (name in "ABC"):
            problem = f"LinuxCNC has no {machine.axes[name].kind} axis called {name}"
            raise InputError(problem, remedy=f"name linear axes X Y Z U V W and rotary ones A B C, not {name}")
    missing = [name for name in "XYZ" if name not in machine.axes]
    if missing:
        raise InputError(
            f"the machine has no axis {missing[0]}, so that LinuxCNC's x, y and z cannot be reached",
            remedy="use the target c",
        )


def _assignments(subject: Subject, letters: list[str], macro: str) -> dict[str, str]:
    """The lines that copy between joints, world coordinates and q."""
    place = {name: i for i, name in enumerate(subject.axes)}

    def factor(letter: str) -> str:
        return f" * {macro}_DEGREE" if letter in "ABC" else ""

    own = [f"joints[{letters.index(c)}]" if c in letters else "0.0" for c in WORLD]
    lines = {
        "from_joints": [f"q[{place[c]}] = joints[{j}]{factor(c)};" for j, c in enumerate(letters)],
        "to_world": [f"    world[{i}] = {own[i]};" for i, c in enumerate(WORLD) if c not in "XYZ"],
        "from_world": [f"q[{place[c]}] = world[{WORLD.index(c)}]{factor(c)};" for c in letters],
        "to_joints": [f"    joints[{j}] = {f'q[{place[c]}]' if c in 'XYZ' else f'world[{WORLD.index(c)}]'};"
                      for j, c in enumerate(letters)],
        "axes_to_world": [f"world[{i}] = {own[i]};" for i in range(len(WORLD))],
        "world_to_axes": [f"joints[{j}] = world[{WORLD.index(c)}];" for j, c in enumerate(letters)],
    }  # fmt: skip
    return {key: "\n".join(f"    {line}" for line in found) for key, found in lines.items()}

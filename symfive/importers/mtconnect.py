"""A machine file from an MTConnect probe, as far as the document tells the machine: a skeleton to be completed.

Read are the Linear and Rotary components of one device (any 1.x or 2.x): their names, the chain of their `Motion` elements with
axis and place (from 1.7 on), travel, feed and acceleration from `Specifications` or the older `Constraints` (MTConnect standard,
device information model). Nothing is assumed silently: what the document leaves open is a comment in the file.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tomlkit

from symfive.errors import InputError, inside
from symfive.files import one_line, shown
from symfive.importers._motions import Motions
from symfive.importers._xml import Element, number, read_xml
from symfive.machine import DEFAULT_DIRECTION, SCHEMA, Machine, Structure, default_kind, make_axis
from symfive.toml_files import parse_toml

KINDS = {"Linear": "linear", "Rotary": "rotary"}
TO_DO = ("fill in", "check")
"""How the comments begin that ask the user for something."""
SPEEDS = {"DEGREE/SECOND": 60.0, "REVOLUTION/MINUTE": 360.0, "REVOLUTION/SECOND": 21600.0}
QUANTITIES: dict[str, dict[str, tuple[tuple[str, ...], dict[str, float]]]] = {
    "linear": {
        "travel": (("POSITION",), {"MILLIMETER": 1.0, "INCH": 25.4}),
        "max_feed": (("VELOCITY", "AXIS_FEEDRATE"), {"MILLIMETER/SECOND": 60.0}),
        "max_acceleration": (("ACCELERATION", "LINEAR_ACCELERATION"), {"MILLIMETER/SECOND^2": 1.0}),
    },
    "rotary": {
        "travel": (("ANGLE", "POSITION"), {"DEGREE": 1.0}),
        "max_feed": (("ANGULAR_VELOCITY", "ROTARY_VELOCITY", "VELOCITY"), SPEEDS),
        "max_acceleration": (("ANGULAR_ACCELERATION",), {"DEGREE/SECOND^2": 1.0}),
    },
}
"""Key of an axis' table: the types that tell it, and the factor of each unit. The first unit is the standard's own."""
UNTIL = {"linear": "in mm (until then ±1000 mm)", "rotary": "in degree (until then ±360°)"}
OF_WORK = ("WORK", "WORKPIECE", "OBJECT", "TASK", "TOOL")
"""Coordinate systems that offsets move: limits in them are no travel."""


@dataclass(frozen=True, eq=False)
class _Component:
    """A Linear or Rotary component: the names that a structural code can hold, best first; whether it only spins a tool."""

    element: Element
    kind: str
    names: tuple[str, ...]
    spindle: bool
    motion: Element | None

    def moves(self, type: str) -> bool:
        return self.motion is not None and self.motion.get("type") == type


def read_mtconnect(path: Path | str, *, device: str = "", code: str = "") -> Machine:
    """The machine that an MTConnect probe describes; `write_machine` writes it with its comments.

    `device` its name, uuid or id, where the document holds several; `code` the structural code, where the document does not
    tell it (no `Motion` elements, or no spindle at the end of one of two chains) or tells it wrongly: its axes are those of the
    machine. What the document does not hold is missing in the file, too, and a comment there asks for it. Raises `InputError`
    naming file and line.
    """
    path = Path(path)
    root = read_xml(path)
    with inside(path=path):
        chosen = _device(root, device)
        components = [_component(element) for element in chosen.inside(*KINDS)]
        axes = [c for c in components if not c.spindle and not c.moves("FIXED")]
        if not components or not (axes or code):
            raise chosen.error("the device has no Linear or Rotary axis", "give the probe of a machine tool")
        motions = Motions(chosen)
        named = _named_by(code, components) if code else _named(axes)
        spindles = [c for c in components if c.spindle and c not in named.values()]
        structure, how = _given(code, named, spindles, motions) if code else _from_motions(named, spindles, motions)
        comments = [f"structure: {how}", *_remarks(components, named, motions)]
        tables = {name: _axis(name, named[name], structure, motions) for name in structure.axes}
    return _machine(one_line(chosen.get("name") or chosen.get("id") or "machine"), structure, comments, tables)


def _device(root: Element, wanted: str) -> Element:
    remedy = "save what the agent answers to …/probe"
    if root.tag != "MTConnectDevices":
        raise root.error(f"the document is {shown(root.tag)}, not MTConnectDevices", remedy)
    devices = list(root.at("Devices", "Device"))
    if not devices:
        raise root.error("the document has no Device", remedy)
    found = [d for d in devices if wanted in (d.get("name"), d.get("uuid"), d.get("id"))] if wanted else devices
    if len(found) != 1:
        names = ", ".join(d.get("name") or d.get("id") for d in devices)
        there = f"{len(found)} devices called {shown(wanted)}" if wanted else f"{len(devices)} devices"
        raise InputError(f"the document has {there}", remedy=f"choose one with --device: {names}")
    return found[0]


def _component(element: Element) -> _Component:
    kind = KINDS[element.tag]
    names = [element.get(key) for key in ("nativeName", "name", "id")]
    usable = [n for n in names if n.isascii() and n.isalnum() and n[0].isalpha() and n not in ("w", "b", "t")]
    usable.sort(key=lambda name: default_kind(name) != kind)  # the letters of ISO 841 first
    motion = next(element.at("Configuration", "Motion"), None)
    return _Component(element, kind, tuple(dict.fromkeys(usable)), _spins(element), motion)


def _spins(element: Element) -> bool:
    """Whether a Rotary is a spindle: SPINDLE is its only mode, or, without modes, it reports a speed and no angle."""
    items = list(element.at("DataItems", "DataItem"))
    modes = {v.text for item in items if item.get("type") == "ROTARY_MODE" for v in item.at("Constraints", "Value")}
    types = {item.get("type") for item in items}
    angle, speed = {"ANGLE", "POSITION", "ANGULAR_VELOCITY"}, {"ROTARY_VELOCITY", "SPINDLE_SPEED"}
    return modes == {"SPINDLE"} or (not modes and bool(types & speed) and not types & angle)


def _named(axes: Sequence[_Component]) -> dict[str, _Component]:
    named: dict[str, _Component] = {}
    for axis in axes:
        name = next((name for name in axis.names if name not in named), None)
        if name is None:
            problem = f"this {axis.element.tag} has no name of its own that a structural code can hold"
            raise axis.element.error(problem, "give it a name of letters and digits")
        named[name] = axis
    return named


def _named_by(code: str, components: Sequence[_Component]) -> dict[str, _Component]:
    """The components that the axes of a structural code mean; spindles only where nothing else bears the name."""
    named = {}
    for name in Structure.parse(code).axes:
        matches = [c for c in components if name in c.names]
        if not matches:
            there = ", ".join(c.names[0] for c in components if c.names) or "none with a usable name"
            raise InputError(f"the document has no axis {name} of the code {shown(code)}", remedy=f"it has {there}")
        named[name] = min(matches, key=lambda c: (c.spindle, c.names.index(name)))
    if len({id(c) for c in named.values()}) < len(named):
        raise InputError(f"two axes of the code {shown(code)} are one component", remedy="name each axis once")
    return named


def _given(
    code: str, named: Mapping[str, _Component], spindles: Sequence[_Component], motions: Motions
) -> tuple[Structure, str]:
    """The structural code that the user gives, and how it goes with the document."""
    structure = Structure.parse(code)
    try:
        stated, _ = _from_motions(named, spindles, motions)
    except InputError:
        return structure, "as given, not from the document"
    return structure, "as given" + ("" if stated == structure else f"; the Motion elements give {stated.code}")


def _from_motions(
    named: Mapping[str, _Component], spindles: Sequence[_Component], motions: Motions
) -> tuple[Structure, str]:
    """The structural code of the Motion elements, and how it was found. Raises `InputError` where they leave it open."""
    remedy = "give it with --code, as in --code \"w C' B' X' Y' b Z t\""
    without = ", ".join(name for name, c in named.items() if c.motion is None)
    if without:
        problem = f"the order of the axes {', '.join(named)} is not in the document ({without} without Motion)"
        raise InputError(problem, remedy=remedy)
    name_of = {id(c.motion): name for name, c in named.items()}

    def chain(component: _Component) -> tuple[str, ...]:
        """The axes from the bed to this component."""
        links = [] if component.motion is None else motions.lineage(component.motion)
        return tuple(name_of[id(link)] for link in reversed(links) if id(link) in name_of)

    chains = [chain(c) for c in named.values()]
    ends = [c for c in chains if not any(other[: len(c)] == c for other in chains if other != c)]
    if len(ends) > 2 or len({end[0] for end in ends}) < len(ends):
        problem = f"the Motion elements of the axes {', '.join(named)} make no one or two chains from the bed"
        raise InputError(problem, remedy=remedy)
    first, second = ends[0], ends[1] if len(ends) > 1 else ()
    either = [Structure(tuple(reversed(b)), a) for a, b in ((first, second), (second, first))]
    held = {chain(s): s for s in spindles if s.motion is not None}
    right = [structure for structure in either if len(held) == 1 and structure.tool in held]
    if len(right) != 1:
        codes = " or ".join(f'--code "{structure.code}"' for structure in either)
        raise InputError("the document does not tell which chain carries the tool", remedy=f"give {codes}")
    name = next((n for s in held.values() for n in s.names), "in it")
    return right[0], f"from the Motion elements; the chain with the spindle {name} is taken as the tool's"


def _remarks(components: Sequence[_Component], named: Mapping[str, _Component], motions: Motions) -> list[str]:
    found = []
    used = {id(c) for c in named.values()}
    rest = [c for c in components if id(c) not in used]
    if rest:
        words = (next(iter(c.names), "one without a name") + (" (a spindle)" if c.spindle else "") for c in rest)
        found.append(f"left out: {', '.join(words)}")
    if any(c.motion is not None for c in named.values()):
        system = f"coordinate system {shown(motions.frame)}" if motions.frame else "own coordinate system"
        found.append(f"directions and origins: in the document's {system}; the workpiece frame lies there at zero, too")
    without = [name for name, c in named.items() if c.motion is None or motions.axis(c.motion) is None]
    if without:
        found.append(
            f"check directions of {', '.join(without)}: not in the document, those of their letters hold (ISO 841)"
        )
    return [*found, "no such document holds them: add [errors], and [axes.X.drive] for recordings in motion"]


def _axis(name: str, component: _Component, structure: Structure, motions: Motions) -> tuple[dict[str, Any], list[str]]:
    """The axis' table and the comments for it. Raises `InputError` at the component's line."""
    table, comments = _geometry(name, component, structure.carries(name) == "workpiece", motions)
    for key in QUANTITIES[component.kind]:
        limits, words = _limits(component, key, motions)
        if limits is not None:
            table[key] = limits if key == "travel" else limits[1]
        elif key == "travel":
            words += "; it turns without end" if component.moves("CONTINUOUS") else ""
            form = f"[lowest, highest] {UNTIL[component.kind]}"
            comments.append(f"fill in travel of {name} = {form}: not in the document{words}")
        elif words:
            comments.append(f"check {key} of {name}{words}")
    with inside(line=component.element.line):
        make_axis(name, **table)
    return table, comments


def _geometry(name: str, component: _Component, carried: bool, motions: Motions) -> tuple[dict[str, Any], list[str]]:
    """Kind, direction and origin. The document tells how a component itself moves; the machine file how the tool moves
    relative to the workpiece (ISO 841), which is the other way round for an axis that carries the workpiece."""
    table: dict[str, Any] = {} if default_kind(name) == component.kind else {"kind": component.kind}
    comments = []
    letter = name[0].upper()
    usual = DEFAULT_DIRECTION[letter] if default_kind(letter) == component.kind else None
    stated = None if component.motion is None else motions.axis(component.motion)
    if stated is not None:
        direction = (-stated if carried else stated) + 0.0
        table["direction"] = tuple(float(v) for v in direction)
        if usual is not None and direction @ usual < -0.99 * math.hypot(*direction):
            comments.append(f"check direction of {name}: by the document it moves against ISO 841")
        if component.motion is not None and motions.turned(component.motion):
            words = "its Motion turns, and the standard leaves open whether Axis does, too"
            comments.append(f"check direction of {name}: {words}")
    elif usual is None:
        problem = f"the direction of axis {name} is not in the document, and its name is no letter of ISO 841"
        raise component.element.error(problem, "add an Axis to its Motion")
    elif name not in DEFAULT_DIRECTION:
        table["direction"] = usual
    if component.kind == "rotary":
        origin = None if component.motion is None else motions.origin(component.motion)
        if origin is None:
            form = "[x, y, z] in mm, a point on the axis (until then 0, 0, 0)"
            comments.append(f"fill in origin of {name} = {form}: not in the document")
        else:
            table["origin"] = tuple(float(v) for v in origin.round(9) + 0.0)
    return table, comments


def _limits(component: _Component, key: str, motions: Motions) -> tuple[tuple[float, float] | None, str]:
    """Lowest and highest value in the machine file's unit, else None; and what there is instead, in words."""
    types, factors = QUANTITIES[component.kind][key]
    element, words = component.element, ""
    items = [(item, item) for item in element.at("Configuration", "Specifications", "Specification")]
    items += [(item, c) for item in element.at("DataItems", "DataItem") for c in item.at("Constraints")]
    for item, holder in items:
        system = motions.systems.get(item.get("coordinateSystemIdRef"))
        if (item.get("coordinateSystem") if system is None else system.get("type")) in OF_WORK:
            continue
        low, high, nominal = (
            next((number(e) for e in holder.at(tag)), None) for tag in ("Minimum", "Maximum", "Nominal")
        )
        if key == "travel" and item.get("type") == "LENGTH" and nominal is not None:
            words = f"; its length is {nominal:g} {item.get('units')}"
        if item.get("type") not in types or high is None or (low is None and key == "travel"):
            continue
        factor = factors.get(item.get("units") or next(iter(factors)))
        if factor is not None:
            return (factor * (low or 0.0), factor * high), ""
        words = f"; line {item.line} has it in {shown(item.get('units'))}"
    return None, words


def _machine(
    name: str, structure: Structure, remarks: Sequence[str], tables: Mapping[str, tuple[dict[str, Any], list[str]]]
) -> Machine:
    document = tomlkit.document()
    for line in (f"from an MTConnect probe, device {shown(name)}: a skeleton, to be completed", *remarks):
        document.add(tomlkit.comment(line))
    for key, text in (("schema", SCHEMA), ("name", name), ("structure", structure.code)):
        document.add(key, text)
    axes = tomlkit.table(is_super_table=True)
    for axis, (values, comments) in tables.items():
        table = tomlkit.table()
        for key, value in values.items():
            table.add(key, list(value) if isinstance(value, tuple) else value)
        for line in comments:
            table.add(tomlkit.comment(line))
        axes.add(axis, table)
    document.add("axes", axes)
    text = tomlkit.dumps(document)
    made = {axis: make_axis(axis, **values) for axis, (values, _) in tables.items()}
    return Machine(
        name=name, structure=structure, axes=made, comments=parse_toml(Path("machine"), text).comments, text=text
    )

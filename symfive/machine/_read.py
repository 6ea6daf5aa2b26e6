"""Machine files: TOML to `Machine` and back without loss (docs: conventions, section 4)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import fields
from pathlib import Path
from typing import Any, TypeVar

from symfive.errors import InputError
from symfive.files import shown
from symfive.machine._axis import UNREAD, Axis, Drive, make_axis
from symfive.machine._data import EffectEntry, Machine, Workspace, check_error, unknown_axis
from symfive.machine._errors import ErrorTerm, axis_of_error
from symfive.machine._structure import DEFAULT_DIRECTION, Structure, default_kind
from symfive.machine._suggest import meant, nearest_error, place_of, refuse_slips
from symfive.outputs import write_text
from symfive.toml_files import TomlFile, parse_toml, read_toml, refuse_what_toml_lacks, rewritten_toml
from symfive.validation import as_lists, as_tuples

SCHEMA = "symfive.machine/1"
T = TypeVar("T")
_TOP = ("schema", "name", "structure", "axes", "errors", "workspace", "model")


def read_machine(path: Path | str) -> Machine:
    """Read a machine file. Unknown keys are kept in `extra`; see `unknown_keys`.

    Raises `InputError` with the line; a key that is close to a known one counts as a typing error.
    """
    return _from_toml(read_toml(Path(path)))


def machine_problems(path: Path | str) -> tuple[Machine | None, list[InputError]]:
    """The machine, None where it cannot be read, and all that is wrong with its file rather than the first."""
    found: list[InputError] = []
    try:
        return _from_toml(read_toml(Path(path)), _Problems(found)), found
    except InputError as error:
        return None, [*found, error]


def machine_from_data(data: Mapping[str, Any], source: str = "machine") -> Machine:
    """The same from nested mappings (as a `model.json` holds them)."""
    file = TomlFile(Path(source), "", data, ())
    _table(file, data, "machine")
    refuse_what_toml_lacks(file)
    return _from_toml(file)


def unknown_keys(machine: Machine) -> tuple[str, ...]:
    """Keys of the machine file that symfive does not know; they are kept and written back."""
    found = [key for key in machine.extra if key != "model"]
    found += [f"model.{key}" for key in machine.extra.get("model", {})]
    for axis in machine.axes.values():
        found += [f"axes.{axis.name}.{key}" for key in axis.extra]
        if axis.drive is not None:
            found += [f"axes.{axis.name}.drive.{key}" for key in axis.drive.extra]
    for term in machine.errors.values():
        found += [f"errors.{term.name}.{key}" for key in term.extra]
    return (*found, *(f"workspace.{key}" for key in machine.workspace.extra))


def write_machine(machine: Machine, path: Path | str) -> None:
    """Write a machine file, whole or not at all; a machine read from a file keeps its comments and layout."""

    def read(text: str) -> dict[str, Any]:
        return machine_to_data(_from_toml(parse_toml(Path("machine"), text)))

    text = rewritten_toml(machine.text, machine_to_data(machine), read, machine.comments, sections=("axes",))
    write_text(Path(path), text, to_edit=True)


class _Problems:
    """Problems of single entries: without a list the first one ends the reading, else all are `found`."""

    def __init__(self, found: list[InputError] | None = None) -> None:
        self.found = found

    @contextmanager
    def __call__(self) -> Iterator[None]:
        try:
            yield
        except InputError as error:
            if self.found is None:
                raise
            self.found.append(error)


def _from_toml(file: TomlFile, problem: _Problems | None = None) -> Machine:
    problem = problem or _Problems()
    data = dict(file.data)
    file.require_schema(SCHEMA)
    code = data.get("structure")
    if not isinstance(code, str):
        raise file.error("there is no structural code", "structure", remedy="add structure = \"w C' B' X' Y' b Z t\"")
    name = data.get("name", "machine")
    if not isinstance(name, str) or not name.isprintable():
        raise file.error(f"name = {shown(name)} is not one line of printed text", "name", remedy='write name = "…"')
    tables = {key: _table(file, data.get(key, {}), key) for key in ("axes", "errors", "workspace", "model")}
    extra = {key: value for key, value in data.items() if key not in _TOP}
    with problem():
        refuse_slips(file, (), data, _TOP)
    if set(tables["model"]) - {"effects"}:
        extra["model"] = {key: value for key, value in tables["model"].items() if key != "effects"}
    structure = _placed(file, ("structure",), lambda: Structure.parse(code))
    axes = _axes(file, structure, tables["axes"], problem)
    errors: dict[str, ErrorTerm] = {}
    for key, entry in tables["errors"].items():
        with problem():
            errors[key] = _error_term(file, key, entry, axes)
    workspace, effects = Workspace(), tuple[EffectEntry, ...]()
    with problem():
        refuse_slips(file, ("workspace",), tables["workspace"], _names(Workspace))
        workspace = _placed(file, ("workspace",), lambda: Workspace(**_known(Workspace, tables["workspace"])))
    with problem():
        effects = _effects(file, tables["model"].get("effects", []))
    with file.placing():
        machine = Machine(
            name=name, structure=structure, axes=axes, errors=errors, workspace=workspace, effects=effects,
            comments=file.comments, extra=extra, text=file.text,
        )  # fmt: skip
    return machine


def _axes(file: TomlFile, structure: Structure, tables: Mapping[str, Any], problem: _Problems) -> dict[str, Axis]:
    """Every axis of the structure; where problems are collected, a wrong one stands in as its letter says."""
    found: dict[str, Axis] = {}
    for key, entry in tables.items():
        with problem():
            if key not in structure.axes:
                close = meant(key, structure.axes)
                first = f"did you mean {close}? " if close else ""
                remedy = f"{first}use one of {', '.join(structure.axes)}, {place_of(key, structure.code)}"
                raise file.error(f"the structure has no axis {shown(key)}", "axes", key, remedy=remedy)
            found[key] = _axis(file, key, entry)
    for key in structure.axes:
        with problem():
            if key not in tables:
                words = f'axis {key} of the structure "{structure.code}" has no table'
                raise file.error(words, "structure", remedy=f"add [axes.{key}] with its travel = [lowest, highest]")
        if key not in found:
            kind, direction = default_kind(key) or "linear", DEFAULT_DIRECTION.get(key, (1.0, 0.0, 0.0))
            found[key] = Axis(name=key, kind=kind, direction=direction, travel=UNREAD)
    return found


def _placed(file: TomlFile, keys: tuple[str | int, ...], make: Callable[[], T]) -> T:
    """What `make` makes of the table at `keys`; its complaint gets its place."""
    try:
        with file.placing(*keys):
            made = make()
        return made
    except InputError:
        raise
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
        problem = f"{'.'.join(map(str, keys))} is not of the right form ({error})"
        raise file.error(problem, *keys, remedy="compare it with the conventions, section 4") from None


def _table(file: TomlFile, value: Any, *keys: str, example: str = "") -> dict[str, Any]:
    if not isinstance(value, Mapping) or not all(isinstance(key, str) for key in value):
        path = ".".join(keys)
        raise file.error(f"{path} is not a table", *keys, remedy=f"write {example or f'[{path}]'}")
    return dict(value)


def _names(kind: type) -> tuple[str, ...]:
    return tuple(f.name for f in fields(kind) if f.name not in ("extra", "name"))


def _known(kind: type, table: Mapping[str, Any]) -> dict[str, Any]:
    """Constructor arguments of a dataclass from a table: lists become tuples, unknown keys go to `extra`."""
    names = _names(kind)
    known = {key: as_tuples(value) for key, value in table.items() if key in names}
    return {**known, "extra": {key: value for key, value in table.items() if key not in names}}


def _axis(file: TomlFile, name: str, entry: Any) -> Axis:
    table = _table(file, entry, "axes", name)
    drive_table = table.pop("drive", None)
    drive = None
    if drive_table is not None:
        keys = ("axes", name, "drive")
        checked = _table(file, drive_table, *keys)
        refuse_slips(file, keys, checked, _names(Drive))
        for key in ("position_gain", "velocity_gain", "integral_time"):
            if key not in checked:
                raise file.error(f"the drive of axis {name} has no {key}", *keys, remedy=f"add {key} = …")
        drive = _placed(file, keys, lambda: Drive(**_known(Drive, checked)))
    refuse_slips(file, ("axes", name), table, _names(Axis))
    return _placed(file, ("axes", name), lambda: make_axis(name, drive=drive, **_known(Axis, table)))


def _error_term(file: TomlFile, name: str, entry: Any, axes: Mapping[str, Axis]) -> ErrorTerm:
    if axis_of_error(name) is None:
        raise file.error(
            f"{shown(name)} is not an error of ISO 230-1", "errors", name, remedy=nearest_error(name, axes)
        )
    table = _table(file, entry, "errors", name, example=f"{name} = {{ sigma = 50.0 }}")
    refuse_slips(file, ("errors", name), table, _names(ErrorTerm))
    if "sigma" not in table:
        raise file.error(f"error {name} has no sigma", "errors", name, remedy="add its prior 1σ in µm or µrad")
    for key in ("basis", "order", "over"):
        if key in table and not isinstance(table[key], list):
            table[key] = [table[key]]
    knots = table.get("knots")
    if isinstance(knots, list) and not any(isinstance(k, list) for k in knots):
        table["knots"] = [knots]
    if axis_of_error(name) not in axes:  # first of all: a wrong name makes a location error look like a motion
        with file.placing("errors", name):
            raise unknown_axis(f"error {name}", axis_of_error(name), axes, remedy=nearest_error(name, axes))
    term = _placed(file, ("errors", name), lambda: ErrorTerm(name=name, **_known(ErrorTerm, table)))
    _placed(file, ("errors", name), lambda: check_error(term, axes))
    return term


def _effects(file: TomlFile, entries: Any) -> tuple[EffectEntry, ...]:
    keys = ("model", "effects")
    remedy = 'write effects = [{ effect = "backlash", axis = "C" }]'
    if not isinstance(entries, list):
        raise file.error(f"effects = {shown(entries)} is not a list", *keys, remedy=remedy)
    found = []
    for number, entry in enumerate(entries):
        table = {"effect": entry} if isinstance(entry, str) else _table(file, entry, *keys)
        if "effect" not in table:
            raise file.error("an effect has no id", *keys, remedy=remedy)
        options = {key: as_tuples(value) for key, value in table.items() if key not in ("effect", "axis")}
        effect, axis = table["effect"], table.get("axis")
        with file.placing(*keys, number):
            found.append(EffectEntry(effect=effect, axis=axis, options=options))
    return tuple(found)


def _plain(item: object, skip: tuple[str, ...]) -> dict[str, Any]:
    """A dataclass as a table: fields at their default are left out, `extra` is merged back."""
    table: dict[str, Any] = {}
    for f in fields(item):  # type: ignore[arg-type]
        value = getattr(item, f.name)
        if f.name in (*skip, "extra") or value is None or value == f.default or value == ():
            continue
        table[f.name] = as_lists(value)
    return {**table, **dict(getattr(item, "extra", {}))}


def machine_to_data(machine: Machine) -> dict[str, Any]:
    """Nested plain mappings in the layout of the machine file."""
    top = {key: value for key, value in machine.extra.items() if key != "model"}
    data: dict[str, Any] = {"schema": SCHEMA, "name": machine.name, "structure": machine.structure.code, **top}
    data["axes"] = {}
    for axis in machine.axes.values():
        table = _plain(axis, skip=("name", "drive"))
        if axis.kind == default_kind(axis.name):
            del table["kind"]
        if axis.direction == DEFAULT_DIRECTION.get(axis.name):
            del table["direction"]
        if axis.drive is not None:
            table["drive"] = _plain(axis.drive, skip=())
        data["axes"][axis.name] = table
    data["errors"] = {term.name: _error_table(term) for term in machine.errors.values()}
    workspace = _plain(machine.workspace, skip=())
    if workspace:
        data["workspace"] = workspace
    model = dict(machine.extra.get("model", {}))
    if machine.effects:
        model["effects"] = [_effect_table(entry) for entry in machine.effects]
    if model:
        data["model"] = model
    return data


def _error_table(term: ErrorTerm) -> dict[str, Any]:
    table = _plain(term, skip=("name",))
    if table.get("over") == [term.axis]:
        del table["over"]
        table["basis"], table["order"] = table["basis"][0], table["order"][0]
    return table


def _effect_table(entry: EffectEntry) -> dict[str, Any]:
    table: dict[str, Any] = {"effect": entry.effect}
    if entry.axis is not None:
        table["axis"] = entry.axis
    return {**table, **{key: as_lists(value) for key, value in entry.options.items()}}

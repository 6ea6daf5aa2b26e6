"""Machine files: TOML to `Machine` and back without loss (docs: conventions, section 4)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any, TypeVar

from symfive.errors import InputError
from symfive.files import TomlFile, read_toml, toml_text, write_text
from symfive.machine._data import Axis, Drive, EffectEntry, ErrorTerm, Machine, Workspace, make_axis
from symfive.machine._structure import Structure

__all__ = ["SCHEMA", "machine_from_data", "machine_to_data", "read_machine", "write_machine"]

SCHEMA = "symfive.machine/1"
T = TypeVar("T")
_TOP = ("schema", "name", "structure", "axes", "errors", "workspace", "model")


def read_machine(path: Path | str) -> Machine:
    """Read a machine file. Keys that are not known are kept in `extra`; see `unknown_keys`."""
    return _from_toml(read_toml(Path(path)))


def machine_from_data(data: Mapping[str, Any], source: str = "machine") -> Machine:
    """The same from nested mappings (as a `model.json` holds them)."""
    return _from_toml(TomlFile(Path(source), "", data, ()))


def unknown_keys(machine: Machine) -> tuple[str, ...]:
    """Keys of the machine file that symfive does not know; they are kept and written back."""
    found = [*machine.extra]
    for axis in machine.axes.values():
        found += [f"axes.{axis.name}.{key}" for key in axis.extra]
        if axis.drive is not None:
            found += [f"axes.{axis.name}.drive.{key}" for key in axis.drive.extra]
    for term in machine.errors.values():
        found += [f"errors.{term.name}.{key}" for key in term.extra]
    return (*found, *(f"workspace.{key}" for key in machine.workspace.extra))


def write_machine(machine: Machine, path: Path | str) -> None:
    """Write a machine file, whole or not at all."""
    write_text(Path(path), toml_text(machine_to_data(machine), machine.comments))


def _from_toml(file: TomlFile) -> Machine:
    data = dict(file.data)
    if data.get("schema") != SCHEMA:
        raise file.error(f"schema is {data.get('schema')!r}", "schema", remedy=f'the first line must be schema = "{SCHEMA}"')
    code = data.get("structure")
    if not isinstance(code, str):
        raise file.error("there is no structural code", "structure", remedy="add structure = \"w C' B' X' Y' b Z t\"")
    structure = _placed(file, ("structure",), lambda: Structure.parse(code))
    tables = {name: _table(file, data.get(name, {}), name) for name in ("axes", "errors", "workspace", "model")}
    axes = {name: _axis(file, name, entry) for name, entry in tables["axes"].items()}
    errors = {name: _error_term(file, name, entry) for name, entry in tables["errors"].items()}
    workspace = _placed(file, ("workspace",), lambda: Workspace(**_known(Workspace, tables["workspace"])))
    effects = tuple(_effect(file, entry) for entry in tables["model"].get("effects", []))
    extra = {key: value for key, value in data.items() if key not in _TOP}
    extra |= {f"model.{key}": value for key, value in tables["model"].items() if key != "effects"}
    name = data.get("name", "machine")
    if not isinstance(name, str):
        raise file.error("name is not text", "name", remedy='write name = "…"')

    def build() -> Machine:
        return Machine(
            name=name, structure=structure, axes=axes, errors=errors, workspace=workspace, effects=effects,
            comments=file.comments, extra=extra,
        )  # fmt: skip

    try:
        return build()
    except InputError as error:
        culprit = next((n for n in (*errors, *axes) if n in error.problem.replace(":", " ").split()), None)
        keys = ("errors", culprit) if culprit in errors else ("axes", culprit) if culprit else ("structure",)
        raise error.at(file.path, file.line(*[str(k) for k in keys])) from None


def _placed(file: TomlFile, keys: tuple[str | int, ...], make: Callable[[], T]) -> T:
    try:
        return make()
    except InputError as error:
        raise error.at(file.path, file.line(*keys)) from None
    except (TypeError, ValueError) as error:
        raise file.error(f"{'.'.join(map(str, keys))} is not of the right form ({error})", *keys) from None


def _table(file: TomlFile, value: Any, *keys: str) -> dict[str, Any]:
    if not isinstance(value, Mapping):
        raise file.error(f"{'.'.join(keys)} is not a table", *keys, remedy=f"write [{'.'.join(keys)}]")
    return dict(value)


def _known(kind: type, table: Mapping[str, Any]) -> dict[str, Any]:
    """Constructor arguments of a dataclass from a table: lists become tuples, unknown keys go to `extra`."""
    names = {f.name for f in fields(kind)} - {"extra", "name"}
    known = {key: _tuples(value) for key, value in table.items() if key in names}
    return {**known, "extra": {key: value for key, value in table.items() if key not in names}}


def _tuples(value: Any) -> Any:
    return tuple(_tuples(v) for v in value) if isinstance(value, list) else value


def _axis(file: TomlFile, name: str, entry: Any) -> Axis:
    table = _table(file, entry, "axes", name)
    drive_table = table.pop("drive", None)
    drive = None
    if drive_table is not None:
        checked = _table(file, drive_table, "axes", name, "drive")
        drive = _placed(file, ("axes", name, "drive"), lambda: Drive(**_known(Drive, checked)))
    return _placed(file, ("axes", name), lambda: make_axis(name, drive=drive, **_known(Axis, table)))


def _error_term(file: TomlFile, name: str, entry: Any) -> ErrorTerm:
    table = _table(file, entry, "errors", name)
    if "sigma" not in table:
        raise file.error(f"error {name} has no sigma", "errors", name, remedy="add its prior 1σ in µm or µrad")
    for key in ("basis", "order", "over"):
        if key in table and not isinstance(table[key], list):
            table[key] = [table[key]]
    return _placed(file, ("errors", name), lambda: ErrorTerm(name=name, **_known(ErrorTerm, table)))


def _effect(file: TomlFile, entry: Any) -> EffectEntry:
    table = {"effect": entry} if isinstance(entry, str) else _table(file, entry, "model", "effects")
    if not isinstance(table.get("effect"), str):
        raise file.error("an effect has no id", "model", "effects", remedy='write { effect = "backlash", axis = "C" }')
    options = {key: _tuples(value) for key, value in table.items() if key not in ("effect", "axis")}
    return EffectEntry(effect=table["effect"], axis=table.get("axis"), options=options)


def _lists(value: Any) -> Any:
    return [_lists(v) for v in value] if isinstance(value, tuple) else value


def _plain(item: object, skip: tuple[str, ...]) -> dict[str, Any]:
    """A dataclass as a table: fields at their default are left out, `extra` is merged back."""
    table: dict[str, Any] = {}
    for f in fields(item):  # type: ignore[arg-type]
        value = getattr(item, f.name)
        if f.name in (*skip, "extra") or value is None or value == f.default or value == ():
            continue
        table[f.name] = dict(value) if isinstance(value, Mapping) else _lists(value)
    return {**table, **dict(getattr(item, "extra", {}))}


def machine_to_data(machine: Machine) -> dict[str, Any]:
    """Nested plain mappings in the layout of the machine file."""
    top = {key: value for key, value in machine.extra.items() if not key.startswith("model.")}
    data: dict[str, Any] = {"schema": SCHEMA, "name": machine.name, "structure": machine.structure.code, **top}
    data["axes"] = {}
    for axis in machine.axes.values():
        table = _plain(axis, skip=("name", "drive"))
        if axis.drive is not None:
            table["drive"] = _plain(axis.drive, skip=())
        data["axes"][axis.name] = table
    data["errors"] = {term.name: _error_table(term) for term in machine.errors.values()}
    workspace = _plain(machine.workspace, skip=())
    if workspace:
        data["workspace"] = workspace
    model = {key.removeprefix("model."): value for key, value in machine.extra.items() if key.startswith("model.")}
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
    return {**table, **{key: _lists(value) for key, value in entry.options.items()}}

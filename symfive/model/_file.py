"""`model.json`: a fitted machine with its effects, values and covariance, to be used again."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from symfive.arrays import Array
from symfive.effects import Effect, baseline_effects, make_effect
from symfive.errors import InputError
from symfive.files import read_text, shown
from symfive.instruments import INSTRUMENTS
from symfive.machine import Machine, machine_from_data, machine_to_data
from symfive.model._assembly import machine_parameters
from symfive.numbers import with_std
from symfive.outputs import write_json
from symfive.screen import OnScreen, listed, plural
from symfive.separated import LARGEST
from symfive.validation import as_lists, as_tuples

SCHEMA = "symfive.model/1"
ROUNDING = 1e-6
"""By how much correlations of a file may miss those of a covariance."""


@dataclass(frozen=True, repr=False)
class FittedModel(OnScreen):
    """A machine, the effects added to its baseline, and the values of all parameters except those of single runs.

    `values` and `std` by name in the files' units; `covariance` (k, k) in the order of `names`.
    """

    machine: Machine
    effects: tuple[Effect, ...]
    values: Mapping[str, float]
    std: Mapping[str, float]
    units: Mapping[str, str]
    names: tuple[str, ...]
    covariance: Array

    def __str__(self) -> str:
        rows = [f"  {name} {with_std(self.values[name], self.std[name], self.units[name])}" for name in self.names]
        effects = f", effects {', '.join(effect.key for effect in self.effects)}" if self.effects else ""
        head = f"fitted model of {self.machine.name}: {plural(len(rows), 'parameter')}{effects}; ± is 1σ"
        return "\n".join([head, *listed(rows, "model.values")])


def effect_to_data(effect: Effect) -> dict[str, Any]:
    """An effect as a table: its id, axis and the options that differ from their defaults."""
    table: dict[str, Any] = {"effect": effect.id}
    for f in fields(effect):
        value = getattr(effect, f.name)
        if value != f.default:
            table[f.name] = effect_to_data(value) if isinstance(value, Effect) else as_lists(value)
    return table


def effects_from_data(entries: Any, source: Path | str) -> tuple[Effect, ...]:
    """Effects from such tables."""
    if not isinstance(entries, list):
        raise InputError("effects is not a list", path=source, remedy='write [{ "effect": "backlash", "axis": "C" }]')
    found = []
    for entry in entries:
        if not isinstance(entry, Mapping) or not isinstance(entry.get("effect"), str):
            raise InputError("an effect has no id", path=source, remedy='write { "effect": "backlash", "axis": "C" }')
        try:
            options = {k: as_tuples(v) for k, v in entry.items() if k not in ("effect", "axis")}
            found.append(make_effect(entry["effect"], entry.get("axis"), **options))
        except (InputError, RecursionError, TypeError, ValueError) as error:
            problem = error.problem if isinstance(error, InputError) else str(error)
            raise InputError(problem, path=source, remedy=getattr(error, "remedy", "") or "correct the entry") from None
    return tuple(found)


def write_model(model: FittedModel, path: Path | str) -> None:
    """Write `model.json`, whole or not at all."""
    data = {
        "schema": SCHEMA,
        "machine": machine_to_data(model.machine),
        "effects": [effect_to_data(effect) for effect in model.effects],
        "parameters": {
            name: {"value": model.values[name], "std": model.std[name], "unit": model.units[name]}
            for name in model.names
        },
        "covariance": {"names": list(model.names), "matrix": model.covariance.tolist()},
    }
    write_json(Path(path), data)


def read_json(path: Path, *, listed: bool = False) -> Any:
    """A JSON file; what is not JSON ends in an `InputError` with line and column. `listed`: as `symfive.files.read_bytes`."""
    text = read_text(path, listed=listed)
    try:
        data = json.loads(text)
        json.dumps(data, ensure_ascii=False).encode()  # half a character (\\ud800) has no UTF-8
        return data
    except json.JSONDecodeError as error:
        raise InputError(
            f"not valid JSON: {error.msg}", path=path, line=error.lineno, column=error.colno,
            remedy="correct it there, or name the JSON file that symfive wrote",
        ) from None  # fmt: skip
    except ValueError as error:  # half a character, or an integer of more than 4300 digits
        raise InputError(
            f"not JSON that can be read: {error}", path=path, remedy="this is not a file of symfive"
        ) from None
    except RecursionError:
        raise InputError("the JSON is nested too deeply", path=path, remedy="this is not a file of symfive") from None


def read_model(path: Path | str) -> FittedModel:
    """Read `model.json`. Raises `InputError`."""
    path = Path(path)
    if path.is_dir():
        path = path / "model.json"
    data = read_json(path, listed=True)
    if not isinstance(data, dict) or data.get("schema") != SCHEMA:
        raise InputError(
            f'this is not a model: its schema is not "{SCHEMA}"', path=path, remedy="run symfive identify to make one"
        )
    try:
        machine = machine_from_data(data["machine"], str(path))
        entries = {str(name): _entry(name, e, path) for name, e in data["parameters"].items()}
        _check_units(machine, entries)
        names = tuple(map(str, data["covariance"]["names"]))
        covariance = _numbers(data["covariance"]["matrix"])
        if len(set(names)) < len(names) or not set(names) <= set(entries) or not _is_covariance(covariance, len(names)):
            raise ValueError("its covariance is not one of its parameters")
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"the model is incomplete ({error})", path=path, remedy="run symfive identify again") from None
    effects = effects_from_data(data.get("effects", []), path)
    _check_owners(machine, effects, entries, path)
    return FittedModel(
        machine=machine,
        effects=effects,
        values={name: e[0] for name, e in entries.items()},
        std={name: e[1] for name, e in entries.items()},
        units={name: e[2] for name, e in entries.items()},
        names=names,
        covariance=covariance,
    )


def _check_units(machine: Machine, entries: Mapping[str, tuple[float, float, str]]) -> None:
    for name, (_, _, unit) in entries.items():
        term = machine.errors.get(name.split(".")[0])
        if term is not None and unit != term.unit:
            raise ValueError(f"{shown(name)} is in {shown(unit)}")


def _check_owners(machine: Machine, effects: Sequence[Effect], names: Iterable[str], path: Path) -> None:
    """Refuse parameters of which the model has no error, no effect and no instrument: nothing would use them."""
    errors = {parameter.name for parameter in machine_parameters(machine)}
    owners = (*INSTRUMENTS, *(effect.key for effect in (*baseline_effects(machine), *effects)))
    for name in names:
        if name not in errors and not name.startswith(tuple(f"{owner}." for owner in owners)):
            problem = f"parameter {shown(name)} belongs to no error and no effect of the model"
            raise InputError(problem, path=path, remedy="correct its name, or add its error under machine.errors")


def _numbers(table: Any) -> Array:
    """Numbers of a file as an array, NaN for what is none."""
    try:
        return np.array(table, dtype=np.float64)
    except (TypeError, ValueError):
        return np.array(np.nan)


def _is_covariance(matrix: Array, size: int) -> bool:
    """Whether it is symmetric (size, size) without negative variances, also of sums: eigenvalues of its correlations are not
    negative, to rounding."""
    if matrix.shape != (size, size) or not (np.abs(matrix) <= LARGEST**2).all():
        return False
    variance = np.diag(matrix)
    std = np.sqrt(np.where(variance > 0.0, variance, 1.0))
    correlations = matrix / np.outer(std, std)
    symmetric = np.allclose(correlations, correlations.T, rtol=0.0, atol=ROUNDING)
    return bool(symmetric and np.linalg.eigvalsh(correlations).min(initial=0.0) >= -ROUNDING * size)


def _entry(name: str, entry: Any, path: Path) -> tuple[float, float, str]:
    value, std = (float(_numbers(entry[key])) for key in ("value", "std"))
    if not (abs(value) <= LARGEST and 0.0 <= std <= LARGEST):
        problem = f"parameter {shown(name)} is not a number within ±{LARGEST:g} with a 1σ"
        raise InputError(problem, path=path, remedy="run symfive identify again")
    return value, std, str(entry["unit"])

"""Checks of plain values, each with a message that names its owner and what to write instead."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from types import MappingProxyType
from typing import Any, TypeGuard

from symfive.errors import InputError
from symfive.files import shown
from symfive.separated import LARGEST, SMALLEST


def is_number(value: object) -> TypeGuard[float]:
    """Whether it is an int or float (and no bool) within `symfive.separated.LARGEST`."""
    return isinstance(value, (int, float)) and not isinstance(value, bool) and -LARGEST <= value <= LARGEST


def finite(owner: str, /, **values: object) -> None:
    """Raise `InputError` unless all are finite numbers."""
    for name, value in values.items():
        if not is_number(value):
            raise InputError(
                f"{owner}: {name} = {shown(value)} is not a finite number", remedy="write a number", keys=(name,)
            )


def positive(owner: str, /, **values: Any) -> None:
    """Raise `InputError` unless all are finite numbers above zero; None stands for a value that was not
    given."""
    for name, value in values.items():
        if value is None:
            continue
        finite(owner, **{name: value})
        if value < SMALLEST:
            problem = f"{owner}: {name} = {shown(value)} is not positive"
            raise InputError(problem, remedy="write a number above zero", keys=(name,))


def at_most(owner: str, most: float, unit: str, why: str, /, **values: float) -> None:
    """Raise `InputError` unless all are finite numbers of a size up to `most`, beyond which there is none: `why`."""
    finite(owner, **values)
    for name, value in values.items():
        if abs(value) > most:
            problem = f"{owner}: {name} = {value:g} {unit} is beyond {most:g} {unit}: {why}"
            raise InputError(problem, remedy=f"give at most {most:g}", keys=(name,))


def numbers(owner: str, name: str, values: object, count: int | None = None, *, example: str) -> None:
    """Raise `InputError` unless `values` is a tuple of finite numbers, `count` of them where that is given."""
    right = isinstance(values, tuple) and all(is_number(value) for value in values)
    if not right or (count is not None and len(values) != count):  # type: ignore[arg-type]
        many = "finite numbers" if count is None else f"{count} finite numbers"
        problem = f"{owner}: {name} = {shown(list(values) if isinstance(values, tuple) else values)} is not {many}"
        raise InputError(problem, remedy=f"write {example}", keys=(name,))


def one_of(owner: str, name: str, value: object, allowed: tuple[str, ...]) -> None:
    """Raise `InputError` unless `value` is one of the `allowed` words."""
    if not isinstance(value, str) or value not in allowed:
        problem = f"{owner}: {name} {shown(value)} is unknown"
        raise InputError(problem, remedy=f"use one of {', '.join(allowed)}", keys=(name,))


def only(owner: str, table: Mapping[str, object], keys: tuple[str, ...]) -> None:
    """Raise `InputError` unless a table has these keys and no others."""
    named = " and ".join(keys)
    for key in [*(key for key in table if key not in keys), *(key for key in keys if key not in table)]:
        raise InputError(
            f"{owner} {'has an unknown' if key in table else 'lacks the'} key {shown(key)}",
            remedy=f"give {named}",
            keys=(key,) if key in table else (),
        )


def unknown_notes(keys: Iterable[str], of: str = "") -> list[str]:
    """What is said of keys that symfive does not know, `of` a file or a run."""
    return [f'key "{key}"{of and f" of {of}"} is unknown to symfive; it is kept' for key in keys]


def as_tuples(value: Any) -> Any:
    """Lists as tuples, at any depth."""
    if isinstance(value, Mapping):
        return {name: as_tuples(entry) for name, entry in value.items()}
    return tuple(map(as_tuples, value)) if isinstance(value, (list, tuple)) else value


def as_lists(value: Any) -> Any:
    """Tuples as lists and mappings as dicts, at any depth: what JSON and TOML hold."""
    if isinstance(value, Mapping):
        return {name: as_lists(entry) for name, entry in value.items()}
    return list(map(as_lists, value)) if isinstance(value, (list, tuple)) else value


def freeze(extra: Mapping[str, Any]) -> Mapping[str, Any]:
    """A read-only copy."""
    return MappingProxyType(dict(extra))

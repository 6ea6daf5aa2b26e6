"""TOML files with the place of every key, written with their comments and layout kept.

They are read by the standard library alone; what writes them is loaded when something is written.
"""

from __future__ import annotations

import math
import re
import tomllib
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from symfive.errors import InputError, inside
from symfive.files import read_text, shown
from symfive.separated import LARGEST

MAX_TOML_BYTES = 20_000_000
MAX_DEPTH = 50


@dataclass(frozen=True)
class TomlFile:
    """A parsed TOML file: `data` as plain Python, `comments` as written, and where each key stands."""

    path: Path
    text: str
    data: Mapping[str, Any]
    comments: tuple[str, ...]

    def line(self, *keys: str | int) -> int | None:
        """The line (from 1) of the deepest of `keys` that can be found: table names, then the key.

        An integer counts the blocks of an array of tables (`[[run]]`). Line 1 where nothing is found.
        """
        header: tuple[str | int, ...] = ()
        blocks = Counter[tuple[str | int, ...]]()
        best, depth = 1, 0
        for number, raw in enumerate(self.text.split("\n"), start=1):
            line = raw.strip()
            key: tuple[str, ...] = ()
            if line.startswith("["):
                header = ()
                *above, last = _parts(line.split("#")[0].strip("[] "))
                for name in above:
                    header = _numbered((*header, name), blocks)
                blocks[(*header, last)] += line.startswith("[[")
                header = _numbered((*header, last), blocks)
            elif "=" in line and not line.startswith("#"):
                key = _parts(line.split("=")[0])
            here = (*header, *key)
            if len(here) > depth and here == keys[: len(here)]:
                best, depth = number, len(here)
        return best if self.text else None

    def require_schema(self, schema: str) -> None:
        """Raise `InputError` unless the file is of this `schema`."""
        own = self.data.get("schema")
        if own != schema:
            remedy = f'the first line must be schema = "{schema}"'
            kinds = [str(name).removeprefix("symfive.").partition("/")[0] for name in (own, schema)]
            if str(own).startswith("symfive.") and kinds[0] != kinds[1]:
                remedy = f"this is a {kinds[0]}: name a {kinds[1]}"
            raise self.error(f"schema is {shown(own)}", "schema", remedy=remedy)

    def error(self, problem: str, *keys: str | int, remedy: str) -> InputError:
        """An `InputError` at the place of `keys`."""
        return InputError(problem, remedy=remedy, path=self.path, line=self.line(*keys), keys=keys)

    @contextmanager
    def placing(self, *keys: str | int) -> Iterator[None]:
        """Errors of the block get this file and the line of their key, which lies at or below `keys`."""
        try:
            with inside(*keys):
                yield
        except InputError as error:
            raise error.at(self.path, self.line(*error.keys)) from None


def _numbered(path: tuple[str | int, ...], blocks: Counter[tuple[str | int, ...]]) -> tuple[str | int, ...]:
    """The path with the number of its last block, where it is that of an array of tables."""
    return (*path, blocks[path] - 1) if blocks[path] else path


def _parts(dotted: str) -> tuple[str, ...]:
    return tuple(part.strip(" \"'") for part in dotted.split("."))


def read_toml(path: Path) -> TomlFile:
    """Read a TOML file. Raises `InputError` with line and column where it is not TOML, or holds NaN or
    infinity."""
    return parse_toml(path, read_text(path, at_most=MAX_TOML_BYTES))


def parse_toml(path: Path, text: str) -> TomlFile:
    """The same of a text; `path` is only named in errors."""
    if not text.strip():
        raise InputError("the file is empty", path=path, line=1, remedy="check that it is the right file")
    try:
        data = tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        said, line, column = _of_tomllib(error, text)
        problem = f"not valid TOML: {said}"
        remedy = "correct the syntax there"
        if path.suffix.casefold() != ".toml":
            remedy = "name a machine file or a campaign's folder; symfive import reads tables"
        raise InputError(problem, path=path, line=line, column=column, remedy=remedy) from None
    file = TomlFile(path, text, data, tuple(_comments(text)))
    refuse_what_toml_lacks(file)
    return file


def refuse_what_toml_lacks(file: TomlFile) -> None:
    """Raise `InputError` where its data, which may come from elsewhere, could not be written again: NaN, infinity, nothing,
    half a character, tables or lists more than `MAX_DEPTH` deep."""
    try:
        for keys, value in _leaves(file.data):
            key = keys[-1] if keys else ""
            if isinstance(value, float) and not math.isfinite(value):
                raise file.error(f"{key} = {value} is not a finite number", *keys, remedy="write a number")
            if isinstance(value, (int, float)) and not -LARGEST <= value <= LARGEST:
                problem = f"{key} = {shown(value)} is beyond {LARGEST:g}"
                raise file.error(problem, *keys, remedy="write it in the unit of the conventions")
            if value is None:
                raise file.error(f"{shown(key)} is null", *keys, remedy="give it a value or remove it")
            for text in (*keys, value):
                if isinstance(text, str) and any("\ud800" <= c <= "\udfff" for c in text):
                    raise file.error(f"{shown(text)} holds half a character", *keys, remedy="write it as UTF-8")
    except RecursionError:
        problem = f"tables or lists are nested more than {MAX_DEPTH} deep"
        raise file.error(problem, remedy="check that it is the right file") from None


def _leaves(
    value: Any, keys: tuple[str | int, ...] = (), depth: int = 0
) -> Iterator[tuple[tuple[str | int, ...], Any]]:
    if depth > MAX_DEPTH:
        raise RecursionError
    if isinstance(value, Mapping):
        for key, entry in value.items():
            yield from _leaves(entry, (*keys, key), depth + 1)
    elif isinstance(value, list):
        for number, entry in enumerate(value):
            yield from _leaves(entry, (*keys, number) if isinstance(entry, Mapping) else keys, depth + 1)
    else:
        yield keys, value


def _of_tomllib(error: Exception, text: str) -> tuple[str, int, int | None]:
    """What tomllib says, its line and column. Before Python 3.14 it tells the place only in brackets at the end of its message;
    without any it is the end of the document, or the whole of it (nested too deep)."""
    said, _, place = str(error).rpartition(" (at ")
    numbers = [int(number) for number in re.findall(r"\d+", place)] if said else []
    if len(numbers) == 2:
        return said, numbers[0], numbers[1]
    return (said, text.count("\n") + 1, None) if said else (str(error), 1, None)


def _comments(text: str) -> Iterator[str]:
    """Comments of a valid TOML text (a `#` outside strings)."""
    in_multi: str | None = None
    for line in text.split("\n"):
        i, quote = 0, None
        while i < len(line):
            here = line[i : i + 3]
            if in_multi:
                if here == in_multi:
                    in_multi, i = None, i + 2
            elif quote:
                if line[i] == "\\" and quote == '"':
                    i += 1
                elif line[i] == quote:
                    quote = None
            elif here in ('"""', "'''"):
                in_multi, i = here, i + 2
            elif line[i] in "\"'":
                quote = line[i]
            elif line[i] == "#":
                yield line[i + 1 :].strip()
                break
            i += 1


def toml_text(data: Mapping[str, Any], comments: Sequence[str] = (), *, sections: Sequence[str] = ()) -> str:
    """TOML text of nested mappings.

    Entries of the top-level tables named in `sections` become tables of their own (`[axes.X]`); every other
    mapping below the first level is written inline.
    """
    import tomlkit

    document = tomlkit.document()
    for comment in comments:
        document.add(tomlkit.comment(comment))
    for key, value in data.items():
        document.add(key, _toml_item(value, 0 if key in sections else 1))
    return tomlkit.dumps(document)


def _toml_item(value: Any, level: int) -> Any:
    """`level` 0 a table of tables, 1 a table, 2 all inline."""
    import tomlkit

    if isinstance(value, Mapping):
        table = tomlkit.inline_table() if level > 1 else tomlkit.table(is_super_table=level == 0 and bool(value))
        for key, entry in value.items():
            table.add(key, _toml_item(entry, level + 1))
        return table
    if isinstance(value, (list, tuple)):
        if value and all(isinstance(v, Mapping) for v in value) and level == 1:
            tables = tomlkit.aot()
            for entry in value:
                tables.append(_toml_item(entry, 1))
            return tables
        array = tomlkit.array()
        for entry in value:
            array.append(_toml_item(entry, 2))
        return array
    return tomlkit.item(value.item() if hasattr(value, "item") else value)  # numpy's numbers as Python's


def rewritten_toml(
    text: str, data: Mapping[str, Any], read: Callable[[str], Mapping[str, Any]], comments: Sequence[str] = (), *,
    sections: Sequence[str] = (),
) -> str:  # fmt: skip
    """TOML text that holds `data`: `text`, out of which `read` makes such data, with what differs changed, its comments and
    layout kept; as `toml_text` where there is none, or where that cannot be done, as when the order of tables has to change."""
    if text:
        with suppress(InputError):  # an edit that does not fit into the old layout
            original = read(text)
            if original == data:
                return text
            edited = _edited(text, original, data)
            if edited is not None and read(edited) == data:
                return edited
    return toml_text(data, comments, sections=sections)


def _edited(text: str, old: Mapping[str, Any], new: Mapping[str, Any]) -> str | None:
    """The TOML `text` with what differs between `old` and `new` changed; None where that cannot be done."""
    import tomlkit
    from tomlkit.exceptions import TOMLKitError

    try:
        document = tomlkit.parse(text)
        _edit(document, old, new, level=1)
        return tomlkit.dumps(document)
    except (TOMLKitError, LookupError, TypeError, ValueError, AttributeError):
        return None


def _edit(table: Any, old: Mapping[str, Any], new: Mapping[str, Any], level: int) -> None:
    for key in old:
        if key not in new:
            del table[key]
    for key, value in new.items():
        if key in old and old[key] == value:
            continue
        if isinstance(value, Mapping) and isinstance(old.get(key), Mapping) and key in table:
            _edit(table[key], old[key], value, level + 1)
        else:
            table[key] = _toml_item(value, level)

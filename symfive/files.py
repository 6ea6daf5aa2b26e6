"""Reading TOML with places, and writing files whole or not at all."""

from __future__ import annotations

import json
import os
import shutil
import tempfile
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tomlkit

from symfive.errors import InputError

__all__ = ["TomlFile", "output_folder", "read_text", "read_toml", "toml_text", "write_json", "write_text"]

MAX_TEXT_BYTES = 2_000_000_000


def read_text(path: Path) -> str:
    """The file's text; every way in which that can fail is one `InputError`."""
    try:
        size = path.stat().st_size
        if path.is_dir():
            raise InputError("this is a folder, not a file", path=path, remedy="name the file inside it")
        if size > MAX_TEXT_BYTES:
            raise InputError(f"the file has {size} bytes, more than {MAX_TEXT_BYTES}", path=path, remedy="split it")
        data = path.read_bytes()
    except FileNotFoundError:
        raise InputError("there is no such file", path=path, remedy="check the name and the folder") from None
    except OSError as error:
        reason = error.strerror or str(error)
        raise InputError(f"the file cannot be read ({reason})", path=path, remedy="check its name and rights") from None
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        column = error.start - (data.rfind(b"\n", 0, error.start) + 1) + 1
        raise InputError(
            f"byte 0x{data[error.start]:02x} is not UTF-8 text",
            path=path,
            line=line,
            column=column,
            remedy="save the file as UTF-8",
        ) from None
    if "\0" in text:
        line = text.count("\n", 0, text.index("\0")) + 1
        raise InputError("a NUL byte stands in the text", path=path, line=line, remedy="this is not a text file")
    return text


@dataclass(frozen=True)
class TomlFile:
    """A parsed TOML file: `data` as plain Python, `comments` as written, and where each key stands."""

    path: Path
    text: str
    data: Mapping[str, Any]
    comments: tuple[str, ...]

    def line(self, *keys: str | int) -> int | None:
        """The line (from 1) of the deepest of `keys` that can be found: table names, then the key.

        An integer counts the blocks of an array of tables (`[[run]]`).
        """
        found: int | None = None
        wanted = [str(k) for k in keys if not isinstance(k, int)]
        blocks = [k for k in keys if isinstance(k, int)]
        header: list[str] = []
        count = -1
        for number, raw in enumerate(self.text.splitlines(), start=1):
            line = raw.strip()
            if line.startswith("[["):
                header = [part.strip(" \"'") for part in line.strip("[] ").split("#")[0].strip("[] ").split(".")]
                count += 1
            elif line.startswith("["):
                header = [part.strip(" \"'") for part in line.split("#")[0].strip().strip("[]").split(".")]
            if blocks and count != blocks[0]:
                continue
            key = line.split("=")[0].strip(" \"'") if "=" in line and not line.startswith(("[", "#")) else None
            here = header + ([key] if key else [])
            if here == wanted:
                return number
            if here and here == wanted[: len(here)] and (found is None or len(here) >= 1):
                found = number
        return found

    def error(self, problem: str, *keys: str | int, remedy: str = "") -> InputError:
        """An `InputError` at the place of `keys`."""
        return InputError(problem, remedy=remedy, path=self.path, line=self.line(*keys))


def read_toml(path: Path) -> TomlFile:
    """Read a TOML file. Raises `InputError` with line and column where it is not TOML."""
    text = read_text(path)
    try:
        data = tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        line, column = _place_in_message(str(error), text)
        problem = str(error).split(" (at ")[0]
        raise InputError(
            f"not valid TOML: {problem}", path=path, line=line, column=column, remedy="correct the syntax there"
        ) from None
    comments = tuple(_comments(text))
    return TomlFile(path, text, data, comments)


def _place_in_message(message: str, text: str) -> tuple[int | None, int | None]:
    words = message.replace(",", " ").replace(")", " ").split()
    if "line" in words and "column" in words:
        return int(words[words.index("line") + 1]), int(words[words.index("column") + 1])
    if "end of document" in message:
        return text.count("\n") + 1, None
    return None, None


def _comments(text: str) -> Iterator[str]:
    """Comments of a valid TOML text (a `#` outside strings)."""
    in_multi: str | None = None
    for line in text.splitlines():
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


def toml_text(data: Mapping[str, Any], comments: Sequence[str] = ()) -> str:
    """TOML text of nested mappings; a mapping at the third level or inside a list is written inline."""
    document = tomlkit.document()
    for comment in comments:
        document.add(tomlkit.comment(comment))
    for key, value in data.items():
        document.add(key, _toml_item(value, depth=0))
    return tomlkit.dumps(document)


def _toml_item(value: Any, depth: int) -> Any:
    if isinstance(value, Mapping):
        inline = depth >= 2 or (depth == 1 and not any(isinstance(v, Mapping) for v in value.values()) and len(value) <= 6)
        table = tomlkit.inline_table() if inline else tomlkit.table()
        for key, entry in value.items():
            table.add(key, _toml_item(entry, depth + 1 if not inline else 9))
        return table
    if isinstance(value, (list, tuple)):
        if value and all(isinstance(v, Mapping) for v in value) and depth == 0:
            tables = tomlkit.aot()
            for entry in value:
                table = tomlkit.table()
                for key, item in entry.items():
                    table.add(key, _toml_item(item, 2))
                tables.append(table)
            return tables
        array = tomlkit.array()
        for entry in value:
            array.append(_toml_item(entry, 9))
        return array
    return tomlkit.item(value)


def write_text(path: Path, text: str) -> None:
    """Write `path` whole or not at all (a temporary sibling, flushed to disk, then renamed)."""
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    try:
        with os.fdopen(handle, "w", encoding="utf-8", newline="\n") as stream:
            stream.write(text)
            stream.flush()
            os.fsync(stream.fileno())
        os.chmod(temporary, 0o644)
        os.replace(temporary, path)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise


def write_json(path: Path, data: Any) -> None:
    """Write JSON whole or not at all; NaN and infinity are refused."""
    write_text(path, json.dumps(data, indent=1, allow_nan=False, ensure_ascii=False) + "\n")


@contextmanager
def output_folder(target: Path) -> Iterator[Path]:
    """A temporary folder that becomes `target` when the block ends without an error.

    Where `target` already exists, files of the same name are replaced one by one (each whole) and others stay.
    """
    target = Path(target)
    try:
        if target.exists() and not target.is_dir():
            raise InputError("the output must be a folder, and a file of that name exists", path=target)
        target.parent.mkdir(parents=True, exist_ok=True)
        temporary = Path(tempfile.mkdtemp(dir=target.parent, prefix=f".{target.name}."))
    except OSError as error:
        reason = error.strerror or str(error)
        raise InputError(
            f"the output folder cannot be made ({reason})", path=target, remedy="choose a folder you may write to"
        ) from None
    try:
        yield temporary
        os.chmod(temporary, 0o755)
        if not target.exists():
            os.rename(temporary, target)
            return
        for file in sorted(p for p in temporary.rglob("*") if p.is_file()):
            destination = target / file.relative_to(temporary)
            destination.parent.mkdir(parents=True, exist_ok=True)
            os.replace(file, destination)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)

"""The manifest of a folder of results: what was read, what was written, by which version and command."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import Any

from symfive.errors import InputError

MANIFEST = "manifest.json"
SCHEMA = "symfive.manifest/1"
command: ContextVar[str] = ContextVar("command", default="Python")
"""The command line that is running."""


@contextmanager
def by_command(words: str) -> Iterator[None]:
    """Manifests written in this block say that the command line `words` made them."""
    token = command.set(words)
    try:
        yield
    finally:
        command.reset(token)


def manifest_of(folder: Path) -> Mapping[str, Any] | None:
    """The manifest in a folder; None where there is none, or one of somebody else."""
    path = folder / MANIFEST
    try:
        data = json.loads(path.read_bytes())
    except FileNotFoundError:
        return None
    except (OSError, ValueError, RecursionError):
        data = {"schema": SCHEMA}
    if not isinstance(data, dict) or data.get("schema") != SCHEMA:
        return None
    right = isinstance(data.get("command"), str) and all(
        isinstance(data.get(key), dict) and all(isinstance(value, str) for value in data[key].values())
        for key in ("inputs", "outputs", "to_edit")
    )
    if not right:
        raise InputError("the manifest is damaged", path=path, remedy="delete it to use the folder as it is")
    return data


def digest_of(path: Path) -> str:
    """The file's SHA-256."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def cut(text: str) -> str:
    """The text with at most 200 characters, for a sentence."""
    return text if len(text) <= 200 else f"{text[:197]}..."

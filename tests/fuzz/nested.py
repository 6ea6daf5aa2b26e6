"""Mutations of what a TOML or JSON text says: the text stays valid, so that they reach what lies behind the syntax."""

import copy
import json
import random
import tomllib
from collections.abc import Iterator
from typing import Any

from symfive.toml_files import toml_text

from .bundle import HEAD

JUNK: tuple[Any, ...] = (
    0, -0.0, 1, -1, 2, 61, 0.5, 1e-9, 5e-324, 1e150, -1e308, float("inf"), float("nan"), 10**400, True,
    "", " ", "X", "C", "x'", "EX0C", "./a.csv", "../a.csv", "a\nb", "\u2028", "static", "dynamic", "polynomial",
    [], {}, [[]], [{}], [1], [1.0, 0.0], [0.0, 0.0, 0.0], [2.0, 1.0, 3.0], ["X", "X"], {"a": 1}, {"axis": 1}, [0.0] * 6,
    ["bspline"], [[0.0, 1.0]],
)  # fmt: skip


def of_values(data: bytes, rng: random.Random) -> bytes | None:
    """The text with one value or key changed; None where it is neither TOML nor JSON, or cannot be written."""
    pieces = HEAD.split(data)
    toml = [i for i in range(1, len(pieces), 2) if pieces[i].endswith(b".toml")]
    try:
        if toml:
            at = rng.choice(toml) + 1
            pieces[at] = _changed(pieces[at], rng)
            heads = [b"=== " + piece + b"\n" if i % 2 else piece for i, piece in enumerate(pieces)]
            return b"".join(heads)
        return _changed(data, rng)
    except (LookupError, RecursionError, TypeError, ValueError, AttributeError):
        return None


def _changed(text: bytes, rng: random.Random) -> bytes:
    is_json = text.lstrip()[:1] == b"{"
    data = json.loads(text) if is_json else tomllib.loads(text.decode())
    places = list(_places(data))
    holder, key = rng.choice(places)
    other, there = rng.choice(places)
    match rng.randrange(6):
        case 0 | 1:
            holder[key] = copy.deepcopy(rng.choice(JUNK))
        case 2:
            holder[key] = copy.deepcopy(other[there])
        case 3:
            del holder[key]
        case 4 if isinstance(holder[key], list):
            rng.shuffle(holder[key])
        case 5 if isinstance(holder, dict) and isinstance(other, dict):
            holder[there] = holder.pop(key)
        case _:
            value = holder[key]
            holder[key] = [value, value] if rng.random() < 0.5 else value[:1] if isinstance(value, list) else [value]
    return (json.dumps(data, indent=1) if is_json else toml_text(data, sections=("axes",))).encode()


def _places(data: Any) -> Iterator[tuple[Any, Any]]:
    """Every container and key or index of nested values."""
    for key, value in list(data.items()) if isinstance(data, dict) else list(enumerate(data)):
        yield data, key
        if isinstance(value, (dict, list)):
            yield from _places(value)

"""Effects, their forms and coordinates in words, and whether an option that a file gives has the type of its field."""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import cache
from numbers import Integral
from types import NoneType, UnionType
from typing import Any, Union, get_args, get_origin

from symfive.kinematics import function_words
from symfive.numbers import enumerated, name_words
from symfive.validation import is_number

Terms = tuple[tuple[str, str], ...]
"""See `Effect.terms`."""
_QUANTITIES = {
    "velocity sign": ("direction", "directions"), "velocity": ("velocity", "velocities"), "": ("position", "positions"),
    "acceleration": ("acceleration", "accelerations"), "since reversal": ("path since reversal", "paths since reversal"),
}  # fmt: skip
_PLAIN = {"t": "time", "row": "the row number", "pose": "the pose", "reading": "the reading"}
_COMPONENT = re.compile(r"E[A-CX-Z]0?(.+)")
_AXIS, _UNIT = re.compile(r"[A-Z]\d?"), re.compile(r"_(s|ms|hz|um|deg)$")
_OF_ORDER = re.compile(r"(amplitude|phase)(\d+)")
_SINES = {"sin": "sine", "cos": "cosine"}
_DIRECTIONS = {**{c: f"along {c.upper()}" for c in "xyz"}, **{c: f"about {c.upper()}" for c in "abc"}}
_REPEATED = re.compile(r"1?(\++)")


def effect_words(effect: str, axis: str | None, component: str | None = None) -> str:
    """An effect, its axis and its component, as `gravity sag of axis B` or `error motion of axis B (EXB)`."""
    said = effect.replace("_", " ")
    if axis:
        said = f"{said.removeprefix('axis ')} of axis {axis}"
    return said + (f" ({component})" if component else "")


@cache
def key_words(key: str, axes: tuple[str, ...], terms: Terms) -> str:
    """The key of an effect, or the name of one of its parameters, in words with the symbol of its component, as `gravity sag of
    axis B (EXB, yielding)` or `unidentified effect over the velocity of X (force)`. `terms`: see `Effect`."""
    effect, *rest = key.split(".")
    if effect == "unknown" and rest:
        said = f"unidentified effect over {coordinate_words(rest.pop(0).replace(',', ', '))}"
    else:
        component = _COMPONENT.fullmatch(rest[0]) if rest else None
        if rest and rest[0] in axes:
            said = effect_words(effect, rest.pop(0))
        else:
            said = effect_words(effect, component[1] if component and component[1] in axes else None)
    more = ", ".join(_parts(rest, terms))
    return said + (f" ({more})" if more else "")


def quantity_words(name: str, unit: str | None, terms: Terms) -> str:
    """A quantity of an effect in words, without the unit that stands behind the number."""
    return ", ".join(_parts(name_words(name, unit).replace(" ", "_").split("."), terms))


def _parts(names: Sequence[str], terms: Terms) -> list[str]:
    """The parts of a name, each in words; a direction and what a term speaks of join what they belong to."""
    said, left, known = list[str](), list(names), dict(terms)
    while left:
        name = left.pop(0)
        if name in _DIRECTIONS:
            along = _DIRECTIONS[name]
            said[-1:] = [f"{said[-1]} {along}"] if said and not _COMPONENT.fullmatch(said[-1]) else [*said[-1:], along]
            continue
        words = known.get(name, f"no. {name}" if name.isdecimal() else _part(name))
        if "{}" in words:
            words = words.format(known.get(left[0], _part(left.pop(0)))) if left else _part(name)
        said.append(words)
    return [words for words in said if words]


def _part(name: str) -> str:
    """One part of a name in words."""
    if name in _SINES:
        return _SINES[name]
    function = function_words(name, lambda coordinate: coordinate_words(coordinate).removeprefix("the position of "))
    if function != name:
        return function
    if _AXIS.fullmatch(name):
        return f"axis {name}"
    if of_order := _OF_ORDER.fullmatch(name):
        return f"{of_order[1]} (order {of_order[2]})"
    return _REPEATED.sub(lambda tag: f" no. {len(tag[1]) + 1}", _UNIT.sub("", name)).replace("_", " ").strip()


def coordinate_words(coordinate: str) -> str:
    """Coordinates in words, as `the direction of B, the positions of B and C and time` for `B velocity sign, B, C, t`."""
    groups: dict[str, list[str]] = {}
    for words in coordinate.split(", "):
        name, _, quantity = words.partition(" ")
        known = words not in _PLAIN and quantity in _QUANTITIES
        groups.setdefault(quantity if known else f"{_PLAIN.get(name, name)} {quantity}".rstrip(), []).append(name)
    said = [
        f"the {_QUANTITIES[what][len(names) > 1]} of {enumerated(names)}" if what in _QUANTITIES else what
        for what, names in groups.items()
    ]
    return enumerated(said)


def fits(value: Any, kind: Any) -> bool:
    """Whether a value from a file, lists as tuples, is of this type: text, number, whole number, truth, tuples, unions."""
    origin, inner = get_origin(kind), get_args(kind)
    if origin in (Union, UnionType):
        return any(fits(value, one) for one in inner)
    if origin is tuple:
        if not isinstance(value, tuple):
            return False
        kinds = inner[:1] * len(value) if inner[-1] is ... else inner
        return len(kinds) == len(value) and all(map(fits, value, kinds))
    if kind is float:
        return is_number(value)
    if kind is int:
        return isinstance(value, Integral) and not isinstance(value, bool)
    return not isinstance(kind, type) or isinstance(value, NoneType if kind is None else kind)

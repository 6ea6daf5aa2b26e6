"""Effects, their forms and coordinates in words, and whether an option that a file gives has the type of its field."""

from __future__ import annotations

import re
from numbers import Integral
from types import NoneType, UnionType
from typing import Any, Union, get_args, get_origin

from symfive.machine import Machine
from symfive.validation import is_number

_QUANTITIES = {
    "velocity sign": "the direction of {}", "velocity": "the velocity of {}", "acceleration": "the acceleration of {}",
    "since reversal": "the path of {} since its reversal", "": "the position of {}",
}  # fmt: skip
_PLAIN = {"t": "time", "row": "the row number", "pose": "the pose", "reading": "the reading"}
_COMPONENT = re.compile(r"E[A-CX-Z]0?(.+)")
_REPEATED = re.compile(r"1?(\++)")


def effect_words(effect: str, axis: str | None, component: str | None = None) -> str:
    """An effect, its axis and its component, as `gravity sag of axis B` or `error motion of axis B (EXB)`."""
    return effect.replace("_", " ") + (f" of axis {axis}" if axis else "") + (f" ({component})" if component else "")


def form_words(key: str, machine: Machine) -> str:
    """The key of a form, or the name of one of its parameters, in words with the symbol of its component, as `gravity sag of axis
    B (EXB, yielding)` or `unidentified effect over the velocity of X (force)`."""
    effect, *rest = key.split(".")
    if effect == "unknown" and rest:
        said = f"unidentified effect over {coordinate_words(rest.pop(0).replace(',', ', '))}"
    else:
        component = _COMPONENT.fullmatch(rest[0]) if rest else None
        if rest and rest[0] in machine.axes:
            said = effect_words(effect, rest.pop(0))
        else:
            said = effect_words(effect, component[1] if component and component[1] in machine.axes else None)
    more = [_REPEATED.sub(lambda tag: f" no. {len(tag[1]) + 1}", word).replace("_", " ").strip() for word in rest]
    return said + (f" ({', '.join(more)})" if more else "")


def coordinate_words(coordinate: str) -> str:
    """Coordinates in words, as `the direction of B, the position of C and time` for `B velocity sign, C, t`."""
    said = []
    for words in coordinate.split(", "):
        name, _, quantity = words.partition(" ")
        plain = f"{_PLAIN.get(name, name)} {quantity}"
        said.append(_PLAIN.get(words) or (_QUANTITIES[quantity].format(name) if quantity in _QUANTITIES else plain))
    *first, last = said
    return f"{', '.join(first)} and {last}" if first else last


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

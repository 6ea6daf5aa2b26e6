"""Whether an option that a file gives has the type of its field."""

from __future__ import annotations

from numbers import Integral
from types import NoneType, UnionType
from typing import Any, Union, get_args, get_origin

from symfive.validation import is_number


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

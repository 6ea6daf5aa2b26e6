"""What a run may say beside the fields that every run has: keys of single instruments and the form of their values."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from symfive.errors import InputError
from symfive.files import shown
from symfive.validation import is_number


def _text(value: Any) -> bool:
    return isinstance(value, str)


def _texts(value: Any) -> bool:
    return isinstance(value, (list, tuple)) and all(isinstance(entry, str) for entry in value)


def _positive(value: Any) -> bool:
    return is_number(value) and value > 0.0


def _numbers(count: int) -> Callable[[Any], bool]:
    def right(value: Any) -> bool:
        return isinstance(value, (list, tuple)) and len(value) == count and all(is_number(entry) for entry in value)

    return right


_SENSOR: dict[str, Callable[[Any], bool]] = {
    "direction": _numbers(3), "position": _numbers(3), "on": _text, "target": _text, "gain_sigma": is_number,
}  # fmt: skip


def _sensors(value: Any) -> bool:
    return isinstance(value, (list, tuple)) and all(
        isinstance(sensor, Mapping) and all(right(sensor[key]) for key, right in _SENSOR.items() if key in sensor)
        for sensor in value
    )


def _touches(value: Any) -> bool:
    return isinstance(value, (list, tuple)) and all(_numbers(3)(touch) for touch in value)


OPTIONS: dict[str, tuple[Callable[[Any], bool], str]] = {
    "at_rest": (lambda value: value == "ignored", '"ignored"'),
    "axis": (_text, '"X"'),
    "between": (lambda value: value in ("line", "curve"), '"curve"'),
    "directions": (_touches, "[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]"),
    "encoder_axes": (_texts, '["X", "C"]'),
    "encoder_zero_sigma": (lambda value: is_number(value) and value >= 0.0, "a number from zero"),
    "force_terms": (_texts, '["mass", "coulomb"]'),
    "form_axis": (_text, '"C"'),
    "form_order": (lambda value: type(value) is int and 0 <= value <= 60, "a whole number from 0 to 60"),
    "form_sigma_um": (_positive, "a number above zero"),
    "lobing_sigma_um": (lambda value: is_number(value) and value >= 0.0, "a number from zero"),
    "frame": (lambda value: value in ("workpiece", "machine", "tool"), '"tool"'),
    "low_pass_hz": (_positive, "a number above zero"),
    "motion_from": (_text, '"encoder"'),
    "placement": (_numbers(6), "[x, y, z, a, b, c]"),
    "placement_sigma": (_numbers(2), "[mm, degree]"),
    "reflector_on": (_text, '"workpiece"'),
    "sensors": (_sensors, "[{ direction = [1.0, 0.0, 0.0], position = [150.0, 0.0, 0.0] }]"),
    "sense": (lambda value: value in ("tool-table", "table-tool"), '"table-tool"'),
    "smoothing_s": (_positive, "a number above zero"),
    "start": (lambda value: value in ("rest", "moving"), '"moving"'),
    "touch_frame": (lambda value: value in ("tool", "machine"), '"machine"'),
    "touches": (_touches, "[[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], …]"),
    "v_rest": (_positive, "a number above zero"),
}
"""Key → what it must be, and how to write it. Other keys are kept and noted."""


def check_options(owner: str, options: Mapping[str, Any]) -> None:
    """Raise `InputError` for an option of the wrong form."""
    for key, value in options.items():
        if key in OPTIONS and not OPTIONS[key][0](value):
            problem = f"{owner}: {key} = {shown(value)} does not fit"
            raise InputError(problem, remedy=f"write {key} = {OPTIONS[key][1]}", keys=(key,))

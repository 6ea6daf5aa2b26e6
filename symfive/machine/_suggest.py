"""What a machine file may have been meant to say: names close to a wrong one, and a ready [errors] block."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from difflib import get_close_matches
from typing import Any

from symfive.files import shown
from symfive.machine._axis import Axis
from symfive.toml_files import TomlFile

SIGMAS = {"position": 50.0, "tilt": 100.0, "squareness": 40.0}
"""Prior 1σ of a machine of which nothing is known, µm and µrad."""
CLOSE = 0.8
_SQUARENESS = ("EC0X", "EA0Z", "EB0Z")
_OTHER_NAMES = {
    "axis": "axes", "kv": "position_gain", "k_v": "position_gain", "kp": "velocity_gain", "k_p": "velocity_gain",
    "tn": "integral_time", "t_n": "integral_time", "ti": "integral_time", "vff": "feedforward", "ff": "feedforward",
    "damping": "viscous", "feed": "max_feed", "acceleration": "max_acceleration",
}  # fmt: skip
"""What others call the same."""


def meant(key: str, known: Iterable[str]) -> str | None:
    """The known key that an unknown one stands for: another name of it, or one letter off."""
    names = list(known)
    other = _OTHER_NAMES.get(key.casefold())
    if other in names:
        return other
    return next(iter(get_close_matches(key.casefold(), names, 1, CLOSE)), None)


def refuse_slips(file: TomlFile, keys: tuple[str | int, ...], table: Mapping[str, Any], known: Collection[str]) -> None:
    """Raise `InputError` for an unknown key that is another name of a known one, or close to it."""
    for key in table:
        close = None if key in known else meant(key, [name for name in known if name not in table])
        if close is not None:
            owner = f"[{'.'.join(k for k in keys if isinstance(k, str))}]" if keys else "the file"
            raise file.error(
                f"{owner} has no key {shown(key)}", *keys, key, remedy=f"did you mean {close}? Correct the name"
            )


def error_names(axes: Mapping[str, Axis]) -> dict[str, float]:
    """The location errors of a machine's axes by name, each with a prior 1σ in µm or µrad.

    Two positions and two tilts of a rotary axis (ISO 230-7), three squarenesses of the linear axes.
    """
    found: dict[str, float] = {}
    for axis in axes.values():
        if axis.rotary:
            along = max(range(3), key=lambda i: abs(axis.direction[i]))
            others = [i for i in range(3) if i != along]
            found |= {f"E{'XYZ'[i]}0{axis.name}": SIGMAS["position"] for i in others}
            found |= {f"E{'ABC'[i]}0{axis.name}": SIGMAS["tilt"] for i in others}
    if all(name in axes and not axes[name].rotary for name in "XYZ"):
        found |= dict.fromkeys(_SQUARENESS, SIGMAS["squareness"])
    return found


def nearest_error(name: str, axes: Mapping[str, Axis]) -> str:
    """A remedy for the name of an error that this machine cannot have."""
    known = error_names(axes)
    motions = [f"E{letter}{axis}" for axis in axes for letter in "XYZABC"]
    zero = name.upper().replace("O", "0")  # the letter for the digit
    close = [zero] if zero in known else get_close_matches(name.upper(), [*known, *motions], 1, 0.6)
    first = f"did you mean {close[0]}? " if close else ""
    names = f"{first}This structure has the location errors {', '.join(known)} and motions such as {motions[0]}"
    return f"{names}; `symfive check` prints a ready [errors] block"


def place_of(axis: str, code: str) -> str:
    """Where an axis that the structural code lacks could stand in it."""
    workpiece, tool = f"w {axis}'{code.removeprefix('w')}", f"{code.removesuffix('t')}{axis} t"
    return f'or give it its place: "{workpiece}" if it carries the workpiece, "{tool}" if it carries the tool'

"""An axis alone, and what a laser reads along it."""

from typing import Any

import numpy as np

from symfive.campaign import Run
from symfive.machine import ErrorTerm, Machine, Structure, make_axis


def axis_alone(low: float, high: float, sigma_um: float = 0.0, order: int = 1) -> Machine:
    """A linear axis X; of its positioning error, a polynomial, each term has a prior 1σ, if any."""
    bent = ErrorTerm(name="EXX", sigma=sigma_um, basis=("polynomial",), order=(order,)) if sigma_um else None
    return Machine(
        name="axis", structure=Structure.parse("w b X t"), axes={"X": make_axis("X", travel=(low, high))},
        errors={"EXX": bent} if bent else {},
    )  # fmt: skip


def laser_run(id: str, way: np.ndarray, read: np.ndarray | None = None, axis: str = "X", **more: Any) -> Run:
    """At rest in every row and 1 s apart, unless more is said."""
    unit = "um" if axis in "XYZ" else "urad"
    said = {"readings": {} if read is None else {f"{axis}_dev_{unit}": read}, "time": np.arange(float(len(way)))}
    rest = {"instrument": ("laser",), "sampling": "static", "commands": {axis: way}, "options": {"axis": axis}}
    return Run(id=id, **(rest | said | more))

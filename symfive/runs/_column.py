"""A column of readings in a run's file."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Column:
    """A reading column of a CSV: internal value (mm, rad, …) = `scale` × the number in the file."""

    name: str
    unit: str
    scale: float

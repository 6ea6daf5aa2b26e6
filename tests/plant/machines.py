"""Ready machines as dictionaries of machine.toml: the ones of the shared campaigns and a few other
topologies.
"""

from typing import Any

Machine = dict[str, Any]


def drive(position: float, velocity: float, integral_s: float, viscous: float) -> dict[str, float]:
    """A drive of these gains, without feedforward."""
    return {
        "position_gain": position, "velocity_gain": velocity, "integral_time": integral_s, "viscous": viscous,
        "feedforward": 0.0,
    }  # fmt: skip


SYNCHRONOUS = {"X": drive(40.0, 300.0, 0.05, 8.0), "C": drive(40.0, 260.0, 0.05, 8.0)}
PLANAR = {"X": drive(45.0, 280.0, 0.06, 6.0), "Y": drive(45.0, 260.0, 0.06, 6.0)}
"""Drives of the campaigns dynamic-none and planar-none."""
LOCATION = {
    "EX0C": 31.0, "EY0C": -22.0, "EA0C": 83.0, "EB0C": -64.0, "EX0B": 15.0, "EZ0B": 26.0, "EA0B": 47.0, "EC0B": -38.0,
}  # fmt: skip
"""Errors of the rotary axes B and C, each of another size, µm and µrad."""
LIMITS = {
    "linear": {"travel": [-400.0, 400.0], "max_feed": 20000.0, "max_acceleration": 4000.0},
    "tilt": {"travel": [-120.0, 120.0], "max_feed": 13000.0, "max_acceleration": 60000.0},
    "turn": {"travel": [-3600.0, 3600.0], "max_feed": 13000.0, "max_acceleration": 60000.0},
}


def machine(
    structure: str,
    errors: dict[str, Any],
    *,
    drives: dict[str, dict[str, float]] | None = None,
    origins: dict[str, list[float]] | None = None,
    directions: dict[str, list[float]] | None = None,
) -> Machine:
    """Machine of any letters; C turns without end, A and B tilt; axes in the campaigns' order (bed
    outward).
    """
    words = structure.split()
    bed = words.index("b")
    names = [w.rstrip("'") for w in words[1:bed][::-1] + words[bed + 1 : -1]]
    axes: dict[str, Any] = {}
    for name in names:
        table: dict[str, Any] = {}
        if name in "ABC":
            table["origin"] = list((origins or {}).get(name, [0.0, 0.0, 0.0]))
        if name in (directions or {}):
            table["direction"] = list(directions[name])
        table |= LIMITS["turn" if name == "C" else "tilt" if name in "AB" else "linear"]
        if name in (drives or {}):
            table["drive"] = dict(drives[name])
        axes[name] = table
    return {
        "schema": "symfive.machine/1",
        "name": "plant",
        "structure": structure,
        "axes": axes,
        "errors": errors,
    }


def dynamic_table() -> Machine:
    """campaign dynamic-none: tilting table A C, Y under it, X and C with drives."""
    sigma = {"EX0C": 30.0, "EY0C": 30.0, "EA0C": 50.0, "EB0C": 50.0}
    return machine("w C' A' Y' b X Z t", {k: {"sigma": v} for k, v in sigma.items()}, drives=SYNCHRONOUS)


def planar_table() -> Machine:
    """campaign planar-none: the same structure, X and Y with drives, baseline squareness and EXX."""
    errors = {"EC0X": {"sigma": 40.0}, "EXX": {"basis": "polynomial", "order": 1, "sigma": 5.0}}
    return machine("w C' A' Y' b X Z t", errors, drives=PLANAR)


def static_table() -> Machine:
    """campaign static-none: tilting table B C, the B axis 50 mm below the origin."""
    errors = {f"E{c}0B": {"sigma": s} for c, s in (("X", 40.0), ("Z", 40.0), ("A", 80.0), ("C", 80.0))}
    errors |= {f"E{c}0C": {"sigma": s} for c, s in (("X", 40.0), ("Y", 40.0), ("A", 80.0), ("B", 80.0))}
    return machine("w C' B' Y' b X Z t", errors, origins={"B": [0.0, 0.0, -50.0]})


SLANT = [0.0, 2.0**-0.5, 2.0**-0.5]
"""Direction of a nutating axis: half way between Y and Z."""
TOPOLOGIES: dict[str, tuple[str, dict[str, list[float]]]] = {
    "table-bc": ("w C' B' Y' b X Z t", {}),
    "table-ac": ("w C' A' Y' b X Z t", {}),
    "table-ac-gantry": ("w C' A' b Y X Z t", {}),
    "head-ca": ("w b X Y Z C A t", {}),
    "head-cb": ("w X' b Y Z C B t", {}),
    "mixed-c-b": ("w C' Y' b X Z B t", {}),
    "nutating-table": ("w C' B' X' Y' b Z t", {"B": SLANT}),
    "nutating-head": ("w Y' b X Z C B t", {"B": SLANT}),
    "turning-table": ("w C' Y' b X Z t", {}),
    "three-axis": ("w Y' X' b Z t", {}),
    "three-axis-gantry": ("w b X Y Z t", {}),
}
"""Structural code and directions that are not the letter's own."""


def topology(
    name: str,
    errors: dict[str, Any],
    *,
    drives: dict[str, dict[str, float]] | None = None,
    origins: dict[str, list[float]] | None = None,
) -> Machine:
    """A machine of the table above."""
    structure, directions = TOPOLOGIES[name]
    return machine(structure, errors, drives=drives, origins=origins, directions=directions)

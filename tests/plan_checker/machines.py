"""Machines drawn at random: structural codes, origins, directions, travels and workspaces that docs/conventions.md allows."""

import numpy as np

from ._plan import Table

ERRORS = {
    "A": ("EY0A", "EZ0A", "EB0A", "EC0A"),
    "B": ("EX0B", "EZ0B", "EA0B", "EC0B"),
    "C": ("EX0C", "EY0C", "EA0C", "EB0C"),
}


def random_machine(seed: int) -> str:
    """A machine file: three linear axes in any order on either side, up to two rotary ones anywhere among them."""
    rng = np.random.default_rng([20290, seed])
    rotary = list(rng.permutation(list("ABC"))[: rng.choice([0, 1, 2], p=[0.05, 0.15, 0.8])])
    names = list(rng.permutation(["X", "Y", "Z", *rotary]))
    bed = int(rng.integers(0, len(names) + 1))
    code = " ".join(["w", *(f"{n}'" for n in names[:bed]), "b", *names[bed:], "t"])
    axes = {name: _rotary(rng, name) if name in rotary else _linear(rng, name) for name in names}
    lines = [f'schema = "symfive.machine/1"\nname = "random {seed}"\nstructure = "{code}"']
    for name, table in axes.items():
        lines += [f"[axes.{name}]", *(f"{key} = {value}" for key, value in table.items())]
    lines += ["[errors]", *(f"{n} = {{ sigma = 40.0 }}" for n in ("EC0X", "EA0Z", "EB0Z"))]
    lines += [f"{n} = {{ sigma = 50.0 }}" for name in rotary for n in ERRORS[name]]
    lines += ["[workspace]", *(f"{key} = {value}" for key, value in _workspace(rng, bool(rotary)).items())]
    return "\n".join(lines) + "\n"


def _linear(rng: np.random.Generator, name: str) -> Table:
    half, shift = rng.uniform(250.0, 700.0), rng.uniform(-80.0, 80.0)
    low, high = (shift - half, shift + half) if name != "Z" else (-rng.uniform(0.0, 250.0), 2.0 * half)
    return {
        "travel": _rounded([low, high]),
        "max_feed": float(rng.integers(4, 40) * 1000),
        "max_acceleration": float(rng.integers(1, 9) * 500),
    }


def _rotary(rng: np.random.Generator, name: str) -> Table:
    """An axis anywhere near the table; one in six is tilted, as nutating heads and tables are."""
    table: Table = {"origin": _rounded(rng.normal(0.0, 80.0, 3) * (rng.random() < 0.7))}
    if rng.random() < 1.0 / 6.0:
        direction = np.eye(3)["ABC".index(name)] + rng.choice([-1.0, 1.0]) * np.eye(3)[("ABC".index(name) + 1) % 3]
        table["direction"] = _rounded(direction)
    turns = name == "C" and rng.random() < 0.7
    low, high = (3600.0, 3600.0) if turns else rng.uniform(25.0, 120.0, 2)
    table |= {"travel": _rounded([-low, high]), "max_feed": float(rng.integers(1, 20) * 1000)}
    table["max_acceleration"] = float(rng.integers(1, 10) * 500)
    return table


def _workspace(rng: np.random.Generator, turning: bool) -> Table:
    low = float(rng.integers(20, 80))
    short = float(rng.integers(80, 160))
    space: Table = {
        "table_radius": float(rng.integers(60, 260)), "ball_height": [low, low + float(rng.integers(10, 150))],
        "tool_length": [short, short + float(rng.integers(0, 120))], "bar_lengths": [50.0, 100.0, 150.0],
        "bar_stroke": _rounded([rng.uniform(0.5, 2.0)])[0], "sensor_range": _rounded([rng.uniform(0.3, 2.0)])[0],
        "seconds_per_pose": 6.0,
    }  # fmt: skip
    if rng.random() < 0.85:
        nose = rng.uniform(20.0, 70.0), rng.uniform(20.0, 0.9 * short)
        space["spindle_nose"] = f"{{ radius = {nose[0]:.1f}, above_ball = {nose[1]:.1f} }}"
    if rng.random() < 0.5:
        space |= {
            "post_radius": float(rng.integers(5, 20)),
            "tool_radius": float(rng.integers(3, 12)),
            "bar_radius": 8.0,
        }
    if rng.random() < (0.15 if turning else 0.5):
        space["table_centre"] = _rounded(rng.normal(0.0, 60.0, 2))
    return space


def _rounded(values: object) -> list[float]:
    return [round(float(v), 1) + 0.0 for v in np.asarray(values)]

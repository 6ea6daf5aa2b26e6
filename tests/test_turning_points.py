"""A play is crossed from where the axis turned, which is between two rows: closed form on a circle that is read seldom."""

import numpy as np
import pytest

from symfive.campaign import Campaign, Run
from symfive.effects import make_effect
from symfive.machine import Machine, Structure, make_axis
from symfive.model import Model

RADIUS_MM, TURNS_HZ, RATE_HZ, WIDTH_UM = 10.0, 0.8, 250.0, 4.0
NAME = "backlash.X"


def circle(phase: float, between: str = "curve") -> Campaign:
    """X of two revolutions at 3000 mm/min: it moves 0.5 µm about a turning point in half a row."""
    time = np.arange(625.0) / RATE_HZ
    way = RADIUS_MM * np.cos(2.0 * np.pi * TURNS_HZ * time + phase)
    machine = Machine(name="axis", structure=Structure.parse("w b X t"), axes={"X": make_axis("X")})
    run = Run(
        id="circle", instrument=("grid_encoder",), sampling="dynamic", time=time, commands={"X": way},
        u=(1.0, 0.0, 0.0), v=(0.0, 1.0, 0.0), options={"between": between},
    )  # fmt: skip
    return Campaign(machine=machine, runs=(run,))


def lost(campaign: Campaign, shape: str, distance: float = WIDTH_UM) -> np.ndarray:
    """What the effect adds in each row, µm, from the second reversal on."""
    effect = make_effect("backlash", "X", shape=shape)
    model = Model(campaign, (effect,))
    values = model.named(model.start) | {f"{NAME}.width": WIDTH_UM}
    if shape != "play":
        values[f"{NAME}.distance"] = distance
    return model.contribution(effect, values)["circle"][:, 0]


def since_turning(campaign: Campaign, phase: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Way since the last turning point, µm, direction, and which rows lie behind the second of them."""
    angle = 2.0 * np.pi * TURNS_HZ * campaign.runs[0].time + phase
    way, half = RADIUS_MM * np.cos(angle), np.floor(angle / np.pi)
    turned = RADIUS_MM * np.cos(np.pi * half)
    return 1e3 * np.abs(way - turned), np.where(half % 2.0 == 0.0, -1.0, 1.0), half >= half[0] + 2.0


@pytest.mark.parametrize("phase", [0.4, 0.403, 0.407, 0.41])
def test_a_play_is_crossed_from_the_turning_point(phase: float) -> None:
    campaign = circle(phase)
    way, direction, settled = since_turning(campaign, phase)
    state = direction * np.clip(2.0 * way / WIDTH_UM - 1.0, -1.0, 1.0)
    error = lost(campaign, "play") + 0.5 * WIDTH_UM * state
    assert np.abs(error[settled]).max() < 0.01  # it was up to 0.5 µm
    at_the_rows = lost(circle(phase, "line"), "play") + 0.5 * WIDTH_UM * state
    assert np.abs(at_the_rows[settled]).max() > 0.05  # a polygon has its turning points at the rows


def test_pre_sliding_begins_at_the_turning_point() -> None:
    campaign, distance = circle(0.4), 3.0
    way, direction, settled = since_turning(campaign, 0.4)
    state = direction * (1.0 - 2.0 * np.exp(-way / distance))
    error = lost(campaign, "pre_sliding", distance) + 0.5 * WIDTH_UM * state
    assert np.abs(error[settled]).max() < 0.01

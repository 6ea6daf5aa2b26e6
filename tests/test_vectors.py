"""The normative vectors: the chain of the conventions, section 1, to 1e-9 mm."""

import json
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from symfive.kinematics import ball_in_workpiece
from symfive.machine import Machine, machine_from_data

VECTORS = sorted((Path(__file__).parent / "data" / "vectors").glob("*.json"))


def machine_of(vector: dict) -> Machine:
    code = vector["structure"]
    names = [word.rstrip("'") for word in code.split() if word not in ("w", "b", "t")]
    axes = {name: {"travel": [-1000.0, 1000.0]} for name in names}
    for key, field in (("origins_mm", "origin"), ("directions", "direction")):
        for name, value in vector.get(key, {}).items():
            axes[name][field] = value
    return machine_from_data({"schema": "symfive.machine/1", "structure": code, "axes": axes})


def scaled(errors: dict[str, float]) -> dict[str, ca.SX]:
    return {name: ca.SX(value * (1e-3 if name[1] in "XYZ" else 1e-6)) for name, value in errors.items()}


def test_all_six_are_there():
    assert len(VECTORS) == 6


@pytest.mark.parametrize("path", VECTORS, ids=lambda path: path.stem)
def test_ball_in_workpiece(path):
    vector = json.loads(path.read_text())
    machine = machine_of(vector)
    location = scaled(vector["location_errors_um_urad"])
    for row in vector["rows"]:
        position = {n: ca.SX(q * machine.axes[n].to_internal) for n, q in row["command"].items()}
        ball = ca.DM(row["tool_ball_mm"])
        motion = scaled(row["error_motions_um_urad"])
        exact = ca.evalf(ball_in_workpiece(machine, position, ball, location=location, motion=motion))
        nominal = ca.evalf(ball_in_workpiece(machine, position, ball))
        assert np.abs(np.asarray(exact)[:, 0] - row["ball_in_workpiece_mm"]).max() < 1e-9
        assert np.abs(np.asarray(nominal)[:, 0] - row["nominal_ball_in_workpiece_mm"]).max() < 1e-9

"""A vertical lifting column with an arm of six rotary axes on a base: total station positions of a prism, mm.

Hilti, CC BY-NC-SA 3.0: local checks only. The arm is mounted with its first axis horizontal.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from symfive.arrays import Array
from symfive.campaign import Campaign, Run, SetupSigma
from symfive.convert._files import files, serial_chain
from symfive.errors import InputError
from symfive.files import read_text
from symfive.kinematics import forward, placement, rounded

AXES = {  # direction, a point on the axis in mm, all axes at zero; the URDF's transforms multiplied out
    "L": ((0.0, 0.0, 1.0), (500.0, 0.0, 216.0)),
    "J1": ((1.0, 0.0, 0.0), (756.5, 0.0, 231.0)),
    "J2": ((0.0, 0.0, 1.0), (756.5, 0.0, 265.5)),
    "J3": ((0.0, 0.0, 1.0), (1376.5, 0.0, 265.5)),
    "J4": ((1.0, 0.0, 0.0), (1935.5, 0.0, 265.5)),
    "J5": ((0.0, 0.0, 1.0), (1935.5, 0.0, 265.5)),
    "J6": ((1.0, 0.0, 0.0), (2056.5, 0.0, 265.5)),
}
NOISE_MM = 0.75
SIGMA = (3000.0, 10000.0)  # of every location error: µm, µrad
_TOKEN = re.compile(
    r"^  (?P<height>[\d.]+):\s*$|^      (?P<space>\d+):\s*$|\btime: (?P<time>[\d.]+)|joint_states: \[(?P<joints>[^\]]*)\]"
    r"|prism_position: \[(?P<prism>[^\]]*)\]",
    re.MULTILINE,
)


@dataclass
class _Station:
    """What was read at one column height and in one solution space of the arm, in the file's order."""

    name: str
    time: list[float] = field(default_factory=list)
    joints: list[Array] = field(default_factory=list)
    prism: list[Array] = field(default_factory=list)


def hilti_column(folder: Path) -> Campaign:
    """Every column height and solution space of each `*.yaml` as a static run of a `tracker`, rows in order of time.

    Each run places the instrument anew, as the robot does before it works there: the base stands on its own wheels. Both
    accelerometers are not converted: the model has no such instrument.
    """
    each = [_stations(path) for path in files(folder, "*.yaml")]
    start = min(station.time[0] for stations in each for station in stations)
    machine = serial_chain(
        "lifting column with arm", AXES, sigma=SIGMA, linear={"L": (0.0, 4000.0)}, travel=(-400.0, 400.0)
    )
    runs = tuple(run for stations in each for run in _runs(stations, start))
    notes = ("the accelerometers of base and column are not converted: the model has no such instrument",)
    return Campaign(machine=machine, runs=runs, name="hilti-column", notes=notes)


def _runs(stations: list[_Station], start: float) -> list[Run]:
    """One file. The placement from which estimation begins is the one that suits all of its stations best."""
    joints = np.concatenate([np.array(station.joints) for station in stations])
    prism = np.concatenate([np.array(station.prism) for station in stations])
    turn, shift, (reflector,) = placement(forward(AXES, joints, ["L"]), [prism])
    angles = Rotation.from_matrix(turn).as_euler("XYZ", degrees=True)
    found = []
    for station in stations:
        order = np.argsort(station.time)
        time = np.array(station.time)[order] - start
        angle, seen = np.array(station.joints)[order], np.array(station.prism)[order]
        found.append(
            Run(
                id=station.name,
                instrument=("tracker",),
                sampling="static",
                time=time - time[0],
                start_s=float(time[0]),
                commands={axis: angle[:, i] for i, axis in enumerate(AXES)},
                readings={f"{c}_mm": seen[:, i] for i, c in enumerate("xyz")},
                tool_ball=rounded(reflector, 3),
                noise_um=NOISE_MM,
                setup_sigma_um=SetupSigma(tool_ball=5000.0),
                options={"placement": [round(float(v), 3) for v in (*shift, *angles)]},
            )
        )
    return found


def _stations(path: Path) -> list[_Station]:
    """The stations of one file, which is the YAML that the robot's own log writer makes."""
    found: list[_Station] = []
    height = "0"
    for match in _TOKEN.finditer(read_text(path)):
        kind, text = str(match.lastgroup), match[str(match.lastgroup)]
        if kind == "height":
            height = text
        elif kind == "space":
            found.append(_Station(f"{path.stem}-{height}-{text}"))
        elif not found:
            raise InputError("a measurement stands before any solution space", path=path)
        elif kind == "time":
            found[-1].time.append(float(text))
        else:
            numbers = np.array([float(number) for number in text.split(",")])
            if kind == "joints":
                found[-1].joints.append(np.concatenate([1e3 * numbers[:1], np.degrees(numbers[1:])]))
            else:
                found[-1].prism.append(1e3 * numbers)
    for station in found:
        sizes = {len(station.time), len(station.joints), len(station.prism)}
        if len(sizes) != 1 or not station.time:
            raise InputError(f"{station.name}: time, joint states and prism do not belong together", path=path)
    if not found:
        raise InputError("the file holds no solution space", path=path, remedy="check that the recording is complete")
    return found

"""The control's configuration files for a machine: axes, joints and limits (INI), and how the parts are wired (HAL)."""

from __future__ import annotations

from collections.abc import Sequence

from symfive.codegen.linuxcnc import WORLD
from symfive.machine import Axis, Machine

SERVO_S = 0.001
SAMPLES = 60000
"""Depth of the recorder's queue: a minute, in case the one that empties it has to wait."""
OVERTRAVEL = 1.0
"""mm or degree between a travel and its limit switch: room for compensation at the end of the travel."""
FEED, ACCELERATION = 6000.0, 1000.0
"""mm/min and mm/s², or degree/min and degree/s², of an axis whose machine file is silent about them."""
WORLD_LIMIT = 1e5
"""The tool centre point has no limits of its own, its axes have."""
TCP_OFF = "M68 E3 Q1\nM66 E0 L0\nG49"


def tcp_on(tool_length: float) -> str:
    """Lines that switch tool-centre point control on for a tool length in mm, which is set while words are axis positions."""
    return f"G43.1 Z{tool_length:.6f}\nM68 E3 Q0\nM66 E0 L0"


def joint_letters(machine: Machine) -> list[str]:
    """The axes in LinuxCNC's order, which is that of the joints."""
    return [letter for letter in WORLD if letter in machine.axes]


def _block(title: str, **values: object) -> str:
    return "\n".join([f"[{title}]", *(f"{name} = {value}" for name, value in values.items())])


def ini_text(machine: Machine, prefix: str) -> str:
    """The INI file. Joint limits, speeds (mm/s, degree/s) and accelerations are the machine file's."""
    letters = joint_letters(machine)
    axes = [machine.axes[letter] for letter in letters]
    linear, rotary = ([a for a in axes if a.rotary == kind] for kind in (False, True))
    blocks = [
        _block("EMC", VERSION="1.1", MACHINE="symfive loop"),
        _block("DISPLAY", DISPLAY="./driver.py", MAX_FEED_OVERRIDE="100.0"),
        _block("TASK", TASK="milltask", CYCLE_TIME=SERVO_S),
        _block("RS274NGC", PARAMETER_FILE="loop.var"),
        _block("EMCMOT", EMCMOT="motmod", COMM_TIMEOUT="1.0", SERVO_PERIOD=round(1e9 * SERVO_S)),
        _block("EMCIO", EMCIO="io", CYCLE_TIME="0.1", TOOL_TABLE="tool.tbl"),
        _block("HAL", HALFILE="loop.hal"),
        _block("KINS", KINEMATICS=f"{prefix}kins", JOINTS=len(letters)),
        _block(
            "TRAJ", COORDINATES=" ".join(letters), LINEAR_UNITS="mm", ANGULAR_UNITS="degree",
            MAX_LINEAR_VELOCITY=max(map(_speed, linear)), MAX_ANGULAR_VELOCITY=max(map(_speed, rotary), default=1.0),
        ),
    ]  # fmt: skip
    for joint, (letter, axis) in enumerate(zip(letters, axes, strict=True)):
        limits = {"MAX_VELOCITY": _speed(axis), "MAX_ACCELERATION": axis.max_acceleration or ACCELERATION}
        blocks += [
            _block(f"AXIS_{letter}", MIN_LIMIT=-WORLD_LIMIT, MAX_LIMIT=WORLD_LIMIT, **limits),
            _block(
                f"JOINT_{joint}", TYPE="ANGULAR" if axis.rotary else "LINEAR", **limits,
                MIN_LIMIT=axis.travel[0] - OVERTRAVEL, MAX_LIMIT=axis.travel[1] + OVERTRAVEL,
                FERROR=1.0, MIN_FERROR=1.0, HOME=_home(axis), HOME_OFFSET=_home(axis), HOME_SEARCH_VEL=0.0,
                HOME_LATCH_VEL=0.0, HOME_SEQUENCE=0,
            ),
        ]  # fmt: skip
    return "\n\n".join(blocks) + "\n"


def _speed(axis: Axis) -> float:
    return (axis.max_feed or FEED) / 60.0


def _home(axis: Axis) -> float:
    """0, or the end of the travel nearest to it."""
    return min(max(0.0, axis.travel[0]), axis.travel[1])


def hal_text(machine: Machine, prefix: str, setp: Sequence[str]) -> str:
    """The HAL file: joints follow their commands at once, the recorder sees line and joints in the same servo cycle."""
    joints = range(len(joint_letters(machine)))
    lines = [
        f"loadrt {prefix}kins",
        f"loadrt motmod servo_period_nsec={round(1e9 * SERVO_S)} num_joints={len(joints)}",
        f"loadrt sampler depth={SAMPLES} cfg=s{'f' * len(joints)}",
        "setp sampler.0.enable 0",
        "addf motion-command-handler servo-thread",
        "addf motion-controller servo-thread",
        "addf sampler.0 servo-thread",
        f"net tool-length motion.tooloffset.z => {prefix}kins.tool-offset",
        "net kinematics motion.analog-out-03 => motion.switchkins-type",
        "net line motion.program-line => sampler.0.pin.0",
        *(f"net joint-{i} joint.{i}.motor-pos-cmd => joint.{i}.motor-pos-fb sampler.0.pin.{i + 1}" for i in joints),
        "net estop iocontrol.0.user-enable-out => iocontrol.0.emc-enable-in",
        "net tool-prepared iocontrol.0.tool-prepare => iocontrol.0.tool-prepared",
        "net tool-changed iocontrol.0.tool-change => iocontrol.0.tool-changed",
        *setp,
    ]
    return "\n".join(lines) + "\n"

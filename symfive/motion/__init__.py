"""Motion of the axes along a run: drives, positions behind them, and signals with memory."""

from symfive.motion._between_rows import begun_before, is_moving, is_told_by_rows, thinned
from symfive.motion._drives import GAINS, drive_response
from symfive.motion._first_order import first_order, first_order_slope
from symfive.motion._friction import FRICTION
from symfive.motion._gaps import programme_of
from symfive.motion._loop import LOOP, linear_recurrence
from symfive.motion._motion import LAG, LAG_OF_ALL, LAGS, AxisMotion, Late, RunMotion, Series, Signal
from symfive.motion._moved_path import moved_response
from symfive.motion._signals import (
    FINE_S,
    Acceleration,
    Command,
    Direction,
    Play,
    Position,
    PreSliding,
    Resonance,
    ReversalAhead,
    ReversalDistance,
    ReversalTime,
    SpindleAngle,
    Velocity,
    approach,
    unmoved,
)

__all__ = [
    "FINE_S", "FRICTION", "GAINS", "LAG", "LAGS", "LAG_OF_ALL", "LOOP", "Acceleration", "AxisMotion", "Command", "Direction",
    "Late", "Play", "Position", "PreSliding", "Resonance", "ReversalAhead", "ReversalDistance", "ReversalTime", "RunMotion",
    "Series", "Signal", "SpindleAngle", "Velocity", "approach", "begun_before", "drive_response", "first_order",
    "first_order_slope", "is_moving", "is_told_by_rows", "linear_recurrence", "moved_response", "programme_of", "thinned",
    "unmoved",
]  # fmt: skip

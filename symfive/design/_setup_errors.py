"""Set-up errors that limit a plan, in words, with the remedy for each."""

from __future__ import annotations

from dataclasses import dataclass

NOISE_HARDLY = 0.95
"""Share of a 1σ from which what is left of it counts as all of it: what went is a tenth of the variance at most."""


@dataclass(frozen=True)
class SetupError:
    """One error of the set-up.

    `sigma` the field of `SetupSigma` that holds its 1σ; `members` the parameters of a run that it has; `remedy` what makes it
    known.
    """

    sigma: str
    name: str
    members: tuple[str, ...]
    remedy: str


SETUP_ERRORS = (
    SetupError(
        "tool_ball", "the tool ball's run-out", ("tool_ball.x", "tool_ball.y"),
        "read it by spindle indexing (--index) or by an indicator (--tool-ball-sigma)",
    ),
    SetupError("tool_length", "the tool's length", ("tool_ball.z",), "measure it (--tool-length-sigma)"),
    SetupError(
        "table_ball", "the table ball's place", ("table_ball.x", "table_ball.y", "table_ball.z"),
        "measure it (--table-ball-sigma)",
    ),
    SetupError(
        "zero", "the nest's place in the workpiece frame", ("zero.x", "zero.y", "zero.z"),
        "put it onto a calibrated place (--zero-sigma)",
    ),
    SetupError("length", "the bar's length", ("length",), "calibrate it (--bar-length-sigma)"),
)  # fmt: skip

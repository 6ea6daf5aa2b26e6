"""Instruments: what each one reads, what it does not know about itself. One file and one line of the table each.

What only the symbolic reading needs (CasADi, SciPy, the motion) is loaded with the first reading: a file is checked without.
"""

from __future__ import annotations

from symfive.errors import InputError, among
from symfive.instruments._base import (
    ZERO_SIGMA_UM,
    BallInstrument,
    Instrument,
    setup_parameter,
    setup_vector,
    vector_constants,
)
from symfive.instruments.ball_bar import BallBar
from symfive.instruments.displacement import Displacement
from symfive.instruments.drive_force import DriveForce
from symfive.instruments.encoder import Encoder
from symfive.instruments.grid_encoder import GridEncoder
from symfive.instruments.laser import Laser
from symfive.instruments.r_test import RTest
from symfive.instruments.straightedge import Straightedge
from symfive.instruments.touch_probe import TouchProbe, touches_of
from symfive.instruments.tracker import Tracker
from symfive.machine import Machine
from symfive.runs import Column, Run

__all__ = [
    "INSTRUMENTS", "ZERO_SIGMA_UM", "BallInstrument", "Column", "Instrument", "ball_instrument", "check_mounting",
    "columns_of", "fitted_parts", "has_bar", "has_clock_of_its_own", "has_post", "instruments_of", "is_probed", "mounted",
    "mounted_instrument", "positioning_instrument", "setup_parameter", "setup_vector", "touches_of", "vector_constants",
]  # fmt: skip

_ALL = (
    BallBar(),
    RTest(),
    TouchProbe(),
    GridEncoder(),
    Displacement(),
    Laser(),
    Encoder(),
    DriveForce(),
    Tracker(),
    Straightedge(),
)
INSTRUMENTS: dict[str, Instrument] = {instrument.name: instrument for instrument in _ALL}


def instruments_of(run: Run) -> tuple[Instrument, ...]:
    """The instruments of a run. Raises `InputError` for a name that is not in the table."""
    for name in run.instrument:
        among(name, INSTRUMENTS, f"instrument {name!r} is unknown", keys=("instrument",))
    return tuple(INSTRUMENTS[name] for name in run.instrument)


def mounted_instrument(run: Run) -> Instrument:
    """The first instrument of a run that names a place on the table; the first of all where none does."""
    every = instruments_of(run)
    return next((instrument for instrument in every if instrument.stands), every[0])


def mounted(run: Run) -> tuple[str, str]:
    """What stands on the table in a run, and what the spindle holds; nothing where no instrument names a place."""
    instrument = mounted_instrument(run)
    return (instrument.on_table(run), instrument.in_spindle(run)) if instrument.stands else ("", "")


def ball_instrument(run: Run) -> BallInstrument | None:
    """The instrument of a run that reads the tool's ball against the table's."""
    return next((i for i in instruments_of(run) if isinstance(i, BallInstrument)), None)


def has_post(run: Run) -> bool:
    """Whether a ball or a nest on a post stands on the table in a run."""
    return any(instrument.on_a_post for instrument in instruments_of(run))


def has_bar(run: Run) -> bool:
    """Whether a bar joins the two balls in a run."""
    return any(instrument.bar for instrument in instruments_of(run))


def is_probed(run: Run) -> bool:
    """Whether the control probes what stands on the table in a run."""
    return any(instrument.probes for instrument in instruments_of(run))


def positioning_instrument(run: Run) -> str | None:
    """The instrument of a run that compares the positions of one axis with their targets."""
    return next((instrument.name for instrument in instruments_of(run) if instrument.positions), None)


def columns_of(run: Run, machine: Machine) -> tuple[Column, ...]:
    """The reading columns of a run, one instrument after the other."""
    return tuple(column for instrument in instruments_of(run) for column in instrument.columns(run, machine))


def fitted_parts(run: Run, machine: Machine) -> list[tuple[str, slice]]:
    """The instruments of a run whose readings are fitted, each with its columns; not those of an encoder that is the motion."""
    found, first = [], 0
    for instrument in instruments_of(run):
        part = slice(first, first + len(instrument.columns(run, machine)))
        first = part.stop
        if not (instrument.name == Encoder.name and run.encoder_is_motion):
            found.append((instrument.name, part))
    return found


def check_mounting(run: Run, machine: Machine) -> None:
    """Raise `InputError` where a run names a mounting of something that its instruments have no error of."""
    if not run.mounting:
        return
    own = {p.quantity.partition(".")[0] for i in instruments_of(run) for p in i.parameters(run, machine) if p.of_setup}
    for quantity in run.mounting:
        if quantity not in own and getattr(run.setup_sigma_um, quantity, None) != 0.0:  # 0: known exactly
            problem = f"run {run.id}: mounting names {quantity}, of which its instruments have no error"
            remedy = f"name one of {', '.join(sorted(own))}"
            raise InputError(problem, remedy=remedy, keys=("mounting", quantity))


def has_clock_of_its_own(run: Run) -> bool:
    """Whether a run has readings that the control does not record itself."""
    return any(not instrument.on_control for instrument in instruments_of(run))

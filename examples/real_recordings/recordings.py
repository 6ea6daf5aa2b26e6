"""The recordings: how each is handed to the diagnosis, which part is fitted and which is held out, what is drawn.

Nothing here knows an answer. `prepare` only takes physics out of the baseline, thins rows, or says which rows are one test.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from symfive.campaign import Campaign, Run
from symfive.importers import every, rows_of, split

STEP_DEG = 4.0


@dataclass(frozen=True)
class Part:
    """A way to divide a recording: `learn` says of a run whether it is fitted (the others are predicted), once `cut` has made
    runs of what is to be divided."""

    label: str
    learn: Callable[[Run], bool]
    cut: Callable[[Campaign], Campaign] = lambda campaign: campaign


@dataclass(frozen=True)
class Recording:
    """One recording, and how its figure is drawn.

    `unit` is that of the readings whose held-out rms is compared. `over` is the coordinate of the figure (an axis,
    `X velocity` or `time`), `column` its reading (none: the one that changes most), `draw` says which runs are in it, `bins`
    how many means over the coordinate. `unseen` picks runs that no fit sees at all, `exclude` takes effects out of the
    catalogue that these readings cannot have, `published` holds values of others.
    """

    name: str
    machine: str
    source: str
    prepared: str
    unit: str
    over: str
    column: str
    parts: tuple[Part, ...]
    prepare: Callable[[Campaign], Campaign] = lambda campaign: campaign
    draw: Callable[[Run], bool] = lambda run: True
    bins: int = 0
    unseen: Callable[[Campaign], Campaign] | None = None
    exclude: tuple[str, ...] = ()
    published: Mapping[str, float] | None = None

    @property
    def converter(self) -> str:
        """Which recording it is, or is a part of."""
        return self.name.split(" ")[0]


def halves() -> tuple[Part, Part]:
    """The first half of every run, and the second."""
    return (
        Part("first half → second half", lambda run: run.id.endswith("-1of2"), _cut_at(0.5)),
        Part("second half → first half", lambda run: run.id.endswith("-2of2"), _cut_at(0.5)),
    )


def _cut_at(share: float) -> Callable[[Campaign], Campaign]:
    """Every run cut in two, each with zeros of its own."""

    def cut(campaign: Campaign) -> Campaign:
        found = []
        for run in campaign.runs:
            at = int(share * run.rows)
            for number, rows in enumerate((slice(0, at), slice(at, None)), start=1):
                found.append(_named(rows_of(run, rows), f"{run.id}-{number}of2"))
        return replace(campaign, runs=tuple(found))

    return cut


def _alternating(campaign: Campaign) -> Campaign:
    """Every other row of each run as a run of its own."""
    each = [(run, number) for run in campaign.runs for number in (1, 2)]
    rows = [_named(rows_of(run, slice(number - 1, None, 2)), f"{run.id}-{number}of2") for run, number in each]
    return replace(campaign, runs=tuple(rows))


def _named(run: Run, name: str) -> Run:
    """Rows as a run of their own name, that begins at 0 s of its own."""
    begin = float(run.time[0])
    return replace(run, id=name, file=f"{name}.csv", time=run.time - begin, start_s=run.start_s + begin)


def runs_with(label: str, *marks: str) -> Part:
    """Runs whose id holds one of the marks are fitted, the others predicted."""
    return Part(label, lambda run: any(mark in run.id for mark in marks))


def _without_friction(campaign: Campaign) -> Campaign:
    """Mass and viscous friction are all that the baseline knows of the drive."""
    bare = [replace(run, options={**run.options, "force_terms": ("mass", "viscous")}) for run in campaign.runs]
    return replace(campaign, runs=tuple(bare))


def _thinned(step: int) -> Callable[[Campaign], Campaign]:
    def prepare(campaign: Campaign) -> Campaign:
        return replace(campaign, runs=tuple(every(run, step) if run.rows > 500 else run for run in campaign.runs))

    return prepare


def _iso230(campaign: Campaign) -> Campaign:
    """The static tests, their cycles as runs (`--split cycles`)."""
    tests = replace(campaign, runs=tuple(run for run in campaign.runs if not run.dynamic))
    return split(tests, "cycles", only=[run.id for run in tests.runs if "encoder" not in run.instrument])


def _of_axis(
    axis: str, then: Callable[[Campaign], Campaign] = lambda campaign: campaign
) -> Callable[[Campaign], Campaign]:
    """The runs that are about one axis."""

    def prepare(campaign: Campaign) -> Campaign:
        return then(replace(campaign, runs=tuple(run for run in campaign.runs if run.options.get("axis") == axis)))

    return prepare


def _scans(step: int) -> Callable[[Campaign], Campaign]:
    def prepare(campaign: Campaign) -> Campaign:
        return replace(campaign, runs=tuple(every(run, step) for run in campaign.runs if run.dynamic))

    return prepare


def _turns(campaign: Campaign) -> Campaign:
    """Whole turns (`--split turns --step-deg 4`); of the standstill every eighth row; no coast-down."""
    probes = [run for run in campaign.runs if "displacement" in run.instrument]
    still = [run.id for run in probes if np.ptp(run.commands["C"]) < 360.0]
    thinned = replace(campaign, runs=tuple(every(run, 8) if run.id in still else run for run in probes))
    return split(thinned, "turns", step_deg=STEP_DEG, only=[run.id for run in probes if run.id not in still])


def _coast_down(campaign: Campaign) -> Campaign:
    """The run with the drive off; all is per unit of inertia (1 kg m²)."""
    return replace(campaign, runs=tuple(run for run in campaign.runs if "drive_force" in run.instrument))


def _seen_from_outside(campaign: Campaign) -> Campaign:
    """The resolver on the screw of a stepper that runs open loop tells no control anything: it reads what the axis did, as an
    outer instrument. Every fourth row (25 Hz)."""
    runs = []
    for run in (every(run, 4) for run in campaign.runs):
        deviation = 1e3 * (run.readings["X_act_mm"] - run.commands["X"])
        runs.append(
            replace(
                run, instrument=("laser",), readings={"X_dev_um": deviation - deviation.mean()}, noise_um=0.01,
                options={"axis": "X"},
            )
        )  # fmt: skip
    return replace(campaign, runs=tuple(runs))


ESS = "A. Sandström, anderssandstrom/ecmc_target_muts_logger"
MUKCA = "G. Franzese, M. Spahn & M. Ramirez, platonics-delft/kinematics_calibration"
CYCLES = (
    runs_with("cycles 1, 2 → 3 to 5", "cycle-1", "cycle-2"),
    runs_with("cycles 4, 5 → 1 to 3", "cycle-4", "cycle-5"),
)
ARM = "rotary axes in series, a ball at the flange set into sockets (same physics as an R-test)"
AS_CONVERTED = "as converted"
SEATED = (
    "as converted, without sensor errors in the catalogue: the ball stays in its socket and every reading is zero by "
    "construction, which no gain can change"
)


def _arm(name: str, places: Part) -> Recording:
    """One of the arms; their sockets in turn, and `places`."""
    return Recording(
        name=f"mukca/{name}",
        machine=ARM,
        source=MUKCA,
        prepared=SEATED,
        exclude=("sensor_error",),
        unit="um",
        over="J2",
        column="",
        bins=12,
        parts=(runs_with("socket 0 → socket 1", "hole_0"), places),
    )


RECORDINGS: tuple[Recording, ...] = (
    Recording(
        name="emps",
        machine="ball-screw axis under position control, encoder and drive force",
        source="A. Janot, M. Gautier & M. Brunot 2019, through forgi86/sysid-neural-continuous",
        prepared="the baseline knows mass and viscous friction only",
        unit="N",
        over="X velocity",
        column="X_force_N",
        parts=halves(),
        prepare=_without_friction,
        published={"coulomb": 20.39, "offset": -3.16},
    ),
    Recording(
        name="ecmc-iso230",
        machine="linear axis, ISO 230-2, 5 positions, 5 cycles, both directions",
        source="paulscherrerinstitute/ecmccfg",
        prepared="each of the five cycles is a run of its own, so that the cycles show the noise",
        unit="um",
        over="X",
        column="X_dev_um",
        parts=CYCLES,
        prepare=_iso230,
    ),
    Recording(
        name="ess-xyz (stops)",
        machine="linear axes X, Y, Z of a target drive unit, ISO 230-2",
        source=ESS,
        prepared="each cycle of the tests is a run of its own; the scans are not seen by any fit",
        unit="um",
        over="X",
        column="X_dev_um",
        parts=(runs_with("cycles 1, 2 → 3 to 5, stops of the raw log", "cycle-1", "cycle-2"),),
        prepare=_iso230,
        draw=lambda run: "cycle" in run.id and "_x_" in run.id,
        unseen=_scans(8),
    ),
    Recording(
        name="ess-xyz (scans)",
        machine="X and Z of the same unit, laser against motor resolver in slow motion",
        source=ESS,
        prepared="of the scans every sixth row (0.6 s, 0.12 mm)",
        unit="um",
        over="X",
        column="X_dev_um",
        parts=halves(),
        prepare=_scans(6),
        draw=lambda run: "_x_" in run.id,
        unseen=_iso230,
    ),
    Recording(
        name="ess-rotary/wobbling (turns)",
        machine="heavy rotary axis, three probes on the rim, one on the face",
        source=ESS,
        prepared="each whole turn is a run of its own, rows every 4°, so that the turns show the noise; and the standstill",
        unit="um",
        over="C",
        column="s4_um",
        parts=(
            runs_with("test_03, standstill → test_04, 05", "test_03", "zero"),
            runs_with("test_04, standstill → test_03, 05", "test_04", "zero"),
        ),
        prepare=_turns,
        draw=lambda run: "turn" in run.id,
    ),
    Recording(
        name="ess-rotary/wobbling (coast-down)",
        machine="the same axis with the drive off, all per unit of inertia",
        source=ESS,
        prepared="the baseline knows viscous and Coulomb friction",
        unit="Nm",
        over="C velocity",
        column="C_torque_Nm",
        parts=halves(),
        prepare=_coast_down,
    ),
    Recording(
        name="ess-rotary/radial-load",
        machine="the same axis at standstill, free and with 10 kN from three sides",
        source=ESS,
        prepared=AS_CONVERTED,
        unit="um",
        over="time",
        column="s1_um",
        parts=(runs_with("load on x- → on x+ and y+", "x_minus"), runs_with("load on x+ → on x- and y+", "x_plus")),
    ),
    Recording(
        name="jjxray-slit",
        machine="slit blade on stepper and lead screw, resolver on the screw",
        source="A. Sandström, anderssandstrom/ecmc_bifrost_slits_sat",
        prepared="the resolver counts as an outer instrument, since the stepper runs open loop; every fourth row (25 Hz)",
        unit="um",
        over="X",
        column="X_dev_um",
        parts=halves(),
        prepare=_seen_from_outside,
        draw=lambda run: bool(np.ptp(run.commands["X"]) > 0.0),
    ),
    Recording(
        name="irb120-tracker",
        machine="six rotary axes, 1000 poses, tracker on three tool and three base reflectors",
        source="K. Kamali 2018, icelinker/Robot-Calibration-LaserTracker",
        prepared="every twelfth pose",
        unit="mm",
        over="J2",
        column="",
        bins=16,
        parts=(
            Part("every other pose → those between", lambda run: run.id.endswith("-1of2"), _alternating),
            runs_with("reflectors 1, 2 → 3", "-1", "-2", "read-back"),
        ),
        prepare=_thinned(12),
        draw=lambda run: "tool" in run.id,
    ),
    *(
        Recording(
            name=f"ess-xyz/week42 ({axis})",
            machine=f"axis {axis} of the same unit, another laser, five weeks earlier, ISO 230-2",
            source=ESS,
            prepared="each of the five cycles is a run of its own",
            unit="um",
            over=axis,
            column=f"{axis}_dev_um",
            parts=CYCLES,
            prepare=_of_axis(axis, _iso230),
        )
        for axis in ("X", "Y")
    ),
    Recording(
        name="hilti-column",
        machine="vertical lifting column with an arm of six rotary axes, prism seen by a total station",
        source="Hilti, CC BY-NC-SA 3.0",
        prepared="as converted: each column height and solution space places the instrument anew",
        unit="mm",
        over="J1",
        column="",
        bins=12,
        parts=(runs_with("flat → outdoor", "flat"), runs_with("outdoor → flat", "outdoor")),
    ),
    *(
        Recording(
            name=f"tx40 (J{k})",
            machine=f"servo axis J{k} of a small arm, motor current, per unit of torque constant, all six joints moving",
            source="FIGAROH project (Apache-2.0)",
            prepared="one joint, whose drive has noise of its own; the baseline knows inertia, viscous and Coulomb friction and "
            "an offset",
            unit="Nm",
            over=f"J{k}",
            column=f"J{k}_torque_Nm",
            parts=(Part("first two thirds → last third", lambda run: run.id.endswith("-1of2"), _cut_at(2.0 / 3.0)),),
            prepare=_of_axis(f"J{k}"),
        )
        for k in range(1, 7)
    ),
    _arm("dinova_2", runs_with("left, right → front", "left", "right")),
    _arm("panda_1", runs_with("two places → back-high", "front", "right")),
    _arm("panda_3", runs_with("back → front", "back")),
)  # fmt: skip

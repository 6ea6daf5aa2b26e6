"""Unknown: a term without physics over named coordinates, where no effect of the vocabulary explains the readings."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from symfive.arrays import Array
from symfive.effects._axes import goes_round, moving, positioned, reversing, revisited
from symfive.effects._base import AXIS, CARRIED, FORCE, TOOL, Campaign, Form, Forms, Run, Tone
from symfive.effects._coordinates import ACCELERATION, ROW, SIGN, SINCE, VELOCITY
from symfive.effects._force import driven_axes
from symfive.effects._nonparametric import NonparametricTerm, share_of
from symfive.errors import InputError

HARMONICS, LEAST_CYCLES = 3, 2.0
"""Of a cycle over time: number of harmonics, and the least number of periods in the recording."""
SIDES, CLOSEST = 16, 1e-5
"""Number of intervals over the distance since reversal, each twice as long as the one before, and the length of the first as a
share of the longest distance: a few µm, as of a backlash."""


@dataclass(frozen=True, kw_only=True)
class Unknown(NonparametricTerm):
    """Σ coefficient·function over the coordinates `over`: a shift of the tool, of an axis, or of a drive's force.

    A coordinate is an axis (`B`), its velocity (`B velocity`) or acceleration (`B acceleration`), the side from which it came
    (`B velocity sign`), its path since it reversed (`B since reversal`, with the sign of the motion, in equal steps of its
    logarithm down to `finest` of the longest), `t` (the campaign's clock, s) or `row` (the number of a row in the `run`, whose
    clock was not recorded).
    With a `period` (of an axis or of time, in its unit; 1σ `period_sigma`, 0: known and fixed) it is the phase in a cycle that
    counts, and `basis` is fourier. Functions as in the machine file: `basis` and `order` one per coordinate (a single one holds
    for all), products for several; `bspline` of order n has n intervals. They have no constant part: zeros and set-ups hold it.
    `span` (lowest, highest per coordinate; mm, degree, s) is where they live, by default what the campaign
    covers. `knots` (mm, degree): the places of a `bspline` over the first coordinate; of order 1 a table, a value at each,
    straight lines between. `place` `axis` moves the axis of the first coordinate, `structure` the tool along `directions` of the
    machine frame (where an axis is named as `carrier`, what it carries, as its error motions do: along `xyz` or about
    `abc`), `force` the recorded force of the drive whose axis the coordinates speak of; there `less` takes from each function
    what offset, direction and speed of the motion hold of it, so that friction keeps its own values beside it. Prior 1σ of a
    coefficient: `sigma_um` (for a rotary axis as many µm at 100 mm), of a force `sigma_force` (N or Nm; by default a twentieth
    of the recorded force's rms), less for the higher ones of a series, since slopes are bounded.
    """

    id = "unknown"
    says = "no known effect fits"
    hidden_by = "error motions over the same coordinates"
    action = "measure at another position or feed to find the cause; correct it only in the range that was recorded"
    terms = (("axis", ""), ("carrier", "carried by"))
    unidentified = True

    @classmethod
    def candidates(cls, campaign: Campaign) -> Forms:
        """Unidentified terms for every channel and coordinate of a campaign, each prepared for it.

        Coordinates: each axis that moves, its velocity and acceleration (dynamic runs only), its distance since reversal, its
        position by direction of approach (a table of values where positions repeat, as in a test by ISO 230-2), each pair of
        rotary axes, and time, also as a cycle; the row of each run without a clock. Drive forces: over velocity, position, and
        position by direction. Coordinates that the campaign does not move are omitted.
        """
        machine, axes = campaign.machine, moving(campaign)
        unclocked = [run.id for run in campaign.runs if not run.has_clock]
        drafts = [cls(over=("t",)), *(cls(over=(ROW,), run=run) for run in unclocked)]
        for axis in axes:
            words = [axis, f"{axis}{SINCE}"]
            if any(run.dynamic for run in campaign.runs):
                words += [f"{axis}{VELOCITY}", f"{axis}{ACCELERATION}"]
            for word in words:
                order = SIDES if word.endswith(SINCE) else cls.order
                drafts += [
                    cls(over=(word,), order=order, finest=CLOSEST),
                    cls(over=(word,), order=order, finest=CLOSEST, place="axis", tag="axis"),
                ]
        for pair in combinations([axis for axis in axes if machine.axes[axis].rotary], 2):
            cyclic = [goes_round(campaign, axis) for axis in pair]
            basis, order = tuple("fourier" if r else "polynomial" for r in cyclic), tuple(3 if r else 4 for r in cyclic)
            pose = cls(over=pair, basis=basis, order=order)
            drafts += [pose, *(replace(pose, carrier=axis, tag=f"carried-{axis}") for axis in pair)]
        for axis in reversing(campaign):
            knots = revisited(campaign, axis)
            family, degree = ("fourier", 3) if goes_round(campaign, axis) else ("polynomial", 4)
            family, degree = ("bspline", 1) if knots else (family, degree)
            by_side = cls(over=(axis, f"{axis}{SIGN}"), basis=(family, "polynomial"), order=(degree, 1), knots=knots)
            drafts.append(replace(by_side, place="axis", tag="axis"))
            if axis in driven_axes(campaign):
                table = replace(by_side, basis=("bspline", "polynomial"), order=(SIDES, 1), knots=())
                drafts.append(replace(table, place="force", tag="force"))
        drafts += [cls(over=(f"{axis}{what}",), order=SIDES, place="force", tag="force")
                   for axis in driven_axes(campaign) for what in (VELOCITY, "")]  # fmt: skip
        for draft in drafts:
            try:
                effect = draft.prepare(campaign)
            except InputError:
                continue  # the campaign does not move there
            yield replace(effect._form(campaign), places=len(unclocked) if effect.run else 1.0)
        yield from cls._cycles(campaign)

    @classmethod
    def _cycles(cls, campaign: Campaign) -> Iterable[Tone]:
        """Periodic functions of time, as of a cooler; periods from two rows to half of the recording."""
        runs = [run for run in campaign.runs if run.has_clock]
        if not runs:
            return
        first, last = (end(run.start_s + float(run.time[k]) for run in runs) for end, k in ((min, 0), (max, -1)))
        lowest, highest = LEAST_CYCLES / max(last - first, 1e-9), 0.5 / max(run.interval for run in runs)
        if lowest >= highest:
            return

        def form(frequency: float, resolution: float, places: int) -> Form:
            sigma = resolution / frequency**2
            cycle = cls(
                over=("t",), basis="fourier", order=HARMONICS, period=1.0 / frequency, period_sigma=sigma, tag="cycle"
            )
            return Form(effect=cycle, places=places)

        yield Tone(
            channel=TOOL, coordinate=lambda run: run.start_s + np.asarray(run.time), lowest=lowest, highest=highest,
            form=form, runs=tuple(run.id for run in runs),
        )  # fmt: skip

    def _form(self, campaign: Campaign) -> Form:
        """The form by which the search sees it: its functions in units of their priors."""

        def basis(run: Run) -> Array:
            shares = np.array([share_of(name) for name in self.functions(campaign.machine).names])
            return (
                self.table(campaign.machine, [run]) * shares if self.applies(run) else np.zeros((run.rows, len(shares)))
            )

        channel = {"axis": AXIS, "force": FORCE}.get(self.place, CARRIED if self.carrier else TOOL)
        return Form(
            effect=self,
            channel=channel,
            axis=self.axis or self.carrier or None,
            basis=basis,
            sigma=self.parameters(campaign)[0].sigma,
            directions=len(self.functions(campaign.machine).names) if self.knots else 0,
            measured=self._measured(campaign),
        )

    def _measured(self, campaign: Campaign) -> bool:
        """Whether it is the positioning deviation of an axis, by direction too if it reverses, in a test by ISO 230-2."""
        axis = self.axis
        if self.place != "axis" or axis not in positioned(campaign):
            return False
        return self.over == ((axis, f"{axis}{SIGN}") if axis in reversing(campaign) else (axis,))

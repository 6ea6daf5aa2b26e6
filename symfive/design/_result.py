"""A static plan as it was found, and what it leaves along a part: their words and files."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from textwrap import wrap
from typing import Any

from symfive.campaign import FIRST_LINE, Campaign
from symfive.design._assess import Assessment, assessment_data
from symfive.design._certificate import Certificate
from symfive.design._digits import six_digits
from symfive.design._part import Expected, Part
from symfive.design._schedule import on_ways
from symfive.design._sheet import Sheet
from symfive.design._write import SCHEMA, Written, write_plan
from symfive.machine import Machine
from symfive.moves import cleared
from symfive.nc import Post, addressed
from symfive.numbers import plain_number
from symfive.outputs import write_text
from symfive.runs import instrument_words
from symfive.screen import listed, plural


@dataclass(frozen=True, repr=False)
class Plan(Written):
    """A measurement plan.

    `campaign` without readings; `criterion` and the parameters `interest` it is for; `certificate` of the poses before the
    return poses were added; `assessment` of the whole; `starts` ψ of every design that the search began with; `minutes` it takes;
    `unsafe` run → rows before which the spindle retracts; `lost` the efficiency left if the most important pose is lost;
    `over_prior` mean and worst efficiency when the machine's errors are drawn from the priors; `information_per_minute`
    nats of ψ per minute; `drift` the efficiency left when a linear drift is a nuisance; `post` the collision-free moves of the
    programs; `part` the expected error along the part; `notes` in plain words.
    """

    machine: Machine
    instrument: str
    criterion: str
    interest: tuple[str, ...]
    campaign: Campaign
    certificate: Certificate
    assessment: Assessment
    starts: tuple[float, ...]
    minutes: float
    unsafe: dict[str, tuple[int, ...]]
    lost: float
    over_prior: tuple[float, float]
    information_per_minute: float
    drift: float
    post: Post = field(default_factory=Post)
    part: PartPlan | None = None
    notes: tuple[str, ...] = ()

    def driven(self, post: Post | None) -> Plan:
        """The plan with the user's choices for its programs: the same ways unless another retract is wished, its own times."""
        if post is None:
            return self
        ways = self.post
        own = replace(post, via=ways.via, unsafe=ways.unsafe, ways=ways.ways, tested=ways.tested)
        if post.retract_mm != ways.retract_mm:
            own = cleared(self.machine, self.campaign.runs, self.unsafe, own)
        if not addressed(self.machine):
            return replace(self, post=own)
        campaign, seconds = on_ways(self.campaign, own)
        unsafe = {run: tuple(rows) for run, rows in own.unsafe.items()}
        return replace(self, post=own, unsafe=unsafe, campaign=campaign, minutes=seconds / 60.0)

    def _write_into(self, folder: Path, nc: tuple[str, ...], post: Post | None) -> None:
        from symfive.design._figures import svg, uncertainty_figure, worth_figure

        plan = self.driven(post)
        counts = f"{plan.certificate.points} poses, {plan.campaign.rows} readings with return poses"
        facts = f"{counts} · about {plan.minutes:.0f} min with set-up"
        ways = [note for note in plan.notes if note.startswith("run ")]
        others = [note for note in plan.notes if note not in ways]
        worth = ". ".join([f"Certificate: {plan.certificate.says}", *(note[:1].upper() + note[1:] for note in others)])
        sheet = Sheet(
            campaign=plan.campaign, post=plan.post, facts=facts, worth=worth, assessment=plan.assessment, notes=ways,
            part=None if plan.part is None else plan.part.shown(),
        )  # fmt: skip
        write_plan(sheet, plan.to_data(), folder, nc)
        write_text(folder / "figures" / "uncertainty.svg", svg(uncertainty_figure(plan.assessment)))
        write_text(folder / "figures" / "worth.svg", svg(worth_figure(plan.assessment.worth)))

    def __str__(self) -> str:
        poses = [len({*zip(*run.commands.values(), strict=True)}) for run in self.campaign.runs]
        runs = [
            f"  {run.id}: {run.rows} readings in {count} poses, ball at {tuple(round(v) for v in run.table_ball)} mm, "
            f"tool {-run.tool_ball[2]:g} mm"
            for run, count in zip(self.campaign.runs, poses, strict=True)
        ]
        size = f"{self.certificate.points} poses, {self.minutes:.0f} min"
        head = f"{instrument_words(self.instrument)} plan, {size}: {self.certificate.says}"
        notes = [*(() if self.part is None else self.part.says), *listed(self.notes, "plan.notes", 10)]
        notes = [line for note in notes for line in wrap(note, 120, subsequent_indent="    ")]
        return "\n".join([head, *listed(runs, "plan.campaign.runs", 10), str(self.assessment), *notes])

    def to_data(self) -> dict[str, Any]:
        """plan.json: criterion, certificate and the assessment."""
        certificate = self.certificate
        return {
            "schema": SCHEMA,
            "machine": self.machine.name,
            "structure": self.machine.structure.code,
            "instrument": self.instrument,
            "criterion": {"name": self.criterion, "for": list(self.interest), "value": six_digits(certificate.value)},
            "certificate": {
                "says": certificate.says,
                **({} if self.part is None else {"part": list(self.part.says)}),
                "efficiency": six_digits(certificate.efficiency),
                "efficiency_any_setup": None if certificate.anywhere is None else six_digits(certificate.anywhere),
                "bound": six_digits(certificate.bound),
                "relaxed": six_digits(certificate.relaxed),
                "poses": certificate.points,
                "rigour": certificate.rigour,
                "starts": [six_digits(v) for v in self.starts],
            },
            **assessment_data(self.assessment),
            "minutes": six_digits(self.minutes),
            "information_per_minute": six_digits(self.information_per_minute),
            "efficiency_with_drift": six_digits(self.drift),
            "efficiency_without_the_most_important_pose": six_digits(self.lost),
            "efficiency_over_the_prior": {
                "mean": six_digits(self.over_prior[0]),
                "worst": six_digits(self.over_prior[1]),
            },
            **({} if self.part is None else {"part": self.part.to_data()}),
            "retract_mm": self.post.retract_mm,
            "spindle_drawn_back_before_rows": {
                run: [i + FIRST_LINE for i in rows] for run, rows in self.unsafe.items()
            },
            "seated_moves_by_way_of_further_positions_before_rows": {
                run: [i + FIRST_LINE for i in sorted(rows)] for run, rows in self.post.via.items()
            },
            "notes": list(self.notes),
        }


@dataclass(frozen=True)
class Left:
    """What a plan of so many `poses`, `runs` and `minutes` leaves along a part."""

    expected: Expected
    poses: int
    runs: int
    minutes: float

    @classmethod
    def by(cls, plan: Plan, part: Part) -> Left:
        """What a plan leaves."""
        expected = part.left_by(plan.assessment)
        return cls(expected, plan.certificate.points, len(plan.campaign.runs), plan.minutes)

    def words(self) -> str:
        """Its size in words."""
        return f"{self.poses} poses in {plural(self.runs, 'set-up')}, {self.minutes:.0f} min"


@dataclass(frozen=True)
class PartPlan:
    """The expected error of the tool along `part`: `before` the first reading, with the `ordinary` D plan in the same time
    (`ordinary_plan`), and `after` the plan made for it."""

    part: Part
    before: Expected
    ordinary_plan: Plan
    ordinary: Left
    after: Left

    @property
    def ratio(self) -> float:
        """The worst expected error over that of the ordinary plan."""
        return self.after.expected.worst / self.ordinary.expected.worst

    @property
    def what(self) -> str:
        """What is expected, in one sentence."""
        path = self.part.path
        where = (
            "in the workpiece frame"
            if path.datum is None
            else "relative to the part zero, probed with the rotary axes at 0"
        )
        return (
            f"Part {path.path.name}: expected error of the tool ({path.tool_length:g} mm) {where}, after compensation, 1σ at "
            f"{len(path)} points of its path"
        )

    @property
    def rows(self) -> tuple[tuple[str, Expected], ...]:
        """The expected errors with what leaves them."""
        return (
            ("before the measurement", self.before),
            (f"ordinary D plan ({self.ordinary.words()})", self.ordinary.expected),
            (f"this plan ({self.after.words()})", self.after.expected),
        )

    @property
    def says(self) -> tuple[str, ...]:
        """Sentences for the screen and plan.json."""
        lines = [f"  {name}: {self.part.words(expected)}" for name, expected in self.rows]
        return (f"{self.what}:", *lines, f"  {self.verdict}", *self.part.path.notes)

    @property
    def verdict(self) -> str:
        """How this plan compares with the ordinary one."""
        return f"at the worst point {plain_number(self.ratio)} times the error of the ordinary plan"

    def shown(self) -> dict[str, Any]:
        """What the sheet shows."""
        rows = [
            (name, plain_number(left.worst), plain_number(left.mean), self.part.path.at(left.row))
            for name, left in self.rows
        ]
        return {
            "what": self.what,
            "rows": rows,
            "notes": [f"Expected error of this plan: {self.verdict}.", *self.part.path.notes],
        }

    def to_data(self) -> dict[str, Any]:
        """As written to plan.json."""
        path = self.part.path
        plans = {
            name: self.part.data(left.expected)
            | {"poses": left.poses, "runs": left.runs, "minutes": six_digits(left.minutes)}
            for name, left in (("ordinary_d_plan", self.ordinary), ("this_plan", self.after))
        }
        return {
            "file": path.path.name, "places": len(path), "tool_length_mm": path.tool_length,
            "datum_mm": None if path.datum is None else list(path.datum),
            "before": self.part.data(self.before), **plans, "worst_over_ordinary": six_digits(self.ratio),
        }  # fmt: skip

"""Unidentified terms: a channel's tangent times functions of a coordinate, compressed to what the readings see of them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from symfive.arrays import Array, Indices
from symfive.campaign import Campaign, Run
from symfive.effects import AXIS, BALL, CARRIED, FORCE, READING, TOOL, Effect, Form, columns_read
from symfive.instruments.drive_force import DriveForce, driven_axis
from symfive.model import Linearisation, Model
from symfive.parameters import Parameter
from symfive.row import Row

__all__ = ["Channel", "Compressed", "channel_of", "compressed", "probes", "tangent"]

SEEN = 1e-2
"""Information in units of the prior below which a direction changes no evidence: log(1 + λ)/2 = 0.005 nats."""
MOST = 10
"""Directions of a term over one coordinate, those that are seen best; four times as many over two."""


@dataclass(frozen=True, kw_only=True)
class _Shift(Effect):
    """A constant shift by three components."""

    def parameters(self, campaign: Campaign) -> tuple[Parameter, ...]:
        return tuple(self.own(c, "um", 1.0) for c in "xyz")


@dataclass(frozen=True, kw_only=True)
class _ToolShift(_Shift):
    """The tool moved by a constant in the machine frame: its tangent says how readings answer to the structure."""

    id: ClassVar[str] = "probe_tool"

    def apply(self, row: Row) -> None:
        for i, c in enumerate("xyz"):
            row.shift[i] += self.parameter(row, c)


@dataclass(frozen=True, kw_only=True)
class _BallShift(_Shift):
    """The table's ball, or what stands there, moved by a constant in the workpiece frame."""

    id: ClassVar[str] = "probe_ball"

    def apply(self, row: Row) -> None:
        for i, c in enumerate("xyz"):
            row.table_ball[i] += self.parameter(row, c)


@dataclass(frozen=True, kw_only=True)
class _AxisOffset(Effect):
    """The coordinate of an axis moved by a constant: its tangent says how readings answer to that axis."""

    id: ClassVar[str] = "probe_axis"
    stage: ClassVar[str] = "axis"

    def parameters(self, campaign: Campaign) -> tuple[Parameter, ...]:
        return (self.own("offset", "urad" if self.its_axis(campaign).rotary else "um", 1.0),)

    def apply(self, row: Row) -> None:
        row.axis[str(self.axis)] += self.parameter(row, "offset")


@dataclass(frozen=True, kw_only=True)
class _Carried(_Shift):
    """What an axis carries moved by a constant in its own frame."""

    id: ClassVar[str] = "probe_carried"

    def apply(self, row: Row) -> None:
        for c in "xyz":
            row.add_motion(f"E{c.upper()}{self.axis}", self.parameter(row, c))


@dataclass(frozen=True, kw_only=True)
class _Force(Effect):
    """A constant force of an axis' drive."""

    id: ClassVar[str] = "probe_force"
    stage: ClassVar[str] = "reading"

    def applies(self, run: Run) -> bool:
        return driven_axis(run) == self.axis

    def parameters(self, campaign: Campaign) -> tuple[Parameter, ...]:
        return (self.own("force", "Nm" if self.its_axis(campaign).rotary else "N", 1.0),)

    def apply(self, row: Row) -> None:
        row.add_reading(DriveForce.name, self.parameter(row, "force"))


@dataclass(frozen=True, kw_only=True)
class _Reading(Effect):
    """A constant in each column of the instruments: 1 µm or µrad, of others 1e-3 of their unit."""

    id: ClassVar[str] = "probe_reading"
    stage: ClassVar[str] = "reading"

    def parameters(self, campaign: Campaign) -> tuple[Parameter, ...]:
        found = columns_read(campaign, campaign.runs)
        return tuple(self.own(name, unit, 1.0 if unit in ("um", "urad") else 1e-3) for name, unit in found.items())

    def apply(self, row: Row) -> None:
        for i in row.sensed:
            row.readings[i] += self.parameter(row, row.columns[i].name)


Channel = tuple[str, str | None]
"""Its kind, and its axis."""


def _probe(channel: Channel) -> Effect:
    kinds = {AXIS: _AxisOffset, CARRIED: _Carried, FORCE: _Force}
    whole = {TOOL: _ToolShift, BALL: _BallShift, READING: _Reading}
    return whole[channel[0]]() if channel[0] in whole else kinds[channel[0]](axis=channel[1])


def channel_of(form: Form) -> Channel:
    """The channel of an unidentified term."""
    return form.channel, form.axis


def probes(channels: Iterable[Channel]) -> list[Effect]:
    """Effects whose tangents are the channels."""
    return [_probe(channel) for channel in dict.fromkeys(channels)]


def tangent(model: Model, line: Linearisation, run: Run, channel: Channel) -> Array:
    """How the readings of a run answer to a channel (N, ny, parts), per µm or µrad."""
    wanted = [model.index[p.name] for p in _probe(channel).parameters(model.campaign)]
    there = line.columns.tolist()
    found = np.zeros((*line.jacobian.shape[:2], len(wanted)))
    for part, i in enumerate(wanted):
        if i in there:  # otherwise the run does not read this part of the channel
            found[:, :, part] = line.jacobian[:, :, there.index(i)]
    return found


@dataclass(frozen=True)
class Compressed:
    """An unidentified term in a model: `turn` (raw, k) from the channel's columns times the functions to k directions, which
    stand at `where` (k,) in the whole."""

    form: Form
    turn: Array = field(default_factory=lambda: np.zeros((0, 0)))
    where: Indices = field(default_factory=lambda: np.zeros(0, dtype=np.int64))

    def raw(self, model: Model, run: Run, line: Linearisation) -> Array:
        """All products (N, ny, raw), in units of the prior."""
        assert self.form.basis is not None
        answer = self.form.sigma * tangent(model, line, run, channel_of(self.form))
        products = answer[:, :, :, None] * self.form.basis(run)[:, None, None, :]
        return np.asarray(products.reshape(*answer.shape[:2], -1))

    def columns(self, model: Model, run: Run, line: Linearisation) -> Array:
        """(N, ny, k)."""
        return np.asarray(self.raw(model, run, line) @ self.turn)


def compressed(
    model: Model, lines: Mapping[str, Linearisation], bases: Sequence[tuple[Array, int]],
    scaled: Callable[[Run, Array], Array], forms: Sequence[Form],
) -> list[Compressed]:  # fmt: skip
    """Each form in the directions of largest information under white noise, what set-up and geometry absorb removed.

    `bases` holds of every run the whitened set-up and geometry (N, ny, s + g) and s.
    """
    drafts = [Compressed(form) for form in forms]
    first = model.campaign.runs[0]
    sizes = [draft.raw(model, first, lines[first.id]).shape[2] for draft in drafts]
    geometry = bases[0][0].shape[2] - bases[0][1]
    shared = np.eye(geometry)
    cross = [np.zeros((geometry, size)) for size in sizes]
    own = [np.zeros((size, size)) for size in sizes]
    for run, (base, setup) in zip(model.campaign.runs, bases, strict=True):
        flat = base.reshape(base.shape[0] * base.shape[1], base.shape[2])
        gram = flat.T @ flat
        factor = np.linalg.cholesky(gram[:setup, :setup] + np.eye(setup))
        mixed = np.linalg.solve(factor, gram[:setup, setup:])
        shared += gram[setup:, setup:] - mixed.T @ mixed
        for k, draft in enumerate(drafts):
            raw = scaled(run, draft.raw(model, run, lines[run.id])).reshape(len(flat), -1)
            seen = flat.T @ raw
            taken = np.linalg.solve(factor, seen[:setup])
            cross[k] += seen[setup:] - mixed.T @ taken
            own[k] += raw.T @ raw - taken.T @ taken
    found = []
    for draft, c, d in zip(drafts, cross, own, strict=True):
        power, axes = np.linalg.eigh(d - c.T @ np.linalg.solve(shared, c))
        most = max(MOST * (1 + draft.form.effect.coordinate.count(",")) ** 2, draft.form.directions)
        kept = np.flatnonzero(power > SEEN)[-most:]
        found.append(Compressed(draft.form, axes[:, kept]))
    return found

"""Localisation of a fault: link of the chain, axis, coordinate, interval, direction in space.

From the moments of one fit, without a refit. Before any verdict stands the observability table: what share of each effect the
campaign can see at all, and which effects it cannot distinguish.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from symfive.campaign import Campaign
from symfive.diagnose._detect import Detection, detect
from symfive.diagnose._intervals import Interval, intervals_of
from symfive.effects import Effect, Form, coordinate_words, form_words
from symfive.identify import Identification
from symfive.machine import Machine
from symfive.model import Model
from symfive.posterior import (
    WIDTHS,
    Moments,
    Subset,
    Sweep,
    candidates,
    expanded,
    linear_estimate,
    log_evidence,
    moments_about,
    nearest_width,
)  # fmt: skip
from symfive.screen import OnScreen, listed
from symfive.threads import one_thread

ALIKE = 0.999
"""Cosine of two visible shapes from which on they are one class: at 22 σ of size they would differ by 1 σ."""
CLEAR = 3.0
"""σ by which an effect of usual size must stand out to be compared with others."""


@dataclass(frozen=True)
class Observability:
    """What the campaign can see of one effect: `visible` share (0…1) of its energy that geometry and set-up leave, `sigmas` by
    which an effect of usual size would stand out."""

    effect: str
    axis: str | None
    form: str
    visible: float
    sigmas: float


@dataclass(frozen=True)
class Suspect:
    """A place where the fit may lack something, with the effect that would best explain it there.

    `nats` that it adds to the log evidence by itself, `log_p` natural log of the p-value, corrected for all that was looked at:
    P(evidence ratio > exp(nats)) ≤ exp(-nats) where nothing is missing (A. Markov; V. Vovk & R. Wang 2021). `values` of all
    parameters with it, by name.
    """

    link: str
    axis: str | None
    coordinate: str
    effect: Effect
    nats: float
    log_p: float
    campaign: Campaign = field(repr=False)
    values: Mapping[str, float] = field(repr=False)

    @cached_property
    def intervals(self) -> tuple[Interval, ...]:
        """Stretches of the runs in which it would act most."""
        model = Model(self.campaign, [self.effect])
        at = model.vector({name: value for name, value in self.values.items() if name in model.index})
        return intervals_of(self.campaign, model.contribution(self.effect, at))

    @property
    def says(self) -> str:
        """The place in words."""
        axis = f", axis {self.axis}" if self.axis else ""
        form = form_words(self.effect.key, self.campaign.machine)
        return f"{self.link}{axis}, over {coordinate_words(self.coordinate)} ({form}: log evidence {self.nats:+.3g})"


@dataclass(frozen=True, repr=False)
class Location(OnScreen):
    """Where a fit may lack something. `suspects` best of every link and axis, most significant first."""

    detection: Detection
    observability: tuple[Observability, ...]
    classes: tuple[tuple[str, ...], ...]
    suspects: tuple[Suspect, ...]

    @property
    def significant(self) -> tuple[Suspect, ...]:
        """Suspects that are significant at the detection's level."""
        return tuple(s for s in self.suspects if s.log_p < np.log(self.detection.level))

    @property
    def says(self) -> str:
        """Where to look, in one sentence."""
        found = self.significant
        if not found:
            return "No link of the chain is significant."
        first = f"Most probable location of the mismatch: {found[0].says}"
        others = [f"{s.link}{f' of {s.axis}' if s.axis else ''}" for s in found[1:4]]
        return first + (f"; next: {', '.join(others)}." if others else ".")

    def __str__(self) -> str:
        suspects = [
            f"  {s.link:<22} {s.axis or '':<3} {coordinate_words(s.coordinate):<28} {s.nats:10.4g}  "
            f"{form_words(s.effect.key, s.campaign.machine)}"
            for s in self.suspects
        ]
        seen = observability_words(self.observability, self.classes, self.detection.fit.model.machine).split("\n")
        return "\n".join([self.says, *listed(suspects, "location.suspects"), *listed(seen, "location.observability")])


@one_thread
def locate(
    found: Detection | Identification | Campaign,
    *,
    exclude: Collection[str] = (),
    progress: Callable[[str], None] = lambda message: None,
) -> Location:
    """Weigh every effect of the library against what a fit leaves, each by itself. `exclude` takes effects (by id) out."""
    detection = found if isinstance(found, Detection) else detect(found, progress=progress)
    progress("fitting each effect alone")
    fit, stated = detection.fit, candidates(detection.fit.model.campaign, exclude)
    here, _ = expanded(fit, [Form(effect=effect) for effect in fit.model.added], stated)
    moments = moments_about(here, stated)
    beside = tuple((t, nearest_width(moments.terms[t].effect.spread)) for t in range(moments.held))
    return located(moments, detection, beside)


def located(moments: Moments, detection: Detection, beside: Subset = ()) -> Location:
    """Localisation from moments: each term is scored jointly with the subset `beside`."""
    node = log_evidence(moments, beside).node
    return Location(detection, _observability(moments, node), _classes(moments, node), _suspects(moments, beside))


def _named(moments: Moments) -> dict[str, int]:
    """The number of each named effect, by key: of one that is looked at in several sizes the first."""
    found: dict[str, int] = {}
    for number, term in enumerate(moments.terms):
        if not term.effect.unidentified:
            found.setdefault(term.effect.key, number)
    return found


def _observability(moments: Moments, node: int) -> tuple[Observability, ...]:
    """σ under the noise of a node, the share under white noise."""
    found = []
    for key, number in _named(moments).items():
        effect, columns = moments.terms[number].effect, moments.columns[number]
        at = columns.where[columns.amplitude]
        left, white, full = (
            float(np.trace(g[np.ix_(at, at)])) for g in (moments.gram[node], moments.gram[0], moments.raw)
        )
        visible = min(max(white, 0.0) / full, 1.0) if full > 0.0 else 0.0
        found.append(Observability(effect.vocabulary, effect.belongs_to, key, visible, max(left, 0.0) ** 0.5))
    return tuple(found)


def _classes(moments: Moments, node: int) -> tuple[tuple[str, ...], ...]:
    """Parameters of named effects whose visible shapes agree: no amount of such readings distinguishes them."""
    names, at = list[str](), list[int]()
    for key, number in _named(moments).items():
        columns = moments.columns[number]
        parameters = moments.terms[number].effect.parameters(moments.fit.model.campaign)
        own = len(parameters)  # the states in which it begins come behind
        for p, where, size in zip(parameters, columns.where[:own], columns.amplitude[:own], strict=True):
            if size and moments.gram[node, where, where] > CLEAR**2:
                names.append(p.name if np.sum(columns.amplitude[:own]) > 1 else key)
                at.append(int(where))
    if not at:
        return ()
    h = moments.gram[node][np.ix_(at, at)]
    size = np.sqrt(np.diag(h))
    cosine = np.abs(h) / np.outer(size, size)
    groups: list[list[int]] = []
    for i in range(len(names)):
        home = next((g for g in groups if cosine[g[0], i] > ALIKE), None)
        if home is None:
            groups.append([i])
        else:
            home.append(i)
    return tuple(tuple(names[i] for i in g) for g in groups if len(g) > 1)


def _suspects(moments: Moments, beside: Subset) -> tuple[Suspect, ...]:
    """The term of every link and axis that adds most evidence, without unidentified ones, which belong to no link."""
    held = {t for t, _ in beside}
    free = [t for t, term in enumerate(moments.terms) if t not in held and not term.effect.unidentified]
    if not free:
        return ()
    nothing = log_evidence(moments, beside).total
    correction = float(np.log(len(WIDTHS) * len(free)))
    best: dict[tuple[str, str | None], tuple[float, int, float]] = {}
    for t, total, width in zip(free, *Sweep.of(moments, beside).best(free), strict=True):
        effect = moments.terms[t].effect
        place = (effect.link, effect.belongs_to)
        if place not in best or total > best[place][0]:
            best[place] = (float(total), t, width)
    found = []
    for (link, axis), (total, t, width) in sorted(best.items(), key=lambda item: -item[1][0]):
        nats = total - nothing
        together = (*beside, (t, width))
        effects, values = linear_estimate(moments, together, log_evidence(moments, together))
        effect = effects[-1]
        coordinate, campaign = ", ".join(effect.coordinates), moments.fit.model.campaign
        found.append(Suspect(link, axis, coordinate, effect, nats, min(0.0, correction - nats), campaign, values))
    return tuple(found)


def observability_words(
    table: Sequence[Observability], classes: Sequence[Sequence[str]], machine: Machine, limit: int = 25
) -> str:
    """The observability table as text, the largest effects first."""
    lines = [
        "Sensitivity of this campaign (share that geometry and set-up cannot absorb, σ of an effect of usual size):"
    ]
    shown = sorted(table, key=lambda o: -o.sigmas)
    lines += [f"  {form_words(o.form, machine):<46} {100 * o.visible:6.2f} %  {o.sigmas:8.1f} σ" for o in shown[:limit]]
    if len(shown) > limit:
        lines.append(f"  … and {len(shown) - limit} more")
    return "\n".join(
        [*lines, *(f"  cannot be separated here: {', '.join(form_words(key, machine) for key in c)}" for c in classes)]
    )

"""Locate: which link of the chain, which axis, over which coordinate, where along it, in which direction of space.

From score tests of the whole catalogue, without a refit. Before any verdict stands the observability table: what share of
each effect the campaign can see at all, and which effects it cannot tell apart.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from symfive.campaign import Campaign
from symfive.diagnose._catalogue import catalogue
from symfive.diagnose._channels import probes
from symfive.diagnose._detect import Detection, detect
from symfive.diagnose._places import Interval, axis_of, coordinate_of, direction_of, intervals_of, link_of
from symfive.diagnose._refit import start_of
from symfive.diagnose._remainder import remainder
from symfive.diagnose._scan import scan
from symfive.diagnose._scores import Board, Score, Secant, score_catalogue
from symfive.diagnose._unknown import unknowns
from symfive.effects import Effect
from symfive.errors import EvaluationError
from symfive.identify import Identification
from symfive.inference import halved, whiten
from symfive.model import Model
from symfive.screen import OnScreen, listed
from symfive.threads import one_thread

__all__ = ["Location", "Observability", "Survey", "Suspect", "locate", "observability_words", "survey"]

Array = NDArray[np.float64]
ALIAS = 0.999
CLEAR = float(np.log(1e-3))
UNUSUAL = (10.0, 100.0)
"""How many times its usual size an effect may be, beside its usual one: the rarer, the more."""
DULL = 0.5
"""Effective degrees of freedom up to which the readings say nothing of an effect."""
SEEN = 3.0
"""σ by which an effect of usual size must stand out to be told apart from anything."""


@dataclass(frozen=True)
class Observability:
    """What the campaign can see of one effect: `visible` share of its energy that the fit leaves, `sigmas` by which an
    effect of usual size would stand out."""

    effect: str
    axis: str | None
    form: str
    visible: float
    sigmas: float


@dataclass(frozen=True)
class Survey:
    """Scores of all that could join a fit, the most significant first; `looks` independent ones among them, for a joint
    false-alarm rate; the `board` of the plain catalogue."""

    board: Board = field(repr=False)
    scores: tuple[Score, ...]
    looks: int


@dataclass(frozen=True)
class Suspect:
    """A place where the fit may lack something, with the effect that would best explain it there.

    `drop` of the cost that it promises, `log_p` natural log of its p-value, corrected for the whole catalogue; `intervals` in
    which it would act most, `direction` of space in the machine frame.
    """

    link: str
    axis: str | None
    coordinate: str
    effect: Effect
    drop: float
    log_p: float
    intervals: tuple[Interval, ...]
    direction: tuple[float, float, float] | None

    @property
    def says(self) -> str:
        """The place in words."""
        axis = f", axis {self.axis}" if self.axis else ""
        return f"{self.link}{axis}, over {self.coordinate} (as {self.effect.key} it would take {self.drop:.3g} off χ²)"


@dataclass(frozen=True, repr=False)
class Location(OnScreen):
    """Where a fit may lack something. `suspects` best of every link and axis, most significant first; `columns` mean square
    of the whitened residual by instrument and column (1: noise): whether the mismatch shows in front of the encoder or behind."""

    detection: Detection
    observability: tuple[Observability, ...]
    classes: tuple[tuple[str, ...], ...]
    suspects: tuple[Suspect, ...]
    columns: Mapping[str, float]
    survey: Survey = field(repr=False)

    @property
    def significant(self) -> tuple[Suspect, ...]:
        """Suspects beyond what chance gives at the detection's level."""
        return tuple(s for s in self.suspects if s.log_p < np.log(self.detection.level))

    @property
    def p_value(self) -> float:
        """The smallest p-value of the whole catalogue, corrected for its size."""
        return float(np.exp(max(min((s.log_p for s in self.suspects), default=0.0), -690.0)))

    @property
    def says(self) -> str:
        """Where to look, in one sentence."""
        found = self.significant
        if not found:
            return "No place of the chain stands out of the noise."
        first = f"The mismatch is best placed at: {found[0].says}"
        others = [f"{s.link}{f' of {s.axis}' if s.axis else ''}" for s in found[1:4]]
        return first + (f"; it also shows at {', '.join(others)}." if others else ".")

    def __str__(self) -> str:
        suspects = [
            f"  {s.link:<22} {s.axis or '':<3} {s.coordinate:<22} {s.drop:10.4g}  {s.effect.key}" for s in self.suspects
        ]
        seen = observability_words(self.observability, self.classes).split("\n")
        return "\n".join([self.says, *listed(suspects, "location.suspects"), *listed(seen, "location.observability")])


@one_thread
def locate(
    found: Detection | Identification | Campaign,
    *,
    exclude: Sequence[str] = (),
    progress: Callable[[str], None] = lambda message: None,
) -> Location:
    """Score the whole catalogue against what a fit leaves. `exclude` takes effects (by id) out of it, as a control."""
    detection = found if isinstance(found, Detection) else detect(found, progress=progress)
    progress("scoring the catalogue")
    seen = survey(detection.fit, exclude)
    return Location(
        detection, _observability(seen.board), _classes(seen.board), _suspects(detection.fit, seen),
        _columns(detection.fit), seen,
    )  # fmt: skip


def survey(result: Identification, exclude: Sequence[str] = (), *, scanning: bool = True) -> Survey:
    """Scores of the plain catalogue, of the peaks of the scans, and of terms without a name, against a fit."""
    campaign = result.model.campaign
    held = result.model.effects
    shapes = remainder(result.model, result.values, result.model.added)
    plain = [e for e in catalogue(campaign, held) if e.id not in exclude]
    board = score_catalogue(result, plain, shapes, probes(campaign))
    sizes = [_sizes(board, e) for e in plain]
    scores, unusual = [usual for usual, *_ in sizes], [score for _, *larger in sizes for score in larger]
    taken = {e.key for e in held}
    scanned = scan(board) if scanning else []
    found = [f for f in scanned if f.effect.id not in exclude and f.effect.key not in taken]
    unique = {f.effect.key: f for f in reversed(found)}
    nameless = list(unknowns(campaign, held))
    secants = _secants(result, scores)
    second = score_catalogue(result, [*(f.effect for f in unique.values()), *nameless], shapes, secants=secants)
    for f in unique.values():
        score = second.score(f.effect)
        scores.append(replace(score, log_p=score.log_p + float(np.log(f.looks)), looks=f.looks))
    # of two shapes or sizes of one effect the better
    ranked = sorted((s for s in (*scores, *unusual) if s.dof > DULL), key=lambda s: -s.log_p)
    scores = list({s.effect.key: s for s in ranked}.values())
    scores += [second.score(effect) for effect in nameless]
    for secant in secants:
        finite = second.score_secant(secant)
        scores = [finite if s.effect.key == finite.effect.key and s.drop < finite.drop else s for s in scores]
    seen = sorted((s for s in scores if s.dof > DULL), key=lambda s: s.log_p)
    return Survey(board, tuple(seen), max(1, int(np.ceil(len(seen) * (1.0 + sum(1.0 / times for times in UNUSUAL))))))


def _sizes(board: Board, effect: Effect) -> list[Score]:
    """The scores of an effect at its usual size and, where it goes with the pose, which is what geometry hides, at unusual ones:
    their share of the rate of false alarms is so much less."""
    times = (1.0,) if coordinate_of(effect) == "time" else (1.0, *UNUSUAL)
    found = zip(board.scores(effect, times), times, strict=True)
    return [replace(score, log_p=score.log_p + float(np.log(wide))) for score, wide in found]


def _secants(result: Identification, scores: Sequence[Score]) -> list[Secant]:
    """Effects at sizes that their slopes at zero do not foretell, where something over the same coordinate stands out."""
    fitted = result.model
    values = result.named
    clear = {coordinate_of(s.effect) for s in scores if s.log_p < CLEAR}
    found = []
    for effect in (s.effect for s in scores if coordinate_of(s.effect) in clear):
        for levels in effect.levels(fitted.campaign):
            model = Model(fitted.campaign, (*fitted.added, effect))
            at = model.vector({**values, **levels})
            try:
                adds = {
                    r.id: model.predict_run(r, at) - fitted.predict_run(r, result.values) for r in fitted.campaign.runs
                }
            except EvaluationError:
                continue
            found.append(Secant(effect, levels, adds))
    return found


def _observability(board: Board) -> tuple[Observability, ...]:
    rows = []
    for effect in board.effects:
        score = board.score(effect)
        seen = min(score.visible, 1.0)
        rows.append(Observability(effect.vocabulary, axis_of(effect), effect.key, seen, score.size))
    return tuple(rows)


def observability_words(table: Sequence[Observability], classes: Sequence[Sequence[str]], limit: int = 25) -> str:
    """The observability table as text, what stands out most first."""
    lines = ["What these recordings can see at all (share of an effect that the fit leaves, σ of one of usual size):"]
    shown = sorted(table, key=lambda o: -o.sigmas)
    lines += [f"  {o.form:<34} {100 * o.visible:6.2f} %  {o.sigmas:8.1f} σ" for o in shown[:limit]]
    if len(shown) > limit:
        lines.append(f"  … and {len(shown) - limit} more")
    return "\n".join([*lines, *(f"  cannot be told apart here: {', '.join(c)}" for c in classes)])


def _classes(board: Board) -> tuple[tuple[str, ...], ...]:
    """Effects, or single parameters of effects that have several, whose visible shapes agree after the fit has taken its
    part: no amount of such recordings tells them apart."""
    names, vectors, sizes = _directions(board)
    if not names:
        return ()
    columns, weights = np.concatenate([c for c, _ in vectors]), np.concatenate([w for _, w in vectors])
    owner = np.repeat(np.arange(len(vectors)), [len(c) for c, _ in vectors])
    spread = np.zeros((len(columns), len(vectors)))
    spread[np.arange(len(columns)), owner] = weights
    h = spread.T @ board.reduced(columns)[0] @ spread
    cosines = np.abs(h) / np.outer(sizes, sizes)
    groups: list[list[int]] = []
    for i in range(len(names)):
        home = next((g for g in groups if cosines[g[0], i] > ALIAS), None)
        if home is None:
            groups.append([i])
        else:
            home.append(i)
    return tuple(tuple(names[i] for i in g) for g in groups if len(g) > 1)


def _directions(board: Board) -> tuple[list[str], list[tuple[NDArray[np.int64], Array]], Array]:
    """Directions that a campaign can see by SEEN σ: each parameter of an effect, or all together where none by itself.

    Names, (columns, weights in units of the prior) and sizes in σ.
    """
    names, vectors, sizes = [], [], []
    for effect in board.effects:
        parameters, columns = effect.parameters(board.model.campaign), board.columns_of(effect)
        sigma = np.array([p.sigma for p in parameters])
        h = board.reduced(columns)[0] * np.outer(sigma, sigma)
        found: list[tuple[str, Array]] = [
            (p.name, row)
            for p, row, power in zip(parameters, np.eye(len(sigma)), np.diag(h), strict=True)
            if power > SEEN**2
        ]
        if len(sigma) == 1 or not found:
            found = [(effect.key, np.linalg.eigh(h)[1][:, -1])]
        for name, direction in found:
            size = float(max(float(direction @ h @ direction), 0.0) ** 0.5)
            if size > SEEN:
                names.append(name)
                vectors.append((columns, sigma * direction))
                sizes.append(size)
    return names, vectors, np.array(sizes)


def _suspects(fit: Identification, seen: Survey) -> tuple[Suspect, ...]:
    """The best score of every link and axis (terms without a name, which have no link, only where nothing else is there)."""
    best: dict[tuple[str, str | None], Score] = {}
    for score in seen.scores:
        place = (link_of(score.effect), axis_of(score.effect))
        if score.effect.id != "unknown" and (place not in best or score.log_p < best[place].log_p):
            best[place] = score
    ordered = sorted(best.items(), key=lambda item: item[1].log_p)
    return tuple(_suspect(fit, link, axis, score, seen.looks) for (link, axis), score in ordered)


def _suspect(fit: Identification, link: str, axis: str | None, score: Score, looks: int) -> Suspect:
    log_p = min(0.0, score.log_p + float(np.log(looks)))
    effect = score.effect
    where: tuple[Interval, ...] = ()
    if log_p < -1.0:
        model = Model(fit.model.campaign, [*fit.model.added, effect])
        fitted = fit.named
        stepped = model.vector(fitted | start_of(model, score))
        _, there = halved(model.predict, stepped, model.vector(fitted))
        acts = {r.id: there[r.id] - fit.model.predict_run(r, fit.values) for r in model.campaign.runs}
        where = intervals_of(model.campaign, acts)
    direction = direction_of(fit.model.machine, effect, score.step)
    return Suspect(link, axis, coordinate_of(effect), effect, score.drop, log_p, where, direction)


def _columns(fit: Identification) -> dict[str, float]:
    problem = fit.problem()
    squares: dict[str, list[float]] = {}
    blocks = problem.blocks(fit.values)
    for run in fit.model.campaign.runs:
        for instrument, part in problem.parts(run):
            block = blocks[run.id, instrument]
            kept = np.where(block.left_out, 0.0, block.residual)
            white, _ = whiten(kept, fit.noises[run.id, instrument], block.interval)
            for column, power in zip(fit.model.columns(run)[part], np.mean(white**2, axis=0), strict=True):
                squares.setdefault(f"{instrument}: {column.name}", []).append(float(power))
    return {name: float(np.mean(powers)) for name, powers in squares.items()}

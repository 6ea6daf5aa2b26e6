"""The cases: strata in the issue's proportions, each a setting with effects, drawn until it is what its stratum says."""

from __future__ import annotations

import json
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import plant
from plant.state import Spec as PlantSpec

from .effects import MACHINE, Draft, Spec, Table, draw, name_of
from .frozen import FROZEN, form_of_case
from .others import FAULTS, OUTSIDE
from .plans import Random, Setting, draw_setting
from .span import Array, Span, aliases, size

STRATA = {"none": 100, "visible": 100, "masked": 80, "alias": 30, "pairs": 60, "outside": 30, "instrument": 20}
"""Cases of each stratum at 420."""
MASKED = 0.7
"""Share of an effect's energy that geometry and set-up can absorb, from which it counts as masked."""
SIZES = (1.0, 8.0)
"""rms of an effect over the declared noise."""
FAINT = (2.0, 60.0)
"""SNR of what geometry and set-up leave of a masked effect."""
TRIES = 400


@dataclass(frozen=True)
class Case:
    """One case and its answer. `facts`: one entry per effect, what the generator knows of it."""

    id: str
    stratum: str
    seed: int
    setting: Setting
    effects: list[Spec] = field(default_factory=list)
    facts: list[dict[str, Any]] = field(default_factory=list)


def case_ids(count: int) -> list[str]:
    """Names of the cases, strata in proportion (largest remainder) and interleaved, so that any beginning is typical."""
    total = sum(STRATA.values())
    exact = {s: count * n / total for s, n in STRATA.items()}
    numbers = {s: int(v) for s, v in exact.items()}
    for s in sorted(STRATA, key=lambda s: numbers[s] - exact[s])[: count - sum(numbers.values())]:
        numbers[s] += 1
    placed = [((k + 0.5) / n, s, k) for s, n in numbers.items() for k in range(n)]
    return [f"{s}-{k:03d}" for _, s, k in sorted(placed)]


def make_case(seed: int, id: str) -> Case:
    """The case of that name: the same for every number of cases and of workers."""
    stratum, number = id.rsplit("-", 1)
    own = [seed, zlib.crc32(stratum.encode()), int(number)]
    rng = np.random.default_rng(own)
    sown = int(np.random.default_rng([*own, 1]).integers(1 << 31))
    form = form_of_case(stratum, int(number)) if stratum in FROZEN else None
    for _ in range(TRIES):
        if form is not None:
            setting = draw_setting(rng, form.kinds)
            drawn = _foreign(rng, setting, sown, ((form.draw, 1.0),))
        else:
            setting = draw_setting(rng, lean=stratum == "alias")
            drawn = MAKERS[stratum](rng, setting, sown)
        if drawn is not None:
            return Case(id, stratum, sown, setting, *drawn)
    raise RuntimeError(f"{id}: no such case in {TRIES} tries")


Drawn = tuple[list[Spec], list[dict[str, Any]]]


def _none(rng: Random, setting: Setting, seed: int) -> Drawn | None:
    return [], []


def _visible(rng: Random, setting: Setting, seed: int) -> Drawn | None:
    return _single(rng, setting, seed, MACHINE, lambda f: f["masked"] < MASKED and f["snr"] > 5.0)


def _masked(rng: Random, setting: Setting, seed: int) -> Drawn | None:
    """Half by size, half by what is left; a faint one always has rivals that come close, so those are allowed."""
    by_snr = bool(rng.random() < 0.5)
    sizes = FAINT if by_snr else SIZES
    drawn = _single(rng, setting, seed, MACHINE, lambda f: f["masked"] >= MASKED, sizes, by_snr, alone=False)
    return None if drawn is None or drawn[1][0]["same"] else drawn


def _alias(rng: Random, setting: Setting, seed: int) -> Drawn | None:
    drawn = _single(rng, setting, seed, MACHINE, lambda f: f["snr"] > 8.0, alone=False)
    return drawn if drawn is not None and drawn[1][0]["same"] else None


def _instrument(rng: Random, setting: Setting, seed: int) -> Drawn | None:
    return _single(rng, setting, seed, FAULTS, lambda f: f["snr"] > 8.0)


def _outside(rng: Random, setting: Setting, seed: int) -> Drawn | None:
    return _foreign(rng, setting, seed, OUTSIDE)


def _foreign(rng: Random, setting: Setting, seed: int, table: Table) -> Drawn | None:
    """One effect that the vocabulary has no word for, clear, and not to be read as one that it has."""
    clear = (1.5, 8.0)
    drawn = _single(rng, setting, seed, table, lambda f: f["snr"] > 10.0 and f["masked"] < 0.9, clear, alone=False)
    return None if drawn is None or drawn[1][0]["same"] else drawn


def _alone(facts: dict[str, Any]) -> bool:
    return not facts["same"] and not facts["close"]


def _single(
    rng: Random, setting: Setting, seed: int, table: Table, wanted: Callable[[dict[str, Any]], bool],
    sizes: tuple[float, float] = SIZES, by_snr: bool = False, *, alone: bool = True,
) -> Drawn | None:  # fmt: skip
    """One effect, of a size (over noise, or by the SNR of its orthogonal part) drawn log-uniformly; `alone`: no other
    name explains it nearly as well."""
    draft = draw(rng, setting, table)
    if draft is None:
        return None
    target = float(np.exp(rng.uniform(*np.log(sizes))))
    span = Span.of(setting)
    spec = scaled(setting, draft, seed, target, span if by_snr else None)
    if spec is None:
        return None
    facts = known(span, spec, seed)
    if not wanted(facts):
        return None
    facts |= aliases(span, spec, change_of(setting, [spec], seed))
    return ([spec], [facts]) if _alone(facts) or not alone else None


def _pairs(rng: Random, setting: Setting, seed: int) -> Drawn | None:
    """Two effects of different name, each of which leaves enough that the other cannot explain."""
    drafts = [d for d in (draw(rng, setting, MACHINE) for _ in range(2)) if d is not None]
    targets = np.exp(rng.uniform(np.log(1.5), np.log(8.0), 2))
    specs = [scaled(setting, d, seed, float(t)) for d, t in zip(drafts, targets, strict=True)]
    if None in specs:
        return None
    first, second = specs
    if name_of(first) == name_of(second) or _clash(first, second):
        return None
    span = Span.of(setting)
    changes = [change_of(setting, [s], seed) for s in specs]
    left = [span.orthogonal(c) for c in changes]
    sine = float(
        np.sqrt(max(0.0, 1.0 - (left[0] @ left[1]) ** 2 / max(left[0] @ left[0] * (left[1] @ left[1]), 1e-30)))
    )
    facts = [known(span, s, seed) for s in specs]
    if min(f["snr"] for f in facts) * sine < 8.0:
        return None
    for f, s, c in zip(facts, specs, changes, strict=True):
        f |= aliases(span, s, c)
    return (specs, facts) if all(_alone(f) for f in facts) else None


def _clash(first: Spec, second: Spec) -> bool:
    """Two error motions of one component, or two servo loops of one axis, would be one effect."""
    return "component" in first and first.get("component") == second.get("component")


MAKERS = {
    "none": _none, "visible": _visible, "masked": _masked, "alias": _alias, "pairs": _pairs, "outside": _outside,
    "instrument": _instrument,
}  # fmt: skip


def _readings(
    setting: Setting, runs: Sequence[Any], specs: Sequence[PlantSpec], seed: int, noise: plant.NoiseOptions
) -> list[Array]:
    return [
        plant.simulate_run(
            setting.machine, run, setting.location, setting.motions, specs, seed=seed, noise_options=noise
        ).values
        for run in runs
    ]


def change_of(setting: Setting, specs: Sequence[PlantSpec], seed: int) -> list[Array]:
    """What effects do to the readings of every run, with the case's own set-up and geometry, (N, k) um."""
    quiet = plant.NoiseOptions(white_um=0.0)
    with_it = _readings(setting, setting.fit, specs, seed, quiet)
    without = _readings(setting, setting.fit, (), seed, quiet)
    return [a - b for a, b in zip(with_it, without, strict=True)]


def scaled(setting: Setting, draft: Draft, seed: int, target: float, span: Span | None = None) -> Spec | None:
    """The effect at the factor that gives it the size `target` (or the SNR, with `span`); None if none does."""
    factor = 1.0
    for _ in range(6):
        change = change_of(setting, [draft.make(factor)], seed)
        reached = span.masked(change)[1] if span else size(setting, change)
        if not np.isfinite(reached) or reached < 1e-9:
            return None
        if abs(np.log(reached / target)) < 0.03:
            return _plain(draft.make(factor))
        factor *= float(np.clip(target / reached, 0.02, 50.0))
        if not 1e-3 < factor < 100.0:
            return None
    return _plain(draft.make(factor)) if abs(np.log(reached / target)) < 0.2 else None


def _plain(spec: Spec) -> Spec:
    return json.loads(json.dumps(spec, default=float))


def known(span: Span, spec: Spec, seed: int) -> dict[str, Any]:
    """Name, size over noise, masked share and SNR of the orthogonal part."""
    change = change_of(span.setting, [spec], seed)
    masked, snr = span.masked(change)
    return {"name": list(name_of(spec)), "size": size(span.setting, change), "masked": masked, "snr": snr}


def heldout_noise(case: Case) -> float:
    """rms of the noise that the plant really adds to the held-out run, outliers (5 sigma) left out, um."""
    setting = case.setting
    quiet = plant.NoiseOptions(white_um=0.0)
    noisy = _readings(setting, setting.heldout, case.effects, case.seed, setting.noise)
    clean = _readings(setting, setting.heldout, case.effects, case.seed, quiet)
    noise = np.concatenate([(a - b).ravel() for a, b in zip(noisy, clean, strict=True)])
    scale = np.hypot(setting.white_um, setting.noise.coloured_um)
    return float(np.sqrt(np.mean(noise[np.abs(noise) < 5.0 * scale] ** 2)))


def acting(case: Case, spec: Spec) -> dict[str, list[bool]]:
    """Rows in which the effect exceeds half of its largest deviation from its own median."""
    setting = case.setting
    rows = [
        plant.simulate_run(
            setting.machine, run, setting.location, setting.motions, [], seed=case.seed, noise_options=setting.noise
        ).rows
        for run in setting.fit
    ]
    change = [c - np.median(c, axis=0) for c in change_of(setting, [spec], case.seed)]
    largest = max(float(np.abs(c).max()) for c in change)
    return {
        run["id"]: (np.abs(c).max(axis=1) > 0.5 * largest)[kept].tolist()
        for run, c, kept in zip(setting.fit, change, rows, strict=True)
    }


def write_case(case: Case, folder: Path) -> str:
    """Writes ``fit`` and ``heldout`` without any truth; returns the answer as text (JSON)."""
    s = case.setting
    for place, runs in (("fit", s.fit), ("heldout", s.heldout)):
        plant.write_campaign(
            folder / place, s.machine, runs, s.location, s.motions, case.effects, seed=case.seed, noise_options=s.noise
        )
        (folder / place / "truth.json").unlink()
    facts = [f | {"acting": acting(case, e)} for f, e in zip(case.facts, case.effects, strict=True)]
    answer = {
        "id": case.id, "stratum": case.stratum, "seed": case.seed, "kind": s.kind, "topology": s.topology,
        "effects": case.effects, "facts": facts, "location_errors_um_urad": s.location, "error_motions_um_urad": s.motions,
        "noise": vars(s.noise), "white_um": s.white_um, "heldout_noise_um": heldout_noise(case),
    }  # fmt: skip
    return json.dumps(answer, default=float)

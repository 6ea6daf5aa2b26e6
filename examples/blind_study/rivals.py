"""Simple rivals on the same recordings and the same library: greedy BIC over exact tangents with three ways to treat noise, all
effects fitted at once, and PySINDy.

`BIC white`: noise is white, its size free (plain BIC). `BIC whitened`: by an ARMA(1,1) fitted once to what the baseline leaves.
`BIC ARMA, clipped`: the ARMA(1,1) is fitted anew to the residual of every step and outliers are clipped at 4 robust sigmas.
A family joins while it lowers BIC = N log(RSS/N) + k log N. `fit all, rank`: every family at once, the significant ones by the
mean square that each takes. `PySINDy`: its sequential thresholding of the same tangents. None of them knows `unknown`.
"""

from __future__ import annotations

import json
import subprocess
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.signal import lfilter
from scipy.stats import chi2

from symfive.campaign import Campaign, read_campaign
from symfive.effects import Effect, make_effect
from symfive.errors import InputError
from symfive.model import Model

from .figures import Line, share
from .score import names_of
from .store import Store

Array = NDArray[np.float64]
Name = tuple[str, str | None]
RIVALS = ("white", "whitened", "ARMA, clipped")
FIT_ALL, PYSINDY = "fit all, rank", "PySINDy"
SIMPLE = (*(f"BIC {rival}" for rival in RIVALS), FIT_ALL)
MOST = 5
LEVEL = 0.01
"""False names over all families, where all are fitted at once."""
ROOM = 100.0
"""Prior sigma of a coefficient there, in noise's own: what the readings cannot separate stays finite."""
THRESHOLD = 5.0
"""Least coefficient that PySINDy keeps, in standard deviations of the declared noise."""
THRESHOLDED = """
import sys, time, json, warnings, numpy
warnings.filterwarnings('ignore')
import pysindy
for line in sys.stdin:
    data = numpy.load(line.strip()); start = time.process_time()
    model = pysindy.STLSQ(threshold=float(sys.argv[1]), max_iter=50)
    model.fit(data['columns'], data['y'][:, None])
    print(json.dumps([time.process_time() - start, numpy.ravel(model.coef_).tolist()]), flush=True)
"""
SHIFTS = 10
"""Instants per run at which an artefact may have moved."""
TEETH = range(60, 181, 2)
PITCHES = (4.0, 5.0, 8.0, 10.0, 12.0)


def library(campaign: Campaign) -> Iterator[Effect]:
    """The vocabulary's effects in their plain forms; what needs a scan is on a coarse grid."""
    axes, dynamic = campaign.machine.axes, campaign.runs[0].dynamic
    for axis in (a for a in axes if any(np.ptp(run.commands[a]) > 0.0 for run in campaign.runs)):
        turning = axes[axis].rotary
        reach = max(float(np.ptp(run.commands[axis])) for run in campaign.runs)
        basis = "fourier" if turning and reach > 200.0 else "polynomial"
        for name in (
            "backlash",
            "friction",
            "servo_mismatch",
            "inertial_compliance",
            *(() if turning else ("scale_error",)),
        ):
            yield make_effect(name, axis)
        for letter in "XYZABC":
            yield make_effect("lateral_play", component=f"E{letter}{axis}")
            yield make_effect("error_motion", component=f"E{letter}{axis}", basis=basis, order=3)
            if turning:
                yield make_effect("gravity_sag", axis, component=f"E{letter}{axis}")
        periods = [360.0 / n for n in TEETH] if turning and dynamic else [90.0, 80.0, 72.0] if turning else PITCHES
        for i, period in enumerate(periods):
            yield make_effect("transmission_error", axis, period=float(period), period_sigma=0.0, tag=f"{i}")
    for axis in axes:
        for letter in "XYZABC":
            yield make_effect("location_error", component=f"E{letter}0{axis}")
    for name in ("latency", "thermal_drift", "bar_temperature"):
        yield make_effect(name)
    yield make_effect("sensor_error", instrument=campaign.runs[0].instrument[0])
    for run in campaign.runs:
        for i, t in enumerate(np.linspace(run.time[0], run.time[-1], SHIFTS + 2)[1:-1]):
            yield make_effect("setup_shift", run=run.id, t_s=float(t), tag=f"{i}")


def prepared(campaign: Campaign) -> list[Effect]:
    """Those that can join this campaign's baseline."""
    found: dict[str, Effect] = {}
    for draft in library(campaign):
        try:
            effect = draft.prepare(campaign)
            effect.parameters(campaign)
        except InputError:
            continue
        if any(effect.applies(run) for run in campaign.runs):
            found.setdefault(effect.key, effect)
    return list(found.values())


@dataclass(frozen=True)
class System:
    """Linear system of a campaign: residual `y` (N,), `base` (N, k) weighed by priors, families of columns, series."""

    y: Array
    base: Array
    families: list[tuple[Name, Array]]
    lengths: list[int]

    @classmethod
    def of(cls, campaign: Campaign) -> System:
        """Exact tangents at the nominal machine, in units of the declared noise; every channel a series."""
        base = Model(campaign)
        effects = prepared(campaign)
        y, lengths = _residual(base)
        tangents = _tangents(base, range(len(base.parameters)))
        families = []
        for group in (effects[i : i + 25] for i in range(0, len(effects), 25)):
            for part in _compatible(group):
                model = Model(campaign, part)
                for effect in part:
                    columns = [model.index[p.name] for p in effect.parameters(campaign)]
                    families.append((name_of(effect), _tangents(model, columns)))
        return cls(y, tangents * base.prior_sigma, families, lengths)


def _compatible(effects: Sequence[Effect]) -> Iterator[list[Effect]]:
    """Parts of the list in which no two effects free the same quantity of a drive."""
    rest = list(effects)
    while rest:
        part, later, freed = [], [], set()
        for effect in rest:
            places = set(effect.frees())
            (later if places & freed else part).append(effect)
            freed |= places
        yield part
        rest = later


def _residual(model: Model) -> tuple[Array, list[int]]:
    series = [
        (model.readings(run) - model.predict_run(run, model.prior_mean)) / model.noise(run)
        for run in model.campaign.runs
    ]
    return np.concatenate([s.T.ravel() for s in series]), [len(s) for s in series for _ in range(s.shape[1])]


def _tangents(model: Model, wanted: Sequence[int] | range) -> Array:
    out = []
    for run in model.campaign.runs:
        line = model.linearise(run, model.prior_mean)
        full = np.zeros((*line.prediction.shape, len(model.parameters)))
        full[:, :, line.columns] = line.jacobian
        part = full[:, :, list(wanted)] / model.noise(run).reshape(1, -1, 1)
        out.append(part.transpose(1, 0, 2).reshape(-1, part.shape[2]))
    return np.concatenate(out)


def name_of(effect: Effect) -> Name:
    """Word of the vocabulary and axis."""
    component = getattr(effect, "component", None)
    if effect.axis is None and isinstance(component, str):
        return effect.vocabulary, component[3:] if component[2] == "0" else component[2:]
    return effect.vocabulary, effect.axis


def search(system: System, rival: str) -> list[Name]:
    """Names in the order in which BIC takes them."""
    active, found = system.base, []
    arma = (0.0, 0.0) if rival == "white" else fit_arma(_left(active, system.y), system.lengths)
    y = system.y
    while len(found) < MOST:
        if rival == "ARMA, clipped":
            left = _left(active, y)
            spread = 4.0 * 1.4826 * float(np.median(np.abs(left - np.median(left))))
            y = y - left + np.clip(left, -spread, spread)
            arma = fit_arma(_left(active, y), system.lengths)
        best = _best(system, active, y, arma)
        if best is None:
            break
        name, columns = best
        active = np.hstack([active, 1e3 * columns / np.linalg.norm(columns, axis=0)])
        found.append(name)
    return found


def _best(system: System, active: Array, y: Array, arma: tuple[float, float]) -> tuple[Name, Array] | None:
    """The family that lowers BIC most, None if none does."""
    basis, target = (
        _basis(whiten(active, system.lengths, arma)),
        np.append(whiten(y, system.lengths, arma), np.zeros(active.shape[1])),
    )
    target = target - basis @ (basis.T @ target)
    before, count, best = float(target @ target), len(y), (0.0, None)
    for name, columns in system.families:
        columns = columns[:, np.linalg.norm(columns, axis=0) > 1e-9]
        if not columns.size:
            continue
        full = np.vstack([whiten(columns, system.lengths, arma), np.zeros((active.shape[1], columns.shape[1]))])
        size = np.linalg.norm(full, axis=0)
        full = full - basis @ (basis.T @ full)
        left, singular, _ = np.linalg.svd(full / size, full_matrices=False)
        left = left[:, singular > 1e-4]
        if not left.size:
            continue
        after = before - float(np.sum((left.T @ target) ** 2))
        gain = count * np.log(before / max(after, 1e-12)) - left.shape[1] * np.log(count)
        if gain > best[0]:
            best = (gain, (name, columns))
    return best[1]


def _basis(active: Array) -> Array:
    return np.asarray(np.linalg.qr(np.vstack([active, np.eye(active.shape[1])]))[0])


def _left(active: Array, y: Array) -> Array:
    basis, full = _basis(active), np.append(y, np.zeros(active.shape[1]))
    return np.asarray((full - basis @ (basis.T @ full))[: len(y)])


def whiten(table: Array, lengths: Sequence[int], arma: tuple[float, float]) -> Array:
    """Innovations of every series under ARMA(1,1) with (phi, theta)."""
    if arma == (0.0, 0.0):
        return table
    parts, start = [], 0
    for n in lengths:
        parts.append(lfilter([1.0, -arma[0]], [1.0, arma[1]], table[start : start + n], axis=0))
        start += n
    return np.concatenate(parts)


def fit_arma(residual: Array, lengths: Sequence[int]) -> tuple[float, float]:
    """(phi, theta) of the least innovation variance."""

    def cost(p: Array) -> float:
        phi, theta = np.tanh(p)
        return float(np.log(np.mean(whiten(residual, lengths, (float(phi), float(theta))) ** 2)))

    starts = [np.arctanh(s) for s in ((0.05, -0.02), (0.8, -0.5), (0.97, -0.85))]
    best = min((minimize(cost, s, method="Nelder-Mead", options={"maxiter": 150}) for s in starts), key=lambda r: r.fun)
    phi, theta = np.tanh(best.x)
    return float(phi), float(theta)


def dictionary(system: System) -> tuple[Array, Array, list[int]]:
    """All columns made orthogonal to the baseline and of unit length (N, n), the readings without it, every column's family."""
    basis = _basis(system.base)[: len(system.y)]  # the priors hold what readings do not
    owner = np.array([i for i, (_, part) in enumerate(system.families) for _ in range(part.shape[1])])
    columns = np.hstack([part for _, part in system.families])
    before = np.linalg.norm(columns, axis=0)
    columns = columns - basis @ (basis.T @ columns)
    size = np.linalg.norm(columns, axis=0)
    seen = np.flatnonzero(size > 1e-4 * np.maximum(before, 1e-9))
    return columns[:, seen] / size[seen], system.y - basis @ (basis.T @ system.y), owner[seen].tolist()


def fit_all(system: System) -> list[Name]:
    """Every family at once; the names of the significant ones, by the mean square that each takes."""
    columns, y, owner = dictionary(system)
    precision = columns.T @ columns + np.eye(columns.shape[1]) / ROOM**2
    covariance = np.linalg.inv(precision)
    values = covariance @ (columns.T @ y)
    noise = max(float(np.mean((y - columns @ values) ** 2)), 1e-12)
    found = []
    for family in dict.fromkeys(owner):
        own = np.flatnonzero(np.array(owner) == family)
        square = float(values[own] @ np.linalg.solve(covariance[np.ix_(own, own)], values[own])) / noise
        if chi2.sf(square, len(own)) < LEVEL / len(system.families):
            found.append((float(np.sum((columns[:, own] @ values[own]) ** 2)), system.families[family][0]))
    return list(dict.fromkeys(name for _, name in sorted(found, key=lambda f: -f[0])))


@cache
def _peer(python: str) -> subprocess.Popen[str]:
    """A process of that `python` that answers one path after the other; it ends with this one."""
    command = [python, "-c", THRESHOLDED, str(THRESHOLD)]
    pipe = subprocess.PIPE
    return subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=pipe, text=True)


def pysindy(system: System, python: str) -> tuple[list[Name], float]:
    """What PySINDy of that `python` keeps, the largest first, and its seconds; RuntimeError where it is not there."""
    columns, y, owner = dictionary(system)
    peer = _peer(python)
    assert peer.stdin and peer.stdout and peer.stderr
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "system.npz"
        np.savez(path, columns=columns, y=y)
        with suppress(BrokenPipeError):
            print(path, file=peer.stdin, flush=True)
        answer = peer.stdout.readline()
    if not answer:
        _peer.cache_clear()
        raise RuntimeError((peer.stderr.read().strip().splitlines() or ["no message"])[-1])
    seconds, values = json.loads(answer)
    order = sorted(np.flatnonzero(values), key=lambda i: -abs(values[i]))
    return list(dict.fromkeys(system.families[owner[i]][0] for i in order)), seconds


def said_of(system: System, rival: str) -> list[Name]:
    """What one of the simple rivals says: `FIT_ALL`, or "BIC …"."""
    return fit_all(system) if rival == FIT_ALL else search(system, rival.removeprefix("BIC "))


def compete(folder: Path, peers: str | None = None) -> dict[str, list[Name]]:
    """What every rival says of a campaign; PySINDy's only with a Python that has it, `peers`."""
    system = System.of(read_campaign(folder / "fit"))
    said = {rival: said_of(system, rival) for rival in SIMPLE}
    return said | ({PYSINDY: pysindy(system, peers)[0]} if peers else {})


def lines(store: Store, ids: Sequence[str]) -> list[Line]:
    """The rivals' part of the table."""
    out = []
    done = [(store.get("answers", i), store.get("rivals", i)) for i in ids if store.has("rivals", i)]
    for rival in dict.fromkeys(name for _, said in done for name in said):
        cases = [(a["stratum"], a["facts"], [tuple(n) for n in said[rival]]) for a, said in done if rival in said]
        single = [(facts[0], said) for s, facts, said in cases if s == "visible"]
        pairs = [(facts, said) for s, facts, said in cases if s == "pairs"]
        masked = [(f[0], said) for s, f, said in cases if s == "masked" and f[0]["snr"] >= 5.0]
        out += [
            share(f"{rival}: false alarms on `none`", "", (bool(said) for s, _, said in cases if s == "none")),
            share(f"{rival}: visible named", "", (bool(said) and said[0] in names_of(f) for f, said in single)),
            share(
                f"{rival}: visible, more invented",
                "",
                (any(n not in names_of(f) for n in said) for f, said in single),
            ),
            share(f"{rival}: masked named", "", (bool(said) and said[0] in names_of(f) for f, said in masked)),
            share(
                f"{rival}: both of a pair",
                "",
                (all(set(names_of(f)) & set(said) for f in fs) for fs, said in pairs),
            ),
        ]
    return out

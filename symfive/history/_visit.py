"""A visit and an event as plain data: what the index holds of one measured result, and what happened to the machine."""

from __future__ import annotations

import hashlib
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symfive.arrays import Array
from symfive.errors import InputError, among
from symfive.files import one_line, shown
from symfive.numbers import with_std
from symfive.separated import LARGEST
from symfive.validation import as_lists

VISIT, EVENT = "symfive.visit/1", "symfive.event/1"
STAGES = ("", "as-found", "as-left")
"""Of one day the state that was found lies before the one that was left."""
KINDS = ("repair", "adjustment", "collision", "note")
MOST_TEXT = 500
SHOWN = 4
"""Quantities of a finding that are shown, those beyond 2σ, at most."""
DIGITS = 12
Twist = tuple[float, float, float]


def instant(text: str) -> float:
    """Seconds since 1970 (UTC) of a date or time in ISO 8601; a date without a time is its midnight, no zone is UTC.

    Raises `InputError`.
    """
    try:
        found = datetime.fromisoformat(text.strip())
        found = found if found.tzinfo is not None else found.replace(tzinfo=UTC)
        return found.timestamp()
    except (ValueError, OverflowError):
        raise InputError(f"{shown(text)} is not a date", remedy="write 2026-03-04 or 2026-03-04T08:30") from None


def time_text(seconds: float) -> str:
    """The instant in ISO 8601, UTC, to the second."""
    return datetime.fromtimestamp(seconds, UTC).strftime("%Y-%m-%dT%H:%M:%SZ")


@dataclass(frozen=True, kw_only=True)
class MachineId:
    """Which machine: two of one name differ by their `serial`, or by their `structure` (ISO 10791-6)."""

    name: str
    structure: str
    serial: str = ""

    def __post_init__(self) -> None:
        for key in ("name", "structure", "serial"):
            object.__setattr__(self, key, _text(key, getattr(self, key)))
        if not self.name:
            raise InputError("the machine has no name", remedy='write name = "…" in the machine file', keys=("name",))

    @property
    def key(self) -> str:
        """Twelve hexadecimal digits of name, serial number and structure."""
        return hashlib.sha256("\0".join((self.name, self.serial, self.structure)).encode()).hexdigest()[:12]

    def said(self, name: str) -> str:
        """One of its errors in words."""
        if "." not in name:
            return name
        from symfive.effects import parameter_words

        return parameter_words(name, re.findall(r"[A-Z]\w*", self.structure))

    def to_data(self) -> dict[str, str]:
        """As JSON."""
        return {"name": self.name, "serial": self.serial, "structure": self.structure}

    @classmethod
    def from_data(cls, data: Mapping[str, str]) -> MachineId:
        """From such a table. Raises `KeyError` where something is missing."""
        return cls(**{key: data[key] for key in ("name", "structure", "serial")})

    def __str__(self) -> str:
        return f"{self.name} ({self.serial})" if self.serial else self.name


@dataclass(frozen=True, kw_only=True)
class Finding:
    """A finding of a diagnosis: `parameters` name → (value, 1σ, unit)."""

    effect: str
    axis: str | None = None
    confidence: float = 0.0
    parameters: Mapping[str, tuple[float, float, str]] = field(default_factory=dict)

    @property
    def key(self) -> str:
        """Effect and axis, by which the findings of two dates belong together."""
        return f"{self.effect} {self.axis or ''}".rstrip()

    @property
    def words(self) -> str:
        """The same as one writes it: `backlash of C`."""
        effect = self.effect.replace("_", " ")
        return f"{effect} of {self.axis}" if self.axis else effect

    @property
    def size(self) -> str:
        """Its parameters with their 1σ, as `width 5.0 ± 0.2 µm`."""
        from symfive.effects import finding_words

        clear = {n: (v, s, u) for n, (v, s, u) in self.parameters.items() if abs(v) >= 2.0 * s} or self.parameters
        shown = list(clear.items())[:SHOWN]
        return ", ".join(f"{finding_words(self.effect, n, u)} {with_std(v, s, u)}".strip() for n, (v, s, u) in shown)


@dataclass(frozen=True, kw_only=True)
class Visit:
    """One measured result of a machine.

    `time` seconds since 1970 (UTC); `values`, `priors`, `means` (k,) and `covariance` (k, k) in `units`, without the set-up of
    the runs, over which they are marginal; a prior of infinity is none. `nominal` axis → (origin in mm, None of a linear
    axis; direction) of the machine file that the values deviate from, `corrections` what the control corrected while it was
    measured. `results` is the hash of the results, `manifest` that of their manifest. `visibility` effect → by how many σ one
    of usual size would have shown.
    """

    machine: MachineId
    time: float
    results: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    values: Array
    priors: Array
    means: Array
    covariance: Array
    nominal: Mapping[str, tuple[Twist | None, Twist]] = field(default_factory=dict)
    corrections: Mapping[str, float] = field(default_factory=dict)
    stage: str = ""
    instrument: str = ""
    operator: str = ""
    temperature: float | None = None
    note: str = ""
    version: str = ""
    manifest: str = ""
    findings: tuple[Finding, ...] = ()
    diagnosed: bool = False
    visibility: Mapping[str, float] = field(default_factory=dict)
    rms: float = 0.0
    rms_unit: str = "um"
    chi2_dof: float = 1.0
    converged: bool = True

    def __post_init__(self) -> None:
        if self.stage not in STAGES:
            raise InputError(
                f"stage {shown(self.stage)} is unknown", remedy="write as-found or as-left", keys=("stage",)
            )
        for key in ("instrument", "operator", "note", "version"):
            object.__setattr__(self, key, _text(key, getattr(self, key)))
        if self.temperature is not None and not -60.0 <= self.temperature <= 100.0:
            problem = f"temperature {self.temperature:g} °C is outside −60 to 100 °C"
            raise InputError(problem, remedy="give the machine's temperature in °C", keys=("temperature",))
        count = len(self.names)
        sizes = {len(self.units), len(self.values), len(self.priors), len(self.means), *self.covariance.shape}
        if sizes != {count} or len(set(self.names)) < count:
            raise InputError("names, values and covariance differ in length", remedy="add the results again")
        numbers = (self.values, self.means, self.covariance.ravel(), np.array([self.time, self.rms, self.chi2_dof]))
        if not all((np.abs(entry) <= LARGEST**2).all() for entry in numbers) or not (self.priors > 0.0).all():
            raise InputError("a number is not finite, or a prior not positive", remedy="add the results again")

    @property
    def order(self) -> tuple[float, int, str]:
        """Visits of a machine stand in this order, whenever they were added."""
        return self.time, STAGES.index(self.stage), self.results

    @property
    def when(self) -> str:
        """The instant in ISO 8601."""
        return time_text(self.time)

    @property
    def date(self) -> str:
        """Its day."""
        return self.when[:10]

    @property
    def std(self) -> Array:
        """1σ of the values (k,)."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))

    def to_data(self) -> dict[str, Any]:
        """`visit.json`: numbers to 12 digits, of the covariance the upper triangle by rows."""
        upper = _upper(len(self.names))
        return {
            "schema": VISIT,
            "machine": self.machine.to_data(),
            "when": self.when, "stage": self.stage, "instrument": self.instrument, "operator": self.operator,
            "temperature_C": self.temperature, "note": self.note, "version": self.version, "results": self.results,
            "manifest": self.manifest, "names": list(self.names), "units": list(self.units),
            "values": _numbers(self.values), "prior": [v if math.isfinite(v) else None for v in _numbers(self.priors)],
            "mean": _numbers(self.means), "covariance": _numbers(self.covariance[upper]),
            "nominal": as_lists(self.nominal),
            "corrections": dict(self.corrections),
            "findings": [
                {"effect": f.effect, "axis": f.axis, "confidence": f.confidence, "parameters": as_lists(f.parameters)}
                for f in self.findings
            ],
            "diagnosed": self.diagnosed, "visibility": dict(self.visibility), "rms": self.rms, "rms_unit": self.rms_unit,
            "chi2_dof": self.chi2_dof, "converged": self.converged,
        }  # fmt: skip

    @classmethod
    def from_data(cls, data: Any) -> Visit:
        """A visit from such a table. Raises `InputError` for anything else."""
        if not isinstance(data, dict) or data.get("schema") != VISIT:
            raise InputError(f'its schema is not "{VISIT}"', remedy="add the results again with symfive history add")
        try:
            names = tuple(map(str, data["names"]))
            upper = _upper(len(names))
            covariance = np.zeros((len(names), len(names)))
            covariance[upper] = data["covariance"]
            covariance.T[upper] = covariance[upper]
            return cls(
                machine=MachineId.from_data(data["machine"]),
                time=instant(data["when"]), results=_digest(data["results"]), names=names,
                units=tuple(map(str, data["units"])), values=np.array(data["values"], dtype=float),
                priors=np.array([math.inf if v is None else v for v in data["prior"]], dtype=float),
                means=np.array(data["mean"], dtype=float), covariance=covariance,
                nominal={axis: (None if o is None else _twist(o), _twist(d)) for axis, (o, d) in data["nominal"].items()},
                corrections={str(name): float(value) for name, value in data["corrections"].items()},
                stage=data["stage"], instrument=data["instrument"], operator=data["operator"],
                temperature=None if data["temperature_C"] is None else float(data["temperature_C"]), note=data["note"],
                version=data["version"], manifest=str(data["manifest"]),
                findings=tuple(_finding(entry) for entry in data["findings"]), diagnosed=bool(data["diagnosed"]),
                visibility={str(name): float(value) for name, value in data["visibility"].items()},
                rms=float(data["rms"]), rms_unit=str(data["rms_unit"]), chi2_dof=float(data["chi2_dof"]),
                converged=bool(data["converged"]),
            )  # fmt: skip
        except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
            if isinstance(error, InputError):
                raise
            problem = f"the record of the visit is damaged ({error})"
            raise InputError(problem, remedy="add the results again with symfive history add") from None


@dataclass(frozen=True, kw_only=True)
class Event:
    """What happened to a machine: a repair and an adjustment begin its history anew, a collision and a note do not."""

    machine: MachineId
    time: float
    kind: str
    text: str

    def __post_init__(self) -> None:
        among(self.kind, KINDS, f"the kind of event {shown(self.kind)} is unknown", keys=("kind",))
        object.__setattr__(self, "text", _text("text", self.text))

    @property
    def renews(self) -> bool:
        """Whether the machine's errors are expected to differ afterwards."""
        return self.kind in ("repair", "adjustment")

    @property
    def when(self) -> str:
        """The instant in ISO 8601."""
        return time_text(self.time)

    @property
    def id(self) -> str:
        """Sixteen hexadecimal digits of its content."""
        said = "\0".join((self.machine.key, self.when, self.kind, self.text))
        return hashlib.sha256(said.encode()).hexdigest()[:16]

    def to_data(self) -> dict[str, Any]:
        """The event as JSON."""
        return {
            "schema": EVENT,
            "machine": self.machine.to_data(),
            "when": self.when,
            "kind": self.kind,
            "text": self.text,
        }

    @classmethod
    def from_data(cls, data: Any) -> Event:
        """An event from such a table. Raises `InputError`."""
        try:
            if data["schema"] != EVENT:
                raise KeyError("schema")
            machine = MachineId.from_data(data["machine"])
            return cls(machine=machine, time=instant(data["when"]), kind=data["kind"], text=data["text"])
        except (KeyError, TypeError, AttributeError) as error:
            raise InputError(
                f"this is not an event ({error})", remedy="remove the file and add the event again"
            ) from None


def _finding(entry: Mapping[str, Any]) -> Finding:
    parameters = {str(n): (float(v), float(s), str(u)) for n, (v, s, u) in entry["parameters"].items()}
    axis = None if entry["axis"] is None else str(entry["axis"])
    return Finding(effect=str(entry["effect"]), axis=axis, confidence=float(entry["confidence"]), parameters=parameters)


def _twist(values: Any) -> Twist:
    x, y, z = map(float, values)
    return x, y, z


def _digest(text: Any) -> str:
    if not isinstance(text, str) or not re.fullmatch("[0-9a-f]{64}", text):
        raise ValueError("results")
    return text


def _text(key: str, value: Any) -> str:
    """One line of printed text. Raises `InputError`."""
    if not isinstance(value, str) or len(value) > MOST_TEXT:
        problem = f"{key} is not a text of at most {MOST_TEXT} characters"
        raise InputError(problem, remedy="write it shorter", keys=(key,))
    return _one_line(value)


_one_line = lru_cache(one_line)


@lru_cache
def _upper(count: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    return np.triu_indices(count)


def _numbers(values: Array) -> list[float]:
    return [float(f"{value:.{DIGITS}g}") for value in values]

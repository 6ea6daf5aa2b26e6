"""A visit from a folder of results, as `symfive identify`, `diagnose` or `fleet` left it, of today or of before."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from symfive.errors import InputError
from symfive.files import read_bytes, shown
from symfive.history._visit import Finding, MachineId, Visit
from symfive.outputs import MANIFEST

RECORD = "visit.json"
"""Lies among the results: what the index reads of them, and what nobody but the user knows."""
RESULTS = ("model.json", "identification.json", "diagnosis.json")


@dataclass(frozen=True, kw_only=True)
class Details:
    """Details that the results do not contain: time, operator, temperature; `None` and "" mean unknown.

    `corrections` location errors (µm, µrad) that the control corrected while it was measured.
    """

    time: float | None = None
    serial: str = ""
    stage: str = ""
    instrument: str = ""
    operator: str = ""
    temperature: float | None = None
    note: str = ""
    corrections: Mapping[str, float] = field(default_factory=dict)


def is_result(folder: Path) -> bool:
    """Whether an identification or a diagnosis lies there."""
    return (folder / "model.json").is_file()


def no_results(path: Path) -> InputError:
    """The error of a folder without results."""
    remedy = "name the folder that symfive identify or diagnose wrote, or one that holds such folders"
    return InputError("there are no results", path=path, remedy=remedy)


def taken(folder: Path, details: Details) -> Visit:
    """The visit of these results. Without a time it is that of the results' files. Raises `InputError`."""
    from symfive.model import read_model

    if not is_result(folder):
        raise no_results(folder)
    fitted = read_model(folder)
    identified = _table(folder / "identification.json")
    diagnosed = _table(folder / "diagnosis.json") if (folder / "diagnosis.json").is_file() else None
    machine, k = fitted.machine, len(fitted.names)
    for name in details.corrections:
        if name not in fitted.names:
            problem = f"the results hold no {shown(name)} that could be corrected"
            raise InputError(problem, path=folder, remedy=f"use one of {', '.join(fitted.names[:8])}")
    priors, means = np.full(k, math.inf), np.zeros(k)
    for i, name in enumerate(fitted.names):
        entry, term = identified.get("parameters", {}).get(name, {}), machine.errors.get(name.split(".")[0])
        if "prior" in entry:
            priors[i], means[i] = float(entry["prior"]), float(entry["prior_mean"])
        elif term is not None:
            priors[i], means[i] = term.sigma, term.mean
    known = _known(folder)
    when = details.time if details.time is not None else (folder / "model.json").stat().st_mtime
    if details.time is None and known is not None:
        when = known.time
    manifest = folder / MANIFEST
    visit = Visit(
        machine=MachineId(name=machine.name, structure=machine.structure.code, serial=details.serial),
        time=float(round(when)), results=_digest(folder), names=fitted.names,
        units=tuple(fitted.units[name] for name in fitted.names),
        values=np.array([fitted.values[name] for name in fitted.names]), priors=priors, means=means,
        covariance=np.asarray(fitted.covariance, dtype=float),
        nominal={name: (axis.origin if axis.rotary else None, axis.direction) for name, axis in machine.axes.items()},
        corrections=dict(details.corrections), stage=details.stage, instrument=details.instrument,
        operator=details.operator, temperature=details.temperature, note=details.note,
        version=str(_table(manifest).get("version", "")) if manifest.is_file() else "",
        manifest=hashlib.sha256(read_bytes(manifest)).hexdigest() if manifest.is_file() else "",
        findings=_findings(diagnosed or {}), diagnosed=diagnosed is not None, visibility=_visibility(diagnosed or {}),
        rms=float(identified.get("rms_um", 0.0)), rms_unit=next(iter(identified.get("rms", {"um": 0})), "um"),
        chi2_dof=float(identified.get("chi2_dof", 1.0)), converged=bool(identified.get("converged", True)),
    )  # fmt: skip
    return visit if known is None else _kept(visit, known, details)


def _known(folder: Path) -> Visit | None:
    """What an earlier call wrote, also of results that were replaced since; None where it is damaged."""
    try:
        return Visit.from_data(json.loads((folder / RECORD).read_bytes()))
    except (OSError, ValueError, RecursionError):
        return None


def _kept(visit: Visit, known: Visit, details: Details) -> Visit:
    """What an earlier call said stays where this one says nothing."""
    before = {
        name: getattr(known, name)
        for name in ("stage", "instrument", "operator", "temperature", "note", "corrections")
        if not getattr(details, name) and getattr(details, name) != 0.0
    }
    serial = known.machine.serial if not details.serial and known.machine.name == visit.machine.name else details.serial
    return replace(visit, machine=replace(visit.machine, serial=serial), **before)


def record_bytes(visit: Visit) -> bytes:
    """What `visit.json` holds, in one line a key; the same visit gives the same bytes."""
    data = visit.to_data()
    lines = (
        f"{json.dumps(key)}: {json.dumps(value, allow_nan=False, ensure_ascii=False)}" for key, value in data.items()
    )
    return ("{" + ",\n ".join(lines) + "}\n").encode()


def read_record(folder: Path) -> Visit:
    """The visit that `visit.json` holds. Raises `InputError` where it is damaged or the results beside it were replaced."""
    path = folder / RECORD
    try:
        visit = Visit.from_data(json.loads(path.read_bytes()))
    except InputError as error:
        raise error.at(path) from None
    except FileNotFoundError:
        raise InputError(
            "there is no such file", path=path, remedy="add the results with symfive history add"
        ) from None
    except (OSError, ValueError, RecursionError) as error:
        raise InputError(f"it cannot be read ({error})", path=path, remedy="add the results again") from None
    manifest = folder / MANIFEST
    if visit.manifest and (
        not manifest.is_file() or hashlib.sha256(manifest.read_bytes()).hexdigest() != visit.manifest
    ):
        problem = "the results beside it were replaced since they were added"
        raise InputError(problem, path=path, remedy="add them again with symfive history add")
    return visit


def _table(path: Path) -> dict[str, Any]:
    from symfive.model import read_json

    data = read_json(path, listed=True) if path.is_file() else {}
    if not isinstance(data, dict):
        raise InputError("this is not a table of results", path=path, remedy="run symfive identify again")
    return data


def _digest(folder: Path) -> str:
    """SHA-256 of the results' files, by name."""
    digest = hashlib.sha256()
    for name in RESULTS:
        if (folder / name).is_file():
            digest.update(f"{name} {hashlib.sha256(read_bytes(folder / name)).hexdigest()}\n".encode())
    return digest.hexdigest()


def _findings(diagnosis: Mapping[str, Any]) -> tuple[Finding, ...]:
    """The findings with those parameters that are one number."""
    found = []
    for entry in diagnosis.get("findings", []):
        parameters = {
            str(name): (float(p["value"]), float(p["std"]), str(p.get("unit", "")))
            for name, p in entry.get("parameters", {}).items()
            if isinstance(p, dict) and _number(p.get("value")) and _number(p.get("std"))
        }
        axis, confidence = entry.get("axis"), float(entry.get("confidence", 0.0))
        found.append(Finding(effect=str(entry["effect"]), axis=axis, confidence=confidence, parameters=parameters))
    return tuple(found)


def _number(value: Any) -> bool:
    return isinstance(value, (int, float)) and math.isfinite(value)


def _visibility(diagnosis: Mapping[str, Any]) -> dict[str, float]:
    """Of each effect by how many σ one of usual size would have shown."""
    found: dict[str, float] = {}
    for entry in diagnosis.get("observability", []):
        if _number(entry.get("sigmas")):
            key = f"{entry['effect']} {entry.get('axis') or ''}".rstrip()
            found[key] = max(float(entry["sigmas"]), found.get(key, 0.0))
    return found

"""The fleet's table: one row a machine, from the state that the index keeps of each."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from symfive.history._visit import MachineId
from symfive.numbers import with_std, with_unit
from symfive.screen import OnScreen, aligned, listed, plural

SCHEMA = "symfive.history/1"


@dataclass(frozen=True, kw_only=True)
class MachineRow:
    """One machine: how many visits from `first` to `last` (ISO 8601), alarms in all and `open` ones since the last repair, the
    newest of them as it stands in the state, findings of the last visit, and its errors now; `says` the newest open alarm in
    a few words, else that there are no visits."""

    machine: MachineId
    visits: int
    first: str = ""
    last: str = ""
    alarms: int = 0
    open: int = 0
    alarm: Mapping[str, Any] | None = None
    findings: tuple[str, ...] = ()
    rms: float | None = None
    rms_unit: str = "um"
    forecasts: tuple[Mapping[str, Any], ...] = field(default=())
    says: str = field(init=False)

    def __post_init__(self) -> None:
        said = "" if self.visits else "no visits"
        if self.open and self.alarm is not None:
            said = f"{alarm_words(self.alarm)} ({self.alarm['when'][:10]})"
        object.__setattr__(self, "says", said)


def alarm_words(alarm: Mapping[str, Any]) -> str:
    """An alarm as one says it: `step of EX0C +2.1 ± 0.3 µm`."""
    kind = {"step": "step", "several": "several errors stepped", "drift": "drift"}[alarm["kind"]]
    causes = [cause_text(c) for c in alarm["causes"][:3]]
    joint = ": " if alarm["kind"] == "several" else " of "
    return f"{kind}{joint}{', '.join(causes)}" if causes else kind


def cause_text(cause: Mapping[str, Any]) -> str:
    """A cause with its size; those that cannot be distinguished with `or`."""
    sign = "+" if cause["change"] >= 0.0 else ""
    return f"{' or '.join(cause['names'][:3])} {sign}{with_std(cause['change'], cause['std'], cause['unit'])}"


@dataclass(frozen=True, repr=False)
class MachineTable(OnScreen):
    """All machines of a history."""

    rows: tuple[MachineRow, ...]

    def to_data(self) -> dict[str, Any]:
        """The table as JSON."""
        return {
            "schema": SCHEMA,
            "machines": [{**asdict(row), "key": row.machine.key} for row in self.rows],
        }

    def __str__(self) -> str:
        alarmed = sum(row.open > 0 for row in self.rows)
        head = f"history of {plural(len(self.rows), 'machine')}, {alarmed} with an open alarm"
        order = sorted(self.rows, key=lambda row: (-row.open, str(row.machine)))
        cells = [["machine", "visits", "last", "alarms", "rms", "says"], *(_cells(row) for row in order)]
        heads, *lines = aligned(cells)
        return "\n".join([head, heads, *listed(lines, "history.fleet().rows", 40)])


def _cells(row: MachineRow) -> list[str]:
    rms = "" if row.rms is None else with_unit(row.rms, row.rms_unit)
    says = row.says or (", ".join(row.findings[:3]) and f"found: {', '.join(row.findings[:3])}")
    alarms = f"{row.open} open" if row.open else str(row.alarms)
    return [_short(str(row.machine), 30), str(row.visits), row.last[:10], alarms, rms, _short(says, 90)]


def _short(text: str, most: int) -> str:
    return text if len(text) <= most else f"{text[: most - 1]}…"


def row_of(machine: MachineId, state: Mapping[str, Any]) -> MachineRow:
    """The row that a state says."""
    alarms = state.get("alarms", [])
    return MachineRow(
        machine=machine, visits=int(state.get("visits", 0)), first=str(state.get("first") or ""),
        last=str(state.get("last") or ""),
        alarms=int(state.get("alarm_count", 0)), open=int(state.get("open", 0)), alarm=alarms[-1] if alarms else None,
        findings=tuple(map(str, state.get("findings", []))), rms=None if state.get("rms") is None else float(state["rms"]),
        rms_unit=str(state.get("rms_unit", "um")), forecasts=tuple(map(dict, state.get("forecasts", []))),
    )  # fmt: skip

"""A table of claims: what a paper says, what comes out here, within which limits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from symfive.files import write_json

__all__ = ["Claim", "write_claims"]


@dataclass(frozen=True)
class Claim:
    """One claim. It holds if `value` lies within `low` … `high` (`unit`); `paper` is the figure the paper prints or implies.

    `note` says what to know about it and, for a claim that fails, why. `refuted`: it is expected to fail.
    """

    id: str
    statement: str
    paper: str
    value: float
    low: float
    high: float
    unit: str = ""
    note: str = ""
    refuted: bool = False

    @property
    def holds(self) -> bool:
        """Whether our figure lies within the limits."""
        return self.low <= self.value <= self.high

    @property
    def settled(self) -> bool:
        """Whether it is reproduced, or shown wrong with the reason."""
        return self.holds != self.refuted and (self.holds or bool(self.note))

    @property
    def verdict(self) -> str:
        """In one word or two."""
        if not self.settled:
            return "NOT SETTLED"
        return "reproduced" if self.holds else "wrong"

    def to_data(self) -> dict[str, Any]:
        """As an entry of claims.json."""
        return {
            "id": self.id, "claim": self.statement, "paper": self.paper, "ours": self.value, "low": self.low,
            "high": self.high, "unit": self.unit, "verdict": self.verdict, "note": self.note,
        }  # fmt: skip

    def to_row(self) -> str:
        """As a line of a Markdown table."""
        limits = f"≤ {self.high:.3g}" if self.low == 0.0 else f"{self.low:.4g} … {self.high:.4g}"
        ours = f"{self.value:.4g} {self.unit}".strip()
        return f"| {' | '.join((self.id, self.statement, self.paper, ours, limits, self.verdict, self.note))} |"


def write_claims(claims: Sequence[Claim], folder: Path, title: str) -> None:
    """`claims.md` and `claims.json` in the folder."""
    folder.mkdir(parents=True, exist_ok=True)
    head = [f"# {title}", "", "| no. | claim | paper | ours | limits | verdict | remark |", "|" + " --- |" * 7]
    lines = [*head, *(claim.to_row() for claim in claims)]
    (folder / "claims.md").write_text("\n".join(lines) + "\n", encoding="utf-8")
    write_json(folder / "claims.json", {"title": title, "claims": [claim.to_data() for claim in claims]})

"""A claim of a paper beside what comes out here, and the table of all of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from symfive.outputs import write_json


@dataclass(frozen=True)
class Claim:
    """One figure of a claim: it holds if `ours` lies in `low` … `high` (`unit`).

    `paper` is what the paper prints or implies, `where` the equation or figure. `refuted`: the statement is expected to
    fail, and `note` says why.
    """

    id: str
    statement: str
    paper: str
    ours: float
    low: float
    high: float
    unit: str = ""
    note: str = ""
    refuted: bool = False
    where: str = ""

    @property
    def holds(self) -> bool:
        """Whether our figure lies within the limits."""
        return self.low <= self.ours <= self.high

    @property
    def settled(self) -> bool:
        """Whether it is reproduced, or shown wrong with the reason."""
        return (bool(self.note) and not self.holds) if self.refuted else self.holds

    @property
    def verdict(self) -> str:
        """In one word or two."""
        if not self.settled:
            return "NOT SETTLED"
        return "wrong" if self.refuted else "reproduced"

    def to_data(self) -> dict[str, Any]:
        """As an entry of claims.json."""
        return {
            "id": self.id, "claim": self.statement, "where": self.where, "paper": self.paper, "ours": self.ours,
            "low": self.low, "high": self.high, "unit": self.unit, "verdict": self.verdict, "note": self.note,
        }  # fmt: skip

    def to_row(self, *, where: bool = True) -> str:
        """As a line of a Markdown table, with or without the column `where`."""
        limits = f"≤ {self.high:.3g}" if self.low in (0.0, -float("inf")) else f"{self.low:.6g} … {self.high:.6g}"
        limits = f"≥ {self.low:.3g}" if self.high == float("inf") else limits
        figure = f"{self.ours:.2e}" if 0.0 < abs(self.ours) < 1e-3 else f"{self.ours:.6g}"
        place = (self.where,) if where else ()
        cells = (
            self.id,
            self.statement,
            *place,
            self.paper,
            f"{figure} {self.unit}".strip(),
            limits,
            self.verdict,
            self.note,
        )
        return f"| {' | '.join(cells)} |"


def markdown(claims: Sequence[Claim]) -> str:
    """The table of claims; the column `where` only if a claim says it."""
    where = any(claim.where for claim in claims)
    columns = ("no.", "claim", *(("where",) if where else ()), "paper", "ours", "limits", "verdict", "remark")
    head = f"| {' | '.join(columns)} |\n" + "| --- " * len(columns) + "|\n"
    return head + "\n".join(claim.to_row(where=where) for claim in claims) + "\n"


def write_claims(claims: Sequence[Claim], folder: Path, title: str) -> None:
    """`claims.md` and `claims.json` in the folder."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "claims.md").write_text(f"# {title}\n\n{markdown(claims)}", encoding="utf-8")
    data = [
        {key: (None if value in (float("inf"), -float("inf")) else value) for key, value in claim.to_data().items()}
        for claim in claims
    ]
    write_json(folder / "claims.json", {"title": title, "claims": data})

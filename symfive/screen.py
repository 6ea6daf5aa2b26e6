"""Display of results: in a prompt, printed, in a notebook."""

from __future__ import annotations

import html
import re
import textwrap
from collections.abc import Container, Sequence

MOST = 30
"""Entries of one kind that a screen holds beside all else."""
WIDTH, HARD_SPACE = 100, "\u00a0"
"""Longest line of the text; a space at which none ends."""
_BEFORE_UNIT = re.compile(r"(?<=\d) (?=[µ°%σ]|(?:mm|ppm|Nm?|Hz|m?s|min)\b)")


class OnScreen:
    """`str` fits a screen, `repr` is one line, a notebook shows what `print` does.

    A subclass writes `__str__`, whose first line says what the thing is; a dataclass has `repr=False`.
    """

    def __repr__(self) -> str:
        noun, head = type(self).__name__, str(self).partition("\n")[0]
        rest = head.removeprefix(f"{noun.lower()} ")
        return f"<{noun}: {head}>" if rest == head else f"<{noun} {rest}>"

    def _repr_html_(self) -> str:
        return f'<pre style="white-space: pre-wrap">{html.escape(str(self))}</pre>'


def listed(entries: Sequence[str], where: str, most: int = MOST) -> list[str]:
    """The first `most` entries, and how many more there are and `where`."""
    left = len(entries) - most
    return list(entries) if left <= 1 else [*entries[:most], f"… and {left} more: {where}"]


def aligned(rows: Sequence[Sequence[str]], right: Container[int] = ()) -> list[str]:
    """The rows of a table as lines; the columns whose numbers are in `right` end alike, the others begin alike."""
    wide = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        "  ".join(cell.rjust(wide[i]) if i in right else cell.ljust(wide[i]) for i, cell in enumerate(row)).rstrip()
        for row in rows
    ]


def plural(count: int, noun: str) -> str:
    """`1 run`, `2 runs`."""
    return f"{count} {noun}{'' if count == 1 else 's'}"


def first_of(words: Sequence[str], most: int) -> str:
    """The first of some words, and how many more there are: `A, B and 3 more`."""
    return ", ".join(words[:most]) + (f" and {len(words) - most} more" if len(words) > most else "")


def wrapped(head: str, text: str) -> list[str]:
    """Lines of the text behind its head, the further ones indented alike; what belongs to one number stays together."""
    for mark in (" ± ", " → "):
        text = text.replace(mark, mark.replace(" ", HARD_SPACE))
    text = _BEFORE_UNIT.sub(HARD_SPACE, text)
    lines = textwrap.wrap(
        text, WIDTH, initial_indent=head, subsequent_indent=" " * len(head), break_long_words=False, break_on_hyphens=False
    )  # fmt: skip
    return [line.replace(HARD_SPACE, " ") for line in lines]

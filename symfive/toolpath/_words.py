"""The words of a block of an NC program (ISO 6983-1, LinuxCNC): letters with plain numbers, without comments."""

from __future__ import annotations

import re
from dataclasses import dataclass

from symfive.errors import InputError
from symfive.files import shown

AXES = "XYZABCUVW"
_WORD = re.compile(r"\s*([A-Z])\s*([+-]?(?:\d+\.?\d*|\.\d+))")
_COMMENT = re.compile(r"\([^()]*\)|;.*")
POSTED = "post the program as plain ISO or LinuxCNC blocks"
SILENT = "NOFS"
"""Numbers of block and program, feed and speed: the tool's path is the same without them."""


@dataclass(frozen=True)
class Block:
    """A block: its `line` from 1, the `modal` codes as `G43.4`, the numbers of `words` by letter."""

    line: int
    modal: tuple[str, ...]
    words: dict[str, float]

    def axes(self) -> dict[str, float]:
        """The words that name an axis."""
        return {letter: value for letter, value in self.words.items() if letter in AXES}

    def only(self, letters: str) -> None:
        """Raise `InputError` for a word whose letter is none of an axis or of `letters`."""
        for letter, value in self.words.items():
            if letter not in AXES + letters:
                raise InputError(f"the word {letter}{value:g} cannot be understood here", line=self.line, remedy=POSTED)


def block_of(text: str, line: int) -> Block:
    """The words of one line. Raises `InputError` with the line for what is no word."""
    rest = _COMMENT.sub(" ", text).upper().strip().removeprefix("/").strip()
    modal, words, place = list[str](), dict[str, float](), 0
    while place < len(rest):
        found = _WORD.match(rest, place)
        if found is None:
            raise _no_word(rest[place:].split(maxsplit=1)[0], line)
        letter, number = found[1], float(found[2])
        place = found.end()
        if letter in "GM":
            modal.append(f"{letter}{number:g}")
        elif letter in words:
            raise InputError(f"the word {letter} stands twice in the block", line=line, remedy=POSTED)
        elif letter not in SILENT:
            words[letter] = number
    return Block(line, tuple(modal), words)


def _no_word(text: str, line: int) -> InputError:
    if any(sign in text for sign in "#[<="):
        problem = f"{shown(text)} holds a parameter or an expression, which is not read"
        return InputError(problem, line=line, remedy="post the program with plain numbers")
    return InputError(f"{shown(text)} is no word with a number", line=line, remedy=POSTED)

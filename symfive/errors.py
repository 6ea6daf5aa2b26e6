"""The exceptions a user can cause: a sentence with file, line, column and remedy; values at which a model has no readings."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path

__all__ = ["EvaluationError", "InputError", "among", "inside"]

MOST = 800
"""Characters of a sentence."""


class InputError(ValueError):
    """An error that the user can correct, in one sentence with its place and remedy.

    Arguments: `problem` (what is wrong), `remedy` (what to change), and the place: `path`, `line` and `column`
    (both counted from 1) where they are known, and `keys`, the path of the key in the data: names of tables and keys,
    numbers (from 0) of entries, e.g. `("run", 2, "length")`. The check of a value gives its key; the reader of the file
    prefixes the keys above it (`inside`) and adds the line. `str(error)` is the sentence for the user.
    """

    def __init__(
        self, problem: str, *, remedy: str = "", path: Path | str | None = None, line: int | None = None,
        column: int | None = None, keys: tuple[str | int, ...] = (),
    ) -> None:  # fmt: skip
        self.problem = problem.rstrip(".")
        self.remedy = remedy.rstrip(".")
        self.path = None if path is None else Path(path)
        self.line = line
        self.column = column
        self.keys = keys
        super().__init__(self._sentence())

    def at(
        self,
        path: Path | str | None,
        line: int | None = None,
        column: int | None = None,
        keys: tuple[str | int, ...] | None = None,
    ) -> InputError:
        """The same error with its place filled in where it was still unknown; `keys` where another path is right."""
        return InputError(
            self.problem,
            remedy=self.remedy,
            path=self.path or path,
            line=self.line if self.line is not None else line,
            column=self.column if self.column is not None else column,
            keys=self.keys if keys is None else keys,
        )

    def _sentence(self) -> str:
        place = "" if self.path is None else str(self.path)
        if self.line is not None:
            place += f"{', ' if place else ''}line {self.line}"
        if self.column is not None:
            place += f", column {self.column}"
        text = f"{place}: {self.problem}" if place else self.problem
        end = f"; {_cut(self.remedy, MOST // 3)}." if self.remedy else "."
        return _cut(" ".join(text.split()), MOST - len(end)) + end


def _cut(text: str, most: int) -> str:
    """At most so many characters, its middle left out."""
    text = " ".join(text.split())
    return text if len(text) <= most else f"{text[: most - most // 3 - 3]} … {text[len(text) - most // 3 :]}"


class EvaluationError(InputError):
    """Parameter values at which the model has no finite readings: most often gains that make a drive unstable.

    Only `symfive.model` raises it, before a library sees such numbers. To a solver it is a step that went too far
    (`symfive.inference.halved`); only where a user's own values are such does it reach him.
    """


def among(
    value: object, choices: Collection[str], problem: str, *, path: Path | str | None = None,
    keys: tuple[str | int, ...] = (),
) -> None:  # fmt: skip
    """Raise `InputError` of the `problem` unless `value` is one of the `choices`, which its remedy lists."""
    if value not in choices:
        raise InputError(problem, path=path, remedy=f"use one of {', '.join(choices) or 'none'}", keys=keys)


@contextmanager
def inside(*keys: str | int, path: Path | str | None = None, line: int | None = None) -> Iterator[None]:
    """Errors of the block lie in this file and line, as far as they do not know better, and at or below `keys`: their own key
    path is continued upward."""
    try:
        yield
    except InputError as error:
        raise error.at(path, line, keys=(*keys, *error.keys)) from None

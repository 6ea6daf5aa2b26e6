"""XML as plain elements with their lines, read so that nothing expands and nothing is fetched."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat

import numpy as np

from symfive.arrays import Array
from symfive.errors import InputError
from symfive.files import read_text, shown

MAX_BYTES, MAX_DEPTH, MOST = 5_000_000, 100, 1e15
REMEDY = "check that it is the right file"


@dataclass(slots=True)
class Element:
    """One XML element, its namespace dropped, and the line where it begins."""

    tag: str
    attributes: dict[str, str]
    line: int
    children: list[Element] = field(default_factory=list)
    pieces: list[str] = field(default_factory=list)

    @property
    def text(self) -> str:
        """The text right below this element."""
        return "".join(self.pieces).strip()

    def get(self, name: str) -> str:
        """An attribute; "" where it is not there."""
        return self.attributes.get(name, "").strip()

    def at(self, *tags: str) -> Iterator[Element]:
        """The elements that lie along a path of tags below this one."""
        for child in self.children:
            if child.tag == tags[0]:
                yield from child.at(*tags[1:]) if len(tags) > 1 else (child,)

    def inside(self, *tags: str) -> Iterator[Element]:
        """Every element of these tags at any depth, in the order of the document."""
        waiting = self.children[::-1]
        while waiting:
            element = waiting.pop()
            waiting += element.children[::-1]
            if element.tag in tags:
                yield element

    def error(self, problem: str, remedy: str) -> InputError:
        """An `InputError` at this element's line."""
        return InputError(problem, line=self.line, remedy=remedy)


def read_xml(path: Path) -> Element:
    """The root of an XML file of at most 5 MB. Raises `InputError` where it is no XML, is nested more than 100 deep or
    declares a document type: entities, outer and inner, need that, so none is ever expanded."""
    parser = expat.ParserCreate(namespace_separator=" ")
    parser.buffer_text = True
    stack = [Element("", {}, 1)]

    def start(tag: str, attributes: dict[str, str]) -> None:
        if len(stack) > MAX_DEPTH:
            problem = f"elements are nested more than {MAX_DEPTH} deep"
            raise InputError(problem, path=path, line=parser.CurrentLineNumber, remedy=REMEDY)
        stack.append(Element(tag.rsplit(" ", 1)[-1], attributes, parser.CurrentLineNumber))
        stack[-2].children.append(stack[-1])

    def declaration(*_: object) -> None:
        problem = "the document declares a type or entities, which are not read"
        raise InputError(problem, path=path, line=parser.CurrentLineNumber, remedy="remove <!DOCTYPE …>")

    parser.StartElementHandler = start
    parser.EndElementHandler = lambda tag: stack.pop()
    parser.CharacterDataHandler = lambda text: stack[-1].pieces.append(text)
    parser.StartDoctypeDeclHandler = declaration
    try:
        parser.Parse(read_text(path, at_most=MAX_BYTES), True)
    except expat.ExpatError as error:
        problem = f"not XML: {expat.errors.messages[error.code]}"
        raise InputError(problem, path=path, line=error.lineno, column=error.offset + 1, remedy=REMEDY) from None
    (root,) = stack[0].children
    return root


def number(element: Element, word: str | None = None) -> float:
    """The element's text, or one word of it, as a number below 1e15."""
    word = element.text if word is None else word
    try:
        value = float(word)
    except ValueError:
        value = math.nan
    if not abs(value) < MOST:
        raise element.error(f"{element.tag} holds {shown(word)}, not a number below {MOST:g}", "correct it")
    return value


def vector(element: Element, tag: str, keys: str = "XYZ") -> Array | None:
    """Three numbers of a child `tag`, or of the entries `keys` of its data set `tag`DataSet; None where there is neither."""
    for child in element.children:
        if child.tag == tag:
            words = child.text.split()
        elif child.tag == f"{tag}DataSet":
            entries = {entry.get("key").upper(): entry.text for entry in child.at("Entry")}
            words = [entries[key] for key in keys if key in entries]
        else:
            continue
        if len(words) != 3:
            raise child.error(f"{child.tag} has {len(words)} numbers, not 3", "write all three")
        return np.array([number(child, word) for word in words])
    return None

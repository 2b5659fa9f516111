"""Reads XML of strangers into elements that know their lines; no document type, no entities, no huge or deep files.

Knows nothing of what the elements mean.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final
from xml.parsers import expat

from vve_sumo.errors import ConfigError

#: bytes of a file at most; the largest public scenarios have a hundredth
MAX_BYTES: Final = 64_000_000
#: elements within each other at most, and in all
MAX_DEPTH, MAX_ELEMENTS = 200, 2_000_000


@dataclass(slots=True)
class Element:
    """One XML element."""

    tag: str  #: without its namespace
    attributes: dict[str, str]
    file: Path
    line: int
    children: list[Element] = field(default_factory=list)
    text: str = ""  #: in the element itself, without that of its children

    @property
    def where(self) -> str:
        """File, line and name, for messages."""
        return f"{self.file}:{self.line}: <{self.tag}>"

    def child(self, *tags: str) -> Element | None:
        """Return the element at the end of a line of first children, None where there is none."""
        here: Element | None = self
        for tag in tags:
            here = None if here is None else next((one for one in here.children if one.tag == tag), None)
        return here

    def all(self, tag: str) -> list[Element]:
        """Return the children with a name."""
        return [one for one in self.children if one.tag == tag]

    def walk(self) -> Iterator[Element]:
        """Yield the element and everything in it."""
        yield self
        for one in self.children:
            yield from one.walk()


def read_xml(file: Path, what: str) -> Element:
    """Return the root of an XML file of `what`.

    Raises ConfigError naming the file and the line for what is no XML, and for a file that has a document type or that
    is larger or deeper than any scenario.
    """
    try:
        size = file.stat().st_size
        if size > MAX_BYTES:
            raise ConfigError(f"{file}: expected {what} of at most {MAX_BYTES / 1e6:.0f} MB, got {size / 1e6:.0f} MB")
        data = file.read_bytes()
    except OSError as error:
        raise ConfigError(f"{file}: expected {what}, it can't be read: {error.strerror}") from None
    builder = _Builder(file, what)
    try:
        return builder.parse(data)
    except expat.ExpatError as error:
        reason = expat.ErrorString(error.code)
        raise ConfigError(f"{file}:{error.lineno}: expected {what}, it is no XML: {reason}") from None


class _Builder:
    def __init__(self, file: Path, what: str) -> None:
        self._file, self._what, self._open, self._count = file, what, list[Element](), 0
        self._root: Element | None = None
        self._parser = expat.ParserCreate()
        self._parser.StartElementHandler = self._start
        self._parser.EndElementHandler = self._end
        self._parser.CharacterDataHandler = self._said
        self._parser.StartDoctypeDeclHandler = self._doctype

    def parse(self, data: bytes) -> Element:
        self._parser.Parse(data, True)
        assert self._root is not None  # expat raises where there is no root
        return self._root

    def _doctype(self, *_declared: object) -> None:
        line = self._parser.CurrentLineNumber
        raise ConfigError(f"{self._file}:{line}: <!DOCTYPE>: expected {self._what} without a document type")

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        self._count += 1
        line = self._parser.CurrentLineNumber
        if len(self._open) >= MAX_DEPTH or self._count > MAX_ELEMENTS:
            raise ConfigError(f"{self._file}:{line}: <{tag}>: deeper or more elements than any {self._what}")
        element = Element(tag.rpartition(":")[2], attributes, self._file, line)
        if self._open:
            self._open[-1].children.append(element)
        else:
            self._root = element
        self._open.append(element)

    def _end(self, _tag: str) -> None:
        self._open.pop()

    def _said(self, text: str) -> None:
        self._open[-1].text += text

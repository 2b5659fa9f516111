"""What a check of the doctor comes to, and how it is told.

Knows words and lines; makes no check.
"""

from __future__ import annotations

import enum
from collections.abc import Callable, Iterable
from typing import Final, NamedTuple, TypeVar

from vve_sumo.errors import VveError

T = TypeVar("T")

WIDTH: Final = 16  #: of the names


class Finding(enum.StrEnum):
    """What a check came to."""

    GO = "go"
    NOTE = "note"  #: no reason not to drive, but good to know
    NO_GO = "NO-GO"


class Check(NamedTuple):
    """One line of the report."""

    name: str
    found: str
    finding: Finding = Finding.GO
    advice: str = ""  #: what to do next

    def lines(self) -> list[str]:
        """Return the check as it is printed."""
        head = f"{self.finding:<5}  {self.name:<{WIDTH}}  {self.found}"
        return [head, f"{'':<{WIDTH + 9}}-> {self.advice}"] if self.advice else [head]


def judged(name: str, found: str, good: bool, advice: str, *, otherwise: Finding = Finding.NO_GO) -> Check:
    """Return a check that is `otherwise`, with advice, where it is not good."""
    return Check(name, found) if good else Check(name, found, otherwise, advice)


class Report:
    """The checks so far, each handed on as it comes."""

    def __init__(self, show: Callable[[Check], None] = lambda check: None) -> None:
        """Hand every check to `show` as soon as it is made."""
        self.checks: list[Check] = []
        self._show = show

    def add(self, checks: Iterable[Check]) -> None:
        """Take in checks as they are made."""
        for check in checks:
            self.checks.append(check)
            self._show(check)

    def attempt(self, name: str, advice: str, make: Callable[[], T]) -> T | None:
        """Return what `make` returns; where it is refused, None, and the refusal is a check of this name."""
        try:
            return make()
        except VveError as error:
            self.add([Check(name, str(error), Finding.NO_GO, advice)])
            return None

    @property
    def against(self) -> list[Check]:
        """What speaks against a drive."""
        return [check for check in self.checks if check.finding is Finding.NO_GO]

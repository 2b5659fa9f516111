"""Results of the doctor's checks, and how they are printed.

The module makes no check itself.
"""

from __future__ import annotations

import enum
from collections.abc import Callable, Iterable
from typing import Final, NamedTuple, TypeVar

from vve_sumo.errors import VveError

T = TypeVar("T")

WIDTH: Final = 16  #: of the names


class CheckResult(enum.StrEnum):
    """Result of a check."""

    GO = "go"
    NOTE = "note"  #: no reason not to drive, but good to know
    NO_GO = "NO-GO"


class Check(NamedTuple):
    """One line of the report."""

    name: str
    observed: str
    finding: CheckResult = CheckResult.GO
    advice: str = ""  #: what to do next

    def lines(self) -> list[str]:
        """Return the check as it is printed."""
        head = f"{self.finding:<5}  {self.name:<{WIDTH}}  {self.observed}"
        return [head, f"{'':<{WIDTH + 9}}-> {self.advice}"] if self.advice else [head]


def judged(name: str, observed: str, good: bool, advice: str, *, otherwise: CheckResult = CheckResult.NO_GO) -> Check:
    """Return a check that is GO if `good`, else `otherwise` with `advice`."""
    return Check(name, observed) if good else Check(name, observed, otherwise, advice)


class CheckReport:
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
        """Return what `make` returns; if it raises VveError, add a NO-GO check of this name and return None."""
        try:
            return make()
        except VveError as error:
            self.add([Check(name, str(error), CheckResult.NO_GO, advice)])
            return None

    @property
    def against(self) -> list[Check]:
        """The checks that speak against a drive."""
        return [check for check in self.checks if check.finding is CheckResult.NO_GO]

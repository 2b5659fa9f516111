"""Progress of a sweep and its remaining time.

Counts runs and reads the clock; nothing else.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field


@dataclass(slots=True)
class Tally:
    """Number of finished runs, by result."""

    total: int | None  #: None for a search, whose number of runs is unknown
    finished: int
    failed: int  #: of the finished ones, those that ended and did not pass
    errors: int  #: of the finished ones, those with an error
    search: str = ""  #: progress of a search
    before: int = field(init=False)  #: finished runs when this session began
    begun: float = field(init=False)  #: when that was [s]

    def __post_init__(self) -> None:
        self.before, self.begun = self.finished, time.monotonic()

    def count(self, passed: bool | None, error: str) -> None:
        """Count a finished run."""
        self.finished += 1
        self.failed += passed is False
        self.errors += bool(error)

    def text(self) -> str:
        """Return progress, rate and remaining time in one line."""
        here = self.finished - self.before
        rate = here / max(time.monotonic() - self.begun, 1e-3)
        speed, of = f"{60.0 * rate:.1f} a minute" if here else "starting", ""
        if self.total is not None:
            of = f" of {self.total}"
            speed += f", {_span((self.total - self.finished) / rate)} left" if here else ""
        counts = f"{self.failed} failed, {self.errors} with an error"
        return ", ".join(filter(None, (f"{self.finished}{of} runs", speed, self.search, counts)))


def _span(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes:02d} min" if hours else f"{minutes} min {rest:02d} s"

"""The people's pages without a drive: a server in a thread, and what it is told."""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TypeVar

from vve_sumo.people.reports import Report
from vve_sumo.view.person_pages import MAX_MESSAGE, PagePerson, PersonPages
from vve_sumo.view.server import PageServer

Kind = TypeVar("Kind")
ANNA = PagePerson("anna", "pedestrian", phone=True)
BOB = PagePerson("bob", "bicycle", phone=False)


class Served:
    """Pages that are served, and the reports that came, each with its time of arrival [s]."""

    def __init__(self, people: Sequence[PagePerson], certificate: Sequence[str]) -> None:
        self._t0 = time.monotonic()
        self.reports: list[tuple[float, Report]] = []
        self.pages = PersonPages(people, self.clock, lambda received, report: self.reports.append((received, report)))
        self.server = PageServer(self.pages.routes(), max_message=MAX_MESSAGE, certificate=certificate)

    def clock(self) -> float:
        return time.monotonic() - self._t0

    def of(self, kind: type[Kind]) -> list[Kind]:
        """The reports of a kind."""
        return [report for _, report in list(self.reports) if isinstance(report, kind)]


@contextmanager
def served(*people: PagePerson, certificate: Sequence[str] = ()) -> Iterator[Served]:
    """Serve pages until the end of the block; over HTTPS with the files of a certificate and its key."""
    one = Served(people or (ANNA,), certificate)
    thread = threading.Thread(target=lambda: asyncio.run(one.server.serve()), daemon=True)
    thread.start()
    try:
        yield one
    finally:
        one.server.close()
        thread.join(10.0)
        assert not thread.is_alive()

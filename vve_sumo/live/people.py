"""Runs the process of a live drive's real people: their pages, their receivers, and whoever stands in for them.

Reports go to the drive, where they are judged; towards the car nothing else goes out. When this process dies, the drive
knows it at once, and the car is stopped.
"""

from __future__ import annotations

import asyncio
import resource
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from vve_sumo.drive.simulated_people import SimulatedPeople, simulated
from vve_sumo.errors import VveError
from vve_sumo.live import messages, signals
from vve_sumo.live.assembly import from_dict
from vve_sumo.live.channel import Channel
from vve_sumo.live.people_link import ArrivedReport, ShownToPeople, decode, encode
from vve_sumo.live.priority import OOM_RECORDER, lower_priority, set_oom_score
from vve_sumo.live.rover import Rover, open_rover
from vve_sumo.live.spawn import receive_config
from vve_sumo.live.view import MAX_FILES, write_address
from vve_sumo.people import reports
from vve_sumo.people.reports import Report
from vve_sumo.rig.connections import RigPerson
from vve_sumo.view.person_pages import MAX_MESSAGE, PagePerson, PersonPages
from vve_sumo.view.server import PageServer

#: file in the record's folder with the page's address while the drive goes on; only its owner may read it
ADDRESS_FILE: Final = "people.json"
#: between two looks at those who stand in for people [s]
SIMULATED_PERIOD: Final = 0.02


class PeopleProcess:
    """The process of the people of a drive: one event loop for pages, receivers and simulated phones."""

    def __init__(self, config: Mapping[str, Any], channels: Mapping[str, Channel]) -> None:
        """Bind all sockets; raises VveError where that cannot be done."""
        self._drive, self._console = channels["drive"], channels["console"]
        self._t0: float = config["t0"]
        resolved, rig = from_dict(config["resolved"], Path(config["working"]))
        kinds = {person.id: person.kind for person in resolved.people}
        there = [person for person in rig.people if person.id in kinds]
        self._rovers = [open_rover(one, self._t0, config["epoch"]) for one in there if one.source == "nmea_udp"]
        self._simulated = simulated(resolved, [one.id for one in there if one.source == "simulated"])
        with_page = [PagePerson(one.id, kinds[one.id], one.source == "phone") for one in there if _has_page(one)]
        self._pages = PersonPages(with_page, self._clock, self._hand_over)
        self.server: PageServer | None = None  #: None where nobody has a page
        if with_page:
            where = {name: config[name] for name in ("address", "port", "token", "certificate")}
            self.server = PageServer(self._pages.routes(), **where, max_message=MAX_MESSAGE, table="people_page")
        self._over = asyncio.Event()

    async def run(self) -> None:
        """Serve until the drive is gone."""
        loop = asyncio.get_running_loop()
        loop.add_reader(self._drive.fileno(), self._read_drive)
        for rover in self._rovers:
            loop.add_reader(rover.fileno(), self._read_rover, rover)
        tasks = [asyncio.create_task(self._walk(self._simulated))]
        if self.server is not None:
            tasks.append(asyncio.create_task(self.server.serve()))
        await self._over.wait()
        if self.server is not None:
            self.server.close()
        tasks[0].cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        for rover in self._rovers:
            rover.close()

    def _clock(self) -> float:
        """Drive time [s]."""
        return time.monotonic() - self._t0

    def _hand_over(self, received: float, report: Report) -> None:
        """Hand a report to the drive; one for which there is no room is lost, as if it had never come."""
        self._drive.send(encode(ArrivedReport(received, reports.encode(report))))

    def _read_drive(self) -> None:
        for datagram in self._drive.receive():
            if isinstance(message := decode(datagram), ShownToPeople):
                self._pages.show(message.state, message.views)
        if self._drive.closed:
            asyncio.get_running_loop().remove_reader(self._drive.fileno())
            self._over.set()

    def _read_rover(self, rover: Rover) -> None:
        for received, report in rover.receive():
            self._hand_over(received, report)

    async def _walk(self, people: SimulatedPeople) -> None:
        while True:
            for received, report in people.until(self._clock()):
                self._hand_over(received, report)
            await asyncio.sleep(SIMULATED_PERIOD)


def _has_page(person: RigPerson) -> bool:
    return person.source != "simulated"


def main() -> int:
    """Run the process and return its exit code."""
    signals.ignore()
    set_oom_score(OOM_RECORDER)
    lower_priority()
    resource.setrlimit(resource.RLIMIT_NOFILE, (MAX_FILES, MAX_FILES))
    config, channels = receive_config()
    console = channels["console"]
    try:
        process = PeopleProcess(config, channels)
    except VveError as error:
        console.send(messages.refusal(error))
        return error.exit_code
    file = Path(config["folder"]) / ADDRESS_FILE
    address: tuple[str, ...] = () if process.server is None else (process.server.address,)
    if address:
        write_address(file, *address)
    console.send(messages.encode(messages.Ready(address)))
    try:
        asyncio.run(process.run())
    finally:
        file.unlink(missing_ok=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())

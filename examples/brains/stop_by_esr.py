"""A brain that sees by a Delphi ESR: NCOM over UDP and the radar's tracks over CAN in, setpoints out.

    python stop_by_esr.py WAYPOINTS.csv [--esr INTERFACE:CHANNEL] [--gnss PORT] [--radar PORT]
        [--setpoints PORT] [--key FILE]

It drives as stop_for_parked.py beside it. Of the radar datagram it reads the sequence alone, for a setpoint names the
datagram that it answers.
"""

from __future__ import annotations

import math
from functools import cache

from driving import Answers, Brain, Scan, answer, arguments, waypoints
from esr_radar import EsrRadar, open_bus

from vve_sumo.values import Fix
from vve_sumo.wire.datagrams import RadarDatagram


def main() -> None:
    """Answer until interrupted."""
    parser = arguments(__doc__)
    parser.add_argument("--esr", default="slcan:esr.pty", help="the radar's bus, slcan:esr.pty where nothing is said")
    given = parser.parse_args()
    brain = Brain(waypoints(given.waypoints), given.speed)

    @cache
    def radar() -> EsrRadar:
        """Open the radar's bus; a serial port that the drive makes is there by the first datagram."""
        return EsrRadar(open_bus(given.esr))

    def look(fix: Fix, _beat: RadarDatagram) -> Scan | None:
        speed = math.hypot(fix.velocity_north, fix.velocity_east)
        radar().listen(fix.time)
        radar().tell(speed, 0.0)
        return radar().scan(fix.time, fix.time, speed)

    answer(Answers(brain, look, given.key), given.gnss, given.radar, given.setpoints)


if __name__ == "__main__":
    main()

"""A brain that sees by a camera, a lidar or V2X alone: NCOM and one of these in, setpoints out.

    python stop_by_sense.py WAYPOINTS.csv --camera INTERFACE:CHANNEL | --lidar PORT | --v2x PORT
        [--gnss PORT] [--radar PORT] [--setpoints PORT] [--key FILE]

It drives as stop_for_parked.py beside it. Of the radar datagram it reads the sequence alone, for a setpoint names the
datagram that it answers. The wires are a rig's `mobileye`, `vlp16` and `v2x`; what is sent after a datagram of the same
tick counts at the next one. V2X needs asn1tools.
"""

from __future__ import annotations

import math
import socket
from collections.abc import Callable, Iterator
from functools import cache

from camera import Camera
from driving import Answers, Brain, Scan, answer, arguments, listen, waypoints
from esr_radar import open_bus
from lidar import Lidar

from vve_sumo.values import Fix

MAX_PACKET = 2048  # [bytes]


def speed_of(fix: Fix) -> float:
    """Return the car's speed [m/s]."""
    return math.hypot(fix.velocity_north, fix.velocity_east)


def came(end: socket.socket) -> Iterator[bytes]:
    """Take what has come to a port."""
    while True:
        try:
            yield end.recv(MAX_PACKET)
        except BlockingIOError:
            return


def by_camera(place: str) -> Callable[[Fix, object], Scan | None]:
    """Return what a camera on a CAN bus sees."""

    @cache
    def camera() -> Camera:
        """Open the bus; a serial port that the drive makes is there by the first datagram."""
        return Camera(open_bus(place))

    return lambda fix, _beat: camera().scan(fix.time, speed_of(fix))


def by_lidar(port: int) -> Callable[[Fix, object], Scan | None]:
    """Return what a lidar that sends to a port of this machine sees."""
    end, lidar = listen(port), Lidar()
    end.setblocking(False)
    end.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)  # a turn comes all at once

    def look(fix: Fix, _beat: object) -> Scan | None:
        for packet in came(end):
            lidar.take(packet)
        return lidar.scan(fix, speed_of(fix))

    return look


def by_v2x(port: int) -> Callable[[Fix, object], Scan | None]:
    """Return who is known by the messages that come to a port of this machine."""
    from v2x_stations import V2xStations

    end, stations = listen(port), V2xStations()
    end.setblocking(False)

    def look(fix: Fix, _beat: object) -> Scan | None:
        for packet in came(end):
            stations.take(packet, fix.time)
        return stations.scan(fix, speed_of(fix))

    return look


def main() -> None:
    """Answer until interrupted."""
    parser = arguments(__doc__)
    sense = parser.add_mutually_exclusive_group(required=True)
    sense.add_argument("--camera", help="the camera's bus, such as slcan:camera.pty")
    sense.add_argument("--lidar", type=int, help="port of the lidar's data packets")
    sense.add_argument("--v2x", type=int, help="port of the V2X receiver's packets")
    given = parser.parse_args()
    if given.camera is not None:
        look = by_camera(given.camera)
    else:
        look = by_lidar(given.lidar) if given.lidar is not None else by_v2x(given.v2x)
    brain = Brain(waypoints(given.waypoints), given.speed)
    answer(Answers(brain, look, given.key), given.gnss, given.radar, given.setpoints)


if __name__ == "__main__":
    main()

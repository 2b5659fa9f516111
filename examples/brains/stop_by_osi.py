"""A brain that sees by ASAM OSI: NCOM and SensorData in over UDP, setpoints out.

    python stop_by_osi.py WAYPOINTS.csv [--osi PORT] [--gnss PORT] [--radar PORT] [--setpoints PORT] [--key FILE]

It drives as stop_for_parked.py beside it. Of the radar datagram it reads the sequence alone, for a setpoint names the
datagram that it answers. Needs osi-python.
"""

from __future__ import annotations

import math
import select
import socket
from types import SimpleNamespace

from driving import Answers, Brain, Scan, answer, arguments, listen, waypoints
from osi3.osi_sensordata_pb2 import SensorData

from vve_sumo.values import Fix
from vve_sumo.wire.datagrams import RadarDatagram

MAX_DATAGRAM = 65_535  # [bytes]
PATIENCE = 0.01  # for the message of the same tick [s]


class OsiRadar:
    """The newest SensorData of a port."""

    def __init__(self, port: int) -> None:
        self._socket: socket.socket = listen(port)
        self._message = SensorData()

    def look(self, fix: Fix, radar: RadarDatagram) -> Scan | None:
        """Return the detections of this tick; None where there is no message of it, or the radar is not available."""
        message = self._message
        # The two wires are sent one after the other, in the order of the rig.
        while not _is_of(radar, message) and select.select([self._socket], [], [], PATIENCE)[0]:
            message.ParseFromString(self._socket.recv(MAX_DATAGRAM))
        if not message.feature_data.radar_sensor or not _is_of(radar, message):
            return None
        sensor = message.feature_data.radar_sensor[0]
        if sensor.header.data_qualifier != sensor.header.DATA_QUALIFIER_AVAILABLE:
            return None
        found = [
            SimpleNamespace(range=one.position.distance, azimuth=one.position.azimuth, range_rate=one.radial_velocity)
            for one in sensor.detection
        ]
        measured = _seconds(sensor.header.measurement_time)
        return Scan(_seconds(message.timestamp), measured, math.hypot(fix.velocity_north, fix.velocity_east), found)


def _is_of(radar: RadarDatagram, message: SensorData) -> bool:
    return abs(_seconds(message.timestamp) - radar.time) < 1e-3


def _seconds(stamp: object) -> float:
    return stamp.seconds + 1e-9 * stamp.nanos  # type: ignore[attr-defined]


def main() -> None:
    """Answer until interrupted."""
    parser = arguments(__doc__)
    parser.add_argument("--osi", type=int, default=5004, help="port of SensorData")
    given = parser.parse_args()
    brain = Brain(waypoints(given.waypoints), given.speed)
    answers = Answers(brain, OsiRadar(given.osi).look, given.key)
    answer(answers, given.gnss, given.radar, given.setpoints)


if __name__ == "__main__":
    main()

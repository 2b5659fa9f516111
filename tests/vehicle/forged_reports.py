"""Reports of the drive-by-wire kit that a test puts in the place of the car's own."""

from __future__ import annotations

from vve_sumo.values import Frame
from vve_sumo.vehicle.dataspeed import codec, messages

ENABLED_BRAKE = codec.BrakeReport(messages.BrakeReportKind.PEDAL, 0.15, 0.15, 0.15, enabled=True)
ENABLED_THROTTLE = codec.ThrottleReport(0.15, 0.15, 0.15, enabled=True)
ENABLED_STEERING = codec.SteeringReport(0.0, 0.0, 10.0, 0.0, enabled=True)


def forged(message: object) -> dict[int, Frame]:
    frame = message if isinstance(message, Frame) else codec.encode(message)
    return {frame.id: frame}

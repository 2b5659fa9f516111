"""A driver's foot on the whole simulated car, with reports that fail, and what came of it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

from tests.vehicle.whole_car import PERIOD, WholeCar
from vve_sumo.values import ArmingState, Frame, GatewayStatus
from vve_sumo.vehicle.dataspeed import layout
from vve_sumo.vehicle.interface import HANDS_OFF, DriverInputs

Alter = Callable[[Frame], Frame]


@dataclass
class Frozen:
    """Keeps the report frames of some identifiers as they were at first, to the last bit."""

    identifiers: tuple[int, ...]
    kept: dict[int, Frame] = field(default_factory=dict)

    def __call__(self, frame: Frame) -> Frame:
        return self.kept.setdefault(frame.id, frame) if frame.id in self.identifiers else frame


def bits_at_zero(frame: Frame) -> Frame:
    """Clear the override and driver bits of the brake report (0x61); all else is true."""
    if frame.id != layout.BRAKE_REPORT:
        return frame
    return Frame(frame.id, frame.data[:-1] + bytes([frame.data[-1] & ~0x06]))


def foot_unseen(frame: Frame) -> Frame:
    """Clear those bits and the pedal's position in the brake report; its command and its enabled bit are true."""
    frame = bits_at_zero(frame)
    return Frame(frame.id, bytes(2) + frame.data[2:]) if frame.id == layout.BRAKE_REPORT else frame


@dataclass
class Course:
    """What came of a drive in which a foot came at a time zero; times in s."""

    statuses: list[tuple[float, GatewayStatus]]
    requested: list[tuple[float, float]]  #: time and throttle that the DBW controller asks of the engine, by the truth
    speeds: list[tuple[float, float]]  #: time and true speed [m/s]

    @property
    def throttle_closed(self) -> float:
        """Time from which the throttle stays closed for good; inf for never."""
        last = [time for time, throttle in self.requested if throttle > 0.0]
        if last and last[-1] == self.requested[-1][0]:
            return math.inf
        return max([0.0, *(time + PERIOD for time in last)])

    @property
    def noticed(self) -> tuple[float, tuple[str, ...]]:
        """Time at which the drive ended, and the reasons at that step."""
        for time, status in self.statuses:
            if status.state is not ArmingState.ENGAGED:
                return time, status.reasons
        return math.inf, ()

    @property
    def reasons(self) -> set[str]:
        """All reasons of the whole course."""
        return {code for _time, status in self.statuses for code in status.reasons}


def under_way(whole: WholeCar, speed: float = 5.0, seconds: float = 8.0) -> None:
    """Engage and drive to a `speed` [m/s], which is then kept."""
    whole.engage()
    for _ in range(round(seconds / PERIOD)):
        status = whole.step(wish(whole, speed))
        assert status.state is ArmingState.ENGAGED, status
    assert status.throttle > 0.0


def wish(whole: WholeCar, speed: float) -> float:
    """Acceleration that a plain cruise controller asks for [m/s2]."""
    return min(max(speed - whole.car.truth().speed, -2.0), 1.5)


def foot_comes(
    whole: WholeCar,
    foot: DriverInputs,
    lasts: float,
    alter: Alter = lambda frame: frame,
    frozen_before: float = 0.0,
    seconds: float = 15.0,
    speed: float = 5.0,
) -> Course:
    """Drive on under `alter` at `speed`; the foot comes after `frozen_before` for as long as it `lasts`."""
    course = Course([], [], [])
    for number in range(round((frozen_before + seconds) / PERIOD)):
        time = number * PERIOD - frozen_before
        driver = foot if -1e-9 <= time < lasts - 1e-9 else HANDS_OFF
        whole.heard = [alter(frame) for frame in whole.heard]
        status = whole.step(wish(whole, speed), driver=driver)
        if time < -1e-9:
            assert status.state is ArmingState.ENGAGED, status
            continue
        course.statuses.append((time, status))
        course.requested.append((time, whole.car.interface.controller.request.throttle))
        course.speeds.append((time, whole.car.truth().speed))
    return course

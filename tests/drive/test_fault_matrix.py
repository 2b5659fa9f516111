"""The rows of the fault matrix that the simulated vehicle brings about, each driven in closed loop.

What is injected, decided and commanded is the code of the live drive; its processes are tested by the rows that stay
live (`tests/live/test_matrix.py`). A row is judged by the same promises, from the car's true motion and the frames.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from typing import Final, NamedTuple

import pytest

from controllers import follow_and_stop
from tests import vehicles
from tests.live.matrix import AT, GATEWAY, INJECTED, Fault, Right, Row, bound, pace
from tests.live.spoilt import BRAKES, SPEED, WEAVE, WEAVES_IN
from tests.vehicle.closed_loop import ClosedLoop, Ticked, winding
from vve_sumo.controller import Controller
from vve_sumo.drive import reasons
from vve_sumo.plant.car import CarOutput
from vve_sumo.plant.injected_faults import START_SPEED, InjectedFault, Shape
from vve_sumo.timing import PERIOD
from vve_sumo.values import ArmingState, ControlCommand, Frame, Observation
from vve_sumo.vehicle.arming import CRITICAL
from vve_sumo.vehicle.arming_machine import OperatorCommand
from vve_sumo.vehicle.dataspeed import codec

DESIRED: Final = 5.0  #: speed, as of the live rows [m/s]
STANDING: Final = 0.05  #: slower is rest [m/s]
LONGEST: Final = 40.0  #: that a drive takes [s]
TENTH: Final = round(0.1 / PERIOD)  #: of a second, in ticks

#: as `tests/live/spoilt.py` has them, by drive time: what a controller's answer becomes, and from which speed on
SPOILT: Final[dict[str, tuple[Callable[[ControlCommand, float], ControlCommand], float]]] = {
    "braking": (lambda answer, _now: replace(answer, acceleration=min(answer.acceleration, -BRAKES)), SPEED),
    "weaving": (lambda answer, now: replace(answer, steering=WEAVE * math.sin(math.tau * now / WEAVES_IN)), 3.5),
}


class Spoilt:
    """The shipped controller, until the car is fast enough; the identity of none."""

    def __init__(self, inner: Controller, name: str) -> None:
        self._inner = inner
        self._spoil, self._speed = SPOILT[name] if name else (lambda answer, _now: answer, math.inf)
        self.since = math.nan  #: drive time from which on it answers otherwise [s]

    def step(self, observation: Observation) -> ControlCommand:
        """Answer an observation."""
        answer = self._inner.step(observation)
        if math.isnan(self.since) and observation.pose.speed > self._speed:
            self.since = observation.time
        return answer if math.isnan(self.since) else self._spoil(answer, observation.time)


class Watched(ClosedLoop):
    """A closed loop of which the frames are kept, and why fixes were refused."""

    def __init__(self, row: Row, controller: Spoilt) -> None:
        super().__init__(winding(), DESIRED, map(injected, row.faults), controller=controller)
        self.sent: list[tuple[Frame, ...]] = []
        self.refused: list[tuple[str, ...]] = []

    def _tick(
        self, tick: int, now: float, heard: CarOutput, command: OperatorCommand | None
    ) -> tuple[Ticked, tuple[Frame, ...]]:
        ticked, frames = super()._tick(tick, now, heard, command)
        self.sent.append(frames)
        self.refused.append(self.pipeline._reasons)
        return ticked, frames


class Driven(NamedTuple):
    """What came of a row."""

    ticks: list[Ticked]
    sent: list[tuple[Frame, ...]]  #: frames of each tick
    refused: set[str]  #: codes for which fixes were refused after the fault
    fault: int  #: number of the tick of the fault


def injected(fault: Fault) -> InjectedFault:
    """Return the fault as the rig of a live row injects it."""
    flapping = fault.flapping is not None
    return InjectedFault(
        fault.kind,
        AT + fault.later,
        fault.duration,
        math.nan if fault.value is None else fault.value,
        Shape.FLAPPING if flapping else Shape.STEP,
        fault.flapping if fault.flapping is not None else math.nan,
    )


def driven(row: Row) -> Driven:
    """Drive until the gateway is done with the car and the car stands."""
    controller = Spoilt(follow_and_stop.make(vehicles.FUSION.vehicle, {}), row.controller)
    loop, ticks, moved = Watched(row, controller), [], math.nan
    for ticked in loop.ticks():
        ticks.append(ticked)
        if math.isnan(moved) and abs(ticked.truth.speed) > START_SPEED:
            moved = ticked.now
        if loop.gateway.done and ticked.truth.speed == 0.0:
            break
        assert ticked.now < LONGEST, f"{ticked.status}"
    begun = moved + AT + min(row.faults[0].later, 0.0)
    begun = max(begun, controller.since) if row.controller else begun
    fault = next(number for number, ticked in enumerate(ticks) if ticked.now >= begun - 1e-9)
    return Driven(ticks, loop.sent, {code for codes in loop.refused[fault:] for code in codes}, fault)


@pytest.mark.parametrize("row", INJECTED, ids=lambda row: row.name)
def test_an_injected_fault_has_its_right_outcome(row: Row) -> None:
    came = driven(row)
    assert came.ticks[came.fault - 1].status.state is ArmingState.ENGAGED
    assert came.ticks[came.fault].truth.speed > SPEED - 1.0
    assert came.ticks[-1].truth.speed == 0.0
    if row.right is Right.REST:
        assert_at_rest(row, came)
    else:
        assert_driver_has_control(came)
    reported = [code for ticked in came.ticks for code in ticked.status.reasons]
    assert set(row.reasons) <= set(reported)
    assert set(reported) <= set(reasons.ALL)
    assert not row.fix or not came.refused.isdisjoint(row.fix)


def assert_at_rest(row: Row, came: Driven) -> None:
    """The car came to rest within the bound, for this reason, and nothing let it go on."""
    here, before = came.ticks[came.fault].truth, came.ticks[came.fault - TENTH].truth
    after = came.ticks[came.fault :]
    way = sum(math.dist((a.truth.x, a.truth.y), (b.truth.x, b.truth.y)) for a, b in pairwise(after))
    assert way <= bound(row, here.speed, (here.speed - before.speed) / (TENTH * PERIOD))
    stopped = [ticked for ticked in after if ticked.status.state is not ArmingState.ENGAGED]
    assert after[-len(stopped) :] == stopped, "engaged again"
    assert stopped[0].status.reasons[0] in row.reasons + row.first
    assert all(ticked.status.throttle == 0.0 for ticked in stopped)
    stood = [ticked for ticked in stopped if ticked.status.state is ArmingState.STOPPED]
    assert all(abs(ticked.truth.speed) < STANDING for ticked in stood), "a car that moves is not held to stand"
    if row.stops is GATEWAY and CRITICAL.isdisjoint(code for ticked in stopped for code in ticked.status.reasons):
        speeds = [ticked.truth.speed for ticked in came.ticks]
        hardest = max(a - b for a, b in zip(speeds, speeds[TENTH:], strict=False)) / (TENTH * PERIOD)
        assert hardest < pace(row), "the gateway keeps its own pace"


def assert_driver_has_control(came: Driven) -> None:
    """Every enable bit is off from the first tick that says so on, and the counters go on."""
    first = next(
        number
        for number, ticked in enumerate(came.ticks)
        if number > came.fault and "driver_override" in ticked.status.reasons
    )
    for kind in (codec.BrakeCommand, codec.ThrottleCommand, codec.SteeringCommand):
        said = [next(one for one in map(codec.decode, frames) if isinstance(one, kind)) for frames in came.sent]
        assert said[came.fault - 1].enable
        assert not any(message.enable for message in said[first:])
        assert all((b.counter - a.counter) % 256 == 1 for a, b in pairwise(said[came.fault :]))
    assert len(came.sent) - first > 20

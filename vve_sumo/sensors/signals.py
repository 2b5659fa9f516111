"""A sense of stop lines and signals: by the messages of roadside units, or by sight.

By messages the receiver knows what MAPEM and SPATEM say: lanes, phases and when phases end at the earliest. By sight it
knows what a signal shows ahead of the car, and no times. What lies between car and signal hides nothing.
"""

from __future__ import annotations

import dataclasses
import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple, TypeAlias

import numpy as np

from vve_sumo.frames import MapFrame
from vve_sumo.intersections import Intersection, SignalPhase
from vve_sumo.sensors.port import Column, SensorColumn
from vve_sumo.sensors.roadside_messages import HOUR, PHASES, geometry_of, middle_of, state_of
from vve_sumo.v2x import mapem, spatem
from vve_sumo.v2x.mapem import Direction, IntersectionGeometry
from vve_sumo.v2x.spatem import Event, IntersectionState, Phase
from vve_sumo.values import Actors, Point, Pose, StopLines, Vehicle

COLUMNS: Final = (
    SensorColumn("signal", "str", "SUMO's id of the signal (ground truth)"),
    SensorColumn("intersection", "int", "number of the junction"),
    SensorColumn("group", "int", "number of what is shown for this way; 0 unknown"),
    SensorColumn("x_m", "float", "middle of the stop line, ahead of the front bumper"),
    SensorColumn("y_m", "float", "middle of the stop line, left of the car's axis"),
    SensorColumn("heading_rad", "float", "of the lane at the line from the car's axis, counter-clockwise"),
    SensorColumn("width_m", "float", "of the lane"),
    SensorColumn("exit_x_m", "float", "begin of the lane beyond, ahead of the front bumper"),
    SensorColumn("exit_y_m", "float", "begin of the lane beyond, left of the car's axis"),
    SensorColumn("phase", "int8", "what is shown: 3 red, 4 red and yellow, 5 and 6 green, 7 and 8 yellow, 0 unknown"),
    SensorColumn("age_s", "float", "from when that was shown"),
    SensorColumn("remaining_s", "float", "for which it is shown at least; 0 where nothing is known"),
    SensorColumn("green_begin_s", "float", "time to the next green at the earliest; 0 where nothing is known"),
    SensorColumn("green_end_s", "float", "time to the end of that green at the earliest; 0 where nothing is known"),
)
#: a message that is older counts no more [s]
MAX_AGE: Final = 1.0
#: a line so far behind the front bumper is listed no more [m]
BEHIND: Final = 3.0
#: a signal is seen by traffic whose heading differs from its lane's by less [rad]
FACING: Final = math.radians(60.0)
GREEN: Final = (Phase.PERMISSIVE_MOVEMENT_ALLOWED, Phase.PROTECTED_MOVEMENT_ALLOWED)
#: an end that lies so far behind within its hour was rounded down from now [s]
ROUNDED: Final = 10.0
#: an output that comes so late shifts those after it [s]
PUNCTUAL: Final = 0.05
#: returns the drive time [s] of a time within the hour [s], None for none
Dated: TypeAlias = Callable[[float | None], float | None]


@dataclass(frozen=True, slots=True)
class SignalsConfig:
    """What is known of signals, and how."""

    by_messages: bool  #: else by sight
    range: float  #: from the front bumper to the middle of the junction [m]
    half_angle: float  #: of the field of view by sight [rad]
    rate: float  #: outputs a second [Hz]
    latency: float  #: from what is shown to the output [s]
    loss: float  #: share of the messages that are not received


class _Way(NamedTuple):
    """A way across a junction, as its MAPEM has it."""

    group: int
    x: float  #: of the stop line's middle, map [m]
    y: float
    heading: float  #: of the lane at the line [rad], counter-clockwise from the map's +x
    width: float
    exit_x: float  #: begin of the lane beyond, map [m]
    exit_y: float


class _Junction(NamedTuple):
    number: int
    intersection: Intersection
    x: float  #: middle, map [m]
    y: float
    ways: Sequence[_Way]


class _Shown(NamedTuple):
    """What is known of one way at a time."""

    phase: Phase
    end: float | None = None  #: earliest, drive time [s]
    green_begin: float | None = None  #: of the next green, earliest, drive time [s]
    green_end: float | None = None  #: as green_begin


class _Heard(NamedTuple):
    time: float  #: of what is known, drive time [s]
    shown: Mapping[int, _Shown]  #: by group


class SignalsReading(NamedTuple):
    """The rows of one output."""

    signals: Sequence[str]
    lines: StopLines

    def columns(self) -> tuple[Column, ...]:
        """Return the rows as the columns of the sensor's table."""
        one = self.lines
        places = (one.x, one.y, one.heading, one.width, one.exit_x, one.exit_y)
        times = (one.age, one.remaining, one.green_begin, one.green_end)
        return (self.signals, one.intersection, one.group, *places, one.phase, *times)


class SignalSense:
    """A sensor of stop lines and signals; call `show` before each step."""

    refused = 0  #: it looks at no actors

    def __init__(
        self,
        config: SignalsConfig,
        vehicle: Vehicle,
        generator: np.random.Generator,
        intersections: Sequence[Intersection],
        frame: MapFrame,
    ) -> None:
        """`frame` is that of the map, in which messages say where lanes are."""
        self._config, self._bumper, self._chance = config, vehicle.rear_axle_to_bumper, generator
        self._junctions = tuple(_junction(number, one, frame) for number, one in enumerate(intersections))
        self._signals: Mapping[str, SignalPhase] = {}
        self._on_the_way: deque[tuple[float, dict[int, _Heard]]] = deque()
        self._known: dict[int, _Heard] = {}
        self._next = -math.inf
        self.output: StopLines = _lines(-math.inf, ())

    def show(self, signals: Mapping[str, SignalPhase]) -> None:
        """Take what each signal shows, by SUMO's ids."""
        self._signals = signals

    def step(self, time: float, pose: Pose, actors: Actors) -> SignalsReading | None:
        """Look from the rear axle's pose at drive time `time` [s]; `actors` hide nothing."""
        if pose.point is not Point.REAR_AXLE:
            raise ValueError(f"signals: the pose must be the rear axle's, got {pose.point}")
        if time < self._next - 1e-9:
            return None
        self._next = max(self._next, time - PUNCTUAL) + 1.0 / self._config.rate
        self._on_the_way.append((time, self._sensed(time, pose)))
        while self._on_the_way and self._on_the_way[0][0] + self._config.latency <= time + 1e-9:
            self._known |= self._on_the_way.popleft()[1]
        rows = list(self._rows(time, pose))
        self.output = _lines(time, [row for _signal, row in rows])
        return SignalsReading([signal for signal, _row in rows], self.output)

    def _sensed(self, time: float, pose: Pose) -> dict[int, _Heard]:
        """Return what is received or seen now, by the junction's number."""
        found = {}
        for one in self._junctions:
            phase = self._signals.get(one.intersection.signal)
            if phase is None or math.hypot(one.x - pose.x, one.y - pose.y) > self._config.range:
                continue
            if not self._config.by_messages:
                groups = {way.group for way in one.ways if way.group}
                letters = {group: phase.state[group - 1] for group in groups if group <= len(phase.state)}
                seen = {group: _Shown(PHASES.get(at, Phase.UNAVAILABLE)) for group, at in letters.items()}
                found[one.number] = _Heard(time, seen)
            elif self._chance.random() >= self._config.loss:
                state = spatem.rounded(spatem.Spatem(1, (state_of(one.number, one.intersection, phase, time),)))
                found[one.number] = _Heard(time, _read(state.intersections[0], time))
        return found

    def _rows(self, time: float, pose: Pose) -> Sequence[tuple[str, tuple[float, ...]]]:
        cos, sin, found = math.cos(pose.heading), math.sin(pose.heading), []
        for one in self._junctions:
            heard = self._known.get(one.number)
            if heard is None or time - heard.time > MAX_AGE + self._config.latency:
                continue
            for way in one.ways:
                shown = heard.shown.get(way.group)
                x, y = self._ahead(way.x, way.y, pose, cos, sin)
                exit_x, exit_y = self._ahead(way.exit_x, way.exit_y, pose, cos, sin)
                heading = math.remainder(way.heading - pose.heading, math.tau)
                if shown is None or not self._noticed(x, heading, exit_x, exit_y):
                    continue
                times = [_after(time, at) for at in (shown.end, shown.green_begin, shown.green_end)]
                place = (x, y, heading, way.width, exit_x, exit_y)
                row = (one.number, way.group, *place, int(shown.phase), time - heard.time, *times)
                found.append((one.intersection.signal, row))
        return found

    def _noticed(self, x: float, heading: float, exit_x: float, exit_y: float) -> bool:
        """Whether a line is listed: by messages whatever leads in, by sight what faces the car in the field of view."""
        if self._config.by_messages:
            return True
        in_view = exit_x > 0.0 and abs(math.atan2(exit_y, exit_x)) <= self._config.half_angle
        return x > -BEHIND and abs(heading) < FACING and in_view

    def _ahead(self, x: float, y: float, pose: Pose, cos: float, sin: float) -> tuple[float, float]:
        east, north = x - pose.x, y - pose.y
        return east * cos + north * sin - self._bumper, north * cos - east * sin


def _after(now: float, at: float | None) -> float:
    return 0.0 if at is None else max(at - now, 0.0)


def _lines(time: float, rows: Sequence[tuple[float, ...]]) -> StopLines:
    """Return rows as columns: each holds the fields of `StopLines` after `time`, in their order."""
    table = np.array(rows, np.float64).reshape(-1, len(dataclasses.fields(StopLines)) - 1)
    columns = [column.copy() for column in table.T]
    intersection, group, x, y, heading, width, exit_x, exit_y, phase, age, remaining, green_begin, green_end = columns
    return StopLines(
        time=time,
        intersection=intersection.astype(np.int64),
        group=group.astype(np.int64),
        x=x,
        y=y,
        heading=heading,
        width=width,
        exit_x=exit_x,
        exit_y=exit_y,
        phase=phase.astype(np.int8),
        age=age,
        remaining=remaining,
        green_begin=green_begin,
        green_end=green_end,
    )


def _junction(number: int, intersection: Intersection, frame: MapFrame) -> _Junction:
    said = mapem.rounded(mapem.Mapem(1, (geometry_of(number, intersection, frame),)))
    return _Junction(number, intersection, *middle_of(intersection), _ways(said.intersections[0], frame))


def _ways(said: IntersectionGeometry, frame: MapFrame) -> Sequence[_Way]:
    """Return the ways across a junction by its MAPEM, in the map."""
    latitude, longitude = math.radians(said.latitude_deg), math.radians(said.longitude_deg)
    x0, y0 = frame.to_map(latitude, longitude)
    turned = -frame.convergence(latitude, longitude)
    cos, sin = math.cos(turned), math.sin(turned)

    def placed(node: tuple[float, float]) -> tuple[float, float]:
        east, north = node
        return x0 + cos * east + sin * north, y0 + cos * north - sin * east

    begins = {lane.id: placed(lane.nodes[0]) for lane in said.lanes}
    ways = []
    for lane in said.lanes:
        if not lane.direction & Direction.INGRESS:
            continue
        (x, y), (before_x, before_y) = placed(lane.nodes[0]), placed(lane.nodes[1])
        heading, width = math.atan2(y - before_y, x - before_x), said.lane_width or 0.0
        for connection in lane.connections:
            ways.append(_Way(connection.signal_group or 0, x, y, heading, width, *begins[connection.lane]))
    return ways


def _read(state: IntersectionState, now: float) -> dict[int, _Shown]:
    """Return what a SPATEM says that was sent at drive time `now` [s], by signal group."""
    of_hour = math.fmod(60.0 * (state.minute_of_year or 0) + (state.second or 0.0), HOUR)

    def dated(mark: float | None) -> float | None:
        if mark is None:
            return None
        after = math.fmod(mark - of_hour + HOUR, HOUR)
        return now + (after if after < HOUR - ROUNDED else 0.0)

    return {movement.signal_group: _shown(movement.events, dated) for movement in state.movements}


def _shown(events: Sequence[Event], dated: Dated) -> _Shown:
    present = events[0]
    green = next((event for event in events[1:] if event.phase in GREEN), None)
    if green is None:
        return _Shown(present.phase, dated(present.min_end))
    return _Shown(present.phase, dated(present.min_end), dated(green.start), dated(green.min_end))

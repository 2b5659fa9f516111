"""A drive of a brain in this process: a street, a car and a radar in closed form behind the real link and encoders.

What a certificate rests on is all real: samples, encoders, faults and phantoms, the link, the inbox of setpoints, the
brain's own code. Only SUMO, the plant and the gateway are not there: the car follows its setpoints by a lag, and is
braked along the path where none is alive. So a certificate takes seconds, and every bug can be tried with many seeds.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from random import Random
from types import SimpleNamespace
from typing import Any

import numpy as np

from tests.conftest import REPOSITORY
from vve_sumo.certify.cases import CASES, Case, Scene, inapplicable
from vve_sumo.certify.judge import Rules, judge
from vve_sumo.certify.limits import CertificateLimits
from vve_sumo.certify.link import FaultLink, FaultyWire, Window
from vve_sumo.certify.moments import speeds_at, timing_of, track_of
from vve_sumo.certify.phantom_contents import LidarMount
from vve_sumo.certify.phantoms import Installation
from vve_sumo.certify.results import CaseDrive, CaseResult, CaseVerdict
from vve_sumo.drive.brain import virtual_placement
from vve_sumo.drive.resolved_scenario import load_vehicle_model
from vve_sumo.frames import MapFrame, Mounting
from vve_sumo.sensors.lidar_settings import LidarSettings
from vve_sumo.sensors.port import configured
from vve_sumo.sensors.street import Street
from vve_sumo.values import Actors, CameraObjects, Detections, Fix, FixQuality, Point, PointCloud, Pose, Stations
from vve_sumo.wire import ars408
from vve_sumo.wire.outputs import KINDS, Context, OfOtherSensor
from vve_sumo.wire.sample import Sample, SampleContent, virtual_fix
from vve_sumo.wire.setpoints import SetpointInbox
from vve_sumo.wire.vlp16 import turn_of

sys.path.insert(0, str(REPOSITORY / "examples" / "brains"))

import driving
import planted_bug
from camera import Camera
from esr_radar import EsrRadar
from lidar import Lidar
from pursuit_headway import PursuitHeadway
from stanley_idm import StanleyIdm
from v2x_stations import V2xStations

TICK, EPOCH, SPEED = 0.02, 1_451_260_818.0, 9.0
BEFORE, RADIUS, TURN, BEHIND = 30.0, 70.0, math.radians(80.0), 110.0
#: of the rear of what stands in the way [m]
OBSTACLE = BEFORE + RADIUS * TURN + 85.0
LONGEST = 60.0  #: drive [s]
BRAKE_LAG, STEERING_LAG, STOP = 0.15, 0.1, -2.5  #: of the car [s], [s], and what brakes it without setpoints [m/s2]
SCAN_PERIOD, SCAN_DELAY = 0.05, 0.03  #: of the radar [s]
PROJECTION = "+proj=tmerc +lat_0=40 +lon_0=-83 +k=1 +x_0=0 +y_0=0 +ellps=WGS84 +units=m +no_defs"
#: where the receiver sits: as the brains have it
MOUNTING = Mounting(driving.AHEAD, driving.LEFT)
RULES = Rules(CertificateLimits(), SPEED, steering=0.5)


def place(s: float) -> tuple[float, float, float]:
    """Return x, y [m] and heading [rad] of the path at a distance [m]."""
    bend = min(max(s - BEFORE, 0.0), RADIUS * TURN) / RADIUS
    rest = max(s - BEFORE - RADIUS * TURN, 0.0)
    x = min(s, BEFORE) + RADIUS * math.sin(bend) + rest * math.cos(bend)
    return x, RADIUS * (1.0 - math.cos(bend)) + rest * math.sin(bend), bend


@cache
def waypoints() -> tuple[tuple[float, float], ...]:
    """Return the path as a brain reads it: latitude and longitude [rad], a point a metre."""
    frame = MapFrame(PROJECTION)
    length = BEFORE + RADIUS * TURN + BEHIND
    return tuple(frame.to_geodetic(*place(float(s))[:2]) for s in range(int(length)))


@cache
def vehicle() -> Any:
    """The car, for the encoders and its bumper."""
    return load_vehicle_model(REPOSITORY / "vehicles" / "ford_fusion.toml")[0].vehicle


BUMPER = driving.BUMPER
#: kind of wire: kind and name of the sensor that it is of, as shipped
OTHER_SENSORS = {"mobileye": "camera", "vlp16": "lidar", "v2x": "v2x"}


def _lidar() -> LidarMount:
    own = LidarSettings().config()
    return LidarMount(own.x, own.y, own.z, own.yaw, own.elevations)


INSTALLATION = Installation(BUMPER, MapFrame(PROJECTION), {"lidar": _lidar()})


class InProcess:
    """A brain as the link's other end: what the outlets send lies here until `receive` lets the brain answer."""

    def __init__(self, answers: driving.Answers, take: Callable[[str, Any], None] = lambda kind, portion: None) -> None:
        """`take` is handed what comes on every other wire than those of the receiver and of the radar datagrams."""
        self._answers, self._fixes, self._other = answers, driving.Fixes(), take
        self._heard: dict[str, list[Any]] = {}
        self.lost = False

    def outlet(self, kind: str) -> Any:
        heard = self._heard.setdefault(kind, [])
        return SimpleNamespace(lost=0, send=heard.extend, close=lambda: None)

    def receive(self) -> list[tuple[float, bytes]]:
        """Return what the brain answers to what it heard."""
        for packet in self._take("ncom"):
            self._fixes.feed(packet)
        for kind in self._heard.keys() - {"ncom", "radar"}:
            for portion in self._take(kind):
                self._other(kind, portion)
        answers = [self._answers.to(data, self._fixes.fix) for data in self._take("radar")]
        return [(0.0, data) for data in answers if data is not None]

    def _take(self, kind: str) -> list[Any]:
        heard = self._heard.get(kind, [])
        came, heard[:] = list(heard), []
        return came

    def fileno(self) -> int:
        raise AssertionError("nobody waits for a brain in this process")

    def next_due(self) -> float:
        return math.inf

    def close(self) -> None:
        """Nothing is open."""


class Frames(list[Any]):
    """A CAN bus that a radar's reader drains."""

    def drain(self) -> list[Any]:
        came = list(self)
        self.clear()
        return came

    def send(self, _frame: Any) -> None:
        """Nobody hears the host."""


class ArsRadar:
    """The newest list of an ARS408, as `esr_radar.EsrRadar` has an ESR's."""

    def __init__(self, bus: Frames) -> None:
        self.bus, self._decoder = bus, ars408.Decoder()
        self._counter, self._came, self._found = -1, -math.inf, ()

    def scan(self, now: float, speed: float) -> driving.Scan | None:
        for found in self._decoder.feed(self.bus.drain()):
            if found.counter != self._counter:
                self._counter, self._came, self._found = found.counter, now, found.objects
        if self._decoder.failed or now - self._came > 0.2:
            return None
        targets = [
            SimpleNamespace(
                range=math.hypot(one.longitudinal, one.lateral),
                azimuth=math.atan2(one.lateral, one.longitudinal),
                range_rate=math.copysign(math.hypot(one.longitudinal_speed, one.lateral_speed), one.longitudinal_speed),
            )
            for one in self._found
        ]
        return driving.Scan(now, self._came - 0.03, speed, targets)


RIGHT: Mapping[str, Callable[[list[tuple[float, float]], float], driving.Brain]] = {
    "stop_for_parked": driving.Brain,
    "stanley_idm": StanleyIdm,
    "pursuit_headway": PursuitHeadway,
}


def in_process(name: str, sense: str = "radar") -> InProcess:
    """Return a right brain, or one with a planted bug, that sees by the radar datagram or by another kind of wire."""
    kind = RIGHT.get(name) or planted_bug.BUGS[name]
    brain = kind(list(waypoints()), SPEED)
    if sense == "radar":
        return InProcess(planted_bug.answers_of(name, brain))
    look, take = _eyes(sense)
    return InProcess(driving.Answers(brain, look), take)


def _eyes(sense: str) -> tuple[Callable[[Fix, Any], driving.Scan | None], Callable[[str, Any], None]]:
    """Return what a brain sees by, and what is handed the sense's frames or packets."""
    if sense == "vlp16":
        lidar = Lidar()
        return lambda fix, _beat: lidar.scan(fix, _speed(fix)), lambda _kind, packet: lidar.take(packet)
    if sense == "v2x":
        stations, came = V2xStations(), list[bytes]()

        def known(fix: Fix, _beat: object) -> driving.Scan:
            for packet in came:
                stations.take(packet, fix.time)
            came.clear()
            return stations.scan(fix, _speed(fix))

        return known, lambda _kind, packet: came.append(packet)
    bus = Frames()
    if sense == "esr":
        radar = EsrRadar(bus)  # type: ignore[arg-type]

        def look(fix: Fix, _beat: object) -> driving.Scan | None:
            radar.listen(fix.time)
            return radar.scan(fix.time, fix.time, _speed(fix))

        return look, lambda _kind, frame: bus.append(frame)
    eye = ArsRadar(bus) if sense == "ars408" else Camera(bus)
    return lambda fix, _beat: eye.scan(fix.time, _speed(fix)), lambda _kind, frame: bus.append(frame)


def _speed(fix: Fix) -> float:
    return math.hypot(fix.velocity_north, fix.velocity_east)


@dataclass
class Car:
    """A bicycle whose wheels do not slip; its setpoints are followed by a lag."""

    x: float = 0.0
    y: float = 0.0
    heading: float = 0.0
    speed: float = 3.5
    acceleration: float = 0.0
    steering: float = 0.0
    s: float = 0.0  #: along the path
    bias: float = 0.0  #: of its steering [rad]

    def step(self, steering: float, acceleration: float) -> None:
        """Move for a tick."""
        self.acceleration += (min(max(acceleration, -6.0), 2.0) - self.acceleration) * TICK / BRAKE_LAG
        self.steering += (min(max(steering, -0.5), 0.5) - self.steering) * TICK / STEERING_LAG
        yaw_rate = self.yaw_rate
        self.x += TICK * self.speed * math.cos(self.heading + 0.5 * TICK * yaw_rate)
        self.y += TICK * self.speed * math.sin(self.heading + 0.5 * TICK * yaw_rate)
        self.heading += TICK * yaw_rate
        self.speed = max(self.speed + TICK * self.acceleration, 0.0)
        px, py, heading = place(self.s)
        self.s += math.cos(heading) * (self.x - px) + math.sin(heading) * (self.y - py)

    @property
    def yaw_rate(self) -> float:
        return self.speed * math.tan(self.steering + self.bias) / driving.WHEELBASE

    @property
    def deviation(self) -> float:
        px, py, heading = place(self.s)
        return math.cos(heading) * (self.y - py) - math.sin(heading) * (self.x - px)

    def along_the_path(self) -> float:
        """Return the steering that leads to a place ahead on the path, as the gateway's fallback path does."""
        x, y, _ = place(self.s + max(4.0, 0.6 * self.speed))
        aside = math.atan2(y - self.y, x - self.x) - self.heading
        return math.atan(2.0 * driving.WHEELBASE * math.sin(aside) / math.hypot(x - self.x, y - self.y)) - self.bias


@dataclass
class Radar:
    """Sees the rear of what stands in the way, by scans that come late and are a little wrong."""

    chance: Random
    scan: Detections = field(default_factory=lambda: _scan(-math.inf, []))
    _next: Detections | None = None

    def step(self, now: float, car: Car) -> Detections:
        if self._next is not None and now >= self._next.time + SCAN_DELAY - 1e-9:
            self.scan, self._next = self._next, None
        if self._next is None and now >= self.scan.time + SCAN_PERIOD - 1e-9:
            self._next = _scan(now, self._seen(car))
        return self.scan

    def _seen(self, car: Car) -> list[tuple[float, float, float]]:
        ox, oy, _ = place(OBSTACLE)
        cos, sin = math.cos(car.heading), math.sin(car.heading)
        dx, dy = ox - car.x - BUMPER * cos, oy - car.y - BUMPER * sin
        far, azimuth = math.hypot(dx, dy), math.atan2(cos * dy - sin * dx, cos * dx + sin * dy)
        if far > (100.0 if abs(azimuth) < 0.17 else 60.0) or abs(azimuth) > 0.78 or self.chance.random() < 0.01:
            return []
        noise = self.chance.gauss
        return [
            (far + noise(0.0, 0.1), azimuth + noise(0.0, 0.004), -car.speed * math.cos(azimuth) + noise(0.0, 0.1))
        ]  # fmt: skip


def _scan(time: float, rows: Sequence[tuple[float, float, float]]) -> Detections:
    table = np.array(rows, np.float64).reshape(-1, 3)
    return Detections(time, table[:, 0], table[:, 1], table[:, 2], np.zeros(len(table), np.int8))


def _actors(now: float) -> Actors:
    x, y, heading = place(OBSTACLE + 2.3)
    one = [np.array([value]) for value in (x, y, heading, 0.0, 4.6, 1.8, 10.0, 0.0, 1.5)]
    return Actors(now, ("parked_car",), *one, np.zeros(1, np.int8))


def _newest(now: float) -> Fix:
    unknown = math.nan
    return Fix(
        EPOCH + now, now, 0.0, 0.0, 200.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, unknown, True, FixQuality.RTK_FIXED,
        0.01, 0.02, 0.001, 1.0,
    )  # fmt: skip


def drive(
    brain: InProcess, case: Case, window: Window | None, seed: int, nominal: CaseDrive | None, kinds: Sequence[str]
) -> CaseDrive:
    """Drive a case and return its course."""
    chance = Random(f"{case.name} {seed}")
    scene = None
    if case.make_scan_fault is not None and window is not None and nominal is not None:
        (speed,) = speeds_at(nominal, [window.begins]).tolist()
        scene = Scene(track_of(nominal), window.begins, INSTALLATION, speed)
    context = Context(vehicle(), PROJECTION)
    wires = [
        FaultyWire(
            OfOtherSensor(KINDS[kind].make(context), OTHER_SENSORS[kind])
            if kind in OTHER_SENSORS
            else KINDS[kind].make(context),
            brain.outlet(kind),
            case.make_wire_fault(chance) if case.make_wire_fault and kind in case.wires else None,
            case.make_scan_fault(scene) if case.make_scan_fault and scene and kind in case.wires else None,
        )
        for kind in kinds
    ]
    link = FaultLink(wires, brain, window, lambda: True, timeout=0.0)  # type: ignore[arg-type]
    return _Drive(link, seed, [kind for kind in kinds if kind in OTHER_SENSORS]).run()


class _Drive:
    def __init__(self, link: FaultLink, seed: int, others: Sequence[str]) -> None:
        luck = Random(seed)
        self._link, self._inbox = link, SetpointInbox(EPOCH)
        self._car = Car(y=luck.gauss(0.0, 0.02), bias=luck.gauss(0.0, 0.002), speed=luck.uniform(3.0, 4.0))
        self._radar = Radar(luck)
        street = Street(map_frame=MapFrame(PROJECTION))
        self._others = {
            kind: configured(OTHER_SENSORS[kind], {}).sensor_along(street, vehicle(), np.random.default_rng(seed))
            for kind in others
        }
        self._turned = -math.inf
        self._placement = virtual_placement(MapFrame(PROJECTION), MOUNTING, EPOCH)
        self._rows: list[tuple[float, ...]] = []

    def run(self) -> CaseDrive:
        car, lost, reasons, rested, contact = self._car, False, (), 0.0, math.nan
        tick = 0
        while tick * TICK < LONGEST and rested < 0.4:
            now = tick * TICK
            gap = OBSTACLE - car.s - BUMPER
            self._rows.append((now, car.speed, gap, car.x, car.y, car.heading, car.deviation))
            self._say(tick, now)
            command = self._inbox.command(now)
            if not lost and (command is None or abs(car.deviation) > 3.0) and tick > 10:
                lost, reasons = True, ("brain_silent" if command is None else "path_deviation",)
            if lost or command is None:
                car.step(car.along_the_path(), STOP)
            else:
                car.step(command.steering, command.acceleration)
            if gap <= 0.0 and abs(car.deviation) < 1.8:
                contact = now
                break
            rested = rested + TICK if car.speed < 0.02 and tick > 100 else 0.0
            tick += 1
        return self._course("fault" if lost else "stopped", reasons, contact, rested > 0.0)

    def _say(self, tick: int, now: float) -> None:
        car = self._car
        pose = Pose(
            now, Point.REAR_AXLE, car.x, car.y, car.heading, car.speed, 0.0, car.yaw_rate, car.acceleration, 0.0
        )  # fmt: skip
        scan = self._radar.step(now, car)
        fix = virtual_fix(pose, self._placement, _newest(now))
        content = self._with_others(now, pose, SampleContent(fix, pose, scan, now - scan.time, _actors(now)))
        sample = Sample(tick + 1, EPOCH + now, now, content)
        self._inbox.sample_sent(sample.sequence)
        self._link.send(sample)
        for received, data in self._link.receive(now, True):
            self._inbox.take(received, data)

    def _with_others(self, now: float, pose: Pose, content: SampleContent) -> SampleContent:
        """Return the content with what the shipped camera, lidar and V2X receiver say."""
        for kind, sensor in self._others.items():
            sensor.step(now, pose, content.actors)
            if hasattr(sensor, "prepare"):
                sensor.prepare()
            output = sensor.output
            if isinstance(output, CameraObjects):
                content = replace(content, lists={OTHER_SENSORS[kind]: output})
            elif isinstance(output, Stations):
                content = replace(content, stations_by_receiver={OTHER_SENSORS[kind]: output})
            elif isinstance(output, PointCloud) and output.time > self._turned:
                self._turned = output.time
                content = replace(content, turns={OTHER_SENSORS[kind]: turn_of(output)})
        return content

    def _course(self, outcome: str, reasons: tuple[str, ...], contact: float, rested: bool) -> CaseDrive:
        time, speed, gap, x, y, heading, deviation = np.array(self._rows).T
        hit = math.isfinite(contact)
        ended = not hit and rested and gap[-1] < 60.0
        if rested:
            speed = speed.copy()
            speed[-1] = 0.0
        return CaseDrive(
            time, speed, gap, tuple(self._link.answers), "contact" if hit else outcome, reasons, hit,
            float(speed[-1]) if hit else math.nan, float(gap[-1]) if ended else math.nan, x, y, heading, deviation,
            contact, dict(self._inbox.counts), self._inbox.taken,
        )  # fmt: skip


def certified(
    name: str, seed: int, sense: str = "radar", cases: Sequence[Case] = CASES, change: Callable[..., Any] | None = None
) -> list[CaseResult]:
    """Return the results of a brain's certificate with a seed, as `vve_sumo.certify.run` finds them."""
    kinds = ("ncom", "radar") if sense == "radar" else ("ncom", sense, "radar")
    nominal = drive(in_process(name, sense), CASES[0], None, seed, None, kinds)
    results = [_result(CASES[0], seed, None, nominal, None)]
    if not nominal.answers:
        return results
    for case in cases:
        if case is CASES[0]:
            continue
        if why := inapplicable(case, kinds):
            results.append(CaseResult(case, seed, CaseVerdict.NOT_APPLICABLE, why))
            continue
        timing = timing_of(case, nominal, BUMPER)
        if timing.void:
            results.append(CaseResult(case, seed, CaseVerdict.VOID, timing.void))
            continue
        course = drive(in_process(name, sense), case, timing.window, seed, nominal, kinds)
        results.append(_result(case, seed, timing.window, course, nominal))
    return results


def _result(case: Case, seed: int, window: Window | None, course: CaseDrive, nominal: CaseDrive | None) -> CaseResult:
    found = judge(case, window, course, nominal, RULES)
    return CaseResult(
        case, seed, found.verdict, found.why, window, found.reaction, found.distance_left, course.impact_speed,
        course.outcome, tuple(course.reasons), found.extra_braking, found.last, drive=course,
    )  # fmt: skip

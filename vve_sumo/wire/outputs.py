"""The port of outgoing wires: each kind turns samples into datagrams, bytes or frames, by its own period.

Knows encoders; it must not know sockets, serial lines or buses. A kind is one class with `step(sample)`, found by its
name in `KINDS`. Whatever a kind sends for a sample that is not valid says that it is not, at once and at every step.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Protocol

from vve_sumo.frames import MapFrame
from vve_sumo.intersections import Intersection
from vve_sumo.pose import ncom, nmea_encoder
from vve_sumo.values import Actors, Frame, Vehicle
from vve_sumo.wire import ars408, datagrams, esr, mobileye, vlp16
from vve_sumo.wire.numbering import Numbering
from vve_sumo.wire.sample import MAX_LIST_AGE, NO_SCAN, Sample, SampleContent, no_fix
from vve_sumo.wire.scene import encode_scene
from vve_sumo.wire.senses import SenseOutput

if TYPE_CHECKING:
    from vve_sumo.sensors.port import Content, SensorSettings

#: how long a control computer may act on a radar datagram [s]
LIFETIME: Final = 0.1
#: times are compared as whole microseconds, so that 0.05 - 0.04 never decides
MICROSECONDS: Final = 1_000_000

#: how long the vehicle messages of an ESR's host count [s]: five of their periods of 20 ms, an assumption
HOST_LIFETIME: Final = 0.1

#: rays of a turn that the drive can hand to the process of the wires [1]
MAX_RAYS: Final = 100_000

#: returns the frames that others have sent on a bus since the last call, in order
ReceiveFrames = Callable[[], Sequence[Frame]]


@dataclass(frozen=True, slots=True)
class Context:
    """What the kinds need to know of a drive."""

    vehicle: Vehicle
    projection: str  #: PROJ string of the virtual road's map
    map_offset: tuple[float, float] = (0.0, 0.0)  #: what the map's coordinates have beyond the projected ones [m]
    rate_nmea: float = 10.0  #: [Hz]
    receive: ReceiveFrames | None = None  #: what others say on the wire's own bus; None where nobody is listened to
    stop_id: int | None = None  #: identifier of the stop frame
    intersections: tuple[Intersection, ...] = ()  #: of the virtual road, those with a signal
    key: bytes = b""  #: that signs this project's own datagrams; empty: they are not signed


class Output(Protocol):
    """One outgoing wire; `step` is called once a tick, in order."""

    def step(self, sample: Sample) -> Sequence[bytes] | Sequence[Frame]:
        """Return what is to be sent now, in order; nothing where nothing is due."""
        ...


class _Due:
    """Says when the next cycle of a period is due; one that turns invalid is due at once."""

    def __init__(self, period: float) -> None:
        self._period = round(period * MICROSECONDS)
        self._next = -(2**62)
        self._valid = True

    def due(self, sample: Sample) -> bool:
        """Whether a cycle begins with this sample."""
        now = round(sample.drive_time * MICROSECONDS)
        if now < self._next and sample.valid == self._valid:
            return False
        self._valid = sample.valid
        self._next = (now // self._period + 1) * self._period
        return True


class NcomOutput:
    """OXTS NCOM, one packet a tick."""

    def __init__(self, _context: Context) -> None:
        self._encoder = ncom.Encoder()

    def step(self, sample: Sample) -> Sequence[bytes]:
        """Return the packet of a sample."""
        measured = sample.measured
        return (self._encoder.encode(measured.fix if measured else no_fix(sample.time, sample.drive_time)),)


class NmeaOutput:
    """NMEA 0183 sentences, ten times a second; the date with the first of every second."""

    def __init__(self, context: Context) -> None:
        self._due = _Due(1.0 / context.rate_nmea)
        self._second = -1

    def step(self, sample: Sample) -> Sequence[bytes]:
        """Return the sentences of a sample where they are due."""
        if not self._due.due(sample):
            return ()
        measured, second = sample.measured, math.floor(round(sample.time, 3))
        dated, self._second = second != self._second, second
        fix = measured.fix if measured else no_fix(sample.time, sample.drive_time)
        return (nmea_encoder.encode(fix, dated=dated),)


class RadarOutput:
    """This project's own radar datagram, one a tick."""

    def __init__(self, _context: Context) -> None:
        self._objects = _Objects(datagrams.MAX_TARGETS)

    def step(self, sample: Sample) -> Sequence[bytes]:
        """Return the datagram of a sample."""
        measured = _with_scan(sample)
        if measured is None:
            nothing = datagrams.RadarDatagram(sample.sequence, sample.time, LIFETIME, 0.0, 0.0, 0.0, (), valid=False)
            return (datagrams.encode_radar(nothing),)
        targets = [
            datagrams.Target(one.number, one.range, one.azimuth, one.range_rate, one.mode)
            for one in self._objects.of(measured)
        ]
        made = sample.time - measured.scan_age
        pose = measured.pose
        seen = datagrams.RadarDatagram(sample.sequence, sample.time, LIFETIME, made, pose.speed, pose.yaw_rate, targets)
        return (datagrams.encode_radar(seen),)


class EsrOutput:
    """Delphi ESR tracks, a cycle every 50 ms: 64 tracks and the status frames.

    Where it hears its bus, it knows the car's motion by the host's vehicle messages alone, as the radar does. Without
    them it reports a communication error, without the order to radiate a transceiver at rest, and no track either way.
    """

    def __init__(self, context: Context) -> None:
        self._receive, self._host = context.receive, esr.Host(HOST_LIFETIME)
        self._due = _Due(esr.PERIOD)
        self._objects = _Objects(esr.TRACKS)
        self._scan_time, self._scan_index = -math.inf, -1

    def step(self, sample: Sample) -> Sequence[Frame]:
        """Return the frames of a cycle where one is due; an invalid cycle counts its scan index up, too."""
        measured = _with_scan(sample)
        if self._receive is not None:
            self._host.take(sample.drive_time, self._receive())
        if not self._due.due(sample):
            return ()
        if measured is None:
            self._scan_index += 1
            return esr.encode(esr.Cycle(self._scan_index, 0.0, esr.HostMotion(0.0, 0.0), (), valid=False))
        stamp = sample.time - measured.scan_age
        host = esr.HostMotion(measured.pose.speed, measured.pose.yaw_rate)
        radiating, host_known = True, True
        if self._receive is not None:
            motion, radiating = self._host.motion(sample.drive_time), self._host.radiates(sample.drive_time)
            host_known, host = motion is not None, motion or esr.HostMotion(0.0, 0.0)
        if not (host_known and radiating):
            self._scan_index += radiating
            return esr.encode(esr.Cycle(self._scan_index, stamp, host, (), host_known=host_known, radiating=radiating))
        if measured.scan.time != self._scan_time:
            self._scan_time, self._scan_index = measured.scan.time, self._scan_index + 1
        tracks = [self._track(one, host.speed) for one in self._objects.of(measured)]
        return esr.encode(esr.Cycle(self._scan_index, stamp, host, tracks))

    def _track(self, one: _Object, speed: float) -> esr.Track:
        return esr.Track(
            one.number,
            one.range,
            one.azimuth,
            one.range_rate,
            one.range_acceleration,
            status=esr.TrackStatus.NEW if one.new else esr.TrackStatus.UPDATED,
            mode=esr.Mode.MEDIUM_RANGE if one.mode else esr.Mode.LONG_RANGE,
            oncoming=_over_ground(one, speed) < -ONCOMING,
        )


class Ars408Output:
    """Continental ARS408 objects, a list every 75 ms."""

    def __init__(self, _context: Context) -> None:
        self._due = _Due(ars408.PERIOD)
        self._objects = _Objects(ars408.MAX_OBJECTS)
        self._counter = -1

    def step(self, sample: Sample) -> Sequence[Frame]:
        """Return the frames of a list where one is due."""
        if not self._due.due(sample):
            return ()
        self._counter += 1
        measured = _with_scan(sample)
        if measured is None:
            return ars408.encode(ars408.ObjectList(self._counter, ()), valid=False)
        speed = measured.pose.speed
        objects = tuple(self._object(one, speed) for one in self._objects.of(measured))
        return ars408.encode(ars408.ObjectList(self._counter, objects))

    def _object(self, one: _Object, speed: float) -> ars408.Object:
        over_ground = _over_ground(one, speed)
        motion = ars408.Motion.STATIONARY
        if abs(over_ground) > ONCOMING:
            motion = ars408.Motion.MOVING if over_ground > 0.0 else ars408.Motion.ONCOMING
        cos, sin = math.cos(one.azimuth), math.sin(one.azimuth)
        return ars408.Object(
            one.number,
            one.range * cos,
            one.range * sin,
            # A radar measures the radial part alone; it is laid along the line of sight.
            one.range_rate * cos,
            one.range_rate * sin,
            motion,
            measurement=ars408.Measurement.NEW if one.new else ars408.Measurement.MEASURED,
        )


#: an object faster over the ground than this moves [m/s]: an assumption, above a radar's noise
ONCOMING: Final = 1.0


@dataclass(frozen=True, slots=True)
class _Object:
    """A numbered detection."""

    number: int
    new: bool
    range: float
    azimuth: float
    range_rate: float
    range_acceleration: float
    mode: int


class _Objects:
    """The numbered detections of the newest scan, worked out once a scan."""

    def __init__(self, most: int) -> None:
        self._numbering = Numbering(most)
        self._time = math.nan
        self._numbered: list[_Object] = []

    def of(self, measured: SampleContent) -> list[_Object]:
        """Return the numbered detections of a sample's scan."""
        scan = measured.scan
        if scan.time != self._time:
            self._time = scan.time
            numbers = self._numbering.step(scan, measured.pose.yaw_rate)
            columns = (scan.range.tolist(), scan.azimuth.tolist(), scan.range_rate.tolist(), scan.mode.tolist())
            self._numbered = [
                _Object(given.number, given.new, far, aside, rate, given.range_acceleration, mode)
                for given, far, aside, rate, mode in zip(numbers, *columns, strict=True)
                if given is not None
            ]
        return self._numbered


def _over_ground(one: _Object, speed: float) -> float:
    """Return the radial speed of an object over the ground [m/s], away from the car positive."""
    return one.range_rate + speed * math.cos(one.azimuth)


def _with_scan(sample: Sample) -> SampleContent | None:
    """Return what a sample carries, where it has a scan that is not too old; else None: the radar is invalid."""
    return sample.measured if sample.radar_valid else None


class OsiOutput:
    """ASAM OSI: SensorView with ground truth, or SensorData with the radar's detections, one message a tick."""

    def __init__(self, context: Context, *, view: bool) -> None:
        from vve_sumo.wire.osi import Encoder

        self._encoder, self._view = Encoder(context.vehicle, context.projection, context.map_offset), view

    def step(self, sample: Sample) -> Sequence[bytes]:
        """Return the message of a sample; an invalid SensorView is not sent, for it has no way to say so."""
        measured = _with_scan(sample)
        if not self._view:
            scan, age = (measured.scan, measured.scan_age) if measured else (NO_SCAN, 0.0)
            message = self._encoder.sensor_data(sample.time, scan, age, valid=measured is not None)
            return (bytes(message.SerializeToString()),)
        if sample.measured is None:
            return ()
        actors: Actors = sample.measured.actors
        return (bytes(self._encoder.sensor_view(sample.time, sample.measured.pose, actors).SerializeToString()),)


class Vlp16Output:
    """A lidar's turns as the data packets of a Velodyne VLP-16, all of a turn at once; nothing while invalid."""

    def __init__(self, _context: Context) -> None:
        self._encoder = vlp16.Vlp16Encoder()

    def step(self, sample: Sample) -> Sequence[bytes]:
        """Return the packets of a sample that brings a turn."""
        measured = sample.measured
        if measured is None or measured.turn is None:
            return ()
        return self._encoder.encode(measured.turn, sample.time - sample.drive_time)


class Vlp16PositionOutput:
    """The position packets of a VLP-16 that hears the receiver, ten times a second."""

    def __init__(self, _context: Context) -> None:
        self._due = _Due(0.1)

    def step(self, sample: Sample) -> Sequence[bytes]:
        """Return the packet of a sample where one is due; while invalid its sentence says that it knows no place."""
        if not self._due.due(sample):
            return ()
        measured = sample.measured
        fix = measured.fix if measured else no_fix(sample.time, sample.drive_time)
        return (vlp16.position_packet(sample.time, nmea_encoder.encode(fix)),)


class MobileyeOutput:
    """A camera's list as a Mobileye's obstacles, once for each list; a failed camera's status while invalid."""

    def __init__(self, _context: Context) -> None:
        self._encoder = mobileye.MobileyeEncoder()
        self._listed = -math.inf

    def step(self, sample: Sample) -> Sequence[Frame]:
        """Return the frames of a sample that brings a list, or that is not valid."""
        listed = sample.measured.objects if sample.measured is not None else None
        if listed is None or sample.drive_time - listed.time > MAX_LIST_AGE:
            return self._encoder.encode(None, sample.time)
        if listed.time <= self._listed:
            return ()
        self._listed = listed.time
        return self._encoder.encode(listed, sample.time)


class V2xOutput:
    """Each message that a V2X receiver heard, as a GeoNetworking packet; nothing while invalid."""

    def __init__(self, _context: Context) -> None:
        from vve_sumo.wire.v2x import HeardEncoder

        self._encoder = HeardEncoder()

    def step(self, sample: Sample) -> Sequence[bytes]:
        """Return the packets of a sample that brings messages."""
        measured = sample.measured
        if measured is None or measured.stations is None:
            return ()
        return self._encoder.encode(measured.stations, sample.time - sample.drive_time)


class CamOutput:
    """The ego's own CAM, whenever it is due; nothing while invalid."""

    def __init__(self, context: Context) -> None:
        from vve_sumo.wire.ego_messages import EgoEncoder

        # A rehearsal of the wires, without a virtual road, has nothing to send.
        frame = MapFrame(context.projection, context.map_offset) if context.projection else None
        self._encoder = EgoEncoder(context.vehicle, frame) if frame is not None else None

    def step(self, sample: Sample) -> Sequence[bytes]:
        """Return the packet of a sample where one is due."""
        if sample.measured is None or self._encoder is None:
            return ()
        return self._encoder.encode(sample.measured, sample.time)


class DenmOutput:
    """The ego's own DENMs: of hard braking, and of standing after a stop or a fault.

    They go out also while the outputs are invalid, for they tell others why the ego stands. An ego that stands before
    the outputs were valid for the first time tells of nothing.
    """

    def __init__(self, context: Context) -> None:
        from vve_sumo.wire.ego_messages import EgoWarningEncoder

        frame = MapFrame(context.projection, context.map_offset) if context.projection else None
        self._encoder = EgoWarningEncoder(context.vehicle, frame) if frame is not None else None
        self._begun = False

    def step(self, sample: Sample) -> Sequence[bytes]:
        """Return the packets of a sample where some are due."""
        self._begun |= sample.valid
        if sample.own is None or self._encoder is None or not self._begun:
            return ()
        return self._encoder.encode(sample.own, sample.time, hazard_lights=not sample.valid)


class CpmOutput:
    """What a camera of the ego sees as CPMs, whenever one is due; nothing while invalid or while its list is old."""

    def __init__(self, context: Context) -> None:
        from vve_sumo.wire.ego_messages import PerceptionEncoder

        frame = MapFrame(context.projection, context.map_offset) if context.projection else None
        self._encoder = PerceptionEncoder(context.vehicle, frame) if frame is not None else None

    def step(self, sample: Sample) -> Sequence[bytes]:
        """Return the packet of a sample where one is due."""
        measured = sample.measured
        if measured is None or measured.objects is None or self._encoder is None:
            return ()
        age = sample.drive_time - measured.objects.time
        return self._encoder.encode(measured.objects, measured, sample.time, age) if age <= MAX_LIST_AGE else ()


class SignalsOutput:
    """What the signals near the ego show as SPATEMs, 10 Hz, and their lanes as MAPEMs, 1 Hz; nothing while invalid."""

    def __init__(self, context: Context) -> None:
        from vve_sumo.wire.roadside import RoadsideEncoder

        frame = MapFrame(context.projection, context.map_offset) if context.projection else None
        self._encoder = RoadsideEncoder(context.intersections, frame) if frame is not None else None
        self._signals, self._maps = _Due(0.1), _Due(1.0)

    def step(self, sample: Sample) -> Sequence[bytes]:
        """Return the packets of a sample where some are due."""
        measured = sample.measured
        if measured is None or self._encoder is None:
            return ()
        place = measured.pose.x, measured.pose.y, sample.time
        packets: list[bytes] = []
        if self._maps.due(sample):
            packets += self._encoder.encode_maps(*place)
        if self._signals.due(sample):
            packets += self._encoder.encode_signals(*place, measured.signals)
        return packets


class SceneOutput:
    """This project's own account of every tick, also of the invalid ones, for what shows a drive."""

    def __init__(self, _context: Context) -> None:
        pass

    def step(self, sample: Sample) -> Sequence[bytes]:
        """Return the datagram of a sample."""
        return (encode_scene(sample),)


class StopOutput:
    """A stop frame: one byte, 1, at every step at which the outputs are invalid after they were valid; else nothing."""

    def __init__(self, context: Context) -> None:
        self._frame = Frame(context.stop_id or 0, b"\x01")
        self._begun = False

    def step(self, sample: Sample) -> Sequence[Frame]:
        """Return the stop frame of a sample; none before the first valid one: nothing drives yet."""
        self._begun |= sample.valid
        return (self._frame,) if self._begun and not sample.valid else ()


class OfOtherSensor:
    """Any output, of another sensor than the one that every scenario has."""

    def __init__(self, output: Output, sensor: str) -> None:
        self._output, self._sensor = output, sensor

    def step(self, sample: Sample) -> Sequence[bytes] | Sequence[Frame]:
        """Return what the output sends of a sample with this sensor's scan in it."""
        return self._output.step(sample.seen_by(self._sensor))


def _other_channels(settings: SensorSettings) -> str:
    """Return what a VLP-16's packets cannot say of a lidar."""
    wanted = [float(elevation) for elevation in vlp16.ELEVATIONS_DEG]
    got = [*getattr(settings, "channels_deg", ())]
    return "" if got == wanted else f"channels_deg: a VLP-16 has {wanted}, got {got}"


def _too_many_rays(settings: SensorSettings) -> str:
    """Return what of a lidar is too much for the way from the drive to the process of the wires."""
    channels, step = getattr(settings, "channels_deg", ()), getattr(settings, "azimuth_step_deg", 360.0)
    rays = round(len(channels) * 360.0 / step)
    return f"a turn has {rays} rays, expected {MAX_RAYS} at most" if rays > MAX_RAYS else ""


@dataclass(frozen=True, slots=True)
class Kind:
    """A kind of outgoing wire."""

    make: Callable[[Context], Output]
    meaning: str
    needs_actors: bool = False  #: whether it needs the actors of a sample
    needs_ego: bool = False  #: whether it needs where the ego is also while the outputs are invalid
    needs_signals: bool = False  #: whether it needs what the signals show, and where their lanes are
    contents: tuple[Content, ...] = ()  #: what it carries of a sensor that serves one of these; empty: of no sensor
    signed: bool = False  #: whether its datagrams are this project's own, which a key signs
    #: what of a sensor's settings the wire cannot carry, in one phrase; empty for nothing
    refuses: Callable[[SensorSettings], str] = lambda settings: ""


KINDS: Final[Mapping[str, Kind]] = {
    "ncom": Kind(NcomOutput, "the ego at its virtual place as OXTS NCOM packets, one a tick"),
    "nmea": Kind(NmeaOutput, "the ego at its virtual place as NMEA 0183 sentences, 10 Hz"),
    "radar": Kind(
        RadarOutput,
        "the radar's newest scan as this project's own datagram, one a tick",
        contents=("detections",),
        signed=True,
    ),
    "esr": Kind(EsrOutput, "the radar as a Delphi ESR's tracks, 20 Hz", contents=("detections",)),
    "ars408": Kind(Ars408Output, "the radar as a Continental ARS408's objects, 13.3 Hz", contents=("detections",)),
    "mobileye": Kind(
        MobileyeOutput, "a camera's list as a Mobileye's obstacles, a list at a time", contents=("objects",)
    ),
    "vlp16": Kind(
        Vlp16Output,
        "a lidar's turns as a Velodyne VLP-16's data packets, a turn at a time",
        contents=("points",),
        refuses=_other_channels,
    ),
    "vlp16_position": Kind(Vlp16PositionOutput, "the position packets of a Velodyne VLP-16, 10 Hz"),
    "v2x": Kind(V2xOutput, "the messages that a V2X receiver heard as GeoNetworking packets", contents=("stations",)),
    "cam": Kind(CamOutput, "the ego's own CAM as a GeoNetworking packet, 1 to 10 Hz"),
    "denm": Kind(
        DenmOutput,
        "the ego's own DENMs in GeoNetworking packets: of hard braking, and of standing after a stop or a fault",
        needs_ego=True,
    ),
    "cpm": Kind(
        CpmOutput, "what a camera sees as the ego's CPMs in GeoNetworking packets, up to 10 Hz", contents=("objects",)
    ),
    "signals": Kind(
        SignalsOutput,
        "the signals near the ego as SPATEMs and MAPEMs in GeoNetworking packets, 10 Hz and 1 Hz",
        needs_signals=True,
    ),
    "scene": Kind(
        SceneOutput,
        "bodies, state and reasons of every tick as this project's own datagram, for the ROS 2 bridge",
        needs_actors=True,
        signed=True,
    ),
    "sense": Kind(
        lambda _: SenseOutput(),
        "what any sensor measured as this project's own datagrams, a measurement at a time, for the ROS 2 bridge",
        contents=("detections", "points", "objects", "stations", "stop_lines"),
        signed=True,
        refuses=_too_many_rays,
    ),
    "stop": Kind(StopOutput, "a frame that asks for a stop, at each tick of a drive that is invalid"),
    "osi_view": Kind(
        lambda c: OsiOutput(c, view=True),
        "ASAM OSI SensorView with ground truth, one a tick",
        needs_actors=True,
    ),
    "osi_data": Kind(
        lambda c: OsiOutput(c, view=False),
        "ASAM OSI SensorData of the radar, one a tick",
        contents=("detections",),
    ),
}

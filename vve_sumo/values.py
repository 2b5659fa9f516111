"""Defines the values that are passed between a pose and a CAN frame.

Nothing here reads or stores anything. Units are SI; angles are radians, counter-clockwise from the map's +x unless
the field says otherwise. A name carries its unit only where it is not SI.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from vve_sumo.frozen import fast_frozen
from vve_sumo.intersections import SignalPhase
from vve_sumo.path import ReferencePath

Floats = NDArray[np.float64]

#: the id of a drive's only ego
EGO: Final = "ego"


class Point(enum.StrEnum):
    """A named point of the car; a pose is always the pose of one of them."""

    OUTPUT = "output_point"  #: the point the GNSS receiver is configured to report
    REAR_AXLE = "rear_axle"  #: middle of the rear axle, on the ground
    FRONT_BUMPER = "front_bumper"  #: middle of the front bumper, on the ground
    CENTRE = "centre"  #: middle of the rectangle that the car covers


class FixQuality(enum.StrEnum):
    """How a receiver found its position, in GNSS terms; each receiver's decoder translates its own codes."""

    UNKNOWN = "unknown"  #: the receiver gives no code, or one that no manual explains
    NONE = "none"  #: the receiver has no position of its own
    SINGLE = "single"  #: code phase, no corrections
    DIFFERENTIAL = "differential"  #: code phase, with corrections
    PPP = "ppp"  #: carrier phase, with corrections of satellite orbits and clocks
    RTK_FLOAT = "RTK float"  #: carrier phase of a base station too, ambiguities not fixed
    RTK_FIXED = "RTK fixed"  #: ambiguities fixed to whole numbers


#: Mark of a 29-bit identifier beside its bits, as in DBC files and in SocketCAN; 11-bit ones lack it.
EXTENDED: Final = 0x8000_0000


class Frame(NamedTuple):
    """One classic CAN frame."""

    id: int  #: identifier: 11 bits, or 29 bits and EXTENDED
    data: bytes  #: payload, 0 to 8 bytes; its length is the DLC


def identifier_text(identifier: int) -> str:
    """Return an identifier for people: three hexadecimal digits, or eight of a 29-bit one, as candump writes them."""
    return f"0x{identifier & ~EXTENDED:08X}" if identifier & EXTENDED else f"0x{identifier:03X}"


@fast_frozen
@dataclass(frozen=True, slots=True)
class Fix:
    """One message of the receiver about its output point; NaN is "not reported" or "reported as invalid".

    The defaults are those of a source that reports no quality of its own: no car drives on such a fix.
    """

    time: float  #: epoch of the fix [s of GNSS time since 1980-01-06, no leap seconds]
    time_received: float  #: arrival on the drive's clock [s]
    latitude: float  #: WGS84 [rad]
    longitude: float  #: WGS84 [rad]
    altitude: float  #: [m]
    heading: float  #: [rad] counter-clockwise from true east, -pi to pi
    pitch: float  #: [rad] nose up positive
    roll: float  #: [rad] right side down positive
    velocity_north: float  #: [m/s]
    velocity_east: float  #: [m/s]
    velocity_down: float  #: [m/s]
    yaw_rate: float  #: [rad/s] counter-clockwise seen from above
    acceleration: float  #: [m/s2] specific force along the car's forward axis, gravity's share included
    locked: bool = False  #: the receiver's navigation is initialised and in real time
    quality: FixQuality = FixQuality.UNKNOWN  #: of the position
    position_sigma: float = math.nan  #: horizontal, 1 sigma, the larger of north and east [m]
    velocity_sigma: float = math.nan  #: horizontal, 1 sigma, the larger of north and east [m/s]
    heading_sigma: float = math.nan  #: 1 sigma [rad]
    differential_age: float = math.nan  #: age of the RTK corrections [s]


@fast_frozen
@dataclass(frozen=True, slots=True)
class Pose:
    """Where a named point of the car is in the map at a stated time, and how it moves."""

    time: float  #: drive time [s]
    point: Point  #: the point of the car whose pose this is
    x: float  #: map [m]
    y: float  #: map [m]
    heading: float  #: of the car's forward axis [rad], counter-clockwise from the map's +x
    speed: float  #: velocity of the point along the heading [m/s], forward positive
    lateral_speed: float  #: velocity of the point across the heading [m/s], left positive
    yaw_rate: float  #: [rad/s] counter-clockwise
    acceleration: float  #: rate of change of speed [m/s2]
    grade: float  #: slope of the ground along the heading [rad], uphill positive


@fast_frozen
@dataclass(frozen=True, slots=True)
class Actors:
    """All actors near the ego at one time: a column per quantity, one row per actor."""

    time: float  #: drive time [s]
    ids: tuple[str, ...]  #: names, in row order
    x: Floats  #: centre of the box, map [m]
    y: Floats  #: centre of the box, map [m]
    heading: Floats  #: [rad] counter-clockwise from the map's +x
    speed: Floats  #: along the heading [m/s]
    length: Floats  #: of the box, along the heading [m]
    width: Floats  #: of the box [m]
    radar_cross_section: Floats  #: at 77 GHz [m2]
    lateral_speed: Floats  #: of the centre across the heading [m/s], left positive: the lateral part of a lane change
    height: Floats  #: of the box, above the ground that it stands on [m]
    kind: NDArray[np.int8]  #: row of `BODY_KINDS`

    @classmethod
    def none(cls, time: float) -> Actors:
        """Return the actors at drive time `time` [s] where nobody is near."""
        return cls(time, (), *_NO_COLUMNS, np.zeros(0, np.int8))


_NO_COLUMNS: Final = (np.zeros(0),) * 9


class ActorState(NamedTuple):
    """An actor that the scenario moves, at one time; radar and contact tests see its box."""

    id: str  #: different from any other actor's
    kind: str  #: as in a scenario file: car, van, truck, bus, motorcycle, bicycle, pedestrian, child
    x: float  #: centre of the box, map [m]
    y: float  #: centre of the box, map [m]
    heading: float  #: the direction that the actor faces [rad], counter-clockwise from the map's +x
    speed: float  #: along the heading [m/s], never negative
    length: float  #: of the box, along the heading [m]
    width: float  #: of the box [m]
    lateral_speed: float = 0.0  #: across the heading, left positive [m/s]


class SignalChange(NamedTuple):
    """A traffic signal that begins to show another state, or whose plan changes."""

    time: float  #: drive time [s]
    signal: str  #: name in SUMO
    state: str  #: a letter of SUMO's for each of its links, in their order: r, y, g, G, …
    end: float = 0.0  #: drive time up to which it shows this at least [s]; 0 where nobody asked
    #: what it shows then, and for how long at least [s], as far as its program is fixed and somebody asked
    coming: tuple[tuple[str, float], ...] = ()

    def phase(self, now: float) -> SignalPhase:
        """Return what the signal shows at drive time `now` [s], up to the next change."""
        return SignalPhase(self.state, max(self.end - now, 0.0), self.coming)


@fast_frozen
@dataclass(frozen=True, slots=True)
class Detections:
    """One radar scan as a controller sees it: a column per quantity, one row per detection."""

    time: float  #: drive time of the measurement, not of the arrival [s]; -inf before the first scan
    range: Floats  #: from the middle of the front bumper to the detected point [m]
    azimuth: Floats  #: direction of the detected point from the middle of the front bumper [rad], left positive
    range_rate: Floats  #: radial velocity at the antenna [m/s], opening positive
    mode: NDArray[np.int8]  #: 0 long range, 1 medium range


@fast_frozen
@dataclass(frozen=True, slots=True)
class PointCloud:
    """One turn of a lidar as a controller sees it: what came back of F firings of C channels.

    Ranges and angles count from the lidar at the moment of the ray: the car moves on during a turn.
    """

    time: float  #: drive time of the turn's last firing [s]; -inf before the first turn
    azimuth: Floats  #: of each firing's first ray from the lidar's x axis [rad], left positive (F)
    azimuth_offset: Floats  #: of each channel's ray from that of the first [rad] (C)
    elevation: Floats  #: of each channel [rad], up positive (C)
    time_offset: Floats  #: of each firing from `time` [s], at most 0 (F)
    range: Floats  #: along the ray [m] (F by C); 0 where nothing came back
    reflectivity: NDArray[np.int8]  #: apparent, in percent of a matt white surface met squarely (F by C)

    def points(self) -> Floats:
        """Return x ahead, y left, z up [m] from the lidar of the rays that came back (n by 3), firing by firing."""
        firing, channel = np.nonzero(self.range > 0.0)
        far, azimuth = self.range[firing, channel], self.azimuth[firing] + self.azimuth_offset[channel]
        level = far * np.cos(self.elevation[channel])
        return np.stack(
            (level * np.cos(azimuth), level * np.sin(azimuth), far * np.sin(self.elevation[channel])), axis=-1
        )


@fast_frozen
@dataclass(frozen=True, slots=True)
class CameraObjects:
    """The objects in one picture of a camera as a controller sees them: a column per quantity, one row per object."""

    time: float  #: drive time of the picture, not of the arrival [s]; -inf before the first
    number: NDArray[np.int64]  #: kept while an object is followed
    kind: NDArray[np.int8]  #: row of `BODY_KINDS`
    status: NDArray[np.int8]  #: 1 standing, 2 stopped after it moved, 3 moving, 4 oncoming
    x: Floats  #: of the middle of the near side, ahead of the front bumper [m]
    y: Floats  #: of the middle of the near side, left of the car's axis [m]
    relative_speed: Floats  #: along the car's axis [m/s], opening positive
    width: Floats  #: [m]
    length: Floats  #: what is usual for the kind [m]
    lane_known: bool  #: whether the car is in a lane
    lane_left: float  #: from the camera to the left border of that lane [m]; 0 where none is known
    lane_right: float  #: from the camera to its right border [m]; 0 where none is known


@fast_frozen
@dataclass(frozen=True, slots=True)
class ReportedObjects:
    """What stations tell of others by their own sensors (CPM): the last message of each object, one row each.

    Two stations that see the same body tell of it each. Places are those of the messages' times.
    """

    sender: NDArray[np.int64]  #: ID of the station that tells of it
    number: NDArray[np.int64]  #: kept by the sender while it sees the object
    kind: NDArray[np.int8]  #: row of `BODY_KINDS`, as far as the message tells
    age: Floats  #: from the time that the message tells of to that of the output [s]
    latitude: Floats  #: WGS84 [rad]; of the body's middle
    longitude: Floats  #: WGS84 [rad], likewise
    x: Floats  #: of the middle of the body, ahead of the front bumper [m]
    y: Floats  #: of the middle of the body, left of the car's axis [m]
    heading: Floats  #: from the car's axis [rad], counter-clockwise
    true_heading: Floats  #: from true east [rad], counter-clockwise
    speed: Floats  #: over the ground along the heading [m/s]
    length: Floats  #: [m]
    width: Floats  #: [m]
    uncertainty: Floats  #: radius in which the place is with 95 %, the sender's own place included [m]
    sender_latitude: Floats  #: WGS84 [rad]; of the middle of the sender's front, as its message has it
    sender_longitude: Floats  #: WGS84 [rad], likewise
    sender_heading: Floats  #: from true east [rad], counter-clockwise


@fast_frozen
@dataclass(frozen=True, slots=True)
class RoadEvents:
    """What stations have warned of (DENM): the last message of each event that still holds, one row each."""

    sender: NDArray[np.int64]  #: ID of the station that warns
    number: NDArray[np.int64]  #: of the event at its sender
    cause: NDArray[np.int64]  #: 94 stationary vehicle, 99 dangerous situation; 0 for an event that has ended
    sub_cause: NDArray[np.int64]  #: by the cause; 0 unknown
    ended: NDArray[np.int8]  #: 1 for an event that its sender has called off
    kind: NDArray[np.int8]  #: row of `BODY_KINDS`: of the sender
    age: Floats  #: from the time that the message tells of to that of the output [s]
    detected: Floats  #: from the event's detection to that of the output [s]
    validity: Floats  #: for which the event holds after its detection [s]
    latitude: Floats  #: WGS84 [rad]; of the event
    longitude: Floats  #: WGS84 [rad], likewise
    x: Floats  #: of the event, ahead of the front bumper [m]
    y: Floats  #: of the event, left of the car's axis [m]
    heading: Floats  #: of the event from the car's axis [rad], counter-clockwise; 0 for one that has ended
    true_heading: Floats  #: of the event from true east [rad], counter-clockwise; 0 for one that has ended
    speed: Floats  #: of the event [m/s]
    uncertainty: Floats  #: radius in which the event is with 95 % [m]


@fast_frozen
@dataclass(frozen=True, slots=True)
class Stations:
    """What a V2X receiver knows of others as a controller sees it: the last message of every station, one row each.

    Places are those that the messages tell of: a station has moved on since, for its row's `age`. What stations tell of
    others, and what they warn of, stands in tables of its own.
    """

    time: float  #: drive time of the output [s]; -inf before the first
    number: NDArray[np.int64]  #: ID of the station
    message: NDArray[np.int8]  #: 2 a CAM, of a vehicle; 16 a VAM, of a person or a cyclist
    kind: NDArray[np.int8]  #: row of `BODY_KINDS`, as far as the message tells
    age: Floats  #: from the time that the message tells of to `time` [s]
    latitude: Floats  #: WGS84 [rad]; in a CAM of the middle of the front, in a VAM of the body's middle
    longitude: Floats  #: WGS84 [rad], likewise
    x: Floats  #: of the middle of the body, ahead of the front bumper at `time` [m]
    y: Floats  #: of the middle of the body, left of the car's axis at `time` [m]
    heading: Floats  #: from the car's axis at `time` [rad], counter-clockwise
    true_heading: Floats  #: from true east [rad], counter-clockwise
    speed: Floats  #: over the ground along the heading [m/s]
    yaw_rate: Floats  #: [rad/s], counter-clockwise; 0 where the message has none
    acceleration: Floats  #: along the heading [m/s2]; 0 where the message has none
    length: Floats  #: [m]; what is usual for the kind where the message has none
    width: Floats  #: [m]; what is usual for the kind where the message has none
    uncertainty: Floats  #: radius in which the place is with 95 %, as the message has it [m]
    objects: ReportedObjects | None = None  #: that stations perceive; None where no station tells of any
    events: RoadEvents | None = None  #: that stations have warned of; None where no station warns


@fast_frozen
@dataclass(frozen=True, slots=True)
class StopLines:
    """The stop lines that a controller knows of, with what is shown there: one row for each way across a junction.

    Places count from where the car is at `time`. A line from which ways lead to several lanes has a row for each.
    """

    time: float  #: drive time of the output [s]; -inf before the first
    intersection: NDArray[np.int64]  #: number of the junction with the signal
    group: NDArray[np.int64]  #: number of what is shown for this way at its junction; 0 unknown
    x: Floats  #: of the line's middle, ahead of the front bumper [m]
    y: Floats  #: of the line's middle, left of the car's axis [m]
    heading: Floats  #: of the lane at the line from the car's axis [rad], counter-clockwise
    width: Floats  #: of the lane [m]
    exit_x: Floats  #: of where the way leads: begin of the lane beyond, ahead of the front bumper [m]
    exit_y: Floats  #: as exit_x, left of the car's axis [m]
    #: 0 unknown, 1 dark, 2 stop and go on, 3 red, 4 red and yellow, 5 green (others may have the right of way),
    #: 6 green (nobody else may go), 7 and 8 yellow after them, 9 flashing yellow (J2735 MovementPhaseState)
    phase: NDArray[np.int8]
    age: Floats  #: from when that was shown to `time` [s]
    remaining: Floats  #: from `time`, for which it is shown at least [s]; 0 where nothing is known
    green_begin: Floats  #: from `time` to when the next green begins at the earliest [s]; 0 where nothing is known
    green_end: Floats  #: from `time` to when that green ends at the earliest [s]; 0 where nothing is known


@fast_frozen
@dataclass(frozen=True, slots=True)
class RightOfWay:
    """The ways across the junctions around the car, and which of them go first: one row for each way.

    Places are those of the map, as the path's are. A way's points begin on the lanes before the junction.
    """

    time: float  #: drive time of the output [s]; -inf before the first
    junction: NDArray[np.int64]  #: number of the junction (W)
    #: what tells the way to give way: 0 nothing, 1 minor road or turn across oncoming traffic, 2 stop sign, 3 stop sign
    #: as everybody else has, 4 equal roads, 5 signal, at whose green others may go first (W)
    control: NDArray[np.int8]
    width: Floats  #: of the lane before the junction [m] (W)
    speed_limit: Floats  #: on the lanes before it, the greatest [m/s] (W)
    speed_across: Floats  #: allowed inside the junction, the least [m/s] (W)
    line: Floats  #: of the end of the lane before it, at its stop line, along the points [m] (W)
    exit: Floats  #: of the begin of the lane after it, along the points [m] (W)
    ends: NDArray[np.bool_]  #: whether nobody comes from beyond the first point (W)
    first: NDArray[np.int64]  #: row of the way's first point; the last number is that of all points (W + 1)
    x: Floats  #: of the points, map [m] (P)
    y: Floats  #: of the points, map [m] (P)
    own: NDArray[np.int64]  #: row of a way that has to give way ... (C)
    prior: NDArray[np.int64]  #: ... and of one that goes first (C)


#: first-order time constant from throttle to drive force, assumed for a car without calibration [s]
DRIVE_LAG: Final = 0.25


@dataclass(frozen=True, slots=True)
class Vehicle:
    """The declared properties of the car: geometry, inertia, limits and lags."""

    length: float  #: bumper to bumper [m]
    width: float  #: without mirrors [m]
    wheelbase: float  #: [m]
    front_overhang: float  #: front axle to front bumper [m]
    mass: float  #: with occupants [kg]
    yaw_inertia: float  #: about the centre of mass [kg m2]
    front_axle_to_mass: float  #: front axle to centre of mass [m]
    cornering_stiffness_front: float  #: whole axle [N/rad]
    cornering_stiffness_rear: float  #: whole axle [N/rad]
    wheel_radius: float  #: rolling [m]
    steering_ratio: float  #: steering-wheel angle over road-wheel angle
    steering_limit: float  #: road-wheel angle [rad]
    steering_rate_limit: float  #: road-wheel angle rate [rad/s]
    steering_delay: float  #: dead time from frame to first movement [s]
    steering_lag: float  #: first-order time constant after the dead time [s]
    brake_delay: float  #: dead time from frame to first torque [s]
    brake_lag: float  #: first-order time constant after the dead time [s]
    brake_torque_limit: float  #: all wheels together [N m]
    deceleration_limit: float  #: that car, brakes, wire, gateway and tyres allow, laden, on the level [m/s2]

    @property
    def rear_axle_to_bumper(self) -> float:
        """Distance from the rear axle forward to the front bumper [m]."""
        return self.wheelbase + self.front_overhang

    @property
    def rear_overhang(self) -> float:
        """Distance from the rear axle back to the rear bumper [m]."""
        return self.length - self.wheelbase - self.front_overhang

    @property
    def tightest_curvature(self) -> float:
        """Curvature of the rear axle's circle at the steering limit, at low speed [1/m]."""
        return math.tan(self.steering_limit) / self.wheelbase

    @property
    def understeer_gradient(self) -> float:
        """Extra road-wheel angle for each m/s2 of lateral acceleration on a steady circle [rad s2/m]."""
        rear = self.wheelbase - self.front_axle_to_mass
        return (self.mass / self.wheelbase) * (
            rear / self.cornering_stiffness_front - self.front_axle_to_mass / self.cornering_stiffness_rear
        )


class SensorOutput(Protocol):
    """A sensor's output for a controller: arrays, one column per quantity, all measured at one time."""

    @property
    def time(self) -> float:
        """Drive time of the measurement [s]; -inf before the first measurement."""
        ...


def newest_scan(sensors: Mapping[str, SensorOutput]) -> Detections:
    """Return the newest scan of the sensor that is named "radar"."""
    scan = sensors["radar"]
    assert isinstance(scan, Detections)
    return scan


@fast_frozen
@dataclass(frozen=True, slots=True)
class Observation:
    """All that a controller may know at one tick."""

    tick: int  #: number of the tick
    time: float  #: drive time of the tick [s]
    pose: Pose  #: of the rear axle, predicted to this time
    path: ReferencePath  #: of the rear axle, the same object for the whole drive
    desired_speed: float  #: speed to keep where nothing requires a lower one [m/s]
    sensors: Mapping[str, SensorOutput]  #: the newest output of every sensor, by the sensor's name
    steering: float  #: road-wheel angle that the car reports [rad], left positive; NaN not reported

    @property
    def radar(self) -> Detections:
        """The newest scan of the sensor that is named "radar", with the time of its measurement."""
        return newest_scan(self.sensors)


@dataclass(frozen=True, slots=True)
class FallbackPath:
    """The fallback path to rest: the curvature that the rear axle shall follow from its pose in the setpoint."""

    spacing: float  #: distance from one knot to the next along the rear axle's path [m], positive
    curvature: tuple[float, ...]  #: at distance 0, spacing, 2 spacing, … [1/m], left positive; linear in between


class DeferredFallbackPath:
    """A fallback path that is computed when a stop needs it.

    Only for a gateway in the same process as the tick: a gateway that outlives the tick must have the path before.
    """

    __slots__ = ("_compute", "_path")

    def __init__(self, compute: Callable[[], FallbackPath | None]) -> None:
        """`compute` returns the path, None where there is no smooth one; it is called once at most."""
        self._compute: Callable[[], FallbackPath | None] | None = compute
        self._path: FallbackPath | None = None

    def path(self) -> FallbackPath | None:
        """Return the path, None where there is no smooth one; the first call computes it."""
        if self._compute is not None:
            self._path, self._compute = self._compute(), None
        return self._path


def resolve_fallback_path(fallback_path: FallbackPath | DeferredFallbackPath | None) -> FallbackPath | None:
    """Return a fallback path, now computed where it was deferred; None where there is none."""
    return fallback_path.path() if isinstance(fallback_path, DeferredFallbackPath) else fallback_path


@fast_frozen
@dataclass(frozen=True, slots=True)
class CommandedPath:
    """The path that a controller means to drive from here: 2 to 100 points of the rear axle, in driving order.

    `vve_sumo.commanded_path` says what is checked of it. Any sequences of numbers will do; a checked one holds tuples.
    """

    x: tuple[float, ...]  #: of the rear axle, map [m]; the first point is where the car is
    y: tuple[float, ...]  #: as x [m]
    speed: tuple[float, ...]  #: that the controller means to have at each point [m/s], not negative


@fast_frozen
@dataclass(frozen=True, slots=True)
class ControlCommand:
    """A controller's request for the car; the tick stamps it into a Setpoint."""

    steering: float  #: road-wheel angle [rad], left positive
    acceleration: float  #: along the heading [m/s2], braking negative
    emergency: bool = False  #: asks for the emergency envelope instead of the comfort one
    note: str = ""  #: the controller's reason, for the record
    #: the path that the controller means to drive from here; None: the scenario's path
    path: CommandedPath | None = None


@fast_frozen
@dataclass(frozen=True, slots=True)
class Setpoint:
    """A control command, stamped by the tick for the gateway.

    No field has a default, so that a setpoint with a missing field cannot be sent.
    """

    steering: float  #: of the control command: road-wheel angle [rad], left positive
    acceleration: float  #: of the control command: along the heading [m/s2], braking negative
    emergency: bool  #: of the control command: asks for the emergency envelope instead of the comfort one
    note: str  #: of the control command: the controller's reason, for the record
    sequence: int  #: counts up by one a setpoint; the gateway refuses a negative one
    time: float  #: drive time it was computed for [s]
    expires: float  #: drive time after which it must not be acted on [s]
    x: float  #: of the rear axle at `time`, map [m]; this and the next four for the plausibility checks
    y: float  #: as x [m]
    heading: float  #: at `time` [rad], counter-clockwise from the map's +x
    speed: float  #: GNSS speed of the rear axle [m/s]
    yaw_rate: float  #: GNSS yaw rate [rad/s]
    grade: float  #: slope along the heading [rad], uphill positive, to be fed forward
    faults: tuple[str, ...]  #: reason codes that the drive found; any of them asks for a stop
    #: the fallback path, checked to lie inside the lot; None where there is none
    fallback_path: FallbackPath | DeferredFallbackPath | None


class ArmingState(enum.StrEnum):
    """The gateway's state, from no command at all to the car at rest again."""

    DISARMED = "disarmed"
    READY = "ready"
    ENGAGED = "engaged"
    STOPPING = "stopping"
    STOPPED = "stopped"
    FAULT = "fault"


@fast_frozen
@dataclass(frozen=True, slots=True)
class GatewayStatus:
    """The gateway's state and output after a step."""

    state: ArmingState  #: after this step
    reasons: tuple[str, ...]  #: reason codes: why not ready, why stopping, why faulted
    steering: float  #: road-wheel angle granted [rad], left positive
    acceleration: float  #: granted [m/s2]
    limited: tuple[str, ...]  #: names of the limits that changed the setpoint
    brake_torque: float  #: commanded [N m]
    throttle: float  #: commanded, 0 to 1

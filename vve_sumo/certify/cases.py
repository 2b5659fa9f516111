"""The cases of a certificate: what is injected, when, which reaction is required within which time, and why.

Data alone: a case names its fault by a function that makes it; nothing here drives or judges.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from random import Random
from typing import Final, NamedTuple

from vve_sumo.certify.phantoms import Installation, MissedDetections, Phantom, Phantoms, ScanFault
from vve_sumo.certify.track import DrivenTrack
from vve_sumo.errors import ConfigError, did_you_mean
from vve_sumo.wire import ars408, esr, faults, mobileye
from vve_sumo.wire.faults import WireFault

#: kinds of wires by the sensor that they carry
GNSS: Final = ("ncom", "nmea")
RADAR: Final = ("radar", "esr", "ars408", "osi_data")
#: kinds with data on road users that never fall silent, except the radar datagram, which every setpoint answers
SENSORS: Final = ("esr", "ars408", "osi_data", "osi_view", "mobileye", "vlp16")
#: kinds with data on road users; a V2X receiver that hears nobody is silent
STREET: Final = ("radar", *SENSORS, "v2x")


class FaultMoment(enum.StrEnum):
    """When a fault begins, relative to the brain's nominal drive with the same seed."""

    CRUISE = "cruise"  #: 5 s before the brain began to brake to rest, on a straight part of the path
    APPROACH = "approach"  #: a second before it
    BRAKING = "braking"  #: a second after it
    BEND = "bend"  #: where the path bends so much that its mirror image at the car's axis is off the path


#: preferred begin of a fault, relative to the onset of the braking that ends in rest [s]
LEADS: Final = {FaultMoment.CRUISE: -5.0, FaultMoment.APPROACH: -1.0, FaultMoment.BRAKING: 1.0}


class Reaction(enum.StrEnum):
    """What is required of a brain."""

    DRIVE = "drive the scenario"  #: it stops before the obstacle, within the limits
    CARRY_ON = "carry on"  #: as DRIVE, as if there were no fault
    IGNORE = "carry on and do not brake for it"  #: as DRIVE, braking by less than BRAKING_DEMAND beyond nominal
    EASE = "brake gently or not"  #: as DRIVE, braking by less than HARD_BRAKING beyond nominal
    STOP = "stop"  #: no answer, or braking, from then on to rest; no contact
    BRAKE = "brake"  #: setpoints that brake by BRAKING_DEMAND or more; no contact
    HOLD = "keep the distance"  #: no contact and `min_left_m` left, by whatever reaction


#: reactions that show only where the nominal drive does not brake by itself
UNBRAKED: Final = (Reaction.STOP, Reaction.BRAKE, Reaction.IGNORE, Reaction.EASE)
#: reactions after which the drive ends as without a fault
UNDISTURBED: Final = (Reaction.DRIVE, Reaction.CARRY_ON, Reaction.IGNORE, Reaction.EASE)

#: an answer that asks for this or less is braking [m/s2]; a car that rolls out does about half of it
SAFE_DEMAND: Final = -0.5
#: of `Reaction.BRAKE` [m/s2]: a brain that keeps its speed demands less
BRAKING_DEMAND: Final = -1.0
#: of `Reaction.EASE` [m/s2]: ten times the braking that its target requires
HARD_BRAKING: Final = -2.2
#: a standing target appears where stopping STANDOFF [m] before it takes GHOST_DEMAND [m/s2]
STANDOFF, GHOST_DEMAND = 5.0, 2.5
#: lateral distance from the path to the nearest corner of a car in the next lane [m]: lanes of 3.5 m, a car of 1.8 m
NEXT_LANE_OFFSET: Final = 2.6
#: speed of a slower target over the car's: 1 - 1 / 3.6, so that its range rate in km/h is that of a standing one
SLOWER: Final = 1.0 - 1.0 / 3.6


class Scene(NamedTuple):
    """The nominal drive at the begin of a fault, from which a scan fault is made."""

    track: DrivenTrack  #: of the nominal drive
    begins: float  #: begin of the fault [s of drive time]
    installation: Installation
    speed: float  #: of the nominal drive then [m/s]


@dataclass(frozen=True, slots=True)
class Case:
    """One case of a certificate."""

    name: str
    injected: str  #: in words
    wires: tuple[str, ...]  #: kinds of the affected wires; the case does not apply to a rig without any
    begins: FaultMoment
    lasts: float  #: [s]; inf: until the drive ends
    reaction: Reaction
    within: float  #: time for the reaction [s]; inf where none is measured
    why: str  #: of the reaction and its time
    make_wire_fault: Callable[[Random], WireFault] | None = None  #: of each wire's bytes; None: no such fault
    make_scan_fault: Callable[[Scene], ScanFault] | None = None  #: of the sensors' data; None: no such fault
    needs: tuple[str, ...] = ()  #: kinds of wires of which the rig must have one as well

    @property
    def injects(self) -> bool:
        """Whether there is a fault at all."""
        return self.make_wire_fault is not None or self.make_scan_fault is not None


def ghost_distance(speed: float) -> float:
    """Return the distance of a standing target [m]: stopping STANDOFF before it from `speed` [m/s] takes
    GHOST_DEMAND.
    """
    return STANDOFF + speed**2 / (2.0 * GHOST_DEMAND)


def _edited(edit: faults.RadarEdit) -> Callable[[Random], WireFault]:
    return lambda _rng: faults.EditedRadar(edit)


def _showing(*phantoms: Callable[[Scene], Phantom]) -> Callable[[Scene], ScanFault]:
    return lambda scene: Phantoms(scene.track, scene.begins, scene.installation, [one(scene) for one in phantoms])


def _ghost(pace: float = 0.0, mirrored: bool = False) -> Callable[[Scene], ScanFault]:
    """Return a scan fault: a target on the path, `pace` times as fast as the car, or its mirror image."""
    return _showing(
        lambda scene: Phantom(ghost_distance(scene.speed), speed=pace * scene.speed, mirrored=mirrored),
    )


def _passing(d: float, ahead: float, pace: float) -> Callable[[Scene], ScanFault]:
    return _showing(lambda scene: Phantom(ahead, d, pace * scene.speed))


def _parked_rows(scene: Scene) -> ScanFault:
    """Return a scan fault: parked cars on both sides of the path."""
    phantoms = [
        Phantom(float(ahead), side) for ahead in range(6, 36, 6) for side in (-NEXT_LANE_OFFSET, NEXT_LANE_OFFSET)
    ]
    return Phantoms(scene.track, scene.begins, scene.installation, phantoms)


_TO_END: Final = (FaultMoment.APPROACH, math.inf)
_NO_TIME: Final = math.inf
_SILENT_AT_ONCE: Final = (Reaction.STOP, 0.1)
_LIFETIME: Final = "No setpoint may be acted on for longer than its lifetime, 0.1 s at most; the gateway then stops."


def _case(
    name: str,
    injected: str,
    wires: tuple[str, ...],
    made: Callable[[Random], WireFault] | None,
    when: tuple[FaultMoment, float],
    required: tuple[Reaction, float],
    why: str,
    needs: tuple[str, ...] = (),
) -> Case:
    return Case(name, injected, wires, *when, *required, why, make_wire_fault=made, needs=needs)


def _shown(
    name: str,
    injected: str,
    make_scan_fault: Callable[[Scene], ScanFault],
    when: tuple[FaultMoment, float],
    required: tuple[Reaction, float],
    why: str,
) -> Case:
    return Case(name, injected, STREET, *when, *required, why, make_scan_fault=make_scan_fault)


CASES: Final[tuple[Case, ...]] = (
    _case(
        "nominal", "nothing", (), None, (FaultMoment.CRUISE, 0.0), (Reaction.DRIVE, _NO_TIME),
        "A brain that fails the scenario without a fault cannot be judged in the other cases.",
    ),
    _case(
        "radar_drop_out", "nothing arrives from the radar any more", RADAR, lambda _: faults.DropOut(),
        _TO_END, _SILENT_AT_ONCE, _LIFETIME,
    ),
    _case(
        "radar_gap", "nothing arrives from the radar for two ticks", RADAR, lambda _: faults.DropOut(),
        (FaultMoment.BRAKING, 0.04), (Reaction.CARRY_ON, _NO_TIME),
        "Two ticks are shorter than the lifetime of 0.1 s; networks lose as much in normal operation.",
    ),
    _case(
        "radar_freeze", "the radar's last bytes arrive again and again", RADAR, lambda _: faults.Freeze(),
        _TO_END, (Reaction.STOP, 0.2), "The sequence does not count. " + _LIFETIME + " Noticing takes as long again.",
    ),
    _case(
        "radar_delay", "the radar arrives 0.3 s late", RADAR, lambda _: faults.Delay(0.3),
        _TO_END, (Reaction.STOP, 0.5),
        "The lifetime of 0.1 s counts from the time of validity. For 0.3 s nothing arrives, then what has outlived it.",
        needs=GNSS,
    ),
    _case(
        "radar_delay_short", "the radar arrives 40 ms late", RADAR, lambda _: faults.Delay(0.04),
        _TO_END, (Reaction.HOLD, _NO_TIME),
        "Within the lifetime a brain may drive on if it compensates the age: 40 ms are 0.45 m at 11.2 m/s.",
    ),
    _case(
        "radar_ageing", "scan and time of measurement freeze while sequence and time count on", ("radar",),
        _edited(faults.aged), _TO_END, (Reaction.STOP, 0.5),
        "A radar shows no scan that is older than 0.3 s; 0.2 s more are 2.2 m at 11.2 m/s, less than a stop leaves.",
    ),
    _case(
        "radar_bit_flips", "one bit of every radar message is wrong", ("radar",), faults.BitFlips,
        _TO_END, _SILENT_AT_ONCE, "The CRC finds every one: it is as if nothing arrived. " + _LIFETIME,
    ),
    _case(
        "radar_bit_flips_some", "one bit of every fifth radar message is wrong", ("radar",),
        lambda rng: faults.BitFlips(rng, 5), (FaultMoment.CRUISE, math.inf), (Reaction.CARRY_ON, _NO_TIME),
        "Four of five messages are good, and no gap is longer than the lifetime.",
    ),
    _shown(
        "target_ghost", "a target stands on the path for 1 s; stopping 5 m before it takes 2.5 m/s²", _ghost(),
        (FaultMoment.CRUISE, 1.0), (Reaction.BRAKE, 0.4),
        "The brain cannot tell a ghost target from a car. At 11.2 m/s it is 30 m away; 0.4 s later it takes 3.1 m/s².",
    ),
    _shown(
        "target_ghost_receding", "a target at the same distance drives away twice as fast as the car, for 1 s",
        _ghost(2.0), (FaultMoment.CRUISE, 1.0), (Reaction.IGNORE, _NO_TIME),
        "Its range rate is positive: the distance grows, so braking is not needed.",
    ),
    _shown(
        "target_ghost_slower", "a target at the same distance drives ahead at 0.72 of the car's speed, for 1 s",
        _ghost(SLOWER), (FaultMoment.CRUISE, 1.0), (Reaction.EASE, _NO_TIME),
        "At 11.2 m/s it approaches at 3.1 m/s: keeping 5 m takes 0.2 m/s². Hard braking risks a rear-end collision.",
    ),
    _shown(
        "target_bend_in_way", "in a bend, a target stands on the path for 1 s; to stop 5 m before it takes 2.5 m/s²",
        _ghost(), (FaultMoment.BEND, 1.0), (Reaction.BRAKE, 0.4),
        "As the ghost on the straight. It lies on the side of the car's axis to which the path bends: with the wrong "
        "sign of the azimuth it seems to be beside the path.",
    ),
    _shown(
        "target_bend_mirrored", "in a bend, a target stands at the mirror image of that place, for 1 s",
        _ghost(mirrored=True), (FaultMoment.BEND, 1.0), (Reaction.IGNORE, _NO_TIME),
        "It stands 4 m or more beside the path: it seems to be on the path only with the wrong sign of the azimuth.",
    ),
    _shown(
        "target_rows_beside", "parked cars stand on both sides of the path, 2.6 m from it, for 2 s", _parked_rows,
        (FaultMoment.CRUISE, 2.0), (Reaction.IGNORE, _NO_TIME),
        "A street is lined with parked cars. A brain that takes degrees for radians, or the "
        "nearest target at any azimuth, brakes for them.",
    ),
    _shown(
        "target_passing_left", "a car passes on the left at 1.5 times the car's speed, 2.6 m from the path, for 2 s",
        _passing(NEXT_LANE_OFFSET, 1.0, 1.5), (FaultMoment.CRUISE, 2.0), (Reaction.IGNORE, _NO_TIME),
        "It is in the next lane and drives away.",
    ),
    _shown(
        "target_passing_right", "a car at half the car's speed is passed on the right, 2.6 m from the path, for 2 s",
        _passing(-NEXT_LANE_OFFSET, 12.0, 0.5), (FaultMoment.CRUISE, 2.0), (Reaction.IGNORE, _NO_TIME),
        "It stays in the next lane: that the distance shrinks requires no braking.",
    ),
    _shown(
        "target_missing", "every target is missing from what the sensors say for 0.5 s",
        lambda scene: MissedDetections(scene.installation),
        (FaultMoment.BRAKING, 0.5), (Reaction.HOLD, _NO_TIME),
        "Sensors lose targets for some scans. 2 m/s² less of braking for half a second costs less than 1 m in the end.",
    ),
    _case(
        "sensor_drop_out", "nothing arrives from the sensor any more; the radar datagrams arrive", SENSORS,
        lambda _: faults.DropOut(), _TO_END, (Reaction.STOP, 0.5),
        "A dead bus is silent. The slowest, a lidar or a camera of 10 Hz, is dead after five cycles without one.",
    ),
    _case(
        "sensor_freeze", "the sensor's last cycle arrives again and again; the radar datagrams arrive", SENSORS,
        lambda _: faults.Freeze(), _TO_END, (Reaction.STOP, 0.5),
        "Scan index, measurement counter, time stamp or time of measurement freeze: as a drop-out.",
    ),
    _case(
        "esr_error", "the ESR reports an internal error, while its tracks look good", ("esr",),
        lambda _: faults.Rewritten(esr.with_internal_error), _TO_END, (Reaction.STOP, 0.5),
        "A radar that reports an error gives no valid track.",
    ),
    _case(
        "ars408_error", "the ARS408 reports a persistent error, while its objects look good", ("ars408",),
        lambda _: faults.Rewritten(ars408.with_persistent_error), _TO_END, (Reaction.STOP, 0.5),
        "A radar that reports an error gives no valid object.",
    ),
    _case(
        "camera_error", "the camera reports that it has failed, while its obstacles look good", ("mobileye",),
        lambda _: faults.Rewritten(mobileye.with_failure), _TO_END, (Reaction.STOP, 0.5),
        "A camera that reports a failure lists no valid obstacle.",
    ),
    _case(
        "camera_delay", "the camera's list arrives 0.1 s late", ("mobileye",), lambda _: faults.Delay(0.1),
        _TO_END, (Reaction.HOLD, _NO_TIME),
        "A list does not say when its picture was taken: a brain has to leave room for it. 0.1 s is 1.1 m at 11.2 m/s.",
    ),
    _case(
        "lidar_delay", "the lidar's packets arrive 0.5 s late", ("vlp16",), lambda _: faults.Delay(0.5),
        _TO_END, (Reaction.STOP, 0.7),
        "A packet carries its time. For 0.5 s nothing arrives, then returns that are 5.6 m too far at 11.2 m/s.",
    ),
    _case(
        "v2x_delay", "the messages of other stations arrive 1 s late", ("v2x",), lambda _: faults.Delay(1.0),
        _TO_END, (Reaction.HOLD, _NO_TIME),
        "A message carries its time and its sender's place on the map: who stands is where the message says.",
    ),
    _case(
        "v2x_freeze", "the last messages of other stations arrive again and again", ("v2x",), lambda _: faults.Freeze(),
        _TO_END, (Reaction.HOLD, _NO_TIME),
        "No message says that a station has left: the brain may drive by its last place or stop, but not forget it.",
    ),
    _case(
        "radar_counter", "the sequence does not count while the rest of the datagram is new", ("radar",),
        _edited(faults.counter_stopped), _TO_END, (Reaction.STOP, 0.2),
        "A datagram whose sequence is not newer is to be refused: the sender may be stuck. " + _LIFETIME,
    ),
    _case(
        "radar_invalid", "every radar datagram is marked invalid, while its contents look good", ("radar",),
        _edited(faults.marked_invalid), _TO_END, _SILENT_AT_ONCE,
        "Data marked as invalid must not be used at all. " + _LIFETIME,
    ),
    _case(
        "radar_not_a_number", "every radar datagram is marked valid, while a range is NaN", ("radar",),
        _edited(faults.not_a_number), _TO_END, _SILENT_AT_ONCE,
        "A comparison with NaN is never true: the brain would never brake for that target.",
    ),
    _case(
        "gnss_drop_out", "nothing arrives from the receiver any more", GNSS, lambda _: faults.DropOut(),
        _TO_END, (Reaction.STOP, 0.3),
        "A brain may bridge a few packets by odometry; a yaw rate error of 2 °/s is 6 cm of lateral error in 0.3 s.",
    ),
    _case(
        "gnss_freeze", "the receiver's last bytes arrive again and again", GNSS, lambda _: faults.Freeze(),
        _TO_END, (Reaction.STOP, 0.3), "The receiver's time freezes: as a drop-out.",
    ),
    _case(
        "gnss_delay", "the receiver arrives 0.3 s late", GNSS, lambda _: faults.Delay(0.3),
        _TO_END, (Reaction.STOP, 0.5),
        "A fix carries its time. For 0.3 s nothing arrives, then positions that are 3.4 m behind at 11.2 m/s.",
    ),
    _case(
        "gnss_bit_flips", "one bit of every packet of the receiver is wrong", ("ncom",), faults.BitFlips,
        _TO_END, (Reaction.STOP, 0.3), "NCOM's checksums find every wrong byte: as a drop-out.",
    ),
    _case(
        "gnss_bit_flips_some", "one bit of every fifth packet of the receiver is wrong", ("ncom",),
        lambda rng: faults.BitFlips(rng, 5), (FaultMoment.CRUISE, math.inf), (Reaction.CARRY_ON, _NO_TIME),
        "Four of five packets are good; a fix that is one tick old is 0.22 m behind at 11.2 m/s.",
    ),
    _case(
        "gnss_invalid", "every packet reports that the unit is not locked, while its contents look good", ("ncom",),
        lambda _: faults.UnlockedNcom(), _TO_END, (Reaction.STOP, 0.3),
        "The receiver declares the position invalid: as a drop-out.",
    ),
    _case(
        "nmea_invalid", "GGA says quality 0 and RMC status V, while position and speed look good", ("nmea",),
        lambda _: faults.Rewritten(faults.nmea_without_fix), _TO_END, (Reaction.STOP, 0.3),
        "The receiver declares the position invalid: as a drop-out.",
    ),
    _case(
        "both_freeze", "the last bytes of all wires arrive again and again", (*GNSS, *RADAR),
        lambda _: faults.Freeze(), _TO_END, (Reaction.STOP, 0.2),
        "The computer before the brain hangs: fix and radar agree with each other, only the sequence does not count.",
    ),
)  # fmt: skip

NAMES: Final = tuple(case.name for case in CASES)
NOMINAL: Final = CASES[0].name
CASE_BY_NAME: Final[Mapping[str, Case]] = {case.name: case for case in CASES}


def select_cases(names: Iterable[str], without: Iterable[str] = ()) -> tuple[Case, ...]:
    """Return the cases with these names, or all where no name is given, without those left out, in the table's order.

    The nominal case is always included. Raises ConfigError for an unknown name.
    """
    requested, left_out = tuple(names), tuple(without)
    for option, given in (("--cases", requested), ("--without", left_out)):
        for name in given:
            if name not in NAMES:
                raise ConfigError(f"{option}: {name!r} is no case, expected some of {', '.join(NAMES)}{_near(name)}")
    return tuple(
        case
        for case in CASES
        if case.name == "nominal" or ((not requested or case.name in requested) and case.name not in left_out)
    )


def _near(name: str) -> str:
    near = did_you_mean(name, NAMES)
    return f"; {near}" if near else ""


def inapplicable(case: Case, kinds: Iterable[str]) -> str:
    """Return why a case does not apply to a rig with wires of these kinds; empty where it applies."""
    present = set(kinds)
    if case.injects and not set(case.wires) & present:
        return f"the rig has no wire of {', '.join(case.wires)}"
    if case.needs and not set(case.needs) & present:
        return f"no wire of {', '.join(case.needs)} tells the brain the time"
    return ""

"""The cases of a certificate: what is injected, when, which reaction is required within which time, and why.

Data alone: a case names its fault by a function that makes it; nothing here drives or judges.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from random import Random
from typing import Final

from vve_sumo.errors import ConfigError, did_you_mean
from vve_sumo.wire import faults
from vve_sumo.wire.faults import WireFault

#: kinds of wires by the sensor that they carry
GNSS: Final = ("ncom", "nmea")
RADAR: Final = ("radar", "esr", "ars408", "osi_data")


class Moment(enum.StrEnum):
    """When a fault begins: by the brain's own drive without a fault, with the same seed."""

    CRUISE = "cruise"  #: CRUISE_LEAD before the brain first braked for good
    APPROACH = "approach"  #: APPROACH_LEAD before it
    BRAKING = "braking"  #: BRAKING_LAG after it


#: [s] before and after the onset of the braking that ends in rest
LEADS: Final = {Moment.CRUISE: -5.0, Moment.APPROACH: -1.0, Moment.BRAKING: 1.0}


class Reaction(enum.StrEnum):
    """What is required of a brain."""

    DRIVE = "drive the scenario"  #: every criterion of the scenario about the stop is met
    CARRY_ON = "carry on"  #: the same, as if nothing had happened
    STOP = "stop"  #: no answer, or braking, from then on to rest; no contact
    BRAKE = "brake"  #: a setpoint that brakes by BRAKING_DEMAND or more; no contact
    HOLD = "keep the distance"  #: no contact, MIN_LEFT left; how is the brain's choice


#: an answer that asks for this or less is braking [m/s2]; a car that rolls out does about half of it
SAFE_DEMAND: Final = -0.5
#: of `Reaction.BRAKE` [m/s2]: more than a brain that keeps its speed asks for
BRAKING_DEMAND: Final = -1.0
#: to be left at rest [m]: half a metre of what neither pose nor radar knows, and as much to spare
MIN_LEFT: Final = 1.0


@dataclass(frozen=True, slots=True)
class Case:
    """One case of a certificate."""

    name: str
    injected: str  #: in words
    wires: tuple[str, ...]  #: kinds of the wires that it hits; none of them in a rig: it does not apply
    make: Callable[[Random], WireFault] | None  #: a fault for each wire; None: nothing is injected
    begins: Moment
    lasts: float  #: [s]; inf: until the drive ends
    reaction: Reaction
    within: float  #: time for the reaction [s]; inf where none is measured
    why: str  #: of the reaction and its time


def _edited(edit: faults.RadarEdit) -> Callable[[Random], WireFault]:
    return lambda _chance: faults.EditedRadar(edit)


def _case(
    name: str,
    injected: str,
    wires: tuple[str, ...],
    make: Callable[[Random], WireFault] | None,
    when: tuple[Moment, float],
    required: tuple[Reaction, float],
    why: str,
) -> Case:
    return Case(name, injected, wires, make, *when, *required, why)


_TO_END: Final = (Moment.APPROACH, math.inf)
_NO_TIME: Final = math.inf
_SILENT_AT_ONCE: Final = (Reaction.STOP, 0.1)
_LIFETIME: Final = "No setpoint may be acted on for longer than its lifetime, 0.1 s at most; the gateway then stops."

CASES: Final[tuple[Case, ...]] = (
    _case(
        "nominal", "nothing", (), None, (Moment.CRUISE, 0.0), (Reaction.DRIVE, _NO_TIME),
        "A brain that does not drive the scenario without a fault says nothing in the others.",
    ),
    _case(
        "radar_drop_out", "nothing arrives from the radar any more", RADAR, lambda _: faults.DropOut(),
        _TO_END, _SILENT_AT_ONCE, _LIFETIME,
    ),
    _case(
        "radar_gap", "nothing arrives from the radar for two ticks", RADAR, lambda _: faults.DropOut(),
        (Moment.BRAKING, 0.04), (Reaction.CARRY_ON, _NO_TIME),
        "Two ticks are shorter than the lifetime of 0.1 s; a network loses as much on an ordinary day.",
    ),
    _case(
        "radar_freeze", "the radar's last bytes arrive again and again", RADAR, lambda _: faults.Freeze(),
        _TO_END, (Reaction.STOP, 0.2), "The sequence stands. " + _LIFETIME + " As much again is left to notice it.",
    ),
    _case(
        "radar_delay", "the radar arrives 0.3 s late", RADAR, lambda _: faults.Delay(0.3),
        _TO_END, (Reaction.STOP, 0.5),
        "A datagram says of which time it is. For 0.3 s nothing arrives, then what has outlived its lifetime.",
    ),
    _case(
        "radar_delay_short", "the radar arrives 40 ms late", RADAR, lambda _: faults.Delay(0.04),
        _TO_END, (Reaction.HOLD, _NO_TIME),
        "Within the lifetime a brain may drive on if it reckons with the age: 40 ms are 0.45 m at 11.2 m/s.",
    ),
    _case(
        "radar_ageing", "the scan and its time of measurement stand while sequence and time count on", ("radar",),
        _edited(faults.aged), _TO_END, (Reaction.STOP, 0.5),
        "A radar shows no scan that is older than 0.3 s; 0.2 s more are 2.2 m at 11.2 m/s, within what a stop keeps.",
    ),
    _case(
        "radar_bit_flips", "one bit of every radar message is wrong", ("radar",), faults.BitFlips,
        _TO_END, _SILENT_AT_ONCE, "The CRC finds every one: it is as if nothing arrived. " + _LIFETIME,
    ),
    _case(
        "radar_bit_flips_some", "one bit of every fifth radar message is wrong", ("radar",),
        lambda chance: faults.BitFlips(chance, 5), (Moment.CRUISE, math.inf), (Reaction.CARRY_ON, _NO_TIME),
        "Four of five messages are good, and no gap is longer than the lifetime.",
    ),
    _case(
        "radar_ghost", "a target stands in the way for 1 s: to stop 5 m before it takes 2.5 m/s²", ("radar",),
        _edited(faults.ghost(2.5, 0.0)),
        (Moment.CRUISE, 1.0), (Reaction.BRAKE, 0.5),
        "Nothing tells a ghost from a car. At 11.2 m/s it is 30 m away; 0.5 s later it takes 3.2 m/s².",
    ),
    _case(
        "radar_ghost_receding", "a target at the same distance drives away twice as fast as the car, for 1 s",
        ("radar",),
        _edited(faults.ghost(2.5, 2.0)),
        (Moment.CRUISE, 1.0), (Reaction.CARRY_ON, _NO_TIME),
        "Its range rate is positive: it opens, and there is nothing to brake for.",
    ),
    _case(
        "radar_missing", "every target is missing from valid datagrams for 0.5 s", ("radar",), _edited(faults.empty),
        (Moment.BRAKING, 0.5), (Reaction.HOLD, _NO_TIME),
        "Radars lose targets for some scans. Half a second with 2 m/s² less of braking costs less than 1 m in the end.",
    ),
    _case(
        "radar_counter", "the sequence stands while the rest of the datagram is new", ("radar",),
        _edited(faults.counter_stopped), _TO_END, (Reaction.STOP, 0.2),
        "A datagram whose sequence is not newer is to be refused: the sender may be stuck. " + _LIFETIME,
    ),
    _case(
        "radar_invalid", "every radar datagram says that it is not valid, while its contents look good", ("radar",),
        _edited(faults.marked_invalid), _TO_END, _SILENT_AT_ONCE,
        "What is marked as invalid must not be acted on at all. " + _LIFETIME,
    ),
    _case(
        "radar_not_a_number", "every radar datagram says that it is valid, while a range is not a number", ("radar",),
        _edited(faults.not_a_number), _TO_END, _SILENT_AT_ONCE,
        "A comparison with no number is never true: a target that is none would never be braked for.",
    ),
    _case(
        "gnss_drop_out", "nothing arrives from the receiver any more", GNSS, lambda _: faults.DropOut(),
        _TO_END, (Reaction.STOP, 0.3),
        "A brain may bridge a few packets by its own odometry; 0.3 s of a wrong yaw rate of 2 °/s are 6 cm aside.",
    ),
    _case(
        "gnss_freeze", "the receiver's last bytes arrive again and again", GNSS, lambda _: faults.Freeze(),
        _TO_END, (Reaction.STOP, 0.3), "The receiver's time stands: as a drop-out.",
    ),
    _case(
        "gnss_delay", "the receiver arrives 0.3 s late", GNSS, lambda _: faults.Delay(0.3),
        _TO_END, (Reaction.STOP, 0.5),
        "A fix says of which time it is. For 0.3 s nothing arrives, then places that lie 3.4 m behind at 11.2 m/s.",
    ),
    _case(
        "gnss_bit_flips", "one bit of every packet of the receiver is wrong", ("ncom",), faults.BitFlips,
        _TO_END, (Reaction.STOP, 0.3), "NCOM's checksums find every wrong byte: as a drop-out.",
    ),
    _case(
        "gnss_bit_flips_some", "one bit of every fifth packet of the receiver is wrong", ("ncom",),
        lambda chance: faults.BitFlips(chance, 5), (Moment.CRUISE, math.inf), (Reaction.CARRY_ON, _NO_TIME),
        "Four of five packets are good; a fix that is one tick old is 0.22 m behind at 11.2 m/s.",
    ),
    _case(
        "gnss_invalid", "every packet says that the unit is not locked, while its contents look good", ("ncom",),
        lambda _: faults.UnlockedNcom(), _TO_END, (Reaction.STOP, 0.3),
        "Nobody vouches for such a place: as a drop-out.",
    ),
    _case(
        "both_freeze", "the last bytes of all wires arrive again and again", (*GNSS, *RADAR),
        lambda _: faults.Freeze(), _TO_END, (Reaction.STOP, 0.2),
        "The computer before the brain hangs: fix and radar agree with each other, only the sequence stands.",
    ),
)  # fmt: skip

NAMES: Final = tuple(case.name for case in CASES)


def chosen(names: Iterable[str]) -> tuple[Case, ...]:
    """Return the cases of these names in the table's order, the nominal one always; all for no name at all.

    Raises ConfigError for a name that there is not.
    """
    wanted = tuple(names)
    for name in wanted:
        if name not in NAMES:
            raise ConfigError(f"--cases: {name!r} is no case, expected some of {', '.join(NAMES)}{_near(name)}")
    return tuple(case for case in CASES if not wanted or case.name in (*wanted, "nominal"))


def _near(name: str) -> str:
    near = did_you_mean(name, NAMES)
    return f"; {near}" if near else ""


def applies(case: Case, kinds: Iterable[str]) -> bool:
    """Whether a rig whose wires are of these kinds has one that the case hits."""
    return case.make is None or bool(set(case.wires) & set(kinds))

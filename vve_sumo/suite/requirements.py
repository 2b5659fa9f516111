"""The standards' requirements as data: speeds in km/h, as printed there, each table with its source.

[P]: read in the primary text. [S]: from a secondary transcription, which is named. Knows no scenario and no car.
"""

from __future__ import annotations

from typing import Final, NamedTuple


class Impact(NamedTuple):
    """A speed, and the greatest impact speed that is allowed at it with the car laden and unladen; None: no row."""

    speed: float  #: [km/h]
    laden: float | None  #: [km/h]
    unladen: float | None  #: [km/h]


# UN R152, 00 series of amendments, 5.2.1.4 (M1): relative speed against a car that stands still, or moves.
# [S] OCRs of R152e, of its Amendment 1 and of OJ EU 30.10.2020 agree; the UN's own file was not read.
R152_STATIONARY: Final = (
    *(Impact(speed, 0.0, 0.0) for speed in (10.0, 15.0, 20.0, 25.0, 30.0, 35.0, 40.0)),
    Impact(42.0, 10.0, 0.0),
    Impact(45.0, 15.0, 15.0),
    Impact(50.0, 25.0, 25.0),
    Impact(55.0, 30.0, 30.0),
    Impact(60.0, 35.0, 35.0),
)
R152_MOVING: Final = (
    *(Impact(speed, 0.0, 0.0) for speed in (10.0, 15.0, 20.0, 25.0, 30.0, 35.0, 40.0)),
    Impact(42.0, None, 0.0),
)
# As above, and slide AEBS-08-07: speed of the car towards a child that crosses.
R152_PEDESTRIAN: Final = (
    *(Impact(speed, 0.0, 0.0) for speed in (20.0, 25.0, 30.0)),
    Impact(35.0, 20.0, 20.0),
    Impact(40.0, 25.0, 25.0),
    Impact(45.0, 30.0, 30.0),
    Impact(50.0, 35.0, 35.0),
    Impact(55.0, 40.0, 40.0),
    Impact(60.0, 45.0, 45.0),
)
R152_PEDESTRIAN_SPEED: Final = 5.0  #: [km/h] [S] as the table
# 01 series: the impact speeds of car-to-car hold for pedestrians too. [S] GRVA-04-10 as globalautoregs.com sums it up;
# the draft on slide AEBS-08-07 has the laden column for both loads.
R152_PEDESTRIAN_01: Final = tuple(entry for entry in R152_STATIONARY if entry.speed >= R152_PEDESTRIAN[0].speed)
# 02 series: bicycles that cross. Its table is in none of our sources. Assumed: what the 01 series allows for
# pedestrians, at the bicycle's speed in Euro NCAP's CBNA ([S] vectorgrp/OSC-NCAP-scenarios).
R152_BICYCLE: Final = R152_PEDESTRIAN_01
R152_BICYCLE_SPEED: Final = 15.0  #: [km/h]
# [S] a summary of the regulation in a public repository, written by a machine; the tolerance from a paper (RegulaRAG).
R152_BRAKING_DEMAND: Final = 5.0  #: of the service brakes in an emergency braking, at least [m/s2]
R152_TEST_SPEEDS: Final = (20.0, 42.0, 60.0)  #: against a stationary car [km/h]
R152_MOVING_TARGET_SPEED: Final = 20.0  #: [km/h]
R152_MIN_TTC: Final = 4.0  #: at the start of the functional part [s]
R152_SPEED_TOLERANCE: Final = (2.0, 0.0)  #: below and above [km/h]


class Lead(NamedTuple):
    """A row of FMVSS 127's table of lead-vehicle tests; two numbers are the ends of a range."""

    kind: str  #: stopped, slower, decelerating
    subject: tuple[float, float]  #: speed of the car under test [km/h]
    lead: float  #: speed of the car ahead at the start [km/h]
    headway: tuple[float, float] | None  #: at the start [m]
    deceleration: tuple[float, float] | None  #: of the car ahead [g]
    manual_brake: bool  #: the driver brakes after the warning


# FMVSS 127, table 1 to S7.1, and S4, S5.3, S7, S9. [P] NHTSA's final rule of 2024, pre-publication text.
_HEADWAY, _LEAD_DECELERATION = (12.0, 40.0), (0.3, 0.5)
FMVSS_127_LEAD: Final = (
    Lead("stopped", (10.0, 80.0), 0.0, None, None, False),
    Lead("stopped", (70.0, 100.0), 0.0, None, None, True),
    Lead("slower", (40.0, 80.0), 20.0, None, None, False),
    Lead("slower", (70.0, 100.0), 20.0, None, None, True),
    Lead("decelerating", (50.0, 50.0), 50.0, _HEADWAY, _LEAD_DECELERATION, False),
    Lead("decelerating", (50.0, 50.0), 50.0, _HEADWAY, _LEAD_DECELERATION, True),
    Lead("decelerating", (80.0, 80.0), 80.0, _HEADWAY, _LEAD_DECELERATION, False),
    Lead("decelerating", (80.0, 80.0), 80.0, _HEADWAY, _LEAD_DECELERATION, True),
)
FMVSS_127_START: Final = 5.0  #: of relative speed are the distance L0 at the start [s]
FMVSS_127_SPEED_TOLERANCE: Final = 1.6  #: [km/h]
FMVSS_127_LEAD_RAMP: Final = 1.5  #: time in which the car ahead reaches its deceleration, at most [s]
FMVSS_127_FALSE_ACTIVATION: Final = 0.25  #: deceleration that must not be reached [g]
FMVSS_127_PASS_SPEED: Final = 80.0  #: between two cars, and over the steel plate [km/h]
FMVSS_127_PASS_GAP: Final = 4.5  #: between the two cars, within 0.1 [m]


class Walk(NamedTuple):
    """A row of FMVSS 127's table of pedestrian tests."""

    kind: str  #: crossing, stationary, along path
    side: str  #: from which it comes, or on which it is: right, left
    overlap: float  #: of the car's width, from that side to where it would be hit [%]
    obstructed: bool  #: it comes out from behind parked cars
    subject: tuple[float, float]  #: least and greatest speed of the car under test [km/h]
    speed: float  #: of the pedestrian [km/h]


# FMVSS 127, table 2 to S8.1.1. [P] as above.
FMVSS_127_WALKS: Final = (
    Walk("crossing", "right", 25.0, False, (10.0, 60.0), 5.0),
    Walk("crossing", "right", 50.0, False, (10.0, 60.0), 5.0),
    Walk("crossing", "left", 50.0, False, (10.0, 60.0), 8.0),
    Walk("crossing", "right", 50.0, True, (10.0, 50.0), 5.0),
    Walk("stationary", "right", 25.0, False, (10.0, 55.0), 0.0),
    Walk("along path", "right", 25.0, False, (10.0, 65.0), 5.0),
)
FMVSS_127_WALK_START: Final = 4.0  #: of relative speed are the distance L0 at the start [s]


class Kerb(NamedTuple):
    """Where a pedestrian who crosses begins."""

    offset: float  #: from the middle of the car's way [m]
    speeding_up: float  #: way in which it comes to its speed [m]


# Where the pedestrians of FMVSS 127 begin and how the parked cars stand is in none of our sources. Assumed: as in Euro
# NCAP's CPNA, CPFA and CPNCO. [S] vectorgrp/OSC-NCAP-scenarios.
KERBS: Final = {"right": Kerb(4.0, 1.0), "left": Kerb(6.0, 1.5)}
PARKED_GAP: Final = 1.0  #: from the pedestrian's way to the first parked car, and between the two [m]
PARKED_CLEARANCE: Final = 1.0  #: from the side of the car under test to that of the parked cars [m]


# Euro NCAP AEB car-to-car, protocol v4.3.1 (2023). [S] variation files of vectorgrp/OSC-NCAP-scenarios.
EURO_NCAP_OVERLAPS: Final = (-50.0, -75.0, 100.0, 75.0, 50.0)  #: of the car's width [%]
EURO_NCAP_CCRS: Final = (10.0, 15.0, 20.0, 25.0, 30.0, 35.0, 40.0, 45.0, 50.0)  #: [km/h]
EURO_NCAP_CCRS_FCW: Final = (55.0, 60.0, 65.0, 70.0, 75.0, 80.0)  #: [km/h]
EURO_NCAP_CCRM: Final = (30.0, 35.0, 40.0, 45.0, 50.0, 55.0, 60.0, 65.0, 70.0, 75.0, 80.0)  #: [km/h]
EURO_NCAP_CCRM_TARGET: Final = 20.0  #: [km/h]
EURO_NCAP_CCRB: Final = 50.0  #: of both cars [km/h]
EURO_NCAP_CCRB_HEADWAY: Final = (12.0, 40.0)  #: [m]
EURO_NCAP_CCRB_DECELERATION: Final = (2.0, 6.0)  #: of the car ahead [m/s2]
EURO_NCAP_CCRB_END: Final = 2.0  #: speed at which the car ahead goes on [km/h]
EURO_NCAP_TARGET_WIDTH: Final = 1.712  #: [m]


# UN R157, 5.2.5.2. [S] as coded in JRC-FSM and esmini, which both add another 0.1 s in their check; we do not.
R157_CUT_IN_SPEEDS: Final = (10.0, 20.0, 30.0, 40.0, 50.0, 60.0)  #: relative [km/h]
R157_BRAKING: Final = 6.0  #: that the rule reckons with [m/s2]
R157_REACTION: Final = 0.35  #: that the rule reckons with [s]


def cut_in_time(relative_speed: float) -> float:
    """Return the time to collision at lane intrusion [s] above which R157 wants no contact; relative speed [m/s]."""
    return relative_speed / (2.0 * R157_BRAKING) + R157_REACTION


class Following(NamedTuple):
    """A row of R157's table of following distances."""

    speed: float  #: [km/h]
    headway: float  #: [s]
    distance: float  #: [m]


# UN R157, 5.2.3.3. [S] the clause as quoted by lawinsider.com (first rows) and esmini's Regulation::MinDist.
R157_FOLLOWING: Final = (
    Following(7.2, 1.0, 2.0),
    Following(10.0, 1.1, 3.1),
    Following(20.0, 1.2, 6.7),
    Following(30.0, 1.3, 10.8),
    Following(40.0, 1.4, 15.6),
    Following(50.0, 1.5, 20.8),
    Following(60.0, 1.6, 26.7),
)

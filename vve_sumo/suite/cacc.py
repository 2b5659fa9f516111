"""Platoons of five by ACC and CACC: settled following, a leader that brakes, cut-in, cut-out, string, lost messages.

Laid out as tests of ISO 15622 are, of which only the scope is in our sources: the figures are ours. What a string of
ACCs passes on has a closed form: it amplifies nothing where the headway is above twice delay and lag of the car.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final, NamedTuple

from vve_sumo.scenario.schema import Scenario
from vve_sumo.sensors.radar import RadarConfig
from vve_sumo.suite.physics import Need
from vve_sumo.suite.row import RequiredApproach, RequiredString, SuiteRow
from vve_sumo.suite.track import KMH
from vve_sumo.timing import PERIOD
from vve_sumo.vehicle.model import VehicleModel

CHAIN: Final = ("ego", "second", "third", "fourth", "fifth")
LEADER: Final = "leader"
SPEED: Final = 15.0  #: of the undisturbed platoon [m/s]
FREE: Final = 18.0  #: that every car would drive alone [m/s]
STANDSTILL: Final = 5.0  #: gap at rest [m]
FRONT: Final = 190.0  #: s of the first ego's rear axle at the start [m]
ACC_HEADWAY, CACC_HEADWAY = 1.5, 0.8  #: that the controllers have where nothing is said [s]
#: gains of the ACC of the closed form: k1 = SHARE / h, k2 = 1 / h [1/s]
SHARE: Final = 0.1
#: drive time until which the platoon settles: a CACC closes up by 0.1 s of headway a second [s]
SETTLED: Final = 25.0
BRAKING: Final = (1.0, 2.0, 3.5)  #: of the leader [m/s2]
SLOWED: Final = 5.0  #: speed that it brakes down to [m/s]
BUILD_UP: Final = 0.5  #: of its deceleration [s]
DIPS_TO, DIPS_FOR, DIPS_AT = 12.0, 15.0, 1.0  #: the leader's disturbance of the string [m/s], [s], [m/s2]
ACC_HEADWAYS, CACC_HEADWAYS = (0.5, 0.8, 1.2), (0.5, 0.8)  #: of the string [s]
CAM_INTERVAL: Final = 0.1  #: between messages of a car of the platoon [s]
AMPLIFICATION: Final = 1.0  #: from head to tail, at most
BESIDE: Final = 4.0  #: the middle of the next lane [m]
CHANGE: Final = 4.0  #: time that a change of lanes takes [s]
REVEALED: Final = 10.0  #: speed of the car that a cut-out reveals [m/s]
AHEAD_OF_LEADER: Final = 70.0  #: where it is when the leader cuts out, and a little more [m]
CAR: Final = 4.5  #: length of the actors [m]
HEADWAY_TOLERANCE: Final = 0.15  #: of the settled headway [s]
LEAST_GAP: Final = 2.0  #: where nobody touches anybody, and nothing but comfort is asked of the brakes [m]
TOLERANCE: Final = 1.0 * KMH  #: of the speed at the start [m/s]


class HeadwayNeed(Need):
    """The headway above which a string of ACCs amplifies nothing, and the headway of the row [s]."""

    @property
    def unit(self) -> str:
        """Unit of both."""
        return "s"


class Law(NamedTuple):
    """A controller and how it follows."""

    name: str
    headway: float  #: time gap on top of the gap at rest [s]
    tuning: dict[str, Any]


ACC: Final = Law("acc", ACC_HEADWAY, {"gap_m": STANDSTILL, "time_headway_s": ACC_HEADWAY})
CACC: Final = Law("cacc", CACC_HEADWAY, {"gap_m": STANDSTILL, "time_headway_s": CACC_HEADWAY})


def rows(car: VehicleModel) -> Iterator[SuiteRow]:
    """Return the suite's rows."""
    for law in (ACC, CACC):
        yield _settled(car, law)
        for braking in BRAKING:
            yield _braking(car, law, braking)
        yield _cut_in(car, law)
        yield _cut_out(car, law)
    for headway in ACC_HEADWAYS:
        gains = {"gap_gain_per_s2": SHARE / headway, "speed_gain_per_s": 1.0 / headway}
        tuning = {"gap_m": STANDSTILL, "time_headway_s": headway} | gains
        yield _string(car, Law("acc", headway, tuning), HeadwayNeed(string_limit(car), headway))
    for headway in CACC_HEADWAYS:
        yield _string(car, Law("cacc", headway, {"gap_m": STANDSTILL, "time_headway_s": headway}), None)
    for braking in BRAKING:
        yield _loss(car, braking)


def string_limit(car: VehicleModel) -> float:
    """Return the headway above which ACCs with k2 = 1 / h amplify nothing: h > 2 (delay + lag) [s].

    Delay and lag are those of the declared car's drive, with a tick and the radar's latency.
    """
    delay = car.simulated.throttle_delay + PERIOD + RadarConfig().latency
    return 2.0 * (delay + car.calibration.drive_lag)


def platoon(
    car: VehicleModel, title: str, law: Law, lasts: float, actors: list[dict[str, Any]], **tables: Any
) -> Scenario:
    """Return a scenario of five cars behind a leader, each at the gap of its headway, CACCs at that of an ACC.

    `lasts` is how long the drive goes on once the platoon is settled [s].
    """
    gap = STANDSTILL + (ACC_HEADWAY if law.name == "cacc" else law.headway) * SPEED
    lead = {"id": LEADER, "ahead_m": gap, "speed_mps": SPEED}
    head, *others = actors
    ego = {
        "path": "test_track",
        "speed_mps": FREE,
        "initial_speed_mps": SPEED,
        "initial_s_m": FRONT,
        "lot": {"latitude_deg": 40.0041, "longitude_deg": -83.0186, "heading_deg": 85.0},
    }
    egos = [
        {"id": name, "initial_s_m": FRONT - number * (gap + car.vehicle.length)}
        for number, name in enumerate(CHAIN[1:], 1)
    ]
    table: dict[str, Any] = {
        "title": f"Platoon: {title}",
        "duration_s": SETTLED + lasts,
        "road": {"network": "test_track"},
        "ego": ego,
        "egos": egos,
        "sensors": [_radio()] if law.name == "cacc" else [],
        "controller": {"name": law.name, "tuning": law.tuning},
        "actors": [lead | head, *others],
        "end_trigger": {"contact": True},
    }
    return Scenario.model_validate(table | tables)


def _radio(**settings: float) -> dict[str, Any]:
    """Return the V2X receiver of each car, with more settings."""
    return {"name": "obu", "kind": "v2x", "settings": {"longest_cam_interval_s": CAM_INTERVAL, **settings}}


def _row(scenario: Scenario, id: str, description: str, required: str, **parts: Any) -> SuiteRow:
    # Behind the leader the first car is as fast as the leader, or slower.
    approach = RequiredApproach(LEADER, SPEED, SPEED, FREE - SPEED + TOLERANCE)
    return SuiteRow(id, description, required, scenario, approach=approach, **parts)


def _settled(car: VehicleModel, law: Law) -> SuiteRow:
    headway = law.headway + STANDSTILL / SPEED
    band = {"min": headway - HEADWAY_TOLERANCE, "max": headway + HEADWAY_TOLERANCE}
    description = f"{law.name}, behind a steady leader"
    scene = platoon(car, description, law, 20.0, [{}], criteria={"headway_median_s": band, "emergency_used": False})
    return _row(scene, f"settled_{law.name}", description, f"headway {headway:.2f} +- {HEADWAY_TOLERANCE:g} s")


def _braking(car: VehicleModel, law: Law, deceleration: float) -> SuiteRow:
    description = f"{law.name}, leader brakes at {deceleration:g} m/s2 to {SLOWED:g} m/s"
    slows = {
        "when": {"after_s": SETTLED}, "speed_mps": SLOWED, "acceleration_mps2": deceleration, "build_up_s": BUILD_UP,
    }  # fmt: skip
    criteria = {"min_gap_m": {"min": LEAST_GAP}, "emergency_used": False}
    scene = platoon(car, description, law, 20.0, [{"events": [slows]}], criteria=criteria)
    required = f"gap >= {LEAST_GAP:g} m, no emergency braking"
    return _row(scene, f"braking_{law.name}_{deceleration:g}", description, required)


def _cut_in(car: VehicleModel, law: Law) -> SuiteRow:
    """Return the row of a car that comes from the next lane between the first and the second car, and goes back."""
    description = f"{law.name}, a car cuts in behind the first car, and out again"
    gap = STANDSTILL + law.headway * SPEED
    joins = {"when": {}, "offset_m": 0.0, "over_s": CHANGE}
    leaves = {"when": {"after_s": 15.0}, "offset_m": BESIDE, "over_s": CHANGE}
    # It enters beside the middle of the gap behind the first car, the platoon being settled.
    joining = {
        "id": "joining", "ahead_m": -(car.vehicle.length + 0.5 * (gap - CAR)), "offset_m": BESIDE, "speed_mps": SPEED,
        "length_m": CAR, "enters": {"drive_s": SETTLED}, "events": [joins, leaves],
    }  # fmt: skip
    scene = platoon(car, description, law, 35.0, [{}, joining])
    return _row(scene, f"cut_in_{law.name}", description, "no contact")


def _cut_out(car: VehicleModel, law: Law) -> SuiteRow:
    """Return the row of a leader that goes to the next lane before a slower car."""
    description = f"{law.name}, the leader cuts out before a car at {REVEALED:g} m/s"
    gap = STANDSTILL + law.headway * SPEED
    out = {"when": {"after_s": SETTLED}, "offset_m": BESIDE, "over_s": CHANGE}
    slower = {
        "id": "slower", "ahead_m": gap + CAR + AHEAD_OF_LEADER, "speed_mps": REVEALED, "length_m": CAR,
        "enters": {"drive_s": SETTLED - 2.0},
    }  # fmt: skip
    scene = platoon(car, description, law, 30.0, [{"events": [out]}, slower])
    return _row(scene, f"cut_out_{law.name}", description, "no contact")


def _string(car: VehicleModel, law: Law, need: Need | None) -> SuiteRow:
    description = f"{law.name}, string of headway {law.headway:g} s"
    dips = [
        {"when": {"after_s": after}, "speed_mps": speed, "acceleration_mps2": DIPS_AT, "build_up_s": BUILD_UP}
        for after, speed in ((SETTLED, DIPS_TO), (DIPS_FOR, SPEED))
    ]
    scene = platoon(car, description, law, 35.0, [{"events": dips}])
    string = RequiredString(LEADER, CHAIN, SPEED, SETTLED - 1.0, AMPLIFICATION)
    required = f"head to tail <= {AMPLIFICATION:g}"
    return _row(scene, f"string_{law.name}_{law.headway:g}", description, required, string=string, need=need)


def _loss(car: VehicleModel, deceleration: float) -> SuiteRow:
    """Return the row of a CACC that hears nothing any more from the moment on at which the leader brakes to rest."""
    description = f"cacc, messages end as the leader brakes at {deceleration:g} m/s2 to rest"
    slows = {
        "when": {"after_s": SETTLED}, "speed_mps": 0.0, "acceleration_mps2": deceleration, "build_up_s": BUILD_UP,
    }  # fmt: skip
    sensors = [_radio(jammed_from_s=SETTLED)]
    scene = platoon(car, description, CACC, 25.0, [{"events": [slows]}], sensors=sensors)
    return _row(scene, f"loss_{deceleration:g}", description, "no contact")

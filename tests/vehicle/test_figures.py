"""What the gateway keeps to, written down a second time: figures with the standard or the reason behind them."""

from __future__ import annotations

from dataclasses import asdict

from vve_sumo import timing
from vve_sumo.values import ArmingState
from vve_sumo.vehicle.arming import COMMANDING, CRITICAL, ENDING, ArmingEvent
from vve_sumo.vehicle.limits import COMFORT, EMERGENCY, Limits

S = ArmingState


def test_the_car_is_commanded_in_three_states_and_a_drive_ends_in_three():
    assert {S.ENGAGED, S.STOPPING, S.STOPPED} == COMMANDING
    assert {S.STOPPING, S.STOPPED, S.FAULT} == ENDING


def test_an_event_is_called_in_documents_what_it_is_called_in_the_source():
    assert all(event.value == event.name.lower() for event in ArmingEvent)


def test_the_harder_stop_is_for_a_car_that_does_not_obey_or_is_not_watched():
    brakes = {f"brake_{what}" for what in ("disabled", "fault", "timeout", "not_following", "report_frozen")}
    steering = {f"steering_{what}" for what in ("disabled", "fault", "timeout", "not_following", "report_stale")}
    controller = {"dbw_braking", "dbw_watchdog", "another_writer", "bus_down"}
    car = {"gear_lost", "drive_not_following", "wheel_speeds_stale", "timer_gap"}
    assert brakes | steering | controller | car == CRITICAL


def test_limits():
    """ISO 15622 (ACC): 3.5 and 2.0 m/s2, 5 m/s3 at high speed. ISO 11270 (lane keeping): 3 m/s2, 5 m/s3 sideways."""
    comfort = {"deceleration": 3.5, "acceleration": 2.0, "jerk": 5.0, "release_jerk": 10.0, "lateral_jerk": 5.0}
    assert asdict(COMFORT) == comfort
    assert asdict(EMERGENCY) == {"deceleration": 9.0, "jerk": 30.0}
    assert asdict(Limits()) == {
        "comfort": comfort,
        "emergency": {"deceleration": 9.0, "jerk": 30.0},
        "lateral_acceleration": 3.0,
        "stop_deceleration": 2.4,
        "stop_jerk": 5.0,
        "stop_lateral_jerk": 10.0,
        "critical_deceleration": 4.0,
        "critical_jerk": 15.0,
        "speed": None,
    }


def test_times():
    """The DBW controller gives up after 100 ms; reports come at 50 Hz, the gear at 20 Hz: three may be lost."""
    assert timing.SETPOINT_LIFETIME == timing.MAX_REPORT_AGE == 0.1
    assert timing.MAX_GEAR_REPORT_AGE == 4 / 20
    assert timing.MAX_PARK_REPORT_AGE == 0.06

"""Which modules are mutated, and which tests must notice: the one table.

The tests are those that run without a bus, a street or a second process; a test that takes seconds is left out where
others say the same.
"""

from __future__ import annotations

from typing import Final

from tests.mutation.trial import Subject


def _vehicle(module: str, *tests: str) -> Subject:
    return Subject(f"vve_sumo.vehicle.{module}", tuple(f"tests/vehicle/test_{test}" for test in tests))


_GATEWAY: Final = (
    "evidence.py",
    "gateway.py",
    "gateway_engaging.py",
    "gateway_driving.py",
    "gateway_faults.py",
    "interface_raises.py",
    "acceleration.py::test_no_car_is_asked_for_more_braking_than_its_brakes_give",
    "gateway_stopping.py",
    "gateway_driver_override.py",
    "fallback.py",
    "waiting.py",
    "other_cars.py",
    "gateway_status.py",
    "not_commanded.py",
    "stopping.py",
    "speed_limit.py",
    "hold.py",
    "drivers_foot.py",
    "safety_constants.py",
)

#: Name on the command line to the module and its tests.
SUBJECTS: Final[dict[str, Subject]] = {
    # Before those whose tests import it: a module that is imported already cannot be changed.
    "dataspeed_interface": Subject(
        "vve_sumo.vehicle.dataspeed.interface",
        ("tests/vehicle/dataspeed/test_interface.py", "tests/vehicle/test_reports.py"),
    ),
    "dataspeed_signals": Subject(
        "vve_sumo.vehicle.dataspeed.signals",
        ("tests/vehicle/dataspeed/test_interface.py", "tests/vehicle/test_reports.py"),
    ),
    "arming": _vehicle(
        "arming",
        "arming.py",
        "arming_diagram.py",
        "figures.py",
        "gateway.py::test_every_reason_it_can_give_has_plain_words",
    ),
    "arming_machine": _vehicle("arming_machine", "arming_machine.py"),
    "setpoint_validation": _vehicle("setpoint_validation", "setpoint_validation.py", "figures.py"),
    "engagement": _vehicle("engagement", "engagement.py", "safety_constants.py"),
    "reports": _vehicle("reports", "reports.py", "driver_reports.py", "safety_constants.py"),
    "report_consistency": _vehicle("report_consistency", "report_spikes.py", "safety_constants.py"),
    "driver_braking": _vehicle("driver_braking", "driver_braking.py", "safety_constants.py"),
    "command_echo": _vehicle("command_echo", "command_echo.py", "safety_constants.py"),
    "slowing_monitor": _vehicle("slowing_monitor", "slowing_monitor.py", "safety_constants.py"),
    "response": _vehicle("response", "response_monitor.py"),
    "limits": _vehicle(
        "limits",
        "limits.py",
        "figures.py",
        "safety_constants.py",
        "speed_limit.py::test_the_limit_is_approached_within_eight_tenths_of_a_second_each",
        "speed_limit.py::test_a_car_that_is_one_metre_per_second_faster_than_its_limit_is_too_fast",
        "speed_limit.py::test_what_is_granted_is_the_least_of_the_request_and_the_approach_to_the_limit",
        "speed_limit.py::test_where_limit_or_speed_is_not_known_nothing_is_limited",
        "speed_limit.py::test_too_fast_is_beyond_the_margin",
        "speed_limit.py::test_a_car_that_follows_the_grant_nears_the_limit_exponentially",
        "speed_limit.py::test_a_limit_that_is_no_positive_number_is_refused",
    ),
    "effective_deceleration": _vehicle("effective_deceleration", "effective_deceleration.py"),
    "standstill": _vehicle("standstill", "standstill.py", "safety_constants.py"),
    "brake_monitor": _vehicle("brake_monitor", "brake_monitor.py", "safety_constants.py"),
    "drift": _vehicle("drift", "drift_check.py", "safety_constants.py"),
    "plausibility": _vehicle(
        "plausibility",
        "plausibility_speed_and_yaw_rate.py",
        "plausibility_frozen.py",
        "plausibility_dead_reckoning.py",
        "safety_constants.py",
    ),
    "gateway": _vehicle("gateway", *_GATEWAY),
    "motion_control": _vehicle("motion_control", *_GATEWAY),
    "monitor": _vehicle("monitor", "monitor.py", "observer.py"),
    "trust": Subject(
        "vve_sumo.pose.trust",
        tuple(f"tests/pose/test_{test}.py" for test in ("trust", "trust_figures", "trust_frozen", "steadiness")),
    ),
    "steadiness": Subject("vve_sumo.pose.steadiness", ("tests/pose/test_steadiness.py",)),
}

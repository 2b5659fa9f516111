"""The times of `vve_sumo/timing.py`: how they depend on each other, and on what others keep to."""

from __future__ import annotations

import ast

import pytest

from tests import setpoints
from tests.conftest import REPOSITORY
from vve_sumo import timing
from vve_sumo.live import car, car_console
from vve_sumo.live.gateway import STATUS_INTERVAL, next_step_time
from vve_sumo.pose.trust import DRIVE
from vve_sumo.rig import load as rigs
from vve_sumo.vehicle import fallback, gateway
from vve_sumo.vehicle.interface import DEFAULT, load
from vve_sumo.vehicle.setpoint_validation import SetpointValidator
from vve_sumo.wire.datagrams import SetpointDatagram, Wrong, decode_setpoint, encode_setpoint

FACTS = load(DEFAULT).facts
#: names under which one of these times was said elsewhere, with the values that it had
SAID = {
    "PERIOD": 0.02, "TICK": 0.02, "period": 0.02, "NOTICED": 0.03, "EXPIRY": 0.1, "SETPOINT_LIFETIME": 0.1,
    "MAX_LIFETIME": 0.1, "MAX_REPORT_AGE": 0.1, "MAX_STEP_INTERVAL": 1.5,
}  # fmt: skip


def test_the_period_is_the_rate_of_commands_and_the_lifetime_is_the_cars_own_patience() -> None:
    assert timing.PERIOD == 1.0 / 50.0
    assert timing.SETPOINT_LIFETIME == FACTS.command_timeout == fallback.MAX_GAP == 0.1


def test_what_is_noticed_is_the_longest_step_of_the_gateways_loop() -> None:
    waited = [
        next_step_time(0.0, fresh, alone, timing.PERIOD) for fresh in (False, True) for alone in (False, True)
    ]  # fmt: skip
    assert max(waited) == pytest.approx(timing.NOTICED) == 0.03
    assert min(waited) == pytest.approx(timing.MIN_STEP_INTERVAL * timing.PERIOD)
    assert timing.MAX_STEP_INTERVAL < gateway.MAX_STEP, "a gateway that waits as long as it may is no gap of its timer"
    assert FACTS.command_timeout > timing.NOTICED, "a late setpoint must not make the car's modules let go"


def test_a_setpoint_outlives_a_lost_tick_and_the_step_that_notices() -> None:
    assert timing.SETPOINT_LIFETIME > 2.0 * timing.PERIOD + timing.NOTICED
    # The longest way from the last good setpoint to the first step without it, which the fence reckons with.
    assert pytest.approx(0.13) == timing.SETPOINT_LIFETIME + timing.NOTICED
    rig = rigs.load(REPOSITORY / "rigs" / "simulated.toml")
    assert rig.latency.budget_ms / 1000.0 < timing.SETPOINT_LIFETIME, "within its budget no setpoint is born dead"


@pytest.mark.parametrize(("lifetime", "reason"), [(0.1, None), (0.1001, "setpoint_lifetime")])
def test_gateway_and_wire_take_no_longer_lifetime_than_the_pipeline_gives(lifetime: float, reason: str | None) -> None:
    plain = {"sequence": 1, "time": 0.0, "expires": lifetime, "speed": 0.0, "yaw_rate": 0.0}
    rejection = SetpointValidator().take(
        0.0, setpoints.setpoint(0.0, 0.0, x=0.0, y=0.0, heading=0.0, **plain)
    )  # fmt: skip
    assert (rejection.reason if rejection else None) == reason
    data = encode_setpoint(SetpointDatagram(1, 1, 0.0, lifetime, 0.0, 0.0))
    assert (decode_setpoint(data) is Wrong.LIFETIME) is (reason is not None)


def test_what_listens_waits_longer_than_what_speaks() -> None:
    assert car.GATEWAY_SILENCE > 2.0 * timing.NOTICED, "the drive hears the gateway at every step"
    assert car_console.SILENT > STATUS_INTERVAL + 2.0 * timing.NOTICED, "the console hears it about ten times a second"
    assert timing.MAX_REPORT_AGE > 2.0 * timing.NOTICED + timing.PERIOD, "two reports of one a step may be lost"
    assert timing.MAX_PARK_REPORT_AGE > timing.NOTICED + timing.PERIOD, "a step may be late, and one report be lost"
    assert timing.MAX_GEAR_REPORT_AGE > 3.0 / 20.0 + timing.NOTICED, "and two of the gear, at 20 Hz"
    assert DRIVE.stale_limit > timing.SETPOINT_LIFETIME, "a pose is predicted for as long as a setpoint lives, and more"


@pytest.mark.thorough
def test_no_other_module_says_one_of_these_times() -> None:
    elsewhere = []
    for file in sorted((REPOSITORY / "vve_sumo").rglob("*.py")):
        if file.name == "timing.py":
            continue
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            for name, value in _said_in(node):
                if isinstance(value, ast.Constant) and (name.lstrip("_"), value.value) in SAID.items():
                    elsewhere.append(f"{file.relative_to(REPOSITORY)}: {name}")
    assert set(elsewhere) <= {"vve_sumo/network_tools/survey.py: PERIOD"}, "that one is between two samples of a track"


def _said_in(node: ast.AST) -> list[tuple[str, ast.expr | None]]:
    """Names that the statement gives a value, and default values of arguments."""
    match node:
        case ast.AnnAssign(target=ast.Name(id=name), value=value):
            return [(name, value)]
        case ast.Assign(targets=[ast.Name(id=name)], value=value):
            return [(name, value)]
        case ast.arguments():
            named = [*node.posonlyargs, *node.args]
            given = zip(named[len(named) - len(node.defaults) :], node.defaults, strict=True)
            return [(one.arg, value) for one, value in (*given, *zip(node.kwonlyargs, node.kw_defaults, strict=True))]
        case _:
            return []

"""Steering laws against what is exactly known of each, and the gains against python-control's own."""

from __future__ import annotations

import math
from dataclasses import replace

import control
import numpy as np
import pytest

from tests.controllers.street import FUSION
from vve_sumo.errors import ConfigError
from vve_sumo.path import ReferencePath
from vve_sumo.values import Detections, Observation, Point, Pose

#: CommonRoad vehicle models, parameter set 2, with the cornering stiffness of its single track.
BMW = replace(
    FUSION, mass=1093.3, yaw_inertia=1791.6, wheelbase=1.1562 + 1.4227, front_axle_to_mass=1.1562,
    cornering_stiffness_front=129_695.8, cornering_stiffness_rear=105_401.2,
)  # fmt: skip
NO_SLIP = replace(FUSION, cornering_stiffness_front=1e12, cornering_stiffness_rear=1e12)
STEP = 0.005  #: of the simple car [s]
NOTHING = Detections(-math.inf, np.empty(0), np.empty(0), np.empty(0), np.empty(0, np.int8))


def circle(radius: float) -> ReferencePath:
    turns = np.linspace(0.0, 3.0, round(3.0 * radius))
    return ReferencePath.from_points(radius * np.sin(turns), radius * (1.0 - np.cos(turns)))


def observation(path: ReferencePath, s: float, speed: float, d: float = 0.0, turned: float = 0.0, slip: float = 0.0):
    """A car beside the path, going steadily, its course turned from the path's direction."""
    at = path.at(s)
    pose = Pose(
        1.0, Point.REAR_AXLE, at.x - d * math.sin(at.heading), at.y + d * math.cos(at.heading),
        at.heading + turned - slip, speed, speed * math.tan(slip), speed * at.curvature, 0.0, 0.0,
    )  # fmt: skip
    return Observation(50, 1.0, pose, path, speed, {"radar": NOTHING}, math.nan)


def steered(part, law, vehicle, now: Observation) -> float:
    observer = part("deviation").DeviationObserver(vehicle)
    projection = now.path.project(now.pose.x, now.pose.y)
    return law.steer(observer.step(now.pose, now.path, projection, 0.02), now)


def laws(part, vehicle):
    return {
        "preview": part("preview").PreviewSteering(vehicle, part("preview").PreviewTuning()),
        "pure_pursuit": part("pure_pursuit").PurePursuit(vehicle),
        "stanley": part("stanley").Stanley(vehicle),
        "lqr": part("lqr").LateralRegulator(vehicle, 0.02),
    }


@pytest.mark.thorough(witnesses=1)
@pytest.mark.parametrize("law", ["preview", "pure_pursuit", "stanley", "lqr"])
@pytest.mark.parametrize("radius", [20.0, 50.0])
def test_on_a_circle_without_slip_every_law_asks_for_its_angle(part, law, radius):
    now = observation(circle(radius), 30.0, 5.0)
    exact = FUSION.wheelbase / radius
    assert steered(part, laws(part, NO_SLIP)[law], NO_SLIP, now) == pytest.approx(exact, rel=0.01)


@pytest.mark.thorough(witnesses=1)
@pytest.mark.parametrize("law", ["preview", "pure_pursuit", "stanley", "lqr"])
def test_with_slip_they_ask_for_what_holds_the_yaw_rate(part, law):
    """Steady circle: yaw rate = V delta / (L + K V^2), the rear axle drifting by what its tyres need."""
    speed, path = 15.0, circle(120.0)
    slip = part("deviation").steady_sideslip(FUSION, speed, 1.0 / 120.0)
    angle = steered(part, laws(part, FUSION)[law], FUSION, observation(path, 60.0, speed, slip=slip))
    factor = FUSION.wheelbase + FUSION.understeer_gradient * speed**2
    assert speed * angle / factor == pytest.approx(speed / 120.0, rel=0.02)


@pytest.mark.thorough
@pytest.mark.parametrize("law", ["preview", "pure_pursuit", "stanley", "lqr"])
def test_they_steer_back_and_mirror(part, law):
    path = ReferencePath.from_points([0.0, 200.0], [0.0, 0.0])
    made = laws(part, FUSION)[law]
    left = steered(part, made, FUSION, observation(path, 50.0, 8.0, d=0.4, turned=0.05, slip=0.0))
    right = steered(part, made, FUSION, observation(path, 50.0, 8.0, d=-0.4, turned=-0.05, slip=0.0))
    assert left < -0.01
    assert right == pytest.approx(-left)


def rolled(part, law, speed: float, d: float, seconds: float) -> list[Observation]:
    """A car without slip or lag on a straight road under a law."""
    path = ReferencePath.from_points([0.0, 1000.0], [0.0, 0.0])
    x, y, heading, wheel, states = 10.0, d, 0.0, 0.0, []
    for _ in range(round(seconds / STEP)):
        pose = Pose(0.0, Point.REAR_AXLE, x, y, heading, speed, 0.0, speed * wheel / FUSION.wheelbase, 0.0, 0.0)
        now = Observation(0, 0.0, pose, path, speed, {"radar": NOTHING}, math.nan)
        states.append(now)
        wheel = steered(part, law, NO_SLIP, now)
        x, y = x + speed * STEP * math.cos(heading), y + speed * STEP * math.sin(heading)
        heading += speed * STEP * math.tan(wheel) / FUSION.wheelbase
    return states


@pytest.mark.thorough
def test_stanley_brings_the_front_axle_in_at_its_rate(part, monkeypatch):
    speed, rate = 10.0, 0.8
    stanley = part("stanley")
    monkeypatch.setattr(stanley, "SOFTENING", 0.0)
    monkeypatch.setattr(stanley, "YAW_DAMPING", 0.0)
    states = rolled(part, stanley.Stanley(NO_SLIP, rate), speed, 0.2, 3.0)
    front = [now.pose.y + FUSION.wheelbase * math.sin(now.pose.heading) for now in states]
    for i in (100, 200, 400, 560):
        assert front[i] == pytest.approx(front[0] * math.exp(-rate * i * STEP), rel=0.02)


@pytest.mark.thorough
@pytest.mark.parametrize("speed", [3.0, 12.0])
def test_preview_dies_out_over_the_way_like_a_second_order_system(part, speed):
    """Without the derivative: damping 1/sqrt(2) at the wave number sqrt(2)/ls, so h(s) is known in closed form."""
    preview = part("preview")
    tuning = preview.PreviewTuning(derivative_time=0.0)
    look_ahead = tuning.at(NO_SLIP, speed).look_ahead
    states = rolled(part, preview.PreviewSteering(NO_SLIP, tuning), speed, 0.1, 4.0 * look_ahead / speed)
    for now in states[:: len(states) // 20]:
        z = (now.pose.x - 10.0) / look_ahead
        assert now.pose.y == pytest.approx(0.1 * math.exp(-z) * (math.cos(z) + math.sin(z)), abs=1e-3)


def test_the_observer_learns_a_misalignment_and_takes_it_out(part):
    path, misaligned = ReferencePath.from_points([0.0, 500.0], [0.0, 0.0]), math.radians(0.5)
    observer = part("deviation").DeviationObserver(FUSION)
    for i in range(400):
        pose = Pose(i * 0.02, Point.REAR_AXLE, 0.2 * i, 0.0, misaligned, 10.0, -10.0 * math.tan(misaligned),
                    0.0, 0.0, 0.0)  # fmt: skip
        deviation = observer.step(pose, path, path.project(pose.x, pose.y, pose.x), 0.02)
        assert deviation.heading_error == pytest.approx(misaligned * math.exp(-(i + 1) * 0.02), abs=2e-4)
    assert deviation.d == pytest.approx(0.0)


def test_the_tyres_response_time_is_the_lag_of_a_ramp(part):
    """Steering ramped into the single track: the rear axle's lateral acceleration trails by that time."""
    speed = 15.0
    cf, cr = FUSION.cornering_stiffness_front, FUSION.cornering_stiffness_rear
    lf, lr, m, inertia = 1.27, 2.85 - 1.27, FUSION.mass, FUSION.yaw_inertia
    across = yaw = 0.0
    dt = 1e-4
    for i in range(50_000):
        steering = 0.01 * i * dt
        front, rear = cf * (steering - (across + lf * yaw) / speed), -cr * (across - lr * yaw) / speed
        across_rate, yaw_rate = (front + rear) / m - speed * yaw, (lf * front - lr * rear) / inertia
        rear_acceleration = across_rate - lr * yaw_rate + speed * yaw
        across, yaw = across + across_rate * dt, yaw + yaw_rate * dt
    curvature = rear_acceleration / speed**2
    static = 0.01 * 50_000 * dt / (FUSION.wheelbase + FUSION.understeer_gradient * speed**2)
    slope = static / (50_000 * dt)
    expected = part("deviation").tyre_response_time(FUSION, speed)
    assert (static - curvature) / slope == pytest.approx(expected, rel=0.01)
    assert expected > 0.1


def test_trim_learns_the_steering_zero_only_while_it_moves_and_within_bounds(part):
    trim = part("trim").SteeringTrim(FUSION, 0.25, 0.8, 4.0)
    assert trim.step(0.2, 0.3, 0.02, saturated=False) == 0.0
    assert trim.step(0.2, 5.0, 0.02, saturated=True) == 0.0
    assert trim.step(0.2, 5.0, 0.02, saturated=False) == pytest.approx(-0.25 * 2 * 2.85 / 64.0 * 0.2 * 0.1)
    for _ in range(100_000):
        trim.step(5.0, 5.0, 0.02, saturated=False)
    assert trim.angle == -0.02


def test_lqr_gains_are_the_reference_ones(part):
    """BMW 320i at 10 m/s, Q = diag(1, 0, 0, 0), R = 1, computed with python-control 0.10.2."""
    lqr = part("lqr")
    discrete = lqr.gains(BMW, 10.0, 0.02, (1.0, 0.0, 0.0, 0.0), 1.0)
    np.testing.assert_allclose(discrete, [0.912855, 0.039062, 1.389415, 0.048718], rtol=2e-5)
    a, b = lqr.lateral_error_model(BMW, 10.0)
    continuous, _, poles = control.lqr(a, b, np.diag([1.0, 0.0, 0.0, 0.0]), [[1.0]])
    np.testing.assert_allclose(continuous[0], [1.0, 0.041904, 1.428692, 0.049636], rtol=2e-5)
    expected = np.array([-4.4798 + 4.2364j, -4.4798 - 4.2364j, -21.627 + 2.388j, -21.627 - 2.388j])
    np.testing.assert_allclose(np.sort_complex(poles), np.sort_complex(expected), atol=1e-3)
    sampled = control.c2d(control.ss(a, b, np.eye(4), 0.0), 0.02)
    moduli = np.sort(np.abs(np.linalg.eigvals(sampled.A - sampled.B @ discrete[None, :])))
    np.testing.assert_allclose(moduli, [0.6489, 0.6489, 0.9143, 0.9143], atol=1e-4)


def test_swept_margins_are_the_reference_ones(part):
    """The same car's loop: 67.16 deg at 9.918 rad/s, so 0.118 s of delay; with 0.2 s it is unstable."""
    a, b = part("lqr").lateral_error_model(BMW, 10.0)
    k = control.lqr(a, b, np.diag([1.0, 0.0, 0.0, 0.0]), [[1.0]])[0]
    loop, design = control.ss(a, b, k, 0.0), part("design")
    found = design.swept_margins(design.FREQUENCIES, loop(1j * design.FREQUENCIES))
    assert found.phase_deg == pytest.approx(67.16, abs=0.01)
    assert found.delay == pytest.approx(math.radians(67.16) / 9.918, rel=1e-3)
    for delay, stable in ((0.11, True), (0.125, False), (0.2, False)):
        closed = control.feedback(control.ss(control.tf(*control.pade(delay, 4))) * loop)
        assert bool(control.poles(closed).real.max() < 0.0) is stable


def test_the_designs_margins_are_those_of_python_control(part):
    """The whole loop, dead time by Pade: gain, phase and delay margin over speed."""
    design, tuning = part("design"), part("preview").PreviewTuning()
    for row in design.margins(FUSION, speeds=(4.5, 11.2, 20.1)):
        a, b, k = design.preview_model(FUSION, tuning, row.speed)
        dead = control.ss(control.tf(*control.pade(FUSION.steering_delay, 4)))
        gains, phases, _, _, crossovers, _ = control.stability_margins(dead * control.ss(a, b, k, 0.0), returnall=True)
        assert row.gain_margin_db == pytest.approx(20.0 * math.log10(min(gains[gains > 1.0])), abs=0.01)
        delays = np.radians(phases % 360.0) / crossovers
        assert row.delay_margin == pytest.approx(delays.min(), rel=1e-3)
        assert row.phase_margin_deg == pytest.approx(phases[delays.argmin()] % 360.0, abs=0.05)


def test_the_design_bears_the_latency_of_a_rig_and_refuses_more(part):
    design = part("design")
    rows = design.margins(FUSION)
    assert [row.speed for row in rows] == list(design.SPEEDS)
    assert min(row.phase_margin_deg for row in rows) > 40.0
    assert min(row.gain_margin_db for row in rows) > 10.0
    design.check(rows, 0.1)
    worst = min(row.delay_margin for row in rows)
    assert 0.35 < worst < 0.45
    with pytest.raises(ConfigError, match=rf"bears {1e3 * worst:.0f} ms of latency, 450 ms are stated"):
        design.check(rows, 0.45)
    assert len(design.table(rows).splitlines()) == 1 + len(rows)


def test_the_delay_margin_is_where_the_closed_loops_poles_cross(part):
    design, tuning = part("design"), part("preview").PreviewTuning()
    row = design.margins(FUSION, speeds=(13.4,))[0]
    a, b, k = design.preview_model(FUSION, tuning, 13.4)
    for share, stable in ((0.97, True), (1.03, False)):
        dead = control.ss(control.tf(*control.pade(FUSION.steering_delay + share * row.delay_margin, 4)))
        closed = control.feedback(dead * control.ss(a, b, k, 0.0))
        assert bool(control.poles(closed).real.max() < 0.0) is stable


def test_d_stability_holds_over_the_box_and_fails_for_a_nervous_design(part):
    design, preview = part("design"), part("preview")
    assert design.d_unstable(FUSION, preview.PreviewTuning()) == []
    assert (20.1, 0.8) in design.d_unstable(FUSION, preview.PreviewTuning(look_ahead_time=0.3))


def test_the_design_examines_what_is_driven(part):
    design, tuning = part("design"), part("follow_and_stop").TUNING
    driven = part("preview").PreviewTuning(tuning["look_ahead_time_s"], tuning["look_ahead_least_m"])
    assert tuning["steering"] == "preview"
    assert design.DEFAULT.at(FUSION, 15.0) == driven.at(FUSION, 15.0)
    assert tuning["trim_share"] == design.TRIM_SHARE

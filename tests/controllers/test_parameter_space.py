"""The parameter space against brute force: eigenvalues on a grid, and gains that put a pole on the edge."""

from __future__ import annotations

import cmath
import math
from dataclasses import replace

import control
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.controllers.street import FUSION
from vve_sumo.errors import ConfigError

LAG = 0.08  #: of the smoothing of the yaw rate [s]


def plane_at(part, speed: float, lag: float = LAG, trim_share: float = 0.25):
    look_ahead = max(4.0, 0.8 * speed)
    trim = trim_share * 2.0 * FUSION.wheelbase / look_ahead**3 * speed
    return part("parameter_space").PlaneOfGains(FUSION, speed, look_ahead, trim, lag)


def closed_poles(part, plane, kp: float, kd: float, corner, order: int = 10) -> np.ndarray:
    """Poles of the loop by the gain design's own state space, dead time by a Pade approximation of high order."""
    gains = part("gain_schedule").GainSchedule([(0.0, plane.look_ahead, kp, kd)])
    share = plane.trim * plane.look_ahead**3 / (2.0 * FUSION.wheelbase * plane.speed)
    true = replace(FUSION, mass=corner.mass_factor * FUSION.mass, yaw_inertia=corner.mass_factor * FUSION.yaw_inertia)
    a, b, k = part("design").preview_model(true, gains, plane.speed, share, plane.yaw_rate_lag)
    dead = control.ss(control.tf(*control.pade(FUSION.steering_delay + corner.delay, order)))
    return control.poles(control.feedback(dead * control.ss(a, b, k, 0.0)))


@pytest.mark.parametrize("speed", [2.2, 11.2, 20.1])
@pytest.mark.parametrize("corner", [(0.9, 0.0), (1.25, 0.06), (1.0, 0.15)])
def test_the_argument_principle_counts_what_eigenvalues_show(part, speed, corner):
    """On a grid of gains; where eigenvalues and Cauchy differ, a pole lies within a hair of the edge: none here."""
    space = part("parameter_space")
    plane, region, corner = plane_at(part, speed), space.Region(), space.Corner(*corner)
    kp, kd = np.meshgrid(np.linspace(0.02, 0.8, 7) * plane.limits[0], np.linspace(0.0, 0.8, 6) * plane.limits[1])
    inside = plane.inside(kp, kd, region, corner)
    # A Pade approximation is exact to about 90 rad/s here; the region asks nothing of pairs beyond its radius.
    brute = [
        all(region.holds(complex(pole)) for pole in closed_poles(part, plane, *gains, corner) if abs(pole) < 90.0)
        for gains in zip(kp.flat, kd.flat, strict=True)
    ]
    assert inside.ravel().tolist() == brute
    assert 0 < sum(brute) < len(brute)


@settings(deadline=None, max_examples=40)
@given(speed=st.floats(2.2, 20.0), piece=st.integers(0, 4), share=st.floats(0.05, 0.95))
def test_gains_on_a_boundary_have_a_pole_on_the_edge(part, speed, piece, share):
    """The closed forms put into the characteristic equation, dead time and all, written here once more."""
    space = part("parameter_space")
    plane, region, corner = plane_at(part, speed), space.Region(), space.Corner(1.1, 0.05)
    real, curve = plane.boundaries(region, corner)[piece]
    assert real is (piece == 0)
    at = round(share * (len(curve) - 1))
    kp, kd = curve[at].tolist()
    poles = np.array([complex(-region.decay, 0.0)] * len(curve))
    if not real:
        points = region.edge()[piece - 1]
        poles = points[points.imag > 0.0]
    s = complex(poles[at])
    assert abs(characteristic(plane, s, kp, kd, corner)) < 1e-6 * (1.0 + abs(kp) + abs(kd))


def characteristic(plane, s: complex, kp: float, kd: float, corner) -> complex:
    """1 + L(s) by solving the single track's equations at s."""
    m, inertia = corner.mass_factor * FUSION.mass, corner.mass_factor * FUSION.yaw_inertia
    cf, cr, v = FUSION.cornering_stiffness_front, FUSION.cornering_stiffness_rear, plane.speed
    lf, lr = FUSION.front_axle_to_mass, FUSION.wheelbase - FUSION.front_axle_to_mass
    matrix = np.array([
        [m * s + (cf + cr) / v, m * v + (lf * cf - lr * cr) / v],
        [(lf * cf - lr * cr) / v, inertia * s + (lf**2 * cf + lr**2 * cr) / v],
    ])  # fmt: skip
    across, yaw = np.linalg.solve(matrix, np.array([cf, lf * cf], dtype=complex))
    wheel = cmath.exp(-(FUSION.steering_delay + corner.delay) * s) / (FUSION.steering_lag * s + 1.0)
    heading = yaw / s
    d = (across - lr * yaw + v * heading) / s
    law = kp * (d + plane.look_ahead * heading)
    law += kd * (v * heading + plane.look_ahead * yaw / (plane.yaw_rate_lag * s + 1.0)) + plane.trim * d / s
    return 1.0 + law * wheel


def test_a_boundary_of_a_textbook_plant_is_the_known_one(part):
    """Without slip and lag: (1 + kd ls v / L) s^2 + v / L (kd v + kp ls) s + kp v^2 / L, as the tyres stiffen.

    With the lead m = 1 + kd ls v / L, poles at -sigma +- j w lie on kp = m (sigma^2 + w^2) L / v^2 and
    kd = (2 sigma m L / v - kp ls) / v.
    """
    space, v, look_ahead = part("parameter_space"), 5.0, 4.0
    stiff = replace(
        FUSION, cornering_stiffness_front=1e11, cornering_stiffness_rear=1e11, steering_delay=0.0, steering_lag=0.0,
        yaw_inertia=FUSION.mass * FUSION.front_axle_to_mass * (FUSION.wheelbase - FUSION.front_axle_to_mass),
    )  # fmt: skip
    plane, region = space.PlaneOfGains(stiff, v, look_ahead), space.Region(0.5, 0.3, 60.0)
    _real, curve = plane.boundaries(region, space.Corner(1.0, 0.0))[1]
    w = region.edge()[0].imag[1:]
    kp = (0.25 + w**2) * FUSION.wheelbase / v**2
    lead = 1.0 + curve[:, 1] * look_ahead * v / FUSION.wheelbase
    kd = (2.0 * 0.5 * lead * FUSION.wheelbase / v - curve[:, 0] * look_ahead) / v
    np.testing.assert_allclose(curve[:, 0], kp * lead, rtol=1e-4)
    np.testing.assert_allclose(curve[:, 1], kd, rtol=1e-3, atol=1e-6)


def test_gains_of_a_schedule_are_inside_between_its_speeds_too(part):
    space, preview = part("parameter_space"), part("preview")
    planes = space.planes(FUSION, preview.PreviewTuning(), delay=0.06, yaw_rate_lag=LAG)
    assert all(one.driven_is_good for one in planes)
    rows = [(one.plane.speed, *one.central) for one in planes]
    between = np.linspace(rows[0][0], rows[-1][0], 25).tolist()
    space.refuse_outside(FUSION, part("gain_schedule").GainSchedule(rows), delay=0.06, speeds=between, yaw_rate_lag=LAG)
    for one in planes:
        column, row = (int(np.searchsorted(axis, gain)) for axis, gain in
                       zip((one.proportional, one.derivative), one.central[1:], strict=True))  # fmt: skip
        assert one.good[row, column]


def test_gains_outside_are_refused_by_speed_mass_and_delay(part):
    space, preview = part("parameter_space"), part("preview")
    nervous = preview.PreviewTuning(look_ahead_time=0.3)
    with pytest.raises(ConfigError, match=r"at 11\.2 m/s, 0\.9 times the declared mass and \d+ ms of delay .* outside"):
        space.refuse_outside(FUSION, nervous, delay=0.06, speeds=[11.2], yaw_rate_lag=LAG)
    usual = preview.PreviewTuning()
    space.refuse_outside(FUSION, usual, delay=0.06, speeds=[11.2], yaw_rate_lag=LAG)
    with pytest.raises(ConfigError, match="150 ms of delay"):
        space.refuse_outside(FUSION, usual, delay=0.15, speeds=[11.2], yaw_rate_lag=LAG)


def test_a_region_without_good_gains_has_no_centre(part):
    space, preview = part("parameter_space"), part("preview")
    hopeless = space.planes(FUSION, preview.PreviewTuning(), delay=0.8, speeds=[15.6], yaw_rate_lag=LAG)[0]
    assert hopeless.central is None
    assert not hopeless.good.any()


def test_a_step_swings_less_than_the_regions_damping_allows(part):
    """Central gains, dead time exact: swings about the aim shrink by exp(-pi D / sqrt(1 - D^2)) at least."""
    space, preview = part("parameter_space"), part("preview")
    one = space.planes(FUSION, preview.PreviewTuning(), delay=0.06, speeds=[11.2], yaw_rate_lag=LAG)[0]
    poles = closed_poles(part, one.plane, *one.central[1:], space.Corner(1.25, 0.06))
    for pole in poles[(poles.imag > 0.0) & (np.abs(poles) < 60.0)]:
        swing = math.exp(-math.pi * -pole.real / pole.imag)
        assert swing <= math.exp(-math.pi * 0.3 / math.sqrt(1.0 - 0.09))


@pytest.mark.parametrize(
    "rows",
    [[], [(2.0, 4.0, 0.1, 0.1)] * 2, [(2.0, 4.0, math.nan, 0.1)], [(2.0, 4.0, -0.1, 0.1)], [(2.0, 0.0, 0.1, 0.1)]],
)
def test_a_schedule_that_is_none_is_refused(part, rows):
    with pytest.raises(ValueError, match="gain schedule needs"):
        part("gain_schedule").GainSchedule(rows)


def test_a_schedule_between_its_rows_and_beyond(part):
    """Straight between rows are the look-ahead, 4 to 8 m, and the gains times its square: 4.8 to 6.4, 0.32 to 0.64."""
    schedule = part("gain_schedule").GainSchedule([(2.0, 4.0, 0.3, 0.02), (6.0, 8.0, 0.1, 0.01)])
    assert schedule.at(FUSION, 1.0) == schedule.at(FUSION, 2.0) == (4.0, 0.3, 0.02)
    assert schedule.at(FUSION, 3.0) == pytest.approx((5.0, 5.2 / 25.0, 0.4 / 25.0))
    assert schedule.at(FUSION, 6.0) == schedule.at(FUSION, 60.0) == (8.0, 0.1, 0.01)

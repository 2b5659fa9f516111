"""The parameter space of the preview steering: for which of its gains the closed loop's poles lie where they shall.

For every complex s the closed loop's 1 + L(s) is linear in the proportional and the derivative gain, dead time
included. So the gains with a pole at s are known in closed form, and those with one on the edge of the region D are
curves (Ackermann, Robust Control: The Parameter Space Approach, 2nd ed., 2002, chapter 2): a line for a real pole (real
root boundary) and a curve for a pair (complex root boundary). An infinite root boundary there is none: between request
and deviation lie the steering's lag and two integrals, so that no gain lifts a pole to infinity.

Whether a point of the plane is inside is told by Cauchy's argument principle along that edge, with exact dead time.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vve_sumo.errors import ConfigError
from vve_sumo.path import Floats
from vve_sumo.values import Vehicle

from .gain_schedule import Schedule
from .preview import Gains
from .single_track import tyre_model

SPEEDS = (2.2, 4.5, 6.7, 8.9, 11.2, 13.4, 15.6, 17.9, 20.1)  #: 5 to 45 mph in steps of 5 [m/s]
MASS_FACTORS: Final = (0.9, 1.25)  #: true over declared mass, and yaw inertia with it: one occupant, fully laden
GRID: Final = 61  #: points of each gain's axis
RANGE: Final = (2.5, 0.4)  #: of the plane: proportional gain over 2 (L + K V^2) / ls^2, and its derivative time [s]
POINTS: Final = 120  #: on each piece of the edge
TOP: Final = 3000.0  #: beyond this frequency the loop is negligible [rad/s]

Complexes = NDArray[np.complex128]
Booleans = NDArray[np.bool_]


class Region(NamedTuple):
    """Where closed-loop poles shall lie (D-stability): all left of the decay, and those within the radius damped."""

    decay: float = 0.15  #: real parts below minus this [1/s]; the slowest pole is the trim's
    damping: float = 0.3  #: at least, of each pair within the radius: each swing is less than 0.4 of the one before
    radius: float = (
        60.0  #: up to which pairs count [rad/s]; dead time has pairs at every frequency, beyond it negligible
    )

    def edge(self) -> list[Complexes]:
        """Return the pieces of the region's edge in the upper half plane, from the real axis to the top [rad/s]."""
        angle, decay, radius = math.acos(self.damping), self.decay, self.radius
        first, last = decay * math.tan(angle), math.sqrt(radius * radius - decay * decay)
        upright = -decay + 1j * np.concatenate(([0.0], np.geomspace(1e-3 * first, first, POINTS)))
        ray = np.geomspace(decay / self.damping, radius, POINTS) * complex(-self.damping, math.sin(angle))
        turn = np.linspace(math.pi - angle, math.atan2(last, -decay), POINTS)
        return [upright, ray, radius * np.exp(1j * turn), -decay + 1j * np.geomspace(last, TOP, POINTS)]

    def holds(self, pole: complex) -> bool:
        """Tell whether a pole lies inside."""
        damped = abs(pole) > self.radius or -pole.real >= self.damping * abs(pole)
        return pole.real < -self.decay and damped


class Corner(NamedTuple):
    """A car and a delay for which gains shall be good."""

    mass_factor: float  #: true over declared mass, and yaw inertia with it
    delay: float  #: dead time beyond the steering's own [s]


def corners(delay: float, mass_factors: Sequence[float] = MASS_FACTORS) -> list[Corner]:
    """Return the corners of the box from the least to the greatest mass, and from no further delay to `delay` [s]."""
    return [Corner(mass, late) for mass in mass_factors for late in sorted({0.0, delay})]


@dataclass(frozen=True)
class PlaneOfGains:
    """The gains' plane at one speed: the loop as 1 + T(s) + kp A(s) + kd B(s)."""

    vehicle: Vehicle  #: as declared
    speed: float  #: [m/s]
    look_ahead: float  #: of the law [m]
    trim: float = 0.0  #: gain of the steering trim on the offset's integral [rad/(m s)]
    yaw_rate_lag: float = 0.0  #: of the smoothing of the yaw rate that the law is given [s]

    @cached_property
    def limits(self) -> tuple[float, float]:
        """Greatest proportional [rad/m] and derivative gain [rad s/m] that are looked at."""
        vehicle, speed = self.vehicle, self.speed
        usual = 2.0 * (vehicle.wheelbase + vehicle.understeer_gradient * speed * speed) / self.look_ahead**2
        return RANGE[0] * usual, RANGE[1] * usual

    def terms(self, s: Complexes, corner: Corner) -> tuple[Complexes, Complexes, Complexes]:
        """Return T, A and B at complex frequencies [rad/s]."""
        vehicle, v = self.vehicle, self.speed
        a11, a12, a21, a22, b1, b2 = tyre_model(_laden(vehicle, corner.mass_factor), v)
        rear, lag = vehicle.wheelbase - vehicle.front_axle_to_mass, vehicle.steering_lag
        late = np.exp(-(vehicle.steering_delay + corner.delay) * s) / (lag * s + 1.0)
        tyres = (s - a11) * (s - a22) - a12 * a21
        yaw_rate = late * ((s - a11) * b2 + a21 * b1) / tyres
        sideways = late * ((s - a22) * b1 + a12 * b2) / tyres - rear * yaw_rate
        heading = yaw_rate / s
        offset = (sideways + v * heading) / s
        given = yaw_rate / (self.yaw_rate_lag * s + 1.0)
        return self.trim * offset / s, offset + self.look_ahead * heading, self.look_ahead * given + v * heading

    def inside(self, proportional: Floats, derivative: Floats, region: Region, corner: Corner) -> Booleans:
        """Tell for gains, arrays of one shape, whether all poles of the closed loop lie in the region."""
        s = np.concatenate(region.edge())
        constant, a, b = self.terms(s, corner)
        kp, kd = (np.asarray(gain, dtype=np.float64).reshape(-1, 1) for gain in (proportional, derivative))
        loop = 1.0 + constant + kp * a + kd * b
        turned = np.angle(loop[:, 1:] / loop[:, :-1]).sum(axis=1)
        # Cauchy: the lower half turns as much. Of 1 + L the poles outside D are known, and the zeros there wanted.
        outside = self._open_poles_outside(region, corner) - np.round(turned / math.pi)
        inside: Booleans = (outside == 0).reshape(np.shape(proportional))
        return inside

    def boundaries(self, region: Region, corner: Corner) -> list[tuple[bool, Floats]]:
        """Return the gains with a pole on the region's edge, in closed form: arrays (n, 2) of both gains.

        True goes with the real root boundary, a line through the plane; False with complex root boundaries, one for
        each piece of the edge.
        """
        decay = np.array([complex(-region.decay, 0.0)])
        constant, a, b = (term.real[0] for term in self.terms(decay, corner))
        kd = np.array([0.0, self.limits[1]])
        curves = [(True, np.column_stack((-(1.0 + constant + kd * b) / a, kd)))]
        for piece in region.edge():
            s = piece[piece.imag > 0.0]
            constant, a, b = self.terms(s, corner)
            # Two real equations, the real and the imaginary part of 1 + T + kp A + kd B = 0.
            determinant = a.real * b.imag - a.imag * b.real
            rest = 1.0 + constant
            kp = (rest.imag * b.real - rest.real * b.imag) / determinant
            kd = (rest.real * a.imag - rest.imag * a.real) / determinant
            curves.append((False, np.column_stack((kp, kd))))
        return curves

    def _open_poles_outside(self, region: Region, corner: Corner) -> int:
        """Count the poles of the open loop that lie outside the region."""
        a11, a12, a21, a22, _b1, _b2 = tyre_model(_laden(self.vehicle, corner.mass_factor), self.speed)
        tyres = np.roots([1.0, -(a11 + a22), a11 * a22 - a12 * a21])
        lags = [-1.0 / lag for lag in (self.vehicle.steering_lag, self.yaw_rate_lag) if lag > 0.0]
        integrals = 3 if self.trim != 0.0 else 2
        return integrals + sum(not region.holds(complex(pole)) for pole in (*tyres.tolist(), *lags))


@dataclass(frozen=True)
class SpeedPlane:
    """What the plane of gains holds at one speed: gains that are good at every corner, and those that are chosen."""

    plane: PlaneOfGains
    proportional: Floats  #: of the grid's columns [rad/m]
    derivative: Floats  #: of the grid's rows [rad s/m]
    good: Booleans  #: at every corner, a row for each derivative gain
    boundaries: list[tuple[bool, Floats]]  #: of all corners: whether of a real root, and the curve
    driven: Gains  #: of the law that drives
    driven_is_good: bool
    central: Gains | None  #: those farthest from the region's edge; None where no gains are good


def planes(
    vehicle: Vehicle,
    schedule: Schedule,
    *,
    delay: float,
    speeds: Iterable[float] = SPEEDS,
    mass_factors: Sequence[float] = MASS_FACTORS,
    trim_share: float = 0.25,
    yaw_rate_lag: float = 0.0,
    region: Region = Region(),  # noqa: B008 (immutable)
) -> list[SpeedPlane]:
    """Return the plane of gains at each speed [m/s], for the masses and delays of the box up to `delay` [s]."""
    found = []
    for speed in speeds:
        plane, driven = _plane_of(vehicle, schedule, speed, trim_share, yaw_rate_lag)
        kp, kd = np.linspace(0.0, plane.limits[0], GRID), np.linspace(0.0, plane.limits[1], GRID)
        box = corners(delay, mass_factors)
        columns, rows = np.meshgrid(kp, kd)
        good = np.logical_and.reduce([plane.inside(columns, rows, region, corner) for corner in box])
        edges = [edge for corner in box for edge in plane.boundaries(region, corner)]
        inside, central = _is_good(plane, driven, region, box), _central(plane, kp, kd, good)
        found.append(SpeedPlane(plane, kp, kd, good, edges, driven, inside, central))
    return found


def refuse_outside(
    vehicle: Vehicle,
    schedule: Schedule,
    *,
    delay: float,
    speeds: Iterable[float],
    mass_factors: Sequence[float] = MASS_FACTORS,
    trim_share: float = 0.25,
    yaw_rate_lag: float = 0.0,
    region: Region = Region(),  # noqa: B008 (immutable)
) -> None:
    """Raise ConfigError, naming the first speed [m/s] and corner, where the gains are not good up to `delay` [s]."""
    for speed in speeds:
        plane, driven = _plane_of(vehicle, schedule, speed, trim_share, yaw_rate_lag)
        for corner in corners(delay, mass_factors):
            if not _is_good(plane, driven, region, [corner]):
                raise ConfigError(
                    f"steering gains: at {speed:.1f} m/s, {corner.mass_factor:g} times the declared mass and "
                    f"{1e3 * corner.delay:.0f} ms of delay kp {driven.proportional:.4f} rad/m and kd "
                    f"{driven.derivative:.4f} rad s/m are outside the D-stable region (decay {region.decay:g} 1/s, "
                    f"damping {region.damping:g}); vve-sumo study gains shows it"
                )


def _plane_of(
    vehicle: Vehicle, schedule: Schedule, speed: float, trim_share: float, yaw_rate_lag: float
) -> tuple[PlaneOfGains, Gains]:
    driven = Gains(*schedule.at(vehicle, speed))
    trim = trim_share * 2.0 * vehicle.wheelbase / driven.look_ahead**3 * speed
    return PlaneOfGains(vehicle, speed, driven.look_ahead, trim, yaw_rate_lag), driven


def _is_good(plane: PlaneOfGains, gains: Gains, region: Region, box: Sequence[Corner]) -> bool:
    kp, kd = np.array([gains.proportional]), np.array([gains.derivative])
    return all(bool(plane.inside(kp, kd, region, corner)[0]) for corner in box)


def _central(plane: PlaneOfGains, kp: Floats, kd: Floats, good: Booleans) -> Gains | None:
    """Return the gains of the grid that are farthest from the edge of those that are good, in steps of the grid."""
    from scipy.ndimage import distance_transform_edt

    if not good.any():
        return None
    distance = np.round(distance_transform_edt(np.pad(good, 1)), 9)[1:-1, 1:-1]
    row, column = np.unravel_index(int(distance.argmax()), good.shape)
    return Gains(plane.look_ahead, float(kp[column]), float(kd[row]))


def _laden(vehicle: Vehicle, factor: float) -> Vehicle:
    return replace(vehicle, mass=factor * vehicle.mass, yaw_inertia=factor * vehicle.yaw_inertia)

"""Targets that are not there, on every kind of wire, against plane geometry and the makers' own layouts of frames."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vve_sumo.certify.cases import CASES, RADAR, Scene
from vve_sumo.certify.phantoms import FIELD_OF_VIEW, Installation, MissedDetections, Phantom, Phantoms
from vve_sumo.certify.track import DrivenTrack
from vve_sumo.frames import local_frame
from vve_sumo.values import Actors, Detections, Fix, FixQuality, Frame, Point, Pose
from vve_sumo.wire import ars408, esr
from vve_sumo.wire.datagrams import decode_radar
from vve_sumo.wire.outputs import KINDS, Context
from vve_sumo.wire.sample import Sample, SampleContent, no_fix

TICK, SPEED, BUMPER, AGE = 0.02, 9.0, 3.8, 0.04
RADARS = (*RADAR, "osi_view")
INSTALLATION = Installation(BUMPER, local_frame(math.radians(40.0), math.radians(-83.0)), {})
CASE = {case.name: case for case in CASES}


def pose(time: float, curvature: float) -> Pose:
    """A car that has driven a circle from the origin, along the map's +x at first."""
    driven, heading = SPEED * time, SPEED * time * curvature
    x = math.sin(heading) / curvature if curvature else driven
    y = (1.0 - math.cos(heading)) / curvature if curvature else 0.0
    return Pose(time, Point.REAR_AXLE, x, y, heading, SPEED, 0.0, SPEED * curvature, 0.0, 0.0)


def track(curvature: float) -> DrivenTrack:
    """The track of ten seconds."""
    poses = [pose(TICK * n, curvature) for n in range(500)]
    columns = [np.array([getattr(one, name) for one in poses]) for name in ("time", "x", "y", "heading")]
    return DrivenTrack(*columns)


def sample(time: float, curvature: float, there: tuple[tuple[float, float, float], ...] = ()) -> Sample:
    """What the sensors see at a time, by a scan that is AGE old."""
    rows = np.array(there, np.float64).reshape(-1, 3)
    scan = Detections(time - AGE, rows[:, 0], rows[:, 1], rows[:, 2], np.zeros(len(rows), np.int8))
    fix = Fix(**{**_fields(no_fix(1000.0 + time, time)), "locked": True, "quality": FixQuality.RTK_FIXED})
    return Sample(
        round(time / TICK) + 1,
        1000.0 + time,
        time,
        SampleContent(fix, pose(time, curvature), scan, AGE, Actors.none(time)),
    )


def _fields(fix: Fix) -> dict[str, object]:
    return {name: getattr(fix, name) for name in fix.__slots__}


def seen(shown: Sample) -> list[tuple[float, float, float]]:
    """Range, azimuth and range rate of every detection."""
    assert shown.measured is not None
    scan = shown.measured.scan
    return list(zip(scan.range.tolist(), scan.azimuth.tolist(), scan.range_rate.tolist(), strict=True))


@settings(deadline=None)
@given(
    curvature=st.sampled_from([0.0, 0.015, -0.015]),
    ahead=st.floats(8.0, 25.0),
    aside=st.floats(-3.0, 3.0),
    pace=st.sampled_from([0.0, 0.5, 2.0]),
    after=st.floats(0.0, 0.5),
)
def test_a_phantom_is_where_plane_geometry_says(
    curvature: float, ahead: float, aside: float, pace: float, after: float
) -> None:
    begins, speed = 2.0, pace * SPEED
    fault = Phantoms(track(curvature), begins, INSTALLATION, [Phantom(ahead, aside, speed)])
    now = begins + after + AGE
    found = seen(fault.step(sample(now, curvature), True))
    along = SPEED * begins + BUMPER + ahead + speed * after
    target, car = pose(along / SPEED, curvature), pose(begins + after, curvature)
    tx, ty = target.x - aside * math.sin(target.heading), target.y + aside * math.cos(target.heading)
    dx = tx - car.x - BUMPER * math.cos(car.heading)
    dy = ty - car.y - BUMPER * math.sin(car.heading)
    azimuth = math.remainder(math.atan2(dy, dx) - car.heading, math.tau)
    if abs(azimuth) > FIELD_OF_VIEW - 0.01:
        return
    assert found[0][0] == pytest.approx(math.hypot(dx, dy), abs=0.05)
    assert found[0][1] == pytest.approx(azimuth, abs=0.005)


@pytest.mark.parametrize("curvature", [0.0, 0.015, -0.015])
@pytest.mark.parametrize("pace", [0.0, 0.5, 2.0])
def test_its_range_rate_is_the_rate_of_its_range(curvature: float, pace: float) -> None:
    fault = Phantoms(track(curvature), 2.0, INSTALLATION, [Phantom(15.0, 1.0, pace * SPEED)])
    before, now, later = (seen(fault.step(sample(2.3 + step, curvature), True))[0] for step in (-0.02, 0.0, 0.02))
    assert now[2] == pytest.approx((later[0] - before[0]) / 0.04, abs=0.03)


@pytest.mark.parametrize("curvature", [0.015, -0.015])
def test_the_mirror_image_has_the_other_azimuth_and_the_same_range(curvature: float) -> None:
    right, wrong = (
        seen(Phantoms(track(curvature), 2.0, INSTALLATION, [Phantom(20.0, mirrored=mirrored)]).step(
            sample(2.0 + AGE, curvature), True
        ))[0]
        for mirrored in (False, True)
    )  # fmt: skip
    assert math.copysign(1.0, right[1]) == math.copysign(1.0, curvature)
    assert wrong[0] == pytest.approx(right[0], abs=0.02)
    assert wrong[1] == pytest.approx(-right[1], abs=0.002)


def _left_by_layout(kind: str, portions: list[object]) -> list[float]:
    """Return the distance to the left of every target, by the bits of the makers' frames or another library.

    ESR: opendbc's ESR.dbc, TRACK_ANGLE 12|10@0-, scale 0.1 degrees, right positive, TRACK_RANGE 18|11@0+, scale 0.1.
    """
    if kind == "radar":
        (data,) = portions
        radar = decode_radar(data)  # type: ignore[arg-type]
        assert radar is not None
        return [one.range * math.sin(one.azimuth) for one in radar.targets]
    if kind.startswith("osi"):
        return _left_in_osi(kind, portions)
    left = []
    for frame in portions:
        assert isinstance(frame, Frame)
        if kind == "esr" and esr.FIRST_TRACK <= frame.id <= esr.LAST_TRACK and any(frame.data[1:4]):
            bits = int.from_bytes(frame.data, "big")
            raw = bits >> (64 - 8 - 3 - 10) & 0x3FF
            angle = 0.1 * (raw - 0x400 if raw & 0x200 else raw)
            left.append(-0.1 * (bits >> (64 - 16 - 5 - 11) & 0x7FF) * math.sin(math.radians(angle)))
        if kind == "ars408" and frame.id == ars408.GENERAL:
            left.append(0.2 * ((frame.data[2] & 0x07) << 8 | frame.data[3]) - 204.6)
    return left


def _left_in_osi(kind: str, portions: list[object]) -> list[float]:
    if kind == "osi_data":
        from osi3.osi_sensordata_pb2 import SensorData

        message = SensorData()
        message.ParseFromString(portions[0])
        return [
            one.position.distance * math.sin(one.position.azimuth)
            for one in message.feature_data.radar_sensor[0].detection
        ]
    from osi3.osi_sensorview_pb2 import SensorView

    view = SensorView()
    view.ParseFromString(portions[0])
    truth = view.global_ground_truth
    others = [one for one in truth.moving_object if one.id.value != truth.host_vehicle_id.value]
    # The car is at the origin of this test's map, along +x.
    return [one.base.position.y for one in others]


@pytest.mark.parametrize("kind", RADARS)
@pytest.mark.parametrize("side", [2.6, -2.6])
def test_a_target_lies_on_the_same_side_on_every_wire(kind: str, side: float) -> None:
    if kind.startswith("osi"):
        pytest.importorskip("osi3", reason="needs osi-python")
    from tests.certify.toy_street import PROJECTION, vehicle

    fault = Phantoms(track(0.0), 0.0, INSTALLATION, [Phantom(15.0, side)])
    output = KINDS[kind].make(Context(vehicle(), PROJECTION))
    left = _left_by_layout(kind, list(output.step(fault.step(sample(AGE, 0.0), True))))
    assert left == [pytest.approx(side, abs=0.2)]


def test_outside_of_its_window_and_without_a_scan_nothing_is_altered() -> None:
    for fault in (Phantoms(track(0.0), 2.0, INSTALLATION, [Phantom(15.0)]), MissedDetections(INSTALLATION)):
        healthy = sample(2.0, 0.0, ((20.0, 0.1, -9.0),))
        assert fault.step(healthy, False) is healthy
        invalid = Sample(1, 1000.0, 2.0, None)
        assert fault.step(invalid, True) is invalid


def test_what_is_there_stays_beside_the_phantoms_and_goes_missing_alone() -> None:
    there = (20.0, 0.1, -9.0)
    beside = Phantoms(track(0.0), 2.0, INSTALLATION, [Phantom(15.0)]).step(sample(2.0, 0.0, (there,)), True)
    assert seen(beside)[0] == there
    assert len(seen(beside)) == 2
    missing = MissedDetections(INSTALLATION).step(sample(2.0, 0.0, (there,)), True)
    assert seen(missing) == []
    assert missing.radar_valid


def test_rows_stand_on_both_sides_and_none_in_the_way() -> None:
    case = CASE["target_rows_beside"]
    assert case.make_scan_fault is not None
    shown = case.make_scan_fault(Scene(track(0.0), 2.0, INSTALLATION, SPEED)).step(sample(2.0 + AGE, 0.0), True)
    aside = [far * math.sin(azimuth) for far, azimuth, _rate in seen(shown)]
    assert sorted({round(each, 1) for each in aside}) == [-2.6, 2.6]
    assert sum(each > 0.0 for each in aside) == sum(each < 0.0 for each in aside) >= 4
    # In degrees, or with any azimuth, they would be in the way.
    assert all(abs(far * math.sin(math.radians(azimuth))) < 0.5 for far, azimuth, _rate in seen(shown))

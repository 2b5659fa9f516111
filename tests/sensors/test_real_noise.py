"""The virtual radar set to a real one's figures, on the real one's geometry: the same noise, quanta and rate.

The ego drives as the recorded car did, past targets that move as the recorded ones did. The recording, our radar and
our radar on the wire of an ESR are measured by the same functions.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import cantools.database
import numpy as np
import pytest
from scipy.signal import savgol_filter

from tests.sensors.denso import BREAK, Track, read_tracks, rows
from tests.sensors.scenes import BUMPER, FUSION, Row, actors, rear_axle
from vve_sumo.sensors.echo import Mount
from vve_sumo.sensors.radar import Radar, RadarConfig, RadarMode, RadarScan
from vve_sumo.values import Actors, Detections, Floats, Frame, Pose
from vve_sumo.wire.outputs import KINDS, Context
from vve_sumo.wire.sample import NO_SCAN, Sample, SampleContent, no_fix

TICK = 0.02
BEGIN, END = 0.0, 59.9  # of the drive in the recording [s]
#: reports of a window in which a target's motion is a parabola: 0.5 s
WINDOW = 11
#: a target that was reported less often has no smooth path of its own
LEAST = 21
EDGE = 0.01  # of a target's box: it is seen where it is [m]

#: What is said of the recording: noise of x about a parabola, quanta, period. Range rate and azimuth are its medians.
DENSO = RadarConfig(
    modes=(RadarMode(186.0, math.radians(17.5)),),
    mount=Mount(0.0),
    period=0.05,
    range_sigma=0.045,
    range_rate_sigma=0.029,
    azimuth_sigma=math.radians(0.037),
    range_quantum=0.04,
    range_rate_quantum=0.025,
    azimuth_quantum=0.0,
    detection_probability=1.0,
)


class Told(NamedTuple):
    """What a radar said in a minute: its scans' times, and its targets."""

    scans: Floats  #: [s]
    tracks: list[Track]

    def noise(self, column: str, nearer: float = math.inf, farther: float = 0.0) -> float:
        """Return the median standard deviation about a parabola over 0.5 s, of what is that far ahead [m]."""
        found = []
        for track in self.tracks:
            for begin in range(0, len(track.time) - WINDOW + 1, WINDOW // 2):
                time, ahead, values = (
                    one[begin : begin + WINDOW] for one in (track.time, track.ahead, getattr(track, column))
                )
                if farther < ahead.mean() < nearer:
                    basis = np.linalg.qr(np.vander(time - time.mean(), 3))[0]
                    left = values - basis @ (basis.T @ values)
                    found.append(math.sqrt(left @ left / (WINDOW - 3)))
        assert len(found) > 200
        return float(np.median(found))

    @property
    def intervals(self) -> Floats:
        """Return the times from scan to scan [s]."""
        return np.diff(self.scans)

    @property
    def reports(self) -> int:
        """Return how often targets with a smooth path of their own were reported."""
        return sum(len(track.time) for track in self.tracks if len(track.time) >= LEAST)

    def all(self, column: str) -> Floats:
        """Return the values of all reports."""
        return np.concatenate([getattr(track, column) for track in self.tracks])


def _step(values: Floats) -> float:
    """Return the least step between two values."""
    return float(np.diff(np.unique(values.round(6))).min())


@pytest.fixture(scope="module")
def real(shared_data: Path) -> Told:
    tracks = read_tracks(shared_data)
    times = np.sort(np.concatenate([track.time for track in tracks]))
    # The reports of a scan come within a few milliseconds.
    return Told(times[np.r_[True, np.diff(times) > TICK]], tracks)


@pytest.fixture(scope="module")
def poses(shared_data: Path) -> list[Pose]:
    """Return the ego's pose at every tick."""
    file = rows(shared_data / "drives/comma2k19/tidy_pose_20hz.csv")
    at, east, north, ve, vn, course = (
        np.array([row[name] for row in file]) for name in ("t", "east", "north", "ve", "vn", "course_deg")
    )
    heading = 0.5 * math.pi - np.unwrap(np.radians(course))
    now = np.arange(BEGIN, END, TICK)
    columns = (np.interp(now, at, c) for c in (east, north, heading, np.hypot(ve, vn), np.gradient(heading, at)))
    return [rear_axle(*map(float, row)) for row in zip(*columns, strict=True)]


@pytest.fixture(scope="module")
def street(real: Told, poses: list[Pose]) -> list[Actors]:
    """Return the targets at every tick, where and how fast they were: small boxes, so that none hides another."""
    smooth = [
        Track(track.time, *(savgol_filter(column, LEAST, 3) for column in track[1:]))
        for track in real.tracks
        if len(track.time) >= LEAST
    ]
    return [_at(BEGIN + tick * TICK, pose, smooth) for tick, pose in enumerate(poses)]


def _at(now: float, pose: Pose, targets: Sequence[Track]) -> Actors:
    found: list[Row] = []
    names: list[str] = []
    cos, sin = math.cos(pose.heading), math.sin(pose.heading)
    for number, track in enumerate(targets):
        if track.time[0] - 0.5 * DENSO.period <= now <= track.time[-1] + 0.5 * DENSO.period:
            ahead, aside, rate = (float(np.interp(now, track.time, column)) for column in track[1:])
            ahead += BUMPER
            place = pose.x + ahead * cos - aside * sin, pose.y + ahead * sin + aside * cos
            found.append((*place, pose.heading, pose.speed + rate, EDGE, EDGE, 10.0))
            names.append(str(number))
    return actors(found, names)


def minute(config: RadarConfig, poses: list[Pose], street: list[Actors]) -> list[tuple[int, RadarScan]]:
    """Drive our radar through the recorded minute; return its scans and the ticks at which they came out."""
    radar = Radar(config, FUSION, np.random.default_rng(11))
    steps = ((tick, radar.step(tick * TICK, pose, street[tick])) for tick, pose in enumerate(poses))
    return [(tick, scan) for tick, scan in steps if scan is not None]


@pytest.fixture(scope="module")
def scans(poses: list[Pose], street: list[Actors]) -> list[tuple[int, RadarScan]]:
    return minute(DENSO, poses, street)


@pytest.fixture(scope="module")
def ours(scans: list[tuple[int, RadarScan]]) -> Told:
    return outcomes(
        (scan.detections.time, zip(scan.actors, *_columns(scan.detections), strict=True)) for _, scan in scans
    )


def _columns(seen: Detections) -> tuple[Floats, Floats, Floats]:
    return seen.range * np.cos(seen.azimuth), seen.range * np.sin(seen.azimuth), seen.range_rate


def outcomes(scans: Iterable[tuple[float, Iterable[tuple[str | int, float, float, float]]]]) -> Told:
    """Return the tracks of scans: time, and name, x, y [m] and range rate [m/s] of every target."""
    times, reports = [], defaultdict(list)
    for time, targets in scans:
        times.append(time)
        for name, *values in targets:
            reports[name].append((time, *values))
    tracks = []
    for one in map(np.array, reports.values()):
        edges = [0, *(np.flatnonzero(np.diff(one[:, 0]) > BREAK) + 1).tolist(), len(one)]
        tracks += [Track(*one[begin:end].T) for begin, end in pairwise(edges)]
    return Told(np.array(times), tracks)


@pytest.mark.thorough
def test_the_geometry_is_the_recorded_one(real: Told, poses: list[Pose], street: list[Actors]) -> None:
    """An ideal radar sees the targets where the real one reported them, but for the real one's noise."""
    kept = [track for track in real.tracks if len(track.time) >= LEAST]
    off = []
    for _, scan in minute(DENSO.ideal(), poses, street):
        for name, *seen in zip(scan.actors, *_columns(scan.detections), strict=True):
            reported = (np.interp(scan.detections.time, kept[int(name)].time, column) for column in kept[int(name)][1:])
            off.append(np.subtract(seen, list(reported)))
    assert len(off) > 0.99 * real.reports
    for column, middle in zip(("ahead", "aside", "rate"), np.median(np.abs(off), axis=0), strict=True):
        assert middle < real.noise(column)


def test_the_recording_is_as_noisy_as_is_said_of_it(real: Told) -> None:
    assert real.noise("ahead") == pytest.approx(DENSO.range_sigma, rel=0.05)
    assert real.noise("ahead", nearer=40.0) == pytest.approx(0.038, rel=0.05)
    assert real.noise("ahead", farther=80.0) == pytest.approx(0.056, rel=0.05)
    assert real.noise("aside") == pytest.approx(0.038, rel=0.05)


@pytest.mark.thorough
def test_ours_is_as_noisy_as_the_real_one(real: Told, ours: Told) -> None:
    """As a whole; the real one's noise grows with the distance, ours is one figure, and lies between near and far."""
    for column in ("ahead", "aside", "rate"):
        assert ours.noise(column) == pytest.approx(real.noise(column), rel=0.05)
    for nearer, farther in ((40.0, 0.0), (math.inf, 80.0)):
        assert ours.noise("ahead", nearer, farther) == pytest.approx(real.noise("ahead", nearer, farther), rel=0.2)


def test_ours_has_the_quanta_of_the_real_one(real: Told, ours: Told, scans: list[tuple[int, RadarScan]]) -> None:
    """The real one rounds x, ours the range: straight ahead they are the same."""
    ranges = np.concatenate([scan.detections.range for _, scan in scans])
    assert _step(ranges) == pytest.approx(_step(real.all("ahead")), abs=1e-6)
    assert _step(ours.all("rate")) == pytest.approx(_step(real.all("rate")), abs=1e-6)


def test_ours_reports_as_often_as_the_real_one(real: Told, ours: Told) -> None:
    """On ticks of 20 ms, so that a scan comes up to half a tick before or after the real one's 50 ms."""
    for one in (real, ours):
        assert one.intervals.mean() == pytest.approx(DENSO.period, rel=1e-3)
        assert np.abs(one.intervals - DENSO.period).max() < 0.5 * TICK + 1e-3
    assert len(ours.scans) == pytest.approx(len(real.scans), rel=0.01)
    assert ours.reports == pytest.approx(real.reports, rel=0.01)
    assert max(np.unique(np.concatenate([track.time for track in ours.tracks]), return_counts=True)[1]) <= 14


@pytest.mark.thorough
def test_the_wire_of_an_esr_adds_its_own_quanta_and_nothing_else(
    shared_data: Path, poses: list[Pose], scans: list[tuple[int, RadarScan]], ours: Told
) -> None:
    """As a public description of its frames reads them: rounding to q adds a variance of q^2 / 12.

    The wire knows no names. Where the real radar had two tracks within half a metre, their numbers change places now
    and then, which the range does not show and the range rate does by 8 %.
    """
    database = cantools.database.load_file(shared_data / "dbc" / "ESR.dbc", strict=False)
    wire = outcomes(_over_esr(database, poses, scans))
    for column, quantum, within in (("ahead", 0.1, 0.05), ("rate", 0.01, 0.1)):
        expected = math.hypot(ours.noise(column), quantum / math.sqrt(12.0))
        assert wire.noise(column) == pytest.approx(expected, rel=within)
    assert wire.intervals.mean() == pytest.approx(DENSO.period, rel=1e-3)
    assert wire.reports == pytest.approx(ours.reports, rel=0.02)


def _over_esr(
    database: Any, poses: list[Pose], scans: list[tuple[int, RadarScan]]
) -> Iterator[tuple[float, list[tuple[int, float, float, float]]]]:
    """Give what each cycle of the ESR's frames says, as `told` wants it; every scan goes out once."""
    output, coming = KINDS["esr"].make(Context(FUSION, "")), dict(scans)
    newest = NO_SCAN
    for tick, pose in enumerate(poses):
        now = tick * TICK
        newest = coming[tick].detections if tick in coming else newest
        measured = SampleContent(no_fix(now, now), pose, newest, now - newest.time, actors([]))
        frames = [frame for frame in output.step(Sample(tick, 1.4e9 + now, now, measured)) if isinstance(frame, Frame)]
        if not frames or newest is NO_SCAN:
            continue
        assert tick in coming, "a cycle repeats a scan"
        yield newest.time, [_read(database, frame) for frame in frames if 0x500 <= frame.id < 0x540 and any(frame.data)]


def _read(database: Any, frame: Frame) -> tuple[int, float, float, float]:
    track = database.decode_message(frame.id, frame.data, decode_choices=False)
    far, angle = track["CAN_TX_TRACK_RANGE"], -math.radians(track["CAN_TX_TRACK_ANGLE"])
    return frame.id, far * math.cos(angle), far * math.sin(angle), track["CAN_TX_TRACK_RANGE_RATE"]

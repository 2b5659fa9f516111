"""Turns a sensor's detections into things on the path: where along it, how fast, how far beside it.

Every thing is kept by its s along the path, so what stands still keeps its place while the car moves, and
averages its noise away. It must not know what is done about the things.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from vve_sumo.path import Corridor, PathProjection, ReferencePath
from vve_sumo.values import Observation, Pose, Vehicle

from .assignment import assign
from .bank import LANE_CHANGERS, WALKERS, Bank
from .crossing import (
    COMES_OVER,
    CROSSES,
    ON_FOOT,
    PREDICTION_HORIZON,
    comes_over,
    crosses,
    probability_in,
    probability_of_cutting_in,
    will_be_in,
    will_have_left,
)
from .lane_keeping import KeptPlace
from .parting import goes_past, nearest_in_way
from .sightings import RATE_SIGMA, Memory, Radar, Sense, Sighting, sightings
from .trend import Trend

#: of the variance of d is the radar's own noise, the rest is caution: the bank takes no caution in
NOISE_SHARE: Final = 0.8
AGILITY: Final = 1.0  #: spectral density of a target's acceleration [m2/s3]
DRIFT: Final = 0.02  #: of a target that keeps its place across the path [m2/s]
LATERAL_SPEED, LATERAL_AGILITY = 4.0, 0.05  #: of one that crosses: to begin with [m/s], its spectral density [m2/s3]
DRIVES: Final = 3.0  #: what is faster than this along the path is a car that keeps its lane or changes it [m/s]
CHANGE_AGILITY: Final = 0.2  #: spectral density of its acceleration across the path [m2/s3]
BUS, TURNING = 12.5, 1.5  #: of a long body [m]; for so long [s] its nearest point may run along its flank
LENGTH: Final = 9.0  #: of a car that goes along and of the own, more than which it takes to get past it [m]
FRESH: Final = 0.13  #: who was seen longer ago than this may have gone straight on since [s]
SOON: Final = 2.0  #: it counts from so long before it is in the way [s]
LIKELY, DOUBTED = 0.4, -0.2  #: standard deviations by which it must be foreseen there to be followed, and on followed
CHANGE, JERK = 3.0, 1.5  #: of a target's acceleration: to begin with [m/s2], its spectral density [m2/s5]
BRAKES: Final = 3.0  #: standard deviations of acceleration that tell braking from noise
HARDER: Final = 2.0  #: standard deviations by which one who brakes may do so harder than it seems
#: What comes faster than this along the path is judged by where it is, not by where it will be, ... [m/s]
ONCOMING: Final = -2.0
#: ... unless it moves across by more than this share of its speed along the path: it crosses the way, as at a turn
OBLIQUE: Final = 0.5
FLANK, ASIDE = 3.0, math.tan(math.radians(40.0))  #: of a car seen so far to the side the point slides by so much [m]
GATE: Final = 3.5  #: standard deviations within which a detection belongs to a track
CONFIRMED: Final = 3  #: hits before a track counts
COAST, COAST_TENTATIVE, COAST_AT_REST = 0.6, 0.2, 5.0  #: a track lives on unseen for so long [s]
MARGIN: Final = 0.3  #: kept on both sides of the swept body [m]
HYSTERESIS: Final = 0.3  #: a target that is in the way must clear the band by this much to be out of it [m]
#: probability from which one who crosses, and a car that cuts in, is braked for; below which it is no longer
CROSSING_FROM, CUT_IN_FROM, FORESEEN_UNTIL = 0.5, 0.6, 0.3
#: a car that has left the place where it kept its lane by so much [m] is braked for partly from this probability on
WANDERS, LEAVES_FROM = 0.45, 0.25
KNOWN_LANE: Final = 0.2  #: standard deviation within which that place must be known [m]
CUTS_IN: Final = 1.3  #: a car that cuts in counts from so long before it is in the band [s]
#: Who crosses faster than this is judged by the one filter on place and speed, not by the bank [m/s]
BANK_COVERS: Final = 4.5
PASSES: Final = 0.2  #: for so long from the car's arrival on its front would meet one who crosses [s]
INSIDE: Final = 0.3  #: one who crosses must come this far into the band to count [m]: into the way of the body itself


class Target(NamedTuple):
    """The nearest thing in the way."""

    gap: float  #: along the path from the front bumper to its nearest point [m]
    speed: float  #: along the path [m/s], oncoming negative
    braking: float = 0.0  #: deceleration, where it surely brakes [m/s2]
    probability: float = 1.0  #: of being in the way when the car gets there; 1 for what is in the way now
    foreseen: bool = False  #: whether it is not in the way yet
    #: gap from the front bumper to the nearest place of the path that its straight course touches [m]; inf for a course
    #: that touches none, -inf where no course is foretold
    keeps_beyond: float = -math.inf


class Track:
    """Kalman filters: on s and speed, on the d of what keeps its place, and of what crosses.

    What crosses has a second one, a bank over its speeds: one speed and its variance foretell the place of a thing that
    crosses anyhow, the bank also says how probable it is that one who stands or keeps its lane comes at all. The last
    filter is on the speed alone: a target's acceleration is told from it.
    """

    __slots__ = (
        "across", "bank", "d", "d_variance", "foreseen", "hits", "in_way", "keeps_beyond", "lane", "p_s", "p_sv", "p_v",
        "pace", "paced", "part_of", "part_until", "probability", "s", "seen", "slide", "speed", "time",
    )  # fmt: skip

    def __init__(self, time: float, sighting: Sighting) -> None:
        self.time = self.seen = time
        self.s, self.d, self.d_variance = sighting.s, sighting.d, sighting.d_variance
        self.speed = 0.0 if math.isnan(sighting.speed) else sighting.speed
        self.across = Trend(sighting.d, sighting.d_variance, LATERAL_SPEED**2, LATERAL_AGILITY)
        self.bank = Bank(sighting.d, sighting.d_variance, WALKERS)
        self.lane = KeptPlace(time, sighting.d, sighting.d_variance)
        self.slide = sighting.slide
        self.foreseen, self.probability = False, 1.0  # as `Target` has them
        self.keeps_beyond = -math.inf  # as `Target` has it, but an s along the path
        self.p_s, self.p_sv = sighting.range_variance, 0.0
        self.p_v = sighting.rate_variance if math.isnan(sighting.speed) else self._rate_variance(sighting)
        self.pace = Trend(self.speed, self.p_v, CHANGE**2, JERK)
        self.paced = not math.isnan(sighting.speed)  # whether its speed was ever measured
        self.hits, self.in_way = 1, False
        self.part_of: Track | None = None  # of which body it may be another place, ...
        self.part_until = -math.inf  # ... until when [s]

    def predict(self, time: float) -> None:
        """Move on to a time [s] at constant speed."""
        dt = time - self.time
        self.time = time
        if time >= self.part_until:
            self.part_of = None
        self.s += self.speed * dt
        self.p_s += dt * (2.0 * self.p_sv + dt * self.p_v) + AGILITY * dt**3 / 3.0
        self.p_sv += dt * self.p_v + AGILITY * dt * dt / 2.0
        self.p_v += AGILITY * dt
        self.d_variance += DRIFT * dt
        self.across.density = CHANGE_AGILITY if self.drives else LATERAL_AGILITY
        self.across.predict(dt)
        habits = LANE_CHANGERS if self.drives else WALKERS
        if self.bank.habits is not habits:
            self.bank = Bank(self.across.value, self.across.variance, habits)
        self.bank.predict(dt, self.slide)
        self.pace.predict(dt)

    def cost(self, sighting: Sighting) -> float:
        """Return how badly a sighting fits: twice the negative logarithm of its likelihood, but for a constant.

        Infinite beyond the gate, which each of the differences to the track must be within.
        """
        place_variance = self.p_s + self._place_variance(sighting)
        off_s = (sighting.s - self.s) ** 2 / place_variance
        if not off_s < GATE**2:
            return math.inf
        across = self.across
        side_variance = across.variance + sighting.d_variance
        off_side = (sighting.d - across.value) ** 2 / side_variance
        if off_side >= GATE**2:
            # One who sets out or stops is where the bank has it before it is where the one filter has it.
            place, variance = self.bank.spread()
            side_variance = variance + sighting.d_variance
            off_side = (sighting.d - place) ** 2 / side_variance
        speed_variance, off_speed = self.p_v + RATE_SIGMA**2, 0.0
        if not math.isnan(sighting.speed):
            speed_variance = self.p_v + self._rate_variance(sighting)
            off_speed = (sighting.speed - sighting.skew * across.rate - self.speed) ** 2 / speed_variance
        if max(off_side, off_speed) >= GATE**2:
            return math.inf
        return off_s + off_side + off_speed + math.log(place_variance * side_variance * speed_variance)

    def update(self, sighting: Sighting) -> None:
        """Take a sighting in."""
        self.hits += 1
        self.seen, self.slide = self.time, sighting.slide
        gain = self.d_variance / (self.d_variance + sighting.d_variance)
        self.d += gain * (sighting.d - self.d)
        self.d_variance *= 1.0 - gain
        self.across.update(sighting.d, sighting.d_variance)
        self.bank.update(sighting.d, NOISE_SHARE * sighting.d_variance)
        self.lane.update(self.time, sighting.d, sighting.d_variance)
        total = self.p_s + self._place_variance(sighting)
        gain_s, gain_v = self.p_s / total, self.p_sv / total
        self._correct(sighting.s - self.s, gain_s, gain_v, self.p_s, self.p_sv)
        if not math.isnan(sighting.speed):
            speed, variance = sighting.speed - sighting.skew * self.across.rate, self._rate_variance(sighting)
            gain_s, gain_v = self.p_sv / (self.p_v + variance), self.p_v / (self.p_v + variance)
            self._correct(speed - self.speed, gain_s, gain_v, self.p_sv, self.p_v)
            self.pace.update(speed, variance)
            self.paced = True

    def braking(self, age: float) -> float:
        """Deceleration [m/s2] that one who surely braked may have so long after it was measured [s], else 0."""
        pace, change = self.pace, self.pace.rate
        if not -change > BRAKES * math.sqrt(pace.rate_variance):
            return 0.0
        return HARDER * math.sqrt(pace.rate_variance + pace.density * age) - change

    @property
    def drives(self) -> bool:
        """Whether it surely goes along with the car, faster than who is on foot."""
        return self.speed > DRIVES and (self.speed - DRIVES) ** 2 > 4.0 * self.p_v

    def may_reach_to(self, sighting: Sighting) -> bool:
        """Whether it is a vehicle that comes nearer or crosses, or a part of one, as long as to reach to a sighting."""
        near = math.hypot(sighting.s - self.s, sighting.d - self.across.value) < BUS
        moves = math.hypot(self.speed, self.across.rate) > DRIVES and not self.drives
        return near and (self.time < self.part_until or (self.hits >= CONFIRMED and moves))

    def _place_variance(self, sighting: Sighting) -> float:
        """Of the s that a sighting stands for [m2]: of a car far to the side the seen point is on its flank.

        The field of view ends there, and the point that is nearest of what is left goes along with the own car.
        """
        return sighting.range_variance + (FLANK**2 if self.drives and abs(sighting.skew) > ASIDE else 0.0)

    def _rate_variance(self, sighting: Sighting) -> float:
        """Of the speed along the path that a sighting stands for [m2/s2]: how fast it crosses is known only so well."""
        return sighting.rate_variance + sighting.skew**2 * self.across.rate_variance

    def _correct(self, error: float, gain_s: float, gain_v: float, seen_s: float, seen_v: float) -> None:
        """Kalman correction by a scalar whose covariances with s and speed are `seen_s` and `seen_v`."""
        self.s += gain_s * error
        self.speed += gain_v * error
        self.p_s, self.p_sv, self.p_v = (
            self.p_s - gain_s * seen_s,
            self.p_sv - gain_s * seen_v,
            self.p_v - gain_v * seen_v,
        )


class Tracker:
    """Keeps the tracks and says which is the nearest in the way."""

    def __init__(self, vehicle: Vehicle, sense: Sense | None = None) -> None:
        """Without a `sense` it sees by the radar."""
        self._vehicle = vehicle
        self._sense = sense if sense is not None else Radar()
        self._corridor: Corridor | None = None
        self._tracks: list[Track] = []
        self._dangers: list[Track] = []
        self._memory = Memory()
        self._scanned = -math.inf

    def step(self, observation: Observation, projection: PathProjection) -> Target | None:
        """Take in a scan if it is new, and return the nearest target at the observation's time."""
        if self._corridor is None:
            self._corridor = self._corridor_of(observation.path)
        self._memory.add(observation.pose)
        detections, now = self._sense.scan(observation), observation.time
        scan = detections.time
        if scan > self._scanned:
            self._scanned = scan
            then, front = self._memory.at(scan), self._vehicle.rear_axle_to_bumper
            self._take_in(scan, sightings(detections, self._sense.noise, then, observation.path, projection, front))
            self._forget(scan, observation.pose)
            self._judge(self._corridor, now - scan)
            bumper = projection.s + self._vehicle.rear_axle_to_bumper
            # Unseen it may go on being one, but becomes none: where it would be by now, nobody has seen it.
            self._dangers = [
                track
                for track in self._tracks
                if track.hits >= CONFIRMED
                and (track.seen == scan or track in self._dangers)
                and _endangers(track, observation.path, self._corridor, bumper, observation.pose.speed, now)
            ]
        return self._nearest(observation.time, projection.s + self._vehicle.rear_axle_to_bumper)

    @property
    def confirmed(self) -> list[Track]:
        """The tracks that count, each as of the newest scan."""
        return [track for track in self._tracks if track.hits >= CONFIRMED]

    def dangers(self, time: float, ego_s: float) -> list[Target]:
        """Return all that the car would meet, or may, at a time [s] with its rear axle at `ego_s` [m].

        Unlike the nearest in the way: who is about to cross is among them, who will have crossed is not.
        """
        bumper = ego_s + self._vehicle.rear_axle_to_bumper
        return [_danger(track, time, bumper) for track in self._dangers]

    def _take_in(self, time: float, sightings: list[Sighting]) -> None:
        for track in self._tracks:
            track.predict(time)
        known = list(self._tracks)
        taken = assign([[track.cost(sighting) for track in known] for sighting in sightings])
        for number, sighting in enumerate(sightings):
            if number in taken:
                known[taken[number]].update(sighting)
            else:
                self._tracks.append(self._begun(time, sighting))

    def _begun(self, time: float, sighting: Sighting) -> Track:
        """Return a new track; one that begins beside a body on its way may be another place of that body."""
        track = Track(time, sighting)
        track.part_of = next((other for other in self._tracks if other.may_reach_to(sighting)), None)
        if track.part_of is not None:
            track.part_until = time + TURNING
        return track

    def _forget(self, time: float, pose: Pose) -> None:
        long = COAST_AT_REST if pose.speed < 0.1 else COAST
        self._tracks = [
            track
            for track in self._tracks
            if time - track.seen <= (long if track.hits >= CONFIRMED else COAST_TENTATIVE)
        ]

    def _corridor_of(self, path: ReferencePath) -> Corridor:
        vehicle = self._vehicle
        return Corridor(path, vehicle.rear_axle_to_bumper, vehicle.rear_overhang, vehicle.width, MARGIN)

    def _judge(self, corridor: Corridor, age: float) -> None:
        for track in self._tracks:
            # In: surely inside the band, by one standard deviation. Out: clear of it by the hysteresis.
            shift = -HYSTERESIS if track.in_way else math.sqrt(track.d_variance)
            outward = max(abs(track.d) + shift, 0.0)
            is_in = corridor.contains(track.s, math.copysign(outward, track.d))
            track.in_way = is_in or (track.drives and _is_coming(track, corridor, age))

    def _nearest(self, time: float, bumper: float) -> Target | None:
        nearest = None
        for track in self._tracks:
            if track.in_way and track.hits >= CONFIRMED:
                gap = track.s + track.speed * (time - track.time) - bumper
                if nearest is None or gap < nearest.gap:
                    nearest = Target(gap, track.speed)
        return nearest


def _danger(track: Track, time: float, bumper: float) -> Target:
    """Return what a track has become at a time [s]: since it was measured, one who surely brakes has become slower."""
    since, speed = time - track.time, track.pace.value if track.paced else track.speed
    braking = track.braking(since)
    slower = min(braking * since, max(speed, 0.0))
    gap = track.s + (track.speed - 0.5 * slower) * since - bumper
    return Target(gap, speed - slower, braking, track.probability, track.foreseen, track.keeps_beyond - bumper)


def _is_coming(track: Track, corridor: Corridor, age: float) -> bool:
    """Tell whether a car that goes along, as a scan of some age [s] shows it, is likely to be in the band soon."""
    return _comes_over(track, corridor, age + SOON, DOUBTED if track.in_way else LIKELY)


def _comes_over(track: Track, corridor: Corridor, within: float, surely: float) -> bool:
    left, right = corridor.half_widths(track.s)
    return track.time - track.seen < FRESH and comes_over(track.across, left, right, within, surely)


def _endangers(track: Track, path: ReferencePath, corridor: Corridor, bumper: float, speed: float, now: float) -> bool:
    """Tell whether a track is in the band, or will be when a car of this speed [m/s] gets there; `bumper` is its now.

    What is foretold of the track counts from when it was measured.
    """
    was_foreseen, track.foreseen, track.probability, track.keeps_beyond = track.foreseen, False, 1.0, -math.inf
    # What is faster across than along crosses, or is long and turns: then its nearest point runs along its flank.
    across, drives, age = track.across, track.drives and abs(track.across.rate) < track.speed, now - track.time
    moves = crosses(across, COMES_OVER if drives else CROSSES)
    then = bumper - speed * age
    if track.speed < ONCOMING and abs(across.rate) > OBLIQUE * -track.speed and crosses(across, COMES_OVER):
        track.keeps_beyond = nearest_in_way(path, corridor, track.s, across, track.speed, then)
    if track.part_of is not None and track.part_of.keeps_beyond < track.s:
        # It has not been seen for long enough to tell how it goes; the body has.
        track.keeps_beyond = max(track.keeps_beyond, track.part_of.keeps_beyond)
    if not moves and _is_inside(track, corridor, track.d, track.d_variance):
        return True
    gap, closing = track.s + track.speed * age - bumper, speed - track.speed
    arrival = age + max(gap, 0.0) / closing if closing > 0.0 else math.inf
    left, right = corridor.half_widths(track.s)
    if moves and _is_inside(track, corridor, across.value, across.variance):
        leaves = will_have_left(across, left, right, arrival)
        return not (leaves or goes_past(path, corridor, track.s, across, track.speed, then, speed))
    if gap <= 0.0 or (track.time < track.part_until and abs(across.rate) > ON_FOOT):
        return False
    if drives:
        past = (gap + LENGTH) / closing if closing > 0.0 else math.inf
        track.foreseen = _cuts_in(track, left, right, age + min(past, CUTS_IN), was_foreseen)
    elif track.speed > ONCOMING and moves and abs(across.rate) > BANK_COVERS:
        return will_be_in(across, left - INSIDE, right - INSIDE, arrival)
    elif track.speed > ONCOMING:
        track.foreseen = _walks_in(track, left, right, arrival, was_foreseen)
    return track.foreseen


def _cuts_in(track: Track, left: float, right: float, within: float, was_foreseen: bool) -> bool:
    """Tell whether a car that goes along will probably come into the band within a time [s]; sets its probability.

    A car that comes over begins slowly, and one that stays sways: within a second the bank takes the one for the other.
    So less probability is enough for one that has left the place where it kept its lane by more than drivers wander.
    """
    if track.time - track.seen >= FRESH:
        return False
    track.probability = probability_of_cutting_in(track.bank, left, right, within, track.speed)
    if track.probability >= (FORESEEN_UNTIL if was_foreseen else CUT_IN_FROM):
        return True
    lane = track.lane
    leaves = lane.variance < KNOWN_LANE**2 and lane.left_towards_path(track.across.value) > WANDERS
    return leaves and track.probability >= LEAVES_FROM


def _walks_in(track: Track, left: float, right: float, arrival: float, was_foreseen: bool) -> bool:
    """Tell whether one who crosses will probably be before the car after a time [s]; sets its probability.

    One who was foreseen stays so until it is improbable that he comes into the band at all: the car that brakes arrives
    later than `arrival`. He may be past by then, but only if it goes on braking.
    """
    track.probability = 0.0
    if arrival <= PREDICTION_HORIZON:
        track.probability = probability_in(track.bank, left - INSIDE, right - INSIDE, arrival, arrival + PASSES)
    if track.probability >= CROSSING_FROM or not was_foreseen:
        return track.probability >= CROSSING_FROM
    until = min(arrival + PASSES, PREDICTION_HORIZON)
    return probability_in(track.bank, left, right, 0.0, until) >= FORESEEN_UNTIL


def _is_inside(track: Track, corridor: Corridor, d: float, variance: float) -> bool:
    """Tell whether it is in the band by two standard deviations."""
    return corridor.contains(track.s, math.copysign(abs(d) + 2.0 * math.sqrt(variance), d))

"""Draws actions, roads and episodes, and lists the pairs; every draw is from the random numbers that are passed in."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import combinations
from random import Random
from typing import Final

from vve_sumo.errors import ConfigError
from vve_sumo.hunt.brains import BEHAVIOURS
from vve_sumo.hunt.episode import DRIVER, FAULTS, KEYS, Action, Episode, EpisodePhase, RoadConditions
from vve_sumo.plant.injected_faults import KINDS, NEUTRAL, NUMBERS, VALUES, Shape

#: Roads that random episodes are driven on: few, because episodes on the same road share its nominal drive.
ROADS: Final = (
    RoadConditions(),
    RoadConditions(grade_percent=1.0),
    RoadConditions(grade_percent=-1.0),
    RoadConditions(friction=0.5),
    RoadConditions(mass_factor=1.2),
    RoadConditions(brake_gain_factor=0.85),
)
#: Seeds of the vehicle's noise.
SEEDS: Final = (1, 2, 3)
#: Latest onset after a phase's beginning [s].
SPANS: Final = {
    EpisodePhase.ARMING: 0.1,
    EpisodePhase.ENGAGING: 0.6,
    EpisodePhase.HELD: 0.98,
    EpisodePhase.DRIVING: 14.0,
    EpisodePhase.BEND: 2.0,
    EpisodePhase.BRAKING: 4.0,
    EpisodePhase.AT_REST: 1.9,
    EpisodePhase.STOPPED: 1.5,
    EpisodePhase.RELEASED: 1.0,
}
#: How often random episodes set in there: mostly where the car moves.
WEIGHTS: Final = {
    EpisodePhase.ARMING: 1,
    EpisodePhase.ENGAGING: 1,
    EpisodePhase.HELD: 2,
    EpisodePhase.DRIVING: 6,
    EpisodePhase.BEND: 3,
    EpisodePhase.BRAKING: 4,
    EpisodePhase.AT_REST: 2,
    EpisodePhase.STOPPED: 1,
    EpisodePhase.RELEASED: 1,
}
#: What a driver does, gentle and hard: kind and value.
DRIVER_CHOICES: Final = tuple(
    (kind, value)
    for kind, values in (
        ("driver_touch", (0.19, 0.215)),
        ("brake_override", (0.23, 0.26, 0.33)),
        ("throttle_override", (0.2, 0.4)),
        ("steering_override", (2.0, 5.0)),
        ("gear_lever", (1.0, 2.0, 3.0, 4.0)),
    )
    for value in values
)
#: Kinds whose value is a whole number.
WHOLE: Final = NUMBERS | {"pose_garbage"}
#: Widest range that values are drawn from, where the kind's own is so wide that hardly a draw would be of use.
USEFUL: Final = {
    "pose_jump": (-8.0, 8.0),
    "pose_rtk_lost": (0.01, 2.0),
    "pose_late": (0.01, 0.4),
    "pose_bursts": (0.02, 0.5),
    "pose_garbage": (1.0, 20.0),
    "pose_drift_lateral": (-1.0, 1.0),
    "pose_drift_along": (-1.0, 1.0),
    "pose_steps": (-1.0, 1.0),
    "pose_heading_drift": (-0.2, 0.2),
    "pose_forged": (-1.0, 1.0),
    "pose_overtaken": (-1.0, 1.0),
}
DURATIONS: Final = (0.06, 0.3, 1.0, 3.0, 8.0)
#: Of flapping faults, of each half [s].
PERIODS: Final = (0.04, 0.1, 0.3, 1.0)
MAX_ACTIONS: Final = 3


def value_of(kind: str, random: Random) -> float:
    """Draw a value of an injected fault; NaN where the kind takes none."""
    if kind not in VALUES:
        return float("nan")
    usual, least, most = VALUES[kind]
    low, high = USEFUL.get(kind, (least, most))
    if random.random() < 0.3:
        return usual
    value = round(random.uniform(low, high), 3)
    return float(round(value)) if kind in WHOLE else value


def action(random: Random, kinds: Sequence[str]) -> Action:
    """Draw an action of one of the kinds."""
    kind = random.choice(kinds)
    after = 0.0 if random.random() < 0.4 else round(random.uniform(0.0, 4.0), 2)
    if kind in KEYS:
        return Action(kind, after, 1.0)
    duration = random.choice(DURATIONS)
    if kind not in KINDS:
        return Action(kind, after, duration)
    shape, period = shape_of(kind, random)
    return Action(kind, after, duration, value_of(kind, random), shape, period)


def shape_of(kind: str, random: Random) -> tuple[Shape, float]:
    """Draw a shape that an injected fault of the kind can have, and its period."""
    shape = random.choices((Shape.STEP, Shape.RAMP, Shape.FLAPPING), (6, 2, 2))[0]
    if shape is Shape.FLAPPING:
        return shape, random.choice(PERIODS)
    return (shape if kind in NEUTRAL else Shape.STEP), float("nan")


def kinds_by_chance(random: Random) -> Sequence[str]:
    """Draw which group of kinds an action is of."""
    return random.choices((FAULTS, DRIVER, tuple(KEYS), tuple(BEHAVIOURS)), (5, 3, 1, 2))[0]


def phase_and_offset(random: Random, phase: EpisodePhase | None = None) -> tuple[EpisodePhase, float]:
    """Draw a phase, unless it is given, and an onset in it."""
    chosen = phase or random.choices(tuple(WEIGHTS), tuple(WEIGHTS.values()))[0]
    return chosen, round(random.uniform(0.0, SPANS[chosen]) / 0.02) * 0.02


def episode(random: Random, road: RoadConditions, seed: int) -> Episode:
    """Draw an episode of one to three actions, the first of which is at its onset."""
    count = random.choices((1, 2, 3), (1, 4, 3))[0]
    actions = [action(random, kinds_by_chance(random)) for _ in range(count)]
    phase, offset = phase_and_offset(random)
    return Episode(phase, round(offset, 2), from_onset(actions), road, seed)


def from_onset(actions: Sequence[Action]) -> tuple[Action, ...]:
    """Return the actions in order of time, moved so that the first is at the onset."""
    ordered = sorted(actions, key=lambda one: one.after)
    first = ordered[0].after if ordered else 0.0
    return tuple(replace(one, after=round(one.after - first, 3)) for one in ordered)


def mutated(episode: Episode, random: Random) -> Episode:
    """Return a neighbour of an episode: numbers or the onset changed, or an action more or less."""
    actions, phase, offset = list(episode.actions), episode.phase, episode.offset
    for _ in range(random.choice((1, 1, 2))):
        match random.choices(("number", "offset", "add", "drop", "phase"), (6, 2, 2, 1, 1))[0]:
            case "number":
                at = random.randrange(len(actions))
                actions[at] = _nudged(actions[at], random)
            case "offset":
                offset = min(max(offset + random.gauss(0.0, 0.3), 0.0), SPANS[phase])
            case "add" if len(actions) < MAX_ACTIONS:
                actions.append(action(random, kinds_by_chance(random)))
            case "drop" if len(actions) > 1:
                actions.pop(random.randrange(len(actions)))
            case "phase":
                phase, offset = phase_and_offset(random)
            case _:
                pass
    return replace(episode, phase=phase, offset=round(round(offset / 0.02) * 0.02, 2), actions=from_onset(actions))


def _nudged(one: Action, random: Random) -> Action:
    """Return an action with its beginning, its duration or its value changed."""
    what = random.choice(("after", "duration", "value"))
    if what == "after" or one.kind in KEYS:
        return replace(one, after=round(max(one.after + random.gauss(0.0, 0.5), 0.0), 2))
    if what == "duration" or one.kind not in VALUES:
        return replace(one, duration=round(min(max(one.duration * random.lognormvariate(0.0, 0.6), 0.02), 12.0), 2))
    usual, least, most = VALUES[one.kind]
    low, high = USEFUL.get(one.kind, (least, most))
    value = (usual if one.value != one.value else one.value) + random.gauss(0.0, 0.15 * (high - low))
    value = min(max(value, low), high)
    try:
        return replace(one, value=float(round(value)) if one.kind in WHOLE else round(value, 3))
    except ConfigError:
        return one


def choices(kind: str) -> tuple[float, ...]:
    """Return the values with which a kind of fault is paired: each number of one, NaN as the default of another."""
    if kind not in NUMBERS:
        return (float("nan"),)
    _usual, least, most = VALUES[kind]
    return tuple(map(float, range(round(least), round(most) + 1)))


def pairs(phases: Sequence[EpisodePhase], seed: int) -> list[tuple[str, Episode]]:
    """Return every pair in an order of chance, so that the first of them are a sample of all; see `all_pairs`."""
    every = list(all_pairs(phases, seed))
    Random(seed).shuffle(every)
    return every


def all_pairs(phases: Sequence[EpisodePhase], seed: int) -> Iterator[tuple[str, Episode]]:
    """Yield every pair, with its name: kind of fault by kind of fault, driver action or behaviour; driver by behaviour.

    A kind whose value is a number of something, as a module, is one for each number; it is not paired with itself.
    Each pair is tried once in every phase, on the nominal road. The first sets in at the onset and the second up to
    1.5 s later, so that each meets a car that the other has already touched.
    """
    singles = [(kind, value) for kind in FAULTS for value in choices(kind)]
    brains = [(kind, float("nan")) for kind in BEHAVIOURS]
    couples = [(one, other) for one, other in combinations(singles, 2) if one[0] != other[0]]
    couples += [(fault, other) for fault in singles for other in (*DRIVER_CHOICES, *brains)]
    couples += [(driver, brain) for driver in DRIVER_CHOICES for brain in brains]
    for phase in phases:
        for first, second in couples:
            name = f"{phase.value}: {_named(first)} x {_named(second)}"
            random = Random(f"{seed} {name}")
            one, other = Action(first[0], 0.0, 8.0, first[1]), Action(second[0], 0.0, 4.0, second[1])
            other = replace(other, after=random.choice((0.0, 0.3, 0.6, 1.0, 1.5)))
            if second[0] in FAULTS and random.random() < 0.5:
                one, other = replace(other, after=0.0, duration=8.0), replace(one, after=other.after, duration=4.0)
            _, offset = phase_and_offset(random, phase)
            yield name, Episode(phase, round(offset, 2), (one, other), RoadConditions(), 1)


def _named(kind: tuple[str, float]) -> str:
    return kind[0] if kind[1] != kind[1] else f"{kind[0]}={kind[1]:g}"

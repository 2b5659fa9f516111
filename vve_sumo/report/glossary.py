"""The glossary: every term of the docs with its meaning, and which terms a text of the report uses.

`docs/glossary.md` is written from it (`python -m tests.test_docs`). A term that is a metric takes its meaning from the
metrics' table. Knows neither the page nor what its texts are about.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache

from vve_sumo.metrics.table import METRICS


@dataclass(frozen=True, slots=True)
class Term:
    """A term of the glossary."""

    word: str  #: with other common words for it in brackets or behind a comma
    meaning: str  #: without its full stop
    spellings: tuple[str, ...] = ()  #: in texts of the report; none for a word that needs no explanation there


def _metric(word: str, name: str, *spellings: str, remark: str = "") -> Term:
    """Return a term that is a metric; `remark` is what the metrics' table does not say."""
    return Term(word, METRICS[name].meaning + remark, spellings or (word,))


TERMS: tuple[Term, ...] = (
    Term(
        "actor",
        "anything with a body on the virtual road other than the ego: SUMO's traffic, obstacles, and what a scenario "
        "moves",
    ),
    Term(
        "actuation command",
        "what the gateway tells the car in one step: brake torque, throttle opening, steering-wheel angle and rate, "
        "gear",
    ),
    Term("alignment", "the transformation from the lot to the virtual road: a turn and a shift"),
    Term(
        "approach",
        "from the first braking from which on what the car stopped for stood ahead, to rest; a stop is its last "
        "braking episode",
    ),
    Term("arming state", "the gateway's state: disarmed, ready, engaged, stopping, stopped, fault"),
    Term(
        "brake dead time, brake lag",
        "time from a commanded torque to its first effect, and the first-order time constant after that",
        ("dead time", "brake lag"),
    ),
    Term(
        "censored value",
        "a value of which only one side is known: a collision is beyond every gap, time to collision and DRAC",
    ),
    Term("commanded path", "the path that a controller's command carries where it means to leave the scenario's"),
    Term("controller", "the system under test: gets an observation each tick, returns a control command"),
    Term("control command", "what a controller asks for: steering (road-wheel angle) and acceleration"),
    Term(
        "d (lateral deviation)",
        "distance of a point from the path, left positive; the lateral Frenet coordinate",
        ("lateral deviation",),
    ),
    Term(
        'drive-by-wire controller (DBW controller, "kit")',
        "the unit in the car that executes CAN commands and has a watchdog of its own",
    ),
    Term(
        "drive-by-wire interface",
        "the software port to that unit: turns actuation commands into frames, and frames into maker-independent "
        "reports",
    ),
    _metric("DRAC", "drac_mps2"),
    Term("ego", "the car under test; its *twin* is the ego in SUMO"),
    Term("end trigger", "the condition at which a scenario ends a drive as planned; the outcome is then `completed`"),
    Term(
        'external controller ("brain" in keys and options)',
        "a control computer that is not ours: it gets the virtual sensors, and drives by setpoints to the gateway or "
        "by commands of its own on the car's bus",
        ("external controller",),
    ),
    Term(
        "fallback path",
        "the path that the car follows to rest when the gateway stops it by itself; it comes with every setpoint",
        ("fallback path",),
    ),
    Term(
        "error (of a run)",
        "why a run of a sweep has no figures: it could not begin, broke, crashed or took too long; no fault, but ours",
    ),
    Term("fix", "one message of the GNSS receiver, with its own time and the time at which it arrived"),
    _metric("gap", "gap_m"),
    Term(
        "gateway fault",
        "a state of the gateway that stops the car; a drive that ends so has the outcome `fault`",
        ("gateway fault",),
    ),
    Term("gateway", "the last process before the car: checks and limits setpoints, and alone writes to the car's bus"),
    Term(
        "geofence",
        "the surveyed lot less its margin; `geofence_breach` means that the car was not certain to come to rest inside",
        ("geofence",),
    ),
    _metric("headway, time gap", "headway_s", "headway", "time gap"),
    Term(
        "hidden delay",
        "part of the age of a pose that its time stamp does not show, so that the prediction cannot make up for it",
        ("hidden delay",),
    ),
    Term(
        "hunting",
        "braking, gaining speed and braking again on the way to rest: the acceleration changes its sign four times or "
        "more",
        ("hunting", "hunted"),
    ),
    Term(
        "injected fault", "what a rig does to the simulated car, its sensors or its bus on purpose", ("injected fault",)
    ),
    _metric("jerk", "jerk_mps3"),
    Term(
        "latency margin",
        "how much hidden delay a scenario tolerates before its gap at rest is zero (the study calls the limit latency "
        "cliff)",
        ("latency margin", "cliff"),
    ),
    Term("lead vehicle", "the actor that the ego's body would touch first along its path", ("lead vehicle", "leader")),
    Term("lot", "the empty place where the real car drives"),
    Term(
        "lockstep, live, playback, replay",
        "a drive on a simulated clock; in real time with several processes; with a recorded drive as its input; a "
        "record computed again, bit for bit",
        ("lockstep", "playback"),
    ),
    Term("map", "the plane of the network's coordinates; headings are radians, counter-clockwise from its +x"),
    _metric("MFDD", "mfdd_mps2"),
    _metric("MSDV (motion sickness dose value)", "msdv_xy_mps1p5", "MSDV"),
    _metric("MTVV (maximum transient vibration value)", "mtvv_xy_mps2", "MTVV"),
    Term("no-brake preview", "how a scenario would go if the ego never braked"),
    Term("observation", "all that a controller may know at one tick"),
    Term("onset", "the tick that first commanded the braking episode that ended at rest", ("onset",)),
    Term("operator command", "engage, go, stop, stop over the page, end, disarm"),
    Term("pose", "place, heading, speed and yaw rate of a named point of the car at a stated time"),
    Term("proxy vehicle", "what SUMO's traffic sees of the ego on a lane that its body cuts"),
    Term(
        "range, azimuth, range rate",
        "distance, direction (left positive) and rate of change of distance of a radar detection",
        ("azimuth", "range rate"),
    ),
    Term("receiver", "the source of poses: a GNSS/INS unit, or a recording"),
    Term("record", "the folder that a drive leaves"),
    Term("rig", "a file that describes one real car with its receiver, bus and lot"),
    _metric("RSS (Responsibility-Sensitive Safety)", "rss_distance_m", "RSS", "Responsibility-Sensitive Safety"),
    Term("run", "one drive of a sweep; also a record as the analysis reads it"),
    Term("s", "distance along the path; the longitudinal Frenet coordinate (station)"),
    Term("setpoint", "a control command that the tick has stamped: sequence number, expiry, pose, fallback path"),
    Term(
        "shadow mode",
        "a live drive with every enable bit off: a driver drives, the program computes and records",
        ("shadow mode",),
    ),
    Term("simulated vehicle", "the model that replaces the real car, down to the bytes of its messages"),
    Term(
        "stopping-bound check",
        "whether a stop was as short as the declared brakes promise",
        ("stopping-bound check", "stopping bound"),
    ),
    Term(
        "survivors",
        "the runs that have a figure, such as the gap at rest of those that did not collide; means are theirs",
    ),
    Term("tick", "one pass of the loop, every 20 ms"),
    Term("trust gate", "decides for each fix whether it may be used, given those before it", ("trust gate",)),
    _metric(
        "TTC (time to collision)",
        "ttc_s",
        "TTC",
        "time to collision",
        remark="; of bodies in the plane where the name says 2D or boxes",
    ),
    Term("virtual road (street)", "the road in SUMO on which the twin drives"),
    Term(
        "variance explained (eta squared)",
        "share of the variance of the runs' ranks by a figure that lies between the values of one parameter",
    ),
    Term(
        "Wd, Wf",
        "frequency weightings of ISO 2631-1: of horizontal shaking of a seated person, and of motion that makes sick",
        ("Wd", "Wf"),
    ),
    Term(
        "Wilson interval",
        "95 % interval of a share of independent random runs: where the share of very many such runs would lie",
        ("95 % interval", "Wilson"),
    ),
)


def markdown() -> str:
    """Return the glossary as a table of the docs."""
    rows = (f"| {term.word} | {term.meaning} |" for term in sorted(TERMS, key=lambda term: term.word.lower()))
    return "\n".join(["| word | what it means here |", "|---|---|", *rows])


def used_in(texts: Iterable[str]) -> tuple[Term, ...]:
    """Return the terms whose spellings stand in texts as whole words, in the order of the glossary."""
    text = " ".join(texts)
    return tuple(term for term in TERMS if term.spellings and _pattern(term).search(text))


@cache
def _pattern(term: Term) -> re.Pattern[str]:
    words = "|".join(map(re.escape, term.spellings))
    return re.compile(rf"(?<!\w)(?:{words})s?(?!\w)", re.IGNORECASE)

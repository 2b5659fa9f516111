"""Tells the process of a live drive's page what each tick came to, without ever waiting for it.

A sample that cannot be queued at once is dropped; once that process is gone, nothing is sent any more.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Final, NamedTuple

from vve_sumo.drive.tick import CompletedTick
from vve_sumo.live.channel import Channel
from vve_sumo.people.person import PersonState
from vve_sumo.values import Fix, FixQuality, resolve_fallback_path
from vve_sumo.vehicle import link
from vve_sumo.view.sample import PersonMark, ReadingView, ViewSample, encode

#: of a reading with more rows than this the page gets every so many: a datagram has a longest size
MAX_ROWS: Final = 1000


class SampleContext(NamedTuple):
    """What a tick's sample holds beside the completed tick."""

    tick: int
    due: float  #: drive time of the tick [s]
    wall: float  #: Unix time of that [s]
    fix: Fix | None  #: the newest trusted one
    feedback: link.Feedback | None  #: the gateway's newest
    feedback_age: float  #: [s], inf without one
    details: dict[str, str]  #: the numbers behind reason codes
    latency: float  #: of the newest completed tick [s]
    missed: int  #: ticks so far
    signals: Mapping[str, str]  #: what each traffic signal shows
    people: Sequence[PersonState]  #: real people, as they were when the tick looked
    outcome: str | None


class ViewFeed:
    """The drive's end of the channel to the page's process."""

    def __init__(self, channel: Channel) -> None:
        self._channel = channel

    def send(self, done: CompletedTick, beside: Callable[[], SampleContext]) -> None:
        """Send a tick's sample. Nothing that goes wrong here may stop a car: then the page gets no more samples.

        `beside` gives what the sample holds beside the completed tick.
        """
        if self._channel.closed:
            return
        try:
            self._channel.send(encode(_sample(done, beside())))
        except Exception:
            self._channel.close()

    def close(self) -> None:
        """Close the drive's end."""
        self._channel.close()


def _sample(done: CompletedTick, beside: SampleContext) -> ViewSample:
    result, setpoint, fix, feedback = done.result, done.result.setpoint, beside.fix, beside.feedback
    return ViewSample(
        tick=beside.tick,
        time=beside.due,
        wall=beside.wall,
        pose=result.pose,
        s=result.s,
        d=result.d,
        wished=setpoint.acceleration if setpoint else math.nan,
        wished_steering=setpoint.steering if setpoint else math.nan,
        note=setpoint.note if setpoint else "",
        fallback_path=resolve_fallback_path(setpoint.fallback_path) if setpoint else None,
        commanded_path=result.commanded_path,
        faults=result.faults,
        details=beside.details,
        pose_reasons=result.pose_reasons,
        quality=fix.quality if fix else FixQuality.UNKNOWN,
        sigma=fix.position_sigma if fix else math.nan,
        status=done.status,
        status_age=beside.feedback_age,
        steering=feedback.measured_steering if feedback else math.nan,
        wheel_speed=feedback.wheel_speed if feedback else math.nan,
        gear=feedback.gear if feedback else "",
        latency=beside.latency,
        missed=beside.missed,
        actors=done.actors,
        readings={name: _reading(done, name) for name in done.result.readings},
        signals=beside.signals,
        people=tuple(map(mark_of, beside.people)),
        outcome=beside.outcome,
    )


def mark_of(state: PersonState) -> PersonMark:
    """Return a person as the page is told of one."""
    body = state.body
    box = (math.nan, math.nan, math.nan) if body is None else (body.heading, body.length, body.width)
    return PersonMark(state.id, state.presence.name.lower(), state.x, state.y, state.radius, state.age, *box)


def _reading(done: CompletedTick, sensor: str) -> ReadingView:
    columns = done.result.readings[sensor]
    step = 1 + max(len(columns[0]) - 1, 0) // MAX_ROWS
    return ReadingView(done.result.sensors[sensor].time, tuple(column[::step] for column in columns))

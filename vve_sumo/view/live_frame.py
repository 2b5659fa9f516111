"""From the samples of a live drive to frames as the page draws them, and to the drive's events.

Knows samples and the scene; neither sockets nor pages.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

import numpy as np

from vve_sumo.drive.reasons import in_words
from vve_sumo.metrics.lead_vehicle import lead_vehicle_now
from vve_sumo.people.presence import Presence
from vve_sumo.record.declared import recorded_path, recorded_vehicle
from vve_sumo.record.drawings import drawings_of
from vve_sumo.sensors.drawing import Drawing, placed, quantities, ranges
from vve_sumo.values import Actors, CommandedPath, Floats, GatewayStatus, Pose
from vve_sumo.view.lot_view import LotView
from vve_sumo.view.sample import PersonMark, ReadingView, ViewSample
from vve_sumo.view.scene import body, finite, rig_of
from vve_sumo.view.sight import FieldOfViewCheck
from vve_sumo.view.words import detection_in_words, presence_in_words

#: samples that are kept to find what a reading looked at: the radar's latency is at most a second
MAX_KEPT: Final = 60
#: between two footprints [s]: each takes a few milliseconds
FOOTPRINT_PERIOD: Final = 0.2
#: a change of the gateway's reasons is an event no more often than this [s]
REASON_PERIOD: Final = 0.5
#: events that are kept for pages that are opened later
MAX_EVENTS: Final = 500

#: words a sample's status: phase and reasons
Wording = Callable[[Mapping[str, Any]], str]


class LiveFrames:
    """Follows one live drive, sample by sample."""

    def __init__(self, resolved: Mapping[str, Any], wording: Wording) -> None:
        """`resolved` is the content of `scenario.json`; `wording` says in plain words what the console would say."""
        self._vehicle, self._path, self._wording = recorded_vehicle(resolved), recorded_path(resolved), wording
        self._sensors = {
            name: _Sensor(name, drawing, [column[0] for column in resolved["sensors"][name]])
            for name, drawing in drawings_of(resolved).items()
        }
        rig = rig_of(resolved)
        self._lot = None if rig is None else LotView(rig, resolved, self._vehicle)
        self._looks: deque[tuple[float, Pose | None, Actors]] = deque(maxlen=MAX_KEPT)
        self._footprint: tuple[float, list[list[float]] | None] = (-math.inf, None)
        self._engaged = False
        self._before: ViewSample | None = None
        self._last_event: tuple[float, GatewayStatus] | None = (
            None  # when the last event of the gateway was, and of what
        )
        self.bodies: dict[str, dict[str, Any]] = {}  #: of every actor seen so far, as the scene has them
        self.events: deque[dict[str, Any]] = deque(maxlen=MAX_EVENTS)
        self.newest: ViewSample | None = None

    def take(self, sample: ViewSample) -> list[dict[str, Any]]:
        """Take a sample, none of which may be left out; return the events that it brings."""
        self._looks.append((sample.time, sample.pose, sample.actors))
        self._engaged |= sample.status.state in ("engaged", "stopping", "stopped")
        self._meet(sample.actors)
        for name, reading in sample.readings.items():
            if name in self._sensors:
                self._look(self._sensors[name], reading)
        found = self._happened(sample)
        self.events.extend(found)
        self._before = self.newest = sample
        return found

    def frame(self) -> dict[str, Any] | None:
        """Return the newest sample as a frame; None before the first."""
        sample = self.newest
        if sample is None:
            return None
        status, pose = sample.status, sample.pose
        return {
            "t": round(sample.time, 4),
            "state": status.state.value,
            "reason": "+".join(status.reasons),
            "said": self._status_text(sample),
            "note": sample.note,
            "contact": "",
            "ego": None if pose is None else self._ego(sample, pose),
            "s": finite(sample.s, 3),
            "deviation": finite(sample.d, 3),
            "quality": _quality(sample),
            "actors": _columns(sample.actors),
            "people": [_person(one) for one in sample.people],
            "commanded": _line(sample.commanded_path),
            "gap": None if pose is None else self._gap(sample, pose),
            "latency": finite(sample.latency),
            "latencies": None,
            "signals": dict(sample.signals),
            "sensed": [sensor.shown for sensor in self._sensors.values()],
            **self._in_the_lot(sample),
        }

    def _status_text(self, sample: ViewSample) -> str:
        return self._wording(
            {
                "state": sample.status.state.value,
                "reasons": list(sample.status.reasons),
                "faults": list(sample.faults),
                "details": sample.details,
                "gear": sample.gear,
                "engaged": self._engaged,
                "status_age_s": sample.status_age,
            }
        )

    @staticmethod
    def _ego(sample: ViewSample, pose: Pose) -> dict[str, Any]:
        return {
            "x": round(pose.x, 4),
            "y": round(pose.y, 4),
            "heading": round(pose.heading, 6),
            "speed": finite(pose.speed, 4),
            "acceleration": finite(pose.acceleration, 4),
            "wished": finite(sample.wished, 4),
            "granted": finite(sample.status.acceleration, 4),
            "steering": finite(sample.steering),
            "wished_steering": finite(sample.wished_steering),
            "yaw_rate": finite(pose.yaw_rate) or 0.0,
        }

    def _gap(self, sample: ViewSample, pose: Pose) -> float | None:
        lead = lead_vehicle_now(pose, sample.s, sample.actors, self._path, self._vehicle, sample.commanded_path)
        return finite(float(lead.gap[0]), 3)

    def _in_the_lot(self, sample: ViewSample) -> dict[str, Any]:
        lot, pose = self._lot, sample.pose
        if lot is None or pose is None:
            return {"real": None, "to_edge": None, "footprint": None}
        real = lot.place(pose)
        edge = lot.to_edges(*(np.array([value]) for value in (real.x, real.y, real.heading)))
        if sample.time - self._footprint[0] >= FOOTPRINT_PERIOD:
            line = lot.footprint(real, sample.steering, sample.fallback_path)
            self._footprint = sample.time, None if line is None else np.round(line, 2).tolist()
        return {
            "real": {"x": round(real.x, 3), "y": round(real.y, 3), "heading": round(real.heading, 5)},
            "to_edge": finite(float(edge[0]), 2),
            "footprint": self._footprint[1],
        }

    def _meet(self, actors: Actors) -> None:
        for row, name in enumerate(actors.ids):
            if name not in self.bodies:
                size = (float(column[row]) for column in (actors.length, actors.width, actors.height))
                self.bodies[name] = body(int(actors.kind[row]), *size)

    def _look(self, sensor: _Sensor, reading: ReadingView) -> None:
        """Place a reading, and find the actors that it did not see, from the tick at which it was measured."""
        _time, pose, actors = min(self._looks, key=lambda one: abs(one[0] - reading.measured))
        if pose is not None:
            sensor.take(reading, pose, actors)

    def _happened(self, sample: ViewSample) -> list[dict[str, Any]]:
        before, time, status = self._before, sample.time, sample.status
        found: list[dict[str, Any]] = []
        last = self._last_event
        if last is None or last[1].state != status.state:
            found.append(_event(time, "state", self._status_text(sample)))
            self._last_event = time, status
        elif last[1].reasons != status.reasons and time - last[0] >= REASON_PERIOD:
            found.append(_event(time, "reason", self._status_text(sample)))
            self._last_event = time, status
        if sample.note and (before is None or before.note != sample.note):
            found.append(_event(time, "note", f"controller: {sample.note}"))
        there = {} if before is None else {one.id: one.presence for one in before.people}
        for one in sample.people:
            if one.presence != there.get(one.id, _GONE):
                found.append(_event(time, "person", presence_in_words(one.id, one.presence)))
        for sensor in self._sensors.values():
            found += [_event(time, "detection", text) for text in sensor.first_detections()]
        if sample.outcome is not None and (before is None or before.outcome is None):
            found.append(_event(time, "end", f"end: {sample.outcome}"))
        return found


class _Sensor:
    """One sensor's newest reading, as a frame has it."""

    def __init__(self, name: str, drawing: Drawing, columns: Sequence[str]) -> None:
        self._name, self._drawing, self._columns = name, drawing, columns
        self._look = None if drawing.view is None or drawing.actor is None else FieldOfViewCheck(drawing.view)
        self._known: set[str] = set()
        self._met: list[str] = []
        self.shown: dict[str, Any] = _NO_READING

    def take(self, reading: ReadingView, pose: Pose, actors: Actors) -> None:
        """Place a reading in the map, from the pose of the rear axle and the actors at which it was measured."""
        drawing = self._drawing
        table = dict(zip(self._columns, reading.columns, strict=True))
        numbers = {name: np.asarray(table[name], np.float64) for name in quantities(drawing).values()}
        shapes = placed(drawing, numbers, pose.x, pose.y, pose.heading)._asdict()
        far = ranges(drawing, numbers)
        seen = [""] * len(far) if drawing.actor is None else [str(name) for name in table[drawing.actor]]
        missing = self._look.undetected((pose.x, pose.y, pose.heading), actors, frozenset(seen)) if self._look else {}
        if drawing.shape == "points":
            del shapes["origin_x"], shapes["origin_y"]
        self.shown = {name: _rounded(values) for name, values in shapes.items() if values is not None} | {
            "seen": seen,
            "measured": round(reading.measured, 4),
            "unseen": {"id": list(missing), "why": [why.value for why in missing.values()]},
        }
        for name, distance in zip(seen, far.tolist(), strict=True):
            if name and name not in self._known:
                self._known.add(name)
                self._met.append(detection_in_words(self._name, name, distance))

    def first_detections(self) -> list[str]:
        """Return, once, in words which actors the readings taken since the last call saw for the first time."""
        met, self._met = self._met, []
        return met


_NO_READING: Final[dict[str, Any]] = {
    "x": [],
    "y": [],
    "seen": [],
    "measured": None,
    "unseen": {"id": [], "why": []},
}


#: how somebody real is on the road at first
_GONE: Final = Presence.GONE.name.lower()


def _event(time: float, kind: str, text: str) -> dict[str, Any]:
    return {"time": round(time, 3), "kind": kind, "text": text}


def _line(path: CommandedPath | None) -> list[list[float]] | None:
    """Return the points of a commanded path as the page draws them."""
    return None if path is None else [[round(x, 3), round(y, 3)] for x, y in zip(path.x, path.y, strict=True)]


def _columns(actors: Actors) -> dict[str, Any]:
    """The actors as columns; one with a value that is not finite is left out."""
    known = np.isfinite(actors.x + actors.y + actors.heading + actors.speed)
    ids = [name for name, is_known in zip(actors.ids, known.tolist(), strict=True) if is_known]
    numbers = {"x": actors.x, "y": actors.y, "heading": actors.heading, "speed": actors.speed}
    return {"id": ids} | {name: _rounded(values[known]) for name, values in numbers.items()}


def _person(one: PersonMark) -> dict[str, Any]:
    """Return a person as a frame has one: what is not known is null."""
    numbers = {
        name: finite(getattr(one, name), 3) for name in ("x", "y", "radius", "age", "heading", "length", "width")
    }
    return {"id": one.id, "presence": one.presence, **numbers}


def _rounded(values: Floats) -> list[float]:
    rounded: list[float] = np.round(values, 3).tolist()
    return rounded


def _quality(sample: ViewSample) -> str:
    # Without any fix at all, the newest one is as good as it was, and old.
    stale = tuple(reason for reason in sample.faults if reason == "pose_stale")
    if sample.pose_reasons or stale:
        return f"refused: {', '.join(map(in_words, (*sample.pose_reasons, *stale)))}"
    if sample.pose is None:
        return "none"
    sigma = f" ± {100.0 * sample.sigma:.0f} cm" if math.isfinite(sample.sigma) else ""
    return f"{sample.quality.value}{sigma}"

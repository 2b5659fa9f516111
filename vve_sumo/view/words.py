"""Says in plain words what the gateway did at a tick of a record, and what a drive came to."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from vve_sumo.drive.reasons import in_words
from vve_sumo.people.presence import Presence
from vve_sumo.values import ArmingState
from vve_sumo.vehicle.arming import WAITING

PHASES: Final = {
    ArmingState.DISARMED: "not ready",
    ArmingState.READY: "ready",
    ArmingState.ENGAGED: "driving",
    ArmingState.STOPPING: "stopping",
    ArmingState.STOPPED: "at rest",
    ArmingState.FAULT: "fault",
}
#: of an engaged car that does not drive yet, by the reason code that says so
ENGAGED_PHASES: Final = {"engaging": "engaging", "shifting": "engaging", WAITING: "held"}

_PRESENCES: Final = {
    Presence.EXACT.name.lower(): "there as a body",
    Presence.AREA.name.lower(): "there as an area",
    Presence.WARNING.name.lower(): "an area with a warning, because the position is old or vague",
    Presence.GONE.name.lower(): "gone, because nobody knows where",
}


def reasons_in_words(reasons: str) -> list[str]:
    """Return reason codes that are joined by + in plain words."""
    return [in_words(code) for code in reasons.split("+") if code]


def presence_in_words(person: str, presence: str) -> str:
    """Return how somebody real is on the road, a name of `Presence` in small letters, for a list of events."""
    return f"{person}: {_PRESENCES[presence]}"


def state_in_words(state: str, reasons: str) -> str:
    """Return the gateway's state and its reasons, codes joined by +, in plain words."""
    why = "; ".join(reasons_in_words(reasons))
    held = (words for code, words in ENGAGED_PHASES.items() if code in reasons.split("+"))
    phase = next(held, PHASES[ArmingState(state)])
    return f"{phase}: {why}" if why else phase


def detection_in_words(sensor: str, actor: str, far: float) -> str:
    """Return that a sensor saw an actor for the first time, at a range [m]."""
    return f"{sensor} first detects {actor} at {far:.1f} m"


def verdict_of(summary: Mapping[str, Any] | None) -> dict[str, Any]:
    """Return what a drive came to, by its summary: outcome, whether its criteria are met, and those that are not."""
    if summary is None:
        return {"outcome": "killed", "passed": None, "failed": []}
    return {
        "outcome": str(summary["outcome"]),
        "passed": summary.get("passed"),
        "failed": [str(one) for one in summary.get("failed", ())],
    }

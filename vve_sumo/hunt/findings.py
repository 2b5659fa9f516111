"""What a hunt has found: each violation once, by its invariant and the kinds of actions that it needs."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from vve_sumo.hunt.episode import Episode, EpisodePhase
from vve_sumo.hunt.known_limits import known
from vve_sumo.hunt.runner import EpisodeResult
from vve_sumo.plant.injected_faults import KINDS, Shape


@dataclass(frozen=True, slots=True)
class HuntFinding:
    """One violation, shrunk."""

    invariant: str
    result: EpisodeResult

    @property
    def kinds(self) -> frozenset[str]:
        """Return the kinds of actions that the violation needs."""
        return frozenset(action.kind for action in self.result.episode.actions)

    @property
    def name(self) -> str:
        """Return a name that is also one of a file."""
        return "-".join((self.invariant, *sorted(self.kinds)))

    def explains(self, result: EpisodeResult, invariant: str) -> bool:
        """Whether the violation of an episode is this one, with actions on top."""
        return invariant == self.invariant and self.kinds <= {action.kind for action in result.episode.actions}

    def to_dict(self) -> dict[str, Any]:
        """Return the row that a regression test replays."""
        texts = [violation.text for violation in self.result.violations if violation.invariant == self.invariant]
        return {
            "invariant": self.invariant,
            "text": texts[0] if texts else self.result.failure,
            "timeline": str(self.result.episode),
            "episode": self.result.episode.to_dict(),
        }


class Findings:
    """The findings of a hunt, in its folder."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self.all: list[HuntFinding] = []

    def new(self, result: EpisodeResult) -> Iterator[str]:
        """Yield the invariants that an episode breaks in a way not yet found, and that no known limit explains."""
        for invariant in result.broken:
            if not known(invariant, result.episode) and not any(
                finding.explains(result, invariant) for finding in self.all
            ):
                yield invariant

    def keep(self, finding: HuntFinding, rig: str) -> Path:
        """Write a finding as a row, and as a rig that injects its faults; return the row's file."""
        self.all.append(finding)
        file = self._folder / f"{finding.name}.json"
        file.write_text(json.dumps(finding.to_dict(), indent=1) + "\n", encoding="utf-8")
        faults = faults_text(finding.result)
        if faults:
            (self._folder / f"{finding.name}.rig.toml").write_text(f"{rig.rstrip()}\n\n{faults}", encoding="utf-8")
        return file


def read_row(file: Path) -> tuple[str, Episode]:
    """Return invariant and episode of a row that was written."""
    data = json.loads(file.read_text(encoding="utf-8"))
    return data["invariant"], Episode.from_dict(data["episode"])


def faults_text(result: EpisodeResult) -> str:
    """Return the rig's `[[faults]]` of an episode: its faults and what its driver does.

    A rig has no keys and no brain's behaviour; these are left out, and said so.
    """
    moving = result.moved is not None and result.episode.phase not in (
        EpisodePhase.ARMING,
        EpisodePhase.ENGAGING,
        EpisodePhase.HELD,
    )
    begin = result.onset - (result.moved or 0.0 if moving else 0.0)
    lines = [f"# {result.episode}"]
    for action in result.episode.actions:
        if action.kind not in KINDS:
            lines.append(f"# not in a rig: {action}")
            continue
        lines += ["[[faults]]", f'kind = "{action.kind}"', f"at_s = {round(begin + action.after, 3)}"]
        lines.append(f"for_s = {action.duration}")
        if action.value == action.value:
            lines.append(f"value = {action.value}")
        if action.shape is not Shape.STEP:
            lines.append(f'shape = "{action.shape.value}"')
        if action.period == action.period:
            lines.append(f"period_s = {action.period}")
        if not moving:
            lines.append("from_start = true")
    return "\n".join(lines) + "\n" if "[[faults]]" in lines else ""

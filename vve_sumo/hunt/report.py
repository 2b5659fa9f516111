"""The report of a hunt as text: how much was driven, pairs covered, least margins, what was found.

Reads results and findings; runs nothing.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from vve_sumo.hunt.findings import HuntFinding
from vve_sumo.hunt.known_limits import known
from vve_sumo.hunt.runner import EpisodeResult


def min_margins(results: Sequence[EpisodeResult]) -> dict[str, tuple[float, EpisodeResult]]:
    """Return the least margin of every invariant that held, and the episode that it came of."""
    least: dict[str, tuple[float, EpisodeResult]] = {}
    for result in results:
        for invariant, margin in result.margins.items():
            if invariant not in result.broken and margin < least.get(invariant, (2.0, result))[0]:
                least[invariant] = margin, result
    return least


def text(
    results: Mapping[str, EpisodeResult],
    findings: Sequence[HuntFinding],
    *,
    total: int | None,
    last_found: int,
    rate: float,
    left_out: Sequence[str] = (),
) -> str:
    """Return the report; `total` is the number of pairs, None for a search; `rate` is in episodes an hour.

    `left_out` are the kinds of faults that cannot be injected through the rig's interface.
    """
    episodes, seconds = len(results), sum(result.seconds for result in results.values())
    broken = sum(bool(result.broken) for result in results.values())
    expected = sum(known(name, result.episode) for result in results.values() for name in result.broken)
    covered = f" of {total} pairs" if total is not None else ""
    lines = [
        f"{episodes}{covered} episodes, {seconds / 3600.0:.1f} h simulated, {rate:.0f} an hour",
        f"{len(findings)} found, in {broken} episodes; the last {max(episodes - last_found, 0)} episodes gave none",
        f"{expected} violations are known limits (docs/hunt.md)",
        "",
        "least margins of what held (1: far from it, 0: broken):",
    ]
    for invariant, (margin, result) in sorted(min_margins(list(results.values())).items(), key=lambda one: one[1][0]):
        lines.append(f"  {margin:6.3f}  {invariant}: {result.episode}")
    if left_out:
        lines += ["", f"not tried, the rig's interface cannot inject them: {', '.join(left_out)}"]
    lines += ["", "found:" if findings else "found nothing"]
    for finding in findings:
        row = finding.to_dict()
        lines += [f"  {finding.name}", f"      {row['timeline']}", f"      {row['text']}"]
    return "\n".join(lines) + "\n"

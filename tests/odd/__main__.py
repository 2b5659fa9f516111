"""The command: `python -m tests.odd [--hours H] [--seed S] [--level LEVEL]`.

Hours of odd driving in traffic, in episodes of five minutes, each in a process of its own. Exit status 1 where a driver
could have avoided an overlap with the ego, or ego and traffic waited for each other for longer than two minutes.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import sys
from concurrent.futures import ProcessPoolExecutor
from typing import Final

from tests.odd.episode import odd

EPISODE: Final = 300.0  #: [s]
LONGEST_WAIT: Final = 120.0  #: [s]


def main(arguments: list[str] | None = None) -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(prog="python -m tests.odd", description=__doc__.splitlines()[2])
    parser.add_argument("--hours", type=float, default=3.0, help="simulated; default 3")
    parser.add_argument("--seed", type=int, default=1, help="of the first episode")
    parser.add_argument("--level", default="heavy", help="of the shipped traffic")
    options = parser.parse_args(arguments)
    count = max(round(options.hours * 3600.0 / EPISODE), 1)
    seeds = range(options.seed, options.seed + count)
    context = multiprocessing.get_context("forkserver")
    seconds = driven = 0.0
    avoidable, overlaps, jumps, longest = 0, 0, 0, 0.0
    with ProcessPoolExecutor(os.cpu_count(), mp_context=context, max_tasks_per_child=1) as pool:
        for reported in pool.map(odd, seeds, [EPISODE] * count, [options.level] * count):
            for line in (*reported.overlaps, *reported.waits, *reported.jumps):
                print(line)
            seconds, driven, jumps = seconds + reported.seconds, driven + reported.driven, jumps + len(reported.jumps)
            avoidable, overlaps = avoidable + reported.avoidable, overlaps + len(reported.overlaps)
            longest = max(longest, reported.longest_wait)
            print(
                f"seed {reported.seed}: {seconds / 3600.0:.2f} h, {driven / 1000.0:.1f} km; overlaps {overlaps}, "
                f"of which avoidable {avoidable}; longest wait {longest:.0f} s; {jumps} jumps; "
                f"up to {reported.most_standing} standing near the ego",
                flush=True,
            )
    return 1 if avoidable or longest > LONGEST_WAIT else 0


if __name__ == "__main__":
    sys.exit(main())

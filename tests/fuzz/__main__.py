"""The command: `python -m tests.fuzz decoders|gateway|damaged|setpoints|stations [--count N] [--seed S]`.

Runs of the seeds S, S + 1, ... until N of them were tried; one that is broken off goes on with the
seed that its last line names. Exit status 1 and the input at the first violation of an invariant.
"""

from __future__ import annotations

import argparse
import sys
import time

from tests.fuzz import damaged, decoders, gateway, setpoints, stations
from tests.fuzz.invariant import Violation

WHAT = {
    "decoders": (decoders.run, "inputs"),
    "gateway": (gateway.run, "steps"),
    "damaged": (damaged.run, "packets"),
    "setpoints": (setpoints.run, "datagrams"),
    "stations": (stations.run, "datagrams"),
}


def main(arguments: list[str] | None = None) -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__.splitlines()[2])
    parser.add_argument("what", choices=WHAT)
    parser.add_argument("--count", type=int, default=100_000, help="inputs, steps, packets or datagrams to try")
    parser.add_argument("--seed", type=int, default=0, help="of the first run")
    options = parser.parse_args(arguments)
    run, unit = WHAT[options.what]
    begun = said = time.monotonic()
    done, seed = 0, options.seed
    while done < options.count:
        try:
            done += run(seed)
        except Violation as found:
            print(f"{options.what}: violation after {done} {unit}\n{found}")
            return 1
        seed += 1
        if time.monotonic() - said > 10.0:
            said = time.monotonic()
            rate = done / (said - begun)
            print(f"{options.what}: {done} of {options.count} {unit}, {rate:.0f}/s; next seed {seed}", flush=True)
    if options.what == "damaged":
        print(*damaged.reported(damaged.ALL), sep="\n")
    print(f"{options.what}: {done} {unit} of the seeds {options.seed} to {seed - 1}, 0 violations")
    return 0


if __name__ == "__main__":
    sys.exit(main())

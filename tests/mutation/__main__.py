"""The command: `python -m tests.mutation [MODULE ...] [--list] [--sample N] [--seed S]`.

Exit status 0: every mutant was noticed by a test, or lives for a reason that `equivalent.toml` states. 1: another one
lives, or a stated one doesn't live or doesn't exist any more.
"""

from __future__ import annotations

import argparse
import random
import sys
import time

from tests.mutation.equivalents import argued
from tests.mutation.mutants import Mutant
from tests.mutation.subjects import SUBJECTS
from tests.mutation.trial import Outcome, all_mutants, explore, judge


def main(arguments: list[str] | None = None) -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(prog="python -m tests.mutation", description=__doc__.splitlines()[2])
    parser.add_argument(
        "modules", nargs="*", metavar="MODULE", help=f"of {', '.join(SUBJECTS)}; all when none is named"
    )
    parser.add_argument("--list", action="store_true", help="only print the mutants")
    parser.add_argument("--sample", type=int, metavar="N", help="try N mutants of each module, picked by --seed")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args(arguments)
    unknown = [name for name in options.modules if name not in SUBJECTS]
    if unknown:
        parser.error(f"no such module: {', '.join(unknown)}; there are {', '.join(SUBJECTS)}")
    bad = 0
    for name in options.modules or SUBJECTS:
        chosen = every = all_mutants(SUBJECTS[name])
        if options.sample is not None:
            chosen = random.Random(options.seed).sample(every, min(options.sample, len(every)))
        if options.list:
            print(*(_told(name, mutant) for mutant in chosen), sep="\n")
        else:
            bad += _tried(name, chosen, {mutant.key for mutant in every})
    return 1 if bad else 0


def _tried(name: str, chosen: list[Mutant], existing: set[tuple[str, str, str]]) -> int:
    """Try a module's mutants; how many things are wrong."""
    begun, subject, reasons = time.monotonic(), SUBJECTS[name], argued(name)
    outcomes = []
    for outcome in judge(subject, chosen, explore(subject)):
        outcomes.append(outcome)
        if not outcome.killer and outcome.mutant.key not in reasons:
            print(_told(name, outcome.mutant), _why(outcome), sep="\n", flush=True)
    lived = [outcome for outcome in outcomes if not outcome.killer]
    others = [outcome for outcome in lived if outcome.mutant.key not in reasons]
    noticed = [o for o in outcomes if o.killer and o.mutant.key in reasons]
    for outcome in noticed:
        print(f"{_told(name, outcome.mutant)}\n    is argued to be equivalent, but {outcome.killer} notices it")
    gone = [key for key in reasons if key not in existing]
    for scope, text, change in gone:
        print(f"{name}: argued to be equivalent, but there is no such mutant: {scope}: {text}\n    {change}")
    print(
        f"{name}: {len(outcomes)} mutants, {len(outcomes) - len(lived)} noticed, {len(lived) - len(others)} argued, "
        f"{len(others)} lived; {time.monotonic() - begun:.0f} s",
        flush=True,
    )
    return len(others) + len(noticed) + len(gone)


def _told(name: str, mutant: Mutant) -> str:
    place = f"{SUBJECTS[name].path.name}:{mutant.line}"
    return f"{place}: {mutant.scope or 'module'}: {mutant.text}\n    {mutant.change}"


def _why(outcome: Outcome) -> str:
    return f"    lived: {outcome.tests} tests reach it" if outcome.tests else "    lived: no test reaches it"


if __name__ == "__main__":
    sys.exit(main())

"""`vve-sumo certify`: tests an external controller in a scenario, with faults on its wires."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from vve_sumo import progress_bar
from vve_sumo.cli.parser import Parser, names, setting, values_of
from vve_sumo.errors import ConfigError

if TYPE_CHECKING:
    from vve_sumo.certify.results import Certificate

EXIT_CODES = """exit codes:
  0  every case passed
  1  the brain failed a case, or a case could not be tested
  2  wrong use or configuration; nothing was written
  3  the brain does not listen, or a port is taken
  4  the simulation broke
  130  interrupted from the keyboard; finished drives are kept, --resume continues
"""

SUMMARY = "test an external control computer (a brain) with faults on its wires: a certificate"
TEXT = """\
Drive an external control computer (a brain) through a scenario in lockstep, first without a fault, then with one fault
at a time on the wires that carry its sensor data: frozen, lost, late, outdated and corrupt messages, false targets,
stuck counters, wrong validity. Each case requires a reaction within a time, and every drive must keep the certificate's
limits. Writes report.html, certificate.json and the record of every drive. If the brain fails, the report names its
likely defect, inferred from its behaviour alone. A case that cannot be tested does not count as passed.

The brain is started before each case and ended after it. Its answers must depend on the datagrams alone. Without
--brain, the command waits before each case until you have started the brain again and pressed Enter.

Several brains are tested in parallel if the command takes its ports as placeholders: {ncom}, {radar}, … are the ports
of the rig's wires, {setpoints} is brain.port.

examples:
  vve-sumo certify --list                    the cases: what is injected, what is required, and why
  vve-sumo certify --rig rigs/foreign.toml \\
      --brain 'python examples/brains/stop_for_parked.py routes/linden_17th.csv'
  vve-sumo certify --rig ours --brain ./brain --cases radar_ageing,radar_invalid --seeds 20 --out cert
  vve-sumo certify --rig ours --out cert --resume --workers 4 --limit max_deviation_m=0.3 \\
      --brain './brain {ncom} {radar} {setpoints}'
"""


def arguments(parser: Parser) -> None:
    """Add the command's arguments."""
    parser.add_argument("scenario", nargs="?", default="parked_car", help="name or .toml file (default: parked_car)")
    parser.add_argument("--rig", metavar="NAME", help="rig with the wires, whose brain answers with setpoints")
    parser.add_argument("--brain", metavar="COMMAND", help="command that starts the brain, quoted, with its arguments")
    parser.add_argument("--out", type=Path, metavar="DIR", help="output folder, absent or empty (default: under runs/)")
    parser.add_argument(
        "--cases", type=names, default=(), metavar="A,B", help="drive only these cases and the nominal one"
    )
    parser.add_argument("--without", type=names, default=(), metavar="A,B", help="cases to leave out")
    parser.add_argument(
        "--limit", type=setting, action="append", default=[], metavar="NAME=VALUE", dest="limits",
        help="override a limit of the certificate: min_left_m, max_left_m, max_deviation_m, max_overspeed_mps",
    )  # fmt: skip
    parser.add_argument(
        "--workers",
        type=int,
        metavar="N",
        help="brains tested in parallel (default: one a processor if their ports can differ)",
    )
    parser.add_argument("--resume", action="store_true", help="continue the certificate in --out")
    parser.add_argument("--seeds", type=int, default=1, metavar="N", help="drives of each case, by seed (default: 1)")
    parser.add_argument(
        "--set", type=setting, action="append", default=[], metavar="KEY=VALUE", dest="values",
        help="override a value of the scenario: a dotted key, or a parameter that it declares",
    )  # fmt: skip
    parser.add_argument("--list", action="store_true", dest="listed", help="list the cases and drive nothing")
    parser.add_argument("--quiet", action="store_true", help="no progress, only the verdicts at the end")


def run(arguments: argparse.Namespace) -> int:
    """List the cases, or drive them; return the exit code."""
    from vve_sumo.certify.cases import CASES, select_cases

    cases = select_cases(arguments.cases, arguments.without)
    if arguments.listed:
        from vve_sumo.certify.report import required

        for case in CASES:
            print(f"{case.name}\n    injected: {case.injected}\n    required: {required(case)}\n    why: {case.why}")
        return 0
    if arguments.rig is None:
        raise ConfigError("--rig: expected the rig that names the brain's wires; see `vve-sumo certify --help`")
    if arguments.seeds < 1:
        raise ConfigError(f"--seeds: expected 1 or more, got {arguments.seeds}")
    if arguments.resume and arguments.out is None:
        raise ConfigError("--resume: expected --out, the folder to continue")
    from vve_sumo.certify.limits import limits_of
    from vve_sumo.certify.run import CertifyQuery
    from vve_sumo.drive.run import new_run_folder

    working = Path.cwd()
    out = arguments.out if arguments.out is not None else new_run_folder("certificate", working)
    query = CertifyQuery(
        rig=arguments.rig,
        scenario=arguments.scenario,
        command=arguments.brain,
        cases=cases,
        seeds=tuple(range(1, arguments.seeds + 1)),
        out=out,
        values=values_of(arguments.values),
        limits=limits_of(dict(arguments.limits)),
        workers=arguments.workers,
        resume=arguments.resume,
    )
    from vve_sumo.certify import report
    from vve_sumo.certify.run import certify

    with progress_bar.of_runs(quiet=arguments.quiet) as shown:
        certificate = certify(query, working, _wait_for_manual_start, shown)
    page = report.write(certificate, out)
    _show(certificate)
    print(f"written: {page}")
    return 0 if certificate.passed else 1


def _wait_for_manual_start(case: str) -> None:
    """Wait until the brain was started by hand."""
    try:
        input(f"case {case}: start the brain again, then press Enter ")
    except EOFError:
        raise ConfigError(
            "--brain: expected a command: standard input is closed, so the brain cannot be started by hand"
        ) from None


def _show(certificate: Certificate) -> None:
    for result in certificate.results:
        print(f"{result.verdict.value:<14} {result.key}{': ' if result.why else ''}{result.why}")
    for defect in certificate.defects:
        print(f"likely defect: {defect.name} ({', '.join(defect.cases)})")
    print(f"limits: {', '.join(f'{name} = {value:g}' for name, value in certificate.limits.to_dict().items())}")
    print(certificate.verdict)

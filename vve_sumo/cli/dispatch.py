"""The command line put together from its commands, and one command run."""

from __future__ import annotations

import argparse
import io
import sys
import traceback
from collections.abc import Sequence

from vve_sumo.cli import (
    align,
    calibrate,
    certify,
    compare,
    completion,
    doctor,
    dossier,
    drive,
    export,
    hunt,
    init,
    lot,
    metrics,
    network,
    notebooks,
    path,
    pose,
    redrive,
    render,
    replay,
    report,
    ros2,
    scenarios,
    steering_margin,
    study,
    suite,
    sweep,
    vehicle,
    view,
)
from vve_sumo.cli.console import DEFECT, INTERRUPTED, PIPE_CLOSED, complain
from vve_sumo.cli.parser import EXIT_CODES, Parser, add_command
from vve_sumo.errors import VveError
from vve_sumo.version import __version__

#: in the order of the help's list; a command imports the modules that it needs when it runs
COMMANDS = (
    drive,
    scenarios,
    suite,
    certify,
    hunt,
    sweep,
    study,
    doctor,
    lot,
    dossier,
    align,
    calibrate,
    vehicle,
    replay,
    redrive,
    view,
    report,
    render,
    ros2,
    export,
    compare,
    metrics,
    pose,
    path,
    network,
    steering_margin,
    init,
    notebooks,
    completion,
)


def parser() -> Parser:
    """Return the parser of the whole command line."""
    root = Parser(
        prog="vve-sumo",
        description="Vehicle in Virtual Environment testing on SUMO: a real drive-by-wire car, a virtual road.",
        epilog="Start with `vve-sumo drive`: it drives the simulated vehicle towards a parked car in Linden.\n"
        "docs/ has a page on every subject, such as docs/scenarios.md and docs/rigs.md; docs/pages.md lists them.\n\n"
        + EXIT_CODES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    root.add_argument("--version", action="version", version=f"vve-sumo {__version__}")
    commands = root.add_subparsers(dest="command", metavar="COMMAND", required=True, parser_class=Parser)
    for command in COMMANDS:
        name, codes = command.__name__.rpartition(".")[2].replace("_", "-"), getattr(command, "EXIT_CODES", EXIT_CODES)
        # A group of subcommands has a summary alone; each subcommand sets its own `run`.
        text = getattr(command, "TEXT", f"{command.SUMMARY[0].upper()}{command.SUMMARY[1:]}.")
        added = add_command(commands, name, command.SUMMARY, text, codes)
        added.set_defaults(run=getattr(command, "run", None))
        command.arguments(added)
        if command is completion:
            added.set_defaults(command_line=root)
    return root


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code; an error of ours is one line on the screen."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    try:
        parsed = parser().parse_args(arguments)
        code: int = parsed.run(parsed)
    except VveError as error:
        complain(str(error))
        return error.exit_code
    except BrokenPipeError:
        return PIPE_CLOSED
    except OSError as error:
        complain(f"{error.filename or 'a file'}: {error.strerror or error}")
        return 2
    except KeyboardInterrupt as interrupt:
        complain(str(interrupt) or "interrupted")
        return INTERRUPTED
    except Exception:
        # Python's own exit code of an exception, 1, would mean that a drive failed its criteria.
        traceback.print_exc()
        return DEFECT
    return code

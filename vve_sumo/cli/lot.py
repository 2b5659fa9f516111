"""`vve-sumo lot`: surveys the lot by a walk or drive along its edge."""

from __future__ import annotations

import argparse
import datetime
from pathlib import Path

from vve_sumo.cli.parser import OF_FILES, Parser, add_command, add_subcommands
from vve_sumo.errors import ConfigError

EXIT_CODES = OF_FILES

SUMMARY = "survey the lot by a walk or drive along its edge"
SURVEY_TEXT = """\
Make the lot's outline from a recording that was walked or driven once along its edge with the receiver, and back to
the begin: NCOM bytes, or CSV as vve-sumo drive --pose takes it. The outline is that of the receiver's output point, so
carry or mount it over the edge, or stay inside. Print how far the places lie off the outline, how accurate each is, and
the margin that follows; refuse an outline that is open, has a gap or crosses itself.

examples:
  vve-sumo lot survey walk.csv --accuracy 0.02     the table [lot], to copy into a rig
  vve-sumo lot survey walk.ncom --rig ours --write   write it into the rig
"""


def arguments(parser: Parser) -> None:
    """Add the command's arguments."""
    survey = add_command(
        add_subcommands(parser), "survey", "make the outline of [lot] from a walk along its edge", SURVEY_TEXT, OF_FILES
    )
    survey.add_argument("recording", type=Path, metavar="FILE", help="of poses along the edge: NCOM bytes or .csv")
    survey.add_argument(
        "--accuracy",
        type=float,
        metavar="N",
        help="standard deviation of a position in metres, for a recording that does not hold it",
    )
    survey.add_argument("--rig", metavar="NAME", help="with --write: a name under rigs/ or a .toml file")
    survey.add_argument(
        "--write", action="store_true", help="write outline, day and margin into the rig; a larger margin there stays"
    )
    survey.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Survey a lot and print its table, or store it; return the exit code, 0."""
    from vve_sumo.commissioning.lot_survey import store, survey_recording

    if arguments.write != (arguments.rig is not None):
        raise ConfigError("--write and --rig: expected both or neither")
    if arguments.accuracy is not None and not arguments.accuracy > 0.0:
        raise ConfigError(f"--accuracy: expected more than 0 m, got {arguments.accuracy:g}")
    today = datetime.date.today()
    found = survey_recording(arguments.recording, arguments.accuracy)
    for line in found.lines():
        print(line)
    if arguments.write:
        print(f"stored in {store(found, arguments.rig, Path.cwd(), today)}")
    else:
        print(f"\n{found.toml(today)}", end="")
    return 0

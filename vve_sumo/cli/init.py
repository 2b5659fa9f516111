"""`vve-sumo init`: a workspace of your own, or a rig file of your own."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from vve_sumo.cli.parser import OF_FILES, Parser
from vve_sumo.errors import ConfigError

if TYPE_CHECKING:
    from vve_sumo.rig.questionnaire import Question

EXIT_CODES = OF_FILES

SUMMARY = "create a workspace of your own"
TEXT = """\
Copy the shipped controllers, networks, notebooks, rigs, routes, scenarios, sweeps and vehicles into a
folder, with examples of external controllers (examples/brains) and of a car by its DBC file
(examples/own_car), and the suites that a receiver, a sensor, a drive-by-wire interface and metrics of your
own must pass (tests/ports). Run vve-sumo from there: your files take precedence over shipped ones of the same
name.

With --rig, ask for what a real car's rig needs and write the file. What is not known yet is marked in it, and the
file is refused, naming the first such key, until it is filled in. Enter takes what stands in brackets, or leaves it
open.

examples:
  vve-sumo init mine                    a workspace
  vve-sumo init --rig rigs/ours.toml    a rig file, by questions
"""


def arguments(parser: Parser) -> None:
    """Add the command's arguments."""
    parser.add_argument(
        "folder", type=Path, nargs="?", metavar="DIR", help="folder to create; existing files are never replaced"
    )
    parser.add_argument("--rig", type=Path, metavar="FILE", help="rig file to write by questions; never replaced")
    parser.add_argument(
        "--answers", type=Path, metavar="FILE", help="with --rig: a TOML file with a rig's keys; nothing is asked"
    )


def run(arguments: argparse.Namespace) -> int:
    """Copy the shipped workspace into a folder, or write a rig file; return the exit code, 0."""
    if (arguments.folder is None) == (arguments.rig is None):
        raise ConfigError("expected either DIR, a folder to create, or --rig FILE, a rig file to write")
    if arguments.rig is not None:
        return _rig(arguments.rig, arguments.answers)
    if arguments.answers is not None:
        raise ConfigError("--answers: expected --rig beside it")
    from vve_sumo.workspace import lay_out

    written = lay_out(arguments.folder)
    print(f"{len(written)} files laid out in {arguments.folder}; next: cd {arguments.folder} && vve-sumo drive")
    return 0


def _rig(file: Path, answers_file: Path | None) -> int:
    """Write a rig file by the answers of a file or of whoever sits at the terminal."""
    from vve_sumo.config_file import read
    from vve_sumo.rig import questionnaire

    if file.exists():
        raise ConfigError(f"{file}: is there already, and is not replaced; name another")
    if answers_file is None:
        answers = questionnaire.asked(_ask)
    else:
        try:
            answers = questionnaire.taken(read(answers_file, "answers"))
        except ConfigError as error:
            named = str(error).startswith(str(answers_file))
            raise error if named else ConfigError(f"{answers_file}: {error}") from None
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(questionnaire.text_of(answers), encoding="utf-8")
    unknown = questionnaire.unknown_keys(answers)
    print(f"{file}: {len(unknown)} keys to be filled in{', first ' + unknown[0] if unknown else ''}")
    if not unknown:
        print(f"next: vve-sumo scenarios --fit-lot {file}, then vve-sumo doctor SCENARIO --rig {file}")
    return 0


def _ask(question: Question, wrong: str) -> str:
    """Ask a question on the terminal; the end of the input answers nothing."""
    if wrong:
        print(wrong)
    choices = f" ({', '.join(question.choices)})" if question.choices else ""
    default = f" [{question.default}]" if question.default else ""
    print(f"{question.key}: {question.words}{choices}{default}: ", end="", flush=True)
    line = sys.stdin.readline()
    if not line.endswith("\n"):
        print()
    return line

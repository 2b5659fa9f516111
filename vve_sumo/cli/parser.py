"""What the commands' parsers share: adding commands, the text of errors, and the types of arguments."""

from __future__ import annotations

import argparse
import re
import tomllib
from collections.abc import Sequence
from typing import Any, TypeAlias

from vve_sumo.errors import ConfigError, did_you_mean
from vve_sumo.workspace import documentation

EXIT_CODES = """exit codes:
  0  good
  1  the drive ran and failed its criteria
  2  wrong use or configuration; nothing was written
  3  the rig is not ready
  4  the simulation broke
  70  a defect of vve_sumo; its traceback says where
  130  interrupted from the keyboard
"""

#: exit codes of a command that only reads and writes files
OF_FILES = """exit codes:
  0  done
  2  wrong use or configuration; nothing was written
  70  a defect of vve_sumo; its traceback says where
  130  interrupted from the keyboard
"""

#: former names of options and commands, and their present names
FORMER_OPTIONS = {
    **dict.fromkeys(("--store", "--yes"), "--write"),
    "--cut": "--write-shortened-path",
    "--leave": "--keep-values",
    "--keep": "--keep-records",
    "--runs": "--seeds",
}
FORMER_COMMANDS = {"cliff": "study latency", "design": "steering-margin"}

#: argparse's message about an unknown command or value
_CHOICES = re.compile(r"invalid choice: '(?P<name>.*)' \(choose from (?P<known>.*)\)$")
_NAME = re.compile(r"[^\s',]+")
#: argparse's message about options that a command does not have
_UNRECOGNIZED = re.compile(r"unrecognized arguments: (?P<arguments>.*)$")
#: argparse's message where an option is followed by nothing, or by what looks like another option
_LACKING = re.compile(r"^argument (?P<option>--[\w-]+): expected one argument$")


class Parser(argparse.ArgumentParser):
    """A parser whose errors are one line, with a pointer to the help."""

    def format_help(self) -> str:
        """Return the help, with the location of the docs that it names."""
        text = super().format_help()
        return f"{text}\ndocs/ is {documentation()}\n" if "docs/" in text else text

    def error(self, message: str) -> None:  # type: ignore[override]
        """Exit with one line and code 2."""
        self.exit(2, f"{self.prog}: {_with_suggestion(message)} (see {self.prog} --help)\n")


def _with_suggestion(message: str) -> str:
    """Return argparse's message with a suggestion; for a former name, only the present one."""
    if choices := _CHOICES.search(message):
        name = choices["name"]
        if name in FORMER_COMMANDS:
            return f"{name} is now vve-sumo {FORMER_COMMANDS[name]}"
        suggestion = did_you_mean(name, _NAME.findall(choices["known"]))
        return f"{message}; {suggestion}" if suggestion else message
    if lacking := _LACKING.search(message):
        return f"{message}; one that begins with a minus is written {lacking['option']}=-…"
    if unknown := _UNRECOGNIZED.search(message):
        for argument in unknown["arguments"].split():
            option = argument.partition("=")[0]
            if option in FORMER_OPTIONS:
                return f"{option} is now {FORMER_OPTIONS[option]}"
    return f"{message}, such as csv" if message.endswith("required: FORMAT") else message


#: the object that commands are added to
Commands: TypeAlias = "argparse._SubParsersAction[Parser]"


def add_command(commands: Commands, name: str, summary: str, text: str, codes: str) -> Parser:
    """Add a command with its line in the list, its text and its exit codes; return its parser."""
    return commands.add_parser(
        name, help=summary, description=text, epilog=codes, formatter_class=argparse.RawDescriptionHelpFormatter
    )


def add_subcommands(command: Parser, *, required: bool = True) -> Commands:
    """Give a command commands of its own."""
    return command.add_subparsers(dest="subcommand", metavar="COMMAND", required=required, parser_class=Parser)


def add_json(parser: Parser, content: str) -> None:
    """Add `--json`, with which a command prints one JSON document of `content` and nothing else on standard output."""
    parser.add_argument("--json", action="store_true", help=f"print {content} as JSON, for programs to read")


def setting(text: str) -> tuple[str, Any]:
    """Return key and value of KEY=VALUE; a value that is no TOML is a string."""
    key, equals, value = text.partition("=")
    if not key.strip() or not equals or not value.strip():
        raise argparse.ArgumentTypeError(f"expected KEY=VALUE such as ego.speed_mps=12, got {text!r}")
    try:
        return key.strip(), tomllib.loads(f"value = {value}")["value"]
    except (tomllib.TOMLDecodeError, RecursionError):
        return key.strip(), value.strip()


def speed(text: str) -> float:
    """Return the speed [m/s] of a number or of a quantity such as 25 km/h."""
    from vve_sumo.units import DIMENSIONS, converted, is_quantity

    try:
        found = converted(text, DIMENSIONS["_mps"]) if is_quantity(text) else float(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"expected m/s or a speed such as '25 km/h': {error}") from None
    if not 0.0 < found < 100.0:
        raise argparse.ArgumentTypeError(f"expected more than 0 and less than 100 m/s, got {text!r}")
    return found


def add_speed(parser: Parser) -> None:
    """Add `--speed`, the ego's in place of the scenario's."""
    parser.add_argument(
        "--speed",
        type=speed,
        metavar="SPEED",
        help="speed of the ego in place of the scenario's: m/s, or with a unit such as '25 km/h'; the scenario's "
        "parameter `speed` takes it where it has one",
    )


def values_of(settings: Sequence[tuple[str, Any]]) -> dict[str, Any]:
    """Return the settings by key; raises ConfigError for a key that is set twice."""
    keys = [key for key, _value in settings]
    duplicate = next((key for at, key in enumerate(keys) if key in keys[:at]), None)
    if duplicate is not None:
        raise ConfigError(f"--set {duplicate}: is set twice, expected each key once")
    return dict(settings)


def names(text: str) -> tuple[str, ...]:
    """Return the names of a list such as a,b,c."""
    return tuple(name for name in text.split(",") if name)


def numbers(text: str) -> tuple[float, ...]:
    """Return the numbers of a list such as 0,100,200."""
    try:
        return tuple(float(part) for part in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"expected numbers such as 0,100,200, got {text!r}") from None

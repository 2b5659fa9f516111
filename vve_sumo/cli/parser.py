"""What the commands' parsers share: how a command is added, how errors read, and the kinds of arguments."""

from __future__ import annotations

import argparse
from typing import TypeAlias

EXIT_CODES = """exit codes:
  0  good
  1  the drive ran and failed its criteria
  2  wrong use or configuration; nothing was written
  3  the rig is not ready
  4  the simulation broke
  130  interrupted from the keyboard
"""


class Parser(argparse.ArgumentParser):
    """Says what is wrong in one line, then where to read on."""

    def error(self, message: str) -> None:  # type: ignore[override]
        """Exit with one line and code 2."""
        self.exit(2, f"{self.prog}: {message} (see {self.prog} --help)\n")


#: what a command is added to
Commands: TypeAlias = "argparse._SubParsersAction[Parser]"


def add_command(commands: Commands, name: str, summary: str, text: str, codes: str = EXIT_CODES) -> Parser:
    """Add a command with its line in the list, its text and its exit codes; return its parser."""
    return commands.add_parser(
        name, help=summary, description=text, epilog=codes, formatter_class=argparse.RawDescriptionHelpFormatter
    )


def add_subcommands(command: Parser, *, required: bool = True) -> Commands:
    """Give a command commands of its own."""
    return command.add_subparsers(dest="what", metavar="WHAT", required=required, parser_class=Parser)


def names(text: str) -> tuple[str, ...]:
    """Return the names of a list such as a,b,c."""
    return tuple(name for name in text.split(",") if name)


def numbers(text: str) -> tuple[float, ...]:
    """Return the numbers of a list such as 0,100,200."""
    try:
        return tuple(float(part) for part in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"expected numbers such as 0,100,200, got {text!r}") from None

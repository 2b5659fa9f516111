"""`vve-sumo completion`: prints a shell's completion script."""

from __future__ import annotations

import argparse

from vve_sumo.cli.parser import OF_FILES, Parser

SHELLS = ("bash", "zsh", "tcsh")

EXIT_CODES = OF_FILES
SUMMARY = "print the completion of commands and options for a shell"
TEXT = """\
Print a script with which a shell completes commands and options on the Tab key.

examples:
  vve-sumo completion bash >> ~/.bash_completion
  vve-sumo completion zsh > ~/.zsh/completions/_vve-sumo     a folder of zsh's fpath
"""


def arguments(parser: Parser) -> None:
    """Add the command's arguments."""
    parser.add_argument("shell", choices=SHELLS, metavar="SHELL", help=f"one of {', '.join(SHELLS)}")


def run(arguments: argparse.Namespace) -> int:
    """Print the script; return the exit code, 0."""
    import shtab

    print(shtab.complete(arguments.command_line, arguments.shell))
    return 0

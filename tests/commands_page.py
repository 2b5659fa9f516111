"""The page of the command line, written from the parsers: no option can be missing there, or be told otherwise."""

from __future__ import annotations

import argparse
import itertools
import re
import textwrap
from collections.abc import Iterator

from vve_sumo.cli.dispatch import parser as whole_parser
from vve_sumo.cli.parser import EXIT_CODES


def markdown() -> str:
    """The section of every command."""
    parser = whole_parser()
    return "\n\n".join(itertools.chain.from_iterable(_section(*one, 2) for one in _commands(parser)))


def parsers() -> dict[str, argparse.ArgumentParser]:
    """The parser of every command in the order of the help, by its name, such as `path record`."""
    return {command.prog.removeprefix("vve-sumo "): command for command in _all(whole_parser())}


def _all(parser: argparse.ArgumentParser) -> Iterator[argparse.ArgumentParser]:
    for command, _summary in _commands(parser):
        yield command
        yield from _all(command)


def _commands(parser: argparse.ArgumentParser) -> Iterator[tuple[argparse.ArgumentParser, str]]:
    """Yield the commands of a parser with the line of each in the list."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            summaries = {choice.dest: choice.help or "" for choice in action._choices_actions}
            for name, command in action.choices.items():
                yield command, summaries[name]


def _section(command: argparse.ArgumentParser, summary: str, level: int) -> Iterator[str]:
    yield f"{'#' * level} {command.prog.removeprefix('vve-sumo ')}"
    said = _text(command.description or "")
    yield said if said else f"{summary[0].upper()}{summary[1:]}."
    inner = list(_commands(command))
    if not inner or any(not action.option_strings for action in _arguments(command)):
        yield f"```text\n{_usage(command)}\n```"
    if arguments := list(_arguments(command)):
        yield "\n".join(["| argument | meaning |", "|---|---|", *(_row(command, action) for action in arguments)])
    if command.epilog and not command.epilog.startswith(EXIT_CODES) and not inner:
        yield _text(command.epilog)
    for one in inner:
        yield from _section(*one, level + 1)


def _arguments(command: argparse.ArgumentParser) -> Iterator[argparse.Action]:
    """Yield what a command takes, without `--help` and the commands of a group."""
    hidden = (argparse._HelpAction, argparse._SubParsersAction)
    for action in command._actions:
        if not isinstance(action, hidden) and action.help is not argparse.SUPPRESS:
            yield action


def _usage(command: argparse.ArgumentParser) -> str:
    """Return how a command is written; a parser's own words for it differ between versions of Python."""
    arguments = list(_arguments(command))
    options = [action for action in arguments if action.option_strings]
    needed = [f"{action.option_strings[-1]} {_value(action)}" for action in options if action.required]
    optional = any(not action.required for action in options)
    places = [_value(action) for action in arguments if not action.option_strings]
    return " ".join([command.prog, *places, *needed, *(["[options]"] if optional else [])])


def _value(action: argparse.Action) -> str:
    """Return what stands for the value of an argument; empty for a switch."""
    if action.nargs == 0:
        return ""
    if isinstance(action.metavar, tuple):
        return " ".join(action.metavar)
    name = action.metavar or (",".join(map(str, action.choices)) if action.choices else action.dest.upper())
    many = {"?": f"[{name}]", "*": f"[{name} …]", "+": f"{name} [{name} …]"}
    return many.get(str(action.nargs), " ".join([name] * action.nargs) if isinstance(action.nargs, int) else name)


def _row(command: argparse.ArgumentParser, action: argparse.Action) -> str:
    said = command._get_formatter()._expand_help(action) if action.help else ""
    written = f"{', '.join(action.option_strings)} {_value(action)}".strip()
    return f"| `{written}` | {_escaped(said)} |"


def _text(text: str) -> str:
    """Return the text of a help as Markdown: lines that are set in are code, the others prose."""
    parts = []
    for paragraph in re.split(r"\n\s*\n", text.strip("\n")):
        for indented, lines in itertools.groupby(paragraph.splitlines(), lambda line: line.startswith("  ")):
            said = "\n".join(lines)
            parts.append(f"```text\n{textwrap.dedent(said)}\n```" if indented else _escaped(said))
    return "\n\n".join(parts)


def _escaped(text: str) -> str:
    """Return the text in one line, with what Markdown would take for its own made harmless."""
    return re.sub(r"([*|<])", r"\\\1", " ".join(text.split("\n")))

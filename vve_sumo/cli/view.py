"""`vve-sumo view`: records, sweeps and the running live drive in a browser."""

from __future__ import annotations

import argparse
import contextlib
import json
import os
from pathlib import Path

from vve_sumo.cli.parser import OF_FILES, Parser
from vve_sumo.errors import ConfigError

EXIT_CODES = OF_FILES

SUMMARY = "show a record, two side by side, a sweep, or the running live drive in a browser"
TEXT = """\
Serve a page on this machine that shows a drive's record with timeline, playback, single steps and events, two records
side by side, or a sweep as a table whose kept runs open. The address is printed; Ctrl-C ends the page. The page of a
live drive is served by the drive itself, with --view; --live prints its address.

examples:
  vve-sumo view runs/parked_car                 the drive, played back
  vve-sumo view before after                    two drives in step
  vve-sumo view sweep                           a sweep as a table that sorts, filters and plots
  vve-sumo view runs/parked_car --html drive.html   one self-contained file, to send to others
  vve-sumo view --live                          address of the running live drive's page
"""

#: folder with the live drives' folders
RUNS = "runs"


def arguments(parser: Parser) -> None:
    """Add the command's arguments."""
    parser.add_argument("folders", nargs="*", type=Path, metavar="DIR", help="a record, two records, or a sweep")
    parser.add_argument("--html", type=Path, metavar="FILE", help="write one self-contained page instead of serving it")
    parser.add_argument("--port", type=int, default=0, metavar="N", help="port of the server (default: any free one)")
    parser.add_argument(
        "--live", action="store_true", help="print the address of the running live drive; DIR if it is not under runs/"
    )


def run(arguments: argparse.Namespace) -> int:
    """Serve, write or print; return the exit code."""
    folders: list[Path] = arguments.folders
    if arguments.live:
        if len(folders) > 1 or arguments.html is not None:
            raise ConfigError("--live: expected at most the folder of one drive, and no --html")
        print(live_address(folders[0] if folders else None, Path.cwd()))
        return 0
    if not folders:
        raise ConfigError("expected the folder of a record or a sweep, or --live")
    if not 0 <= arguments.port <= 65535:
        raise ConfigError(f"--port: expected 0 to 65535, got {arguments.port}")
    if arguments.html is not None:
        return _write(folders, arguments.html)
    from vve_sumo.view.server import replay_server

    server = replay_server(folders, arguments.port)
    print(f"view: {server.address}", flush=True)
    print("Ctrl-C ends it", flush=True)
    with contextlib.suppress(KeyboardInterrupt):
        server.run()
    return 0


def _write(folders: list[Path], file: Path) -> int:
    from vve_sumo.view.library import Library

    page = Library(folders).page()
    file.write_text(page, encoding="utf-8")
    print(f"view: {file} ({len(page) / 1e6:.1f} MB)")
    return 0


def live_address(folder: Path | None, working: Path) -> str:
    """Return the address of a running live drive's page, in a folder or the newest under RUNS of `working`.

    Raises ConfigError where there is none.
    """
    # The name of the file is that of live.view, which brings the whole server with it.
    name = "view.json"
    files = [folder / name] if folder is not None else sorted((working / RUNS).glob(f"*/{name}"), key=_age)
    for file in files:
        with contextlib.suppress(OSError, ValueError, KeyError, TypeError):
            content = json.loads(file.read_text(encoding="utf-8"))
            os.kill(int(content["pid"]), 0)
            return str(content["address"])
    where = folder if folder is not None else working / RUNS
    raise ConfigError(
        f"{where}: no live drive with a page is running there; start one with vve-sumo drive --rig … --view"
    )


def _age(file: Path) -> float:
    return -file.stat().st_mtime

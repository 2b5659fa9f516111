"""`vve-sumo notebooks`: notebooks to begin an analysis with."""

from __future__ import annotations

import argparse
import shlex
from pathlib import Path

from vve_sumo.cli.parser import Parser

EXIT_CODES = """exit codes:
  0  the notebooks were copied
  2  wrong use, or the folder holds one of them; nothing was written
"""

SUMMARY = "copy five Jupyter notebooks to begin an analysis with"
TEXT = """\
Copy five notebooks into a folder: the paper's drive, stopping over a sweep of speeds, the latency cliff, a
recording through the pipeline, two controllers over 200 drives. Each makes its own records, under runs/ beside it,
and explains what it shows.
"""


def arguments(parser: Parser) -> None:
    """Add the command's arguments."""
    parser.add_argument(
        "folder", type=Path, metavar="DIR", help="folder for the notebooks; existing files are never replaced"
    )


def run(arguments: argparse.Namespace) -> int:
    """Copy the shipped notebooks into a folder; return the exit code, 0."""
    from vve_sumo.workspace import lay_out_notebooks

    written = lay_out_notebooks(arguments.folder)
    print(f"{len(written)} notebooks in {arguments.folder}; next:")
    print(f"  pip install 'vve-sumo[notebooks]' && jupyter lab {shlex.quote(str(arguments.folder))}")
    return 0

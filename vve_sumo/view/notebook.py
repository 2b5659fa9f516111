"""A record's or a sweep's page inside a notebook: a frame with the page that a thread of this process serves."""

from __future__ import annotations

import atexit
import threading
from html import escape
from pathlib import Path
from typing import Final

from vve_sumo.view.library import Library
from vve_sumo.view.server import Server, library_routes

#: of the frame in the cell [CSS pixels]
HEIGHT: Final = 720
#: for the server's thread to end [s]
END_TIMEOUT: Final = 3.0


class ShownPage:
    """A page that is served until `close` or the end of the process; in a notebook the cell shows it."""

    def __init__(self, folder: Path) -> None:
        """Serve the page of a record or a sweep on the loopback; raises ConfigError as `Library` does."""
        self._server = Server(library_routes(Library([folder])))
        self._thread = threading.Thread(target=self._server.run, name="vve-sumo view", daemon=True)
        self._thread.start()
        atexit.register(self.close)

    @property
    def address(self) -> str:
        """What a browser on this machine opens."""
        return self._server.address

    def close(self) -> None:
        """End the page's server."""
        self._server.close()
        self._thread.join(END_TIMEOUT)

    def __repr__(self) -> str:
        return f"<page at {self.address}>"

    def _repr_html_(self) -> str:
        return f'<iframe src="{escape(self.address)}" width="100%" height="{HEIGHT}" frameborder="0"></iframe>'


def write_page(folder: Path, file: Path) -> Path:
    """Write the page of a record or a sweep as one file that needs nothing else, and return the file.

    Raises ConfigError as `Library` does, OSError where the file cannot be written.
    """
    file.write_text(Library([folder]).page(), encoding="utf-8")
    return file

"""Names for pseudo-terminals of this machine: `pty:FILE` makes FILE a link to one, which another program then opens.

It knows links; it must not know what goes over a terminal.
"""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Final

from vve_sumo.errors import RigError

#: of a channel or a device that is a link to a pseudo-terminal
PREFIX: Final = "pty:"
#: where the kernel keeps pseudo-terminals: another link is not one of a drive before
TERMINALS: Final = Path("/dev/pts")


class PtyLink:
    """A link to a terminal, there from the beginning until `remove`."""

    def __init__(self, name: str, terminal: str) -> None:
        """Make the link that `pty:FILE` names; raises RigError where FILE is something else than such a link."""
        if not name.startswith(PREFIX):
            raise RigError(f"{name}: expected {PREFIX}FILE")  # never a link in place of a device
        self._link, self._terminal = Path(name.removeprefix(PREFIX)), terminal
        try:
            if self._link.is_symlink() and self._link.readlink().is_relative_to(TERMINALS):
                self._link.unlink()  # of a drive that was killed
            self._link.symlink_to(terminal)
        except OSError as error:
            raise RigError(f"{name}: cannot be made ({error.strerror}: {self._link})") from None

    def remove(self) -> None:
        """Remove the link, unless a later drive has its own there."""
        with contextlib.suppress(OSError):
            if str(self._link.readlink()) == self._terminal:
                self._link.unlink()

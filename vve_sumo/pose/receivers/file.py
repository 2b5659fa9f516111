"""Recordings played as if a receiver sent them now; no car is armed on one."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

from pydantic import Field

from vve_sumo.config_file import Name
from vve_sumo.pose import ncom, sources
from vve_sumo.pose.receivers.port import OpenBus, Receiver, ReceiverTable
from vve_sumo.pose.trust import PLAYBACK, TrustProfile


class RecordedDrive(ReceiverTable):
    """A recorded drive, played in real time as NCOM."""

    profile: ClassVar[TrustProfile] = PLAYBACK
    silent_hint: ClassVar[str] = "see pose.file"

    file: Name = Field(description="recording to be played; cannot arm anything")

    def open(self, _open_bus: OpenBus) -> sources.Source:
        """Read the recording; raises ConfigError naming file, line and column."""
        return sources.open_file(Path(self.file))

    def decoder(self) -> ncom.Decoder:
        """Return a fresh decoder."""
        return ncom.Decoder()

    def place(self) -> str:
        """Return the file."""
        return self.file


def make() -> type[Receiver]:
    """Return the kind's class."""
    return RecordedDrive

"""The link between an environment and the process that drives for it: one observation out, one action back.

A Unix socket in a private folder carries it, a message a packet. Knows neither gymnasium nor how a drive is run.
"""

from __future__ import annotations

import socket
import struct
from pathlib import Path
from typing import Final, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from vve_sumo.bridges.observed_numbers import FEATURES

_ACTION: Final = struct.Struct("<dd")
_OBSERVATION: Final = np.dtype("<f4")
_OBSERVATION_BYTES: Final = len(FEATURES) * _OBSERVATION.itemsize


class AgentAction(NamedTuple):
    """What an agent asks for until its next action."""

    acceleration: float  #: along the heading [m/s2], braking negative
    steering: float  #: road-wheel angle [rad], left positive; not used where the scenario's controller steers


class LinkClosedError(Exception):
    """The other end is gone."""


class AgentLink:
    """One end of the link of one drive."""

    def __init__(self, connected: socket.socket) -> None:
        self._socket = connected

    @classmethod
    def connect(cls, address: Path) -> Self:
        """Connect to the environment that listens at an address; raises OSError where none does."""
        own = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        own.connect(str(address))
        return cls(own)

    def close(self) -> None:
        """Close this end."""
        self._socket.close()

    def send_observation(self, observation: NDArray[np.float32]) -> None:
        """Send the vector of an observation; raises LinkClosedError."""
        self._send(observation.astype(_OBSERVATION).tobytes())

    def receive_observation(self) -> NDArray[np.float32]:
        """Wait for an observation; raises LinkClosedError where the drive is over."""
        return np.frombuffer(self._receive(_OBSERVATION_BYTES), _OBSERVATION).astype(np.float32)

    def send_action(self, action: AgentAction) -> None:
        """Send an action; raises LinkClosedError."""
        self._send(_ACTION.pack(*action))

    def receive_action(self) -> AgentAction:
        """Wait for an action; raises LinkClosedError where the environment is gone or has given the drive up."""
        return AgentAction(*_ACTION.unpack(self._receive(_ACTION.size)))

    def _send(self, data: bytes) -> None:
        try:
            self._socket.send(data)
        except OSError as error:
            raise LinkClosedError from error

    def _receive(self, size: int) -> bytes:
        try:
            data = self._socket.recv(size)
        except OSError as error:
            raise LinkClosedError from error
        if len(data) != size:
            raise LinkClosedError
        return data


def listen(address: Path) -> socket.socket:
    """Return the socket at which one drive may connect; its folder has to be closed to other users."""
    listening = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    listening.bind(str(address))
    listening.listen(1)
    return listening

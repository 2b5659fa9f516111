"""The one error of bytes that are no message."""

from __future__ import annotations


class MessageDecodeError(ValueError):
    """Bytes are not the message, or the packet, that they were decoded as."""

"""Signs this project's own datagrams with a key that two computers share, and checks the signature.

A signed datagram ends in TAG bytes more: the first of the HMAC-SHA-256 (RFC 2104) of all before, which only who has the
key can make. Knows bytes; it must not know what they mean, nor where a key is kept.
"""

from __future__ import annotations

import hashlib
import hmac
from typing import Final

TAG: Final = 16  #: [bytes]


def signed(data: bytes, key: bytes) -> bytes:
    """Return a datagram with the tag that a key gives it."""
    return data + hmac.new(key, data, hashlib.sha256).digest()[:TAG]


def without_tag(data: bytes, key: bytes) -> bytes | None:
    """Return a datagram without its tag, or None where it was not `signed` with the key; all of it without a key."""
    if not key:
        return data
    body = data[:-TAG]
    return body if hmac.compare_digest(signed(body, key), data) else None

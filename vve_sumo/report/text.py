"""Text that a page may hold.

Knows characters only.
"""

from __future__ import annotations

import re

#: no page may hold these: control characters, halves of characters, and marks that turn the reading direction round
_UNFIT = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u202a-\u202e\u2066-\u2069\ud800-\udfff\ufffe\uffff]"
)


def printable(text: str) -> str:
    """Return a text with a replacement character for each that no page may hold."""
    return _UNFIT.sub("\ufffd", text)

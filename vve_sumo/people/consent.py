"""The text that a person acknowledges before a drive, and its hash, by which the record says which text it was."""

from __future__ import annotations

import hashlib
from typing import Final

TEXT: Final = "\n\n".join(
    (
        "You take part in a test of a car. The car is real and drives by itself in a field of its own, which you "
        "must never enter. You stay in your field, away from it. Your position decides where a virtual you stands "
        "in a virtual street; the car brakes for that one, and cannot see you yourself.",
        "Until the drive is over this page reports to the test's computer, and the test's record keeps: your "
        "position with its accuracy, the direction of your phone, and when you pressed a button. Nothing else of "
        "your phone is read.",
        "Leave your field only after you have pressed STOP. Look where you walk, not at the phone. If the page "
        "turns red, or if anything is unclear, press STOP and stand still. You may press STOP at any time, "
        "without a reason. A closed or hidden page stops the car as well, within a few seconds.",
    )
)


def digest(text: str) -> str:
    """Return the hash of a text (hexadecimal SHA-256)."""
    return hashlib.sha256(text.encode()).hexdigest()

"""Values compared bit by bit, which tells NaN from nothing and a number from one beside it."""

from __future__ import annotations

import dataclasses
import math
import struct
from typing import Any

import numpy as np


def bits(value: Any) -> Any:
    """Return something that is equal only where every bit of every number is."""
    if isinstance(value, float):
        return "nan" if math.isnan(value) else struct.pack("<d", value)
    if isinstance(value, np.ndarray):
        return value.dtype, value.shape, value.tobytes()
    if dataclasses.is_dataclass(value):
        return type(value), [bits(getattr(value, field.name)) for field in dataclasses.fields(value)]
    if isinstance(value, list | tuple):
        return type(value), [bits(one) for one in value]
    if isinstance(value, dict):
        return {key: bits(one) for key, one in value.items()}
    return type(value), value

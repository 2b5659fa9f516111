"""What every table of a file holds to, and the values that stand in many of them.

Knows pydantic, and no file and no table in particular.
"""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

Name = Annotated[str, Field(min_length=1)]
Finite = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]
Bitrate = Annotated[int, Field(ge=10_000, le=1_000_000)]  #: of a CAN bus [bit/s]


class Table(BaseModel):
    """One table of a file: unknown keys are errors, nothing is coerced, nothing changes after loading."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

"""What a scenario file may say of the radar, and the radar that it means."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

from vve_sumo.sensors.radar import RadarConfig, RadarMode


class RadarSettings(BaseModel):
    """The virtual radar, where it differs from the Delphi ESR defaults."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    ideal: bool = Field(
        default=False, description="no latency, noise, quanta or false alarms, every visible target detected"
    )
    range_limit_m: Annotated[float, Field(gt=0.0, allow_inf_nan=False)] | None = Field(
        default=None, description="blind beyond this range in every mode"
    )
    latency_s: Annotated[float, Field(ge=0.0, le=1.0)] = Field(
        default=0.09, description="from measuring to a scan's coming out; it is dated when it was measured"
    )
    noise_correlation: Annotated[float, Field(ge=0.0, lt=1.0)] = Field(
        default=0.0, description="of one actor's errors from scan to scan; 0 is white noise"
    )
    false_alarms: Annotated[float, Field(ge=0.0, le=10.0)] = Field(
        default=0.0, description="mean number a scan, anywhere in the field of view"
    )

    def config(self) -> RadarConfig:
        """Return the radar's configuration."""
        modes = RadarConfig().modes
        if self.range_limit_m is not None:
            limit = self.range_limit_m
            modes = tuple(RadarMode(min(mode.range_max, limit), mode.half_angle) for mode in modes)
        config = RadarConfig(
            modes=modes,
            latency=self.latency_s,
            noise_correlation=self.noise_correlation,
            false_alarms=self.false_alarms,
        )
        return config.ideal() if self.ideal else config

"""What a camera whose pictures are drawn is: its inner geometry, where it is mounted on the car, its rate.

Reads the file of a camera, and a drive's own cameras from its settings. Knows nothing of how pictures are drawn.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, ValidationError

from vve_sumo.config_file import Finite, Positive, Table, complaint, numbers_of, read
from vve_sumo.errors import ConfigError
from vve_sumo.sensors.camera_model import BrownConrady, CameraModel, KannalaBrandt, Lens
from vve_sumo.sensors.camera_settings import CameraSettings
from vve_sumo.sensors.port import PORT, configured
from vve_sumo.values import Floats

Side = Annotated[int, Field(ge=64, le=4096)]
Angle = Annotated[float, Field(ge=-180.0, le=180.0)]
Tilt = Annotated[float, Field(ge=-89.0, le=89.0)]
Coefficients = Annotated[list[Finite], Field(max_length=5)]


@dataclass(frozen=True, slots=True)
class CameraMount:
    """Where a camera is on the car, from the middle of the rear axle on the ground; the car stands level.

    The camera is turned about the vertical first, then about its own axis to the left, then about the way it looks.
    """

    x: float  #: forward [m]
    y: float  #: left [m]
    z: float  #: up [m]
    yaw: float = 0.0  #: of its axis, counter-clockwise from the car's forward axis [rad]
    pitch: float = 0.0  #: of its axis, downwards positive [rad]
    roll: float = 0.0  #: about its axis, the right side down positive [rad]

    def camera_points(self, points: Floats) -> Floats:
        """Return points (n, 3) of the car's frame (forward, left, up) in the camera's (right, down, along the axis)."""
        return (points - (self.x, self.y, self.z)) @ self.axes().T

    def axes(self) -> Floats:
        """Return the camera's axes right, down, along as rows, in the car's frame, (3, 3)."""
        (cy, sy), (cp, sp), (cr, sr) = ((math.cos(a), math.sin(a)) for a in (self.yaw, self.pitch, self.roll))
        along = np.array((cp * cy, cp * sy, -sp))
        level_right = np.array((sy, -cy, 0.0))
        level_down = np.cross(along, level_right)
        right, down = cr * level_right + sr * level_down, cr * level_down - sr * level_right
        return np.stack((right, down, along))


@dataclass(frozen=True, slots=True)
class DeclaredCamera:
    """A camera on the car."""

    name: str
    model: CameraModel
    mount: CameraMount
    rate: float  #: pictures a second [1/s]

    def to_dict(self) -> dict[str, Any]:
        """Return what `camera.json` says of it: lengths in metres and pixels, angles in degrees."""
        model, mount = self.model, self.mount
        kind = "brown_conrady" if isinstance(model.lens, BrownConrady) else "kannala_brandt"
        return {
            "name": self.name,
            "columns_px": model.columns,
            "rows_px": model.rows,
            "focal_x_px": model.focal_x,
            "focal_y_px": model.focal_y,
            "centre_x_px": model.centre_x,
            "centre_y_px": model.centre_y,
            "lens": kind,
            "distortion": list(model.lens),
            "rate_hz": self.rate,
            "x_m": mount.x,
            "y_m": mount.y,
            "z_m": mount.z,
            "yaw_deg": math.degrees(mount.yaw),
            "pitch_deg": math.degrees(mount.pitch),
            "roll_deg": math.degrees(mount.roll),
        }


class CameraFile(Table):
    """The file of a camera."""

    columns_px: Side = Field(default=1280, description="width of the picture")
    rows_px: Side = Field(default=720, description="height of the picture")
    focal_x_px: Positive = Field(description="focal length in widths of a pixel")
    focal_y_px: Positive | None = Field(default=None, description="in heights of a pixel; without it as `focal_x_px`")
    centre_x_px: Finite | None = Field(
        default=None, description="column of the principal point, 0 in the middle of the first; without it the middle"
    )
    centre_y_px: Finite | None = Field(
        default=None, description="row of the principal point, 0 in the middle of the first; without it the middle"
    )
    lens: Literal["brown_conrady", "kannala_brandt"] = Field(
        default="brown_conrady", description="what `distortion` means: as OpenCV's cameras, or as its fisheye cameras"
    )
    distortion: Coefficients = Field(
        default=[],
        description="k1, k2, p1, p2, k3 of `brown_conrady`; k1 to k4 of `kannala_brandt`; missing ones are 0",
    )
    rate_hz: Annotated[float, Field(gt=0.0, le=100.0)] = Field(default=15.0, description="pictures a second")
    x_m: Finite = Field(default=1.9, description="where it is mounted, forward from the rear axle")
    y_m: Finite = Field(default=0.0, description="where it is mounted, to the left")
    z_m: Annotated[float, Field(gt=0.2, le=10.0)] = Field(default=1.3, description="its height above the ground")
    yaw_deg: Angle = Field(default=0.0, description="of its axis, counter-clockwise from the car's forward axis")
    pitch_deg: Tilt = Field(default=0.0, description="of its axis, downwards positive")
    roll_deg: Angle = Field(default=0.0, description="about its axis, the right side down positive")

    def camera(self, name: str) -> DeclaredCamera:
        """Return the camera; raises ValueError for a lens that has no ray for a pixel."""
        middle = 0.5 * (self.columns_px - 1), 0.5 * (self.rows_px - 1)
        model = CameraModel(
            self.columns_px,
            self.rows_px,
            self.focal_x_px,
            self.focal_x_px if self.focal_y_px is None else self.focal_y_px,
            middle[0] if self.centre_x_px is None else self.centre_x_px,
            middle[1] if self.centre_y_px is None else self.centre_y_px,
            self._lens(),
        )
        model.slopes(_border(model))
        angles = (math.radians(angle) for angle in (self.yaw_deg, self.pitch_deg, self.roll_deg))
        return DeclaredCamera(name, model, CameraMount(self.x_m, self.y_m, self.z_m, *angles), self.rate_hz)

    def _lens(self) -> Lens:
        kind = BrownConrady if self.lens == "brown_conrady" else KannalaBrandt
        if len(self.distortion) > len(kind._fields):
            raise ValueError(
                f"distortion: expected at most {len(kind._fields)} numbers for {self.lens}, got {len(self.distortion)}"
            )
        return kind(*self.distortion)


def find_camera(name: str, resolved: Mapping[str, Any]) -> DeclaredCamera:
    """Return the camera that a name means: a TOML file of a camera, or a camera of the drive.

    `resolved` is the content of the drive's `scenario.json`. Raises ConfigError where there is no such camera.
    """
    if name.endswith(".toml"):
        return load_camera(Path(name))
    cameras = dict(_cameras(resolved))
    if name not in cameras:
        known = f"the drive has {', '.join(sorted(cameras))}" if cameras else "the drive has none"
        raise ConfigError(f"--camera {name}: expected a camera of the drive or a file CAMERA.toml; {known}")
    config = cameras[name].config()
    view = config.view
    model = CameraModel(
        view.columns, view.rows, view.focal, view.focal, 0.5 * (view.columns - 1), 0.5 * (view.rows - 1), BrownConrady()
    )
    return DeclaredCamera(name, model, CameraMount(config.x, config.y, config.z, config.yaw), config.rate)


def _cameras(resolved: Mapping[str, Any]) -> Iterator[tuple[str, CameraSettings]]:
    for one in resolved["settings"].get("sensors") or ():
        if one["kind"] in PORT.shipped:
            settings = configured(one["kind"], one.get("settings") or {})
            if isinstance(settings, CameraSettings):
                yield one["name"], settings


def load_camera(file: Path) -> DeclaredCamera:
    """Return the camera of a TOML file; raises ConfigError naming the file and what is wrong with it."""
    table = numbers_of(read(file, "camera"), file, CameraFile)
    try:
        return CameraFile.model_validate(table).camera(file.stem)
    except ValidationError as error:
        raise ConfigError(complaint(file, error, CameraFile)) from None
    except ValueError as error:
        raise ConfigError(f"{file}: {error}") from None


def _border(model: CameraModel) -> Floats:
    """Return the pixels along the border of the picture, (n, 2)."""
    column, row = np.arange(model.columns, dtype=np.float64), np.arange(model.rows, dtype=np.float64)
    last_column, last_row = column[-1], row[-1]
    return np.concatenate(
        (
            np.column_stack((column, np.zeros_like(column))),
            np.column_stack((column, np.full_like(column, last_row))),
            np.column_stack((np.zeros_like(row), row)),
            np.column_stack((np.full_like(row, last_column), row)),
        )
    )

"""How a sensor's rows are drawn: which columns of its table hold which quantity, and in which frame.

A sensor's class declares one drawing; pictures, page, report and exports show its table by that alone. Declarations and
plane geometry; knows no kind of sensor, no record and no picture.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal, NamedTuple

import numpy as np
from pydantic import Field, TypeAdapter, ValidationError

from vve_sumo.config_file import Finite, Positive, Table
from vve_sumo.errors import ConfigError
from vve_sumo.values import Floats, Vehicle

if TYPE_CHECKING:
    from vve_sumo.sensors.port import SensorColumn

#: kinds of columns that hold numbers, and those that hold names
_NUMBERS: Final = frozenset({"float", "int", "int8"})
_NAMES: Final = frozenset({"str"})


class Mounting(Table):
    """Where a frame is on the car, seen from the middle of the rear axle on the ground: the default is that place."""

    x_m: Finite = Field(default=0.0, description="forward")
    y_m: Finite = Field(default=0.0, description="left")
    z_m: Finite = Field(default=0.0, description="up")
    yaw_rad: Finite = Field(default=0.0, description="of its x axis, counter-clockwise from the car's forward axis")


def front_bumper(vehicle: Vehicle) -> Mounting:
    """Return the frame in the middle of the front bumper of a vehicle, its x axis forward."""
    return Mounting(x_m=vehicle.rear_axle_to_bumper)


class Polar(Table):
    """A place by range and azimuth in the drawing's frame."""

    range: str = Field(description="column of the range [m]")
    azimuth: str | None = Field(
        default=None, description="column of the azimuth [rad], left positive; none: straight along the x axis"
    )
    elevation: str | None = Field(default=None, description="column of the elevation [rad], up positive; none: level")


class Cartesian(Table):
    """A place by x and y in the drawing's frame."""

    x: str = Field(description="column of x [m]")
    y: str = Field(description="column of y [m]")


class ViewSector(Table):
    """A part of a field of view, symmetric about the x axis of its frame."""

    range_m: Positive = Field(description="farthest point that is seen")
    half_angle_rad: Annotated[float, Field(gt=0.0, lt=0.5 * math.pi)] = Field(description="x axis to edge")


class FieldOfView(Table):
    """What a sensor sees if nothing is in the way; only with it is an actor said to be hidden, or missed."""

    frame: Mounting = Mounting()
    sectors: list[ViewSector] = Field(min_length=1)


class _Drawn(Table):
    place: Polar | Cartesian
    frame: Mounting = Mounting()
    range_rate: str | None = Field(
        default=None, description="column of the radial speed, relative to the sensor [m/s], opening positive"
    )
    actor: str | None = Field(
        default=None, description="column of the name of the actor that was seen, empty for none: truth for the record"
    )
    view: FieldOfView | None = None


class Points(_Drawn):
    """Each row is a point."""

    shape: Literal["points"] = "points"


class Rays(_Drawn):
    """Each row is a line from the frame's origin to a point."""

    shape: Literal["rays"] = "rays"


class Boxes(_Drawn):
    """Each row is a box about its middle."""

    shape: Literal["boxes"] = "boxes"
    heading: str = Field(description="column of the heading [rad], counter-clockwise from the frame's x axis")
    length: str = Field(description="column of the length, along the heading [m]")
    width: str = Field(description="column of the width [m]")


Drawing = Points | Rays | Boxes
_ANY: Final[TypeAdapter[Drawing]] = TypeAdapter(Annotated[Drawing, Field(discriminator="shape")])


def to_dict(drawing: Drawing) -> dict[str, Any]:
    """Return a drawing as plain JSON, for a record's `scenario.json`."""
    return drawing.model_dump(mode="json", exclude_none=True)


def from_dict(declared: Mapping[str, Any]) -> Drawing:
    """Return the drawing that plain JSON declares; raises ConfigError for what is none."""
    try:
        return _ANY.validate_python(dict(declared))
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(map(str, first["loc"]))
        raise ConfigError(f"drawing: {where}: {first['msg']}") from None


def quantities(drawing: Drawing) -> dict[str, str]:
    """Return the column of each number that a drawing names, by the quantity."""
    named: dict[str, str | None] = {**dict(drawing.place), "range_rate": drawing.range_rate}
    if isinstance(drawing, Boxes):
        named |= {"heading": drawing.heading, "length": drawing.length, "width": drawing.width}
    return {quantity: column for quantity, column in named.items() if column is not None}


def wrong(drawing: object, columns: Sequence[SensorColumn]) -> str:
    """Return in one phrase what is wrong with a drawing of a table of these columns; empty where nothing is."""
    if not isinstance(drawing, Points | Rays | Boxes):
        return f"expected points, rays, boxes or None, got {drawing!r}"
    kinds = {name: kind for name, kind, _meaning in columns}
    needed = [(quantity, column, _NUMBERS) for quantity, column in quantities(drawing).items()]
    needed += [] if drawing.actor is None else [("actor", drawing.actor, _NAMES)]
    for quantity, column, fit in needed:
        if kinds.get(column) not in fit:
            got = f"of kind {kinds[column]}" if column in kinds else "not declared"
            return f"{quantity}: column {column!r} is {got}, expected one of kind {' or '.join(sorted(fit))}"
    return ""


class Placed(NamedTuple):
    """Rows of a sensor's table as shapes in the map; an entry a row."""

    x: Floats  #: of the point or of the box's middle [m]
    y: Floats  #: [m]
    origin_x: Floats  #: of the frame that the row was measured in [m]
    origin_y: Floats  #: [m]
    heading: Floats | None = None  #: of boxes, counter-clockwise from the map's +x [rad]
    length: Floats | None = None  #: of boxes [m]
    width: Floats | None = None  #: of boxes [m]

    def select(self, rows: slice) -> Placed:
        """Return some of the shapes."""
        return Placed(*(None if values is None else values[rows] for values in self))  # type: ignore[arg-type]

    def corners(self) -> Floats:
        """Return the corners of boxes in the map (n x 4 x 2) [m], counter-clockwise from the left one at the front.

        Raises ValueError for what are no boxes.
        """
        if self.heading is None or self.length is None or self.width is None:
            raise ValueError("points have no corners")
        cos, sin = np.cos(self.heading), np.sin(self.heading)
        ahead = np.multiply.outer(0.5 * self.length, (1.0, -1.0, -1.0, 1.0))
        left = np.multiply.outer(0.5 * self.width, (1.0, 1.0, -1.0, -1.0))
        x = self.x[:, None] + ahead * cos[:, None] - left * sin[:, None]
        y = self.y[:, None] + ahead * sin[:, None] + left * cos[:, None]
        return np.stack((x, y), axis=-1)


def placed(
    drawing: Drawing, table: Mapping[str, Floats], x: Floats | float, y: Floats | float, heading: Floats | float
) -> Placed:
    """Return the rows of a table in the map, from the pose of the rear axle [m], [rad] at the time of measurement.

    `table` holds the columns by their names; the pose is one for all rows or one a row.
    """
    ahead, left = in_frame(drawing, table)
    frame = drawing.frame
    cos, sin = np.cos(heading), np.sin(heading)
    origin_x, origin_y = x + frame.x_m * cos - frame.y_m * sin, y + frame.x_m * sin + frame.y_m * cos
    turned = heading + frame.yaw_rad
    cos, sin = np.cos(turned), np.sin(turned)
    each = np.zeros(len(ahead))
    points = origin_x + ahead * cos - left * sin, origin_y + ahead * sin + left * cos
    origin = origin_x + each, origin_y + each
    if not isinstance(drawing, Boxes):
        return Placed(*points, *origin)
    return Placed(*points, *origin, turned + table[drawing.heading], table[drawing.length], table[drawing.width])


def in_frame(drawing: Drawing, table: Mapping[str, Floats]) -> tuple[Floats, Floats]:
    """Return x and y [m] of the rows of a table in the drawing's own frame."""
    place = drawing.place
    if isinstance(place, Cartesian):
        return table[place.x], table[place.y]
    reach = table[place.range]
    if place.elevation is not None:
        reach = reach * np.cos(table[place.elevation])
    azimuth = np.zeros(len(reach)) if place.azimuth is None else table[place.azimuth]
    return reach * np.cos(azimuth), reach * np.sin(azimuth)


def heights(drawing: Drawing, table: Mapping[str, Floats]) -> Floats:
    """Return how far the rows of a table lie above the drawing's own frame [m]; 0 where it does not say."""
    place = drawing.place
    if isinstance(place, Cartesian) or place.elevation is None:
        return np.zeros(len(next(iter(table.values()))))
    return table[place.range] * np.sin(table[place.elevation])


def ranges(drawing: Drawing, table: Mapping[str, Floats]) -> Floats:
    """Return the range of the rows of a table from the origin of the drawing's frame [m]."""
    if isinstance(drawing.place, Polar):
        return table[drawing.place.range]
    return np.hypot(*in_frame(drawing, table))

"""What is declared of a person: body, limits, how their field lies on the virtual road, and where the car may be.

Declarations alone; files are read elsewhere.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Final

from vve_sumo.errors import ConfigError
from vve_sumo.frames import Alignment, MapFrame, local_frame

Pair = tuple[float, float]

#: Greatest speed at which a person comes nearer between two reports [m/s], by kind. Euro NCAP's running adult has
#: 8 km/h (2.2 m/s) and its bicyclist up to 25 km/h (6.9 m/s); both are taken a sixth to a third higher.
MAX_SPEED: Final = {"pedestrian": 3.0, "bicycle": 8.0}


@dataclass(frozen=True, slots=True)
class PresenceLimits:
    """Up to which age and uncertainty a person is on the virtual road, and how."""

    exact: float  #: radius of uncertainty up to which the body alone is there [m]
    warning: float  #: radius beyond which the person is warned [m]
    lost: float  #: radius beyond which the person counts as lost [m]
    warning_age: float  #: age of the newest trusted position beyond which the person is warned [s]
    lost_age: float  #: age beyond which the person counts as lost [s]


@dataclass(frozen=True, slots=True)
class PersonSetup:
    """A person, with everything that the drive must know of them."""

    id: str
    kind: str  #: `pedestrian` or `bicycle`
    length: float  #: of the body, along the way it faces [m]
    width: float  #: of the body [m]
    latitude: float  #: of the field's anchor, the origin of the field's map, WGS84 [rad]
    longitude: float  #: of the field's anchor, WGS84 [rad]
    heading: float  #: of the field's anchor, in the field's map [rad], counter-clockwise from +x
    road_heading: float  #: of the ego's path where the anchor lies [rad], counter-clockwise from the road map's +x
    alignment: Alignment  #: lays the field's map (+x is east at the anchor) onto the virtual road's
    limits: PresenceLimits
    pages: bool  #: whether the person must acknowledge the start on a page, which must stay open
    fence: tuple[Pair, ...] = ()  #: outline of the ground that the car may cover, field's map [m]; empty for none
    least_distance: float = 0.0  #: from the person to that ground [m]

    @property
    def max_speed(self) -> float:
        """Greatest speed of the person [m/s]."""
        return MAX_SPEED[self.kind]

    def frame(self) -> MapFrame:
        """Return the field's map."""
        return local_frame(self.latitude, self.longitude)

    def to_dict(self) -> dict[str, Any]:
        """Return plain JSON, for the record."""
        return asdict(self)

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> PersonSetup:
        """Return what `to_dict` wrote; raises ConfigError for anything else."""
        try:
            alignment = Alignment(*(content["alignment"][key] for key in ("rotation", "x", "y")))
            limits = PresenceLimits(**content["limits"])
            fence = tuple((x, y) for x, y in content["fence"])
            return cls(**{**content, "alignment": alignment, "limits": limits, "fence": fence})
        except (KeyError, TypeError, ValueError) as error:
            raise ConfigError(f"scenario.json: people: none of this version: {error!r}") from None

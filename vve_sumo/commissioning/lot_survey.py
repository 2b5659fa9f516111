"""Makes the table `[lot]` of a rig from a recording that was walked or driven along the lot's edge.

Reads a recording and writes a rig file; geometry is `lot.survey`.
"""

from __future__ import annotations

import datetime
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from vve_sumo import workspace
from vve_sumo.commissioning.align import refuse_shipped
from vve_sumo.errors import ConfigError
from vve_sumo.frames import local_frame
from vve_sumo.lot.survey import SurveyedOutline, survey
from vve_sumo.pose import recording
from vve_sumo.rig import edit
from vve_sumo.rig import load as rigs

GNSS_EPOCH: Final = datetime.datetime(1980, 1, 6, tzinfo=datetime.UTC)
LEAP_SECONDS: Final = 18.0  #: of GNSS time over UTC, since 2017
#: GNSS seconds after 2010: a smaller time of a recording is not counted from the epoch of GNSS [s]
MIN_GNSS_TIME: Final = 9.5e8
DECIMALS: Final = 8  #: of degrees: 1 mm


@dataclass(frozen=True, slots=True)
class LotSurvey:
    """A surveyed outline on Earth."""

    outline: SurveyedOutline
    corners: tuple[tuple[float, float], ...]  #: latitude, longitude [deg], WGS84
    day: datetime.date | None  #: of the recording; None where it has no GNSS time

    def lines(self) -> tuple[str, ...]:
        """Return what was found, for people to read."""
        found = self.outline
        return (
            f"{len(self.corners)} corners around {found.area:.0f} m2, from {found.places} places; the end came within "
            f"{found.overlap:.2f} m of the begin",
            f"places lie {found.rms:.3f} m (rms) and at most {found.worst:.3f} m off the outline, which lies at most "
            f"{found.beyond:.3f} m outside of them; each place is known to {found.radius:.3f} m (95 %)",
            f"margin_m: {found.margin:g} m or more",
        )

    def toml(self, today: datetime.date) -> str:
        """Return the keys of `[lot]` that a survey gives, as TOML; `today` where the recording has no day."""
        rows = [f"  [{latitude:.{DECIMALS}f}, {longitude:.{DECIMALS}f}]," for latitude, longitude in self.corners]
        head = ["[lot]", f"surveyed = {self.day or today}", f"margin_m = {self.outline.margin:g}", "outline = ["]
        return "\n".join([*head, *rows, "]", ""])


def survey_recording(file: Path, accuracy: float | None) -> LotSurvey:
    """Return the outline that a recording was taken along.

    `accuracy` is the standard deviation of its positions [m], for a recording that does not hold it. Raises ConfigError
    naming the file, as `recording.fixes` and `survey`.
    """
    fixes = list(recording.fixes(file))
    sigma = np.array([fix.position_sigma for fix in fixes], dtype=np.float64)
    if accuracy is not None:
        sigma = np.where(np.isfinite(sigma), sigma, accuracy)
    if not np.isfinite(sigma).all():
        raise ConfigError(f"{file}: does not say how accurate its positions are; give --accuracy, 1 sigma in metres")
    frame = local_frame(fixes[0].latitude, fixes[0].longitude)
    places = np.array([frame.to_map(fix.latitude, fix.longitude) for fix in fixes], dtype=np.float64)
    try:
        outline = survey(places[:, 0], places[:, 1], sigma)
    except ConfigError as error:
        raise ConfigError(f"{file}: {error}") from None
    corners = [frame.to_geodetic(x, y) for x, y in outline.corners.tolist()]
    degrees = tuple(
        (round(math.degrees(latitude), DECIMALS), round(math.degrees(longitude), DECIMALS))
        for latitude, longitude in corners
    )
    return LotSurvey(outline, degrees, _day_of(fixes[0].time))


def _day_of(time: float) -> datetime.date | None:
    """Return the UTC day of a GNSS time [s]; None where the time is no GNSS time."""
    if not time >= MIN_GNSS_TIME:
        return None
    return (GNSS_EPOCH + datetime.timedelta(seconds=time - LEAP_SECONDS)).date()


def store(found: LotSurvey, rig: str, working: Path, today: datetime.date) -> Path:
    """Write outline, day and margin into a rig's file, and return that; a larger margin of the rig stays.

    Raises ConfigError where the rig would not load with it, such as with holes outside the new outline.
    """
    file = workspace.find("rig", rig, working)
    refuse_shipped(file)
    margin = max(found.outline.margin, rigs.load(file, working).lot.margin_m)
    values: dict[tuple[str, str], Any] = {
        ("lot", "surveyed"): found.day or today,
        ("lot", "outline"): [list(corner) for corner in found.corners],
        ("lot", "margin_m"): margin,
    }
    edit.put(file, values)
    return file

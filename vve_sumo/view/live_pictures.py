"""Draws what a camera on the car sees while a drive is live, as fast as this computer can, and never an old frame.

Each picture is of one tick: the newest that was known when drawing began. Knows the page that is read and the stream
that pictures go to; nothing of the drive.
"""

from __future__ import annotations

import time
from typing import Final, NamedTuple

from vve_sumo.view.camera_pictures import CameraPictures, SceneAppearance
from vve_sumo.view.declared_camera import DeclaredCamera
from vve_sumo.view.live_page import LivePage
from vve_sumo.view.picture_stream import PictureStream

#: of the JPEG pictures
QUALITY: Final = 0.9


class Drawn(NamedTuple):
    """What was drawn of a drive."""

    pictures: int
    seconds: float  #: from the first picture's beginning to the last one's end [s]

    @property
    def rate(self) -> float:
        """Pictures a second [1/s]."""
        return self.pictures / self.seconds if self.seconds > 0.0 else 0.0


def opened(page: LivePage, camera: DeclaredCamera, appearance: SceneAppearance) -> CameraPictures:
    """Return the pictures of a live drive's street; raises BrowserError and ValueError as `CameraPictures` does.

    Nobody knows yet where somebody will stand or walk, so no car is parked for decoration.
    """
    return CameraPictures.of_scene(page.scene | {"nothing_parked": True}, camera, appearance)


def draw(page: LivePage, pictures: CameraPictures, stream: PictureStream, rate: float) -> Drawn:
    """Draw the newest frame at most `rate` times a second [1/s] until the drive is over; return what was drawn."""
    number, count, begun, due = -1, 0, time.monotonic(), time.monotonic()
    while (newest := page.newer(number)) is not None:
        if newest.actors:
            pictures.meet(newest.actors)
        at = float(newest.frame["t"])
        stream.publish(pictures.drawn(newest.frame, at, "image/jpeg", QUALITY), at)
        number, count = newest.number, count + 1
        due = max(due + 1.0 / rate, time.monotonic())
        time.sleep(max(due - time.monotonic(), 0.0))
    return Drawn(count, time.monotonic() - begun)

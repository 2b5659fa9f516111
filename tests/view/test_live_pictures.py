"""Pictures of a camera while a drive is live: a hub that is fed, a real browser that draws, viewers over HTTP."""

from __future__ import annotations

import http.client
import io
import re
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tests.live.patience import until
from tests.view.feed import live
from tests.view.made import Made
from tests.view.spaces import frame, standing, straight
from vve_sumo.cli import main
from vve_sumo.errors import ConfigError
from vve_sumo.view import live_pictures
from vve_sumo.view.browser import BrowserError, find_browser
from vve_sumo.view.camera_pictures import CameraPictures, SceneAppearance
from vve_sumo.view.declared_camera import CameraFile, DeclaredCamera
from vve_sumo.view.live_page import LivePage
from vve_sumo.view.picture_stream import MAX_VIEWERS, PictureStream

TOKEN = "a-token-of-the-page"
PART = re.compile(rb"--picture\r\nContent-Type: image/jpeg\r\nContent-Length: (\d+)\r\nX-Drive-Time: ([\d.]+)\r\n\r\n")


def camera() -> DeclaredCamera:
    return CameraFile(columns_px=320, rows_px=200, focal_x_px=300.0).camera("front")


def needs_a_browser() -> None:
    try:
        find_browser()
    except BrowserError as missing:
        pytest.skip(str(missing))


class Viewer:
    """Somebody who asks for the pictures."""

    def __init__(self, stream: PictureStream, path: str = f"/{TOKEN}/", host: str | None = None) -> None:
        address = stream.url.split("/")[2]
        self._connection = http.client.HTTPConnection(address, timeout=20.0)
        self._connection.request("GET", path, headers={} if host is None else {"Host": host})
        self._answer = self._connection.getresponse()
        self.status = self._answer.status

    def next(self) -> tuple[float, bytes] | None:
        """Drive time and content of the next picture; None after the last."""
        head = b""
        while not head.endswith(b"\r\n\r\n"):
            byte = self._answer.read(1)
            if not byte or head == b"--picture--\r\n":
                return None
            head += byte
        found = PART.fullmatch(head)
        assert found, head
        content = self._answer.read(int(found[1]))
        assert self._answer.read(2) == b"\r\n"
        return float(found[2]), content

    def close(self) -> None:
        self._connection.close()


@contextmanager
def streaming() -> Iterator[PictureStream]:
    with PictureStream(0, TOKEN) as stream:
        yield stream


def test_who_lacks_the_token_or_asks_by_another_name_gets_no_picture() -> None:
    with streaming() as stream:
        stream.publish(b"picture", 1.0)
        for path, host in (("/", None), ("/wrong/", None), (f"/{TOKEN}", None), (f"/{TOKEN}/", "elsewhere.example")):
            assert Viewer(stream, path, host).status == 403
        assert Viewer(stream).status == 200


def test_the_pictures_are_on_this_computer_alone() -> None:
    with streaming() as stream:
        assert stream.url.startswith("http://127.0.0.1:")
        with pytest.raises(ConfigError, match=r"--mjpeg \d+: cannot listen"):
            PictureStream(int(stream.url.split(":")[2].split("/")[0]), TOKEN)


def test_every_viewer_gets_the_newest_picture_and_a_slow_one_holds_up_nobody() -> None:
    large = bytes(3_000_000)
    with streaming() as stream:
        slow, quick = Viewer(stream), Viewer(stream)
        seen = []
        for number in range(1, 31):
            stream.publish(large, float(number))
            found = quick.next()
            assert found is not None
            seen.append(found[0])
        assert seen == [float(number) for number in range(1, 31)]
        late = [slow.next() for _ in range(2)]
        assert late[0] is not None
        last = late[1]
        while last is not None and last[0] < 30.0:
            last = slow.next()
            late.append(last)
        # What was in the buffers when the first pictures came, and the newest.
        assert last is not None
        assert last[0] == 30.0
        assert len(late) < 15


def test_no_more_viewers_than_there_is_room_for() -> None:
    with streaming() as stream:
        stream.publish(b"picture", 1.0)
        viewers = [Viewer(stream) for _ in range(MAX_VIEWERS)]
        assert [viewer.next() for viewer in viewers] == [(1.0, b"picture")] * MAX_VIEWERS
        assert Viewer(stream).status == 503
        viewers[0].close()

        def again() -> bool:
            stream.publish(b"picture", 2.0)
            return Viewer(stream).status == 200

        until(again)


def test_the_page_of_no_drive_is_refused_in_a_line() -> None:
    with pytest.raises(ConfigError, match="the page of the live drive does not answer"):
        LivePage("http://127.0.0.1:9/token/")


def test_a_reader_gets_the_newest_frame_and_hears_of_the_end(made: Made) -> None:
    with live(Path(made.drive)) as one:
        with LivePage(one.address) as page:
            assert page.scene["source"] == "live"
            first = page.newer(-1)
            assert first is not None
            time.sleep(1.0)
            second = page.newer(first.number)
            assert second is not None
            # A frame every 20 ms: after a second the one that is taken is no older than some of them.
            assert second.number - first.number > 30
            assert one.hub.clients == 1
        until(lambda: one.hub.clients == 0)
        assert one.hub.dropped == 0


def test_a_reader_of_a_drive_that_ends_is_told(made: Made) -> None:
    with live(Path(made.drive)) as one, LivePage(one.address) as page:
        assert page.newer(-1) is not None
        one.end()
        number = 0
        while (newest := page.newer(number)) is not None:
            number = newest.number


def test_an_actor_who_comes_later_has_the_body_that_is_said_then() -> None:
    needs_a_browser()
    person = {"kind": "pedestrian", "length": 0.6, "width": 0.5, "height": 1.75}
    there = frame(actors=standing(("late", 12.0, 0.0, 0.0)))
    with CameraPictures.of_scene(straight(), camera(), SceneAppearance(dressed=False)) as pictures:
        pictures.drawn(there)
        assert [body.kind for body in pictures.truth().bodies] == ["passenger"]
        pictures.meet({"late": person})
        pictures.drawn(there)
        assert [(body.name, body.kind) for body in pictures.truth().bodies] == [("late", "pedestrian")]


@pytest.mark.thorough
def test_nothing_is_parked_where_nobody_knows_who_will_stand() -> None:
    needs_a_browser()
    looks = {}
    for bare in (False, True):
        scene = straight(400.0) | ({"nothing_parked": True} if bare else {})
        with CameraPictures.of_scene(scene, camera(), SceneAppearance()) as pictures:
            pictures.drawn(frame())
            looks[bare] = sum(body.decoration for body in pictures.truth().bodies)
    assert looks[False] > 0
    assert looks[True] == 0


@pytest.mark.thorough
def test_the_camera_of_a_live_drive_is_served_until_the_drive_is_over(made: Made) -> None:
    """Each picture is of a tick that was new when drawing began, and shows the street."""
    needs_a_browser()
    with (
        live(Path(made.drive)) as one,
        LivePage(one.address) as page,
        streaming() as stream,
        live_pictures.opened(page, camera(), SceneAppearance()) as pictures,
    ):
        drawn: list[live_pictures.Drawn] = []
        drawing = threading.Thread(
            target=lambda: drawn.append(live_pictures.draw(page, pictures, stream, 10.0)), daemon=True
        )
        drawing.start()
        viewer = Viewer(stream)
        ages, colours = [], 0
        for _ in range(4):
            found = viewer.next()
            assert found is not None
            newest = one.frames.newest
            assert newest is not None
            ages.append(newest.time - found[0])
            picture = Image.open(io.BytesIO(found[1]))
            assert picture.size == (320, 200)
            colours = len(np.unique(np.asarray(picture).reshape(-1, 3), axis=0))
        assert colours > 1000
        # As old as drawing takes, however long that is: none waits in between.
        assert max(ages) < 10.0
        one.end()
        drawing.join(30.0)
        assert drawn[0].pictures >= 4
        assert pictures.complaints == []
    # The stream ends with the command, and every viewer is told.
    while viewer.next() is not None:
        pass


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--live", "--png"), "--live: goes with --mjpeg and --camera"),
        (("--live", "--mjpeg", "0"), "--live: goes with --mjpeg and --camera"),
        (("--live", "--mjpeg", "0", "--camera", "front", "--from", "3"), "--from: does not go with --live"),
        (("--live", "--mjpeg", "0", "--camera", "front"), "no live drive with a page is running there"),
    ],
)
def test_what_does_not_go_together_is_refused_in_a_line(
    made: Made, options: tuple[str, ...], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["render", str(made.drive), *options]) == 2
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1

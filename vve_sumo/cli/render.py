"""`vve-sumo render`: renders pictures and videos of a drive, without a screen."""

from __future__ import annotations

import argparse
import contextlib
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final
from urllib.parse import urlsplit

from vve_sumo import progress_bar
from vve_sumo.cli.parser import Parser
from vve_sumo.errors import ConfigError

if TYPE_CHECKING:
    from vve_sumo.analysis.run import Run
    from vve_sumo.view.camera_pictures import CameraPictures, SceneAppearance
    from vve_sumo.view.declared_camera import DeclaredCamera
    from vve_sumo.view.pictures import Pictures

EXIT_CODES = """exit codes:
  0  the picture was written, also of a drive that failed
  2  wrong use, no record, a file that exists already, or no browser or ffmpeg; nothing was written
"""

SUMMARY = "render pictures and videos of a drive, without a screen"
TEXT = """\
Draw a drive's record as the page of `vve-sumo view` does: from the driver's seat, from behind the car, from
above, or the page's street with what the sensors measured. A headless Chromium draws; no screen and no graphics card is
needed. Pictures depend on drive time alone: the same record gives the same pictures.

With --camera they are those of a camera on the car, with its lens, without a caption, and --frames writes the truth
beside each: boxes, what every pixel shows and whose it is, depths. With --live they are those of a drive that goes on
and has a page (vve-sumo drive --view), over HTTP, as many a second as this computer can draw beside the drive.

examples:
  vve-sumo render runs/mine --mp4                            mine.mp4 here, the whole drive
  vve-sumo render runs/mine --png --at 12.3 --view chase     one picture
  vve-sumo render runs/mine --gif --from 50 --to 60 --size 640x360
  vve-sumo render runs/mine --frames --camera front          folder mine_front, as often as that camera takes one
  vve-sumo render runs/mine --mp4 --camera mine.toml --light night --rain
  vve-sumo render runs/mine --mjpeg 8090 --camera front --live     while the drive with --view goes on
"""

VIEWS: Final = ("driver", "chase", "above", "street")
TIMES_OF_DAY: Final = ("day", "dusk", "night")
FRAMES, MJPEG = "frames", "mjpeg"
#: format, default size [px], default pictures a second
FORMATS: Final = {
    "mp4": ("1280x720", 25.0),
    "gif": ("640x360", 10.0),
    "webp": ("640x360", 10.0),
    "png": ("1280x720", 1.0),
}
#: of a side [px]; not every browser draws more than the largest
MIN_SIDE, MAX_SIDE = 64, 4096
MAX_RATE: Final = 100.0
#: of the pictures of a GIF or WebP, which are all in memory at once [bytes]
MAX_PICTURE_BYTES: Final = 1_000_000_000
#: of the JPEG pictures of a film; a GIF is made of PNG
QUALITY: Final = 0.95


@dataclass(frozen=True, slots=True)
class PictureSize:
    """Of a picture [px]."""

    width: int
    height: int


@dataclass(frozen=True, slots=True)
class RenderPlan:
    """What is drawn, and into which file."""

    form: str  #: one of FORMATS
    size: PictureSize
    rate: float  #: pictures a second of the film [1/s]
    times: list[float]  #: drive times of the pictures [s]
    file: Path


def _size(text: str) -> PictureSize:
    width, _, height = text.partition("x")
    if not (width.isdecimal() and height.isdecimal()):
        raise argparse.ArgumentTypeError(f"expected WIDTHxHEIGHT such as 1280x720, got {text!r}")
    size = PictureSize(int(width), int(height))
    if not all(MIN_SIDE <= side <= MAX_SIDE for side in (size.width, size.height)):
        raise argparse.ArgumentTypeError(f"expected sides of {MIN_SIDE} to {MAX_SIDE} pixels, got {text}")
    return size


def _seconds(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"expected seconds such as 12.3, got {text!r}")
    return value


def _rate(text: str) -> float:
    value = _seconds(text)
    if not 0.0 < value <= MAX_RATE:
        raise argparse.ArgumentTypeError(f"expected more than 0 and at most {MAX_RATE:g} pictures a second, got {text}")
    return value


def arguments(parser: Parser) -> None:
    """Add the command's arguments."""
    parser.add_argument("folder", type=Path, metavar="DIR", help="folder of the record")
    form = parser.add_mutually_exclusive_group(required=True)
    form.add_argument(
        "--mp4",
        dest="form",
        action="store_const",
        const="mp4",
        help="a film; needs ffmpeg (pip install 'vve-sumo[video]')",
    )
    form.add_argument(
        "--gif", dest="form", action="store_const", const="gif", help="an animation that every program shows"
    )
    form.add_argument(
        "--webp", dest="form", action="store_const", const="webp", help="an animation, smaller and with full colour"
    )
    form.add_argument("--png", dest="form", action="store_const", const="png", help="one picture, with --at")
    form.add_argument(
        "--frames",
        dest="form",
        action="store_const",
        const=FRAMES,
        help="a folder: the pictures of --camera, each with its truth",
    )
    form.add_argument(
        "--mjpeg",
        type=_port,
        metavar="PORT",
        help="the pictures of --camera over HTTP on this computer, in real time; 0: any port",
    )
    parser.add_argument("--at", type=_seconds, metavar="S", help="drive time of the picture, of --png")
    parser.add_argument(
        "--from", dest="begin", type=_seconds, metavar="S", help="drive time to begin at (default: the first tick)"
    )
    parser.add_argument(
        "--to", dest="end", type=_seconds, metavar="S", help="drive time to end at (default: the last tick)"
    )
    parser.add_argument(
        "--view",
        choices=VIEWS,
        help="driver's seat, chase, above, or the page's street (default: driver)",
    )
    _camera_arguments(parser)
    parser.add_argument(
        "--size", type=_size, metavar="WxH", help="in pixels (default: 1280x720, of --gif and --webp 640x360)"
    )
    parser.add_argument(
        "--fps", type=_rate, metavar="N", help="pictures a second (default: 25, of --gif and --webp 10)"
    )
    parser.add_argument(
        "--out", type=Path, metavar="FILE", help="file to write (default: here, named after DIR); no file is replaced"
    )


def _camera_arguments(parser: Parser) -> None:
    parser.add_argument(
        "--camera", metavar="NAME", help="a camera of the drive by its name, or the file CAMERA.toml of one"
    )
    parser.add_argument("--light", choices=TIMES_OF_DAY, help="of the pictures of --camera (default: day)")
    parser.add_argument("--rain", action="store_true", help="in the pictures of --camera")
    parser.add_argument(
        "--bare", action="store_true", help="without the houses and parked cars that are made up for --camera"
    )
    parser.add_argument(
        "--live", action="store_true", help="of --mjpeg: the drive goes on, with --view; its page's token is asked for"
    )


def _port(text: str) -> int:
    if not (text.isdecimal() and int(text) < 65536):
        raise argparse.ArgumentTypeError(f"expected a port from 0 to 65535, got {text!r}")
    return int(text)


def run(arguments: argparse.Namespace) -> int:
    """Write the picture or film of a record and print its path; return the exit code, 0."""
    from vve_sumo.analysis.load import load
    from vve_sumo.analysis.run import Run

    if arguments.live:
        return _run_live(arguments)
    drive = load(arguments.folder)
    if not isinstance(drive, Run):
        raise ConfigError(f"{arguments.folder}: is a sweep's folder, expected the record of one drive")
    if arguments.camera is not None:
        return _run_camera(arguments, drive)
    _refuse_camera_options(arguments)
    from vve_sumo.view.pictures import Pictures

    plan = _plan(arguments, drive)
    with Pictures(drive, arguments.view or VIEWS[0], plan.size.width, plan.size.height) as pictures:
        _write(plan, pictures)
    print(f"{plan.form}: {plan.file}")
    return 0


def _refuse_camera_options(arguments: argparse.Namespace) -> None:
    given = {
        "--frames": arguments.form == FRAMES,
        "--mjpeg": arguments.mjpeg is not None,
        "--light": arguments.light is not None,
        "--rain": arguments.rain,
        "--bare": arguments.bare,
    }
    for option in (name for name, is_given in given.items() if is_given):
        raise ConfigError(f"{option}: goes with --camera, a camera of the drive or the file CAMERA.toml of one")


def _run_camera(arguments: argparse.Namespace, drive: Run) -> int:
    """Write or serve the pictures of a camera; return the exit code, 0."""
    from vve_sumo.view.camera_pictures import CameraPictures, SceneAppearance
    from vve_sumo.view.declared_camera import find_camera

    for option, value in (("--view", arguments.view), ("--size", arguments.size)):
        if value is not None:
            raise ConfigError(f"{option}: does not go with --camera, which says both")
    camera = find_camera(arguments.camera, drive.resolved)
    appearance = SceneAppearance(arguments.light or TIMES_OF_DAY[0], arguments.rain, not arguments.bare)
    plan = _plan(arguments, drive, camera)
    try:
        pictures = CameraPictures(drive, camera, appearance)
    except ValueError as error:
        raise ConfigError(f"--camera {arguments.camera}: {error}") from None
    with pictures:
        if plan.form == MJPEG:
            _serve(arguments.mjpeg, plan, pictures)
            return 0
        if plan.form == FRAMES:
            _write_frames(plan, pictures, camera, appearance)
        else:
            _write(plan, pictures)
    print(f"{plan.form}: {plan.file}")
    return 0


def _write_frames(
    plan: RenderPlan, pictures: CameraPictures, camera: DeclaredCamera, appearance: SceneAppearance
) -> None:
    from vve_sumo.view.truth_files import TruthFolder

    folder = TruthFolder(plan.file, camera, appearance)
    with progress_bar.of_pictures(len(plan.times)) as show:
        for done, time in enumerate(plan.times, 1):
            folder.add(time, pictures.at(time), pictures.truth())
            show(done)


def _serve(port: int, plan: RenderPlan, pictures: CameraPictures) -> None:
    """Serve the pictures to one client after the other, until the user ends it."""
    from vve_sumo.view.mjpeg import MjpegServer

    def draw(time: float) -> bytes:
        return pictures.at(time, "image/jpeg", QUALITY)

    server = MjpegServer(port, draw, plan.times[0], plan.times[-1], plan.rate)
    print(f"{MJPEG}: {server.url} (end with Ctrl-C)", flush=True)
    try:
        while True:
            server.serve_one()
    except KeyboardInterrupt:
        pass
    finally:
        server.close()


def _run_live(arguments: argparse.Namespace) -> int:
    """Serve the pictures of a camera of a drive that goes on, until it is over; return the exit code, 0."""
    from vve_sumo.cli.view import live_address
    from vve_sumo.live.priority import OOM_PICTURES, PICTURES_NICE, keep_low, set_oom_score
    from vve_sumo.record.declared import read_resolved
    from vve_sumo.view import live_pictures
    from vve_sumo.view.camera_pictures import SceneAppearance
    from vve_sumo.view.declared_camera import find_camera
    from vve_sumo.view.live_page import LivePage
    from vve_sumo.view.picture_stream import PictureStream

    _refuse_live_options(arguments)
    address = live_address(arguments.folder, Path.cwd())
    camera = find_camera(arguments.camera, read_resolved(arguments.folder, "settings"))
    appearance = SceneAppearance(arguments.light or TIMES_OF_DAY[0], arguments.rain, not arguments.bare)
    # The browser that draws takes over both: it gets what the drive leaves of processor and memory.
    keep_low(PICTURES_NICE)
    set_oom_score(OOM_PICTURES)
    with LivePage(address) as page, PictureStream(arguments.mjpeg, _token_in(address)) as stream:
        try:
            pictures = live_pictures.opened(page, camera, appearance)
        except ValueError as error:
            raise ConfigError(f"--camera {arguments.camera}: {error}") from None
        with pictures, contextlib.suppress(KeyboardInterrupt):
            print(f"{MJPEG}: {stream.url} (end with Ctrl-C)", flush=True)
            drawn = live_pictures.draw(page, pictures, stream, arguments.fps or camera.rate)
            print(f"{MJPEG}: the drive is over; {drawn.pictures} pictures, {drawn.rate:.1f} a second")
    return 0


def _refuse_live_options(arguments: argparse.Namespace) -> None:
    """Raise ConfigError for what does not go with --live."""
    if arguments.mjpeg is None or arguments.camera is None:
        raise ConfigError("--live: goes with --mjpeg and --camera; every other format is drawn from a finished record")
    given = {
        "--at": arguments.at,
        "--from": arguments.begin,
        "--to": arguments.end,
        "--view": arguments.view,
        "--size": arguments.size,
        "--out": arguments.out,
    }
    for option in (name for name, value in given.items() if value is not None):
        raise ConfigError(f"{option}: does not go with --live, which shows what is now")


def _token_in(address: str) -> str:
    """Return the token in the address of a page."""
    return urlsplit(address).path.strip("/")


def _plan(arguments: argparse.Namespace, drive: Run, camera: DeclaredCamera | None = None) -> RenderPlan:
    """Return the plan of a command line; raises ConfigError before anything is drawn."""
    form = MJPEG if arguments.mjpeg is not None else arguments.form
    if camera is None:
        default_size, default_rate = FORMATS[form]
        size, rate = arguments.size or _size(default_size), arguments.fps or default_rate
    else:
        size, rate = PictureSize(camera.model.columns, camera.model.rows), arguments.fps or camera.rate
    if form == "mp4":
        from vve_sumo.view.movie import find_ffmpeg

        find_ffmpeg()
        if size.width % 2 or size.height % 2:
            raise ConfigError(f"--size {size.width}x{size.height}: expected even sides for an MP4")
    if form == "gif":
        from vve_sumo.view.movie import MAX_GIF_RATE

        if rate > MAX_GIF_RATE:
            raise ConfigError(f"--fps {rate:g}: expected at most {MAX_GIF_RATE:g} pictures a second for a GIF")
    first, last = float(drive.time[0]), float(drive.time[-1])
    times = _picture_time(arguments, first, last) if form == "png" else _frame_times(arguments, first, last, size, rate)
    name = arguments.folder.resolve().name
    if form == FRAMES:
        assert camera is not None
        return RenderPlan(form, size, rate, times, _output_folder(arguments.out, f"{name}_{camera.name}"))
    out = Path() if form == MJPEG else _output_file(arguments.out, arguments.folder, form)
    return RenderPlan(form, size, rate, times, out)


def _picture_time(arguments: argparse.Namespace, first: float, last: float) -> list[float]:
    if arguments.at is None:
        raise ConfigError(f"--png: expected --at, a drive time from {first:g} to {last:g} s")
    return [_within("--at", arguments.at, first, last)]


def _frame_times(
    arguments: argparse.Namespace, first: float, last: float, size: PictureSize, rate: float
) -> list[float]:
    form = arguments.form
    if arguments.at is not None:
        raise ConfigError("--at: goes with --png, expected --from and --to for a film or an animation")
    begin = first if arguments.begin is None else _within("--from", arguments.begin, first, last)
    end = last if arguments.end is None else _within("--to", arguments.end, begin, last)
    count = math.floor((end - begin) * rate + 1e-6) + 1
    if form in ("gif", "webp") and 3 * count * size.width * size.height > MAX_PICTURE_BYTES:
        raise ConfigError(
            f"--{form}: {count} pictures of {size.width}x{size.height} are too many to keep in memory; "
            "ask for a shorter span, fewer a second or a smaller --size, or for --mp4"
        )
    return [begin + k / rate for k in range(count)]


def _within(option: str, time: float, first: float, last: float) -> float:
    if not first <= time <= last:
        raise ConfigError(f"{option} {time:g}: expected a drive time from {first:g} to {last:g} s")
    return time


def _output_file(out: Path | None, folder: Path, form: str) -> Path:
    file = Path(f"{folder.resolve().name}.{form}") if out is None else out
    if file.is_dir():
        file = file / f"{folder.resolve().name}.{form}"
    if file.exists():
        raise ConfigError(f"{file}: exists already, expected a new file; choose another with --out")
    if not file.parent.is_dir():
        raise ConfigError(f"{file.parent}: no such folder for {file.name}")
    return file


def _output_folder(out: Path | None, name: str) -> Path:
    folder = Path(name) if out is None else out
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise ConfigError(f"{folder}: exists already, expected a new or empty folder; choose another with --out")
    return folder


def _write(plan: RenderPlan, pictures: Pictures | CameraPictures) -> None:
    if plan.form == "png":
        plan.file.write_bytes(pictures.at(plan.times[0]))
        return
    from vve_sumo.view import movie

    writers = {"mp4": movie.write_mp4, "gif": movie.write_gif, "webp": movie.write_webp}
    drawn = _drawn(pictures, plan.times, "image/png" if plan.form == "gif" else "image/jpeg")
    try:
        writers[plan.form](plan.file, drawn, plan.rate)
    except BaseException:
        plan.file.unlink(missing_ok=True)
        raise


def _drawn(pictures: Pictures | CameraPictures, times: list[float], kind: str) -> Iterator[bytes]:
    """Yield the pictures, and show the progress."""
    with progress_bar.of_pictures(len(times)) as show:
        for done, time in enumerate(times, 1):
            yield pictures.at(time, kind, QUALITY)
            show(done)

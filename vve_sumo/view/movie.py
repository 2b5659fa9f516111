"""Writes pictures one after the other as a moving picture: MP4 by ffmpeg, GIF and WebP by Pillow.

Knows files of pictures; nothing of what is on them.
"""

from __future__ import annotations

import contextlib
import importlib
import io
import shutil
import subprocess
from collections.abc import Iterable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import IO, TYPE_CHECKING, Final

from vve_sumo.errors import ConfigError

if TYPE_CHECKING:
    from PIL.Image import Image

#: of a GIF's pictures [1/s]: it counts in hundredths of a second, and browsers slow down what shows a picture for one
MAX_GIF_RATE: Final = 50.0
#: colours of a GIF; all of its pictures share them, so that what does not move costs nothing
COLOURS: Final = 160
#: pictures that a GIF's colours are taken from
SAMPLED: Final = 16
WEBP_QUALITY: Final = 62
#: from the full range of JPEG to what players expect of a film
TO_TELEVISION: Final = "scale=in_range=pc:out_range=tv:out_color_matrix=bt709,format=yuv420p"
#: H.264's constant rate factor: hardly worse than what it is made of
RATE_FACTOR: Final = "20"


def find_ffmpeg() -> str:
    """Return the path of an ffmpeg: the computer's, else that of the package imageio-ffmpeg.

    Raises ConfigError, with what to install, where there is none.
    """
    found = shutil.which("ffmpeg")
    if found is not None:
        return found
    with contextlib.suppress(ImportError, RuntimeError):
        return str(importlib.import_module("imageio_ffmpeg").get_ffmpeg_exe())
    raise ConfigError(
        "no ffmpeg is installed, which MP4 needs: pip install 'vve-sumo[video]', or sudo apt-get install ffmpeg; "
        "--gif and --webp need none"
    )


def write_mp4(file: Path, pictures: Iterable[bytes], rate: float) -> None:
    """Write JPEG pictures at `rate` a second [1/s] as H.264; raises ConfigError where ffmpeg is missing or fails."""
    command = [find_ffmpeg(), "-loglevel", "error", "-y"]
    command += ["-f", "image2pipe", "-c:v", "mjpeg", "-framerate", f"{rate:g}", "-i", "-"]
    command += ["-vf", TO_TELEVISION, "-color_range", "tv", "-colorspace", "bt709"]
    command += ["-color_primaries", "bt709", "-color_trc", "bt709"]
    command += ["-c:v", "libx264", "-preset", "medium", "-crf", RATE_FACTOR]
    command += ["-fflags", "+bitexact", "-flags:v", "+bitexact", "-movflags", "+faststart", "-f", "mp4", str(file)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdin is not None
        assert process.stderr is not None
        with contextlib.suppress(BrokenPipeError):
            _feed(process.stdin, pictures)
        error_output = process.stderr.read().decode(errors="replace").strip()
    if process.returncode:
        raise ConfigError(f"{file}: ffmpeg failed: {' '.join(error_output.split())[-300:] or process.returncode}")


def _feed(sink: IO[bytes], pictures: Iterable[bytes]) -> None:
    try:
        for picture in pictures:
            sink.write(picture)
    finally:
        sink.close()


def write_gif(file: Path, pictures: Iterable[bytes], rate: float) -> None:
    """Write pictures at `rate` a second [1/s] as a GIF that repeats."""
    from PIL.Image import Dither

    whole = list(_opened(pictures))
    palette = _palette(whole)
    first, *rest = (one.quantize(palette=palette, dither=Dither.NONE) for one in whole)
    # In whole hundredths of a second each, and together as long as they should be.
    begins = [round(100.0 * k / rate) for k in range(len(whole) + 1)]
    durations = [10 * (end - begin) for begin, end in pairwise(begins)]
    first.save(file, "GIF", save_all=True, append_images=rest, duration=durations, loop=0, optimize=False)


def write_webp(file: Path, pictures: Iterable[bytes], rate: float) -> None:
    """Write pictures at `rate` a second [1/s] as an animated WebP that repeats."""
    first, *rest = _opened(pictures)
    first.save(
        file, "WEBP", save_all=True, append_images=rest, duration=round(1000.0 / rate), loop=0,
        quality=WEBP_QUALITY, method=5,
    )  # fmt: skip


def _opened(pictures: Iterable[bytes]) -> Iterator[Image]:
    from PIL import Image

    for picture in pictures:
        yield Image.open(io.BytesIO(picture)).convert("RGB")


def _palette(pictures: list[Image]) -> Image:
    """Return a picture with the colours that pictures from all of the time have in common."""
    from PIL import Image

    chosen = pictures[:: max(1, len(pictures) // SAMPLED)]
    wide, high = chosen[0].width // 2, chosen[0].height // 2
    sheet = Image.new("RGB", (wide, high * len(chosen)))
    for row, picture in enumerate(chosen):
        sheet.paste(picture.resize((wide, high)), (0, row * high))
    return sheet.quantize(COLOURS)

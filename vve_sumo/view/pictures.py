"""Pictures of a record, drawn by the page's own modules in a headless browser: the street from the car and from above.

Knows records and the page `render.html`; nothing of files that pictures are written to.
"""

from __future__ import annotations

import base64
import json
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Self

from vve_sumo.analysis.run import Run
from vve_sumo.view.browser import Browser
from vve_sumo.view.details import details
from vve_sumo.view.frames import Frames
from vve_sumo.view.street import with_network

#: where a picture is taken from: the driver's seat, behind the car, over it; the page's street from above
VIEWS: Final = ("driver", "chase", "above", "street")
PAGE: Final = Path(__file__).parent / "web" / "render.html"


class Pictures:
    """Draws a record at any drive time; a context manager that ends its browser."""

    def __init__(self, run: Run, view: str, width: int, height: int) -> None:
        """Open the record in a browser of its own; `view` is one of VIEWS, sizes are pixels.

        Raises BrowserError where there is no browser or it fails.
        """
        frames = Frames(run)
        scene = with_network(frames.scene, run.resolved, Path.cwd())
        packed = [base64.b64encode(part).decode() for part in (frames.packed(), details(run))]
        self._browser = Browser(width, height)
        try:
            self._browser.open(PAGE)
            arguments = json.dumps([scene, *packed, view, width, height], allow_nan=False)
            self._browser.evaluate(f"pictures.open(...{arguments})")
        except BaseException:
            self._browser.close()
            raise

    def at(self, time: float, kind: str = "image/png", quality: float = 1.0) -> bytes:
        """Return the picture at a drive time [s] as a file of a kind that the browser writes: PNG or JPEG."""
        drawn = self._browser.evaluate(f"pictures.at({time!r}, {kind!r}, {quality!r})")
        return base64.b64decode(drawn)

    def evaluate(self, expression: str) -> Any:
        """Return the value of a JavaScript expression on the page; raises BrowserError where it throws."""
        return self._browser.evaluate(expression)

    @property
    def complaints(self) -> list[str]:
        """What the page wrote to its console as an error."""
        return self._browser.complaints

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._browser.close()

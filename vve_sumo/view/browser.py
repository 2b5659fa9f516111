"""A headless Chromium of our own, spoken to over the DevTools protocol through a pipe: no port is opened.

Opens files of this package and evaluates expressions in them. Knows nothing of what they draw.
"""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import select
import shutil
import signal
import tempfile
import time
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Self

from vve_sumo.errors import ConfigError

#: names of the programs that are tried, in this order; the environment variable comes before them
PROGRAMS: Final = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
VARIABLE: Final = "VVE_CHROMIUM"
#: what is said where there is none
MISSING: Final = (
    f"no Chromium is installed: looked for {', '.join(PROGRAMS)}; "
    f"install one (sudo apt-get install chromium) or set {VARIABLE} to its path"
)
#: the browser is given so long for an answer [s]; a picture takes a tenth of a second
TIMEOUT: Final = 60.0
#: a process is given so long to end before it is killed [s]
ENDING: Final = 5.0
#: software rendering, so that a picture is the same with and without a graphics card; nothing is fetched
OPTIONS: Final = (
    "--headless=new",
    "--remote-debugging-pipe",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist",
    "--force-device-scale-factor=1",
    "--force-color-profile=srgb",
    "--font-render-hinting=none",
    "--allow-file-access-from-files",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-default-apps",
    "--disable-dev-shm-usage",
    "--disable-extensions",
    "--disable-sync",
    "--host-resolver-rules=MAP * ~NOTFOUND",
    "--mute-audio",
    "--no-default-browser-check",
    "--no-first-run",
)


class BrowserError(ConfigError):
    """The browser is missing, did not start, or gave up."""


def find_browser() -> str:
    """Return the path of a Chromium; raises BrowserError, with what to do about it, where there is none."""
    named = os.environ.get(VARIABLE)
    if named:
        if shutil.which(named) is None:
            raise BrowserError(f"{VARIABLE}: expected the path of a Chromium, found no program {named}")
        return named
    found = next(filter(None, map(shutil.which, PROGRAMS)), None)
    if found is None:
        raise BrowserError(MISSING)
    return found


class Browser:
    """One headless Chromium with one page; a context manager that ends it."""

    def __init__(self, width: int, height: int) -> None:
        """Start it with a window of this size [px]; raises BrowserError where that fails."""
        program = find_browser()
        self._profile = tempfile.TemporaryDirectory(prefix="vve-sumo-browser-", ignore_cleanup_errors=True)
        theirs_in, self._out = os.pipe()
        self._in, theirs_out = os.pipe()
        options = [*OPTIONS, f"--user-data-dir={self._profile.name}", f"--window-size={width},{height}"]
        if os.geteuid() == 0:
            options.append("--no-sandbox")  # Chromium refuses to run as root with it
        self._pid = _spawn([program, *options, "about:blank"], theirs_in, theirs_out, Path(self._profile.name))
        self._ended = False
        self._number = 0
        self._buffer = bytearray()
        self._events: list[dict[str, Any]] = []
        try:
            self._session = self._attach(width, height)
        except BaseException:
            self.close()
            raise

    def _attach(self, width: int, height: int) -> str:
        targets = self._call("Target.getTargets")["targetInfos"]
        page = next(one["targetId"] for one in targets if one["type"] == "page")
        self._session = ""
        session = str(self._call("Target.attachToTarget", targetId=page, flatten=True)["sessionId"])
        self._session = session
        self._call("Page.enable")
        self._call("Runtime.enable")
        self._call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)
        return session

    def open(self, file: Path) -> None:
        """Open a file of this computer as the page and wait until it and its modules are loaded."""
        answer = self._call("Page.navigate", url=file.resolve().as_uri())
        if answer.get("errorText"):
            raise BrowserError(f"{file}: the browser cannot open it: {answer['errorText']}")
        self._wait_for("Page.loadEventFired")

    def evaluate(self, expression: str) -> Any:
        """Return the value of a JavaScript expression on the page, awaited where it is a promise.

        Raises BrowserError with the page's own words where it throws.
        """
        answer = self._call("Runtime.evaluate", expression=expression, awaitPromise=True, returnByValue=True)
        if "exceptionDetails" in answer:
            raise BrowserError(f"the page failed: {_exception_text(answer['exceptionDetails'])}")
        return answer["result"].get("value")

    @property
    def complaints(self) -> list[str]:
        """What was written to the page's console as an error, and exceptions that nobody caught."""
        found = []
        for event in self._events:
            if event["method"] == "Runtime.exceptionThrown":
                found.append(_exception_text(event["params"]["exceptionDetails"]))
            elif event["method"] == "Runtime.consoleAPICalled" and event["params"]["type"] == "error":
                found.append(" ".join(str(one.get("value", "")) for one in event["params"]["args"]))
        return found

    def close(self) -> None:
        """End the browser and delete its profile."""
        if not self._ended:
            self._ended = True
            for pipe in (self._in, self._out):
                os.close(pipe)
            _end(self._pid)
            self._profile.cleanup()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Call a method of the protocol and return its result."""
        self._number += 1
        message: dict[str, Any] = {"id": self._number, "method": method, "params": parameters}
        if getattr(self, "_session", ""):
            message["sessionId"] = self._session
        self._write(json.dumps(message).encode() + b"\0")
        while True:
            answer = self._next()
            if answer.get("id") == self._number:
                if "error" in answer:
                    raise BrowserError(f"the browser refused {method}: {answer['error'].get('message')}")
                result: dict[str, Any] = answer["result"]
                return result

    def _wait_for(self, event: str) -> None:
        while not any(one["method"] == event for one in self._events):
            self._next()

    def _next(self) -> dict[str, Any]:
        """Return the next message; events are kept."""
        end = self._buffer.find(0)
        deadline = time.monotonic() + TIMEOUT
        while end < 0:
            if not select.select([self._in], [], [], max(0.0, deadline - time.monotonic()))[0]:
                raise BrowserError(f"the browser gave no answer within {TIMEOUT:.0f} s")
            chunk = os.read(self._in, 1 << 20)
            if not chunk:
                raise BrowserError("the browser ended unexpectedly")
            before = len(self._buffer)
            self._buffer += chunk
            end = self._buffer.find(0, before)
        message: dict[str, Any] = json.loads(bytes(self._buffer[:end]))
        del self._buffer[: end + 1]
        if "method" in message:
            self._events.append(message)
        return message

    def _write(self, data: bytes) -> None:
        view = memoryview(data)
        try:
            while view:
                view = view[os.write(self._out, view) :]
        except BrokenPipeError:
            raise BrowserError("the browser ended unexpectedly") from None


def _spawn(command: list[str], theirs_in: int, theirs_out: int, profile: Path) -> int:
    """Start the browser in a process group of its own, its end of the pipes as file descriptors 3 and 4."""
    # Above 10, so that neither is overwritten before it is duplicated.
    high_in, high_out = (fcntl.fcntl(pipe, fcntl.F_DUPFD_CLOEXEC, 10) for pipe in (theirs_in, theirs_out))
    quiet = os.open(os.devnull, os.O_RDWR)
    actions = [
        (os.POSIX_SPAWN_DUP2, quiet, 0),
        (os.POSIX_SPAWN_DUP2, quiet, 1),
        (os.POSIX_SPAWN_DUP2, quiet, 2),
        (os.POSIX_SPAWN_DUP2, high_in, 3),
        (os.POSIX_SPAWN_DUP2, high_out, 4),
    ]
    environment = os.environ | {"HOME": str(profile), "DBUS_SESSION_BUS_ADDRESS": "disabled:"}
    try:
        return os.posix_spawnp(command[0], command, environment, file_actions=actions, setpgroup=0)
    except OSError as error:
        raise BrowserError(f"{command[0]}: cannot be started: {error.strerror}") from None
    finally:
        for pipe in (theirs_in, theirs_out, high_in, high_out, quiet):
            os.close(pipe)


def _end(process: int) -> None:
    """End a process and its group."""
    for number in (signal.SIGTERM, signal.SIGKILL):
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process, number)
        deadline = time.monotonic() + ENDING
        while time.monotonic() < deadline:
            if os.waitpid(process, os.WNOHANG)[0]:
                with contextlib.suppress(ProcessLookupError):
                    os.killpg(process, signal.SIGKILL)
                return
            time.sleep(0.01)


def _exception_text(details: dict[str, Any]) -> str:
    text = str(details.get("exception", {}).get("description") or details.get("text", ""))
    return " ".join(text.split())[:300]

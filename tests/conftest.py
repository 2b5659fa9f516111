"""Fixtures that every room's tests share."""

from __future__ import annotations

import os
import signal
from collections import Counter
from pathlib import Path

import pytest
from hypothesis import settings

pytest_plugins = ["tests.live.repeated"]
REPOSITORY = Path(__file__).parent.parent
SHARED_DATA = REPOSITORY.parent / "shared" / "data"


# How long an example takes says how busy the computer is. The gate draws the same examples each time, so it fails by a
# change alone. The release's run (`./check slow`) names the other profile, which draws new ones. A test that states how
# many examples it needs has as many in both.
settings.register_profile("gate", deadline=None, max_examples=40, derandomize=True)
settings.register_profile("release", deadline=None, max_examples=200)
settings.load_profile(os.environ.get("VVE_EXAMPLES", "gate"))


def pytest_configure() -> None:
    """Hear Ctrl-C: a shell starts what runs in its background deaf to it, and every test's processes would be too."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Complete the marks `thorough`.

    A test's first cases lose it, as many as it names `witnesses`. The tests of a fixture that their module names
    `THOROUGH_FIXTURE` get it.
    """
    seen: Counter[str] = Counter()
    for item in items:
        if not isinstance(item, pytest.Function):
            continue
        for mark in item.iter_markers("thorough"):
            name = item.nodeid.partition("[")[0]
            seen[name] += 1
            if seen[name] <= mark.kwargs.get("witnesses", 0):
                item.own_markers.remove(mark)
        if getattr(item.module, "THOROUGH_FIXTURE", None) in item.fixturenames:
            item.add_marker("thorough")


@pytest.fixture(scope="session")
def repository() -> Path:
    """Root of the checkout."""
    return REPOSITORY


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Folder of real recordings and tables that are not part of the repository."""
    if not SHARED_DATA.is_dir():
        pytest.skip(f"real recordings and tables are not beside this checkout ({SHARED_DATA.name} folder absent)")
    return SHARED_DATA

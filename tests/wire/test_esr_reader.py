"""The shipped reader of an ESR: how old it takes a scan to be, against the age that the scan was sent with."""

from __future__ import annotations

import uuid

import pytest

from tests.conftest import REPOSITORY
from vve_sumo.bus import Bus
from vve_sumo.wire import esr


@pytest.mark.parametrize("age", [0.0, 0.0004, 0.02, 0.09, 0.15, 0.2, 0.25])
def test_a_scan_is_as_old_as_its_stamp_says_within_its_rounding(age: float, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(REPOSITORY / "examples" / "brains"))
    from esr_radar import EsrRadar, open_bus  # type: ignore[import-not-found]

    place = f"esr_{uuid.uuid4().hex}"
    with Bus("virtual", place) as radar:
        reader = EsrRadar(open_bus(f"virtual:{place}"))
        for tick in range(40):
            now = 1_400_000_000.0 + 0.0371 * tick
            for frame in esr.encode(esr.Cycle(tick, now - age, esr.HostMotion(5.0, 0.0), ())):
                radar.send(frame)
            reader.listen(now)
            scan = reader.scan(now, now, 5.0)
            assert scan is not None
            assert scan.time - scan.measured == pytest.approx(age, abs=0.0011)
        reader.bus.close()

"""The builder: every consumer of chance has a stream that no other consumer shifts, and an alignment comes back."""

from __future__ import annotations

import numpy as np
import pytest

from vve_sumo.drive.assembly import LotAlignment, seed_of
from vve_sumo.frames import Alignment


def drawn(seeds: np.random.SeedSequence) -> list[int]:
    return np.random.default_rng(seeds).integers(0, 2**63, 8).tolist()


@pytest.mark.parametrize("seed", [0, 1, 7, 2**31 - 1])
def test_vehicle_and_radar_have_the_streams_that_numpy_spawns(seed: int) -> None:
    vehicle, radar = np.random.SeedSequence(seed).spawn(2)
    assert drawn(seed_of(seed, "vehicle")) == drawn(vehicle)
    assert drawn(seed_of(seed, "radar")) == drawn(radar)


def test_every_name_has_a_stream_of_its_own() -> None:
    """Also beside what numpy spawns for numbers that no name has been given."""
    names = {"vehicle", "radar", "lidar", "radar2", "camera", "a", "\0", "\1"}
    streams = {tuple(drawn(seed_of(3, name))) for name in names}
    streams |= {tuple(drawn(child)) for child in np.random.SeedSequence(3).spawn(8)[2:]}
    assert len(streams) == len(names) + 6


def test_an_alignment_comes_back_from_the_record() -> None:
    lot = LotAlignment("+proj=tmerc +lat_0=40 +lon_0=-83 +k=1 +datum=WGS84", Alignment(0.3, 12.5, -7.25), 1.4e9)
    assert LotAlignment.from_dict({"seed": 1} | lot.to_dict()) == lot

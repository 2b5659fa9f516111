"""Certificates of right and wrong brains on a street in closed form: who is right passes, who is not is named.

Every brain that is asked here runs through all cases with twenty seeds in the slow tests; VVE_CERTIFY_SEEDS is another
number of seeds. The others drive what shows one bug, with one seed.
"""

from __future__ import annotations

import math
import os
from functools import cache

import pytest

from tests.certify.courses import CASE
from tests.certify.toy_street import RIGHT, certified
from tests.exhaustive import with_slow
from vve_sumo.certify import diagnosis
from vve_sumo.certify.cases import CASES
from vve_sumo.certify.diagnosis import diagnose
from vve_sumo.certify.results import CaseResult, CaseVerdict

SEEDS = range(1, int(os.environ.get("VVE_CERTIFY_SEEDS", "20")) + 1)

#: bug: cases that show it, and a part of the name that it is given
BUGS = {
    "acts_on_invalid": (("radar_invalid",), "acts on radar marked invalid"),
    "ignores_age": (("radar_ageing",), "does not check the age of the radar"),
    # Bytes that arrive again and again are too old after 0.1 s, which this brain does check.
    "ignores_sequence": (("radar_counter",), "does not check the sequence of the radar"),
    "ignores_delay": (("radar_delay",), "acts on radar that arrives late"),
    "drives_on_dead_gnss": (("gnss_drop_out", "gnss_freeze"), "drives on without GNSS"),
    "swaps_range_rate": (("nominal", "target_ghost", "target_ghost_receding"), diagnosis.SIGN),
    "range_rate_in_kmh": (("nominal", "target_ghost", "target_ghost_slower"), diagnosis.RATE_UNIT),
    "mirrors_azimuth": (("target_bend_in_way", "target_bend_mirrored"), diagnosis.MIRRORED),
    "azimuth_in_degrees": (("target_rows_beside",), "unit of azimuth"),
    "steers_backwards": (("nominal",), diagnosis.STEERING_SIGN),
    "steers_in_degrees": (("nominal",), diagnosis.STEERING_SCALE),
    "accelerates_in_g": (("nominal",), diagnosis.ACCELERATION_SMALL),
    "accelerates_backwards": (("nominal",), diagnosis.ACCELERATION_SIGN),
    "reacts_late": (("target_ghost",), "reacts late to a target"),
    "lives_too_long": (("nominal",), "lifetime of its setpoints"),
}
#: bugs of a brain that sees by the frames of a radar
BUGS_ON_CAN = ("mirrors_azimuth", "range_rate_in_kmh")
#: of these the fast tests drive one case each
QUICK = ("mirrors_azimuth", "drives_on_dead_gnss", "steers_backwards", "reacts_late", "lives_too_long")


def failed(results: list[CaseResult]) -> set[str]:
    """Return the cases that failed."""
    return {one.case.name for one in results if one.verdict is CaseVerdict.FAILED}


def names(results: list[CaseResult]) -> list[str]:
    """Return the defects' names."""
    return [defect.name for defect in diagnose(results)]


@pytest.mark.thorough
@pytest.mark.parametrize("bug", QUICK)
def test_a_bug_fails_the_case_that_is_for_it_and_is_named(bug: str) -> None:
    cases, name = BUGS[bug]
    results = certified(bug, 1, cases=[CASE[case] for case in cases])
    assert failed(results) == set(cases)
    assert [name in found for found in names(results)] == [True]


def test_who_ignores_the_sequence_is_saved_from_a_frozen_radar_by_the_age_alone() -> None:
    """Who checks the sequence answers at the first repeated datagram, this one once the scan is older than 0.1 s."""
    _, frozen = certified("ignores_sequence", 1, cases=[CASE["radar_freeze"]])
    assert frozen.verdict is CaseVerdict.PASSED
    assert 0.0 < frozen.reaction <= 0.1
    _, by_sequence = certified("ignores_age", 1, cases=[CASE["radar_freeze"]])
    assert by_sequence.reaction == 0.0


@pytest.mark.thorough(witnesses=1)
@pytest.mark.parametrize("sense", ["esr", "ars408"])
def test_who_reads_a_radars_angle_by_the_wrong_sign_is_named(sense: str) -> None:
    """An ESR's angle is right positive, an ARS408's lateral distance left positive: the slip of a reader."""
    cases = [CASE["target_bend_in_way"], CASE["target_bend_mirrored"]]
    results = certified("mirrors_azimuth", 1, sense, cases)
    assert failed(results) == {"target_bend_in_way", "target_bend_mirrored"}
    assert "mirrored" in names(results)[0]
    assert "sign of azimuth" in names(results)[0]


@pytest.mark.thorough
@pytest.mark.parametrize("sense", ["esr", "ars408"])
def test_a_right_brain_on_a_radars_bus_passes_what_is_for_buses(sense: str) -> None:
    cases = [one for one in CASES if one.name.startswith("sensor_") or one.name.endswith("_error")]
    cases += [CASE["target_bend_in_way"], CASE["target_bend_mirrored"]]
    results = certified("stop_for_parked", 1, sense, cases)
    assert [(one.case.name, one.why) for one in results if one.verdict in (CaseVerdict.FAILED, CaseVerdict.VOID)] == []


#: sense: a case that is its own, and how a frozen, a late or a missing one ends
OTHER_SENSES = {"mobileye": "camera_error", "vlp16": "lidar_delay", "v2x": "v2x_freeze"}


@pytest.mark.parametrize("sense", with_slow(list(OTHER_SENSES), lambda sense: sense == "v2x"))
def test_a_right_brain_by_another_sense_passes_and_one_that_mirrors_it_is_named(sense: str) -> None:
    pytest.importorskip("asn1tools", reason="needs asn1tools")
    right = certified("stop_for_parked", 1, sense, [CASE["target_bend_in_way"], CASE[OTHER_SENSES[sense]]])
    assert [one.verdict for one in right] == [CaseVerdict.PASSED] * 3
    mirroring = certified("mirrors_azimuth", 1, sense, [CASE["target_bend_in_way"], CASE["target_bend_mirrored"]])
    assert failed(mirroring) == {"target_bend_in_way", "target_bend_mirrored"}
    assert diagnosis.MIRRORED in names(mirroring)


@pytest.mark.slow
@pytest.mark.parametrize("sense", OTHER_SENSES)
def test_a_right_brain_by_another_sense_passes_every_case(sense: str) -> None:
    results = whole("stop_for_parked", 1, sense)
    assert [(one.case.name, one.why) for one in results if one.verdict in (CaseVerdict.FAILED, CaseVerdict.VOID)] == []


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["stanley_idm", "pursuit_headway"])
def test_a_right_brain_by_a_public_law_passes_what_its_law_is_asked_by(name: str) -> None:
    asked = ("target_ghost", "target_ghost_slower", "target_bend_in_way", "target_rows_beside", "gnss_drop_out")
    results = certified(name, 1, cases=[CASE[case] for case in asked])
    assert [(one.case.name, one.why) for one in results if one.verdict is not CaseVerdict.PASSED] == []


@pytest.mark.thorough
def test_a_brain_by_the_law_of_a_public_package_passes_what_its_law_is_asked_by(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    pytest.importorskip("cacc_sim", reason="cavsandbox is not installed")
    from cavsandbox_idm import CavsandboxIdm

    monkeypatch.setitem(RIGHT, "cavsandbox_idm", CavsandboxIdm)  # type: ignore[arg-type]
    results = certified("cavsandbox_idm", 1, cases=[CASE["target_ghost"], CASE["target_ghost_slower"]])
    assert [(one.case.name, one.why) for one in results if one.verdict is not CaseVerdict.PASSED] == []


@cache
def whole(name: str, seed: int, sense: str = "radar") -> tuple[CaseResult, ...]:
    """Return a certificate with all cases."""
    return tuple(certified(name, seed, sense))


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("name", RIGHT)
def test_the_right_brains_pass_every_case(name: str, seed: int) -> None:
    results = whole(name, seed)
    assert [(one.case.name, one.why) for one in results if one.verdict in (CaseVerdict.FAILED, CaseVerdict.VOID)] == []
    assert sum(one.verdict is CaseVerdict.PASSED for one in results) >= 25


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("bug", BUGS)
def test_every_bug_fails_and_is_named_by_all_cases(bug: str, seed: int) -> None:
    cases, name = BUGS[bug]
    results = list(whole(bug, seed))
    assert set(cases) <= failed(results)
    assert any(name in found for found in names(results)), names(results)


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("sense", ["esr", "ars408"])
@pytest.mark.parametrize("bug", BUGS_ON_CAN)
def test_every_bug_of_a_reader_of_frames_is_named(bug: str, sense: str, seed: int) -> None:
    results = list(whole(bug, seed, sense))
    assert any(BUGS[bug][1] in found for found in names(results)), names(results)


def test_what_is_left_says_how_far_from_the_target_the_brain_stopped() -> None:
    (nominal,) = certified("stop_for_parked", 1, cases=[])
    assert nominal.verdict is CaseVerdict.PASSED
    assert math.isclose(nominal.distance_left, 5.5, abs_tol=0.6)

"""Places for brains side by side, and what a drive keeps."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.conftest import REPOSITORY
from vve_sumo.certify import case_record
from vve_sumo.certify.link import Answer
from vve_sumo.certify.places import Place, has_places, place_of, places_of
from vve_sumo.errors import ConfigError
from vve_sumo.rig.load import load as load_rig
from vve_sumo.rig.schema import Rig

COMMAND = "./brain --see {radar} --place {ncom} --say {setpoints}"


@pytest.fixture
def rig() -> Rig:
    return load_rig(REPOSITORY / "rigs" / "foreign.toml", REPOSITORY)


def test_the_rigs_own_place_has_its_own_ports(rig: Rig) -> None:
    assert place_of(rig, COMMAND).command == "./brain --see 5002 --place 5001 --say 5003"
    assert place_of(rig, COMMAND).ports == {5001: "ncom", 5002: "radar"}
    assert place_of(rig, None).command is None
    with pytest.raises(ConfigError, match=r"\{esr\} stands for no wire of the rig, expected one of \{setpoints\}"):
        place_of(rig, "./brain {esr}")


def test_places_share_no_port_and_no_link(rig: Rig) -> None:
    bus = rig.outputs[0].model_copy(update={"kind": "esr", "udp": None, "interface": "slcan", "channel": "pty:esr.pty"})
    rig = rig.model_copy(update={"outputs": (*rig.outputs, bus)})
    places = places_of(rig, COMMAND + " --bus {esr}", 3)
    ports = [port for place in places for port in (*place.ports, place.rig.brain.port)]
    assert len(set(ports)) == 9
    assert {(place.command or "").rpartition(" ")[2] for place in places} == {f"esr.pty.{n}" for n in range(3)}
    for place in places:
        said = (place.command or "").split()
        by_kind = {kind: port for port, kind in place.ports.items()}
        assert [said[2], said[4], said[6]] == [str(by_kind["radar"]), str(by_kind["ncom"]), str(place.rig.brain.port)]


@pytest.mark.parametrize(
    ("command", "said"),
    [
        (None, "expected --brain"),
        ("./brain", r"expected \{ncom\} in the brain's command, in the place of 5001"),
        ("./brain {ncom} {radar}", r"expected \{setpoints\} in the brain's command, in the place of 5003"),
    ],
)
def test_brains_that_would_meet_on_a_port_are_refused(rig: Rig, command: str | None, said: str) -> None:
    assert not has_places(rig, command)
    assert has_places(rig, COMMAND)
    with pytest.raises(ConfigError, match=f"--workers 2: {said}"):
        places_of(rig, command, 2)
    assert len(places_of(rig, command, 1)) == 1


def test_a_place_goes_to_the_process_that_drives(rig: Rig) -> None:
    for place in places_of(rig, COMMAND, 2):
        assert Place.from_dict(rig, json.loads(json.dumps(place.to_dict()))) == place


def test_every_setpoint_is_kept_in_the_record(tmp_path: Path) -> None:
    case_record.write(tmp_path, [Answer(0.06000000000000001, 3, 4, 0.1, -1.5)])
    assert case_record._answers(tmp_path / case_record.ANSWERS) == [Answer(0.06, 3, 4, 0.1, -1.5)]

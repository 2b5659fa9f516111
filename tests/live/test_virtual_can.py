"""A card that bears the name of a virtual bus: nobody but a person engages over it."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.live.command_line import own_rig
from vve_sumo.live.virtual_can import INTERFACES, hardware_obstacle
from vve_sumo.rig.load import load
from vve_sumo.rig.schema import Rig

CARD = "devices/pci0000:00/0000:00:1c.0/net"


def rig_on_vcan(folder: Path, *changes: tuple[str, str]) -> Rig:
    bus = ('interface = "slcan"\nchannel = "pty"', 'interface = "socketcan"\nchannel = "vcan0"')
    return load(own_rig(folder, bus, ("[car_start] ", '[car_start]\nchannel = "vcan1" '), *changes))


def kernel(folder: Path, **devices: str) -> Path:
    """The kernel's folder of interfaces, each a link to where its device is."""
    net = folder / "class" / "net"
    net.mkdir(parents=True)
    for name, place in devices.items():
        (folder / place / name).mkdir(parents=True)
        (net / name).symlink_to(folder / place / name)
    return net


@pytest.mark.parametrize(("card", "other"), [("vcan0", "vcan1"), ("vcan1", "vcan0")])
def test_a_card_under_a_virtual_name_is_refused_at_either_end(tmp_path: Path, card: str, other: str) -> None:
    net = kernel(tmp_path, **{card: CARD, other: "devices/virtual/net"})
    obstacle = hardware_obstacle(rig_on_vcan(tmp_path), net)
    assert str(obstacle).startswith(f"operator.automatic: {card} is a CAN card and not virtual")
    assert hardware_obstacle(rig_on_vcan(tmp_path, ("automatic = true", "automatic = false")), net) is None


def test_virtual_and_missing_interfaces_and_a_pseudo_terminal_pass(tmp_path: Path) -> None:
    assert hardware_obstacle(rig_on_vcan(tmp_path), kernel(tmp_path, vcan0="devices/virtual/net")) is None
    assert hardware_obstacle(load(own_rig(tmp_path)), kernel(tmp_path / "other", pty=CARD)) is None


def test_this_machine_s_loopback_is_virtual_as_the_kernel_lists_it() -> None:
    assert (INTERFACES / "lo").resolve().parts[-4:-1] == ("devices", "virtual", "net")

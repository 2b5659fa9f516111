"""A heavier car than the shipped ones, with stronger brakes and a wire of its own: the toy's, which takes 6000 N m."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

from tests.conftest import REPOSITORY

TOY: Final = REPOSITORY / "tests" / "ports" / "toy" / "interface.py"
#: 5000 N m over 868 kg m are 5.76 m/s2; the 3412 N m of Dataspeed's wire are 3.93
NUMBERS: Final = {
    "mass_kg": 2300.0,
    "laden_mass_kg": 2800.0,
    "brake_torque_limit_nm": 5000.0,
    "deceleration_limit_mps2": 5.5,
    "brake_gain_kgm": 868.0,
}
OWN_WIRE: Final = f'interface = "{TOY}:make"\nsettings = {{ brake_nm = 6000.0 }}'
DATASPEED: Final = 'interface = "dataspeed_dbw1"\nsettings = { variant = "dbw1_2024" }'


def van_file(folder: Path, wire: str, name: str = "van.toml") -> Path:
    """Write the van's vehicle file with a wire and return its place."""
    text = (REPOSITORY / "vehicles" / "ford_fusion.toml").read_text(encoding="utf-8")
    for key, value in NUMBERS.items():
        text, count = re.subn(rf"^{key} = [\d._]+$", f"{key} = {value}", text, count=1, flags=re.MULTILINE)
        assert count == 1
    assert DATASPEED in text
    file = folder / name
    file.write_text(text.replace(DATASPEED, wire), encoding="utf-8")
    return file

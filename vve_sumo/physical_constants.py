"""Constants of physics that several rooms compute with; each is defined here only."""

from __future__ import annotations

from typing import Final

#: standard acceleration of free fall [m/s2], 3rd CGPM, 1901
GRAVITY: Final = 9.80665
#: dry air at 20 degrees Celsius and sea level [kg/m3], rounded
AIR_DENSITY: Final = 1.2
#: mean radius of the earth [m], IUGG; good to 0.5 % anywhere, for what turns short ways into angles and back
EARTH_RADIUS: Final = 6_371_000.0

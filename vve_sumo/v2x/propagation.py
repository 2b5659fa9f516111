"""How strongly a radio at 5.9 GHz is heard along an urban street.

Path loss, the loss behind a vehicle and the sigma of the shadowing are those of 3GPP TR 37.885 V15 (table 6.2.1-1 and
6.2.1), the shadowing's decorrelation that of TR 36.885 (A.1.4). Powers in dBm, losses in dB, lengths in metres. Plain
arithmetic; draws nothing.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Mapping
from typing import Final

#: of ITS-G5's control channel, and about that of the others [GHz]
FREQUENCY: Final = 5.9
#: nearer than this the model does not hold: the loss is that at this distance [m]
NEAREST: Final = 1.0


class Sight(enum.Enum):
    """What is between two antennas."""

    CLEAR = "clear"
    BODY = "body"  #: a body that is as high as one of the antennas, or higher
    BUILDING = "building"


#: 1 sigma [dB]
SHADOWING: Final[Mapping[Sight, float]] = {Sight.CLEAR: 3.0, Sight.BODY: 3.0, Sight.BUILDING: 4.0}
#: after so much way of one antenna relative to the other the shadowing is correlated by 1/e [m]
DECORRELATION: Final = 10.0


def path_loss(distance: float, sight: Sight) -> float:
    """Return the mean loss over a distance [m] between two antennas [dB], that of a body between them left out."""
    far = math.log10(max(distance, NEAREST))
    if sight is Sight.BUILDING:
        return 36.85 + 30.0 * far + 18.9 * math.log10(FREQUENCY)
    return 38.77 + 16.7 * far + 18.2 * math.log10(FREQUENCY)


def body_loss(distance: float, antennas: tuple[float, float], body: float, normal: float) -> float:
    """Return what a body between two antennas costs [dB].

    `antennas` are the heights of both, `body` that of the body [m], `normal` a number of the standard normal
    distribution. The loss is log-normal: none where the body is lower than both antennas, 5 dB in the mean where it is
    lower than one of them, 9 dB where it is higher than both, and more beyond 540 m.
    """
    if body < min(antennas):
        return 0.0
    mean, sigma = (9.0, 4.5) if body > max(antennas) else (5.0, 4.0)
    mean += max(0.0, 15.0 * math.log10(max(distance, NEAREST)) - 41.0)
    variance = math.log1p((sigma / mean) ** 2)
    return math.exp(math.log(mean) - 0.5 * variance + math.sqrt(variance) * normal)

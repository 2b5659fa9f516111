"""What is drawn in a figure: the data of its lines, found by their labels."""

from __future__ import annotations

import re

import numpy as np
from matplotlib.figure import Figure


def lines(figure: Figure, label: str) -> list[np.ndarray]:
    """Return x and y (2 x n) of the lines of that label, panel by panel."""
    return [np.array(line.get_data()) for axes in figure.axes for line in axes.lines if line.get_label() == label]


def labelled(figure: Figure, pattern: str) -> np.ndarray:
    found = [np.array(line.get_data()) for axes in figure.axes for line in axes.lines
             if re.search(pattern, str(line.get_label()))]  # fmt: skip
    return found[0]

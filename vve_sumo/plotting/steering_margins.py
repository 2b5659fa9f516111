"""The delay margin of a steering loop over speed: as the closed form predicts it, and as drives measured it.

Draws what a study came to; computes nothing that is not drawn.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np
from matplotlib.figure import Figure

from vve_sumo.plotting.page import PAPER
from vve_sumo.plotting.style import LINE_STYLES, WIDTH, explain, name, page, plain

if TYPE_CHECKING:
    from vve_sumo.analysis.steering_study import SteeringStudy

#: from seconds to what the axis shows
MS: Final = 1000.0


def steering_margin(study: SteeringStudy) -> Figure:
    """Draw the margins over speed, without and with an observer, for each mass: lines predicted, marks measured.

    A mark stands between the greatest delay whose drive was stable and the next step; an arrow upwards where every
    drive was stable.
    """
    with page(WIDTH, 4.8) as figure:
        axes = figure.subplots()
        name(figure, study.title)
        plain(axes)
        kinds = list(study.margins.groupby(["observer_s", "mass_factor"]))
        for look, (_kind, rows) in zip(LINE_STYLES, kinds, strict=False):
            speed, observer, mass = (
                rows[key].to_numpy(np.float64) for key in ("speed_mps", "observer_s", "mass_factor")
            )
            word = f"observer {observer[0]:g} s" if observer[0] > 0.0 else "without observer"
            word += f", mass x {mass[0]:g}" if study.margins["mass_factor"].nunique() > 1 else ""
            predicted = np.where(np.isfinite(rows["predicted_s"]), rows["predicted_s"], np.nan)
            axes.plot(speed, MS * predicted, color=look.colour, linestyle=look.stroke, label=f"{word}: predicted")
            measured = rows["measured_s"].to_numpy(np.float64)
            marks: dict[str, Any] = {
                "color": look.colour,
                "linestyle": "",
                "markersize": 8.0,
                "markerfacecolor": PAPER,
                "zorder": 4,
            }
            axes.plot(speed, MS * measured, marker=look.mark, markeredgewidth=1.8, label=f"{word}: measured", **marks)
            beyond = np.where(rows["unstable_from_s"].isna() & rows["stable_to_s"].notna(), study.greatest, np.nan)
            if np.isfinite(beyond).any():
                axes.plot(speed, MS * beyond, marker="^", label=f"{word}: stable at every delay", **marks)
        axes.set(xlabel="speed [m/s]", ylabel="delay margin of the steering [ms]", ylim=(0.0, None))
        explain(axes, 2)
        return figure

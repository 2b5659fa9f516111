"""Every metric that a person meets, in one table: what it is called, its unit, what it means, which way is worse.

Files, criteria, sweeps, reports, plots, the screen and the docs take names and words from here. The rows of what is
measured stand beside the functions that measure it (`per_drive`, `per_tick`, `exposure`, a user's file); here are those
that a drive itself reports.
"""

from __future__ import annotations

import re
from collections import ChainMap
from collections.abc import Iterable, Mapping

from vve_sumo.metrics.exposure import EXPOSURE
from vve_sumo.metrics.metric import Metric, ending_of, unit_of
from vve_sumo.metrics.port import shipped


def rows(*metrics: Metric) -> dict[str, Metric]:
    """Return metrics by their names."""
    return {metric.name: metric for metric in metrics}


#: how a drive ended, as it reports it itself
ENDING = rows(
    Metric("outcome", "outcome", "how the drive ended", kind="str"),
    Metric("passed", "passed", "whether it met all criteria", kind="bool"),
    Metric("failed", "failed", "criteria that it did not meet, joined by ;", kind="str"),
    Metric("reasons", "reasons", "the gateway's reason codes at the end, joined by ;", kind="str"),
)

#: what a playback measures while it drives
PLAYBACK = rows(
    Metric(
        "prediction_error_100ms_mean_m",
        "prediction over 100 ms, mean error",
        "distance of each measured pose from its prediction out of poses at least 100 ms older, the mean",
        worse="higher",
    ),
    Metric(
        "prediction_error_100ms_max_m",
        "prediction over 100 ms, maximum error",
        "distance of each measured pose from its prediction out of poses at least 100 ms older, the greatest",
        worse="higher",
    ),
)

#: what else a drive reports of itself
REPORTED = rows(
    Metric("removed_at_entry", "removed at entry", "vehicles taken off the road to make room for the ego", kind="int"),
    Metric(
        "removed_after_standoff",
        "removed after a standoff",
        "vehicles taken off the road because they and the ego waited for each other",
        kind="int",
    ),
    Metric("sumo_warnings", "SUMO's warnings", "how often SUMO warned", kind="int"),
    Metric("text", "text", "what a failure said in its own words", kind="str"),
    Metric("record_sha256", "record hash", "hash of the run's record", kind="str"),
)

_SHIPPED = shipped()
#: figures of every drive in the order in which a sweep's row holds them
FIGURES: Mapping[str, Metric] = {**ENDING, **_SHIPPED.per_drive, **REPORTED}
#: those of them that are numbers with a mean
NUMBERS = tuple(name for name, metric in FIGURES.items() if metric.kind == "float")
#: every shipped metric
SHIPPED_METRICS: dict[str, Metric] = {**FIGURES, **PLAYBACK, **_SHIPPED.per_tick, **EXPOSURE}
#: rows of a user's metrics that this process has met; what a drive is judged by is its scenario's own row
OWN_METRICS: dict[str, Metric] = {}
#: every metric by its name; a shipped one's words are never another's
METRICS: Mapping[str, Metric] = ChainMap(SHIPPED_METRICS, OWN_METRICS)

#: of parts of names, to be read in text
_WORDS = {
    "ttc": "TTC",
    "mttc": "modified TTC",
    "drac": "DRAC",
    "rss": "RSS",
    "gnss": "GNSS",
    "mfdd": "MFDD",
    "min": "minimum",
    "max": "maximum",
}
#: what may be the name of a metric in a text; a key of a scenario, with its dots, is none
_NAME = re.compile(r"(?<![\w.])[a-z0-9]+(?:_[a-z0-9]+)+(?!\w)")


def enter(metrics: Mapping[str, Metric]) -> None:
    """Make a user's metrics known by name to all that shows figures; of two of one name the last one's words count.

    Those of shipped metrics are left out.
    """
    OWN_METRICS.update({name: row for name, row in metrics.items() if name not in SHIPPED_METRICS})


def label_of(name: str) -> str:
    """Return what a column is called, without its unit; of one that is no metric, the words of its name.

    `min_ttc_s` is "minimum TTC", the parameter `ego.speed_mps` "ego speed", and `controller.name` "controller".
    """
    if name in METRICS:
        return METRICS[name].label
    name = name.removesuffix(".name")
    last = [part for part in name.removesuffix(ending_of(name)).split(".") if not part.isdigit()][-2:]
    return " ".join(_WORDS.get(word, word) for part in last for word in part.split("_"))


def axis_of(name: str, units: Mapping[str, str] | None = None) -> str:
    """Return what an axis says: what a column is called and its unit, 1 for a number without one."""
    return f"{label_of(name)} [{(units or {}).get(name) or unit_of(name) or '1'}]"


def meaning_of(name: str) -> str:
    """Return what a metric means; empty for what is none."""
    return METRICS[name].meaning if name in METRICS else ""


def with_labels(text: str) -> str:
    """Return a text, such as a meaning, in which metrics are called by their labels, in quotes, and not by their names.

    A name that is an everyday word, such as `hunting`, is left as it is.
    """
    return _NAME.sub(lambda found: f"“{METRICS[found[0]].label}”" if found[0] in METRICS else found[0], text)


def markdown(metrics: Iterable[Metric]) -> str:
    """Return a table of metrics as the docs show it."""
    lines = (f"| `{m.name}` | {m.label} | {m.unit} | {m.meaning} | {m.worse or ''} | {m.source} |" for m in metrics)
    return "\n".join(["| name | label | unit | meaning | worse | source |", "|---|---|---|---|---|---|", *lines])

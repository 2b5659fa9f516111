"""What the documents say is what the program does; tables that come from code are written from it.

`python -m tests.test_docs` rewrites the generated tables, and the pictures of the arming machine and of the control
structure.
"""

from __future__ import annotations

import dataclasses
import re
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, get_origin

import pyarrow as pa
import pytest
from pydantic import BaseModel
from pydantic.fields import FieldInfo

from tests import commands_page
from tests.conftest import REPOSITORY
from tests.live import matrix
from tests.record.declared import LIVE_TABLES
from tests.safety import control_structure
from tests.safety import tables as safety_tables
from tests.vehicle import arming_diagram
from vve_sumo.analysis.latency import PERCENTILES
from vve_sumo.analysis.sensing import STATISTICS
from vve_sumo.bridges.observed_numbers import FEATURES
from vve_sumo.certify.cases import CASES
from vve_sumo.certify.report import required
from vve_sumo.hunt import invariants
from vve_sumo.hunt.brains import BEHAVIOURS
from vve_sumo.hunt.known_limits import LIMITS
from vve_sumo.metrics.exposure import EXPOSURE
from vve_sumo.metrics.per_drive import PER_DRIVE
from vve_sumo.metrics.per_tick import PER_TICK
from vve_sumo.metrics.table import PLAYBACK, markdown
from vve_sumo.people import person, report_gate
from vve_sumo.plant import injected_faults
from vve_sumo.pose import trust
from vve_sumo.pose.receivers.port import PORT, ReceiverTable
from vve_sumo.pose.receivers.port import load as load_receiver
from vve_sumo.record.layout import (
    COMMANDED,
    OPTIONAL_SCHEMAS,
    PEOPLE,
    PEOPLE_REPORTS,
    ROADS,
    ROADS_SCHEMA,
    SIGNAL_PLANS,
    STATION_DATAGRAMS,
    STATIONS,
)
from vve_sumo.record.rows import TickRow
from vve_sumo.report import glossary
from vve_sumo.rig.load import MODEL_TABLES
from vve_sumo.rig.load import parse as parse_rig
from vve_sumo.rig.schema import Rig
from vve_sumo.rig.validation import arming_obstacle
from vve_sumo.scenario.load import parse
from vve_sumo.scenario.road_users import When
from vve_sumo.scenario.schema import Scenario
from vve_sumo.scenario.story_schema import StoryCondition
from vve_sumo.sensors.camera_settings import CameraSettings
from vve_sumo.sensors.lidar_settings import LidarSettings
from vve_sumo.sensors.right_of_way_settings import RightOfWaySettings
from vve_sumo.sensors.signals_settings import SignalsSettings
from vve_sumo.sensors.v2x_settings import V2xSettings
from vve_sumo.stations import station_gate
from vve_sumo.sweep.controllers import VariedController
from vve_sumo.sweep.spec import Boundary, Spec, WorstCase, parse_spec
from vve_sumo.vehicle import arming
from vve_sumo.vehicle.interface import INTERFACE_KINDS
from vve_sumo.vehicle.schema import VehicleFile
from vve_sumo.view.declared_camera import CameraFile

DOCS = REPOSITORY / "docs"


def columns() -> str:
    """The table of a tick's columns."""
    rows = (f"| `{f.name}` | {f.type} | {f.metadata['meaning']} |" for f in dataclasses.fields(TickRow))
    return "\n".join(["| column | type | meaning |", "|---|---|---|", *rows])


#: tables that stand in many places, and what is said there in place of their keys
EVERYWHERE = {"CriterionBand": "a band: `{ min = …, max = … }`", "When": "a trigger: see below"}


def _keys(model: type[BaseModel], prefix: str) -> Iterator[str]:
    for name, field in model.model_fields.items():
        key, inner = f"{prefix}{name}", field.annotation
        arguments = getattr(inner, "__args__", ())
        nested = next((a for a in (inner, *arguments) if isinstance(a, type) and issubclass(a, BaseModel)), None)
        if nested is not None and nested.__name__ not in EVERYWHERE:
            if field.description:
                yield f"| `{key}` |  | {field.description} |"
            yield from _keys(nested, key + {tuple: "[].", dict: ".NAME."}.get(get_origin(inner) or inner, "."))
            continue
        default = _default(field)
        meanings = (EVERYWHERE[nested.__name__] if nested else "", field.description or "")
        yield f"| `{key}` | {default} | {', '.join(filter(None, meanings))} |"


def _default(field: FieldInfo) -> str:
    """What a field is where it is left out: a value of a factory depends on the others, and the meaning tells it."""
    if field.is_required():
        return "required"
    return "" if field.default_factory is not None else _said(field.default)


def _said(value: Any) -> str:
    if value in (None, "", (), {}) or isinstance(value, BaseModel):
        return ""
    return f"`{str(value).lower() if isinstance(value, bool) else value}`"


def keys(model: type[BaseModel], prefix: str = "") -> str:
    """The table of a file's keys."""
    return "\n".join(["| key | default | meaning |", "|---|---|---|", *_keys(model, prefix)])


def _codes(reasons: Mapping[str, str]) -> str:
    rows = (f"| `{code}` | {words} |" for code, words in reasons.items())
    return "\n".join(["| code | in plain words |", "|---|---|", *rows])


def _schema(table: str) -> str:
    schema = (LIVE_TABLES | OPTIONAL_SCHEMAS | {ROADS: ROADS_SCHEMA})[table]
    rows = (f"| `{f.name}` | {_type(f)} | {f.metadata[b'meaning'].decode()} |" for f in schema)
    return "\n".join(["| column | type | meaning |", "|---|---|---|", *rows])


def _type(field: pa.Field) -> str:
    return f"list of {field.type.value_type}" if pa.types.is_list(field.type) else str(field.type)


def _kinds() -> str:
    lines = ["| kind | what happens | value |", "|---|---|---|"]
    for kind, words in injected_faults.KINDS.items():
        usual, least, most = injected_faults.VALUES.get(kind, injected_faults.NO_VALUE)
        value = f"{least:g} to {most:g}; {usual:g} where none is given" if kind in injected_faults.VALUES else ""
        lines.append(f"| `{kind}` | {words} | {value} |")
    return "\n".join(lines)


def _interface_kinds() -> str:
    lines = ["| kind | while it is due |", "|---|---|"]
    return "\n".join([*lines, *(f"| `{kind}` | {words} |" for kind, words in INTERFACE_KINDS.items())])


def _receivers() -> str:
    """The keys of `[pose]` that each kind of receiver has beside those of all."""
    lines = ["| kind | what it is | key | default | meaning |", "|---|---|---|---|---|"]
    for kind in PORT.shipped:
        receiver = load_receiver(kind)
        what = (receiver.__doc__ or "").rstrip(".")
        for name, field in receiver.model_fields.items():
            if name not in ReceiverTable.model_fields:
                default = _default(field)
                lines.append(f"| `{kind}` | {what} | `pose.{name}` | {default} | {field.description} |")
    return "\n".join(lines)


def _rig_keys() -> str:
    """The table of a rig's keys; what a rig leaves out of its car's tables is its vehicle model's."""
    optional = rf"(?:{'|'.join(MODEL_TABLES)})\.\w+|drive_by_wire\.interface"
    return re.sub(rf"^(\| `(?:{optional})` \|) required \|", r"\1 the model's |", keys(Rig), flags=re.MULTILINE)


def _cases() -> str:
    """The cases of a certificate."""
    lines = ["| case | injected | begins | required | why |", "|---|---|---|---|---|"]
    for case in CASES:
        when = "" if case.make_wire_fault is None else case.begins.value
        lines.append(f"| `{case.name}` | {case.injected} | {when} | {required(case)} | {case.why} |")
    return "\n".join(lines)


def _invariants() -> str:
    """The invariants that a hunt judges."""
    lines = ["| invariant | what holds |", "|---|---|"]
    lines += [f"| `{judge.name}` | {(judge.__doc__ or '').strip()} |" for judge in invariants.ALL]
    return "\n".join(lines)


def _behaviours() -> str:
    """The behaviours of a brain that a hunt tries."""
    lines = ["| behaviour | the brain |", "|---|---|"]
    return "\n".join([*lines, *(f"| `{kind}` | {words} |" for kind, words in BEHAVIOURS.items())])


def _known_limits() -> str:
    """What a gateway cannot know."""
    lines = ["| invariant | with | and | why |", "|---|---|---|---|"]
    for limit in LIMITS:
        others = " or ".join(f"`{kind}`" for kind in sorted(limit.kinds - {limit.frozen}))
        lines.append(f"| `{limit.invariant}` | `{limit.frozen}` | {others} | {limit.why} |")
    return "\n".join(lines)


def _gallery() -> str:
    """The pictures of the scenario library."""
    cards = []
    for file in sorted((REPOSITORY / "scenarios").glob("*.toml")):
        title = tomllib.loads(file.read_text(encoding="utf-8"))["title"]
        picture = f"![{file.stem}: the virtual road from above](scenarios/{file.stem}.png)"
        cards.append(f"- [{picture}](library.md#{file.stem})\n\n    `{file.stem}`: {title}")
    return "\n\n".join(cards)


def _observed_numbers() -> str:
    """What agents and FMUs observe; the detections after the first are alike."""
    rows = [feature for feature in FEATURES if not re.search(r"_[2-9]_", feature.name)]
    lines = [f"| `{one.name}` | {one.low:g} to {one.high:g} | {one.meaning} |" for one in rows]
    last = re.search(r"_(\d)_", FEATURES[-1].name)
    assert last is not None
    more = f"| … | | the same of detections 2 to {last.group(1)} |"
    return "\n".join(["| number | from, to | meaning |", "|---|---|---|", *lines, more])


GENERATED = {
    ("gymnasium.md", "observed numbers"): _observed_numbers,
    ("commands.md", "commands"): commands_page.markdown,
    ("gallery.md", "scenarios"): _gallery,
    ("certify.md", "cases"): _cases,
    ("hunt.md", "invariants"): _invariants,
    ("hunt.md", "behaviours"): _behaviours,
    ("hunt.md", "known limits"): _known_limits,
    ("faults.md", "faults"): matrix.table,
    ("faults.md", "kinds"): _kinds,
    ("glossary.md", "glossary"): glossary.markdown,
    ("record.md", "reading columns"): lambda: _schema("readings"),
    ("record.md", "detection columns"): lambda: _schema("sensor_radar"),
    ("record.md", "actor columns"): lambda: _schema("actors"),
    ("record.md", "commanded path columns"): lambda: _schema(COMMANDED),
    ("record.md", "people report columns"): lambda: _schema(PEOPLE_REPORTS),
    ("record.md", "people columns"): lambda: _schema(PEOPLE),
    ("record.md", "station datagram columns"): lambda: _schema(STATION_DATAGRAMS),
    ("record.md", "signal plan columns"): lambda: _schema(SIGNAL_PLANS),
    ("record.md", "station columns"): lambda: _schema(STATIONS),
    ("record.md", "road columns"): lambda: _schema("roads"),
    ("record.md", "gateway columns"): lambda: _schema("gateway"),
    ("record.md", "latency columns"): lambda: _schema("latency"),
    ("record.md", "columns"): columns,
    ("measures.md", "drive metrics"): lambda: markdown({**PER_DRIVE, **PLAYBACK}.values()),
    ("measures.md", "tick metrics"): lambda: markdown(PER_TICK.values()),
    ("measures.md", "exposure metrics"): lambda: markdown(EXPOSURE.values()),
    ("scenarios.md", "keys"): lambda: keys(Scenario),
    ("scenarios.md", "triggers"): lambda: keys(When),
    ("scenarios.md", "story conditions"): lambda: keys(StoryCondition),
    ("rigs.md", "keys"): _rig_keys,
    ("rigs.md", "receivers"): _receivers,
    ("camera.md", "camera keys"): lambda: keys(CameraSettings),
    ("pictures.md", "camera file keys"): lambda: keys(CameraFile),
    ("v2x.md", "v2x keys"): lambda: keys(V2xSettings),
    ("signals.md", "signals keys"): lambda: keys(SignalsSettings),
    ("right_of_way.md", "right of way keys"): lambda: keys(RightOfWaySettings),
    ("lidar.md", "lidar keys"): lambda: keys(LidarSettings),
    ("sweeps.md", "keys"): lambda: keys(Spec),
    ("sweeps.md", "controllers keys"): lambda: keys(VariedController, "controllers[]."),
    ("sweeps.md", "boundary keys"): lambda: keys(Boundary, "search."),
    ("sweeps.md", "worst keys"): lambda: keys(WorstCase, "search."),
    ("vehicle.md", "interface kinds"): _interface_kinds,
    ("vehicle.md", "keys"): lambda: keys(VehicleFile),
    ("vehicle.md", "gateway reasons"): lambda: _codes(arming.REASONS),
    ("vehicle.md", "trust reasons"): lambda: _codes(trust.REASONS),
    ("people.md", "person reasons"): lambda: _codes(person.REASONS),
    ("people.md", "report reasons"): lambda: _codes(report_gate.REASONS),
    ("v2x.md", "station reasons"): lambda: _codes(station_gate.REASONS),
    ("safety/hazards.md", "losses"): safety_tables.losses,
    ("safety/hazards.md", "hazards"): safety_tables.hazards,
    ("safety/hazards.md", "constraints"): safety_tables.constraints,
    ("safety/hazards.md", "actions"): safety_tables.actions,
    ("safety/residual_risks.md", "residual risks"): safety_tables.residual_risks,
    ("safety/roles.md", "roles"): safety_tables.roles,
    ("safety/roles.md", "checklists"): safety_tables.checklists,
}


def _parts(file: Path, name: str) -> tuple[str, str, str]:
    text = file.read_text(encoding="utf-8")
    found = re.search(rf"(.*<!-- {name}: [^\n]*-->\n)(.*)(<!-- end of {name} -->.*)", text, re.DOTALL)
    assert found is not None, f"{file}: no place for {name}"
    return found.group(1), found.group(2), found.group(3)


@pytest.mark.parametrize(("page", "name"), GENERATED)
def test_generated_tables_are_up_to_date(page: str, name: str) -> None:
    _head, table, _tail = _parts(DOCS / page, name)
    assert table.strip() == GENERATED[page, name](), "run python -m tests.test_docs"


def test_the_page_of_commands_holds_every_option_that_a_help_names() -> None:
    page = (DOCS / "commands.md").read_text(encoding="utf-8")
    sections = dict(re.findall(r"^##+ ([\w -]+)\n(.*?)(?=^##|^<!-- end|\Z)", page, re.DOTALL | re.MULTILINE))
    parsers = commands_page.parsers()
    assert list(sections) == list(parsers)
    for name, parser in parsers.items():
        arguments = parser.format_help().partition("\noptions:\n")[2].partition("exit codes:")[0]
        named = {*re.findall(r"(?m)^  (?:-\w, |-\w \S+, )?(--[\w-]+)", arguments)} - {"--help"}
        assert named <= {*re.findall(r"(?m)^\| `(?:-\w, )?(--[\w-]+)", sections[name])}, name


def test_the_list_of_pages_leaves_none_out() -> None:
    page = (DOCS / "pages.md").read_text(encoding="utf-8")
    pages = {str(file.relative_to(DOCS)) for file in DOCS.rglob("*.md")}
    assert pages - {*re.findall(r"\]\(([\w/]+\.md)\)", page)} == {"pages.md"}


def test_the_front_page_is_one_page_with_both_commands_and_five_doors() -> None:
    text = (REPOSITORY / "README.md").read_text(encoding="utf-8")
    assert len(text.splitlines()) <= 60
    assert re.findall(r"```\n(.*?)\n```", text, re.DOTALL) == [
        "pip install . && vve-sumo drive",
        "pip install '.[dev]' && ./check test",
    ]
    doors = re.findall(r"(?m)^\| .*\*\*([\w ]+)\*\*.* \| \[", text)
    assert doors == ["test engineer", "researcher", "analyst", "brain", "contributor"]
    assert text.count("![") == 1


def test_the_page_of_measures_names_what_the_radar_and_latencies_are_told_by() -> None:
    page = (DOCS / "measures.md").read_text(encoding="utf-8")
    assert [name for name in (*STATISTICS, *PERCENTILES) if f"`{name}`" not in page] == []


def test_every_column_of_a_tick_says_what_it_means() -> None:
    assert all(f.metadata["meaning"] for f in dataclasses.fields(TickRow))


def test_the_scenarios_in_the_documentation_are_some() -> None:
    text = (DOCS / "scenarios.md").read_text(encoding="utf-8")
    blocks = re.findall(r"```toml\n(.*?)```", text, re.DOTALL)
    *whole, rolling_ego, several, story = (tomllib.loads(block) for block in blocks)
    standing, moving = (parse(table, DOCS / "scenarios.md") for table in whole)
    assert [ego.id for ego in parse(several, DOCS / "scenarios.md").egos] == ["second", "third"]
    staged = parse(whole[0] | story, DOCS / "scenarios.md")
    assert [action.name for action in staged.actors[0].story.actions] == ["brake", "aside"]
    rolling = parse(whole[0] | {"ego": whole[0]["ego"] | rolling_ego["ego"]}, DOCS / "scenarios.md")
    assert rolling.ego.initial_speed_mps == rolling.ego.speed_mps
    assert len(standing.obstacles) == 2
    assert [len(actor.events) for actor in moving.actors] == [2, 1]
    for parameter in moving.parameters.values():
        assert all(_held(tomllib.loads(blocks[1]), place) is not None for place in parameter.sets)


def _held(table: Any, place: str) -> Any:
    """What stands at a dotted place; actors go by their names, events by their number."""
    for key in place.split("."):
        if isinstance(table, list):
            table = next((one for one in table if one.get("id") == key), None) or table[int(key)]
        else:
            table = table[key]
    return table


def test_the_sweeps_in_the_documentation_are_some() -> None:
    text = (DOCS / "sweeps.md").read_text(encoding="utf-8")
    blocks = re.findall(r"```toml\n(.*?)```", text, re.DOTALL)
    grid, compared, *searches = (parse_spec(tomllib.loads(block), DOCS / "sweeps.md") for block in blocks)
    assert list(grid.parameters) == ["ego.speed_mps", "ego.car.gnss_delay_s"]
    assert [one.count for one in compared.controllers] == [2, 1]
    assert [type(one.search) for one in searches] == [Boundary, WorstCase]


def test_the_rig_in_the_documentation_is_one_that_may_be_armed() -> None:
    text = (DOCS / "rigs.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"```toml\n(.*?)```", text, re.DOTALL)
    rig = parse_rig(tomllib.loads(block), DOCS / "rigs.md")
    assert rig.watchdog_test is not None
    assert arming_obstacle(rig, rig.watchdog_test.date) is None


@pytest.mark.parametrize(
    "page", ["README.md", "CONTRIBUTING.md", *(str(p.relative_to(REPOSITORY)) for p in DOCS.rglob("*.md"))]
)
def test_links_lead_somewhere(page: str) -> None:
    text = (REPOSITORY / page).read_text(encoding="utf-8")
    for target in re.findall(r"\]\(([^)#]+)", text):
        if "://" not in target:
            assert ((REPOSITORY / page).parent / target).exists(), f"{page} links to {target}"


def _rewrite() -> None:
    for (page, name), table in GENERATED.items():
        head, _old, tail = _parts(DOCS / page, name)
        (DOCS / page).write_text(f"{head}\n{table()}\n\n{tail}", encoding="utf-8")
    (DOCS / "arming.svg").write_text(arming_diagram.svg(), encoding="utf-8")
    (DOCS / "safety" / "control_structure.svg").write_text(control_structure.svg(), encoding="utf-8")


if __name__ == "__main__":
    _rewrite()

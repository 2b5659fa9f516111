"""Scenarios in code: found by name, changed key by key, checked as their files are, drawn, and listed."""

from __future__ import annotations

import copy
import warnings
from collections.abc import Iterator, Mapping, Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vve_sumo import workspace
from vve_sumo.config_file import read_as
from vve_sumo.errors import did_you_mean
from vve_sumo.scenario import overrides, schema
from vve_sumo.scenario.listing import COLUMNS, Row, listing, row_of
from vve_sumo.scenario.load import parse

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class Scenario:
    """A scenario: a name under scenarios/ or a .toml file, which `replace` makes others of. It never changes itself.

    >>> import vve_sumo as vve
    >>> scenario = vve.Scenario("parked_car")
    >>> faster = scenario.replace({"ego.speed_mps": 12, "obstacles.parked_car.offset_m": 0.5})
    >>> scenario["ego.speed_mps"], faster["ego.speed_mps"]
    (11.176, 12.0)
    """

    def __init__(self, scenario: str | Path, /) -> None:
        """Read a scenario; raises ConfigError, naming file and key, for what is missing or wrong."""
        self._file = workspace.find("scenario", str(scenario), Path.cwd())
        self._take(read_as(self._file, "scenario", schema.Scenario))

    def _take(self, table: dict[str, Any]) -> None:
        self._settings = parse(table, self._file)
        self._table = table

    @property
    def name(self) -> str:
        """Name of the file, without its ending."""
        return self._file.name.removesuffix(".toml")

    @property
    def title(self) -> str:
        """What the scenario is, in a line."""
        return self._settings.title

    @property
    def file(self) -> Path:
        """File that it was read from; relative names in it count from its folder."""
        return self._file

    @property
    def table(self) -> dict[str, Any]:
        """What the scenario's file would say, as Python's tomllib reads it; a copy."""
        return copy.deepcopy(self._table)

    @property
    def parameters(self) -> dict[str, str]:
        """What `replace` and a sweep's `vary` take by name, besides every key by its place, and what it means."""
        return {name: parameter.meaning for name, parameter in self._settings.parameters.items()}

    def __getitem__(self, key: str) -> Any:
        """Return the value of a dotted key, such as "ego.speed_mps", or of a parameter; defaults included."""
        return overrides.value_at(self._settings.model_dump(), overrides.places(self._table, key)[0])

    def replace(self, values: Mapping[str, Any] | None = None, /, **named: Any) -> Scenario:
        """Return the scenario with other values of dotted keys, such as "ego.speed_mps", or of its `parameters`.

        A number may be a text with a unit: {"ego.speed": "25 mph"} is the same as {"ego.speed_mps": 11.176}.
        Keys without dots may be given by keyword: `replace(seed=3)`. Raises ConfigError, naming the key, for what no
        scenario's file may say.
        """
        new_values = {key: plain(value) for key, value in {**(values or {}), **named}.items()}
        return self._with(overrides.checked(self._table, new_values, f"{self._file}: "))

    def chosen(
        self, *, seed: int | None, speed: float | str | None, controller: str | None, vehicle: str | None
    ) -> Scenario:
        """Return the scenario with another seed, speed [m/s], controller or vehicle model, where one is given."""
        seed, speed = plain(seed), plain(speed)
        return self._with(overrides.choose(self._table, seed=seed, speed=speed, controller=controller, vehicle=vehicle))

    def _with(self, table: dict[str, Any]) -> Scenario:
        other = copy.copy(self)
        other._take(table)
        return other

    def to_toml(self) -> str:
        """Return the scenario as the text of a scenario file."""
        import tomlkit

        return tomlkit.dumps(self._table)

    def draw(self) -> Figure:
        """Draw the virtual road, who moves how, and which trigger fires where and when if the ego never braked."""
        from vve_sumo.drive.resolved_scenario import resolve_scenario
        from vve_sumo.plotting.scenario import picture

        return picture(resolve_scenario(self.name, self._settings, self._file, Path.cwd()))

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Scenario):
            return NotImplemented
        return (self._file, self._table) == (other._file, other._table)

    __hash__ = None  # type: ignore[assignment]  # its table is none of the hashable kinds

    def __repr__(self) -> str:
        return f"<Scenario {self.name}: {self.title}>"

    def _repr_html_(self) -> str:
        row = zip(COLUMNS, row_of(self.name, self._settings), strict=True)
        cells = (f"<tr><th>{escape(name)}</th><td>{escape(text)}</td></tr>" for name, text in row)
        return f"<table>{''.join(cells)}</table>"


class Scenarios(Mapping[str, Scenario]):
    """Scenarios by their names, which show themselves as a table."""

    def __init__(self, rows: Sequence[Row]) -> None:
        self._rows = {row[0]: row for row in rows}

    def __getitem__(self, name: str) -> Scenario:
        if name not in self._rows:
            raise KeyError(f"{name!r} is no scenario; {did_you_mean(name, self._rows) or 'vve.scenarios() lists them'}")
        return Scenario(name)

    def __iter__(self) -> Iterator[str]:
        return iter(self._rows)

    def __len__(self) -> int:
        return len(self._rows)

    def __repr__(self) -> str:
        width = max(map(len, self._rows), default=0)
        return "\n".join(f"{name:{width}}  {title}" for name, title, *_rest in self._rows.values())

    def _repr_html_(self) -> str:
        head = "".join(f"<th>{escape(name)}</th>" for name in COLUMNS)
        rows = ("".join(f"<td>{escape(cell)}</td>" for cell in row) for row in self._rows.values())
        return f"<table><tr>{head}</tr>{''.join(f'<tr>{row}</tr>' for row in rows)}</table>"


def scenarios() -> Scenarios:
    """Return the scenarios that there are, in the working folder and shipped, by name; a warning says what is none.

    >>> import vve_sumo as vve
    >>> "parked_car" in vve.scenarios()
    True
    >>> vve.scenarios()["parked_car"].title
    "The paper's drive: a car parked in the middle of the road"
    """
    rows, wrong = listing(Path.cwd())
    for line in wrong:
        warnings.warn(line, stacklevel=2)
    return Scenarios(rows)


def plain(value: Any) -> Any:
    """Return a value as TOML could give it: arrays, series and numbers of numpy and pandas as Python's own."""
    if isinstance(value, Mapping):
        return {str(key): plain(one) for key, one in value.items()}
    if hasattr(value, "tolist"):
        return value.tolist()
    if isinstance(value, (list, tuple, range)):
        return [plain(one) for one in value]
    return value

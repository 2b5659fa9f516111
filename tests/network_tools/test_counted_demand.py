"""Traffic by counts: SUMO's detectors count what was counted when it is driven; what is wrong is said in a line."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from itertools import pairwise
from pathlib import Path

import pytest

from tests.isolated import isolated
from tests.world.streets import grid
from vve_sumo.errors import ConfigError
from vve_sumo.network_tools.counted_demand import Count, Reached, read_counts, write_counted_demand

#: a street through a town of 5 x 5 blocks, one across it, and one beside it
COUNTS = """# an hour's afternoon
edge, begin_s, end_s, vehicles
B2C2, 0, 600, 60
C2B2, 0, 600, 20
C1C2, 0, 600, 0
C3D3, 0, 600, 35
B2C2, 600, 900, 10
"""


def town(folder: Path) -> Path:
    """A town of 5 x 5 junctions somewhere on Earth."""
    network = grid(folder, 5)
    place = "+proj=utm +zone=17 +ellps=WGS84 +datum=WGS84 +units=m +no_defs"
    network.write_text(network.read_text().replace('projParameter="!"', f'projParameter="{place}"'))
    return network


def _entered(network: str, routes: str, folder: str) -> dict[tuple[str, int], int]:
    """Vehicles that SUMO says entered an edge from its begin on or departed there, by edge and interval's begin [s]."""
    import libsumo

    additional, data = Path(folder) / "data.add.xml", Path(folder) / "edges.xml"
    bounds = (0, 600, 900, 3000)
    parts = "".join(
        f'<edgeData id="{begin}" file="{data}" begin="{begin}" end="{end}"/>' for begin, end in pairwise(bounds)
    )
    additional.write_text(f"<additional>{parts}</additional>")
    libsumo.start(["sumo", "-n", network, "-r", routes, "-a", str(additional), "--no-step-log", "true", "-e", "3000"])
    while libsumo.simulation.getMinExpectedNumber() and libsumo.simulation.getTime() < 3000:
        libsumo.simulationStep()
    libsumo.close()
    found: dict[tuple[str, int], int] = {}
    for interval in ET.parse(data).getroot():
        for edge in interval:
            number = int(edge.get("entered", 0)) + int(edge.get("departed", 0))
            found[edge.attrib["id"], int(float(interval.attrib["begin"]))] = number
    return found


def test_sumo_counts_what_was_counted(tmp_path: Path) -> None:
    network, counts, out = town(tmp_path), tmp_path / "counts.csv", tmp_path / "counted.rou.xml"
    counts.write_text(COUNTS)
    reached = write_counted_demand(network, counts, out)
    counted = [one.vehicles for one in reached]
    assert counted == pytest.approx([60, 20, 0, 35, 10], abs=1)
    assert all(one.geh < 0.5 for one in reached)
    first = out.read_bytes()
    write_counted_demand(network, counts, out)
    assert out.read_bytes() == first
    write_counted_demand(network, counts, out, seed=2)
    assert out.read_bytes() != first
    seen = isolated(_entered, str(network), str(out), str(tmp_path))
    for edge in ("B2C2", "C2B2", "C1C2", "C3D3"):
        said = sum(one.vehicles for one in reached if one.counted.edge == edge)
        assert sum(value for (name, _), value in seen.items() if name == edge) == said
    # Whoever sets out in an interval may come by in the next one.
    assert seen["B2C2", 0] == pytest.approx(60, abs=12)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (
            "edge,begin_s,end_s\nB2C2,0,600\n",
            "no column vehicles, expected a header with edge, begin_s, end_s, vehicles",
        ),
        ("", "no column edge"),
        ("edge,begin_s,end_s,vehicles\n", "expected a line for each counting place, got none"),
        ("edge,begin_s,end_s,vehicles\nB2C2,0,600,1.5\n", "line 2: expected edge"),
        ("edge,begin_s,end_s,vehicles\nB2C2,0,600\n", "line 2: expected edge"),
        ("edge,begin_s,end_s,vehicles\nB2C2,nan,600,1\n", "line 2: expected 0 <= begin_s"),
        ("edge,begin_s,end_s,vehicles\nB2C2,600,600,1\n", "line 2: expected 0 <= begin_s"),
        ("edge,begin_s,end_s,vehicles\nB2C2,0,inf,1\n", "line 2: expected 0 <= begin_s"),
        ("edge,begin_s,end_s,vehicles\nB2C2,0,600,-1\n", "line 2: expected 0 <= begin_s"),
        ("edge,begin_s,end_s,vehicles\nB2C2,0,600,1\nB2C2,500,900,1\n", "line 3: edge 'B2C2' is counted already"),
    ],
)
def test_counts_that_are_none_are_refused_in_a_line(tmp_path: Path, content: str, said: str) -> None:
    file = tmp_path / "counts.csv"
    file.write_text(content)
    with pytest.raises(ConfigError, match=f"^counts {file}.*") as raised:
        read_counts(file)
    assert said in str(raised.value)
    assert "\n" not in str(raised.value)


def test_an_edge_that_is_not_there_is_refused_before_anything_is_written(tmp_path: Path) -> None:
    network, counts, out = town(tmp_path), tmp_path / "counts.csv", tmp_path / "counted.rou.xml"
    counts.write_text("edge,begin_s,end_s,vehicles\nZ9Y9,0,600,1\n")
    with pytest.raises(ConfigError, match="there is no edge 'Z9Y9'"):
        write_counted_demand(network, counts, out)
    assert not out.exists()


@pytest.mark.parametrize(
    ("counted", "written", "geh"), [(100, 100, 0.0), (0, 0, 0.0), (1000, 900, 3.2444), (0, 8, 4.0)]
)
def test_geh_is_that_of_the_manual_in_an_hour(counted: int, written: int, geh: float) -> None:
    """The Design Manual for Roads and Bridges, volume 12, has sqrt((M - C)^2 / ((M + C) / 2))."""
    assert Reached(Count("a", 0.0, 3600.0, counted), written).geh == pytest.approx(geh, abs=1e-4)


def test_geh_is_of_flows_in_an_hour() -> None:
    assert Reached(Count("a", 0.0, 900.0, 250), 225).geh == pytest.approx(3.2444, abs=1e-4)

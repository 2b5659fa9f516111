"""The documentation's site: MkDocs builds it without a warning, and everything on it leads somewhere."""

from __future__ import annotations

import dataclasses
import os
import re
import subprocess
import sys
from collections import defaultdict
from html import unescape
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote

import nbformat
import pytest

import vve_sumo as vve
from tests.conftest import REPOSITORY
from vve_sumo.controller import Controller
from vve_sumo.pose.receivers.port import Receiver
from vve_sumo.sensors.port import Sensor
from vve_sumo.values import ControlCommand, Observation
from vve_sumo.vehicle.interface import SimulatedInterface, VehicleInterface

#: a fixture that takes long: `./check test` leaves its tests out
THOROUGH_FIXTURE = "site"


class Page(HTMLParser):
    """The anchors of a page, what its links lead to, what a browser fetches for it, and its words."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.anchors: set[str] = set()
        self.links: list[str] = []
        self.fetched: list[str] = []
        self.said = ""
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        said = {name: value or "" for name, value in attrs}
        self.anchors |= {said[name] for name in ("id", "name") if name in said}
        if "href" in said and tag == "a":
            self.links.append(said["href"])
        self.fetched += [said[name] for name in ("src", "href") if name in said and tag != "a"]

    def handle_data(self, data: str) -> None:
        self.said += data


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Page]:
    """The pages of the site by their places, built from this checkout; of its other files the places alone."""
    pytest.importorskip("mkdocs", reason="building the site needs the extra `docs`")
    folder = tmp_path_factory.mktemp("site")
    build = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(folder)]
    environment = {**os.environ, "NO_MKDOCS_2_WARNING": "1"}
    done = subprocess.run(
        build, cwd=REPOSITORY, env=environment, capture_output=True, text=True, timeout=300, check=False
    )
    assert done.returncode == 0, done.stderr
    (folder / "404.html").unlink()  # its links begin at the root of a host
    texts = {file: file.read_text(encoding="utf-8") if file.suffix == ".html" else "" for file in folder.rglob("*.*")}
    return {str(file.relative_to(folder)): Page(text) for file, text in texts.items()}


@pytest.mark.thorough
def test_every_page_of_the_repository_is_on_it(site: dict[str, Page]) -> None:
    docs = REPOSITORY / "docs"
    wanted = {str(file.relative_to(docs).with_suffix(".html")) for file in docs.rglob("*.md")}
    wanted |= {f"notebooks/{file.stem}.html" for file in (REPOSITORY / "notebooks").glob("*.ipynb")}
    wanted |= {"index.html", "contributing.html", "changelog.html", "networks.html", "routes.html"}
    assert {place for place in site if place.endswith(".html")} == wanted


def test_every_link_and_every_picture_leads_somewhere(site: dict[str, Page]) -> None:
    wrong: dict[str, list[str]] = defaultdict(list)
    for place, page in site.items():
        for link in (*page.links, *page.fetched):
            if re.match(r"[a-z]+:", link):
                continue
            file, _, anchor = unquote(link).partition("#")
            there = os.path.normpath(Path(place).parent / file) if file else place
            if there not in site or (anchor and anchor not in site[there].anchors):
                wrong[place].append(link)
    assert wrong == {}


def test_a_page_fetches_nothing_from_elsewhere(site: dict[str, Page]) -> None:
    assert [url for page in site.values() for url in page.fetched if "//" in url and not url.startswith("data:")] == []


def test_every_public_name_and_every_port_is_told_from_its_docstring(site: dict[str, Page]) -> None:
    public = {getattr(vve, name) for name in vve.__all__}
    ports = {Controller, Sensor, Receiver, VehicleInterface, SimulatedInterface}
    for page, objects in (("api.html", public), ("ports.html", ports)):
        for one in objects:
            assert f"{one.__module__}.{one.__qualname__}" in site[page].anchors
            first = str(one.__doc__).partition("\n")[0].replace("`", "")
            assert first in " ".join(site[page].said.split())


def test_every_field_of_what_a_controller_gets_and_gives_has_its_meaning_and_unit(site: dict[str, Page]) -> None:
    said = " ".join(site["ports.html"].said.split())
    for one in (Observation, ControlCommand):
        assert all(f" {field.name} " in said for field in dataclasses.fields(one))
    assert "road-wheel angle that the car reports [rad], left positive; NaN not reported" in said


def test_examples_in_docstrings_are_code_and_no_quotations(site: dict[str, Page]) -> None:
    assert '>>> run = vve.drive("parked_car", speed=12, seed=3, out="mine")' in site["api.html"].said


def test_notebooks_are_shown_whole(site: dict[str, Page]) -> None:
    for file in (REPOSITORY / "notebooks").glob("*.ipynb"):
        page = site[f"notebooks/{file.stem}.html"]
        assert f"notebooks/{file.name}" in site
        for cell in nbformat.read(file, as_version=4).cells:
            if cell.cell_type == "code":
                assert unescape(cell.source) in page.said


@pytest.mark.thorough
def test_a_notebook_that_is_run_shows_what_its_cells_put_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("mkdocs", reason="building the site needs the extra `docs`")
    import mkdocs_hooks

    cells = [
        nbformat.v4.new_markdown_cell("# A title"),
        nbformat.v4.new_code_cell("import pandas as pd\npd.DataFrame({'speed_mps': [12.5]})"),
        nbformat.v4.new_code_cell("from IPython.display import Image\nImage(b'a picture', format='png')"),
    ]
    (tmp_path / "mine.ipynb").write_text(nbformat.writes(nbformat.v4.new_notebook(cells=cells)), encoding="utf-8")
    monkeypatch.setenv("IPYTHONDIR", str(tmp_path))
    monkeypatch.setenv("JUPYTER_RUNTIME_DIR", str(tmp_path))
    assert [*mkdocs_hooks.converted(tmp_path / "mine.ipynb")] == ["mine.md"]
    monkeypatch.setenv(mkdocs_hooks.RUN, "1")
    page, picture = mkdocs_hooks.converted(tmp_path / "mine.ipynb").items()
    assert "<th>speed_mps</th>" in page[1]
    assert "<table>" in page[1]
    assert "<style" not in page[1]
    assert picture[1] == b"a picture"
    assert f"]({picture[0]})" in page[1]

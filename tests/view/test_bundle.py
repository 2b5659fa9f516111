"""The shipped build of the street in three dimensions is the one of its sources, and small."""

from __future__ import annotations

import hashlib
import json
import shutil
import subprocess
import zlib
from pathlib import Path

import pytest

from tests.isolated import REPOSITORY

SHIPPED = REPOSITORY / "vve_sumo" / "view" / "web"
SOURCES = REPOSITORY / "web"
BUNDLE = "world.min.js"
MAX_BUNDLE = 700_000  #: [bytes]
MAX_GROWTH = 1_500_000  #: of the wheel by the pages of `view` [bytes]


def test_the_hash_beside_the_build_is_its_own() -> None:
    said, name = (SHIPPED / f"{BUNDLE}.sha256").read_text(encoding="utf-8").split()
    assert name == BUNDLE
    assert hashlib.sha256((SHIPPED / BUNDLE).read_bytes()).hexdigest() == said


def test_the_sources_give_the_same_bytes(tmp_path: Path) -> None:
    node = shutil.which("node")
    if node is None or not (SOURCES / "node_modules" / "esbuild").is_dir():
        pytest.skip("Node or its packages are not installed: run npm ci in web/")
    subprocess.run([node, "build.mjs", str(tmp_path)], cwd=SOURCES, check=True, timeout=60)
    for name in (BUNDLE, f"{BUNDLE}.sha256", "three.LICENSE.txt"):
        assert (tmp_path / name).read_bytes() == (SHIPPED / name).read_bytes(), f"{name}: run node web/build.mjs"


def test_packages_are_pinned_by_hash_and_name_no_registry() -> None:
    text = (SOURCES / "package-lock.json").read_text(encoding="utf-8")
    assert "http" not in text.replace("https://github.com/sponsors", "").replace("https://opencollective.com", "")
    packages = {name: one for name, one in json.loads(text)["packages"].items() if name}
    assert {f"node_modules/{name}" for name in ("three", "esbuild", "iwer")} <= packages.keys()
    assert all(one["integrity"].startswith("sha512-") for one in packages.values())


def test_the_licence_of_what_is_shipped_stands_beside_it() -> None:
    licence = (SHIPPED / "three.LICENSE.txt").read_text(encoding="utf-8")
    assert "MIT" in licence
    assert "three.js authors" in licence
    assert "three.LICENSE.txt" in (REPOSITORY / "pyproject.toml").read_text(encoding="utf-8")


def test_the_pages_are_small() -> None:
    assert (SHIPPED / BUNDLE).stat().st_size <= MAX_BUNDLE
    files = [file for file in (REPOSITORY / "vve_sumo" / "view").rglob("*") if file.suffix != ".pyc" and file.is_file()]
    assert (SHIPPED / BUNDLE) in files
    assert sum(len(zlib.compress(file.read_bytes())) for file in files) < MAX_GROWTH

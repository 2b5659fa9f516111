"""Where a drive comes from: the hash of the code against a reckoning of its own, git against git itself."""

from __future__ import annotations

import hashlib
import json
import re
import subprocess
import tomllib
from pathlib import Path

import pytest

from tests.drive.street import REPOSITORY, drive_once
from tests.isolated import isolated
from vve_sumo.drive.provenance import _checkout, changed_since, code_sha256, libraries, software
from vve_sumo.record.hashes import hash_parts


def package(folder: Path) -> Path:
    """A small package."""
    inside = folder / "package"
    (inside / "room").mkdir(parents=True)
    (inside / "__init__.py").write_text("", encoding="utf-8")
    (inside / "room" / "a.py").write_text("x = 1\n", encoding="utf-8")
    (inside / "room" / "car.dbc").write_text("VERSION\n", encoding="utf-8")
    return inside


def test_the_hash_is_that_of_names_and_bytes(tmp_path: Path) -> None:
    short_repr = b"11:__init__.py0:" + b"9:room/a.py6:x = 1\n" + b"12:room/car.dbc8:VERSION\n"
    assert code_sha256(package(tmp_path)) == hashlib.sha256(short_repr).hexdigest()


def test_what_decides_changes_the_hash_and_nothing_else_does(tmp_path: Path) -> None:
    inside = package(tmp_path)
    before = code_sha256(inside)
    (inside / "shipped" / "controllers").mkdir(parents=True)
    (inside / "shipped" / "controllers" / "mine.py").write_text("x = 1\n", encoding="utf-8")
    (inside / "room" / "__pycache__").mkdir()
    (inside / "room" / "__pycache__" / "a.pyc").write_bytes(b"x")
    (inside / "room" / "page.css").write_text("", encoding="utf-8")
    assert code_sha256(inside) == before
    (inside / "room" / "a.py").rename(inside / "room" / "b.py")
    renamed = code_sha256(inside)
    (inside / "room" / "car.dbc").write_text("VERSION 2\n", encoding="utf-8")
    assert len({before, renamed, code_sha256(inside)}) == 3


def git(folder: Path, *arguments: str) -> str:
    """Run git in a folder."""
    who = ("-c", "user.name=a", "-c", "user.email=a@b", "-c", "commit.gpgsign=false")
    run = subprocess.run(["git", *who, *arguments], cwd=folder, capture_output=True, text=True, check=True)
    return run.stdout.strip()


def test_a_checkout_tells_its_commit_and_whether_it_was_changed(tmp_path: Path) -> None:
    inside = package(tmp_path)
    assert _checkout(inside) == {"git_commit": None, "git_dirty": None}
    git(tmp_path, "init", "-q")
    assert _checkout(inside) == {"git_commit": None, "git_dirty": None}, "no commit yet"
    git(tmp_path, "add", "package")
    git(tmp_path, "commit", "-q", "-m", "one")
    head = git(tmp_path, "rev-parse", "HEAD")
    (tmp_path / "beside.txt").write_text("no code\n", encoding="utf-8")
    assert _checkout(inside) == {"git_commit": head, "git_dirty": False}
    (inside / "new.py").write_text("", encoding="utf-8")
    assert _checkout(inside) == {"git_commit": head, "git_dirty": True}
    (inside / "new.py").unlink()
    (inside / "room" / "a.py").write_text("x = 2\n", encoding="utf-8")
    assert _checkout(inside) == {"git_commit": head, "git_dirty": True}


def test_a_package_installed_under_another_checkout_is_not_of_its_commit(tmp_path: Path) -> None:
    git(tmp_path, "init", "-q")
    inside = package(tmp_path / ".venv")
    git(tmp_path, "add", "-A")
    git(tmp_path, "commit", "-q", "-m", "one")
    assert _checkout(inside) == {"git_commit": None, "git_dirty": None}


def test_without_git_there_is_no_commit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    inside = package(tmp_path)
    git(tmp_path, "init", "-q")
    monkeypatch.setenv("PATH", str(tmp_path))
    assert _checkout(inside) == {"git_commit": None, "git_dirty": None}


def test_every_library_that_is_declared_has_its_version() -> None:
    project = tomllib.loads((REPOSITORY / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    declared = {re.split(r"[<>=~!; ]", line)[0] for line in project["dependencies"]}
    assert libraries().keys() == declared
    assert libraries()["libsumo"] == "1.28.0"


def test_what_has_changed_since_is_a_line_each() -> None:
    reported = json.loads(json.dumps(software()))
    assert changed_since(reported) == []
    reported["libraries"]["pyarrow"], reported["proj"], reported["code"]["sha256"] = "1.0", "5.0", "0"
    now = software()
    assert changed_since(reported) == [
        "the code of vve-sumo has changed since",
        f"proj was 5.0, is {now['proj']}",
        f"pyarrow was 1.0, is {now['libraries']['pyarrow']}",
    ]
    assert changed_since({})[0] == "the code of vve-sumo has changed since"
    assert changed_since({"code": 1, "libraries": [], "python": {}})[0] == "the code of vve-sumo has changed since"


def test_the_record_tells_it_and_its_hash_does_not_hang_on_it(tmp_path: Path) -> None:
    folder = tmp_path / "r"
    summary = isolated(drive_once, {"duration_s": 1.0}, str(folder))
    reported = json.loads((folder / "provenance.json").read_text(encoding="utf-8"))
    assert reported["code"] == software()["code"]
    assert reported["libraries"] == libraries()
    scenario = (REPOSITORY / "scenarios" / "parked_car.toml").read_bytes()
    assert reported["scenario_file_sha256"] == hashlib.sha256(scenario).hexdigest()
    assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\+00:00", reported["began_utc"])
    assert reported["host"]["machine"]
    (folder / "provenance.json").write_text("{}", encoding="utf-8")
    assert hash_parts(folder) == summary["record_parts_sha256"]

"""The command that shows records, and the same from Python."""

from __future__ import annotations

import html
import json
import os
import re
import signal
import subprocess
import sys
import threading
import urllib.request
from pathlib import Path

import pytest

import vve_sumo as vve
from tests.conftest import REPOSITORY
from tests.isolated import command
from tests.report.made import driven
from vve_sumo.errors import ConfigError
from vve_sumo.live.view_token import token_of
from vve_sumo.rig.connections import RigView
from vve_sumo.view.library import Library


@pytest.fixture(scope="module")
def record(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return driven(tmp_path_factory, tmp_path_factory.mktemp("shown") / "record")


def content(address: str) -> bytes:
    with urllib.request.urlopen(address, timeout=10.0) as answer:
        return bytes(answer.read())


@pytest.mark.thorough
def test_the_command_serves_until_it_is_interrupted(record: Path) -> None:
    with subprocess.Popen(
        [sys.executable, "-m", "vve_sumo.cli", "view", "record"],
        cwd=record.parent, env=os.environ | {"PYTHONPATH": str(REPOSITORY)}, stdout=subprocess.PIPE, text=True,
    ) as process:  # fmt: skip
        assert process.stdout is not None
        found = re.fullmatch(r"view: (http://127\.0\.0\.1:\d+/[\w-]{20,}/)\n", process.stdout.readline())
        assert found
        assert b"main.js" in content(found[1])
        process.send_signal(signal.SIGINT)
        process.stdout.read()
        assert process.wait(10.0) == 0


@pytest.mark.thorough
def test_one_file_is_written(record: Path, tmp_path: Path) -> None:
    done = command("view", str(record), "--html", "page.html", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert page.startswith("<!doctype html>")
    assert 'src="' not in page.split('id="vve-data"')[0]


@pytest.mark.thorough(witnesses=2)
@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        ((), "expected the folder of a record or a sweep, or --live"),
        (("nowhere",), "nowhere: not there; expected a drive's record"),
        (("record", "record", "record"), "expected one or two folders, got 3"),
        (("record", "--port", "70000"), "--port: expected 0 to 65535, got 70000"),
        (("--live", "record", "--html", "x"), "--live: expected at most the folder of one drive, and no --html"),
        (("--live",), "runs: no live drive with a page is running there"),
    ],
)
def test_what_cannot_be_shown_is_one_line(record: Path, arguments: tuple[str, ...], expected: str) -> None:
    done = command("view", *arguments, cwd=record.parent)
    assert done.returncode == 2
    assert expected in done.stderr
    assert done.stderr.count("\n") == 1


def test_only_a_live_drive_is_shown_while_it_goes_on(tmp_path: Path) -> None:
    done = command("drive", "--view", cwd=tmp_path)
    assert done.returncode == 2
    assert "--view: only a live drive has a page while it runs" in done.stderr
    assert list(tmp_path.iterdir()) == []


def test_the_address_of_a_drive_that_is_gone_is_not_printed(tmp_path: Path) -> None:
    folder = tmp_path / "runs" / "old"
    folder.mkdir(parents=True)
    with subprocess.Popen([sys.executable, "-c", ""]) as gone:
        gone.wait()
    (folder / "view.json").write_text(json.dumps({"address": "http://127.0.0.1:1/x/", "pid": gone.pid}))
    assert command("view", "--live", cwd=tmp_path).returncode == 2
    (folder / "view.json").write_text(json.dumps({"address": "http://127.0.0.1:1/x/", "pid": os.getpid()}))
    assert command("view", "--live", cwd=tmp_path).stdout == "http://127.0.0.1:1/x/\n"


@pytest.mark.thorough
def test_a_notebook_shows_the_page_in_its_cell(record: Path) -> None:
    threads = threading.active_count()
    shown = vve.load(record).view()
    (page,) = re.findall(r'^<iframe srcdoc="([^"]*)" ', shown._repr_html_())
    assert html.unescape(page) == Library([record]).page()
    assert str(record) in repr(shown)
    assert threading.active_count() == threads  # nothing is served


def test_a_rigs_token_is_read_and_judged(tmp_path: Path) -> None:
    assert token_of(RigView(), tmp_path) == ""
    (tmp_path / "token").write_text("abcdefghij-0123456789\n")
    assert token_of(RigView(token_file="token"), tmp_path) == "abcdefghij-0123456789"
    for wrong in ("short", "x" * 200, "with a space and more", "slash/slash/slash/slash"):
        (tmp_path / "token").write_text(wrong)
        with pytest.raises(ConfigError, match=r"view\.token_file: .*expected 16 to 128"):
            token_of(RigView(token_file="token"), tmp_path)
    with pytest.raises(ConfigError, match=r"view\.token_file: .*cannot be read"):
        token_of(RigView(token_file="none"), tmp_path)


@pytest.mark.parametrize("everywhere", ["0.0.0.0", "::"])
def test_a_rig_may_not_listen_on_every_network(everywhere: str) -> None:
    with pytest.raises(ValueError, match="expected this computer's address"):
        RigView(address=everywhere)

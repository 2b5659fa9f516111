"""Every command that the documentation shows is one that the command line takes, and every file it names is there."""

from __future__ import annotations

import contextlib
import io
import re
import shlex
from collections.abc import Iterator
from pathlib import Path

import pytest

from vve_sumo.cli.dispatch import parser as whole_parser

REPOSITORY = Path(__file__).parent.parent
PAGES = sorted([*REPOSITORY.glob("*.md"), *REPOSITORY.glob("docs/**/*.md"), *REPOSITORY.glob("n*/*.md")])
#: of the folders of this repository, the files that a page may name
FILE = re.compile(
    r"(?<![\w/.<-])(?:benchmarks|networks|routes|scenarios|sweeps|rigs|vehicles|controllers)/[\w./-]+\.\w+"
)
#: that a reader writes, or a program makes
OF_THE_READER = re.compile(r"/(?:mine\w*|ours\w*|my_\w+|our_\w+|your\w*|leader|NAME|scenario\.schema)\b")
#: complaints about a command of which a page shows a part alone
IN_PART = (
    "the following arguments are required",
    "expected one argument",
    "expected at least one argument",
    "expected 2 arguments",
    "invalid choice: 'SHELL'",
)


def commands(page: Path) -> Iterator[str]:
    """Yield the commands of a page: whole lines of its blocks, and what stands between backticks."""
    text = page.read_text(encoding="utf-8")
    for block in re.findall(r"```(?:sh|bash|console|text)?\n(.*?)```", text, re.DOTALL):
        for line in block.replace("\\\n", " ").splitlines():
            yield line.strip().removeprefix("$ ").partition("   ")[0]  # what a command does may stand beside it
    outside = re.sub(r"```.*?```", "", text, flags=re.DOTALL)
    yield from re.findall(r"`([^`\n]+)`", outside)


def words(command: str) -> list[str]:
    """Return the words of a command as far as the first that a shell would take for itself."""
    said = shlex.split(command, comments=True)
    return said[: next((at for at, word in enumerate(said) if word in ("&&", "|", ">", ">>", ";", "&")), len(said))]


def is_whole(said: list[str]) -> bool:
    """Whether a command is meant to be typed: not a name alone, nor one with parts left out."""
    whole = len(said) > 1 and not any("…" in word or "..." in word or word.startswith(("[", "<")) for word in said)
    return whole and said[0] == "vve-sumo"


def test_the_pages_show_commands() -> None:
    assert sum(is_whole(words(line)) for page in PAGES for line in commands(page) if line.startswith("vve-sumo")) > 60


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_command_is_taken(page: Path) -> None:
    parser, wrong = whole_parser(), []
    for line in commands(page):
        if not line.startswith("vve-sumo ") or not is_whole(said := words(line)):
            continue
        complaint = io.StringIO()
        try:
            with contextlib.redirect_stderr(complaint), contextlib.redirect_stdout(complaint):
                parser.parse_args([re.sub(r"^N$", "1", word) for word in said[1:]])
        except SystemExit as ended:
            if ended.code and not any(part in complaint.getvalue() for part in IN_PART):
                wrong.append(f"{line}: {complaint.getvalue().strip()}")
    assert wrong == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_file_is_there(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    named = {path for path in FILE.findall(text) if not OF_THE_READER.search(path)}
    named |= set(re.findall(r"python ((?:benchmarks|tests)/[\w/]+\.py)", text))
    modules = re.findall(r"python -m ((?:tests|benchmarks)(?:\.\w+)*)", text)
    missing = [path for path in sorted(named) if not any((root / path).exists() for root in (REPOSITORY, page.parent))]
    places = [REPOSITORY / module.replace(".", "/") for module in modules]
    missing += [str(place) for place in places if not (place.is_dir() or place.with_suffix(".py").exists())]
    assert missing == []


def test_a_recorded_speed_is_found_by_name_under_routes_and_by_file_beside_the_scenario(tmp_path: Path) -> None:
    """As docs/traffic.md says."""
    from vve_sumo import workspace

    (block,) = re.findall(r'speeds = "(\w+)"\s+# (\S+);', (REPOSITORY / "docs/traffic.md").read_text(encoding="utf-8"))
    name, file = block
    (tmp_path / "routes").mkdir()
    (tmp_path / file).write_text("time_s,speed_mps\n", encoding="utf-8")
    assert workspace.find("speeds", name, tmp_path) == tmp_path / file

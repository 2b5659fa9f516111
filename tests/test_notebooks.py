"""The notebooks: stripped in git; run by a fresh kernel from an empty folder they show figures, and numbers of records.

`python -m tests.test_notebooks` strips them.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import nbformat
import numpy as np
import pytest
from nbclient import NotebookClient
from nbformat import NotebookNode

from tests.conftest import REPOSITORY
from tests.isolated import command
from tests.pose import recordings
from vve_sumo.analysis import load
from vve_sumo.laws import stopping_distance

FOLDER = REPOSITORY / "notebooks"
NAMES = ("1_paper_drive", "2_stopping_over_a_sweep", "3_latency_cliff", "4_real_recording", "5_two_controllers")
#: what a notebook says of itself in git, whoever ran it
METADATA = {
    "kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"},
    "language_info": {"name": "python"},
}


def read(name: str) -> NotebookNode:
    """Read a shipped notebook."""
    return nbformat.read(FOLDER / f"{name}.ipynb", as_version=4)


def stripped(book: NotebookNode) -> str:
    """The text of a notebook without what running it leaves."""
    book = nbformat.from_dict({**book, "metadata": METADATA})
    for cell in book.cells:
        cell["metadata"] = {}
        if cell.cell_type == "code":
            cell["outputs"], cell["execution_count"] = [], None
    return nbformat.writes(book) + "\n"


def run(name: str, folder: Path, patch: pytest.MonkeyPatch, other: tuple[str, str] = ("", "")) -> NotebookNode:
    """Run a notebook in an empty folder and return it with its outputs, among which no warning may be.

    `other` is a line of it and what stands there instead.
    """
    for place in ("IPYTHONDIR", "JUPYTER_RUNTIME_DIR"):
        patch.setenv(place, str(folder / place))
    (folder / "nb").mkdir()
    book = read(name)
    for cell in book.cells:
        cell["source"] = "\n".join(other[1] if line == other[0] else line for line in cell.source.split("\n"))
    client = NotebookClient(
        book, timeout=300, kernel_name="python3", resources={"metadata": {"path": str(folder / "nb")}}
    )
    client.execute()
    warnings = [output.text for output in outputs(book) if output.get("name") == "stderr"]
    assert [text for text in warnings if "font cache" not in text] == []  # that one is of a machine's first plot
    return book


def outputs(book: NotebookNode) -> list[Any]:
    """All that the cells of a notebook put out."""
    return [output for cell in book.cells if cell.cell_type == "code" for output in cell.outputs]


def figures(book: NotebookNode) -> int:
    """How many pictures a notebook shows, by themselves or within what a drive or a sweep shows of itself."""
    shown = [output.get("data", {}) for output in outputs(book)]
    return sum("image/png" in data or "data:image/png" in data.get("text/html", "") for data in shown)


def said(book: NotebookNode) -> str:
    """All that the outputs say in plain text."""
    return "\n".join(output.get("text") or output.get("data", {}).get("text/plain", "") for output in outputs(book))


def numbers(pattern: str, text: str) -> list[float]:
    """The numbers that stand where `#` does in a sentence of the outputs."""
    found = re.search(re.escape(pattern).replace(r"\#", r"(-?\d+(?:\.\d+)?)"), text)
    assert found, f"{pattern!r} is not said"
    return [float(number) for number in found.groups()]


def summary(folder: Path, outcome: str) -> dict[str, Any]:
    """What the summary of the only drive with an outcome says that a notebook has left."""
    said = [json.loads(file.read_text(encoding="utf-8")) for file in (folder / "nb" / "runs").glob("*/summary.json")]
    (found,) = (one for one in said if one["outcome"] == outcome)
    return found


def test_all_notebooks_are_tested() -> None:
    assert tuple(sorted(file.stem for file in FOLDER.glob("*.ipynb"))) == NAMES


@pytest.mark.parametrize("name", NAMES)
def test_a_notebook_is_stripped_and_explains_itself(name: str) -> None:
    book = read(name)
    nbformat.validate(book)
    assert (FOLDER / f"{name}.ipynb").read_text(encoding="utf-8") == stripped(book)
    kinds = [cell.cell_type for cell in book.cells]
    assert kinds[0] == kinds[-1] == "markdown"
    assert kinds.count("markdown") * 2 >= kinds.count("code")
    assert all(len(cell.source.splitlines()) <= 16 for cell in book.cells if cell.cell_type == "code")


@pytest.mark.thorough
def test_the_papers_drive(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    book = run("1_paper_drive", tmp_path, monkeypatch)
    assert figures(book) == 3
    reported = summary(tmp_path, "stopped")
    sentence = "From # m/s to rest in # m, # m behind the parked car."
    speed, distance, gap = numbers(sentence, said(book))
    assert speed == pytest.approx(reported["stop_onset_speed_mps"], abs=0.0051)
    assert distance == pytest.approx(reported["stop_distance_m"], abs=0.0051)
    assert gap == pytest.approx(reported["stop_gap_m"], abs=0.0051)


@pytest.mark.slow
def test_a_sweep(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    book = run("2_stopping_over_a_sweep", tmp_path, monkeypatch)
    assert figures(book) == 3
    rows, reported = load(tmp_path / "nb" / "runs" / "stopping").rows(), said(book)
    assert len(rows) == 12
    for row in rows.itertuples():
        assert f"{row.stop_distance_m:.2f}" in reported
        assert row.collision or f"{row.stop_gap_m:.2f}" in reported
    stopped = rows[rows["outcome"].eq("stopped")]
    assert len(stopped) == 10
    asked = zip(stopped["stop_onset_speed_mps"], stopped["controller.tuning.deceleration_m_s2"], strict=True)
    by_hand = np.array([stopping_distance(speed, braked, 0.04, braked / 4.0) for speed, braked in asked])
    assert (np.abs(stopped["stop_distance_m"] - by_hand) < 0.02 * stopped["stop_onset_speed_mps"]).all()


@pytest.mark.slow
def test_the_latency_cliff(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    book = run("3_latency_cliff", tmp_path, monkeypatch)
    assert figures(book) == 1
    cost, closed_form = numbers("each 100 ms of hidden delay cost # m; speed times delay is # m", said(book))
    rows = load(tmp_path / "nb" / "runs" / "cliff").rows()
    gaps = dict(zip(rows["ego.car.gnss_hidden_delay_s"], rows["stop_gap_m"], strict=True))
    assert cost == pytest.approx((gaps[0.0] - gaps[0.3]) / 3.0, abs=0.02)
    assert cost == pytest.approx(closed_form, abs=0.05) == pytest.approx(0.1 * 13.9, abs=0.05)
    (declared,) = numbers("70 ms more of declared delay cost # m", said(book))
    assert abs(declared) <= 0.05


@pytest.mark.thorough
def test_a_recording(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("VVE_RECORDING", raising=False)
    book = run("4_real_recording", tmp_path, monkeypatch)
    assert "no real recording" in said(book)
    assert figures(book) == 2
    reported = summary(tmp_path, "played")
    mean, most = numbers("predicted, it was off by # m on average, # m at most", said(book))
    assert mean == pytest.approx(reported["prediction_error_100ms_mean_m"], abs=0.00051)
    assert most == pytest.approx(reported["prediction_error_100ms_max_m"], abs=0.00051)


@pytest.mark.slow
def test_a_real_recording(tmp_path: Path, shared_data: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The first 12 s of a minute in California: it drives through the car that brakes ahead, for nobody obeys."""
    whole = recordings.comma2k19(shared_data, tmp_path / "whole.csv").read_text(encoding="utf-8").splitlines()
    (tmp_path / "comma.csv").write_text("\n".join(whole[:241]), encoding="utf-8")
    monkeypatch.setenv("VVE_RECORDING", str(tmp_path / "comma.csv"))
    book = run("4_real_recording", tmp_path, monkeypatch)
    assert "comma.csv: taken for a real recording" in said(book)
    reported = summary(tmp_path, "played")
    assert reported["collision"]
    held, mean = numbers("off by # m on average (speed times age);\npredicted, it was off by # m", said(book))
    assert mean == pytest.approx(reported["prediction_error_100ms_mean_m"], abs=0.00051)
    assert mean < 0.05 * held


@pytest.mark.slow
def test_two_controllers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With 36 drives instead of 200; four plots in fewer than 40 lines of code."""
    book = run("5_two_controllers", tmp_path, monkeypatch, ("points = 5", "points = 3"))
    assert figures(book) == 4
    code = [line for cell in book.cells if cell.cell_type == "code" for line in cell.source.splitlines()]
    assert len(code) < 40
    rows, reported = load(tmp_path / "nb" / "runs" / "controllers").rows(), said(book)
    assert len(rows) == 36
    for name, part in rows.groupby("controller.name"):
        (line,) = (line for line in reported.splitlines() if str(name) in line)
        apart = part["stop_gap_m"][~part["collision"]]  # an overlap is no gap at rest
        assert line.split()[2:5] == ["18", str(part["collision"].sum()), str(apart.notna().sum())]
        assert f"{apart.mean():.2f}" in line
    hardest = rows[rows["controller.tuning.deceleration_m_s2"].eq(3.5)]
    regulated = rows[rows["controller.tuning.stop_deceleration_m_s2"].eq(3.0)]
    on = ["ego.speed_mps", "ego.car.gnss_hidden_delay_s"]
    pairs = hardest.merge(regulated, on=on)
    alone = int((pairs["passed_x"].eq(False) & pairs["passed_y"].eq(True)).sum())
    (line,) = (line for line in reported.splitlines() if line.startswith("passed"))
    assert line.split()[3] == str(alone)


def test_copies_are_the_notebooks_and_nothing_is_replaced(tmp_path: Path) -> None:
    done = command("notebooks", "mine", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "pip install 'vve-sumo[notebooks]' && jupyter lab mine" in done.stdout
    copies = sorted((tmp_path / "mine").rglob("*"))
    assert [copy.stem for copy in copies] == list(NAMES)
    assert all(copy.read_bytes() == (FOLDER / copy.name).read_bytes() for copy in copies)
    copies[0].write_text("mine", encoding="utf-8")
    for other in copies[1:]:
        other.unlink()
    again = command("notebooks", "mine", cwd=tmp_path)
    assert again.returncode == 2
    assert "1_paper_drive.ipynb is there already" in again.stderr
    assert [file.read_text(encoding="utf-8") for file in (tmp_path / "mine").iterdir()] == ["mine"]


if __name__ == "__main__":
    for name in NAMES:
        (FOLDER / f"{name}.ipynb").write_text(stripped(read(name)), encoding="utf-8")

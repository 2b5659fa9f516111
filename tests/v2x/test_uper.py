"""The ASN.1 modules: compiled once, for each message its own, and only where their compiler is installed."""

from __future__ import annotations

import re
import subprocess
import sys
from importlib import import_module

import pytest

from tests.conftest import REPOSITORY
from vve_sumo.errors import ConfigError
from vve_sumo.v2x import uper

#: a message of each kind, by the module that encodes it and tests it
SAMPLES = {"cam": "CAR", "denm": "EVENT", "vam": "CYCLIST", "cpm": "MESSAGE"}


def test_without_asn1tools_one_line_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    uper.specification.cache_clear()
    monkeypatch.setitem(sys.modules, "asn1tools", None)
    with pytest.raises(ConfigError, match=r"pip install 'vve-sumo\[v2x\]'"):
        uper.encode("CAM", {})


def test_importing_the_codecs_compiles_nothing() -> None:
    done = "import sys; from vve_sumo.v2x import cam, geonetworking; assert 'asn1tools' not in sys.modules"
    subprocess.run([sys.executable, "-c", done], check=True, timeout=60)


@pytest.mark.thorough
@pytest.mark.parametrize("message", SAMPLES)
def test_a_message_has_the_same_bytes_whichever_others_are_compiled(message: str) -> None:
    """Messages share the parsed dictionary: a process that compiles one alone stands against this one, with all."""
    for one in uper.MODULES:
        uper.specification(one)
    ours = import_module(f"vve_sumo.v2x.{message}").encode(
        getattr(import_module(f"tests.v2x.test_{message}"), SAMPLES[message])
    )
    sample = f"from tests.v2x.test_{message} import {SAMPLES[message]} as one; from vve_sumo.v2x import {message}"
    command = [sys.executable, "-c", f"{sample}; print({message}.encode(one).hex())"]
    alone = subprocess.run(command, check=True, capture_output=True, text=True, cwd=REPOSITORY, timeout=60).stdout
    assert bytes.fromhex(alone) == ours


def test_the_page_s_example_runs() -> None:
    page = (REPOSITORY / "docs" / "v2x.md").read_text(encoding="utf-8")
    (example,) = re.findall(r"```python\n(.*?)```", page, re.S)
    exec(example, {})


def test_the_modules_are_licensed() -> None:
    licence = (uper.FOLDER / "LICENSE.txt").read_text(encoding="utf-8")
    assert "Copyright 2019 ETSI" in licence
    named = {line.split()[0] for line in licence.splitlines() if line.split(" ")[0].endswith(".asn")}
    shipped = {file.name for file in uper.FOLDER.glob("*.asn")}
    assert shipped == {file for files in uper.MODULES.values() for file in files}
    assert {name for name in shipped if not name.startswith("CPM-")} | {"CPM-*.asn"} == named

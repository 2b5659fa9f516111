"""The ASN.1 modules: compiled once, for each message its own, and only where their compiler is installed."""

from __future__ import annotations

import subprocess
import sys

import pytest

from vve_sumo.errors import ConfigError
from vve_sumo.v2x import uper


def test_without_asn1tools_one_line_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    uper.specification.cache_clear()
    monkeypatch.setitem(sys.modules, "asn1tools", None)
    with pytest.raises(ConfigError, match=r"pip install 'vve-sumo\[v2x\]'"):
        uper.encode("CAM", {})


def test_importing_the_codecs_compiles_nothing() -> None:
    done = "import sys; from vve_sumo.v2x import cam, geonetworking; assert 'asn1tools' not in sys.modules"
    subprocess.run([sys.executable, "-c", done], check=True, timeout=60)


@pytest.mark.parametrize("message", uper.MODULES)
def test_messages_that_share_a_dictionary_are_compiled_as_alone(message: str) -> None:
    import asn1tools

    together = uper.specification(message)
    texts = "\n".join((uper.FOLDER / file).read_text(encoding=uper.ENCODING) for file in uper.MODULES[message])
    alone = asn1tools.compile_string(texts, "uper")
    assert together.types.keys() == alone.types.keys()
    assert repr(together.types[message]) == repr(alone.types[message])


def test_the_modules_are_licensed() -> None:
    licence = (uper.FOLDER / "LICENSE.txt").read_text(encoding="utf-8")
    assert "Copyright 2019 ETSI" in licence
    named = {line.split()[0] for line in licence.splitlines() if line.split(" ")[0].endswith(".asn")}
    shipped = {file.name for file in uper.FOLDER.glob("*.asn")}
    assert shipped == {file for files in uper.MODULES.values() for file in files}
    assert {name for name in shipped if not name.startswith("CPM-")} | {"CPM-*.asn"} == named

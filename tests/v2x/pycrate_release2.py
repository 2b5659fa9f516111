"""ETSI's release 2 as pycrate compiles it: a second encoder and decoder of the same ASN.1 files.

What is compared with it is how asn1tools reads those files and packs bits. That the files are those of the standards,
and that a field means what we take it for, no comparison with it can show.
"""

from __future__ import annotations

import importlib.util
import json
import re
import subprocess
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from tests.once import once
from vve_sumo.v2x import uper

#: what pycrate cannot parse or verify, and what stands for the same encoding: the span of a union of values, and a size
#: that is narrowed within an extensible one, of a polygon, which no message here has
_SAME = {"(unknown|passengerCar..tram|agricultural)": "(0..14)", "(SIZE(3..16,...))": ""}
_COMPILE = """
import json, sys
from pycrate_asn1c.asnproc import PycrateGenerator, compile_text, generate_modules
texts = json.load(sys.stdin)
compile_text(list(texts.values()), filenames=list(texts))
generate_modules(PycrateGenerator, sys.argv[1])
"""


def compiled(factory: pytest.TempPathFactory) -> ModuleType:
    """Return the module that pycrate generates of all files, generated once in a session."""
    file = once(factory, "pycrate_release2", _generate) / "etsi_release2.py"
    spec = importlib.util.spec_from_file_location("etsi_release2", file)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def _generate(folder: Path) -> None:
    folder.mkdir()
    names = sorted({file for files in uper.MODULES.values() for file in files})
    texts = {name: _parsable((uper.FOLDER / name).read_text(encoding=uper.ENCODING)) for name in names}
    command = [sys.executable, "-c", _COMPILE, str(folder / "etsi_release2.py")]
    subprocess.run(command, input=json.dumps(texts), text=True, check=True, capture_output=True, timeout=600)


def _parsable(text: str) -> str:
    """Return the text without comments and WITH COMPONENT(S), on which the encoding does not depend (X.691, 10.3)."""
    text = re.sub(r"/\*.*?\*/", "", text, flags=re.S)
    while found := re.search(r"\((\s*\()*\s*WITH COMPONENT", text):
        depth, end = 0, found.start()
        while True:
            depth += {"(": 1, ")": -1}.get(text[end], 0)
            end += 1
            if depth == 0:
                break
        text = text[: found.start()] + text[end:]
    for theirs, ours in _SAME.items():
        text = text.replace(theirs, ours)
    return text


def read_and_made_again(kind: Any, data: bytes) -> Any:
    """Return what pycrate reads of a message; fail unless it makes the same bytes of that again."""
    kind.from_uper(data)
    content = kind.get_val()
    kind.set_val(content)
    assert kind.to_uper() == data
    return content

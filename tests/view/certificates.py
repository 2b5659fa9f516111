"""A certificate for the loopback, made by the command that docs/world.md has for a headset."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[2] / "docs" / "world.md"


def certificate_in(folder: Path) -> list[str]:
    """Make a certificate and its key in a folder; return their files."""
    if shutil.which("openssl") is None:
        pytest.skip("openssl is not installed")
    command = re.search(r"^openssl req (?:.*\\\n)*.*", DOCS.read_text(encoding="utf-8"), re.M)
    assert command is not None
    here = command[0].replace("192.168.1.5", "127.0.0.1")
    subprocess.run(["bash", "-c", here], cwd=folder, check=True, capture_output=True)
    return [str(folder / "view-cert.pem"), str(folder / "view-key.pem")]

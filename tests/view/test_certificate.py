"""The page over HTTPS with a certificate of one's own, as docs/world.md makes one: a headset asks for it."""

from __future__ import annotations

import http.client
import re
import shutil
import ssl
import subprocess
import urllib.request
from pathlib import Path
from typing import NamedTuple

import pytest
from pydantic import ValidationError

from tests.view.conftest import serving
from vve_sumo.errors import ConfigError
from vve_sumo.live.view_token import certificate_of
from vve_sumo.rig.schema import RigView
from vve_sumo.view.server import NO_FRAMES, PageServer, page_routes


class Made(NamedTuple):
    certificate: Path
    key: Path


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Made:
    if shutil.which("openssl") is None:
        pytest.skip("openssl is not installed")
    folder = tmp_path_factory.mktemp("certificate")
    command = re.search(
        r"^openssl req (?:.*\\\n)*.*", (Path(__file__).parents[2] / "docs" / "world.md").read_text(), re.M
    )
    assert command is not None
    here = command[0].replace("192.168.1.5", "127.0.0.1")
    subprocess.run(["bash", "-c", here], cwd=folder, check=True, capture_output=True)
    return Made(folder / "view-cert.pem", folder / "view-key.pem")


def test_the_page_is_served_over_https_alone(made: Made) -> None:
    with serving(PageServer(page_routes(NO_FRAMES), certificate=[str(made.certificate), str(made.key)])) as server:
        assert server.address.startswith("https://127.0.0.1:")
        trusting = ssl.create_default_context(cafile=str(made.certificate))
        connection = http.client.HTTPSConnection("127.0.0.1", server.port, timeout=10.0, context=trusting)
        connection.request("GET", f"/{server.token}/world.min.js", headers={"Host": f"127.0.0.1:{server.port}"})
        assert connection.getresponse().status == 200
        connection.close()
        with pytest.raises(OSError, match=r"."):
            urllib.request.urlopen(f"http://127.0.0.1:{server.port}/{server.token}/", timeout=10.0)


def test_a_certificate_that_cannot_be_used_is_named(made: Made, tmp_path: Path) -> None:
    for certificate, key in (
        (made.key, made.key),
        (made.certificate, tmp_path / "nowhere.pem"),
        (tmp_path / "nowhere.pem", made.key),
    ):
        with pytest.raises(ConfigError, match=re.escape(f"view: {certificate} and {key}: expected a certificate")):
            PageServer(page_routes(NO_FRAMES), certificate=[str(certificate), str(key)])


def test_a_rig_names_both_files_or_neither(tmp_path: Path) -> None:
    named = RigView(certificate_file="view-cert.pem", key_file="view-key.pem")
    assert certificate_of(named, tmp_path) == (str(tmp_path / "view-cert.pem"), str(tmp_path / "view-key.pem"))
    assert certificate_of(RigView(), tmp_path) == ()
    with pytest.raises(ValidationError, match="expected both or neither"):
        RigView(certificate_file="view-cert.pem")

"""The page over HTTPS with a certificate of one's own, as docs/world.md makes one: a headset asks for it."""

from __future__ import annotations

import http.client
import re
import ssl
import urllib.request
from pathlib import Path
from typing import NamedTuple

import pytest
from pydantic import ValidationError

from tests.view.certificates import certificate_in
from tests.view.conftest import serving
from vve_sumo.errors import ConfigError
from vve_sumo.live.view_token import certificate_of
from vve_sumo.rig.connections import RigView
from vve_sumo.view.server import NO_FRAMES, PageServer, page_routes


class Made(NamedTuple):
    certificate: Path
    key: Path


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Made:
    certificate, key = certificate_in(tmp_path_factory.mktemp("certificate"))
    return Made(Path(certificate), Path(key))


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

"""A hundred wrong command lines: each is exit code 2 and one line, without a traceback, and nothing is written."""

from __future__ import annotations

import gzip
import shlex
from pathlib import Path

import pytest

from vve_sumo.cli.dispatch import main


def _gzipped(text: str, kept: float) -> str:
    """The beginning of a gzip file of a text, as a text that `surrogateescape` turns into its bytes."""
    whole = gzip.compress(text.encode())
    return whole[: int(kept * len(whole))].decode(errors="surrogateescape")


#: a network's head with a projection whose grid nobody has
BENT = (
    '<net><location netOffset="0,0" convBoundary="0,0,1,1" '
    'projParameter="+proj=utm +zone=17 +nadgrids=absent.gsb"/></net>'
)
ROUTES = f"<routes>{''.join(f'<!-- {number} -->' for number in range(999))}</routes>"
#: files that lie in the working folder, by their names
FILES = {
    "empty.toml": "",
    "torn.toml": "title = [",
    "wrong.toml": "title = 3\n",
    "latin.toml": "title = 'caf\udce9'\n",
    "no_make.py": "x = 1\n",
    "raises.py": "raise RuntimeError('here')\n",
    "syntax.py": "def make(:\n",
    "text.csv": "a,b\n1\n",
    "noise.bin": "\x00\x01\x02" * 40,
    "summary/summary.json": "{}",
    "full/file.txt": "something else",
    "scenarios/mine.toml": "title = 'mine'\nunknown = 1\n",
    "sweeps/mine.toml": "title = 'mine'\nscenario = 'parked_car'\nseeds = -1\n",
    "sweeps/far.toml": "scenario = 'parked_car'\n[parameters]\nego.speed_mps = [999.0]\n",
    "bent.net.xml": BENT,
    "torn.net.xml.gz": _gzipped(BENT, 0.5),
    "torn.rou.xml.gz": _gzipped(ROUTES, 0.5),
    "spoilt.rou.xml.gz": _gzipped(ROUTES, 0.3) + "\x00" * 99,
    "plain.rou.xml.gz": ROUTES,
    "torn.osm.xml.gz": _gzipped("<osm>" + ROUTES, 0.5),
    "rigs/mine.toml": "[pose]\nkind = 'nothing'\n",
}
WRONG = """
drive nowhere
drive empty.toml
drive torn.toml
drive wrong.toml
drive latin.toml
drive mine
drive missing.toml
drive full
drive parked_car --seed -1
drive parked_car --seed one
drive parked_car --seed 99999999999
drive parked_car --controller nowhere
drive parked_car --controller no_make.py:make
drive parked_car --controller raises.py:make
drive parked_car --controller syntax.py:make
drive parked_car --controller missing.py:make
drive parked_car --controller ""
drive parked_car --controller :
drive parked_car --vehicle nothing
drive parked_car --vehicle torn.toml
drive parked_car --pose missing.csv
drive parked_car --pose text.csv
drive parked_car --pose noise.bin
drive parked_car --pose full
drive parked_car --out full
drive parked_car --out full/file.txt
drive parked_car --out empty.toml/x
drive parked_car --rig nowhere
drive parked_car --rig mine
drive parked_car --rig mine --lockstep
drive parked_car --lockstep
drive parked_car --shadow
drive parked_car --operator me
drive parked_car --driver me
drive parked_car --rig simulated --vehicle ford_fusion
drive parked_car --rig simulated --pose text.csv
drive parked_car --nothing
drive parked_car twice
drive parked_car --set road.network=bent.net.xml
drive parked_car --set road.network=torn.net.xml.gz
drive parked_car --set 'road.demand=["torn.rou.xml.gz"]'
drive parked_car --set 'road.demand=["spoilt.rou.xml.gz"]'
drive parked_car --set 'road.demand=["plain.rou.xml.gz"]'
drive parked_car --set 'sensors=[{name="a",kind="radar",settings={range_limit="50 mph"}}]'
scenarios show
scenarios show nowhere
scenarios show parked_car --all x
scenarios show parked_car --out nowhere/x.png
scenarios show parked_car --out x.jpg
scenarios show --all empty.toml
scenarios show torn.toml
scenarios schema --out nowhere/x.json
scenarios draw
suite nothing
suite r157 --seeds 0
suite r157 --seeds x
suite r157 --vehicle nothing
suite r157 --rig nothing
suite r157 --rig simulated --vehicle lincoln_mkz
suite r157 --rig foreign
sweep
sweep nowhere --out x
sweep parked_car_speeds
sweep torn.toml --out x
sweep empty.toml --out x
sweep mine --out x
sweep far --out x
sweep parked_car_speeds --out full
sweep parked_car_speeds --out x --workers 0
sweep parked_car_speeds --out x --workers many
sweep parked_car_speeds --out x --keep-records nobody
sweep parked_car_speeds --out x --search
sweep parked_car_speeds --out x --vehicle nothing
sweep parked_car_speeds --out x --rig nothing
sweep parked_car_speeds --out x --rig simulated --vehicle lincoln_mkz
sweep parked_car_speeds --out x --rig foreign
sweep parked_car_speeds --out x --cluster localhost
sweep parked_car_speeds --out x --cluster ""
sweep parked_car_speeds --out x --cluster tcp://localhost:port
sweep parked_car_speeds --out x --cluster 127.0.0.1:1
sweep --rerun full KEY
sweep --rerun nowhere KEY
sweep parked_car_speeds --rerun full KEY
sweep --rerun full
study
study latency
study latency nowhere --out x
study latency parked_car --out full
study latency parked_car --out x --rig nothing
study latency parked_car --out x --delays-ms 5000
study latency parked_car --out x --delays-ms a,b
study latency parked_car --out x --noise nan
study latency parked_car --out x --seeds 0
study latency parked_car --out x --workers -3
study latency parked_car --out x --speeds-mps 5
study latency parked_car --out x --steering
study latency steering_probe --out x --steering --noise 1
study latency steering_probe --out x --steering --speeds-mps 50
study latency steering_probe --out x --steering --mass-factors nan
study gains
study gains nowhere --out x
study gains parked_car --out full
study gains parked_car --out x --rig nothing
study gains parked_car --out x --delay-ms nan
study gains parked_car --out x --speeds-mps 0,5
study gains parked_car --out x --mass-factors 9
drive parked_car --rig simulated --set controller.tuning.look_ahead_time_s=0.3 --out x
align --rig nowhere
calibrate nowhere
calibrate full
replay
replay nowhere
replay full
replay summary
redrive nowhere --controller follow_and_stop
redrive full --controller follow_and_stop
report
report nowhere
report full
report summary
report empty.toml
compare nowhere full
compare full
compare full summary
pose decode missing.ncom
pose decode full
path record missing.csv --out x.csv
path record text.csv --out x.csv
path record bent.net.xml --from a --to b --out x.csv
path record torn.net.xml.gz --from a --to b --out x.csv
path record linden --from nowhere --to nowhere --out x.csv
path record linden --from 21405924#2 --to 21405924#2 --from-position nan --out x.csv
path record linden --from 21405924#2 --to 21405924#2 --tolerance nan --out x.csv
path record linden --from 21405924#2 --to 21405924#2 --tolerance=-1 --out x.csv
path record linden --from 21405924#2 --to 21405924#2 --vehicle nothing --out x.csv
view nowhere
view full
view nowhere --html x.html
view full full full
render nowhere --png
render full --png
export nowhere csv
export full mcap
network build missing.osm --out x.net.xml
network build torn.osm.xml.gz --out x.net.xml
network edges bent.net.xml 0 0
network build torn.toml --out x.net.xml
network edges nowhere 0 0
network demand nowhere --out x.rou.xml
network demand linden --level huge --out x.rou.xml
design nowhere
design parked_car --latency-ms -1
design parked_car --latency-ms nan
design parked_car --latency-ms ten
init full/file.txt
notebooks full/file.txt
nothing
drive -
--nothing
"""
LINES = [line for line in WRONG.splitlines() if line]


@pytest.fixture
def working(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    for name, text in FILES.items():
        file = tmp_path / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(text.encode(errors="surrogateescape"))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def everything(folder: Path) -> dict[str, bytes]:
    """Return every file in a folder with its bytes, but for what Python leaves of a controller that it has read."""
    files = (file for file in folder.rglob("*") if file.is_file() and "__pycache__" not in file.parts)
    return {str(file.relative_to(folder)): file.read_bytes() for file in files}


def test_there_are_a_hundred() -> None:
    assert len(LINES) == len(set(LINES)) > 100


@pytest.mark.parametrize("line", LINES)
def test_it_is_one_line_and_exit_code_2(line: str, working: Path, capfd: pytest.CaptureFixture[str]) -> None:
    before = everything(working)
    try:
        code = main(shlex.split(line))
    except SystemExit as ended:
        code = int(ended.code or 0)
    out, err = capfd.readouterr()
    assert code == 2, out + err
    assert "Traceback" not in out + err
    assert len(err.strip().splitlines()) == 1, err
    assert out == ""
    assert everything(working) == before

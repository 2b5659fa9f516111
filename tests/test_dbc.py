"""DBC files as cantools reads them, which is independent; the names in them as the package has them."""

from __future__ import annotations

from pathlib import Path

import cantools
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vve_sumo import dbc
from vve_sumo.vehicle.dataspeed import layout
from vve_sumo.wire import ars408, esr

FILES = (
    layout.DBC,
    layout.DBC.with_name("dbw1_2018.dbc"),
    *(Path(esr.__file__).with_name(f"{n}.dbc") for n in ("esr", "ars408")),
)
DESCRIBED = {file.name: cantools.database.load_file(file, strict=True) for file in FILES}
READ = {file.name: dbc.read(file) for file in FILES}
MESSAGES = st.sampled_from(
    [(file, name) for file, messages in READ.items() for name, it in messages.items() if it.signals]
)


@pytest.mark.parametrize("file", READ)
def test_every_signal_is_what_cantools_reads(file):
    assert len(READ[file]) == len(DESCRIBED[file].messages)
    for described in DESCRIBED[file].messages:
        message = READ[file][described.name]
        assert (message.id, message.size) == (described.frame_id, described.length)
        assert message.signals.keys() == {signal.name for signal in described.signals}
        for signal in described.signals:
            own = message.signals[signal.name]
            assert (own.length, own.scale, own.offset) == (signal.length, signal.scale, signal.offset)
            assert (own.min_count < 0, own.unit) == (signal.is_signed, signal.unit or "")
            assert (own.minimum, own.maximum) == (signal.minimum or 0.0, signal.maximum or 0.0)
            assert own.choices == {count: str(name) for count, name in (signal.choices or {}).items()}
            assert own.switch == signal.is_multiplexer
            assert ([own.case] if own.case is not None else None) == signal.multiplexer_ids


@given(MESSAGES, st.binary(min_size=8, max_size=8), st.randoms())
def test_values_are_read_and_put_where_cantools_does(which, data, random):
    file, name = which
    message, described = READ[file][name], DESCRIBED[file].get_message_by_name(name)
    data = data[: message.size]
    read = message.decode(data)
    try:
        expected = described.decode(data, decode_choices=False)
    except cantools.database.errors.DecodeError:
        return  # the count of a switch is no case
    assert {signal: read[signal] for signal in expected} == pytest.approx(expected, rel=1e-12, abs=1e-12)
    assert {signal: message.value(data, signal) for signal in read} == read
    sent = message.encode(**{signal: read[signal] for signal in expected})
    assert described.decode(sent, decode_choices=False) == pytest.approx(expected, rel=1e-12, abs=1e-12)
    chosen = random.choice(list(expected))
    other = message.altered(bytes(byte ^ 0xFF for byte in data), **{chosen: read[chosen]})
    assert message.value(other, chosen) == read[chosen]
    kept = [signal for signal in message.signals.values() if not _overlap(signal, message.signals[chosen])]
    for signal in kept:
        assert signal.get(message.bits(other)) == signal.get(message.bits(bytes(byte ^ 0xFF for byte in data)))


def _overlap(one: dbc.Signal, other: dbc.Signal) -> bool:
    return bool(one.mask << one.shift & other.mask << other.shift)


def test_values_saturate_and_what_is_no_number_is_refused():
    track = READ["esr.dbc"]["Track"]
    data = track.encode(TRACK_RANGE=1e9, TRACK_ANGLE=-1e9)
    assert (track.value(data, "TRACK_RANGE"), track.value(data, "TRACK_ANGLE")) == pytest.approx((204.7, -51.2))
    for none in (float("nan"), float("inf"), -float("inf")):
        with pytest.raises(ValueError, match=f"finite numbers only, got {none}"):
            track.encode(TRACK_RANGE=none)


def test_bytes_that_are_missing_are_zeros():
    state = READ["ars408.dbc"]["RadarState"]
    assert state.decode(b"\xff\xff\xff") == state.decode(b"\xff\xff\xff" + bytes(5))


INTEL, MOTOROLA = ' SG_ P : 0|8@1+ (1,0) [0|1] "" Y', ' SG_ Q : 15|8@0+ (1,0) [0|1] "" Y'


@pytest.mark.parametrize(
    ("lines", "complaint"),
    [
        (("BO_ 1 A: 8 X", INTEL, MOTOROLA), "A: expected signals of one byte order"),
        (("BO_ 1 A: 8 X", INTEL.replace("(1,0)", "(1)")), "got 'SG_ P : 0"),
        (("BO_ one A: 8 X",), "got 'BO_ one A: 8 X'"),
    ],
)
def test_what_is_not_understood_is_refused(tmp_path, lines, complaint):
    file = tmp_path / "strange.dbc"
    file.write_text("\n".join(lines), encoding="ascii")
    with pytest.raises(ValueError, match=f"strange.dbc.*{complaint}"):
        dbc.read(file)


@pytest.mark.parametrize(
    ("signal", "kind"),
    [
        (READ["esr.dbc"]["Track"].signals["TRACK_STATUS"], esr.TrackStatus),
        (READ["esr.dbc"]["Track"].signals["TRACK_MED_RANGE_MODE"], esr.Mode),
        (READ["ars408.dbc"]["General"].signals["MOTION"], ars408.Motion),
        (READ["ars408.dbc"]["Quality"].signals["MEASUREMENT"], ars408.Measurement),
        (READ["ars408.dbc"]["Extended"].signals["CLASS"], ars408.Kind),
    ],
)
def test_the_radars_dbc_files_name_what_the_codecs_do(signal, kind):
    assert signal.choices == {int(member): member.name for member in kind}

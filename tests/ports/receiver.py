"""What every kind of receiver must hold to, whoever wrote it: subclass, name its table and what it sends, run pytest.

    from tests.ports.receiver import ReceiverConformance

    class TestMine(ReceiverConformance):
        table = {"kind": "my_receiver.py:make", "minimum_delay_ms": 5.0}

        def portions(self):
            return [(arrival_s, bytes_as_sent), …]  # a drive of some seconds that a car could be driven on

A kind is judged by the fixes that come of its bytes; nothing here knows a format. One with an encoder, as which the
simulated vehicle can speak, names how finely its messages say each field:

        resolution = {"latitude": 1e-9, …}  # of `fix` [its unit]; a field that is left out is not in the messages
        warm_up = 20  # fixes until all of that is known
"""

from __future__ import annotations

import dataclasses
import math
import random
import re
import select
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from itertools import pairwise
from pathlib import Path
from typing import Any, ClassVar, Final, NamedTuple

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from vve_sumo.bus import Bus
from vve_sumo.live.pty_bus import LinkedAdapter
from vve_sumo.pose.receivers.port import FixDecoder, FrameBus, OpenBus, Receiver, ReceiverTable, load
from vve_sumo.pose.receivers.udp import UdpReceiver
from vve_sumo.pose.trust import TrustGate
from vve_sumo.values import Fix, FixQuality

Portions = list[tuple[float, bytes]]

SEEDS: Final = range(10)
PATIENCE: Final = 20.0  # for bytes that were sent to arrive [s]
OPENED: Final = 40  # portions that are sent to an open receiver
#: what a car cannot be driven without
NEEDED: Final = ("time", "latitude", "longitude", "heading", "velocity_north", "velocity_east", "yaw_rate")


#: between the fixes of an encoder's test [s]
INTERVAL: Final = 0.02
ANGLES: Final = ("heading", "pitch", "roll")
#: of a car that stands in Columbus in 2026, to the whole second
STEADY: Final = Fix(
    time=1_451_260_818.0, time_received=0.0, latitude=math.radians(40.0), longitude=math.radians(-83.0),
    altitude=220.0, heading=0.1, pitch=0.01, roll=-0.01, velocity_north=0.0, velocity_east=0.0, velocity_down=0.0,
    yaw_rate=0.0, acceleration=0.0, locked=True, quality=FixQuality.RTK_FIXED, position_sigma=0.02,
    velocity_sigma=0.03, heading_sigma=0.002, differential_age=1.0,
)  # fmt: skip


def steady_fixes() -> st.SearchStrategy[Fix]:
    """Return the strategy of first fixes of steady drives, anywhere a car is driven."""
    return st.builds(
        Fix,
        time=st.integers(1_300_000_000, 1_600_000_000).map(float),
        time_received=st.just(0.0),
        latitude=st.floats(math.radians(-80.0), math.radians(80.0)),
        longitude=st.floats(-math.pi, math.pi, exclude_min=True, exclude_max=True),
        altitude=st.floats(-400.0, 5000.0),
        heading=st.floats(-math.pi, math.pi),
        pitch=st.floats(-0.3, 0.3),
        roll=st.floats(-0.3, 0.3),
        velocity_north=st.just(0.0),
        velocity_east=st.just(0.0),
        velocity_down=st.floats(-2.0, 2.0),
        yaw_rate=st.floats(-1.0, 1.0),
        acceleration=st.floats(-9.0, 9.0),
        locked=st.just(True),
        quality=st.sampled_from([FixQuality.SINGLE, FixQuality.RTK_FLOAT, FixQuality.RTK_FIXED]),
        position_sigma=st.floats(0.005, 5.0),
        velocity_sigma=st.floats(0.005, 0.6),
        heading_sigma=st.floats(0.0005, 0.05),
        differential_age=st.floats(0.0, 30.0),
    )


class FarEnd(NamedTuple):
    """The other end of a receiver's wire."""

    changes: dict[str, Any]  #: to the table, so that the receiver finds it
    write: Callable[[bytes], object]  #: sends a portion
    open_bus: OpenBus  #: for a receiver on CAN


def no_bus(interface: str, channel: str, _bitrate: int) -> FrameBus:
    """Open nothing: the receiver is on no CAN bus."""
    raise AssertionError(f"opened {interface}:{channel}")


@contextmanager
def udp_far_end() -> Iterator[FarEnd]:
    """Send to a port of this machine that nobody listens to yet."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
        yield FarEnd({"port": port}, lambda data: out.sendto(data, ("127.0.0.1", port)), no_bus)


class ReceiverConformance:
    """The suite."""

    table: ClassVar[dict[str, Any]]  #: `[pose]` of a rig
    grain: ClassVar[int] = 1  #: bytes that the source never cuts: 1, or those of a frame
    resolution: ClassVar[dict[str, float]] = {}  #: of the fields that the encoder's messages hold
    warm_up: ClassVar[int] = 20  #: fixes until the decoder knows all of them
    says_locked: ClassVar[bool] = True  #: whether the messages tell a fix that is not locked

    def portions(self) -> Portions:
        """Return arrivals [s] and bytes of a drive of some seconds that a car could be driven on."""
        raise NotImplementedError

    def far_end(self, _folder: Path) -> AbstractContextManager[FarEnd]:
        """Return the other end of the wire; without one, the tests of opening the receiver are skipped."""
        pytest.skip("no other end of the wire to try it with")

    def simulated(self, _folder: Path, port: int) -> dict[str, Any]:
        """Return the changes to the table for a simulated vehicle: a free port, or files in a folder of the test's."""
        return {"port": port}

    def configured(self, **changes: Any) -> ReceiverTable:
        return load(self.table["kind"]).model_validate(self.table | changes)

    def receiver(self, **changes: Any) -> Receiver:
        receiver = self.configured(**changes)
        assert isinstance(receiver, Receiver)
        return receiver

    def fixes(self, portions: Portions) -> list[Fix]:
        """Feed a fresh decoder, and hold each fix to what every fix must be."""
        decoder = self.receiver().decoder()
        return [fix for received, data in portions for fix in _fed(decoder, received, data)]

    # --- the table ---------------------------------------------------------------------------------------------------

    def test_a_table_survives_its_record(self) -> None:
        table = self.configured()
        kept = table.model_dump_json(exclude_unset=True)
        assert type(table).model_validate_json(kept) == table

    def test_a_key_of_another_kind_is_refused(self) -> None:
        with pytest.raises(ValidationError, match="no_such_key"):
            self.configured(no_such_key=1)

    def test_a_live_receiver_declares_what_its_fixes_take_to_arrive(self) -> None:
        if self.receiver().profile.live:
            with pytest.raises(ValidationError, match="minimum_delay_ms is missing"):
                self.configured(minimum_delay_ms=None)
            assert self.configured(minimum_delay_ms=None, clock="absolute")

    def test_what_it_says_of_itself_is_one_line_each(self) -> None:
        receiver = self.receiver()
        for words in (receiver.place(), receiver.silent_hint, receiver.not_fixed_hint):
            assert words
            assert words.isprintable()

    def test_identifiers_on_a_bus_are_of_11_bits(self) -> None:
        on_can = self.receiver().on_can()
        if on_can is not None:
            assert on_can.interface
            assert on_can.channel
            assert on_can.identifiers
            assert on_can.identifiers <= frozenset(range(0x800))

    # --- the decoder -------------------------------------------------------------------------------------------------

    def test_a_drive_becomes_fixes_that_are_trusted(self) -> None:
        fixes = self.fixes(self.portions())
        assert len(fixes) >= 20
        trusted = _trusted(self.receiver(), fixes)
        assert trusted[-1] is fixes[-1]
        assert len(trusted) >= 10

    def test_times_of_validity_increase(self) -> None:
        times = [fix.time for fix in self.fixes(self.portions())]
        assert all(later > earlier for earlier, later in pairwise(times))

    @pytest.mark.parametrize("seed", SEEDS)
    def test_the_cut_of_the_stream_does_not_matter(self, seed: int) -> None:
        chance, pieces = random.Random(seed), []
        for received, data in self.portions():
            count = len(data) // self.grain
            cuts = sorted(self.grain * chance.randint(0, count) for _ in range(chance.choice((0, 1, 5, 80))))
            pieces += [(received, data[a:b]) for a, b in zip([0, *cuts], [*cuts, len(data)], strict=True)]
        assert _same(self.fixes(pieces), self.fixes(self.portions()))

    def test_each_decoder_begins_anew(self) -> None:
        receiver, portions = self.receiver(), self.portions()
        one, other = receiver.decoder(), receiver.decoder()
        first = [fix for received, data in portions for fix in one.feed(data, received)]
        assert _same([fix for received, data in portions for fix in other.feed(data, received)], first)

    @pytest.mark.parametrize("seed", SEEDS)
    def test_garbage_is_survived_and_is_no_fix(self, seed: int) -> None:
        chance = random.Random(seed)
        garbage = [(0.01 * k, chance.randbytes(self.grain * chance.randint(0, 300))) for k in range(200)]
        assert self.fixes(garbage) == []

    @pytest.mark.parametrize("seed", SEEDS)
    def test_damage_is_survived_and_nothing_that_is_no_number_is_trusted(self, seed: int) -> None:
        chance = random.Random(seed)
        damaged = [(received, _damaged(chance, data)) for received, data in self.portions()]
        _trusted(self.receiver(), self.fixes(damaged))

    @pytest.mark.parametrize("word", [b"nan", b"inf", b"-inf", b"1e999", b"", b"-", b"0x1", b"1_0"])
    def test_words_in_place_of_numbers_are_survived(self, word: bytes) -> None:
        """In frames, which hold no words, these are damage like any other."""
        chance = random.Random(1)
        short_repr = [(received, _with_word(chance, data, word)) for received, data in self.portions()]
        whole = [(received, data[: len(data) - len(data) % self.grain]) for received, data in short_repr]
        _trusted(self.receiver(), self.fixes(whole))

    @pytest.mark.parametrize("seed", SEEDS)
    def test_what_is_late_or_comes_twice_is_not_trusted(self, seed: int) -> None:
        """Marked by the decoder, which gives no fix of it, or by the trust gate."""
        chance, portions = random.Random(seed), self.portions()
        muddled = []
        for here in portions:
            muddled += [here[1], chance.choice(portions)[1]] if chance.random() < 0.05 else [here[1]]
        for k in range(1, len(muddled)):
            if chance.random() < 0.05:
                muddled[k - 1 : k + 1] = muddled[k], muddled[k - 1]
        arrivals = [portions[min(k, len(portions) - 1)][0] for k in range(len(muddled))]
        _trusted(self.receiver(), self.fixes(list(zip(arrivals, muddled, strict=True))))

    # --- the encoder -------------------------------------------------------------------------------------------------

    @settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.differing_executors])
    @given(fix=steady_fixes(), north=st.floats(-30.0, 30.0), east=st.floats(-30.0, 30.0))
    def test_what_is_encoded_is_decoded_to_the_wires_resolution(self, fix: Fix, north: float, east: float) -> None:
        """Of a drive at constant velocity and rates: every fix, once the decoder knows all that the messages hold."""
        encoder, decoder = self.receiver().encoder(), self.receiver().decoder()
        if encoder is None:
            pytest.skip("this receiver brings no encoder")
        assert {"time", *NEEDED} - {"yaw_rate"} <= {*self.resolution}
        fix = dataclasses.replace(fix, velocity_north=north, velocity_east=east)
        sent, found = {}, 0
        for number in range(self.warm_up + 10):
            now = dataclasses.replace(fix, time=fix.time + INTERVAL * number, time_received=INTERVAL * number)
            sent[number] = now
            for got in decoder.feed(encoder.encode(now), INTERVAL * number):
                number_of = round((got.time - fix.time) / INTERVAL)
                assert got.time == pytest.approx(sent[number_of].time, abs=self.resolution["time"])
                if number_of >= self.warm_up:
                    self.hold(got, sent[number_of])
                    found += 1
        assert found >= 5

    def hold(self, got: Fix, sent: Fix) -> None:
        """Hold a decoded fix to the one that was sent; an angle may be a turn off."""
        assert got.locked is sent.locked
        assert got.quality is sent.quality
        for name, step in self.resolution.items():
            off = getattr(got, name) - getattr(sent, name)
            off = math.remainder(off, math.tau) if name in ANGLES else off
            assert abs(off) <= 0.51 * step + 1e-12 * abs(getattr(sent, name)), (name, got, sent)

    def test_a_fix_that_a_car_cannot_be_driven_on_is_none_after_the_wire(self) -> None:
        """Not locked, without a place, without a heading: sent after good ones, none is trusted."""
        receiver = self.receiver()
        if receiver.encoder() is None:
            pytest.skip("this receiver brings no encoder")
        good = Fix(**{**dataclasses.asdict(STEADY), "time_received": 0.0})
        changes: list[dict[str, Any]] = [{"latitude": math.nan}, {"heading": math.nan}]
        for change in [*changes, {"locked": False}] if self.says_locked else changes:
            encoder, decoder, gate = receiver.encoder(), receiver.decoder(), TrustGate(receiver.profile, good.time)
            assert encoder is not None
            trusted = []
            for number in range(self.warm_up + 120):
                bad = change if number >= self.warm_up + 80 else {}
                now = dataclasses.replace(good, time=good.time + INTERVAL * number, **bad)
                fixes = decoder.feed(encoder.encode(now), INTERVAL * number)
                trusted += [one.time for one in fixes if gate.step(one.time_received, one).trusted]
            assert trusted, "the good ones are"
            assert max(trusted) < good.time + INTERVAL * (self.warm_up + 79.5), change

    def test_who_can_be_simulated_says_so(self) -> None:
        receiver = self.configured()
        if why := receiver.not_simulated():
            assert why.isprintable()
            assert why.partition(": ")[0] in type(receiver).model_fields
            return
        assert receiver.encoder() is not None

    def test_what_the_far_end_sends_arrives(self, tmp_path: Path) -> None:
        """Over the receiver's own wire on this machine, to its own source, opened for the second time."""
        with socket.socket() as taken:
            taken.bind(("127.0.0.1", 0))
            port = taken.getsockname()[1]
        table = self.configured()
        if any(getattr(type(table), name) is getattr(ReceiverTable, name) for name in ("encoder", "far_end")):
            pytest.skip("this receiver cannot be simulated")
        receiver = self.receiver(**self.simulated(tmp_path, port))
        assert receiver.not_simulated() == ""
        encoder, far, arrived = receiver.encoder(), receiver.far_end(LinkedAdapter), b""
        assert encoder is not None
        assert far is not None
        receiver.open(Bus).close()
        source = receiver.open(Bus)
        try:
            begun, sent = time.monotonic(), b""
            while len(arrived) < 1000 and time.monotonic() < begun + PATIENCE:
                number = len(sent)
                data = encoder.encode(dataclasses.replace(STEADY, time=STEADY.time + INTERVAL * number))
                far.send(data)
                sent += data
                select.select([source], [], [], 0.05)
                arrived += b"".join(portion for _stamp, portion in source.receive())
        finally:
            source.close()
            far.close()
        assert len(arrived) >= 1000
        assert arrived in sent

    # --- the wire ----------------------------------------------------------------------------------------------------

    def test_over_udp_a_datagram_of_the_receiver_is_told_from_others(self) -> None:
        table = self.configured()
        if not isinstance(table, UdpReceiver):
            return
        assert all(table.recognises(data) for _received, data in self.portions() if data)
        assert not table.recognises(b"")
        if type(table).recognises is not UdpReceiver.recognises:
            chance = random.Random(1)
            assert not any(table.recognises(chance.randbytes(size)) for size in range(1, 300))

    def test_what_is_sent_arrives(self, tmp_path: Path) -> None:
        sent = [data for _received, data in self.portions()[:OPENED]]
        with self.far_end(tmp_path) as far:
            source = self.receiver(**far.changes).open(far.open_bus)
            try:
                begun, arrived, waiting = time.monotonic(), b"", list(sent)
                while len(arrived) < len(b"".join(sent)) and time.monotonic() < begun + PATIENCE:
                    if waiting:
                        far.write(waiting.pop(0))
                    select.select([] if source.lost else [source], [], [], 0.01)
                    for stamp, data in source.receive():
                        assert begun - 0.1 <= stamp <= time.monotonic() + 0.1
                        arrived += data
            finally:
                source.close()
        assert arrived == b"".join(sent)


def _fed(decoder: FixDecoder, received: float, data: bytes) -> list[Fix]:
    fixes = decoder.feed(data, received)
    for fix in fixes:
        assert fix.time_received == received
        assert math.isfinite(fix.time + fix.latitude + fix.longitude), fix
        assert abs(fix.latitude) <= math.pi / 2
        assert isinstance(fix.quality, FixQuality)
        assert isinstance(fix.locked, bool)
        numbers = [value for value in dataclasses.astuple(fix) if isinstance(value, float)]
        assert not any(math.isinf(value) for value in numbers), fix
    return fixes


def _trusted(receiver: Receiver, fixes: list[Fix]) -> list[Fix]:
    """Return the fixes that the trust gate passes, which must be finite in all that is needed, and ever newer."""
    if not fixes:
        return []
    epoch = fixes[0].time - fixes[0].time_received
    gate = TrustGate(receiver.profile, epoch)
    trusted = [fix for fix in fixes if gate.step(fix.time_received, fix).trusted]
    assert all(math.isfinite(getattr(fix, name)) for fix in trusted for name in NEEDED)
    assert all(later.time > earlier.time for earlier, later in pairwise(trusted))
    return trusted


def _same(some: list[Fix], others: list[Fix]) -> bool:
    """Whether fixes are the same, NaN for NaN."""
    return [repr(fix) for fix in some] == [repr(fix) for fix in others]


def _damaged(chance: random.Random, data: bytes) -> bytes:
    """The bytes, some of which a bad line made others; their number stays."""
    return bytes(chance.randrange(256) if chance.random() < 0.01 else byte for byte in data)


def _with_word(chance: random.Random, data: bytes, word: bytes) -> bytes:
    """The bytes with a word in place of now and then a number that stands there as text."""
    return re.sub(rb"-?\d+\.?\d*", lambda found: word if chance.random() < 0.02 else found[0], data)

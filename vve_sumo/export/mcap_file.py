"""MCAP of a drive: the topics of `foxglove` in one file, in the order of their times, in compressed chunks."""

from __future__ import annotations

import heapq
import io
import json
from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, Final

from vve_sumo.analysis.run import Run
from vve_sumo.errors import ConfigError
from vve_sumo.export.part import ExportPart
from vve_sumo.version import __version__

if TYPE_CHECKING:
    from mcap.writer import Writer

    from vve_sumo.export.foxglove import Topic

CHUNK: Final = 1 << 20  #: bytes of messages before compression


def of_drive(run: Run) -> Iterator[ExportPart]:
    """Yield the file, which has an index; raises ConfigError where a package of the extra is not installed."""
    try:
        from mcap.writer import CompressionType, Writer

        from vve_sumo.export.foxglove import topics_of
    except ImportError:
        needed = "mcap, mcap-protobuf-support and foxglove-schemas-protobuf"
        raise ConfigError(f"mcap needs {needed}: pip install 'vve-sumo[mcap]'") from None
    sink = io.BytesIO()
    writer = Writer(sink, chunk_size=CHUNK, compression=CompressionType.ZSTD)
    writer.start(library=f"vve_sumo {__version__}")
    writer.add_metadata("vve_sumo", _about(run))
    _write(writer, [*topics_of(run)])
    writer.finish()  # type: ignore[no-untyped-call]
    yield ExportPart("", sink.getvalue())


def _write(writer: Writer, topics: Iterable[Topic]) -> None:
    """Write the messages of topics; those of one time in the order of the topics."""
    streams = []
    for topic in topics:
        schema = writer.register_schema(topic.schema.name, topic.schema.encoding, topic.schema.content)
        channel = writer.register_channel(topic.name, topic.schema.messages, schema)
        streams.append(_numbered(channel, topic))
    for time, channel, data in heapq.merge(*streams, key=lambda message: message[:2]):
        writer.add_message(channel, time, data, time)


def _numbered(channel: int, topic: Topic) -> Iterator[tuple[int, int, bytes]]:
    return ((time, channel, data) for time, data in topic.messages)


def _about(run: Run) -> dict[str, str]:
    """Return what the file says of the drive."""
    about = {
        "scenario": run.name,
        "title": run.title,
        "epoch_gnss_s": json.dumps(run.resolved["epoch_gnss_s"]),
        "vve_sumo": __version__,
    }
    for name in ("outcome", "record_sha256"):
        if run.summary is not None and run.summary.get(name) is not None:
            about[name] = str(run.summary[name])
    return about

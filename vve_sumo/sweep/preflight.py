"""Previews some runs of a sweep in a process of its own before any is driven: are they valid, which files do they read?

Reads scenarios and makes controllers, whose code is a user's and may end the process; drives nothing.
"""

from __future__ import annotations

import contextlib
import json
import os
import select
import subprocess
import sys
from collections.abc import Iterator, Sequence
from typing import IO, Any, NamedTuple

from vve_sumo.errors import ConfigError
from vve_sumo.record.hashes import hash_file
from vve_sumo.sweep.input_cache import InputCache, resolve_job
from vve_sumo.sweep.job import CHUNK, Job
from vve_sumo.sweep.worker import search_path

TIMEOUT = 60.0  #: time for the preview of one run [s]


class RunPreview(NamedTuple):
    """The preview of a run."""

    complaint: str  #: why it could not be driven; empty if it can
    files_sha256: dict[str, str]  #: of the files that it reads, by role
    note: str = ""  #: what limits the car's braking below the declared value; empty without a limit
    metrics: Sequence[dict[str, Any]] = ()  #: rows of the user's metrics of a drive


def preview(jobs: Sequence[Job]) -> list[RunPreview]:
    """Return the preview of each job, in order.

    There are fewer where a controller ended the process, or hung; the run's row then has its error.
    """
    chunk = "".join(f"{job.to_json()}\n" for job in jobs)
    # Not by multiprocessing, which cannot start processes in a worker of a cluster.
    child = subprocess.Popen(
        [sys.executable, "-P", "-m", "vve_sumo.sweep.preflight"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": search_path()},
        start_new_session=True,  # this process handles an interrupt and ends the child
    )
    assert child.stdin is not None
    assert child.stdout is not None
    try:
        with contextlib.suppress(BrokenPipeError), child.stdin:
            child.stdin.write(chunk.encode())
        return [RunPreview(*json.loads(line)) for line in _lines(child.stdout, len(jobs))]
    finally:
        child.kill()
        child.wait()
        child.stdout.close()


def _lines(pipe: IO[bytes], count: int) -> Iterator[bytes]:
    """Yield up to `count` lines, until the end of the pipe or a TIMEOUT."""
    buffer = b""
    while count:
        line, end, rest = buffer.partition(b"\n")
        if end:
            buffer, count = rest, count - 1
            yield line
        elif select.select([pipe], [], [], TIMEOUT)[0] and (chunk := os.read(pipe.fileno(), CHUNK)):
            buffer += chunk
        else:
            return


def main() -> None:
    """Read jobs from stdin, a line each; write their previews to stdout, a line each."""
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)  # a controller's prints must not mix with the previews
    cache = InputCache()
    for line in sys.stdin.read().splitlines():
        job = Job.from_json(line)
        try:
            resolved = resolve_job(job, cache)
            resolved.controller(job.working)
            rig = {} if job.rig is None else {"rig": hash_file(job.rig)}
            content = resolved.to_dict(job.working)
            own = content.get("metrics", {}).get("per_drive", [])
            run_preview = RunPreview("", content["files_sha256"] | rig, resolved.note, own)
        except ConfigError as error:
            run_preview = RunPreview(str(error), {})
        answers.write(f"{json.dumps(run_preview)}\n")
        answers.flush()


if __name__ == "__main__":
    main()

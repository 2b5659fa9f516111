"""Looks at a few runs of a sweep before any is driven, in a process of its own: are they complete, what do they read?

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

TIMEOUT = 60.0  #: for one run to be looked at [s]


class RunPreview(NamedTuple):
    """What is known of a run before it is driven."""

    complaint: str  #: why it could not be driven; empty if it can
    files_sha256: dict[str, str]  #: of what it reads, by role
    note: str = ""  #: what brakes the car less than declared; empty where nothing does
    metrics: Sequence[dict[str, Any]] = ()  #: rows of the user's metrics of a drive


def look(jobs: Sequence[Job]) -> list[RunPreview]:
    """Return what is known of each job, in order.

    There are fewer where a controller ended the process, or hung: what it then does to a drive is the row's to say.
    """
    chunk = "".join(f"{job.to_json()}\n" for job in jobs)
    # Not of multiprocessing, which starts nothing from within a worker of a cluster.
    child = subprocess.Popen(
        [sys.executable, "-P", "-m", "vve_sumo.sweep.preflight"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": search_path()},
        start_new_session=True,  # an interrupt from the keyboard is this process's, which then ends that one
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
    """Return as many lines as there are, up to a count; none that is longer in coming than one may be."""
    heard = b""
    while count:
        line, end, rest = heard.partition(b"\n")
        if end:
            heard, count = rest, count - 1
            yield line
        elif select.select([pipe], [], [], TIMEOUT)[0] and (chunk := os.read(pipe.fileno(), CHUNK)):
            heard += chunk
        else:
            return


def main() -> None:
    """Look at a job a line on stdin; say on stdout, a line each, what is known of it."""
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)  # what a controller prints must not come between
    cache = InputCache()
    for line in sys.stdin.read().splitlines():
        job = Job.from_json(line)
        try:
            resolved = resolve_job(job, cache)
            resolved.controller(job.working)
            rig = {} if job.rig is None else {"rig": hash_file(job.rig)}
            content = resolved.to_dict(job.working)
            own = content.get("metrics", {}).get("per_drive", [])
            seen = RunPreview("", content["files_sha256"] | rig, resolved.note, own)
        except ConfigError as error:
            seen = RunPreview(str(error), {})
        answers.write(f"{json.dumps(seen)}\n")
        answers.flush()


if __name__ == "__main__":
    main()

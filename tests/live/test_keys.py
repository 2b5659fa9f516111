"""What an operator's keys, words and signals mean, on a real terminal and on a pipe."""

from __future__ import annotations

import os
import pty
import select
import signal
import subprocess
import sys
from typing import IO

import pytest

from tests.conftest import REPOSITORY
from vve_sumo.live.signals import STOP_REQUESTS

LISTENER = """
import fcntl, select, sys, termios
if sys.argv[1:] == ["controlled"]:
    fcntl.ioctl(0, termios.TIOCSCTTY, 0)
from vve_sumo.live.keys import OperatorInput
with OperatorInput(listen=True) as keys:
    print("ready", flush=True)
    while True:
        select.select(keys.filenos(), [], [], 0.05)
        for command in keys.commands():
            print(command.value, flush=True)
"""


def listener(stdin: int, *, controlled: bool) -> tuple[subprocess.Popen[str], IO[str]]:
    """Start a process that says what it is asked for; with `controlled` its standard input is its terminal."""
    process = subprocess.Popen(
        [sys.executable, "-c", LISTENER, *(["controlled"] if controlled else [])],
        cwd=REPOSITORY,
        stdin=stdin,
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    return process, process.stdout


def next_line(said: IO[str]) -> str:
    """The next line, where none has been read ahead; nothing where none comes."""
    return said.readline() if select.select([said], [], [], 10.0)[0] else ""


def test_on_a_terminal_all_but_four_keys_stop_even_those_that_a_terminal_keeps_to_itself() -> None:
    ours, theirs = pty.openpty()
    process, said = listener(theirs, controlled=True)
    os.close(theirs)
    wanted = {b"e": "engage", b"G": "go", b"r": "reset", b"\r": "nothing", b" ": "stop", b"x": "stop"}
    # Ctrl-C, Ctrl-Z, Ctrl-\ as signals; Ctrl-S and Ctrl-Q, which would freeze a terminal, as keys.
    wanted |= dict.fromkeys((b"\x03", b"\x1a", b"\x1c", b"\x13", b"\x11"), "stop")
    for key, wish in wanted.items():
        os.write(ours, key)
        assert said.readline() == f"{wish}\n", key
    os.close(ours)
    assert said.readline() == "stop\n", "the terminal was closed"
    process.kill()
    process.wait()


def test_every_signal_that_would_end_or_freeze_the_console_is_a_stop() -> None:
    reader, writer = os.pipe()
    process, said = listener(reader, controlled=False)
    assert {
        signal.SIGINT,
        signal.SIGTERM,
        signal.SIGHUP,
        signal.SIGQUIT,
        signal.SIGUSR1,
        signal.SIGTSTP,
    } <= STOP_REQUESTS
    for number in sorted(STOP_REQUESTS):
        process.send_signal(number)
        assert next_line(said) == "stop\n", number
    process.kill()
    process.wait()
    os.close(reader)
    os.close(writer)


@pytest.mark.parametrize("signal_of_the_parent", [signal.SIGKILL, signal.SIGTERM])
def test_a_console_whose_parent_is_gone_and_that_hears_nobody_says_so(signal_of_the_parent: signal.Signals) -> None:
    """It has no terminal and reads no pipe: whoever started it was who looked after it."""
    child = LISTENER.replace("listen=True", "listen=False")
    script = f"import subprocess, sys; subprocess.run([sys.executable, '-c', {child!r}], stdin=subprocess.DEVNULL)"
    parent = subprocess.Popen(
        [sys.executable, "-c", script], cwd=REPOSITORY, stdout=subprocess.PIPE, text=True, start_new_session=True
    )
    assert parent.stdout is not None
    assert parent.stdout.readline() == "ready\n"
    parent.send_signal(signal_of_the_parent)
    parent.wait()
    assert next_line(parent.stdout) == "gone\n"
    os.killpg(parent.pid, signal.SIGKILL)


def test_on_a_pipe_words_count_and_its_end_is_a_stop() -> None:
    reader, writer = os.pipe()
    process, said = listener(reader, controlled=False)
    os.close(reader)
    os.write(writer, b"engage\nGO\nwhat")
    assert [said.readline() for _ in range(2)] == ["engage\n", "go\n"]
    os.write(writer, b"ever\n")
    assert said.readline() == "stop\n", "what is no word of ours is said in a hurry"
    os.close(writer)
    assert said.readline() == "stop\n"
    process.kill()
    process.wait()

# SPDX-License-Identifier: Apache-2.0
"""Commands that evaluate designs: each is a group of processes with all that it starts, which ends with the design."""

import contextlib
import ctypes
import os
import pathlib
import signal
import subprocess
import sys
import threading
from typing import BinaryIO, List, NoReturn, Optional, Set, Tuple

_prctl = getattr(ctypes.CDLL(None), "prctl", None)  # found here, since a child between fork and exec should not look for it
_PR_SET_PDEATHSIG = 1

_running: Set[int] = set()  # groups of the commands that workers of this process wait for
_given_up: Set[int] = set()
_lock = threading.Lock()
_keeper: Optional[Tuple[int, "subprocess.Popen[bytes]"]] = None  # of the process with that number

# Reads "+GROUP" and "-GROUP", and kills the groups that are left when whoever writes them has ended, in whatever way.
_KEEPER = """\
import os, signal, sys
for each in (signal.SIGHUP, signal.SIGINT, signal.SIGTERM):
    signal.signal(each, signal.SIG_IGN)
groups = set()
for line in sys.stdin.buffer:
    (groups.add if line[:1] == b"+" else groups.discard)(int(line[1:]))
for group in groups:
    try:
        os.killpg(group, signal.SIGKILL)
    except OSError:
        pass
"""


class GivenUp(BaseException):
    """The study ends before this design has a result; it is evaluated when the study goes on."""


def run(words: List[str], folder: pathlib.Path, output: BinaryIO, timeout: Optional[float]) -> int:
    """The exit status of a command, which runs in `folder`. Raises subprocess.TimeoutExpired after `timeout` seconds, FileNotFoundError without
    such a program, GivenUp after end_commands(). Any thread."""
    parent = os.getpid()
    keeper = _keep()

    def begin() -> None:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGTERM})  # which workers block
        os.setpgid(0, 0)
        _tell(keeper, b"+", os.getpid())  # by the group itself, so that it is known before anything can run in it
        _die_with_parent(parent, signal.SIGKILL)

    process = subprocess.Popen(words, cwd=folder, stdin=subprocess.DEVNULL, stdout=output, stderr=output, preexec_fn=begin)
    with _lock:
        _running.add(process.pid)
    try:
        status = process.wait(timeout)
    finally:
        with _lock:
            _running.discard(process.pid)
            given_up = process.pid in _given_up
            _given_up.discard(process.pid)
            if process.returncode is None:
                _kill(process.pid)
        process.wait()
        _tell(keeper, b"-", process.pid)
    if given_up:
        raise GivenUp
    return status


def end_commands() -> None:
    """Ends the commands that threads of this process wait for; their designs raise GivenUp."""
    with _lock:
        _given_up.update(_running)
        for group in _running:
            _kill(group)


def become_worker(parent: int) -> None:
    """Has this process, which `parent` started, end with all its commands when it gets SIGTERM, or on Linux when the parent ends. Ctrl-C is left to
    the parent. To be called once, before any other thread is there."""

    def end() -> NoReturn:
        signal.sigwait({signal.SIGTERM})
        os._exit(1)  # and the keeper ends the commands

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGTERM})
    threading.Thread(target=end, daemon=True).start()  # a call of the client may take long, and Python's own handlers wait for it
    _die_with_parent(parent, signal.SIGTERM)


def _keep() -> int:
    """The pipe to the keeper of this process, which is begun with the first command: a process of its own, since nothing here runs after SIGKILL."""
    global _keeper
    with _lock:
        if _keeper is None or _keeper[0] != os.getpid() or _keeper[1].poll() is not None:
            _keeper = os.getpid(), subprocess.Popen([sys.executable, "-I", "-S", "-c", _KEEPER], stdin=subprocess.PIPE, stdout=subprocess.DEVNULL,
                                                    stderr=subprocess.DEVNULL, start_new_session=True)
        assert _keeper[1].stdin is not None
        return _keeper[1].stdin.fileno()


def _tell(keeper: int, what: bytes, group: int) -> None:
    with contextlib.suppress(OSError):  # it was killed; the next command has another
        os.write(keeper, b"%b%d\n" % (what, group))


def _die_with_parent(parent: int, how: int) -> None:
    if _prctl is not None:
        _prctl(_PR_SET_PDEATHSIG, int(how))
    if os.getppid() != parent:  # it ended before that
        os._exit(1)


def _kill(group: int) -> None:
    try:
        os.killpg(group, signal.SIGKILL)
    except ProcessLookupError:
        pass

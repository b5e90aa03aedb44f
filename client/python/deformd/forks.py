# SPDX-License-Identifier: Apache-2.0
"""Processes that os.fork() makes beside a connection. gRPC has threads and locks there that the child lacks, or would wait for: whatever it
is asked for crashes or hangs. So the child raises an error, and what it has of its parent's connections stays as it is."""

import os
import weakref
from typing import TYPE_CHECKING, Any

from . import _deformd
from .errors import FailedPrecondition

if TYPE_CHECKING:
    from .client import Client

_clients: "weakref.WeakSet[Client]" = weakref.WeakSet()
_forking = _forked = False


def watch(client: "Client") -> None:
    """The connection of this client is left alone in processes that are forked."""
    _clients.add(client)


def unconnectable() -> bool:
    """Was this process forked while another one was connected?"""
    return _forked


def error() -> FailedPrecondition:
    """What calls raise there."""
    return FailedPrecondition("this process was made by os.fork() while there was a client that was not closed, and gRPC, which connects clients, does "
                              "not survive that; start processes by the method \"spawn\" or \"forkserver\" of multiprocessing, or close clients before")


class Unconnected:
    """Stands for what should have been unpickled there. Any use raises, while an error of unpickling would leave a pool of processes
    waiting for ever."""

    def __getattr__(self, name: str) -> Any:
        raise error()

    def __call__(self, *_: Any, **__: Any) -> Any:
        raise error()


def _before() -> None:
    global _forking
    _forking = _forked or _deformd.connected()


def _in_child() -> None:
    global _forked
    _forked = _forking
    for client in _clients:
        if client._connection is not None:
            _deformd.keep(client._connection)


os.register_at_fork(before=_before, after_in_child=_in_child)

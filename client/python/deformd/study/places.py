# SPDX-License-Identifier: Apache-2.0
"""Where designs are evaluated: executors of this machine and of libraries that are installed."""

import contextlib
import ctypes
import importlib
import multiprocessing
import os
import pathlib
import signal
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from typing import Any, Callable, Iterator, Tuple

_prctl = getattr(ctypes.CDLL(None), "prctl", None)  # found here, since a child between fork and exec should not look for it


def die_with_parent(parent: int) -> None:
    """Linux ends this process when `parent`, which started it, ends, so that no worker of a killed study goes on."""
    if _prctl is not None:
        _prctl(1, signal.SIGKILL)  # PR_SET_PDEATHSIG
    if os.getppid() != parent:  # it ended before that
        os._exit(1)


@contextlib.contextmanager
def open_place(place: Tuple[str, Any], folder: pathlib.Path) -> Iterator[Executor]:
    """The executor of a place: what has `submit(function, argument)` and gives futures of concurrent.futures, or such that have `result()` and
    `done()`. folder: for what a place has to write."""
    kind, options = place
    if kind == "threads":
        with ThreadPoolExecutor(options) as pool:
            yield pool
    elif kind == "processes":
        with ProcessPoolExecutor(options, mp_context=multiprocessing.get_context("spawn"), initializer=die_with_parent,
                                 initargs=(os.getpid(),)) as processes:
            yield processes
    elif kind == "submitit":
        import submitit

        given = dict(options or {})
        executor = submitit.AutoExecutor(folder=str(folder / "jobs"), cluster=given.pop("cluster", None))
        executor.update_parameters(**given)
        yield executor
    elif kind == "dask":
        from distributed import Client

        with Client(options) if isinstance(options, str) else Client(**(options or {})) as dask:
            yield dask.get_executor()
    elif kind == "ray":
        yield from _ray(options)
    else:
        module, name = str(options).split(":")
        with getattr(importlib.import_module(module), name)() as made:
            yield made


def _ray(options: Any) -> Iterator[Executor]:
    import ray

    if not ray.is_initialized():
        ray.init(**{"log_to_driver": False, **(options or {})})

    class RayExecutor(Executor):
        def submit(self, function: Callable[..., Any], /, *arguments: Any, **named: Any) -> "Future[Any]":
            return ray.remote(function).remote(*arguments, **named).future()

    try:
        yield RayExecutor()
    finally:
        ray.shutdown()

# SPDX-License-Identifier: Apache-2.0
"""Where designs are evaluated: executors of this machine and of libraries that are installed."""

import contextlib
import importlib
import multiprocessing
import os
import pathlib
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from typing import Any, Callable, Iterator, Tuple

from .commands import become_worker


@contextlib.contextmanager
def open_place(place: Tuple[str, Any], folder: pathlib.Path) -> Iterator[Executor]:
    """The executor of a place: what has `submit(function, argument)` and gives futures of concurrent.futures, or such that have `result()` and
    `done()`. folder: for what a place has to write."""
    kind, options = place
    if kind == "threads":
        with ThreadPoolExecutor(options) as pool:
            yield pool
    elif kind == "processes":
        with ProcessPoolExecutor(options, mp_context=multiprocessing.get_context("spawn"), initializer=become_worker,
                                 initargs=(os.getpid(),)) as processes:
            try:
                yield processes
            except BaseException:
                for worker in multiprocessing.active_children():  # they would go on with the designs that they were given
                    worker.terminate()
                raise
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

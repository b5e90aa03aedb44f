# SPDX-License-Identifier: Apache-2.0
"""Where designs are evaluated: executors of this machine and of libraries that are installed."""

import contextlib
import importlib
import multiprocessing
import os
import pathlib
import threading
import time
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from typing import Any, Callable, Iterable, Iterator, List, Mapping, Sequence, Tuple, Type

from ..errors import Error, InvalidArgument
from .commands import become_worker


_OUT_OF_TIME = "submitit.core.utils.UncompletedJobError: "  # what its workers raise at their limit of time


class WorkerLost(Error):
    """The process that evaluated a design ended before it had a result: it was killed, ran out of memory or crashed."""

    code = "worker_lost"


class OutOfTime(WorkerLost):
    """A scheduler ended the job of a design at its limit of time; another would end there, too."""

    code = "out_of_time"


class Place:
    """Submits tasks and has their results. Futures are those of concurrent.futures, or have `result()`, `done()` and `cancel()`."""

    def __init__(self, submit: Callable[..., Any], lost: Tuple[Type[BaseException], ...] = (), wrapped: Tuple[Type[BaseException], ...] = ()) -> None:
        """lost: what futures raise where a worker ended; wrapped: what they raise in the place of what the function raised, with its trace as text."""
        self._submit = submit
        self._lost, self._wrapped = lost, wrapped

    def submit_all(self, function: Callable[..., Any], tasks: Iterable[Mapping[str, Any]]) -> Iterator[Tuple[Mapping[str, Any], Any]]:
        """Tasks with the futures of `function` of each, in any order; the futures of those that were taken are there at once."""
        for task in tasks:
            yield task, self._submit(function, task)

    def cancel(self, futures: Sequence[Any]) -> None:
        """Cancels what waits; threads and processes that run go on."""
        for future in futures:
            future.cancel()

    def result(self, future: Any) -> Any:
        """Raises WorkerLost or OutOfTime, or what the function raised."""
        try:
            return future.result()
        except self._wrapped as error:
            message = _raised(str(error))
            raise (OutOfTime if message.startswith(_OUT_OF_TIME) else Error)(message) from error
        except self._lost as error:
            raise WorkerLost(str(error).split("\n", 1)[0][:200]) from error


def _raised(text: str) -> str:
    """The exception of a trace, which stands in a text of more lines: what follows its last call."""
    lines = text.splitlines()
    calls = [number for number, line in enumerate(lines) if line.startswith('  File "')]
    return next((line for line in lines[calls[-1]:] if line and not line.startswith(" ")), text) if calls else text


class _Processes:
    """Threads with a process each, so that one that ends takes no other's design with it."""

    def __init__(self, count: int) -> None:
        self._threads = ThreadPoolExecutor(count)
        self._own = threading.local()

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Any:
        return self._threads.submit(self._run, function, *arguments)

    def _run(self, function: Callable[..., Any], *arguments: Any) -> Any:
        if getattr(self._own, "process", None) is None:
            self._own.process = ProcessPoolExecutor(1, multiprocessing.get_context("spawn"), initializer=become_worker, initargs=(os.getpid(),))
        try:
            return self._own.process.submit(function, *arguments).result()
        except BrokenProcessPool:
            self._own.process = None
            raise WorkerLost("a process of this machine") from None

    def __enter__(self) -> "_Processes":
        return self

    def __exit__(self, kind: Any, *_: Any) -> None:
        if kind is not None:
            for worker in multiprocessing.active_children():
                worker.terminate()
        self._threads.shutdown(cancel_futures=True)  # with a thread its process ends


@contextlib.contextmanager
def open_place(place: Tuple[str, Any], folder: pathlib.Path) -> Iterator[Place]:
    """The place by its name and options. folder: for what it has to write."""
    kind, options = place
    if kind == "threads":
        with ThreadPoolExecutor(options) as pool:
            yield Place(pool.submit)
    elif kind == "processes":
        with _Processes(options) as processes:
            yield Place(processes.submit, (WorkerLost,))
    elif kind == "submitit":
        import submitit
        from submitit.core.utils import FailedJobError, UncompletedJobError

        given = dict(options or {})
        try:
            executor = submitit.AutoExecutor(folder=str(folder / "jobs"), cluster=given.pop("cluster", None))
            executor.update_parameters(**given)
        except (AssertionError, NameError, RuntimeError, TypeError, ValueError) as error:  # what it raises for options
            raise InvalidArgument(f"place.submitit: {error}") from error
        if executor.cluster == "slurm":
            from .slurm import open_slurm

            yield open_slurm(executor, given)
        else:
            submit = _few_at_a_time(executor.submit) if executor.cluster == "local" else executor.submit
            yield Place(submit, (UncompletedJobError,), (FailedJobError,))
    elif kind == "dask":
        from distributed import Client, KilledWorker

        with Client(options) if isinstance(options, str) else Client(**(options or {})) as dask:
            yield Place(dask.get_executor().submit, (KilledWorker,))
    elif kind == "ray":
        yield from _ray(options)
    else:
        module, name = str(options).split(":")
        with getattr(importlib.import_module(module), name)() as made:
            yield Place(made.submit, (BrokenProcessPool,))


def _few_at_a_time(submit: Callable[..., Any]) -> Callable[..., Any]:
    """For jobs of this machine, each of which is a process at once: waits until fewer run than there are cores."""
    jobs: List[Any] = []

    def submit_later(*arguments: Any) -> Any:
        while True:
            jobs[:] = [job for job in jobs if not job.done()]
            if len(jobs) < (os.cpu_count() or 1):
                break
            time.sleep(0.05)
        jobs.append(submit(*arguments))
        return jobs[-1]

    return submit_later


def _ray(options: Any) -> Iterator[Place]:
    import ray

    if not ray.is_initialized():
        ray.init(**{"log_to_driver": False, **(options or {})})
    try:
        yield Place(lambda function, *arguments: ray.remote(function).remote(*arguments).future(), (ray.exceptions.WorkerCrashedError, ray.exceptions.OutOfMemoryError))
    finally:
        ray.shutdown()


__all__ = ["OutOfTime", "Place", "WorkerLost", "open_place"]

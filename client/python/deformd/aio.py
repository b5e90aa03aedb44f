# SPDX-License-Identifier: Apache-2.0
"""The client for asyncio: the same calls, awaited.

    async with deformd.aio.Client() as client:
        system = await client.prepare("ahmed.yaml")
        population = await system.deform(designs)
        async for i, points, report in system.stream(designs):
            ...

Each call runs on a thread of its own executor, which gives the GIL back while it waits. Cancelling a task cancels its call, here and on the
server.
"""

import asyncio
import functools
from concurrent.futures import ThreadPoolExecutor
from typing import Any, AsyncIterator, Callable, List, Optional, Tuple, TypeVar, Union

import numpy as np

from . import _deformd
from . import client as blocking
from .compiled import CompiledDeformation
from .geometry import Geometry
from .reports import Deformation, Evaluation, Population, Report
from .system import System as BlockingSystem

_Result = TypeVar("_Result")


class Client:
    """A connection to deformd for tasks of one event loop. Arguments are those of `deformd.Client`, and how many calls may be under way
    at a time (`calls`); further ones wait."""

    def __init__(self, address: Optional[str] = None, *, calls: int = 16, **settings: Any) -> None:
        self.blocking = blocking.Client(address, **settings)
        """The client that does the work."""
        self._executor = ThreadPoolExecutor(calls, thread_name_prefix="deformd")

    async def __aenter__(self) -> "Client":
        return self

    async def __aexit__(self, *_: Any) -> None:
        await self.close()

    async def close(self) -> None:
        """Ends the connection when the calls under way have ended."""
        await asyncio.get_running_loop().run_in_executor(None, self._executor.shutdown)
        self.blocking.close()

    async def register(self, mesh: Any, **options: Any) -> Geometry:
        """As `deformd.Client.register`."""
        return await self._run(self.blocking.register, mesh, **options)

    async def prepare(self, setup: Any, geometry: Any = None, **options: Any) -> "System":
        """As `deformd.Client.prepare`."""
        return System(self, await self._run(self.blocking.prepare, setup, geometry, **options))

    async def system(self, id: str) -> "System":
        """As `deformd.Client.system`."""
        return System(self, await self._call(self.blocking.system, id))

    async def geometry(self, id: str) -> Geometry:
        """As `deformd.Client.geometry`."""
        return await self._call(self.blocking.geometry, id)

    async def systems(self) -> List["System"]:
        """As `deformd.Client.systems`."""
        return [System(self, system) for system in await self._call(self.blocking.systems)]

    async def check(self, setup: Any, geometry: Any = None) -> "_deformd.Record":
        """As `deformd.Client.check`."""
        return await self._call(self.blocking.check, setup, geometry)

    async def server_info(self) -> "_deformd.Record":
        """As `deformd.Client.server_info`."""
        return await self._call(self.blocking.server_info)

    async def _call(self, function: Callable[..., _Result], *arguments: Any) -> _Result:
        """On a thread; it runs to its end."""
        return await asyncio.get_running_loop().run_in_executor(self._executor, functools.partial(function, *arguments))

    async def _run(self, function: Callable[..., _Result], *arguments: Any, **options: Any) -> _Result:
        """On a thread, with a flag that the cancelled task sets; then waits for the call to end, so that nothing of it is left."""
        cancel = options.pop("cancel", None) or _deformd.Cancel()
        call = functools.partial(function, *arguments, cancel=cancel, **options)
        running = asyncio.get_running_loop().run_in_executor(self._executor, call)
        try:
            return await asyncio.shield(running)
        except asyncio.CancelledError:
            cancel.cancel()
            await asyncio.wait([running])
            if not running.cancelled():
                running.exception()  # seen
            raise

    def __repr__(self) -> str:
        return f"<aio.Client of {self.blocking.address}>"


class System:
    """A prepared system; `Client.prepare` and `Client.system` make it. Every other attribute is that of `deformd.System`."""

    def __init__(self, client: Client, system: BlockingSystem) -> None:
        self._client = client
        self.blocking = system
        """The system that does the work."""

    def __getattr__(self, name: str) -> Any:
        if name not in ("id", "info", "names", "variables", "bounds", "geometry"):
            raise AttributeError(name)
        return getattr(self.blocking, name)

    async def __call__(self, x: Any, **options: Any) -> np.ndarray:
        """As calling a `deformd.System`."""
        return await self._client._run(self.blocking.__call__, x, **options)

    async def deform(self, x: Any, **options: Any) -> Union[Deformation, Population]:
        """As `deformd.System.deform`."""
        return await self._client._run(self.blocking.deform, x, **options)

    async def stream(self, designs: Any, **options: Any) -> AsyncIterator[Tuple[int, Optional[np.ndarray], Report]]:
        """As `deformd.System.stream`."""
        cancel = options.pop("cancel", None) or _deformd.Cancel()
        results = await self._client._call(functools.partial(self.blocking.stream, designs, cancel=cancel, **options))
        try:
            while True:
                item = await self._client._run(_next, results, cancel=cancel)
                if item is None:
                    return
                yield item
        finally:
            cancel.cancel()
            await self._client._call(results.close)  # type: ignore[attr-defined]

    async def evaluate(self, points: Any, x: Any = None, **options: Any) -> Evaluation:
        """As `deformd.System.evaluate`."""
        return await self._client._run(self.blocking.evaluate, points, x, **options)

    async def jvp(self, x: Any, v: Any, **options: Any) -> np.ndarray:
        """As `deformd.System.jvp`."""
        return await self._client._run(self.blocking.jvp, x, v, **options)

    async def vjp(self, x: Any, w: Any, **options: Any) -> np.ndarray:
        """As `deformd.System.vjp`."""
        return await self._client._run(self.blocking.vjp, x, w, **options)

    async def jacobian(self, x: Any = None, **options: Any) -> np.ndarray:
        """As `deformd.System.jacobian`."""
        return await self._client._run(self.blocking.jacobian, x, **options)

    async def local(self, **options: Any) -> CompiledDeformation:
        """As `deformd.System.local`."""
        return await self._client._run(self.blocking.local, **options)

    async def release(self, *, forget: bool = False) -> None:
        """As `deformd.System.release`."""
        await self._client._call(functools.partial(self.blocking.release, forget=forget))

    def __repr__(self) -> str:
        return f"<aio.{repr(self.blocking)[1:]}"


def _next(results: Any, cancel: Any) -> Any:
    """The next design of a stream, or None; the flag is known to the stream."""
    return next(results, None)

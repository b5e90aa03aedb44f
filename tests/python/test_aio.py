# SPDX-License-Identifier: GPL-3.0-or-later
"""The client for asyncio gives what the other one gives, at once and cancellably."""

import asyncio
import time

import numpy as np
import pytest

import deformd
import deformd.aio
from harness import LONG_SETUP


def run(coroutine):
    return asyncio.run(asyncio.wait_for(coroutine, 60))


def test_the_same_points(case, system, population):
    async def work():
        async with deformd.aio.Client(case.server.address) as client:
            assert (await client.server_info()).version == deformd.__version__
            geometry = await client.register(case.mesh)
            mine = await client.prepare(case.setup, geometry)
            assert mine.id == system.id and mine.names == system.names and mine.geometry is geometry
            singles = await asyncio.gather(*(mine(x) for x in population))
            for x, y in zip(population, singles):
                np.testing.assert_array_equal(y, system(x))
            np.testing.assert_array_equal((await mine.deform(population)).points, system(population))
            streamed = {i: y async for i, y, report in mine.stream(population, batch=2)}
            np.testing.assert_array_equal(np.array([streamed[i] for i in range(9)]), system(population, batch=2))
            v, w = [1, 0.5], np.ones((system.info.points, 3))
            np.testing.assert_array_equal(await mine.jvp(population[0], v), system.jvp(population[0], v))
            np.testing.assert_array_equal(await mine.vjp(population[0], w), system.vjp(population[0], w))
            np.testing.assert_array_equal(await mine.jacobian(), system.jacobian())
            assert (await client.system(system.id)).id in [one.id for one in await client.systems()]
            with pytest.raises(deformd.InvalidArgument, match="outside of its bounds"):
                await mine([9, 9])
        with pytest.raises(deformd.FailedPrecondition, match="closed"):
            client.blocking.server_info()
    run(work())


def test_the_loop_goes_on_meanwhile_and_a_cancelled_task_cancels_its_call(case):
    case.command("sample", "-o", "long.obj", "--points", "30000")
    (case.folder / "long.yaml").write_text(LONG_SETUP)

    async def work():
        async with deformd.aio.Client(case.server.address) as client:
            task = asyncio.create_task(client.prepare(case.folder / "long.yaml"))
            start, turns = time.monotonic(), 0
            while time.monotonic() < start + 0.5:
                await asyncio.sleep(0.005)
                turns += 1
            assert turns > 5 and not task.done()
            task.cancel()
            with pytest.raises(asyncio.CancelledError):
                await task
            while True:
                info = await client.server_info()
                if info.running + info.queue_length == 0:
                    break
                await asyncio.sleep(0.05)
            points = (await client.register(case.folder / "long.obj")).info.points
            assert not any(one.info.resident for one in await client.systems() if one.info.points == points)
    run(work())


def test_leaving_a_stream_ends_it(case, system, population):
    async def work():
        async with deformd.aio.Client(case.server.address) as client:
            mine = await client.system(system.id)
            stream = mine.stream(np.tile(population, (300, 1)), batch=2)
            async for i, points, report in stream:
                break
            await stream.aclose()
            np.testing.assert_array_equal(await mine(population[0]), system(population[0]))
    run(work())

#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""What Python costs beside the C++ client: populations of 15 designs, 50,000 points, RAW_F64, on one machine.

usage: python_overhead.py BUILD [--quick]       needs DEFORM_BUILD_PYTHON; prints a table of required against measured
Both talk to the same server in turns: `deform bench`, which drops what comes, and System.deform(), which gives an array (15, n, 3) and the
reports. The figure is the median over the rounds of the ratio of their times.
"""
import json
import os
import pathlib
import resource
import statistics
import subprocess
import sys
import tempfile
import time

ROOT = pathlib.Path(__file__).resolve().parents[2]
BUILD = pathlib.Path(sys.argv[1]).resolve()
os.environ["DEFORM_BIN"], os.environ["DEFORMD_BIN"] = str(BUILD / "client/cli/deform"), str(BUILD / "server/deformd")
sys.path[:0] = [str(BUILD / "client/python"), str(ROOT / "tests/end_to_end")]

import numpy as np  # noqa: E402

import deformd  # noqa: E402
from harness import DEFORM, Server  # noqa: E402

POPULATION, LIMIT = 15, 1.1
ROUNDS, POPULATIONS = (3, 10) if "--quick" in sys.argv else (15, 40)


def processor_seconds(whose):
    used = resource.getrusage(whose)
    return used.ru_utime + used.ru_stime


def seconds_of_cpp(folder, address):
    """Per design."""
    done = subprocess.run([DEFORM, "bench", "ahmed.yaml", "--population", str(POPULATION), "--designs", str(POPULATION * POPULATIONS),
                           "--encoding", "raw_f64", "--json"], cwd=folder, env={**os.environ, "DEFORM_SERVER": address},
                          stdout=subprocess.PIPE, check=True)
    return 1 / json.loads(done.stdout)["designs_per_second"]


def seconds_of_python(system, random):
    low, high = system.bounds.T
    start = time.perf_counter()
    for _ in range(POPULATIONS):
        system.deform(random.uniform(low, high, (POPULATION, len(low))), encoding="RAW_F64")
    return (time.perf_counter() - start) / (POPULATION * POPULATIONS)


def processor_ratio(folder, address, system, random):
    """The ratio of the processor times of the two clients alone, which a busy machine does not change; the start of `deform bench` left out."""
    def cpp(designs):
        before = processor_seconds(resource.RUSAGE_CHILDREN)
        subprocess.run([DEFORM, "bench", "ahmed.yaml", "--population", str(POPULATION), "--designs", str(designs), "--encoding", "raw_f64",
                        "--json"], cwd=folder, env={**os.environ, "DEFORM_SERVER": address}, stdout=subprocess.DEVNULL, check=True)
        return processor_seconds(resource.RUSAGE_CHILDREN) - before
    few = cpp(POPULATION)
    theirs = cpp(POPULATION * (POPULATIONS + 1)) - few
    before = processor_seconds(resource.RUSAGE_SELF)
    seconds_of_python(system, random)
    return (processor_seconds(resource.RUSAGE_SELF) - before) / theirs


def main():
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run([DEFORM, "sample", "-o", "ahmed.obj", "--points", "50000"], cwd=folder, stdout=subprocess.DEVNULL, check=True)
        (pathlib.Path(folder) / "ahmed.yaml").write_text((ROOT / "deploy/examples/ahmed.yaml").read_text())
        server = Server(folder).start()
        try:
            with deformd.Client(server.address) as client:
                system = client.prepare(os.path.join(folder, "ahmed.yaml"))
                random = np.random.default_rng(1)
                seconds_of_python(system, random)  # connects
                rounds = [(seconds_of_cpp(folder, server.address), seconds_of_python(system, random)) for _ in range(ROUNDS)]
                processor = statistics.median(processor_ratio(folder, server.address, system, random) for _ in range(3))
        finally:
            server.stop()
    ratio = statistics.median(python / cpp for cpp, python in rounds)
    cpp, python = (statistics.median(column) for column in zip(*rounds))
    print("| figure | required | measured | |\n|---|---|---|---|")
    print(f"| Python against the C++ client, {system.info.points} points, RAW_F64, populations of {POPULATION}, {ROUNDS} rounds | <= {LIMIT} "
          f"| {ratio:.3f} ({1 / python:.0f} against {1 / cpp:.0f} designs/s) | {'PASS' if ratio <= LIMIT else 'MISS'} |")
    print(f"| The same, processor time of the client | <= {LIMIT} | {processor:.3f} | {'PASS' if processor <= LIMIT else 'MISS'} |")
    return 0 if max(ratio, processor) <= LIMIT else 1


if __name__ == "__main__":
    sys.exit(main())

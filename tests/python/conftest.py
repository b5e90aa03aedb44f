# SPDX-License-Identifier: GPL-3.0-or-later
"""A real server with the Ahmed body, and the command line beside it."""

import csv
import os
import pathlib
import signal
import subprocess
import sys

import numpy as np
import pytest

HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parent.parent
sys.path[:0] = [str(ROOT / "tests" / "end_to_end"), str(ROOT / "tests" / "wire")]

import deformd  # noqa: E402
from harness import AHMED_SETUP, DEFORM, Server  # noqa: E402  (of the folder named above)


if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)  # what a shell runs in the background ignores it, and so would programs that tests interrupt


class Case:
    """A folder with ahmed.obj and ahmed.yaml, and a server."""

    def __init__(self, folder, *options):
        self.folder = pathlib.Path(folder)
        self.server = Server(str(folder), *options).start()
        self.command("sample", "-o", "ahmed.obj", "--points", "2000")
        (self.folder / "ahmed.yaml").write_text(AHMED_SETUP)
        self.setup = self.folder / "ahmed.yaml"
        self.mesh = self.folder / "ahmed.obj"

    def command(self, *arguments):
        """Runs deform; what it printed."""
        environment = {name: value for name, value in os.environ.items() if not name.startswith("DEFORM")}
        environment["DEFORM_SERVER"] = self.server.address
        done = subprocess.run([DEFORM, *map(str, arguments)], cwd=self.folder, env=environment, stdout=subprocess.PIPE,
                              stderr=subprocess.PIPE, text=True, timeout=120)
        assert done.returncode == 0, done.stderr
        return done.stdout


@pytest.fixture(scope="session")
def case(tmp_path_factory):
    made = Case(tmp_path_factory.mktemp("server"))
    yield made
    made.server.stop()


@pytest.fixture
def client(case):
    with deformd.Client(case.server.address) as made:
        yield made


@pytest.fixture
def system(case, client):
    return client.prepare(case.setup)


@pytest.fixture
def population(system):
    low, high = system.bounds.T
    return np.random.default_rng(7).uniform(low, high, (9, 2))


@pytest.fixture
def study(case, tmp_path):
    """Runs a study: study(text) -> (exit code, what it printed); its folder is study.folder."""

    class Runner:
        folder = tmp_path / "study"
        log = tmp_path / "log"

        def start(self, text, start_new_session=False, **variables):
            (tmp_path / "study.yaml").write_text(("" if "setup:" in text else f"setup: {case.setup}\n") + f"server: {case.server.address}\n{text}\n")
            paths = os.pathsep.join([os.environ.get("PYTHONPATH", ""), str(HERE)])
            return subprocess.Popen([sys.executable, "-m", "deformd.study", str(tmp_path / "study.yaml")], stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                                    text=True, start_new_session=start_new_session, env={**os.environ, "PYTHONPATH": paths, "STUDY_LOG": str(self.log), **variables})

        def __call__(self, text, **variables):
            process = self.start(text, **variables)
            told = process.communicate(timeout=200)[0]
            return process.returncode, told

        def history(self):
            with open(self.folder / "history.csv", newline="") as file:
                return list(csv.DictReader(file))

        def evaluated(self):
            return self.log.read_text().splitlines()

    return Runner()


def brick(counts=(4, 3, 3)):
    """Points and hexahedra of a block of unit cells."""
    nx, ny, nz = (count + 1 for count in counts)
    z, y, x = np.meshgrid(np.arange(nz), np.arange(ny), np.arange(nx), indexing="ij")
    points = np.stack([x.ravel(), y.ravel(), z.ravel()], axis=1).astype(float)
    number = np.arange(nx * ny * nz).reshape(nz, ny, nx)
    corner = [number[k:nz - 1 + k, j:ny - 1 + j, i:nx - 1 + i].ravel() for i, j, k in
              [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]]
    return points, np.stack(corner, axis=1)


@pytest.fixture
def squeezed(client):
    """A block whose right end may be pushed through its left one: its cells invert."""
    points, hexahedra = brick()
    x = points[:, 0]
    geometry = client.register((points, {"hexahedron": hexahedra}), groups={"left": np.flatnonzero(x == 0), "right": np.flatnonzero(x == 4)})
    return client.prepare({"handles": [{"name": "right", "region": {"group": "right"}}], "fixed": [{"group": "left"}],
                           "variables": [{"name": "push", "handle": "right", "translate": [-1, 0, 0], "lower": -10, "upper": 10}]}, geometry)

# SPDX-License-Identifier: GPL-3.0-or-later
"""A real deformd process, the real deform command, and just enough mesh reading to check what they write."""

import gzip
import json
import os
import re
import shutil
import signal
import struct
import subprocess
import sys
import tempfile
import time
import unittest

DEFORM = os.environ["DEFORM_BIN"]
DEFORMD = os.environ["DEFORMD_BIN"]
SHARED_DATA = os.environ.get("DEFORM_SHARED_DATA", "")
LONG = bool(os.environ.get("DEFORM_LONG"))


def long_test(test):
    """One of those that are too long for every day: with DEFORM_LONG=1, as every night."""
    return test if LONG else None


class Server:
    """Owns a data directory; may be started, killed and started again on it."""

    host = "127.0.0.1"

    def __init__(self, folder, *options):
        self.folder = folder
        self.data = os.path.join(folder, "data")
        self.options = list(options)
        self.process = None
        self.port = None

    def start(self):
        port_file = os.path.join(self.folder, "port")
        if os.path.exists(port_file):
            os.remove(port_file)
        address = f"{self.host}:{self.port or 0}"
        with open(os.path.join(self.folder, "deformd.log"), "ab") as log:
            self.process = subprocess.Popen(
                [DEFORMD, "--address", address, "--data-dir", self.data, "--port-file", port_file, *self.options],
                stdout=log, stderr=log)
        deadline = time.time() + 30
        while time.time() < deadline:
            if self.process.poll() is not None:
                raise RuntimeError(f"deformd ended with {self.process.returncode}:\n{self.log_text()}")
            if os.path.exists(port_file):
                with open(port_file) as file:
                    text = file.read().strip()
                if text:
                    self.port = int(text)
                    return self
            time.sleep(0.01)
        raise RuntimeError("deformd did not write its port in time")

    @property
    def address(self):
        return f"127.0.0.1:{self.port}"

    def kill(self):
        self.process.send_signal(signal.SIGKILL)
        self.process.wait()

    def stop(self):
        if self.process is not None and self.process.poll() is None:
            self.process.terminate()
            try:
                self.process.wait(40)
            except subprocess.TimeoutExpired:
                self.kill()
        return self.process.returncode if self.process else None

    def log_text(self):
        with open(os.path.join(self.folder, "deformd.log"), errors="replace") as file:
            return file.read()


class Result:
    def __init__(self, code, out, err):
        self.code, self.out, self.err = code, out, err

    @property
    def json(self):
        return json.loads(self.out)


def without_warnings(text):
    """Nor progress, which commands that take more than ten seconds tell."""
    return "".join(line for line in text.splitlines(keepends=True) if not line.startswith(("deform: warning: ", "deform: progress: ")))


class EndToEnd(unittest.TestCase):
    """A folder of its own per test and, once asked for, a server."""

    server_options = []

    def setUp(self):
        self.folder = tempfile.mkdtemp(prefix="deform-e2e-")
        self.server = None
        self.children = []

    def tearDown(self):
        for child in self.children:
            if child.poll() is None:
                child.kill()
            child.communicate()
        if self.server:
            self.server.stop()
        shutil.rmtree(self.folder, ignore_errors=True)

    def start_server(self, *options):
        self.server = Server(self.folder, *options).start()
        return self.server

    def path(self, name):
        return os.path.join(self.folder, name)

    def write(self, name, text):
        with open(self.path(name), "w") as file:
            file.write(text)
        return self.path(name)

    def environment(self):
        environment = {k: v for k, v in os.environ.items() if not k.startswith("DEFORM")}
        environment["DEFORM_CONFIG"] = self.path("contexts.yaml")  # not those of whoever runs the tests
        if self.server:
            environment["DEFORM_SERVER"] = self.server.address
        return environment

    def deform(self, *arguments, expect=0, environment=None):
        """Runs deform in the test's folder; unless expect is None its exit code must be that. `environment`: variables besides."""
        done = subprocess.run([DEFORM, *map(str, arguments)], cwd=self.folder, env={**self.environment(), **(environment or {})}, timeout=600,
                              stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        if expect is not None:
            self.assertEqual(done.returncode, expect, f"deform {' '.join(map(str, arguments))}\n{done.stdout}\n{done.stderr}")
        if done.returncode == 0:
            self.assertEqual(without_warnings(done.stderr), "", "silent in a pipe")
        return Result(done.returncode, done.stdout, done.stderr)

    def spawn(self, *arguments):
        child = subprocess.Popen([DEFORM, *map(str, arguments)], cwd=self.folder, env=self.environment(),
                                 stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        self.children.append(child)
        return child

    def fails(self, code, *arguments, says=(), prints=False):
        """The error is one line on stderr that says what to do; nothing on stdout, unless the command fails after its result.
        With --json it stands on stdout, too."""
        result = self.deform(*arguments, expect=code)
        errors = without_warnings(result.err)
        self.assertEqual(errors.count("\n"), 1, result.err)
        self.assertTrue(errors.startswith("deform: "), result.err)
        if "--json" in arguments:
            self.assertEqual(set(result.json["error"]) - {"request_id"}, {"code", "message", "field"})
            self.assertEqual(list(result.json) != ["error"], prints)
        else:
            self.assertEqual(result.out != "", prints)
        for part in says:
            self.assertIn(part, result.err)
        return result

    def status(self):
        return self.deform("status", "--json").json

    def busy(self):
        """Requests that the server waits for or works on."""
        status = self.status()
        return status["running"] + status["queue_length"]

    def wait_until(self, condition, what, seconds=30):
        deadline = time.time() + seconds
        while time.time() < deadline:
            if condition():
                return
            time.sleep(0.02)
        self.fail(f"after {seconds} s still not: {what}")

    def assert_logged(self, pattern, server=None):
        """A call is written to the log after it was answered."""
        server = server or self.server
        self.wait_until(lambda: re.search(pattern, server.log_text()), f"the log says {pattern}")


AHMED_SETUP = """\
geometry: ahmed.obj
method: {rbf: {kernel: TRIHARMONIC}}
handles:
  - {name: slant, region: {group: slant}}
  - {name: roof,  region: {intersection: [{group: roof}, {box: {min: [0.4, -1, 0], max: [0.6, 1, 1]}}]}}
fixed: [{group: nose}, {group: underbody}, {group: stilts}]
variables:
  - {name: roof_up,    handle: roof,  translate: [0, 0, 1], lower: -0.05, upper: 0.05}
  - {name: slant_turn, handle: slant, rotate: {axis: [0, 1, 0], centre: [0.843, 0, 0.338]}, lower: -0.2, upper: 0.2}
"""

# Every point but those of the sides is a centre: takes long enough to be interrupted.
LONG_SETUP = """\
geometry: long.obj
method: {rbf: {reduction: REDUCTION_OFF}}
handles: [{name: roof, region: {group: roof}}]
fixed: [{difference: [{all: true}, {group: roof}, {group: sides}]}]
variables: [{name: up, handle: roof, translate: [0, 0, 1]}]
"""


def read_bytes(path):
    with open(path, "rb") as file:
        content = file.read()
    return gzip.decompress(content) if content[:2] == b"\x1f\x8b" else content


def read_obj(path):
    """Points, and all lines that are no points."""
    points, rest = [], []
    for line in read_bytes(path).decode().split("\n"):
        if line.startswith("v "):
            points.append(tuple(map(float, line.split()[1:4])))
        else:
            rest.append(line)
    return points, rest


def read_off(path):
    """Points, and the lines of the faces."""
    lines = read_bytes(path).decode().split("\n")
    content = [line for line in lines if line.strip() and not line.startswith("#")]
    count = int(content[1].split()[0])
    return [tuple(map(float, line.split()[:3])) for line in content[2:2 + count]], content[2 + count:]


def read_stl_corners(path):
    """Corner coordinates and normals in file order, of an ascii or a binary STL, and everything else."""
    content = read_bytes(path)
    if content[:5] == b"solid" and b"facet" in content[:1000]:
        corners, normals, rest = [], [], []
        for line in content.decode().split("\n"):
            words = line.split()
            if words[:1] == ["vertex"]:
                corners.append(tuple(map(float, words[1:4])))
            elif words[:1] == ["facet"]:
                normals.append(tuple(map(float, words[2:5])))
            else:
                rest.append(line)
        return corners, normals, rest
    count = struct.unpack_from("<I", content, 80)[0]
    corners, normals, rest = [], [], [content[:84]]
    for k in range(count):
        numbers = struct.unpack_from("<12f", content, 84 + 50 * k)
        normals.append(numbers[:3])
        corners += [numbers[3:6], numbers[6:9], numbers[9:12]]
        rest.append(content[132 + 50 * k:134 + 50 * k])
    return corners, normals, rest


def box(points):
    return [min(p[k] for p in points) for k in range(3)], [max(p[k] for p in points) for k in range(3)]


def distance(a, b):
    return max(abs(x - y) for x, y in zip(a, b))


def main():
    unittest.main(argv=[sys.argv[0], "-v", *sys.argv[1:]])

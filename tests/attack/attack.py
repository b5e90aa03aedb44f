# SPDX-License-Identifier: GPL-3.0-or-later
"""A server with a budget of 512 MiB, an honest client at work, and what both are watched for while a test attacks."""

import functools
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import threading
import time
import unittest
import urllib.request

import grpc
from google.protobuf import json_format

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path[:0] = [os.path.join(os.path.dirname(HERE), "end_to_end"), os.path.join(os.path.dirname(HERE), "wire")]
from deform.v1 import deformation_pb2, geometry_pb2, service_pb2, service_pb2_grpc, setup_pb2  # noqa: E402
from harness import Server  # noqa: E402
from honest import until_answered  # noqa: E402
from relay import Relay  # noqa: E402
from wire_client import SETUP, Plate  # noqa: E402

MIB = 1 << 20
BUDGET = 512 * MIB
LONG = bool(os.environ.get("DEFORM_LONG"))
# Connections of their own, not one shared by all channels of this process to an address.
CHANNEL = [("grpc.use_local_subchannel_pool", 1)]


def resident(pid, what="VmRSS"):
    with open(f"/proc/{pid}/status") as status:
        return next(1024 * int(line.split()[1]) for line in status if line.startswith(what))


class Honest:
    """honest.py at work."""

    def __init__(self, address, request, token=""):
        self.process = subprocess.Popen([sys.executable, os.path.join(HERE, "honest.py"), address, token], stdin=subprocess.PIPE,
                                        stdout=subprocess.PIPE, text=True)
        self.process.stdin.write(request.SerializeToString().hex() + "\n")
        self.process.stdin.flush()

    def stop(self):
        out, _ = self.process.communicate(timeout=90)
        result = json.loads(out)
        self.seconds, self.failures = result["seconds"], result["failures"]


class Attack(unittest.TestCase):
    """Every test starts with a fresh server and asserts, when it ends: the process held at most 640 MiB, is back within 64 MiB of
    before, the honest client had every answer (in the long tests within a second), and all kinds of calls are answered still."""

    options = []
    host = "127.0.0.1"

    @classmethod
    def setUpClass(cls):
        cls.figures = []

    @classmethod
    def tearDownClass(cls):
        for line in cls.figures:
            print(line, file=sys.stderr)

    def setUp(self):
        self.folder = tempfile.mkdtemp(prefix="deform-attack-")
        self.addCleanup(shutil.rmtree, self.folder, ignore_errors=True)
        self.server = Server(self.folder, "--memory-budget", str(BUDGET), "--metrics-address", "127.0.0.1:0", *self.options)
        self.server.host = self.host
        self.server.start()
        self.addCleanup(self.server.stop)
        self.connections = []
        self.addCleanup(lambda: [one.close() for one in self.connections])
        self.service = service_pb2_grpc.DeformServiceStub(self.channel())
        self.plate = Plate()
        self.geometry = self.service.RegisterGeometry(self.plate.messages(), timeout=60)
        self.setup = json_format.ParseDict({"geometry": self.geometry.id, **SETUP}, setup_pb2.Setup())
        self.system = list(self.service.Prepare(deformation_pb2.PrepareRequest(setup=self.setup), timeout=60))[-1].system
        self.request = deformation_pb2.DeformRequest(
            system_id=self.system.id, designs=[deformation_pb2.Design(variables=[0.1, 0.2, 0.1])],
            output=dict(encoding=deformation_pb2.RAW_F64))
        self.every_call_is_answered()  # also warms up what every later call needs
        self.cached = self.cache_bytes()
        self.before = self.peak = resident(self.server.process.pid)
        self.watching = threading.Event()
        self.watcher = threading.Thread(target=self.watch)
        self.watcher.start()
        self.honest = Honest(self.server.address, self.request)

    def channel(self, host=None):
        """A connection of its own; from another address of this machine, it is one of another client."""
        address = self.server.address
        if host is not None:
            relay = Relay(self.server.port, host)
            self.addCleanup(relay.close)
            address = relay.address
        channel = grpc.insecure_channel(address, CHANNEL)
        self.connections.append(channel)
        return channel

    def stub(self, host=None):
        return service_pb2_grpc.DeformServiceStub(self.channel(host))

    def watch(self):
        while not self.watching.wait(0.01):
            try:
                self.peak = max(self.peak, resident(self.server.process.pid))
            except (OSError, StopIteration):
                return

    def tearDown(self):
        for one in self.connections:
            one.close()
        self.connections.clear()
        time.sleep(2)  # for what was sent to be worked on
        self.honest.stop()
        self.assertIsNone(self.server.process.poll(), self.server.log_text()[-2000:])
        self.service = self.stub()
        self.every_call_is_answered()
        deadline = time.monotonic() + 20
        kept = self.cache_bytes() - self.cached  # systems that others may want
        while resident(self.server.process.pid) > self.before + kept + 64 * MIB and time.monotonic() < deadline:
            time.sleep(0.1)
        after = resident(self.server.process.pid)
        self.watching.set()
        self.watcher.join()
        times = sorted(self.honest.seconds)
        worst = times[min(len(times) - 1, int(0.99 * len(times)))]
        self.figures.append(f"{self.id().split('.')[-1]}: resident {self.before / MIB:.0f} MiB before, {self.peak / MIB:.0f} at most, "
                            f"{after / MIB:.0f} after; honest client: {len(times)} rounds, p99 {worst:.2f} s")
        self.assertEqual(self.honest.failures, [], self.server.log_text()[-3000:])
        self.assertGreater(len(times), 0)
        self.assertLessEqual(self.peak, 1.25 * BUDGET, "at most a quarter beyond the budget")
        if LONG:
            self.assertLessEqual(worst, 1, "seconds that the honest client waited")
        self.assertLessEqual(after, self.before + kept + 64 * MIB, "memory is given back")

    def figure(self, name):
        """A metric that has no labels."""
        port = re.search(r"metrics: .* on port (\d+)", self.server.log_text()).group(1)
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/metrics", timeout=10) as reply:
            return float(re.search(rf"^{name} (\S+)$", reply.read().decode(), re.MULTILINE).group(1))

    def cache_bytes(self):
        return self.service.GetServerInfo(service_pb2.GetServerInfoRequest(), timeout=30).cache_bytes

    def every_call_is_answered(self):
        service = self.service
        answered = functools.partial(until_answered, reconnects=3)  # as often as the client library; the upload is much
        answered(lambda: service.GetServerInfo(service_pb2.GetServerInfoRequest(), timeout=30))
        answered(lambda: service.RegisterGeometry(self.plate.messages(), timeout=30))
        answered(lambda: service.GetGeometry(geometry_pb2.GetGeometryRequest(id=self.geometry.id), timeout=30))
        answered(lambda: service.ListGeometries(geometry_pb2.ListGeometriesRequest(), timeout=30))
        answered(lambda: list(service.GetPoints(geometry_pb2.GetPointsRequest(id=self.geometry.id), timeout=30)))
        answered(lambda: service.Estimate(deformation_pb2.EstimateRequest(setup=self.setup), timeout=30))
        answered(lambda: list(service.Prepare(deformation_pb2.PrepareRequest(setup=self.setup), timeout=30)))
        answered(lambda: service.GetSystem(deformation_pb2.GetSystemRequest(id=self.system.id), timeout=30))
        answered(lambda: service.ListSystems(deformation_pb2.ListSystemsRequest(), timeout=30))
        answered(lambda: list(service.Deform(self.request, timeout=30)))

    def refused(self, call):
        """The status that a call ends with; None when it was answered."""
        try:
            call()
            return None
        except grpc.RpcError as error:
            return error.code()


def main():
    unittest.main(verbosity=2)

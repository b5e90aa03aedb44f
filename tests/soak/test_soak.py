# SPDX-License-Identifier: GPL-3.0-or-later
"""A server under mixed load for a long time: random calls of two tenants, sweeps, large meshes that come and go, streams that are
cancelled, connections that are dropped, bad requests, and an honest client whose waiting is measured. Nothing may fail that should not, the same
question has the same answer throughout, and memory, files and threads at the end are what they were early on.

    DEFORM_SOAK_MINUTES=N    that long: a third of a minute by default, 60 with DEFORM_LONG
    DEFORM_SOAK_SEED=N       the same decisions once more
"""

import hashlib
import os
import random
import re
import shutil
import socket
import subprocess
import sys
import threading
import time

import grpc
from google.protobuf import json_format

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path[:0] = [os.path.join(os.path.dirname(HERE), folder) for folder in ("end_to_end", "wire", "history", "attack")]
from attack import CHANNEL, MIB, Honest, resident  # noqa: E402
from checker import Functions  # noqa: E402
from clients import Client, Geometry, Record, Tenant  # noqa: E402
from deform.v1 import deformation_pb2, service_pb2_grpc, setup_pb2  # noqa: E402
from harness import AHMED_SETUP, DEFORMD, EndToEnd, Server, main, read_bytes  # noqa: E402
from wire_client import SETUP, Plate  # noqa: E402

MINUTES = float(os.environ.get("DEFORM_SOAK_MINUTES") or (60 if os.environ.get("DEFORM_LONG") else 1 / 3))
SEED = int(os.environ.get("DEFORM_SOAK_SEED") or time.time_ns() % 1_000_000)
BUDGET = 512 * MIB
INTERVALS = 12  # of which each has a line of figures
TOKENS = {"operator": "default", "owner": "acme"}


def quantile(values, q):
    values = sorted(values)
    return values[min(len(values) - 1, int(q * len(values)))] if values else float("nan")


class Work(threading.Thread):
    """A function called again and again until the end; its rounds, and the exception that ended it."""

    def __init__(self, function):
        super().__init__(daemon=True, name=function.__name__)
        self.function, self.rounds, self.failure = function, 0, None
        self.ending = threading.Event()

    def run(self):
        try:
            while not self.ending.is_set():
                self.function()
                self.rounds += 1
        except Exception as error:  # told by the test
            self.failure = error


class Soak(EndToEnd):
    def setUp(self):
        super().setUp()
        self.random = random.Random(f"{SEED} the soak")
        identities = self.write("identities", "".join(
            f"{role} {role} sha256:{hashlib.sha256(f'{role}-of-the-soak'.encode()).hexdigest()} tenant={tenant}\n"
            for role, tenant in TOKENS.items()))
        self.write("token", "operator-of-the-soak\n")
        os.chmod(self.path("token"), 0o600)
        self.tenants = [Tenant(tenant, f"{role}-of-the-soak") for role, tenant in TOKENS.items()]
        self.server = Server(self.folder, "--identities", identities, "--memory-budget", str(BUDGET), "--log-level", "warning",
                             "--connection-idle", "20", "--workers", "2")
        self.server.start()
        self.channel = grpc.insecure_channel(self.server.address, CHANNEL)
        self.service = service_pb2_grpc.DeformServiceStub(self.channel)
        self.addCleanup(self.channel.close)
        self.calling = {"timeout": 60, "metadata": self.tenants[0].metadata}
        self.bytes_of_sweep = None
        self.bytes_of_design = {}
        self.turns = 0

    def environment(self):
        return {**super().environment(), "DEFORM_TOKEN_FILE": self.path("token")}

    # ---- what is done all the time ----

    def sweep(self):
        """A sweep by the command line; its meshes are the same bytes each time."""
        shutil.rmtree(self.path("swept"), ignore_errors=True)
        self.deform("sweep", "ahmed.yaml", "--designs", "designs.csv", "-o", "swept")
        found = {name: hashlib.sha256(read_bytes(self.path(f"swept/{name}"))).digest() for name in os.listdir(self.path("swept"))
                 if name.endswith(".obj")}
        self.bytes_of_sweep = self.bytes_of_sweep or found
        self.assertEqual(found, self.bytes_of_sweep)

    def replace_a_mesh(self):
        """A mesh of its own size is registered, prepared, deformed, and deleted with its setups."""
        size = 54000 - 7000 * (self.turns % 8)
        name = f"mesh{self.turns % 8}"
        self.turns += 1
        self.deform("sample", "-o", f"{name}.obj", "--points", size)
        self.write(f"{name}.yaml", AHMED_SETUP.replace("ahmed.obj", f"{name}.obj"))
        identity = self.deform("register", f"{name}.obj", "--json").json["id"]
        self.deform("prepare", f"{name}.yaml")
        self.deform("apply", f"{name}.yaml", "--set", "roof_up=0.02", "-o", f"{name}_out.obj")
        digest = hashlib.sha256(read_bytes(self.path(f"{name}_out.obj"))).digest()
        self.assertEqual(self.bytes_of_design.setdefault(name, digest), digest)
        self.deform("remove", identity, "--with-setups")
        for file in (f"{name}.obj", f"{name}_out.obj"):
            os.remove(self.path(file))

    def cancel(self):
        """A stream of many designs that is given up on the way, or whose connection is dropped."""
        channel = grpc.insecure_channel(self.server.address, CHANNEL)
        try:
            service = service_pb2_grpc.DeformServiceStub(channel)
            designs = [deformation_pb2.Design(variables=[self.random.uniform(-1, 1), 0.1, 0.1]) for _ in range(200)]
            call = service.Deform(deformation_pb2.DeformRequest(system_id=self.system, designs=designs,
                                                                output=dict(encoding=deformation_pb2.DELTA_ZSTD)), **self.calling)
            time.sleep(self.random.uniform(0, 0.1))
            try:
                for _ in range(self.random.randrange(20)):
                    next(call)
            except StopIteration:
                pass
            if self.random.random() < 0.5:
                call.cancel()
        finally:
            channel.close()
        time.sleep(0.1)

    def ask_badly(self):
        """Requests that are wrong, each with its own status, and connections that say nothing or nonsense."""
        wrong = [
            (grpc.StatusCode.NOT_FOUND, lambda: list(self.service.Deform(
                deformation_pb2.DeformRequest(system_id="0" * 64, designs=[dict(variables=[0, 0, 0])]), **self.calling))),
            (grpc.StatusCode.INVALID_ARGUMENT, lambda: list(self.service.Deform(
                deformation_pb2.DeformRequest(system_id=self.system, designs=[dict(variables=[float("nan")] * 3)]), **self.calling))),
            (grpc.StatusCode.INVALID_ARGUMENT, lambda: list(self.service.Prepare(
                deformation_pb2.PrepareRequest(setup=setup_pb2.Setup(geometry=self.geometry, seed=1)), **self.calling))),
            (grpc.StatusCode.UNAUTHENTICATED, lambda: list(self.service.Deform(
                deformation_pb2.DeformRequest(system_id=self.system), timeout=60, metadata=(("authorization", "Bearer nobody"),)))),
        ]
        for code, call in wrong:
            with self.assertRaises(grpc.RpcError) as caught:
                call()
            self.assertEqual(caught.exception.code(), code, caught.exception.details())
        sockets = []
        for _ in range(5):
            one = socket.create_connection(("127.0.0.1", self.server.port))
            one.sendall(self.random.choice([b"", b"GET / HTTP/1.1\r\n\r\n", b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n", os.urandom(200)]))
            sockets.append(one)
        time.sleep(0.2)
        for one in sockets:
            one.close()

    # ---- what is looked at ----

    def files(self):
        return len(os.listdir(f"/proc/{self.server.process.pid}/fd"))

    def threads(self):
        return len(os.listdir(f"/proc/{self.server.process.pid}/task"))

    def stored(self):
        return sum(os.path.getsize(os.path.join(folder, name)) for folder, _, names in os.walk(self.server.data) for name in names
                   if os.path.exists(os.path.join(folder, name)))

    def take_in(self, record, functions, counts):
        """What the random clients saw meanwhile: all that contradicts. Nothing is kept but first answers."""
        with record.lock:
            operations, answers = record.operations, record.answers
            record.operations, record.answers = [], []
        wrong = [operation.what[1] for _, operation in operations if operation.what[0] == "never"]
        for question, answer, who in answers:
            first = functions.differs(question, answer, who)
            if first:
                wrong.append(f"{question}: {who} got {answer}, {first} got another answer before")
        counts["operations"] = counts.get("operations", 0) + len(operations)
        return wrong

    def test_nothing_grows_and_nothing_fails(self):
        print(f"seed {SEED} (DEFORM_SOAK_SEED), {MINUTES:.1f} minutes (DEFORM_SOAK_MINUTES)", file=sys.stderr)
        plate = Plate()
        self.geometry = self.service.RegisterGeometry(plate.messages("of the soak"), **self.calling).id
        setup = json_format.ParseDict({"geometry": self.geometry, **SETUP}, setup_pb2.Setup())
        self.system = list(self.service.Prepare(deformation_pb2.PrepareRequest(setup=setup), **self.calling))[-1].system.id
        self.deform("sample", "-o", "ahmed.obj", "--points", 20000)
        self.write("ahmed.yaml", AHMED_SETUP)
        self.write("designs.csv", "roof_up,slant_turn\n" + "".join(f"{0.01 * i},{0.02 * i}\n" for i in range(4)))
        self.deform("register", "ahmed.obj")
        self.deform("prepare", "ahmed.yaml")
        honest_request = deformation_pb2.DeformRequest(system_id=self.system, designs=[dict(variables=[0.1, 0.2, 0.1])],
                                                       output=dict(encoding=deformation_pb2.RAW_F64))
        record, functions, counts, wrong = Record(), Functions(), {}, []
        geometries = [Geometry(number) for number in range(2)]
        clients = [Client(number, SEED, self.tenants[1], geometries, self.server.address, record) for number in range(4)]
        works = [Work(function) for function in (self.sweep, self.replace_a_mesh, self.cancel, self.ask_badly)]
        for one in [*clients, *works]:
            one.start()
        lines = []
        for _ in range(INTERVALS):
            honest = Honest(self.server.address, honest_request, token=self.tenants[0].token)
            sizes, end = [], time.monotonic() + 60 * MINUTES / INTERVALS
            while time.monotonic() < end:
                sizes.append(resident(self.server.process.pid))
                time.sleep(0.05)
            peak = max(sizes)
            honest.stop()
            wrong += self.take_in(record, functions, counts) + honest.failures
            lines.append((peak, self.files(), self.threads(), self.stored(), honest.seconds))
            print(f"resident {min(sizes) / MIB:4.0f} to {peak / MIB:4.0f} MiB, {self.files():4} files, {self.threads():3} threads, {self.stored() / MIB:6.1f} MiB "
                  f"stored; honest client: {len(honest.seconds):5} rounds, median {1e3 * quantile(honest.seconds, 0.5):5.1f} ms, "
                  f"p99 {1e3 * quantile(honest.seconds, 0.99):6.1f} ms, most {1e3 * quantile(honest.seconds, 1):6.1f} ms", file=sys.stderr)
            if wrong or any(work.failure for work in works):
                break
        for one in works:
            one.ending.set()
        for one in clients:
            one.stop()
        for one in [*clients, *works]:
            one.join(120)
        wrong += self.take_in(record, functions, counts)
        print({work.name: work.rounds for work in works}, counts["operations"], "answers of random calls;",
              dict(sorted(record.counts.items())), file=sys.stderr)
        self.assertEqual([work.failure for work in works if work.failure], [])
        self.assertEqual([client.failure for client in clients if client.failure], [])
        self.assertEqual(wrong, [])
        self.judge(lines)

    def judge(self, lines):
        """Growth is looked for once the server is warm, from the second quarter on; of its size in runs of at least five minutes, as in
        shorter ones not all meshes have come by then."""
        quarter = INTERVALS // 4
        early, late = lines[quarter:2 * quarter], lines[-quarter:]
        for number, (what, slack) in enumerate((("resident bytes", 64 * MIB), ("open files", 40), ("threads", 10), ("stored bytes", 32 * MIB))):
            if number == 0 and MINUTES < 5:
                continue
            before, after = (max(line[number] for line in part) for part in (early, late))
            self.assertLessEqual(after, before + slack, f"{what}: {before} at most in the second quarter")
        self.assertLessEqual(max(line[0] for line in lines), 1.25 * BUDGET)
        silent = [k for k, line in enumerate(lines) if not line[4]]
        # Each honest client is a new process, which may take an interval of a short run to start on a busy machine.
        self.assertLess(len(silent), INTERVALS if MINUTES < 5 else 1, "intervals without a round of the honest client")
        if os.environ.get("DEFORM_LONG"):
            self.assertLessEqual(quantile([s for line in lines for s in line[4]], 0.99), 1, "seconds that the honest client waited")
        faults = re.findall(r".*(?:INTERNAL|terminate|Assertion|bad_alloc).*", self.server.log_text())
        self.assertEqual(faults, [])
        self.assertEqual(self.server.stop(), 0)
        checked = subprocess.run([DEFORMD, "store", "check", "--data-dir", self.server.data], stdout=subprocess.PIPE, text=True, timeout=60)
        self.assertEqual(checked.returncode, 0, checked.stdout)


if __name__ == "__main__":
    main()

# SPDX-License-Identifier: GPL-3.0-or-later
"""Many clients at a few geometries while the server is killed, stopped, cut off and given a bad disk: every answer is one that some order
of the calls explains (checker.py), and what was acknowledged is there in the end.

    DEFORM_HISTORY_KILLS=N    so many kills: 10 by default, 1,000 with DEFORM_LONG
    DEFORM_HISTORY_SEED=N     the same decisions once more; when they meet each other is up to the machine
"""

import hashlib
import mmap
import os
import random
import re
import shutil
import signal
import sqlite3
import struct
import subprocess
import sys
import tempfile
import time
import unittest

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path[:0] = [os.path.join(os.path.dirname(HERE), "end_to_end"), os.path.join(os.path.dirname(HERE), "wire")]
from checker import Functions, Operation, check, contradiction, described  # noqa: E402
from clients import SYSTEMS, Client, Geometry, Record, Tenant  # noqa: E402
from deform.v1 import admin_pb2  # noqa: E402
from harness import DEFORMD, Server  # noqa: E402
from proxy import Proxy  # noqa: E402

KILLS = int(os.environ.get("DEFORM_HISTORY_KILLS") or (1000 if os.environ.get("DEFORM_LONG") else 10))
SEED = int(os.environ.get("DEFORM_HISTORY_SEED") or time.time_ns() % 1_000_000)
FAULTY_DISK = os.environ.get("FAULTY_DISK_LIB", "")
CLIENTS = 8
OFF, ERRORS, FULL, SLOW = range(4)  # of faulty_disk.cpp


class Disk:
    """What faulty_disk.cpp is told."""

    def __init__(self, path):
        with open(path, "wb") as file:
            file.write(bytes(mmap.PAGESIZE))
        with open(path, "r+b") as file:
            self.memory = mmap.mmap(file.fileno(), mmap.PAGESIZE)
        self.path = path

    def fail(self, mode, per_mille=1000, milliseconds=0):
        self.memory[4:12] = struct.pack("<II", per_mille, milliseconds)
        self.memory[:4] = struct.pack("<I", mode)

    def heal(self):
        self.memory[:4] = struct.pack("<I", OFF)

    @property
    def failures(self):
        return struct.unpack("<I", self.memory[12:16])[0]


class HistoryServer(Server):
    """Knows when it was there."""

    def __init__(self, folder, disk, *options):
        super().__init__(folder, *options)
        self.disk = disk
        self.deaths, self.starts = [], []

    def start(self):
        self.disk.heal()
        if FAULTY_DISK:
            os.environ.update(LD_PRELOAD=FAULTY_DISK, HISTORY_FAULTS=self.disk.path)
        try:
            super().start()
        finally:
            os.environ.pop("LD_PRELOAD", None)
        self.starts.append(time.monotonic())
        return self

    def begin_to_start(self):
        """And is killed before long."""
        with open(os.path.join(self.folder, "deformd.log"), "ab") as log:
            self.process = subprocess.Popen([DEFORMD, "--address", self.address, "--data-dir", self.data, *self.options], stdout=log,
                                            stderr=log)

    def kill(self):
        super().kill()
        self.deaths.append(time.monotonic())

    def settled(self, moment):
        """When it is decided what became of a call that was given up at a moment: as soon as the next server answers."""
        return next((start for start in self.starts if start >= moment), None)


class History(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.mkdtemp(prefix="deform-history-")
        self.addCleanup(shutil.rmtree, self.folder, ignore_errors=True)
        self.random = random.Random(f"{SEED} what goes wrong")
        tokens = {"operator": "default", "owner": "acme"}
        with open(os.path.join(self.folder, "identities"), "w") as file:
            for role, tenant in tokens.items():
                digest = hashlib.sha256(f"{role} of the history".encode()).hexdigest()
                file.write(f"{role} {role} sha256:{digest} tenant={tenant}\n")
        self.tenants = [Tenant(tenant, f"{role} of the history") for role, tenant in tokens.items()]
        self.disk = Disk(os.path.join(self.folder, "faults"))
        self.server = HistoryServer(self.folder, self.disk, "--identities", os.path.join(self.folder, "identities"), "--log-level", "warning",
                                    "--keep-free", "64KiB", "--workers", "2")
        self.server.start()
        self.addCleanup(self.server.stop)
        self.proxy = Proxy(lambda: self.server.port)
        self.addCleanup(self.proxy.close)
        self.geometries = [Geometry(number) for number in range(2)]
        self.record = Record()
        self.done = {}
        self.backups = []

    def client(self, number):
        address = self.proxy.address if number % 2 else self.server.address
        return Client(number, SEED, self.tenants[number // 2 % 2], self.geometries, address, self.record)

    # ---- what goes wrong ----

    def pause(self, least, most):
        time.sleep(self.random.uniform(least, most))

    def suspend(self):
        self.server.process.send_signal(signal.SIGSTOP)
        self.pause(0.05, 0.2)
        self.server.process.send_signal(signal.SIGCONT)

    def cut(self):
        for _ in range(self.random.randrange(1, 4)):
            self.proxy.cut()
            self.pause(0, 0.1)

    def hold(self):
        self.proxy.hold()
        self.pause(0.05, 0.2)
        if self.random.random() < 0.5:
            self.proxy.cut()
        self.proxy.release()

    def delay(self):
        self.proxy.seconds = self.random.uniform(0.005, 0.05)
        self.pause(0.1, 0.4)
        self.proxy.seconds = 0.0

    def disk_errors(self):
        self.disk.fail(ERRORS, self.random.choice([20, 100, 500]))
        self.pause(0.05, 0.3)

    def disk_full(self):
        for _ in range(self.random.randrange(1, 4)):
            self.disk.fail(FULL)
            self.pause(0.02, 0.15)

    def disk_slow(self):
        self.disk.fail(SLOW, 300, self.random.choice([5, 30]))
        self.pause(0.1, 0.3)

    def drain(self):
        with self.operator() as admin:
            admin("Drain", admin_pb2.DrainRequest())
            self.pause(0.02, 0.1)
            admin("Undrain", admin_pb2.UndrainRequest())

    def evict(self):
        with self.operator() as admin:
            for _ in range(self.random.randrange(1, 10)):
                admin("Evict", admin_pb2.EvictRequest(all=True))
                self.pause(0.01, 0.03)

    def backup(self):
        """What is in it is what was there at some time while it was made."""
        to = os.path.join(self.folder, f"backup{len(self.backups)}")
        start = time.monotonic()
        with self.operator() as admin:
            if admin("BackupStore", admin_pb2.BackupStoreRequest(directory=to)):
                self.backups.append((to, start, time.monotonic()))

    def operator(self):
        return Operator(self.server.address, self.tenants[0])

    def go_wrong(self):
        kinds = [None, None, None, None, self.suspend, self.cut, self.hold, self.delay, self.drain, self.evict]
        if FAULTY_DISK:
            kinds += [self.disk_errors, self.disk_full, self.disk_slow]
        kind = self.random.choice(kinds)
        if len(self.backups) < 3 + KILLS // 50 and self.random.random() < 0.1:
            kind = self.backup
        if kind:
            self.done[kind.__name__] = self.done.get(kind.__name__, 0) + 1
            kind()

    def kill(self):
        """Half of the time right after a call that changes something has begun."""
        self.pause(0.03, 0.4)
        self.go_wrong()
        if self.random.random() < 0.5:
            self.record.changing.clear()
            self.record.changing.wait(1)
            self.pause(0, 0.006)
        self.server.kill()

    def restart(self):
        """Some starts are killed, too; the number of those."""
        kills = 0
        while self.random.random() < 0.25:
            self.server.begin_to_start()
            self.pause(0, 0.06)
            self.server.kill()
            kills += 1
        self.server.start()
        return kills

    # ---- what must hold ----

    def test_every_answer_is_explained(self):
        print(f"seed {SEED} (DEFORM_HISTORY_SEED), {KILLS} kills", file=sys.stderr)
        clients = [self.client(number) for number in range(CLIENTS)]
        for client in clients:
            client.start()
        kills = stops = 0
        while kills < KILLS:
            if self.random.random() < 0.08:
                self.pause(0.05, 0.3)
                self.assertEqual(self.server.stop(), 0, self.server.log_text()[-3000:])
                self.server.deaths.append(time.monotonic())
                stops += 1
            else:
                self.kill()
                kills += 1
            kills += self.restart()
        time.sleep(0.3)
        for client in clients:
            client.stop()
        for client in clients:
            client.join(20)
        self.assertEqual([client.failure for client in clients if client.failure], [])
        self.server.kill()
        self.server.start()  # now it is decided what became of the last calls
        self.look_at_all()
        self.look_at_backups()
        self.assertEqual(self.server.stop(), 0)
        checked = subprocess.run([DEFORMD, "store", "check", "--data-dir", self.server.data], stdout=subprocess.PIPE, text=True, timeout=60)
        self.assertEqual(checked.returncode, 0, checked.stdout)
        self.judge(kills, stops)

    def look_at_all(self):
        """Everything that the last server has, by a client of each tenant that nobody disturbs."""
        for number, tenant in enumerate(self.tenants):
            client = Client(100 + number, SEED, tenant, self.geometries, self.server.address, self.record)
            for geometry in self.geometries:
                for name in ("get", "list", "points", "list_systems"):
                    client.call(name, geometry, 0, 30)
                for system in range(SYSTEMS):
                    for name in ("system", "deform", "deform"):
                        client.call(name, geometry, system, 30)
            client.channel.close()

    def look_at_backups(self):
        for folder, start, end in self.backups:
            checked = subprocess.run([DEFORMD, "store", "check", "--data-dir", folder], stdout=subprocess.PIPE, text=True, timeout=60)
            self.assertEqual(checked.returncode, 0, checked.stdout)
            catalog = sqlite3.connect(os.path.join(folder, "catalog.sqlite"))
            keys = {key for table in ("geometries", "setups") for (key,) in catalog.execute(f"SELECT id FROM {table}")}
            catalog.close()
            rows = []
            for tenant in self.tenants:
                suffix = "" if tenant.name == "default" else f".{tenant.name}"
                for geometry in self.geometries:
                    for k, one in enumerate([geometry.id, *geometry.systems]):
                        rows.append(((tenant.name, geometry.id),
                                     Operation("backup", ("see", 1 << k, one + suffix in keys), start, end, True, os.path.basename(folder))))
            self.record.add(rows, [], "backup")

    def judge(self, kills, stops):
        objects, wrong = {}, []
        for key, operation in self.record.operations:
            if not operation.certain:
                operation.end = self.server.settled(operation.end) or operation.end
            objects.setdefault(key, []).append(operation)
        for (tenant, geometry), operations in sorted(objects.items()):
            violation = check(operations)
            if violation:
                found = contradiction(operations, violation, SYSTEMS)
                begin = found[0].start
                around = [f"  {death - begin:9.4f} the server died" for death in self.server.deaths if begin < death < found[-1].end]
                around += [f"  {start - begin:9.4f} a server answered" for start in self.server.starts if begin < start < found[-1].end]
                wrong.append(f"geometry {geometry[:16]} of {tenant}; before the last answer the state was one of {sorted(violation.before)}\n"
                             + described(found, begin) + "\n" + "\n".join(around))
        functions = Functions()
        for question, answer, who in self.record.answers:
            first = functions.differs(question, answer, who)
            if first:
                wrong.append(f"{question}: {who} got {answer}, {first} got another answer before")
        operations = sum(len(one) for one in objects.values())
        lost = sum(not o.certain for one in objects.values() for o in one)
        print(f"{kills} kills, {stops} stops, {len(self.record.answers)} answers compared, {operations} operations, {lost} of them not "
              f"answered, disk failures {self.disk.failures}\n{dict(sorted(self.done.items()))}\n{dict(sorted(self.record.counts.items()))}",
              file=sys.stderr)
        faults = re.findall(r".*(?:INTERNAL|terminate|Assertion).*", self.server.log_text())
        self.assertEqual(faults, [])
        if wrong:
            self.fail("\n" + "\n".join(wrong))


class Operator:
    """Calls of the operator; those that fail with the server do not matter."""

    def __init__(self, address, tenant):
        self.address, self.tenant = address, tenant

    def __enter__(self):
        self.client = Client(99, SEED, self.tenant, [], self.address, Record())
        return self.call

    def call(self, method, request):
        import grpc
        try:
            getattr(self.client.admin, method)(request, timeout=20, metadata=self.tenant.metadata)
            return True
        except grpc.RpcError:
            return False

    def __exit__(self, *_):
        self.client.channel.close()


if __name__ == "__main__":
    unittest.main(verbosity=2)

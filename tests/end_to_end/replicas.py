# SPDX-License-Identifier: GPL-3.0-or-later
"""Three servers, and clients at work while they are killed, emptied and restarted; with a proxy before them; with a store that they
share."""

import os
import shutil
import socket
import subprocess
import sys
import tempfile
import time

from harness import AHMED_SETUP, LONG, EndToEnd, Server, read_bytes

SOURCE = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
sys.path.insert(0, os.path.join(SOURCE, "tests", "support"))
import postgres  # noqa: E402

CLIENTS = 8 if LONG else 4
DESIGNS = 1000 if LONG else 500  # of each


def free_port():
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return one.getsockname()[1]


class Replicas(EndToEnd):
    """Servers that share nothing."""

    down_seconds = 0.1  # of a server that was killed
    up_seconds = 0  # at least, until the next one
    designs = DESIGNS  # while servers are killed

    def setUp(self):
        super().setUp()
        self.servers = []
        for k in range(3):
            folder = self.path(f"server{k}")
            os.mkdir(folder)
            self.servers.append(self.new_server(folder, k).start())

    def new_server(self, folder, number):
        return Server(folder, *self.options_of(number))

    def empty(self, server):
        """What a server that is down may lose."""
        shutil.rmtree(server.data)

    def tearDown(self):
        for server in self.servers:
            server.stop()
        super().tearDown()

    def options_of(self, number):
        return []

    def write_cases(self, designs):
        """Meshes of different sizes, so that the servers share them."""
        for k in range(CLIENTS):
            self.deform("sample", "-o", f"body{k}.obj", "--points", 2000 + 800 * k)
            self.write(f"setup{k}.yaml", AHMED_SETUP.replace("ahmed.obj", f"body{k}.obj"))
        rows = [f"{0.04 * (i % 17) / 17},{0.15 * (i % 23) / 23 - 0.05}" for i in range(designs)]
        self.write("designs.csv", "\n".join(["roof_up,slant_turn", *rows]) + "\n")

    def sweeps(self, output):
        return [self.spawn("sweep", f"setup{k}.yaml", "--designs", "designs.csv", "-o", f"{output}{k}", "--batch", 5)
                for k in range(CLIENTS)]

    def all_succeed(self, children):
        for child in children:
            self.assertEqual(child.wait(600), 0, child.communicate()[1])

    def meshes(self, folder):
        return {name: read_bytes(self.path(os.path.join(folder, name))) for name in os.listdir(self.path(folder))
                if name.endswith(".obj")}

    def written(self, output):
        """Meshes of all sweeps so far."""
        count = 0
        for k in range(CLIENTS):
            folder = self.path(f"{output}{k}")
            count += sum(name.endswith(".obj") for name in os.listdir(folder)) if os.path.isdir(folder) else 0
        return count

    def check_killing(self):
        """One after the other is killed, each time that a tenth of the designs has come; every second one comes back knowing nothing.
        All designs come, with the same bytes as without."""
        self.write_cases(self.designs)
        self.all_succeed(self.sweeps("alone"))
        children = self.sweeps("killed")
        kills = due = 0
        while any(child.poll() is None for child in children):
            time.sleep(0.005)
            if self.written("killed") < due:
                continue
            due = self.written("killed") + CLIENTS * self.designs // 10
            victim = self.servers[kills % 3]
            victim.kill()
            if kills % 2 == 0:
                self.empty(victim)
            kills += 1
            time.sleep(self.down_seconds)
            victim.start()
            time.sleep(self.up_seconds)
        self.all_succeed(children)
        self.assertGreaterEqual(kills, 3)
        for k in range(CLIENTS):
            alone, killed = self.meshes(f"alone{k}"), self.meshes(f"killed{k}")
            self.assertEqual(len(alone), self.designs)
            self.assertEqual(alone.keys(), killed.keys())
            self.assertEqual([name for name in alone if alone[name] != killed[name]], [])

    def check_rolling_restart(self):
        self.write_cases(DESIGNS)
        children = self.sweeps("rolled")
        for number, server in enumerate(self.servers):
            self.wait_until(lambda: self.written("rolled") >= (number + 1) * CLIENTS * DESIGNS // 10, "designs come", 120)
            self.assertEqual(server.stop(), 0)
            server.start()
        self.all_succeed(children)


class SharedStore:
    """Before Replicas in the list of bases: the servers have a folder and a database in common."""

    def setUp(self):
        if postgres.missing():
            self.skipTest(postgres.missing())
        self.postgres_folder = tempfile.mkdtemp(prefix="deform-pg-")
        self.postgres = postgres.Postgres(self.postgres_folder).create().start()
        try:
            super().setUp()
        except BaseException:
            self.drop_postgres()
            raise

    def tearDown(self):
        super().tearDown()
        self.drop_postgres()

    def drop_postgres(self):
        self.postgres.stop("immediate")
        shutil.rmtree(self.postgres_folder, ignore_errors=True)

    def options_of(self, number):
        return [*super().options_of(number), "--catalog", self.postgres.uri()]

    def new_server(self, folder, number):
        server = super().new_server(folder, number)
        server.data = self.path("shared")
        return server

    def empty(self, server):
        """Nothing is its own."""


class BehindProxy(Replicas):
    def setUp(self):
        self.metrics = [free_port() for _ in range(3)]
        super().setUp()
        self.port = free_port()
        self.proxy = None
        self.start_proxy()

    def tearDown(self):
        self.stop_proxy()
        super().tearDown()

    def stop_proxy(self):
        if self.proxy:
            self.proxy.kill()
            self.proxy.wait()

    def options_of(self, number):
        # The proxy may lose a stream (docs/operations.md): the call ends then, and the client repeats it.
        return ["--metrics-address", f"127.0.0.1:{self.metrics[number]}", "--stall-timeout", "60"]

    def proxy_settings(self):
        return {}

    def proxy_configuration(self, text):
        return text

    def start_proxy(self):
        self.launch_proxy()
        self.wait_until(lambda: self.deform("status", expect=None).code == 0 or self.proxy.poll() is not None, "haproxy answers")
        if self.proxy.poll() is not None:
            self.fail(self.proxy_log())

    def proxy_log(self):
        return read_bytes(self.path("haproxy.log")).decode()

    def launch_proxy(self, **settings):
        """The file that is shipped, but for its own port; with variables besides proxy_settings()."""
        with open(os.path.join(SOURCE, "deploy/replicas/haproxy.cfg")) as file:
            self.write("haproxy.cfg", self.proxy_configuration(file.read().replace("bind :50051", f"bind 127.0.0.1:{self.port}")))
        environment = {**os.environ, **self.proxy_settings(), **settings}
        for name, server, metrics in zip("ABC", self.servers, self.metrics):
            environment[f"DEFORMD_{name}"] = server.address
            environment[f"DEFORMD_{name}_METRICS"] = str(metrics)
        with open(self.path("haproxy.log"), "ab") as log:
            self.proxy = subprocess.Popen(["haproxy", "-db", "-f", self.path("haproxy.cfg")], stdout=log, stderr=log, env=environment)

    def environment(self):
        return {**super().environment(), "DEFORM_SERVER": f"127.0.0.1:{self.port}", "DEFORM_REPLICAS": "1"}

# SPDX-License-Identifier: GPL-3.0-or-later
"""Clients that know several servers, which share nothing: killed, emptied and restarted while sweeps run. DEFORM_LONG=1 goes on for
two minutes."""

import os
import random
import shutil
import time

from harness import AHMED_SETUP, EndToEnd, Server, main, read_bytes

LONG = bool(os.environ.get("DEFORM_LONG"))
CLIENTS = 8 if LONG else 4


class SeveralServers(EndToEnd):
    def setUp(self):
        super().setUp()
        self.servers = []
        for k in range(3):
            folder = self.path(f"server{k}")
            os.mkdir(folder)
            self.servers.append(Server(folder).start())

    def tearDown(self):
        for server in self.servers:
            server.stop()
        super().tearDown()

    def environment(self):
        return {**super().environment(), "DEFORM_SERVER": ",".join(server.address for server in self.servers)}

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

    def meshes(self, folder):
        return {name: read_bytes(self.path(os.path.join(folder, name))) for name in os.listdir(self.path(folder))
                if name.endswith(".obj")}

    def geometries(self, server):
        return self.deform("status", "--server", server.address, "--json").json["geometries"]

    def test_the_servers_share_the_geometries(self):
        self.write_cases(3)
        for k in range(CLIENTS):
            self.deform("apply", f"setup{k}.yaml", "--set", "roof_up=0.02", "-o", f"out{k}.obj")
        shares = [self.geometries(server) for server in self.servers]
        self.assertEqual(sum(shares), CLIENTS, shares)
        self.assertGreater(len([share for share in shares if share > 0]), 1, shares)
        listed = self.deform("list", "--json").json
        self.assertEqual(len(listed["geometries"]), CLIENTS)
        status = self.deform("status", "--json").json["servers"]
        self.assertEqual([one["address"] for one in status], [server.address for server in self.servers])
        self.servers[1].kill()
        down = self.deform("status", "--json", expect=3).json["servers"]
        self.assertEqual(["error" in one for one in down], [False, True, False])
        self.assertIn(self.servers[1].address, down[1]["error"]["message"])
        self.fails(3, "list", says=[self.servers[1].address])

    def test_nothing_is_lost_while_servers_are_killed(self):
        designs = 2000 if LONG else 300
        self.write_cases(designs)
        for child in self.sweeps("alone"):
            self.assertEqual(child.wait(600), 0, child.communicate()[1])
        chance = random.Random(16)
        children = self.sweeps("killed")
        end = time.time() + 120
        kills = 0
        while any(child.poll() is None for child in children) and time.time() < end:
            time.sleep(2 if LONG else 0.7)
            victim = self.servers[chance.randrange(3)]
            victim.kill()
            kills += 1
            if chance.random() < 0.5:
                shutil.rmtree(victim.data)  # it comes back knowing nothing
            time.sleep(0.2)
            victim.start()
        for child in children:
            self.assertEqual(child.wait(600), 0, child.communicate()[1])
        self.assertGreaterEqual(kills, 2)
        for k in range(CLIENTS):
            alone, killed = self.meshes(f"alone{k}"), self.meshes(f"killed{k}")
            self.assertEqual(len(alone), designs)
            self.assertEqual(alone.keys(), killed.keys())
            self.assertEqual([name for name in alone if alone[name] != killed[name]], [])

    def test_no_design_fails_in_a_rolling_restart(self):
        self.write_cases(400)
        children = self.sweeps("rolled")
        for server in self.servers:
            time.sleep(0.7)
            self.assertEqual(server.stop(), 0)
            server.start()
        for child in children:
            self.assertEqual(child.wait(600), 0, child.communicate()[1])


if __name__ == "__main__":
    main()

# SPDX-License-Identifier: GPL-3.0-or-later
"""Clients that name several servers. DEFORM_LONG=1: for minutes."""

import shutil
import signal

from harness import main
from replicas import CLIENTS, Replicas


class SeveralServers(Replicas):
    def environment(self):
        return {**super().environment(), "DEFORM_SERVER": ",".join(server.address for server in self.servers)}

    def geometries(self, server):
        return self.deform("status", "--server", server.address, "--json").json["geometries"]

    def test_the_servers_share_the_geometries(self):
        self.write_cases(3)
        for k in range(CLIENTS):
            self.deform("apply", f"setup{k}.yaml", "--set", "roof_up=0.02", "-o", f"out{k}.obj")
        shares = [self.geometries(server) for server in self.servers]
        self.assertEqual(sum(shares), CLIENTS, shares)
        listed = self.deform("list", "--json").json
        self.assertEqual(len(listed["geometries"]), CLIENTS)
        status = self.deform("status", "--json").json["servers"]
        self.assertEqual([one["address"] for one in status], [server.address for server in self.servers])
        self.servers[1].kill()
        down = self.deform("status", "--json", "--timeout", 3, expect=3).json["servers"]
        self.assertEqual(["error" in one for one in down], [False, True, False])
        self.assertIn(self.servers[1].address, down[1]["error"]["message"])
        self.fails(3, "list", "--timeout", 3, says=[self.servers[1].address])

    def test_nothing_is_lost_while_servers_are_killed(self):
        self.check_killing()

    def test_no_design_fails_in_a_rolling_restart(self):
        self.check_rolling_restart()

    def test_a_server_that_is_stopped_is_left(self):
        """It takes connections and answers nothing, as one without power does."""
        self.write_cases(200)
        children = self.sweeps("stopped")
        self.wait_until(lambda: self.written("stopped") > 20, "designs come", 60)
        for server in self.servers[:2]:
            server.process.send_signal(signal.SIGSTOP)
        self.all_succeed(children)
        self.deform("apply", "setup0.yaml", "--set", "roof_up=0.02", "-o", "after.obj", "--timeout", 20)
        for server in self.servers[:2]:
            server.process.send_signal(signal.SIGCONT)

    def test_a_sweep_by_id_survives_the_loss_of_its_server(self):
        self.write_cases(500)
        system = self.deform("prepare", "setup0.yaml", "--json").json["id"]
        child = self.spawn("sweep", system, "--source", "body0.obj", "--designs", "designs.csv", "-o", "byid0", "--batch", 5)
        self.wait_until(lambda: self.written("byid") > 20, "designs come", 60)
        owner = next(server for server in self.servers if self.geometries(server) > 0)
        owner.kill()
        self.all_succeed([child])
        self.deform("show", self.deform("prepare", "setup0.yaml", "--json").json["geometry_id"])

    def test_clients_of_a_bench_share_what_one_has_brought(self):
        self.write_cases(1)
        child = self.spawn("bench", "setup0.yaml", "--clients", 3, "--designs", 6000, "--json")
        for _ in range(2):
            self.wait_until(lambda: any(self.geometries(server) > 0 for server in self.servers), "it is brought to one", 60)
            owner = next(server for server in self.servers if self.geometries(server) > 0)
            owner.kill()
            shutil.rmtree(owner.data)
            self.assertIsNone(child.poll(), "it goes on")
            owner.start()
        self.all_succeed([child])


if __name__ == "__main__":
    main()

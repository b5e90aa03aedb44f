# SPDX-License-Identifier: GPL-3.0-or-later
"""Servers that share a store, by a folder and a catalog in PostgreSQL: what one has all have, whoever is killed. Where PostgreSQL's
server is installed. DEFORM_LONG=1: for minutes, and the figures are printed."""

import json
import os
import random
import shutil
import threading
import time
import unittest

from harness import AHMED_SETUP, DEFORMD, main, read_bytes
from replicas import LONG, BehindProxy, Replicas, SharedStore

CLIENTS = 8


def vary(mesh, client, count):
    """A mesh of which there is no second one: its first point lies a little elsewhere."""
    lines = mesh.split("\n")
    first = next(i for i, line in enumerate(lines) if line.startswith("v "))
    x, y, z = map(float, lines[first].split()[1:4])
    lines[first] = f"v {x - 1e-7 * (1000 * client + count)!r} {y!r} {z!r}"
    return "\n".join(lines)


class OneStore(SharedStore, Replicas):
    def environment(self):
        return {**super().environment(), "DEFORM_SERVER": ",".join(server.address for server in self.servers)}

    def at(self, server):
        return ["--server", server.address]

    def write_case(self, name="ahmed", points=2000):
        self.deform("sample", "-o", f"{name}.obj", "--points", points)
        self.write(f"{name}.yaml", AHMED_SETUP.replace("ahmed.obj", f"{name}.obj"))
        return f"{name}.yaml"

    def test_what_one_server_has_all_have(self):
        a, b, c = self.servers
        system = self.deform("prepare", self.write_case(), "--json", *self.at(a)).json
        for server in self.servers:
            self.deform("apply", system["id"], "--source", "ahmed.obj", "--set", "roof_up=0.03", "-o", f"{server.port}.obj", *self.at(server))
            self.assertEqual(len(self.deform("list", "geometries", "--json", *self.at(server)).json["geometries"]), 1)
        self.assertEqual(len({read_bytes(self.path(f"{server.port}.obj")) for server in self.servers}), 1)
        self.assertEqual(len(self.deform("list", "geometries", "--json").json["geometries"]), 1)
        self.deform("remove", system["geometry_id"], "--with-setups", *self.at(b))
        for server in self.servers:
            self.fails(1, "show", system["id"], *self.at(server), says=["no geometry and no system has the id"])
        self.wait_until(lambda: self.deform("status", "--json", *self.at(c)).json["systems_resident"] == 0, "it is forgotten")
        self.assertEqual(os.listdir(self.path("shared/geometries")), [])

    def test_another_server_takes_over_systems_that_are_known_by_their_ids_only(self):
        system = self.deform("prepare", self.write_case(), "--json").json["id"]
        self.write("designs.csv", "roof_up\n" + "\n".join(f"{0.04 * (i % 17) / 17}" for i in range(400)) + "\n")
        child = self.spawn("sweep", system, "--source", "ahmed.obj", "--designs", "designs.csv", "-o", "byid", "--batch", 5)
        self.wait_until(lambda: os.path.isdir(self.path("byid")) and len(os.listdir(self.path("byid"))) > 20, "designs come", 60)
        owner = max(self.servers, key=lambda server: self.deform("status", "--json", *self.at(server)).json["designs_served"])
        owner.kill()
        self.all_succeed([child])
        self.assertEqual(sum(name.endswith(".obj") for name in os.listdir(self.path("byid"))), 400)

    def test_no_design_fails_in_a_rolling_restart(self):
        self.check_rolling_restart()

    def test_restarts_of_the_database_cost_nothing(self):
        """Designs go on; what has to be stored is stored, a little later."""
        self.write_cases(300)
        systems = [self.deform("prepare", f"setup{k}.yaml", "--json").json["id"] for k in range(2)]
        children = [self.spawn("sweep", system, "--source", f"body{k}.obj", "--designs", "designs.csv", "-o", f"out{k}", "--batch", 5)
                    for k, system in enumerate(systems)]
        for how in ("fast", "immediate"):
            self.postgres.stop(how)
            late = self.spawn("register", self.write_case(how, 2000 + 1000 * len(how)).replace(".yaml", ".obj"), "--json")
            time.sleep(1)
            self.postgres.start()
            self.all_succeed([late])
        self.all_succeed(children)
        self.assertEqual(len(self.deform("list", "geometries", "--json").json["geometries"]), 4)

    def test_what_a_database_that_is_gone_means_is_said(self):
        self.deform("prepare", self.write_case())
        one = self.at(self.servers[0])
        self.postgres.stop()
        self.fails(3, "list", "geometries", *one, says=["the database cannot be reached"])
        self.wait_until(lambda: not self.deform("status", "--json", *one).json["store"]["writable"], "it is noticed")
        self.assertIn("cannot be reached", self.deform("status", "--json", *one).json["store"]["reason"])
        self.assertIn(".s.PGSQL", self.servers[0].log_text())  # the address is for the operator
        self.postgres.start()
        self.wait_until(lambda: self.deform("status", "--json", *one).json["store"]["writable"], "it is back")
        self.deform("list", "geometries", *one)

    def test_passwords_are_neither_taken_nor_shown(self):
        extra = type(self.servers[0])(self.path("server0"), "--catalog", self.postgres.uri().replace("///", "//u:hush@/"))
        with self.assertRaises(RuntimeError) as refused:
            extra.start()
        self.assertIn("it has a password", str(refused.exception))
        self.assertNotIn("hush", str(refused.exception))
        for server in self.servers:
            self.assertNotIn("hush", server.log_text())

    def check_operations_while_killing(self, seconds, every):
        """Clients register, prepare, deform and delete; one after the other server is killed at random. What was acknowledged holds, and
        every design has the bytes that it had before."""
        for k in range(CLIENTS):
            self.write_case(f"client{k}", 2000 + 50 * k)
        systems = [self.deform("prepare", f"client{k}.yaml", "--json").json for k in range(CLIENTS)]
        for k, system in enumerate(systems):
            self.deform("apply", system["id"], "--source", f"client{k}.obj", "--set", "roof_up=0.03", "-o", f"expected{k}.obj")
        expected = [read_bytes(self.path(f"expected{k}.obj")) for k in range(CLIENTS)]
        end = time.time() + seconds
        wrong, failed, stored, deleted, counts, slowest = [], [], {}, {}, dict(designs=0, prepared=0, deleted=0), [0.0]
        lock = threading.Lock()

        def client(k):
            chance = random.Random(k)
            mine, count = [], 0
            while time.time() < end:
                began = time.time()
                result = self.deform("apply", systems[k]["id"], "--source", f"client{k}.obj", "--set", "roof_up=0.03",
                                     "-o", f"out{k}.obj", expect=None)
                with lock:
                    slowest[0] = max(slowest[0], time.time() - began)
                    counts["designs"] += 1
                    if result.code != 0:
                        failed.append(result.err)
                    elif read_bytes(self.path(f"out{k}.obj")) != expected[k]:
                        wrong.append(k)
                name = f"own{k}"
                count += 1
                self.write(f"{name}.obj", vary(read_bytes(self.path(f"client{k}.obj")).decode(), k, count))
                self.write(f"{name}.yaml", AHMED_SETUP.replace("ahmed.obj", f"{name}.obj"))
                result = self.deform("prepare", f"{name}.yaml", "--json", expect=None)
                if result.code == 0:
                    mine.append(result.json)
                    with lock:
                        stored[result.json["id"]] = result.json
                        counts["prepared"] += 1
                else:
                    with lock:
                        failed.append(result.out + result.err)
                if len(mine) > 3:
                    gone = mine.pop(chance.randrange(3))
                    with lock:
                        stored.pop(gone["id"], None)
                    # At one server: a client that names several has it deleted at all, whatever they share, and fails without one of them.
                    for server in chance.sample(self.servers, 3):
                        if self.deform("remove", gone["geometry_id"], "--with-setups", *self.at(server), expect=None).code == 0:
                            with lock:
                                deleted[gone["id"]] = gone
                                counts["deleted"] += 1
                            break

        threads = [threading.Thread(target=client, args=(k,)) for k in range(CLIENTS)]
        for thread in threads:
            thread.start()
        kills, chance = 0, random.Random(4711)
        while time.time() + every < end:
            time.sleep(every)
            victim = chance.choice(self.servers)
            victim.kill()
            kills += 1
            time.sleep(0.3)
            victim.start()
        for thread in threads:
            thread.join()
        listed = [{one["id"] for one in self.deform("list", "systems", "--json", *self.at(server)).json["systems"]} for server in self.servers]
        lost = [one for one in stored if any(one not in ids for ids in listed)]
        back = [one for one in deleted if any(one in ids for ids in listed)]
        figures = dict(kills=kills, seconds=seconds, **counts, failed=len(failed), wrong=len(wrong), lost=len(lost), back=len(back),
                       checked=len(stored) + len(deleted), slowest_design=round(slowest[0], 2))
        if LONG:
            print("figures", json.dumps(figures), flush=True)
        self.assertEqual((wrong, lost, back), ([], [], []), figures)
        self.assertEqual(failed, [], figures)
        self.assertGreater(kills, 2)
        damaged = self.deform("admin", "check", *self.at(self.servers[0]), expect=None)
        self.assertEqual(damaged.code, 0, damaged.out + damaged.err)
        for server in self.servers:
            self.assertEqual(server.stop(), 0)

    def test_nothing_acknowledged_is_lost_while_servers_are_killed(self):
        self.check_operations_while_killing(*((120, 2) if LONG else (12, 2)))


@unittest.skipUnless(shutil.which("haproxy"), "haproxy is not installed")
class OneStoreBehindProxy(SharedStore, BehindProxy):
    up_seconds = 1  # a call has four attempts, and here nothing takes long in between

    def proxy_settings(self):
        return {"DEFORMD_READYZ": "/readyz?exclude=store"}

    def test_nothing_is_lost_while_servers_are_killed(self):
        self.check_killing()

    def test_no_design_fails_in_a_rolling_restart(self):
        self.check_rolling_restart()




if __name__ == "__main__":
    main()

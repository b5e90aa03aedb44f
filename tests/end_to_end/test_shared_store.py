# SPDX-License-Identifier: GPL-3.0-or-later
"""Servers that share a store, by a folder and a catalog in PostgreSQL: what one has all have, whoever is killed. Where PostgreSQL's
server is installed. DEFORM_LONG=1: for minutes, and the figures are printed."""

import collections
import datetime
import json
import os
import random
import re
import shutil
import subprocess
import threading
import time
import unittest

from harness import AHMED_SETUP, DEFORMD, Server, long_test, main, read_bytes
from replicas import DESIGNS, LONG, BehindProxy, Replicas, SharedStore

CLIENTS = 8


def vary(mesh, client, count):
    """A mesh of which there is no second one: its first point lies a little elsewhere."""
    lines = mesh.split("\n")
    first = next(i for i, line in enumerate(lines) if line.startswith("v "))
    x, y, z = map(float, lines[first].split()[1:4])
    lines[first] = f"v {x - 1e-7 * (1000 * client + count)!r} {y!r} {z!r}"
    return "\n".join(lines)


class Preparations:
    """Which server prepared which system when, by the logs."""

    def setUp(self):
        self.killed = []  # servers, and the moment before
        super().setUp()

    def options_of(self, number):
        return [*super().options_of(number), "--log-level", "debug", "--log-format", "json", "--stored-bases-from", "0.2"]

    def preparations(self):
        """System -> [(server, begin, end)]. What a kill has ended has no line: it ended then, or later."""
        found = {}
        for server in self.servers:
            kills = sorted(when for victim, when in self.killed if victim is server)
            begun = {}
            for line in server.log_text().splitlines():
                try:
                    line = json.loads(line)
                except ValueError:
                    continue  # cut off by a kill
                words = re.match(r"engine: (begins to prepare|ends preparing) system (\S+)", line.get("message", ""))
                if words is None:
                    continue
                when = datetime.datetime.fromisoformat(line["time"].replace("Z", "+00:00")).timestamp()
                if words[1].startswith("ends"):
                    found.setdefault(words[2], []).append((server.port, begun.pop(words[2], when), when))
                    continue
                if words[2] in begun:
                    found.setdefault(words[2], []).append((server.port, begun[words[2]], next(k for k in kills if k >= begun[words[2]])))
                begun[words[2]] = when
            for system, when in begun.items():
                found.setdefault(system, []).append((server.port, when, next((k for k in kills if k >= when), when)))
        return found

    def prepared_twice_at_once(self):
        """Systems that two servers prepared at the same time."""
        twice = []
        for system, spans in self.preparations().items():
            spans.sort(key=lambda span: span[1])
            twice += [(system, a, b) for a, b in zip(spans, spans[1:]) if b[0] != a[0] and b[1] < a[2]]
        return twice


class Killing:
    """Before a class with servers in the list of bases."""

    def at(self, server):
        return ["--server", server.address]

    def write_case(self, name="ahmed", points=2000):
        self.deform("sample", "-o", f"{name}.obj", "--points", points)
        self.write(f"{name}.yaml", AHMED_SETUP.replace("ahmed.obj", f"{name}.obj"))
        return f"{name}.yaml"

    def write_large_case(self, name, points):
        """Every handle and fixed point is a centre of its dense system."""
        setup = self.write_case(name, points)
        with open(self.path(setup)) as file:
            text = file.read()
        self.write(setup, text.replace("{kernel: TRIHARMONIC}", "{kernel: TRIHARMONIC, reduction: REDUCTION_OFF, solver: CHOLESKY}"))
        return setup

    def more_figures(self):
        """What is counted besides; asserted by whoever knows it."""
        return {}

    def seen_of(self, environment):
        """What is known of the calls of a command that failed."""
        return ""

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
                def traced(kind):
                    """Names the command for those who look at its calls."""
                    return {"TRACEPARENT": f"00-{kind}{k + 1:015x}{count + 1:016x}-00f067aa0ba902b7-01"}

                result = self.deform("apply", systems[k]["id"], "--source", f"client{k}.obj", "--set", "roof_up=0.03",
                                     "-o", f"out{k}.obj", expect=None, environment=traced("d"))
                with lock:
                    slowest[0] = max(slowest[0], time.time() - began)
                    counts["designs"] += 1
                    if result.code != 0:
                        failed.append(result.err + self.seen_of(traced("d")))
                    elif read_bytes(self.path(f"out{k}.obj")) != expected[k]:
                        wrong.append(k)
                name = f"own{k}"
                count += 1
                self.write(f"{name}.obj", vary(read_bytes(self.path(f"client{k}.obj")).decode(), k, count))
                self.write(f"{name}.yaml", AHMED_SETUP.replace("ahmed.obj", f"{name}.obj"))
                result = self.deform("prepare", f"{name}.yaml", "--json", expect=None, environment=traced("c"))
                if result.code == 0:
                    mine.append(result.json)
                    with lock:
                        stored[result.json["id"]] = result.json
                        counts["prepared"] += 1
                else:
                    with lock:
                        failed.append(result.out + result.err + self.seen_of(traced("c")))
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
            self.killed.append((victim, time.time()))
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
                       checked=len(stored) + len(deleted), slowest_design=round(slowest[0], 2), **self.more_figures())
        if LONG:
            print("figures", json.dumps(figures), flush=True)
        self.assertEqual((wrong, lost, back), ([], [], []), figures)
        self.assertEqual(failed, [], figures)
        self.assertGreater(kills, 2)
        self.assertGreater(sum(len(spans) for spans in self.preparations().values()), CLIENTS)
        self.assertEqual(self.prepared_twice_at_once(), [], figures)
        damaged = self.deform("admin", "check", *self.at(self.servers[0]), expect=None)
        self.assertEqual(damaged.code, 0, damaged.out + damaged.err)
        for server in self.servers:
            self.assertEqual(server.stop(), 0)


class OneStore(Killing, Preparations, SharedStore, Replicas):
    def environment(self):
        return {**super().environment(), "DEFORM_SERVER": ",".join(server.address for server in self.servers)}

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

    def test_a_server_that_dies_is_replaced_without_preparing(self):
        """What takes longer to prepare leaves its basis to the others, and to itself after a restart."""
        setup = self.write_large_case("many", 8000)
        a, b, c = self.servers

        def apply_at(server, name):
            self.deform("apply", system, "--source", "many.obj", "--set", "roof_up=0.03", "-o", name, *self.at(server))
            return read_bytes(self.path(name))

        system = self.deform("prepare", setup, "--json", *self.at(a)).json["id"]
        before = apply_at(a, "before.obj")
        self.wait_until(lambda: os.path.exists(self.path(f"shared/bases/{system}.basis")), "its basis is stored")
        self.killed.append((a, time.time()))
        a.kill()
        self.assertEqual(apply_at(b, "after.obj"), before)
        a.start()
        self.assertEqual(apply_at(a, "back.obj"), before)
        self.assertIn("1 bases", self.deform("admin", "check", *self.at(b)).out)
        self.assertEqual(len(self.preparations()[system]), 1)
        self.deform("remove", system, *self.at(c))
        self.assertEqual(os.listdir(self.path("shared/bases")), [])

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

    def store(self, *arguments):
        done = subprocess.run([DEFORMD, "store", *arguments], capture_output=True, text=True, timeout=120, check=False)
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
        return done.stdout

    def test_a_backup_becomes_a_store_of_one_server_and_comes_back(self):
        system = self.deform("prepare", self.write_case(), "--json").json
        self.deform("apply", system["id"], "--source", "ahmed.obj", "--set", "roof_up=0.03", "-o", "before.obj")
        self.deform("admin", "backup", self.path("monday"), *self.at(self.servers[1]))
        shared = ["--catalog", self.postgres.uri(), "--data-dir", self.path("shared")]
        self.store("backup", self.path("tuesday"), *shared)
        self.assertIn("every file is whole", self.store("check", *shared))
        for name in ("monday", "tuesday"):
            self.assertIn("1 geometries, 1 setups: every file is whole", self.store("check", "--data-dir", self.path(name)))
        os.mkdir(self.path("alone"))
        self.store("restore", self.path("monday"), "--data-dir", self.path("alone/data"))
        alone = Server(self.path("alone")).start()
        self.addCleanup(alone.stop)
        self.deform("apply", system["id"], "--source", "ahmed.obj", "--set", "roof_up=0.03", "-o", "alone.obj", *self.at(alone))
        self.assertEqual(read_bytes(self.path("alone.obj")), read_bytes(self.path("before.obj")))
        self.assertEqual(alone.stop(), 0)
        self.deform("remove", system["geometry_id"], "--with-setups", *self.at(self.servers[0]))
        self.assertIn("added 1 geometries, 1 setups", self.store("import", self.path("alone/data"), *shared))
        self.assertIn("added 0 geometries, 0 setups", self.store("import", self.path("alone/data"), *shared))
        for server in self.servers:
            self.deform("apply", system["id"], "--source", "ahmed.obj", "--set", "roof_up=0.03", "-o", "after.obj", *self.at(server))
            self.assertEqual(read_bytes(self.path("after.obj")), read_bytes(self.path("before.obj")))

    def test_nothing_acknowledged_is_lost_while_servers_are_killed(self):
        self.check_operations_while_killing(*((120, 2) if LONG else (12, 2)))


@unittest.skipUnless(shutil.which("haproxy"), "haproxy is not installed")
class OneStoreBehindProxy(Killing, Preparations, SharedStore, BehindProxy):
    up_seconds = 1  # a call has four attempts, and here nothing takes long in between
    designs = 3 * DESIGNS  # no call waits for a server that is down

    def proxy_settings(self):
        return {"DEFORMD_READYZ": "/readyz?exclude=store"}

    def proxy_configuration(self, text):
        """A line of the log for each call that comes, with the trace of the command that made it."""
        text = text.replace("  maxconn 4000\n", "  maxconn 4000\n  log stdout format raw local0\n", 1)
        text = text.replace("  default_backend replicas\n", "  default_backend replicas\n  log global\n  http-request capture req.hdr(traceparent) len 60\n"
                            "  log-format \"call %HP %[capture.req.hdr(0)] %s %ST %ts\"\n", 1)
        return text

    def seen_of(self, environment):
        with open(self.path("haproxy.log")) as file:
            return "".join(line for line in file if environment["TRACEPARENT"] in line)

    def retries(self, kind):
        """How many calls of each command of the kind came again: as the proxy saw them."""
        calls = re.findall(rf"^call \S*/deform\.v1\.DeformService/(\w+) 00-({kind}\w{{31}})-", read_bytes(self.path("haproxy.log")).decode(), re.MULTILINE)
        again = dict.fromkeys((trace for _, trace in calls), 0)
        for (_, trace), count in collections.Counter(calls).items():
            again[trace] += count - 1
        return list(again.values())

    def more_figures(self):
        designs, prepared = self.retries("d"), self.retries("c")
        return dict(designs_counted=len(designs), designs_retried=sum(map(bool, designs)), most_retries_of_a_design=max(designs, default=0),
                    preparations_retried=sum(map(bool, prepared)), most_retries_of_a_preparation=max(prepared, default=0))

    def test_nothing_acknowledged_is_lost_while_servers_are_killed(self):
        self.check_operations_while_killing(*((120, 2) if LONG else (9, 2)))
        retries = self.retries("d")
        self.assertGreater(len(retries), CLIENTS)
        self.assertLessEqual(max(retries), 1)

    def test_designs_of_a_large_system_go_on_when_its_server_dies(self):
        """Whoever prepared it is killed between designs, and then whoever took over: nobody prepares it again."""
        setup = self.write_large_case("large", 45000 if LONG else 6000)
        system = self.deform("prepare", setup, "--json").json
        self.wait_until(lambda: os.path.exists(self.path(f"shared/bases/{system['id']}.basis")), "its basis is stored", 120)
        seconds, points, counts = [], set(), []
        for number in range(60):
            if number in (20, 40):
                served = [self.deform("status", "--json", *self.at(server)).json["designs_served"] for server in self.servers]
                owner = self.servers[max(range(3), key=lambda k: served[k] - (counts[-1][k] if counts else 0))]
                counts.append(served)
                self.killed.append((owner, time.time()))
                owner.kill()
            elif number in (30, 50):
                self.killed[-1][0].start()
            began = time.time()
            self.deform("apply", system["id"], "--source", "large.obj", "--set", "roof_up=0.03", "-o", "out.obj")
            seconds.append(time.time() - began)
            points.add(read_bytes(self.path("out.obj")))
        seconds.sort()
        if LONG:
            self.assertGreaterEqual(system["centres"], 15000)
            print("figures", json.dumps(dict(centres=system["centres"], median=round(seconds[30], 3), slowest=round(seconds[-1], 3))), flush=True)
        self.assertEqual(len(points), 1)
        self.assertNotEqual(self.killed[0][0], self.killed[1][0])
        self.assertEqual(len(self.preparations()[system["id"]]), 1)

    @long_test
    def test_nothing_is_lost_while_servers_are_killed(self):
        self.check_killing()

    def test_no_design_fails_in_a_rolling_restart(self):
        self.check_rolling_restart()


if __name__ == "__main__":
    main()

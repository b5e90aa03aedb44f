# SPDX-License-Identifier: GPL-3.0-or-later
"""deform admin on a running server: what the operator sees and does, and what its clients are told."""

import hashlib
import os
import re
import signal
import subprocess
import time
import urllib.error
import urllib.request

from harness import AHMED_SETUP, DEFORMD, LONG_SETUP, EndToEnd, Server, main

OPERATOR = "the operator of the server cancelled this call"


class Admin(EndToEnd):
    def calls(self, *options):
        return self.deform(*options, "admin", "calls", "--json").json["calls"]

    def long_preparation(self, *options):
        """A preparation that takes minutes, under way."""
        self.deform("sample", "-o", "long.obj", "--points", 20000)
        self.write("long.yaml", LONG_SETUP)
        child = self.spawn(*options, "prepare", "long.yaml")
        self.wait_until(lambda: any(c["method"] == "Prepare" and c["state"] == "CALL_PREPARING" for c in self.calls()), "it is prepared", 60)
        return child

    def prepared(self):
        self.deform("sample", "-o", "ahmed.obj", "--points", 2000)
        self.write("setup.yaml", AHMED_SETUP)
        return self.deform("prepare", "setup.yaml", "--json").json["id"]

    def test_a_client_that_was_suspended_gets_the_rest(self):
        """The server does not wait longer for it than it is told to, and the client asks again for what it lacks."""
        designs = 600
        self.start_server("--stall-timeout", "2")
        self.deform("sample", "-o", "ahmed.obj", "--points", 20000)
        self.write("setup.yaml", AHMED_SETUP)
        self.deform("prepare", "setup.yaml")
        self.write("designs.csv", "\n".join(["roof_up", *(f"{0.04 * k / designs}" for k in range(designs))]) + "\n")
        child = self.spawn("sweep", "setup.yaml", "--designs", "designs.csv", "-o", "swept", "--batch", designs // 2)
        self.wait_until(lambda: os.path.isdir(self.path("swept")) and len(os.listdir(self.path("swept"))) > 5, "designs come", 60)
        child.send_signal(signal.SIGSTOP)
        self.assertEqual([call["method"] for call in self.calls()], ["Deform", "Deform"])
        self.wait_until(lambda: self.calls() == [], "the calls end")
        child.send_signal(signal.SIGCONT)
        _, err = child.communicate(timeout=120)
        self.assertEqual(child.returncode, 0, err)
        self.assertEqual(sum(name.endswith(".obj") for name in os.listdir(self.path("swept"))), designs)
        self.assertEqual(self.server.log_text().count("the client took nothing of the answer for 2 s (--stall-timeout)"), 2)

    def test_a_long_preparation_is_listed_and_cancelled(self):
        self.start_server()
        before = self.status()["memory_in_use"]
        child = self.long_preparation()
        self.wait_until(lambda: self.status()["memory_in_use"] > before + (64 << 20), "it takes memory", 60)
        [call] = self.calls()
        self.assertEqual((call["method"], call["tenant"], len(call["system"])), ("Prepare", "default", 64))
        table = self.deform("admin", "calls").out.splitlines()
        self.assertRegex(table[0], r"^ID +METHOD +STATE +AGE +IN STATE +HOLDS +COST +WHO +FROM +ABOUT$")
        self.assertRegex(table[1], rf"^{call['id']} +Prepare +preparing .* ipv4:127\.0\.0\.1:\d+ +system {call['system'][:16]}$")
        started = time.time()
        said = self.deform("admin", "cancel", call["id"], "--reason", "it fills the machine").out
        self.assertRegex(said, r"^cancelled Prepare of ipv4:.*, which was preparing after ")
        _, err = child.communicate(timeout=30)
        self.assertLess(time.time() - started, 10)
        self.assertIn(f"{OPERATOR}: it fills the machine", err)
        self.assertEqual(child.returncode, 130)
        self.wait_until(lambda: self.status()["memory_in_use"] <= before + (8 << 20), "memory given back")
        time.sleep(1)
        self.assertEqual(self.calls(), [], "the client does not repeat it")
        self.assertEqual(self.deform("admin", "calls").out, "no calls under way\n")
        self.assert_logged("method=Prepare ")
        self.assertEqual(self.server.log_text().count("method=Prepare "), 1)
        self.assertRegex(self.server.log_text(), r"operator \(not asked for an identity\) at ipv4:.*: cancels call \d+, Prepare of")
        self.fails(1, "admin", "cancel", call["id"], says=[f"call {call['id']}: there is no such call"])
        self.fails(2, "admin", "cancel")

    def test_drain_sends_clients_to_another_server(self):
        second = Server(self.path("second"), "--metrics-address", "127.0.0.1:0")
        os.mkdir(second.folder)
        self.addCleanup(second.stop)
        first = self.start_server("--metrics-address", "127.0.0.1:0")
        second.start()
        port = int(re.findall(r"/readyz on port (\d+)", first.log_text())[-1])

        def ready():
            try:
                with urllib.request.urlopen(f"http://127.0.0.1:{port}/readyz", timeout=20) as reply:
                    return reply.status, reply.read().decode()
            except urllib.error.HTTPError as error:
                return error.code, error.read().decode()

        self.prepared()
        running = self.long_preparation()
        self.assertEqual(ready()[0], 200)
        self.assertRegex(self.deform("admin", "drain").out, r"^draining: new work is refused, 1 calls are under way")
        self.assertEqual(ready(), (503, "[-] accepting: draining: its operator sends clients elsewhere\n[+] store\n[+] memory\n"))
        self.assertIn(", DRAINING, up for ", self.deform("status", expect=3).out)
        self.fails(3, "apply", "setup.yaml", "--set", "roof_up=0.02", "-o", "none.obj", says=["the server is being drained"])
        both = ["--server", f"{first.address},{second.address}"]
        for k in range(3):
            self.deform("apply", *both, "setup.yaml", "--set", f"roof_up=0.0{k + 1}", "-o", f"out{k}.obj")
        served = self.deform("status", "--server", second.address, "--json").json["designs_served"]
        self.assertEqual(served, 3)
        self.assertIn(running.poll(), (None, 0), "what runs goes on, or is done")
        self.assertEqual(self.deform("admin", "undrain").out, "work is taken again\n")
        self.assertEqual(ready()[0], 200)
        self.deform("apply", "setup.yaml", "--set", "roof_up=0.02", "-o", "again.obj")
        self.assertIn(running.poll(), (None, 0))

    def test_evict(self):
        self.start_server()
        system = self.prepared()
        self.assertEqual(self.status()["systems_resident"], 1)
        self.assertRegex(self.deform("admin", "evict", system[:12]).out, r"^1 systems taken out of memory, [\d.]+ KiB|MiB$")
        self.assertEqual(self.status()["systems_resident"], 0)
        self.fails(1, "admin", "evict", system, says=["not in memory"])
        self.fails(2, "admin", "evict", says=["--all"])
        self.fails(2, "admin", "evict", system, "--all", says=["not both"])
        self.deform("apply", "setup.yaml", "--set", "roof_up=0.02", "-o", "out.obj")
        done = self.deform("admin", "evict", "--all", "--json").json
        self.assertEqual((done["systems"], done["in_use"]), (1, 0))
        self.assertGreater(done["bytes"], 1000)
        self.assertEqual(self.status()["memory_in_use"], 0)

    def test_limits_change_until_a_restart(self):
        self.start_server("--queue-limit", "100", "--max-points", "3000")
        shown = {limit["name"]: limit for limit in self.deform("admin", "limits", "--json").json["limits"]}
        self.assertEqual((shown["queue-limit"]["value"], shown["max-points"]["value"]), ("100", "3000"))
        self.assertEqual({name for name, limit in shown.items() if limit["changeable"]},
                         {"cache-budget", "log-level", "max-connections", "max-deadline", "queue-limit"})
        self.assertNotIn("data-dir", shown)
        text = self.deform("admin", "limits", "queue-limit=50", "max-deadline=600").out
        self.assertRegex(text, r"(?m)^queue-limit +50 +changed, until a restart$")
        self.assertRegex(text, r"(?m)^max-points +3000 +takes a restart$")
        self.assertEqual(self.status()["queue_limit"], 50)
        self.fails(1, "admin", "limits", "max-points=1", says=["limit max-points: takes a restart; it stays 3000"])
        self.fails(1, "admin", "limits", "queue-limt=1", says=["queue-limt", "queue-limit"])
        self.fails(2, "admin", "limits", "queue-limit", says=["NAME=VALUE"])
        self.deform("admin", "limits", "log-level=warning")
        self.deform("status")
        self.assertNotIn("method=GetServerInfo", self.server.log_text().split("sets log-level to warning")[1])
        self.server.stop()
        self.server.start()
        self.assertEqual(self.status()["queue_limit"], 100)

    def test_connections(self):
        self.start_server()
        child = self.long_preparation()
        reply = self.deform("admin", "connections", "--json").json
        self.assertEqual(sorted(c["calls"] for c in reply["connections"])[-1], 1)
        self.assertGreaterEqual(reply["open"], 2)
        self.assertRegex(self.deform("admin", "connections").out, r"(?m)^FROM +AGE +CALLS +WHO\nipv4:127\.0\.0\.1:\d+ ")
        child.kill()

    def test_store_beside_the_work(self):
        self.start_server()
        self.prepared()
        self.assertIn("1 geometries, 1 setups: every file is whole", self.deform("admin", "check").out)
        copy = self.path("copy")
        self.assertIn("1 geometries, 1 setups", self.deform("admin", "backup", copy).out)
        subprocess.run([DEFORMD, "store", "check", "--data-dir", copy], check=True, stdout=subprocess.DEVNULL, timeout=60)
        self.fails(1, "admin", "backup", copy, says=["is not empty"])
        self.fails(1, "admin", "backup", "relative", says=["not absolute"])
        [geometry] = os.listdir(os.path.join(self.server.data, "geometries"))
        with open(os.path.join(self.server.data, "geometries", geometry), "ab") as file:
            file.write(b"x")
        found = self.fails(1, "admin", "check", says=["the store has faults"], prints=True)
        self.assertIn(f"geometry {geometry}", found.out)
        help_text = self.deform("admin", "--help").out
        self.assertIn("deformd store rebuild", help_text)
        self.assertIn("deformd store restore", help_text)

    def test_roles_and_tenants(self):
        names = {"ada": "reader", "ben": "user tenant=acme", "cleo": "owner", "ops": "operator", "acme-ops": "operator tenant=acme"}
        lines = []
        for name, rest in names.items():
            token = f"{name}-secret-of-this-test"
            self.write(f"{name}.token", token + "\n")
            role, *tenant = rest.split()
            lines.append(" ".join([name, role, "sha256:" + hashlib.sha256(token.encode()).hexdigest(), *tenant]))
        self.start_server("--identities", self.write("identities", "\n".join(lines) + "\n"))

        def says(name):
            return ["--token-file", f"{name}.token"]

        verbs = [["calls"], ["cancel", 1], ["drain"], ["undrain"], ["evict", "--all"], ["connections"], ["limits"], ["limits", "queue-limit=1"],
                 ["check"], ["backup", self.path("copy")]]
        for name in ("ada", "ben", "cleo"):
            for verb in verbs:
                self.fails(1, *says(name), "admin", *verb, says=["needs the role operator"])
        self.deform("sample", "-o", "long.obj", "--points", 20000)
        self.write("long.yaml", LONG_SETUP)
        child = self.spawn(*says("ben"), "prepare", "long.yaml")
        self.wait_until(lambda: any(c["method"] == "Prepare" for c in self.calls(*says("ops"))), "a preparation", 60)
        self.assertEqual([(c["identity"], c["tenant"]) for c in self.calls(*says("acme-ops"))], [("ben", "acme")])
        [line] = self.deform(*says("ops"), "admin", "calls").out.splitlines()[1:]
        self.assertIn("ben of acme", line)
        self.assertIn("ben", self.deform(*says("ops"), "admin", "connections").out)
        for verb in (["drain"], ["undrain"], ["connections"], ["limits"], ["check"], ["backup", self.path("copy")]):
            self.fails(1, *says("acme-ops"), "admin", *verb, says=["is about the whole server", "of tenant \"acme\" alone"])
        [call] = self.calls(*says("acme-ops"))
        self.deform(*says("acme-ops"), "admin", "cancel", call["id"])
        self.assertIn(OPERATOR, child.communicate(timeout=30)[1])
        self.assertRegex(self.server.log_text(), rf"operator acme-ops at ipv4:.*: cancels call {call['id']}, Prepare of ben")
        self.assertFalse(os.path.exists(self.path("copy")))


if __name__ == "__main__":
    main()

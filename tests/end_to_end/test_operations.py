# SPDX-License-Identifier: GPL-3.0-or-later
"""What those who look after a server see: figures, health, the log under rotation, a reload."""

import json
import os
import re
import signal
import socket
import subprocess
import threading
import urllib.error
import urllib.request

from harness import AHMED_SETUP, DEFORM, DEFORMD, EndToEnd, main

MONITORING = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..", "deploy", "monitoring")


def promtool(*arguments, text=""):
    done = subprocess.run(["promtool", *arguments], input=text, cwd=MONITORING, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    return done.returncode, done.stdout


def content(path):
    """Empty where there is no such file."""
    if not os.path.exists(path):
        return ""
    with open(path) as file:
        return file.read()


class Operations(EndToEnd):
    def start(self, *options):
        server = self.start_server("--metrics-address", "127.0.0.1:0", *options)
        self.port = int(re.findall(r"/readyz on port (\d+)", server.log_text())[-1])
        return server

    def get(self, path):
        """Status and body."""
        try:
            with urllib.request.urlopen(f"http://127.0.0.1:{self.port}{path}", timeout=20) as reply:
                return reply.status, reply.read().decode()
        except urllib.error.HTTPError as error:
            return error.code, error.read().decode()

    def figures(self):
        """Value by name with labels."""
        status, text = self.get("/metrics")
        self.assertEqual(status, 200)
        return {line.rsplit(" ", 1)[0]: float(line.rsplit(" ", 1)[1]) for line in text.splitlines() if not line.startswith("#")}

    def test_the_log_names_the_trace_of_a_call_and_counts_what_is_too_much(self):
        server = self.start("--log-calls", "2")
        trace = "0af7651916cd43dd8448eb211c80319c"
        environment = {**self.environment(), "TRACEPARENT": f"00-{trace}-b7ad6b7169203331-01"}
        subprocess.run([DEFORM, "status"], env=environment, check=True, stdout=subprocess.DEVNULL, timeout=60)
        self.assert_logged(f"method=GetServerInfo client=.* trace={trace} ", server)
        children = [self.spawn("bench", self.prepared(), "--designs", 200, "--population", 1) for _ in range(2)]
        for child in children:
            self.assertEqual(child.wait(120), 0)

        def left_out():
            self.deform("status")
            return sum(map(int, re.findall(r"(\d+) calls are not in this log", server.log_text())))

        self.wait_until(lambda: left_out() >= 200, "the others were counted")

    def test_the_health_check_asks_whether_the_server_lives(self):
        script = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..", "deploy", "health-check")
        server = self.start()

        def check(address):
            return subprocess.run([script], env={"PATH": "/usr/bin:/bin", "DEFORMD_METRICS_ADDRESS": address}, timeout=60,
                                  stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)

        for address in (f"0.0.0.0:{self.port}", f"127.0.0.1:{self.port}"):
            done = check(address)
            self.assertEqual(done.returncode, 0, done.stdout)
            self.assertIn("[+] ", done.stdout)
        server.process.send_signal(signal.SIGSTOP)
        try:
            self.assertNotEqual(check(f"127.0.0.1:{self.port}").returncode, 0, "it hangs")
        finally:
            server.process.send_signal(signal.SIGCONT)
        server.stop()
        done = check(f"[::]:{self.port}")
        self.assertNotEqual(done.returncode, 0)
        self.assertIn("::1", done.stdout)

    def test_the_server_needs_no_library_of_mesh_files(self):
        """The image of deformd alone has none."""
        libraries = subprocess.run(["ldd", DEFORMD], check=True, stdout=subprocess.PIPE, text=True, timeout=60).stdout
        self.assertIn("libgrpc++", libraries)
        for name in ("libcgns", "libnetcdf", "libhdf5"):
            self.assertNotIn(name, libraries)

    def test_an_error_names_its_call_in_the_log(self):
        server = self.start()
        failed = self.fails(1, "--json", "admin", "cancel", "4711").json["error"]
        self.assertEqual(failed["code"], "NOT_FOUND")
        self.assert_logged(f"client_request={failed['request_id']} .*status=not_found", server)
        plain = self.fails(1, "admin", "cancel", "4711")
        self.assertNotIn("request id", plain.err, "nobody who looks after the server can help with a wrong number")

    def prepared(self):
        self.deform("sample", "-o", "ahmed.obj", "--points", 2000)
        self.write("setup.yaml", AHMED_SETUP)
        self.deform("prepare", "setup.yaml")
        return "setup.yaml"

    def test_figures_count_what_was_done(self):
        self.start()
        before = self.figures()
        self.deform("sample", "-o", "ahmed.obj", "--points", 2000)
        self.write("setup.yaml", AHMED_SETUP)
        for value in (0.01, 0.02, 0.03):
            self.deform("apply", "setup.yaml", "--set", f"roof_up={value}", "-o", "out.obj")
        self.wait_until(lambda: self.figures()["deformd_calls_in_progress"] == 0, "the last call has ended")
        now = self.figures()
        self.assertEqual(now["deformd_designs_served_total"] - before["deformd_designs_served_total"], 3)
        self.assertEqual(now['deformd_calls_total{method="RegisterGeometry",status="ok"}'], 1)
        self.assertEqual(now["deformd_store_geometries"], 1)
        self.assertEqual(now["deformd_cache_misses_total"], 1)
        self.assertEqual(now["deformd_cache_systems"], 1)
        self.assertEqual(now["deformd_calls_in_progress"], 0)
        self.assertGreater(now["deformd_received_bytes_total"], os.path.getsize(self.path("ahmed.obj")) / 4)
        self.assertTrue(any(k.startswith("deformd_calls_total") and 'status="not_found"' in k for k in now), "before the registration")
        # What the log says about the same calls.
        log = [line for line in self.server.log_text().splitlines() if "method=Deform" in line and "status=ok" in line]
        methods = {re.search(r"method=(\S+)", line).group(1) + (".request" if " request=" in line else "") for line in log}
        for method in methods:
            walls = [float(re.search(r"wall_ms=([\d.]+)", line).group(1)) for line in log
                     if re.search(r"method=(\S+)", line).group(1) + (".request" if " request=" in line else "") == method]
            self.assertEqual(now[f'deformd_call_seconds_count{{method="{method}"}}'], len(walls))
            self.assertAlmostEqual(now[f'deformd_call_seconds_sum{{method="{method}"}}'], sum(walls) / 1e3, delta=1e-5 * len(walls))
        self.assertGreater(now['deformd_stage_seconds_sum{stage="solve"}'], 0)
        self.assertGreaterEqual(now["deformd_store_sync_seconds_count"] - before["deformd_store_sync_seconds_count"], 4, "a geometry was stored")
        self.assertLess(now["deformd_connections_open"], 5)
        with socket.create_connection(("127.0.0.1", self.server.port)):
            self.wait_until(lambda: self.figures()["deformd_connections_open"] > 0, "a connection")

    def test_refusals_are_counted_by_their_reason(self):
        self.start("--memory-budget", "64MiB")
        refused = lambda: {name[len('deformd_refusals_total{reason="'):-2]: value for name, value in self.figures().items()
                           if name.startswith("deformd_refusals_total")}
        none = dict.fromkeys(("queue", "memory", "held", "quota", "rate", "disk", "draining", "connections"), 0)
        self.assertEqual(refused(), none)
        self.deform("sample", "-o", "ahmed.obj", "--points", 60000)
        self.write("setup.yaml", AHMED_SETUP)
        self.deform("register", "ahmed.obj", "--timeout", 3, expect=None)
        self.deform("prepare", "setup.yaml", "--timeout", 3, expect=None)
        self.wait_until(lambda: refused()["memory"] > 0, "what does not fit into the budget")
        self.deform("admin", "drain")
        self.deform("prepare", "setup.yaml", "--timeout", 3, expect=None)
        self.wait_until(lambda: refused()["draining"] > 0, "what is refused by a server that is drained")
        self.assertEqual({**refused(), "memory": 0, "draining": 0}, none)
        self.server.stop()
        self.start("--keep-free", "1000T")
        self.deform("sample", "-o", "other.obj", "--points", 2000)
        self.deform("register", "other.obj", "--timeout", 3, expect=None)
        self.wait_until(lambda: refused()["disk"] > 0, "a disk without room")

    def test_figures_are_what_prometheus_reads_and_the_rules_ask_for(self):
        self.start()
        self.deform("sample", "-o", "ahmed.obj", "--points", 2000)
        self.write("setup.yaml", AHMED_SETUP)
        self.deform("apply", "setup.yaml", "--set", "roof_up=0.01", "-o", "out.obj")
        text = self.get("/metrics")[1]
        self.assertEqual(promtool("check", "metrics", text=text), (0, ""))
        self.assertEqual(promtool("check", "config", "prometheus.yaml")[0], 0)
        code, said = promtool("test", "rules", "alerts_test.yaml")
        self.assertEqual(code, 0, said)
        known = {match for line in text.splitlines() if line.startswith("# TYPE") for match in [line.split()[2]]}
        known |= {name + suffix for name in known for suffix in ("_bucket", "_sum", "_count")}
        with open(os.path.join(MONITORING, "dashboard.json")) as file:
            asked = [t["expr"] for panel in json.load(file)["panels"] for t in panel["targets"]]
        with open(os.path.join(MONITORING, "alerts.yaml")) as file:
            asked += re.findall(r"expr: (.*)", file.read())
        names = {name for expression in asked for name in re.findall(r"\b(?:deformd|process)_\w+", expression)}
        self.assertGreater(len(names), 20)
        self.assertEqual(names - known, set())

    def test_health(self):
        self.start()
        self.assertEqual(self.get("/livez"), (200, "[+] calls\n[+] watch\n"))
        self.assertEqual(self.get("/readyz"), (200, "[+] accepting\n[+] store\n[+] memory\n"))
        self.assertEqual(self.get("/else")[0], 404)

    def test_a_store_without_room_is_not_ready_and_still_alive(self):
        self.start("--keep-free", "1000T")
        status, text = self.get("/readyz")
        self.assertEqual(status, 503)
        self.assertRegex(text, r"\[-\] store: .+")
        self.assertEqual(self.get("/livez")[0], 200)
        status, text = self.get("/readyz?exclude=store")
        self.assertEqual(status, 200, text)
        self.assertNotIn("[!]", text)
        status, text = self.get("/readyz?exclude=stroe")
        self.assertEqual(status, 503, text)
        self.assertIn('[!] exclude: there is no check "stroe"\n', text)
        self.assertEqual(self.figures()["deformd_store_writable"], 0)

    def test_slow_and_silent_connections_do_not_keep_others_waiting(self):
        self.start()
        silent = [socket.create_connection(("127.0.0.1", self.port)) for _ in range(40)]
        for connection in silent[:20]:
            connection.sendall(b"GET /metr")
        self.wait_until(lambda: self.get("/livez")[0] == 200, "an answer", seconds=60)
        for connection in silent:
            connection.close()

    def test_a_server_that_drains_is_not_ready(self):
        server = self.start("--grace", "20")
        self.deform("sample", "-o", "ahmed.obj", "--points", 40000)
        self.write("setup.yaml", AHMED_SETUP)
        busy = self.spawn("prepare", "setup.yaml")
        self.wait_until(self.busy, "a preparation")
        seen = []

        def watch():
            try:
                while True:
                    seen.append(self.get("/readyz"))
            except (OSError, urllib.error.URLError):
                pass

        watcher = threading.Thread(target=watch)
        watcher.start()
        server.process.terminate()
        self.assertEqual(server.process.wait(40), 0)
        watcher.join()
        busy.communicate()
        self.assertIn((503, "[-] accepting: the server shuts down\n[+] store\n[+] memory\n"), seen)

    def test_bad_addresses_are_refused(self):
        self.start()
        for address, says in ((f"127.0.0.1:{self.port}", "cannot listen on"), ("unix:/tmp/x", "is not HOST:PORT"), ("9464", "is not HOST:PORT"),
                              ("127.0.0.1:99999", "is not HOST:PORT")):
            done = subprocess.run([DEFORMD, "--address", "127.0.0.1:0", "--data-dir", self.path("other"), "--metrics-address", address],
                                  stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, timeout=30)
            self.assertNotEqual(done.returncode, 0)
            self.assertIn("option metrics-address", done.stderr)
            self.assertIn(says, done.stderr)

    def test_hangup_takes_limits_over(self):
        self.write("server.yaml", "queue_limit: 100\n")
        server = self.start_server("--config", self.path("server.yaml"), "--max-deadline", "60")
        limits = lambda: {limit["name"]: limit["value"] for limit in self.deform("admin", "limits", "--json").json["limits"]}
        before = limits()

        def hang_up(text, logged):
            self.write("server.yaml", text)
            server.process.send_signal(signal.SIGHUP)
            self.assert_logged(logged)

        hang_up("queue_limit: 200\ncache_budget: 3MiB\nmax_connections: 77\nmax_points: 9\nmax_deadline: 5\n",
                "option max-points=9 takes a restart; it stays 50000000")
        for line in ("queue-limit=200 .*server.yaml:1. is taken over, before 100", "cache-budget=3MiB .* is taken over, before ",
                     "max-connections=77 .* is taken over, before "):
            self.assert_logged("option " + line)
        self.assertEqual(limits(), {**before, "queue-limit": "200", "cache-budget": "3MiB", "max-connections": "77"}, "a flag wins over the file")
        until_a_restart = lambda: re.findall(r"(?m)^(\S+) .* changed, until a restart$", self.deform("admin", "limits").out)
        self.assertEqual(until_a_restart(), [], "a restart reads the same file")
        # What the operator has set stays as long as the options are what they were.
        self.deform("admin", "limits", "queue-limit=9")
        hang_up("queue_limit: 200\n", "option max-connections=0 .* is taken over, before 77")
        self.assertEqual(limits(), {**before, "queue-limit": "9"})
        self.assertEqual(until_a_restart(), ["queue-limit"])
        hang_up("queue_limit: 300\ncache_budget: 900TiB\n", "option cache-budget=.* is not taken over, it stays: limit cache-budget: more than")
        self.assertEqual(limits(), {**before, "queue-limit": "300"})
        self.assertEqual(server.stop(), 0)

    def test_hangup_reopens_the_log_and_takes_the_level_over(self):
        self.write("server.yaml", "log_level: info\nworkers: 1\n")
        log = self.path("calls.log")
        server = self.start_server("--log-file", log, "--config", self.path("server.yaml"))
        self.deform("status")
        os.rename(log, log + ".1")
        self.deform("status")
        self.assertEqual(content(log + ".1").count("method=GetServerInfo"), 2, "until the signal the old file is written")
        self.write("server.yaml", "log_level: warning\nworkers: 2\n")
        server.process.send_signal(signal.SIGHUP)
        self.wait_until(lambda: "workers=2 takes a restart; it stays 1" in content(log), "a reload")
        self.deform("status")
        self.assertNotIn("method=GetServerInfo", content(log), "level warning")
        self.write("server.yaml", "log_level: [\n")
        server.process.send_signal(signal.SIGHUP)
        self.wait_until(lambda: "options stay as they are" in content(log), "a complaint")
        self.deform("status")
        self.assertEqual(server.stop(), 0)


if __name__ == "__main__":
    main()

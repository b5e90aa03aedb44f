# SPDX-License-Identifier: GPL-3.0-or-later
"""Servers that share nothing behind the proxy of deploy/replicas, and a client that is told so: where haproxy is installed. The
manifests for Kubernetes: where kubectl is."""

import os
import re
import shutil
import socket
import subprocess
import time
import unittest

from harness import AHMED_SETUP, EndToEnd, Server, main, read_bytes

SOURCE = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
CLIENTS = 4


def free_port():
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return one.getsockname()[1]


@unittest.skipUnless(shutil.which("haproxy"), "haproxy is not installed")
class Proxy(EndToEnd):
    def setUp(self):
        super().setUp()
        self.servers = []
        for k in range(3):
            folder = self.path(f"server{k}")
            os.mkdir(folder)
            metrics = free_port()
            server = Server(folder, "--metrics-address", f"127.0.0.1:{metrics}").start()
            server.metrics = metrics
            self.servers.append(server)
        self.port = free_port()
        self.proxy = None
        self.start_proxy()

    def tearDown(self):
        if self.proxy:
            self.proxy.kill()
            self.proxy.wait()
        for server in self.servers:
            server.stop()
        super().tearDown()

    def start_proxy(self):
        """The file that is shipped, but for its own port."""
        with open(os.path.join(SOURCE, "deploy/replicas/haproxy.cfg")) as file:
            self.write("haproxy.cfg", file.read().replace("bind :50051", f"bind 127.0.0.1:{self.port}"))
        environment = dict(os.environ)
        for name, server in zip("ABC", self.servers):
            environment[f"DEFORMD_{name}"] = server.address
            environment[f"DEFORMD_{name}_METRICS"] = str(server.metrics)
        with open(self.path("haproxy.log"), "ab") as log:
            self.proxy = subprocess.Popen(["haproxy", "-db", "-f", self.path("haproxy.cfg")], stdout=log, stderr=log, env=environment)
        self.wait_until(lambda: self.deform("status", expect=None).code == 0, "haproxy answers")

    def environment(self):
        return {**super().environment(), "DEFORM_SERVER": f"127.0.0.1:{self.port}", "DEFORM_REPLICAS": "1"}

    def write_cases(self, designs):
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

    def status_of(self, server):
        return self.deform("status", "--server", server.address, "--json").json

    def test_each_geometry_stays_on_one_server(self):
        self.write_cases(10)
        for child in self.sweeps("out"):
            self.assertEqual(child.wait(600), 0, child.communicate()[1])
        for k in range(CLIENTS):
            self.deform("apply", f"setup{k}.yaml", "--set", "roof_up=0.02", "-o", f"out{k}.obj")
        status = [self.status_of(server) for server in self.servers]
        self.assertEqual(sum(one["geometries"] for one in status), CLIENTS)
        self.assertEqual(sum(one["systems_resident"] for one in status), CLIENTS)
        for server in self.servers:
            server.kill()
        self.fails(3, "list", says=["a proxy answers", "503"])

    def test_nothing_is_lost_while_servers_are_killed(self):
        self.write_cases(300)
        for child in self.sweeps("alone"):
            self.assertEqual(child.wait(600), 0, child.communicate()[1])
        children = self.sweeps("killed")
        kills = 0
        while any(child.poll() is None for child in children) and kills < 60:
            time.sleep(1)
            victim = self.servers[kills % 3]
            victim.kill()
            if kills % 2 == 0:
                shutil.rmtree(victim.data)  # it comes back knowing nothing
            time.sleep(0.5)
            victim.start()
            kills += 1
        for child in children:
            self.assertEqual(child.wait(600), 0, child.communicate()[1])
        self.assertGreaterEqual(kills, 2)
        for k in range(CLIENTS):
            alone, killed = self.meshes(f"alone{k}"), self.meshes(f"killed{k}")
            self.assertEqual(len(alone), 300)
            self.assertEqual([name for name in alone if alone[name] != killed.get(name)], [])

    def test_no_design_fails_in_a_rolling_restart(self):
        self.write_cases(300)
        children = self.sweeps("rolled")
        for server in self.servers:
            time.sleep(1)
            self.assertEqual(server.stop(), 0)
            server.start()
        for child in children:
            self.assertEqual(child.wait(600), 0, child.communicate()[1])


@unittest.skipUnless(shutil.which("kubectl"), "kubectl is not installed")
class Manifests(unittest.TestCase):
    """What kustomize makes of deploy/replicas fits together."""

    def test_names_and_ports_fit(self):
        import yaml

        text = subprocess.run(["kubectl", "kustomize", os.path.join(SOURCE, "deploy/replicas")], check=True, stdout=subprocess.PIPE,
                              text=True, timeout=60).stdout
        found = {(one["kind"], one["metadata"]["name"]): one for one in yaml.safe_load_all(text)}
        servers, proxy = found["StatefulSet", "deformd"]["spec"], found["Deployment", "deformd-proxy"]["spec"]
        (configuration,) = (one for (kind, _), one in found.items() if kind == "ConfigMap")
        mounted = proxy["template"]["spec"]["volumes"][0]["configMap"]["name"]
        self.assertEqual(mounted, configuration["metadata"]["name"])
        cfg = configuration["data"]["haproxy.cfg"]
        lines = re.findall(r'^  server \w "\$\{(\w+)-', cfg, re.MULTILINE)
        self.assertEqual(len(lines), servers["replicas"])
        addresses = {one["name"]: one["value"] for one in proxy["template"]["spec"]["containers"][0]["env"]}
        self.assertEqual([addresses[name] for name in lines],
                         [f"deformd-{k}.{servers['serviceName']}:50051" for k in range(servers["replicas"])])
        for name, spec in (("deformd", servers), ("deformd-proxy", proxy)):
            labels = spec["template"]["metadata"]["labels"]
            ports = {one["name"]: one["containerPort"] for one in spec["template"]["spec"]["containers"][0]["ports"]}
            service = found["Service", name]["spec"]
            selectors = [spec["selector"]["matchLabels"], service["selector"],
                         found["PodDisruptionBudget", name]["spec"]["selector"]["matchLabels"],
                         found["NetworkPolicy", name]["spec"]["podSelector"]["matchLabels"]]
            for selector in selectors:
                self.assertLessEqual(selector.items(), labels.items())
            for port in service["ports"]:
                self.assertEqual(ports[port["targetPort"]], port["port"])
        environment = {one["name"]: one["value"] for one in servers["template"]["spec"]["containers"][0]["env"]}
        self.assertTrue(environment["DEFORMD_METRICS_ADDRESS"].endswith(":9464"))
        self.assertEqual(re.findall(r"_METRICS-(\d+)", cfg), ["9464"] * servers["replicas"])


if __name__ == "__main__":
    main()

# SPDX-License-Identifier: GPL-3.0-or-later
"""Servers that share nothing behind the proxy of deploy/replicas, and a client that is told so: where haproxy is installed. The
manifests for Kubernetes."""

import os
import re
import shutil
import socket
import struct
import threading
import unittest

from harness import Server, main
from replicas import CLIENTS, SOURCE, BehindProxy, free_port


@unittest.skipUnless(shutil.which("haproxy"), "haproxy is not installed")
class Proxy(BehindProxy):
    def status_of(self, server):
        return self.deform("status", "--server", server.address, "--json").json

    def test_each_geometry_stays_on_one_server(self):
        self.write_cases(10)
        self.all_succeed(self.sweeps("out"))
        for k in range(CLIENTS):
            self.deform("apply", f"setup{k}.yaml", "--set", "roof_up=0.02", "-o", f"out{k}.obj")
        status = [self.status_of(server) for server in self.servers]
        self.assertEqual(sum(one["geometries"] for one in status), CLIENTS)
        self.assertEqual(sum(one["systems_resident"] for one in status), CLIENTS)
        for server in self.servers:
            server.kill()
        self.fails(3, "list", says=["a proxy answers", "503"])

    def test_nothing_is_lost_while_servers_are_killed(self):
        self.check_killing()

    def test_no_design_fails_in_a_rolling_restart(self):
        self.check_rolling_restart()


class NameServer:
    """Knows one name, while it is to, and gives it the address 127.0.0.1."""

    def __init__(self):
        self.known = False
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.port = self.socket.getsockname()[1]
        threading.Thread(target=self.serve, daemon=True).start()

    def serve(self):
        while True:
            try:
                query, client = self.socket.recvfrom(4096)
            except OSError:
                return
            end = query.index(b"\0", 12) + 5  # name, type and class
            (kind,) = struct.unpack(">H", query[end - 4:end - 2])
            found = self.known and kind == 1
            head = query[:2] + struct.pack(">HHHHH", 0x8180 if self.known else 0x8183, 1, found, 0, 0)
            answer = b"\xc0\x0c" + struct.pack(">HHIH", 1, 1, 1, 4) + socket.inet_aton("127.0.0.1") if found else b""
            self.socket.sendto(head + query[12:end] + answer, client)

    def close(self):
        self.socket.close()


@unittest.skipUnless(shutil.which("haproxy"), "haproxy is not installed")
class NumberOfServers(BehindProxy):
    """A fourth server that comes and goes, as one of a StatefulSet: by its name."""

    def setUp(self):
        self.names = NameServer()
        self.addCleanup(self.names.close)
        self.fourth = (free_port(), free_port())
        super().setUp()

    def proxy_settings(self):
        port, metrics = self.fourth
        return {"DEFORMD_D": f"deformd-3.deformd.example:{port}", "DEFORMD_D_METRICS": str(metrics)}

    def proxy_configuration(self, text):
        return text.replace("  parse-resolv-conf\n", f"  nameserver here 127.0.0.1:{self.names.port}\n")

    def geometries(self, server):
        return {one["id"] for one in self.deform("list", "geometries", "--server", server.address, "--json").json["geometries"]}

    def test_only_those_of_the_server_that_comes_and_goes_move(self):
        for k in range(16):
            self.deform("sample", "-o", f"body{k}.obj", "--points", 2000 + 400 * k)
        register = lambda: [self.deform("register", f"body{k}.obj") for k in range(16)]  # noqa: E731
        register()
        before = [self.geometries(server) for server in self.servers]
        count = sum(map(len, before))  # some sizes give the same mesh
        os.mkdir(self.path("server3"))
        port, metrics = self.fourth
        fourth = Server(self.path("server3"), "--metrics-address", f"127.0.0.1:{metrics}")
        fourth.port = port
        fourth.start()
        self.servers.append(fourth)
        self.names.known = True

        def asked():
            self.deform("status")
            return "method=GetServerInfo" in fourth.log_text()

        self.wait_until(asked, "the fourth server gets its share of calls")
        register()
        moved = self.geometries(fourth)
        self.assertGreater(len(moved), 0)
        self.assertLess(len(moved), count // 2)
        self.assertEqual([self.geometries(server) for server in self.servers[:3]], before, "the others stay where they are")
        self.names.known = False
        said = len(self.proxy_log())
        fourth.stop()
        # Until its next check the proxy hands what the fourth server does not take to any other.
        self.wait_until(lambda: re.search("replicas/d is (going )?DOWN", self.proxy_log()[said:]), "the proxy knows that it is gone")
        register()
        self.assertEqual([self.geometries(server) for server in self.servers[:3]], before, "and those that moved return")


class Manifests(unittest.TestCase):
    """The files of deploy/replicas fit together."""

    def test_names_and_ports_fit(self):
        import yaml

        folder = os.path.join(SOURCE, "deploy/replicas")
        with open(os.path.join(folder, "kustomization.yaml")) as file:
            kustomization = yaml.safe_load(file)
        self.assertEqual(sorted(kustomization["resources"]),
                         sorted("kubernetes/" + name for name in os.listdir(os.path.join(folder, "kubernetes"))))
        found = {}
        for name in kustomization["resources"]:
            with open(os.path.join(folder, name)) as file:
                found.update({(one["kind"], one["metadata"]["name"]): one for one in yaml.safe_load_all(file)})
        servers, proxy = found["StatefulSet", "deformd"]["spec"], found["Deployment", "deformd-proxy"]["spec"]
        (configuration,) = kustomization["configMapGenerator"]
        self.assertEqual(proxy["template"]["spec"]["volumes"][0]["configMap"]["name"], configuration["name"])
        self.assertEqual(configuration["files"], ["haproxy.cfg"])
        with open(os.path.join(folder, "haproxy.cfg")) as file:
            cfg = file.read()
        lines = re.findall(r'^  server \w "\$\{(\w+)-', cfg, re.MULTILINE)
        self.assertEqual(len(lines), servers["replicas"])
        addresses = {one["name"]: one.get("value") for one in proxy["template"]["spec"]["containers"][0]["env"]}
        self.assertEqual([addresses[name] for name in lines],
                         [f"deformd-{k}.{servers['serviceName']}.$(NAMESPACE).svc.cluster.local:50051" for k in range(servers["replicas"])])
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
        self.assertEqual(set(re.findall(r"_METRICS-(\d+)", cfg)), {"9464"})

    def test_what_is_changed_for_a_shared_store_is_there(self):
        import yaml

        def read(path):
            with open(os.path.join(SOURCE, "deploy", path)) as file:
                return list(yaml.safe_load_all(file))

        (kustomization,) = read("replicas-shared/kustomization.yaml")
        self.assertIn("../replicas", kustomization["resources"])
        objects = [one for name in read("replicas/kustomization.yaml")[0]["resources"] for one in read("replicas/" + name)]
        found = {(one["kind"], one["metadata"]["name"]): one for one in objects}
        changes = [read("replicas-shared/" + one["path"])[0] for one in kustomization["patches"] if "path" in one]
        self.assertEqual(len(changes), 3)
        for change in changes:
            base = found[change["kind"], change["metadata"]["name"]]
            containers = change["spec"].get("template", {}).get("spec", {}).get("containers", [])
            known = [one["name"] for one in base["spec"].get("template", {}).get("spec", {}).get("containers", [])]
            self.assertLessEqual({one["name"] for one in containers}, set(known))
        (claim,) = read("replicas-shared/store.yaml")
        servers = next(one for one in changes if one["kind"] == "StatefulSet")["spec"]["template"]["spec"]
        self.assertEqual(servers["volumes"][0]["persistentVolumeClaim"]["claimName"], claim["metadata"]["name"])
        mounts = found["StatefulSet", "deformd"]["spec"]["template"]["spec"]["containers"][0]["volumeMounts"]
        self.assertIn(servers["volumes"][0]["name"], [one["name"] for one in mounts])
        (compose,) = read("compose.shared.yaml")
        self.assertEqual({one for one in compose["services"] if one.startswith("deformd")}, {"deformd-a", "deformd-b", "deformd-c"})


if __name__ == "__main__":
    main()

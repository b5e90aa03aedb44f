# SPDX-License-Identifier: GPL-3.0-or-later
"""What becomes an image, and the manifests for Kubernetes as kustomize renders them, where a kubectl that can is installed: Debian 12 has one that is too old.
They are validated against the schemas of Kubernetes where the program kubernetes-validate is found (PyPI; KUBERNETES_VALIDATE names it)."""

import json
import os
import re
import shutil
import subprocess
import tempfile
import unittest

SOURCE = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
DEPLOY = os.path.join(SOURCE, "deploy")
VALIDATE = os.environ.get("KUBERNETES_VALIDATE") or shutil.which("kubernetes-validate")
FIRST_MINOR = 22  # of kubectl 1.x, whose kustomize knows components and labels


def missing():
    if shutil.which("kubectl") is None:
        return "kubectl is not installed"
    done = subprocess.run(["kubectl", "version", "--client", "-o", "json"], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
    version = json.loads(done.stdout)["clientVersion"]
    minor = int(re.match(r"\d+", version["minor"]).group())
    return "" if minor >= FIRST_MINOR else f"the kustomize of kubectl 1.{minor} is too old, 1.{FIRST_MINOR} is needed"


def read(path):
    with open(os.path.join(SOURCE, path)) as file:
        return file.read()


@unittest.skipIf(missing(), missing())
class Rendered(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.mkdtemp(prefix="deform-manifests-")
        self.addCleanup(shutil.rmtree, self.folder, ignore_errors=True)

    def overlay(self, resource, *components):
        folder = os.path.join(self.folder, "overlay")
        os.makedirs(folder, exist_ok=True)

        def from_there(name):
            return os.path.relpath(os.path.join(DEPLOY, name), os.path.realpath(folder))

        with open(os.path.join(folder, "kustomization.yaml"), "w") as file:
            json.dump(dict(apiVersion="kustomize.config.k8s.io/v1beta1", kind="Kustomization", resources=[from_there(resource)],
                           components=[from_there(one) for one in components]), file)
        return folder

    def rendered(self, folder):
        """By kind and name."""
        import yaml

        done = subprocess.run(["kubectl", "kustomize", folder], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertEqual(done.stderr, "", "no warnings")
        self.assertEqual(self.faults(done.stdout), "")
        return {(one["kind"], one["metadata"]["name"]): one for one in yaml.safe_load_all(done.stdout)}

    def faults(self, text):
        """What the schemas find wrong; nothing where there is no validator."""
        if not VALIDATE:
            return ""
        path = os.path.join(self.folder, "rendered.yaml")
        with open(path, "w") as file:
            file.write(text)
        done = subprocess.run([VALIDATE, "--strict", "--quiet", path], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        return done.stdout if done.returncode else ""

    def container(self, rendered, kind, name):
        (one,) = rendered[kind, name]["spec"]["template"]["spec"]["containers"]
        return one

    def environment(self, rendered, kind, name):
        """The values in their order, where they are known."""
        return {one["name"]: one.get("value") for one in self.container(rendered, kind, name)["env"]}

    @unittest.skipUnless(VALIDATE, "kubernetes-validate is not installed")
    def test_the_validator_finds_what_is_wrong(self):
        done = subprocess.run(["kubectl", "kustomize", os.path.join(DEPLOY, "replicas")], stdout=subprocess.PIPE, text=True)
        self.assertEqual(self.faults(done.stdout), "")
        self.assertIn("podManagmentPolicy", self.faults(done.stdout.replace("podManagementPolicy", "podManagmentPolicy")))

    def test_what_is_applied_as_it_is(self):
        for name in ("replicas", "replicas-shared"):
            rendered = self.rendered(os.path.join(DEPLOY, name))
            self.assertEqual(rendered["StatefulSet", "deformd"]["spec"]["replicas"], 3)
            self.assertNotIn("HorizontalPodAutoscaler", [kind for kind, _ in rendered])
        self.assertIn(("HorizontalPodAutoscaler", "deformd"), self.rendered(os.path.join(DEPLOY, "replicas-autoscaled")))

    def test_as_many_servers_as_the_queues_want(self):
        for base in ("replicas", "replicas-shared"):
            rendered = self.rendered(self.overlay(base, "autoscaling"))
            autoscaler = rendered["HorizontalPodAutoscaler", "deformd"]["spec"]
            target = autoscaler["scaleTargetRef"]
            servers = rendered[target["kind"], target["name"]]["spec"]
            self.assertNotIn("replicas", servers, "each apply would undo what the autoscaler did")
            addresses = self.environment(rendered, "Deployment", "deformd-proxy")
            names = [f"DEFORMD_{letter}" for letter in "ABCDEFGHIJ"[:autoscaler["maxReplicas"]]]
            self.assertEqual([addresses[name] for name in names],
                             [f"deformd-{k}.{servers['serviceName']}.$(NAMESPACE).svc.cluster.local:50051" for k in range(len(names))])
            order = list(addresses)
            for name in names:
                self.assertGreater(order.index(name), order.index("NAMESPACE"), "else Kubernetes leaves $(NAMESPACE) as it is")
            self.assertEqual(re.findall(r'^ *server \w "\$\{(DEFORMD_[A-Z])', read("deploy/replicas/haproxy.cfg"), re.MULTILINE), names)

    def test_the_figures_are_those_of_the_server(self):
        import yaml

        rendered = self.rendered(os.path.join(DEPLOY, "replicas-autoscaled"))
        figures = [one["pods"]["metric"]["name"] for one in rendered["HorizontalPodAutoscaler", "deformd"]["spec"]["metrics"]]
        self.assertEqual(len(figures), 2)
        (rule,) = yaml.safe_load(read("deploy/autoscaling/prometheus_adapter.yaml"))["rules"]["custom"]
        series = re.search(r'__name__=~"(.*?)"', rule["seriesQuery"]).group(1)
        for figure in figures:
            self.assertIn(f'gauge_of("{figure}"', read("server/rpc/metrics.cpp"))
            self.assertRegex(figure, series)

    @unittest.skipUnless(shutil.which("promtool"), "promtool is not installed")
    def test_the_adapter_asks_prometheus_in_its_language(self):
        import yaml

        (rule,) = yaml.safe_load(read("deploy/autoscaling/prometheus_adapter.yaml"))["rules"]["custom"]
        query = rule["metricsQuery"]
        for name, value in (("Series", "deformd_queue_length"), ("LabelMatchers", 'namespace="n",pod=~"deformd-0|deformd-1"'), ("GroupBy", "pod")):
            self.assertIn(f"<<.{name}>>", query)
            query = query.replace(f"<<.{name}>>", value)
        path = os.path.join(self.folder, "rules.yaml")
        with open(path, "w") as file:
            json.dump(dict(groups=[dict(name="g", rules=[dict(record="r", expr=query), dict(record="s", expr=rule["seriesQuery"])])]), file)
        done = subprocess.run(["promtool", "check", "rules", path], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        self.assertEqual(done.returncode, 0, done.stdout)

    def test_encrypted(self):
        for base in ("replicas", "replicas-shared"):
            rendered = self.rendered(self.overlay(base, "tls", "autoscaling"))
            for kind, name, variables in (("StatefulSet", "deformd", ("DEFORMD_TLS_CERT", "DEFORMD_TLS_KEY", "DEFORMD_IDENTITIES")),
                                          ("Deployment", "deformd-proxy", ("DEFORMD_PROXY_CERT", "DEFORMD_CA"))):
                environment = self.environment(rendered, kind, name)
                mounts = [one["mountPath"] for one in self.container(rendered, kind, name)["volumeMounts"]]
                for variable in variables:
                    self.assertIn(os.path.dirname(environment[variable]), mounts)
            self.assertEqual(self.environment(rendered, "StatefulSet", "deformd")["DEFORMD_INSECURE"], "false")


class Image(unittest.TestCase):
    def test_what_is_copied_is_not_ignored(self):
        taken = [line[1:] for line in read(".dockerignore").splitlines() if line.startswith("!")]
        copied = [source for line in re.findall(r"^COPY (?!--from)(.*)$", read("Dockerfile"), re.MULTILINE) for source in line.split()[:-1]]
        self.assertGreater(len(copied), 10)
        for source in copied:
            self.assertTrue(os.path.exists(os.path.join(SOURCE, source)), source)
            self.assertTrue(any((source + "/").startswith(one + "/") for one in taken), f"{source} is ignored")


if __name__ == "__main__":
    unittest.main(verbosity=2)

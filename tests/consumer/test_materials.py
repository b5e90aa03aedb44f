# SPDX-License-Identifier: Apache-2.0
"""The bills of materials that cmake --install writes, against what ldd, the compiler's notes of headers and dpkg say of the same programs."""

import hashlib
import json
import os
import re
import subprocess
import sys
import tempfile
import unittest

BUILD = os.environ["DEFORM_BUILD"]
CMAKE = os.environ["CMAKE_COMMAND"]


def output(*command, **environment):
    return subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True, env={**os.environ, **environment}).stdout


def owner(path):
    """The package of a file, which may be known by its path with or without /usr."""
    for known in (path, re.sub("^/usr", "", path), "/usr" + path):
        found = subprocess.run(["dpkg-query", "--search", known], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
        if found.returncode == 0:
            return found.stdout.split(": ")[0].split(":")[0]
    raise AssertionError(f"no package owns {path}")


class Materials(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.temporary = tempfile.TemporaryDirectory(prefix="deform-materials-")
        cls.installed = {}

    @classmethod
    def tearDownClass(cls):
        cls.temporary.cleanup()

    def install(self, folder, component):
        prefix = os.path.join(self.temporary.name, folder)
        if self.installed.setdefault(folder, component) == component and os.path.isdir(prefix):
            return prefix
        output(CMAKE, "--install", BUILD, "--prefix", prefix, "--component", component, "--strip", SOURCE_DATE_EPOCH="1700000000")
        return prefix

    def document(self, prefix, name):
        with open(os.path.join(prefix, "share", "doc", name, name + ".spdx.json"), "rb") as file:
            return json.load(file)

    def check(self, component, name, headers):
        prefix = self.install(name, component)
        document = self.document(prefix, name)
        program = os.path.join(prefix, "bin", name)

        packages = {package["name"]: package for package in document["packages"]}
        self.assertEqual(len(packages), len(document["packages"]))
        with open(program, "rb") as file:
            self.assertEqual(packages[name]["checksums"],
                             [{"algorithm": "SHA256", "checksumValue": hashlib.sha256(file.read()).hexdigest()}])
        self.assertEqual(packages[name]["versionInfo"].replace("+", " (commit ") + ")",
                         output(program, "--version").strip().removeprefix(name + " "))
        self.assertEqual(document["creationInfo"]["created"], "2023-11-14T22:13:20Z")

        # Every library that the program loads, and no package that it does not.
        loaded = {owner(os.path.realpath(path)) for path in re.findall(r"=> (/\S+)", output("ldd", program))}
        self.assertGreater(len(loaded), 10)
        related = {}
        names = {package["SPDXID"]: package["name"] for package in document["packages"]}
        for relation in document["relationships"][1:]:
            self.assertEqual(names[relation["spdxElementId"]], name)
            related.setdefault(relation["relationshipType"], set()).add(names[relation["relatedSpdxElement"]])
        # libc6 has the loader, which ldd prints without an arrow.
        self.assertEqual(related["DYNAMIC_LINK"] | {"libc6"}, loaded | {"libc6"})
        self.assertLessEqual(headers, related["STATIC_LINK"])
        self.assertEqual(related["DYNAMIC_LINK"] | related["STATIC_LINK"] | {name}, set(packages))

        for package in packages.values():
            if package["name"] == name:
                continue
            version = package["versionInfo"]
            self.assertEqual(version, output("dpkg-query", "--show", "--showformat=${Version}", package["name"]))
            place = package["externalRefs"][0]["referenceLocator"]
            quoted = version.replace("+", "%2B").replace(":", "%3A")
            self.assertRegex(place, "^pkg:deb/debian/" + re.escape(package["name"].replace("+", "%2B")) + "@" + re.escape(quoted) +
                             r"\?arch=\w+&distro=debian-\d+$")

    def test_the_server(self):
        self.check("server", "deformd", {"libeigen3-dev", "libcli11-dev", "libnanoflann-dev", "libspdlog-dev"})

    def test_the_command_line(self):
        self.check("tools", "deform", {"libcli11-dev", "nlohmann-json3-dev"})
        self.assertNotIn("libsqlite3-dev", json.dumps(self.document(os.path.join(self.temporary.name, "deform"), "deform")))

    def test_cad_is_a_program_of_its_own(self):
        """Only where it was built; deform loads nothing of OpenCASCADE either way."""
        prefix = self.install("deform", "tools")
        self.assertNotIn("libocct", json.dumps(self.document(prefix, "deform")))
        if os.path.exists(os.path.join(BUILD, "client", "cli", "deform-cad")):
            self.assertTrue(os.access(os.path.join(prefix, "bin", "deform-cad"), os.X_OK))
            self.assertIn("libocct", json.dumps(self.document(prefix, "deform-cad")))

    def test_the_same_program_gives_the_same_file(self):
        first, second = (self.document(self.install(folder, "server"), "deformd") for folder in ("deformd", "again"))
        self.assertEqual(first, second)


if __name__ == "__main__":
    unittest.main(argv=[sys.argv[0], "-v", *sys.argv[1:]])

# SPDX-License-Identifier: GPL-3.0-or-later
"""What the documentation shows, against real programs: defaults of the tables, commands of the first round, the Python client."""

import os
import re
import shlex
import shutil
import subprocess
import sys

from harness import EndToEnd, main

ROOT = os.path.normpath(os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", ".."))
sys.path.insert(0, os.path.join(ROOT, "tests", "support"))
import check_docs  # noqa: E402

# In these a bare setup has no defaults of its own; a constraint makes those of constraint_options count.
HANDLES = """handles: [{name: roof, region: {group: roof}}]
fixed: [{group: underbody}]
"""
# A method that has no bare setup: a cage around the model, whose vertices are handles.
CAGE = """method: {cage: {file: cage.obj}}
handles: [{name: roof, region: {control: {ids: [0]}}}]
"""
CAGE_MESH = "v -9 -9 -9\nv 99 -9 -9\nv -9 99 -9\nv -9 -9 99\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
CONSTRAINT = "constraints: [{name: slant, planar: {}, regions: [{group: slant}]}]\n"
PLACE = re.compile(r"^<!-- fields of (\w+) at ([\w.]+) -->$")
DEFAULT = re.compile(r"(\w+_(?:DEFAULT|AUTOMATIC)) = 0;(?:\s*//\s*(\w+))?")


def read(*names):
    with open(os.path.join(ROOT, *names), encoding="utf-8") as file:
        return file.read()


def pages():
    for folder, _, names in os.walk(os.path.join(ROOT, "docs")):
        for name in sorted(names):
            if name.endswith(".md"):
                yield os.path.relpath(os.path.join(folder, name), ROOT)


def default_tables():
    """(page, place in a setup, rows) of every table whose message stands at a place in a setup."""
    for page in pages():
        lines = read(page).splitlines()
        for number, kind, _, rows in check_docs.read_tables(lines):
            place = PLACE.match(lines[number - 1])
            if kind == "fields" and place:
                yield page, place[2], rows


class Defaults(EndToEnd):
    """`deform show --setup` prints a setup with its defaults filled in; what is 0 or automatic is left out."""

    def shown(self, place):
        method = place.split(".")[1] if place.startswith("method.") else "mls"
        energy = "" if method == "rbf" else CONSTRAINT
        self.write("cage.obj", CAGE_MESH)
        of_method = CAGE if method == "cage" else f"method: {{{method}: {{}}}}\n" + HANDLES + energy
        self.write("setup.yaml", "geometry: ahmed.obj\n" + of_method)
        system = self.deform("prepare", "setup.yaml", "--json").json["id"]
        node = self.deform("show", system, "--setup", "--json").json
        for name in place.split("."):
            node = node.get(name, {})
        return node

    def test_tables_say_what_a_setup_gets(self):
        self.start_server()
        self.deform("sample", "-o", "ahmed.obj", "--points", "2000")
        zeros = {word for pair in DEFAULT.findall(read("proto", "deform", "v1", "setup.proto")) for word in pair}
        places = set()
        for page, place, rows in default_tables():
            places.add(place)
            shown = self.shown(place)
            for line, name, default in rows:
                with self.subTest(page=page, line=line, name=name):
                    value = shown.get(name)
                    if isinstance(value, (dict, list)):
                        continue  # a message: it has a table of its own
                    if value is None:
                        self.assertTrue(default is None or default in zeros, f"{default}: a setup has none")
                    elif isinstance(value, str):
                        self.assertEqual(default, value)
                    else:
                        self.assertIsNotNone(default, value)
                        self.assertEqual(float(default), value)
        self.assertLessEqual({"method.rbf", "method.shell.energy", "method.subspace", "method.mls", "constraint_options"}, places)


class FirstRound(EndToEnd):
    """The commands of the README, in their order, with the setup that it shows."""

    def commands(self, page):
        for _, language, _, block in check_docs.read_blocks(read(page).splitlines()):
            if language == "sh":
                for line in block.splitlines():
                    words = shlex.split(line, comments=True)
                    if words[:1] == ["deform"]:
                        yield words[1:]

    def test_the_readme(self):
        self.start_server()
        for name in ("ahmed.yaml", "designs.csv"):
            shutil.copy(os.path.join(ROOT, "deploy", "examples", name), self.path(name))
        done = [self.deform(*words) for words in self.commands("README.md")]
        self.assertGreaterEqual(len(done), 5)
        self.assertTrue(os.path.exists(self.path("out.obj")))
        self.assertEqual(len(os.listdir(self.path("results"))), 5, "four designs and the manifest")

    def test_the_tutorial(self):
        self.start_server()
        for name in ("ahmed.yaml", "designs.csv"):
            shutil.copy(os.path.join(ROOT, "deploy", "examples", name), self.path(name))
        self.deform("sample", "-o", "ahmed.obj")
        ours = [words for words in self.commands("docs/tutorial.md") if any("ahmed" in word for word in words)]
        for words in ours:
            self.deform(*words)
        self.assertGreaterEqual(len(ours), 5)
        with open(self.path("report.html"), encoding="utf-8") as page:
            self.assertIn("<html", page.read(1000))


class PythonClient(EndToEnd):
    """The stubs are generated by the command of docs/clients.md, and the example is run with them."""

    def test_deform_once(self):
        self.start_server()
        command = re.search(r"^protoc .*$", read("docs", "clients.md"), re.M)[0]
        os.mkdir(self.path("stubs"))
        command = command.replace("proto/deform/v1/*.proto", " ".join(
            f"proto/deform/v1/{name}" for name in sorted(os.listdir(os.path.join(ROOT, "proto/deform/v1"))) if name.endswith(".proto")))
        subprocess.run(command.replace("=stubs", "=" + self.path("stubs")), shell=True, cwd=ROOT, check=True, timeout=60)
        environment = {**self.environment(), "PYTHONPATH": self.path("stubs"), "PYTHONDONTWRITEBYTECODE": "1"}
        done = subprocess.run(["/usr/bin/python3", os.path.join(ROOT, "client", "examples", "deform_once.py"), self.server.address],
                              env=environment, timeout=60, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, check=False)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertEqual(done.stdout, "2500 points, highest 0.000 -> 0.030\n")


if __name__ == "__main__":
    main()

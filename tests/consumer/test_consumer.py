# SPDX-License-Identifier: Apache-2.0
"""What cmake --install gives to somebody else's project: found by CMake and by pkg-config, compiled, linked and run against a server."""

import os
import re
import shlex
import subprocess
import sys
import tempfile
import unittest

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path.insert(0, os.path.join(HERE, "..", "end_to_end"))

from harness import Server, box, read_obj  # noqa: E402  (of the folder named above)

BUILD = os.environ["DEFORM_BUILD"]
CMAKE = os.environ["CMAKE_COMMAND"]
COMPILER = os.environ["CXX_COMPILER"]
LAUNCHER = os.environ["CXX_LAUNCHER"]  # ccache or nothing


class Consumer(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.temporary = tempfile.TemporaryDirectory(prefix="deform-consumer-")
        cls.folder = cls.temporary.name
        cls.prefix = os.path.join(cls.folder, "prefix")
        for component in ("client", "files"):
            cls.run_command(CMAKE, "--install", BUILD, "--prefix", cls.prefix, "--component", component)

    @classmethod
    def tearDownClass(cls):
        cls.temporary.cleanup()

    @classmethod
    def run_command(cls, *command, **environment):
        done = subprocess.run(command, cwd=cls.folder, env={**os.environ, **environment}, stdout=subprocess.PIPE,
                              stderr=subprocess.STDOUT, text=True)
        if done.returncode != 0:
            raise AssertionError(f"{' '.join(command)}\n{done.stdout}")
        return done.stdout

    def installed(self):
        for folder, _, names in os.walk(self.prefix):
            for name in names:
                yield os.path.relpath(os.path.join(folder, name), self.prefix)

    def deforms_a_file(self, program):
        server = Server(tempfile.mkdtemp(dir=self.folder)).start()
        try:
            source, result = os.path.join(self.folder, "ahmed.obj"), os.path.join(self.folder, "out.obj")
            self.run_command(os.environ["DEFORM_BIN"], "sample", "-o", source, "--points", "2000")
            said = self.run_command(program, server.address, source, result, "roof", "underbody", "0.03")
        finally:
            server.stop()
        before, faces = read_obj(source)
        after, faces_after = read_obj(result)
        self.assertEqual(faces_after, faces)
        self.assertEqual(len(after), len(before))
        self.assertAlmostEqual(box(after)[1][2], box(before)[1][2] + 0.03, places=5)
        self.assertRegex(said, r"^deform \d+\.\d+\.\d+: \d+ points, the largest displacement is 0\.03\d\n$")

    def test_cmake(self):
        build = os.path.join(self.folder, "build")
        self.run_command(CMAKE, "-G", "Ninja", "-S", os.path.join(HERE, "project"), "-B", build, f"-DCMAKE_PREFIX_PATH={self.prefix}",
                         f"-DCMAKE_CXX_COMPILER={COMPILER}", f"-DCMAKE_CXX_COMPILER_LAUNCHER={LAUNCHER}",
                         "-DCMAKE_CXX_FLAGS=-Wall -Wextra -Werror")
        self.run_command(CMAKE, "--build", build)
        self.deforms_a_file(os.path.join(build, "deform_file"))

    def test_pkg_config(self):
        paths = {"PKG_CONFIG_PATH": os.path.join(self.prefix, os.environ["LIBDIR"], "pkgconfig")}
        flags = shlex.split(self.run_command("pkg-config", "--cflags", "--libs", "deform-client", "deform-files", **paths))
        source, program = os.path.join(HERE, "project", "deform_file.cpp"), os.path.join(self.folder, "deform_file")
        self.run_command(COMPILER, source, "-o", program, *flags)
        self.deforms_a_file(program)

    def test_the_contract_is_installed_and_compiles(self):
        folder = os.path.join(self.prefix, "share", "deform", "proto")
        protos = sorted(name for name in self.installed() if name.endswith(".proto"))
        self.assertIn("share/deform/proto/deform/v1/service.proto", protos)
        self.run_command("protoc", f"-I{folder}", f"--python_out={self.folder}",
                         *(os.path.relpath(os.path.join(self.prefix, name), folder) for name in protos))

    def test_everything_has_one_prefix(self):
        """Nothing that could be taken for the file of another project, and nothing that names the folders of this one."""
        for name in self.installed():
            self.assertRegex(name, r"^(include/deform/|share/(deform|doc/deform)/|lib[^.]*/(libdeform_|cmake/deform/|pkgconfig/deform-))")
            if name.endswith((".h", ".cmake", ".pc")):
                with open(os.path.join(self.prefix, name), encoding="utf-8") as file:
                    text = file.read()
                self.assertNotRegex(text, r'#include "(core|client)/', name)
                self.assertNotIn(BUILD, text, name)

    def test_everything_is_under_the_licence_of_the_client(self):
        """Every text file but the licence itself and what other programs make says Apache-2.0 in its first line."""
        generated = re.compile(r"\.pb\.h$|/deform-(client|files)-targets(-\w+)?\.cmake$|/deform-config-version\.cmake$")
        looked_at = set()
        for name in self.installed():
            if name.endswith(".a"):
                continue
            with open(os.path.join(self.prefix, name), encoding="utf-8") as file:
                text = file.read()
            self.assertNotIn("GPL", text, name)
            if generated.search(name) or name == "share/doc/deform/Apache-2.0.txt":
                continue
            self.assertRegex(text.splitlines()[0], r"^(//|#) SPDX-License-Identifier: Apache-2\.0$", name)
            looked_at.add(re.sub(r".*(?=\.)", "", name))
        self.assertEqual(looked_at, {".h", ".proto", ".cmake", ".pc"})


class ClientOnly(unittest.TestCase):
    def test_needs_nothing_of_the_solvers(self):
        """Configures only: what was looked for stands in the cache."""
        with tempfile.TemporaryDirectory(prefix="deform-client-only-") as folder:
            root = os.path.join(HERE, "..", "..")
            for files in ("OFF", "ON"):
                done = subprocess.run([CMAKE, "-G", "Ninja", "-S", root, "-B", folder, f"-DCMAKE_CXX_COMPILER={COMPILER}",
                                       "-DDEFORM_CLIENT_ONLY=ON", f"-DDEFORM_BUILD_FILES={files}"],
                                      stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
                self.assertEqual(done.returncode, 0, done.stdout)
                with open(os.path.join(folder, "CMakeCache.txt"), encoding="utf-8") as cache:
                    text = cache.read()
                others = r"(?i)eigen|openblas|cholmod|hwy|sqlite|spdlog|yaml|CLI11|nlohmann" + ("" if files == "ON" else "|netcdf|cgns")
                self.assertEqual(set(re.findall(others, text)), set())


if __name__ == "__main__":
    unittest.main(argv=[sys.argv[0], "-v", *sys.argv[1:]])

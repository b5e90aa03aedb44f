# SPDX-License-Identifier: GPL-3.0-or-later
"""What a script learns from `deform` without reading its text: exit codes, errors as JSON, gates, and that sources are not overwritten."""

import gzip
import math
import os
import shutil
import signal
import subprocess

from harness import AHMED_SETUP, DEFORM, LONG_SETUP, EndToEnd, distance, main, read_obj

BOUNDED = AHMED_SETUP.replace("lower: -0.05, upper: 0.05", "lower: -0.1, upper: 0.1")

# One hexahedron of OpenFOAM.
FOAM = {
    "points": "8\n(\n(0 0 0)\n(1 0 0)\n(1 1 0)\n(0 1 0)\n(0 0 1)\n(1 0 1)\n(1 1 1)\n(0 1 1)\n)\n",
    "faces": "6\n(\n4(0 3 2 1)\n4(4 5 6 7)\n4(0 1 5 4)\n4(1 2 6 5)\n4(2 3 7 6)\n4(3 0 4 7)\n)\n",
    "owner": "6\n(\n0\n0\n0\n0\n0\n0\n)\n",
    "neighbour": "0\n(\n)\n",
    "boundary": "2\n(\nbottom\n{\n type wall;\n nFaces 1;\n startFace 0;\n}\nrest\n{\n type wall;\n nFaces 5;\n startFace 1;\n}\n)\n",
}
FOAM_CLASSES = {"points": "vectorField", "faces": "faceList", "owner": "labelList", "neighbour": "labelList",
                "boundary": "polyBoundaryMesh"}

FOAM_SETUP = """\
geometry: case
handles: [{name: top, region: {half_space: {point: [0, 0, 0.9], normal: [0, 0, 1]}}}]
fixed: [{group: bottom}]
variables: [{name: up, handle: top, translate: [0, 0, 1]}]
"""


class ExitCodes(EndToEnd):
    def setUp(self):
        super().setUp()
        self.start_server()
        self.deform("sample", "-o", "ahmed.obj", "--points", 2500)
        self.write("setup.yaml", BOUNDED)

    def bytes_of(self, name):
        with open(self.path(name), "rb") as file:
            return file.read()

    def test_limits_of_integers_are_those_of_the_server(self):
        """A setup file cannot say -1; its message has the numbers of the message about one more than the limit."""
        planar = "constraints: [{name: c, planar: {}, regions: [{group: base}]}]\n"
        for entry, least, most in (("method: {subspace: {centres: N}}", 4, 100000), ("method: {mls: {surface_samples: N}}", 0, 1000000),
                                   ("method: {mls: {volume_samples: N}}", 0, 1000000),
                                   ("method: {rbf: {reduction: REDUCTION_RINGS, reduction_rings: N}}", 1, 100),
                                   ("method: {rbf: {polynomial_degree: N}}", 0, 2), ("method: {ffd: {lattice: {points: [4, N, 4]}}}", 4, 1000),
                                   ("method: {cage: {control: MESH, generate: {kind: WRAP, points: N}}}", 8, 10000),
                                   ("symmetry: [{sector: {axis: [0, 0, 1], count: N}}]", 2, 10000),
                                   ("fixed: [{grow: {region: {group: base}, rings: N}}]", 1, 1000),
                                   ("constraints: [{name: c, rigid: {layers: N}, regions: [{group: base}]}]", 0, 1000),
                                   (planar + "constraint_options: {iterations: N}", 1, 1000000)):
            method = "" if entry.startswith("method") else "method: {shell: {}}\n"
            text = "geometry: ahmed.obj\nhandles: [{name: h, region: {group: slant}}]\n" + method + entry + "\n"
            with self.subTest(entry=entry):
                self.write("integer.yaml", text.replace("N}", "-1}").replace("N,", "-1,"))
                self.fails(1, "prepare", "integer.yaml", "--check", says=[f"expected an integer from {least} to {most}", '"-1"'])
                self.write("integer.yaml", text.replace("N}", f"{most + 1}}}").replace("N,", f"{most + 1},"))
                self.fails(1, "prepare", "integer.yaml", "--check", says=["out of range", str(most)])

    def test_each_kind_of_failure_has_its_code(self):
        apply = ["apply", "setup.yaml", "-o", "x.obj", "--set"]
        self.deform(*apply, "roof_up=0.01")
        os.remove(self.path("x.obj"))
        self.fails(1, *apply, "roof_up=1", says=["roof_up", "1 is outside of its bounds [-0.1, 0.1]"])
        self.fails(2, *apply, "roof_up=0.01", "--fail-on", "flipped>0", says=["flipped_faces, newly_intersecting_faces, points_across_symmetry", "displacement_ratio"])
        self.fails(2, *apply, "roof_up=0.01", "--fail-on", "max_displacement", says=["NAME>NUMBER"])
        self.fails(2, "apply", "setup.yaml", says=["-o", "--in-place"])
        for value in ("-1", "nan", "inf", "1e999", "x"):
            self.fails(2, *apply, "roof_up=0.01", f"--tolerance={value}", says=[f"--tolerance: {value}, expected a finite number of at least 0"])
        self.assertFalse(os.path.exists(self.path("x.obj")))
        self.fails(4, *apply, "roof_up=0.01", "--fail-on", "max_displacement<1", says=["x.obj: max_displacement<1: it is 0.0"],
                   prints=True)
        self.assertTrue(os.path.exists(self.path("x.obj")), "what a gate fails can be looked at")
        self.fails(4, *apply, "roof_up=0.01", "--fail-on", "inverted_cells>0", says=["not measured"], prints=True)
        self.deform("sample", "-o", "long.obj", "--points", 12000)
        self.write("long.yaml", LONG_SETUP)
        self.fails(3, "prepare", "long.yaml", "--timeout", 0.3, says=["deadline"])
        child = self.spawn("prepare", "long.yaml")
        self.wait_until(lambda: self.busy() > 0, "it is prepared")
        child.send_signal(signal.SIGINT)
        self.assertEqual(child.wait(20), 130)
        self.server.stop()
        self.fails(3, *apply, "roof_up=0.01", says=["cannot reach"])
        help_text = self.deform("--help").out
        for code in ("0 done", "1 wrong input", "2 wrong usage", "3 server", "4 a gate", "130 interrupted"):
            self.assertIn(code, help_text)

    def test_errors_are_json_when_asked(self):
        apply = ["apply", "setup.yaml", "-o", "x.obj", "--json", "--set"]
        error = self.fails(1, *apply, "roof_up=1").json["error"]
        self.assertEqual((error["code"], error["field"]), ("INVALID_ARGUMENT", "designs[0].variables[0]"))
        self.assertIn("0.1", error["message"])
        error = self.fails(1, "inspect", "missing.obj", "--json").json["error"]
        self.assertEqual((error["code"], error["field"]), ("NOT_FOUND", ""))
        self.assertEqual(self.fails(2, "apply", "--json").json["error"]["code"], "USAGE")
        self.assertEqual(self.fails(2, "--json", "aply").json["error"]["code"], "USAGE")
        failed = self.fails(4, *apply, "roof_up=0.01", "--fail-on", "max_displacement>0", prints=True).json
        self.assertEqual(failed["error"]["code"], "VERDICT")
        self.assertEqual(len(failed["failures"]), 1)
        self.assertTrue(failed["written"])
        self.assertIn("max_displacement>0", failed["failures"][0])
        self.server.stop()
        self.assertEqual(self.fails(3, "list", "--json").json["error"]["code"], "UNAVAILABLE")

    def test_values_of_float32_optimizers_are_taken(self):
        self.deform("apply", "setup.yaml", "--set", "roof_up=0.1", "-o", "at.obj")
        self.deform("apply", "setup.yaml", "--set", "roof_up=0.10000000149011612", "-o", "beside.obj")
        self.assertEqual(self.bytes_of("at.obj"), self.bytes_of("beside.obj"))
        self.fails(1, "apply", "setup.yaml", "--set", "roof_up=0.1000003", "-o", "x.obj",
                   says=["0.1000003 is outside of its bounds [-0.1, 0.1]"])

    def test_a_design_without_any_change_says_so(self):
        for settings in ([], ["--set", "roof_up=0"]):
            self.assertIn("note: no variable differs from 0", self.deform("apply", "setup.yaml", *settings, "-o", "x.obj").out)
        self.assertIn("nothing was asked to move", self.deform("apply", "setup.yaml", "-o", "x.obj", "--json").json["report"]["notes"][0])
        self.assertNotIn("note: no variable", self.deform("apply", "setup.yaml", "--set", "roof_up=0.01", "-o", "x.obj").out)

    def test_the_source_is_not_overwritten(self):
        source = self.bytes_of("ahmed.obj")
        os.symlink("ahmed.obj", self.path("symbolic.obj"))
        os.link(self.path("ahmed.obj"), self.path("hard.obj"))
        served = self.status()["designs_served"]
        for name in ("ahmed.obj", "./ahmed.obj", self.path("ahmed.obj"), "symbolic.obj", "hard.obj", "ahmed.obj.gz"):
            self.fails(1, "apply", "setup.yaml", "--set", "roof_up=0.01", "-o", name, says=["source mesh", "ahmed.obj", "--in-place"])
        self.assertEqual(self.status()["designs_served"], served, "found before anything is computed")
        self.assertEqual(self.deform("list", "--json").json, {"geometries": [], "systems": []})
        self.assertEqual(self.bytes_of("ahmed.obj"), source)
        self.assertFalse(os.path.exists(self.path("ahmed.obj.gz")))
        by_id = self.write("id.yaml", BOUNDED.replace("ahmed.obj", self.deform("register", "ahmed.obj", "--json").json["id"]))
        self.fails(1, "apply", by_id, "--source", "hard.obj", "--set", "roof_up=0.01", "-o", "ahmed.obj", says=["source mesh"])
        self.fails(1, "apply", "setup.yaml", "--set", "roof_up=0.01", "-o", "x.obj", "--in-place", says=["x.obj", "leave one out"])
        self.deform("apply", "setup.yaml", "--set", "roof_up=0.01", "-o", "x.obj")
        self.deform("apply", "setup.yaml", "--set", "roof_up=0.01", "--in-place")
        self.assertEqual(self.bytes_of("ahmed.obj"), self.bytes_of("x.obj"))

    def test_no_library_starts_threads_before_signals_are_waited_for(self):
        """OpenBLAS does when it is loaded: Ctrl-C would end the process by one of them, and the server would go on."""
        linked = subprocess.run(["ldd", DEFORM], check=True, stdout=subprocess.PIPE, text=True, timeout=60).stdout
        self.assertIn("libgrpc++", linked)
        for library in ("openblas", "cholmod"):
            self.assertNotIn(library, linked)

    def test_the_mesh_of_a_case_is_not_overwritten(self):
        os.makedirs(self.path("case/constant/polyMesh"))
        head = "FoamFile\n{{\n version 2.0;\n format ascii;\n class {};\n object {};\n}}\n"
        for name, body in FOAM.items():
            self.write(f"case/constant/polyMesh/{name}", head.format(FOAM_CLASSES[name], name) + body)
        with open(self.path("case/constant/polyMesh/points"), "rb") as file:
            points = file.read()
        with gzip.open(self.path("case/constant/polyMesh/points.gz"), "wb") as file:
            file.write(points)
        os.remove(self.path("case/constant/polyMesh/points"))
        self.write("case.yaml", FOAM_SETUP)
        apply = ["apply", "case.yaml", "--set", "up=0.1"]
        for name in ("case", "case/"):
            self.fails(1, *apply, "-o", name, says=["is an OpenFOAM case", "time folder", "case/1"])
        for name in ("case/constant", "case/constant/polyMesh", "case/constant/polyMesh/points"):
            self.fails(1, *apply, "-o", name, says=["source mesh", "case/constant/polyMesh/points.gz"])
        self.assertEqual(os.listdir(self.path("case")), ["constant"])
        self.deform(*apply, "-o", "case/1")
        self.deform(*apply, "-o", "case/1")
        self.write("time.yaml", FOAM_SETUP.replace("geometry: case", "geometry: case/1"))
        for name in ("case/constant", "case/1"):
            self.fails(1, "apply", "time.yaml", "--set", "up=0.1", "-o", name, says=["source mesh"])
        self.fails(1, "apply", "time.yaml", "--set", "up=0.1", "-o", "case", says=["is an OpenFOAM case"])
        self.deform(*apply, "--in-place")
        self.assertIn(b"(0 0 1.1)", gzip.decompress(self.bytes_of("case/constant/polyMesh/points.gz")))
        self.assertNotIn("points", os.listdir(self.path("case/constant/polyMesh")))

    def test_displacements_and_warnings_are_told(self):
        reply = self.deform("apply", "setup.yaml", "--set", "roof_up=0.03", "-o", "x.obj", "--json").json
        report = reply["report"]
        before, after = read_obj(self.path("ahmed.obj"))[0], read_obj(self.path("x.obj"))[0]
        self.assertGreaterEqual(max(map(distance, before, after)), 0.03 * (1 - 1e-9))
        for key in ("max_displacement", "prescribed_displacement"):
            self.assertIn(key, report)
        self.assertEqual(reply["failures"], [])
        self.assertTrue(math.isclose(report["prescribed_displacement"], 0.03, rel_tol=1e-9))
        self.assertTrue(math.isclose(report["displacement_ratio"], report["max_displacement"] / 0.03, rel_tol=1e-9))
        self.assertEqual(reply["warnings"] != [], report["displacement_ratio"] >= 1.5)
        told = self.deform("apply", "setup.yaml", "--set", "roof_up=0.03", "-o", "x.obj")
        self.assertRegex(told.out, r"  largest displacement 0\.\d+( \(prescribed 0\.03, ratio \d+(\.\d+)?\))?\n")
        self.assertEqual(told.err.count("deform: warning: "), len(reply["warnings"]))
        self.assertEqual(told.out.count("  WARNING: "), len(reply["warnings"]))

    def test_a_folded_surface_is_told_without_being_asked_for(self):
        self.write("fold.yaml", AHMED_SETUP + "  - {name: slide, handle: roof, translate: [1, 0, 0]}\n")
        told = self.deform("apply", "fold.yaml", "--set", "slide=0.4", "-o", "folded.obj")
        self.assertIn("faces flipped", told.out)
        self.assertIn("folded over", told.err)
        self.fails(4, "apply", "fold.yaml", "--set", "slide=0.4", "-o", "folded.obj", "--fail-on", "flipped_faces>0", prints=True)
        self.write("folds.csv", "name,slide\nfolded,0.4\nrest,0\n")
        swept = self.deform("sweep", "fold.yaml", "--designs", "folds.csv", "-o", "swept", "--json").json
        self.assertEqual(list(swept["warnings"]), ["folded"])

    def test_options_that_may_be_repeated_take_one_value_each(self):
        self.deform("apply", "--set", "roof_up=0.01", "setup.yaml", "-o", "x.obj")
        self.fails(2, "apply", "setup.yaml", "--set", "roof_up=0.01", "slant_turn=0.01", "-o", "x.obj")

    def test_output_that_cannot_be_written_is_a_failure(self):
        with open("/dev/full", "w") as full:
            done = subprocess.run([DEFORM, "status", "--server", self.server.address], stdout=full, stderr=subprocess.PIPE, text=True, timeout=60)
        self.assertEqual(done.returncode, 1)
        self.assertIn("standard output", done.stderr)

    def test_what_is_registered_is_told(self):
        inspected = {g["name"]: g["points"] for g in self.deform("inspect", "ahmed.obj", "--json").json["groups"]}
        registered = self.deform("register", "ahmed.obj", "--json").json
        self.assertEqual({g["name"]: g["all_points"] for g in registered["groups"]}, inspected)
        self.assertIn(f"group nose: {inspected['nose']} points, ", self.deform("register", "ahmed.obj").out)
        self.deform("prepare", "setup.yaml")
        lines = self.deform("list").out.split("\n")
        self.assertRegex(lines[0], r"^geometry [0-9a-f]{16}  20\d\d-\d\d-\d\dT\d\d:\d\d:\d\d[+-]\d\d:\d\d  \d+ points")
        self.assertRegex(lines[1], r"^system   [0-9a-f]{16}  (-|20\d\d-\S+)  of geometry ")
        self.assertNotIn("Nothing is fixed", self.deform("prepare", "setup.yaml", "--check").out)
        self.write("loose.yaml", BOUNDED.replace("fixed:", "# fixed:"))
        for command in (["prepare", "loose.yaml", "--check"], ["prepare", "loose.yaml"]):
            self.assertIn("note: Nothing is fixed, so everything that is no handle may move.", self.deform(*command).out)


class SmallServer(EndToEnd):
    def test_what_does_not_fit_fails_with_its_estimate(self):
        self.start_server("--memory-budget", "200M", "--cache-budget", "0.1G")
        self.assertEqual(self.status()["memory_budget"], 200 << 20)
        self.deform("sample", "-o", "long.obj", "--points", 12000)
        self.write("long.yaml", LONG_SETUP)
        self.fails(1, "prepare", "long.yaml", "--check", says=["does not fit", "200.0 MiB"], prints=True)
        told = self.fails(1, "prepare", "long.yaml", "--check", "--json", prints=True).json
        self.assertEqual((told["fits"], told["error"]["code"]), (False, "RESOURCE_EXHAUSTED"))
        self.fails(1, "prepare", "long.yaml", says=["MiB"])


if __name__ == "__main__":
    main()

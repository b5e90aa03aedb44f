# SPDX-License-Identifier: GPL-3.0-or-later
"""The command line as a user meets it: the README's flow, JSON keys, exit codes, one-line errors, resumable sweeps."""

import json
import math
import os
import shutil
import signal
import subprocess
import tarfile

from harness import AHMED_SETUP, DEFORM, DEFORMD, EndToEnd, box, distance, main, read_obj


class Flow(EndToEnd):
    def setUp(self):
        super().setUp()
        self.start_server()
        self.sample = self.deform("sample", "-o", "ahmed.obj", "--points", 3000, "--json").json
        self.write("setup.yaml", AHMED_SETUP)

    def test_points_that_have_strayed_are_told_wherever_one_looks(self):
        """One point far away makes the body a dot in its own box: only the handles moved, and that was good without a word."""
        lines = open(self.path("ahmed.obj")).read().splitlines(keepends=True)
        last = max(i for i, line in enumerate(lines) if line.startswith("v "))
        lines.insert(last + 1, "v 1e15 0 0\n")
        self.write("ahmed.obj", "".join(lines))
        said = "but the bounding box is 1e+15 long"
        self.assertIn(said, self.deform("inspect", "ahmed.obj").out)
        self.assertIn(said, self.deform("inspect", "ahmed.obj", "--json").json["warning"])
        notes = self.deform("prepare", "setup.yaml", "--check", "--json").json["notes"]
        self.assertEqual(sum(said in note for note in notes), 1, notes)
        apply = ["apply", "setup.yaml", "--set", "roof_up=0.03", "-o", "out.obj", "--check", "off"]
        self.deform(*apply, expect=4)
        self.assertFalse(os.path.exists(self.path("out.obj")))
        applied = self.deform(*apply, "--keep-bad", "--json", expect=4).json
        self.assertEqual(applied["report"]["verdict"], "bad", "errors are judged by the size of the body")
        self.assertTrue(any(said in reason for reason in applied["report"]["reasons"]), applied["report"])

    def test_readme_flow(self):
        self.assertEqual([g["name"] for g in self.sample["groups"]],
                         ["nose", "roof", "sides", "slant", "base", "underbody", "stilts"])
        inspected = self.deform("inspect", "ahmed.obj", "--json").json
        self.assertEqual(inspected["points"], self.sample["points"])
        self.assertEqual(inspected["boundary_edges"], 0)
        for key in ("faces", "groups", "box_min", "box_max", "components", "non_manifold_edges", "degenerate_faces",
                    "isolated_points"):
            self.assertIn(key, inspected)
        registered = self.deform("register", "ahmed.obj", "--json").json
        for key in ("id", "points", "faces", "groups"):
            self.assertIn(key, registered)
        self.assertEqual(registered["faces"], self.sample["faces"])
        check = self.deform("prepare", "setup.yaml", "--check", "--json").json
        self.assertTrue(any(note.startswith("Variable roof_up: bounds move points by up to 0.05 (") for note in check["notes"]), check["notes"])
        for key in ("centres", "peak_bytes", "resident_bytes", "seconds", "fits"):
            self.assertIn(key, check)
        self.assertFalse(check["resident"])
        self.assertEqual(self.status()["systems_resident"], 0)
        prepared = self.deform("prepare", "setup.yaml", "--json").json
        for key in ("id", "centres", "bytes", "seconds"):
            self.assertIn(key, prepared)
        self.assertEqual(prepared["geometry_id"], registered["id"])
        applied = self.deform("apply", "setup.yaml", "--set", "roof_up=0.03", "--set", "slant_turn=0.1", "-o", "out.obj",
                              "--json").json
        self.assertEqual(applied["points"], self.sample["points"])
        self.assertEqual(applied["max_error"], 0)
        for key in ("solve", "encode", "decode", "total"):
            self.assertGreaterEqual(applied["seconds"][key], 0)
        self.assertIn("interpolation_residual", applied["report"])
        self.check_result("ahmed.obj", "out.obj")
        listed = self.deform("list", "--json").json
        self.assertEqual([g["id"] for g in listed["geometries"]], [registered["id"]])
        self.assertEqual([s["id"] for s in listed["systems"]], [prepared["id"]])
        self.assertEqual(self.deform("show", prepared["id"][:12]).json["id"], prepared["id"])
        shown = self.write("again.yaml", self.deform("show", prepared["id"], "--setup").out)
        self.assertEqual(self.deform("prepare", shown, "--json").json["id"], prepared["id"])
        self.fails(1, "remove", registered["id"], says=["setup"])
        removed = self.deform("remove", registered["id"], "--with-setups", "--json").json["removed"]
        self.assertEqual(removed[0]["setups_deleted"], 1)
        self.assertEqual(self.deform("list", "--json").json, {"geometries": [], "systems": []})

    def check_result(self, before_file, after_file):
        before, lines_before = read_obj(self.path(before_file))
        after, lines_after = read_obj(self.path(after_file))
        self.assertEqual(lines_before, lines_after)
        self.assertEqual(len(before), len(after))
        low, high = box(before)
        diagonal = math.dist(low, high)
        group_points = self.group_points(before_file)
        for point in group_points["nose"] | group_points["underbody"] | group_points["stilts"]:
            self.assertLessEqual(distance(before[point], after[point]), 1e-9 * diagonal)
        for point in group_points["roof"]:
            if 0.4 <= before[point][0] <= 0.6:
                x, y, z = before[point]
                self.assertLessEqual(distance((x, y, z + 0.03), after[point]), 1e-9 * diagonal)
        c, s = math.cos(0.1), math.sin(0.1)
        for point in group_points["slant"]:
            x, y, z = before[point]
            dx, dz = x - 0.843, z - 0.338
            turned = (0.843 + c * dx + s * dz, y, 0.338 - s * dx + c * dz)
            self.assertLessEqual(distance(turned, after[point]), 1e-9 * diagonal)

    def group_points(self, name):
        groups, current = {}, None
        with open(self.path(name)) as file:
            for line in file:
                words = line.split()
                if words[:1] == ["g"]:
                    current = groups.setdefault(words[1], set())
                elif words[:1] == ["f"] and current is not None:
                    current.update(int(w.split("/")[0]) - 1 for w in words[1:])
        return groups

    def test_encodings_keep_the_tolerance(self):
        self.deform("apply", "setup.yaml", "--set", "roof_up=0.03", "-o", "exact.obj")
        exact, _ = read_obj(self.path("exact.obj"))
        for encoding, tolerance in (("draco", 1e-4), ("DRACO", 1e-7), ("delta_zstd", 1e-5), ("raw_f32", 1e-7)):
            reply = self.deform("apply", "setup.yaml", "--set", "roof_up=0.03", "-o", "coded.obj", "--encoding", encoding,
                                "--tolerance", tolerance, "--json").json
            coded, _ = read_obj(self.path("coded.obj"))
            largest = max(distance(a, b) for a, b in zip(exact, coded))
            self.assertLessEqual(largest, reply["max_error"] * (1 + 1e-9) + 1e-16)
            self.assertLessEqual(reply["max_error"], tolerance * (1 + 1e-9))

    def test_vertex_normals_turn_when_asked(self):
        with open(self.path("ahmed.obj"), encoding="utf-8") as file:
            lines = file.read().splitlines()
        roof = "vn 0 0 1.00"  # spelled so that it is found again
        with_normals = [roof] + [" ".join(word if k == 0 else word + "//1" for k, word in enumerate(line.split()))
                                 if line.startswith("f ") else line for line in lines]
        self.write("normals.obj", "\n".join(with_normals) + "\n")
        self.write("normals.yaml", AHMED_SETUP.replace("ahmed.obj", "normals.obj"))
        command = ["apply", "normals.yaml", "--set", "slant_turn=0.1", "-o", "out.obj"]
        def written():
            with open(self.path("out.obj"), encoding="utf-8") as file:
                return next(line for line in file.read().splitlines() if line.startswith("vn "))
        self.deform(*command)
        self.assertEqual(written(), roof)
        self.deform(*command, "--turn-normals")
        turned = [float(word) for word in written().split()[1:]]
        self.assertNotEqual(written(), roof)
        self.assertAlmostEqual(math.hypot(*turned), 1, delta=1e-14)
        # A sweep that is asked for other normals does not take the files that are there.
        self.write("designs.csv", "name,slant_turn\na,0.1\n")
        sweep = ["sweep", "normals.yaml", "--designs", "designs.csv", "-o", "swept", "--json"]
        self.assertEqual(self.deform(*sweep).json["written"], 1)
        self.assertEqual(self.deform(*sweep).json["skipped"], 1)
        self.assertEqual(self.deform(*sweep, "--turn-normals").json["written"], 1)

    def test_motions_from_files(self):
        self.write("matrix.csv", "handle,m00,m01,m02,m03,m10,m11,m12,m13,m20,m21,m22,m23\n"
                                 "roof,1,0,0,0,0,1,0,0,0,0,1,0.03\n")
        self.deform("apply", "setup.yaml", "--set", "roof_up=0.03", "-o", "by_variable.obj")
        self.deform("apply", "setup.yaml", "--motions", "matrix.csv", "-o", "by_matrix.obj")
        by_variable, _ = read_obj(self.path("by_variable.obj"))
        by_matrix, _ = read_obj(self.path("by_matrix.obj"))
        self.assertLessEqual(max(distance(a, b) for a, b in zip(by_variable, by_matrix)), 1e-12)
        before, _ = read_obj(self.path("ahmed.obj"))
        roof = sorted(p for p in self.group_points("ahmed.obj")["roof"] if 0.4 <= before[p][0] <= 0.6)
        lines = [f"roof,{p},0,0,0.03" for p in reversed(roof)]
        self.write("displacements.csv", "\n".join(["handle,point,dx,dy,dz", *lines]) + "\n")
        self.deform("apply", "setup.yaml", "--motions", "displacements.csv", "-o", "by_points.obj")
        by_points, _ = read_obj(self.path("by_points.obj"))
        self.assertLessEqual(max(distance(a, b) for a, b in zip(by_variable, by_points)), 1e-9)
        self.write("short.csv", "\n".join(["handle,point,dx,dy,dz", *lines[1:]]) + "\n")
        self.fails(1, "apply", "setup.yaml", "--motions", "short.csv", "-o", "x.obj", says=["1 of its", str(roof[-1])])
        self.assertFalse(os.path.exists(self.path("x.obj")))

    def test_sweep_is_interrupted_and_resumed(self):
        count = 60
        rows = [f"d{k},{0.05 * k / count},{-0.001 * k}" for k in range(count)]
        self.write("designs.csv", "\n".join(["name,roof_up,slant_turn", *rows]) + "\n")
        command = ["sweep", "setup.yaml", "--designs", "designs.csv", "-o", "results", "--batch", 1, "--json"]
        self.deform("prepare", "setup.yaml")
        child = self.spawn(*command)
        manifest = self.path("results/sweep.manifest")
        def entries():
            """The entries of finished results; there are other lines, too."""
            if not os.path.exists(manifest):
                return {}
            with open(manifest) as file:
                lines = [json.loads(line) for line in file.read().split("\n")[:-1]]
            return {line["name"]: line for line in lines if "hash" in line}

        self.wait_until(entries, "a first result")
        child.send_signal(signal.SIGKILL)
        child.wait()
        recorded = entries()
        for entry in recorded.values():  # what counts as finished is complete
            self.assertEqual(len(read_obj(self.path("results/" + entry["file"]))[0]), self.sample["points"])
        resumed = self.deform(*command).json
        self.assertEqual(resumed["skipped"], len(recorded))
        self.assertEqual(resumed["written"], count - len(recorded))
        self.assertEqual(self.deform(*command).json["skipped"], count)
        files = sorted(os.listdir(self.path("results")))
        self.assertEqual(files, sorted([f"d{k}.obj" for k in range(count)] + ["sweep.manifest"]))
        self.deform("apply", "setup.yaml", "--set", f"roof_up={0.05 * 7 / count}", "--set", "slant_turn=-0.007", "-o", "d7.obj")
        with open(self.path("d7.obj"), "rb") as one, open(self.path("results/d7.obj"), "rb") as other:
            self.assertEqual(one.read(), other.read())
        rows[3] = "d3,0.01,0"
        self.write("designs.csv", "\n".join(["name,roof_up,slant_turn", *rows]) + "\n")
        self.assertEqual(self.deform(*command).json["written"], 1)
        self.deform("sweep", "setup.yaml", "--designs", "designs.csv", "-o", "results.tar")
        with tarfile.open(self.path("results.tar")) as archive:
            self.assertEqual(sorted(archive.getnames()), sorted(f"d{k}.obj" for k in range(count)))
            with open(self.path("results/d3.obj"), "rb") as file:
                self.assertEqual(archive.extractfile("d3.obj").read(), file.read())

    def test_incremental_qr_and_its_tolerance(self):
        greedy = "solver: INCREMENTAL_QR, reduction: REDUCTION_OFF, centre_order: GREEDY, samples: [{variables: [0.03, 0.1]}]"
        self.write("qr.yaml", AHMED_SETUP.replace("kernel: TRIHARMONIC", f"kernel: TRIHARMONIC, {greedy}"))
        prepared = self.deform("prepare", "qr.yaml", "--json").json
        self.assertEqual(prepared["solver"], "INCREMENTAL_QR")
        self.assertEqual(prepared["tolerance"], 1e-4)
        self.assertIn("solver: INCREMENTAL_QR, tolerance 0.0001 D\n", self.deform("prepare", "qr.yaml").out)
        self.assertEqual(self.deform("prepare", "setup.yaml", "--json").json["tolerance"], 0)
        self.assertNotIn("tolerance", self.deform("prepare", "setup.yaml").out)
        self.assertLess(3 * prepared["centres"], prepared["constraint_points"])
        design = ["--set", "roof_up=0.03", "--set", "slant_turn=0.1", "-o", "out.obj", "--json"]
        # Between the constraint points both are farther off than 1e-3 of the motion, and say so.
        fine = self.deform("apply", "qr.yaml", "--keep-bad", *design, expect=4).json["report"]
        coarse = self.deform("apply", "qr.yaml", "--keep-bad", "--solver-tolerance", "5e-3", *design, expect=4).json["report"]
        for report in (fine, coarse):
            self.assertEqual(report["verdict"], "bad")
            self.assertGreater(report["relative_error"], 1e-3)
        self.assertLess(2 * fine["interpolation_residual"], coarse["interpolation_residual"])  # by how much depends on the BLAS of the machine, which decides between like centres
        self.check_result("ahmed.obj", "out.obj")
        self.fails(1, "apply", "qr.yaml", "--solver-tolerance", "1e-6", *design[:-1], says=["tolerance", "prepared for 0.0001"])
        self.fails(1, "apply", "setup.yaml", "--solver-tolerance", "1e-3", *design[:-1], says=["tolerance", "cholesky"])

    def test_bench_reports_rates(self):
        report = self.deform("bench", "setup.yaml", "--clients", 2, "--population", 5, "--designs", 20, "--json").json
        self.assertEqual(report["designs"], 20)
        self.assertGreater(report["designs_per_second"], 0)
        self.assertGreaterEqual(report["latency_ms"]["p99"], report["latency_ms"]["p50"])
        self.assertEqual(set(report["stages_ms_per_design"]), {"solve", "encode", "decode"})

    def test_errors_are_one_line_that_says_what_to_do(self):
        self.fails(1, "apply", "setup.yaml", "--set", "roofup=1", "-o", "x.obj", says=["did you mean \"roof_up\""])
        self.fails(1, "apply", "setup.yaml", "--set", "roof_up=1", "-o", "x.obj", says=["roof_up", "0.05"])
        self.fails(1, "apply", "setup.yaml", "-o", "x.stl", says=["x.stl"])
        self.fails(1, "apply", "missing.yaml", "-o", "x.obj", says=["missing.yaml"])
        self.fails(1, "inspect", "missing.obj", says=["missing.obj"])
        self.fails(1, "show", "0123456789abcdef", says=["deform list"])
        self.fails(1, "show", "xyz", says=["hexadecimal"])
        for change, says in ((("group: slant", "group: slnt"), ["slnt", "slant"]),
                             (("handles:", "handels:"), ["bad.yaml:3", "handles"]),
                             (("ahmed.obj", "other.obj"), ["other.obj"]),
                             (("{group: nose}", "{group: slant}"), ["slant"]),
                             (("handle: roof", "handle: rof"), ["rof", "roof"]),
                             (("name: roof,", "name: slant,"), ["\"slant\" is used twice", "\"slant_2\""]),
                             (("{group: slant}", "{patch: {seed: [1, 0, 2]}}"), ["patch.seed", "from the surface", "at most"]),
                             (("[0.4, -1, 0]", "[0.9, -1, 0]"), ["roof"])):
            self.write("bad.yaml", AHMED_SETUP.replace(*change))
            self.fails(1, "prepare", "bad.yaml", says=says)

    def test_no_command_replaces_what_it_reads(self):
        self.write("designs.csv", "roof_up\n0.01\n")
        os.symlink("ahmed.obj", self.path("link.obj"))
        def content(name):
            with open(self.path(name), "rb") as file:
                return file.read()
        self.deform("cage", "mesh", "ahmed.obj", "--kind", "box", "--points", "150", "-o", "box.obj")
        self.write("box.yaml", AHMED_SETUP.replace("{rbf: {kernel: TRIHARMONIC}}", "{cage: {file: box.obj, control: MESH}}"))
        names = ("ahmed.obj", "setup.yaml", "designs.csv", "box.obj")
        before = [content(name) for name in names]
        for arguments, file in ((["cage", "mesh", "ahmed.obj", "-o", "link.obj"], "link.obj"),
                                (["detect", "ahmed.obj", "-o", "ahmed.obj"], "ahmed.obj"),
                                (["compile", "setup.yaml", "-o", "setup.yaml"], "setup.yaml"),
                                (["compile", "setup.yaml", "-o", "ahmed.obj"], "ahmed.obj"),
                                (["compare", "setup.yaml", "--designs", "designs.csv", "-o", "designs.csv"], "designs.csv"),
                                (["compare", "setup.yaml", "--set", "roof_up=0.01", "-o", "ahmed.obj"], "ahmed.obj"),
                                (["apply", "box.yaml", "--set", "roof_up=0.01", "-o", "box.obj"], "box.obj"),
                                (["quality", "ahmed.obj", "--html", "ahmed.obj"], "ahmed.obj")):
            self.fails(1, *arguments, says=["would replace", file])
        self.assertEqual([content(name) for name in names], before)

    def test_symmetric_cars_have_symmetric_cages(self):
        made = self.deform("cage", "mesh", "ahmed.obj", "--points", 150, "-o", "cage.obj")
        self.assertIn("  symmetric to y = 0, as the mesh is, but for 0 (0 D)\n", made.out)
        self.assertNotIn("warning", made.err)
        told = self.deform("cage", "mesh", "ahmed.obj", "--points", 150, "-o", "cage.obj", "--json").json
        self.assertEqual(told["symmetry"], [{"point": [0, 0, 0], "normal": [0, 1, 0]}])
        vertices, _ = read_obj(self.path("cage.obj"))
        for x, y, z in vertices:  # every one has an image
            self.assertLess(min(distance((x, -y, z), other) for other in vertices), 1e-12)
        without = self.deform("cage", "mesh", "ahmed.obj", "--points", 150, "-o", "other.obj", "--symmetry-tolerance", 0)
        self.assertNotIn("symmetric", without.out)
        self.write("cage.yaml", AHMED_SETUP.replace("{rbf: {kernel: TRIHARMONIC}}", "{cage: {file: cage.obj, control: MESH}}"))
        self.assertIn("its own mirror image in y = 0.", self.deform("prepare", "cage.yaml", "--check").out)
        # A bump of 4 mm, over a thousandth of the diagonal, on one side.
        with open(self.path("ahmed.obj"), encoding="ascii") as file:
            lines = file.read().splitlines()
        for i, line in enumerate(lines):
            if line.startswith("v "):
                x, y, z = map(float, line.split()[1:4])
                if y > 0:
                    lines[i] = f"v {x} {y + 0.004 * math.exp(-((x - 0.5) ** 2 + (z - 0.2) ** 2) / 0.01)} {z}"
        self.write("bump.obj", "\n".join(lines) + "\n")
        bump = self.deform("cage", "mesh", "bump.obj", "--points", 150, "-o", "bumped.obj").out
        self.assertIn("  not symmetric, as the mesh is only nearly symmetric to ", bump)
        tolerance = bump.split("--symmetry-tolerance ")[1].split()[0]
        wanted = self.deform("cage", "mesh", "bump.obj", "--points", 150, "-o", "bumped.obj", "--symmetry-tolerance", tolerance).out
        self.assertIn("\n  symmetric to ", wanted)

    def test_a_cage_far_away_is_warned_of(self):
        far = self.deform("cage", "mesh", "ahmed.obj", "--kind", "box", "--points", 98, "--offset", 500, "-o", "far.obj")
        self.assertIn("--offset 500: the cage is ", far.err)
        self.assertIn("model units", far.err)
        near = self.deform("cage", "mesh", "ahmed.obj", "--kind", "box", "--points", 98, "--offset", 0.5, "-o", "near.obj")
        self.assertNotIn("--offset", near.err)

    def test_a_page_that_is_no_page_and_a_cage_that_is_none(self):
        self.fails(1, "compare", "setup.yaml", "--set", "roof_up=0.01", "-o", "z.pdf", says=["z.pdf", ".html"])
        refused = self.fails(1, "compare", "setup.yaml", "--methods", "cage", "--set", "roof_up=0.01", "--json", says=["no method"], prints=True)
        self.assertIn("needs a cage", refused.json["methods"][0]["refused"][0])
        self.assertIn("deform cage mesh", refused.json["methods"][0]["refused"][0])

    def test_points_without_faces_are_told(self):
        self.write("cloud.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n")
        first = self.deform("register", "cloud.obj")
        self.assertIn("cloud.obj: no faces and no cells, only 4 points", first.err)
        self.assertIn("4 points, no faces", first.out)
        self.assertEqual(self.deform("register", "cloud.obj").err, "", "once")

    def test_tables_of_spreadsheets_with_semicolons(self):
        self.write("designs.csv", "name;roof_up\na;0.01\nb;0,01\n")
        self.fails(1, "sweep", "setup.yaml", "--designs", "designs.csv", "-o", "results", prints=True,
                   says=["1 of 2 designs failed", 'designs.csv:3: roof_up: expected a finite number, got "0,01"; decimals are written with a point: 0.01'])
        self.assertTrue(os.path.exists(self.path("results/a.obj")))
        self.write("probes.csv", "name;x;y;z\nq,r;0.5;0;0.3\n")
        self.deform("evaluate", "setup.yaml", "probes.csv", "-o", "moved.csv")
        with open(self.path("moved.csv")) as file:
            self.assertEqual(file.read(), "name;x;y;z\nq,r;0.5;0;0.3\n")
        self.write("probes.csv", "\ufeffx,y,z\n0.5,0,0.3\n")
        self.deform("evaluate", "setup.yaml", "probes.csv", "-o", "moved.csv")
        with open(self.path("moved.csv")) as file:
            self.assertEqual(file.read(), "\ufeffx,y,z\n0.5,0,0.3\n", "the byte order mark of UTF-8 stays")
        self.write("probes.xyz", "\ufeff0.5 0 0.3\n")
        self.deform("evaluate", "setup.yaml", "probes.xyz", "-o", "moved.xyz")
        self.write("probes.csv", "x;y;z\n0,5;0;0.3\n")
        self.fails(1, "evaluate", "setup.yaml", "probes.csv", "-o", "moved.csv", says=["probes.csv:2", '"0,5"', "with a point"])
        for decimals in ("0,5 1,5 0,3", "1 2 0,3", "0,5 1 2", "1\t2,5 3"):
            self.write("probes.xyz", decimals + "\n")
            self.fails(1, "evaluate", "setup.yaml", "probes.xyz", "-o", "moved.xyz", says=["probes.xyz:1", "with a point"])
        self.write("probes.xyz", "0.5, 1.5, 0.3\n0.5,1.5,0.3 7,8\n0.5 1.5 0.3 9,1\n1 2, 3\n")
        self.deform("evaluate", "setup.yaml", "probes.xyz", "-o", "moved.xyz")
        self.fails(1, "evaluate", "setup.yaml", "probes.xyz", "-o", "nowhere/moved.xyz", says=["there is no folder nowhere"])

    def test_values_beyond_all_digits_are_bad(self):
        with open(self.path("setup.yaml")) as file:
            setup = file.read()
        self.write("unbounded.yaml", setup.replace(", lower: -0.05, upper: 0.05", "").replace(", lower: -0.2, upper: 0.2", ""))
        bad = self.fails(4, "apply", "unbounded.yaml", "--set", "roof_up=1e300", "-o", "x.obj", "--json", prints=True, says=["times the diagonal"])
        self.assertAlmostEqual(bad.json["report"]["max_displacement"] / 1e300, 1)
        self.assertFalse(os.path.exists(self.path("x.obj")))
        self.fails(1, "apply", "unbounded.yaml", "--set", "slant_turn=1e300", "-o", "x.obj", says=['"slant_turn"', "1e12 radians"])
        self.write("probes.csv", "x,y,z\n0.5,0,0.3\n")
        self.fails(1, "evaluate", "unbounded.yaml", "probes.csv", "--set", "roof_up=1e300", "-o", "q.csv", says=["times the diagonal"])

    def test_commands_that_need_cad_are_those_of_the_program_beside(self):
        """Loading OpenCASCADE takes longer than most commands, so it is in a program of its own, which gets all that was given."""
        alone = self.path("deform")
        shutil.copy(DEFORM, alone)
        regions = [alone, "cad-regions", "part with blanks.step", "-", "-o", "", "--json"]
        missing = subprocess.run(regions, capture_output=True, text=True, timeout=60)
        self.assertEqual(missing.returncode, 1)
        self.assertRegex(missing.stderr, "^deform: (this program was built without CAD|deform-cad does not lie beside deform)")
        self.write("deform-cad", "#!/bin/sh\nprintf '<%s>' \"$@\"\ncat\nexit 7\n")
        refused = subprocess.run(regions, capture_output=True, text=True, timeout=60)
        self.assertEqual(refused.returncode, 1)
        self.assertIn("deform-cad: Permission denied", refused.stderr)
        os.chmod(self.path("deform-cad"), 0o755)
        for command in (regions, [alone, "--server", "unix:none", "cad-move", "a.step", "b.step", "-", "-o", "m.csv"]):
            other = subprocess.run(command, input="its input", capture_output=True, text=True, timeout=60)
            self.assertEqual(other.stdout, "".join(f"<{argument}>" for argument in command[1:]) + "its input")
            self.assertEqual((other.returncode, other.stderr), (7, ""))
        if os.path.exists(os.path.join(os.path.dirname(DEFORM), "deform-cad")):
            self.fails(1, "cad-regions", "no.step", "ahmed.obj", "-o", "s.yaml", says=["no.step"])

    def test_exit_codes(self):
        self.fails(2, says=["--help"])
        self.fails(2, "aply", says=["did you mean \"apply\""])
        self.fails(2, "apply", says=["SETUP", "deform apply --help"])
        self.fails(2, "apply", "setup.yaml", "--outptu", "x.obj", "--zap=3", "7", says=[
            'unknown options "--outptu" (did you mean "--output"?), "--zap"', "deform apply --help"])
        self.fails(2, "apply", "setup.yaml", "-o", "x.obj", "--fial-on", "missed", says=['unknown option "--fial-on" (did you mean "--fail-on"'])
        self.fails(2, "sample", "-o", "x.obj", "one", "two", says=['unexpected arguments "one", "two"; see deform sample --help'])
        self.fails(2, "admin", "cals", says=['there is no command "admin cals"; did you mean "calls"'])
        self.fails(2, "--sevrer", "localhost:1", "status", says=['unknown option "--sevrer" (did you mean "--server"'])
        self.fails(2, "apply", "setup.yaml", "-o", "x.obj", "--fail-on", "fliped_faces>0", says=['did you mean "flipped_faces"'])
        self.fails(2, "cage", "mesh", "setup.yaml", says=["--output", "deform cage mesh --help"])
        self.fails(2, "lattice", "refine", says=["deform lattice refine --help"])
        self.fails(2, "apply", "setup.yaml", "-o", "x.obj", "--encoding", "zip", says=["zip"])
        self.fails(2, "sample", "-o", "x.obj", "--points", 10, says=["10"])
        self.assertRegex(self.deform("--version").out, r"^deform \d+\.\d+\.\d+ \(commit (unknown|[0-9a-f]{12,}(-dirty)?)\)$")
        for command in ("sample", "inspect", "register", "prepare", "apply", "sweep", "list", "show", "remove", "status", "bench"):
            self.assertIn("Usage", self.deform(command, "--help").out)
            self.assertIn(command, self.deform("--help").out)
        self.fails(1, "--server", "localhost", "list", says=["HOST:PORT"])
        self.server.stop()
        self.fails(3, "status", says=["cannot reach deformd at 127.0.0.1", "start it"])


class Start(EndToEnd):
    def deformd(self, *options):
        return subprocess.run([DEFORMD, *options], cwd=self.folder, env=self.environment(), timeout=30, stdout=subprocess.PIPE,
                              stderr=subprocess.STDOUT, text=True)

    def test_a_second_server_on_the_same_data_is_refused(self):
        self.start_server()
        second = self.deformd("--address", "127.0.0.1:0", "--data-dir", self.server.data)
        self.assertNotEqual(second.returncode, 0)
        self.assertIn(self.server.data, second.stdout)
        self.assertFalse(self.status()["draining"])

    def test_no_listening_beyond_loopback_unless_told(self):
        refused = self.deformd("--address", "0.0.0.0:0", "--data-dir", "other")
        self.assertNotEqual(refused.returncode, 0)
        self.assertIn("--insecure", refused.stdout)

    def test_sigterm_ends_cleanly(self):
        self.start_server()
        self.assertEqual(self.server.stop(), 0)


if __name__ == "__main__":
    main()

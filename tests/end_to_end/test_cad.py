# SPDX-License-Identifier: GPL-3.0-or-later
"""A volume mesh follows its CAD model: a block with a bore that widens, tilts and moves, judged by the parameters of the model."""

import csv
import gzip
import json
import math
import os
import shutil

from harness import SHARED_DATA, EndToEnd, main

PARAM = os.path.join(SHARED_DATA, "B_volume", "param")
CAD = os.path.join(SHARED_DATA, "D_cad")
ROUNDING = 2e-8  # of the table of nodes


def model(name):
    return os.path.join(CAD, name)


class Cad(EndToEnd):
    def setUp(self):
        super().setUp()
        shutil.copy(os.path.join(PARAM, "bore_tet_p0.msh.gz"), self.path("bore.msh.gz"))

    def nodes(self):
        """Patches and place at rest by node."""
        with gzip.open(os.path.join(PARAM, "bore_tet_boundary_steps.csv.gz"), "rt") as file:
            rows = list(csv.reader(file))[1:]
        return {int(row[0]): (row[1].split("|"), [float(v) for v in row[2:5]]) for row in rows}

    def move(self, share):
        self.deform("cad-move", model("bore_p000.step"), model(f"bore_p{share:03}.step"), "bore.msh.gz", "-o", f"m{share}.csv", "--setup",
                    f"s{share}.yaml")
        with open(self.path(f"m{share}.csv")) as file:
            return {int(row["point"]): [float(row[k]) for k in ("dx", "dy", "dz")] for row in csv.DictReader(file)}

    def test_the_boundary_lies_on_the_new_model_and_the_volume_follows(self):
        self.start_server()
        nodes = self.nodes()
        for share in (25, 50, 100):
            part = share / 100
            radius, tilt, shift = 0.5 + 0.3 * part, math.radians(20 * part), 0.3 * part
            motions = self.move(share)
            self.assertEqual(set(motions), set(nodes))
            axes = {"x": (math.sin(tilt), 0, math.cos(tilt)), "y": (0, -math.sin(tilt), math.cos(tilt)), "-y": (0, math.sin(tilt), math.cos(tilt)),
                    "-x": (-math.sin(tilt), 0, math.cos(tilt))}
            worst = dict.fromkeys(axes, 0)
            for node, (patches, rest) in nodes.items():
                moved = [r + d for r, d in zip(rest, motions[node])]
                if "side" in patches:
                    self.assertEqual(motions[node], [0, 0, 0], "the sides stay as they are")
                for patch, height in (("top", 1), ("bottom", -1)):
                    if patch in patches:
                        self.assertAlmostEqual(moved[2], height, delta=ROUNDING)
                if "hole" not in patches:
                    continue
                for name, axis in axes.items():
                    from_axis = [moved[0] - shift, moved[1], moved[2]]
                    along = sum(a * b for a, b in zip(from_axis, axis))
                    distance = math.sqrt(sum((p - along * a) ** 2 for p, a in zip(from_axis, axis)))
                    worst[name] = max(worst[name], abs(distance - radius))
            self.assertLess(min(worst.values()), ROUNDING, f"{share} %: distance from the cylinder {worst}")
            applied = self.deform("apply", f"s{share}.yaml", "--motions", f"m{share}.csv", "-o", f"out{share}.msh", "--fail-on", "inverted_cells>0")
            self.assertIn("none is inverted", applied.out)
            self.assertIn("good", applied.out)

    def test_a_volume_mesh_follows_in_one_command(self):
        self.start_server()
        moved = self.deform("cad-move", model("bore_p000.step"), model("bore_p100.step"), "bore.msh.gz", "--setup", "s.yaml", "-o", "out.msh.gz", "--split",
                            "uniform", "--fail-on", "inverted_cells>0", "--json").json
        self.assertEqual(moved["file"], "s.motions.csv")
        self.assertEqual((moved["flipped"], moved["outside"]), (0, 0))
        self.assertEqual(moved["applied"]["report"]["verdict"], "good")
        self.assertEqual(moved["applied"]["report"]["cells"]["inverted"], 0)
        self.deform("apply", "s.yaml", "--motions", "s.motions.csv", "-o", "again.msh.gz", "--split", "uniform")
        with gzip.open(self.path("out.msh.gz")) as one, gzip.open(self.path("again.msh.gz")) as other:
            self.assertEqual(one.read(), other.read())
        on_new = self.deform("cad-move", model("bore_p100.step"), model("bore_p100.step"), "out.msh.gz", "-o", "none.csv", "--json").json
        self.assertLess(on_new["farthest"], ROUNDING)
        self.fails(4, "cad-move", model("bore_p000.step"), model("bore_p100.step"), "bore.msh.gz", "--setup", "t.yaml", "-o", "out2.msh.gz", "--fail-on",
                   "max_displacement>0.01", says=["max_displacement"], prints=True)

    def test_a_pipe_that_bends_is_paired_without_a_map(self):
        """Its ends are alike; the table says where the nodes of its wall go, with nine digits."""
        shutil.copy(os.path.join(PARAM, "pipe_tet_p0.msh.gz"), self.path("pipe.msh.gz"))
        with gzip.open(os.path.join(PARAM, "pipe_tet_boundary_steps.csv.gz"), "rt") as file:
            rows = list(csv.reader(file))[1:]
        for share in (50, 100):
            moved = self.deform("cad-move", model("pipe_p000.step"), model(f"pipe_p{share:03}.step"), "pipe.msh.gz", "-o", "m.csv", "--json").json
            self.assertEqual((moved["flipped"], moved["outside"]), (0, 0))
            self.assertLess(moved["distance"], 1e-9 * moved["diagonal"])
            with open(self.path("m.csv")) as file:
                motions = {int(row["point"]): [float(row[k]) for k in ("dx", "dy", "dz")] for row in csv.DictReader(file)}
            self.assertEqual(len(motions), len(rows))
            for row in rows:
                if row[1] in ("inlet", "outlet"):  # moved another way
                    continue
                first, last = (list(map(float, row[2 + 3 * k:5 + 3 * k])) for k in (0, share // 5))
                place = [a + d for a, d in zip(first, motions[int(row[0])])]
                self.assertLess(math.dist(place, last), ROUNDING)

    def test_what_does_not_fit_is_refused_by_name(self):
        self.fails(1, "cad-move", model("bore_p000.step"), model("ahmed_slant25.step"), "bore.msh.gz", "-o", "m.csv", "--setup", "s.yaml",
                   says=["face"])
        self.fails(1, "cad-move", model("bore_p100.step"), model("bore_p000.step"), "bore.msh.gz", "-o", "m.csv", "--setup", "s.yaml",
                   says=["farther", "--tolerance"])
        self.fails(1, "cad-move", model("bore_p000.step"), model("bore_p100.step"), "bore.msh.gz", "-o", "moved.msh", says=["--setup"])
        for name in ("m.csv", "s.yaml", "moved.msh"):
            self.assertFalse(os.path.exists(self.path(name)), name)

    SETUP = """\
geometry: bore.msh.gz
method: {rbf: {kernel: TRIHARMONIC}}
handles: [{name: top, region: {half_space: {point: [0, 0, 0.99], normal: [0, 0, 1]}}}]
fixed: [{half_space: {point: [0, 0, -0.99], normal: [0, 0, -1]}}]
variables:
  - {name: turn, handle: top, rotate: {axis: [0, 0, 1], unit: DEGREES}}
  - {name: up, handle: top, translate: [0, 0, 1]}
"""

    def test_the_deformed_mesh_lies_on_the_deformed_model(self):
        """Whether mesh and model agree is judged by cad-move, which projects the nodes onto the model that was written."""
        self.start_server()
        self.write("s.yaml", self.SETUP)
        settings = ("--set", "turn=20", "--set", "up=0.1")
        before = self.status()
        report = self.deform("cad-apply", "s.yaml", model("bore_p000.step"), *settings, "-o", "out.step", "--tolerance", "1e-5", "--json").json
        self.assertEqual(self.status()["geometries"], before["geometries"] + 1, "only the mesh stays")
        self.assertEqual(report["failures"], [])
        self.assertLess(report["error"], 2e-5 * report["diagonal"])
        self.assertLess(report["mesh_difference"], 1e-9 * report["diagonal"])
        # Between the nodes of the mesh the fixed bottom moves a little, and the top a little otherwise than its handle: both go as their nodes do.
        held = [face for face in report["faces"] if "overlooked" in face]
        self.assertEqual([(face["type"], face["became"]) for face in held], [("plane", "moved")] * 2)
        self.assertGreater(report["overlooked"], 1e-5 * report["diagonal"])
        self.assertLess(report["overlooked"], 1e-3 * report["diagonal"])
        loose = self.deform("cad-apply", "s.yaml", model("bore_p000.step"), *settings, "-o", "loose.step", "--tolerance", "1e-5", "--hold", "0",
                            "--json").json
        self.assertEqual([loose["overlooked"], loose["failures"]], [0, []])
        self.assertLess(loose["gap"], 2e-5 * report["diagonal"])
        self.deform("apply", "s.yaml", *settings, "-o", "out.msh.gz")
        moved = self.deform("cad-move", "out.step", "out.step", "out.msh.gz", "-o", "none.csv", "--json").json
        self.assertLess(moved["farthest"], 2e-5 * report["diagonal"] + ROUNDING)

    def test_a_bore_that_a_constraint_keeps_is_a_cylinder_in_the_file(self):
        self.start_server()
        self.deform("cad-regions", model("bore_p000.step"), "bore.msh.gz", "-o", "regions.yaml")
        for exactly in ("", "exact: true, "):
            self.write("s.yaml", """\
geometry: bore.msh.gz
method: {ffd: {lattice: {points: [7, 7, 5]}}}
handles: [{name: end, region: {half_space: {point: [1.99, 0, 0], normal: [1, 0, 0]}}}]
fixed: [{half_space: {point: [-1.99, 0, 0], normal: [-1, 0, 0]}}]
variables: [{name: shift, handle: end, translate: [0.3, 0.2, 0]}]
constraints: [{name: bore, %scylindrical: {}, regions: [{ids: {file: regions.points.json, set: cylinder_7}}]}]
""" % exactly)
            report = self.deform("cad-apply", "s.yaml", model("bore_p000.step"), "--set", "shift=1", "-o", "out.step", "--tolerance", "1e-6", "--json").json
            self.assertEqual(report["failures"], [])
            bore = next(face for face in report["faces"] if face["type"] == "cylinder")
            self.assertEqual(bore["became"], "reshaped", exactly)
            with open(self.path("out.step")) as file:
                radius = [float(line.split(",")[-1].split(")")[0]) for line in file if "CYLINDRICAL_SURFACE" in line]
            self.assertEqual(len(radius), 1)
            if not exactly:
                continue  # nodes are as far from the cylinder as the constraint reports
            self.deform("apply", "s.yaml", "--set", "shift=1", "-o", "out.msh.gz")
            moved = self.deform("cad-move", "out.step", "out.step", "out.msh.gz", "-o", "none.csv", "--json").json
            self.assertLess(moved["farthest"], 2e-6 * report["diagonal"] + 2 * bore.get("overlooked", 0) + ROUNDING)

    def test_half_models_slide_in_their_plane_of_symmetry(self):
        """Nodes of the fit lie beyond the plane by a margin, where the server knows no deformation."""
        self.start_server()
        self.write("s.yaml", """\
geometry: bore.msh.gz
method: {rbf: {kernel: TRIHARMONIC}}
symmetry: [{point: [0, 0, -1], normal: [0, 0, 1]}]
handles: [{name: end, region: {half_space: {point: [1.99, 0, 0], normal: [1, 0, 0]}}}]
fixed: [{half_space: {point: [-1.99, 0, 0], normal: [-1, 0, 0]}}]
variables: [{name: shift, handle: end, translate: [0, 1, 0]}]
""")
        report = self.deform("cad-apply", "s.yaml", model("bore_p000.step"), "--set", "shift=0.3", "-o", "out.step", "--tolerance", "1e-4", "--json").json
        self.assertEqual(report["failures"], [])
        self.deform("apply", "s.yaml", "--set", "shift=0.3", "-o", "out.msh.gz")
        moved = self.deform("cad-move", "out.step", "out.step", "out.msh.gz", "-o", "none.csv", "--json").json
        self.assertLess(moved["farthest"], 2e-4 * report["diagonal"])

    def test_a_lattice_that_the_mesh_places_stays_there(self):
        self.start_server()
        self.write("s.yaml", """\
geometry: bore.msh.gz
method: {ffd: {control: CONTROLS}}
handles: [{name: top, region: {lattice: {k: [5, 6]}}}]
variables: [{name: up, handle: top, translate: [0.1, 0, 0.2]}]
""")
        report = self.deform("cad-apply", "s.yaml", model("bore_p000.step"), "--set", "up=1", "-o", "out.brep", "--tolerance", "1e-4", "--json").json
        self.assertEqual(report["failures"], [])
        self.assertFalse(any("nothing was asked to move" in note for note in report["notes"]), report["notes"])
        self.assertLess(report["mesh_difference"], 1e-12 * report["diagonal"])

    def test_a_design_at_rest_is_told(self):
        self.start_server()
        self.write("s.yaml", self.SETUP)
        report = self.deform("cad-apply", "s.yaml", model("bore_p000.step"), "-o", "out.step", "--json").json
        self.assertIn("no variable differs from 0 and no motion is given: nothing was asked to move", report["notes"])

    def test_what_deforms_no_space_is_refused(self):
        self.start_server()
        self.write("s.yaml", self.SETUP.replace("rbf: {kernel: TRIHARMONIC}", "shell: {}"))
        self.fails(1, "cad-apply", "s.yaml", model("bore_p000.step"), "--set", "up=0.1", "-o", "out.step", says=["method.shell", "no other point of space"])
        self.write("s.yaml", self.SETUP)
        self.fails(1, "cad-apply", "s.yaml", model("bore_p000.step"), "--set", "up=0.1", "-o", "out.stl", says=[".step"])
        self.fails(1, "cad-apply", "s.yaml", model("bore_p000.step"), "--set", "up=0.1", "-o", "nowhere/out.step",
                   says=["-o nowhere/out.step: there is no folder nowhere"])
        self.fails(1, "cad-apply", "s.yaml", self.path("bore.msh.gz"), "--set", "up=0.1", "-o", "out.step", says=["bore.msh.gz"])
        self.assertFalse(os.path.exists(self.path("out.step")))
        self.assertEqual(os.listdir(self.folder).count("out.partial.step"), 0)

    def test_faces_become_constraints_and_sets(self):
        self.start_server()
        found = self.deform("cad-regions", model("bore_p000.step"), "bore.msh.gz", "-o", "regions.yaml", "--json").json
        types = [face["type"] for face in found["faces"]]
        self.assertEqual((types.count("plane"), types.count("cylinder")), (6, 1))
        patches = {node: patches for node, (patches, _) in self.nodes().items()}
        bore = next(face for face in found["faces"] if face["type"] == "cylinder")
        self.assertEqual(set(bore["points"]), {node for node in patches if "hole" in patches[node]})
        self.assertAlmostEqual(bore["radius"], 0.5)
        with open(self.path("regions.points.json")) as file:
            sets = json.load(file)
        self.assertEqual(sets[bore["name"]], bore["points"])
        self.assertEqual(len(sets), len(found["faces"]) + len(found["edges"]))
        # Of a setup: what the server accepts, and what keeps the bore a cylinder.
        self.write("s.yaml", self.SETUP.replace("rbf: {kernel: TRIHARMONIC}", "mls: {}"))
        self.deform("cad-regions", model("bore_p000.step"), "s.yaml", "-o", "kept.yaml")
        with open(self.path("kept.yaml")) as file:
            text = file.read()
        self.assertIn("cylindrical: {}", text)
        self.assertIn("all its points are fixed", text, "the bottom needs no constraint")
        self.deform("prepare", "kept.yaml", "--check")
        # A set as a region of a setup without constraints.
        self.write("held.yaml", self.SETUP.replace("fixed: [", f"fixed: [{{ids: {{file: regions.points.json, set: {bore['name']}}}}}, ")
                   .replace("half_space: {point: [0, 0, 0.99], normal: [0, 0, 1]}", "difference: [{half_space: {point: [0, 0, 0.99], normal: [0, 0, 1]}}, "
                            f"{{ids: {{file: regions.points.json, set: {bore['name']}}}}}]"))
        self.deform("prepare", "held.yaml", "--check")

    def test_exact_constraints_put_nodes_on_their_faces_to_the_last_digits(self):
        self.start_server()
        self.write("s.yaml", """\
geometry: bore.msh.gz
method: {ffd: {lattice: {points: [7, 7, 5]}}}
handles: [{name: end, region: {half_space: {point: [1.99, 0, 0], normal: [1, 0, 0]}}}]
fixed: [{half_space: {point: [-1.99, 0, 0], normal: [-1, 0, 0]}}]
variables: [{name: shift, handle: end, translate: [0.3, 0.2, 0]}]
""")
        largest = {}
        for name, options in (("soft", []), ("exact", ["--exact"])):
            self.deform("cad-regions", model("bore_p000.step"), "s.yaml", "-o", f"{name}.yaml", *options)
            report = self.deform("apply", f"{name}.yaml", "--set", "shift=1", "-o", f"{name}.msh.gz", "--json").json["report"]
            self.assertFalse(report["constraints"]["exact_given_up"])
            largest[name] = max(each["largest"] for each in report["constraints"]["residuals"])
        self.assertGreater(largest["soft"], 1e-6)  # also of planes that were planes without constraints
        self.assertLess(largest["exact"], 1e-14)

    def test_models_of_other_meshes_are_refused(self):
        self.fails(1, "cad-regions", model("ahmed_slant25.step"), "bore.msh.gz", "-o", "regions.yaml", says=["farther"])
        self.assertFalse(os.path.exists(self.path("regions.yaml")))


if __name__ == "__main__":
    main()

# SPDX-License-Identifier: GPL-3.0-or-later
"""Cells through a real server: checks in every reply, quality, splitting, motions of boundary nodes by place."""

import json
import math

from harness import EndToEnd, main, read_bytes

N = 24


def point_id(i, j):
    return i + (N + 1) * j


def square():
    """[0, 1]^2 in quads, as SU2 in two dimensions; the outer sides are the marker "outer"."""
    lines = ["NDIME= 2", f"NELEM= {N * N}"]
    for j in range(N):
        for i in range(N):
            lines.append(f"9 {point_id(i, j)} {point_id(i + 1, j)} {point_id(i + 1, j + 1)} {point_id(i, j + 1)}")
    lines.append(f"NPOIN= {(N + 1) ** 2}")
    lines += [f"{i / N!r} {j / N!r}" for j in range(N + 1) for i in range(N + 1)]
    edges = [(point_id(k, e), point_id(k + 1, e)) for e in (0, N) for k in range(N)]
    edges += [(point_id(e, k), point_id(e, k + 1)) for e in (0, N) for k in range(N)]
    lines += ["NMARK= 1", "MARKER_TAG= outer", f"MARKER_ELEMS= {len(edges)}"] + [f"3 {a} {b}" for a, b in edges]
    return "\n".join(lines) + "\n"


SQUARE_SETUP = """\
geometry: square.su2
handles: [{name: block, region: {box: {min: [0.4, 0.4, -1], max: [0.6, 0.6, 1]}}}]
fixed: [{group: outer}]
variables:
  - {name: turn, handle: block, rotate: {axis: [0, 0, 1], centre: [0.5, 0.5, 0]}}
  - {name: shift, handle: block, translate: [1, 0, 0]}
"""


def hexahedra(n):
    """[0, 1]^3 as Medit."""
    at = lambda i, j, k: 1 + i + (n + 1) * (j + (n + 1) * k)
    lines = ["MeshVersionFormatted 2", "Dimension 3", f"Vertices {(n + 1) ** 3}"]
    lines += [f"{i / n!r} {j / n!r} {k / n!r} 0" for k in range(n + 1) for j in range(n + 1) for i in range(n + 1)]
    lines.append(f"Hexahedra {n ** 3}")
    for k in range(n):
        for j in range(n):
            for i in range(n):
                base = [at(i, j, k), at(i + 1, j, k), at(i + 1, j + 1, k), at(i, j + 1, k)]
                lines.append(" ".join(map(str, base + [p + (n + 1) ** 2 for p in base] + [0])))
    return "\n".join(lines + ["End", ""])


CUBE_SETUP = """\
geometry: cube.mesh
handles: [{name: top, region: {half_space: {point: [0, 0, 1], normal: [0, 0, 1]}}}]
fixed: [{half_space: {point: [0, 0, 0], normal: [0, 0, -1]}}]
variables: [{name: up, handle: top, translate: [0, 0, 1]}]
"""

WRECK_SETUP = """\
geometry: ahmed.obj
method: {rbf: {kernel: TRIHARMONIC, reduction: REDUCTION_RINGS}}
handles:
  - {name: slant, region: {group: slant}}
  - {name: roof,  region: {intersection: [{group: roof}, {box: {min: [0.2, -1, 0], max: [0.8, 1, 1]}}]}}
fixed: [{group: nose}, {group: underbody}, {group: stilts}]
variables:
  - {name: roof_up,    handle: roof,  translate: [0, 0, 1], lower: -0.05, upper: 0.05}
  - {name: slant_turn, handle: slant, rotate: {axis: [0, 1, 0], centre: [0, 0, 0.3]}, lower: -0.2, upper: 0.2}
"""


def two_sheets(side=8):
    """A level sheet and over it a sloping one, which do not touch: z = 0 and z = 0.1 + 0.4 x."""
    lines, faces = [], {}
    for sheet, (base, slope) in {"level": (0, 0), "sloping": (0.1, 0.4)}.items():
        first = len(lines) + 1
        lines += [f"v {i / side} {j / side} {base + slope * i / side}" for j in range(side + 1) for i in range(side + 1)]
        at = [first + i + (side + 1) * j for j in range(side) for i in range(side)]
        faces[sheet] = [f"f {a} {a + 1} {a + side + 2} {a + side + 1}" for a in at]
    return "\n".join(lines + [line for sheet, of in faces.items() for line in [f"g {sheet}", *of]]) + "\n"


class Cells(EndToEnd):
    def setUp(self):
        super().setUp()
        self.start_server()

    def square(self):
        self.write("square.su2", square())
        self.write("square.yaml", SQUARE_SETUP)

    def apply(self, *arguments, expect=0):
        return self.deform("apply", *arguments, "-o", "out.su2", "--json", expect=expect).json["report"]

    def test_variables_that_leave_the_plane_of_a_file(self):
        """No design of such a variable can be written, so that --check refuses it with its name. In a file that stores z it may leave."""
        self.square()
        self.deform("prepare", "square.yaml", "--check")
        self.write("leaving.yaml", SQUARE_SETUP + "  - {name: lift, handle: block, translate: [0, 0, 1]}\n"
                   "  - {name: roll, handle: block, rotate: {axis: [1, 0, 0]}}\n")
        self.fails(1, "apply", "leaving.yaml", "--set", "lift=0.1", "-o", "out.su2", says=["two-dimensional"])
        told = self.fails(1, "prepare", "leaving.yaml", "--check", "--json", says=["2 problems"], prints=True).json
        self.assertEqual([each["field"] for each in told["problems"]], ["variables[2]", "variables[3]"])
        self.assertIn('variables[2] ("lift")', told["problems"][0]["message"])
        self.write("square.obj", "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n")
        self.write("plate.yaml", "geometry: square.obj\nhandles: [{name: block, region: {ids: [0, 1]}}]\nfixed: [{ids: [2, 3]}]\n"
                   "variables: [{name: lift, handle: block, translate: [0, 0, 1]}]\n")
        self.deform("prepare", "plate.yaml", "--check")

    def test_faces_of_a_plane_mesh(self):
        self.square()
        report = self.apply("square.yaml", "--set", "turn=0.3")
        self.assertEqual(report["cells"]["cells"], N * N)
        self.assertEqual((report["cells"]["safe_amplitude"], report["cells"]["inverted"]), (1, 0))
        self.assertNotIn("first_cell", report["cells"])
        report = self.apply("square.yaml", "--set", "turn=2.3", expect=4)
        cells = report["cells"]
        self.assertLess(cells["safe_amplitude"], 1)
        self.assertEqual(len(cells["inverted_ids"]), min(100, cells["inverted"]))
        self.assertIn("first_cell", cells)
        self.assertNotIn("split", report)
        self.assertNotIn("cells", self.apply("square.yaml", "--set", "turn=2.3", "--check", "off"))
        text = self.deform("apply", "square.yaml", "--set", "turn=2.3", "-o", "out.su2", expect=4).out
        self.assertRegex(text, rf"{N * N} cells, {cells['inverted']} inverted by the full step; none before 0\.\d+ of it")
        self.assertIn("worst cells: ", text)

    def test_designs_are_split_each_for_itself(self):
        self.square()
        for mode in ("uniform", "adaptive"):
            split = self.apply("square.yaml", "--set", "turn=2.3", "--split", mode)["split"]
            self.assertTrue(split["inversion_free"])
            self.assertGreater(split["steps"], 1)
            quality = self.deform("quality", "out.su2", "--before", "square.su2", "--fail-on", "flipped_faces>0", "--json").json
            self.assertEqual(quality["flipped_faces"], 0)
        self.write("designs.csv", "name,turn,shift\nsmall,0.2,0\nlarge,2.3,0\nhopeless,0,0.9\n")
        reply = self.deform("sweep", "square.yaml", "--designs", "designs.csv", "-o", "results", "--split", "uniform",
                            "--most-steps", "4", "--json", expect=4).json
        self.assertEqual((reply["written"], list(reply["failed"])), (2, ["hopeless"]), "bad ones are not written")
        self.assertEqual(reply["inverted"], {}, "a split ends where nothing is inverted")
        self.assertEqual(list(reply["partial"]), ["hopeless"])
        reached = reply["partial"]["hopeless"]
        self.assertTrue(0 < reached < 1)
        self.assertIn("the split did not arrive", reply["bad"]["hopeless"][0])
        split_command = ["sweep", "square.yaml", "--designs", "designs.csv", "-o", "results", "--split", "uniform", "--most-steps", "4"]
        with open(self.path("results/sweep.manifest")) as manifest:
            entries = {entry["name"]: entry for entry in map(json.loads, manifest) if "hash" in entry}
        self.assertEqual((entries["hopeless"]["state"], entries["hopeless"]["reached"]), ("final", reached))
        self.assertNotIn("state", entries["large"])
        again = self.deform(*split_command, "--json", expect=4).json
        self.assertEqual((again["written"], again["skipped"], again["partial"]), (0, 3, reply["partial"]), "final: not computed again")
        self.assertEqual(again["failed"], reply["failed"])
        kept = self.deform(*split_command, "--json", "--keep-bad", expect=4).json
        self.assertEqual((kept["written"], kept["skipped"], kept["failed"], kept["partial"]), (1, 2, {}, reply["partial"]))
        self.assertIn("1 made only a part of their motion", self.deform(*split_command, expect=4).out)
        command = ["sweep", "square.yaml", "--designs", "designs.csv", "-o", "results"]
        reply = self.deform(*command, "--json", expect=4).json
        self.assertEqual(reply["written"], 1, "without splitting these are other results")
        self.assertEqual(sorted(reply["inverted"]), ["hopeless", "large"])
        again = self.deform(*command, "--json", expect=4).json
        self.assertEqual((again["written"], again["inverted"], again["bad"]), (0, reply["inverted"], reply["bad"]), "told again")
        done = self.fails(4, *command, says=["2 of 3 designs were not written, for example: designs.csv:4: "], prints=True)
        self.assertRegex(done.out, rf"large bad: \d+ of {N * N} cells are inverted; none before 0\.\d+ of the motion")

    def test_quality_of_a_volume(self):
        self.write("cube.mesh", hexahedra(6))
        self.write("cube.yaml", CUBE_SETUP)
        self.assertEqual(self.deform("register", "cube.mesh", "--json").json["cells"], 216)
        self.assertEqual(self.deform("inspect", "cube.mesh", "--json").json["elements"], {"hexahedron": 216})
        self.assertRegex(self.deform("inspect", "cube.mesh").out, r"cells +216 \(216 hexahedron\)")
        report = self.deform("apply", "cube.yaml", "--set", "up=0.5", "--check", "quality", "-o", "out.mesh", "--json").json["report"]
        measured = {measure["name"]: measure["value"] for measure in report["quality"]["measures"]}
        quality = self.deform("quality", "out.mesh", "--json", "--fail-on", "inverted_cells>0").json  # as apply and sweep call it
        self.fails(4, "quality", "out.mesh", "--fail-on", "inverted_cells<1", says=["inverted_cells<1"], prints=True)
        for name in ("scaled_jacobian", "average_scaled_jacobian", "volume", "total_volume"):
            self.assertEqual(measured[name], quality[name], name)
        cells = self.deform("apply", "cube.yaml", "--set", "up=-1.25", "-o", "out.mesh", "--json", expect=4).json["report"]["cells"]
        self.assertGreater(cells["inverted"], 0)
        self.assertAlmostEqual(cells["safe_amplitude"], 0.8, delta=0.15)

    def test_a_split_goes_as_far_as_is_safe(self):
        self.square()
        quality = ["quality", "out.su2", "--before", "square.su2", "--json"]
        for margin in (0, 0.2):
            report = self.apply("square.yaml", "--set", "shift=0.9", "--split", "adaptive", "--most-steps", "4", "--margin", str(margin),
                                "--keep-bad", expect=4)
            self.assertGreaterEqual(report["split"]["reached"], (1 - 1e-9) * report["cells"]["safe_amplitude"] * (margin == 0))
            self.assertGreaterEqual(report["split"]["least_determinant"], margin)
            measured = self.deform(*quality, "--fail-on", "inverted_cells>0").json
            self.assertAlmostEqual(measured["scaled_jacobian"], report["split"]["least_determinant"], delta=1e-4)
        text = self.deform("apply", "square.yaml", "--set", "shift=0.9", "--split", "adaptive", "-o", "out.su2", expect=4).out
        self.assertIn("the motion does NOT ARRIVE", text)
        self.fails(1, "apply", "square.yaml", "--set", "turn=2.3", "--split", "uniform", "--margin", "1", "-o", "out.su2",
                   says=["splitting.margin"])

    def test_turns_arrive(self):
        self.square()
        self.write("square.yaml", SQUARE_SETUP.replace("[0.4, 0.4, ", "[0.45, 0.45, ").replace("[0.6, 0.6, ", "[0.55, 0.55, "))
        split = self.apply("square.yaml", "--set", "turn=3.1415926", "--split", "adaptive")["split"]
        self.assertEqual((split["inversion_free"], split["reached"]), (True, 1))

    def test_clockwise_meshes_are_protected(self):
        lines = square().split("\n")
        turned = [" ".join(["9"] + line.split()[:0:-1]) if line.startswith("9 ") else line for line in lines]
        self.write("square.yaml", SQUARE_SETUP)
        found = []
        for text in (lines, turned):
            self.write("square.su2", "\n".join(text))
            found.append(self.apply("square.yaml", "--set", "turn=2.3", "--keep-bad", expect=4)["cells"])
        self.assertEqual((found[0]["left_handed"], found[1]["left_handed"]), (0, N * N))
        for key in ("inverted", "inverted_ids", "inverted_at_rest"):
            self.assertEqual(found[0][key], found[1][key], key)
        self.assertAlmostEqual(found[0]["safe_amplitude"], found[1]["safe_amplitude"], delta=1e-12)
        quality = self.deform("quality", "out.su2", "--before", "square.su2", "--json").json
        self.assertEqual(quality["inverted_elements"], found[1]["inverted"])
        self.assertEqual(quality["left_handed_elements"], N * N)
        self.assertIn("left-handed", quality["notes"][0])

    def test_a_plate_may_leave_its_plane_as_a_whole(self):
        faces = [f"f {point_id(i, j) + 1} {point_id(i + 1, j) + 1} {point_id(i + 1, j + 1) + 1} {point_id(i, j + 1) + 1}"
                 for j in range(N) for i in range(N)]
        points = [f"v {i / N!r} {j / N!r} 0" for j in range(N + 1) for i in range(N + 1)]
        self.write("plate.obj", "\n".join(points + faces) + "\n")
        self.write("plate.yaml", "geometry: plate.obj\nhandles: [{name: all, region: {box: {min: [0, 0, -1], max: [1, 0.5, 1]}}}]\n"
                   "variables: [{name: up, handle: all, translate: [0, 0, 1]}]\nmethod: {rbf: {kernel: BIHARMONIC}}\n")
        report = self.deform("apply", "plate.yaml", "--set", "up=0.3", "-o", "out.obj", "--json").json["report"]
        self.assertEqual((report["cells"]["inverted"], report["cells"]["safe_amplitude"]), (0, 1))

    def test_boundary_nodes_by_place(self):
        """As another program gives them: positions at rest and displacements, in any order, rounded."""
        self.write("cube.mesh", hexahedra(6))
        self.write("cube.yaml", CUBE_SETUP)
        top = [(i / 6, j / 6) for j in range(7) for i in range(7)]
        bump = lambda x, y: 0.2 * math.sin(math.pi * x) * math.sin(math.pi * y)
        lines = [f"top,{x + 1e-8!r},{y!r},1,0,0,{bump(x, y)!r}" for x, y in reversed(top)]
        self.write("places.csv", "\n".join(["handle,x,y,z,dx,dy,dz"] + lines) + "\n")
        ids = [(i + 7 * j + 49 * 6, i / 6, j / 6) for j in range(7) for i in range(7)]
        self.write("ids.csv", "\n".join(["handle,point,dx,dy,dz"] + [f"top,{p},0,0,{bump(x, y)!r}" for p, x, y in ids]) + "\n")
        self.write("positions.csv", "\n".join(["handle,point,x,y,z"] + [f"top,{p},{x!r},{y!r},{1 + bump(x, y)!r}" for p, x, y in ids]) + "\n")
        for name in ("places", "ids", "positions"):
            self.deform("apply", "cube.yaml", "--motions", f"{name}.csv", "-o", f"{name}.mesh")
        with open(self.path("places.mesh")) as places, open(self.path("ids.mesh")) as by_id:
            self.assertEqual(places.read(), by_id.read())
        with open(self.path("positions.mesh")) as file:
            points = [list(map(float, line.split()[:3])) for line in file.read().split("\n")[3:3 + 343]]
        for p, x, y in ids:
            self.assertAlmostEqual(points[p][2], 1 + bump(x, y), delta=1e-14)
        self.fails(1, "apply", "cube.yaml", "--motions", "places.csv", "--match-tolerance", "1e-9", "-o", "out.mesh",
                   says=["places.csv:2", "--match-tolerance"])

    def test_surfaces_have_no_cells(self):
        self.deform("sample", "-o", "ahmed.obj")
        self.write("ahmed.yaml", "geometry: ahmed.obj\nhandles: [{name: roof, region: {group: roof}}]\nfixed: [{group: stilts}]\n"
                                 "variables: [{name: up, handle: roof, translate: [0, 0, 1]}]\n")
        reply = self.deform("apply", "ahmed.yaml", "--set", "up=0.01", "-o", "out.obj", "--json").json["report"]
        self.assertNotIn("cells", reply)
        self.fails(1, "apply", "ahmed.yaml", "--set", "up=0.01", "--split", "uniform", "-o", "out.obj", says=["splitting", "no cells"])

    def test_faces_that_run_into_each_other(self):
        self.write("sheets.obj", two_sheets())
        self.write("sheets.yaml", "geometry: sheets.obj\nhandles: [{name: sloping, region: {group: sloping}}]\n"
                                  "fixed: [{group: level}]\nvariables: [{name: up, handle: sloping, translate: [0, 0, 1]}]\n")
        apply = ("apply", "sheets.yaml", "-o", "out.obj", "--json", "--set")
        report = self.deform(*apply, "up=-0.05").json["report"]
        self.assertEqual((report["verdict"], report["newly_intersecting_faces"], report["newly_intersecting"]), ("good", 0, []))
        # At z = 0.4 x - 0.15 they cross in the third and fourth columns, x = 0.375, in their common edges.
        reply = self.deform(*apply, "up=-0.25")
        report = reply.json["report"]
        crossing = [side * 64 + 8 * row + column for side in (0, 1) for row in range(8) for column in (2, 3)]
        self.assertEqual((report["verdict"], report["newly_intersecting_faces"]), ("doubtful", 32))
        self.assertEqual(report["newly_intersecting"], crossing)
        self.assertEqual(report["flipped_faces"], 0)
        self.assertIn("32 of 128 faces ran into others", report["reasons"])
        self.assertIn("32 of 128 faces ran into others, the first is face 2", reply.err)
        self.assertIn("32 of 128 faces ran into others: 2, 3, 10", self.deform(*apply[:-2], "--set", "up=-0.25").out)
        self.assertIn("none of 128 faces flipped or ran into another", self.deform(*apply[:-2], "--set", "up=0.05").out)
        gate = ("--fail-on", "newly_intersecting_faces>0")
        self.fails(4, *apply, "up=-0.25", *gate, says=["newly_intersecting_faces>0: it is 32"], prints=True)
        self.deform(*apply, "up=-0.05", *gate)
        self.assertNotIn("newly_intersecting_faces", self.deform(*apply, "up=-0.25", "--check", "amplitude").json["report"])
        self.fails(4, *apply, "up=-0.25", "--check", "amplitude", *gate, says=["it is 32"], prints=True)
        self.fails(4, *apply, "up=-0.25", "--check", "off", *gate, says=["it was not measured"], prints=True)
        # Compiled, in sweeps and between files the same.
        self.deform("compile", "sheets.yaml", "-o", "sheets.deformation")
        compiled = self.deform("apply", "sheets.deformation", "-o", "other.obj", "--json", "--set", "up=-0.25").json["report"]
        self.assertEqual(compiled["newly_intersecting"], crossing)
        self.assertEqual(compiled["verdict"], "doubtful")
        self.write("designs.csv", "up\n-0.05\n-0.25\n")
        self.fails(4, "sweep", "sheets.yaml", "--designs", "designs.csv", "-o", "swept", *gate, says=["it is 32"], prints=True)
        quality = self.deform("quality", "out.obj", "--before", "sheets.obj", "--json").json
        self.assertEqual((quality["intersecting_faces"], quality["newly_intersecting_faces"]), (32, 32))
        self.assertEqual((quality["intersecting"], quality["newly_intersecting"]), (crossing, crossing))
        self.assertEqual(quality["before"]["intersecting_faces"], 0)
        # Without the mesh before, points at one place are one: here the sheets share their common line.
        self.assertEqual(self.deform("quality", "out.obj", "--json").json["intersecting_faces"], 0)
        self.fails(4, "quality", "out.obj", "--before", "sheets.obj", "--fail-on", "intersecting_faces>0", "--html", "out.html", says=["it is 32"], prints=True)
        self.assertIn("Faces that intersect others", read_bytes(self.path("out.html")).decode())
        self.fails(2, "quality", "out.obj", *gate, says=["newly_intersecting_faces is measured with --before"])

    def test_a_wrecked_body_is_not_delivered_without_a_word(self):
        """The example of version 0.1: the side walls of the body fold over its roof."""
        self.deform("sample", "-o", "ahmed.obj")
        self.write("wreck.yaml", WRECK_SETUP)
        report = self.deform("apply", "wreck.yaml", "--set", "roof_up=0.03", "--set", "slant_turn=0.1", "-o", "out.obj",
                             "--json").json["report"]
        self.assertAlmostEqual(report["max_displacement"], 0.2976, delta=2e-3)
        quality = self.deform("quality", "out.obj", "--before", "ahmed.obj", "--json").json
        self.assertEqual(quality["displacement"], report["max_displacement"])
        # They fold in their own plane, so the sign of their normals' y tells which faces flipped.
        self.assertAlmostEqual(quality["flipped_faces"], 1660, delta=10)
        self.assertEqual(len(quality["flipped"]), 100)
        gated = self.deform("quality", "out.obj", "--before", "ahmed.obj", "--fail-on", "flipped_faces>0", expect=None)
        self.assertNotEqual(gated.code, 0)
        self.assertIn("flipped_faces", gated.err)


if __name__ == "__main__":
    main()

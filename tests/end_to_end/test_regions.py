# SPDX-License-Identifier: GPL-3.0-or-later
"""`deform regions`: what moves, stays and follows, in colours; the region `boundary` from YAML through the wire."""

import math
import re
import struct

from harness import AHMED_SETUP, EndToEnd, main, read_bytes


def read_vtp(path):
    """Arrays of a file of ours by name: appended raw data, header of UInt64; and the texts of its field data."""
    content = read_bytes(path)
    head, data = content.split(b'<AppendedData encoding="raw">\n_', 1)
    head = head.decode()
    arrays, texts = {}, {}
    forms = {"Float64": ("d", 8), "Int32": ("i", 4), "UInt8": ("B", 1), "Int64": ("q", 8)}
    for kind, name, components, offset in re.findall(
            r'<DataArray type="(\w+)" Name="([^"]*)" NumberOfComponents="(\d+)" format="appended" offset="(\d+)"', head):
        letter, size = forms[kind]
        begin = int(offset)
        length = struct.unpack_from("<Q", data, begin)[0]
        values = struct.unpack_from(f"<{length // size}{letter}", data, begin + 8)
        width = int(components)
        arrays[name] = values if width == 1 else [values[i:i + width] for i in range(0, len(values), width)]
    for name, codes in re.findall(r'<DataArray type="String" Name="(\w+)" NumberOfTuples="\d+" format="ascii">(.*?)</DataArray>', head,
                                  re.DOTALL):
        texts[name] = bytes(int(code) for code in codes.split()).decode().split("\0")[:-1]
    return arrays, texts


def read_ply_colours(path):
    content = read_bytes(path)
    head, data = content.split(b"end_header\n", 1)
    count = int(re.search(rb"element vertex (\d+)", head)[1])
    return [struct.unpack_from("<3d3B", data, 27 * i)[3:] for i in range(count)]


CONTROLS_SETUP = """\
geometry: ahmed.obj
method: {ffd: {control: CONTROLS, lattice: {basis: CLAMPED_CUBIC, points: [5, 4, 4], box: {min: [-0.1, -0.3, -0.1], max: [1.1, 0.3, 0.4]}}}}
handles:
  - {name: tail, region: {lattice: {i: [3, 3]}}}
  - {name: one, region: {control: {ids: [42]}}}
fixed: [{lattice: {i: [0, 0]}}]
variables:
  - {name: up, handle: tail, translate: [0, 0, 1], upper: 0.2}
  - {name: turn, handle: one, rotate: {axis: [1, 0, 0]}}
"""


GENERATED_CAGE_SETUP = """\
geometry: ahmed.obj
method: {cage: {file: wrap.obj, control: MESH}}
handles: [{name: roof, region: {intersection: [{group: roof}, {box: {min: [0.4, -1, 0], max: [0.6, 1, 1]}}]}}]
fixed: [{group: nose}, {group: underbody}]
variables: [{name: up, handle: roof, translate: [0, 0, 1]}]
"""


CAGE_SETUP = """\
geometry: ahmed.obj
method: {cage: {file: cage.obj}}
handles:
  - {name: tail, region: {control: {ids: [1, 3, 5, 7]}}}
  - {name: nose, region: {control: {ids: [0, 2, 4, 6]}}}
variables:
  - {name: tail_up, handle: tail, translate: [0, 0, 1], upper: 0.2}
  - {name: nose_up, handle: nose, translate: [0, 0, 1]}
"""


def clamped_splines(points, u):
    """Values at u of the cubic B-splines with knots four-fold at the ends, by their recurrence."""
    t = [0.0] * 3 + [k / (points - 3) for k in range(points - 2)] + [1.0] * 3
    values = [1.0 if t[i] <= u < t[i + 1] else 0.0 for i in range(points + 3)]
    for degree in (1, 2, 3):
        values = [((u - t[i]) / (t[i + degree] - t[i]) * values[i] if t[i + degree] > t[i] else 0.0) +
                  ((t[i + degree + 1] - u) / (t[i + degree + 1] - t[i + 1]) * values[i + 1] if t[i + degree + 1] > t[i + 1] else 0.0)
                  for i in range(len(values) - 1)]
    return values[:points]


class Regions(EndToEnd):
    def ahmed(self, setup=AHMED_SETUP):
        self.deform("sample", "-o", "ahmed.obj")
        return self.write("ahmed.yaml", setup)

    def test_regions_and_centres_of_a_surface(self):
        self.ahmed(AHMED_SETUP.replace("kernel: TRIHARMONIC", "reduction: REDUCTION_RINGS"))
        self.start_server()
        reply = self.deform("regions", "ahmed.yaml", "-o", "regions.vtp", "--json").json
        arrays, texts = read_vtp(self.path("regions.vtp"))
        self.assertEqual(texts["region_names"], ["free", "fixed", "slant", "roof"])
        self.assertEqual(len(arrays["region"]), reply["points"])
        for entry in reply["regions"]:
            self.assertEqual(entry["points"], arrays["region"].count(entry["value"]), entry)
            self.assertGreater(entry["points"], 0)
        self.assertEqual([entry["name"] for entry in reply["regions"]], ["", "", "slant", "roof"])
        self.assertEqual(len({entry["colour"] for entry in reply["regions"]}), 4)
        # The centres are those of the prepared system, and points of handles or fixed ones.
        system = self.deform("prepare", "ahmed.yaml", "--json").json
        self.assertEqual(sum(arrays["centre"]), system["centres"])
        self.assertEqual(reply["centres"], system["centres"])
        self.assertTrue(all(region > 0 for region, centre in zip(arrays["region"], arrays["centre"]) if centre))
        counted = {handle["name"]: handle["points"] for handle in self.deform("prepare", "ahmed.yaml", "--check", "--json").json["handles"]}
        self.assertEqual(counted, {entry["name"]: entry["points"] for entry in reply["regions"] if entry["kind"] == "handle"})
        # Nothing but looking happened before.
        colours = dict(zip(arrays["region"], arrays["colour"]))
        self.assertEqual(colours[0], (208, 208, 208))

    def test_nothing_is_prepared(self):
        self.ahmed()
        self.start_server()
        out = self.deform("regions", "ahmed.yaml", "-o", "regions.ply").out
        self.assertEqual(self.deform("list", "--json").json["systems"], [])
        for part in ("handle slant", "handle roof", "fixed", "free", "#e69f00", "wrote regions.ply"):
            self.assertIn(part, out)
        colours = read_ply_colours(self.path("regions.ply"))
        self.assertIn((230, 159, 0), colours)
        self.assertIn((208, 208, 208), colours)

    def test_without_a_server(self):
        self.ahmed()
        reply = self.deform("--server", "127.0.0.1:1", "regions", "ahmed.yaml", "-o", "regions.vtp", "--json").json
        self.assertIsNone(reply["centres"])
        self.assertIn("centres are not shown", reply["notes"][0])
        self.assertNotIn("centre", read_vtp(self.path("regions.vtp"))[0])
        self.start_server()
        quiet = self.deform("regions", "ahmed.yaml", "-o", "quiet.vtp", "--no-centres", "--json").json
        self.assertEqual(quiet["notes"], [])
        self.assertEqual(read_bytes(self.path("quiet.vtp")), read_bytes(self.path("regions.vtp")))
        self.assertEqual(self.deform("list", "--json").json["geometries"], [], "the server was not asked")

    def test_what_prepare_refuses_is_drawn_and_refused_in_its_words(self):
        self.start_server()
        overlapping = self.ahmed(AHMED_SETUP.replace("{group: slant}", "{union: [{group: slant}, {group: roof}]}"))
        drawn = self.fails(1, "regions", overlapping, "-o", "overlap.vtp", "--no-centres", prints=True)
        refused = self.fails(1, "prepare", overlapping)
        self.assertIn('handle "roof" overlaps handle "slant"', drawn.err)
        self.assertIn(drawn.err.strip().removeprefix("deform: ").split(" (and ")[0], refused.err)
        self.assertIn("  problem: fixed[0] overlaps", drawn.out)
        arrays, _ = read_vtp(self.path("overlap.vtp"))
        self.assertEqual(sum(arrays["contested"]), sum(map(int, re.findall(r"(\d+) common points", drawn.err + drawn.out))))
        empty = self.write("empty.yaml", AHMED_SETUP.replace("min: [0.4", "min: [77").replace("max: [0.6", "max: [78"))
        words = "its region contains no point; the model's box is ["
        drawn = self.fails(1, "regions", empty, "-o", "empty.vtp", prints=True, says=['handle "roof": ' + words])
        self.assertIn(drawn.err.strip().removeprefix("deform: "), self.fails(1, "prepare", empty).err)
        box = re.search(r"box is \[(\S+), \S+, \S+\] to \[(\S+), \S+, (\S+)\]", drawn.err)
        inspected = self.deform("inspect", "ahmed.obj", "--json").json
        self.assertEqual([float(text) for text in box.groups()], [inspected["box_min"][0], inspected["box_max"][0], inspected["box_max"][2]])

    def test_wrong_arguments(self):
        self.ahmed()
        self.fails(1, "regions", "ahmed.yaml", "-o", "regions.obj", "--no-centres", says=[".vtp, .ply or"])
        self.fails(1, "regions", "ahmed.yaml", "-o", "regions.vtu", "--no-centres", says=["no cells"])
        by_id = self.write("id.yaml", AHMED_SETUP.replace("ahmed.obj", "0123456789abcdef"))
        self.fails(1, "regions", by_id, "-o", "a.vtp", says=["--source"])
        self.deform("regions", by_id, "-o", "a.vtp", "--source", "ahmed.obj", "--no-centres")
        two = self.write("two.yaml", AHMED_SETUP.replace("{group: slant}}", "{group: slant, all: true}}"))
        self.fails(1, "regions", two, "-o", "a.vtp", "--no-centres", prints=True, says=['handle "slant"', "exactly one kind"])

    # ---- lattices ----

    def test_lattice_that_control_points_move(self):
        self.deform("sample", "--points", "2000", "-o", "ahmed.obj")
        self.write("ffd.yaml", CONTROLS_SETUP)
        at_rest = self.deform("--server", "127.0.0.1:1", "lattice", "ffd.yaml", "-o", "rest.vtp", "--json").json
        self.assertEqual((at_rest["points"], at_rest["in_handles"], at_rest["max_displacement"]), ([5, 4, 4], 17, 0))
        self.deform("lattice", "ffd.yaml", "--set", "up=0.1", "--set", "turn=0.3", "-o", "moved.vtp")
        arrays, texts = read_vtp(self.path("moved.vtp"))
        self.assertIn(b'NumberOfLines="184"', read_bytes(self.path("moved.vtp")), "edges along three axes: 64, 60 and 60")
        self.assertEqual(texts["region_names"], ["other", "fixed", "tail", "one"])
        self.assertEqual(arrays["region"].count(1), 16)
        self.assertEqual(arrays["index"][5 * (3 + 4 * 2) + 4], (4, 3, 2))
        self.assertEqual(len({value for value, u in zip(arrays["region"], arrays["displacement"]) if any(u)}), 2)
        self.start_server()
        self.assertIn("control points: 80, of these 17 in handles, 16 fixed", self.deform("prepare", "ffd.yaml").out)
        self.assertIn("handle tail: 16 control points", self.deform("prepare", "ffd.yaml", "--check").out)
        said = self.deform("apply", "ffd.yaml", "--set", "up=0.1", "--set", "turn=0.3", "-o", "out.obj").out
        self.assertIn("control points moved by up to", said)
        self.assertNotIn("centres", said)
        # The server deforms as the lattice that was written: sums of clamped splines over it, one span along two axes.
        before, after = ([tuple(map(float, line.split()[1:4])) for line in read_bytes(self.path(name)).decode().splitlines() if line.startswith("v ")]
                         for name in ("ahmed.obj", "out.obj"))
        largest = 0
        for x, y in zip(before, after):
            u = [x[0] / 1.2 + 0.1 / 1.2, x[1] / 0.6 + 0.5, x[2] / 0.5 + 0.2]
            values = [clamped_splines(5, u[0]), clamped_splines(4, u[1]), clamped_splines(4, u[2])]
            d = [sum(values[0][i] * values[1][j] * values[2][k] * arrays["displacement"][i + 5 * (j + 4 * k)][c]
                     for i in range(5) for j in range(4) for k in range(4)) for c in range(3)]
            largest = max(largest, max(map(abs, d)))
            for c in range(3):
                self.assertAlmostEqual(y[c], x[c] + d[c], delta=2e-6)
        self.assertGreater(largest, 0.01)
        self.fails(1, "quality", "out.obj", "--before", "ahmed.obj", "--setup", "ffd.yaml", says=["--setup", "CONTROLS"])
        # A lattice that ends in the middle of the body.
        self.write("cut.yaml", CONTROLS_SETUP.replace("max: [1.1,", "max: [0.5,").replace("i: [3, 3]", "i: [4, 4]"))
        torn = self.deform("apply", "cut.yaml", "--set", "up=0.1", "-o", "cut.obj", "--json").json["report"]
        self.assertEqual(torn["verdict"], "doubtful")
        self.assertRegex(torn["reasons"][0], "[1-9][0-9]* edges are torn at the boundary of the lattice")

    def test_a_lattice_beside_the_model_moves_nothing(self):
        self.ahmed(CONTROLS_SETUP.replace("min: [-0.1, -0.3, -0.1], max: [1.1, 0.3, 0.4]", "min: [5, -0.3, -0.1], max: [6, 0.3, 0.4]"))
        self.start_server()
        self.assertIn("No point of the mesh lies in the lattice: is it", self.deform("prepare", "ahmed.yaml", "--check").out)
        report = self.fails(4, "apply", "ahmed.yaml", "--set", "up=0.1", "-o", "out.obj", "--json", says=["nothing moves"], prints=True).json["report"]
        self.assertEqual(report["verdict"], "bad")
        self.assertIn("the largest prescribed one 0.1", report["reasons"][0])

    def test_lattice_from_a_file(self):
        self.deform("sample", "--points", "2000", "-o", "ahmed.obj")
        self.write("ffd.yaml", CONTROLS_SETUP)
        self.deform("lattice", "ffd.yaml", "--set", "up=0.1", "-o", "moved.vtp")
        self.write("moved.yaml", CONTROLS_SETUP.replace("points: [5, 4, 4]", "points: [5, 4, 4], control_points: {file: moved.vtp}"))
        self.start_server()
        system = self.deform("prepare", "moved.yaml", "--json").json
        # The setup that the server shows holds the control points.
        self.write("shown.yaml", self.deform("show", system["id"], "--setup").out)
        self.assertEqual(self.deform("prepare", "shown.yaml", "--source", "ahmed.obj", "--json").json["id"], system["id"])
        self.deform("lattice", "shown.yaml", "--source", "ahmed.obj", "-o", "again.vtp")
        rest, again = read_vtp(self.path("moved.vtp"))[0]["Points"], read_vtp(self.path("again.vtp"))[0]["Points"]
        self.assertEqual(rest, again)
        self.fails(1, "lattice", self.write("energy.yaml", CONTROLS_SETUP.replace("control: CONTROLS, ", "")), "--set", "up=0.1",
                   "-o", "a.vtp", says=["--set", "CONTROLS"])
        self.fails(1, "regions", "ffd.yaml", "-o", "a.vtp", says=["CONTROLS", "deform lattice"])
        self.fails(1, "lattice", "ffd.yaml", "--set", "up=0.3", "-o", "a.vtp", says=["up", "0.3", "0.2"])

    def test_refined_lattice(self):
        self.deform("sample", "--points", "2000", "-o", "ahmed.obj")
        self.write("ffd.yaml", CONTROLS_SETUP)
        offline = ("--server", "127.0.0.1:1", "lattice", "refine")
        reply = self.deform(*offline, "ffd.yaml", "--halve", "i,k", "-o", "fine.yaml", "--json").json
        self.assertEqual((reply["points_before"], reply["points"]), ([5, 4, 4], [7, 4, 5]))
        self.start_server()
        system = self.deform("prepare", "fine.yaml", "--json").json
        self.assertEqual(system["centres"], 7 * 4 * 5)
        # From a design on: the mesh is that of the server, and it stays where it is in the finer lattice.
        design = ("--set", "up=0.1", "--set", "turn=0.3")
        said = self.deform(*offline, "ffd.yaml", "--halve", "j", *design, "--mesh", "start.obj", "-o", "onwards.yaml").out
        self.assertIn("variables count from this design", said)
        self.deform("apply", "ffd.yaml", *design, "--encoding", "raw_f64", "-o", "out.obj")
        points = lambda name: [tuple(map(float, line.split()[1:4])) for line in read_bytes(self.path(name)).decode().splitlines()
                               if line.startswith("v ")]
        for got, expected in zip(points("start.obj"), points("out.obj")):
            for a, b in zip(got, expected):
                self.assertAlmostEqual(a, b, delta=1e-12)
        self.deform("lattice", "onwards.yaml", "-o", "onwards.vtp")
        self.assertEqual(read_vtp(self.path("onwards.vtp"))[0]["Points"], read_vtp(self.path("onwards.control_points.vtp"))[0]["Points"])
        self.deform("apply", "onwards.yaml", "--set", "up=0", "--encoding", "raw_f64", "-o", "still.obj")
        for got, expected in zip(points("still.obj"), points("start.obj")):
            for a, b in zip(got, expected):
                self.assertAlmostEqual(a, b, delta=1e-12)
        self.fails(1, "lattice", "refine", "ffd.yaml", "--elevate", "i", "-o", "a.yaml", says=["--elevate", "--halve"])
        self.fails(1, "lattice", "refine", "ffd.yaml", "-o", "a.yaml", says=["--halve"])
        self.fails(1, "lattice", "refine", "ffd.yaml", "--halve", "i", "-o", "ffd.yaml", says=["--output", "replace"])
        self.fails(1, "lattice", "refine", "ffd.yaml", "--halve", "i", "-o", "elsewhere/a.yaml", says=["--output", "same folder"])
        self.fails(1, "lattice", "refine", "ffd.yaml", "--halve", "i", "--set", "up=0.1", "-o", "a.yaml", says=["--mesh"])
        for wrong in ("x", "i,i", "ik", "i,"):
            self.fails(2, "lattice", "refine", "ffd.yaml", "--halve", wrong, "-o", "a.yaml", says=["--halve"])
        self.fails(2, "lattice", "ffd.yaml", says=["--output"])
        self.fails(2, "lattice", says=["SETUP"])

    # ---- cages ----

    def test_generated_cage(self):
        self.deform("sample", "--points", "3000", "-o", "ahmed.obj")
        for kind in ("box", "hull", "wrap"):
            reply = self.deform("--server", "127.0.0.1:1", "cage", "mesh", "ahmed.obj", "--kind", kind, "--points", "150", "-o", kind + ".obj",
                                "--json").json
            self.assertLess(abs(reply["points"] - 150), 8)
            if kind == "box" and reply["points"] != 150:
                said = self.deform("cage", "mesh", "ahmed.obj", "--kind", kind, "--points", "150", "-o", "box.obj").err
                self.assertIn("--points 150: a box in rectangles has %d vertices" % reply["points"], said)
            self.assertGreater(reply["least_angle"], 15)
            self.assertEqual((reply["genus"], reply["components"], reply["outside"]), (0, 1, 0))
        self.start_server()
        self.write("mesh.yaml", GENERATED_CAGE_SETUP)
        prepared = self.deform("prepare", "mesh.yaml")
        self.assertNotIn("outside", prepared.out)
        self.assertNotIn("solver", prepared.out)
        report = self.deform("apply", "mesh.yaml", "--set", "up=0.03", "-o", "out.obj", "--json").json["report"]
        self.assertEqual(report["verdict"], "good")
        self.assertEqual(report["flipped_faces"], 0)
        # The cage as a picture, with what moves it.
        last = self.deform("cage", "mesh", "ahmed.obj", "--points", "60", "-o", "cage.obj", "--json").json["points"] - 1
        self.write("controls.yaml", CAGE_SETUP.replace("[1, 3, 5, 7]", "[%d]" % last))
        shown = self.deform("lattice", "controls.yaml", "--set", "tail_up=0.1", "-o", "cage.vtp", "--json").json
        self.assertEqual((shown["vertices"], shown["in_handles"]), (last + 1, 5))
        self.assertAlmostEqual(shown["max_displacement"], 0.1)
        arrays, texts = read_vtp(self.path("cage.vtp"))
        self.assertEqual(texts["region_names"], ["other", "fixed", "tail", "nose"])
        self.assertEqual([i for i, u in enumerate(arrays["displacement"]) if any(u)], [last])
        self.assertEqual((arrays["id"][last], arrays["region"][last]), (last, 2))
        self.assertIn(b'NumberOfPolys="%d"' % shown["triangles"], read_bytes(self.path("cage.vtp")))
        self.fails(1, "lattice", "mesh.yaml", "--set", "up=0.01", "-o", "a.vtp", says=["--set", "CONTROLS"])
        self.fails(1, "cage", "mesh", "ahmed.obj", "-o", "cage.stl", says=["--output", ".obj"])
        self.fails(2, "cage", "mesh", "ahmed.obj", "--kind", "sphere", "-o", "cage.obj", says=["--kind"])
        self.fails(2, "cage", "mesh", "ahmed.obj", "--points", "5", "-o", "cage.obj", says=["--points"])
        self.fails(1, "prepare", self.write("nofile.yaml", CAGE_SETUP.replace("{file: cage.obj}", "{}")), says=["method.cage.file: missing"])

    def test_cage(self):
        self.deform("sample", "--points", "2000", "-o", "ahmed.obj")
        corners = [(x, y, z) for z in (-0.1, 0.5) for y in (-0.4, 0.4) for x in (-0.2, 1.3)]
        quads = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
        triangles = [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]
        self.write("cage.obj", "".join("v %r %r %r\n" % c for c in corners) + "".join("f %d %d %d\n" % tuple(i + 1 for i in t) for t in triangles))
        self.write("cage.yaml", CAGE_SETUP)
        self.start_server()
        system = self.deform("prepare", "cage.yaml", "--json").json
        self.assertIn("control points: 8, of these 8 in handles, 0 fixed", self.deform("prepare", "cage.yaml").out)
        self.assertIn("handle tail: 4 control points", self.deform("prepare", "cage.yaml", "--check").out)
        # The setup that the server shows holds the cage.
        self.write("shown.yaml", self.deform("show", system["id"], "--setup").out)
        self.assertEqual(self.deform("prepare", "shown.yaml", "--source", "ahmed.obj", "--json").json["id"], system["id"])
        points = lambda name: [tuple(map(float, line.split()[1:4])) for line in read_bytes(self.path(name)).decode().splitlines()
                               if line.startswith("v ")]
        said = self.deform("apply", "cage.yaml", "--set", "tail_up=0.1", "--set", "nose_up=0.1", "-o", "out.obj").out
        self.assertIn("control points moved by up to", said)
        for before, after in zip(points("ahmed.obj"), points("out.obj")):  # all vertices go the same way, and so do all points
            for x, y, d in zip(before, after, (0, 0, 0.1)):
                self.assertAlmostEqual(y, x + d, delta=2e-6)
        # In other units, and beside the model: said before and with the result, and nothing moves is no good design.
        far = "".join("v %r %r %r\n" % (x + 1e6, y, z) for x, y, z in corners) + "".join("f %d %d %d\n" % tuple(i + 1 for i in t) for t in triangles)
        self.write("far.obj", far)
        self.write("far.yaml", CAGE_SETUP.replace("cage.obj", "far.obj"))
        big = "".join("v %r %r %r\n" % tuple(1000 * c for c in p) for p in corners) + "".join("f %d %d %d\n" % tuple(i + 1 for i in t) for t in triangles)
        self.write("big.obj", big)
        self.write("big.yaml", CAGE_SETUP.replace("cage.obj", "big.obj"))
        self.assertIn("in the same units?", self.deform("prepare", "big.yaml", "--check").out)
        self.assertIn("in the same units?", self.deform("apply", "big.yaml", "--set", "tail_up=0.1", "-o", "x.obj").out)
        self.assertIn("No point of the mesh lies in the cage", self.deform("prepare", "far.yaml", "--check").out)
        # A linear function of the vertices is the same function of the points: no vertex but those at the tail moves, by x.
        self.write("moves.csv", "handle,x,y,z,dx,dy,dz\n" + "".join(
            "%s,%r,%r,%r,0,0,%r\n" % ("tail" if c[0] > 1 else "nose", *c, 0.1 * c[0]) for c in corners))
        self.deform("apply", "cage.yaml", "--motions", "moves.csv", "-o", "bent.obj")
        for before, after in zip(points("ahmed.obj"), points("bent.obj")):
            self.assertAlmostEqual(after[2], before[2] + 0.1 * before[0], delta=2e-6)
        self.write("open.obj", "".join("v %r %r %r\n" % c for c in corners) + "f 1 2 3\n")
        self.fails(1, "prepare", self.write("open.yaml", CAGE_SETUP.replace("cage.obj", "open.obj")), says=["method.cage.vertices[3]"])
        self.fails(1, "prepare", self.write("none.yaml", CAGE_SETUP.replace("cage.obj", "none.obj")), says=["method.cage.file", "none.obj"])
        self.fails(1, "regions", "cage.yaml", "-o", "a.vtp", says=["CONTROLS", "deform lattice"])
        # Green coordinates: a turn of the whole cage is one of all points; points outside are named; there is nothing to compile.
        green = CAGE_SETUP.replace("cage.obj}", "cage.obj, coordinates: GREEN}")
        self.write("green.yaml", green.replace("translate: [0, 0, 1]", "rotate: {axis: [0, 0, 1]}"))
        self.deform("apply", "green.yaml", "--set", "tail_up=0.2", "--set", "nose_up=0.2", "-o", "turned.obj")
        c, s = math.cos(0.2), math.sin(0.2)
        for (x, y, z), after in zip(points("ahmed.obj"), points("turned.obj")):
            for expected, got in zip((c * x - s * y, s * x + c * y, z), after):
                self.assertAlmostEqual(got, expected, delta=2e-6)
        self.fails(1, "compile", "green.yaml", "-o", "green.deformation", says=["cannot be compiled", "Green coordinates", "MEAN_VALUE"])
        self.fails(1, "prepare", self.write("out.yaml", green.replace("cage.obj", "far.obj")), "--check", says=["GREEN", "outside", "the first is 0"])
        self.fails(1, "prepare", self.write("by_mesh.yaml", green.replace("GREEN}", "GREEN, control: MESH}")), says=["GREEN", "CONTROLS"])

    def test_half_cage(self):
        """Green coordinates of a half model in its half cage against the whole cage."""
        steps = [(i, j) for j in range(9) for i in range(13)]
        at = lambda i, j: 13 * j + i + 1
        self.write("half.obj", "".join("v %r %r %r\n" % (i / 12, j / 20, 0.1 * math.sin(i)) for i, j in steps) + "".join(
            "f %d %d %d %d\n" % (at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)) for i, j in steps if i < 12 and j < 8))
        corners = [(x, y, z) for z in (-0.4, 0.5) for y in (0.0, 0.6) for x in (-0.2, 1.2)]
        quads = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
        triangles = [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]
        image = {v: v if y == 0 else 8 + sum(c[1] != 0 for c in corners[:v]) for v, (x, y, z) in enumerate(corners)}
        outer = [t for t in triangles if any(corners[v][1] != 0 for v in t)]
        whole = outer + [(image[a], image[c], image[b]) for a, b, c in outer]
        write = lambda name, vertices, faces: self.write(
            name, "".join("v %r %r %r\n" % c for c in vertices) + "".join("f %d %d %d\n" % tuple(i + 1 for i in t) for t in faces))
        write("cage.obj", corners, triangles)
        write("whole_cage.obj", corners + [(x, -y, z) for x, y, z in corners if y != 0], whole)
        plane = "symmetry: [{point: [0, 0, 0], normal: [0, 1, 0]}]\n"
        head = "geometry: half.obj\nmethod: {cage: {file: cage.obj, coordinates: GREEN}}\nhandles:\n"
        handles = "  - {name: tail, region: {control: {ids: [3, 7]}}}\n  - {name: end, region: {control: {ids: [1]}}}\n"
        variables = "variables:\n  - {name: tail, handle: tail, translate: [0.1, 0.3, 1]}\n  - {name: end, handle: end, translate: [1, 0, 0.5]}\n"
        self.write("half.yaml", head + handles + variables + plane)
        self.write("whole.yaml", head.replace("cage.obj", "whole_cage.obj") + handles + "  - {name: image, region: {control: {ids: [%d, %d]}}}\n" %
                   (image[3], image[7]) + variables + "  - {name: image, handle: image, translate: [0.1, -0.3, 1]}\n")
        self.start_server()
        self.assertIn("With its mirror images, and without its triangles where it ends, it has 12 vertices and 20 triangles",
                      self.deform("prepare", "half.yaml", "--check").out)
        values = ["--set", "tail=0.3", "--set", "end=0.2"]
        self.deform("apply", "half.yaml", *values, "-o", "half_out.obj")
        self.deform("apply", "whole.yaml", *values, "--set", "image=0.3", "-o", "whole_out.obj")
        points = lambda name: [tuple(map(float, line.split()[1:4])) for line in read_bytes(self.path(name)).decode().splitlines()
                               if line.startswith("v ")]
        rest, half, of_whole = points("half.obj"), points("half_out.obj"), points("whole_out.obj")
        self.assertGreater(max(math.dist(x, y) for x, y in zip(rest, half)), 0.05)
        for x, a, b in zip(rest, half, of_whole):
            self.assertLess(math.dist(a, b), 2e-6)
            self.assertEqual(a[1] == 0, x[1] == 0)
        compared = self.deform("compare", "half.yaml", "--methods", "cage", *values, "--json").json["methods"]
        self.assertEqual([bool(row.get("refused")) for row in compared], [False])
        # The cages that are made for it: a box that ends in the plane, and wraps that are their own mirror images.
        for method, on_one_side in (("generate: {kind: BOX, points: 28}, coordinates: GREEN", True),
                                    ("generate: {points: 60}, coordinates: GREEN", False), ("generate: {points: 60}", False)):
            made = lambda ids: head.replace("file: cage.obj, coordinates: GREEN", method) + \
                "  - {name: tail, region: {control: {ids: %r}}}\n" % ids + variables.rsplit("\n", 2)[0] + "\n" + plane
            self.deform("lattice", self.write("made.yaml", made([0])), "-o", "made.vtp")
            places = read_vtp(self.path("made.vtp"))[0]["Points"]
            self.assertEqual(min(y for x, y, z in places) == 0, on_one_side)
            self.assertEqual({(x, -y, z) for x, y, z in places} == {tuple(place) for place in places}, not on_one_side)
            side = [i for i, (x, y, z) in enumerate(places) if y > 0.7 * max(y for x, y, z in places)]
            self.deform("apply", self.write("made.yaml", made(side)), "--set", "tail=0.1", "-o", "made.obj")
            self.assertGreater(max(math.dist(x, y) for x, y in zip(rest, points("made.obj"))), 0.02)
            for x, a in zip(rest, points("made.obj")):
                self.assertEqual(a[1] == 0, x[1] == 0)

    # ---- volumes ----

    def cube(self, n):
        """n^3 hexahedra as SU2."""
        at = lambda i, j, k: i + (n + 1) * (j + (n + 1) * k)
        cells = [(12, at(i, j, k), at(i + 1, j, k), at(i + 1, j + 1, k), at(i, j + 1, k), at(i, j, k + 1), at(i + 1, j, k + 1),
                  at(i + 1, j + 1, k + 1), at(i, j + 1, k + 1)) for k in range(n) for j in range(n) for i in range(n)]
        points = [(i, j, k) for k in range(n + 1) for j in range(n + 1) for i in range(n + 1)]
        self.write("cube.su2", f"NDIME= 3\nNELEM= {len(cells)}\n" + "".join(" ".join(map(str, c)) + "\n" for c in cells) +
                   f"NPOIN= {len(points)}\n" + "".join(" ".join(map(str, p)) + "\n" for p in points) + "NMARK= 0\n")
        return points

    def test_boundary_of_a_volume_mesh(self):
        n = 6
        points = self.cube(n)
        self.start_server()
        self.write("cube.yaml", """
geometry: cube.su2
method: {mls: {}}
handles:
  - {name: top, region: {intersection: [{boundary: true}, {half_space: {point: [0, 0, 5], normal: [0, 0, 1]}}]}}
fixed: [{difference: [{boundary: true}, {half_space: {point: [0, 0, 0.5], normal: [0, 0, 1]}}]}]
variables: [{name: up, handle: top, translate: [0, 0, 1]}]
constraints:
  - {name: rod, rigid: {}, regions: [{ids: [171, 172, 173]}]}
""")
        surface = [any(x in (0, n) for x in p) for p in points]
        top = sum(on and p[2] >= 5 for on, p in zip(surface, points))
        estimate = self.deform("prepare", "cube.yaml", "--check", "--json").json
        self.assertEqual(estimate["handles"][0]["points"], top)
        self.assertEqual(estimate["fixed_points"], 49)
        for name in ("regions.vtp", "regions.vtu"):
            reply = self.deform("regions", "cube.yaml", "-o", name, "--json").json
            arrays, texts = read_vtp(self.path(name))
            self.assertEqual(len(arrays["region"]), len(points), "ids are those of the mesh")
            self.assertEqual([region == 2 for region in arrays["region"]], [on and p[2] >= 5 for on, p in zip(surface, points)])
            self.assertEqual([i for i, value in enumerate(arrays["constraint"]) if value], [171, 172, 173])
            self.assertEqual(arrays["constraint"], arrays["constraint rod"])
            self.assertEqual(texts["constraint_names"], ["none", "rod"])
            self.assertEqual(arrays["colour"][172], (51, 34, 136))
            self.assertEqual(reply["constraints"][0]["points"], 3)
            self.assertIsNone(reply["centres"])
            self.assertTrue(any("not listed" in note for note in reply["notes"]), reply["notes"])
            self.assertEqual(self.deform("inspect", name, "--json").json["points"], len(points), "our own reader reads it")
        self.assertEqual(len(read_vtp(self.path("regions.vtu"))[0]["types"]), n ** 3)
        self.deform("regions", "cube.yaml", "-o", "regions.ply", "--no-centres")
        self.assertEqual(len(read_ply_colours(self.path("regions.ply"))), len(points))


if __name__ == "__main__":
    main()

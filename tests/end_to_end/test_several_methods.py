# SPDX-License-Identifier: GPL-3.0-or-later
"""Setups with several methods and with cages that they have made, through the real programs: against the same methods one after the other."""

import math

from harness import EndToEnd, main, read_obj

COARSE = """\
geometry: ahmed.obj
method: {ffd: {lattice: {points: [7, 5, 5]}}}
handles:
  - {name: roof, region: {intersection: [{group: roof}, {box: {min: [0.4, -1, 0], max: [0.6, 1, 1]}}]}}
fixed: [{group: nose}, {group: underbody}, {group: stilts}]
variables:
  - {name: roof_up, handle: roof, translate: [0, 0, 1], lower: -0.05, upper: 0.05}
"""
FINE = """\
then:
  - method: {rbf: {}}
    handles: [{name: slant, region: {difference: [{group: slant}, {group: roof}]}}]
    fixed: [{group: nose}, {group: roof}, {group: underbody}, {group: stilts}]
"""
VARIABLES = """\
  - {name: slant_turn, handle: slant, rotate: {axis: [0, 1, 0], centre: [0.843, 0, 0.338]}, lower: -0.2, upper: 0.2}
  - {name: slant_up, handle: slant, translate: [0, 0, 1]}
"""
BOTH = COARSE.replace("variables:", FINE + "variables:") + VARIABLES


class SeveralMethods(EndToEnd):
    def setUp(self):
        super().setUp()
        self.start_server()
        self.deform("sample", "-o", "ahmed.obj", "--points", "3000")

    def moved(self, setup, *settings):
        self.write("setup.yaml", setup)
        arguments = [part for setting in settings for part in ("--set", setting)]
        reply = self.deform("apply", "setup.yaml", *arguments, "-o", "out.obj", "--json").json
        return read_obj(self.path("out.obj"))[0], reply

    def test_the_second_starts_where_the_first_ends(self):
        rest = read_obj(self.path("ahmed.obj"))[0]
        coarse, _ = self.moved(COARSE, "roof_up=0.04")
        both, reply = self.moved(BOTH, "roof_up=0.04", "slant_turn=0.15", "slant_up=0.01")
        self.assertEqual(reply["report"]["verdict"], "good")
        second = BOTH.replace("method: {ffd: {lattice: {points: [7, 5, 5]}}}", "method: {rbf: {}}")
        slant = sorted(set(self.group_points("slant")) - set(self.group_points("roof")))
        self.assertGreater(len(slant), 20)
        cos, sin = math.cos(0.15), math.sin(0.15)
        largest = 0
        for i in slant:
            x, y, z = coarse[i][0] - 0.843, coarse[i][1], coarse[i][2] - 0.338
            expected = (0.843 + cos * x + sin * z, y, 0.338 - sin * x + cos * z + 0.01)
            self.assertLess(math.dist(both[i], expected), 1e-9)
            largest = max(largest, math.dist(coarse[i], rest[i]))
        self.assertGreater(largest, 1e-3, "the first method moved them")
        prescribed = max(0.04, max(math.dist(both[i], rest[i]) for i in slant))  # of the roof 0.04
        self.assertAlmostEqual(reply["report"]["prescribed_displacement"], prescribed, delta=1e-9)
        for i in self.group_points("roof"):
            self.assertLess(math.dist(both[i], coarse[i]), 1e-9, "fixed points of the second stay where the first put them")
        # Translations add up.
        alone, _ = self.moved(second.replace(FINE, "").replace(COARSE[COARSE.index("handles"):COARSE.index("variables")],
                              "handles: [{name: slant, region: {difference: [{group: slant}, {group: roof}]}}]\n"
                              "fixed: [{group: nose}, {group: roof}, {group: underbody}, {group: stilts}]\n").replace(
                              "  - {name: roof_up, handle: roof, translate: [0, 0, 1], lower: -0.05, upper: 0.05}\n", ""), "slant_up=0.02")
        sum_of_both, reply = self.moved(BOTH, "roof_up=0.04", "slant_up=0.02")
        self.assertEqual(reply["report"]["path"], "PATH_BASIS")
        for a, b, c, x in zip(sum_of_both, coarse, alone, rest):
            self.assertLess(max(abs(a[k] - (b[k] + c[k] - x[k])) for k in range(3)), 1e-9)

    def group_points(self, group):
        """Corners of the faces of a group of the .obj file."""
        points, current = set(), None
        with open(self.path("ahmed.obj")) as file:
            for line in file:
                words = line.split()
                if words[:1] == ["g"]:
                    current = words[1]
                elif words[:1] == ["f"] and current == group:
                    points.update(int(word.split("/")[0]) - 1 for word in words[1:])
        return sorted(points)

    def test_what_is_said_of_them(self):
        self.write("setup.yaml", BOTH)
        check = self.deform("prepare", "setup.yaml", "--check", "--json").json
        prepared = self.deform("prepare", "setup.yaml", "--json").json
        self.assertLessEqual(prepared["bytes"], check["resident_bytes"])
        said = self.deform("prepare", "setup.yaml").out
        self.assertIn("then[0] factor", said)
        shown = self.write("again.yaml", self.deform("show", prepared["id"], "--setup").out)
        self.assertEqual(self.deform("prepare", shown, "--json").json["id"], prepared["id"])
        regions = self.deform("regions", "setup.yaml", "--then", "0", "-o", "second.ply", "--json").json
        self.assertEqual([r["name"] for r in regions["regions"] if r["kind"] == "handle"], ["slant"])
        self.assertGreater(regions["centres"], 20)
        self.deform("lattice", "setup.yaml", "-o", "lattice.vtp")
        for change, says in ((("[{group: slant}", "[{group: slent}"), ["then[0]: handle \"slant\"", "slent"]),
                             (("{rbf: {}}", "{rbf: {tolerance: 7}}"), ["then[0].method.rbf.tolerance"]),
                             (("{group: roof}, {group: underbody}", "{group: slant}, {group: underbody}"), ["then[0]", "slant"]),
                             (("{name: slant,", "{name: roof,"), ["\"roof\" is used twice"]),
                             (("variables:", "constraints: [{name: flat, planar: {}, regions: [{group: base}]}]\nvariables:"), ["constraints", "`then`"])):
            with self.subTest(says=says):
                self.write("bad.yaml", BOTH.replace(*change))
                self.fails(1, "prepare", "bad.yaml", says=says)
                checked = self.deform("prepare", "bad.yaml", "--check", expect=1)
                for part in says:
                    self.assertIn(part, checked.out + checked.err)
        self.fails(1, "regions", "setup.yaml", "--then", "1", "-o", "a.ply", says=["--then 1", "1 further method"])
        self.fails(1, "lattice", "setup.yaml", "--then", "0", "-o", "a.vtp", says=["only method.ffd has a lattice"])
        for command in (["compile", "setup.yaml", "-o", "a.dfm"],
                        ["compare", "setup.yaml", "--set", "roof_up=0.01", "-o", "a.html"]):
            self.fails(1, *command, says=["one method"])

    def test_populations_and_other_points(self):
        self.write("setup.yaml", BOTH)
        self.write("designs.csv", "name,roof_up,slant_turn,slant_up\na,0.04,0.15,0.01\nb,0.02,0,0.02\nc,0,0.1,0\n")
        self.deform("sweep", "setup.yaml", "--designs", "designs.csv", "-o", "results")
        single, _ = self.moved(BOTH, "roof_up=0.04", "slant_turn=0.15", "slant_up=0.01")
        self.assertEqual(read_obj(self.path("results/a.obj"))[0], single)
        self.write("points.csv", "x,y,z\n0.5,0,0.4\n0.95,0.05,0.3\n")
        self.deform("evaluate", "setup.yaml", "points.csv", "--set", "roof_up=0.04", "--set", "slant_turn=0.15", "-o", "moved.csv")
        with open(self.path("moved.csv")) as file:
            self.assertEqual(len(file.read().split()), 3)

    def test_a_setup_has_its_cage_made(self):
        def setup(cage):
            return COARSE.replace("{ffd: {lattice: {points: [7, 5, 5]}}}", "{cage: {%s, control: MESH}}" % cage)
        made, reply = self.moved(setup("generate: {points: 150}"), "roof_up=0.03")
        self.assertEqual(reply["report"]["verdict"], "good")
        first = self.deform("prepare", "setup.yaml", "--json").json["id"]
        self.deform("cage", "mesh", "ahmed.obj", "--points", "150", "-o", "cage.obj")
        read, _ = self.moved(setup("file: cage.obj"), "roof_up=0.03")
        self.assertEqual(self.deform("prepare", "setup.yaml", "--json").json["id"], first, "the same cage is the same system")
        self.assertEqual(read, made)
        self.write("hull.yaml", setup("generate: {kind: HULL, points: 60}"))
        self.deform("lattice", "hull.yaml", "-o", "hull.vtp")
        self.write("bad.yaml", setup("generate: {kind: BALL}"))
        self.fails(1, "prepare", "bad.yaml", says=["BALL", "WRAP"])
        self.write("bad.yaml", setup("generate: {points: 3}"))
        self.fails(1, "prepare", "bad.yaml", says=["method.cage.generate", "8"])


if __name__ == "__main__":
    main()

# SPDX-License-Identifier: GPL-3.0-or-later
"""`deform detect` on a setup, and `deform prepare --check` on setups with several faults."""

import json

from harness import EndToEnd, main


def box(n):
    """The box [0, 1] x [0, 1] x [0, 2] of squares."""
    points, lines, faces = {}, [], []

    def point(*p):
        if p not in points:
            points[p] = len(points) + 1
            lines.append(f"v {p[0] / n!r} {p[1] / n!r} {p[2] / n!r}")
        return points[p]
    size = (n, n, 2 * n)
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        for level in (0, size[axis]):
            for i in range(size[u]):
                for j in range(size[v]):
                    corners = []
                    for a, b in ((0, 0), (1, 0), (1, 1), (0, 1)):
                        p = [0, 0, 0]
                        p[axis], p[u], p[v] = level, i + a, j + b
                        corners.append(str(point(*p)))
                    faces.append("f " + " ".join(corners if level else reversed(corners)))
    return "\n".join(lines + faces) + "\n"


SETUP = """\
# my box
geometry: box.obj
method: {mls: {}}
handles: [{name: lid, region: {half_space: {point: [0, 0, 1.9], normal: [0, 0, 1]}}}]
fixed: [{box: {min: [-1, -1, -1], max: [2, 2, 0.3]}}]
variables: [{name: shear, handle: lid, translate: [0.2, 0, 0]}]
"""

WRONG = """\
geometry: box.obj
method: {mls: {cover: 3, cubature: 99, energy: {fixing: -1, handles: HANDLES_SOFT}}}
handles:
  - {name: lid, region: {half_space: {point: [0, 0, 1.9], normal: [0, 0, 1]}}}
  - {name: lid, region: {box: {min: [5, 5, 5], max: [6, 6, 6]}}}
fixed: [{ids: [123456]}, {all: true}]
variables: [{name: shear, handle: lit, translate: [1, 0, 0]}]
constraints:
  - {name: short, straight: {}, regions: [{ids: [1, 2]}]}
  - {name: good, planar: {}, regions: [{ids: [1, 2, 3, 4]}]}
  - {name: two, circular: {}, regions: [{ids: [1, 2]}, {ids: [3]}]}
"""
WRONG_FIELDS = ["handles[1].name", "variables[0]", "method.mls.energy.fixing", "method.mls.cubature", "method.mls.cover", "handles[1].region", "fixed[0]", "fixed[1]", "constraints[2]", "constraints[0]"]


class Detection(EndToEnd):
    def setUp(self):
        super().setUp()
        self.start_server()
        self.write("box.obj", box(6))

    def read(self, name):
        with open(self.path(name), encoding="utf-8") as file:
            return file.read()

    def test_a_setup_is_continued(self):
        self.write("setup.yaml", SETUP)
        out = self.deform("detect", "setup.yaml", "-o", "more.yaml").out
        self.assertIn("wrote more.yaml: 4 constraints, 14 left out", out)
        text = self.read("more.yaml")
        self.assertTrue(text.startswith(SETUP))
        self.assertIn("plane_z2_1, planar: {}, regions: [{ids: {file: more.points.json, set: plane_z2_1}}]}  # all its points are "
                      "in handle lid\n", text)
        self.assertIn("# all its points are fixed\n", text)
        self.assertIn("follows from plane_", text)
        sets = json.loads(self.read("more.points.json"))
        self.assertEqual(len(sets["plane_x0_1"]), 7 * 13)
        # What was written may have been edited: it is replaced by the same only, or when told to.
        self.deform("detect", "setup.yaml", "-o", "more.yaml")
        self.write("more.yaml", text.replace("- name: plane_x0_1\n", "- name: left\n"))
        self.fails(1, "detect", "setup.yaml", "-o", "more.yaml", says=["more.yaml", "may have been edited", "--overwrite"])
        self.assertIn("- name: left\n", self.read("more.yaml"))
        self.write("more.yaml", text)
        self.write("more.points.json", "{}")
        self.fails(1, "detect", "setup.yaml", "-o", "more.yaml", says=["more.points.json", "--overwrite"])
        self.assertEqual(self.read("more.points.json"), "{}")
        self.deform("detect", "setup.yaml", "-o", "more.yaml", "--overwrite")
        self.assertEqual(json.loads(self.read("more.points.json")), sets)
        self.deform("prepare", "more.yaml", "--check")
        report = self.deform("apply", "more.yaml", "--set", "shear=1", "-o", "out.obj", "--json").json["report"]
        self.assertEqual(sorted(entry["name"] for entry in report["constraints"]["residuals"]),
                         ["plane_x0_1", "plane_x1_1", "plane_y0_1", "plane_y1_1"])
        self.fails(1, "detect", "more.yaml", "-o", "again.yaml", says=["constraints", "take them out"])
        self.write("rbf.yaml", SETUP.replace("method: {mls: {}}\n", ""))
        self.fails(1, "detect", "rbf.yaml", "-o", "again.yaml", says=["method", "rbf takes no constraints"])
        self.assertIn("plane_x0_1", self.deform("detect", "rbf.yaml").out)
        self.fails(1, "detect", "setup.yaml", "-o", "elsewhere/more.yaml", says=["--setup", "the folder of setup.yaml"])

    def test_a_strange_name_of_a_mesh_is_quoted(self):
        self.write("box: #1.obj", box(3))
        self.deform("detect", "box: #1.obj", "-o", "found: #1.yaml")
        self.write("found.yaml", self.read("found: #1.yaml").replace("handles: []", "handles: [{name: a, region: {ids: [0]}}]"))
        self.deform("prepare", "found.yaml", "--check")

    def test_all_that_is_wrong_is_told_at_once(self):
        self.write("wrong.yaml", WRONG)
        told = self.fails(1, "prepare", "wrong.yaml", "--check", says=["10 problems, the first is: handles[1].name"], prints=True)
        lines = told.out.splitlines()
        self.assertEqual(len(lines), len(WRONG_FIELDS))
        for line, field in zip(lines, WRONG_FIELDS):
            self.assertIn(field, line)
        told = self.fails(1, "prepare", "wrong.yaml", "--check", "--json", prints=True).json
        self.assertEqual([problem["field"] for problem in told["problems"]], WRONG_FIELDS)
        self.fails(1, "prepare", "wrong.yaml", says=["handles[1].name"])

    def test_faults_of_the_text_are_told_with_their_lines(self):
        self.write("typing.yaml", "geometry: box.obj\nhandels: []\nfixed: [{ids: {file: none.json}}]\nseed: x\n")
        told = self.fails(1, "prepare", "typing.yaml", "--check", says=["3 problems"], prints=True)
        for line, part in zip(told.out.splitlines(), ("typing.yaml:2", "typing.yaml:3", "typing.yaml:4")):
            self.assertIn(part, line)
        self.write("one.yaml", "geometry: box.obj\nhandels: []\n")
        self.fails(1, "prepare", "one.yaml", "--check", says=["one.yaml:2", "did you mean \"handles\""])


if __name__ == "__main__":
    main()

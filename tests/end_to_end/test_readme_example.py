# SPDX-License-Identifier: GPL-3.0-or-later
"""The README's example at every corner of its bounds and at three sizes: what comes out is a car, and its gate says so."""

import csv
import itertools
import math
import os
import shutil

from harness import EndToEnd, long_test, main

EXAMPLES = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..", "deploy", "examples")
HINGE = (0.843, 0.338)  # x, z of the axis that the slant turns about
LOWEST, HIGHEST = {"roof_up": -0.04, "slant_turn": -0.1}, {"roof_up": 0.04, "slant_turn": 0.1}


def read_obj(path):
    points, faces, groups, group = [], [], {}, None
    with open(path) as file:
        for line in file:
            if line.startswith("v "):
                points.append(tuple(map(float, line.split()[1:4])))
            elif line.startswith("f "):
                faces.append(tuple(int(word.split("/")[0]) - 1 for word in line.split()[1:]))
                groups.setdefault(group, set()).update(faces[-1])
            elif line.startswith("g "):
                group = line.split()[1]
    return points, faces, groups


def normal(points, face):
    a, b, c = (points[k] for k in face)
    u, v = [b[k] - a[k] for k in range(3)], [c[k] - a[k] for k in range(3)]
    return (u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0])


def turned_over(before, after, faces):
    """No part of the example turns by more than 6 degrees, so here the direction of a normal itself tells."""
    return sum(1 for face in faces if sum(p * q for p, q in zip(normal(before, face), normal(after, face))) <= 0)


class ReadmeExample(EndToEnd):
    def prepare_example(self, points):
        for name in ("ahmed.yaml", "designs.csv"):
            shutil.copy(os.path.join(EXAMPLES, name), self.path(name))
        self.deform("sample", "-o", "ahmed.obj", "--points", str(points))
        return read_obj(self.path("ahmed.obj"))

    def told(self, rest, design):
        """The largest displacement that the handles are told to make, by the setup as a person reads it."""
        points, _, groups = rest
        arm = max(math.hypot(points[i][0] - HINGE[0], points[i][2] - HINGE[1]) for i in groups["slant"])
        return max(abs(design["roof_up"]), 2 * math.sin(abs(design["slant_turn"]) / 2) * arm)

    def check(self, rest, design):
        settings = [word for name, value in design.items() for word in ("--set", f"{name}={value}")]
        report = self.deform("apply", "ahmed.yaml", *settings, "-o", "out.obj", "--fail-on", "flipped_faces>0", "--fail-on",
                             "displacement_ratio>1.2", "--json").json["report"]
        after, _, _ = read_obj(self.path("out.obj"))
        self.assertEqual(turned_over(rest[0], after, rest[1]), 0, design)
        farthest = max(map(math.dist, rest[0], after))
        self.assertLessEqual(farthest, 1.2 * self.told(rest, design), design)
        self.assertAlmostEqual(report["max_displacement"], farthest, 9)
        self.assertAlmostEqual(report["prescribed_displacement"], self.told(rest, design), 9)
        self.assertEqual(report["flipped_faces"], 0)
        self.deform("quality", "out.obj", "--before", "ahmed.obj", "--setup", "ahmed.yaml", "--fail-on", "flipped_faces>0")

    def sweep_corners(self, points):
        self.start_server()
        rest = self.prepare_example(points)
        corners = itertools.product(*((LOWEST[name], 0, HIGHEST[name]) for name in LOWEST))
        for corner in corners:
            design = dict(zip(LOWEST, corner))
            if any(corner):
                self.check(rest, design)
        self.check(rest, {"roof_up": 0.03, "slant_turn": 0.1})  # the command of the README
        for name in LOWEST:  # these are the bounds
            for value in (1.01 * LOWEST[name], 1.01 * HIGHEST[name]):
                self.fails(1, "apply", "ahmed.yaml", "--set", f"{name}={value}", "-o", "x.obj", says=[name, "bounds"])

    def test_nothing_folds_at_2500_points(self):
        self.sweep_corners(2500)

    def test_nothing_folds_at_10000_points(self):
        self.sweep_corners(10000)

    @long_test
    def test_nothing_folds_at_50000_points(self):
        self.sweep_corners(50000)

    def test_the_table_of_designs_stays_within_the_bounds(self):
        with open(os.path.join(EXAMPLES, "designs.csv")) as file:
            for row in csv.DictReader(file):
                for name in LOWEST:
                    self.assertTrue(LOWEST[name] <= float(row[name]) <= HIGHEST[name], row)


if __name__ == "__main__":
    main()

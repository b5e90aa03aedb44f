# SPDX-License-Identifier: GPL-3.0-or-later
"""Meshes from elsewhere go through a real server and come back deformed, in order, correct to 1e-9 of the diagonal."""

import json
import math
import os
import re
import struct

from harness import SHARED_DATA, EndToEnd, box, distance, main, read_off, read_stl_corners

SETUP = """\
geometry: {mesh}
method: {{rbf: {{reduction: {reduction}}}}}
handles: [{{name: top, region: {{half_space: {{point: {top}, normal: {axis}}}}}}}]
fixed: [{{half_space: {{point: {bottom}, normal: {minus_axis}}}}}]
variables:
  - {{name: up, handle: top, translate: [0.1, 0.2, 0.3]}}
  - {{name: turn, handle: top, rotate: {{axis: [0, 0, 1], centre: [0.1, 0, 0]}}}}
"""


def moved(p, up, turn):
    """The affine image of a handle point: first the translation, then the rotation."""
    x, y, z = p[0] + 0.1 * up - 0.1, p[1] + 0.2 * up, p[2] + 0.3 * up
    return (0.1 + math.cos(turn) * x - math.sin(turn) * y, math.sin(turn) * x + math.cos(turn) * y, z)


JOINT = """\
geometry: joint_remeshed.off.gz
method: {method}
handles: [{{name: top, region: {{half_space: {{point: [0, 0, {top}], normal: [0, 0, 1]}}}}}}]
fixed: [{{half_space: {{point: [0, 0, {bottom}], normal: [0, 0, -1]}}}}]
variables: [{{name: up, handle: top, translate: [0, 0, 1]}}]
constraints:
"""


def off_circle(points):
    """Largest distance from the circle through three of the points that are far apart."""
    def minus(a, b):
        return [x - y for x, y in zip(a, b)]

    def cross(a, b):
        return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]

    def dot(a, b):
        return sum(x * y for x, y in zip(a, b))

    a = points[0]
    b = max(points, key=lambda p: math.dist(a, p))
    c = max(points, key=lambda p: min(math.dist(a, p), math.dist(b, p)))
    u, v = minus(b, a), minus(c, a)
    normal = cross(u, v)
    square = dot(normal, normal)
    to_centre = [(dot(u, u) * x + dot(v, v) * y) / (2 * square) for x, y in zip(cross(v, normal), cross(normal, u))]
    centre = [x + y for x, y in zip(a, to_centre)]
    radius, unit = math.dist(a, centre), [x / math.sqrt(square) for x in normal]
    worst = 0
    for p in points:
        out = minus(p, centre)
        height = dot(out, unit)
        across = math.sqrt(max(0, dot(out, out) - height * height))
        worst = max(worst, math.hypot(height, across - radius))
    return worst


def height_and_normal(a, b, c):
    """The least height of a triangle and its unit normal, by the right hand."""
    u, v = [q - p for p, q in zip(a, b)], [q - p for p, q in zip(a, c)]
    cross = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]]
    twice = math.hypot(*cross)
    longest = max(math.dist(a, b), math.dist(b, c), math.dist(c, a))
    return (twice / longest if longest > 0 else 0), [x / twice for x in cross] if twice > 0 else [0, 0, 0]


class RealMeshes(EndToEnd):
    def setUp(self):
        super().setUp()
        self.start_server()

    def mesh(self, name):
        path = os.path.join(SHARED_DATA, "A_surface", name)
        os.symlink(path, self.path(name))
        return path

    def write_setup(self, mesh, axis, bottom, top, reduction="REDUCTION_AUTOMATIC"):
        unit = [1.0 if k == axis else 0.0 for k in range(3)]
        self.write("setup.yaml", SETUP.format(mesh=mesh, reduction=reduction, axis=unit, minus_axis=[-u for u in unit],
                                              bottom=[u * bottom for u in unit], top=[u * top for u in unit]))

    def test_joint(self):
        name = "joint_remeshed.off.gz"
        before, faces_before = read_off(self.mesh(name))
        low, high = box(before)
        diagonal = math.dist(low, high)
        bottom, top = low[1] + 0.2 * (high[1] - low[1]), high[1] - 0.2 * (high[1] - low[1])
        self.write_setup(name, 1, bottom, top)
        reply = self.deform("apply", "setup.yaml", "--set", "up=0.5", "--set", "turn=0.3", "-o", "out.off.gz", "--json").json
        self.assertEqual(reply["points"], len(before))
        after, faces_after = read_off(self.path("out.off.gz"))
        self.assertEqual(faces_before, faces_after)
        handle = [k for k, p in enumerate(before) if p[1] >= top]
        fixed = [k for k, p in enumerate(before) if p[1] <= bottom]
        self.assertGreater(min(len(handle), len(fixed)), 100)
        self.assertLessEqual(max(distance(moved(before[k], 0.5, 0.3), after[k]) for k in handle), 1e-9 * diagonal)
        self.assertLessEqual(max(distance(before[k], after[k]) for k in fixed), 1e-9 * diagonal)
        self.assertGreater(max(distance(a, b) for a, b in zip(before, after)), 0.01 * diagonal)
        self.compare_with_scipy(name, before, low, high, diagonal)

    def test_joint_keeps_its_bore_round(self):
        """Thesis figure 8.9: bottom fixed, top lifted, the rims of the bore as they were found."""
        name = "joint_remeshed.off.gz"
        before, _ = read_off(self.mesh(name))
        low, high = box(before)
        diagonal, margin = math.dist(low, high), 1e-4 * (high[2] - low[2])
        self.deform("detect", name, "-o", "found.yaml", "--overwrite")
        with open(self.path("found.yaml"), encoding="utf-8") as file:
            found = re.split(r"^(?=  - name: |  #)", file.read(), flags=re.MULTILINE)
        rims = [entry.rstrip() for entry in found if re.match(r"  - name: circle_", entry)][:2]  # the longest come first
        self.assertEqual(len(rims), 2)
        with open(self.path("found.points.json"), encoding="utf-8") as file:
            sets = json.load(file)
        points = [sets[re.match(r"  - name: (\S+)", rim).group(1)] for rim in rims]
        for method in ("{shell: {}}", "{mls: {}}"):
            self.write("round.yaml", JOINT.format(method=method, top=high[2] - margin, bottom=low[2] + margin) +
                       "\n".join(rim + "\n    exact: true" for rim in rims) + "\n")
            reply = self.deform("apply", "round.yaml", "--set", "up=0.3", "-o", "round.off.gz", "--json").json
            constraints = reply["report"]["constraints"]
            self.assertTrue(constraints["converged"])
            after, _ = read_off(self.path("round.off.gz"))
            for residual, ids in zip(constraints["residuals"], points):
                self.assertGreater(residual["free_rms"], 1e-3 * diagonal)
                self.assertLess(residual["rms"], 1e-2 * residual["free_rms"])
                self.assertLess(off_circle([after[i] for i in ids]), 1e-9 * diagonal)
                self.assertGreater(max(distance(before[i], after[i]) for i in ids), 0.01 * diagonal)

    def test_what_is_detected_is_accepted(self):
        """As it is written, with a handle in it; and without what a handle holds, when it is known."""
        volume = os.path.join(SHARED_DATA, "B_volume", "mambo", "mambo_s1_tet_cadclassified.msh.gz")
        names = ["joint.off", "joint_remeshed.off.gz", "flange.stl.gz", "fandisk.off.gz", "fandisk_dual.off.gz", "anchor_dense.off.gz",
                 "pinion.off", "ChineseDragon-10kv.off.gz", "NACA0012.obj.gz"]
        for name in names:
            self.mesh(name)
        os.symlink(volume, self.path("volume.msh.gz"))
        for name in names + ["volume.msh.gz"]:
            with self.subTest(name):
                self.deform("detect", name, "-o", "found.yaml", "--overwrite")
                with open(self.path("found.yaml"), encoding="utf-8") as file:
                    text = file.read()
                self.assertEqual(text.count("\nhandles: []"), 1)
                self.write("found.yaml", text.replace("\nhandles: []", "\nhandles: [{name: corner, region: {ids: [0]}}]"))
                self.deform("prepare", "found.yaml", "--check")
                comments = text.replace("# - {name", "- {name")  # what is left out is as legal, too few points aside
                self.write("all.yaml", comments.replace("\nhandles: []", "\nhandles: [{name: corner, region: {ids: [0]}}]"))
                self.deform("prepare", "all.yaml", "--check")

    def compare_with_scipy(self, name, before, low, high, diagonal):
        """The free points between small handle and fixed regions, against an interpolant computed here."""
        try:
            import numpy
            from scipy.interpolate import RBFInterpolator
        except ImportError:
            print("without scipy: the free points are not compared")
            return
        bottom, top = low[1] + 0.08 * (high[1] - low[1]), high[1] - 0.08 * (high[1] - low[1])
        self.write_setup(name, 1, bottom, top, "REDUCTION_OFF")
        self.deform("apply", "setup.yaml", "--set", "up=0.5", "--set", "turn=0.3", "-o", "all.off")
        after, _ = read_off(self.path("all.off"))
        centres = [k for k, p in enumerate(before) if p[1] >= top or p[1] <= bottom]
        free = [k for k, p in enumerate(before) if bottom < p[1] < top][::37]
        values = [moved(before[k], 0.5, 0.3) if before[k][1] >= top else before[k] for k in centres]
        points = numpy.array(before)
        interpolant = RBFInterpolator(points[centres], numpy.array(values) - points[centres], kernel="cubic", degree=1)
        expected = interpolant(points[free]) + points[free]
        self.assertGreater(len(free), 100)
        self.assertLessEqual(abs(numpy.array(after)[free] - expected).max(), 1e-9 * diagonal)

    def test_car(self):
        name = "car_fastback.stl.gz"
        before, normals_before, rest_before = read_stl_corners(self.mesh(name))
        low, high = box(before)
        diagonal = math.dist(low, high)
        bottom, top = 0.4, 1.2
        self.write_setup(name, 2, bottom, top)
        self.deform("apply", "setup.yaml", "--set", "up=0.1", "--set", "turn=0.05", "-o", "out.stl.gz")
        after, normals_after, rest_after = read_stl_corners(self.path("out.stl.gz"))
        self.assertTrue(rest_before == rest_after, "what is neither a corner nor a normal is as it was")
        self.assertEqual(len(before), len(after))
        handles = fixed = 0
        for a, b in zip(before, after):
            if a[2] <= bottom:
                fixed += 1
                self.assertLessEqual(distance(a, b), 1e-9 * diagonal + self.rounding(a))
            elif a[2] >= top:
                handles += 1
                expected = moved(a, 0.1, 0.05)
                self.assertLessEqual(distance(expected, b), 1e-9 * diagonal + self.rounding(expected))
        self.assertGreater(min(handles, fixed), 100)
        corners = {}
        for a, b in zip(before, after):  # coincident corners stay coincident
            self.assertEqual(corners.setdefault(a, b), b)

        turned = 0
        for k, (old, new) in enumerate(zip(normals_before, normals_after)):
            corners_before, corners_after = before[3 * k:3 * k + 3], after[3 * k:3 * k + 3]
            if corners_before == corners_after or not any(old):
                self.assertEqual(old, new)
                continue
            turned += math.dist(old, new) > 1e-3
            height, normal = height_and_normal(*corners_after)
            # Corners are rounded to floats, which turns thin facets.
            allowed = 1e-6 + 4 * max(map(self.rounding, corners_after)) / height if height > 0 else 2
            self.assertLessEqual(math.dist(new, normal) if height > 0 else 0, allowed)
        self.assertGreater(turned, 100)

    def rounding(self, point):
        """Half a unit in the last place of the floats that an STL holds."""
        largest = max(abs(x) for x in point)
        bits = struct.unpack("<I", struct.pack("<f", largest))[0]
        return (struct.unpack("<f", struct.pack("<I", bits + 1))[0] - struct.unpack("<f", struct.pack("<I", bits))[0]) / 2


if __name__ == "__main__":
    main()

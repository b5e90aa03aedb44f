# SPDX-License-Identifier: GPL-3.0-or-later
"""Constraints through a real server: found by detection, kept by moving least squares and shells."""

import math
import os

from harness import EndToEnd, main, read_obj
from test_cells import hexahedra

AROUND, ACROSS = 96, 14
HOLE = 0.25


def plate():
    """[0, 2] x [0, 1] in quads, slightly bent, with a round hole in its middle; group "hole" is the row of faces around it."""
    lines = []
    for j in range(ACROSS + 1):
        t = j / ACROSS
        for k in range(AROUND):
            angle = 2 * math.pi * k / AROUND
            c, s = math.cos(angle), math.sin(angle)
            reach = min(1 / abs(c) if c else math.inf, 0.5 / abs(s) if s else math.inf)
            radius = (1 - t) * HOLE + t * reach
            lines.append(f"v {1 + radius * c!r} {0.5 + radius * s!r} {0.0!r}")
    at = lambda j, k: 1 + j * AROUND + k % AROUND
    for j in range(ACROSS):
        lines.append("g hole" if j == 0 else "g plate")
        lines += [f"f {at(j, k)} {at(j, k + 1)} {at(j + 1, k + 1)} {at(j + 1, k)}" for k in range(AROUND)]
    return "\n".join(lines) + "\n"


def half_plate():
    """The points of the plate with y >= 0.5, in their order."""
    lines = plate().splitlines()
    kept = [AROUND * j + k for j in range(ACROSS + 1) for k in range(AROUND // 2 + 1)]
    number = {1 + id: 1 + i for i, id in enumerate(kept)}
    points = [line for line in lines if line.startswith("v ")]
    faces = [[int(corner) for corner in line.split()[1:]] for line in lines if line.startswith("f ")]
    faces = [face for face in faces if all(corner in number for corner in face)]
    return "\n".join([points[id] for id in kept] +
                     ["f " + " ".join(str(number[corner]) for corner in face) for face in faces]) + "\n"


RIM = list(range(AROUND))
DIAGONAL = math.sqrt(5)


def setup(method, constraints=""):
    return f"""\
geometry: plate.obj
method: {method}
handles: [{{name: right, region: {{half_space: {{point: [1.9, 0, 0], normal: [1, 0, 0]}}}}}}]
fixed: [{{half_space: {{point: [0.1, 0, 0], normal: [-1, 0, 0]}}}}]
variables: [{{name: pull, handle: right, translate: [1, 0, 0]}}, {{name: lift, handle: right, translate: [0, 0, 1]}}]
{constraints}
"""


CIRCLE = f"constraints: [{{name: bore, circular: {{}}, regions: [{{ids: {RIM}}}]}}]"
CIRCLE_KEPT = f"constraints: [{{name: bore, circular: {{radius: KEPT}}, regions: [{{ids: {RIM}}}]}}]"


def distance(a, b):
    return math.dist(a, b)


def out_of_round(points):
    """Largest radius minus smallest over mean, of points nearly in a plane around their mean."""
    middle = [sum(p[k] for p in points) / len(points) for k in range(3)]
    radii = [distance(p, middle) for p in points]
    return (max(radii) - min(radii)) * len(radii) / sum(radii)


def circle_through(a, b, c):
    """Centre in the plane z = 0, and radius, of the circle through three points."""
    (ax, ay, _), (bx, by, _), (cx, cy, _) = a, b, c
    twice = 2 * (ax * (by - cy) + bx * (cy - ay) + cx * (ay - by))
    squares = [p[0] ** 2 + p[1] ** 2 for p in (a, b, c)]
    x = (squares[0] * (by - cy) + squares[1] * (cy - ay) + squares[2] * (ay - by)) / twice
    y = (squares[0] * (cx - bx) + squares[1] * (ax - cx) + squares[2] * (bx - ax)) / twice
    return [x, y, 0], distance([x, y, 0], [ax, ay, 0])


def drum(around=48, high=12, rings=5):
    """A closed cylinder of radius 0.5 and height 2, of quads and triangles."""
    lines, faces = [], []
    ring = lambda r, z: [f"v {r * math.cos(2 * math.pi * k / around)!r} {r * math.sin(2 * math.pi * k / around)!r} {z!r}"
                         for k in range(around)]
    for j in range(high + 1):
        lines += ring(0.5, 2 * j / high)
    at = lambda j, k: 1 + j * around + k % around
    for j in range(high):
        faces += [f"f {at(j, k)} {at(j, k + 1)} {at(j + 1, k + 1)} {at(j + 1, k)}" for k in range(around)]
    for top in (False, True):
        outer = high * around if top else 0
        for i in range(1, rings):
            inner = len(lines)
            lines += ring(0.5 * (1 - i / rings), 2.0 if top else 0.0)
            for k in range(around):
                quad = [outer + k, outer + (k + 1) % around, inner + (k + 1) % around, inner + k]
                faces.append("f " + " ".join(str(1 + p) for p in (quad if top else reversed(quad))))
            outer = inner
        lines.append(f"v 0 0 {2.0 if top else 0.0!r}")
        for k in range(around):
            corners = [outer + k, outer + (k + 1) % around, len(lines) - 1]
            faces.append("f " + " ".join(str(1 + p) for p in (corners if top else reversed(corners))))
    return "\n".join(lines + faces) + "\n"


class Constraints(EndToEnd):
    def setUp(self):
        super().setUp()
        self.start_server()

    def apply(self, name, *arguments, expect=0):
        reply = self.deform("apply", name, *arguments, "-o", "out.obj", "--json", expect=expect).json
        return reply["report"], read_obj(self.path("out.obj"))[0]

    def test_a_bore_stays_round(self):
        self.write("plate.obj", plate())
        for method in ("{mls: {}}", "{shell: {}}", "{subspace: {centres: 400}}"):
            self.write("free.yaml", setup(method))
            self.write("round.yaml", setup(method, CIRCLE))
            free, points = self.apply("free.yaml", "--set", "pull=0.4")
            self.assertNotIn("constraints", free)
            unconstrained = out_of_round([points[i] for i in RIM])
            self.assertGreater(unconstrained, 0.05, method)
            report, points = self.apply("round.yaml", "--set", "pull=0.4")
            self.assertLess(out_of_round([points[i] for i in RIM]), 5e-2 * unconstrained, method)
            constraints = report["constraints"]
            self.assertTrue(constraints["converged"])
            (bore,) = constraints["residuals"]
            self.assertEqual(bore["name"], "bore")
            self.assertLess(bore["rms"], 5e-2 * bore["free_rms"])
            self.assertGreater(constraints["iterations"], 0)
            self.assertLessEqual(constraints["newton_steps"], constraints["iterations"])
            self.assertTrue(0 < constraints["convergence_error"] < 1e-5, constraints["convergence_error"])
            text = self.deform("apply", "round.yaml", "--set", "pull=0.4", "-o", "out.obj").out
            self.assertRegex(text, r"bore: largest \S+, rms \S+ \(without constraints \S+, \S+\)")
            self.assertRegex(text, r"constraints converged in \d+ iterations(, \d+ of them Newton steps)?, \S+ rms from the solution")
            self.write("stiff.yaml", setup(method, CIRCLE.replace("circular", "weight: 1e7, circular")))
            report, points = self.apply("stiff.yaml", "--set", "pull=0.4")
            self.assertTrue(report["constraints"]["converged"])
            self.assertLess(report["constraints"]["residuals"][0]["rms"], 1e-2 * bore["free_rms"])
            self.assertLess(out_of_round([points[i] for i in RIM]), 1e-2 * unconstrained, method)

    def test_the_time_of_a_design_is_told(self):
        self.write("plate.obj", plate())
        self.write("free.yaml", setup("{shell: {}}"))
        self.write("round.yaml", setup("{shell: {}}", CIRCLE))
        for options in (["--check"], []):
            self.assertEqual(self.deform("prepare", "free.yaml", *options, "--json").json["design_seconds"], 0)
            self.assertGreater(self.deform("prepare", "round.yaml", *options, "--json").json["design_seconds"], 0)
            self.assertIn("time of a design with its constraints: about", self.deform("prepare", "round.yaml", *options).out)

    def test_the_radius_is_kept_when_asked(self):
        self.write("plate.obj", plate())
        self.write("kept.yaml", setup("{mls: {}}", CIRCLE_KEPT))
        _, points = self.apply("kept.yaml", "--set", "pull=0.4")
        rim = [points[i] for i in RIM]
        middle = [sum(p[k] for p in rim) / len(rim) for k in range(3)]
        self.assertAlmostEqual(sum(distance(p, middle) for p in rim) / len(rim), HOLE, delta=2e-3)

    def test_a_sweep_is_what_apply_gives(self):
        self.write("plate.obj", plate())
        self.write("round.yaml", setup("{mls: {}}", CIRCLE))
        self.write("designs.csv", "name,pull,lift\na,0.1,0\nb,0.4,0.2\nc,-0.1,0.1\n")
        self.deform("sweep", "round.yaml", "--designs", "designs.csv", "-o", "results")
        for name, pull, lift in (("a", 0.1, 0), ("b", 0.4, 0.2), ("c", -0.1, 0.1)):
            _, points = self.apply("round.yaml", "--set", f"pull={pull}", "--set", f"lift={lift}")
            swept = read_obj(self.path(os.path.join("results", f"{name}.obj")))[0]
            self.assertLess(max(distance(p, q) for p, q in zip(points, swept)), 1e-5, name)

    def test_refusals(self):
        self.write("plate.obj", plate())
        self.write("rbf.yaml", setup("{rbf: {}}", CIRCLE))
        self.fails(1, "prepare", "rbf.yaml", says=["constraints", "rbf"])
        self.write("few.yaml", setup("{mls: {}}", "constraints: [{name: bore, circular: {}, regions: [{ids: [0, 1]}]}]"))
        self.fails(1, "prepare", "few.yaml", says=["constraints[0]", "2 points"])
        self.write("none.yaml", setup("{mls: {}}", "constraints: [{name: bore, regions: [{ids: [0, 1]}]}]"))
        self.fails(1, "prepare", "none.yaml", says=["constraints[0]", "no kind of constraint"])
        self.write("layers.yaml", setup("{mls: {}}", CIRCLE.replace("circular: {}", "rigid: {layers: 2}")))
        self.fails(1, "prepare", "layers.yaml", says=["constraints[0].rigid.layers", "no cells"])
        self.write("layers.yaml", setup("{mls: {}}", CIRCLE.replace("circular: {}", "rigid: {layers: 1001}")))
        self.fails(1, "prepare", "layers.yaml", "--check", says=["constraints[0].rigid.layers", "1000"])
        for options, says in (("{tolerance: 0.5}", ["tolerance: 0.5", "1e-12..0.01"]),
                              ("{iterations: 1000001}", ["iterations: 1000001", "1000000"])):
            self.write("options.yaml", setup("{mls: {}}", f"{CIRCLE}\nconstraint_options: {options}"))
            self.fails(1, "prepare", "options.yaml", says=["constraint_options." + says[0], says[1]])
            self.write("options.yaml", setup("{mls: {}}", f"constraint_options: {options}"))
            self.fails(1, "prepare", "options.yaml", "--check", says=["constraint_options." + says[0], says[1]])

    def test_half_a_bore_stays_half_of_a_round_one(self):
        self.write("plate.obj", plate())
        whole = {name: setup("{shell: {}}", f"{constraint}\nconstraint_options: {{tolerance: 1e-10}}")
                 for name, constraint in (("soft", CIRCLE), ("exact", CIRCLE.replace("circular", "exact: true, circular")))}
        half_rim = list(range(AROUND // 2 + 1))
        self.write("half.obj", half_plate())
        for name, text in whole.items():
            self.write("whole.yaml", text)
            _, expected = self.apply("whole.yaml", "--set", "pull=0.4")
            self.write("half.yaml", text.replace("plate.obj", "half.obj").replace(str(RIM), str(half_rim)) +
                       "symmetry: [{point: [0, 0.5, 0], normal: [0, 1, 0]}]\n")
            prepared = self.deform("prepare", "half.yaml").out
            self.assertIn("Constraint bore continues through symmetry[0]", prepared)
            report, points = self.apply("half.yaml", "--set", "pull=0.4")
            kept = [AROUND * j + k for j in range(ACROSS + 1) for k in half_rim]
            self.assertLess(max(distance(points[i], expected[id]) for i, id in enumerate(kept)), 1e-6, name)
            (bore,) = report["constraints"]["residuals"]
            self.assertEqual(bore["name"], "bore")
            rim = [points[i] for i in half_rim]
            rim += [[x, 1 - y, z] for x, y, z in rim]
            self.assertLess(out_of_round(rim), 1e-8 if name == "exact" else 1e-2, name)

    def test_ids_do_not_depend_on_spelling_defaults_out(self):
        self.write("plate.obj", plate())
        self.write("short.yaml", setup("{mls: {}}", CIRCLE))
        self.write("long.yaml", setup("{mls: {}}", CIRCLE.replace("circular", "exact: false, weight: 0, circular") +
                                      "\nconstraint_options: {tolerance: 1e-7, iterations: 3000}"))
        ids = [self.deform("prepare", name, "--json").json["id"] for name in ("short.yaml", "long.yaml")]
        self.assertEqual(ids[0], ids[1])
        shown = self.deform("show", ids[0], "--setup").out
        self.assertRegex(shown, r'"iterations": 3000')

    def test_exact_ones_are_on_their_shape(self):
        self.write("plate.obj", plate())
        self.write("exact.yaml", setup("{mls: {}}", CIRCLE.replace("circular", "exact: true, circular")))
        report, points = self.apply("exact.yaml", "--set", "pull=0.4", "--encoding", "raw_f64")
        (bore,) = report["constraints"]["residuals"]
        self.assertFalse(bore["missed"])
        self.assertLess(bore["largest"], 1e-9 * DIAGONAL)
        self.assertGreater(bore["free_largest"], 1e-3)
        rim = [points[i] for i in RIM]
        middle, radius = circle_through(rim[0], rim[AROUND // 3], rim[2 * AROUND // 3])
        for p in rim:
            self.assertLess(math.hypot(distance(p, middle) - radius, p[2]), 1e-8, "in the plane and on the circle of three of them")
        self.write("torn.yaml", setup("{mls: {}}", """constraints:
  - {name: ends, exact: true, rigid: {}, regions: [{union: [{box: {min: [-1, -1, -1], max: [0.1, 2, 1]}}, {box: {min: [1.9, -1, -1], max: [3, 2, 1]}}]}]}"""))
        report, _ = self.apply("torn.yaml", "--set", "pull=0.4", expect=4)
        self.assertTrue(report["constraints"]["residuals"][0]["missed"], "one end stays, the other moves")
        torn = ["apply", "torn.yaml", "--set", "pull=0.4", "-o", "torn.obj"]
        told = self.fails(4, *torn, says=["torn.obj was not written", "\"ends\"", "--keep-bad"], prints=True)
        self.assertIn("NOT EXACT", told.out)
        self.assertIn("did NOT write torn.obj", told.out)
        self.assertFalse(os.path.exists(self.path("torn.obj")))
        self.fails(4, *torn, "--keep-bad", "--json", says=["torn.obj", "\"ends\""], prints=True)
        self.assertEqual(len(read_obj(self.path("torn.obj"))[0]), len(points))

    def test_layers_on_a_wall_keep_their_shape(self):
        self.write("cube.mesh", hexahedra(8))
        layers = """\
geometry: cube.mesh
method: {mls: {}}
handles: [{name: top, region: {half_space: {point: [0, 0, 1], normal: [0, 0, 1]}}}]
fixed: [{half_space: {point: [0, 0, 0], normal: [0, 0, -1]}}]
variables: [{name: turn, handle: top, rotate: {axis: [0, 0, 1], centre: [0.5, 0.5, 0]}}]
constraints: [{name: wall, rigid: {layers: LAYERS}, regions: [{box: {min: [0, 0.25, 0.25], max: [0, 0.75, 0.75]}}]}]
"""
        for count, shorter in ((2, 0), (10, 16)):
            self.write("wall.yaml", layers.replace("LAYERS", str(count)))
            notes = " ".join(self.deform("prepare", "wall.yaml", "--json").json["notes"])
            self.assertIn(f"wall: 16 rigid columns of cells, {shorter} of them of fewer than {count} layers", notes)
        self.write("wall.yaml", layers.replace("LAYERS", "2"))
        reply = self.deform("apply", "wall.yaml", "--set", "turn=0.4", "-o", "out.mesh", "--json").json["report"]
        (wall,) = reply["constraints"]["residuals"]
        self.assertTrue(reply["constraints"]["converged"])
        self.assertLess(wall["rms"], 5e-2 * wall["free_rms"])
        self.assertEqual(reply["cells"]["inverted"], 0)
        self.write("wall.yaml", layers.replace("LAYERS", "2").replace("rigid:", "exact: true, rigid:"))
        reply = self.deform("apply", "wall.yaml", "--set", "turn=0.4", "-o", "out.mesh", "--json").json["report"]
        (wall,) = reply["constraints"]["residuals"]
        self.assertFalse(wall["missed"])
        self.assertLess(wall["largest"], 1e-9 * math.sqrt(3))
        self.assertEqual(reply["cells"]["inverted"], 0)
        self.write("inside.yaml", layers.replace("LAYERS", "2").replace("[0, 0.25", "[0.25, 0.25").replace("[0, 0.75", "[0.25, 0.75"))
        for check in ((), ("--check",)):
            self.fails(1, "prepare", "inside.yaml", *check, says=["constraints[0].regions[0]", "no face on the boundary"])

    def test_thin_layers_keep_their_heights(self):
        # A plate in hexahedra with first cells of 3e-5, of which a strip is lifted and turned.
        levels = [0.0]
        while levels[-1] < 0.6:
            levels.append(levels[-1] + min(0.2, 1e-4 * 1.4 ** (len(levels) - 1)))
        levels.append(1.0)
        nx, ny, nz = 16, 4, len(levels)

        def at(i, j, k):
            return 1 + i + (nx + 1) * (j + (ny + 1) * k)

        rest = [[3 * i / nx, j / ny, z] for z in levels for j in range(ny + 1) for i in range(nx + 1)]
        cells = [[at(i + a, j + b, k + c) for c in (0, 1) for a, b in ((0, 0), (1, 0), (1, 1), (0, 1))]
                 for k in range(nz - 1) for j in range(ny) for i in range(nx)]
        self.write("plate.mesh", "MeshVersionFormatted 2\nDimension 3\nVertices\n" + f"{len(rest)}\n" +
                   "".join(f"{x!r} {y!r} {z!r} 0\n" for x, y, z in rest) + f"Hexahedra\n{len(cells)}\n" +
                   "".join(" ".join(map(str, cell)) + " 0\n" for cell in cells) + "End\n")
        plate = """\
geometry: plate.mesh
method: {ffd: {}}
handles: [{name: strip, region: {box: {min: [1.1, -1, -1], max: [1.9, 2, 0]}}}]
fixed:
  - {half_space: {point: [0, 0, 1], normal: [0, 0, 1]}}
  - {half_space: {point: [0, 0, 0], normal: [-1, 0, 0]}}
  - {half_space: {point: [3, 0, 0], normal: [1, 0, 0]}}
variables:
  - {name: up, handle: strip, translate: [0, 0, 1]}
  - {name: turn, handle: strip, rotate: {axis: [0, 1, 0], centre: [1.5, 0, 0]}}
"""
        self.write("free.yaml", plate)
        keep = "constraints: [{name: wall, rigid: {layers: 4}, regions: [{box: {min: [-1, -1, -1], max: [4, 2, 0]}}]}]\n"
        self.write("kept.yaml", plate + keep)

        def heights(name, *more):
            sets = ["--set", "up=0.1", "--set", "turn=0.15", *more]
            told = self.deform("apply", name, *sets, "-o", "plate_out.mesh").out
            report = self.deform("apply", name, *sets, "-o", "plate_out.mesh", "--json").json["report"]
            with open(self.path("plate_out.mesh"), encoding="ascii") as file:
                lines = file.read().split("Vertices\n")[1].splitlines()
            points = [[float(word) for word in line.split()[:3]] for line in lines[1:1 + int(lines[0])]]
            ratios = []
            for k in range(4):
                for j in range(ny):
                    for i in range(nx):
                        a, b, c, d = (points[at(*p, k) - 1] for p in ((i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)))
                        u, v = [c[t] - a[t] for t in range(3)], [d[t] - b[t] for t in range(3)]
                        n = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]]
                        up = [sum(points[at(*p, k + 1) - 1][t] - points[at(*p, k) - 1][t]
                                  for p in ((i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1))) / 4 for t in range(3)]
                        ratios.append(sum(x * y for x, y in zip(n, up)) / math.hypot(*n) / (levels[k + 1] - levels[k]))
            return report, told, min(ratios), max(ratios)

        _, _, least, largest = heights("free.yaml")
        self.assertLess(least, 0.95)
        report, told, least, largest = heights("kept.yaml")
        self.assertGreater(least, 0.995)
        self.assertLess(largest, 1.005)
        (wall,) = report["constraints"]["residuals"]
        self.assertAlmostEqual(wall["least_height"], least, delta=1e-3)
        self.assertAlmostEqual(wall["largest_height"], largest, delta=1e-3)
        self.assertLess(wall["free_least_height"], 0.95)
        self.assertEqual(report["verdict"], "good")
        self.assertIn("heights of its layers: ", told)
        # A point above the wall that stays where it is while the wall moves, or the other way around, is told.
        self.write("kept.yaml", plate
                   .replace("max: [1.9, 2, 0]}}}]\n", "max: [1.9, 2, 0]}}}, {name: lifted, region: {ids: [%d]}}]\n" % (at(3, 2, 1) - 1))
                   .replace("fixed:\n", "fixed:\n  - {ids: [%d]}\n" % (at(3, 2, 0) - 1)) +
                   "  - {name: lift, handle: lifted, translate: [0, 0, 1]}\n" + keep)
        report, told, least, largest = heights("kept.yaml", "--set", "lift=5e-5")
        self.assertGreater(largest, 1.1)
        self.assertEqual(report["verdict"], "doubtful")
        self.assertTrue(any('the heights of the layers of "wall" are ' in reason for reason in report["reasons"]), report["reasons"])

    def test_few_iterations_are_reported(self):
        self.write("plate.obj", plate())
        stiff = CIRCLE.replace("circular", "weight: 1e10, circular")
        self.write("few.yaml", setup("{mls: {}}", f"{stiff}\nconstraint_options: {{iterations: 1, tolerance: 1e-12}}"))
        report, _ = self.apply("few.yaml", "--set", "pull=0.4", "--keep-bad", expect=4)
        self.assertEqual(report["verdict"], "bad")
        self.assertFalse(report["constraints"]["converged"])
        self.assertEqual(report["constraints"]["iterations"] - report["constraints"]["newton_steps"], 1)
        self.assertIn("constraints DID NOT CONVERGE in ", self.deform("apply", "few.yaml", "--set", "pull=0.4", "-o", "out.obj", expect=4).out)

    def test_tolerances_below_rounding_are_told(self):
        self.write("plate.obj", plate())
        self.write("least.yaml", setup("{mls: {}}", f"{CIRCLE}\nconstraint_options: {{tolerance: 1e-12}}"))
        self.write("plain.yaml", setup("{mls: {}}", CIRCLE))
        plain, _ = self.apply("plain.yaml", "--set", "pull=0.4")
        report, _ = self.apply("least.yaml", "--set", "pull=0.4")
        self.assertEqual(report["verdict"], "good", report)
        constraints = report["constraints"]
        self.assertNotEqual(constraints["converged"], constraints["at_rounding"])
        self.assertLess(constraints["iterations"], 200)
        self.assertAlmostEqual(constraints["energy"], plain["constraints"]["energy"], delta=1e-9)
        if constraints["at_rounding"]:
            self.assertIn("the tolerance of the constraints is less than rounding allows", " ".join(report["notes"]))

    def test_detected_primitives_are_kept(self):
        self.write("drum.obj", drum())
        found = self.deform("detect", "drum.obj", "-o", "drum.yaml", "--coloured", "drum.ply", "--json").json
        names = [primitive["name"] for primitive in found["primitives"]]
        self.assertEqual(sorted(names), ["cylinder_d1_1", "plane_z0_1", "plane_z2_1"])
        self.assertEqual(names[2], "cylinder_d1_1", "planes come first")
        self.assertAlmostEqual(found["primitives"][2]["radius"], 0.5, delta=1e-6)
        self.assertEqual([edge["constraint"] for edge in found["edges"]], ["circular", "circular"])
        self.assertEqual([edge["implied_by"] for edge in found["edges"]], [[], []])
        for edge in found["edges"]:
            self.assertIn("cylinder_d1_1", edge["lies_on"])
            self.assertEqual(len(edge["lies_on"]), 2)
        self.assertAlmostEqual(found["coverage"], 1, delta=1e-9)
        text = self.deform("detect", "drum.obj", "--coloured", "drum.vtp").out
        for name in names:
            self.assertIn(name, text)
        info = self.deform("inspect", "drum.ply", "--json").json
        original = self.deform("inspect", "drum.obj", "--json").json
        self.assertEqual((info["points"], info["faces"]), (original["points"], original["faces"]))

        # What the user does with the file: say what moves and what stays, take out what is not wanted.
        with open(self.path("drum.yaml")) as file:
            lines = file.read()
        self.assertIn("geometry: drum.obj\n", lines)
        start = lines.index("handles:")
        end = lines.index("constraints:")
        lines = lines[:start] + """\
handles: [{name: top, region: {half_space: {point: [0, 0, 1.99], normal: [0, 0, 1]}}}]
fixed: [{half_space: {point: [0, 0, 0.01], normal: [0, 0, -1]}}]
variables: [{name: shift, handle: top, translate: [0.3, 0, 0]}]
""" + lines[end:lines.index("  # ", lines.index("name: cylinder_d1_1"))]
        self.write("kept.yaml", lines)
        reply = self.deform("apply", "kept.yaml", "--set", "shift=1", "-o", "out.obj", "--json").json["report"]
        residuals = {entry["name"]: entry for entry in reply["constraints"]["residuals"]}
        self.assertEqual(sorted(residuals), sorted(names))
        self.assertLess(residuals["cylinder_d1_1"]["rms"], residuals["cylinder_d1_1"]["free_rms"])
        self.fails(1, "detect", "drum.obj", "--coloured", "drum.png", says=[".ply or .vtp"])


if __name__ == "__main__":
    main()

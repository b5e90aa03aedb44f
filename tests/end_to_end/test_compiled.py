# SPDX-License-Identifier: GPL-3.0-or-later
"""Deformations that are carried away: compile with a server, apply without; a second reader and evaluator of the file, written from
docs/compiled.md alone."""

import math
import os
import struct
import subprocess

from harness import AHMED_SETUP, EndToEnd, main, read_bytes, read_obj
from test_constraints import CIRCLE, plate, setup

COMPILED_ALONE = os.environ["COMPILED_ALONE_BIN"]
DESIGN = {"roof_up": 0.03, "slant_turn": 0.1}

LATTICE_SETUP = """\
geometry: ahmed.obj
method: {ffd: {lattice: {points: [8, 5, 5]}, control: CONTROLS}}
handles: [{name: top, region: {lattice: {k: [4, 4]}}}]
variables: [{name: grow, handle: top, scale: {centre: [0.5, 0, 0.3]}, lower: -0.2, upper: 0.2}]
"""


def settings(design):
    return [word for name, value in design.items() for word in ("--set", f"{name}={value}")]


def records(content):
    """(kind, basis, payload) of a compiled deformation."""
    assert content[:8] == b"\x89DEFORM\n"
    version, zero, size = struct.unpack_from("<2IQ", content, 8)
    assert (version, zero, size) == (1, 0, len(content))
    at, found = 24, []
    while at < len(content):
        kind, basis, count, _ = struct.unpack_from("<4sIQQ", content, at)
        found.append((kind.decode(), basis, content[at + 24:at + 24 + count]))
        at += 24 + (count + 7) // 8 * 8
    return found


class SecondReader:
    """One basis, held points, no symmetry: what the page says about such a file, in plain loops."""

    def __init__(self, path):
        with open(path, "rb") as file:
            found = records(file.read())
        assert found[0][0] == "HEAD" and found[-1][0] == "ENDS"
        head = found[0][2]
        flags, handles, variables, bases, planes, driven = struct.unpack_from("<6I", head, 0)
        assert (bases, planes) == (1, 0) and flags & 2
        self.points, self.following = struct.unpack_from("<2Q", head, 24)
        (self.scale, *self.origin) = struct.unpack_from("<4d", head, 24 + 48 + 32 + 40)
        self.geometry_id = head[-128:-96].hex()
        arrays = {}
        self.handles, self.variables, self.also, self.texts = [], [], [], {}
        for kind, _, payload in found[1:-1]:
            if kind == "TEXT":
                key = 4 + struct.unpack_from("<I", payload)[0]
                self.texts[payload[4:key].decode()] = payload[key:].decode()
            elif kind == "HAND":
                self.handles.append(struct.unpack_from("<12d", payload, 8))
            elif kind == "VARI":
                self.variables.append((*struct.unpack_from("<2I9d", payload, 0), payload[80:].decode()))
            elif kind == "ALSO":
                variable, _, *numbers = struct.unpack("<4I7d", payload)
                self.also.append((variable, *numbers))
            else:
                assert struct.unpack_from("<Q", payload)[0] * {"REST": 24, "FLDS": 8, "REGI": 4}.get(kind, 0) in (
                    0, len(arrays.get(kind, b"")))
                arrays[kind] = arrays.get(kind, b"") + payload[8:]
        assert (len(self.handles), len(self.variables), len(self.also)) == (handles, variables, driven)
        self.rest = list(struct.iter_unpack("<3d", arrays["REST"]))
        self.regions = struct.unpack(f"<{self.points}I", arrays["REGI"])
        self.fields = struct.unpack(f"<{len(arrays['FLDS']) // 8}d", arrays["FLDS"])

    @staticmethod
    def map_of(kind, vector, centre, v):
        """A and b of x -> A x + b."""
        if kind == 0:
            return [[float(i == j) for j in range(3)] for i in range(3)], [v * d for d in vector]
        length = math.hypot(*vector)
        a = [x / length for x in vector] if length else vector
        if kind == 1:
            c, s = math.cos(v), math.sin(v)
            K = [[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]]
            A = [[c * (i == j) + s * K[i][j] + (1 - c) * a[i] * a[j] for j in range(3)] for i in range(3)]
        else:
            A = [[(i == j) + v * (a[i] * a[j] if length else float(i == j)) for j in range(3)] for i in range(3)]
        return A, [centre[i] - sum(A[i][j] * centre[j] for j in range(3)) for i in range(3)]

    def evaluate(self, values):
        maps = [([[float(i == j) for j in range(3)] for i in range(3)], [0.0] * 3) for _ in self.handles]
        motions = [(k, handle, kind, numbers[0:6], numbers[8]) for k, (handle, kind, *numbers) in enumerate(self.variables)]
        motions += [(k, handle, kind, numbers[0:6], numbers[6]) for k, handle, kind, *numbers in self.also]
        for k, handle, kind, numbers, unit in sorted(motions):
            A, b = self.map_of(kind, numbers[0:3], numbers[3:6], values[k] * unit)
            M, t = maps[handle]
            maps[handle] = ([[sum(A[i][k] * M[k][j] for k in range(3)) for j in range(3)] for i in range(3)],
                            [b[i] + sum(A[i][k] * t[k] for k in range(3)) for i in range(3)])
        coefficients = []
        for (A, b), frame in zip(maps, self.handles):
            J = [[A[i][j] - (i == j) for j in range(3)] for i in range(3)]
            c = [self.origin[k] + self.scale * frame[k] for k in range(3)]
            coefficients.append([sum(J[i][j] * c[j] for j in range(3)) + b[i] for i in range(3)])
            for axis in (frame[3:6], frame[6:9], frame[9:12]):
                coefficients.append([self.scale * sum(J[i][j] * axis[j] for j in range(3)) for i in range(3)])
        points, s = [], 0
        for x, region in zip(self.rest, self.regions):
            if region == 0xFFFFFFFF:
                first = (s // 16 * len(coefficients)) * 16 + s % 16
                points.append(tuple(x[k] + sum(self.fields[first + 16 * f] * row[k] for f, row in enumerate(coefficients))
                                    for k in range(3)))
                s += 1
            elif region == 0xFFFFFFFE:
                points.append(x)
            else:
                A, b = maps[region]
                points.append(tuple(sum(A[i][j] * x[j] for j in range(3)) + b[i] for i in range(3)))
        return points


class Compiled(EndToEnd):
    def setUp(self):
        super().setUp()
        self.start_server()
        self.deform("sample", "-o", "ahmed.obj", "--points", 2000)
        self.write("setup.yaml", AHMED_SETUP)

    def compile(self, setup="setup.yaml", output="car.deformation"):
        return self.deform("compile", setup, "-o", output, "--json").json

    def test_a_mirrored_handle_is_doubtful_wherever_it_is_computed(self):
        self.write("scaled.yaml", AHMED_SETUP + "  - {name: high, handle: roof, scale: {centre: [0, 0, 0], axis: [0, 0, 1]}}\n")
        self.compile("scaled.yaml")
        for value, word, determinant in ((-2.5, "mirrored", "-1.5"), (-1, "flattened", "0")):
            reports = [self.deform("apply", what, "--set", f"high={value}", "-o", "out.obj", "--json").json["report"]
                       for what in ("scaled.yaml", "car.deformation")]
            self.assertIn(f'handle "roof" is {word} by high = {value}: its linear map has determinant {determinant}', reports[0]["reasons"])
            for report in reports:
                self.assertEqual((report["verdict"], report["reasons"]), (reports[0]["verdict"], reports[0]["reasons"]))
        fine = self.deform("apply", "scaled.yaml", "--set", "high=0.1", "-o", "out.obj", "--json").json["report"]
        self.assertEqual(fine["verdict"], "good")

    def test_points_that_have_strayed_are_judged_as_by_the_server(self):
        lines = open(self.path("ahmed.obj")).read().splitlines(keepends=True)
        last = max(i for i, line in enumerate(lines) if line.startswith("v "))
        told = set()
        for far in ("1e4", "2e6", "1e15"):
            self.write("ahmed.obj", "".join(lines[:last + 1] + [f"v {far} 0 0\n"] + lines[last + 1:]))
            self.write("held.yaml", AHMED_SETUP.replace("TRIHARMONIC", "BIHARMONIC"))
            for setup in ("setup.yaml", "held.yaml"):
                self.compile(setup)
                served, applied = (self.deform("apply", what, "--set", "roof_up=0.03", "-o", "out.obj", "--check", "off", "--keep-bad", "--json",
                                               expect=None).json["report"] for what in (setup, "car.deformation"))
                for key in ("verdict", "reasons", "reasons_of_verdict"):
                    self.assertEqual(applied.get(key), served.get(key), (far, setup, key))
                self.assertEqual(any("most points lie within" in reason for reason in applied["reasons"]), far != "1e4", applied)
                told.add(applied["verdict"])
        self.assertEqual(told, {"doubtful", "bad"})

    def test_fewer_centres_than_points_are_told_wherever_it_is_computed(self):
        self.write("rings.yaml", AHMED_SETUP.replace("TRIHARMONIC", "TRIHARMONIC, reduction: REDUCTION_RINGS, reduction_rings: 3"))
        self.compile("rings.yaml")
        reports = [self.deform("apply", what, "--set", "roof_up=0.03", "-o", "out.obj", "--json").json["report"]
                   for what in ("rings.yaml", "car.deformation")]
        for report in reports:
            self.assertEqual(report["verdict"], "doubtful")
            self.assertIn("not all handle and fixed points are centres", " ".join(report["reasons"]))
            self.assertGreater(report["reduction_error"], 0.01 * 0.03)
            for key in ("reasons", "reduction_error"):
                self.assertEqual(report[key], reports[0][key])
        self.fails(4, "apply", "rings.yaml", "--set", "roof_up=0.03", "-o", "out.obj", "--fail-on", "reduction_error>1e-5",
                   says=["reduction_error"], prints=True)
        self.assertIn("not all handle and fixed points are centres", self.deform("apply", "rings.yaml", "--set", "roof_up=0.03", "-o", "out.obj").out)
        self.write("probes.csv", "x,y,z\n0.5,0,0.2\n")
        evaluate = ("evaluate", "rings.yaml", "probes.csv", "--set", "roof_up=0.03", "-o", "moved.csv")
        elsewhere = self.deform(*evaluate, "--json").json
        self.assertEqual(elsewhere["reduction_error"], reports[0]["reduction_error"])
        self.assertEqual(elsewhere["doubts"], reports[0]["reasons"])
        printed = self.deform(*evaluate).out
        self.assertIn("with all, points might be up to about", printed)
        self.assertIn("doubtful: not all handle and fixed points are centres", printed)
        whole = self.deform("evaluate", "setup.yaml", "probes.csv", "--set", "roof_up=0.03", "-o", "moved.csv", "--json").json
        self.assertEqual((whole["reduction_error"], whole["doubts"]), (0, []))

    def test_the_file_is_what_the_server_computes(self):
        compiled = self.compile()
        self.assertEqual(compiled["bytes"], os.path.getsize(self.path("car.deformation")))
        self.assertEqual([v["name"] for v in compiled["variables"]], ["roof_up", "slant_turn"])
        self.assertEqual(compiled["mesh"], "ahmed.obj")
        served = self.deform("apply", "setup.yaml", *settings(DESIGN), "-o", "served.obj", "--json").json["report"]
        again = self.path("again.deformation")
        self.compile(output=again)
        self.assertEqual(read_bytes(again), read_bytes(self.path("car.deformation")))
        self.assertFalse(os.path.exists(again + ".part"))
        self.server.stop()
        applied = self.deform("apply", "car.deformation", *settings(DESIGN), "-o", "out.obj", "--json").json
        self.assertEqual(applied["encoding"], "none")
        for name in ("max_displacement", "prescribed_displacement", "verdict", "reasons", "faces", "path"):
            self.assertEqual(applied["report"].get(name), served.get(name), name)
        self.assertAlmostEqual(applied["report"]["estimated_error"], served["estimated_error"], delta=1e-12 * served["estimated_error"])
        points, rest = read_obj(self.path("out.obj"))
        right, right_rest = read_obj(self.path("served.obj"))
        self.assertEqual(rest, right_rest)
        worst = max(max(abs(a - b) for a, b in zip(p, q)) for p, q in zip(points, right))
        self.assertLessEqual(worst, 1e-14 * 1.2)

        # The evaluator that is linked with nothing has the same bits as the command, and a second one the same points.
        done = subprocess.run([COMPILED_ALONE, self.path("car.deformation"), self.path("alone"), "0.03", "0.1"], timeout=60)
        self.assertEqual(done.returncode, 0)
        alone = list(struct.iter_unpack("<3d", read_bytes(self.path("alone"))))
        self.assertEqual(alone, points)
        second = SecondReader(self.path("car.deformation"))
        self.assertEqual(second.geometry_id, compiled["geometry_id"])
        self.assertEqual(second.texts["method"], "rbf")
        self.assertEqual([v[-1] for v in second.variables], ["roof_up", "slant_turn"])
        worst = max(max(abs(a - b) for a, b in zip(p, q)) for p, q in zip(second.evaluate([0.03, 0.1]), points))
        self.assertLessEqual(worst, 1e-14 * 1.2)

    def test_variables_in_degrees_and_of_several_handles(self):
        self.write("setup.yaml", AHMED_SETUP.replace("lower: -0.05,", "lower: -0.05, also: [{handle: slant}],").replace(
            "centre: [0.843, 0, 0.338]}, lower: -0.2, upper: 0.2",
            "centre: [0.843, 0, 0.338], unit: DEGREES}, lower: -12, upper: 12,"
            " also: [{handle: roof, scale: {centre: [0.5, 0, 0.3]}}]"))
        self.compile()
        self.deform("apply", "setup.yaml", "--set", "roof_up=0.03", "--set", "slant_turn=7", "-o", "served.obj")
        self.deform("apply", "car.deformation", "--set", "roof_up=0.03", "--set", "slant_turn=7", "-o", "out.obj")
        points, right = read_obj(self.path("out.obj"))[0], read_obj(self.path("served.obj"))[0]
        self.assertNotEqual(points, read_obj(self.path("ahmed.obj"))[0])
        self.assertLessEqual(max(max(abs(a - b) for a, b in zip(p, q)) for p, q in zip(points, right)), 1e-14 * 1.2)
        second = SecondReader(self.path("car.deformation"))
        self.assertEqual([(k, handle) for k, handle, *_ in second.also], [(0, 0), (1, 1)])
        worst = max(max(abs(a - b) for a, b in zip(p, q)) for p, q in zip(second.evaluate([0.03, 7]), points))
        self.assertLessEqual(worst, 1e-13 * 1.2)  # the roof grows to eight times its size

    def test_other_methods(self):
        self.write("lattice.yaml", LATTICE_SETUP)
        self.deform("compile", "lattice.yaml", "-o", "lattice.deformation")
        self.deform("apply", "lattice.yaml", "--set", "grow=0.1", "-o", "served.obj")
        self.deform("apply", "lattice.deformation", "--set", "grow=0.1", "-o", "out.obj")
        points, right = read_obj(self.path("out.obj"))[0], read_obj(self.path("served.obj"))[0]
        self.assertNotEqual(points, read_obj(self.path("ahmed.obj"))[0])
        self.assertLessEqual(max(max(abs(a - b) for a, b in zip(p, q)) for p, q in zip(points, right)), 1e-14 * 1.2)

    def test_the_mesh_is_that_of_the_setup(self):
        """Not the file of the same points that was registered first, whose name the server knows."""
        self.compile()
        with open(self.path("ahmed.obj")) as file:
            self.write("copy.obj", "# a copy\n" + file.read())
        self.write("copy.yaml", AHMED_SETUP.replace("ahmed.obj", "copy.obj"))
        compiled = self.compile("copy.yaml", "copy.deformation")
        self.assertEqual(compiled["mesh"], "copy.obj")
        self.assertEqual(compiled["bytes"], os.path.getsize(self.path("copy.deformation")))
        self.deform("apply", "copy.deformation", *settings(DESIGN), "-o", "out.obj")
        with open(self.path("out.obj")) as file:
            self.assertEqual(file.readline(), "# a copy\n")

    def test_a_basis_to_a_tolerance_is_small(self):
        self.write("small.yaml", AHMED_SETUP.replace("kernel: TRIHARMONIC", "kernel: TRIHARMONIC, basis_tolerance: 1e-6"))
        plain, small = self.compile()["bytes"], self.compile("small.yaml", "small.deformation")["bytes"]
        self.assertLess(small, 0.8 * plain)
        served = self.deform("apply", "small.yaml", *settings(DESIGN), "-o", "served.obj", "--json").json["report"]
        applied = self.deform("apply", "small.deformation", *settings(DESIGN), "-o", "out.obj", "--json").json["report"]
        self.assertGreater(applied["estimated_error"], 1e-12)
        self.assertAlmostEqual(applied["estimated_error"], served["estimated_error"], delta=1e-12 * served["estimated_error"])
        points, right = read_obj(self.path("out.obj"))[0], read_obj(self.path("served.obj"))[0]
        self.assertLessEqual(max(max(abs(a - b) for a, b in zip(p, q)) for p, q in zip(points, right)), 1e-14 * 1.2)

    def test_what_cannot_be_compiled_says_why(self):
        self.write("never.yaml", AHMED_SETUP.replace("kernel: TRIHARMONIC", "kernel: TRIHARMONIC, basis: BASIS_NEVER"))
        self.fails(1, "compile", "never.yaml", "-o", "car.deformation", says=["cannot be compiled", "BASIS_ALWAYS"])
        self.write("plate.obj", plate())
        self.write("constrained.yaml", setup("{shell: {}}", CIRCLE))
        self.fails(1, "compile", "constrained.yaml", "-o", "car.deformation", says=["cannot be compiled", "constraints"])
        self.write("fixed.yaml", AHMED_SETUP[:AHMED_SETUP.index("variables:")])
        self.fails(1, "compile", "fixed.yaml", "-o", "car.deformation", says=["cannot be compiled", "no design variables"])
        self.assertEqual(self.deform("list", "systems", "--json").json["systems"], [], "nothing was prepared for this")
        self.assertEqual([name for name in os.listdir(self.folder) if "car.deformation" in name], [])

    def test_commands_that_take_setups_say_what_a_compiled_deformation_is(self):
        self.compile()
        self.write("designs.csv", "roof_up\n0.01\n")
        self.fails(1, "sweep", "car.deformation", "--designs", "designs.csv", "-o", "out", says=["compiled deformation", "deform apply", "deformd.load"])
        self.fails(1, "prepare", "car.deformation", says=["is a compiled deformation"])

    def test_direct_manipulation_is_judged_as_by_the_server(self):
        for number, (points, clamp, verdict) in enumerate((([9, 8, 7], "0", "good"), ([4, 4, 4], "0.3", "bad"))):
            self.write("lattice.yaml", AHMED_SETUP.replace("{rbf: {kernel: TRIHARMONIC}}", f"{{ffd: {{control: MESH, clamp: {clamp}, lattice: {{points: {points}}}}}}}"))
            self.compile("lattice.yaml", f"lattice{number}.deformation")
            reports = [self.deform("apply", name, "--set", "roof_up=0.02", "-o", "x.obj", "--keep-bad", "--json", expect=None).json["report"]
                       for name in ("lattice.yaml", f"lattice{number}.deformation")]
            for report in reports:
                self.assertEqual(report["verdict"], verdict, report)
            self.assertEqual(reports[0]["reasons"], reports[1]["reasons"])

    def test_apply_checks_file_mesh_and_options(self):
        self.compile()
        self.server.stop()
        apply = ["apply", "car.deformation"]
        self.fails(1, *apply, "--set", "roof_up=0.06", "-o", "out.obj", says=["roof_up", "0.06", "[-0.05, 0.05]"])
        self.fails(1, *apply, "--set", "roof=0.06", "-o", "out.obj", says=["did you mean", "roof_up"])
        self.fails(1, *apply, "-o", "ahmed.obj", says=["would replace the source mesh"])
        self.fails(1, *apply, "--motions", "m.csv", "-o", "out.obj", says=["--motions", "apply the setup file"])
        self.fails(1, *apply, "--split", "uniform", "-o", "out.obj", says=["--split"])
        self.deform("sample", "-o", "other.obj", "--points", 2500)
        self.fails(1, *apply, "--source", "other.obj", "-o", "out.obj", says=["holds geometry", "was compiled for"])
        os.rename(self.path("ahmed.obj"), self.path("moved.obj"))
        self.fails(1, *apply, "-o", "out.obj", says=["ahmed.obj is not beside it", "--source"])
        self.deform(*apply, "--mesh", "moved.obj", *settings(DESIGN), "-o", "out.obj")
        result = self.fails(4, *apply, "--mesh", "moved.obj", *settings(DESIGN), "-o", "out.obj", "--json", "--fail-on",
                            "max_displacement>0.01", prints=True)
        self.assertIn("max_displacement>0.01", result.err)
        content = bytearray(read_bytes(self.path("car.deformation")))
        content[len(content) // 2] ^= 1
        with open(self.path("bad.deformation"), "wb") as file:
            file.write(content)
        self.fails(1, "apply", "bad.deformation", "-o", "out2.obj", says=["checksum"])
        self.assertFalse(os.path.exists(self.path("out2.obj")))


if __name__ == "__main__":
    main()

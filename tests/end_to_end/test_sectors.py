# SPDX-License-Identifier: GPL-3.0-or-later
"""A blade passage as an OpenFOAM case with rotational cyclic patches, through the real programs: the patches stay periodic."""

import json
import math
import os
import re
import shutil
import subprocess

from harness import EndToEnd, main

HEADER = 'FoamFile {{ version 2.0; format ascii; class {kind}; location "constant/polyMesh"; object {name}; }}\n'
SETUP = """\
geometry: case
symmetry: [{sector: {axis: [0, 0, 1], count: COUNT, periodic: [{group: low}, {group: high}]}}]
handles: [{name: blade, region: {difference: [{group: blade}, {group: hub}, {group: casing}]}}]
fixed: [{group: hub}, {group: casing}, {group: inlet}, {group: outlet}]
variables:
  - {name: lift, handle: blade, translate: [0, 1, 0], lower: -0.05, upper: 0.05}
  - {name: stagger, handle: blade, rotate: {axis: [1, 0, 0], centre: [0.7, 0, 0.4]}, lower: -0.3, upper: 0.3}
"""


class Passage:
    """Hexahedra in one of `count` passages of a wheel about the z axis, around a bent blade, which is a hole."""

    def __init__(self, count, around=12, outwards=6, along=16):
        self.count, self.size = count, (around, outwards, along)
        self.pitch = 2 * math.pi / count
        solid = {(i, j, k) for i in (around // 2 - 1, around // 2) for j in range(outwards) for k in range(5, 11)}
        cells = [c for c in ((i, j, k) for k in range(along) for j in range(outwards) for i in range(around)) if c not in solid]
        number = {c: n for n, c in enumerate(cells)}
        self.points, self.ids, faces = [], {}, {}
        for c in cells:
            for corners, side in self.sides(c):
                faces.setdefault(frozenset(corners), []).append((number[c], corners, c, side))
        internal, patches = [], {name: [] for name in ("low", "high", "hub", "casing", "inlet", "outlet", "blade")}
        for of_face in faces.values():
            of_face.sort()
            owner, corners, c, side = of_face[0]
            if len(of_face) == 2:
                internal.append((owner, of_face[1][0], corners))
            else:
                patches[self.patch(c, side)].append((owner, corners, c))
        internal.sort()
        # Partners of cyclic patches are in the same order, and so are their first points.
        for name in ("low", "high"):
            patches[name].sort(key=lambda f: f[2][1:])
        self.internal, self.patches, self.cells = internal, patches, len(cells)

    def place(self, i, j, k):
        around, outwards, along = self.size
        z, r = 0.8 * k / along, 0.4 + 0.6 * j / outwards
        angle = self.pitch * ((i / around - 0.5) + 0.5 * math.sin(3 * z) - 0.3 * r)
        return (r * math.cos(angle), r * math.sin(angle), z)

    def id(self, *at):
        if at not in self.ids:
            self.ids[at] = len(self.points)
            self.points.append(self.place(*at))
        return self.ids[at]

    def sides(self, cell):
        i, j, k = cell
        p = lambda a, b, c: self.id(i + a, j + b, k + c)
        # Outwards, around and along are right-handed; normals lead out.
        yield [p(0, 0, 0), p(0, 1, 0), p(0, 1, 1), p(0, 0, 1)], "low"
        yield [p(1, 0, 0), p(1, 0, 1), p(1, 1, 1), p(1, 1, 0)], "high"
        yield [p(0, 0, 0), p(0, 0, 1), p(1, 0, 1), p(1, 0, 0)], "hub"
        yield [p(0, 1, 0), p(1, 1, 0), p(1, 1, 1), p(0, 1, 1)], "casing"
        yield [p(0, 0, 0), p(1, 0, 0), p(1, 1, 0), p(0, 1, 0)], "inlet"
        yield [p(0, 0, 1), p(0, 1, 1), p(1, 1, 1), p(1, 0, 1)], "outlet"

    def patch(self, cell, side):
        ends = {"low": (0, 0), "high": (0, self.size[0] - 1), "hub": (1, 0), "casing": (1, self.size[1] - 1),
                "inlet": (2, 0), "outlet": (2, self.size[2] - 1)}
        axis, last = ends[side]
        return side if cell[axis] == last else "blade"

    def pairs(self):
        around, outwards, along = self.size
        return [(self.ids[0, j, k], self.ids[around, j, k]) for j in range(outwards + 1) for k in range(along + 1)]

    def turned(self, x):
        c, s = math.cos(self.pitch), math.sin(self.pitch)
        return (c * x[0] - s * x[1], s * x[0] + c * x[1], x[2])

    def write(self, folder):
        mesh = os.path.join(folder, "constant", "polyMesh")
        os.makedirs(mesh)
        os.makedirs(os.path.join(folder, "system"))
        faces = [f[2] for f in self.internal]
        owner, neighbour = [f[0] for f in self.internal], [f[1] for f in self.internal]
        boundary = []
        for name, patch in self.patches.items():
            extra = "type wall;" if name in ("hub", "casing", "blade") else "type patch;"
            if name in ("low", "high"):
                other = "high" if name == "low" else "low"
                extra = (f"type cyclic; neighbourPatch {other}; transform rotational; rotationAxis (0 0 1); "
                         "rotationCentre (0 0 0); matchTolerance 1e-4;")
            boundary.append(f"{name} {{ {extra} nFaces {len(patch)}; startFace {len(faces)}; }}\n")
            # The first corner of both partners is the same one: faces of the second start there and go the other way round.
            faces += [f[1] for f in patch]
            owner += [f[0] for f in patch]

        def put(name, kind, entries):
            with open(os.path.join(mesh, name), "w") as file:
                file.write(HEADER.format(kind=kind, name=name) + f"{len(entries)}\n(\n" + "".join(entries) + ")\n")

        put("points", "vectorField", [f"({x[0]!r} {x[1]!r} {x[2]!r})\n" for x in self.points])
        put("faces", "faceList", [f"4({f[0]} {f[1]} {f[2]} {f[3]})\n" for f in faces])
        put("owner", "labelList", [f"{c}\n" for c in owner])
        put("neighbour", "labelList", [f"{c}\n" for c in neighbour])
        put("boundary", "polyBoundaryMesh", boundary)
        for name, text in (("controlDict", "startFrom latestTime; startTime 0; stopAt endTime; endTime 1; deltaT 1; writeControl "
                                           "timeStep; writeInterval 1; writeFormat ascii; writePrecision 17; timePrecision 6;"),
                           ("fvSchemes", "ddtSchemes {} gradSchemes {} divSchemes {} laplacianSchemes {}"), ("fvSolution", "")):
            with open(os.path.join(folder, "system", name), "w") as file:
                file.write(f"FoamFile {{ version 2.0; format ascii; class dictionary; object {name}; }}\n{text}\n")
        open(os.path.join(folder, "case.foam"), "w").close()


def read_points(path):
    with open(path) as file:
        text = file.read()
    return [tuple(map(float, match)) for match in re.findall(r"\(([-+.\deE]+) ([-+.\deE]+) ([-+.\deE]+)\)", text)]


class Sectors(EndToEnd):
    def setUp(self):
        super().setUp()
        self.start_server()

    def check_mesh(self, time):
        if shutil.which("checkMesh") is None:
            print("without OpenFOAM: its checkMesh is not asked")
            return
        environment = {"WM_PROJECT_DIR": "/usr/share/openfoam", **os.environ}
        done = subprocess.run(["checkMesh", "-case", self.path("case"), "-time", time], env=environment, timeout=120,
                              stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        self.assertIn("Mesh OK", done.stdout, done.stdout[-3000:])

    def test_cyclic_patches_stay_cyclic(self):
        for count in (6, 36):
            passage = Passage(count)
            shutil.rmtree(self.path("case"), ignore_errors=True)
            passage.write(self.path("case"))
            self.check_mesh("0")
            self.write("setup.yaml", SETUP.replace("COUNT", str(count)))
            said = self.deform("prepare", "setup.yaml", "--json").json
            self.assertIn(f"Sector: one of {count}; {len(passage.pairs())} pairs of points", json.dumps(said))
            lift = min(0.4 / count, 0.05)
            reply = self.deform("apply", "setup.yaml", "--set", f"lift={lift}", "--set", "stagger=0.1", "-o", "case/1", "--json").json
            self.assertEqual(reply["report"]["verdict"], "good", reply)
            moved = read_points(self.path("case/1/polyMesh/points"))
            self.assertEqual(len(moved), len(passage.points))
            farthest = max(math.dist(moved[low], passage.points[low]) for low, _ in passage.pairs())
            self.assertGreater(farthest, 1e-3, "the periodic boundaries follow the blade")
            for low, high in passage.pairs():
                self.assertLess(math.dist(moved[high], passage.turned(moved[low])), 1e-14)
            self.check_mesh("1")

    def test_what_is_not_periodic_is_found_before_it_is_prepared(self):
        passage = Passage(12)
        low, high = passage.pairs()[40]
        passage.points[high] = tuple(x + 1e-4 for x in passage.points[high])
        passage.write(self.path("case"))
        self.write("setup.yaml", SETUP.replace("COUNT", "12"))
        self.fails(1, "prepare", "setup.yaml", "--check", says=["symmetry[0].sector.periodic[0]", f"point {low} has no partner"])
        self.write("setup.yaml", SETUP.replace("COUNT", "12").replace(", periodic: [{group: low}, {group: high}]", ""))
        self.fails(1, "prepare", "setup.yaml", "--check", says=["symmetry[0].sector", "has no partner"])
        self.write("setup.yaml", SETUP.replace("COUNT", "13"))
        self.fails(1, "prepare", "setup.yaml", "--check", says=["periodic[0]", "turned by 27.6923 degrees"])


if __name__ == "__main__":
    main()

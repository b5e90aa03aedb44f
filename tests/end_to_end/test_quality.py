# SPDX-License-Identifier: GPL-3.0-or-later
"""`deform quality` on surfaces and volumes: table, gates, page, files for ParaView. No server."""

import base64
import gzip
import math
import os
import re
import shutil
import struct
import subprocess

from harness import AHMED_SETUP, SHARED_DATA, EndToEnd, main, read_bytes

HEXAHEDRA = """MeshVersionFormatted 2
Dimension 3
Vertices 12
{points}
Quadrilaterals 2
1 4 5 2 7
2 5 6 3 7
Hexahedra 2
1 2 5 4 7 8 11 10 1
2 3 6 5 8 9 12 11 1
End
"""


def hexahedra(height, shear=0.0):
    points = [(i + shear * k * height, j, k * height) for k in range(2) for j in range(2) for i in range(3)]
    return HEXAHEDRA.format(points="\n".join(f"{x!r} {y!r} {z!r} 0" for x, y, z in points))


def bump(path, out):
    """The roof of the Ahmed body rises."""
    with open(path) as source, open(out, "w") as target:
        for line in source:
            if line.startswith("v "):
                x, y, z = map(float, line.split()[1:4])
                z += 0.1 * math.exp(-((x - 0.5) / 0.15) ** 2) * max(0, z - 0.15)
                line = f"v {x!r} {y!r} {z!r}\n"
            target.write(line)


class Quality(EndToEnd):
    def ahmed(self):
        self.deform("sample", "-o", "ahmed.obj")
        bump(self.path("ahmed.obj"), self.path("out.obj"))
        self.write("ahmed.yaml", AHMED_SETUP)

    def test_surface_before_and_after(self):
        self.ahmed()
        reply = self.deform("quality", "out.obj", "--before", "ahmed.obj", "--setup", "ahmed.yaml", "--json").json
        self.assertEqual([name for name, value in reply.items() if name.endswith("_faces") and not isinstance(value, int)], [])
        self.assertIsInstance(reply["flipped_faces"], int)
        self.assertEqual(reply["flipped_faces"], 0)
        self.assertEqual(reply["degenerate_faces"], 0)
        self.assertGreater(reply["displacement"], 0.01)
        self.assertGreater(reply["mean_curvature"], 0)
        self.assertGreater(reply["border_edges"], 100)
        self.assertGreater(reply["curvature_jump_growth"], 0)
        self.assertLess(reply["normal_jump_growth"], 10)
        self.assertEqual(sum(reply["histogram"]), reply["faces"])
        self.assertNotIn("displacement", reply["before"])
        self.assertAlmostEqual(reply["before"]["total_area"], self.deform("quality", "ahmed.obj", "--json").json["total_area"])
        text = self.deform("quality", "out.obj", "--before", "ahmed.obj").out
        self.assertRegex(text, r"quality of a face 2r/R, least +0\.\d+ +0\.\d+ +\(\d+\)")
        self.assertRegex(text, r"displacement of a point, largest +- +0\.\d+")

    def test_gates(self):
        self.ahmed()
        self.deform("quality", "out.obj", "--before", "ahmed.obj", "--fail-on", "flipped_faces>0", "--fail-on", "least_angle<5")
        self.fails(4, "quality", "out.obj", "--fail-on", "face_quality<0.9", "--html", "failed.html",
                   says=["out.obj: face_quality<0.9: it is 0."], prints=True)
        self.assertIn("class=\"bad\">failed: face_quality&lt;0.9", read_bytes(self.path("failed.html")).decode())
        self.fails(2, "quality", "out.obj", "--fail-on", "flipped_faces>0", says=["flipped_faces is measured with --before"])
        self.fails(2, "quality", "out.obj", "--fail-on", "wall_height<1e-3", says=["wall_height is measured with --wall"])
        self.fails(2, "quality", "out.obj", "--fail-on", "flipped>0", says=["there is no measure \"flipped\""])
        self.fails(2, "quality", "out.obj", "--fail-on", "least_angle", says=["--fail-on least_angle", "NAME>NUMBER"])

    def test_flips_and_other_meshes(self):
        self.write("flat.obj", "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3\nf 1 3 4\n")
        self.write("turned.obj", "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 2 0 0\nf 1 2 3\nf 1 3 4\n")
        reply = self.deform("quality", "turned.obj", "--before", "flat.obj", "--json").json
        self.assertEqual((reply["flipped_faces"], reply["flipped"]), (1, [1]))
        self.write("other.obj", "v 0 0 0\nv 1 0 0\nv 1 1 0\nf 1 2 3\n")
        reply = self.deform("quality", "other.obj", "--before", "flat.obj", "--json").json
        self.assertNotIn("flipped_faces", reply)
        self.assertIn("differ", reply["notes"][0])
        self.write("points.obj", "v 0 0 0\n")
        self.fails(1, "quality", "points.obj", says=["points.obj", "no faces"])
        self.write("block.mesh", hexahedra(0.5))
        self.fails(1, "quality", "block.mesh", "--before", "flat.obj", says=["flat.obj", "not the kind of mesh"])

    def test_walls_of_elements(self):
        self.write("before.mesh", hexahedra(0.5))
        self.write("after.mesh", hexahedra(0.25, 1.0))
        group = next(g["name"] for g in self.deform("inspect", "before.mesh", "--json").json["groups"] if g["faces"] == 2)
        reply = self.deform("quality", "after.mesh", "--before", "before.mesh", "--wall", group, "--json").json
        self.assertEqual(reply["wall_faces"], 2)
        for name in ("wall_height", "average_wall_height", "largest_wall_height"):
            self.assertAlmostEqual(reply[name], 0.25)
            self.assertAlmostEqual(reply["before"][name], 0.5)
        for name in ("wall_angle", "average_wall_angle", "least_wall_angle"):
            self.assertAlmostEqual(reply[name], 45)
            self.assertAlmostEqual(reply["before"][name], 0)
        self.fails(4, "quality", "after.mesh", "--wall", group, "--fail-on", "wall_height<0.3", says=["it is 0.25"], prints=True)
        self.fails(1, "quality", "after.mesh", "--wall", "nothing", says=["--wall nothing", "no such group", group])
        self.write("flat.obj", "v 0 0 0\nv 1 0 0\nv 1 1 0\nf 1 2 3\n")
        self.fails(1, "quality", "flat.obj", "--wall", "roof", says=["is a surface"])

    def test_page(self):
        self.ahmed()
        evil = "<script>alert(1)<script>&'.obj"
        os.rename(self.path("out.obj"), self.path(evil))
        self.deform("quality", evil, "--before", "ahmed.obj", "--html", "report.html")
        page = read_bytes(self.path("report.html")).decode()
        self.assertNotIn("<script>alert", page)
        self.assertIn("&lt;script&gt;alert(1)&lt;script&gt;&amp;&#39;.obj", page)
        self.assertNotRegex(page, r"https?:")
        data = {name: base64.b64decode(text)
                for name, text in re.findall(r'<script type="text/plain" id="([\w-]+)"[^>]*>([^<]*)</script>', page)}
        triangles = len(data["data-edges"])
        self.assertEqual(len(data["data-corners"]), 12 * triangles)
        corners = struct.unpack(f"<{3 * triangles}I", data["data-corners"])
        self.assertLess(max(corners), len(data["data-points"]) // 12)
        self.assertEqual(len(data["data-points"]), len(data["data-before"]))
        self.assertNotEqual(data["data-points"], data["data-before"])
        labels = re.findall(r'data-field="([^"]+)"', page)
        self.assertEqual(labels, ["quality of faces 2r/R", "mean curvature", "displacement"])
        self.assertEqual(page.count("data-at="), 40, "20 faces, 20 points")
        if shutil.which("node") is None:
            print("without node: the script of the page is not parsed")
            return
        script = re.search(r"<script>\n(.*?)</script>", page, re.S).group(1)
        self.write("page.js", script)
        subprocess.run(["node", "--check", self.path("page.js")], check=True)

    def test_files_for_paraview(self):
        self.ahmed()
        self.deform("quality", "out.obj", "--before", "ahmed.obj", "--vtp", "out.vtp")
        content = read_bytes(self.path("out.vtp"))
        for part in (b'type="PolyData"', b'header_type="UInt64"', b'Name="displacement" NumberOfComponents="3"',
                     b'Name="mean_curvature"', b'Name="face_quality"'):
            self.assertIn(part, content)
        self.write("block.mesh", hexahedra(0.5))
        self.deform("quality", "block.mesh", "--vtu", "block.vtu")
        content = read_bytes(self.path("block.vtu"))
        for part in (b'NumberOfPoints="12" NumberOfCells="2"', b'Name="scaled_jacobian"', b'Name="volume"'):
            self.assertIn(part, content)
        self.fails(1, "quality", "block.mesh", "--vtu", "block.vtp", says=["block.vtp", ".vtu"], prints=True)
        self.fails(1, "quality", "out.obj", "--vtu", "out.vtu", says=["out.vtu", ".vtp"], prints=True)

    def test_openfoam(self):
        if not SHARED_DATA:
            print("without shared meshes: no OpenFOAM case")
            return
        source = os.path.join(SHARED_DATA, "B_volume", "openfoam", "car_fastback")
        shutil.copytree(source, self.path("case"), copy_function=shutil.copyfile)
        text = gzip.open(self.path("case/constant/polyMesh/points.gz"), "rt").read()
        head, body = text[:text.index("\n(") + 2], text[text.index("\n(") + 2:]
        os.makedirs(self.path("case/1/polyMesh"))

        def move(match):
            x, y, z = map(float, match.group(1).split())
            return f"({x!r} {y!r} {z + 0.2 * math.exp(-(x - 2) ** 2 - y ** 2 - 4 * (z - 1) ** 2)!r})"

        self.write("case/1/polyMesh/points", head + re.sub(r"\(([^()]+)\)", move, body))
        reply = self.deform("quality", "case/1", "--before", "case", "--wall", "car_body", "--html", "case.html",
                            "--vtu", "case.vtu", "--json").json
        self.assertEqual(reply["wall_faces"], 20901)
        self.assertGreater(reply["wall_height"], 0)
        self.assertLess(reply["wall_height"], reply["average_wall_height"])
        self.assertGreater(reply["average_wall_angle"], reply["before"]["average_wall_angle"])
        self.assertGreater(reply["displacement"], 0.05)
        page = read_bytes(self.path("case.html")).decode()
        self.assertIn("data-part checked> car_body", page)
        self.assertIn("data-part> inlet", page)
        content = read_bytes(self.path("case.vtu"))
        self.assertIn(b'NumberOfPoints="268807" NumberOfCells="225317"', content)
        self.assertIn(b'Name="non_orthogonality"', content)


if __name__ == "__main__":
    main()

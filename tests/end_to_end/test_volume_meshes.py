# SPDX-License-Identifier: GPL-3.0-or-later
"""Simulation meshes through a real server: the inside follows the surface, and the solver's own checks still pass."""

import gzip
import os
import re
import shutil
import subprocess

from harness import SHARED_DATA, EndToEnd, box, long_test, main, read_bytes

ROOF_LIFT = """\
geometry: case
handles:
  - {name: roof, region: {intersection: [{group: car_body}, {box: {min: [1.3, -0.5, 1.3], max: [2.6, 0.5, 2]}}]}}
fixed: [{group: inlet}, {group: outlet}, {group: lowerWall}, {group: upperWall}, {group: frontAndBack}]
variables: [{name: lift, handle: roof, translate: [0, 0, 1], lower: 0, upper: 0.5}]
"""


def read_foam_points(path):
    text = read_bytes(path).decode()
    body = text[text.index("\n(") + 2:]
    return [tuple(map(float, triple.split())) for triple in re.findall(r"\(([^()]+)\)", body)], text


class OpenFoam(EndToEnd):
    def case(self, name):
        source = os.path.join(SHARED_DATA, "B_volume", "openfoam", name)
        shutil.copytree(source, self.path("case"), copy_function=shutil.copyfile)
        return read_foam_points(self.path("case/constant/polyMesh/points.gz"))

    def check_mesh(self, time):
        """What checkMesh says, or None where it is not installed."""
        if shutil.which("checkMesh") is None:
            print("without OpenFOAM: its checkMesh is not asked")
            return None
        environment = {"WM_PROJECT_DIR": "/usr/share/openfoam", **os.environ}
        return subprocess.run(["checkMesh", "-case", self.path("case"), "-time", time], env=environment, timeout=120,
                              stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=True).stdout

    def test_the_roof_of_a_car_is_lifted(self):
        before, text = self.case("car_fastback")
        self.start_server()
        self.write("car.yaml", ROOF_LIFT)
        for lift in ("0.05", "0.15"):
            reply = self.deform("apply", "car.yaml", "--set", f"lift={lift}", "-o", f"case/{lift}", "--json").json
            self.assertEqual(reply["points"], len(before))
            after, text_after = read_foam_points(self.path(f"case/{lift}/polyMesh/points"))
            self.assertEqual(len(after), len(before))
            self.assertEqual(text[:text.index("\n(")], text_after[:text_after.index("\n(")])
            low, high = box(before)
            moved = outer = 0
            for a, b in zip(before, after):
                shift = b[2] - a[2]
                if any(min(abs(a[k] - low[k]), abs(a[k] - high[k])) < 1e-9 for k in range(3)):
                    outer += 1
                    self.assertEqual(a, b)
                elif shift > 0.999 * float(lift):
                    moved += 1
            self.assertGreater(min(moved, outer), 290)
            quality = self.deform("quality", f"case/{lift}", "--before", "case", "--fail-on", "failed_checks>0", "--json").json
            self.assertLess(abs(quality["non_orthogonality"] - quality["before"]["non_orthogonality"]), 5)
            said = self.check_mesh(lift)
            if said is not None:
                self.assertIn("Mesh OK.", said)
                self.compare(said, quality)
        self.fails(4, "quality", "case/0.15", "--json", "--fail-on", "skewness>1", says=["skewness>1: it is 3.0"], prints=True)
        self.fails(2, "quality", "case", "--fail-on", "skewnes>1", says=["did you mean", "skewness"])

    @long_test
    def test_faces_that_become_severely_non_orthogonal_are_counted(self):
        """None is at rest, so that all that checkMesh's formula finds afterwards are new."""
        self.case("car_fastback")
        self.start_server()
        self.write("car.yaml", ROOF_LIFT.replace("upper: 0.5", "upper: 2"))
        for lift, any_are in (("0.3", False), ("1.3", True)):
            apply = ["apply", "car.yaml", "--set", f"lift={lift}", "-o", f"case/{lift}", "--json", "--keep-bad"]
            report = self.deform(*apply, "--check", "quality", expect=None).json["report"]
            quality = self.deform("quality", f"case/{lift}", "--before", "case", "--json").json
            self.assertEqual(quality["before"]["non_orthogonal_faces"], 0)
            severe = int(quality["non_orthogonal_faces"] + quality["non_orthogonality_errors"])
            self.assertEqual(severe > 0, any_are)
            told = [reason for reason in report["reasons"] if "severely non-orthogonal" in reason]
            self.assertEqual([int(reason.split()[0]) for reason in told], [severe] if any_are else [])
            self.assertTrue(not any_are or report["verdict"] != "good")
            self.assertFalse(any("non-orthogonal" in reason for reason in self.deform(*apply, expect=None).json["report"]["reasons"]))
        self.write("moved.yaml", ROOF_LIFT.replace("upper: 0.5", "upper: 2").replace("geometry: case", "geometry: case/1.3").replace("0.5, 2]", "0.5, 4]"))
        rest = self.deform("apply", "moved.yaml", "--set", "lift=0", "-o", "case/9", "--json", "--keep-bad", "--check", "quality", expect=None).json["report"]
        self.assertFalse(any("non-orthogonal" in reason for reason in rest["reasons"]), "they are so at rest")

    def test_a_sweep_writes_time_folders(self):
        before, _ = self.case("pipe_tet")
        self.start_server()
        self.write("pipe.yaml", "geometry: case\nhandles: [{name: inlet, region: {group: inlet}}]\nfixed: [{group: outlet}]\n"
                                "variables: [{name: up, handle: inlet, translate: [0, 0, 1]}]\n")
        self.write("designs.csv", "name,up\na,0.05\nb,0.1\n")
        command = ["sweep", "pipe.yaml", "--designs", "designs.csv", "-o", "results", "--json"]
        self.assertEqual(self.deform(*command).json["written"], 2)
        self.assertEqual(self.deform(*command).json["skipped"], 2)
        self.deform("apply", "pipe.yaml", "--set", "up=0.1", "-o", "one")
        swept = read_bytes(self.path("results/b/polyMesh/points"))
        self.assertEqual(swept, read_bytes(self.path("one/polyMesh/points")))
        # Of points and points.gz at one place OpenFOAM reads one: a result leaves no other beside it.
        with gzip.open(self.path("one/polyMesh/points.gz"), "wb") as file:
            file.write(b"of another design")
        self.deform("apply", "pipe.yaml", "--set", "up=0.1", "-o", "one")
        self.assertEqual(os.listdir(self.path("one/polyMesh")), ["points"])
        os.makedirs(self.path("other/a/polyMesh"))
        os.rename(self.path("one/polyMesh/points"), self.path("other/a/polyMesh/points.gz"))
        self.fails(1, "sweep", "pipe.yaml", "--designs", "designs.csv", "-o", "other",
                   says=["other/a/polyMesh/points.gz: is there and not of this sweep"])
        self.assertEqual(os.listdir(self.path("other/a/polyMesh")), ["points.gz"])
        self.deform("apply", "pipe.yaml", "--set", "up=0.1", "-o", "one")
        self.assertEqual(len(before), len(read_foam_points(self.path("one/polyMesh/points"))[0]))

        # Points alone have the faces of the mesh they are compared with.
        self.fails(1, "quality", "results/b", "--json", says=["results/constant/polyMesh/faces", "--before"])
        alone = self.deform("quality", "results/b", "--before", "case", "--json").json
        self.assertGreater(alone["displacement"], 0.099)

        # Beside constant of its own case, where the faces are found; not where they are those of another mesh.
        self.assertEqual(self.deform("sweep", "pipe.yaml", "--designs", "designs.csv", "-o", "case", "--json").json["written"], 2)
        within = self.deform("quality", "case/b", "--before", "case", "--json").json
        self.assertEqual({**within, "file": "results/b"}, alone)
        self.write("constant.csv", "name,up\nconstant,0.05\n")
        self.fails(1, "sweep", "pipe.yaml", "--designs", "constant.csv", "-o", "case", says=["would replace the source mesh"])
        os.makedirs(self.path("parts/constant"))
        os.rename(self.path("case"), self.path("parts/processor0"))
        self.write("pipe.yaml", "geometry: parts/processor0\nhandles: [{name: inlet, region: {group: inlet}}]\n"
                                "fixed: [{group: outlet}]\nvariables: [{name: up, handle: inlet, translate: [0, 0, 1]}]\n")
        for verb in (["sweep", "--designs", "designs.csv", "-o", "parts"], ["apply", "--set", "up=0.1", "-o", "parts/1"]):
            self.fails(1, verb[0], "pipe.yaml", *verb[1:], says=["-o", "processor0", "part of a decomposed case", "processor0/1"])
            self.assertEqual(sorted(os.listdir(self.path("parts"))), ["constant", "processor0"])
        os.makedirs(self.path("regions/constant"))
        os.rename(self.path("parts/processor0/constant"), self.path("regions/constant/fluid"))
        self.write("pipe.yaml", "geometry: regions/constant/fluid\nhandles: [{name: inlet, region: {group: inlet}}]\n"
                                "fixed: [{group: outlet}]\nvariables: [{name: up, handle: inlet, translate: [0, 0, 1]}]\n")
        for verb in (["sweep", "--designs", "designs.csv", "-o", "regions"], ["apply", "--set", "up=0.1", "-o", "regions/1"]):
            self.fails(1, verb[0], "pipe.yaml", *verb[1:], says=["-o", "region fluid", "1/fluid"])
            self.assertEqual(os.listdir(self.path("regions")), ["constant"])

    def test_the_parts_of_a_decomposed_case_move_as_the_whole(self):
        """By OpenFOAM's own decomposePar; the tests of the reader cut a grid themselves."""
        if shutil.which("decomposePar") is None:
            self.skipTest("without OpenFOAM: there is no decomposePar")
        whole, _ = self.case("pipe_tet")
        self.decompose()
        # OpenFOAM reads some decimals as the double beside the nearest one. So both have what it wrote.
        places = [self.places(part) for part in range(4)]
        for part in range(4):
            for place, point in zip(places[part], read_foam_points(self.path(f"case/processor{part}/constant/polyMesh/points"))[0]):
                self.assertLess(max(abs(a - b) for a, b in zip(whole[place], point)), 1e-14)
                whole[place] = point
        self.assertEqual(len(set().union(*places)), len(whole))
        os.remove(self.path("case/constant/polyMesh/points.gz"))
        self.write("case/constant/polyMesh/points", f"{len(whole)}\n(\n" + "".join("(%r %r %r)\n" % point for point in whole) + ")\n")
        self.start_server()
        setup = ("handles: [{name: inlet, region: {group: inlet}}]\nfixed: [{group: outlet}]\n"
                 "variables: [{name: up, handle: inlet, translate: [0, 0, 1]}]\n")
        self.write("whole.yaml", "geometry: case\n" + setup)
        self.write("parts.yaml", 'geometry: "case/processor*"\n' + setup)
        self.deform("apply", "whole.yaml", "--set", "up=0.1", "-o", "whole")
        self.deform("apply", "parts.yaml", "--set", "up=0.1", "-o", "case/1")
        whole, _ = read_foam_points(self.path("whole/polyMesh/points"))
        for part in range(4):
            points, _ = read_foam_points(self.path(f"case/processor{part}/1/polyMesh/points"))
            self.assertEqual(points, [whole[place] for place in places[part]])
        self.write("designs.csv", "name,up\na,0.05\n")
        self.fails(1, "sweep", "parts.yaml", "--designs", "designs.csv", "-o", "results", says=["4 parts", "deform apply"])
        self.fails(1, "apply", "parts.yaml", "--set", "up=0.1", "-o", "case/processor*/constant", says=["would replace the source"])

    def decompose(self, case="case", *options):
        """Into four parts."""
        os.makedirs(self.path(f"{case}/system"), exist_ok=True)
        head = "FoamFile { version 2.0; format ascii; class dictionary; object x; }\n"
        self.write(f"{case}/system/controlDict", head + "startFrom startTime; startTime 0; stopAt endTime; endTime 1; deltaT 1;\n"
                                                     "writeControl timeStep; writeInterval 1; writePrecision 17;\n")
        self.write(f"{case}/system/decomposeParDict", head + "numberOfSubdomains 4; method simple; coeffs { n (2 2 1); }\n")
        self.write(f"{case}/system/fvSolution", head)
        schemes = ("ddt", "grad", "div", "laplacian", "interpolation", "snGrad")
        self.write(f"{case}/system/fvSchemes", head + "".join(f"{name}Schemes {{ default none; }}\n" for name in schemes))
        subprocess.run(["decomposePar", "-case", self.path(case), *options], env={"WM_PROJECT_DIR": "/usr/share/openfoam", **os.environ},
                       timeout=120, stdout=subprocess.DEVNULL, check=True)

    def collated(self, path):
        """What a collated file has of each part."""
        content, blocks = read_bytes(self.path(path)), []
        for found in re.finditer(rb"// Processor\d+\s+(\d+)\s*\(", content):
            blocks.append(content[found.end():found.end() + int(found[1])].decode())
        return blocks

    def test_collated_parts_move_as_those_in_folders_of_their_own(self):
        if shutil.which("decomposePar") is None:
            self.skipTest("without OpenFOAM: there is no decomposePar")
        self.case("pipe_tet")
        shutil.copytree(self.path("case"), self.path("together"))
        self.decompose()
        self.decompose("together", "-fileHandler", "collated")
        self.start_server()
        setup = ("handles: [{name: inlet, region: {group: inlet}}]\nfixed: [{group: outlet}]\n"
                 "variables: [{name: up, handle: inlet, translate: [0, 0, 0.1]}]\n")
        self.write("parts.yaml", 'geometry: "case/processor*"\n' + setup)
        self.write("collated.yaml", "geometry: together/processors4\n" + setup)
        self.deform("apply", "parts.yaml", "--set", "up=0.5", "-o", "case/1")
        served = self.deform("apply", "collated.yaml", "--set", "up=0.5", "-o", "together/1", "--json").json
        blocks = self.collated("together/processors4/1/polyMesh/points")
        self.assertEqual(len(blocks), 4)
        for part, block in enumerate(blocks):
            points, _ = read_foam_points(self.path(f"case/processor{part}/1/polyMesh/points"))
            of_block = [tuple(map(float, triple.split())) for triple in re.findall(r"\(([^()]+)\)", block[block.index("\n("):])]
            self.assertEqual(of_block, points)
        self.assertEqual(served["points"], len({place for part in range(4) for place in self.places(part)}))
        self.fails(1, "apply", "collated.yaml", "--set", "up=0.5", "-o", "together/processors4/constant", says=["would replace the source"])
        if shutil.which("mpirun") is None:
            return
        os.rename(self.path("together/constant/polyMesh"), self.path("undecomposed"))  # so that nothing else is read
        said = subprocess.run(["mpirun", "--allow-run-as-root", "--oversubscribe", "-np", "4", "checkMesh", "-parallel", "-fileHandler", "collated",
                               "-case", self.path("together"), "-time", "1"], env={"WM_PROJECT_DIR": "/usr/share/openfoam", **os.environ}, timeout=120,
                              stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=True).stdout
        quality = self.deform("quality", "together/processors4/1", "--json").json
        self.compare(said, quality)

    def places(self, part):
        text = read_bytes(self.path(f"case/processor{part}/constant/polyMesh/pointProcAddressing")).decode()
        return list(map(int, text[text.index("\n(") + 2:text.rindex(")")].split()))

    def compare(self, said, quality):
        """OpenFOAM's own numbers."""
        for label, name in ((r"Mesh non-orthogonality Max:", "non_orthogonality"), (r"average:", "average_non_orthogonality"),
                            (r"Max skewness =", "skewness"), (r"Max aspect ratio =", "aspect_ratio"),
                            (r"Min volume =", "volume"), (r"Total volume =", "total_volume")):
            theirs = float(re.search(label + r" ([-+0-9.e]*[0-9])", said).group(1))
            self.assertLess(abs(quality[name] - theirs), 1e-6 * abs(theirs), name)


if __name__ == "__main__":
    main()

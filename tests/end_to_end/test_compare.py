# SPDX-License-Identifier: GPL-3.0-or-later
"""`deform compare` and what setups may say in few words: a real server, pages and pictures read back."""

import base64
import json
import math
import re
import signal
import struct
import time
import zlib

from harness import AHMED_SETUP, EndToEnd, main, read_obj

DESIGN = {"roof_up": 0.03, "slant_turn": 0.1}


def png_size(data):
    """Width and height of a whole PNG of eight bits per red, green, blue and opacity."""
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    place, pixels = 8, b""
    while place < len(data):
        length, kind = struct.unpack_from(">I4s", data, place)
        body = data[place + 8:place + 8 + length]
        assert zlib.crc32(kind + body) == struct.unpack_from(">I", data, place + 8 + length)[0]
        if kind == b"IHDR":
            width, height, bits, colours = struct.unpack_from(">IIBB", body)
        if kind == b"IDAT":
            pixels += body
        place += 12 + length
    assert (bits, colours) == (8, 6)
    assert len(zlib.decompress(pixels)) == height * (1 + 4 * width)
    return width, height


class Compare(EndToEnd):
    def setUp(self):
        super().setUp()
        self.start_server()
        self.deform("sample", "-o", "ahmed.obj", "--points", "3000")
        self.write("ahmed.yaml", AHMED_SETUP)

    def compare(self, *arguments, expect=0):
        return self.deform("compare", "ahmed.yaml", *arguments, expect=expect)

    def test_what_was_compared_is_told_when_it_is_interrupted(self):
        self.deform("sample", "-o", "ahmed.obj", "--points", "15000")
        self.write("slow.yaml", "method: {rbf: {reduction: REDUCTION_OFF}}\n")
        child = self.spawn("compare", "ahmed.yaml", "--set", "roof_up=0.03", "--methods", "shell,slow.yaml", "-o", "page.html", "--json")

        def second_is_prepared():
            preparing = any(call["state"].lower().endswith("preparing") for call in self.deform("admin", "calls", "--json").json["calls"])
            return preparing and len(self.deform("list", "systems", "--json").json["systems"]) == 1

        # The first one is listed a moment before its own call ends.
        self.wait_until(second_is_prepared, "the first method is prepared", 60)
        time.sleep(1)
        self.wait_until(second_is_prepared, "the second method is prepared", 60)
        child.send_signal(signal.SIGINT)
        out, err = child.communicate(timeout=60)
        self.assertEqual(child.returncode, 130, err)
        self.assertIn("only 1 of 2 methods were compared", err)
        reply = json.loads(out)
        self.assertEqual([method["label"] for method in reply["methods"]], ["shell"])
        self.assertEqual(reply["error"]["code"], "CANCELLED")
        with open(self.path("page.html")) as file:
            self.assertIn("shell", file.read())

    def test_says_what_apply_says_of_each_method(self):
        self.write("dense.yaml", "method: {ffd: {control: MESH, lattice: {points: [9, 8, 7]}}}\n")
        self.write("narrow.yaml", "method: {cage: {file: tetrahedron.off}}\n")
        self.write("tetrahedron.off", "OFF\n4 4 6\n-9 -9 -9\n9 0 0\n0 9 0\n0 0 9\n3 0 2 1\n3 0 1 3\n3 1 2 3\n3 0 3 2\n")
        settings = [part for name, value in DESIGN.items() for part in ("--set", f"{name}={value}")]
        reply = self.compare("--methods", "rbf,shell,dense.yaml", "--methods", "narrow.yaml", *settings, "-o", "page.html",
                             "--json").json
        self.assertEqual([m["label"] for m in reply["methods"]], ["rbf", "shell", "dense", "narrow"])
        self.assertEqual([m["options"] for m in reply["methods"]], ["the setup", "defaults", "dense.yaml", "narrow.yaml"])
        rest, _ = read_obj(self.path("ahmed.obj"))
        slant, roof = self.held(rest)
        blocks = ["{rbf: {kernel: TRIHARMONIC}}", "{shell: {}}", "{ffd: {control: MESH, lattice: {points: [9, 8, 7]}}}"]
        for method, block in zip(reply["methods"], blocks):
            self.write("one.yaml", AHMED_SETUP.replace("{rbf: {kernel: TRIHARMONIC}}", block))
            applied = self.deform("apply", "one.yaml", *settings, "-o", "out.obj", "--keep-bad", "--json", expect=None).json
            design = method["designs"][0]
            self.assertEqual(method["refused"], [])
            self.assertEqual(design["verdict"], applied["report"]["verdict"])
            self.assertEqual(design["flipped_faces"], applied["report"]["flipped_faces"])
            self.assertAlmostEqual(design["max_displacement"], applied["report"]["max_displacement"], delta=1e-12)
            self.assertGreater(method["prepare_seconds"], 0)
            self.assertGreater(method["bytes"], 0)
            moved, _ = read_obj(self.path("out.obj"))
            away = [math.dist(moved[p], self.turned(rest[p])) for p in slant]
            away += [math.dist(moved[p], (rest[p][0], rest[p][1], rest[p][2] + DESIGN["roof_up"])) for p in roof]
            # The handles are most of what is held; fixed points are missed by no more than they.
            self.assertGreaterEqual(design["misfit"]["largest"], max(away) - 1e-9)
        self.assertLess(reply["methods"][0]["designs"][0]["misfit"]["largest"], 1e-12)
        self.assertGreater(reply["methods"][2]["designs"][0]["misfit"]["largest"], 1e-9, "a lattice meets them by least squares")
        refused = reply["methods"][3]
        self.assertIn("control", " ".join(refused["refused"]))
        self.assertNotIn("designs", refused)
        self.check_page("page.html", shots=6)

    def held(self, points):
        """The points of the handles: of the slant, and of the roof within the box."""
        groups, name = {}, None
        with open(self.path("ahmed.obj")) as file:
            for line in file:
                words = line.split()
                if words[:1] == ["g"]:
                    name = words[1]
                elif words[:1] == ["f"]:
                    groups.setdefault(name, set()).update(int(word.split("/")[0]) - 1 for word in words[1:])
        roof = [i for i in groups["roof"] if 0.4 <= points[i][0] <= 0.6]
        self.assertGreater(min(len(groups["slant"]), len(roof)), 20)
        return groups["slant"], roof

    @staticmethod
    def turned(p):
        c, s = math.cos(DESIGN["slant_turn"]), math.sin(DESIGN["slant_turn"])
        x, z = p[0] - 0.843, p[2] - 0.338
        return 0.843 + c * x + s * z, p[1], 0.338 - s * x + c * z

    def check_page(self, name, shots):
        with open(self.path(name)) as file:
            page = file.read()
        pictures = re.findall(r'<img alt="([^"]+)" src="data:image/png;base64,([^"]+)">', page)
        self.assertEqual(len(pictures), shots)
        for _, data in pictures:
            self.assertEqual(png_size(base64.b64decode(data, validate=True)), (480, 320))
        self.assertEqual(len({data for _, data in pictures}), shots, "no two methods look the same")
        self.assertFalse("://" in page or "<script" in page, "it needs nothing else")
        self.assertEqual(page.count("<b class=\"bad\">refused</b>"), 1)

    def test_takes_tables_of_designs(self):
        self.write("designs.csv", "name,roof_up\nlow,-0.02\nrest,0\nhigh,0.02\n")
        text = self.compare("--designs", "designs.csv", "--methods", "shell,rbf", "-o", "page.html").out
        for line in ("low: roof_up = -0.02", "rest: all variables 0", "high: roof_up = 0.02"):
            self.assertIn(f"\n{line}\n", text)
        reply = self.compare("--designs", "designs.csv", "--methods", "shell", "--json").json
        self.assertEqual([d["name"] for d in reply["designs"]], ["low", "rest", "high"])
        self.assertEqual(reply["methods"][0]["designs"][1]["roughness"], 0)
        self.assertGreater(reply["methods"][0]["designs"][2]["roughness"], 0)

    def test_constraints_are_refused_by_what_has_none(self):
        self.write("ahmed.yaml", AHMED_SETUP + "constraints: [{name: back, planar: {}, regions: [{group: base}]}]\n")
        reply = self.compare("--methods", "rbf,shell", "--set", "slant_turn=0.1", "--json").json
        self.assertIn("constraints", reply["methods"][0]["refused"][0])
        self.assertLess(reply["methods"][1]["designs"][0]["constraints"]["back"], 1e-3)

    def test_what_is_wrong_is_said(self):
        self.assertIn("did you mean \"shell\"", self.compare("--methods", "shel", "--set", "roof_up=0", expect=1).err)
        self.assertIn("exactly one of --set, --designs", self.compare(expect=1).err)
        self.assertIn("roof_up: 0.2 is outside of its bounds", self.compare("--set", "roof_up=0.2", expect=1).err)
        self.write("ahmed.yaml", AHMED_SETUP.replace("{group: nose}", "{group: nsoe}"))
        nothing = self.compare("--methods", "rbf,shell", "--set", "roof_up=0.01", "--json", expect=1)
        self.assertIn("no method gave a deformation", nothing.err)
        self.assertIn("nsoe", nothing.json["methods"][1]["refused"][0])
        self.assertEqual(nothing.json["error"]["code"], "INVALID_ARGUMENT")


class FewWords(EndToEnd):
    def setUp(self):
        super().setUp()
        self.start_server()
        self.deform("sample", "-o", "ahmed.obj", "--points", "3000")

    def points_of(self, setup, *settings):
        self.write("setup.yaml", setup)
        arguments = [part for setting in settings for part in ("--set", setting)]
        self.deform("apply", "setup.yaml", *arguments, "-o", "out.obj")
        return read_obj(self.path("out.obj"))[0]

    def test_degrees_lengths_and_patches_mean_the_same_as_what_they_stand_for(self):
        plain = self.points_of(AHMED_SETUP, "roof_up=0.03", f"slant_turn={math.radians(4)!r}")
        rest, _ = read_obj(self.path("ahmed.obj"))
        low, high = [min(p[k] for p in rest) for k in range(3)], [max(p[k] for p in rest) for k in range(3)]
        diagonal = math.dist(low, high)
        # The slant is a flat part of the body, and the nose is not: patches of 10 degrees end at its round edges.
        short = AHMED_SETUP.replace("region: {group: slant}", "region: {patch: {seed: [0.95, 0, 0.3], angle: 10}}")
        short = short.replace("lower: -0.2, upper: 0.2", "lower: -5, upper: 5").replace("0.338]", "0.338], unit: DEGREES")
        short = short.replace("translate: [0, 0, 1], lower: -0.05, upper: 0.05", "translate: [0, 0, 0.1*L], lower: -Lz, upper: pi/4")
        moved = self.points_of(short, f"roof_up={0.03 / (0.1 * diagonal)!r}", "slant_turn=4")
        self.assertLess(max(math.dist(a, b) for a, b in zip(plain, moved)), 1e-12)
        self.assertGreater(max(math.dist(a, b) for a, b in zip(plain, rest)), 0.02)

    def test_a_variable_moves_several_handles(self):
        both = AHMED_SETUP[:AHMED_SETUP.index("variables:")] + """variables:
  - {name: all, handle: roof, translate: [0, 0, 1], also: [{handle: slant, translate: [0, 0, -1]}]}
"""
        each = AHMED_SETUP[:AHMED_SETUP.index("variables:")] + """variables:
  - {name: up, handle: roof, translate: [0, 0, 1]}
  - {name: down, handle: slant, translate: [0, 0, -1]}
"""
        self.assertEqual(self.points_of(both, "all=0.01"), self.points_of(each, "up=0.01", "down=0.01"))

    def test_the_schema_knows_what_setups_say(self):
        schema = self.deform("schema").json
        self.assertEqual(schema["required"], ["geometry"])
        self.assertIn("DEGREES", schema["$defs"]["Rotate"]["properties"]["unit"]["enum"])
        self.assertEqual(sorted(schema["properties"]), sorted(
            ["geometry", "method", "handles", "fixed", "variables", "seed", "symmetry", "constraints", "constraint_options", "then"]))
        self.assertEqual(sorted(schema["$defs"]["Stage"]["properties"]), ["fixed", "handles", "method"])
        self.assertIn("WRAP", schema["$defs"]["CageMethod.Generate"]["properties"]["kind"]["enum"])
        shown = json.dumps(schema)
        for reference in set(re.findall(r'"#/\$defs/([\w.]+)"', shown)):
            self.assertIn(reference, schema["$defs"])


if __name__ == "__main__":
    main()

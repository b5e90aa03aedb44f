# SPDX-License-Identifier: GPL-3.0-or-later
"""A volume mesh follows its CAD model: a block with a bore that widens, tilts and moves, judged by the parameters of the model."""

import csv
import gzip
import math
import os
import shutil

from harness import SHARED_DATA, EndToEnd, main

PARAM = os.path.join(SHARED_DATA, "B_volume", "param")
CAD = os.path.join(SHARED_DATA, "D_cad")
ROUNDING = 2e-8  # of the table of nodes


def model(name):
    return os.path.join(CAD, name)


class Cad(EndToEnd):
    def setUp(self):
        super().setUp()
        shutil.copy(os.path.join(PARAM, "bore_tet_p0.msh.gz"), self.path("bore.msh.gz"))

    def nodes(self):
        """Patches and place at rest by node."""
        with gzip.open(os.path.join(PARAM, "bore_tet_boundary_steps.csv.gz"), "rt") as file:
            rows = list(csv.reader(file))[1:]
        return {int(row[0]): (row[1].split("|"), [float(v) for v in row[2:5]]) for row in rows}

    def move(self, share):
        self.deform("cad-move", model("bore_p000.step"), model(f"bore_p{share:03}.step"), "bore.msh.gz", "-o", f"m{share}.csv", "--setup",
                    f"s{share}.yaml")
        with open(self.path(f"m{share}.csv")) as file:
            return {int(row["point"]): [float(row[k]) for k in ("dx", "dy", "dz")] for row in csv.DictReader(file)}

    def test_the_boundary_lies_on_the_new_model_and_the_volume_follows(self):
        self.start_server()
        nodes = self.nodes()
        for share in (25, 50, 100):
            part = share / 100
            radius, tilt, shift = 0.5 + 0.3 * part, math.radians(20 * part), 0.3 * part
            motions = self.move(share)
            self.assertEqual(set(motions), set(nodes))
            axes = {"x": (math.sin(tilt), 0, math.cos(tilt)), "y": (0, -math.sin(tilt), math.cos(tilt)), "-y": (0, math.sin(tilt), math.cos(tilt)),
                    "-x": (-math.sin(tilt), 0, math.cos(tilt))}
            worst = dict.fromkeys(axes, 0)
            for node, (patches, rest) in nodes.items():
                moved = [r + d for r, d in zip(rest, motions[node])]
                if "side" in patches:
                    self.assertEqual(motions[node], [0, 0, 0], "the sides stay as they are")
                for patch, height in (("top", 1), ("bottom", -1)):
                    if patch in patches:
                        self.assertAlmostEqual(moved[2], height, delta=ROUNDING)
                if "hole" not in patches:
                    continue
                for name, axis in axes.items():
                    from_axis = [moved[0] - shift, moved[1], moved[2]]
                    along = sum(a * b for a, b in zip(from_axis, axis))
                    distance = math.sqrt(sum((p - along * a) ** 2 for p, a in zip(from_axis, axis)))
                    worst[name] = max(worst[name], abs(distance - radius))
            self.assertLess(min(worst.values()), ROUNDING, f"{share} %: distance from the cylinder {worst}")
            applied = self.deform("apply", f"s{share}.yaml", "--motions", f"m{share}.csv", "-o", f"out{share}.msh", "--fail-on", "inverted_cells>0")
            self.assertIn("none is inverted", applied.out)
            self.assertIn("good", applied.out)

    def test_what_does_not_fit_is_refused_by_name(self):
        self.fails(1, "cad-move", model("bore_p000.step"), model("ahmed_slant25.step"), "bore.msh.gz", "-o", "m.csv", "--setup", "s.yaml",
                   says=["face"])
        self.fails(1, "cad-move", model("bore_p100.step"), model("bore_p000.step"), "bore.msh.gz", "-o", "m.csv", "--setup", "s.yaml",
                   says=["farther", "--tolerance"])
        self.fails(1, "cad-move", model("bore_p000.step"), model("bore_p100.step"), "bore.msh.gz", "-o", "moved.msh", says=["--setup"])
        for name in ("m.csv", "s.yaml", "moved.msh"):
            self.assertFalse(os.path.exists(self.path(name)), name)


if __name__ == "__main__":
    main()

# SPDX-License-Identifier: GPL-3.0-or-later
"""Setups that no single message takes: 10 MiB of point ids by the command line."""

import json

from harness import EndToEnd, main, read_bytes

MIB = 1 << 20


class LargeSetups(EndToEnd):
    columns, lists = 128, 400

    def setUp(self):
        super().setUp()
        self.start_server()
        n = self.columns
        points = "".join(f"v {i / (n - 1):.7f} {j / (n - 1):.7f} 0\n" for j in range(n) for i in range(n))
        faces = "".join(f"f {a} {a + 1} {a + 1 + n} {a + n}\n" for j in range(n - 1) for a in range(j * n + 1, j * n + n))
        self.write("sheet.obj", points + faces)
        half = n // 2 - n // 32
        sets = {"left": [j * n + i for j in range(n) for i in range(half)],
                "right": [j * n + i for j in range(n) for i in range(n - half, n)]}
        self.write("ids.json", json.dumps(sets))

        def union(name):
            return "{union: [" + ", ".join([f"{{ids: {{file: ids.json, set: {name}}}}}"] * self.lists) + "]}"

        self.write("large.yaml", "geometry: sheet.obj\nmethod: {rbf: {kernel: TRIHARMONIC}}\n"
                   f"handles: [{{name: right, region: {union('right')}}}]\nfixed: [{union('left')}]\n"
                   "variables: [{name: up, handle: right, translate: [0, 0, 1], lower: -1, upper: 1}]\n")
        self.write("small.yaml", "geometry: sheet.obj\nmethod: {rbf: {kernel: TRIHARMONIC}}\n"
                   "handles: [{name: right, region: {ids: {file: ids.json, set: right}}}]\nfixed: [{ids: {file: ids.json, set: left}}]\n"
                   "variables: [{name: up, handle: right, translate: [0, 0, 1], lower: -1, upper: 1}]\n")

    def test_ten_mebibytes_are_prepared_and_deform_as_the_same_in_fewer_words(self):
        estimate = self.deform("prepare", "large.yaml", "--check", "--json").json
        system = self.deform("prepare", "large.yaml", "--json").json
        self.assertEqual(system["id"], estimate["system_id"])
        self.assertGreater(int(system["setup_bytes"]), 10 * MIB)
        for name in ("large", "small"):
            self.deform("apply", f"{name}.yaml", "--set", "up=0.1", "-o", f"{name}.obj")
        self.assertEqual(read_bytes(self.path("large.obj")), read_bytes(self.path("small.obj")))
        self.assertEqual(len(self.deform("list", "systems", "--json").json["systems"]), 2)
        self.server.kill()
        self.server.start()
        self.deform("apply", system["id"], "--source", "sheet.obj", "--set", "up=0.1", "-o", "again.obj")
        self.assertEqual(read_bytes(self.path("again.obj")), read_bytes(self.path("large.obj")))


if __name__ == "__main__":
    main()

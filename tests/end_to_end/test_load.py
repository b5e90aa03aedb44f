# SPDX-License-Identifier: GPL-3.0-or-later
"""Many clients with different systems at once, and a cache too small for all of them."""

from harness import AHMED_SETUP, EndToEnd, main


class Load(EndToEnd):
    kernels = ["TRIHARMONIC", "BIHARMONIC", "QUINTIC", "GAUSSIAN", "MULTIQUADRIC", "INVERSE_MULTIQUADRIC", "WENDLAND_C2",
               "THIN_PLATE"]

    def write_setups(self, count):
        """Different systems of one geometry."""
        names = []
        for k in range(count):
            kernel = self.kernels[k % len(self.kernels)]
            text = AHMED_SETUP.replace("kernel: TRIHARMONIC", f"kernel: {kernel}" + (", shape: 0.01" if k >= 3 else ""))
            names.append(self.write(f"setup{k}.yaml", text + f"seed: {k}\n"))
        return names

    def content(self, name):
        with open(self.path(name), "rb") as file:
            return file.read()

    def test_eight_clients_with_eight_systems(self):
        self.start_server()
        self.deform("sample", "-o", "ahmed.obj", "--points", 3000)
        setups = self.write_setups(8)
        children = [self.spawn("apply", setup, "--set", "roof_up=0.02", "-o", f"together{k}.obj")
                    for k, setup in enumerate(setups)]
        for child in children:
            self.assertEqual(child.wait(600), 0, child.communicate()[1])
        for k, setup in enumerate(setups):
            self.deform("apply", setup, "--set", "roof_up=0.02", "-o", f"alone{k}.obj")
            self.assertEqual(self.content(f"together{k}.obj"), self.content(f"alone{k}.obj"))
        self.assertEqual(len({self.content(f"alone{k}.obj") for k in range(7)}), 7)
        self.assertEqual(self.status()["systems_resident"], 8)

    def test_eviction_under_load(self):
        self.start_server("--cache-budget", "3MiB")
        self.deform("sample", "-o", "ahmed.obj", "--points", 3000)
        setups = self.write_setups(5)
        sizes = [self.deform("prepare", setup, "--json").json["bytes"] for setup in setups]
        self.assertGreater(sum(sizes), 3 << 20)
        children = [self.spawn("bench", setup, "--designs", 15, "--json") for setup in setups]
        for child in children:
            self.assertEqual(child.wait(600), 0, child.communicate()[1])
        status = self.status()
        self.assertGreater(status["cache_evictions"], 0)
        self.assertLessEqual(status["cache_bytes"], 3 << 20)
        self.assertEqual(status["running"], 0)
        for k, setup in enumerate(setups):
            self.deform("apply", setup, "--set", "roof_up=0.02", "-o", f"evicted{k}.obj")
        self.server.stop()
        self.server.options = []
        self.server.start()
        for k, setup in enumerate(setups):
            self.deform("apply", setup, "--set", "roof_up=0.02", "-o", f"kept{k}.obj")
            self.assertEqual(self.content(f"evicted{k}.obj"), self.content(f"kept{k}.obj"))


if __name__ == "__main__":
    main()

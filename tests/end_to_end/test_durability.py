# SPDX-License-Identifier: GPL-3.0-or-later
"""Whatever is interrupted, by a signal or by kill -9: nothing registered is lost, nothing half-registered appears."""

import os
import signal
import time

from harness import AHMED_SETUP, LONG_SETUP, EndToEnd, main, read_obj


class Durability(EndToEnd):
    def setUp(self):
        super().setUp()
        self.start_server("--max-stored-bases", "0")  # so that systems are prepared again
        self.deform("sample", "-o", "ahmed.obj", "--points", 3000)
        self.write("setup.yaml", AHMED_SETUP)

    def prepared(self):
        return self.deform("prepare", "setup.yaml", "--json").json["id"]

    def kill_and_restart(self):
        self.server.kill()
        self.server.start()

    def apply_by_id(self, system, output="by_id.obj"):
        return self.deform("apply", system, "--source", "ahmed.obj", "--set", "roof_up=0.03", "-o", output, "--json").json

    def test_system_ids_outlive_a_restart(self):
        system = self.prepared()
        self.deform("apply", "setup.yaml", "--set", "roof_up=0.03", "-o", "before.obj")
        self.assertEqual(self.server.stop(), 0)
        self.server.start()
        self.assertFalse(self.deform("show", system).json["resident"])
        self.assertTrue(self.apply_by_id(system)["report"]["prepared_again"])
        self.assertEqual(read_obj(self.path("before.obj")), read_obj(self.path("by_id.obj")))
        self.assertFalse(self.apply_by_id(system)["report"]["prepared_again"])

    def test_kill_during_upload(self):
        system = self.prepared()
        known = self.deform("list", "geometries", "--json").json["geometries"]
        points = self.deform("sample", "-o", "large.stl", "--points", 400000, "--json").json["points"]
        uploads = self.path("data/tmp")
        for attempt in range(2):
            child = self.spawn("register", "large.stl", "--json")
            self.wait_until(lambda: os.listdir(uploads) or child.poll() is not None, "an upload under way")
            self.server.kill()
            child.communicate()
            self.server.start()
            self.assertEqual(os.listdir(uploads), [], "what was half-uploaded is gone after the start")
            geometries = self.deform("list", "geometries", "--json").json["geometries"]
            ids = [g["id"] for g in geometries]
            self.assertIn(known[0]["id"], ids)
            for geometry in geometries:  # all there or not there
                if geometry["id"] != known[0]["id"]:
                    self.assertEqual(geometry["points"], points)
            self.assertEqual(sorted(os.listdir(self.path("data/geometries"))), sorted(ids))
        registered = self.deform("register", "large.stl", "--json").json
        self.assertEqual(registered["points"], points)
        self.apply_by_id(system)

    def test_kill_during_prepare(self):
        system = self.prepared()
        self.deform("sample", "-o", "long.obj", "--points", 12000)
        self.write("long.yaml", LONG_SETUP)
        child = self.spawn("prepare", "long.yaml")
        self.wait_until(lambda: self.busy() > 0, "a preparation under way")
        self.server.kill()
        self.assertEqual(child.wait(60), 3)
        told = [line for line in child.communicate()[1].splitlines() if "progress:" not in line]
        self.assertEqual(len(told), 2, told)
        self.assertIn("waiting for the server", told[0])
        self.assertIn("nobody listens there", told[1])
        self.server.start()
        self.assertEqual(self.status()["systems_resident"], 0)
        self.assertTrue(self.apply_by_id(system)["report"]["prepared_again"])
        self.assertEqual(len(self.deform("list", "geometries", "--json").json["geometries"]), 2)

    def test_kill_during_deform(self):
        system = self.prepared()
        before = self.apply_by_id(system, "before.obj")
        child = self.spawn("bench", "setup.yaml", "--designs", 1000000, "--clients", 4)
        served = self.status()["designs_served"]
        self.wait_until(lambda: self.status()["designs_served"] > served + 20, "designs served")
        self.server.kill()
        self.assertEqual(child.wait(60), 3)
        self.server.start()
        self.assertTrue(self.apply_by_id(system, "after.obj")["report"]["prepared_again"])
        self.assertEqual(read_obj(self.path("before.obj")), read_obj(self.path("after.obj")))
        self.assertEqual(before["points"], len(read_obj(self.path("after.obj"))[0]))

    def test_ctrl_c_cancels_on_the_server_too(self):
        self.deform("sample", "-o", "long.obj", "--points", 12000)
        self.write("long.yaml", LONG_SETUP)
        self.deform("prepare", "long.yaml", "--check")
        mesh_only = self.status()["memory_in_use"]
        child = self.spawn("prepare", "long.yaml")
        self.wait_until(lambda: self.busy() > 0, "a preparation under way")
        started = time.time()
        child.send_signal(signal.SIGINT)
        self.assertEqual(child.wait(20), 130)
        error = child.communicate()[1]
        self.assertEqual(error.count("\n"), 1, error)
        self.assertIn("cancelled", error)
        self.wait_until(lambda: self.busy() == 0, "the server stopped working", seconds=20)
        self.assertLess(time.time() - started, 20)
        self.wait_until(lambda: self.status()["memory_in_use"] == mesh_only, "its memory was given back", seconds=20)
        self.assertEqual(self.status()["systems_resident"], 0)

    def test_a_timeout_reaches_the_server(self):
        self.deform("sample", "-o", "long.obj", "--points", 12000)
        self.write("long.yaml", LONG_SETUP)
        self.deform("register", "long.obj")
        self.fails(3, "prepare", "long.yaml", "--timeout", 0.5, says=["deadline"])
        self.wait_until(lambda: self.busy() == 0, "the server stopped working", seconds=20)


if __name__ == "__main__":
    main()

#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""A store whose folder comes to every server by a mount of its own that remembers names, attributes and what was not there for three seconds,
as NFS does between machines, and that may go away. Where bindfs and FUSE are there. DEFORM_LONG=1: for minutes, and the figures are printed."""

import os
import shutil
import subprocess
import tempfile
import time
import unittest

from harness import main, read_bytes
from replicas import LONG, Replicas, SharedStore
from test_shared_store import Killing, Preparations

CACHES = "attr_timeout=3,entry_timeout=3,negative_timeout=3,auto_cache"  # contents are looked at anew when a file is opened


def missing():
    """Why nothing can be mounted here, as in most containers."""
    if not shutil.which("bindfs"):
        return "bindfs is not installed"
    with tempfile.TemporaryDirectory() as folder:
        tried = subprocess.run(["bindfs", "--no-allow-other", folder, folder], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        if tried.returncode == 0:
            subprocess.run(["fusermount", "-u", "-z", folder], check=True)
    return None if tried.returncode == 0 else f"bindfs cannot mount: {tried.stderr.strip()}"


MISSING = missing()


@unittest.skipIf(MISSING, MISSING)
class SharedFolder(Killing, Preparations, SharedStore, Replicas):
    def setUp(self):
        self.mounts = []
        super().setUp()

    def new_server(self, folder, number):
        server = super().new_server(folder, number)
        server.data = self.path(f"mount{number}")
        os.makedirs(self.path("shared"), exist_ok=True)
        os.mkdir(server.data)
        self.mount(server.data)
        return server

    def mount(self, folder):
        subprocess.run(["bindfs", "--multithreaded", "--no-allow-other", "-o", CACHES, self.path("shared"), folder], check=True)
        self.mounts.append(folder)

    def unmount(self, folder):
        subprocess.run(["fusermount", "-u", "-z", folder], check=True)
        self.mounts.remove(folder)

    def tearDown(self):
        for server in self.servers:
            server.stop()
        for folder in list(self.mounts):
            self.unmount(folder)
        super().tearDown()

    def environment(self):
        return {**super().environment(), "DEFORM_SERVER": ",".join(server.address for server in self.servers)}

    def apply_at(self, server, system, name):
        self.deform("apply", system, "--source", "ahmed.obj", "--set", "roof_up=0.03", "-o", name, *self.at(server), "--timeout", 20)
        return read_bytes(self.path(name))

    def test_what_one_server_has_all_have_at_once(self):
        """Though each has just been told by its folder that it is not there."""
        a, b, _ = self.servers
        setup = self.write_case()
        for _ in range(5):
            system = self.deform("prepare", setup, "--json", *self.at(a)).json
            designs = {self.apply_at(server, system["id"], f"{server.port}.obj") for server in self.servers}
            self.assertEqual(len(designs), 1)
            self.deform("remove", system["geometry_id"], "--with-setups", *self.at(b))
            for server in self.servers:
                self.fails(1, "show", system["id"], *self.at(server), says=["no geometry and no system has the id"])
        self.assertEqual(os.listdir(self.path("shared/geometries")), [])

    def test_nothing_acknowledged_is_lost_while_servers_are_killed(self):
        self.check_operations_while_killing(*((120, 2) if LONG else (12, 2)))

    def test_a_folder_that_goes_away_loses_nothing(self):
        """Its file system does not answer, or it is not mounted and an empty folder is in its place: what needs it is refused for the time being,
        nothing is called damaged or unknown, and when it is back all is there."""
        a, b, _ = self.servers
        system = self.deform("prepare", self.write_case(), "--json", *self.at(a)).json
        before = self.apply_at(a, system["id"], "before.obj")
        late = self.write_case("late", 2500)
        for goes in (self.kill_mount, self.unmount):
            self.deform("admin", "evict", "--all", *self.at(b))
            goes(b.data)
            for command in (["apply", system["id"], "--source", "ahmed.obj", "--set", "roof_up=0.03", "-o", "out.obj"], ["prepare", late]):
                refused = self.deform(*command, *self.at(b), "--timeout", 5, expect=None)
                self.assertNotEqual(refused.code, 0)
                self.assertIn("cannot be reached", refused.err)
                self.assertNotIn("damaged", refused.err)
            self.assertIsNone(b.process.poll(), b.log_text()[-2000:])
            self.assertEqual(self.apply_at(a, system["id"], "meanwhile.obj"), before)
            if goes == self.kill_mount:
                self.unmount(b.data)
            self.assertEqual(os.listdir(b.data), [], "nothing was written beside the mount")
            self.mount(b.data)
            self.wait_until(lambda: self.deform("admin", "check", *self.at(b), expect=None).code == 0, "the folder is back")
            self.assertEqual(self.apply_at(b, system["id"], "after.obj"), before)
            self.deform("prepare", late, *self.at(b))
        for server in self.servers:
            self.assertNotIn("damaged", server.log_text())

    def test_a_folder_that_hangs_keeps_only_those_calls_waiting_that_had_begun(self):
        """A file server that falls silent, on a hard mount: designs of what is in memory go on, what needs the folder is refused."""
        a, b, _ = self.servers
        system = self.deform("prepare", self.write_case(), "--json", *self.at(b)).json
        before = self.apply_at(b, system["id"], "before.obj")
        late = [self.write_case(f"late{k}", 2500 + 100 * k) for k in range(3)]
        self.signal_mount("STOP", b.data)
        try:
            waiting = [self.spawn("prepare", setup, *self.at(b)) for setup in late[:2]]
            time.sleep(6)  # what is remembered of the folder is old
            for k in range(3):
                began = time.time()
                self.assertEqual(self.apply_at(b, system["id"], f"meanwhile{k}.obj"), before)
                if LONG:
                    self.assertLess(time.time() - began, 1)
            self.assertEqual(self.apply_at(a, system["id"], "other.obj"), before)
            self.assertIn("cannot be reached", self.deform("status", *self.at(b)).out)
            refused = self.deform("prepare", late[2], *self.at(b), "--timeout", 20, expect=None)
            self.assertNotEqual(refused.code, 0)
            self.assertIn("cannot be reached", refused.err)
        finally:
            self.signal_mount("CONT", b.data)
        for one in waiting:  # stored, or refused when it went on
            one.wait(60)
        self.wait_until(lambda: "cannot be reached" not in self.deform("status", *self.at(b)).out, "the folder is back")
        for setup in late:
            self.deform("prepare", setup, *self.at(b))
        self.assertEqual(self.deform("admin", "check", *self.at(b)).code, 0)
        self.assertEqual(len(os.listdir(self.path("shared/geometries"))), 4)

    def kill_mount(self, folder):
        self.signal_mount("KILL", folder)

    @staticmethod
    def signal_mount(name, folder):
        subprocess.run(["pkill", f"-{name}", "-f", f"bindfs.* {folder}$"], check=True)


if __name__ == "__main__":
    main()

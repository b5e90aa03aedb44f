# SPDX-License-Identifier: GPL-3.0-or-later
"""The data directory on a bad day: a full disk, a lost catalog, the wrong folder, too many connections; and what looks after it."""

import os
import resource
import shutil
import socket
import subprocess

from harness import AHMED_SETUP, DEFORMD, EndToEnd, main


def tree(folder):
    found = {}
    for where, _, names in os.walk(folder):
        for name in names:
            path = os.path.join(where, name)
            with open(path, "rb") as file:
                found[os.path.relpath(path, folder)] = file.read()
    return found


class Store(EndToEnd):
    def prepared(self):
        self.deform("sample", "-o", "ahmed.obj", "--points", 2000)
        self.write("setup.yaml", AHMED_SETUP)
        return self.deform("prepare", "setup.yaml", "--json").json["id"]

    def apply(self, system):
        return self.deform("apply", system, "--source", "ahmed.obj", "--set", "roof_up=0.03", "-o", "out.obj", "--json").json

    def command(self, *arguments, expect=0):
        done = subprocess.run([DEFORMD, "store", *arguments, "--data-dir", self.path("data")], stdout=subprocess.PIPE,
                              stderr=subprocess.PIPE, text=True, timeout=60)
        self.assertEqual(done.returncode, expect, done.stdout + done.stderr)
        return done

    def writable(self):
        return self.status()["store"]["writable"]

    def test_backup_beside_the_server_and_restore(self):
        self.start_server()
        system = self.prepared()
        self.command("backup", self.path("backup"))
        self.assertIn("is inside", self.command("backup", self.path("data/backup"), expect=2).stderr)
        self.assertFalse(os.path.exists(self.path("data/backup")))
        self.command("check", expect=1)  # the server has it
        self.assertEqual(self.server.stop(), 0)
        self.assertIn("every file is whole", self.command("check").stdout)
        self.command("restore", self.path("backup"), expect=1)  # would overwrite
        shutil.rmtree(self.path("data"))
        self.command("restore", self.path("backup"))
        self.server.start()
        self.apply(system)
        self.command("nonsense", expect=2)

    def test_a_lost_catalog_after_a_kill_loses_nothing(self):
        self.start_server()
        system = self.prepared()
        self.server.kill()
        for name in ("catalog.sqlite", "catalog.sqlite-wal", "catalog.sqlite-shm"):
            os.remove(self.path("data/" + name))
        self.server.start()
        self.assertEqual(self.deform("list", "geometries", "--json").json["geometries"][0]["name"], "ahmed.obj")
        self.apply(system)
        self.assertIn("from their files", self.server.log_text())

    def test_a_lost_mark_names_the_command_that_writes_it_anew(self):
        self.start_server()
        system = self.prepared()
        self.server.kill()
        os.remove(self.path("data/deformd-store"))
        refused = self.command("check", expect=1)
        self.assertIn("deformd store rebuild", refused.stdout + refused.stderr)
        self.command("rebuild")
        self.server.start()
        self.apply(system)

    def test_a_damaged_geometry_is_mended_by_registering_it_again(self):
        self.start_server()
        system = self.prepared()
        geometry = self.deform("list", "geometries", "--json").json["geometries"][0]["id"]
        content = self.path("data/geometries/" + geometry)
        for damage in (self.flip_a_byte, os.remove):
            self.assertEqual(self.server.stop(), 0)
            damage(content)
            self.server.start()
            if damage == self.flip_a_byte:  # found where it is used
                self.fails(1, "apply", system, "--source", "ahmed.obj", "--set", "roof_up=0.03", "-o", "x.obj", says=["register"])
            self.assertNotEqual(self.deform("list", "geometries", "--json").json["geometries"][0]["damage"], "")
            self.deform("register", "ahmed.obj")
            self.assertEqual(self.deform("list", "geometries", "--json").json["geometries"][0]["damage"], "")
            self.apply(system)

    def flip_a_byte(self, path):
        os.chmod(path, 0o600)
        with open(path, "r+b") as file:
            file.seek(os.path.getsize(path) // 2)
            byte = file.read(1)
            file.seek(-1, os.SEEK_CUR)
            file.write(bytes([byte[0] ^ 1]))

    def test_a_folder_of_something_else_is_refused_and_left_untouched(self):
        os.makedirs(self.path("home/tmp"))
        self.write("home/tmp/thesis.tex", "years of work")
        before = tree(self.path("home"))
        done = subprocess.run([DEFORMD, "--address", "127.0.0.1:0", "--data-dir", self.path("home")], stderr=subprocess.PIPE, text=True,
                              timeout=60)
        self.assertEqual(done.returncode, 1)
        self.assertIn("not a store of deformd", done.stderr)
        self.assertEqual(tree(self.path("home")), before)
        self.assertEqual(sorted(os.listdir(self.path("home"))), ["tmp"])
        os.makedirs(self.path("data/geometries"))
        self.write("data/geometries/atlas.txt", "mine")
        self.command("rebuild", expect=1)
        self.assertEqual(tree(self.path("data")), {"geometries/atlas.txt": b"mine"})

    def test_a_full_disk_can_be_left(self):
        os.mkdir(self.path("data"))
        mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=32m", "tmpfs", self.path("data")], stderr=subprocess.PIPE, text=True)
        if mounted.returncode != 0:
            self.skipTest("no tmpfs can be mounted here (it takes root): " + mounted.stderr.strip())
        self.addCleanup(subprocess.run, ["umount", "-l", self.path("data")])
        self.start_server("--keep-free", "8MiB")
        system = self.prepared()
        self.deform("sample", "-o", "other.obj", "--points", 3000)
        other = self.deform("register", "other.obj", "--json").json["id"]
        self.assertTrue(self.writable())
        self.fill(self.path("data/filler"))
        self.wait_until(lambda: not self.writable(), "the server notices")
        self.assertIn("NOTHING CAN BE ADDED", self.deform("status").out)
        for stop in (self.server.kill, self.server.stop):
            stop()
            if stop == self.server.stop:
                if os.path.exists(self.path("data/reserve")):
                    os.remove(self.path("data/reserve"))  # and another program takes its room
                self.fill(self.path("data/filler2"))
            self.server.start()
            self.assertFalse(self.writable())
            self.assertEqual(len(self.deform("list", "geometries", "--json").json["geometries"]), 2)
            self.apply(system)
        self.deform("sample", "-o", "third.obj", "--points", 4000)
        refused = self.deform("register", "third.obj", expect=None)
        self.assertNotEqual(refused.code, 0)
        self.assertIn("must stay free", refused.err)
        self.deform("remove", other)
        self.deform("remove", "--with-setups", self.deform("list", "geometries", "--json").json["geometries"][0]["id"])
        self.assertEqual(self.deform("list", "geometries", "--json").json["geometries"], [])
        for filler in ("filler", "filler2"):
            os.remove(self.path("data/" + filler))
        self.wait_until(self.writable, "there is room again")
        self.apply(self.prepared())
        self.assertEqual(self.server.stop(), 0)
        self.assertIn("every file is whole", self.command("check").stdout)

    def fill(self, path):
        with open(path, "wb", buffering=0) as file:
            block = bytes(65536)
            try:
                while file.write(block):
                    pass
            except OSError:
                pass

    def test_more_idle_connections_than_the_usual_limit_of_open_files(self):
        soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
        if hard < 4096:
            self.skipTest(f"the hard limit of open files is {hard} here, too low for 1,100 connections on both sides")
        self.addCleanup(resource.setrlimit, resource.RLIMIT_NOFILE, (soft, hard))
        resource.setrlimit(resource.RLIMIT_NOFILE, (1024, hard))
        self.start_server()
        resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))
        with open(f"/proc/{self.server.process.pid}/limits") as file:
            line = next(line for line in file if line.startswith("Max open files"))
        self.assertEqual(line.split()[3:5], [str(hard), str(hard)])
        idle = [socket.create_connection(("127.0.0.1", self.server.port)) for _ in range(1100)]
        try:
            self.deform("sample", "-o", "ahmed.obj", "--points", 4000)
            self.deform("register", "ahmed.obj")
            self.assertEqual(self.status()["geometries"], 1)
        finally:
            for connection in idle:
                connection.close()


if __name__ == "__main__":
    main()

# SPDX-License-Identifier: GPL-3.0-or-later
"""Damaged CGNS and netCDF-4 files: whatever their libraries make of them, the command says one line, ends by itself and leaves nothing
behind. DEFORM_LONG=1 tries forty times as many.
"""

import base64
import glob
import os
import random
import signal
import subprocess
import tempfile
import time

from harness import DEFORM, EndToEnd, main

WRITE_CONTAINERS = os.environ["WRITE_CONTAINERS_BIN"]

# bricks.e of write_containers with 2 x 2 x 2 bricks and four bits flipped, gzipped: libhdf5 1.10.8 crashes on it.
CRASHES_LIBHDF5 = """
H4sIAAAAAAACA+1bC2xTZRQ+9/a2a7uuezA2x1AKOhXBuY6hIzi20YcdzG3QhQASa1nvXKFrcSsEiA9Qg4hojBJUjJqgxoC6mKDBd0iMSHwGdCpESPARjRgg
xtdQg/d/3bV/W2xZNxi5J5Db//znP/855zv3f97d73G688zjzKLRCIxOUyqsJ+Uqyn90YN6GVo9zvmh5VZyEObp8WtVJf/xFn5cUkKdZBAE9x44HCcmLqnKe
LDasEAxgRKLRYDQkwxiFpVf+i8p/v63DHy3Aeo9UE+1eZrEN0qDQze/dhM3PqxWEYsQRBUFgbrOnrhhZXDhxAjYYqS41QuldyBDsi85MbOiyE/lHaDvmoZTa
wylxHjqaG71e7GEB9dDZdKOrxdvU2uLzOhqbXWBZDEqPOiUCuEFL440uLN9A5du7gr025Z/fFpajDqfbFgh2y+HeYCRsW7oyagtHooNVq/w9Qf/SkFxpY1QL
yCBR0W8FC9Lva5GjHYHOGmewOxiAAiUgLAKiGsNT0+esJDGEmBjqWOzSjqGxCMsJamy4KOqyF0UC163Uti7aUUa+4xS28Pn0bP/JyW6v1wVOmuyCAsweJGtY
dKg9XrbV4Zk7vHBOg6Kbx+1MxKacWlCeYX7XTkme34ZsI1OhHwIyODOtie/6trzfdkPWaNjRq74O1k0u+T4RvbMdnbZfPeyjE+noJ8MQ0NOlQO/I2zMWQXZp
+F/AWnj45YG/sgdhTeUIQfiScQgQSikg/GN6fytcMBhK1AIpQww914wQhhHzEDDUp8BwYZOxZNRBWAOutXP2ZQ/CQyMF4TTLECA0pIBwQcWVFXDBYMjWoWKG
GH5ZlRxDfbYx/DVvCBjmpMBw05aeslEFXzX8vP+WWWkvRW31dG5sgJpcqDmtrAr0VgzfVYN70qdvYFsG+0zC+ZoD8wxby0YCZrGCQvEgCo5IpCcQDPujcm88
FoqpAlUuxGQc3XuOI5zFwHmTisq+PvqNe76nDeMrQgEk7LMbaJntI4DPc0r5aSIsxbQUqFMC2Kcx3uEfKoyz2z1OBX5FLlfhBK7cWsD6YL38/FjvB1jKgKTy
iVQRL7Vg18TDbq8iBQ1cyIQEq9pgNd6pk5p6uiOj8VSf+/u2/z27vdkN+ra+28bCHIU1Hk6+9pAN7lN+ToJdle9UwfMCCvzAsWMz4ReFezG8ecdn9WBSuGUw
sXBnFGbin0WP/H4PjMUglbiX3AubcLN/13zyFnQq3Ilg3NPyMXyI9V7e9tVBiGCBz1/Y9yO0458TTmz9Ax+AjIOPHoj+CTtws3lLPh2ASbiLXXPlO0Gj7BLG
36AWCYJqQhE41BQnGcLOHiiwbJqnSaNnRYKfqppAn8OKJJfUUYfkk4kVCeBmViQplsuKJF/UUwKSSXnqII6L6uhO8vfPAzucGtjJ5qhhmjtM15/TuePDKRnO
HeaNM9YPVyyOnttY9E3NMBZ1Yb9DjcVlWJmYuLtO2G1bUN+xZunNJCYSMWsdMecyas7d6R9EujKORsL6le5HLJeS5ZiZLMfkkNzti65ZQc6/JdrA41pYy1pG
Dm5ZmxgLfouTsOVJMxZ7K89BLPR0F2OpOEMsDLSB1+Nqbq6ha2xr/+nEWIhcHvBlnRE5PIampj6HxAGnKXtBBmYR0YL0X5Chh4FNRQSJEN24LANukZSCnlux
4ak0tk3/mwfqeFkfH7URGSNyVPdP2bkx4ooM5pAN/euX471OM0mofAXI4tiNW3OTtx3KKMCl1MtkBqFnbfng77x+adUNjtZmISY7BC6/PtMlzzvG18XwhRi+
xMk/qB98PZLxDRy/LSc+jxi/2JR8fGR8E8f/ii5zzBz/SbrAyU3Bt3D8E/SZl0Ke0etWbdWjkUYaaaSRRuc1SVoINNJIo9FGohYCjbJC6GSB/4gxROvQ4YUO
jPQTrG2syYLhs6bs87Km7J91oLclJO+ZEOvrG3XxDSxLyA13+j3yp1GxPeq5Mjrd2Ous2Rwb9ez6iI5dHthneAxr3owsQJqrkOb5LrdrvqvF4SKarxWJ5oA/
6u+Vo4NdqHfjYOSPtvgPYxdzpxxbi+PL28fGl5e1jH8xWabZaL0lhHRn02I+Vn3cF0D/2F95/vywiJUPFX2xKC5D6bFtAwxHhhq5Mjo3829/qS9ZTApGLCZv
lsajVHjJ/innh0WsXLJjzb/4HVuS6dt7JjRyuTI6VGx/9/2dyXw3xo3O7fRPCDaNwOgcLh/fdW7fmb0XxZe3nHrmquyPpeiM9/GNx5/Amm9HFmXTJz4PmE+M
DnAfSX13fPMYbImL+GglF0q+FkdbT2SF3BMNyr34AmgSVbpK7kE911VPDeNLi7qayhmVVVO7Ap3T6+yV9qrK2m/dU4+5Pc7Z6p+7INq1++MG9eoNjCE57Av7
u2V28C1I6r1GeGW3T3FwmshqmCsmVBOOBORedg0gSGzKsKI6OeQLhn1LQ8vt7NxfkFiX+bSxT/FJEbSzGwBB0idVUc2O/AXJkFxFNTv8FyR2jWCmKpT27ORe
kNgbZehAtzur2eQmSKa4ijVslhMkc1zFWjbdCZJ6ndARCYfljqhdHeUlC1dVrQ4tknqpIC/FMe9V81yyxlStUPC2HygDjc5MDVoINNJII43SpZP1ycfO0c5P
5Sf/VNs1jE49Z4v3UJ8p7Uz7KdBVK1rkoaWgmW6HrHQhzv6+zkBlcun2KJ/KSJSPFnE5tA3iF9JFP/sey0RlrLRtEZXh+0Mr6WK6WShJ0h+qQ8u9i6gM318J
5aMvnMqS9FdK25ZTGSHGBzEmFgYY/K4uh9quj/HVRGWCyjYjIAN0hpSlKNWHjof/A+er5ngRPwAA
"""


class DamagedFiles(EndToEnd):
    def setUp(self):
        super().setUp()
        # A temporary folder of the commands' own, to see what they leave in it.
        self.temporary = tempfile.mkdtemp(dir=self.folder)

    def environment(self):
        return {**super().environment(), "TMPDIR": self.temporary}

    def containers(self, bricks):
        subprocess.run([WRITE_CONTAINERS, self.folder, str(bricks)], check=True, timeout=100)

    def left_behind(self):
        """Processes that read our temporary folder's files, and those files."""
        mine = []
        for folder in glob.glob("/proc/[0-9]*"):
            try:
                with open(folder + "/cmdline", "rb") as file:
                    command = file.read()
                with open(folder + "/environ", "rb") as file:
                    ours = self.temporary.encode() in file.read()
            except OSError:
                continue
            if b"read-isolated" in command and ours:
                mine.append(folder)
        return mine + os.listdir(self.temporary)

    def test_good_files_are_read_and_written(self):
        self.containers(3)
        for name in ("bricks.cgns", "bricks_adf.cgns", "bricks.e"):
            inspected = self.deform("inspect", name, "--json").json
            self.assertEqual(inspected["points"], 64)
        self.assertEqual(self.left_behind(), [])

    def test_a_file_that_crashes_its_library_is_an_error(self):
        with open(self.path("crash.e.gz"), "wb") as file:
            file.write(base64.b64decode(CRASHES_LIBHDF5))
        for arguments in (["inspect", "crash.e.gz"], ["quality", "crash.e.gz"], ["quality", "crash.e.gz", "--before", "crash.e.gz"],
                          ["register", "crash.e.gz"]):
            result = self.fails(1, *arguments, says=["deform: crash.e.gz: the netCDF library", "the file is damaged"])
            self.assertIn("crashed while reading it (signal 11)", result.err)
        self.assertEqual(self.left_behind(), [])

    def test_damaged_bytes_never_end_the_command_by_a_signal(self):
        self.containers(2)
        runs = 4000 if os.environ.get("DEFORM_LONG") else 100
        names = ("bricks.cgns", "bricks.e", "bricks_adf.cgns")
        originals = {}
        for name in names:
            with open(self.path(name), "rb") as file:
                originals[name] = file.read()
        ends = {}
        running = []

        def collect(seed, path, child):
            out, err = child.communicate(timeout=100)
            with self.subTest(seed=seed):
                self.assertIn(child.returncode, (0, 1))
                self.assertEqual(err.count("\n"), child.returncode, err)
                if child.returncode == 1:
                    self.assertTrue(err.startswith("deform: " + os.path.basename(path)), err)
                    self.assertEqual(out, "")
            ends[child.returncode] = ends.get(child.returncode, 0) + 1
            os.remove(path)

        for seed in range(runs):
            chance = random.Random(seed)
            name = names[seed % len(names)]
            damaged = bytearray(originals[name])
            for _ in range(1 << seed % 5):
                damaged[chance.randrange(len(damaged))] = chance.randrange(256)
            if seed % 7 == 0:
                del damaged[chance.randrange(len(damaged)):]
            path = self.path(f"{seed}_{name}")
            with open(path, "wb") as file:
                file.write(damaged)
            child = subprocess.Popen([DEFORM, "inspect", os.path.basename(path)], cwd=self.folder, env=self.environment(),
                                     stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, errors="replace")
            running.append((seed, path, child))
            if len(running) == 4:
                collect(*running.pop(0))
        for entry in running:
            collect(*entry)
        self.assertGreater(ends.get(1, 0), runs // 10)
        self.assertGreater(ends.get(0, 0), 0)
        self.assertEqual(self.left_behind(), [])

    def caught_while_reading(self):
        """A command whose reader is at work; on a busy machine some have ended before they are looked at."""
        for _ in range(20):
            child = self.spawn("inspect", "bricks.cgns")
            self.wait_until(lambda child=child: len(self.left_behind()) > 1 or child.poll() is not None, "reading has begun", 60)
            if child.poll() is None:
                return child
            child.communicate()
        return self.fail("no command was seen reading")

    def test_an_interrupt_ends_the_reading_process_too(self):
        self.containers(60)
        for end in (signal.SIGINT, signal.SIGTERM, signal.SIGKILL):
            child = self.caught_while_reading()
            child.send_signal(end)
            child.wait(20)
            self.wait_until(lambda: not any(name.startswith("/proc") for name in self.left_behind()), "the reader is gone")
            for name in os.listdir(self.temporary):  # what a killed command could not remove
                os.remove(os.path.join(self.temporary, name))

    def test_an_interrupted_command_of_the_server_says_so(self):
        self.containers(60)
        self.start_server()
        child = self.spawn("register", "bricks.cgns")
        self.wait_until(lambda: len(self.left_behind()) > 0, "reading has begun")
        start = time.time()
        child.send_signal(signal.SIGINT)
        self.assertEqual(child.wait(20), 130, child.communicate())
        self.assertLess(time.time() - start, 5)
        self.assertEqual(self.left_behind(), [])

    def test_nobody_runs_the_reader_by_hand(self):
        self.assertNotIn("read-isolated", self.deform("--help").out)
        done = subprocess.run([DEFORM, "read-isolated"], stdin=subprocess.DEVNULL, timeout=20, check=False)
        self.assertEqual(done.returncode, 2)


if __name__ == "__main__":
    main()

# SPDX-License-Identifier: GPL-3.0-or-later
"""Sweeps on a bad day: kill -9 of client and server at random points, a full disk, bad rows, files of others. No finished design is
lost, none is computed twice, and the manifest is true. DEFORM_LONG=1 kills 300 times instead of 12."""

import json
import os
import random
import re
import resource
import shutil
import signal
import subprocess
import tarfile
import time

from harness import AHMED_SETUP, DEFORM, LONG, EndToEnd, main, read_bytes
from test_constraints import plate, setup

ROWS = 40


def table(rows):
    return "name,roof_up,slant_turn\n" + "".join(f"{name},{up:.6f},{turn:.6f}\n" for name, (up, turn) in rows)


def manifest_lines(path):
    """All but what a crash has torn."""
    if not os.path.exists(path):
        return []
    with open(path) as file:
        return [json.loads(line) for line in file.read().split("\n")[:-1]]


class Recorded:
    """What a manifest says: entries of the folder or archive by file, of the part in order, failures by name."""

    def __init__(self, path):
        self.results, self.part, self.next, self.failed, self.writing = {}, [], [], {}, set()
        for line in manifest_lines(path):
            if "writing" in line:
                self.results.pop(line["writing"], None)
                self.writing.add(line["writing"])
            elif "failed" in line:
                self.failed[line["name"]] = line["failed"]
            elif "hash" in line:
                self.take(line)

    def take(self, entry):
        if entry.get("in") == "next":
            self.next.append(entry)
            return
        self.failed.pop(entry["name"], None)
        if entry.get("in") == "part":
            self.part.append(entry)
        else:
            self.writing.discard(entry["file"])
            self.results[entry["file"]] = entry

    def hashes(self):
        return {(e["name"], e["hash"]) for e in [*self.results.values(), *self.part]}


class Sweep(EndToEnd):
    def setUp(self):
        super().setUp()
        self.start_server()
        self.deform("sample", "-o", "ahmed.obj", "--points", 2000)
        self.write("setup.yaml", AHMED_SETUP)

    def command(self, designs, output, *more):
        return ["sweep", "setup.yaml", "--designs", designs, "-o", output, *more]

    def sweep(self, designs, output, *more, expect=0):
        return self.deform(*self.command(designs, output, *more), "--json", expect=expect).json

    def sweep_fails(self, code, designs, output, *more):
        """Its report, and the one line that says why the exit code is not 0."""
        result = self.fails(code, *self.command(designs, output, *more), "--json", prints=True)
        return result.json, result.err

    def contents(self, folder):
        return {name: read_bytes(self.path(f"{folder}/{name}")) for name in os.listdir(self.path(folder)) if name.endswith(".obj")}

    def members(self, archive):
        with tarfile.open(self.path(archive)) as file:
            return {name: file.extractfile(name).read() for name in file.getnames()}

    def recorded(self, output):
        return Recorded(self.path(output + ".manifest" if output.endswith(".tar") else output + "/sweep.manifest"))


class Kills(Sweep):
    """Two tables that share most of their rows are swept in turn into one folder and one archive, and every run is killed."""

    def setUp(self):
        super().setUp()
        rows = [(f"d{k}", (0.05 * k / ROWS, -0.001 * k)) for k in range(ROWS)]
        other = list(rows)
        for k in (3, 17, 30):
            other[k] = (other[k][0], (0.011 * (k % 4), 0.002))
        other = [*other[20:], *other[1:20], ("new", (0.02, 0.02))]
        self.tables = {"one.csv": rows, "other.csv": other}
        self.wanted, self.hashes = {}, {}
        for name, content in self.tables.items():
            self.write(name, table(content))
            started = time.time()
            self.sweep(name, "undisturbed_" + name, "--batch", 2)
            self.seconds = time.time() - started
            self.wanted[name] = self.contents("undisturbed_" + name)
            self.hashes[name] = {(e["name"], e["hash"]) for e in self.recorded("undisturbed_" + name).results.values()}
            self.assertEqual(len(self.wanted[name]), len(content))
        self.bytes_of = {}  # by name and hash
        for name in self.tables:
            for entry in self.recorded("undisturbed_" + name).results.values():
                self.bytes_of[entry["name"], entry["hash"]] = self.wanted[name][entry["file"]]

    def check_truth(self, output):
        """Everything that the manifest names is whole, and everything that is whole is named."""
        recorded = self.recorded(output)
        if not output.endswith(".tar"):
            names = set(os.listdir(self.path(output))) if os.path.exists(self.path(output)) else set()
            for file, entry in recorded.results.items():
                self.assertEqual(read_bytes(self.path(f"{output}/{file}")), self.bytes_of[entry["name"], entry["hash"]], file)
            files = {name for name in names if name.endswith(".obj")}
            self.assertLessEqual(files, set(recorded.results) | recorded.writing, "a file with its name is recorded, or being replaced")
            return recorded
        archive = self.path(output)
        if os.path.exists(archive):
            with tarfile.open(archive) as file:  # whole at every moment
                found = {name: file.extractfile(name).read() for name in file.getnames()}
            versions = [recorded.results.values(), recorded.next]
            self.assertIn(found, [{e["file"]: self.bytes_of[e["name"], e["hash"]] for e in v} for v in versions])
        if os.path.exists(archive + ".part"):
            part = read_bytes(archive + ".part")
            for entry in recorded.part:
                begin = entry["offset"] + 512
                self.assertEqual(part[begin:begin + entry["bytes"]], self.bytes_of[entry["name"], entry["hash"]])
        return recorded

    def stamps(self, output, recorded):
        """What changes when a recorded file is written again."""
        if output.endswith(".tar"):
            return {}
        stats = {file: os.stat(self.path(f"{output}/{file}")) for file in recorded.results}
        return {(recorded.results[file]["hash"], file): (stat.st_ino, stat.st_mtime_ns) for file, stat in stats.items()}

    def killed(self, random_numbers, designs, output):
        """Starts a sweep and kills it or the server at some moment; whether it got to its end before."""
        served = self.status()["designs_served"]
        known = self.recorded(output).hashes() & self.hashes[designs]
        child = self.spawn(*self.command(designs, output, "--batch", 2, "--patience", 0))
        time.sleep(random_numbers.uniform(0, 1.1 * self.seconds))
        if random_numbers.random() < 0.5:
            child.send_signal(signal.SIGKILL)
            code = child.wait(60)
            self.assertIn(code, (0, -signal.SIGKILL))
            self.wait_until(lambda: self.busy() == 0, "the server has let go of it")
            self.assertLessEqual(self.status()["designs_served"] - served, len(self.hashes[designs]) - len(known),
                                 "a design that was recorded was computed again")
        else:
            self.server.kill()
            code = child.wait(60)
            error = child.communicate()[1]
            self.assertIn(code, (0, 3), error)
            told = [line for line in error.splitlines() if "waiting for the server" not in line]
            self.assertEqual(len(told), 0 if code == 0 else 1, error)
            self.server.start()
        return code == 0

    def finish(self, designs, output):
        known = self.recorded(output).hashes() & self.hashes[designs]
        served = self.status()["designs_served"]
        report = self.sweep(designs, output)
        self.assertEqual(report["skipped"], len(known), "what was recorded is not lost")
        self.assertEqual(report["written"], len(self.hashes[designs]) - len(known))
        self.assertEqual(self.status()["designs_served"] - served, report["written"], "nor computed again")
        if output.endswith(".tar"):
            self.assertEqual(self.members(output), self.wanted[designs])
            self.assertFalse(os.path.exists(self.path(output + ".part")))
        else:
            contents = self.contents(output)
            self.assertEqual({name: contents[name] for name in self.wanted[designs]}, self.wanted[designs])
            self.assertFalse([name for name in os.listdir(self.path(output)) if name.endswith(".part")])
        self.assertEqual(self.recorded(output).hashes() & self.hashes[designs], self.hashes[designs])
        self.assertEqual(self.sweep(designs, output)["written"], 0)

    def test_kill_9_of_client_and_server_at_random_points(self):
        random_numbers = random.Random(11)
        turn = {"results": 0, "results.tar": 0}
        tables = list(self.tables)
        kills = 0
        while kills < (300 if LONG else 12):
            for output in turn:
                designs = tables[turn[output] % 2]
                before = self.stamps(output, self.recorded(output))
                ended = self.killed(random_numbers, designs, output)
                kills += 0 if ended else 1
                recorded = self.check_truth(output)
                after = self.stamps(output, recorded)
                for key in before.keys() & after.keys():
                    self.assertEqual(before[key], after[key], f"{key} was written again")
                if ended or random_numbers.random() < 0.25:
                    self.finish(designs, output)
                    turn[output] += 1
        for output in turn:
            self.finish(tables[turn[output] % 2], output)


class Rows(Sweep):
    ROWS = """name,roof_up,slant_turn
a,0.01,0
b,0.3,0
c,0.02,0.1

d,0.02
e,x,0
a,0.03,0
f,0.03,0.05
"""
    FAILED = {"b": "designs.csv:3: roof_up: 0.3 is outside of its bounds [-0.05, 0.05]",
              "d": "designs.csv:6: 2 fields, the header has 3",
              "e": "designs.csv:7: roof_up: expected a finite number, got \"x\"",
              "designs.csv:8": "designs.csv:8: name: \"a\" stands there twice"}

    def test_bad_rows_are_named_and_the_others_go_on(self):
        self.write("designs.csv", self.ROWS)
        for output in ("results", "results.tar"):
            report, error = self.sweep_fails(1, "designs.csv", output)
            self.assertEqual(report["failed"], self.FAILED)
            self.assertIn("4 of 7 designs failed", error)
            self.assertEqual((report["designs"], report["written"]), (7, 3))
            self.assertEqual(self.recorded(output).failed, self.FAILED)
            names = self.members(output) if output.endswith(".tar") else self.contents(output)
            self.assertEqual(sorted(names), ["a.obj", "c.obj", "f.obj"])
            report, _ = self.sweep_fails(1, "designs.csv", output)
            self.assertEqual((report["written"], report["skipped"]), (0, 3))
        text = self.deform("sweep", "setup.yaml", "--designs", "designs.csv", "-o", "results", expect=1).out
        for name, reason in self.FAILED.items():
            self.assertIn(f"  {name} FAILED: {reason}\n", text)
        mended = self.ROWS.replace("b,0.3", "b,0.03").replace("d,0.02", "d,0.02,0").replace("x", "0").replace("a,0.03", "g,0.03")
        self.write("designs.csv", mended)
        for output in ("results", "results.tar"):
            report = self.sweep("designs.csv", output)
            self.assertEqual((report["written"], report["skipped"], report["failed"]), (4, 3, {}))
            self.assertEqual(self.recorded(output).failed, {})
        self.assertEqual(self.members("results.tar"), self.contents("results"))

    def test_no_more_designs_at_once_than_the_server_takes(self):
        self.server.stop()
        self.start_server("--max-designs", "3")
        self.write("designs.csv", table([(f"d{k}", (0.001 * k, 0)) for k in range(8)]))
        self.assertEqual(self.sweep("designs.csv", "results")["written"], 8)
        self.fails(1, *self.command("designs.csv", "others", "--batch", "4", "--no-keep-going"), says=["limit of 3"])

    def test_without_keep_going_nothing_is_computed(self):
        self.write("designs.csv", self.ROWS)
        self.fails(1, *self.command("designs.csv", "results", "--no-keep-going"),
                   says=[self.FAILED["b"], "3 more bad rows", "nothing was computed"])
        self.assertFalse(os.path.exists(self.path("results")))
        status = self.status()
        self.assertEqual((status["systems_resident"], status["designs_served"]), (0, 0), "not even prepared")

    def test_verdicts_and_gates_are_told_again_without_computing_again(self):
        self.write("designs.csv", table([("a", (0.01, 0)), ("b", (0.04, 0))]))
        gate = ["--fail-on", "interpolation_residual<-1"]  # passes
        self.sweep("designs.csv", "results", *gate)
        failing = ["--fail-on", "prescribed_displacement>0.03"]
        for output in ("results", "results.tar"):
            report, error = self.sweep_fails(4, "designs.csv", output, *failing)
            self.assertEqual(report["written"], 2, "an earlier run did not look at this")
            self.assertEqual(list(report["gate"]), ["b"])
            self.assertIn("1 of 2 designs are bad, for example: b: prescribed_displacement>0.03: it is 0.04", error)
            self.assertEqual("deform: " + report["error"]["message"] + "\n", error)
            report, _ = self.sweep_fails(4, "designs.csv", output, *failing)
            self.assertEqual((report["written"], list(report["gate"])), (0, ["b"]))
            self.assertEqual(self.sweep("designs.csv", output)["gate"], {}, "nobody asks")
        self.fails(2, *self.command("designs.csv", "results", "--fail-on", "nonsense>1"), says=["nonsense"])

    def test_a_design_that_the_server_refuses_fails_alone(self):
        """Two points of one place cannot go apart, which no bound tells."""
        lines = [f"v {0.1 * (k % 11)} {0.1 * (k // 11)} 0" for k in range(121)] + ["v 0 0 0"]
        lines += [f"f {k + 11 * j} {k + 1 + 11 * j} {k + 12 + 11 * j} {k + 11 + 11 * j}" for j in range(10) for k in range(1, 11)]
        self.write("square.obj", "\n".join(lines + ["g first", "p 1", "g second", "p 122"]) + "\n")
        self.write("square.yaml", """geometry: square.obj
handles:
  - {name: first, region: {group: first}}
  - {name: far, region: {box: {min: [0.9, -1, -1], max: [2, 2, 1]}}}
fixed: [{group: second}]
variables:
  - {name: near_up, handle: first, translate: [0, 0, 1]}
  - {name: far_up, handle: far, translate: [0, 0, 1]}
""")
        self.write("designs.csv", "near_up,far_up\n0,0.1\n0.1,0.1\n0,0.2\n")
        for output in ("results", "results.tar"):
            result = self.fails(1, "sweep", "square.yaml", "--designs", "designs.csv", "-o", output, "--json", prints=True)
            report = result.json
            self.assertEqual((report["written"], list(report["failed"])), (2, ["design_0002"]))
            reason = report["failed"]["design_0002"]
            self.assertTrue(reason.startswith("designs.csv:3: points 0 (handle \"first\") and 121 (fixed) coincide"), reason)
            self.assertEqual(self.recorded(output).failed, report["failed"])
        served = self.status()["designs_served"]
        self.fails(1, "sweep", "square.yaml", "--designs", "designs.csv", "-o", "results", prints=True)
        self.assertEqual(self.status()["designs_served"], served, "tried again, and nothing else")

    def test_a_design_that_cannot_be_written_fails_alone(self):
        """Rows that only the server, or the file, can find out about."""
        self.write("free.yaml", AHMED_SETUP.replace(", lower: -0.05, upper: 0.05", "").replace("[0, 0, 1]}", "[0, 0, 10]}"))
        self.write("designs.csv", "roof_up\n0.01\n1e307\n-0.01\n")
        for output in ("results", "results.tar"):
            result = self.fails(4, "sweep", "free.yaml", "--designs", "designs.csv", "-o", output, "--json", prints=True)
            report = result.json
            self.assertEqual((report["written"], list(report["failed"])), (2, ["design_0002"]))
            self.assertTrue(report["failed"]["design_0002"].startswith("designs.csv:3: points move by up to "), report)
            self.assertIn("1 of 3 designs were not written, for example: designs.csv:3: ", result.err)
            self.assertEqual(self.recorded(output).failed, report["failed"])
        self.write("designs.csv", "roof_up\n0.01\n1e308\n-0.01\n")
        failed = self.fails(1, "sweep", "free.yaml", "--designs", "designs.csv", "-o", "results", "--json", prints=True).json["failed"]
        self.assertEqual(failed, {"design_0002": 'designs.csv:3: variables: they move handle "roof" farther than a number can say'})

    def test_the_error_of_every_design_is_recorded(self):
        rows = [(f"d{k}", (0.01 * k, -0.02 * k)) for k in range(4)]
        self.write("few.csv", table(rows))
        applied = {}
        for name, (roof_up, slant_turn) in rows:
            report = self.deform("apply", "setup.yaml", "--set", f"roof_up={roof_up}", "--set", f"slant_turn={slant_turn}", "-o", "one.obj",
                                 "--json").json["report"]
            applied[name] = {key: report[key] for key in ("estimated_error", "relative_error")}
        for output in ("few", "few.tar"):
            told = self.sweep("few.csv", output)["largest_error"]
            recorded = {entry["name"]: entry for entry in self.recorded(output).results.values()}
            self.assertEqual({name: {key: recorded[name][key] for key in applied[name]} for name in applied}, applied)
            worst = max(applied, key=lambda name: applied[name]["relative_error"])
            self.assertEqual(told, {"name": worst, **applied[worst]})
            again = self.sweep("few.csv", output)
            self.assertEqual((again["skipped"], again["largest_error"]), (4, told), "known of earlier results, too")
        self.assertIn("largest estimated error", self.deform(*self.command("few.csv", "few")).out)

    def test_designs_that_miss_exact_constraints_are_not_written(self):
        self.write("plate.obj", plate())
        ends = "[{union: [{box: {min: [-1, -1, -1], max: [0.1, 2, 1]}}, {box: {min: [1.9, -1, -1], max: [3, 2, 1]}}]}]"
        self.write("torn.yaml", setup("{mls: {}}", f"constraints: [{{name: ends, exact: true, rigid: {{}}, regions: {ends}}}]"))
        self.write("designs.csv", "name,pull,lift\nrest,0,0\ntorn,0.4,0\n")
        command = ["sweep", "torn.yaml", "--designs", "designs.csv", "-o"]
        for output in ("results", "results.tar"):
            done = self.fails(4, *command, output, "--json", says=["1 of 2 designs were not written", "designs.csv:3"], prints=True)
            self.assertEqual((done.json["written"], list(done.json["failed"])), (1, ["torn"]))
            self.assertRegex(done.json["failed"]["torn"], "^designs.csv:3: .*exact.*; not written without --keep-bad$")
            self.assertEqual(self.recorded(output).failed, done.json["failed"])
            names = self.members(output) if output.endswith(".tar") else self.contents(output)
            self.assertEqual(list(names), ["rest.obj"])
            done = self.fails(4, *command, output, "--json", "--keep-bad", prints=True)
            self.assertEqual((done.json["written"], done.json["failed"], list(done.json["bad"])), (1, {}, ["torn"]))
            done = self.fails(4, *command, output, "--json", prints=True)
            self.assertEqual((done.json["skipped"], list(done.json["bad"])), (2, ["torn"]))


class Places(Sweep):
    def test_a_server_that_restarts_is_waited_for(self):
        rows = [(f"d{k}", (0.0002 * k, -0.0005 * k)) for k in range(200)]
        self.write("many.csv", table(rows))
        child = self.spawn(*self.command("many.csv", "out", "--batch", 2))
        self.wait_until(lambda: os.path.exists(self.path("out")) and len(self.contents("out")) > 3, "it is under way")
        self.server.kill()
        time.sleep(1.5)  # longer than the client tries otherwise
        self.assertIsNone(child.poll(), "it waits")
        self.server.start()
        error = child.communicate(timeout=120)[1]
        self.assertEqual(child.returncode, 0, error)
        self.assertEqual(len(self.contents("out")), 200)
        self.sweep("many.csv", "other")
        self.assertEqual(self.contents("out"), self.contents("other"))
        self.server.kill()
        started = time.time()
        self.fails(3, *self.command("many.csv", "third"), says=["nobody listens there"])
        self.assertLess(time.time() - started, 15, "who was never there is not waited for")
        self.server.start()

    def test_archives_and_files_of_others_are_left_alone(self):
        self.write("designs.csv", table([("a", (0.01, 0))]))
        with tarfile.open(self.path("backup.tar"), "w") as archive:
            archive.add(self.path("ahmed.obj"), "ahmed.obj")
        before = read_bytes(self.path("backup.tar"))
        self.fails(1, *self.command("designs.csv", "backup.tar"), says=["backup.tar", "not of this sweep"])
        self.assertEqual(read_bytes(self.path("backup.tar")), before)
        os.mkdir(self.path("meshes"))
        self.write("meshes/a.obj", "mine")
        self.fails(1, *self.command("designs.csv", "meshes"), says=["meshes/a.obj", "not of this sweep"])
        self.assertEqual(os.listdir(self.path("meshes")), ["a.obj"])
        self.assertEqual(read_bytes(self.path("meshes/a.obj")), b"mine")

    def mount(self, folder, size):
        os.makedirs(folder, exist_ok=True)
        remount = "remount," if os.path.ismount(folder) else ""
        return subprocess.run(["mount", "-t", "tmpfs", "-o", f"{remount}size={size}", "tmpfs", folder], stdout=subprocess.DEVNULL,
                              stderr=subprocess.DEVNULL).returncode == 0

    def test_a_full_disk_loses_no_finished_design(self):
        disk = self.path("disk")
        if os.geteuid() != 0 or not self.mount(disk, 1 << 20):
            self.skipTest("needs root and the right to mount a tmpfs")
        self.addCleanup(subprocess.run, ["umount", disk])
        rows = [(f"d{k}", (0.001 * k, 0)) for k in range(24)]
        self.write("designs.csv", table(rows))
        self.sweep("designs.csv", "undisturbed")
        size = os.path.getsize(self.path("undisturbed/d5.obj"))
        for output in ("disk/results", "disk/results.tar"):
            for room in (10, 10, 14):  # the second time there is no room to begin with
                self.assertTrue(self.mount(disk, room * size))
                before = self.recorded(output)
                refused = self.fails(1, *self.command("designs.csv", output), says=["No space left on device", "disk/results"])
                recorded = self.recorded(output)
                self.assertLessEqual(before.hashes(), recorded.hashes(), "nothing finished is lost")
                told = re.search(r"(\d+) of 24 designs are done: run it again for the rest", refused.err)
                if before.hashes() != recorded.hashes():
                    self.assertEqual(int(told[1]), len(recorded.hashes()), "those of earlier runs count")
            known = len(recorded.hashes())
            self.assertGreater(known, 8)
            self.assertLess(known, 16)
            self.assertTrue(self.mount(disk, 80 * size))
            served = self.status()["designs_served"]
            report = self.sweep("designs.csv", output)
            self.assertEqual((report["skipped"], report["written"]), (known, 24 - known))
            self.assertEqual(self.status()["designs_served"] - served, 24 - known)
            contents = self.members(output) if output.endswith(".tar") else self.contents(output)
            self.assertEqual(contents, self.contents("undisturbed"))
            self.replaced_without_room(disk, output, size)
            for name in os.listdir(disk):
                path = os.path.join(disk, name)
                shutil.rmtree(path) if os.path.isdir(path) else os.remove(path)

    def replaced_without_room(self, disk, output, size):
        """A complete archive whose new version does not fit stays as it is."""
        if not output.endswith(".tar"):
            return
        before = read_bytes(self.path(output))
        self.write("changed.csv", table([(f"d{k}", (0.001 * k, 0.1 if k == 7 else 0)) for k in range(24)]))
        self.assertTrue(self.mount(disk, 30 * size))
        self.fails(1, *self.command("changed.csv", output), says=["No space left on device"])
        self.assertEqual(read_bytes(self.path(output)), before)
        self.assertTrue(self.mount(disk, 80 * size))
        self.assertEqual(self.sweep("changed.csv", output)["written"], 0, "the changed design was finished before")
        self.assertEqual(len(self.members(output)), 24)

    def test_a_limit_on_files_loses_no_finished_design(self):
        """The same without root: a file may not become longer than that."""
        self.write("designs.csv", table([(f"d{k}", (0.001 * k, 0)) for k in range(12)]))
        self.sweep("designs.csv", "undisturbed")
        limit = 5 * os.path.getsize(self.path("undisturbed/d5.obj"))

        def limited():
            signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
            resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))

        done = subprocess.run([DEFORM, *self.command("designs.csv", "results.tar")], cwd=self.folder, env=self.environment(),
                              preexec_fn=limited, timeout=60, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        self.assertEqual(done.returncode, 1, done.stderr)
        self.assertIn("results.tar.part: File too large", done.stderr)
        known = len(self.recorded("results.tar").hashes())
        self.assertGreater(known, 2)
        report = self.sweep("designs.csv", "results.tar")
        self.assertEqual((report["skipped"], report["written"]), (known, 12 - known))
        self.assertEqual(self.members("results.tar"), self.contents("undisturbed"))


if __name__ == "__main__":
    main()

#!/usr/bin/python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""Measures how many small faults in core/ the unit tests notice: makes mutants, builds them all at once, runs the tests for each.

usage: tests/mutation/mutate.py [--count 200] [--seed N] [--folders base,codec,...] [--again] [--least PERCENT] ...
README.md beside this file explains what is mutated and how to read the result.
"""
import argparse
import collections
import concurrent.futures
import dataclasses
import hashlib
import json
import math
import multiprocessing
import os
import pathlib
import random
import re
import shlex
import signal
import subprocess
import sys
import tempfile
import threading
import time

ROOT = pathlib.Path(__file__).resolve().parents[2]
# The test programs of each folder of core/. Those that need -DDEFORM_SHARED_DATA are run where they exist.
TESTS = {
    "base": ["base_test"],
    "codec": ["codec_test"],
    "compiled": ["compiled_test"],
    "mesh": ["mesh_test", "surface_mesh_test", "remeshing_test", "cages_test", "mesh_shared_data_test", "remeshing_shared_data_test",
             "cages_shared_data_test"],
    "quality": ["quality_test", "quality_memory_test", "quality_shared_data_test"],
    "measures": ["measures_test", "measures_shared_data_test"],
    "numerics": ["numerics_test", "sparse_test", "cyclic_test", "numerics_memory_test"],
    "io": ["io_test", "containers_test", "io_shared_data_test", "io_shared_grids_test", "shared_containers_test"],
    "constraints": ["constraints_test", "detection_test", "detection_shared_data_test"],
    "deformers": ["deformers_test", "rbf_test", "basis_test", "energy_test", "ffd_test", "mls_space_test", "compiled_form_test",
                  "reduction_test", "symmetry_test", "exact_test", "rbf_tolerance_test", "energy_error_test", "space_map_test",
                  "composed_test", "sector_test", "contract_test", "condition_test", "direct_error_test", "layers_test", "misfit_rule_test",
                  "exact_joins_test", "delivered_constraints_test", "units_test", "memory_test", "affine_shared_test", "exact_shared_test",
                  "ffd_shared_test", "symmetry_shared_test"],
    "report": ["report_test"],
    "cad": ["cad_apply_test", "cad_regions_test", "cad_move_test", "cad_marks_test", "cad_pairs_test", "cad_parts_test", "cad_round_trip_test",
            "without_cad_test"],
}
LEFT_OUT = {"scipy_test": "starts an interpreter for every test"}
MOST = 65536  # mutants of one run
HEADER = """#pragma once
// The mutant that runs: its number stands in DEFORM_MUTANT; none without it. DEFORM_MUTANTS_REACHED names a file with a byte for each
// mutant that becomes 1 where the program comes by.
#include <fcntl.h>
#include <sys/mman.h>
#include <unistd.h>
#include <atomic>
#include <cstdlib>
namespace deform_mutant {
inline unsigned char* map_reached() {
  const char* name = std::getenv("DEFORM_MUTANTS_REACHED");
  const int file = name ? ::open(name, O_RDWR | O_CLOEXEC) : -1;
  if (file < 0) return nullptr;
  void* bytes = ::mmap(nullptr, %d, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
  ::close(file);
  return bytes == MAP_FAILED ? nullptr : static_cast<unsigned char*>(bytes);
}
inline const int chosen = std::getenv("DEFORM_MUTANT") ? std::atoi(std::getenv("DEFORM_MUTANT")) : -1;
inline unsigned char* const reached = map_reached();
inline bool on(int number) {
  if (reached) std::atomic_ref<unsigned char>(reached[number]).store(1, std::memory_order_relaxed);
  return number == chosen;
}
}  // namespace deform_mutant
""" % MOST


def say(text):
    print(time.strftime("%H:%M:%S ") + text, flush=True)


# --- the copy of the tree -------------------------------------------------------------------------------------------------------------

def write_if_changed(path, data):
    if not path.is_file() or path.read_bytes() != data:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)


def copy_tree(tree, only=""):
    names = subprocess.run(["git", "ls-files", "-co", "--exclude-standard", "-z", "."], cwd=ROOT, capture_output=True, check=True)
    for name in names.stdout.decode().split("\0"):
        source = ROOT / name
        if name and name.startswith(only) and source.is_file():
            write_if_changed(tree / name, source.read_bytes())
            (tree / name).chmod(source.stat().st_mode)


def configure(tree, options):
    subprocess.run(["cmake", "-S", tree, "-B", tree / "build/release", "-G", "Ninja", "-DCMAKE_BUILD_TYPE=Release",
                    "-DCMAKE_EXPORT_COMPILE_COMMANDS=ON", "-DDEFORM_BUILD_BENCH=OFF", "-DDEFORM_BUILD_PYTHON=ON", *options],
                   check=True, stdout=subprocess.DEVNULL)


# --- places ---------------------------------------------------------------------------------------------------------------------------

def includes_of(path):
    return {pathlib.Path(name) for name in re.findall(r'^#include "(core/[^"]+)"', (ROOT / path).read_text(), re.M)}


class Includes:
    """Who includes what in core/ and tests/core."""

    def __init__(self):
        paths = [p.relative_to(ROOT) for top in ("core", "tests/core", "proto/convert") for p in (ROOT / top).rglob("*")
                 if p.suffix in (".h", ".cpp")]
        self.direct = {p: includes_of(p) for p in paths}
        self.users = collections.defaultdict(set)
        for path, names in self.direct.items():
            for name in names:
                self.users[name].add(path)

    def sources_with(self, header):
        seen, todo = set(), [header]
        while todo:
            for user in self.users[todo.pop()]:
                if user not in seen:
                    seen.add(user)
                    todo.append(user)
        return sorted(p for p in seen if p.suffix == ".cpp")

    def source_of(self, header):
        beside = header.with_suffix(".cpp")
        users = self.sources_with(header)
        inside = [p for p in users if p.parts[0] == "core"]
        return beside if beside in users else (inside or users or [None])[0]


def arguments_of(tree):
    """Per folder of core/ (and per source): the include folders, definitions and the standard."""
    found = {}
    for entry in json.loads((tree / "build/release/compile_commands.json").read_text()):
        words = shlex.split(entry["command"])
        kept, position = [], 0
        while position < len(words):
            word = words[position]
            if word == "-isystem":
                kept += [word, words[position + 1]]
                position += 1
            elif word.startswith(("-I", "-D", "-std=")):
                kept.append(word)
            position += 1
        # Sources are read where they are; what the build makes is in the copy.
        kept = [f"-I{ROOT}" if k == f"-I{tree}" else k for k in kept]
        name = entry["file"]
        found[name.replace(str(tree), str(ROOT), 1)] = kept
        target = re.search(r"core/.*?/CMakeFiles/deform_(\w+)\.dir", entry["command"])
        if target:
            found.setdefault(target.group(1), kept)
    return found


def parse(job):
    source, file, arguments = job
    from clang import cindex
    import places
    library = os.environ.get("DEFORM_LIBCLANG", "/usr/lib/llvm-14/lib/libclang.so.1")
    if not cindex.Config.loaded:
        cindex.Config.set_library_file(library)
    return places.find_places(str(source), [str(file)], arguments)


def code_lines(path):
    lines = (ROOT / path).read_text().splitlines()
    return sum(1 for line in lines if line.strip() and not line.strip().startswith("//"))


def draw_mutants(tree, folders, count, seed, widest):
    """Draws files by their lines of code, then a line with places in it, then a kind, then a place. The order is random."""
    rng = random.Random(seed)
    includes = Includes()
    files, left_out = [], 0
    for path in sorted(includes.direct):
        if path.parts[0] != "core" or path.parts[1] not in folders or path.name.endswith("-inl.h"):
            continue
        if path.suffix == ".h" and len(includes.sources_with(path)) > widest:
            left_out += code_lines(path)
            continue
        files.append(path)
    weights = [code_lines(path) for path in files]
    say(f"{len(files)} files with {sum(weights)} lines of code; headers that more than {widest} sources read have {left_out} more")
    arguments = arguments_of(tree)
    drawn = rng.choices(files, weights, k=count)
    jobs = {}
    for path in dict.fromkeys(drawn):
        source = path if path.suffix == ".cpp" else includes.source_of(path)
        if source is None:
            continue
        known = arguments.get(str(ROOT / source)) or arguments.get(source.parts[1])
        if known is None:
            known = next(iter(arguments.values()))
        jobs[path] = (ROOT / source, ROOT / path, known)
    with multiprocessing.Pool(2) as pool:
        found = dict(zip(jobs, pool.map(parse, jobs.values(), chunksize=1)))
    mutants, taken = [], collections.defaultdict(list)
    for path in drawn:
        by_line = collections.defaultdict(list)
        for place in found.get(path, []):
            if all(place.end <= a or b <= place.start for a, b in taken[path]):
                by_line[place.line].append(place)
        if not by_line:
            continue
        here = by_line[rng.choice(sorted(by_line))]
        kind = rng.choice(sorted({p.kind for p in here}))
        place = rng.choice(sorted((p for p in here if p.kind == kind), key=lambda p: (p.start, p.end, p.mutated)))
        taken[path].append((place.start, place.end))
        mutant = dataclasses.asdict(place)
        mutant.update(file=str(path), number=len(mutants), last_line=place.line + place.original.count("\n"))
        mutants.append(mutant)
    return mutants


def write_mutants(tree, mutants):
    by_file = collections.defaultdict(list)
    for mutant in mutants:
        by_file[mutant["file"]].append(mutant)
    write_if_changed(tree / "deform_mutant.h", HEADER.encode())
    for name, here in by_file.items():
        text = (ROOT / name).read_bytes()
        for mutant in sorted(here, key=lambda m: -m["start"]):
            assert text[mutant["start"]:mutant["end"]].decode() == mutant["original"], name
            if not mutant.get("dropped"):
                schema = mutant["schema"].replace("@", str(mutant["number"]))
                text = text[:mutant["start"]] + schema.encode() + text[mutant["end"]:]
        first, rest = text.split(b"\n", 1)  # the first line names the licence; the number of lines stays
        assert first.startswith(b"//"), name
        write_if_changed(tree / name, b'#include "deform_mutant.h"\n' + rest)


# --- build ----------------------------------------------------------------------------------------------------------------------------

def build(tree, log, mutants, targets, jobs):
    """Builds, taking out again what does not compile."""
    folder = tree / "build/release"
    while True:
        done = subprocess.run(["nice", "-n", "3", "ninja", "-C", folder, "-k", "0", f"-j{jobs}", *targets], capture_output=True, text=True,
                              check=False)
        log.write_text(done.stdout + done.stderr)
        if done.returncode == 0:
            return
        # The places in the text of an error and its notes, of which one is inside the mutant.
        bad = set()
        seen = set()
        for name, line in re.findall(r"([\w./+-]+\.(?:h|cpp)):(\d+)", done.stdout):
            path = pathlib.Path(os.path.normpath(folder / name))
            if path.is_relative_to(tree):
                seen.add((str(path.relative_to(tree)), int(line)))
        errors = {(str(pathlib.Path(os.path.normpath(folder / name)).relative_to(tree)), int(line))
                  for name, line in re.findall(r"([\w./+-]+\.(?:h|cpp)):(\d+):\d+: (?:fatal )?error:", done.stdout)
                  if pathlib.Path(os.path.normpath(folder / name)).is_relative_to(tree)}
        for spots in (errors, seen):
            for mutant in mutants:
                if not mutant.get("dropped") and any(name == mutant["file"] and mutant["line"] <= line <= mutant["last_line"]
                                                     for name, line in spots):
                    bad.add(mutant["number"])
            if bad:
                break
        if not bad:
            sys.exit(f"the build failed for another reason than a mutant: see {log}")
        for mutant in mutants:
            if mutant["number"] in bad:
                mutant["dropped"] = True
                say(f"does not compile: {mutant['file']}:{mutant['line']} {mutant['original'][:60]!r} -> {mutant['mutated'][:60]!r}")
        write_mutants(tree, mutants)


# --- tests ----------------------------------------------------------------------------------------------------------------------------

def run_binary(binary, number, tests, limit, reached=None):
    """(name of the test that failed, or None; its processor time; whether that was over the limit, in seconds)"""
    environment = dict(os.environ, OPENBLAS_NUM_THREADS="1")
    environment.pop("DEFORM_MUTANT", None)
    if number is not None:
        environment["DEFORM_MUTANT"] = str(number)
    if reached is not None:
        environment["DEFORM_MUTANTS_REACHED"] = str(reached)
    words = [binary, "--gtest_fail_fast", "--gtest_brief=0", "--gtest_filter=" + ":".join(tests)]
    with tempfile.TemporaryDirectory() as scratch, tempfile.TemporaryFile() as output:
        environment["TMPDIR"] = scratch
        # What a shell starts in the background ignores interrupts, and so would the tests of them.
        limited = f'ulimit -v 12000000; ulimit -f 4000000; ulimit -t {math.ceil(limit)}; exec env --default-signal=INT,QUIT "$@"'
        with subprocess.Popen(["bash", "-c", limited, "bash", *map(str, words)], cwd=scratch, env=environment, stdout=output,
                              stderr=subprocess.STDOUT, start_new_session=True) as process:
            # Processor time does not depend on what else the machine does; what sleeps for ever is ended, too.
            asleep = threading.Timer(6 * limit + 30, os.killpg, (process.pid, signal.SIGKILL))
            asleep.start()
            _, status, usage = os.wait4(process.pid, 0)
            asleep.cancel()
            process.returncode = code = os.waitstatus_to_exitcode(status)
        seconds = usage.ru_utime + usage.ru_stime
        output.seek(0, os.SEEK_END)
        output.seek(max(0, output.tell() - 1_000_000))
        text = output.read().decode(errors="replace")
    if code == 0:
        return None, seconds, False
    over = code in (-signal.SIGXCPU, -signal.SIGKILL)
    failed = re.findall(r"\[  FAILED  \] ([^\s,]+/?[^\s,]*)", text)
    running = re.findall(r"\[ RUN      \] (\S+)", text)
    name = failed[0] if failed and not over else (running[-1] if running else "start")
    how = "" if failed and not over else (" (time)" if over else f" (exit {code})")
    return name + how, seconds, over


def tests_of(binary):
    text = subprocess.run([binary, "--gtest_list_tests"], capture_output=True, text=True, check=True).stdout
    names, suite = [], ""
    for line in text.splitlines():
        word = line.split("#")[0].strip()
        if line.startswith("  "):
            names.append(suite + word)
        elif word.endswith("."):
            suite = word
    return names


def measure(binary, name, again):
    """Runs one test without a mutant: its seconds, and the mutants that it comes by."""
    with tempfile.NamedTemporaryFile() as reached:
        reached.truncate(MOST)
        failed, seconds, _ = run_binary(binary, None, [name], 900, reached.name)
        if failed and not again:
            sys.exit(f"{binary} fails without a mutant: {failed}")
        if failed:  # a test of what has been mended since the mutants were made
            say(f"left out, as it fails without a mutant: {failed}")
            return {"seconds": round(seconds, 2), "reached": []}
        return {"seconds": round(seconds, 2), "reached": [n for n, byte in enumerate(pathlib.Path(reached.name).read_bytes()) if byte]}


def measure_tests(paths, pool, stored, again):
    """Per program and test: measure(); what was measured of the same program before is taken from the file `stored`."""
    before = json.loads(stored.read_text()) if stored.is_file() else {}
    measured = {}
    for program, path in paths.items():
        state = hashlib.sha256(path.read_bytes()).hexdigest()
        if before.get(program, {}).get("state") != state:
            names = tests_of(path)
            before[program] = {"state": state, "tests": dict(zip(names, pool.map(lambda name, at=path: measure(at, name, again), names)))}
            stored.write_text(json.dumps(before) + "\n")
        measured[program] = before[program]["tests"]
    return measured


def run_mutant(number, programs, slow, factor):
    """Runs the tests that come by the mutant; `programs` are (path, tests) with what measure() says of each test."""
    each = []
    for path, tests in programs:
        near = {name: test["seconds"] for name, test in tests.items() if number in test["reached"]}
        quick = [name for name, seconds in near.items() if seconds <= slow]
        each.append((sum(near[name] for name in quick), path, quick, bool(near)))
    for total, path, quick, _ in sorted(each, key=lambda e: e[0]):
        if not quick:
            continue
        killer, seconds, over = run_binary(path, number, quick, total * factor + 5)
        if killer:
            return {"killed": f"{path.name}: {killer}", "seconds": round(seconds, 1), "time": over}
    return {"killed": None, "tests": sum(len(e[2]) for e in each), "slow_only": not any(e[2] for e in each) and any(e[3] for e in each)}


# --- report ---------------------------------------------------------------------------------------------------------------------------

def difference(mutant):
    return f"{mutant['kind']}: {' '.join(mutant['original'].split())!r} -> {mutant['mutated']!r}"


def coverage(result):
    """How many tests a survivor had to pass."""
    if result.get("tests"):
        return f"{result['tests']} tests"
    return "only slow tests come by" if result.get("slow_only") else "no test comes by"


def load_equivalent(path):
    """Mutants that no test can notice: a JSON list of file, original, mutated and reason."""
    return json.loads(path.read_text()) if path and path.is_file() else []


def report(mutants, work, equivalent, folders):
    """Writes and prints the table. Gives the share of those that count that were killed, in percent."""
    kept = [m for m in mutants if not m.get("dropped") and "killed" in m]
    for mutant in kept:
        mutant["equivalent"] = next((e["reason"] for e in equivalent if e["file"] == mutant["file"] and e["original"] == mutant["original"]
                                     and e["mutated"] == mutant["mutated"] and e.get("line", mutant["line"]) == mutant["line"]), None)
    (work / "result.json").write_text(json.dumps(kept, indent=1) + "\n")
    lines = []
    for mutant in kept:
        if mutant["killed"] is None:
            reason = mutant["equivalent"]
            lines.append(f"{mutant['number']:4} {mutant['file']}:{mutant['line']}  {difference(mutant)} ({coverage(mutant)})"
                         + (f"\n       equivalent: {reason}" if reason else ""))
    table = ["folder        mutants  killed  (time)  equivalent  survived   killed of those that count"]
    for folder in [*folders, "all"]:
        here = [m for m in kept if folder in ("all", m["file"].split("/")[1])]
        killed = [m for m in here if m["killed"]]
        same = [m for m in here if not m["killed"] and m["equivalent"]]
        count = len(here) - len(same)
        share = 100 * len(killed) / max(count, 1)
        table.append(f"{folder:12} {len(here):8} {len(killed):7} {sum(m.get('time', False) for m in killed):7} {len(same):11} "
                     f"{count - len(killed):9}   {share:5.1f} %")
    text = "survivors\n" + "\n".join(lines) + "\n\n" + "\n".join(table) + "\n"
    (work / "result.txt").write_text(text)
    print(text)
    return share


def verdict(share, least):
    """The exit code: 1 when fewer mutants were killed than must be, in percent of those that count."""
    if share >= least:
        return 0
    say(f"{share:.1f} % of the mutants were killed, fewer than --least {least:g} %")
    return 1


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--count", type=int, default=200, help="mutants (default 200)")
    parser.add_argument("--seed", type=int, default=1, help="of the random choice (default 1)")
    parser.add_argument("--folders", default=",".join(TESTS), help="folders of core/, with commas")
    parser.add_argument("--work", type=pathlib.Path, default=ROOT / "build/mutation", help="the copy, its build and the result")
    parser.add_argument("--cmake", action="append", default=[], metavar="OPTION", help="an option for CMake, such as -DDEFORM_SHARED_DATA=...")
    parser.add_argument("--jobs", type=int, default=2, help="at the same time (default 2)")
    parser.add_argument("--slow", type=float, default=2, help="tests that take more processor time are left out, seconds (default 2)")
    parser.add_argument("--factor", type=float, default=10, help="limit of processor time, in times of the tests without a mutant, + 5 s (default 10)")
    parser.add_argument("--widest", type=int, default=12, help="headers that more sources read are left alone (default 12)")
    parser.add_argument("--without", default="^$", metavar="REGEX", help="test programs that are not run, such as shared_data")
    parser.add_argument("--minutes", type=float, default=90, help="mutants that have not run after this time are left out (default 90)")
    parser.add_argument("--least", type=float, default=0, metavar="PERCENT",
                        help="exit code 1 when fewer of those that count are killed (default 0: never)")
    parser.add_argument("--again", action="store_true", help="the same mutants with the tests as they are now: those that survived")
    parser.add_argument("--list", action="store_true", help="only show the mutants")
    parser.add_argument("--table", action="store_true", help="only show the last result again")
    options = parser.parse_args()
    folders = options.folders.split(",")
    unknown = [f for f in folders if f not in TESTS]
    if unknown:
        parser.error(f"--folders: {unknown[0]} is none of {', '.join(TESTS)}")
    work = options.work.resolve()
    tree = (work / "tree").resolve()  # a link leads to where ccache knows the sources
    work.mkdir(parents=True, exist_ok=True)
    equivalent = load_equivalent(pathlib.Path(__file__).with_name("equivalent.json"))
    if options.table:
        return verdict(report(json.loads((work / "result.json").read_text()), work, equivalent, folders), options.least)
    if options.again:
        mutants = json.loads((work / "mutants.json").read_text())
        earlier = work / "result.json"
        before = {m["number"]: m for m in json.loads(earlier.read_text())} if earlier.is_file() else {}
        copy_tree(tree, "tests/")
    else:
        copy_tree(tree)
        configure(tree, options.cmake)
        mutants = draw_mutants(tree, folders, options.count, options.seed, options.widest)
        before = {}
        say(f"{len(mutants)} mutants in {len({m['file'] for m in mutants})} files")
        if options.list:
            for mutant in mutants:
                print(f"{mutant['number']:4} {mutant['file']}:{mutant['line']}  {difference(mutant)}")
            return 0
        write_mutants(tree, mutants)
    used = {m["file"].split("/")[1] for m in mutants if not (before.get(m["number"]) or {}).get("killed")}
    known = subprocess.run(["ninja", "-C", tree / "build/release", "-t", "targets", "all"], capture_output=True, text=True, check=True).stdout
    programs = {f: [t for t in TESTS[f] if re.search(rf"^{t}: phony", known, re.M) and not re.search(options.without, t)] for f in folders if f in used}
    targets = sorted({t for each in programs.values() for t in each})
    begin = time.monotonic()
    build(tree, work / "build.log", mutants, targets, options.jobs)
    say(f"built {len(targets)} test programs in {time.monotonic() - begin:.0f} s; "
        f"{sum(1 for m in mutants if m.get('dropped'))} mutants did not compile")
    (work / "mutants.json").write_text(json.dumps(mutants, indent=1) + "\n")
    begin = time.monotonic()
    pool = concurrent.futures.ThreadPoolExecutor(options.jobs)
    paths = {t: next(p for p in (tree / "build/release/tests/core").rglob(t) if p.is_file()) for t in targets}
    measured = measure_tests(paths, pool, work / "tests.json", options.again)
    for name, tests in measured.items():
        seconds = [test["seconds"] for test in tests.values()]
        slow = [test for test in tests if tests[test]["seconds"] > options.slow]
        say(f"{name}: {len(tests)} tests, {sum(seconds):.1f} s; slow tests left out: {len(slow)} {' '.join(slow[:6])}")

    def run(mutant):
        earlier = before.get(mutant["number"]) or {}
        if earlier.get("killed"):
            return {k: earlier[k] for k in ("killed", "seconds", "time")}
        if time.monotonic() - begin > options.minutes * 60:
            return {}
        here = [(paths[name], measured[name]) for name in programs[mutant["file"].split("/")[1]]]
        result = run_mutant(mutant["number"], here, options.slow, options.factor)
        say(f"{mutant['number']:4} {result['killed'] or 'SURVIVED ' + coverage(result)}  {mutant['file']}:{mutant['line']} {difference(mutant)[:120]}")
        return result

    live = [m for m in mutants if not m.get("dropped")]
    for mutant, result in zip(live, pool.map(run, live)):
        mutant.update(result)
    missing = sum(1 for m in live if "killed" not in m)
    if missing:
        say(f"{missing} mutants did not run in {options.minutes:.0f} minutes")
    return verdict(report(mutants, work, equivalent, folders), options.least)


if __name__ == "__main__":
    sys.path.insert(0, str(pathlib.Path(__file__).parent))
    sys.exit(main())

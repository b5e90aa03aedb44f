#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""Meshes that follow CAD models (thesis 6.2): the Ahmed body, a car, a bore and a pipe, and both of these in four steps as a chain.

usage: cad_table.py BUILD SHARED_DATA [--chain-only]      prints a table of required against measured; exit code 1 when something is missed
Distances are in D, the diagonal of the bounding box of the new model. "off" is measured by the command, by projection onto the trimmed
entity of each tenth node or so; the pipe and the bore are also judged by the parameters of their models, and by tables of where
the nodes of the boundary go that were made from the same parameters (with nine digits).
"""
import argparse
import csv
import gzip
import json
import math
import os
import pathlib
import shutil
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parents[2]
parser = argparse.ArgumentParser()
parser.add_argument("build", type=pathlib.Path)
parser.add_argument("data", type=pathlib.Path)
parser.add_argument("--chain-only", action="store_true")
options = parser.parse_args()
BUILD, DATA = options.build.resolve(), options.data.resolve()
os.environ["DEFORM_BIN"], os.environ["DEFORMD_BIN"] = str(BUILD / "client/cli/deform"), str(BUILD / "server/deformd")
sys.path.insert(0, str(ROOT / "tests/end_to_end"))

from harness import DEFORM, Server  # noqa: E402

CAD, PARAM, SURFACE = DATA / "D_cad", DATA / "B_volume/param", DATA / "A_surface"
FOLDER = pathlib.Path(tempfile.mkdtemp(prefix="deform-cad-"))
SERVER = Server(str(FOLDER)).start()
missed = []


def deform(*arguments):
    done = subprocess.run([DEFORM, *map(str, arguments), "--json"], cwd=FOLDER, env={**os.environ, "DEFORM_SERVER": SERVER.address}, text=True,
                          stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    if done.returncode not in (0, 4):
        sys.exit(f"deform {' '.join(map(str, arguments))}: {done.stderr}")
    return json.loads(done.stdout)


def check(good, what):
    if not good:
        missed.append(what)
    return "" if good else "  MISSED"


def unpacked(path):
    target = FOLDER / path.name.removesuffix(".gz")
    with gzip.open(path) as source, open(target, "wb") as file:
        shutil.copyfileobj(source, file)
    return target


def table(kind):
    """Node ids, patches and 21 places each."""
    with gzip.open(PARAM / f"{kind}_boundary_steps.csv.gz", "rt") as file:
        rows = list(csv.reader(file))[1:]
    return {int(row[0]): (row[1].split("|"), [tuple(map(float, row[2 + 3 * k:5 + 3 * k])) for k in range(21)]) for row in rows}


def from_axis(p, axis):
    along = sum(a * b for a, b in zip(p, axis))
    return math.sqrt(max(0.0, sum((a - along * b) ** 2 for a, b in zip(p, axis))))


def off_bore(p, patches, part):
    """Distance from the analytic surfaces on which a node of the bore lies."""
    tilt, distances = math.radians(20 * part), []
    if "hole" in patches:
        shifted = (p[0] - 0.3 * part, p[1], p[2])
        distances.append(min(abs(from_axis(shifted, axis) - 0.5 - 0.3 * part) for axis in ((math.sin(tilt), 0, math.cos(tilt)), (-math.sin(tilt), 0, math.cos(tilt)),
                                                                                        (0, math.sin(tilt), math.cos(tilt)), (0, -math.sin(tilt), math.cos(tilt)))))
    if "top" in patches or "bottom" in patches:
        distances.append(abs(abs(p[2]) - 1))
    return max(distances, default=0.0)


def off_pipe(p, patches, part):
    """Distance from the legs and the bend of the wall of the pipe."""
    inner, outer, bend, angle = 0.7 - 0.15 * part, 1 + 0.15 * part, 3 - 0.8 * part, math.radians(90 - 30 * part)
    first = 2 + 2 * part
    centre = (bend, 0.0, first)
    end = (bend - bend * math.cos(angle), 0.0, first + bend * math.sin(angle))
    axis = (math.sin(angle), 0.0, math.cos(angle))
    distances = []
    for name, radius in (("inner", inner), ("outer", outer)):
        if name not in patches:
            continue
        ring = math.hypot(p[0] - centre[0], p[2] - centre[2])
        beyond = sum((a - b) * c for a, b, c in zip(p, end, axis))
        if p[2] <= first:
            distances.append(abs(math.hypot(p[0], p[1]) - radius))
        elif beyond >= 0:
            distances.append(abs(from_axis([a - b for a, b in zip(p, end)], axis) - radius))
        else:
            distances.append(abs(math.hypot(ring - bend, p[1]) - radius))
    if "inlet" in patches:
        distances.append(abs(p[2]))
    return max(distances, default=0.0)


def motions_of(path):
    with open(path) as file:
        return {int(row["point"]): [float(row[k]) for k in ("dx", "dy", "dz")] for row in csv.DictReader(file)}


def row(name, moved, extra=""):
    off = moved["distance"] / moved["diagonal"]
    verdict = check(off <= 1e-9 and moved["flipped"] == 0 and moved["outside"] == 0, name)
    mended = sum(face["warp_flipped"] + face["warp_outside"] for face in moved["faces"]) - moved["flipped"] - moved["outside"]
    print(f"{name:28} {moved['nodes']:6} {off:9.1e} {moved['flipped']:8} {moved['outside']:8} {mended:7}{extra}{verdict}", flush=True)


def unchanged(moved, numbers):
    """The largest motion of a node of these faces, in D."""
    return max((face["max_displacement"] for face in moved["faces"] if face["before"] in numbers), default=0.0) / moved["diagonal"]


def single_moves():
    print(f"{'from -> to':28} {'nodes':>6} {'off, D':>9} {'flipped':>8} {'outside':>8} {'mended':>7}   judged by parameters, by tables; faces that stay")
    for name, old, new, stl in (("Ahmed body 25 -> 35 degrees", "ahmed_slant25", "ahmed_slant35", "ahmed_slant25"),
                                ("car, roof and wheelbase", "car_fastback_p0", "car_fastback_p1", "car_fastback")):
        mesh = unpacked(SURFACE / f"{stl}.stl.gz")
        moved = deform("cad-move", CAD / f"{old}.step", CAD / f"{new}.step", mesh, "-o", "moved.stl")
        still = sum(face["max_displacement"] <= 1e-12 * moved["diagonal"] for face in moved["faces"])
        row(name, moved, f"   {still} of {len(moved['faces'])} faces stay")
    for kind, mesh in (("bore_tet", "bore_tet_p0.msh.gz"), ("bore_hex", "bore_hex_p0.vtk.gz"), ("pipe_tet", "pipe_tet_p0.msh.gz"), ("pipe_hex", "pipe_hex_p0.vtu")):
        places, model = table(kind), kind.split("_")[0]
        for share in (25, 50, 75, 100):
            part = share / 100
            moved = deform("cad-move", CAD / f"{model}_p000.step", CAD / f"{model}_p{share:03}.step", PARAM / mesh, "-o", "motions.csv")
            motions = motions_of(FOLDER / "motions.csv")
            analytic = tables = still = 0.0
            for node, (patches, steps) in places.items():
                if node not in motions:
                    continue
                place = [a + b for a, b in zip(steps[0], motions[node])]
                analytic = max(analytic, (off_bore if model == "bore" else off_pipe)(place, patches, part))
                if patches != ["inlet"] and patches != ["outlet"]:  # the tables move the inside of these another way
                    tables = max(tables, math.dist(place, steps[share // 5]))
                if patches == ["side"]:
                    still = max(still, math.hypot(*motions[node]))
            extra = f"   {analytic / moved['diagonal']:.0e}, {tables / moved['diagonal']:.0e}"
            if model == "bore":
                extra = f"   {analytic / moved['diagonal']:.0e}, -; sides move {still:.0e}" + check(still <= 1e-12 * moved["diagonal"], f"{kind} {share}: sides")
            row(f"{kind} 0 -> {share} %", moved, extra + check(analytic <= 1e-8 * moved["diagonal"], f"{kind} {share}: surfaces"))


def scaled_jacobian(mesh):
    return deform("quality", mesh)["scaled_jacobian"]


def by_table(here, places, step, target):
    """The quality where the boundary goes to a row of the table and the interior follows by the same method."""
    with open(FOLDER / "table.csv", "w") as file:
        file.write("handle,point,x,y,z\n")
        for node, (_, steps) in places.items():
            file.write(f"boundary,{node}," + ",".join(map(repr, steps[step])) + "\n")
    (FOLDER / "table.yaml").write_text(f"geometry: '{here}'\nmethod:\n  rbf: {{kernel: TRIHARMONIC}}\nhandles:\n  - {{name: boundary, region: {{boundary: true}}}}\n")
    deform("apply", "table.yaml", "--motions", "table.csv", "-o", target, "--keep-bad")
    return scaled_jacobian(target)


def by_models(model, before, after, here, target):
    moved = deform("cad-move", CAD / f"{model}_p{before}.step", CAD / f"{model}_p{after}.step", here, "--setup", "models.yaml", "-o", target, "--keep-bad")
    return moved, scaled_jacobian(target)


def chains():
    """Step by step, each from the mesh of the one before, and at once from the first mesh: by the models and by the tables."""
    print(f"\nleast scaled Jacobian {'':6} {'chain':>8} {'table':>8} {'at once':>9} {'table':>8} {'flipped':>8} {'outside':>8}   verdict of the chain")
    for kind, mesh in (("bore_tet", "bore_tet_p0.msh.gz"), ("bore_hex", "bore_hex_p0.vtk.gz"), ("pipe_tet", "pipe_tet_p0.msh.gz"), ("pipe_hex", "pipe_hex_p0.vtu")):
        places, model = table(kind), kind.split("_")[0]
        start = unpacked(PARAM / mesh) if mesh.endswith(".gz") else pathlib.Path(shutil.copy(PARAM / mesh, FOLDER))
        here = theirs = start
        before = "000"
        for share in (25, 50, 75, 100):
            after, step = f"{share:03}", share // 5
            files = [FOLDER / f"{kind}_{name}_{share}{start.suffix}" for name in ("chain", "chain_table", "once", "once_table")]
            moved, chain = by_models(model, before, after, here, files[0])
            chain_table = by_table(theirs, places, step, files[1])
            at_once, once = by_models(model, "000", after, start, files[2])
            once_table = by_table(start, places, step, files[3])
            flipped, outside = moved["flipped"] + at_once["flipped"], moved["outside"] + at_once["outside"]
            bad = check(chain >= chain_table - 0.01 and once >= once_table - 0.01 and flipped + outside == 0, f"{kind} {share}")
            print(f"{kind:20} {share:5} % {chain:8.4f} {chain_table:8.4f} {once:9.4f} {once_table:8.4f} {flipped:8} {outside:8}   "
                  f"{moved['applied']['report']['verdict']}{bad}", flush=True)
            here, theirs, before = files[0], files[1], after


try:
    if not options.chain_only:
        single_moves()
    chains()
finally:
    SERVER.stop()
    shutil.rmtree(FOLDER, ignore_errors=True)
if missed:
    print("missed: " + "; ".join(missed))
sys.exit(1 if missed else 0)

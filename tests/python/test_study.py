# SPDX-License-Identifier: GPL-3.0-or-later
"""Studies from end to end, through the command, with a real server."""

import hashlib
import json
import os
import random
import re
import signal
import threading
import time
import types

import numpy as np
import pytest
from conftest import brick
from scipy.stats import qmc

import deformd
from deformd.study import read_spec
from deformd.measures import CentreOfGravity, Thickness, Volume
from deformd.quality import Quality, differences

PLACE_DESIGNS = int(os.environ.get("DEFORM_PLACE_DESIGNS", "16"))
KILLS = int(os.environ.get("DEFORM_STUDY_KILLS", "3"))


# ---- designs of experiments ----


def test_a_design_of_experiments(study, system):
    code, told = study("doe: {latin_hypercube: 8}\nevaluate: {measures: {v: volume, a: area, f: {projected_area: x}}}\nseed: 3\nplace: {threads: 2}")
    assert code == 0, told
    low, high = system.bounds.T
    expected = low + qmc.LatinHypercube(2, seed=3).random(8) * (high - low)
    rows = study.history()
    np.testing.assert_array_equal([[float(row[name]) for name in system.names] for row in rows], expected)
    volume = Volume(system.geometry)
    for row, x in zip(rows, expected):
        assert float(row["v"]) == pytest.approx(volume.value(system(x)), rel=1e-12)
    assert "<svg" in (study.folder / "report.html").read_text()
    assert [each["number"] for each in json.loads((study.folder / "history.json").read_text())] == list(range(8))


def test_a_table_is_that_of_a_sweep(study, case, tmp_path):
    """The same file serves both; a column is left at 0 where there is none."""
    (tmp_path / "designs.csv").write_text("name; roof_up\nfirst; 0.01\n\nsecond;-0.02\n")
    code, told = study("doe: {table: designs.csv}\nevaluate: {measures: {v: volume}}")
    assert code == 0, told
    case.command("sweep", case.setup, "--designs", tmp_path / "designs.csv", "-o", tmp_path / "swept")
    assert [(float(row["roof_up"]), float(row["slant_turn"])) for row in study.history()] == [(0.01, 0), (-0.02, 0)]


@pytest.mark.parametrize("table, says", [
    ("roof_up,slant_turn\n0.01,0\nnan,0\n", "line 3: roof_up: nan, expected a finite number"),
    ("roof_up,slant_turn\n0.01,0\n0.01, inf\n", "line 3: slant_turn: inf, expected a finite number"),
    ("roof_up\n0,01\n", "line 2: 2 columns, the header has 1"), ("roof_up,slant_turn\n0.1\n", "line 2: 1 columns, the header has 2"),
    ("roof_up\nhigh\n", "line 2: roof_up: high, expected a number"), ("roof_up,roof_up\n1,2\n", "the columns are roof_up, roof_up, expected some of roof_up, slant_turn"),
    ("name\na\n", "the columns are name, expected some of"), ("roof_up,roof_dwn\n0,0\n", "the columns are roof_up, roof_dwn, expected"), ("", "the columns are missing"),
    ("roof_up\n\n", "no designs")])
def test_a_table_that_is_wrong(study, tmp_path, table, says):
    (tmp_path / "designs.csv").write_text(table)
    code, told = study("doe: {table: designs.csv}\nevaluate: {measures: {v: volume}}")
    assert code == 1 and says in told and "doe.table: " in told and "Traceback" not in told, told


def test_a_server_that_is_restarted_is_waited_for(study, case):
    process = study.start("doe: {halton: 12}\nevaluate: {function: study_functions:height}\nplace: {threads: 2}", STUDY_SECONDS="0.2")
    while not study.log.exists() or len(study.evaluated()) < 3:
        assert process.poll() is None, process.communicate()[0]
        time.sleep(0.02)
    case.server.kill()
    time.sleep(1.5)  # longer than four attempts take
    case.server.start()
    told = process.communicate(timeout=200)[0]
    assert process.returncode == 0, told
    assert len(study.history()) == len(study.evaluated()) == 12 and {row["verdict"] for row in study.history()} == {"good"}


def test_a_data_set_has_checked_meshes_and_reasons(study, system, tmp_path):
    (tmp_path / "designs.csv").write_text("slant_turn,roof_up\n0.1,0.02\n0,9\n-0.1,0\n")
    code, told = study("doe: {table: designs.csv}\nmeshes: .obj")
    assert code == 0, told
    manifest = json.loads((study.folder / "manifest.json").read_text())
    assert [each["variables"] for each in manifest["meshes"]] == [{"roof_up": 0.02, "slant_turn": 0.1}, {"roof_up": 0, "slant_turn": -0.1}]
    for each in manifest["meshes"]:
        path = study.folder / each["file"]
        assert hashlib.sha256(path.read_bytes()).hexdigest() == each["sha256"]
        points = np.array([line.split()[1:4] for line in path.read_text().splitlines() if line.startswith("v ")], dtype=float)
        np.testing.assert_allclose(points, system(each["variables"]), atol=1e-6)
    (rejected,) = manifest["rejected"]
    assert rejected["number"] == 1 and "roof_up" in " ".join(rejected["reasons"])


def test_factorial(study):
    assert study("doe: {factorial: [2, 3]}")[0] == 0
    assert [(float(row["roof_up"]), float(row["slant_turn"])) for row in study.history()] == [(a, b) for a in (-0.05, 0.05) for b in (-0.2, 0, 0.2)]


# ---- state ----

SEARCH = "evaluate: {function: study_functions:height}\n%s\nplace: {processes: 2}\nseed: 5"


def check_kills(study, text, kills):
    """Kills the study at random moments; its history is that of one that was left alone, and nothing that was known was evaluated again."""
    text = SEARCH % text
    code, told = study(text)
    assert code == 0, told
    whole, once = (study.folder / "history.csv").read_bytes(), study.evaluated()
    assert len(once) == len(set(once))
    study.folder.rename(study.folder.with_name("alone"))
    study.log.unlink()
    study.log.touch()
    moments = random.Random(11)
    finished = 0
    for _ in range(kills):
        known = set()
        if (study.folder / "journal.jsonl").exists():
            lines = (study.folder / "journal.jsonl").read_text().split("\n")[:-1]
            known = {"%r %r" % tuple(json.loads(line)["x"]) for line in lines}
        before = len(study.evaluated())
        process = study.start(text, STUDY_SECONDS="0.02")
        wanted = before + moments.randint(0, 4)
        deadline = time.time() + moments.uniform(0.3, 4)
        while len(study.evaluated()) < wanted and time.time() < deadline and process.poll() is None:
            time.sleep(0.005)
        time.sleep(moments.uniform(0, 0.05))
        finished += process.poll() is not None
        process.send_signal(signal.SIGKILL)
        process.communicate()
        time.sleep(0.1)
        assert not known & set(study.evaluated()[before:]), "a design that was known was evaluated again"
    code, told = study(text)
    assert code == 0, told
    assert (study.folder / "history.csv").read_bytes() == whole
    assert set(study.evaluated()) == set(once)
    return finished


def test_a_killed_design_of_experiments_goes_on(study):
    assert check_kills(study, "doe: {halton: 40}", KILLS) < KILLS


def test_a_killed_search_goes_on(study):
    pytest.importorskip("cma")
    assert check_kills(study, "minimize: height\noptimizer: {cma: {popsize: 8}}\nbudget: 48", KILLS) < KILLS


def test_a_line_that_was_cut_off_and_one_that_was_damaged(study):
    text = SEARCH % "doe: {halton: 6}"
    assert study(text)[0] == 0
    whole = (study.folder / "history.csv").read_bytes()
    journal = study.folder / "journal.jsonl"
    content = journal.read_bytes()
    journal.write_bytes(content[:-7])
    code, told = study(text)
    assert code == 0 and "5 designs are known" in told, told
    assert (study.folder / "history.csv").read_bytes() == whole and len(study.evaluated()) == 7
    code, told = study(text)
    assert code == 0 and "6 designs are known" in told and len(study.evaluated()) == 7, told
    journal.write_bytes(b"x" + content)
    code, told = study(text)
    assert code == 1 and "journal.jsonl: line 1 is damaged" in told


def test_another_study_in_the_same_folder_is_refused(study):
    assert study("doe: {halton: 3}")[0] == 0
    code, told = study("doe: {halton: 4}")
    assert code == 1 and told.startswith("error: doe: changed since")


def test_a_folder_without_a_finished_design_is_claimed_anew(study):
    told = study("evaluate: {function: no_such_module:f}\ndoe: {halton: 4}")[1]
    assert "no_such_module" in told
    code, told = study("evaluate: {function: study_functions:always_broken}\ndoe: {halton: 3}")
    assert code == 3 and "all 3 designs failed" in told and [row["verdict"] for row in study.history()] == ["failed"] * 3, told
    kept = study.folder / "results" / "000000.json"
    late = {**json.loads((study.folder / "journal.jsonl").read_text().split("\n")[0]), "study": "of another file"}
    kept.write_text(json.dumps(late))
    code, told = study("evaluate: {function: study_functions:height}\ndoe: {halton: 3}")
    assert code == 0 and "known from before" not in told, told
    assert [row["verdict"] for row in study.history()] == ["good"] * 3 and len(study.evaluated()) == 3
    code, told = study("evaluate: {function: study_functions:height}\ndoe: {halton: 4}")
    assert code == 1 and told.startswith("error: doe: changed since")


def test_results_that_workers_keep_belong_to_their_study(study):
    text = "evaluate: {function: study_functions:height}\ndoe: {halton: %d}"
    assert study(text % 2)[0] == 0
    record = json.loads((study.folder / "journal.jsonl").read_text().split("\n")[0])
    (study.folder / "journal.jsonl").write_text("")
    kept = study.folder / "results" / f"{record['number']:06}.json"
    kept.write_text(json.dumps({**record, "study": "some other"}))
    code, told = study(text % 3)
    assert code == 1 and told.startswith("error: doe: changed since"), "a worker has finished a design"
    code, told = study(text % 2)
    assert code == 0 and len(study.evaluated()) == 4, "that of another study is evaluated again"
    kept.write_text(json.dumps({**record, "verdict": "failed"}))
    (study.folder / "journal.jsonl").write_text("")
    code, told = study(text % 3)
    assert code == 0 and "known from before" not in told and not kept.exists(), told


def test_progress_counts_the_designs_of_the_study(study, tmp_path):
    (tmp_path / "designs.csv").write_text("roof_up,slant_turn\n0.01,0\n0.02,0\n0.01,0\n0.03,0\n")
    code, told = study("doe: {table: designs.csv}\nbudget: 30")
    assert code == 0 and re.findall(r"^\S+/\S+", told, re.MULTILINE) == ["1/3", "2/3", "3/3"], told
    code, told = study("doe: {table: designs.csv}\nbudget: 2\nfolder: fewer")
    assert code == 0 and re.findall(r"^\S+/\S+", told, re.MULTILINE) == ["1/2", "2/2"], told
    code, told = study("doe: {table: designs.csv}\nfolder: fewer")
    assert code == 0 and re.findall(r"^\S+/\S+", told, re.MULTILINE) == ["3/3"], told


def test_missing_libraries_are_named_with_what_to_install(study, tmp_path):
    (tmp_path / "yaml.py").write_text("raise ModuleNotFoundError(\"No module named 'yaml'\", name='yaml')\n")
    code, told = study("doe: {halton: 3}", PYTHONPATH=os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")]))
    assert code == 1 and told.count("\n") == 1
    assert told.startswith("error: No module named 'yaml'") and told.count("pip install './client/python[study]'") == 1


# ---- optimizers ----


def test_gradients_find_the_optimum_on_a_constraint(study):
    code, told = study("evaluate: {measures: {v: volume, a: area}}\nminimize: a\nconstraints: {v: {min: 0.115}}\nbudget: 40\n"
                       "optimizer: {scipy: {method: SLSQP}}")
    assert code == 0, told
    rows = study.history()
    assert len(rows) < 15 and float(rows[-1]["v"]) == pytest.approx(0.115, abs=1e-6)
    assert float(rows[-1]["a"]) < 1.5545


@pytest.mark.parametrize("method", ["L-BFGS-B", "SLSQP", "TNC", "trust-constr", "BFGS"])
def test_gradients_come_back_from_designs_that_fail(study, method):
    """The first step along the gradient is too far already; a search that ends there has not moved."""
    code, told = study("evaluate: {function: study_functions:to_the_edge}\nminimize: low\nbudget: 40\nfailing: 1\noptimizer: {scipy: {method: %s}}" % method)
    assert code == 0 and "failed" in told, told
    usable = [row for row in study.history() if row["verdict"] != "failed"]
    best = min(usable, key=lambda row: float(row["low"]))
    assert 0.012 < float(best["roof_up"]) <= 0.02, told
    assert re.search(rf"^ended: ({method} of SciPy: .+|the budget of 40 designs is spent)$", told, re.MULTILINE)
    assert "<p>Ended: " in (study.folder / "report.html").read_text()


def test_the_start_must_be_usable(study):
    code, told = study("evaluate: {function: study_functions:to_the_edge}\nminimize: low\nbudget: 40\noptimizer: {scipy: {start: {roof_up: 0.03}}}")
    assert code == 1 and "optimizer.start: design 0 is failed (study_functions:to_the_edge: RuntimeError: did not converge)" in told, told


def test_a_search_says_what_it_did_not_find(study):
    text = "evaluate: {measures: {v: volume, a: area}}\nminimize: a\nbudget: 15\noptimizer: {scipy: {method: %s}}\n"
    code, told = study(text % "SLSQP" + "constraints: {v: {min: 5}}")
    assert code == 4 and re.search(r"^no design is within the constraints; the nearest is design \d+: v 0\.\d+, min 5$", told, re.MULTILINE), told
    study.folder.rename(study.folder.with_name("first"))
    text = "evaluate: {function: study_functions:height}\nminimize: turn\nbudget: 8\noptimizer: {scipy: {method: Nelder-Mead}}"
    code, told = study(text)  # the square of an angle that is 0 at the start
    assert code == 0 and "\nno design is better than the start, design 0\n" in told, told
    study.folder.rename(study.folder.with_name("second"))
    code, told = study(text.replace("Nelder-Mead", "Nelder-Mead, start: {slant_turn: 0.1}"))
    assert code == 0 and "better than the start" not in told, told


def test_a_wrong_name_of_a_value_may_be_corrected(study):
    text = "evaluate: {function: study_functions:to_the_edge}\nminimize: %s\nbudget: 10\noptimizer: {scipy: {method: Nelder-Mead}}"
    code, told = study(text % "lower")
    assert code == 1 and told.endswith('error: "lower": design 0 has no such value, only low; did you mean "low"?\n') and "Traceback" not in told, told
    code, told = study(text % "low")
    assert code == 0 and told.startswith("1 designs are known from before"), told
    code, told = study(text % "lower")
    assert code == 1 and told.startswith("error: minimize: changed since"), told
    study.folder.rename(study.folder.with_name("first"))
    code, told = study((text % "lower").replace("Nelder-Mead", "SLSQP"))
    assert code == 1 and told.endswith('error: "lower": design 0 has no such value, only low; did you mean "low"?\n'), told


def test_a_volume_and_a_least_thickness_are_held(study, system):
    """The roof comes down for a low centre of gravity until the body is as thin there as it may be, and the slant turns until there is as little
    volume as there may be."""
    measured = "v: volume, a: area, t: {thickness: {at: roof, tolerance: 0.002}}, s: {thickness: {at: roof, method: spheres, tolerance: 0.002}}, c: {centre_of_gravity: z}"
    code, told = study(f"evaluate: {{measures: {{{measured}}}}}\nminimize: c\nconstraints: {{v: {{min: 0.108}}, t: {{min: 0.27}}}}\nbudget: 60\n"
                       "optimizer: {scipy: {method: SLSQP}}")
    assert code == 0, told
    best = study.history()[-1]
    alone = Thickness(system.geometry, at="roof", tolerance=0.002)
    points = system([float(best["roof_up"]), float(best["slant_turn"])])
    assert Volume(system.geometry).value(points) == pytest.approx(0.108, abs=1e-7)
    assert alone.value(points) == pytest.approx(0.27, abs=1e-7)
    assert alone.least(points).value == pytest.approx(float(best["t_least"]), rel=1e-9) and 0.27 <= float(best["t_least"]) <= 0.272
    assert float(best["s_least"]) >= float(best["s"]) and len(study.history()) < 40
    assert float(best["c"]) < float(study.history()[0]["c"]) - 0.003
    assert CentreOfGravity(system.geometry).value(points)[2] == pytest.approx(float(best["c"]), rel=1e-12)


def test_a_body_keeps_out(study, system, tmp_path):
    """The roof goes up for more volume until it is as near to the box, and to a mesh of the same shape, as allowed."""
    low, high = np.array([0.4, -0.1, 0.36]), np.array([0.6, 0.1, 0.5])
    corners = [low + (high - low) * (i & 1, i >> 1 & 1, i >> 2) for i in range(8)]
    faces = [[1, 3, 4, 2], [5, 6, 8, 7], [1, 2, 6, 5], [3, 7, 8, 4], [1, 5, 7, 3], [2, 4, 8, 6]]
    (tmp_path / "engine.obj").write_text("".join(f"v {x!r} {y!r} {z!r}\n" for x, y, z in (map(float, each) for each in corners)) +
                                         "".join("f " + " ".join(map(str, face)) + "\n" for face in faces))
    found = {}
    for name, keep_out in (("box", f"box: {{min: {low.tolist()}, max: {high.tolist()}}}"), ("mesh", "mesh: engine.obj")):
        code, told = study(f"evaluate: {{measures: {{v: volume, k: {{clearance: {{{keep_out}, groups: roof, tolerance: 0.001}}}}}}}}\nmaximize: v\n"
                           "constraints: {k: {min: 0.005}}\nbudget: 60\noptimizer: {scipy: {method: SLSQP}}")
        assert code == 0, told
        found[name] = study.history()[-1]
        assert float(found[name]["k"]) == pytest.approx(0.005, abs=1e-6) and 0.005 <= float(found[name]["k_least"]) <= 0.006
        study.folder.rename(study.folder.with_name(name))
    assert float(found["box"]["roof_up"]) == pytest.approx(float(found["mesh"]["roof_up"]), abs=1e-6)
    study.folder.with_name("mesh").rename(study.folder)
    (tmp_path / "engine.obj").write_text((tmp_path / "engine.obj").read_text() + "v 0 0 0\n")
    code, told = study(f"evaluate: {{measures: {{v: volume, k: {{clearance: {{mesh: engine.obj, groups: roof, tolerance: 0.001}}}}}}}}\nmaximize: v\n"
                       "constraints: {k: {min: 0.005}}\nbudget: 60\noptimizer: {scipy: {method: SLSQP}}")
    assert code == 1 and "evaluate.measures.k.mesh: changed since" in told


def test_what_a_measure_says_about_the_mesh(study):
    code, told = study("evaluate: {measures: {v: {volume: {groups: [roof, bonnet]}}}}\ndoe: {sobol: 2}")
    assert code == 1 and 'evaluate.measures.v.volume: groups[1]: there is no group "bonnet"' in told


def test_the_gradient_of_a_function(study):
    text = "evaluate: {function: study_functions:distance}\nminimize: distance\nbudget: 60\n"
    assert study(text + "optimizer: {scipy: {method: L-BFGS-B}}")[0] == 0
    with_gradients = study.history()
    study.folder.rename(study.folder.with_name("gradients"))
    assert study(text + "optimizer: {scipy: {method: Nelder-Mead}}")[0] == 0
    assert len(with_gradients) < len(study.history())
    assert min(float(row["distance"]) for row in with_gradients) <= min(float(row["distance"]) for row in study.history()) * (1 + 1e-6)


@pytest.mark.parametrize("library, optimizer, enough", [("cma", "cma: {popsize: 15, CMA_mu: 2, CMA_active: false}", 1.56), ("pymoo", "nsga2: {pop_size: 10}", 1.57),
                                                        ("nlopt", "nlopt: {method: LD_SLSQP}", 1.55392)])
def test_optimizers_of_libraries(study, library, optimizer, enough):
    """The least area at that volume is 1.553917, by SLSQP; most random designs within the constraint have more than 1.57."""
    pytest.importorskip(library)
    code, told = study("evaluate: {measures: {v: volume, a: area}}\nminimize: a\nconstraints: {v: {min: 0.115}}\nbudget: 90\noptimizer: {%s}" % optimizer)
    assert code == 0, told
    usable = [float(row["a"]) for row in study.history() if float(row["v"]) > 0.115 - 1e-9]
    assert min(usable) < enough and len(study.history()) <= 90
    assert "The best, design" in (study.folder / "report.html").read_text()


def test_a_population_that_failed_is_not_the_end(study):
    """Designs can be used in a hundredth of the bounds around the original. Equal values of all that failed would be a flat function for pycma."""
    pytest.importorskip("cma")
    code, told = study("evaluate: {function: study_functions:in_a_corner}\nminimize: value\nbudget: 120\nfailing: 1\noptimizer: {cma: {popsize: 8, sigma: 0.6}}")
    assert code == 0, told
    verdicts = [row["verdict"] for row in study.history()]
    assert set(verdicts[:8]) == {"failed"}, "the first population"
    assert "good" in verdicts


def test_the_pareto_front(study):
    pytest.importorskip("pymoo")
    code, told = study("evaluate: {function: study_functions:two_goals}\nminimize: near\nmaximize: high\nconstraints: {near: {max: 0.9}}\nbudget: 60\n"
                       "optimizer: {nsga2: {pop_size: 12}}")
    assert code == 0, told
    rows = study.history()
    goals = [(float(row["near"]), -float(row["high"])) if row["near"] and float(row["near"]) <= 0.9 else None for row in rows]

    def beaten(goal):
        return any(other and other != goal and other[0] <= goal[0] and other[1] <= goal[1] for other in goals)

    front = [int(goal is not None and not beaten(goal)) for goal in goals]
    assert [int(row["on_front"]) for row in rows] == front and 2 < sum(front) < len(rows) - 5
    assert f"{sum(front)} of {len(rows)} designs are on the Pareto front" in told
    page = (study.folder / "report.html").read_text()
    assert "The Pareto front" in page and page.count("<tr><td>") >= sum(front) and "The best in near, design" in page
    assert [each["on_front"] for each in json.loads((study.folder / "history.json").read_text())] == front


def test_the_pareto_front_of_all_small_cases():
    """Against its definition, with values that are equal."""
    from deformd.study.results import front_of

    spec = types.SimpleNamespace(objectives=(("low", 1.0), ("high", -1.0)), constraints=(("low", "max", 2.0),))
    random_values = random.Random(3)
    for _ in range(300):
        records = [{"number": number, "verdict": random_values.choice(["good", "good", "good", "bad"]),
                    "values": {"low": float(random_values.randint(0, 3)), "high": float(random_values.randint(0, 3))}} for number in range(7)]
        usable = [each for each in records if each["verdict"] != "bad" and each["values"]["low"] <= 2]

        def beats(a, b):
            a, b = a["values"], b["values"]
            return a["low"] <= b["low"] and a["high"] >= b["high"] and a != b

        expected = {each["number"] for each in usable if not any(beats(other, each) for other in usable)}
        assert {each["number"] for each in front_of(spec, records)} == expected


def test_nsga2_sees_what_failed_as_worse_than_what_is_outside(monkeypatch):
    """pymoo ranks what violates more behind what violates less, and only then by objectives."""
    pytest.importorskip("pymoo")
    from deformd.study import optimizers
    from deformd.study.driver import FAILED

    records = [{"verdict": "good", "values": (1.0, 2.0), "violations": [-0.5]}, {"verdict": "bad", "values": (0.0, 0.0), "violations": [-9.0]},
               {"verdict": "good", "values": (3.0, 4.0), "violations": [7.0]}, {"verdict": "failed", "values": (0.0, 0.0), "violations": [-9.0]}]
    stub = types.SimpleNamespace(bounds=np.array([[-1.0, 1.0]]), designs=lambda x: records, objective=lambda record, number: record["values"][number],
                                 violations=lambda record: record["violations"],
                                 spec=types.SimpleNamespace(objectives=(("a", 1.0), ("b", 1.0)), constraints=(("c", "max", 0.0),), seed=1))
    seen = {}
    monkeypatch.setattr("pymoo.optimize.minimize", lambda problem, *_, **__: seen.update(problem.evaluate(np.zeros((4, 1)), return_as_dictionary=True)))
    optimizers._nsga2(stub, {"pop_size": 4})
    np.testing.assert_array_equal(seen["F"], [[1, 2], [FAILED, FAILED], [3, 4], [FAILED, FAILED]])
    violated = np.maximum(seen["G"], 0).sum(axis=1)
    assert violated[0] == 0 and violated[2] == 7 and violated[1] == violated[3] > 1e6


# ---- quality ----

QUALITY = ["least_angle", "flipped_faces", "displacement", "max_displacement", "displacement_ratio"]


def test_quality_is_measured_by_its_names(study, system):
    code, told = study(f"evaluate: {{function: study_functions:height, quality: [{', '.join(QUALITY)}]}}\ndoe: {{halton: 4}}")
    assert code == 0, told
    quality = Quality(system.geometry)
    for row, kept in zip(study.history(), json.loads((study.folder / "history.json").read_text())):
        points, report = system.deform([float(row["roof_up"]), float(row["slant_turn"])])
        expected = quality.values(points, ["least_angle", "flipped_faces", "displacement"])
        expected.update(max_displacement=report.max_displacement, displacement_ratio=report.max_displacement / report.prescribed_displacement)
        assert {name: float(row[name]) for name in QUALITY} == pytest.approx(expected, rel=1e-9)
        assert {name: kept[name] for name in QUALITY} == {name: float(row[name]) for name in QUALITY} and float(row["height"]) > 0
    records = [json.loads(line) for line in (study.folder / "journal.jsonl").read_text().splitlines()]
    assert all(each["seconds_quality"] > 0 for each in records)
    assert re.search(r"^4 designs: \S+ s of deforming, \S+ s of measuring quality, \S+ s of evaluating \(\S+ % is deforming, \S+ % quality\)$", told, re.MULTILINE)


def test_the_report_compares_quality_by_its_names(study, system):
    code, told = study("evaluate: {measures: {v: volume}, quality: total_area}\nminimize: total_area\nconstraints: {v: {min: 0.11}}\nbudget: 12\n"
                       "optimizer: {scipy: {method: COBYLA}}")
    assert code == 0, told
    page = (study.folder / "report.html").read_text()
    usable = [row for row in study.history() if float(row["v"]) >= 0.11 * (1 - 1e-6)]
    best = min(usable, key=lambda row: float(row["total_area"]))
    assert "<td>total_area<td>%.6g</tr>" % float(best["total_area"]) in page
    before, after = (Quality(system.geometry)(system(x))["total_area"] for x in ([0, 0], [float(best["roof_up"]), float(best["slant_turn"])]))
    assert before > after and f"area, total<td>{before:.6g}<td>{after:.6g}</tr>" in page


def test_quality_alone_is_of_data_sets(study, system):
    code, told = study("evaluate: {quality: [face_quality]}\ndoe: {halton: 3}\nmeshes: .obj")
    assert code == 0, told
    for each in json.loads((study.folder / "manifest.json").read_text())["meshes"]:
        assert each["values"] == pytest.approx(Quality(system.geometry).values(system(each["variables"]), ["face_quality"]), rel=1e-9)


def test_a_compiled_deformation_has_quality(study, system):
    text = "evaluate: {quality: [least_angle, max_displacement, inverted_at_rest]}\ndoe: {halton: 3}\ndeformation: compiled"
    code, told = study(text)
    assert code == 1 and "evaluate.quality: inverted_at_rest: only the server reports it" in told, told
    code, told = study(text.replace(", inverted_at_rest", ""))
    assert code == 0, told
    for row in study.history():
        x = [float(row["roof_up"]), float(row["slant_turn"])]
        expected = Quality(system.geometry).values(system(x), ["least_angle", "displacement"])
        assert [float(row["least_angle"]), float(row["max_displacement"])] == pytest.approx(list(expected.values()), rel=1e-9)


def test_what_optimizers_that_rank_need_not_evaluate(study, case, system, tmp_path):
    """A design outside of its constraints on quality: the function is not called, and what is known ranks it."""
    from deformd.study.driver import INFEASIBLE, not_evaluated, violations
    from deformd.study.optimizers import gradients_of, skipping
    from deformd.study.worker import evaluate

    (tmp_path / "s.yaml").write_text(f"setup: {case.setup}\nevaluate: {{function: study_functions:always_broken, quality: [least_angle, displacement]}}\n"
                                     "minimize: value\nconstraints: {displacement: {max: 0.02}, least_angle: {min: 1}, value: {max: 3}}\n"
                                     "optimizer: {cma: {}}\nbudget: 9\n")
    spec = read_spec(tmp_path / "s.yaml")
    assert skipping(spec) == [("displacement", "max", 0.02), ("least_angle", "min", 1.0)] and gradients_of(spec) == []
    task = {"study": "s", "evaluate": spec.evaluate, "folder": str(tmp_path), "write": None, "gradients": [], "server": case.server.address,
            "system": system.id, "names": system.names, "compiled": None, "mesh": str(case.mesh), "skip": skipping(spec)}
    outside = evaluate({**task, "number": 0, "x": [0.04, 0.0]})
    assert outside["verdict"] == "good" and not_evaluated(outside) and set(outside["values"]) == {"least_angle", "displacement"}
    assert outside["reasons"] == ["not evaluated: displacement 0.04, max 0.02"]
    assert violations(spec, outside)[0] == pytest.approx(1) and violations(spec, outside)[2] == 0 and INFEASIBLE < 1e60
    within = evaluate({**task, "number": 1, "x": [0.01, 0.0]})
    assert within["verdict"] == "failed" and "did not start" in within["reasons"][0] and within["values"]["displacement"] == pytest.approx(0.01)


def test_populations_are_not_evaluated_outside_of_quality(study):
    pytest.importorskip("cma")
    text = ("evaluate: {function: study_functions:height, quality: [displacement]}\nmaximize: height\nconstraints: {displacement: {max: %s}}\n"
            "optimizer: {cma: {popsize: 8}}\nbudget: 48")
    code, told = study(text % "0.02")
    assert code == 0 and "not evaluated" in told, told
    rows = study.history()
    skipped = [row for row in rows if "not evaluated" in row["reasons"]]
    assert skipped and all(float(row["displacement"]) > 0.02 and not row["height"] for row in skipped)
    assert len(study.evaluated()) == len(rows) - len(skipped)
    best = max((row for row in rows if row["height"]), key=lambda row: float(row["height"]))
    assert 0.015 < float(best["displacement"]) <= 0.02 * (1 + 1e-6)
    study.folder.rename(study.folder.with_name("first"))
    code, told = study(text % "1e-9")
    assert code == 4 and re.search(r"no design is within the constraints; the nearest is design \d+: displacement \S+, max 1e-09", told), told
    study.folder.rename(study.folder.with_name("second"))
    pytest.importorskip("pymoo")
    code, told = study((text % "0.02").replace("cma: {popsize: 8}", "nsga2: {pop_size: 8}"))
    assert code == 0 and "not evaluated" in told, told


def test_gradients_hold_quality_by_differences(study, system):
    """As far as the displacement may go; no design of the differences is evaluated."""
    text = "evaluate: {function: study_functions:distance, quality: [displacement, total_area]}\nminimize: distance\nbudget: 40\noptimizer: {scipy: {method: SLSQP}}\n"
    code, told = study(text)
    assert code == 0, told
    free = study.history()[-1]
    limit = 0.6 * float(free["displacement"])
    assert limit > 0.005, "the constraint shall be active"
    study.folder.rename(study.folder.with_name("free"))
    code, told = study(text + f"constraints: {{displacement: {{max: {limit!r}}}, total_area: {{min: 1}}}}")
    assert code == 0, told
    rows = study.history()
    assert float(rows[-1]["displacement"]) == pytest.approx(limit, rel=1e-4) and len(rows) < 40
    records = [json.loads(line) for line in (study.folder / "journal.jsonl").read_text().splitlines()]
    slope = differences(system, records[0]["x"], Quality(system.geometry), ["total_area"])["total_area"]
    assert np.abs(slope).min() > 1e-3
    np.testing.assert_allclose(records[0]["gradients"]["total_area"], slope, rtol=1e-9, atol=1e-9)
    assert float(free["distance"]) < float(rows[-1]["distance"]) < float(rows[0]["distance"])


@pytest.mark.parametrize("text, message", [
    ("evaluate: {quality: [scaled_jacobain]}\ndoe: {sobol: 2}", "evaluate.quality: there is no measure 'scaled_jacobain'; did you mean \"scaled_jacobian\""),
    ("evaluate: {quality: [scaled_jacobian]}\ndoe: {sobol: 2}", "evaluate.quality: scaled_jacobian is measured of other kinds of meshes"),
    ("evaluate: {quality: [wall_height], walls: [roof]}\ndoe: {sobol: 2}", "evaluate.quality: walls: the mesh is a surface"),
    ("evaluate: {quality: [flipped_faces], measures: {a: area}}\nminimize: a\nconstraints: {flipped_faces: {max: 0}}\nbudget: 5\noptimizer: {scipy: {method: SLSQP}}",
     "flipped_faces: it is a number of faces, cells or the like, which has no slope, and SLSQP follows slopes"),
    ("evaluate: {function: study_functions:angle, quality: [least_angle]}\ndoe: {sobol: 2}", '"least_angle": the evaluator gives it, and evaluate.quality measures it'),
    ("evaluate: {function: study_functions:height}\nminimize: least_angle\nbudget: 3\noptimizer: {scipy: {method: COBYLA}}",
     '"least_angle": design 0 has no such value, only height, turn; it is one of the measures of quality: evaluate.quality: [least_angle]'),
])
def test_what_is_wrong_about_quality(study, text, message):
    code, told = study(text)
    assert code == 1 and message in told and "Traceback" not in told, told


# ---- failures ----


def test_more_than_half_failing_stops(study):
    code, told = study("evaluate: {function: study_functions:half_broken}\nminimize: value\nbudget: 60\noptimizer: {scipy: {method: Nelder-Mead}}")
    assert code in (0, 3), told
    study.folder.rename(study.folder.with_name("first"))
    code, told = study("evaluate: {function: study_functions:half_broken}\ndoe: {halton: 40}")
    assert code == 3 and "designs failed" in told and "did not converge" in told
    assert len([row for row in study.history() if row["verdict"] == "failed"]) < 40
    study.folder.rename(study.folder.with_name("second"))
    code, told = study("evaluate: {function: study_functions:half_broken}\ndoe: {halton: 40}\nfailing: 1")
    assert code == 0 and len(study.history()) == 40


@pytest.mark.parametrize("first, other, code, count", [("bad", "good", 3, 21), ("good", "bad", 0, 24)])
def test_exactly_half_of_the_designs_may_be_bad(study, tmp_path, first, other, code, count):
    """Which is looked at from 20 designs on. Of those in turns, beginning with a bad one, 10 of 19, 10 of 20 and 11 of 21 are bad."""
    whole = {"good": 0, "bad": 9}  # outside of the bounds
    (tmp_path / "designs.csv").write_text("roof_up\n" + "".join(f"{whole[first]}.0{i:02}\n{whole[other]}.0{i + 1:02}\n" for i in range(0, 24, 2)))
    done, told = study("evaluate: {measures: {v: volume}}\ndoe: {table: designs.csv}")
    assert done == code and [row["verdict"] for row in study.history()] == ([first, other] * 12)[:count], told


def test_a_format_that_the_mesh_cannot_be_written_in_is_refused_at_once(study):
    code, told = study("evaluate: {function: study_functions:height}\ndoe: {halton: 4}\nmeshes: .su2")
    assert code == 1 and told.startswith("error: meshes: .su2:") and not study.log.exists(), told
    assert not list(study.folder.glob("tmp*"))


def test_no_server_is_no_failure_of_designs(study):
    code, told = study("evaluate: {function: no_such_module:f}\ndoe: {halton: 4}")
    assert code == 1 and "no_such_module" in told and not (study.folder / "journal.jsonl").read_bytes()


# ---- compiled deformations ----


def test_flipped_faces_of_a_compiled_deformation_are_doubtful(study, case, tmp_path, client):
    folding = {"geometry": str(case.mesh), "handles": [{"name": "roof", "region": {"box": {"min": [0.4, -1, 0.3], "max": [0.6, 1, 1]}}}],
               "fixed": [{"group": "nose"}, {"group": "slant"}, {"group": "underbody"}],
               "variables": [{"name": "push", "handle": "roof", "translate": [1, 0, 0], "lower": -0.5, "upper": 0.5}]}
    (tmp_path / "folding.yaml").write_text(json.dumps(folding))
    (tmp_path / "designs.csv").write_text("push\n0.01\n0.45\n")
    code, told = study(f"doe: {{table: designs.csv}}\ndeformation: compiled\nsetup: {tmp_path / 'folding.yaml'}")
    assert code == 0, told
    server = client.prepare(tmp_path / "folding.yaml").deform([0.45]).report
    rows = study.history()
    assert [row["verdict"] for row in rows] == ["unknown", "doubtful"]
    assert rows[1]["reasons"] == f"{server.faces.flipped} of {server.faces.faces} faces are flipped"


def test_inverted_cells_of_a_compiled_deformation_are_bad(study, client, tmp_path):
    """As the server has it. The block of conftest.squeezed, from a file."""
    meshio = pytest.importorskip("meshio")
    points, hexahedra = brick()
    meshio.Mesh(points, {"hexahedron": hexahedra}).write(tmp_path / "brick.vtu")
    ends = {"handles": [{"name": "right", "region": {"box": {"min": [3.9, -1, -1], "max": [5, 9, 9]}}}], "fixed": [{"box": {"min": [-1, -1, -1], "max": [0.1, 9, 9]}}]}
    (tmp_path / "brick.yaml").write_text(json.dumps({"geometry": "brick.vtu", **ends, "variables": [
        {"name": "push", "handle": "right", "translate": [-1, 0, 0], "lower": -10, "upper": 10}]}))
    (tmp_path / "designs.csv").write_text("push\n1\n6\n-1\n")
    code, told = study(f"doe: {{table: designs.csv}}\ndeformation: compiled\nsetup: brick.yaml\nevaluate: {{quality: [volume]}}\nfailing: 1")
    assert code == 0, told
    rows = study.history()
    assert [row["verdict"] for row in rows] == ["unknown", "bad", "unknown"] and rows[1]["volume"] == ""
    system = client.prepare(tmp_path / "brick.yaml")
    cells = system.deform([6.0]).report.cells
    assert rows[1]["reasons"].startswith(f"{cells.inverted} of {cells.cells} cells are inverted") and cells.inverted > 0
    assert deformd.CellCheck(system.geometry).inverted(system.local()([6.0], bad="keep")) == cells.inverted


# ---- places ----


@pytest.mark.parametrize("place, library", [("processes: 2", "numpy"), ("submitit: {cluster: local, timeout_min: 5}", "submitit"),
                                            ("dask: {n_workers: 1, threads_per_worker: 2, dashboard_address: null}", "distributed"), ("ray: {num_cpus: 1}", "ray")])
def test_places_give_the_same_history(study, place, library):
    pytest.importorskip(library)
    text = "evaluate: {function: study_functions:height}\ndoe: {halton: 4}\ndeformation: compiled\n"
    assert study(text)[0] == 0
    here = (study.folder / "history.csv").read_bytes()
    study.folder.rename(study.folder.with_name("here"))
    code, told = study(text + f"place: {{{place}}}")
    assert code == 0, told
    assert (study.folder / "history.csv").read_bytes() == here


@pytest.mark.parametrize("place, library", [("processes: 2", "numpy"), ("submitit: {cluster: local, timeout_min: 5}", "submitit"),
                                            ("dask: {n_workers: 2, threads_per_worker: 1, dashboard_address: null}", "distributed"), ("ray: {num_cpus: 2}", "ray")])
def test_places_outlive_a_killed_worker_and_a_killed_server(study, case, place, library):
    pytest.importorskip(library)
    process = study.start(f"evaluate: {{function: study_functions:by_process}}\ndoe: {{halton: {PLACE_DESIGNS}}}\nplace: {{{place}}}", STUDY_SECONDS="0.3")

    def wait_for(count):
        while not study.log.exists() or len(study.evaluated()) < count:
            assert process.poll() is None, process.communicate()[0]
            time.sleep(0.02)

    wait_for(PLACE_DESIGNS // 4)
    worker = int(study.evaluated()[-1].split()[0])
    assert worker != process.pid
    try:
        os.kill(worker, signal.SIGKILL)
    except ProcessLookupError:  # a process per design, and this one is done
        pass
    wait_for(PLACE_DESIGNS // 2)
    case.server.kill()
    time.sleep(1.5)
    case.server.start()
    told = process.communicate(timeout=3600)[0]
    assert process.returncode == 0, told
    if library in ("numpy", "submitit"):  # the others try again by themselves
        assert "its worker ended" in told
    assert [int(row["number"]) for row in study.history()] == list(range(PLACE_DESIGNS)) and {row["verdict"] for row in study.history()} == {"good"}, told
    designs = [line.split()[1] for line in study.evaluated()]
    assert len(set(designs)) == PLACE_DESIGNS and len(designs) <= PLACE_DESIGNS + 3, "what a worker was about when it ended is evaluated again, and nothing else"


def test_a_design_that_ends_its_workers_has_failed(study):
    code, told = study("evaluate: {function: study_functions:deadly}\ndoe: {factorial: [3, 1]}\nplace: {processes: 2}")
    assert code == 0, told
    assert [row["verdict"] for row in study.history()] == ["good", "good", "failed"] and "its worker ended 3 times" in study.history()[2]["reasons"]
    assert study.evaluated() == ["the end"] * 3 and told.count("its worker ended:") == 3


@pytest.mark.parametrize("last, kind", [("submitit.core.utils.UncompletedJobError: Job not requeued because: timed-out and not checkpointable.", "out_of_time"),
                                        ("deformd.errors.InvalidArgument: evaluate.command: there is no program solve", "error")])
def test_what_jobs_of_submitit_say(last, kind):
    """Its exception has the trace as text, within lines of its own; the study says what was raised."""
    pytest.importorskip("submitit")
    from deformd.study.places import OutOfTime, Place, WorkerLost
    from submitit.core.utils import FailedJobError, UncompletedJobError

    class Future:
        def result(self):
            raise self.error

    future = Future()
    trace = f'Traceback (most recent call last):\n  File "a.py", line 3, in f\n    g()\n{last}\nand what follows\n'
    future.error = FailedJobError(f"Job (task=0) failed during processing with trace:\n----------------------\n{trace}\n----------------------\n"
                                  "You can check full logs with 'job.stderr(0)' and 'job.stdout(0)'or at paths:\n  - a.err\n  - a.out")
    place = Place(lambda: None, (UncompletedJobError,), (FailedJobError,))
    with pytest.raises(deformd.Error) as raised:
        place.result(future)
    assert str(raised.value) == last and type(raised.value) is (OutOfTime if kind == "out_of_time" else deformd.Error)
    future.error = UncompletedJobError("Job 7 (task: 0) has not produced any output\nand more")
    with pytest.raises(WorkerLost, match="^Job 7 .task: 0. has not produced any output$"):
        place.result(future)


# ---- parts ----


def test_jobs_of_this_machine_are_as_many_at_a_time_as_it_has_cores(monkeypatch):
    """Each is a process at once; the next waits until one is done, whichever."""
    from deformd.study.places import _few_at_a_time

    class Job:
        def __init__(self, number):
            self.number, self.over = number, threading.Event()

        def done(self):
            return self.over.is_set()

    jobs = []

    def submit(number):
        jobs.append(Job(number))
        return jobs[-1]

    monkeypatch.setattr(os, "cpu_count", lambda: 3)
    few, given = _few_at_a_time(submit), []
    thread = threading.Thread(target=lambda: given.extend(few(number) for number in range(6)), daemon=True)
    thread.start()
    for ends, there in ((None, 3), (1, 4), (3, 5), (0, 6)):
        if ends is not None:
            jobs[ends].over.set()
        deadline = time.time() + 5
        while len(jobs) < there and time.time() < deadline:
            time.sleep(0.01)
        time.sleep(0.15)
        assert len(jobs) == there
    thread.join(5)
    assert [job.number for job in given] == list(range(6)) and not thread.is_alive()


def test_numbers_with_exponents_need_no_point(case, tmp_path):
    """1e-9 is text to YAML 1.1, and so to PyYAML."""
    (tmp_path / "s.yaml").write_text(f"setup: {case.setup}\nevaluate: {{measures: {{a: area}}}}\nminimize: a\nconstraints: {{a: {{min: 1e-9, max: -2E+1}}}}\n"
                                     "optimizer: {scipy: {method: SLSQP, ftol: 1e-7, eps: .5e-3}}\nbudget: 9\nfolder: 1e5e\n")
    spec = read_spec(tmp_path / "s.yaml")
    assert spec.constraints == (("a", "min", 1e-9), ("a", "max", -20.0)) and spec.optimizer[1] == {"method": "SLSQP", "ftol": 1e-7, "eps": 5e-4}
    assert spec.folder.name == "1e5e"


@pytest.mark.parametrize("text, message", [
    ("doe: {sobol: 0}", "doe.sobol: 0, expected a whole number of at least 1"),
    ("doe: {sobol: 4}\nbugdet: 3", "key: 'bugdet', expected one of setup, "),
    ("doe: {sobol: 4}\nbugdet: 3", 'did you mean "budget"?'),
    ("doe: {sobol: 4}\nevaluate: {quality: [least_angel]}", "evaluate.quality: there is no measure 'least_angel'; did you mean \"least_angle\""),
    ("doe: {sobol: 4}\nevaluate: {quality: no}", "evaluate.quality: False, expected the name of a measured value"),
    ("doe: {sobol: 4}\nevaluate: {quality: least_angle, walls: 3}", "evaluate.walls: 3, expected the name of a group of faces"),
    ("doe: {sobol: 4}\nevaluate: {measures: {a: area}, walls: [roof]}", "evaluate.walls: only with quality"),
    ("doe: {sobol: 4}\nevaluate: {measures: {volume: volume}, quality: [volume]}", 'evaluate.measures.volume: gives "volume", as evaluate.quality does'),
    ("doe: {sobol: 4}\nevaluate: {measures: {a: area}}\nconstraints: {least_angle: {min: 9}}",
     '"least_angle": no such measure, only a; it is one of the measures of quality: evaluate.quality: [least_angle] has it measured'),
    ("doe: {sobol: 4}\nevaluate: {quality: [least_angle]}\nconstraints: {least_angel: {min: 9}}", 'only least_angle; did you mean "least_angle"?'),
    ("doe: {sobol: 4}\nevaluate: {quality: [least_angle]}\nconstraints: {least_angle: {least: 9}}", "constraints.least_angle: 'least', expected one of min, max"),
    ("doe: {sobol: 4}\noptimizer: {cma: {}}", "exactly one of them"),
    ("optimizer: {cma: {}}\nbudget: 9", "an optimizer needs an objective"),
    ("optimizer: {cma: {}}\nminimize: a\nevaluate: {measures: {a: area}}", "budget: missing"),
    ("optimizer: {cma: {}}\nminimize: b\nbudget: 9\nevaluate: {measures: {a: area}}", '"b": no such measure, only a'),
    ("optimizer: {cma: {}}\nminimize: [a, b]\nbudget: 9\nevaluate: {measures: {a: area, b: volume}}", "2 objectives, cma takes one"),
    ("doe: {sobol: 4}\nevaluate: {measures: {a: {projected_area: w}}}", "evaluate.measures.a.projected_area.direction: 'w', expected one of x, y, z"),
    ("doe: {sobol: 4}\nevaluate: {measures: {a: {projected_area: {of: faces}}}}", "evaluate.measures.a.projected_area: a direction is missing"),
    ("doe: {sobol: 4}\nevaluate: {measures: {a: {volume: 3}}}", "evaluate.measures.a.volume: 3, expected a mapping of options: groups, of, rims"),
    ("doe: {sobol: 4}\nevaluate: {measures: {a: {volume: {at: roof}}}}", "evaluate.measures.a.volume.at: no such option, only groups, of, rims"),
    ("doe: {sobol: 4}\nevaluate: {measures: {a: {thickness: {method: cones}}}}", "evaluate.measures.a.thickness.method: 'cones', expected one of rays, spheres"),
    ("doe: {sobol: 4}\nevaluate: {measures: {a: {volume: {groups: no}}}}",
     "groups: False, expected the name of a group of faces, or a list of names; YAML reads on, off, yes and no as booleans: put a name like that in quotes"),
    ("doe: {sobol: 4}\nevaluate: {measures: {a: {volume: {groups: [roof, 12]}}}}", "or a list of names; YAML reads it as a number: put a name like that in quotes"),
    ("doe: {sobol: 4}\nevaluate: {measures: {on: area}}", "evaluate.measures.True: expected a name; YAML reads on, off, yes and no as booleans"),
    ("doe: {sobol: 4}\nminimize: no\nevaluate: {measures: {a: area}}", "minimize: False, expected the name of a measured value, or a list of names; YAML reads on"),
    ("doe: {sobol: 4}\nevaluate: {measures: {a: {thickness: {tolerance: thin}}}}", "evaluate.measures.a.thickness.tolerance: 'thin', expected a number"),
    ("doe: {sobol: 4}\nevaluate: {measures: {a: clearance}}", "evaluate.measures.a.clearance: exactly one of box"),
    ("doe: {sobol: 4}\nevaluate: {measures: {a: {clearance: {box: [1, 2]}}}}", "evaluate.measures.a.clearance.box: [1, 2], expected {min:"),
    ("doe: {sobol: 4}\nevaluate: {measures: {t: thickness, t_least: area}}", 'evaluate.measures.t_least: gives "t_least", as "t" does'),
    ("doe: {sobol: 4}\nevaluate: {function: f}", 'expected "module:function"'),
    ("doe: {sobol: 4}\nplace: {threads: 0}", "place.threads: 0"),
    ("doe: {sobol: 4}\nevaluate: {command: solve, timeout: 0}", "evaluate.timeout: 0, expected seconds, a positive number"),
    ("doe: {sobol: 4}\nevaluate: {command: solve, timeout: 5m}", "evaluate.timeout: '5m', expected seconds"),
    ("doe: {sobol: 4}\nfailing: 2", "failing: 2"),
])
def test_what_is_wrong_in_the_file(case, tmp_path, text, message):
    (tmp_path / "s.yaml").write_text(f"setup: {case.setup}\n{text}\n")
    with pytest.raises(deformd.InvalidArgument) as raised:
        read_spec(tmp_path / "s.yaml")
    assert message in str(raised.value)

# SPDX-License-Identifier: GPL-3.0-or-later
"""Commands that evaluate the designs of a study, and how they end: with their design, with the study, with its workers."""

import json
import os
import pathlib
import re
import signal
import sys
import time

import pytest

PLACE_DESIGNS = int(os.environ.get("DEFORM_PLACE_DESIGNS", "16"))


def test_a_command_per_design(study, tmp_path):
    (tmp_path / "template").mkdir()
    (tmp_path / "template" / "solve.py").write_text(
        "import json, sys\nx = json.load(open('variables.json'))\nif x['roof_up'] == 0: sys.exit('diverged')\n"
        "lines = [line.split() for line in open(sys.argv[1]) if line.startswith('v ')]\n"
        "json.dump({'top': max(float(line[3]) for line in lines)}, open(sys.argv[2], 'w'))\n")
    code, told = study(f"evaluate: {{command: '{sys.executable} solve.py {{points}} {{result}}', template: template, timeout: 60}}\ndoe: {{factorial: [3, 1]}}")
    assert code == 0, told
    rows = study.history()
    assert [row["verdict"] for row in rows] == ["good", "failed", "good"] and "diverged" in rows[1]["reasons"]
    assert float(rows[2]["top"]) > float(rows[0]["top"])
    assert (study.folder / "cases" / "000002" / "output.txt").exists()


def _ends(process):
    """Whether the process of a number ends within some seconds."""
    for _ in range(100):
        try:
            state = pathlib.Path(f"/proc/{process}/stat").read_text().rsplit(")", 1)[1].split()[0]
        except OSError:
            return True
        if state == "Z":  # nobody waits for it
            return True
        time.sleep(0.05)
    return False


SOLVER = "sh -c 'sleep 300 & echo $! > solver.pid; wait'"


def _solver(study, process, number=0):
    """The process that the command of a design started, once it is there."""
    pid = study.folder / "cases" / f"{number:06}" / "solver.pid"
    while not pid.exists() or not pid.read_text().strip():
        assert process.poll() is None, process.communicate()[0]
        time.sleep(0.05)
    return int(pid.read_text())


def test_what_a_command_started_ends_with_its_design(study):
    code, told = study(f'evaluate: {{command: "{SOLVER}", timeout: 0.5}}\ndoe: {{halton: 1}}')
    assert code == 3 and "longer than 0.5 s" in study.history()[0]["reasons"], told
    assert _ends(int((study.folder / "cases" / "000000" / "solver.pid").read_text()))


@pytest.mark.parametrize("place", ["threads", "processes"])
def test_an_interrupted_study_ends_what_its_commands_started(study, place):
    process = study.start(f'evaluate: {{command: "{SOLVER}"}}\ndoe: {{halton: 4}}\nplace: {{{place}: 2}}', start_new_session=True)
    solvers = [_solver(study, process, number) for number in range(2)]
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does
    told = process.communicate(timeout=60)[0]
    assert process.returncode == 130 and "interrupted" in told and "Traceback" not in told, told
    assert all(_ends(solver) for solver in solvers)
    assert not list((study.folder / "results").glob("*")) and not (study.folder / "journal.jsonl").read_bytes(), "these designs have not failed"


@pytest.mark.parametrize("place, whom", [("threads", "process"), ("threads", "group"), ("processes", "process")])
def test_a_killed_study_ends_what_its_commands_started(study, place, whom):
    """Be it alone or with all processes of its terminal."""
    process = study.start(f'evaluate: {{command: "{SOLVER}"}}\ndoe: {{halton: 2}}\nplace: {{{place}: 1}}', start_new_session=True)
    solver = _solver(study, process)
    if whom == "process":
        process.kill()
    else:
        os.killpg(process.pid, signal.SIGKILL)
    process.communicate(timeout=60)
    assert _ends(solver)


def test_a_killed_worker_ends_what_its_command_started(study):
    process = study.start(f'evaluate: {{command: "{SOLVER}"}}\ndoe: {{halton: 1}}\nplace: {{processes: 1}}')
    solver = _solver(study, process)
    shell = int(pathlib.Path(f"/proc/{solver}/stat").read_text().rsplit(")", 1)[1].split()[1])
    worker = int(pathlib.Path(f"/proc/{shell}/stat").read_text().rsplit(")", 1)[1].split()[1])
    assert worker != process.pid
    (study.folder / "cases" / "000000" / "solver.pid").unlink()
    os.kill(worker, signal.SIGKILL)
    assert _ends(solver)
    assert _solver(study, process) != solver, "another worker has the design"
    process.send_signal(signal.SIGINT)
    assert process.wait(60) == 130


def test_what_a_command_left_behind_when_it_ended_is_left_alone(study, tmp_path):
    """Such as the daemon of a licence."""
    code, told = study(f"evaluate: {{command: \"sh -c 'sleep 60 & echo $! > {tmp_path}/daemon; echo 1 > {{result}}'\"}}\ndoe: {{halton: 1}}")
    assert code == 0, told
    daemon = int((tmp_path / "daemon").read_text())
    assert not _ends(daemon)
    os.kill(daemon, signal.SIGKILL)


def test_the_keeper_of_commands_is_replaced_when_it_was_killed(tmp_path):
    from deformd.study import commands

    with open(tmp_path / "output", "wb") as output:
        assert commands.run(["true"], tmp_path, output, None) == 0
        first = commands._keeper[1]
        assert commands.run(["true"], tmp_path, output, None) == 0 and commands._keeper[1] is first
        first.kill()
        first.wait()
        assert commands.run(["false"], tmp_path, output, None) == 1
    assert commands._keeper[1].pid != first.pid and commands._keeper[1].poll() is None


def test_commands_of_processes_can_be_ended_as_usual(study, tmp_path):
    """Their workers block SIGTERM, for which a thread waits; the commands do not."""
    (tmp_path / "solve.py").write_text("import os, signal, sys\nos.kill(os.getpid(), signal.SIGTERM)\nopen(sys.argv[1], 'w').write('1')\n")
    code, told = study(f"evaluate: {{command: '{sys.executable} -S {tmp_path}/solve.py {{result}}'}}\ndoe: {{halton: 1}}\nplace: {{processes: 1}}")
    assert code == 3 and "ended with -15" in study.history()[0]["reasons"], told


def test_the_share_of_deforming_is_told(study, tmp_path):
    (tmp_path / "template").mkdir()
    (tmp_path / "template" / "sleep.py").write_text("import sys, time\ntime.sleep(0.3)\nopen(sys.argv[1], 'w').write('1')\n")
    code, told = study(f"evaluate: {{command: '{sys.executable} -S sleep.py {{result}}', template: template}}\ndoe: {{halton: 3}}")
    assert code == 0, told
    records = [json.loads(line) for line in (study.folder / "journal.jsonl").read_text().splitlines()]
    assert all(0.3 <= each["seconds_evaluating"] < 10 and 0 < each["seconds_deforming"] < 10 for each in records), records
    deforming, evaluating = (sum(each[f"seconds_{what}"] for each in records) for what in ("deforming", "evaluating"))
    share = re.search(r"^3 designs: (\S+) s of deforming, (\S+) s of evaluating \((\S+) % is deforming\)$", told, re.MULTILINE)
    assert float(share[1]) == pytest.approx(deforming, rel=0.01) and float(share[2]) == pytest.approx(evaluating, rel=0.01)
    assert float(share[3]) == pytest.approx(100 * deforming / (deforming + evaluating), rel=0.01)
    assert "seconds" not in (study.folder / "history.csv").read_text()


@pytest.mark.skipif(PLACE_DESIGNS < 200, reason="submitit tells jobs of a minute after half of it")
def test_a_job_of_this_machine_that_is_out_of_time_has_failed(study):
    pytest.importorskip("submitit")
    code, told = study(f'evaluate: {{command: "{SOLVER}"}}\ndoe: {{halton: 1}}\nplace: {{submitit: {{cluster: local, timeout_min: 1}}}}')
    assert code == 3 and "its job was out of time" in study.history()[0]["reasons"] and "worker ended" not in told, told
    assert _ends(int((study.folder / "cases" / "000000" / "solver.pid").read_text()))

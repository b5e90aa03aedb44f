# SPDX-License-Identifier: GPL-3.0-or-later
"""Studies whose designs are jobs of SLURM, a real one on this machine (slurm_on_loopback.py). Skipped where it is not installed."""

import json
import os
import pathlib
import signal
import subprocess
import sys
import time

import pytest
import slurm_on_loopback

pytest.importorskip("submitit")
if slurm_on_loopback.missing():
    pytest.skip(f"no {', '.join(slurm_on_loopback.missing())}: needs the packages slurm-wlm and munge", allow_module_level=True)

DESIGNS = int(os.environ.get("DEFORM_PLACE_DESIGNS", "16"))
LONG = DESIGNS >= 200
PLACE = "place: {submitit: {cluster: slurm, timeout_min: %d, slurm_partition: short}}"
NOTED = f"evaluate: {{function: study_functions:by_process}}\ndoe: {{halton: {DESIGNS}}}\n" + PLACE % 30


@pytest.fixture(scope="module")
def slurm():
    with slurm_on_loopback.loopback() as made:
        yield made


@pytest.fixture(autouse=True)
def environment(slurm, monkeypatch):
    for name, value in slurm.environment.items():
        monkeypatch.setenv(name, value)
    yield
    slurm.command("scancel", f"--user={os.getuid()}")


class Watched:
    """A study that runs, whose evaluations are counted."""

    def __init__(self, study, text=NOTED, **variables):
        self.study = study
        self.process = study.start(text, **{"STUDY_SECONDS": "0.5", **variables})

    def wait_for(self, count):
        while not self.study.log.exists() or len(self.study.evaluated()) < count:
            assert self.process.poll() is None, self.process.communicate()[0]
            time.sleep(0.02)

    def worker(self):
        """The process of the youngest evaluation."""
        return int(self.study.evaluated()[-1].split()[0])

    def kill(self):
        self.process.kill()
        return self.process.communicate(timeout=60)[0]

    def end(self, code=0):
        told = self.process.communicate(timeout=1800)[0]
        assert self.process.returncode == code, told
        return told


def check_whole(study, again=0):
    """All designs are there; none was evaluated twice but those of which a worker ended meanwhile, `again` of them."""
    assert [int(row["number"]) for row in study.history()] == list(range(DESIGNS)) and {row["verdict"] for row in study.history()} == {"good"}
    records = [json.loads(line) for line in (study.folder / "journal.jsonl").read_text().splitlines()]
    assert sorted(each["number"] for each in records) == list(range(DESIGNS))
    assert not list((study.folder / "results").glob("*"))
    designs = [line.split()[1] for line in study.evaluated()]
    assert len(set(designs)) == DESIGNS and len(designs) <= DESIGNS + again, f"{len(designs)} evaluations"
    return designs


def submitted(study):
    """Jobs that were given to SLURM."""
    return [path.name.split("_submitted")[0] for path in (study.folder / "jobs").glob("*_submitted.pkl")]


def test_slurm_outlives_killed_workers_servers_and_controllers(study, case, slurm):
    """One worker gets SIGKILL, the job of another is cancelled; deformd and slurmctld are killed and come back."""
    watched = Watched(study)
    watched.wait_for(DESIGNS // 4)
    os.kill(watched.worker(), signal.SIGKILL)
    watched.wait_for(DESIGNS // 4 + 3)
    running = slurm.command("squeue", "--noheader", "--array", "--states=running", "--format=%i").split()
    slurm.command("scancel", running[-1])
    watched.wait_for(DESIGNS // 2)
    case.server.kill()
    slurm.stop_controller()
    time.sleep(1.5)
    slurm.start_controller()
    case.server.start()
    told = watched.end()
    check_whole(study, 2)
    assert 1 <= told.count("its worker ended: job") <= 2, told  # the second may have been done by then
    assert len({job.split("_")[0] for job in submitted(study)}) == 1 + told.count("its worker ended"), "the designs are one array, and what was lost a job each"


def test_a_killed_study_takes_its_jobs_over(study, slurm):
    """Those that run, that wait and that have a result meanwhile: nothing is evaluated twice, and nothing submitted twice."""
    watched = Watched(study)
    watched.wait_for(DESIGNS // 4)
    watched.kill()
    watched = Watched(study)
    watched.wait_for(DESIGNS // 2)
    watched.kill()
    while len(study.evaluated()) < DESIGNS * 3 // 4:
        assert slurm.jobs()
        time.sleep(0.05)
    told = Watched(study).end()
    check_whole(study)
    assert len(submitted(study)) == DESIGNS, told


def test_measures_of_jobs_that_ended_meanwhile_are_taken(study, slurm):
    """They are in the files of submitit alone."""
    text = "evaluate: {measures: {v: volume}}\ndoe: {halton: 6}\n" + PLACE % 30
    watched = Watched(study, text)
    while not (study.folder / "jobs").exists() or len(submitted(study)) < 6:
        assert watched.process.poll() is None
        time.sleep(0.01)
    watched.kill()
    while slurm.jobs():
        time.sleep(0.1)
    (study.folder / "jobs").chmod(0o755)
    told = Watched(study, text).end()
    assert len(submitted(study)) == 6 and [row["verdict"] for row in study.history()] == ["good"] * 6, told


def test_jobs_that_were_lost_before_are_not_waited_for(study, slurm):
    """Whatever became of them while the study was not there: cancelled, or ended with an error that has been mended."""
    text = "evaluate: {function: mended_later:height}\ndoe: {halton: 2}\n" + PLACE % 30
    assert "mended_later" in Watched(study, text).end(1)
    (study.folder.parent / "mended_later.py").write_text("from study_functions import by_process\n\n\ndef height(points, variables, report):\n"
                                                         "    return {'z': by_process(points, variables, report)}\n")
    watched = Watched(study, text, STUDY_SECONDS="30")
    watched.wait_for(2)
    watched.kill()
    slurm.command("scancel", *slurm.jobs())
    watched = Watched(study, text)
    told = watched.end()
    assert [row["verdict"] for row in study.history()] == ["good"] * 2 and len(study.evaluated()) == 4 and len(submitted(study)) == 6, told
    assert "its worker ended" not in told


def test_jobs_of_another_server_are_cancelled(study, case, slurm, tmp_path):
    """They would wait for one that is no more."""
    watched = Watched(study, STUDY_SECONDS="3")
    watched.wait_for(2)
    watched.kill()
    case.server.kill()
    before = slurm.jobs()
    port, case.server.port = case.server.port, None
    try:
        case.server.start()
        assert case.server.port != port
        watched = Watched(study)
        while len(submitted(study)) < DESIGNS + 4:
            assert watched.process.poll() is None, watched.process.communicate()[0]
            time.sleep(0.05)
        after = slurm.jobs()
        waiting = {job for job in before if job.split("_")[0] in {each.split("_")[0] for each in after}}
        running = slurm.command("squeue", "--noheader", "--array", "--states=running,completing", "--format=%i").split()
        assert not waiting & set(after) - set(running)
        watched.end()
    finally:
        case.server.stop()
        case.server.port = port
        case.server.start()
    check_whole(study, slurm_on_loopback.CPUS)


SOLVER = "sh -c 'sleep 300 & echo $! > solver.pid; wait'"


def _runs(process):
    try:
        return pathlib.Path(f"/proc/{process}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except OSError:
        return False


def test_an_interrupted_study_cancels_its_jobs(study, slurm):
    watched = Watched(study, f'evaluate: {{command: "{SOLVER}"}}\ndoe: {{halton: {DESIGNS}}}\n' + PLACE % 30)
    pid = study.folder / "cases" / "000001" / "solver.pid"
    while not pid.exists() or not pid.read_text().strip():
        assert watched.process.poll() is None, watched.process.communicate()[0]
        time.sleep(0.05)
    watched.process.send_signal(signal.SIGINT)
    assert "interrupted" in watched.end(130)
    deadline = time.time() + 30
    while slurm.jobs() or _runs(int(pid.read_text())):
        assert time.time() < deadline, "jobs or solvers run on"
        time.sleep(0.1)
    assert not (study.folder / "journal.jsonl").read_bytes()


@pytest.mark.parametrize("ends", ["CANCELLED", pytest.param("requeued", marks=pytest.mark.skipif(not LONG, reason="SLURM waits for two minutes"))])
def test_solvers_that_end_with_their_job_have_not_failed(study, slurm, ends):
    """All processes of a job get SIGTERM. The first solver of a design waits for ever, the next one has a result."""
    command = "sh -c 'test -e {case}.once && echo 7 > {result} || { touch {case}.once; sleep 300; }'"
    watched = Watched(study, f'evaluate: {{command: "{command}"}}\ndoe: {{halton: 1}}\n' + PLACE % 30)
    while not (study.folder / "cases" / "000000.once").exists():
        assert watched.process.poll() is None, watched.process.communicate()[0]
        time.sleep(0.05)
    (job,) = slurm.jobs()
    slurm.command(*(["scancel", job] if ends == "CANCELLED" else ["scontrol", "requeue", job]))
    told = watched.end()
    (row,) = study.history()
    assert (row["verdict"], float(row["value"])) == ("good", 7), told
    assert ("its worker ended" in told) == (ends == "CANCELLED") and len(submitted(study)) == 1 + (ends == "CANCELLED"), told


@pytest.mark.skipif(not LONG, reason="SLURM looks for limits of time every half minute")
def test_a_design_beyond_the_limit_of_its_job_has_failed(study):
    watched = Watched(study, f'evaluate: {{command: "{SOLVER}"}}\ndoe: {{halton: 1}}\n' + PLACE % 1)
    watched.end(3)
    (row,) = study.history()
    assert row["verdict"] == "failed" and "its job was out of time" in row["reasons"] and len(submitted(study)) == 1


@pytest.mark.parametrize("options, step, variable", [("cpus_per_task: 3", "--ntasks=1 --cpus-per-task=3", "SLURM_CPUS_PER_TASK"),
                                                     ("slurm_additional_parameters: {nodes: 1, ntasks-per-node: 3}", "--ntasks=3", "SLURM_NTASKS")])
def test_solvers_have_the_cores_of_the_job_and_start_steps(study, options, step, variable):
    """In a step of srun of its own the worker would have one core, and a step of the solver would wait for it for ever."""
    command = f"sh -c 'srun {step} printenv {variable} > all; sort -u all > {{result}}'"
    text = f'evaluate: {{command: "{command}", timeout: 60}}\ndoe: {{halton: 2}}\nplace: {{submitit: {{cluster: slurm, timeout_min: 5, {options}}}}}'
    told = Watched(study, text).end()
    assert [float(row["value"]) for row in study.history()] == [3, 3], told


def test_the_study_may_be_a_job_itself(study, case, slurm, monkeypatch, tmp_path):
    """A job of an array, whose variables its jobs inherit; the first job of design 0 is killed, so that the next one is alone and not in an array."""
    (tmp_path / "kills.py").write_text("import os, signal\nfrom study_functions import by_process\n\n\ndef first(points, variables, report):\n"
                                       "    if not os.path.exists('killed'):\n        open('killed', 'w').close()\n        os.kill(os.getpid(), signal.SIGKILL)\n"
                                       "    return by_process(points, variables, report)\n")
    (tmp_path / "study.yaml").write_text(f"setup: {case.setup}\nserver: {case.server.address}\nevaluate: {{function: kills:first}}\n"
                                         "doe: {halton: 3}\nplace: {submitit: {cluster: slurm, timeout_min: 5, cpus_per_task: 2}}\n")
    monkeypatch.setenv("STUDY_LOG", str(study.log))
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([os.environ.get("PYTHONPATH", ""), str(pathlib.Path(__file__).parent)]))
    done = subprocess.run(["sbatch", "--wait", "--array=3", "--time=10", f"--output={tmp_path}/told", "--wrap",
                           f"{sys.executable} -m deformd.study {tmp_path}/study.yaml"], cwd=tmp_path, timeout=280)
    told = (tmp_path / "told").read_text()
    assert done.returncode == 0 and [row["verdict"] for row in study.history()] == ["good"] * 3, told
    assert told.count("its worker ended") == 1 and len(study.evaluated()) == 3


@pytest.mark.parametrize("options, says", [
    ("slurm_partition: nowhere", "error: place.submitit: sbatch: error: "),
    ("slurm_partitoin: short", "error: place.submitit: Unknown argument 'partitoin'"),
    ("tasks_per_node: 4", "error: place.submitit: a design has one worker"),
    ("nodes: 2", "error: place.submitit: a design has one worker"),
])
def test_what_is_wrong_about_the_place(study, options, says):
    code, told = study(f"evaluate: {{measures: {{v: volume}}}}\ndoe: {{halton: 3}}\nplace: {{submitit: {{cluster: slurm, {options}}}}}")
    assert code == 1 and says in told and "Traceback" not in told, told


def test_a_place_without_slurm(study, tmp_path):
    """Where PATH has no srun."""
    code, told = study("evaluate: {measures: {v: volume}}\ndoe: {halton: 3}\nplace: {submitit: {cluster: slurm}}", PATH=str(tmp_path))
    assert code == 1 and told.startswith("error: place.submitit: ") and "srun" in told and "Traceback" not in told, told


def test_the_script_runs_commands(tmp_path):
    done = subprocess.run([sys.executable, slurm_on_loopback.__file__, "sinfo", "--noheader", "--format=%P"], capture_output=True, text=True, timeout=100)
    assert (done.returncode, done.stdout) == (0, "short*\n"), done.stderr

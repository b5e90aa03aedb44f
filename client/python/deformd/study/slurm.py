# SPDX-License-Identifier: Apache-2.0
"""Jobs of SLURM, submitted by submitit: in arrays, watched in the queue, and taken over from a run of the study that was killed."""

import contextlib
import os
import pathlib
import signal
import subprocess
import time
from typing import Any, Callable, Dict, Iterable, Iterator, List, Mapping, Optional, Sequence, Tuple

from submitit.core.utils import DelayedSubmission, FailedJobError, FailedSubmissionError, UncompletedJobError, pickle_load
from submitit.slurm.slurm import SlurmJob

from ..errors import InvalidArgument
from .places import OutOfTime, Place, WorkerLost

ARRAY = 1000
"""Most designs of an array; the default of MaxArraySize allows 1001."""
ASKED_EVERY = 10.0
"""Seconds between questions about the queue. What jobs have as results is seen at once; only those without a result are found by this."""
GRACE = 15.0
"""Seconds after the end of a job in which its result may still appear in a folder of another machine."""
SETTLING = 1.0
"""Seconds in which a job whose evaluation failed may learn that it is to end: its processes get SIGTERM one after the other."""
_ENDED = ("BOOT_FAIL", "CANCELLED", "COMPLETED", "DEADLINE", "FAILED", "NODE_FAIL", "OUT_OF_MEMORY", "PREEMPTED", "TIMEOUT")


def in_job(function: Callable[..., Any], task: Mapping[str, Any]) -> Any:
    """function(task, before_failing=...) in a job of SLURM. Ends this process with SIGTERM, which all processes of a job get before they are killed:
    at the end of its time, by scancel, to make room for others. A solver that ends by it has not failed: the job begins again, or another has the design."""
    signal.signal(signal.SIGTERM, lambda *_: os._exit(128 + signal.SIGTERM))  # its commands end with it
    return function(task, before_failing=lambda: time.sleep(SETTLING))


class Slurm(Place):
    """Each design is a job with one worker, which runs in_job(). submitit keeps tasks and results in files; from them a study that was killed finds its jobs again."""

    def __init__(self, executor: Any) -> None:
        super().__init__(executor.submit, (UncompletedJobError,), (FailedJobError,))
        self._executor, self._folder = executor, pathlib.Path(executor.folder)
        self._queue = _Queue(self._folder)
        self._left = self._jobs_left()

    def submit_all(self, function: Callable[..., Any], tasks: Iterable[Mapping[str, Any]]) -> Iterator[Tuple[Mapping[str, Any], Any]]:
        anew = []
        for task in tasks:
            left = self._left.pop(task["number"], [])
            same = [job for of, job in left if of == task]
            self.cancel([job for _, job in left if job not in same[-1:]])  # such as those that would go to a server that is no more
            if same:
                yield task, same[-1]
            else:
                anew.append(task)
        for first in range(0, len(anew), ARRAY):
            part = anew[first:first + ARRAY]
            try:
                jobs = self._executor.map_array(in_job, [function] * len(part), part)
            except (FailedJobError, FailedSubmissionError) as error:  # sbatch refuses it
                lines = [line for line in str(error).splitlines() if "error:" in line] or str(error).splitlines()
                raise InvalidArgument(f"place.submitit: {lines[-1].strip()}") from error
            now = time.monotonic()
            yield from zip(part, [_Job(job, self._queue, now) for job in jobs])

    def cancel(self, futures: Sequence[Any]) -> None:
        numbers = [future.job.job_id for future in futures]
        for first in range(0, len(numbers), ARRAY):
            subprocess.run(["scancel", "--quiet", *numbers[first:first + ARRAY]], check=False)

    def _jobs_left(self) -> Dict[int, List[Tuple[Any, "_Job"]]]:
        """Jobs of earlier runs that have a result or will have one, with their tasks, by number of the design; the youngest last."""
        found: Dict[int, List[Tuple[Any, _Job]]] = {}
        for path in sorted(self._folder.glob("*_submitted.pkl"), key=lambda path: path.stat().st_mtime):
            job = _Job(SlurmJob(self._folder, path.name[:-len("_submitted.pkl")]), self._queue, submitted=0.0)  # any answer is younger
            kept = job.job.paths.result_pickle
            try:
                if kept.exists() and pickle_load(kept)[0] != "success" or not kept.exists() and self._queue.state(job) is not None:
                    continue
                task = DelayedSubmission.load(path).args[1]
                found.setdefault(task["number"], []).append((task, job))
            except Exception:  # files of another version of the package or of submitit: these designs are evaluated anew
                continue
        return found


class _Job:
    """A job as a future."""

    def __init__(self, job: Any, queue: "_Queue", submitted: float) -> None:
        """submitted: when, by time.monotonic(); answers of the queue from before say nothing of it."""
        self.job, self.submitted = job, submitted
        self._queue = queue

    def done(self) -> bool:
        return self.job.paths.result_pickle.exists() or self._queue.ended(self)

    def result(self) -> Any:
        if self.job.paths.result_pickle.exists():
            return self.job.result()
        state = self._queue.state(self)
        if state == "TIMEOUT":
            raise OutOfTime(f"job {self.job.job_id} of SLURM")
        with contextlib.suppress(OSError, IndexError):
            state = f"{state}, {self.job.paths.stderr.read_text(errors='replace').strip().splitlines()[-1]}"
        raise WorkerLost(f"job {self.job.job_id} of SLURM: {state}")


class _Queue:
    """What becomes of jobs, by squeue: sacct, which submitit asks, is there on clusters with a database of accounts only."""

    def __init__(self, folder: pathlib.Path) -> None:
        self._folder = folder
        self._states: Dict[str, str] = {}
        self._asked, self._known = -ASKED_EVERY, -1.0  # when it was asked, and when it answered
        self._ended: Dict[str, float] = {}

    def state(self, job: _Job) -> Optional[str]:
        """How a job ended; None of one that has not, as far as is known."""
        if time.monotonic() - self._asked >= ASKED_EVERY:
            self._ask()
        if self._known < job.submitted:
            return None
        state = self._states.get(job.job.job_id, "no longer in the queue")
        return state if state in _ENDED or job.job.job_id not in self._states else None

    def ended(self, job: _Job) -> bool:
        """For so long that its result would be there."""
        if self.state(job) is None:
            self._ended.pop(job.job.job_id, None)  # SLURM may begin a job again
            return False
        return time.monotonic() - self._ended.setdefault(job.job.job_id, time.monotonic()) > GRACE

    def _ask(self) -> None:
        self._asked = time.monotonic()
        with contextlib.suppress(OSError):
            self._folder.chmod(self._folder.stat().st_mode)  # has NFS look at the folder anew
        try:
            listed = subprocess.run(["squeue", "--noheader", "--array", "--states=all", f"--user={os.getuid()}", "--format=%i %T"], check=True, timeout=60,
                                    stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True).stdout
        except (OSError, subprocess.SubprocessError):  # the controller is restarted: nothing new is known
            return
        self._states = {line.split()[0]: line.split()[1] for line in listed.splitlines() if line.strip()}
        self._known = self._asked


def open_slurm(executor: Any, parameters: Mapping[str, Any]) -> Slurm:
    """The place of an executor of submitit for SLURM with these parameters."""
    if any(int(parameters.get(name, 1)) > 1 for name in ("nodes", "tasks_per_node", "slurm_nodes", "slurm_ntasks_per_node", "slurm_tasks_per_node")):
        raise InvalidArgument("place.submitit: a design has one worker: for solvers that run in parallel, cpus_per_task, or over several nodes "
                              "slurm_additional_parameters: {nodes: 2, ntasks-per-node: 16}, and srun or mpirun in the command")
    for name in [each for each in os.environ if each.startswith("SLURM_") and each != "SLURM_CONF"]:
        del os.environ[name]  # of the job in which the study itself runs: its jobs would take them for theirs
    # The worker is the script of the job itself: a step of srun would have one core of those of cpus_per_task, and no steps within.
    executor.update_parameters(**{"slurm_use_srun": False, **parameters})
    return Slurm(executor)


__all__ = ["Slurm", "open_slurm"]

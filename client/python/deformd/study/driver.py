# SPDX-License-Identifier: Apache-2.0
"""Runs a study: asks for designs, has them evaluated, keeps what came of them."""

import concurrent.futures
import hashlib
import json
import os
import pathlib
import sys
import time
from typing import Any, Callable, Dict, Iterable, List, Optional, Tuple, Union

import numpy as np

from .. import _deformd
from ..client import Client
from ..compiled import load
from ..errors import DataLoss, Error, InvalidArgument
from ..quality import violation
from . import optimizers, results
from .commands import end_commands
from .journal import Journal
from .libraries import needing_libraries
from .places import OutOfTime, Place, WorkerLost, open_place
from .sampling import sample
from .spec import TOLERANCE, Spec, name_advice, read_spec
from .worker import Task, check_format, check_quality, evaluate, failed_record, kept_result, mesh_beside

FAILED = 1e60
"""What optimizers of one objective see for a design that failed or is bad: this, times 1 plus how far it lies from the start, in parts of the bounds,
where the optimizer ranks designs. So they rank after all others, and a population of which all failed goes back to where designs can be used."""
ATTEMPTS = 3
"""At a design whose worker ends, until it counts as failed."""
INFEASIBLE = 1e30
"""What they see for one outside of the constraints: this, times 1 plus the sum of the violations."""


class StudyStopped(Error):
    """More designs failed than the study allows."""

    code = "stopped"


class OutsideConstraints(Error):
    """A search has ended, and none of its designs is within the constraints."""

    code = "outside"


class BudgetSpent(Exception):
    """Ends an optimizer: all designs of the budget are evaluated."""


class Study:
    """A study that runs; `optimizers` ask it. Not for several threads.

    names: of the variables; bounds: (k, 2). A design is evaluated once: records of earlier runs, and of the same values, are taken
    as they are. Designs are numbered in the order in which they are asked for, so a history does not depend on who was done first.
    """

    def __init__(self, spec: Spec, journal: Journal, task: Task, names: Tuple[str, ...], bounds: np.ndarray, place: Place, say: Callable[[str], None]) -> None:
        self.spec, self.names, self.bounds = spec, names, bounds
        self._journal, self._task, self._place, self._say = journal, task, place, say
        self._numbers: Dict[bytes, int] = {}
        self._best: Optional[float] = None
        self._began = time.monotonic()

    def designs(self, rows: Iterable[Iterable[float]]) -> List[Dict[str, Any]]:
        """Records of designs, (m, k), in that order. Raises BudgetSpent when not all of them are within the budget, once those that are have been
        evaluated; StudyStopped when too many fail."""
        asked, tasks, spent = [], [], False
        for row in np.atleast_2d(np.asarray(rows, dtype=np.float64)) + 0.0:  # -0.0 is 0.0
            key = row.tobytes()
            if key not in self._numbers:
                number = len(self._numbers)
                if self.spec.budget is not None and number >= self.spec.budget:
                    spent = True
                    break
                self._numbers[key] = number
                known = self._journal.records.get(number)
                if known is None:
                    tasks.append({**self._task, "number": number, "x": row.tolist()})
                elif known["x"] != row.tolist():
                    raise DataLoss(f"design {number} is not the one that the journal has: the optimizer or a library changed since {self.spec.folder} was "
                                   "begun; name another folder")
            asked.append(self._numbers[key])
        self._evaluate(tasks)
        if spent:
            raise BudgetSpent
        return [self._journal.records[number] for number in asked]

    def value(self, record: Dict[str, Any], objective: int = 0) -> float:
        """What an optimizer minimizes."""
        if failed(record):
            return FAILED
        violation = sum(max(0.0, each) for each in self.violations(record))
        if violation > TOLERANCE:
            return INFEASIBLE * (1 + violation)
        return self.objective(record, objective)

    def objective(self, record: Dict[str, Any], number: int = 0) -> float:
        """The objective alone, with the sign of a minimization; FAILED where it was not evaluated."""
        name, sign = self.spec.objectives[number]
        if name not in record["values"] and not_evaluated(record):
            return FAILED
        return sign * _named(record, name)

    def violations(self, record: Dict[str, Any]) -> List[float]:
        """Per constraint how much a value is beyond its limit, in parts of the limit; negative within."""
        return violations(self.spec, record)

    def _evaluate(self, tasks: List[Task]) -> None:
        ready = [(task, kept_result(task)) for task in tasks]
        for task, record in ready:
            if record is not None:
                self._add(record, 0.0)
        began: Dict[Any, float] = {}
        futures: Dict[Any, Task] = {}
        lost = {task["number"]: 0 for task in tasks}

        def submit(given: List[Task]) -> None:
            for task, future in self._place.submit_all(evaluate, given):
                futures[future], began[future] = task, time.monotonic()

        try:
            submit([task for task, record in ready if record is None])
            while futures:
                for future in _done(futures):
                    # Not kept: Dask computes lost results of futures that somebody still has once more.
                    task, seconds = futures.pop(future), time.monotonic() - began.pop(future)
                    try:
                        record = self._place.result(future)
                    except OutOfTime as error:
                        record = failed_record(task, f"its job was out of time: {error}")
                    except WorkerLost as error:
                        lost[task["number"]] += 1
                        self._say(f"design {task['number']}: its worker ended: {error}")
                        if lost[task["number"]] < ATTEMPTS:
                            submit([task])
                            continue
                        record = failed_record(task, f"its worker ended {ATTEMPTS} times: {error}")
                    self._add(record, seconds)
        except BaseException:
            self._place.cancel(list(futures))
            end_commands()
            raise

    def _add(self, record: Dict[str, Any], seconds: float) -> None:
        self._journal.add({**record, "seconds": round(seconds, 3)})
        (self.spec.folder / "results" / f"{record['number']:06}.json").unlink(missing_ok=True)
        self._tell(record)
        records = self._journal.records.values()
        bad = [each for each in records if failed(each)]
        if len(records) >= 20 and len(bad) > self.spec.failing * len(records):
            raise StudyStopped(f"{len(bad)} of {len(records)} designs failed, the last one: {'; '.join(bad[-1]['reasons'])}. {_REPAIR}; "
                               "`failing: 1` in the file goes on whatever fails")

    def _tell(self, record: Dict[str, Any]) -> None:
        records = self._journal.records
        whole = self.spec.budget if self.spec.doe is None else len(self._numbers)  # a design of experiments is asked for at once
        done = len(records) if whole is None else sum(number in records for number in range(whole))
        line = f"{done}{f'/{whole}' if whole else ''}  design {record['number']}: {record['verdict']}"
        if failed(record):
            line += f" ({'; '.join(record['reasons'])[:120]})"
        elif len(self.spec.objectives) == 1:
            name, sign = self.spec.objectives[0]
            value = self.value(record)
            if self._best is None:
                self._best = min(self.value(each) for each in self._journal.records.values())
            self._best = min(self._best, value)
            line += f"  {name} {_named(record, name):.6g}" if name in record["values"] or not not_evaluated(record) else "  not evaluated"
            line += "" if value < INFEASIBLE else " (outside of the constraints)"
            line += f"  best {sign * self._best:.6g}" if self._best < INFEASIBLE else ""
        self._say(f"{line}  {time.monotonic() - self._began:.0f} s")


def failed(record: Dict[str, Any]) -> bool:
    """The design must not be used: its verdict is bad, or its evaluation failed."""
    return record["verdict"] in ("bad", "failed")


def not_evaluated(record: Dict[str, Any]) -> bool:
    """Its quality is outside of the constraints, so that only that was measured (Task: skip)."""
    return bool(record.get("not_evaluated", False))


def violations(spec: Spec, record: Dict[str, Any]) -> List[float]:
    """As Study.violations has them; 0 of what was not evaluated."""
    return [0.0 if not_evaluated(record) and name not in record["values"] else violation(_named(record, name), side, limit)
            for name, side, limit in spec.constraints]


def _named(record: Dict[str, Any], name: str) -> float:
    if name not in record["values"]:
        raise InvalidArgument(f'"{name}": design {record["number"]} has no such value, only {", ".join(record["values"]) or "none"}'
                              f'{name_advice(name, record["values"])}')
    return float(record["values"][name])


def _done(futures: Iterable[Any]) -> List[Any]:
    pending = list(futures)
    if all(isinstance(future, concurrent.futures.Future) for future in pending):
        return sorted(concurrent.futures.wait(pending, return_when=concurrent.futures.FIRST_COMPLETED).done, key=pending.index)
    while True:  # jobs of schedulers
        done = [future for future in pending if future.done()]
        if done:
            return done
        time.sleep(0.2)


@needing_libraries()
def run_study(path: Union[str, "os.PathLike[str]"], say: Callable[[str], None] = print) -> List[Dict[str, Any]]:
    """Runs the study of a file, or goes on with it, and writes its results. Returns the records by number of the design.

    say: takes the lines of progress. Raises InvalidArgument for what is wrong in the file, StudyStopped when too many designs fail, OutsideConstraints
    when a search ends without a design within the constraints, ImportError that says what to install for a library that is missing.
    """
    spec = read_spec(path)
    if str(spec.base) not in sys.path:
        sys.path.insert(0, str(spec.base))  # functions are looked for beside the file
    os.environ["PYTHONPATH"] = os.pathsep.join(dict.fromkeys([str(spec.base), *filter(None, os.environ.get("PYTHONPATH", "").split(os.pathsep))]))
    journal = Journal(spec.folder, spec.identity)
    try:
        known = len(journal.records)
        if known:
            say(f"{known} designs are known from before")
        task, names, bounds = _task(spec)
        with open_place(spec.place, spec.folder) as place:
            study = Study(spec, journal, task, names, bounds, place, say)
            ends = []
            try:
                if spec.doe is not None:
                    study.designs(sample(spec.doe, names, bounds, spec.seed))
                else:
                    ends.append(f"ended: {optimizers.run(study)}")
            except BudgetSpent:
                if spec.optimizer is not None:
                    ends.append(f"ended: the budget of {spec.budget} designs is spent")
            finally:
                if spec.optimizer is not None:
                    ends += _outcome(spec, journal.in_order())
                results.write(spec, names, bounds, task, journal.in_order(), ends)
        lost = next((line for line in ends if line.startswith(_OUTSIDE)), None)
        for line in [*(line for line in ends if line != lost), _shares(journal.in_order()), f"results: {spec.folder / 'report.html'}"]:
            say(line)
        if lost is not None:
            raise OutsideConstraints(lost)
        records = journal.in_order()
        if records and all(failed(each) for each in records):
            raise StudyStopped(f"{'the only design' if len(records) == 1 else f'all {len(records)} designs'} failed, the last one: "
                               f"{'; '.join(records[-1]['reasons'])}. {_REPAIR}")
        return records
    finally:
        journal.close()


_OUTSIDE = "no design is within the constraints"
_REPAIR = "Narrow the bounds of the variables or repair the evaluator"


def _outcome(spec: Spec, records: List[Dict[str, Any]]) -> List[str]:
    """What a search found, where that is not what it was for."""
    best = results.best_of(spec, records)
    if best is not None and len(spec.objectives) > 1:
        front = results.front_of(spec, records)
        return [f"{len(front)} of {len(records)} designs are on the Pareto front: none is better in one objective without being worse in another"]
    measured = [each for each in records
                if not failed(each) and (not_evaluated(each) or all(name in each["values"] for name, _, _ in spec.constraints))]
    if best is not None:
        searched = spec.optimizer is not None and spec.optimizer[0] in ("scipy", "nlopt")  # populations do not begin at the start itself
        if searched and best is records[0] and len(records) > 1:
            return ["no design is better than the start, design 0"]
        return []
    if not measured:
        return []
    nearest = min(measured, key=lambda each: max(violations(spec, each), default=0.0))
    missed = [f"{name} {_named(nearest, name):.6g}, {side} {limit:.6g}" for (name, side, limit), by in zip(spec.constraints, violations(spec, nearest))
              if by > TOLERANCE]
    return [f"{_OUTSIDE}; the nearest is design {nearest['number']}: {'; '.join(missed)}"]


def _shares(records: List[Dict[str, Any]]) -> str:
    """What of the workers' time deformation took."""
    seconds = {what: sum(each.get(f"seconds_{what}", 0.0) for each in records) for what in ("deforming", "quality", "evaluating")}
    whole = sum(seconds.values())

    def share(what: str) -> str:
        return f"{100 * seconds[what] / whole if whole else 0:.3g} %"

    if not any("seconds_quality" in each for each in records):
        return f"{len(records)} designs: {seconds['deforming']:.3g} s of deforming, {seconds['evaluating']:.3g} s of evaluating ({share('deforming')} is deforming)"
    return (f"{len(records)} designs: {seconds['deforming']:.3g} s of deforming, {seconds['quality']:.3g} s of measuring quality, "
            f"{seconds['evaluating']:.3g} s of evaluating ({share('deforming')} is deforming, {share('quality')} quality)")


def _task(spec: Spec) -> Tuple[Task, Tuple[str, ...], np.ndarray]:
    study = hashlib.sha256(json.dumps(spec.identity, sort_keys=True).encode()).hexdigest()
    task: Task = {"study": study, "evaluate": spec.evaluate, "folder": str(spec.folder), "write": spec.meshes, "gradients": optimizers.gradients_of(spec),
                  "server": spec.server, "system": None, "compiled": None, "mesh": str(spec.mesh) if spec.mesh else None, "skip": optimizers.skipping(spec)}
    if spec.setup.suffix == ".deformation":
        task["mesh"] = task["mesh"] or mesh_beside(spec.setup)
        check_quality(task, by_server=False)
        check_format(task)
        fast = load(spec.setup)
        return {**task, "compiled": str(spec.setup), "names": fast.names}, fast.names, fast.bounds
    if task["mesh"] is None:
        task["mesh"] = str(_deformd.Setup.read(str(spec.setup), False).geometry_file or "") or None
    check_quality(task, by_server=spec.deformation == "server")
    check_format(task)
    with Client(spec.server) as client:
        system = client.prepare(spec.setup, None if spec.mesh is None else spec.mesh)
        task.update(server=client.address, system=system.id, names=system.names)
        if spec.deformation == "compiled":
            compiled = pathlib.Path(spec.folder) / "system.deformation"
            system.local().save(compiled)
            task["compiled"] = str(compiled)
        return task, system.names, system.bounds

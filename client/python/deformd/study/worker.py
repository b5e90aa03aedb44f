# SPDX-License-Identifier: Apache-2.0
"""Evaluates one design; runs in the processes of a place. What travels is a task of a few numbers: meshes do not."""

import contextlib
import importlib
import json
import math
import os
import pathlib
import shlex
import shutil
import subprocess
import tempfile
import threading
import time
from typing import Any, Callable, Dict, Iterator, List, Mapping, Optional, Tuple

import numpy as np

from .. import _deformd
from ..client import Client, _isolated_reader
from ..compiled import load
from ..errors import Error, InvalidArgument, NumericalFailure
from ..faces import CellCheck, FaceCheck
from ..quality import REPORT_MEASURES, Quality, differences, report_measure, violation
from ..reports import CompiledReport
from . import commands
from .journal import write_whole
from .measures import Evaluation, make_measure
from .spec import TOLERANCE, name_advice

Task = Dict[str, Any]
"""number, x; study (what its file says, as a hash); evaluate, names; server and system, or compiled (a path); mesh (a path or None); folder; write (an extension or None); gradients; skip, the
constraints on quality outside of which nothing is evaluated."""

PATIENCE = 600.0
"""Seconds for which a worker waits for a server that went away."""

_lock = threading.Lock()
_loaded: Dict[str, Any] = {}
_FAILURES = ("invalid_argument", "numerical_failure", "deadline_exceeded")


def evaluate(task: Task, before_failing: Callable[[], None] = lambda: None) -> Dict[str, Any]:
    """The record of a design: number, x, verdict, reasons, values, gradients (of values at the variables), mesh, whose file was written, and
    seconds_deforming (until its points are there, for a command as a file), seconds_evaluating (by measures, function or command) and, where
    it is measured, seconds_quality. not_evaluated: True where quality is outside of its constraints and the task says that this is enough.

    verdict: that of the report, "failed" where evaluator or design failed; of compiled deformations "bad" where cells
    are inverted, "doubtful" where faces are flipped or handles mirrored, else "unknown". Raises what has nothing to do with the design: no server, no such function. What
    functions and commands gave is kept in the folder, so that it is there for the study even if that ended meanwhile. before_failing: is called
    before a record of a failed evaluation.
    """
    kept = pathlib.Path(task["folder"]) / "results" / f"{task['number']:06}.json"
    found = kept_result(task)
    if found is not None:
        return found
    record = _evaluate(task)
    if record["verdict"] == "failed":
        before_failing()
    if "function" in task["evaluate"] or "command" in task["evaluate"]:
        kept.parent.mkdir(exist_ok=True)
        write_whole(kept, json.dumps({**record, "study": task["study"]}, allow_nan=False).encode())
    return record


def failed_record(task: Task, reason: str) -> Dict[str, Any]:
    """The record of a design that no worker has one of."""
    return {"number": task["number"], "x": task["x"], "seconds_deforming": 0.0, "seconds_evaluating": 0.0, "verdict": "failed", "reasons": [reason], "values": {},
            "gradients": {}, "mesh": None}


def kept_result(task: Task) -> Optional[Dict[str, Any]]:
    """What a worker of this study kept of this design, if it did."""
    kept = pathlib.Path(task["folder"]) / "results" / f"{task['number']:06}.json"
    if not kept.exists():
        return None
    record: Dict[str, Any] = json.loads(kept.read_text())
    study = record.pop("study", None)  # a job of what the folder was begun with may end late
    return record if record["x"] == task["x"] and study == task["study"] else None


def _evaluate(task: Task) -> Dict[str, Any]:
    system = _system(task)
    x = np.array(task["x"])
    record: Dict[str, Any] = {"number": task["number"], "x": task["x"], "seconds_deforming": 0.0, "seconds_evaluating": 0.0}
    looks = {"faces": _face_check(task)} if task["compiled"] else {}
    if task["compiled"]:
        _cell_check(task)  # is made once, which is no time of this design
    with _timed(record, "deforming"):
        points, report = system.deform(x, **looks)
    record.update(verdict=getattr(report, "verdict", "unknown"), reasons=list(report.reasons), values={}, gradients={}, mesh=None)
    if task["compiled"]:
        flipped = [f"{report.flipped_faces} of {looks['faces'].faces} faces are flipped"] if report.flipped_faces else []
        doubts = [*report.doubts, *flipped]
        inverted = [] if report.bad else _inverted(task, points, record)
        if inverted or doubts:
            record.update(verdict="bad" if inverted else "doubtful", reasons=[*report.reasons, *inverted, *doubts])
    error = report.error
    if error is not None and error.code.lower() not in _FAILURES and not isinstance(error, InvalidArgument):
        raise error
    if report.bad or record["verdict"] == "bad":
        return {**record, "verdict": "bad"}
    try:
        quality = _measure_quality(task, points, report, record)
        record["values"] = dict(quality)
        outside = [f"{name} {quality[name]:.6g}, {side} {limit:.6g}" for name, side, limit in task.get("skip", ())
                   if violation(quality[name], side, limit) > TOLERANCE]
        if outside and task["evaluate"].keys() - {"quality", "walls"}:
            return {**record, "reasons": [*record["reasons"], *(f"not evaluated: {each}" for each in outside)], "not_evaluated": True}
        values, slopes = _values(task, points, report, record)
        both = next((name for name in quality if name in values), None)
        if both is not None:
            raise InvalidArgument(f'"{both}": the evaluator gives it, and evaluate.quality measures it; name one of them otherwise')
        values.update(quality)
        by_difference = _quality_slopes(task, system, x, [name for name in task["gradients"] if name in quality], record)
    except _Failed as failed:
        return {**record, "verdict": "failed", "reasons": [str(failed)]}
    record["values"] = values
    if task["gradients"]:
        unknown = next((name for name in task["gradients"] if name not in values), None)
        if unknown is not None:
            raise InvalidArgument(f'"{unknown}": design {task["number"]} has no such value, only {", ".join(values) or "none"}'
                                  f"{name_advice(unknown, values)}")
        missing = [name for name in task["gradients"] if name not in slopes and name not in by_difference]
        if missing:
            raise InvalidArgument(f"evaluate: no gradient of {', '.join(missing)} at the points, which the optimizer needs")
        record["gradients"] = {name: (by_difference[name] if name in by_difference else system.vjp(x, slopes[name])).tolist()
                               for name in task["gradients"]}
    if task["write"]:
        folder = pathlib.Path(task["folder"]) / "meshes"
        folder.mkdir(exist_ok=True)
        name = f"{task['number']:06}{task['write']}"
        beside = folder / f"writing-{name}"
        _mesh(task).write(str(beside), points)
        os.replace(beside, folder / name)
        record["mesh"] = f"meshes/{name}"
    return record


class _Failed(Exception):
    """The evaluator has no value of this design."""


@contextlib.contextmanager
def _timed(record: Dict[str, Any], what: str) -> Iterator[None]:
    began = time.perf_counter()
    try:
        yield
    finally:
        record[f"seconds_{what}"] = round(record[f"seconds_{what}"] + time.perf_counter() - began, 6)


def _values(task: Task, points: np.ndarray, report: Any, record: Dict[str, Any]) -> Tuple[Dict[str, float], Dict[str, np.ndarray]]:
    """Values and their gradients at the points; the time they took goes to the record."""
    how = task["evaluate"]
    slopes: Dict[str, np.ndarray] = {}
    if not how.keys() - {"quality", "walls"}:
        return {}, {}
    if "measures" in how:
        values: Any = {}
        with _timed(record, "evaluating"):
            for name in how["measures"]:
                try:
                    found, slope = _measure(task, name)(points, name in task["gradients"])
                except NumericalFailure as error:
                    raise _Failed(f"{name}: {error}") from None
                values.update(found)
                if slope is not None:
                    slopes[name] = slope
    elif "function" in how:
        module, name = how["function"].split(":")
        function = getattr(importlib.import_module(module), name)
        try:
            with _timed(record, "evaluating"):
                values = function(points, dict(zip(task["names"], task["x"])), report)
        except Exception as error:  # whatever the user's function raises is its failure for this design
            raise _Failed(f"{how['function']}: {type(error).__name__}: {error}") from error
        if isinstance(values, tuple):
            values, slopes = values
    else:
        values = _command(task, points, record)
    if not isinstance(values, Mapping):
        values = {"value": values}
    try:
        checked = {str(name): float(value) for name, value in values.items()}
    except (TypeError, ValueError):
        raise _Failed(f"evaluate: expected numbers by name, not {values!r}") from None
    for name, value in checked.items():
        if not math.isfinite(value):
            raise _Failed(f"{name}: {value}")
    return checked, slopes


def _measure_quality(task: Task, points: np.ndarray, report: Any, record: Dict[str, Any]) -> Dict[str, float]:
    """The measures of evaluate.quality, of the report where it has them; the time they took goes to the record."""
    names = task["evaluate"].get("quality", ())
    if not names:
        return {}
    record["seconds_quality"] = 0.0
    known = {name: report_measure(name, report) for name in names}
    wanted = [name for name, value in known.items() if value is None]
    if wanted:
        quality = _quality(task)
        with _timed(record, "quality"):
            known.update(quality.values(points, wanted))
    for name, value in known.items():
        if value is None or not math.isfinite(value):
            raise _Failed(f"{name}: {value}")
    return {name: float(value) for name, value in known.items() if value is not None}


def _quality_slopes(task: Task, system: Any, x: np.ndarray, names: List[str], record: Dict[str, Any]) -> Dict[str, np.ndarray]:
    """Derivatives with respect to the variables, by differences: they take designs that are deformed, but not evaluated."""
    if not names:
        return {}
    try:
        with _timed(record, "quality"):
            return differences(system, x, _quality(task), names)
    except NumericalFailure as error:
        raise _Failed(str(error)) from None


def _command(task: Task, points: np.ndarray, record: Dict[str, Any]) -> Any:
    """Values that a command left in {result}: JSON of names and numbers, or one number."""
    how = task["evaluate"]
    case = pathlib.Path(task["folder"]) / "cases" / f"{task['number']:06}"
    with _timed(record, "evaluating"):
        if case.exists():
            shutil.rmtree(case)
        if "template" in how:
            shutil.copytree(how["template"], case)
        else:
            case.mkdir(parents=True)
    mesh = _mesh(task, needed=False)
    shape = case / f"design{task['write'] or pathlib.Path(task['mesh']).suffix if mesh else '.npy'}"
    with _timed(record, "deforming"):
        if mesh:
            mesh.write(str(shape), points)
        else:
            np.save(shape, points)
    (case / "variables.json").write_text(json.dumps(dict(zip(task["names"], task["x"]))))
    result = case / "result.json"
    places = {"{points}": str(shape), "{case}": str(case), "{result}": str(result)}
    words = shlex.split(how["command"])
    for place, value in places.items():
        words = [word.replace(place, value) for word in words]
    with open(case / "output.txt", "wb") as output, _timed(record, "evaluating"):
        try:
            status = commands.run(words, case, output, how.get("timeout"))
        except subprocess.TimeoutExpired as late:
            raise _Failed(f"{words[0]}: longer than {late.timeout:g} s") from None
        except FileNotFoundError:
            raise InvalidArgument(f"evaluate.command: there is no program {words[0]}") from None
    if status != 0:
        raise _Failed(f"{words[0]}: ended with {status}: {_tail(case / 'output.txt')}")
    if not result.exists():
        raise _Failed(f"{words[0]}: wrote no {result}")
    try:
        return json.loads(result.read_text())
    except ValueError:
        raise _Failed(f"{result}: expected JSON, a mapping of names to numbers or a number") from None


def _tail(path: pathlib.Path) -> str:
    return path.read_bytes()[-200:].decode(errors="replace").strip()


def _system(task: Task) -> Any:
    if task["compiled"]:
        return _once("compiled:" + task["compiled"], lambda: load(task["compiled"]))
    return _once(f"system:{task['server']}:{task['system']}", lambda: Client(task["server"], patience=PATIENCE).system(task["system"]))


def _mesh(task: Task, needed: bool = True) -> Any:
    if task["mesh"] is None:
        if needed:
            raise InvalidArgument("mesh: missing, and it does not stand beside the compiled deformation; name the mesh file whose faces are measured and written")
        return None
    return _once("mesh:" + task["mesh"], lambda: _deformd.Mesh.read(task["mesh"], _isolated_reader(), _deformd.Limits()))


def _measure(task: Task, name: str) -> Evaluation:
    how = task["evaluate"]["measures"][name]
    mesh = _mesh(task)
    try:
        return _once(f"measure:{task['mesh']}:{name}:{json.dumps(how, sort_keys=True)}", lambda: make_measure(name, how, mesh))
    except Error as error:
        raise type(error)(f"evaluate.measures.{name}.{how['kind']}: {error}") from None


def _quality(task: Task) -> Quality:
    walls = task["evaluate"].get("walls", [])
    mesh = _mesh(task)
    return _once(f"quality:{task['mesh']}:{json.dumps(walls)}", lambda: Quality(mesh, walls=walls))  # type: ignore[no-any-return]


def mesh_beside(path: pathlib.Path) -> Optional[str]:
    """The mesh file of a compiled deformation, under the name it had, beside it or in this folder, as `deform apply` looks for it; else None."""
    name = pathlib.Path(load(path).mesh).name  # whatever it says: it does not lead out of these folders
    return next((str(found) for found in (path.parent / name, pathlib.Path(name)) if name and found.exists()), None)


def check_quality(task: Task, by_server: bool) -> None:
    """Refuses measures of evaluate.quality that neither the mesh nor reports have: those of the server, or of compiled deformations. Raises
    InvalidArgument, with suggestions."""
    for name in task["evaluate"].get("quality", ()):
        if name in REPORT_MEASURES and (by_server or hasattr(CompiledReport, name)):
            continue
        try:
            _quality(task).check(name)
        except InvalidArgument as error:
            why = f"{name}: only the server reports it, and here designs are deformed without" if name in REPORT_MEASURES else str(error)
            raise InvalidArgument(f"evaluate.quality: {why}") from None


def check_format(task: Task) -> None:
    """Writes the mesh at rest once in the format of the key meshes, and removes it. Raises Error, which names the key, for one that it cannot be written in."""
    if not task["write"]:
        return
    mesh = _mesh(task)
    with tempfile.TemporaryDirectory(dir=task["folder"]) as folder:
        try:
            mesh.write(os.path.join(folder, f"rest{task['write']}"), np.asarray(mesh.points))
        except Error as error:
            raise type(error)(f"meshes: {task['write']}: {str(error).replace(folder + os.sep, '')}") from None


def _faces(task: Task) -> np.ndarray:
    mesh = _mesh(task)
    return _once(f"faces:{task['mesh']}", lambda: _triangles(np.asarray(mesh.face_sizes, dtype=np.int64), np.asarray(mesh.face_points, dtype=np.int64)))


def _triangles(sizes: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Faces as fans of triangles, (t, 3) of ids of points. sizes (f,): corners of each face; corners: their ids, one face after the other."""
    if len(sizes) == 0:
        raise InvalidArgument("mesh: it has no faces")
    starts = np.cumsum(sizes) - sizes
    counts = np.maximum(sizes - 2, 0)
    fan = np.repeat(starts, counts)
    within = np.arange(len(fan)) - np.repeat(np.cumsum(counts) - counts, counts)
    return np.stack([corners[fan], corners[fan + within + 1], corners[fan + within + 2]], axis=1)


def _face_check(task: Task) -> Any:
    """For compiled deformations; None where the study has no mesh, or that no faces."""
    mesh = _mesh(task, needed=False)
    if mesh is None or len(mesh.face_sizes) == 0:
        return None
    return _once(f"check:{task['mesh']}", lambda: FaceCheck(mesh))


def _cell_check(task: Task) -> Any:
    """For compiled deformations; None where the study has no mesh, or that no cells."""
    mesh = _mesh(task, needed=False)

    def made() -> Any:
        try:
            return CellCheck(mesh)
        except InvalidArgument:  # a surface that is in no plane
            return None

    return None if mesh is None else _once(f"cells:{task['mesh']}", made)


def _inverted(task: Task, points: np.ndarray, record: Dict[str, Any]) -> List[str]:
    """The reason why a design of a compiled deformation is bad for its cells, if it is."""
    check = _cell_check(task)
    if check is None:
        return []
    with _timed(record, "deforming"):
        try:
            count = check.inverted(points)
        except InvalidArgument as error:  # a mesh in a plane, which the design leaves
            return [str(error)]
    return [f"{count} of {check.cells} cells are inverted"] if count else []


def _once(key: str, make: Any) -> Any:
    with _lock:
        if key not in _loaded:
            _loaded[key] = make()
        return _loaded[key]


def quality_of(task: Task) -> Quality:
    """Measures designs of the study. Raises Error where there is no mesh, or nothing to measure."""
    return _quality(task)


def rest_and_faces(task: Task) -> Tuple[np.ndarray, np.ndarray]:
    """Points at rest (n, 3) and triangles of the mesh, for pictures. Raises Error where there is no mesh."""
    return np.asarray(_mesh(task).points), _faces(task)


def points_of(task: Task) -> np.ndarray:
    """The points (n, 3) of a design, deformed once more."""
    return _system(task).deform(np.array(task["x"])).points


__all__ = ["Error", "Task", "check_format", "check_quality", "evaluate", "failed_record", "kept_result", "points_of", "quality_of", "rest_and_faces"]

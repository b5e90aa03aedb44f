# SPDX-License-Identifier: Apache-2.0
"""What a study leaves: tables, a manifest of its meshes, and the report."""

import csv
import hashlib
import io
import json
from typing import Any, Dict, List, Optional, Sequence

import numpy as np

from .journal import write_whole
from .report import page
from .spec import Spec
from .worker import Task

Record = Dict[str, Any]
_FRONT = "on_front"


def write(spec: Spec, names: Sequence[str], bounds: np.ndarray, task: Task, records: List[Record], ends: Sequence[str]) -> None:
    """history.csv, history.json, report.html, history.parquet where pyarrow is there, and manifest.json where meshes are written. The histories
    have nothing that depends on the time; of several objectives they say which designs are on the Pareto front. ends: lines of the report that say how a search ended."""
    rows = [_row(names, record) for record in records]
    columns = ["number", *names, *sorted({name for record in records for name in record["values"]})]
    if len(spec.objectives) > 1:
        columns.append(_FRONT)
        front = {record["number"] for record in front_of(spec, records)}
        rows = [{**row, _FRONT: int(row["number"] in front)} for row in rows]
    columns += ["verdict", "reasons"]
    text = io.StringIO()
    writer = csv.DictWriter(text, columns, lineterminator="\n")
    writer.writeheader()
    writer.writerows([{**row, "reasons": "; ".join(row["reasons"])} for row in rows])
    write_whole(spec.folder / "history.csv", text.getvalue().encode())
    write_whole(spec.folder / "history.json", json.dumps(rows, indent=1).encode())
    _write_parquet(spec, columns, rows)
    if spec.meshes is not None:
        write_whole(spec.folder / "manifest.json", json.dumps(_manifest(spec, names, bounds, task, records), indent=1).encode())
    write_whole(spec.folder / "report.html", page(spec, names, bounds, task, records, best_of(spec, records), front_of(spec, records) if len(spec.objectives) > 1 else [], ends).encode())


def _write_parquet(spec: Spec, columns: List[str], rows: List[Record]) -> None:
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError:  # absent, or not for the NumPy that is there
        return
    pyarrow.parquet.write_table(pyarrow.table({name: [row.get(name) for row in rows] for name in columns}), spec.folder / "history.parquet")


def best_of(spec: Spec, records: List[Record]) -> Optional[Record]:
    """The usable design within the constraints of the least first objective; None without objective or such a design."""
    if not spec.objectives:
        return None
    name, sign = spec.objectives[0]
    return min(_usable(spec, records, [name]), key=lambda each: sign * each["values"][name], default=None)


def front_of(spec: Spec, records: List[Record]) -> List[Record]:
    """The Pareto front: the usable designs within the constraints than which no other is at least as good in all objectives and better in one, in the order
    of the first objective."""
    usable = _usable(spec, records, [name for name, _ in spec.objectives])
    goals = np.array([[sign * each["values"][name] for name, sign in spec.objectives] for each in usable]).reshape(len(usable), len(spec.objectives))
    order = np.lexsort(goals.T[::-1])
    front: List[int] = []
    for i in order:  # what dominates a design stands before it
        rivals = goals[front]
        if not ((rivals <= goals[i]).all(axis=1) & (rivals < goals[i]).any(axis=1)).any():
            front.append(int(i))
    return [usable[i] for i in front]


def _usable(spec: Spec, records: List[Record], names: Sequence[str]) -> List[Record]:
    """The designs that have the named values and are within the constraints."""
    from .driver import TOLERANCE, failed, violations

    wanted = {*names, *(each for each, _, _ in spec.constraints)}
    return [each for each in records if not failed(each) and wanted <= each["values"].keys() and all(v <= TOLERANCE for v in violations(spec, each))]


def _row(names: Sequence[str], record: Record) -> Record:
    return {"number": record["number"], **dict(zip(names, record["x"])), **record["values"], "verdict": record["verdict"], "reasons": record["reasons"]}


def _manifest(spec: Spec, names: Sequence[str], bounds: np.ndarray, task: Task, records: List[Record]) -> Record:
    meshes = [{"file": each["mesh"], "sha256": hashlib.sha256((spec.folder / each["mesh"]).read_bytes()).hexdigest(),
               "variables": dict(zip(names, each["x"])), "values": each["values"], "verdict": each["verdict"], "reasons": each["reasons"]}
              for each in records if each["mesh"]]
    rejected = [{"number": each["number"], "variables": dict(zip(names, each["x"])), "verdict": each["verdict"], "reasons": each["reasons"]}
                for each in records if not each["mesh"]]
    return {"system": task["system"], "setup": spec.setup.name, "seed": spec.seed, "doe": spec.doe[0] if spec.doe else None,
            "bounds": {name: list(map(float, pair)) for name, pair in zip(names, bounds)}, "meshes": meshes, "rejected": rejected}

# SPDX-License-Identifier: Apache-2.0
"""What a study knows, kept so that a process may be killed at any moment."""

import ast
import fcntl
import json
import os
import pathlib
from typing import Any, Dict, Iterable, List, Mapping

from ..errors import DataLoss, FailedPrecondition

_JUDGING = ("minimize", "maximize", "constraints")


class Journal:
    """The records of a study, by number of the design, in FOLDER/journal.jsonl: one line each, in the order in which they were done.

    A record is on the disk when `add` returns. A last line that was cut off is taken back. One process at a time: another raises
    FailedPrecondition. Not for several threads.

    A folder belongs to the study that has finished a design in it; another raises FailedPrecondition. Where none is finished, because none was
    evaluated or all failed, a changed study begins anew. Where the objective or a constraint names a value that its designs do not have, it may be
    corrected.
    """

    def __init__(self, folder: pathlib.Path, identity: Mapping[str, str]) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._lock = open(folder / "lock", "w")
        try:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise FailedPrecondition(f"folder: {folder}: another process runs this study") from None
        self.records: Dict[int, Dict[str, Any]] = {}
        path = folder / "journal.jsonl"
        whole = self._read(path) if path.exists() else 0
        changed = _changed(folder, dict(identity))
        finished = [*_finished(self.records.values()), *_finished(_kept(folder))]
        corrected = all(key in _JUDGING for key in changed) and not any(_optimized(folder, each) for each in finished)
        if changed and finished and not corrected:
            raise FailedPrecondition(f"{', '.join(changed)}: changed since {folder} was begun, whose designs would not be those of this study; name "
                                     "another folder, or delete that one")
        self._file = open(path, "ab")
        if changed and not (finished and corrected):  # what is there goes first, so that a crash leaves no record to the wrong study
            self.records, whole = {}, 0
            for kept in (folder / "results").glob("*.json"):
                kept.unlink()
        self._file.truncate(whole)
        os.fsync(self._file.fileno())
        _sync_folder(folder)
        if changed or not (folder / "identity.json").exists():
            write_whole(folder / "identity.json", json.dumps(dict(identity), indent=1).encode())

    def _read(self, path: pathlib.Path) -> int:
        """Bytes of whole lines."""
        content = path.read_bytes()
        whole = content.rfind(b"\n") + 1
        for number, line in enumerate(content[:whole].splitlines(), 1):
            try:
                record = json.loads(line)
                self.records[record["number"]] = record
            except (ValueError, KeyError, TypeError):
                raise DataLoss(f"{path}: line {number} is damaged") from None
        return whole

    def add(self, record: Dict[str, Any]) -> None:
        self._file.write(json.dumps(record, allow_nan=False).encode() + b"\n")
        self._file.flush()
        os.fsync(self._file.fileno())
        self.records[record["number"]] = record

    def in_order(self) -> List[Dict[str, Any]]:
        """All records by number."""
        return [self.records[number] for number in sorted(self.records)]

    def close(self) -> None:
        self._file.close()
        self._lock.close()


def write_whole(path: pathlib.Path, content: bytes) -> None:
    """Replaces a file; whoever reads it, even after a crash, finds the old content or the new one."""
    beside = path.with_name(f".{path.name}.{os.getpid()}")
    with open(beside, "wb") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())
    os.replace(beside, path)
    _sync_folder(path.parent)


def _sync_folder(folder: pathlib.Path) -> None:
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _changed(folder: pathlib.Path, identity: Dict[str, str]) -> List[str]:
    """Keys of the study that are not as when the folder was claimed; none of a folder that was not claimed."""
    path = folder / "identity.json"
    if not path.exists():
        return []
    before = json.loads(path.read_text())
    return sorted(key for key in {*before, *identity} if before.get(key) != identity.get(key))


def _kept(folder: pathlib.Path) -> List[Dict[str, Any]]:
    """Records that workers have kept and the journal does not have."""
    return [json.loads(path.read_text()) for path in (folder / "results").glob("*.json")]


def _finished(records: Iterable[Mapping[str, Any]]) -> List[Mapping[str, Any]]:
    return [record for record in records if record["verdict"] != "failed"]


def _optimized(folder: pathlib.Path, record: Mapping[str, Any]) -> bool:
    """Has a design the values that the study was for when the folder was claimed? Where it has not, as after a slip in a name, they are of no use."""
    before = json.loads((folder / "identity.json").read_text())
    named = {str(name) for key in _JUDGING for value in [ast.literal_eval(before.get(key, "None"))] if value
             for name in ([value] if isinstance(value, str) else value)}
    return bool(named <= record["values"].keys())

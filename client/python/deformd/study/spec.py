# SPDX-License-Identifier: Apache-2.0
"""The file of a study, read and checked."""

import hashlib
import os
import pathlib
import re
from typing import Any, Dict, Iterable, List, Mapping, NamedTuple, Optional, Tuple, Union

from .. import _deformd
from ..errors import InvalidArgument, NotFound
from ..quality import NAMES, check_name, checked_limits
from .libraries import needing_libraries
from .measures import MEASURES, checked_measure, files_of, names_of, quotes_advice

DOES = ("sobol", "latin_hypercube", "halton", "factorial", "table")
OPTIMIZERS = ("cma", "nsga2", "scipy", "nlopt")
PLACES = ("threads", "processes", "submitit", "dask", "ray", "executor")
_KEYS = ("setup", "mesh", "server", "folder", "seed", "evaluate", "minimize", "maximize", "constraints", "doe", "optimizer", "budget", "place",
         "deformation", "meshes", "failing")
_MAY_CHANGE = ("budget", "place", "server", "failing", "folder")
TOLERANCE = 1e-6
"""The tolerance of constraints, in parts of their limits: optimizers with gradients end on them."""


class Spec(NamedTuple):
    """A study as its file has it; paths are absolute."""

    setup: pathlib.Path
    """A setup file, or a compiled deformation (.deformation)."""
    mesh: Optional[pathlib.Path]
    server: Optional[str]
    folder: pathlib.Path
    """The folder of the state and the results."""
    base: pathlib.Path
    """The folder of the file."""
    seed: int
    evaluate: Dict[str, Any]
    """"measures": name -> {"kind", "options"}; "function": "module:function"; "command", "template", "timeout"; "quality": names, "walls": groups.
    Empty: nothing."""
    objectives: Tuple[Tuple[str, int], ...]
    """(name, 1 to be minimized or -1 to be maximized)"""
    constraints: Tuple[Tuple[str, str, float], ...]
    """(name, "min" or "max", limit)"""
    doe: Optional[Tuple[str, Any]]
    optimizer: Optional[Tuple[str, Dict[str, Any]]]
    budget: Optional[int]
    place: Tuple[str, Any]
    deformation: str
    """What workers deform with, "server" or "compiled"."""
    meshes: Optional[str]
    """The extension of the meshes to be written, with its dot."""
    failing: float
    """The part of designs that may fail before the study stops."""
    identity: Dict[str, str]
    """What must not change between runs: key -> a hash or text."""


@needing_libraries()
def read_spec(path: Union[str, "os.PathLike[str]"]) -> Spec:
    """Reads a study. Raises InvalidArgument, which names the key, for what is wrong; ImportError without PyYAML."""
    import yaml

    file = pathlib.Path(path).resolve()
    if not file.is_file():
        raise NotFound(f"{path}: there is no such file")
    try:
        raw = yaml.load(file.read_text(), _loader())
    except yaml.YAMLError as error:
        raise InvalidArgument(f"{path}: {error}") from None
    if not isinstance(raw, dict):
        raise InvalidArgument(f"{path}: expected a mapping with the key setup")
    for key in raw:
        _one_of("key", key, _KEYS)
    if "setup" not in raw:
        raise InvalidArgument("setup: missing; it names a setup file or a compiled deformation")
    base = file.parent
    setup = _file(base, "setup", raw["setup"])
    mesh = _file(base, "mesh", raw["mesh"]) if "mesh" in raw else None
    doe = _single("doe", raw["doe"], DOES) if "doe" in raw else None
    optimizer = _optimizer(raw["optimizer"]) if "optimizer" in raw else None
    if (doe is None) == (optimizer is None):
        raise InvalidArgument("doe, optimizer: a study has exactly one of them")
    if doe is not None:
        doe = _checked_doe(base, doe)
    evaluate = _evaluate(base, raw.get("evaluate") or {})
    objectives = tuple((name, sign) for key, sign in (("minimize", 1), ("maximize", -1)) for name in _names(key, raw.get(key, [])))
    constraints = checked_limits("constraints", raw.get("constraints") or {})
    if optimizer is not None and not objectives:
        raise InvalidArgument("minimize, maximize: an optimizer needs an objective, the name of a measured value")
    if optimizer is not None and optimizer[0] != "nsga2" and len(objectives) != 1:
        raise InvalidArgument(f"minimize, maximize: {len(objectives)} objectives, {optimizer[0]} takes one; nsga2 takes several")
    if (objectives or constraints) and not evaluate:
        raise InvalidArgument("evaluate: missing; objectives and constraints are values that it measures")
    measured = evaluate.get("measures", {})
    if evaluate and "function" not in evaluate and "command" not in evaluate:  # whose values are unknown before
        known = [*measured, *evaluate.get("quality", ())]
        for name in [name for name, _ in objectives] + [name for name, _, _ in constraints]:
            if name not in known:
                raise InvalidArgument(f'"{name}": no such measure, only {", ".join(known)}{name_advice(name, known)}')
    budget = raw.get("budget")
    if budget is not None:
        budget = _whole("budget", budget, 1)
    elif optimizer is not None:
        raise InvalidArgument("budget: missing; it is the number of designs that an optimizer may have evaluated")
    extension = raw.get("meshes")
    if extension is not None and (not isinstance(extension, str) or not extension.startswith(".")):
        raise InvalidArgument(f"meshes: {extension!r}, expected the extension of the files to write, such as .obj")
    failing = raw.get("failing", 0.5)
    if isinstance(failing, bool) or not isinstance(failing, (int, float)) or not 0 < failing <= 1:
        raise InvalidArgument(f"failing: {failing!r}, expected a number above 0 and up to 1")
    identity = {key: repr(raw.get(key)) for key in _KEYS if key not in _MAY_CHANGE}
    files = [("setup", setup), ("mesh", mesh), ("table", doe[1] if doe is not None and doe[0] == "table" else None), *files_of(measured).items()]
    for key, named in files:
        if named is not None:
            identity[key] = hashlib.sha256(pathlib.Path(named).read_bytes()).hexdigest()
    return Spec(setup, mesh, raw.get("server"), base / raw.get("folder", file.stem), base, _whole("seed", raw.get("seed", 1), 0), evaluate, objectives,
                constraints, doe, optimizer, budget, _place(raw.get("place", {"threads": 1})),
                _one_of("deformation", raw.get("deformation", "server"), ("server", "compiled")), extension, float(failing), identity)


def _loader() -> Any:
    """That of PyYAML, which takes 1e-9 for text, with the numbers of YAML 1.2."""
    import yaml

    class Loader(yaml.SafeLoader):
        pass

    Loader.add_implicit_resolver("tag:yaml.org,2002:float", re.compile(r"^[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)[eE][-+]?[0-9]+$"), list("-+.0123456789"))
    return Loader


def _one_of(what: str, value: Any, choices: Tuple[str, ...]) -> str:
    if value not in choices:
        near = _deformd.nearest_names(str(value), list(choices))
        raise InvalidArgument(f"{what}: {value!r}, expected one of {', '.join(choices)}{f'; did you mean {near}?' if near else ''}")
    return str(value)


def name_advice(name: str, known: Iterable[str]) -> str:
    """For messages about a value that there is not: what to do where `deform quality` measures it, else names that are near."""
    if name in NAMES:
        return f"; it is one of the measures of quality: evaluate.quality: [{name}] has it measured"
    near = _deformd.nearest_names(name, list(known)) or _deformd.nearest_names(name, list(NAMES))
    return f"; did you mean {near}?" if near else ""


def _whole(what: str, value: Any, least: int) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or value < least:
        raise InvalidArgument(f"{what}: {value!r}, expected a whole number of at least {least}")
    return value


def _file(base: pathlib.Path, what: str, value: Any) -> pathlib.Path:
    path = base / str(value)
    if not path.is_file():
        raise NotFound(f"{what}: {path}: there is no such file")
    return path


def _single(what: str, value: Any, choices: Tuple[str, ...]) -> Tuple[str, Any]:
    if isinstance(value, str):
        value = {value: None}
    if not isinstance(value, dict) or len(value) != 1:
        raise InvalidArgument(f"{what}: expected one of {', '.join(choices)}, with its options")
    name, options = next(iter(value.items()))
    return _one_of(what, name, choices), options


def _optimizer(value: Any) -> Tuple[str, Dict[str, Any]]:
    name, options = _single("optimizer", value, OPTIMIZERS)
    if options is not None and not isinstance(options, dict):
        raise InvalidArgument(f"optimizer.{name}: expected a mapping of options")
    return name, dict(options or {})


def _checked_doe(base: pathlib.Path, doe: Tuple[str, Any]) -> Tuple[str, Any]:
    name, options = doe
    if name == "table":
        return name, _file(base, "doe.table", options)
    if name == "factorial" and isinstance(options, list):
        return name, [_whole(f"doe.factorial[{i}]", count, 1) for i, count in enumerate(options)]
    return name, _whole(f"doe.{name}", options, 1)


def _place(value: Any) -> Tuple[str, Any]:
    name, options = _single("place", value, PLACES)
    if name in ("threads", "processes"):
        options = _whole(f"place.{name}", options, 1)
    return name, options


def _seconds(key: str, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not 0 < value < float("inf"):
        raise InvalidArgument(f"{key}: {value!r}, expected seconds, a positive number")
    return float(value)


def _names(key: str, value: Any) -> List[str]:
    names = [value] if isinstance(value, str) else value
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        kind = "a group of faces" if key == "evaluate.walls" else "a measured value"
        raise InvalidArgument(f"{key}: {value!r}, expected the name of {kind}, or a list of names{quotes_advice(names)}")
    return names


def _evaluate(base: pathlib.Path, value: Any) -> Dict[str, Any]:
    if not isinstance(value, dict):
        raise InvalidArgument("evaluate: expected measures, function or command, and quality")
    kinds = [key for key in ("measures", "function", "command") if key in value]
    for key in value:
        _one_of("evaluate", key, ("measures", "function", "command", "template", "timeout", "quality", "walls"))
    if not value:
        return {}
    if len(kinds) != 1 and (kinds or "quality" not in value):
        raise InvalidArgument("evaluate: exactly one of measures, function and command, or quality alone")
    checked = dict(value)
    if kinds == ["measures"]:
        checked["measures"] = _measures(base, value["measures"])
    elif kinds == ["function"]:
        if not isinstance(value["function"], str) or value["function"].count(":") != 1:
            raise InvalidArgument(f'evaluate.function: {value["function"]!r}, expected "module:function"')
    elif kinds and (not isinstance(value["command"], str) or not value["command"].strip()):
        raise InvalidArgument("evaluate.command: expected a command line")
    for key in ("template", "timeout"):
        if key in value and kinds != ["command"]:
            raise InvalidArgument(f"evaluate.{key}: only of a command")
    if "timeout" in value:
        checked["timeout"] = _seconds("evaluate.timeout", value["timeout"])
    if "walls" in value and "quality" not in value:
        raise InvalidArgument("evaluate.walls: only with quality, which measures the first layer of cells on them")
    for key in ("quality", "walls"):
        if key in value:
            checked[key] = _names(f"evaluate.{key}", value[key])
    for name in checked.get("quality", ()):
        check_name("evaluate.quality", name)
        if name in checked.get("measures", {}):
            raise InvalidArgument(f'evaluate.measures.{name}: gives "{name}", as evaluate.quality does; name it otherwise')
    if "template" in value:
        checked["template"] = str(base / str(value["template"]))
        if not os.path.isdir(checked["template"]):
            raise NotFound(f"evaluate.template: {checked['template']}: there is no such folder")
    return checked


def _measures(base: pathlib.Path, value: Any) -> Dict[str, Dict[str, Any]]:
    if not isinstance(value, dict) or not value:
        raise InvalidArgument("evaluate.measures: expected names with a measure each, such as frontal: {projected_area: x}")
    checked: Dict[str, Dict[str, Any]] = {}
    given: Dict[str, str] = {}
    for name, measure in value.items():
        what = f"evaluate.measures.{name}"
        if not isinstance(name, str):
            raise InvalidArgument(f"{what}: expected a name{quotes_advice(name)}")
        kind, options = _single(what, measure, MEASURES)
        checked[str(name)] = checked_measure(what, kind, options, base)
        for each in names_of(str(name), kind):
            if each in given:
                raise InvalidArgument(f'{what}: gives "{each}", as "{given[each]}" does; name one of them otherwise')
            given[each] = str(name)
    return checked

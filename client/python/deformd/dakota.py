# SPDX-License-Identifier: Apache-2.0
"""An analysis driver of Dakota: python -m deformd.dakota --setup ahmed.yaml --function module:function params.in results.out

Reads the parameters file, in Dakota's own or the aprepro format, with one parameter set or, with the keyword `batch`, several; writes the
results file. A design that must not be used, or whose evaluation fails, is FAIL, which Dakota's failure capturing takes.
"""

import argparse
import os
import pathlib
import re
import sys
import tempfile
from typing import Any, Dict, List, NamedTuple, Optional, Tuple

from . import _deformd
from .client import Client
from .compiled import load
from .errors import Error, InvalidArgument
from .quality import NAMES, check_name
from .study.journal import write_whole
from .study.measures import checked_measure
from .study.worker import check_quality, evaluate, mesh_beside

_APREPRO = re.compile(r"^\s*\{\s*(\S+)\s*=\s*\"?([^\"\s}]+)\"?\s*\}")
_COUNTS = {"DAKOTA_VARS": "variables", "DAKOTA_FNS": "functions", "DAKOTA_DER_VARS": "derivative_variables", "DAKOTA_AN_COMPS": "analysis_components",
           "DAKOTA_EVAL_ID": "eval_id"}


class Parameters(NamedTuple):
    """One parameter set."""

    variables: Dict[str, float]
    functions: Dict[str, int]
    """Descriptor of a response -> its active set: 1 value, 2 gradient, 4 Hessian, or a sum of them."""
    derivatives: List[str]
    """The variables of gradients, in order."""


def read_parameters(text: str) -> List[Parameters]:
    """The parameter sets of a file. Raises InvalidArgument with the line that is wrong."""
    lines = []
    for number, line in enumerate(text.splitlines(), 1):
        if line.strip() and not line.lstrip().startswith("#"):
            found = _APREPRO.match(line)
            words = [found[2], _COUNTS.get(found[1], found[1])] if found else line.split()[:2]
            if len(words) != 2:
                raise InvalidArgument(f"parameters: line {number}: expected a value and its name")
            lines.append((number, words[0], words[1]))
    sets: List[Parameters] = []
    at = 0

    def section(wanted: str) -> List[Any]:
        nonlocal at
        if at >= len(lines) or lines[at][2] != wanted or not lines[at][1].isdigit():
            where = f"line {lines[at][0]}" if at < len(lines) else "the end"
            raise InvalidArgument(f"parameters: {where}: expected the number of {wanted}")
        begin, at = at + 1, at + 1 + int(lines[at][1])
        if at > len(lines):
            raise InvalidArgument(f"parameters: the end: fewer {wanted} than said")
        return lines[begin:at]

    while at < len(lines):
        variables, functions, derivatives = section("variables"), section("functions"), section("derivative_variables")
        while at < len(lines) and lines[at][2] != "variables":  # components, the number of the evaluation, metadata
            at += 1
        try:
            sets.append(Parameters({name: float(value) for _, value, name in variables},
                                   {name.split(":", 1)[1]: int(value) for _, value, name in functions}, [name.split(":", 1)[1] for _, _, name in derivatives]))
        except (ValueError, IndexError):
            raise InvalidArgument(f"parameters: set {len(sets)}: expected numbers, and names such as ASV_1:response") from None
    if not sets:
        raise InvalidArgument("parameters: no parameter set")
    return sets


def results_of(parameters: Parameters, names: List[str], task: Dict[str, Any]) -> str:
    """The results of one set: values and gradients as its active set wants them, or FAIL. task: that of study.worker, without x."""
    strange = [name for name in parameters.variables if name not in names]
    if strange:
        raise InvalidArgument(f"variables: the setup has no {', '.join(strange)}, only {', '.join(names)}")
    if any(active & 4 for active in parameters.functions.values()):
        raise InvalidArgument("responses: there are no Hessians; use no_hessians, quasi_hessians or numerical_hessians")
    x = [parameters.variables.get(name, 0.0) for name in names]
    wanted = [name for name, active in parameters.functions.items() if active & 2]
    counts = [name for name in wanted if name in task["evaluate"].get("quality", ()) and NAMES[name]]
    if counts:
        raise InvalidArgument(f"responses: {counts[0]} is a number of faces, cells or the like, which has no gradient; use no_gradients")
    record = evaluate({**task, "number": 0, "x": x, "gradients": wanted})
    if record["verdict"] in ("bad", "failed"):
        print("; ".join(record["reasons"]), file=sys.stderr)
        return "FAIL\n"
    missing = [name for name in parameters.functions if name not in record["values"]]
    if missing:
        raise InvalidArgument(f"responses: nothing measures {', '.join(missing)}, only {', '.join(record['values'])}")
    lines = [f"{record['values'][name]:.17g} {name}\n" for name, active in parameters.functions.items() if active & 1]
    for name in wanted:
        slopes = dict(zip(names, record["gradients"][name]))
        lines.append(f"[ {' '.join(f'{slopes[each]:.17g}' for each in parameters.derivatives)} ]\n")
    return "".join(lines)


def main(words: Optional[List[str]] = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m deformd.dakota", description="Analysis driver of Dakota on deformed meshes.")
    parser.add_argument("--setup", required=True, help="setup file, or a compiled deformation (.deformation)")
    parser.add_argument("--mesh", help="its mesh file; that of the setup unless given")
    parser.add_argument("--server", help="HOST:PORT; DEFORM_SERVER unless given")
    parser.add_argument("--function", help="module:function, as studies have it")
    parser.add_argument("--measure", action="append", default=[], metavar="RESPONSE=MEASURE", help="volume, area, projected_area:x, centre_of_gravity:x or thickness, or with options as in a study: '{thickness: {method: spheres}}'; more than once")
    parser.add_argument("--quality", action="append", default=[], metavar="NAME", help="a response with the name and value of a measure of `deform quality` or --fail-on, such as scaled_jacobian; more than once")
    parser.add_argument("--wall", action="append", default=[], metavar="GROUP", help="group of boundary faces for wall_height and the like; more than once")
    parser.add_argument("params")
    parser.add_argument("results")
    arguments = parser.parse_args(words)
    try:
        if bool(arguments.function) == bool(arguments.measure) and (arguments.function or not arguments.quality):
            raise InvalidArgument("--function, --measure: one of the two, or --quality alone")
        if arguments.function and arguments.function.count(":") != 1:
            raise InvalidArgument(f'--function: {arguments.function!r}, expected "module:function"')
        sets = read_parameters(pathlib.Path(arguments.params).read_text())
        sys.path.insert(0, os.getcwd())
        with tempfile.TemporaryDirectory() as folder:
            task, names = _task(arguments, folder)
            written = []
            for i, each in enumerate(sets):
                kept = os.path.join(folder, str(i))
                os.mkdir(kept)
                written.append(results_of(each, list(names), {**task, "folder": kept}))
        write_whole(pathlib.Path(arguments.results), "#\n".join(written).encode())
    except (Error, ImportError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    return 0


def _measure_of(text: str, measure: str) -> Tuple[str, Any]:
    """volume, projected_area:x, or as in the file of a study: {thickness: {at: wall}}."""
    if not measure.startswith("{"):
        kind, _, direction = measure.partition(":")
        return kind, direction or None
    import yaml

    try:
        ((kind, options),) = yaml.safe_load(measure).items()
    except (yaml.YAMLError, AttributeError, ValueError):
        raise InvalidArgument(f"--measure: {text!r}, expected RESPONSE={{MEASURE: {{OPTION: VALUE}}}}") from None
    return str(kind), options


def _task(arguments: Any, folder: str) -> Any:
    how: Dict[str, Any] = {"function": arguments.function} if arguments.function else {"measures": {}} if arguments.measure else {}
    if arguments.quality:
        how["quality"] = [check_name("--quality", name) for name in arguments.quality]
        how["walls"] = arguments.wall
    for text in arguments.measure:
        name, _, measure = text.partition("=")
        kind, options = _measure_of(text, measure)
        how["measures"][name] = checked_measure(f"--measure: {name}", kind, options, pathlib.Path.cwd())
    task = {"evaluate": how, "folder": folder, "write": None, "server": None, "system": None, "compiled": None, "mesh": arguments.mesh}
    if not arguments.setup.endswith(".deformation"):
        task["mesh"] = arguments.mesh or str(_deformd.Setup.read(arguments.setup, False).geometry_file or "") or None
    else:
        task["mesh"] = arguments.mesh or mesh_beside(pathlib.Path(arguments.setup))
    check_quality(task, by_server=not arguments.setup.endswith(".deformation"))
    if arguments.setup.endswith(".deformation"):
        names = load(arguments.setup).names
        return {**task, "compiled": arguments.setup, "names": names}, names
    with Client(arguments.server) as client:
        system = client.prepare(arguments.setup, arguments.mesh)
    return {**task, "server": client.address, "system": system.id, "names": system.names}, system.names


if __name__ == "__main__":
    sys.exit(main())

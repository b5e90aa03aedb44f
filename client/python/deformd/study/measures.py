# SPDX-License-Identifier: Apache-2.0
"""The measures of a study: their options as the file has them, and what `deformd.measures` makes of them."""

import pathlib
from typing import Any, Callable, Dict, List, Mapping, Optional, Tuple

import numpy as np

from .. import measures
from ..errors import InvalidArgument, NotFound

_FACES = ("groups", "of")
_BODY = (*_FACES, "rims")
_OPTIONS = {"volume": _BODY, "area": _FACES, "projected_area": ("direction", *_FACES), "centre_of_gravity": ("direction", *_BODY),
            "thickness": (*_BODY, "at", "method", "tolerance", "opposing_degrees"), "clearance": ("box", "mesh", *_FACES, "tolerance")}
MEASURES = tuple(_OPTIONS)
_CHOICES = {"of": ("faces", "cells"), "rims": ("refuse", "close"), "method": ("rays", "spheres")}

Values = Dict[str, float]
Evaluation = Callable[[np.ndarray, bool], Tuple[Values, Optional[np.ndarray]]]
"""(points (n, 3), whether a gradient is wanted) -> values by name, the measure's own among them, and its gradient (n, 3) or None."""


def checked_measure(what: str, kind: str, given: Any, base: pathlib.Path) -> Dict[str, Any]:
    """{"kind", "options"} of plain values. given: a mapping of options, None, or the direction alone. base: the folder where files are looked
    for. Raises InvalidArgument or NotFound, which name the option."""
    if kind not in _OPTIONS:
        raise InvalidArgument(f"{what}: {kind!r}, expected one of {', '.join(MEASURES)}")
    known = _OPTIONS[kind]
    if given is not None and not isinstance(given, Mapping):
        if "direction" not in known:
            raise InvalidArgument(f"{what}.{kind}: {given!r}, expected a mapping of options: {', '.join(known)}")
        given = {"direction": given}
    options = dict(given or {})
    for name, value in options.items():
        place = f"{what}.{kind}.{name}"
        if name not in known:
            raise InvalidArgument(f"{place}: no such option, only {', '.join(known)}")
        options[name] = _checked(place, name, value, base)
    if "direction" in known and "direction" not in options:
        raise InvalidArgument(f"{what}.{kind}: a direction is missing, x, y, z or three numbers")
    if kind == "clearance" and ("box" in options) == ("mesh" in options):
        raise InvalidArgument(f"{what}.{kind}: exactly one of box, such as {{min: [0, 0, 0], max: [1, 1, 1]}}, and mesh, a file")
    return {"kind": kind, "options": options}


def _checked(place: str, name: str, value: Any, base: pathlib.Path) -> Any:
    if name in _CHOICES:
        if value not in _CHOICES[name]:
            raise InvalidArgument(f"{place}: {value!r}, expected one of {', '.join(_CHOICES[name])}")
    elif name in ("groups", "at"):
        names = [value] if isinstance(value, str) else value
        if not isinstance(names, list) or not names or not all(isinstance(each, str) for each in names):
            raise InvalidArgument(f"{place}: {value!r}, expected the name of a group of faces, or a list of names{quotes_advice(names)}")
        return names
    elif name == "direction":
        return measures.axis_vector(place, value)
    elif name == "box":
        if not isinstance(value, Mapping) or set(value) != {"min", "max"}:
            raise InvalidArgument(f"{place}: {value!r}, expected {{min: [x, y, z], max: [x, y, z]}}")
        return {side: measures.axis_vector(f"{place}.{side}", list(value[side]) if isinstance(value[side], list) else None) for side in ("min", "max")}
    elif name == "mesh":
        path = base / str(value)
        if not path.is_file():
            raise NotFound(f"{place}: {path}: there is no such file")
        return str(path)
    elif isinstance(value, bool) or not isinstance(value, (int, float)):
        raise InvalidArgument(f"{place}: {value!r}, expected a number")
    return value


def quotes_advice(names: Any) -> str:
    """For messages: what to do where YAML has taken names for something else, `no` for a boolean or `12` for a number."""
    wrong = [each for each in (names if isinstance(names, list) else [names]) if isinstance(each, (bool, int, float))]
    if not wrong:
        return ""
    read = "YAML reads on, off, yes and no as booleans" if isinstance(wrong[0], bool) else "YAML reads it as a number"
    return f"; {read}: put a name like that in quotes"


def files_of(checked: Mapping[str, Dict[str, Any]]) -> Dict[str, str]:
    """The files that measures read, by a key for each."""
    return {f"evaluate.measures.{name}.mesh": each["options"]["mesh"] for name, each in checked.items() if "mesh" in each["options"]}


def names_of(name: str, kind: str) -> List[str]:
    """The values that a measure gives: its own, and for those that aggregate the true minimum behind it."""
    return [name, f"{name}_least"] if kind in ("thickness", "clearance") else [name]


def make_measure(name: str, how: Mapping[str, Any], mesh: Any) -> Evaluation:
    """Prepares a measure for a mesh. how: of checked_measure()."""
    kind, options = how["kind"], dict(how["options"])
    if kind in ("thickness", "clearance"):
        made = measures.Thickness(mesh, **options) if kind == "thickness" else _clearance(mesh, options)

        def aggregated(points: np.ndarray, wanted: bool) -> Tuple[Values, Optional[np.ndarray]]:
            if wanted:
                found, least = made.with_least(points)
                return {name: found.value, f"{name}_least": least.value}, found.gradient
            value, least = made.value_and_least(points)
            return {name: value, f"{name}_least": least.value}, None

        return aggregated
    if kind == "centre_of_gravity":
        direction = np.array(options.pop("direction"))
        direction = direction / np.linalg.norm(direction)
        centre = measures.CentreOfGravity(mesh, **options)

        def along(points: np.ndarray, wanted: bool) -> Tuple[Values, Optional[np.ndarray]]:
            if not wanted:
                return {name: float(direction @ centre.value(points))}, None
            value, gradient = centre(points)
            return {name: float(direction @ value)}, np.tensordot(direction, gradient, 1)

        return along
    simple = {"volume": measures.Volume, "area": measures.Area, "projected_area": measures.ProjectedArea}[kind](mesh, **options)

    def plain(points: np.ndarray, wanted: bool) -> Tuple[Values, Optional[np.ndarray]]:
        if not wanted:
            return {name: simple.value(points)}, None
        value, gradient = simple(points)
        return {name: value}, gradient

    return plain


def _clearance(mesh: Any, options: Dict[str, Any]) -> measures.Clearance:
    box, path = options.pop("box", None), options.pop("mesh", None)
    return measures.Clearance(mesh, path if box is None else (box["min"], box["max"]), **options)

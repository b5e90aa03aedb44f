# SPDX-License-Identifier: Apache-2.0
"""Designs of experiments, from scipy.stats.qmc and tables."""

import csv
import itertools
import warnings
from typing import Any, Sequence, Tuple

import numpy as np

from ..errors import InvalidArgument


def sample(doe: Tuple[str, Any], names: Sequence[str], bounds: np.ndarray, seed: int) -> np.ndarray:
    """Designs (m, k) of `doe`, of the kinds of spec.DOES, within bounds (k, 2). The same seed gives the same designs."""
    kind, options = doe
    if kind == "table":
        return _table(options, names)
    if not np.isfinite(bounds).all():
        raise InvalidArgument(f"doe.{kind}: needs finite bounds of all variables")
    low, high = bounds.T
    if kind == "factorial":
        counts = options if isinstance(options, list) else [options] * len(names)
        if len(counts) != len(names):
            raise InvalidArgument(f"doe.factorial: {len(counts)} counts, the setup has {len(names)} variables: {', '.join(names)}")
        levels = [np.linspace(a, b, n) if n > 1 else np.array([(a + b) / 2]) for n, a, b in zip(counts, low, high)]
        return np.array(list(itertools.product(*levels)))
    from scipy.stats import qmc

    makers = {"sobol": qmc.Sobol, "latin_hypercube": qmc.LatinHypercube, "halton": qmc.Halton}
    with warnings.catch_warnings():  # Sobol points whose number is no power of two are less even, which docs/studies.md says
        warnings.simplefilter("ignore", UserWarning)
        unit = makers[kind](d=len(names), seed=seed).random(options)
    return low + unit * (high - low)


def _table(path: Any, names: Sequence[str]) -> np.ndarray:
    with open(path, newline="", encoding="utf-8-sig") as file:
        lines = file.read().splitlines()
    semicolons = bool(lines) and ";" in lines[0] and "," not in lines[0]  # as spreadsheets write whose language has decimal commas
    rows = list(csv.reader(lines, delimiter=";" if semicolons else ","))
    head = [name.strip() for name in rows[0]] if rows else []
    columns = [name for name in head if name in names or name != "name"]  # the names of designs, of which a study has numbers
    if not columns or len(set(head)) != len(head) or not set(columns) <= set(names):
        raise InvalidArgument(f"doe.table: {path}: the columns are {', '.join(head) or 'missing'}, expected some of {', '.join(names)}")
    designs = []
    for number, row in enumerate(rows[1:], 2):
        if not any(cell.strip() for cell in row):
            continue
        where = f"doe.table: {path}: line {number}"
        if len(row) != len(head):
            raise InvalidArgument(f"{where}: {len(row)} columns, the header has {len(head)}")
        values = dict.fromkeys(names, 0.0)
        for name, cell in zip(head, row):
            if name not in columns:
                continue
            try:
                values[name] = float(cell)
            except ValueError:
                raise InvalidArgument(f"{where}: {name}: {cell.strip() or 'nothing'}, expected a number, decimals with a point") from None
            if not np.isfinite(values[name]):
                raise InvalidArgument(f"{where}: {name}: {cell.strip()}, expected a finite number")
        designs.append([values[name] for name in names])
    if not designs:
        raise InvalidArgument("doe.table: no designs")
    return np.array(designs)

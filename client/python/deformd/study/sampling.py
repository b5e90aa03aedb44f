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
    if sorted(head) != sorted(names):
        raise InvalidArgument(f"doe.table: the columns are {', '.join(head) or 'missing'}, expected {', '.join(names)}")
    designs = []
    for number, row in enumerate(rows[1:], 2):
        try:
            values = dict(zip(head, map(float, row)))
            designs.append([values[name] for name in names])
        except (ValueError, KeyError):
            raise InvalidArgument(f"doe.table: line {number}: expected {len(names)} numbers, decimals with a point") from None
    if not designs:
        raise InvalidArgument("doe.table: no designs")
    return np.array(designs)

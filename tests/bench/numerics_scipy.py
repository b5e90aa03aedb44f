# SPDX-License-Identifier: GPL-3.0-or-later
"""Interpolates with scipy.interpolate.RBFInterpolator (kernel cubic, degree 1) for a comparison.

usage: numerics_scipy.py FOLDER
Reads FOLDER/{centres,values,points}.f64 (rows of three doubles), writes FOLDER/result.f64 and prints one line of JSON with the
seconds of the solve and of the evaluation.
"""

import json
import pathlib
import sys
import time

import numpy
import scipy
from scipy.interpolate import RBFInterpolator


def main() -> None:
    folder = pathlib.Path(sys.argv[1])
    centres, values, points = (
        numpy.fromfile(folder / f"{name}.f64").reshape(-1, 3) for name in ("centres", "values", "points")
    )
    start = time.perf_counter()
    interpolator = RBFInterpolator(centres, values, kernel="cubic", degree=1)
    solved = time.perf_counter()
    result = interpolator(points)
    evaluated = time.perf_counter()
    result.astype(numpy.float64).tofile(folder / "result.f64")
    print(json.dumps({"scipy": scipy.__version__, "solve": solved - start, "evaluate": evaluated - solved}))


if __name__ == "__main__":
    main()

# SPDX-License-Identifier: Apache-2.0
"""Which numpy an extension module may be used with."""

import numpy as np

_FIRST_PYBIND11_FOR_NUMPY_2 = 0x020C0000


def check_numpy_version(pybind11: int, numpy: str = np.__version__) -> None:
    """Raises ImportError where arrays would be read wrongly: pybind11 before 2.12 (a hexadecimal version number) does not know the
    layout of the arrays of NumPy 2 and gives wrong values without an error."""
    if int(numpy.split(".", 1)[0]) >= 2 and pybind11 < _FIRST_PYBIND11_FOR_NUMPY_2:
        raise ImportError(f"deformd was built with a pybind11 that does not support NumPy {numpy}; "
                          "use numpy < 2, or install the package with pip, which builds it with a newer one")

# SPDX-License-Identifier: Apache-2.0
"""Libraries that only studies need, and what to install for them."""

import contextlib
from typing import Iterator

_EXTRAS = {"yaml": "study", "scipy": "study", "cma": "study", "pymoo": "study", "nlopt": "study", "submitit": "places", "distributed": "places",
           "ray": "places"}

_ADVICE = "which comes with the extra"


@contextlib.contextmanager
def needing_libraries() -> Iterator[None]:
    """Raises ModuleNotFoundError, which says what to install, where one of them is missing."""
    try:
        yield
    except ModuleNotFoundError as error:
        module = (error.name or "").partition(".")[0]
        if module not in _EXTRAS or _ADVICE in str(error):
            raise
        raise ModuleNotFoundError(f"{error.msg}, {_ADVICE} \"{_EXTRAS[module]}\": pip install './client/python[{_EXTRAS[module]}]' from "
                                  "a clone of deformd", name=error.name) from None

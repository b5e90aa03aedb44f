# SPDX-License-Identifier: Apache-2.0
"""Studies: designs of experiments and optimizations from one file. `python -m deformd.study study.yaml`; docs/studies.md is the page about it."""

from .driver import Study, StudyStopped, run_study
from .spec import Spec, read_spec

__all__ = ["Spec", "Study", "StudyStopped", "read_spec", "run_study"]

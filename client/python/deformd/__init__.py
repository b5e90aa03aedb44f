# SPDX-License-Identifier: Apache-2.0
"""deformd for Python: meshes deformed by a server, as numpy arrays.

    with deformd.Client("127.0.0.1:50051") as client:
        system = client.prepare("ahmed.yaml")       # once
        points = system({"roof_up": 0.03})          # as often as wanted: (n, 3)
        system.geometry.write("out.obj", points)

docs/python.md of the repository is the page about it.
"""

from . import _deformd
from .numpy_version import check_numpy_version

check_numpy_version(_deformd.pybind11_version)

from ._deformd import Cancel, Record
from .client import Client
from .compiled import CompiledDeformation, load
from .designs import Variable
from .errors import (AlreadyExists, BadDesign, BadDesignWarning, Cancelled, DataLoss, DeadlineExceeded, Error, FailedPrecondition,
                     Internal, InvalidArgument, NotFound, NumericalFailure, OutOfBudget, PermissionDenied, Unauthenticated, Unavailable)
from .faces import CellCheck, FaceCheck
from .geometry import Geometry
from .quality import Quality, QualityConstraints
from .reports import CompiledReport, Deformation, Evaluation, Population, Report
from .system import System

from . import aio, measures

__version__: str = _deformd.version

__all__ = ["AlreadyExists", "BadDesign", "BadDesignWarning", "Cancel", "Cancelled", "CellCheck", "Client", "CompiledDeformation", "CompiledReport",
           "DataLoss", "DeadlineExceeded", "Deformation", "Error", "Evaluation", "FaceCheck", "FailedPrecondition", "Geometry", "Internal", "InvalidArgument",
           "NotFound", "NumericalFailure", "OutOfBudget", "PermissionDenied", "Population", "Quality", "QualityConstraints", "Record", "Report", "System", "Unauthenticated",
           "Unavailable", "Variable", "aio", "load", "measures"]

# SPDX-License-Identifier: Apache-2.0
"""What calls raise. Every class is an Error; those with a counterpart among Python's own exceptions are that as well."""

import re
from typing import Any, Dict, Optional, Tuple, Type


class Error(Exception):
    """An error of the server or of the client library.

    Its text says which field is wrong, with its index, and the limit that it breaks.
    """

    code: str = "internal"
    """The kind of the error: "invalid_argument", "not_found", ..."""

    def __init__(self, message: str, field: str = "", retry_after: Optional[float] = None, request_id: str = "") -> None:
        super().__init__(message)
        self.message = message
        """For people."""
        self.field = field
        """The field of the request or setup that is wrong, such as "designs[3].variables[0]"; else empty."""
        self.retry_after = retry_after
        """Seconds after which the same call may succeed; None where only another call can."""
        self.request_id = request_id
        """The id of the call in the server's log (`client_request`); empty where nothing was sent."""

    @property
    def indices(self) -> Tuple[int, ...]:
        """The indices in `field`, the outermost first: (3, 0) of "designs[3].variables[0]"."""
        return tuple(int(index) for index in re.findall(r"\[(\d+)\]", self.field))

    @property
    def index(self) -> Optional[int]:
        """The innermost index in `field`, or None."""
        return self.indices[-1] if self.indices else None

    def __reduce__(self) -> Any:
        return type(self), (self.message, self.field, self.retry_after, self.request_id)


class InvalidArgument(Error, ValueError):
    """The input is wrong."""

    code = "invalid_argument"


class NotFound(Error, LookupError):
    """There is no such file, geometry, system or name."""

    code = "not_found"


class AlreadyExists(Error):
    """A name that is taken."""

    code = "already_exists"


class FailedPrecondition(Error):
    """The input is right, but not now: a geometry that setups still use."""

    code = "failed_precondition"


class Unauthenticated(Error, PermissionError):
    """The server requires an identity, and the call has none or an unknown one."""

    code = "unauthenticated"


class PermissionDenied(Error, PermissionError):
    """The server knows the caller, who may not do this."""

    code = "permission_denied"


class OutOfBudget(Error):
    """More memory, queue or time than the server allows; `retry_after` says whether waiting helps."""

    code = "out_of_budget"


class NumericalFailure(Error, ArithmeticError):
    """The mathematics broke down, as with a singular system."""

    code = "numerical_failure"


class Cancelled(Error):
    """The call was cancelled."""

    code = "cancelled"


class DeadlineExceeded(Error, TimeoutError):
    """The call took longer than its `timeout`."""

    code = "deadline_exceeded"


class DataLoss(Error):
    """Bytes that were stored or sent are not what they were."""

    code = "data_loss"


class Unavailable(Error, ConnectionError):
    """The server cannot be reached, also not by the attempts that the client made."""

    code = "unavailable"


class Internal(Error):
    """A bug in the server or in the client library."""

    code = "internal"


class BadDesign(Error):
    """Designs whose verdict is bad, or that could not be evaluated, of a call that was to raise for them.

    `deformation` has what the call would have answered: points and a report of every design.
    """

    code = "bad_design"

    def __init__(self, message: str, deformation: Any = None, field: str = "") -> None:
        super().__init__(message, field)
        self.deformation = deformation

    def __reduce__(self) -> Any:
        return type(self), (self.message, self.deformation, self.field)


class BadDesignWarning(UserWarning):
    """The warning in place of BadDesign with `bad="warn"`."""


_CLASSES: Dict[str, Type[Error]] = {
    kind.code: kind
    for kind in (InvalidArgument, NotFound, AlreadyExists, FailedPrecondition, Unauthenticated, PermissionDenied, OutOfBudget,
                 NumericalFailure, Cancelled, DeadlineExceeded, DataLoss, Unavailable, Internal)
}


def _error(code: str, message: str, field: str, retry_after_ms: int, request_id: str) -> Error:
    """For the extension module: the exception of an error of the C++ library."""
    return _CLASSES.get(code, Internal)(message, field, retry_after_ms / 1000 if retry_after_ms else None, request_id)

# SPDX-License-Identifier: Apache-2.0
"""The connection to a server."""

import base64
import json
import os
from typing import Any, Callable, Dict, List, Mapping, Optional, Union

import numpy as np

from . import _deformd, forks
from .errors import FailedPrecondition, InvalidArgument
from .geometry import Geometry
from .meshes import mesh_from
from .system import System

Path = Union[str, "os.PathLike[str]"]


class Client:
    """A connection to deformd. Any number of threads may use it.

    address: HOST:PORT, [IPv6]:PORT or unix:PATH; the environment variable DEFORM_SERVER, else 127.0.0.1:50051, unless given.
      Several with commas: each geometry and its systems are on one of these servers. When one is lost, its calls go to the next one, and
      what this client has registered and prepared is brought there.
    replicas: True where one address stands for several servers (a proxy before them), to which the same shall be brought; unless given
      DEFORM_REPLICAS.
    timeout: seconds for each call that has no timeout of its own; None: no limit.
    connect_timeout: seconds for one attempt to connect.
    max_attempts: of a call that is safe to repeat, while the server cannot be reached or asks to come back later; twice as many with `replicas`.
    patience: seconds, from the first failure of a call, for which attempts go on beyond max_attempts while no server can be reached, or it refuses
      and says when to come back. Unless given 30 once this client has had an answer, so that a restart of the server ends nothing, and 0 before, so
      that a wrong address is an error at once.
    threads: for decoding; 0: all cores.
    encoding: of points, "RAW_F64", "RAW_F32", "DRACO" or "DELTA_ZSTD"; unless given RAW_F64 for a server on this machine, else DELTA_ZSTD.

    tls: True encrypts and trusts the authorities that this machine trusts; also switched on by any of the next four.
    ca: file of authorities to trust, PEM. cert, key: files of the client's certificate and its private key, PEM.
    server_name: the name that the server's certificate must have, if not the host of the address.
    token_file: file with the token that says who calls; it is read for every call, and not kept here.
      Unless given, these six are the environment variables DEFORM_TLS, DEFORM_CA, DEFORM_CERT, DEFORM_KEY, DEFORM_SERVER_NAME and
      DEFORM_TOKEN_FILE, as on the command line.
    context: the name of a server and its credentials that `deform context add` has kept; unless given DEFORM_CONTEXT, or where no address is
      given the one in use. Arguments and variables go before what it says.

    Connects with the first call. Ctrl-C cancels a call, here and on the server. Clients, geometries and systems can be pickled, and connect
    anew where they arrive. Connections do not survive os.fork() (multiprocessing with the method "fork"), nor can a process connect that
    was forked while there was a client that was not closed: calls raise FailedPrecondition.
    """

    def __init__(
        self,
        address: Optional[str] = None,
        *,
        replicas: Optional[bool] = None,
        timeout: Optional[float] = None,
        connect_timeout: float = 5.0,
        max_attempts: int = 4,
        patience: Optional[float] = None,
        threads: int = 0,
        encoding: Optional[str] = None,
        tls: Optional[bool] = None,
        ca: Optional[Path] = None,
        cert: Optional[Path] = None,
        key: Optional[Path] = None,
        server_name: Optional[str] = None,
        token_file: Optional[Path] = None,
        context: Optional[str] = None,
    ) -> None:
        named = address or os.environ.get("DEFORM_SERVER")
        chosen = context or os.environ.get("DEFORM_CONTEXT")
        # With an address by hand, the context in use is nobody's: its token would go to another server.
        known = (_deformd.find_context(chosen or "") if chosen or not named else None) or {}
        self.address = named or known.get("server") or "127.0.0.1:50051"
        self.timeout = timeout
        files = {name: os.environ.get("DEFORM_" + name.upper()) or known.get(name, "") if value is None else os.fspath(value)
                 for name, value in (("ca", ca), ("cert", cert), ("key", key), ("server_name", server_name), ("token_file", token_file))}
        if tls is None:
            tls = _switched_on("DEFORM_TLS") or known.get("tls", False)
            encrypt = tls or any(files[name] for name in ("ca", "cert", "key", "server_name"))
        else:
            encrypt = tls
            if not tls and any(value is not None for value in (ca, cert, key, server_name)):
                raise InvalidArgument("tls: False, while ca, cert, key and server_name are options of TLS; remove one of the two")
        if not encrypt:
            files.update(ca="", cert="", key="", server_name="")
        several = _switched_on("DEFORM_REPLICAS") or known.get("replicas", False) if replicas is None else bool(replicas)
        self._settings = {"replicas": several, "timeout": timeout, "connect_timeout": connect_timeout, "max_attempts": max_attempts,
                          "patience": patience, "threads": threads, "encoding": encoding, "tls": encrypt, **{name: value or None for name, value in files.items()}}
        self._process = os.getpid()
        self._connection: Optional[_deformd.Client] = None if forks.unconnectable() else _deformd.Client(
            self.address, several, float(connect_timeout), int(max_attempts), None if patience is None else float(patience), int(threads), encoding or "", self._process,
            encrypt, files["ca"], files["cert"], files["key"], files["server_name"], files["token_file"])
        self._known_max_designs: Optional[int] = None
        forks.watch(self)

    def close(self) -> None:
        """Ends the connection; further calls raise FailedPrecondition."""
        self._connection = None

    def __enter__(self) -> "Client":
        return self

    def __exit__(self, *_: Any) -> None:
        self.close()

    @property
    def encoding(self) -> str:
        """The encoding of points, where a call names none."""
        return self._native.encoding

    # ---- geometries ----

    def register(
        self,
        mesh: Any,
        *,
        name: Optional[str] = None,
        groups: Optional[Mapping[str, Any]] = None,
        progress: Optional[Callable[[str, float], None]] = None,
        timeout: Optional[float] = None,
        cancel: "Optional[_deformd.Cancel]" = None,
    ) -> Geometry:
        """Uploads a mesh, unless the server has it already.

        mesh: one of
          - the path of a mesh file of any format of docs/formats.md;
          - (points, faces) or (points, faces, groups): points (n, 3), or (n, 2) in the plane; faces (f, corners), or a list of lists of
            corners, or a mapping of kinds of cells to arrays, {"triangle": (f, 3), "tetra": (c, 4)}, with the names of meshio;
          - a mesh of meshio, with its sets, or a surface or unstructured grid of PyVista.
        groups: further named groups, for arrays and objects: name -> ids of points, or {"points": ids, "faces": ids}.
        name: a label for people; the name of the file unless given.
        progress: called with ("upload", fraction) meanwhile, from another thread.

        Raises InvalidArgument for a mesh that is none, with what and where; NotFound where there is no such file.
        """
        limits = self._limits(timeout, cancel)
        if isinstance(mesh, (str, os.PathLike)):
            if groups:
                raise InvalidArgument("groups: a mesh file has its own")
            source = _deformd.Mesh.read(os.fspath(mesh), _isolated_reader(), limits)
            label = os.path.basename(os.path.normpath(os.fspath(mesh)))
        else:
            source, label = mesh_from(mesh, groups), ""
        info = self._native.register(source, label if name is None else name, progress, limits)
        return Geometry(self, info, source, label if name is None else name)

    def geometry(self, id: str, *, timeout: Optional[float] = None) -> Geometry:
        """A geometry by its id or a unique prefix of at least 8 digits. Raises NotFound."""
        return Geometry(self, self._native.geometry(id, self._limits(timeout, None)), None)

    def geometries(self, *, timeout: Optional[float] = None) -> List[Geometry]:
        """All geometries, the newest first."""
        return [Geometry(self, info, None) for info in self._native.geometries(self._limits(timeout, None))]

    # ---- systems ----

    def prepare(
        self,
        setup: Union[Path, Mapping[str, Any], "_deformd.Record"],
        geometry: Any = None,
        *,
        progress: Optional[Callable[[str, float], None]] = None,
        timeout: Optional[float] = None,
        cancel: "Optional[_deformd.Cancel]" = None,
    ) -> System:
        """Prepares a setup once, or takes the system that the server has; then designs are cheap.

        setup: the path of a setup file in YAML, as the command line reads it; or the same as a mapping, with lists, arrays and numbers;
          or a setup of the server (`system.info.setup`). Files that it names are looked for beside the file, of a mapping in the working folder.
        geometry: a Geometry, an id, or what `register` takes; what the setup itself names unless given.
        progress: called with the stage and the fraction of it that is done, from another thread.

        Raises InvalidArgument for a setup that is wrong, with the line of a file, the field, its index and the limit; OutOfBudget for
        one that does not fit into the memory of the server, with the numbers.
        """
        read, registered = self._setup(setup, geometry, timeout, cancel)
        info = self._native.prepare(read, progress, self._limits(timeout, cancel))
        return System(self, info, registered)

    def check(
        self,
        setup: Union[Path, Mapping[str, Any], "_deformd.Record"],
        geometry: Any = None,
        *,
        timeout: Optional[float] = None,
    ) -> "_deformd.Record":
        """What preparing would take, without doing it: EstimateReply of proto/deform/v1/deformation.proto.

        `problems` lists all that is wrong with the setup; when there are none, `peak_bytes`, `seconds` and `fits` say what it takes.
        """
        read, _ = self._setup(setup, geometry, timeout, None)
        return self._native.estimate(read, True, self._limits(timeout, None))

    def system(self, id: str, *, timeout: Optional[float] = None) -> System:
        """A system by its id or a unique prefix of at least 8 digits. Raises NotFound."""
        return System(self, self._native.system(id, self._limits(timeout, None)))

    def systems(self, *, timeout: Optional[float] = None) -> List[System]:
        """All systems whose setups are stored, in memory or not, the newest first."""
        return [System(self, info) for info in self._native.systems(self._limits(timeout, None))]

    def server_info(self, *, timeout: Optional[float] = None) -> "_deformd.Record":
        """Version, load, memory, store and limits: ServerInfo of proto/deform/v1/service.proto."""
        return self._native.server_info(self._limits(timeout, None))

    # ---- inside ----

    @property
    def _native(self) -> "_deformd.Client":
        if forks.unconnectable() or self._process != os.getpid():
            raise forks.error()
        if self._connection is None:
            raise FailedPrecondition("this client was closed")
        return self._connection

    def _limits(self, timeout: Optional[float], cancel: "Optional[_deformd.Cancel]") -> "_deformd.Limits":
        return _deformd.Limits(self.timeout if timeout is None else float(timeout), cancel)

    @property
    def _max_designs(self) -> int:
        if self._known_max_designs is None:
            self._known_max_designs = int(self.server_info().limits.max_designs)
        return self._known_max_designs

    def _setup(self, setup: Any, geometry: Any, timeout: Optional[float], cancel: Any) -> Any:
        given = geometry is not None
        if isinstance(setup, _deformd.Record):
            setup = _without_defaults(setup.to_dict())
        if isinstance(setup, Mapping):
            read = _deformd.Setup.parse(json.dumps(dict(setup), default=_plain), "setup", os.getcwd(), given)
        elif isinstance(setup, (str, os.PathLike)):
            read = _deformd.Setup.read(os.fspath(setup), given)
        else:
            raise InvalidArgument(f"setup: {type(setup).__name__}, expected the path of a setup file or a mapping")
        if not given:
            geometry = read.geometry_file
        if geometry is None:
            return read, None
        if isinstance(geometry, str) and not os.path.exists(geometry) and 8 <= len(geometry) <= 64 and not set(geometry) - set("0123456789abcdef"):
            read.geometry = geometry
            return read, None
        registered = geometry if isinstance(geometry, Geometry) else self.register(geometry, timeout=timeout, cancel=cancel)
        read.geometry = registered.id
        return read, registered

    def __repr__(self) -> str:
        return f"<Client of {self.address}>"

    def __reduce__(self) -> Any:
        return _connect, (self.address, self._settings)


def _connect(address: str, settings: Dict[str, Any]) -> Client:
    return Client(address, **settings)


def _switched_on(variable: str) -> bool:
    return os.environ.get(variable, "").lower() not in ("", "0", "false", "off", "no")


def _isolated_reader() -> str:
    return os.path.join(os.path.dirname(os.path.abspath(_deformd.__file__)), "read-isolated")


def _plain(value: Any) -> Any:
    """What JSON has no form for."""
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, (bytes, bytearray)):
        return base64.b64encode(value).decode()
    if isinstance(value, Mapping):
        return dict(value)
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    raise InvalidArgument(f"setup: a value of type {type(value).__name__}, expected numbers, text, lists and mappings")


def _without_defaults(value: Any) -> Any:
    """A record as a setup has it: nothing that is empty or absent."""
    if isinstance(value, dict):
        return {name: _without_defaults(item) for name, item in value.items() if item is not None and item != [] and item != ""}
    if isinstance(value, list):
        return [_without_defaults(item) for item in value]
    return value

#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""Checks that a folder includes only from floors below it.

usage: check_floors.py [ROOT]      prints FILE:LINE: what is wrong; exit code 1 when anything is
"""
import pathlib
import posixpath
import re
import sys

# Folder, or one header -> folders and headers of the project that it may include besides itself. The ground floor stands first.
DEFORMERS_GROUND = ["core/base", "core/compiled", "core/numerics", "core/mesh", "core/mesh/operators", "core/quality", "core/constraints"]
# What every room of the deformers speaks, whatever methods there are.
DEFORMERS_TERMS = ["core/deformers/setup.h", "core/deformers/system.h", "core/deformers/space_map.h", "core/deformers/method.h",
                   "core/deformers/option_checks.h", "core/deformers/mirrored_mesh.h"]
FLOORS = {
    "core/base": [],
    "core/base/commit": ["core/base"],
    "core/codec": ["core/base"],
    "core/compiled": ["core/base"],
    "core/mesh": ["core/base"],
    "core/mesh/surface_mesh": ["core/base", "core/mesh"],
    "core/mesh/remeshing": ["core/base", "core/mesh", "core/mesh/surface_mesh"],
    "core/mesh/cages": ["core/base", "core/mesh", "core/mesh/surface_mesh", "core/mesh/remeshing"],
    "core/io/mesh_file.h": ["core/base", "core/mesh"],
    "core/io/readers.h": ["core/base", "core/io/mesh_file.h"],
    "core/io/binary": ["core/base"],
    "core/io/text": ["core/base", "core/mesh"],
    "core/io/assembly": ["core/base", "core/mesh", "core/io/mesh_file.h", "core/io/text", "core/io/binary"],
    "core/io/formats": ["core/base", "core/mesh", "core/io/mesh_file.h", "core/io/readers.h", "core/io/text",
                        "core/io/binary", "core/io/assembly"],
    "core/io": ["core/base", "core/mesh", "core/io/mesh_file.h", "core/io/readers.h", "core/io/binary", "core/io/assembly", "core/io/formats"],
    "core/quality": ["core/base", "core/mesh"],
    "core/measures": ["core/base", "core/mesh"],
    "core/report": ["core/base", "core/mesh", "core/quality"],
    "core/numerics": ["core/base", "core/compiled"],
    "core/mesh/operators": ["core/base", "core/numerics", "core/mesh"],
    "core/cad": ["core/base", "core/numerics", "core/mesh"],
    "core/constraints": ["core/base", "core/numerics", "core/mesh"],
    "core/constraints/detection": ["core/base", "core/numerics", "core/mesh", "core/constraints"],
    "core/deformers/setup.h": DEFORMERS_GROUND + ["core/deformers/handles/symmetry.h"],
    "core/deformers/handles/symmetry.h": ["core/base", "core/mesh", "core/deformers/handles/sector.h"],
    "core/deformers/handles/sector.h": ["core/base", "core/mesh"],
    "core/deformers/mirrored_mesh.h": ["core/base", "core/mesh", "core/deformers/handles/symmetry.h"],
    "core/deformers/system.h": DEFORMERS_GROUND + ["core/deformers/setup.h"],
    "core/deformers/space_map.h": DEFORMERS_GROUND + ["core/deformers/setup.h", "core/deformers/system.h"],
    "core/deformers/method.h": DEFORMERS_GROUND + ["core/deformers/setup.h", "core/deformers/system.h", "core/deformers/method_features.h"],
    "core/deformers/method_features.h": [],
    "core/deformers/option_checks.h": [],
    "core/deformers/handles": DEFORMERS_GROUND + DEFORMERS_TERMS,
    "core/deformers/rbf": DEFORMERS_GROUND + DEFORMERS_TERMS + ["core/deformers/handles"],
    "core/deformers/constrained": DEFORMERS_GROUND + DEFORMERS_TERMS + ["core/deformers/handles"],
    "core/deformers/energy/spaces": DEFORMERS_GROUND + DEFORMERS_TERMS + ["core/deformers/handles"],
    "core/deformers/energy": DEFORMERS_GROUND + DEFORMERS_TERMS + ["core/deformers/handles", "core/deformers/constrained",
                                                                   "core/deformers/energy/spaces"],
    "core/deformers/ffd": DEFORMERS_GROUND + DEFORMERS_TERMS + ["core/deformers/handles", "core/deformers/energy",
                                                                "core/deformers/energy/spaces"],
    "core/deformers/cage": DEFORMERS_GROUND + DEFORMERS_TERMS + ["core/deformers/handles", "core/deformers/ffd", "core/mesh/remeshing", "core/mesh/cages"],
    "core/deformers/composed": DEFORMERS_GROUND + DEFORMERS_TERMS + ["core/deformers/handles"],
    "core/deformers": DEFORMERS_GROUND + DEFORMERS_TERMS + ["core/deformers/handles", "core/deformers/rbf", "core/deformers/constrained",
                                                            "core/deformers/energy", "core/deformers/ffd", "core/deformers/cage",
                                                            "core/deformers/composed"],
    # Messages to core types and back: each room needs as much of the core as the types it names.
    "proto/convert/base": ["core/base", "core/codec", "deform/v1"],
    "proto/convert/mesh": ["core/base", "core/mesh", "proto/convert/base", "deform/v1"],
    "proto/convert/controls": ["core/base", "core/mesh", "core/numerics", "proto/convert/base", "proto/convert/mesh", "deform/v1"],
    "proto/convert/findings.h": ["core/quality", "deform/v1"],
    "proto/convert/verdict.h": ["deform/v1"],
    "proto/convert/method_traits.h": ["core/deformers/method_features.h", "core/numerics", "deform/v1"],
    "proto/convert": ["core/base", "core/codec", "core/mesh", "core/quality", "core/constraints", "core/constraints/detection",
                      "core/deformers", "core/deformers/composed", "proto/convert/base", "proto/convert/mesh", "proto/convert/controls", "deform/v1"],
    # The server never reads a user's file.
    "server/store": ["core/base", "core/codec", "core/mesh", "proto/convert", "proto/convert/mesh", "deform/v1"],
    "server/engine": ["core/base", "core/codec", "core/compiled", "core/mesh", "core/quality", "core/constraints", "core/constraints/detection",
                      "core/deformers", "proto/convert", "proto/convert/base", "deform/v1", "server/store"],
    "server/rpc": ["core/base", "core/codec", "proto/convert/base", "deform/v1", "grpc/health/v1", "server/engine"],
    # main() chooses the kernels of dense systems.
    "server": ["core/base", "core/base/commit", "core/numerics", "server/store", "server/engine", "server/rpc"],
    "client": ["core/base", "core/codec", "proto/convert/base", "deform/v1"],
    "client/setup": ["core/base", "core/mesh", "core/mesh/cages", "core/io", "proto/convert/mesh", "deform/v1"],
    "client/python": ["core/base", "core/codec", "core/compiled", "core/mesh", "core/io", "core/measures", "core/quality", "deform/v1", "client", "client/setup"],
    # Executables that read files.
    "client/cli": ["core/base", "core/base/commit", "core/cad", "core/codec", "core/compiled", "core/mesh", "core/mesh/cages", "core/io", "core/quality",
                   "core/report",
                   "core/constraints/detection", "core/numerics", "proto/convert/mesh", "proto/convert/controls",
                   "proto/convert/findings.h", "proto/convert/verdict.h", "proto/convert/method_traits.h", "deform/v1", "client", "client/setup"],
    "client/examples": ["core/base", "core/codec", "core/mesh", "core/io", "deform/v1", "client"],
}

# Start of a library's header -> the only folders that know the library.
LIBRARIES = {
    "grpc": ["server/rpc", "client"],
    "google/protobuf/": ["proto/convert/base", "proto/convert/mesh", "proto/convert", "server/store", "server/engine", "server/rpc", "client", "client/setup", "client/python", "client/cli", "client/examples"],
    "draco/": ["core/codec"],
    "openssl/": ["core/codec", "server/engine", "server/store", "server/rpc", "client"],
    "hwy/": ["core/numerics"],
    "cholmod.h": ["core/numerics"],
    "nanoflann": ["core/numerics"],
    "sqlite3.h": ["server/store"],
    "libpq-fe.h": ["server/store"],
    "spdlog/": ["server/store", "server/engine", "server/rpc", "server"],
    "yaml-cpp/": ["server", "client/setup", "client/cli"],
    "prometheus/": ["server/rpc"],
    "httplib.h": ["server/rpc"],
    "CLI/": ["server", "client/cli"],
    "nlohmann/": ["client/setup", "client/cli", "client/examples"],
    "pybind11/": ["client/python"],
}

INCLUDE = re.compile(r'^\s*#\s*include\s*(?:"([^"]+)"|<([^>]+)>)')
SOURCES = {".h", ".cpp"}


def floor_of(path):
    """The header itself or the longest folder of FLOORS that holds `path`, or None."""
    parts = pathlib.PurePosixPath(path).parts
    for length in range(len(parts), 0, -1):
        folder = "/".join(parts[:length])
        if folder in FLOORS:
            return folder
    return None


def complaint(folder, header, quoted):
    """Why a file of `folder` must not include `header`, or None."""
    for start, folders in LIBRARIES.items():
        if header.startswith(start) and folder not in folders:
            return f"{folder} must not know {header}, only {', '.join(folders)}"
    if not quoted:
        return None
    if header.startswith(("deform/v1/", "grpc/health/v1/")):
        target = posixpath.dirname(header)
    elif "/" not in header or header.startswith("."):
        return f'"{header}": includes start at the root of the repository'
    else:
        target = floor_of(header)
    if target is None:
        return f'"{header}" is on no floor that {folder} knows'
    # Whoever may include from a folder may include its headers that have a row of their own, not those of its rooms.
    if target != folder and not {target, posixpath.dirname(target) if target.endswith(".h") else target} & {folder, *FLOORS[folder]}:
        return f'{folder} includes "{header}", but {target} is not below it'
    return None


def violations(root):
    found = []
    for top in ("core", "proto", "server", "client"):
        for path in sorted((root / top).rglob("*")):
            if path.suffix not in SOURCES:
                continue
            name = path.relative_to(root).as_posix()
            folder = floor_of(name)
            if folder is None:
                found.append(f"{name}:1: its folder is in no row of the table FLOORS in check_floors.py")
                continue
            for number, line in enumerate(path.read_text().splitlines(), 1):
                match = INCLUDE.match(line)
                why = match and complaint(folder, match[1] or match[2], bool(match[1]))
                if why:
                    found.append(f"{name}:{number}: {why}")
    return found


def main():
    root = pathlib.Path(sys.argv[1]) if len(sys.argv) > 1 else pathlib.Path(__file__).resolve().parents[2]
    found = violations(root)
    for line in found:
        print(line)
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())

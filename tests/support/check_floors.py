#!/usr/bin/env python3
"""Checks that a folder includes only from floors below it.

usage: check_floors.py [ROOT]      prints FILE:LINE: what is wrong; exit code 1 when anything is
"""
import pathlib
import re
import sys

# Folder -> folders of the project that it may include besides itself. The ground floor stands first.
FLOORS = {
    "core/base": [],
    "core/codec": ["core/base"],
    "core/numerics": ["core/base"],
    "core/mesh": ["core/base", "core/numerics"],
    "core/io": ["core/base", "core/mesh"],
    "core/quality": ["core/base", "core/mesh"],
    "core/constraints": ["core/base", "core/numerics", "core/mesh"],
    "core/constraints/detection": ["core/base", "core/numerics", "core/mesh", "core/constraints"],
    "core/deformers": ["core/base", "core/numerics", "core/mesh", "core/quality", "core/constraints"],
    # The server never reads a user's file.
    "server": ["core/base", "core/codec", "core/mesh", "core/quality", "core/constraints", "core/constraints/detection", "core/deformers",
               "deform/v1"],
    "client": ["core/base", "core/codec", "deform/v1"],
    # Executables that read files.
    "client/cli": ["core/base", "core/codec", "core/mesh", "core/io", "core/quality", "core/constraints/detection", "deform/v1",
                   "client"],
    "client/examples": ["core/base", "core/codec", "core/mesh", "core/io", "deform/v1", "client"],
}

# Start of a library's header -> the only folders that know the library.
LIBRARIES = {
    "grpc": ["server", "client"],
    "google/protobuf/": ["server", "client", "client/cli", "client/examples"],
    "draco/": ["core/codec"],
    "hwy/": ["core/numerics"],
    "cholmod.h": ["core/numerics"],
    "nanoflann": ["core/numerics"],
    "sqlite3.h": ["server"],
    "spdlog/": ["server"],
    "yaml-cpp/": ["server", "client/cli"],
    "CLI/": ["server", "client/cli"],
    "nlohmann/": ["client/cli", "client/examples"],
}

INCLUDE = re.compile(r'^\s*#\s*include\s*(?:"([^"]+)"|<([^>]+)>)')
SOURCES = {".h", ".cpp"}


def floor_of(path):
    """The longest folder of FLOORS that holds `path`, or None."""
    parts = pathlib.PurePosixPath(path).parts
    for length in range(len(parts) - 1, 0, -1):
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
    if header.startswith("deform/v1/"):
        target = "deform/v1"
    elif "/" not in header or header.startswith("."):
        return f'"{header}": includes start at the root of the repository'
    else:
        target = floor_of(header)
    if target is None:
        return f'"{header}" is on no floor that {folder} knows'
    if target != folder and target not in FLOORS[folder]:
        return f'{folder} includes "{header}", but {target} is not below it'
    return None


def violations(root):
    found = []
    for top in ("core", "server", "client"):
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

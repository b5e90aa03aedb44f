#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""Writes small compiled deformations as seeds of their fuzz target: CORPUS/fuzz_read_deformation/NAME. Checksums are left at 0, the
target puts in the right ones.

usage: make_deformation_seeds.py CORPUS
"""
import pathlib
import struct
import sys

FOLLOWS, FIXED = 0xFFFFFFFF, 0xFFFFFFFE
UNIT = [1, 0, 0, 0, 1, 0, 0, 0, 1]


def doubles(*numbers):
    return struct.pack(f"<{len(numbers)}d", *numbers)


def record(kind, payload, basis=0):
    return kind + struct.pack("<IQQ", basis, len(payload), 0) + payload + bytes(-len(payload) % 8)


def array(kind, entries, basis=0):
    return record(kind, struct.pack("<Q", 0) + entries, basis)


def deformation(planes=0, held=True, coded=False):
    points, fields = 20, 8
    regions = [0] * 3 + [FIXED] * 2 + [FOLLOWS] * 15
    following = 15 if held else points
    components = [1, 6] if planes else [7]
    head = struct.pack("<6I", 1 | (2 if held else 0), 2, 2, len(components), planes, 1)
    head += struct.pack("<6Q", points, following, 0 if held else 1, 1, 1, 4)
    head += struct.pack("<8I", *(components + [0] * 8)[:8])
    head += doubles(2, 1, 2, 0, 0, 1, 0, 0, 0, *UNIT, 1e-9, 0, 0) + bytes(64)
    codes = struct.pack("<2I", 2, 0) + doubles(0, 0, 0, 1, *[0.1] * 4 * fields, 0.1, 0.1, 0, 0) + bytes(8 * fields)
    codes += bytes([4, 20]) + bytes(2 * 24 * (following // 16 + 1))
    codes += bytes(-len(codes) % 8)
    head += struct.pack("<8Q", *[len(codes) if coded else 0] * len(components), *[0] * (8 - len(components)))
    file = record(b"HEAD", head) + record(b"TEXT", struct.pack("<I", 6) + b"methodrbf")
    file += record(b"HAND", struct.pack("<Q", 3) + doubles(0, 0, 0, *UNIT) + b"handle")
    file += record(b"HAND", struct.pack("<Q", 0) + doubles(0, 0, 0, *UNIT) + b"other")
    file += record(b"VARI", struct.pack("<2I", 0, 0) + doubles(0, 1, 1, 0, 0, 0, -1, 1, 1) + b"up")
    file += record(b"VARI", struct.pack("<2I", 0, 1) + doubles(1, 0, 0, 0, 0, 0, -1, 1, 0.0175) + b"turn")
    file += record(b"ALSO", struct.pack("<4I", 1, 0, 1, 2) + doubles(0, 0, 0, 1, 0, 0, 1))
    file += array(b"SETU", b"none")
    file += array(b"REST", doubles(*(0.05 * (i if i < 12 else i - 3) for i in range(3 * points))))
    file += array(b"REGI", struct.pack(f"<{points}I", *regions))
    if planes:
        file += array(b"PLAN", bytes([0] * 18 + [1] * 2))
    if not held:
        file += array(b"CTRL", struct.pack("<2I", 0, 0) + doubles(0, 1, 0))
    file += array(b"PAIR", struct.pack("<2I", 3, 4))
    for basis in range(len(components)):
        for kind in (b"RESI", b"MORE", b"COMP", b"ERRO"):
            file += array(kind, doubles(*[1e-9] * fields), basis)
        tiles = (following + 15) // 16
        file += array(b"CODE", codes, basis) if coded else array(b"FLDS", doubles(*(0.01 * i for i in range(16 * fields * tiles))), basis)
    file += record(b"ENDS", bytes(8))
    return b"\x89DEFORM\n" + struct.pack("<2IQ", 1, 0, 24 + len(file)) + file


def main():
    folder = pathlib.Path(sys.argv[1]) / "fuzz_read_deformation"
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "plain").write_bytes(deformation())
    (folder / "half").write_bytes(deformation(planes=1))
    (folder / "codes").write_bytes(deformation(coded=True))
    (folder / "controls").write_bytes(deformation(held=False))


if __name__ == "__main__":
    main()

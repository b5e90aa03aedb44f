#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""Registers a mesh, prepares a deformation, deforms once and looks at the result. docs/clients.md says how to generate the stubs.

usage: PYTHONPATH=STUBS deform_once.py [HOST:PORT]
"""
import array
import sys

import grpc
from deform.v1 import deformation_pb2, geometry_pb2, service_pb2_grpc, setup_pb2

CHUNK = 8192  # points or faces of a message, which stays below 1 MiB


def sheet(n):
    """A square of n x n points with quads: x y z of all points, and the corners of all faces."""
    points = array.array("d")
    for k in range(n * n):
        points.extend((k % n / (n - 1), k // n / (n - 1), 0.0))
    corners = array.array("I")
    for k in range(n * (n - 1)):
        if k % n < n - 1:
            corners.extend((k, k + 1, k + n + 1, k + n))
    return points, corners


def upload(points, corners):
    """The messages of RegisterGeometry. Arrays are little endian, as they are in memory on the machines that gRPC knows."""
    request = geometry_pb2.RegisterGeometryRequest
    faces = len(corners) // 4
    yield request(header=geometry_pb2.GeometryHeader(point_count=len(points) // 3, face_count=faces, corner_count=len(corners),
                                                     name="sheet"))
    for first in range(0, len(points), 3 * CHUNK):
        yield request(points=geometry_pb2.PointChunk(xyz=points[first:first + 3 * CHUNK].tobytes()))
    for first in range(0, len(corners), 4 * CHUNK):
        some = corners[first:first + 4 * CHUNK]
        sizes = array.array("I", [4] * (len(some) // 4))
        yield request(faces=geometry_pb2.FaceChunk(sizes=sizes.tobytes(), corners=some.tobytes()))


def example_setup(geometry_id):
    """The middle of the sheet moves up and down, its rim stays."""
    setup = setup_pb2.Setup(geometry=geometry_id)
    middle = setup.handles.add(name="middle")
    middle.region.sphere.centre.extend((0.5, 0.5, 0))
    middle.region.sphere.radius = 0.1
    setup.fixed.add(open_boundary=True)
    setup.variables.add(name="up", handle="middle", translate=(0, 0, 1))
    return setup


def prepare(service, setup):
    """Progress messages come first, then the system, once."""
    for reply in service.Prepare(deformation_pb2.PrepareRequest(setup=setup)):
        if reply.WhichOneof("part") == "system":
            return reply.system
    raise RuntimeError("the answer ended without a system")


def deform(service, request):
    """Points of the only design, from blocks in RAW_F64 and in ascending order."""
    points = array.array("d")
    for reply in service.Deform(request):
        if reply.WhichOneof("part") == "block":
            points.frombytes(reply.block.data)
    return points


def main():
    address = sys.argv[1] if len(sys.argv) > 1 else "127.0.0.1:50051"
    service = service_pb2_grpc.DeformServiceStub(grpc.insecure_channel(address))
    rest, corners = sheet(50)
    geometry = service.RegisterGeometry(upload(rest, corners))
    setup = example_setup(geometry.id)

    system = prepare(service, setup)  # once

    request = deformation_pb2.DeformRequest(system_id=system.id)  # as often as wanted
    request.output.encoding = deformation_pb2.RAW_F64
    request.designs.add(variables=[0.03])
    points = deform(service, request)  # x, y, z of each point, in registered order

    print(f"{len(points) // 3} points, highest {max(rest[2::3]):.3f} -> {max(points[2::3]):.3f}")


if __name__ == "__main__":
    main()

# SPDX-License-Identifier: GPL-3.0-or-later
"""A client in Python, written from the contract alone: a real server, a plate registered with it, a prepared system, decoded deformations."""

import os
import shutil
import sys
import tempfile
import unittest

import grpc
import numpy
from google.protobuf import json_format

import decode
from deform.v1 import deformation_pb2, geometry_pb2, service_pb2_grpc, setup_pb2

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path.insert(0, os.path.join(os.path.dirname(HERE), "end_to_end"))
from harness import Server  # noqa: E402

COLUMNS, ROWS = 24, 18


def u32(numbers):
    return numpy.asarray(numbers, "<u4").tobytes()


class Plate:
    """A curved plate of quads with a group of points at either end."""

    def __init__(self):
        i, j = numpy.meshgrid(numpy.arange(COLUMNS), numpy.arange(ROWS))
        x, y = i.ravel() / 8, j.ravel() / 8
        self.points = numpy.stack([x, y, 0.1 * x * (3 - x) + 0.05 * y], axis=1)
        first = (i[:-1, :-1] + COLUMNS * j[:-1, :-1]).ravel()
        self.faces = numpy.stack([first, first + 1, first + 1 + COLUMNS, first + COLUMNS], axis=1)
        self.left = numpy.flatnonzero(i.ravel() < 2)
        self.right = numpy.flatnonzero(i.ravel() >= COLUMNS - 2)

    def messages(self, name="plate"):
        header = geometry_pb2.GeometryHeader(point_count=len(self.points), face_count=len(self.faces), corner_count=self.faces.size,
                                             group_count=2, name=name)
        half = len(self.points) // 2
        for part in (dict(header=header), dict(points=dict(xyz=self.points[:half].astype("<f8").tobytes())),
                     dict(points=dict(xyz=self.points[half:].astype("<f8").tobytes())),
                     dict(faces=dict(sizes=u32([4] * len(self.faces)), corners=u32(self.faces[:5]))),
                     dict(faces=dict(corners=u32(self.faces[5:]))),
                     dict(group=dict(name="left", points=u32(self.left))),
                     dict(group=dict(name="right", points=u32(self.right[:7]))), dict(group=dict(points=u32(self.right[7:])))):
            yield geometry_pb2.RegisterGeometryRequest(**part)


SETUP = {
    "handles": [{"name": "right", "region": {"group": "right"}}], "fixed": [{"group": "left"}],
    "variables": [{"name": "up", "handle": "right", "translate": [0, 0, 2], "lower": -1, "upper": 1},
                  {"name": "turn", "handle": "right", "rotate": {"axis": [0, 3, 0], "centre": [2.75, 0, 0.25]}},
                  {"name": "grow", "handle": "right", "scale": {"centre": [2.75, 1, 0], "axis": [0, 2, 0]}}]}


class TestCase(unittest.TestCase):
    setup = SETUP

    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.mkdtemp(prefix="deform-wire-")
        cls.addClassCleanup(shutil.rmtree, cls.folder, ignore_errors=True)
        cls.server = Server(cls.folder, "--block-points", "256").start()
        cls.addClassCleanup(cls.server.stop)
        cls.channel = grpc.insecure_channel(cls.server.address)
        cls.addClassCleanup(cls.channel.close)
        cls.service = service_pb2_grpc.DeformServiceStub(cls.channel)
        cls.plate = Plate()
        cls.geometry = cls.service.RegisterGeometry(cls.plate.messages(), timeout=60)
        cls.system = cls.prepare(cls.setup)

    @classmethod
    def prepare(cls, setup):
        message = json_format.ParseDict({"geometry": cls.geometry.id, **setup}, setup_pb2.Setup())
        replies = list(cls.service.Prepare(deformation_pb2.PrepareRequest(setup=message), timeout=60))
        kinds = [reply.WhichOneof("part") for reply in replies]
        assert kinds[-1] == "system" and set(kinds[:-1]) <= {"progress"}, kinds
        return replies[-1].system

    def request(self, designs, encoding=deformation_pb2.RAW_F64, tolerance=0, system=None, **rest):
        return deformation_pb2.DeformRequest(system_id=(system or self.system).id, designs=[self.design(design) for design in designs],
                                             output=dict(encoding=encoding, tolerance=tolerance), **rest)

    @staticmethod
    def design(design):
        return design if isinstance(design, deformation_pb2.Design) else deformation_pb2.Design(variables=design)

    def deform(self, *arguments, **rest):
        replies = list(self.service.Deform(self.request(*arguments, **rest), timeout=60))
        self.assertTrue(all(reply.request_id == 0 for reply in replies))
        return self.decoded(replies)

    def decoded(self, replies):
        def points_of(geometry):
            self.assertEqual(geometry, self.geometry.id)
            return self.plate.points
        return decode.decode_replies(replies, points_of)[1]

    def refused(self, code, call, *says):
        with self.assertRaises(grpc.RpcError) as caught:
            call()
        self.assertEqual(caught.exception.code(), code, caught.exception.details())
        for text in says:
            self.assertIn(text, caught.exception.details())
        return caught.exception

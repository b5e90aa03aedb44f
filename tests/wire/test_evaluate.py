# SPDX-License-Identifier: GPL-3.0-or-later
"""Evaluate, by a client that was written from the contract: points that were never registered, in blocks, and what is no block."""

import unittest

import grpc
import numpy

import decode
import wire_client
from deform.v1 import deformation_pb2

DESIGN = [0.2, 0.3, 0.1]
ENCODINGS = (deformation_pb2.RAW_F64, deformation_pb2.RAW_F32, deformation_pb2.DRACO, deformation_pb2.DELTA_ZSTD)


def block(points, number=0, first=0, **changes):
    data = numpy.asarray(points, "<f8").tobytes()
    fields = dict(block=number, first=first, count=len(points), encoding=deformation_pb2.RAW_F64, checksum=decode.xxh64(data), data=data)
    return deformation_pb2.EvaluateRequest(points=deformation_pb2.Block(**{**fields, **changes}))


class Evaluate(wire_client.TestCase):
    def setUp(self):
        self.probes = numpy.random.default_rng(1).uniform([-0.5, -0.5, -0.5], [3.5, 2.5, 0.8], (700, 3))

    def header(self, design=DESIGN, encoding=deformation_pb2.RAW_F64, tolerance=0, system=None):
        return deformation_pb2.EvaluateRequest(header=deformation_pb2.EvaluateHeader(
            system_id=(system or self.system).id, design=self.design(design), output=dict(encoding=encoding, tolerance=tolerance)))

    def evaluate(self, messages, sent):
        """The moved points and the result; sent: the points of each block."""
        replies = list(self.service.Evaluate(iter(messages), timeout=60))
        kinds = [reply.WhichOneof("part") for reply in replies]
        self.assertEqual(kinds, ["info"] + ["block"] * len(sent) + ["result"])
        self.assertEqual(replies[0].info.geometry_id, self.geometry.id)
        moved, first = [], 0
        for number, (reply, points) in enumerate(zip(replies[1:], sent)):
            self.assertEqual((reply.block.block, reply.block.first, reply.block.count), (number, first, len(points)))
            moved.append(decode.decode_block(reply.block, points))
            first += len(points)
        result = replies[-1].result
        self.assertEqual(result.checksum, decode.design_checksum([reply.block.checksum for reply in replies[1:-1]]))
        self.assertEqual(result.points, first)
        return numpy.concatenate(moved) if moved else numpy.empty((0, 3)), result

    def test_registered_points_go_where_deform_puts_them(self):
        expected = self.deform([DESIGN], path=deformation_pb2.PATH_DIRECT)[0].points
        points = self.plate.points
        moved, result = self.evaluate([self.header(), block(points[:100]), block(points[100:], 1, 100)], [points[:100], points[100:]])
        self.assertTrue(numpy.array_equal(moved, expected))
        self.assertTrue(result.converged)

    def test_values_do_not_depend_on_blocks_and_encodings(self):
        whole, _ = self.evaluate([self.header(), block(self.probes)], [self.probes])
        cuts = [0, 1, 2, 300, 700]
        parts = [self.probes[a:b] for a, b in zip(cuts, cuts[1:])]
        single, _ = self.evaluate([self.header()] + [block(part, i, cuts[i]) for i, part in enumerate(parts)], parts)
        self.assertTrue(numpy.array_equal(whole, single))
        for encoding in ENCODINGS:
            moved, result = self.evaluate([self.header(encoding=encoding, tolerance=1e-5), block(self.probes)], [self.probes])
            worst = numpy.abs(moved - whole).max()
            self.assertLessEqual(worst, 1e-5)
            self.assertEqual(result.max_error, worst)
        self.assertEqual(self.evaluate([self.header()], [])[1].points, 0)

    def test_the_thin_plate_spline_of_the_handle_points(self):
        """Dense, with numpy: r^3 and a linear polynomial through the prescribed displacements of all handle and fixed points."""
        prescribed = numpy.asarray(self.evaluate([self.header(), block(self.plate.points)], [self.plate.points])[0]) - self.plate.points
        at = numpy.concatenate([self.plate.left, self.plate.right])
        centres = self.plate.points[at]
        cubes = lambda a: numpy.linalg.norm(a[:, None] - centres[None], axis=2) ** 3  # noqa: E731
        linear = lambda a: numpy.hstack([numpy.ones((len(a), 1)), a])  # noqa: E731
        matrix = numpy.block([[cubes(centres), linear(centres)], [linear(centres).T, numpy.zeros((4, 4))]])
        weights = numpy.linalg.lstsq(matrix, numpy.vstack([prescribed[at], numpy.zeros((4, 3))]), rcond=None)[0]
        expected = self.probes + numpy.hstack([cubes(self.probes), linear(self.probes)]) @ weights
        moved, _ = self.evaluate([self.header(), block(self.probes)], [self.probes])
        numpy.testing.assert_allclose(moved, expected, atol=1e-7)

    def test_what_is_no_block_is_refused(self):
        good = block(self.probes[:100])
        broken = self.probes.copy()
        broken[17, 2] = numpy.nan
        refusals = [
            ([], ["header"]),
            ([good], ["first message"]),
            ([self.header(), self.header()], ["second header"]),
            ([self.header(), good, block(self.probes, 1, 100, count=0, data=b"")], ["blocks[1].count", "1..40000"]),
            ([self.header(), block(self.probes, count=40001)], ["blocks[0].count", "40000"]),
            ([self.header(), good, block(self.probes, 2, 100)], ["blocks[1].block"]),
            ([self.header(), good, block(self.probes, 1, 99)], ["blocks[1].first", "100"]),
            ([self.header(), block(self.probes, design=1)], ["blocks[0].design"]),
            ([self.header(), block(self.probes, encoding=deformation_pb2.DELTA_ZSTD)], ["blocks[0].encoding", "RAW_F64"]),
            ([self.header(), block(self.probes, encoding=77)], ["blocks[0].encoding"]),
            ([self.header(), block(self.probes, data=b"1234")], ["blocks[0].data", "16800"]),
            ([self.header(), good, block(broken, 1, 100)], ["points[117]", "finite"]),
            ([self.header([0.2])], ["variables"]),
            ([self.header(DESIGN[:2] + [numpy.nan])], ["variables"]),
        ]
        for messages, says in refusals:
            self.refused(grpc.StatusCode.INVALID_ARGUMENT, lambda: list(self.service.Evaluate(iter(messages), timeout=60)), *says)
        self.refused(grpc.StatusCode.DATA_LOSS, lambda: list(self.service.Evaluate(iter([self.header(), block(self.probes, checksum=1)]), timeout=60)),
                     "blocks[0]", "checksum")

    def test_the_shell_says_why_not(self):
        shell = self.prepare({**wire_client.SETUP, "method": {"shell": {}}})
        self.refused(grpc.StatusCode.FAILED_PRECONDITION,
                     lambda: list(self.service.Evaluate(iter([self.header(system=shell), block(self.probes)]), timeout=60)), "shell", "faces")

    def test_many_cotangents_are_single_ones(self):
        fields = numpy.random.default_rng(2).normal(size=(3, *self.plate.points.shape))

        def gradient(field, **more):
            header = deformation_pb2.VectorJacobianHeader(system_id=self.system.id, variables=DESIGN, **more)
            yield deformation_pb2.VectorJacobianRequest(header=header)
            yield deformation_pb2.VectorJacobianRequest(cotangent=numpy.asarray(field, "<f8").tobytes())

        together = self.service.VectorJacobian(gradient(fields, cotangents=3), timeout=60).gradient
        alone = [g for field in fields for g in self.service.VectorJacobian(gradient(field), timeout=60).gradient]
        numpy.testing.assert_allclose(together, alone, rtol=1e-9, atol=1e-9 * numpy.abs(alone).max())
        self.refused(grpc.StatusCode.INVALID_ARGUMENT, lambda: self.service.VectorJacobian(gradient(fields, cotangents=2), timeout=60), "cotangent")
        self.refused(grpc.StatusCode.INVALID_ARGUMENT, lambda: self.service.VectorJacobian(gradient(fields, cotangents=1001), timeout=60), "1000")


if __name__ == "__main__":
    unittest.main()

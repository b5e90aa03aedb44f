# SPDX-License-Identifier: GPL-3.0-or-later
"""The client talks to a real server: registers, prepares, deforms, decodes, differentiates."""

import base64
import json
import os
import unittest

import grpc
import numpy
from google.protobuf import json_format

import decode
import wire_client
from deform.v1 import deformation_pb2, detection_pb2, geometry_pb2, service_pb2, setup_pb2
from wire_client import SETUP

ENCODINGS = (deformation_pb2.RAW_F64, deformation_pb2.RAW_F32, deformation_pb2.DRACO, deformation_pb2.DELTA_ZSTD)


def vectors(name):
    with open(os.path.join(os.path.dirname(os.path.abspath(__file__)), "vectors", name)) as file:
        return json.load(file)


def moved(points, up, turn, grow):
    """What the variables of SETUP mean, composed in their order."""
    x = points + up * numpy.array([0, 0, 2])
    centre, c, s = numpy.array([2.75, 0, 0.25]), numpy.cos(turn), numpy.sin(turn)
    x = (x - centre) @ numpy.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]).T + centre
    x[:, 1] = 1 + (1 + grow) * (x[:, 1] - 1)
    return x


class Contract(wire_client.TestCase):
    # ---- geometries ----

    def test_geometry_ids(self):
        self.assertEqual(self.geometry.id, decode.geometry_id(list(self.plate.messages())))
        for case in vectors("uploads.json"):
            messages = [geometry_pb2.RegisterGeometryRequest.FromString(base64.b64decode(text)) for text in case["messages"]]
            with self.subTest(case["name"]):
                first = self.service.RegisterGeometry(iter(messages), timeout=60)
                self.assertEqual((first.id, first.existed), (case["id"], False))
                messages[0].header.id = case["id"]
                again = self.service.RegisterGeometry(iter(messages[:1]), timeout=60)
                self.assertEqual((again.id, again.existed), (case["id"], True))

    def test_points_come_back_as_they_were_sent(self):
        chunks = list(self.service.GetPoints(geometry_pb2.GetPointsRequest(id=self.geometry.id[:8]), timeout=60))
        self.assertEqual(b"".join(chunk.xyz for chunk in chunks), self.plate.points.astype("<f8").tobytes())

    def test_an_announced_id_must_be_that_of_the_arrays(self):
        messages = list(self.plate.messages())
        messages[0].header.id = "0" * 64
        self.refused(grpc.StatusCode.INVALID_ARGUMENT, lambda: self.service.RegisterGeometry(iter(messages), timeout=60), "header.id")

    def test_pages(self):
        ids, token = [], ""
        while True:
            reply = self.service.ListGeometries(geometry_pb2.ListGeometriesRequest(page_size=1, page_token=token), timeout=60)
            ids += [geometry.id for geometry in reply.geometries]
            token = reply.next_page_token
            if not token:
                break
        self.assertIn(self.geometry.id, ids)
        self.assertEqual(len(ids), len(set(ids)))

    def test_unknown_ids(self):
        self.refused(grpc.StatusCode.NOT_FOUND, lambda: self.service.GetGeometry(geometry_pb2.GetGeometryRequest(id="0" * 64), timeout=60))
        self.refused(grpc.StatusCode.INVALID_ARGUMENT, lambda: self.service.GetGeometry(geometry_pb2.GetGeometryRequest(id="0"), timeout=60))

    # ---- setups ----

    def estimate(self, setup):
        return self.service.Estimate(deformation_pb2.EstimateRequest(setup=setup), timeout=60)

    def test_system_ids(self):
        given = json_format.ParseDict({"geometry": self.geometry.id[:12], **SETUP}, setup_pb2.Setup())
        canonical = decode.canonical_setup(given, self.geometry.id, flat=False)
        self.assertEqual(self.system.id, decode.system_id(canonical))
        self.assertEqual(self.system.setup, canonical)
        self.assertEqual(self.estimate(canonical).system_id, self.system.id)
        self.assertEqual(self.service.GetSystem(deformation_pb2.GetSystemRequest(id=self.system.id), timeout=60).id, self.system.id)

    def test_setups_are_left_out_on_demand(self):
        def systems(**options):
            return self.service.ListSystems(deformation_pb2.ListSystemsRequest(geometry_id=self.geometry.id, **options), timeout=60).systems

        def one(**options):
            return self.service.GetSystem(deformation_pb2.GetSystemRequest(id=self.system.id, **options), timeout=60)

        def prepared(**options):
            request = deformation_pb2.PrepareRequest(setup=self.system.setup, **options)
            return list(self.service.Prepare(request, timeout=60))[-1].system

        self.assertEqual([info.HasField("setup") for info in systems()], [True] * len(systems()))
        self.assertEqual([info.HasField("setup") for info in systems(omit_setup=True)], [False] * len(systems()))
        for call in (one, prepared):
            full, short = call(), call(omit_setup=True)
            self.assertEqual((full.setup, short.HasField("setup")), (self.system.setup, False))
            full.ClearField("setup")
            self.assertEqual(full, short, "else the same")

    def test_regions(self):
        points = self.plate.points
        radius = lambda a, b: numpy.linalg.norm(a - b, axis=1)  # noqa: E731
        every = numpy.arange(len(points))
        edges = {}
        for face in self.plate.faces:
            for a, b in zip(face, numpy.roll(face, -1)):
                edges[frozenset((a, b))] = edges.get(frozenset((a, b)), 0) + 1
        border = {point for edge, count in edges.items() if count == 1 for point in edge}
        seeds = {5, 40, 41}
        ring = {point for face in self.plate.faces if seeds & set(face) for point in face}
        cases = [
            ({"box": {"min": [0.5, 0.25, -1], "max": [1, 1.5, 1]}},
             (points >= [0.5, 0.25, -1]).all(axis=1) & (points <= [1, 1.5, 1]).all(axis=1)),
            ({"halfSpace": {"point": [1, 0, 0], "normal": [2, 0, 0]}}, points[:, 0] >= 1),
            ({"sphere": {"centre": points[100].tolist(), "radius": 0.5}}, radius(points, points[100]) <= 0.5),
            ({"cylinder": {"start": [0.5, 0, 0], "end": [1.5, 0, 0], "radius": 0.6}},
             (points[:, 0] >= 0.5) & (points[:, 0] <= 1.5) & (numpy.hypot(points[:, 1], points[:, 2]) <= 0.6)),
            ({"group": "left"}, numpy.isin(every, self.plate.left)),
            ({"openBoundary": True}, numpy.isin(every, list(border))),
            ({"boundary": True}, every >= 0),
            ({"grow": {"region": {"ids": sorted(seeds)}, "rings": 1}}, numpy.isin(every, list(ring))),
            ({"difference": [{"all": True}, {"group": "left"}, {"group": "right"}]},
             ~numpy.isin(every, numpy.concatenate([self.plate.left, self.plate.right]))),
            ({"intersection": [{"ids": [1, 2, 3]}, {"complement": {"ids": [2]}}]}, numpy.isin(every, [1, 3])),
            ({"union": [{"ids": [1, 2, 3]}, {"ids": [3, 4]}]}, numpy.isin(every, [1, 2, 3, 4]))]
        for region, inside in cases:
            setup = {"geometry": self.geometry.id, "handles": [{"name": "handle", "region": region}]}
            with self.subTest(str(region)):
                reply = self.estimate(json_format.ParseDict(setup, setup_pb2.Setup()))
                self.assertEqual(reply.handles[0].points, int(inside.sum()))

    def test_errors_name_the_field(self):
        setup = json_format.ParseDict({"geometry": self.geometry.id, **SETUP}, setup_pb2.Setup())
        del setup.variables[1].rotate.axis[:1]
        self.refused(grpc.StatusCode.INVALID_ARGUMENT, lambda: self.estimate(setup), "variables[1].rotate.axis", "3 numbers")

    # ---- deformations ----

    def test_motions_of_handles(self):
        designs = self.deform([(0.25, 0.5, -0.25), (0, 0, 0), (-1, 0, 2)])
        for design, values in zip(designs, [(0.25, 0.5, -0.25), (0, 0, 0), (-1, 0, 2)]):
            right = moved(self.plate.points[self.plate.right], *values)
            self.assertLess(abs(design.points[self.plate.right] - right).max(), 1e-9)
            self.assertLess(abs(design.points - self.plate.points)[self.plate.left].max(), 1e-9)
            self.assertAlmostEqual(design.result.max_displacement,
                                   numpy.linalg.norm(design.points - self.plate.points, axis=1).max(), delta=1e-12)

    def test_affine_maps_and_displacements(self):
        affine = [1, 0.1, 0, 0.2, 0, 1, 0, 0, 0.3, 0, 1, -0.1]
        rest = self.plate.points[self.plate.right]
        shift = numpy.linspace(0, 0.3, rest.size).reshape(rest.shape)
        pieces = [dict(first=9, xyz=shift[9:].tobytes()), dict(first=0, xyz=shift[:9].tobytes())]
        designs = self.deform([deformation_pb2.Design(motions=[dict(handle="right", affine=affine)]),
                               deformation_pb2.Design(motions=[dict(handle="right", displacements=pieces)])])
        matrix = numpy.array(affine).reshape(3, 4)
        self.assertLess(abs(designs[0].points[self.plate.right] - (rest @ matrix[:, :3].T + matrix[:, 3])).max(), 1e-9)
        self.assertLess(abs(designs[1].points[self.plate.right] - (rest + shift)).max(), 1e-9)

    def test_every_encoding(self):
        values = [(0.3, 0.1, 0), (-0.5, 0, 0.5)]
        exact = self.deform(values)
        for encoding in ENCODINGS:
            with self.subTest(deformation_pb2.Encoding.Name(encoding)):
                for design, other in zip(self.deform(values, encoding, tolerance=1e-5), exact):
                    error = abs(design.points - other.points).max()
                    self.assertLessEqual(error, 1e-5)
                    self.assertEqual(error, design.result.max_error)

    def test_default_tolerance(self):
        design, exact = self.deform([(0.3, 0.1, 0)], deformation_pb2.ENCODING_DEFAULT)[0], self.deform([(0.3, 0.1, 0)])[0]
        diagonal = numpy.linalg.norm(numpy.ptp(self.plate.points, axis=0))
        self.assertAlmostEqual(self.geometry.diagonal, diagonal)
        self.assertLessEqual(abs(design.points - exact.points).max(), 1e-6 * diagonal)

    def test_a_bad_design(self):
        values = [(0.5, 0, 0), (2, 0, 0)]
        self.refused(grpc.StatusCode.INVALID_ARGUMENT, lambda: self.deform(values), "designs[1]", "variables[0]")
        good, bad = self.deform(values, failures=deformation_pb2.FAILURES_PER_DESIGN)
        self.assertFalse(good.result.HasField("error"))
        self.assertEqual(bad.result.error.code, grpc.StatusCode.INVALID_ARGUMENT.value[0])

    def test_a_deadline(self):
        self.refused(grpc.StatusCode.DEADLINE_EXCEEDED, lambda: list(self.service.Deform(self.request([(0, 0, 0)] * 5000), timeout=0.005)))

    def test_a_stream(self):
        rest = self.plate.points[self.plate.right]
        shift = numpy.full(rest.shape, 0.125)
        message = deformation_pb2.DeformStreamRequest
        begun = self.request([(0.5, 0, 0), deformation_pb2.Design(motions=[dict(handle="right", displacements=[
            dict(first=0, xyz=shift[:4].tobytes())])])])
        rest_of_it = deformation_pb2.DeformRequest(designs=[
            dict(continues=True, motions=[dict(handle="right", displacements=[dict(first=4, xyz=shift[4:].tobytes())])]),
            dict(variables=(0, 0.25, 0))])
        unknown = self.request([(0, 0, 0)])
        unknown.system_id = "0" * 64
        sent = [message(request_id=7, request=begun, more=True), message(request_id=8, request=self.request([(0.25, 0, 0)])),
                message(request_id=9, request=unknown), message(request_id=7, request=rest_of_it),
                message(request_id=10, request=self.request([(0, 0, 0)]), more=True), message(request_id=10, cancel=True),
                message(request_id=11, cancel=True), message(request_id=12, request=self.request([(0, 0, 0)]), more=True)]
        replies = {}
        for reply in self.service.DeformStream(iter(sent), timeout=60):
            replies.setdefault(reply.request_id, []).append(reply)
        self.assertEqual({id: parts[-1].error.code for id, parts in replies.items()},
                         {7: 0, 8: 0, 9: grpc.StatusCode.NOT_FOUND.value[0], 10: grpc.StatusCode.CANCELLED.value[0],
                          12: grpc.StatusCode.INVALID_ARGUMENT.value[0]})
        designs = self.decoded(replies[7])
        self.assertEqual(len(designs), 3)
        self.assertLess(abs(designs[1].points[self.plate.right] - rest - shift).max(), 1e-9)
        self.assertTrue((self.decoded(replies[8])[0].points == self.deform([(0.25, 0, 0)])[0].points).all())

    # ---- derivatives ----

    def test_derivatives(self):
        at, direction, step = numpy.array([0.2, 0.3, -0.1]), numpy.array([1, -0.5, 0.25]), 1e-6
        reply = self.service.JacobianVector(
            deformation_pb2.JacobianVectorRequest(system_id=self.system.id, variables=at, direction=direction), timeout=60)
        forward = self.decoded(list(reply))[0].points
        after, before = self.deform([at + step * direction, at - step * direction])
        self.assertLess(abs(forward - (after.points - before.points) / (2 * step)).max(), 1e-7)
        cotangent = numpy.cos(numpy.arange(forward.size)).reshape(forward.shape)
        data = cotangent.tobytes()
        request = deformation_pb2.VectorJacobianRequest
        gradient = self.service.VectorJacobian(iter([
            request(header=dict(system_id=self.system.id, variables=at)), request(cotangent=data[:1001]),
            request(cotangent=data[1001:])]), timeout=60).gradient
        self.assertAlmostEqual(numpy.dot(gradient, direction), (cotangent * forward).sum(), delta=1e-9)

    # ---- the rest ----

    def test_detection(self):
        replies = list(self.service.Detect(detection_pb2.DetectRequest(geometry_id=self.geometry.id, tolerance=1e-6), timeout=60))
        self.assertEqual(replies[-1].WhichOneof("part"), "summary")
        expected, got, kinds = {}, {}, []
        for reply in replies[:-1]:
            kind = reply.WhichOneof("part")
            kinds.append(kind)
            if kind == "ids":
                got[reply.ids.of] = got.get(reply.ids.of, 0) + len(reply.ids.ids) // 4
                continue
            self.assertEqual(got, expected)
            found = getattr(reply, kind)
            got, expected = {}, {detection_pb2.DetectedIds.POINTS: found.points}
            if kind == "primitive":
                expected[detection_pb2.DetectedIds.FACES] = found.faces
        self.assertEqual(got, expected)
        self.assertIn("edge", kinds)

    def test_server_info(self):
        info = self.service.GetServerInfo(service_pb2.GetServerInfoRequest(), timeout=60)
        self.assertGreater(info.limits.max_points, len(self.plate.points))
        self.assertTrue(info.store.writable)

    def test_release(self):
        setup = {**SETUP, "seed": "77"}
        system = self.prepare(setup)
        release = deformation_pb2.ReleaseSystemRequest
        self.assertGreater(self.service.ReleaseSystem(release(id=system.id), timeout=60).bytes_released, 0)
        self.assertFalse(self.service.GetSystem(deformation_pb2.GetSystemRequest(id=system.id), timeout=60).resident)
        self.refused(grpc.StatusCode.FAILED_PRECONDITION,
                     lambda: self.service.DeleteGeometry(geometry_pb2.DeleteGeometryRequest(id=self.geometry.id), timeout=60))
        self.service.ReleaseSystem(release(id=system.id, forget=True), timeout=60)
        self.refused(grpc.StatusCode.NOT_FOUND, lambda: self.service.ReleaseSystem(release(id=system.id, forget=True), timeout=60))


if __name__ == "__main__":
    unittest.main(verbosity=2)

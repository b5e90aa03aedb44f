# SPDX-License-Identifier: GPL-3.0-or-later
"""Cheap requests that took servers down, each with the bounds of attack.Attack."""

import concurrent.futures
import contextlib
import re
import socket
import struct
import threading
import time

import grpc
import numpy

import http2
from attack import LONG, MIB, Attack, main, resident
from honest import until_answered
from deform.v1 import deformation_pb2, detection_pb2, geometry_pb2, service_pb2_grpc, setup_pb2


def in_threads(count, action):
    with concurrent.futures.ThreadPoolExecutor(count) as pool:
        return list(pool.map(action, range(count)))


def varint(number):
    out = bytearray()
    while number >= 128:
        out.append(number % 128 + 128)
        number //= 128
    return bytes(out) + bytes([number])


class RawService:
    """Calls with bytes as they are."""

    def __init__(self, channel):
        self.channel = channel

    def unary(self, method, request, timeout=30):
        return self.channel.unary_unary(f"/deform.v1.DeformService/{method}")(request, timeout=timeout)

    def server_stream(self, method, request, timeout=30):
        return list(self.channel.unary_stream(f"/deform.v1.DeformService/{method}")(request, timeout=timeout))

    def stream(self, method, requests, timeout=60):
        return list(self.channel.stream_stream(f"/deform.v1.DeformService/{method}")(requests, timeout=timeout))


def register_large(service, columns=500, rows=400):
    """A plane of unit squares."""
    i, j = numpy.meshgrid(numpy.arange(columns), numpy.arange(rows))
    points = numpy.stack([i.ravel(), j.ravel(), 0 * i.ravel()], axis=1).astype("<f8")
    first = (i[:-1, :-1] + columns * j[:-1, :-1]).ravel()
    faces = numpy.stack([first, first + 1, first + 1 + columns, first + columns], axis=1).astype("<u4")

    def messages():
        yield geometry_pb2.RegisterGeometryRequest(
            header=dict(point_count=len(points), face_count=len(faces), corner_count=faces.size, name="large"))
        for part in numpy.array_split(points, 20):
            yield geometry_pb2.RegisterGeometryRequest(points=dict(xyz=part.tobytes()))
        for part in numpy.array_split(faces, 20):
            yield geometry_pb2.RegisterGeometryRequest(
                faces=dict(sizes=numpy.full(len(part), 4, "<u4").tobytes(), corners=part.tobytes()))

    return service.RegisterGeometry(messages(), timeout=60)


class Messages(Attack):
    """What is small on the wire and large once it is parsed."""

    # A design is two bytes on the wire.
    def designs(self, size):
        head = self.request.SerializeToString(deterministic=True)
        return head + b"\x12\x00" * ((size - len(head)) // 2)

    def test_empty_designs_in_one_message(self):
        """4 MiB, which is what gRPC takes: two million designs, 16 times at once, again and again."""
        bytes_ = self.designs(4 * MIB - 64)

        def attack(_):
            raw = RawService(self.channel())
            return [self.refused(lambda: raw.server_stream("Deform", bytes_)) for _ in range(6)]

        for codes in in_threads(16, attack):
            self.assertNotIn(None, codes)

    def test_empty_designs_on_a_stream(self):
        """56 MB of designs on one stream: each request continues."""
        request = self.designs(MIB - 64)

        def requests():
            for i in range(56):
                yield b"\x08\x01\x12" + varint(len(request)) + request + b"\x18\x01"

        replies = [deformation_pb2.DeformReply.FromString(reply)
                   for reply in RawService(self.channel()).stream("DeformStream", requests())]
        self.assertEqual([reply.WhichOneof("part") for reply in replies], ["error"])

    def test_empty_designs_of_many_requests(self):
        """Below the limit of designs, but many requests that wait."""
        request = deformation_pb2.DeformRequest(system_id=self.system.id)
        request.designs.extend([deformation_pb2.Design()] * 10_000)
        bytes_ = request.SerializeToString()

        def attack(_):
            raw = RawService(self.channel())
            return self.refused(lambda: raw.stream("DeformStream", (b"\x08" + varint(i + 1) + b"\x12" + varint(len(bytes_)) + bytes_
                                                                     for i in range(500))))

        in_threads(4, attack)

    def test_regions_within_regions(self):
        """A setup of 900 KB that is unions of empty unions."""
        region = b"\x4a\x00" * 400_000
        setup = self.setup.SerializeToString() + b"\x22" + varint(len(region)) + region
        request = b"\x0a" + varint(len(setup)) + setup

        def attack(_):
            raw = RawService(self.channel())
            return [self.refused(lambda: raw.unary("Estimate", request)) for _ in range(3)]

        for codes in in_threads(16, attack):
            self.assertNotIn(None, codes)


class Selections(Attack):
    """Small setups that ask for much work."""

    def test_many_regions_of_many_constraints(self):
        """134 KB of constraints on everything: each selects 200,000 points."""
        large = register_large(self.stub())
        setup = setup_pb2.Setup(geometry=large.id)
        setup.method.shell.SetInParent()
        handle = setup.handles.add(name="h")
        handle.region.box.min.extend([-1, -1, -1])
        handle.region.box.max.extend([3, 1e3, 1])
        for i in range(4000):
            constraint = setup.constraints.add(name=f"c{i}")
            constraint.planar.SetInParent()
            region = constraint.regions.add()
            region.complement.ids.append(i)

        def attack(i):
            if i % 2 == 0:
                return self.refused(lambda: self.stub().Estimate(deformation_pb2.EstimateRequest(setup=setup), timeout=20))
            return self.refused(lambda: list(self.stub().Prepare(deformation_pb2.PrepareRequest(setup=setup), timeout=20)))

        for codes in (in_threads(8, attack) for _ in range(3)):
            self.assertEqual(set(codes), {grpc.StatusCode.RESOURCE_EXHAUSTED})

    def test_estimates_do_not_keep_questions_waiting(self):
        """16 estimates of 468 KB of regions at once; their clients leave after 5 s."""
        large = register_large(self.stub())
        setup = setup_pb2.Setup(geometry=large.id)
        handle = setup.handles.add(name="h")
        for i in range(9000):
            part = handle.region.union.add()
            part.sphere.centre.extend([i % 500, i % 400, 0.0])
            part.sphere.radius = 3
        codes = in_threads(16, lambda _: self.refused(
            lambda: self.stub().Estimate(deformation_pb2.EstimateRequest(setup=setup), timeout=5)))
        self.assertIn(grpc.StatusCode.DEADLINE_EXCEEDED, codes, "it was to be too much work")

    def test_preparations_do_not_keep_designs_waiting(self):
        """300 preparations, all different."""
        large = register_large(self.stub(), 200, 100)

        def attack(i):
            setup = setup_pb2.Setup(geometry=large.id, seed=i)
            for name, column in (("a", 3 + 0.001 * i), ("b", 100)):
                handle = setup.handles.add(name=name)
                handle.region.box.min.extend([column - 4, -1, -1])
                handle.region.box.max.extend([column + 2, 1e3, 1])
            return self.refused(lambda: list(self.stub().Prepare(deformation_pb2.PrepareRequest(setup=setup), timeout=10)))

        self.assertIn(None, in_threads(100, attack), "some are prepared")


class LongWork(Attack):
    """Calls of one client that take seconds each, beside designs that take milliseconds."""

    def test_detections_do_not_keep_designs_waiting(self):
        """20 at once of a mesh of 200,000 points."""
        large = register_large(self.stub())
        stub = self.stub()
        codes = in_threads(20, lambda _: self.refused(
            lambda: list(stub.Detect(detection_pb2.DetectRequest(geometry_id=large.id), timeout=15))))
        self.assertIn(None, codes, "some are answered")

    def test_derivatives_do_not_keep_designs_waiting(self):
        """Products with 8 fields of 200,000 vectors each, 8 at once, again and again."""
        large = register_large(self.stub())
        setup = setup_pb2.Setup(geometry=large.id)
        setup.method.rbf.SetInParent()
        for name, first in (("a", 0), ("b", 199_000)):
            setup.handles.add(name=name).region.ids.extend(range(first, first + 1000))
            setup.variables.add(name=f"{name}_up", handle=name, translate=[0, 0, 1])
        stub = self.stub()
        system = list(stub.Prepare(deformation_pb2.PrepareRequest(setup=setup), timeout=60))[-1].system
        piece = deformation_pb2.VectorJacobianRequest(cotangent=numpy.ones(120_000, "<f8").tobytes())  # a fifth of a field

        def requests():
            yield deformation_pb2.VectorJacobianRequest(header=dict(system_id=system.id, variables=[0, 0], cotangents=8))
            for _ in range(5 * 8):
                yield piece

        codes = in_threads(8, lambda _: [self.refused(lambda: until_answered(lambda: stub.VectorJacobian(requests(), timeout=30)))
                                         for _ in range(2)])
        self.assertIn(None, sum(codes, []), "some are answered")

    def of_spheres(self, geometry, count):
        setup = setup_pb2.Setup(geometry=geometry)
        handle = setup.handles.add(name="h")
        for i in range(count):
            part = handle.region.union.add()
            part.sphere.centre.extend([i % 500, i % 400, 0.0])
            part.sphere.radius = 3
        return setup

    def test_estimates_of_one_do_not_keep_those_of_others_waiting(self):
        """One client asks for 60 that take most of a second each and for 4 that take longer; another asks one after the other."""
        large = register_large(self.stub())
        greedy, modest = self.stub(), self.stub("127.0.0.3")
        many = [self.of_spheres(large.id, 5000 + i) for i in range(4)] + [self.of_spheres(large.id, 500 + i) for i in range(60)]
        calls = [greedy.Estimate.future(deformation_pb2.EstimateRequest(setup=setup), timeout=20) for setup in many]
        time.sleep(1)
        seconds = []
        while not all(call.done() for call in calls) and len(seconds) < 20:
            began = time.monotonic()
            until_answered(lambda: modest.Estimate(deformation_pb2.EstimateRequest(setup=self.setup), timeout=20))
            seconds.append(time.monotonic() - began)
        self.assertGreater(len(seconds), 1, "it was to be too much work")
        self.figures.append(f"estimates of another: {len(seconds)}, at most {max(seconds):.2f} s")
        if LONG:
            self.assertLess(max(seconds), 5, "seconds that one of them may take that has begun, on a busy machine")
        for call in calls:
            call.cancel()
        until_answered(lambda: modest.Estimate(deformation_pb2.EstimateRequest(setup=self.of_spheres(large.id, 100)), timeout=10))

    def test_more_regions_than_can_be_looked_at(self):
        """4 MB of spheres, to be looked for among 200,000 points: 60,000 times 200,000 is beyond --max-setup-work."""
        large = register_large(self.stub())
        setup = self.of_spheres(large.id, 60_000).SerializeToString()

        def attack(i):
            stub = self.stub()
            if i % 2 == 0:
                return self.refused(lambda: stub.EstimateLarge(
                    (deformation_pb2.EstimateLargeRequest.FromString(piece.SerializeToString()) for piece in pieces_of(setup)), timeout=20))
            return self.refused(lambda: list(stub.PrepareLarge(pieces_of(setup), timeout=20)))

        self.assertLessEqual(set(in_threads(8, attack)), {grpc.StatusCode.INVALID_ARGUMENT, grpc.StatusCode.RESOURCE_EXHAUSTED})
        self.assertEqual({attack(0), attack(1)}, {grpc.StatusCode.INVALID_ARGUMENT})


def pieces_of(setup, count=None):
    """The messages of a setup; only so many of them."""
    size = 700_000
    for i in range(0, len(setup), size)[:count]:
        message = deformation_pb2.PrepareLargeRequest(setup=setup[i:i + size])
        if i == 0:
            message.header.setup.bytes = len(setup)
        yield message


class LargeSetups(Attack):
    """Setups in pieces (EstimateLarge, PrepareLarge), and answers about them."""

    options = ["--max-deadline", "20"]

    def of_ids(self, size, seed=0):
        """A setup of so many bytes that fixes the left end again and again."""
        ids = bytes(i for i in self.plate.left if i < 128) * 100  # one byte each
        lists = b"\x4a" + varint(len(ids) + 3) + b"\x32" + varint(len(ids)) + ids  # union: ids
        region = lists * (size // len(lists))
        setup = setup_pb2.Setup()
        setup.CopyFrom(self.setup)
        setup.seed = seed
        return setup.SerializeToString() + b"\x22" + varint(len(region)) + region

    def test_pieces_whose_setup_never_ends(self):
        """64 streams announce 40 MB each, and send 28 MB."""
        setup = bytes(40_000_000)
        release = threading.Event()
        self.addCleanup(release.set)

        def attack(i):
            def messages():
                yield from pieces_of(setup, 40)
                release.wait(10)

            stub = self.stub()
            if i % 2 == 0:
                call = stub.EstimateLarge.future(deformation_pb2.EstimateLargeRequest.FromString(m.SerializeToString()) for m in messages())
                return lambda: call.result(timeout=30)
            replies = stub.PrepareLarge(messages(), timeout=30)
            return lambda: list(replies)

        calls = in_threads(64, attack)
        time.sleep(4)
        release.set()
        for call in calls:
            self.assertIn(self.refused(call), {grpc.StatusCode.RESOURCE_EXHAUSTED, grpc.StatusCode.INVALID_ARGUMENT})

    def test_many_parts(self):
        """12 MB of empty regions: six million messages once they are parsed."""
        region = b"\x4a\x00" * 6_000_000
        setup = self.setup.SerializeToString() + b"\x22" + varint(len(region)) + region

        def attack(_):
            stub = self.stub()
            return [self.refused(lambda: list(stub.PrepareLarge(pieces_of(setup), timeout=30))) for _ in range(4)]

        for codes in in_threads(16, attack):
            self.assertNotIn(None, codes)

    def test_large_setups_that_are_right(self):
        """6 different setups of 4 MB at once, again and again, and all questions about them. Who does as a refusal says gets an answer."""
        def attack(i):
            stub, setup = self.stub(), self.of_ids(4_000_000, i)
            for _ in range(3):
                until_answered(lambda: list(stub.PrepareLarge(pieces_of(setup), timeout=30)))
            for system in stub.ListSystems(deformation_pb2.ListSystemsRequest(), timeout=30).systems:
                self.assertLess(system.ByteSize(), MIB)
                self.refused(lambda: stub.GetSystem(deformation_pb2.GetSystemRequest(id=system.id), timeout=30))
                self.refused(lambda: list(stub.GetSetup(deformation_pb2.GetSetupRequest(system_id=system.id), timeout=30)))

        in_threads(6, attack)
        self.assertEqual(len(self.service.ListSystems(deformation_pb2.ListSystemsRequest(), timeout=30).systems), 7)


def small_window(attack):
    """A connection that takes next to nothing."""
    connection = http2.Connection(attack.server.port)
    connection.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_WINDOW_CLAMP, 1024)
    attack.connections.append(connection)
    return connection


def call_frames(connection, method, message):
    """The frames of a call with one message, which fits into one."""
    stream = connection.next_stream()
    return (http2.frame(http2.HEADERS, http2.END_HEADERS, stream, http2.call_headers(method)) +
            http2.frame(http2.DATA, http2.END_STREAM, stream, b"\0" + struct.pack(">I", len(message)) + message))


def ask_for_setups(attack, connections):
    """Setups of 0.5 MB, asked for 40 times by each connection, which reads no answer."""
    large = register_large(attack.service)
    setup = setup_pb2.Setup(geometry=large.id)
    setup.method.rbf.SetInParent()
    handle = setup.handles.add(name="h")
    few, many = handle.region.intersection.add(), handle.region.intersection.add()
    few.ids.extend(range(20))
    many.ids.extend(range(150_000))
    system = list(attack.service.Prepare(deformation_pb2.PrepareRequest(setup=setup), timeout=60))[-1].system
    attack.assertGreater(attack.service.GetSystem(deformation_pb2.GetSystemRequest(id=system.id)).ByteSize(), 400_000)
    request = deformation_pb2.GetSystemRequest(id=system.id).SerializeToString()
    for _ in range(connections):
        connection = small_window(attack)
        for _ in range(40):
            connection.send(call_frames(connection, "GetSystem", request))


class Held(Attack):
    """Calls that are begun and never ended, replies that nobody reads."""

    options = ["--max-deadline", "20"]

    def hold(self, count, method, messages):
        """Begins as many calls that send these messages and no end; after 3 s the end comes. How many were under way then, and the
        codes of all. Until then what is held is charged, and the server takes designs and small meshes."""
        release = threading.Event()
        self.addCleanup(release.set)

        def requests():
            yield from messages
            release.wait(30)

        stubs = [self.stub() for _ in range(10)]
        calls = [getattr(stubs[i % 10], method).future(requests(), timeout=30) for i in range(count)]
        time.sleep(3)
        waiting = sum(not call.done() for call in calls)
        self.check_what_is_held()
        release.set()
        return waiting, [call.exception(timeout=40).code() for call in calls]

    def check_what_is_held(self):
        """It is charged, and leaves room for designs and small meshes."""
        self.assertEqual(self.figure("deformd_memory_full"), 0, "what is held leaves room for designs")
        held = self.figure("deformd_memory_charged_bytes") + self.figure("deformd_requests_held_bytes")
        self.assertLess(resident(self.server.process.pid), self.before + held + 96 * MIB, "what is held is charged")
        until_answered(lambda: self.service.RegisterGeometry(self.plate.messages(), timeout=10))

    def test_cotangents_that_never_end(self):
        points = 24 * 18
        waiting, codes = self.hold(500, "VectorJacobian", [
            deformation_pb2.VectorJacobianRequest(header=dict(system_id=self.system.id, variables=[0, 0, 0])),
            deformation_pb2.VectorJacobianRequest(cotangent=bytes(points * 24 - 8))])
        self.assertEqual((waiting, set(codes)), (500, {grpc.StatusCode.INVALID_ARGUMENT}))

    def test_uploads_that_never_end(self):
        waiting, codes = self.hold(300, "RegisterGeometry", [
            geometry_pb2.RegisterGeometryRequest(header=dict(point_count=1_000_000, face_count=1, corner_count=3, name="x")),
            geometry_pb2.RegisterGeometryRequest(points=dict(xyz=bytes(40_000 * 24)))])
        self.assertGreater(waiting, 0)
        self.assertIn(grpc.StatusCode.INVALID_ARGUMENT, codes, "their points are missing")
        self.assertNotIn(None, codes)

    def test_large_uploads_that_never_end(self):
        """100 of 10 MB each; those that come to nearly a quarter of the budget are held."""
        waiting, codes = self.hold(100, "RegisterGeometry", [
            geometry_pb2.RegisterGeometryRequest(header=dict(point_count=10_000_000, face_count=1, corner_count=3, name="x")),
            *[geometry_pb2.RegisterGeometryRequest(points=dict(xyz=bytes(40_000 * 24)))] * 10])
        self.assertGreater(waiting, 0)
        self.assertEqual(set(codes), {grpc.StatusCode.RESOURCE_EXHAUSTED, grpc.StatusCode.INVALID_ARGUMENT})

    def stay_open(self, method, message):
        """Begins 200 streams that send this message and no more. The codes with which they end, when the client does."""
        release = threading.Event()
        self.addCleanup(release.set)

        def requests():
            yield message
            release.wait(30)

        channels = [self.channel() for _ in range(10)]
        calls = [channels[i % 10].stream_stream(f"/deform.v1.DeformService/{method}")(requests(), timeout=30) for i in range(200)]
        time.sleep(3)
        self.assertEqual([call.details() for call in calls if not call.is_active()][:2], [])
        self.check_what_is_held()
        release.set()
        for call in calls:
            with contextlib.suppress(grpc.RpcError):
                list(call)
        return {call.code() for call in calls}

    def test_streams_that_say_nothing_more(self):
        """They cancel a request that is not there, with 0.9 MB of it, which is ignored, and stay open."""
        message = deformation_pb2.DeformStreamRequest(request_id=1, cancel=True)
        message.request.designs.add(variables=[0.5] * 115_000)
        self.assertEqual(self.stay_open("DeformStream", message.SerializeToString()), {grpc.StatusCode.OK})

    def test_large_setups_that_say_nothing_more(self):
        """Their headers have 0.9 MB of a field that the server does not know."""
        unknown = b"\xfa\x01" + b"\xa0\xf7\x36" + bytes(900_000)  # field 31, its length
        header = deformation_pb2.PrepareLargeRequest(header=dict(setup=dict(bytes=1000)))
        self.assertEqual(self.stay_open("PrepareLarge", header.SerializeToString() + unknown), {grpc.StatusCode.INVALID_ARGUMENT})

    def test_designs_that_nobody_reads(self):
        """Populations whose replies wait; the reader takes the first and no more."""
        request = deformation_pb2.DeformRequest(system_id=self.system.id, output=dict(encoding=deformation_pb2.RAW_F64))
        request.designs.extend([deformation_pb2.Design(variables=[0.1, 0, 0])] * 10_000)
        calls = []
        for _ in range(200):
            call = self.stub().Deform(request, timeout=60)
            calls.append(call)
        time.sleep(5)
        for call in calls:
            call.cancel()

    def test_replies_that_nobody_reads(self):
        """Setups of 0.5 MB, asked for 4,000 times; nobody reads the answers."""
        ask_for_setups(self, 100)
        time.sleep(4)
        self.assertGreater(self.figure("deformd_requests_held_bytes"), 10 * MIB, "the answers are charged")


class Stalled(Attack):
    """Clients that say nothing more, and ones that listen to nothing, are not waited for."""

    options = ["--stall-timeout", "2"]

    def stay(self, method, messages):
        """Sends these and no end; the call ends by itself, with its code and details."""
        release = threading.Event()
        self.addCleanup(release.set)

        def requests():
            yield from messages
            release.wait(30)

        began = time.monotonic()
        call = getattr(self.stub(), method)
        if method in ("PrepareLarge", "Evaluate", "DeformStream"):
            call = call(requests(), timeout=25)
            with contextlib.suppress(grpc.RpcError):
                list(call)
        else:
            call = call.future(requests(), timeout=25)
        code, details = call.code(), call.details()
        self.assertIn("--stall-timeout", details, method)
        self.assertEqual(code, grpc.StatusCode.DEADLINE_EXCEEDED, method)
        self.assertTrue(1.9 < time.monotonic() - began < 20, method)

    def test_requests_that_never_end(self):
        points = deformation_pb2.VectorJacobianRequest(header=dict(system_id=self.system.id, variables=[0, 0, 0]))
        upload = geometry_pb2.RegisterGeometryRequest(header=dict(point_count=1000, face_count=1, corner_count=3, name="x"))
        half = deformation_pb2.DeformStreamRequest(request_id=1, more=True)
        half.request.CopyFrom(self.request)
        cases = [("VectorJacobian", [points]), ("RegisterGeometry", [upload]), ("RegisterGeometry", []),
                 ("EstimateLarge", [deformation_pb2.EstimateLargeRequest(header=dict(setup=dict(bytes=1000)))]),
                 ("PrepareLarge", [deformation_pb2.PrepareLargeRequest(header=dict(setup=dict(bytes=1000)))]),
                 ("Evaluate", [deformation_pb2.EvaluateRequest(header=dict(system_id=self.system.id, design=dict(variables=[0, 0, 0])))]),
                 ("DeformStream", [half])]
        in_threads(len(cases), lambda k: self.stay(*cases[k]))

    def test_slow_requests_are_taken(self):
        """A population whose messages come one a second, five in all."""
        def requests():
            for k in range(5):
                message = deformation_pb2.DeformStreamRequest(request_id=1, more=k < 4)
                if k == 0:
                    message.request.CopyFrom(self.request)
                message.request.designs.add(variables=[0.1, 0.2, 0.1])
                yield message
                time.sleep(1)

        replies = list(self.stub().DeformStream(requests(), timeout=30))
        self.assertEqual([reply.error.message for reply in replies if reply.HasField("error")], [])
        self.assertEqual(sum(reply.HasField("result") for reply in replies), 6)

    def test_streams_may_rest_between_requests(self):
        go_on = threading.Event()

        def requests():
            for k in range(2):
                yield deformation_pb2.DeformStreamRequest(request_id=k + 1, request=self.request)
                go_on.wait(6)

        self.assertEqual(sum(reply.HasField("summary") for reply in self.stub().DeformStream(requests(), timeout=30)), 2)

    def population(self):
        """400 designs, which are still one frame."""
        request = deformation_pb2.DeformRequest(system_id=self.system.id, output=dict(encoding=deformation_pb2.RAW_F64))
        request.designs.extend([deformation_pb2.Design(variables=[0.1, 0, 0])] * 400)
        return request.SerializeToString()

    def test_the_status_passes_the_answers_that_nobody_takes(self):
        """The window of HTTP/2 stays shut. A client that reads again learns that it may ask again, and why."""
        connection = http2.Connection(self.server.port)
        self.connections.append(connection)
        connection.send(call_frames(connection, "Deform", self.population()))
        trailers = connection.wait_for_end(connection.stream)
        self.assertIn(http2.text("grpc-status") + http2.text(str(grpc.StatusCode.UNAVAILABLE.value[0])), trailers)
        self.assertIn(b"the client took nothing of the answer for 2 s (--stall-timeout)", trailers)

    def test_answers_that_nobody_takes(self):
        """Populations, over connections with a small window; their memory is free again."""
        for _ in range(20):
            connection = small_window(self)
            connection.send(call_frames(connection, "Deform", self.population()))
        self.wait_for("deformd_memory_charged_bytes", lambda bytes: bytes > self.charged + 5 * MIB)
        self.wait_for("deformd_memory_charged_bytes", lambda bytes: bytes < self.charged + MIB)

    def test_large_answers_that_nobody_takes(self):
        ask_for_setups(self, 20)
        self.wait_for("deformd_requests_held_bytes", lambda bytes: bytes > 10 * MIB)
        self.wait_for("deformd_requests_held_bytes", lambda bytes: bytes < MIB)

    def wait_for(self, name, condition):
        deadline = time.monotonic() + 20
        while not condition(self.figure(name)):
            self.assertLess(time.monotonic(), deadline, f"{name} {self.figure(name)}")
            time.sleep(0.05)

    def setUp(self):
        super().setUp()
        self.charged = self.figure("deformd_memory_charged_bytes")


class Frames(Attack):
    """What no client library sends, to a server that listens on all addresses of this machine."""

    host = "0.0.0.0"
    options = ["--insecure"]

    def flood(self, make, connections=4, seconds=4.0, most=10_000_000):
        """Each connection sends what make(connection) gives until it is cut off or time is up."""

        def attack(_):
            connection = http2.Connection(self.server.port)
            self.connections.append(connection)
            end, sent = time.monotonic() + seconds, 0
            while time.monotonic() < end and sent < most:
                data = make(connection)
                if not connection.send(data) or connection.drop_replies():
                    return sent, True
                sent += len(data)
            return sent, False

        return in_threads(connections, attack)

    def begin_calls(self, method, message=None):
        """20,000 calls that say nothing more than that message."""
        headers, begun = http2.call_headers(method), []

        def call(stream):
            said = http2.frame(http2.HEADERS, http2.END_HEADERS, stream, headers)
            if message is not None:
                said += http2.frame(http2.DATA, http2.END_STREAM, stream, struct.pack(">BI", 0, len(message)) + message)
            return said

        for _ in range(20):
            connection = http2.Connection(self.server.port)
            self.connections.append(connection)
            begun.append(connection.send(b"".join(call(connection.next_stream()) for _ in range(1000))))
            time.sleep(0.2)
            connection.drop_replies()
        time.sleep(2)
        self.assertEqual(begun, [True] * 20)

    def test_streams_that_rest(self):
        self.begin_calls("DeformStream")

    def test_watches_of_health_that_rest(self):
        self.begin_calls("grpc.health.v1.Health/Watch", message=b"")

    def test_reflection_that_rests(self):
        self.begin_calls("grpc.reflection.v1alpha.ServerReflection/ServerReflectionInfo")
        with open(f"/proc/{self.server.process.pid}/status") as status:
            threads = next(int(line.split()[1]) for line in status if line.startswith("Threads"))
        self.assertLess(threads, 200)
        for connection in self.connections:
            connection.close()
        ask = self.channel().stream_stream("/grpc.reflection.v1alpha.ServerReflection/ServerReflectionInfo")
        list_services = b"\x3a\x01*"
        replies = until_answered(lambda: list(ask(iter([list_services]), timeout=10)), reconnects=3)
        self.assertIn(b"deform.v1.DeformService", replies[0])

    def flood_call(self, method, flags, frames):
        """Each connection begins one call, then sends what frames(connection) gives."""

        def make(connection):
            if connection.stream < 0:
                return http2.frame(http2.HEADERS, flags, connection.next_stream(), http2.call_headers(method))
            return frames(connection)

        self.flood(make)

    def test_streams_opened_and_reset(self):
        """90,000 calls that are cancelled in the same breath."""
        self.flood(lambda connection: http2.resets(connection, "GetServerInfo", 500), connections=3, seconds=8 if LONG else 4,
                   most=30_000 * 150)
        # The server may read the last calls after they were sent. What it reads first decides why a connection is closed.
        deadline = time.monotonic() + 10
        while self.figure("deformd_connections_cut_off_total") < 3 and time.monotonic() < deadline:
            time.sleep(0.1)
        closed = re.findall(r"connections: (\S+) is closed: (.*)", self.server.log_text())
        self.assertEqual(len(closed), 3, closed)
        self.assertEqual(len({peer for peer, _ in closed}), 3, closed)
        self.assertIn("it begins calls and resets them", [why for _, why in closed])

    def test_a_connection_that_resets_all_its_calls_is_closed(self):
        """Slowly enough to cost little: 100 calls every 20 ms."""
        connection = http2.Connection(self.server.port)
        self.connections.append(connection)
        for _ in range(500):
            if not connection.send(http2.resets(connection, "GetServerInfo", 100)) or connection.drop_replies():
                break
            time.sleep(0.02)
        else:
            self.fail("50,000 calls were taken")
        self.assertIn("it begins calls and resets them", self.server.log_text())
        self.assertEqual(self.figure("deformd_connections_cut_off_total"), 1)

    def test_calls_of_health_opened_and_reset(self):
        for closed_before, method in ((0, "Check"), (3, "Watch")):
            self.flood(lambda connection: http2.resets(connection, "grpc.health.v1.Health/" + method, 500), connections=3, seconds=4,
                       most=30_000 * 150)
            closed = re.findall(r"connections: (\S+) is closed: it begins calls and resets them", self.server.log_text())
            self.assertGreater(len(set(closed)), closed_before, method)

    def test_calls_of_no_method_opened_and_reset(self):
        self.flood(lambda connection: http2.resets(connection, "NoSuchMethod", 500), connections=3, seconds=4, most=30_000 * 150)

    def test_pings(self):
        self.flood(lambda _: http2.frame(http2.PING, 0, 0, bytes(8)) * 1000)

    def test_settings(self):
        self.flood(lambda _: http2.frame(http2.SETTINGS, 0, 0, struct.pack(">HI", 4, 65535)) * 1000)

    def test_headers_that_never_end(self):
        self.flood_call("GetServerInfo", 0, lambda connection: http2.frame(http2.CONTINUATION, 0, connection.stream,
                                                                           http2.literal("x-more", "y" * 8000)) * 8)

    def test_headers_that_never_end_and_say_nothing(self):
        self.flood_call("GetServerInfo", 0, lambda connection: http2.frame(http2.CONTINUATION, 0, connection.stream) * 1000)

    def test_one_header_a_thousand_times(self):
        """A header of 4 KB is remembered and then named by one byte each time."""
        def make(connection):
            stream = connection.next_stream()
            block = http2.call_headers("GetServerInfo") + http2.literal("x-bomb", "y" * 3900, indexed=True) + b"\xbe" * 12_000
            return http2.frame(http2.HEADERS, http2.END_HEADERS, stream, block)

        self.flood(make)

    def test_empty_data(self):
        self.flood_call("RegisterGeometry", http2.END_HEADERS,
                        lambda connection: http2.frame(http2.DATA, 0, connection.stream) * 1000)

    def test_priorities_and_windows(self):
        self.flood(lambda _: (http2.frame(http2.PRIORITY, 0, 1, struct.pack(">IB", 3, 1)) +
                              http2.frame(http2.WINDOW_UPDATE, 0, 0, struct.pack(">I", 1))) * 500)

    def test_messages_announced_and_not_sent(self):
        """The first bytes of messages of 4 MiB on 100 streams each of 20 connections."""
        head = b"\0" + struct.pack(">I", 4 * MIB - 1)
        for _ in range(20):
            connection = http2.Connection(self.server.port)
            self.connections.append(connection)
            for _ in range(100):
                stream = connection.next_stream()
                connection.send(http2.frame(http2.HEADERS, http2.END_HEADERS, stream, http2.call_headers("Estimate")) +
                                http2.frame(http2.DATA, 0, stream, head + bytes(600)))
        for connection in self.connections:
            if isinstance(connection, http2.Connection):
                connection.drop_replies()
        time.sleep(2)


if __name__ == "__main__":
    main()

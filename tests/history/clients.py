# SPDX-License-Identifier: GPL-3.0-or-later
"""Clients that do random things with few geometries and systems, and write down what they were told and when."""

import hashlib
import random
import threading
import time

import grpc
from google.protobuf import json_format

import decode
from checker import Operation
from deform.v1 import admin_pb2_grpc, deformation_pb2, geometry_pb2, service_pb2_grpc, setup_pb2
from wire_client import SETUP, Plate

SYSTEMS = 3  # of each geometry
CHANNEL = [("grpc.use_local_subchannel_pool", 1), ("grpc.enable_retries", 0)]
# Whether these were done is not known: the connection was lost, the time was over, or the server says that it failed.
UNKNOWN = {grpc.StatusCode.UNAVAILABLE, grpc.StatusCode.UNKNOWN, grpc.StatusCode.DEADLINE_EXCEEDED, grpc.StatusCode.CANCELLED,
           grpc.StatusCode.RESOURCE_EXHAUSTED}
DESIGNS = ([0.25, 0.5, -0.25], [-1.0, 0.0, 0.5])


class Geometry:
    """A plate with its setups, computed once."""

    def __init__(self, number):
        self.plate = Plate()
        self.plate.points = self.plate.points * (1 + 0.125 * number)
        self.name = f"plate {number}"
        self.messages = list(self.plate.messages(self.name))
        self.id = decode.geometry_id(self.messages)
        self.setups, self.systems = [], []
        for k in range(SYSTEMS):
            setup = json_format.ParseDict({"geometry": self.id, **SETUP, "seed": str(k)}, setup_pb2.Setup())
            setup.variables[0].translate[2] = 2 + k
            setup.variables[2].scale.centre[0] *= 1 + 0.125 * number
            self.setups.append(setup)
            self.systems.append(decode.system_id(decode.canonical_setup(setup, self.id, flat=False)))


class Tenant:
    """Who calls: a token and the name under which its geometries are told from those of others."""

    def __init__(self, name, token):
        self.name, self.token = name, token
        self.metadata = (("authorization", f"Bearer {token}"),)


class Record:
    """What all clients saw; what they did together."""

    def __init__(self):
        self.lock = threading.Lock()
        self.operations = []  # (object, Operation), the end of those that were not answered is when the client gave up
        self.answers = []     # (question, answer, who)
        self.counts = {}
        self.changing = threading.Event()  # a call that changes something has just begun

    def add(self, rows, answers, name):
        with self.lock:
            self.operations += rows
            self.answers += answers
            self.counts[name] = self.counts.get(name, 0) + 1


class Client(threading.Thread):
    """Makes one call after the other until it is stopped. What it decides depends on the seed alone."""

    def __init__(self, number, seed, tenant, geometries, address, record):
        super().__init__(daemon=True, name=f"client {number}")
        self.random = random.Random(f"{seed} client {number}")
        self.tenant, self.geometries, self.record = tenant, geometries, record
        self.address, self.channel = address, None
        self.connect()
        self.ending = threading.Event()
        self.failure = None

    def connect(self):
        """Anew: a channel waits for seconds before it tries again."""
        if self.channel:
            self.channel.close()
        self.channel = grpc.insecure_channel(self.address, CHANNEL)
        self.service = service_pb2_grpc.DeformServiceStub(self.channel)
        self.admin = admin_pb2_grpc.AdminStub(self.channel)

    def run(self):
        try:
            while not self.ending.wait(self.random.uniform(0, 0.01)):
                self.step()
        except Exception as error:  # told by the test
            self.failure = error
        finally:
            self.channel.close()

    def stop(self):
        self.ending.set()

    def step(self):
        kinds = {"register": 8, "get": 3, "list": 3, "delete": 2, "delete_all": 2, "points": 1, "prepare": 14, "estimate": 1, "system": 3,
                 "list_systems": 2, "deform": 12, "forget": 5, "release": 4}
        name = self.random.choices(list(kinds), list(kinds.values()))[0]
        geometry = self.random.choice(self.geometries)
        system = self.random.randrange(SYSTEMS)
        seconds = self.random.choice([0.002, 0.01, 0.05]) if self.random.random() < 0.08 else 3.0
        self.call(name, geometry, system, seconds)

    def call(self, name, geometry, system, seconds):
        """One call, and what it says about each object."""
        if name in ("register", "delete", "delete_all", "prepare", "forget"):
            self.record.changing.set()
        found, answers, start, certain, note = [], [], time.monotonic(), True, name
        try:
            for g, what in getattr(self, "do_" + name)(geometry, system, answers, {"timeout": seconds, "metadata": self.tenant.metadata}):
                found.append((g, what))
        except grpc.RpcError as error:
            note = f"{name}: {error.code().name}"
            if "failed to connect" in error.details():
                note = "not sent"
                self.ending.wait(0.01)
                self.connect()
            elif error.code() in UNKNOWN or (error.code() == grpc.StatusCode.INTERNAL and "RST_STREAM" in error.details()):
                found, certain = self.unknown(name, geometry, system), False
            else:
                found = self.refused(name, geometry, system, error)
        end = time.monotonic()
        who = self.name
        rows = [((self.tenant.name, g.id), Operation(who, what, start, end, certain, note)) for g, what in found]
        self.record.add(rows, [(question, answer, who) for question, answer in answers], note)

    @staticmethod
    def unknown(name, geometry, system):
        effects = {"register": ("register", None), "delete": ("delete", False, None), "delete_all": ("delete", True, None),
                   "prepare": ("prepare", system), "forget": ("forget", system)}
        return [(geometry, effects[name])] if name in effects else []

    @staticmethod
    def refused(name, geometry, system, error):
        code = error.code()
        if code == grpc.StatusCode.NOT_FOUND and name in ("get", "delete", "delete_all", "points", "prepare", "estimate", "list_systems"):
            return [(geometry, ("see", 1, False))]
        if code == grpc.StatusCode.NOT_FOUND and name in ("system", "deform", "forget", "release"):
            return [(geometry, ("see", 2 << system, False))]
        if code == grpc.StatusCode.FAILED_PRECONDITION and name == "delete":
            return [(geometry, ("refused",))]
        return [(geometry, ("never", f"{name}: {code.name}: {error.details()}"))]

    # ---- one function per kind of call: what its answer says, as pairs of a geometry and an operation ----

    def do_register(self, geometry, _system, answers, options):
        messages = [geometry_pb2.RegisterGeometryRequest.FromString(m.SerializeToString()) for m in geometry.messages]
        if self.random.random() < 0.5:
            messages[0].header.id = geometry.id
        info = self.service.RegisterGeometry(iter(messages), **options)
        return self.told(geometry, info, answers) + [(geometry, ("register", info.existed))]

    def told(self, geometry, info, answers):
        """What a description of a geometry says beside that it is there."""
        if info.damage:
            return [(geometry, ("never", info.damage))]
        answers.append((("geometry", info.id), (info.name, info.points, info.faces, info.corners, tuple(info.box_max),
                                                tuple((g.name, g.points, g.all_points) for g in info.groups))))
        return []

    def do_get(self, geometry, _system, answers, options):
        info = self.service.GetGeometry(geometry_pb2.GetGeometryRequest(id=geometry.id), **options)
        return [(geometry, ("see", 1, True)), (geometry, ("count", info.setups))] + self.told(geometry, info, answers)

    def do_list(self, _geometry, _system, answers, options):
        listed, token = {}, ""
        while True:
            reply = self.service.ListGeometries(geometry_pb2.ListGeometriesRequest(page_token=token), **options)
            listed.update((info.id, info) for info in reply.geometries)
            token = reply.next_page_token
            if not token:
                break
        found = []
        for geometry in self.geometries:
            info = listed.pop(geometry.id, None)
            found.append((geometry, ("see", 1, info is not None)))
            if info:
                found += self.told(geometry, info, answers)
        if listed:
            found.append((self.geometries[0], ("never", f"nobody registered {list(listed)}")))
        return found

    def do_delete(self, geometry, _system, _answers, options, force=False):
        reply = self.service.DeleteGeometry(geometry_pb2.DeleteGeometryRequest(id=geometry.id, with_setups=force), **options)
        return [(geometry, ("delete", force, reply.setups_deleted))]

    def do_delete_all(self, geometry, system, answers, options):
        return self.do_delete(geometry, system, answers, options, force=True)

    def do_points(self, geometry, _system, answers, options):
        chunks = self.service.GetPoints(geometry_pb2.GetPointsRequest(id=geometry.id), **options)
        points = b"".join(chunk.xyz for chunk in chunks)
        answers.append((("points", geometry.id), hashlib.sha256(points).digest()))
        return [(geometry, ("see", 1, True))]

    def do_prepare(self, geometry, system, answers, options):
        replies = list(self.service.Prepare(deformation_pb2.PrepareRequest(setup=geometry.setups[system]), **options))
        info = replies[-1].system
        answers.append((("prepared", geometry.id, system), (info.id, info.centres, info.points, info.condition)))
        return [(geometry, ("prepare", system))]

    def do_estimate(self, geometry, system, answers, options):
        reply = self.service.Estimate(deformation_pb2.EstimateRequest(setup=geometry.setups[system]), **options)
        answers.append((("estimate", geometry.id, system), (reply.system_id, reply.centres, reply.resident_bytes, reply.peak_bytes)))
        return [(geometry, ("see", 1, True))]

    def do_system(self, geometry, system, answers, options):
        info = self.service.GetSystem(deformation_pb2.GetSystemRequest(id=geometry.systems[system]), **options)
        answers.append((("prepared", geometry.id, system), (info.id, info.centres, info.points, info.condition)))
        return [(geometry, ("see", 2 << system, True))]

    def do_list_systems(self, geometry, _system, _answers, options):
        reply = self.service.ListSystems(deformation_pb2.ListSystemsRequest(geometry_id=geometry.id), **options)
        listed = {info.id for info in reply.systems}
        return [(geometry, ("see", 2 << k, geometry.systems[k] in listed)) for k in range(SYSTEMS)]

    def do_deform(self, geometry, system, answers, options):
        number = self.random.randrange(len(DESIGNS))
        request = deformation_pb2.DeformRequest(system_id=geometry.systems[system], designs=[dict(variables=DESIGNS[number])],
                                                output=dict(encoding=deformation_pb2.RAW_F64))
        replies = list(self.service.Deform(request, **options))
        kinds = [reply.WhichOneof("part") for reply in replies]
        if kinds != ["header", "block", "result", "summary"]:
            return [(geometry, ("never", f"a design of {kinds}"))]
        answers.append((("design", geometry.id, system, number), hashlib.sha256(replies[1].block.data).digest()))
        return [(geometry, ("see", 2 << system, True))]

    def do_forget(self, geometry, system, _answers, options):
        self.service.ReleaseSystem(deformation_pb2.ReleaseSystemRequest(id=geometry.systems[system], forget=True), **options)
        return [(geometry, ("forget", system))]

    def do_release(self, geometry, system, _answers, options):
        self.service.ReleaseSystem(deformation_pb2.ReleaseSystemRequest(id=geometry.systems[system]), **options)
        return [(geometry, ("see", 2 << system, True))]

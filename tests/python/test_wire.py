# SPDX-License-Identifier: GPL-3.0-or-later
"""The package against the second implementation of the wire contract (tests/wire), which is pure Python written from the .proto files."""

import numpy as np
import pytest

import deformd
import wire_client
from deform.v1 import deformation_pb2

DESIGNS = [[0.25, -0.5, 0.125], [-1, 2, 0.5], [0, 0, 0]]


class Wire(wire_client.TestCase):
    def runTest(self):
        """unittest wants a test; pytest takes those below."""


@pytest.fixture(scope="module")
def wire():
    Wire.setUpClass()
    yield Wire()
    Wire.doClassCleanups()


@pytest.fixture(scope="module")
def system(wire):
    client = deformd.Client(wire.server.address)
    plate = wire.plate
    geometry = client.register((plate.points, plate.faces, {"left": plate.left, "right": plate.right}), name="plate")
    return client.prepare(wire_client.SETUP, geometry)


def test_ids_are_those_of_the_contract(wire, system):
    assert system.geometry.id == wire.geometry.id
    assert system.id == wire.system.id


@pytest.mark.parametrize("encoding", ["RAW_F64", "RAW_F32", "DELTA_ZSTD", "DRACO"])
def test_points_have_the_bits_that_the_contract_defines(wire, system, encoding):
    expected = wire.deform(DESIGNS, deformation_pb2.Encoding.Value(encoding), 1e-6)
    population = system.deform(DESIGNS, encoding=encoding, tolerance=1e-6)
    assert len(expected) == len(DESIGNS)
    for i, design in enumerate(expected):
        np.testing.assert_array_equal(population.points[i], design.points)
        assert population.reports[i].checksum == design.result.checksum
        assert population.reports[i].max_error == design.result.max_error


def test_reports_have_every_field(wire, system):
    message = wire.deform([[0.25, -0.5, 0.125]])[0].result
    report = system.deform([0.25, -0.5, 0.125]).report
    for field in message.DESCRIPTOR.fields:
        if field.name in ("verdict", "error", "reasons"):
            continue  # as properties of their own
        value = getattr(message, field.name)
        if field.message_type is None:
            assert getattr(report, field.name) == (tuple(value) if field.label == field.LABEL_REPEATED else
                                                   field.enum_type.values_by_number[value].name if field.enum_type else value), field.name
        else:
            assert (getattr(report, field.name) is None) == (not message.HasField(field.name)), field.name
    assert report.faces.faces == message.faces.faces


def test_info_has_every_field(wire, system):
    assert {field.name for field in wire.system.DESCRIPTOR.fields} <= set(dir(system.info))
    assert system.info.setup.to_dict()["handles"][0]["region"]["group"] == "right"
    assert [variable.name for variable in wire.system.setup.variables] == list(system.names)

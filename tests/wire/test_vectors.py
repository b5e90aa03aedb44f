# SPDX-License-Identifier: GPL-3.0-or-later
"""The test vectors, read by the second implementation of the contract."""

import base64
import json
import os
import unittest

import numpy
from google.protobuf import json_format

import decode
from deform.v1 import deformation_pb2, geometry_pb2, setup_pb2

FOLDER = os.path.join(os.path.dirname(os.path.abspath(__file__)), "vectors")


def read(name):
    with open(os.path.join(FOLDER, name)) as file:
        return json.load(file)


def numbers(text, kind="<f8"):
    return numpy.frombuffer(base64.b64decode(text), kind).reshape(-1, 3)


def message(kind, text):
    return kind.FromString(base64.b64decode(text))


def same_bits(a, b):
    return a.astype("<f8").tobytes() == b.astype("<f8").tobytes()


class Checksums(unittest.TestCase):
    def test_known_answers_of_xxh64(self):
        # As xxhsum -H64 prints them.
        self.assertEqual(decode.xxh64(b""), 0xEF46DB3751D8E999)
        self.assertEqual(decode.xxh64(b"a"), 0xD24EC4F1A98C6E5B)
        self.assertEqual(decode.xxh64(b"abc"), 0x44BC2CF5AD770999)
        self.assertEqual(decode.xxh64(b"Call me Ishmael. Some years ago--never mind how long precisely-"), 0x02A2E85470D6FD96)


class Blocks(unittest.TestCase):
    def check(self, case):
        block = message(deformation_pb2.Block, case["block"])
        registered, computed = numbers(case["registered"]), numbers(case["computed"])
        asked = deformation_pb2.Encoding.Value(case["requested"])
        self.assertEqual(block.encoding, deformation_pb2.RAW_F64 if block.fell_back else asked)
        if "integers" in case:
            integers = decode.integers_of(block)
            self.assertEqual(integers.astype("<i4").tobytes(), base64.b64decode(case["integers"]))
            self.assertTrue((integers[0] == 0).all())
            self.assertLessEqual(block.max_error, case["tolerance"])
        points = decode.decode_block(block, registered)
        self.assertTrue(same_bits(points, numbers(case["decoded"])))
        if block.encoding == deformation_pb2.RAW_F64:
            self.assertTrue(same_bits(points, computed))
        with numpy.errstate(over="ignore"):
            errors = abs(points - computed)
        self.assertEqual(errors[numpy.isfinite(errors)].max(), block.max_error)

    def check_file(self, name):
        cases = read(name)
        for case in cases:
            with self.subTest(case["name"]):
                self.check(case)
        return {case["name"]: message(deformation_pb2.Block, case["block"]).fell_back for case in cases}

    def test_raw_f64(self):
        self.assertFalse(any(self.check_file("blocks_raw_f64.json").values()))

    def test_raw_f32(self):
        fell_back = self.check_file("blocks_raw_f32.json")
        self.assertEqual([name for name, true in fell_back.items() if true], ["extremes"])

    def test_draco(self):
        fell_back = self.check_file("blocks_draco.json")
        self.assertEqual([name for name, true in fell_back.items() if true],
                         ["too_wide_for_draco", "widest_range", "too_wide", "too_strict"])

    def test_delta_zstd(self):
        fell_back = self.check_file("blocks_delta_zstd.json")
        self.assertEqual([name for name, true in fell_back.items() if true], ["too_wide", "too_strict"])

    def test_damage_is_noticed(self):
        for name in ("blocks_raw_f64.json", "blocks_raw_f32.json", "blocks_draco.json", "blocks_delta_zstd.json"):
            case = read(name)[0]
            block = message(deformation_pb2.Block, case["block"])
            block.checksum ^= 1
            with self.subTest(name), self.assertRaises(decode.Damaged):
                decode.decode_block(block, numbers(case["registered"]))


class Encoders(unittest.TestCase):
    """What the contract says about the server's encoder, although a decoder need not know it."""

    def test_grid(self):
        for case in read("blocks_delta_zstd.json"):
            block = message(deformation_pb2.Block, case["block"])
            registered, computed = numbers(case["registered"]), numbers(case["computed"])
            slack = 16 * 2.0**-53 * max(abs(registered).max(), abs(computed).max())
            step = 2 * (case["tolerance"] - slack)
            grid = numpy.rint((computed - registered) * (1 / step))
            integers = grid - grid[0]
            fits = case["tolerance"] > 2 * slack and abs(integers).max() <= 2**29
            with self.subTest(case["name"]):
                self.assertEqual(block.fell_back, not fits)
                if fits:
                    self.assertEqual(block.step, step)
                    self.assertEqual(list(block.offset), list(grid[0]))
                    self.assertTrue((decode.integers_of(block) == integers).all())

    def test_draco_is_for_small_differences(self):
        for case, delta in zip(read("blocks_draco.json"), read("blocks_delta_zstd.json")):
            block = message(deformation_pb2.Block, case["block"])
            other = message(deformation_pb2.Block, delta["block"])
            suits = not other.fell_back
            if suits:
                differences = numpy.diff(numbers(delta["integers"], "<i4").astype(numpy.int64), axis=0)
                suits = abs(differences).max(initial=0) < 2**19
            with self.subTest(case["name"]):
                self.assertEqual(block.fell_back, not suits)
                if suits:
                    self.assertEqual(block.checksum, other.checksum)

    def test_single_precision_rounds_to_even(self):
        for case in read("blocks_raw_f32.json"):
            block = message(deformation_pb2.Block, case["block"])
            if not block.fell_back:
                self.assertEqual(block.data, numbers(case["computed"]).astype("<f4").tobytes())


class Replies(unittest.TestCase):
    def setUp(self):
        self.case = read("replies.json")
        self.replies = [message(deformation_pb2.DeformReply, text) for text in self.case["replies"]]

    def decoded(self, replies):
        return decode.decode_replies(replies, lambda geometry: numbers(self.case["registered"]))

    def test_designs_arrive(self):
        _, designs, _ = self.decoded(self.replies)
        self.assertEqual([design.result.HasField("error") for design in designs], [False, True, False])
        for design, text in zip(designs, self.case["computed"]):
            if not design.result.HasField("error"):
                self.assertLessEqual(abs(design.points - numbers(text)).max(), self.case["tolerance"])

    def test_what_is_missing_is_noticed(self):
        for left_out in range(len(self.replies)):
            with self.subTest(left_out), self.assertRaises(decode.Damaged):
                self.decoded(self.replies[:left_out] + self.replies[left_out + 1:])


class Ids(unittest.TestCase):
    def test_geometries(self):
        for case in read("uploads.json"):
            messages = [message(geometry_pb2.RegisterGeometryRequest, text) for text in case["messages"]]
            with self.subTest(case["name"]):
                self.assertEqual(decode.geometry_id(messages), case["id"])

    def test_setups(self):
        for case in read("setups.json"):
            setup = json_format.ParseDict(case["setup"], setup_pb2.Setup())
            canonical = decode.canonical_setup(setup, case["geometry"], case["flat"])
            with self.subTest(case["name"]):
                expected = message(setup_pb2.Setup, case["canonical"])
                self.assertEqual(json_format.MessageToDict(canonical), json_format.MessageToDict(expected))
                self.assertEqual(decode.canonical_bytes(canonical), base64.b64decode(case["canonical"]))
                self.assertEqual(decode.system_id(canonical), case["id"])

    def test_a_canonical_setup_stays_as_it_is(self):
        for case in read("setups.json"):
            canonical = message(setup_pb2.Setup, case["canonical"])
            with self.subTest(case["name"]):
                self.assertEqual(decode.canonical_setup(canonical, case["geometry"], case["flat"]), canonical)

    def test_unknown_fields_do_not_count(self):
        case = read("setups.json")[0]
        setup = json_format.ParseDict(case["setup"], setup_pb2.Setup())
        unknown = setup_pb2.Setup.FromString(setup.SerializeToString() + b"\xf8\x3f\x01")  # field 1023: 1
        self.assertEqual(decode.system_id(decode.canonical_setup(unknown, case["geometry"], case["flat"])), case["id"])


if __name__ == "__main__":
    unittest.main(verbosity=2)

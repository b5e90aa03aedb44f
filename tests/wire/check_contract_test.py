# SPDX-License-Identifier: GPL-3.0-or-later
"""check_contract.py finds every kind of breach, and nothing else."""

import unittest

from google.protobuf import descriptor_pb2, text_format

import check_contract

SET = """
file {
  name: "a.proto" package: "p"
  message_type {
    name: "M"
    field { name: "a" number: 1 type: TYPE_UINT32 label: LABEL_OPTIONAL }
    field { name: "b" number: 2 type: TYPE_DOUBLE label: LABEL_REPEATED }
    field { name: "c" number: 3 type: TYPE_STRING label: LABEL_OPTIONAL oneof_index: 0 }
    field { name: "d" number: 4 type: TYPE_MESSAGE type_name: ".p.M.N" label: LABEL_OPTIONAL }
    nested_type { name: "N" }
    oneof_decl { name: "kind" }
    reserved_range { start: 7 end: 8 }
    reserved_name: "old"
  }
  enum_type { name: "E" value { name: "ZERO" number: 0 } value { name: "ONE" number: 1 } }
  service { name: "S" method { name: "Call" input_type: ".p.M" output_type: ".p.M" server_streaming: true } }
}
"""


def contract(change=lambda text: text):
    return check_contract.contract_of(text_format.Parse(change(SET), descriptor_pb2.FileDescriptorSet()))


class CheckContract(unittest.TestCase):
    def after(self, old, new):
        self.assertIn(old, SET)
        return list(check_contract.breaches(contract(), contract(lambda text: text.replace(old, new))))

    def test_nothing_has_changed(self):
        self.assertEqual(self.after("p", "p"), [])

    def test_additions_are_allowed(self):
        self.assertEqual(self.after('nested_type { name: "N" }', 'nested_type { name: "N" } nested_type { name: "O" }\n'
                                    'field { name: "e" number: 5 type: TYPE_BOOL label: LABEL_OPTIONAL }'), [])
        self.assertEqual(self.after('value { name: "ONE"', 'value { name: "TWO" number: 2 } value { name: "ONE"'), [])

    def test_a_field_must_stay(self):
        gone = self.after('field { name: "a" number: 1 type: TYPE_UINT32 label: LABEL_OPTIONAL }', "")
        self.assertEqual(gone, ['message p.M: "uint32 a" is gone, its number 1 must be reserved',
                                'message p.M: "uint32 a" is gone, its name must be reserved'])
        self.assertEqual(self.after('field { name: "a" number: 1 type: TYPE_UINT32 label: LABEL_OPTIONAL }',
                                    'reserved_range { start: 1 end: 2 } reserved_name: "a"'), [])

    def test_types_names_and_presence_must_stay(self):
        for old, new in (("TYPE_UINT32", "TYPE_UINT64"), ('name: "a"', 'name: "z"'), ("LABEL_REPEATED", "LABEL_OPTIONAL"),
                         ("LABEL_REPEATED", "LABEL_REPEATED options { packed: false }"), ("oneof_index: 0", ""),
                         ("TYPE_UINT32 label: LABEL_OPTIONAL", "TYPE_UINT32 label: LABEL_OPTIONAL oneof_index: 0 proto3_optional: true"),
                         ('".p.M.N"', '".p.M"'), ('name: "ONE"', 'name: "UN"')):
            with self.subTest(new):
                self.assertEqual(len(self.after(old, new)), 1)

    def test_reserved_stays_reserved(self):
        self.assertEqual(self.after("reserved_range { start: 7 end: 8 }", ""), ["message p.M: the number 7 is no longer reserved"])
        self.assertEqual(self.after('reserved_name: "old"', ""), ["message p.M: the name old is no longer reserved"])

    def test_values_messages_and_calls_must_stay(self):
        self.assertEqual(len(self.after('value { name: "ONE" number: 1 }', "")), 2)
        self.assertEqual(self.after('nested_type { name: "N" }', ""), ["message p.M.N is gone"])
        self.assertEqual(self.after('name: "E"', 'name: "F"'), ["enum p.E is gone"])
        self.assertEqual(self.after('name: "Call"', 'name: "Cull"'), ["call p.S/Call is gone"])
        self.assertEqual(len(self.after("server_streaming: true", "")), 1)


if __name__ == "__main__":
    unittest.main()

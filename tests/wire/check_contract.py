#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""Compares the messages, enums and calls of the wire contract with a snapshot, so that no number ever means something else.

usage: check_contract.py [--update] DESCRIPTORS SNAPSHOT     prints what is wrong; exit code 1 when anything is

DESCRIPTORS is what protoc --include_imports --descriptor_set_out writes. What the snapshot has must still be there as it is: fields with
their numbers, names, types and presence, enum values, calls. A field or value that goes leaves its number and its name reserved. What is
new must be added to the snapshot by --update, which refuses as long as anything else is wrong.
"""
import json
import sys

from google.protobuf import descriptor_pb2

Field = descriptor_pb2.FieldDescriptorProto


def field_text(field, oneofs):
    """What the bytes, the JSON form and the generated code of a field depend on."""
    kind = field.type_name.lstrip(".") or Field.Type.Name(field.type).removeprefix("TYPE_").lower()
    if field.label == Field.LABEL_REPEATED:
        packed = field.options.packed if field.options.HasField("packed") else True
        kind = "repeated " + kind + ("" if packed else " unpacked")
    elif field.proto3_optional:
        kind = "optional " + kind
    elif field.HasField("oneof_index"):
        kind = f"oneof {oneofs[field.oneof_index].name}: {kind}"
    return f"{kind} {field.name}"


def numbers_in(ranges, inclusive):
    return [number for r in ranges for number in range(r.start, r.end + inclusive)]


def add_enum(enum, scope, contract):
    contract["enums"][scope + enum.name] = {
        "values": {str(value.number): value.name for value in enum.value},
        "reserved": numbers_in(enum.reserved_range, 1),
        "reserved_names": sorted(enum.reserved_name)}


def add_message(message, scope, contract):
    name = scope + message.name
    contract["messages"][name] = {
        "fields": {str(field.number): field_text(field, message.oneof_decl) for field in message.field},
        "reserved": numbers_in(message.reserved_range, 0),
        "reserved_names": sorted(message.reserved_name)}
    for inner in message.nested_type:
        add_message(inner, name + ".", contract)
    for enum in message.enum_type:
        add_enum(enum, name + ".", contract)


def contract_of(descriptors):
    contract = {"messages": {}, "enums": {}, "calls": {}}
    for file in descriptors.file:
        scope = file.package + "."
        for message in file.message_type:
            add_message(message, scope, contract)
        for enum in file.enum_type:
            add_enum(enum, scope, contract)
        for service in file.service:
            for call in service.method:
                streams = ["stream " if on else "" for on in (call.client_streaming, call.server_streaming)]
                contract["calls"][f"{scope}{service.name}/{call.name}"] = (
                    f"({streams[0]}{call.input_type.lstrip('.')}) returns ({streams[1]}{call.output_type.lstrip('.')})")
    return contract


def changes(kind, name, old, new):
    """What is wrong with an entry that both have."""
    what = "fields" if "fields" in old else "values"
    for number, text in old[what].items():
        if number in new[what]:
            if new[what][number] != text:
                yield f"{kind} {name}, number {number}: was \"{text}\", is \"{new[what][number]}\""
        else:
            if int(number) not in new["reserved"]:
                yield f"{kind} {name}: \"{text}\" is gone, its number {number} must be reserved"
            if text.split()[-1] not in new["reserved_names"]:
                yield f"{kind} {name}: \"{text}\" is gone, its name must be reserved"
    for number in set(old["reserved"]) - set(new["reserved"]):
        yield f"{kind} {name}: the number {number} is no longer reserved"
    for text in set(old["reserved_names"]) - set(new["reserved_names"]):
        yield f"{kind} {name}: the name {text} is no longer reserved"


def breaches(old, new):
    """Changes that are never allowed."""
    for kind in ("messages", "enums"):
        for name, entry in old[kind].items():
            if name in new[kind]:
                yield from changes(kind[:-1], name, entry, new[kind][name])
            else:
                yield f"{kind[:-1]} {name} is gone"
    for name, text in old["calls"].items():
        if name not in new["calls"]:
            yield f"call {name} is gone"
        elif new["calls"][name] != text:
            yield f"call {name}: was {text}, is {new['calls'][name]}"


def main(arguments):
    update = arguments[:1] == ["--update"]
    descriptors_path, snapshot_path = arguments[update:]
    with open(descriptors_path, "rb") as file:
        new = contract_of(descriptor_pb2.FileDescriptorSet.FromString(file.read()))
    with open(snapshot_path) as file:
        old = json.load(file)
    found = sorted(breaches(old, new))
    if not found and new != old:
        if update:
            with open(snapshot_path, "w") as file:
                file.write(json.dumps(new, indent=1) + "\n")
        else:
            found.append("the contract has additions: check_contract.py --update adds them to the snapshot")
    for line in found:
        print(line)
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

# SPDX-License-Identifier: GPL-3.0-or-later
"""A second implementation of what the wire contract says about bytes, written from the comments in proto/deform/v1 alone: checksums, blocks
of every encoding, ids of geometries and of systems. It shares nothing with the C++ code; Zstandard's own library decompresses, Draco's
entropy coder is read here, by the bitstream specification of that project."""

import hashlib
import struct

import numpy
import zstandard

from deform.v1 import deformation_pb2, setup_pb2


class Damaged(Exception):
    """Bytes that are not what the contract says."""


def expect(truth, what):
    if not truth:
        raise Damaged(what)


# ---- checksums ----

MASK = (1 << 64) - 1
PRIMES = (11400714785074694791, 14029467366897019727, 1609587929392839161, 9650029242287828579, 2870177450012600261)


def rotated(x, bits):
    return (x << bits | x >> (64 - bits)) & MASK


def xxh64(data):
    """XXH64 with seed 0."""
    p1, p2, p3, p4, p5 = PRIMES
    data = bytes(data)

    def mixed(lane, value):
        return rotated((lane + value * p2) & MASK, 31) * p1 & MASK

    at = 0
    if len(data) >= 32:
        lanes = [(p1 + p2) & MASK, p2, 0, -p1 & MASK]
        for at in range(0, len(data) - 31, 32):
            lanes = [mixed(lane, value) for lane, value in zip(lanes, struct.unpack_from("<4Q", data, at))]
        at += 32
        result = sum(rotated(lane, bits) for lane, bits in zip(lanes, (1, 7, 12, 18))) & MASK
        for lane in lanes:
            result = ((result ^ mixed(0, lane)) * p1 + p4) & MASK
    else:
        result = p5
    result = (result + len(data)) & MASK
    while at + 8 <= len(data):
        result = (rotated(result ^ mixed(0, struct.unpack_from("<Q", data, at)[0]), 27) * p1 + p4) & MASK
        at += 8
    if at + 4 <= len(data):
        result = (rotated(result ^ struct.unpack_from("<I", data, at)[0] * p1 & MASK, 23) * p2 + p3) & MASK
        at += 4
    for byte in data[at:]:
        result = rotated(result ^ byte * p5 & MASK, 11) * p1 & MASK
    result = (result ^ result >> 33) * p2 & MASK
    result = (result ^ result >> 29) * p3 & MASK
    return result ^ result >> 32


def design_checksum(blocks):
    """The checksum of the checksums of the blocks, in their order."""
    return xxh64(b"".join(struct.pack("<Q", checksum) for checksum in blocks))


# ---- blocks ----

def from_zigzag(unsigned):
    unsigned = unsigned.astype(numpy.int64)
    return numpy.where(unsigned % 2 == 0, unsigned // 2, -(unsigned + 1) // 2)


def delta_integers(data, count):
    """The integers of a DELTA_ZSTD block, count x 3."""
    size = zstandard.frame_content_size(data)
    expect(size == 12 * count, f"the frame says {size} bytes, {count} points take {12 * count}")
    content = zstandard.ZstdDecompressor().decompress(data)
    planes = numpy.frombuffer(content, numpy.uint8).reshape(3, 4, count).astype(numpy.int64)
    unsigned = planes[:, 0] + (planes[:, 1] << 8) + (planes[:, 2] << 16) + (planes[:, 3] << 24)
    return numpy.cumsum(from_zigzag(unsigned), axis=1).astype(numpy.uint32).astype(numpy.int32).T


class Reader:
    """Bytes from the front."""

    def __init__(self, data):
        self.data, self.at = data, 0

    def bytes(self, count):
        expect(self.at + count <= len(self.data), "the data ends too early")
        self.at += count
        return self.data[self.at - count:self.at]

    def byte(self):
        return self.bytes(1)[0]

    def varint(self):
        value, shift = 0, 0
        while True:
            byte = self.byte()
            value |= (byte & 127) << shift
            shift += 7
            if byte < 128:
                return value


class RansDecoder:
    """Draco's entropy coder: a table of probabilities, then symbols from the back of a string of bytes."""

    def __init__(self, reader, symbol_bits):
        self.bits = min(max(3 * symbol_bits // 2, 12), 20)
        self.precision = 1 << self.bits
        probabilities = []
        count = reader.varint()
        while len(probabilities) < count:
            byte = reader.byte()
            if byte & 3 == 3:
                probabilities += [0] * ((byte >> 2) + 1)
                continue
            probability = byte >> 2
            for extra in range(byte & 3):
                probability |= reader.byte() << (8 * extra + 6)
            probabilities.append(probability)
        expect(len(probabilities) == count and sum(probabilities) == self.precision, "the probabilities do not add up")
        self.starts = numpy.cumsum([0] + probabilities)
        self.probabilities = probabilities
        self.stream = reader.bytes(reader.varint())
        length = (self.stream[-1] >> 6) + 1
        self.at = len(self.stream) - length
        state = int.from_bytes(self.stream[self.at:], "little") & ((1 << (8 * length - 2)) - 1)
        self.state = state + 4 * self.precision

    def symbol(self):
        while self.state < 4 * self.precision and self.at > 0:
            self.at -= 1
            self.state = self.state * 256 + self.stream[self.at]
        quotient, remainder = divmod(self.state, self.precision)
        symbol = int(numpy.searchsorted(self.starts, remainder, side="right")) - 1
        self.state = quotient * self.probabilities[symbol] + remainder - int(self.starts[symbol])
        return symbol


def draco_symbols(reader, count):
    """3 x count symbols, point by point."""
    scheme = reader.byte()
    expect(scheme in (0, 1), "an unknown way of coding symbols")
    if scheme == 1:
        decoder = RansDecoder(reader, reader.byte())
        return [decoder.symbol() for _ in range(3 * count)]
    decoder = RansDecoder(reader, 5)
    sizes = [decoder.symbol() for _ in range(count)]
    bits = 3 * sum(sizes)
    number = int.from_bytes(reader.bytes((bits + 7) // 8), "little")
    symbols = []
    for size in sizes:
        for _ in range(3):
            symbols.append(number & ((1 << size) - 1))
            number >>= size
    return symbols


def draco_integers(data, count):
    """The integers of a DRACO block, count x 3."""
    header = b"DRACO" + bytes([2, 3, 0, 0, 0, 0]) + struct.pack("<I", count) + bytes([1, 1, 4, 5, 3, 0, 0, 1, 0, 1, 1])
    expect(data[:len(header)] == header, "the header is not that of the contract")
    reader = Reader(data[len(header):])
    corrections = from_zigzag(numpy.array(draco_symbols(reader, count), numpy.int64)).reshape(count, 3)
    least, largest = struct.unpack("<ii", reader.bytes(8))
    expect(reader.at == len(reader.data), "bytes are left over")
    span = largest - least + 1
    integers = numpy.zeros((count, 3), numpy.int64)
    before = numpy.zeros(3, numpy.int64)
    for i in range(count):
        value = numpy.clip(before, least, largest) + corrections[i]
        value = numpy.where(value > largest, value - span, numpy.where(value < least, value + span, value))
        integers[i] = before = value
    return integers.astype(numpy.int32)


def integers_of(block):
    decoders = {deformation_pb2.DELTA_ZSTD: delta_integers, deformation_pb2.DRACO: draco_integers}
    return decoders[block.encoding](block.data, block.count)


def decode_block(block, registered):
    """The points of a block, count x 3 doubles, from its registered points; refuses what the contract does not allow."""
    expect(1 <= block.count <= 65536 and registered.shape == (block.count, 3), "another number of points")
    if block.encoding in (deformation_pb2.RAW_F64, deformation_pb2.RAW_F32):
        expect(block.step == 0 and not block.offset, "a raw block has neither step nor offset")
        expect(xxh64(block.data) == block.checksum, "the checksum does not match")
        kind = "<f8" if block.encoding == deformation_pb2.RAW_F64 else "<f4"
        expect(len(block.data) == 3 * numpy.dtype(kind).itemsize * block.count, "another number of bytes")
        return numpy.frombuffer(block.data, kind).reshape(block.count, 3).astype(numpy.float64)
    expect(block.step >= numpy.finfo(numpy.float64).tiny and numpy.isfinite(block.step), "the step is out of range")
    expect(len(block.offset) == 3 and all(abs(o) <= 1 << 51 for o in block.offset), "an offset is out of range")
    integers = integers_of(block)
    expect(xxh64(integers.astype("<i4").tobytes()) == block.checksum, "the checksum does not match")
    return registered + (integers + numpy.array(block.offset, numpy.float64)) * block.step


class Design:
    def __init__(self, points):
        self.points = numpy.empty((points, 3))
        self.known, self.checksums, self.max_error, self.result = 0, [], 0.0, None


def decode_replies(replies, points_of):
    """Header, designs and summary of one request; points_of(geometry id) gives the registered points, n x 3."""
    header, summary, designs, registered = None, None, [], None
    for reply in replies:
        part = reply.WhichOneof("part")
        expect((header is None) == (part == "header"), "the header comes first, once")
        expect(summary is None, "the summary comes last")
        if part == "header":
            header = reply.header
            registered = points_of(header.geometry_id)
            expect(len(registered) == header.points, "another number of points")
            designs = [Design(header.points) for _ in range(header.designs)]
        elif part == "block":
            block, design = reply.block, designs[reply.block.design]
            expect(design.result is None, "a block after the result of its design")
            expect(block.first == design.known and block.block == len(design.checksums), "blocks ascend")
            end = block.first + block.count
            expect(block.count == header.block_points or end == header.points, "only the last block is smaller")
            design.points[block.first:end] = decode_block(block, registered[block.first:end])
            design.known = end
            design.checksums.append(block.checksum)
            design.max_error = max(design.max_error, block.max_error)
        elif part == "result":
            result, design = reply.result, designs[reply.result.design]
            expect(design.result is None, "two results of a design")
            design.result = result
            if result.HasField("error"):
                expect(design.known == 0, "a design with blocks and an error")
                continue
            expect(design.known == header.points, "points are missing")
            expect(result.checksum == design_checksum(design.checksums), "the checksum of a design does not match")
            expect(result.max_error == design.max_error, "the error is not that of the blocks")
        else:
            expect(part == "summary", "an empty reply")
            summary = reply.summary
    expect(summary is not None and all(design.result for design in designs), "something is missing")
    return header, designs, summary


# ---- geometry ids ----

def counted(data, size):
    return struct.pack("<Q", len(data) // size) + data


def upload_arrays(messages):
    """The arrays of an upload: header, bytes by name, groups."""
    expect(messages[0].WhichOneof("part") == "header", "the header comes first")
    header = messages[0].header
    arrays = {name: b"" for name in ("xyz", "sizes", "corners", "element_types", "element_points", "face_sizes", "face_points", "owners",
                                     "neighbours", "empty_faces")}
    groups, order, stage = [], ("points", "faces", "group", "cells"), 0
    for message in messages[1:]:
        part = message.WhichOneof("part")
        expect(order.index(part) >= stage, "chunks come in order")
        stage = order.index(part)
        chunk = getattr(message, part)
        if part == "group":
            if chunk.name:
                groups.append([chunk.name, b"", b""])
            groups[-1][1] += chunk.points
            groups[-1][2] += chunk.faces
            continue
        for field, data in chunk.ListFields():
            arrays[field.name] += data
    counts = header.cells
    sizes = {"xyz": 24 * header.point_count, "sizes": 4 * header.face_count, "corners": 4 * header.corner_count,
             "element_types": counts.elements, "element_points": 4 * counts.element_points, "face_sizes": 4 * counts.faces,
             "face_points": 4 * counts.face_points, "owners": 4 * counts.faces, "neighbours": 4 * counts.internal_faces,
             "empty_faces": counts.faces if counts.empty_faces else 0}
    expect(sizes == {name: len(data) for name, data in arrays.items()}, "the arrays are not those of the header")
    expect(len(groups) == header.group_count, "another number of groups")
    return header, arrays, groups


def geometry_id(messages):
    """The id of the geometry that these messages of RegisterGeometry upload."""
    header, arrays, groups = upload_arrays(messages)
    with_cells = header.cells.elements > 0 or header.cells.cells > 0
    content = (b"deform.geometry.2\0" if with_cells else b"deform.geometry.1\0")
    content += counted(arrays["xyz"], 24) + counted(arrays["sizes"], 4) + counted(arrays["corners"], 4)
    content += struct.pack("<Q", len(groups))
    for name, points, faces in groups:
        content += counted(name.encode(), 1) + counted(points, 4) + counted(faces, 4)
    if with_cells:
        offsets = b""
        if header.cells.faces > 0:
            sizes = numpy.frombuffer(arrays["face_sizes"], "<u4")
            offsets = numpy.concatenate([[0], numpy.cumsum(sizes)]).astype("<u8").tobytes()
        content += counted(arrays["element_types"], 1) + counted(arrays["element_points"], 4)
        content += struct.pack("<Q", header.cells.cells) + counted(offsets, 8)
        for name in ("face_points", "owners", "neighbours"):
            content += counted(arrays[name], 4)
        content += counted(arrays["empty_faces"], 1)
    return hashlib.sha256(content).hexdigest()


# ---- system ids ----

SHAPED = (setup_pb2.GAUSSIAN, setup_pb2.MULTIQUADRIC, setup_pb2.INVERSE_MULTIQUADRIC, setup_pb2.WENDLAND_C2)


def instead_of_zero(message, field, value):
    if getattr(message, field) == 0:
        setattr(message, field, value)


def canonical_rbf(rbf, flat):
    instead_of_zero(rbf, "kernel", setup_pb2.THIN_PLATE if flat else setup_pb2.TRIHARMONIC)
    if rbf.kernel not in SHAPED:
        rbf.shape = 0
    instead_of_zero(rbf, "shape", 0)
    stored = rbf.HasField("polynomial_degree") and (rbf.reduction_rings != 0 or rbf.reduction_tolerance != 0)
    by_spacing = rbf.kernel in (setup_pb2.GAUSSIAN, setup_pb2.MULTIQUADRIC, setup_pb2.INVERSE_MULTIQUADRIC) and rbf.shape == 0
    if not by_spacing or rbf.automatic_shape == setup_pb2.SHAPE_OF_MEDIAN:
        rbf.automatic_shape = setup_pb2.AUTOMATIC_SHAPE_DEFAULT
    elif not stored:
        rbf.automatic_shape = setup_pb2.SHAPE_OF_DENSEST
    if not rbf.HasField("polynomial_degree"):
        rbf.polynomial_degree = 2 if rbf.kernel == setup_pb2.QUINTIC else 1
    incremental = rbf.solver == setup_pb2.INCREMENTAL_QR
    if incremental:
        instead_of_zero(rbf, "tolerance", 1e-4)
    elif rbf.solver in (setup_pb2.ITERATIVE, setup_pb2.SOLVER_AUTOMATIC):
        instead_of_zero(rbf, "tolerance", 1e-6)
    else:
        rbf.tolerance = 0
    if not incremental:
        del rbf.samples[:]
    if not incremental or rbf.centre_order == setup_pb2.FARTHEST_POINT:
        rbf.centre_order = setup_pb2.CENTRE_ORDER_DEFAULT
    canonical_basis(rbf)
    if rbf.reduction == setup_pb2.REDUCTION_AUTOMATIC and rbf.reduction_rings == 0:
        rbf.reduction = setup_pb2.REDUCTION_TOLERANCE
    if incremental and rbf.reduction == setup_pb2.REDUCTION_TOLERANCE:
        rbf.reduction = setup_pb2.REDUCTION_OFF
    if rbf.reduction == setup_pb2.REDUCTION_TOLERANCE:
        rbf.reduction_rings = 0
        instead_of_zero(rbf, "reduction_tolerance", 1e-3 if rbf.kernel == setup_pb2.BIHARMONIC else 1e-4)
        return
    if rbf.reduction == setup_pb2.REDUCTION_RINGS:
        rbf.reduction = setup_pb2.REDUCTION_AUTOMATIC
    if rbf.reduction == setup_pb2.REDUCTION_OFF:
        rbf.reduction_rings = 3
    instead_of_zero(rbf, "reduction_rings", 3)
    rbf.reduction_tolerance = 0


def canonical_basis(options):
    if options.basis == setup_pb2.BASIS_NEVER or options.basis_tolerance == 0:
        options.basis_tolerance = 0


def canonical_energy(energy):
    canonical_basis(energy)
    energy.SetInParent()
    if not energy.HasField("bending"):
        energy.bending = 1
    instead_of_zero(energy, "handles", setup_pb2.HANDLES_HARD)
    if energy.handles == setup_pb2.HANDLES_HARD:
        energy.fixing = 0
    else:
        instead_of_zero(energy, "fixing", 1000)


def canonical_region(region):
    for holder in [region] + ([region.control] if region.HasField("control") else []):
        ids = sorted(set(holder.ids))
        del holder.ids[:]
        holder.ids.extend(ids)
    for children in (region.union, region.intersection, region.difference):
        for child in children:
            canonical_region(child)
    if region.HasField("complement"):
        canonical_region(region.complement)
    if region.HasField("grow"):
        canonical_region(region.grow.region)
    if region.HasField("patch"):
        instead_of_zero(region.patch, "angle", 30)


def canonical_method(method, flat):
    kind = method.WhichOneof("kind") or "rbf"
    chosen = getattr(method, kind)
    chosen.SetInParent()
    if kind == "rbf":
        return canonical_rbf(chosen, flat)
    if kind == "cage":
        chosen.file = ""
        if chosen.coordinates != setup_pb2.GREEN:
            chosen.coordinates = setup_pb2.MEAN_VALUE
        if chosen.control == setup_pb2.MESH:
            instead_of_zero(chosen, "clamp", 0)
        else:
            chosen.control = setup_pb2.CONTROLS
            chosen.clamp = 0
        return canonical_basis(chosen)
    # How setups were stored before there were MlsMethod.domain, SubspaceMethod.linear and Energy.misfit.
    stored = chosen.energy.HasField("bending") and chosen.energy.handles != setup_pb2.HANDLES_DEFAULT
    at_centres = chosen.energy.misfit == setup_pb2.MISFIT_AT_CENTRES or (
        stored and chosen.energy.misfit == setup_pb2.MISFIT_DEFAULT and has_all_but_energy(kind, chosen))
    canonical_energy(chosen.energy)
    if kind == "subspace":
        stored = stored and chosen.centres != 0 and chosen.cover != 0 and chosen.linear == setup_pb2.LINEAR_DEFAULT
        decays = chosen.kernel in (setup_pb2.SUBSPACE_WENDLAND_C2, setup_pb2.SUBSPACE_GAUSSIAN)
        left_out = stored or not decays or chosen.linear == setup_pb2.LINEAR_LEFT_OUT
        chosen.linear = setup_pb2.LINEAR_DEFAULT if left_out else setup_pb2.LINEAR_ADDED
        instead_of_zero(chosen, "kernel", setup_pb2.SUBSPACE_MLS)
        instead_of_zero(chosen, "centres", 1000)
        if chosen.kernel in (setup_pb2.SUBSPACE_TRIHARMONIC, setup_pb2.SUBSPACE_BIHARMONIC):
            chosen.cover = 0
        else:
            instead_of_zero(chosen, "cover", 8 if chosen.kernel == setup_pb2.SUBSPACE_MLS else 50)
    if kind == "ffd":
        if chosen.control in (setup_pb2.MESH, setup_pb2.CONTROLS):
            basis, basis_tolerance = chosen.energy.basis, chosen.energy.basis_tolerance
            chosen.ClearField("energy")
            chosen.energy.basis, chosen.energy.basis_tolerance = basis, basis_tolerance
            canonical_energy(chosen.energy)
        else:
            chosen.control = setup_pb2.ENERGY
        if chosen.control != setup_pb2.MESH or chosen.clamp == 0:
            chosen.clamp = 0
        chosen.lattice.SetInParent()
        instead_of_zero(chosen.lattice, "basis", setup_pb2.UNIFORM_CUBIC)
    if kind == "mls":
        stored = stored and chosen.cubature != 0 and chosen.cover != 0 and chosen.domain == setup_pb2.DOMAIN_DEFAULT
        surface = stored or chosen.domain == setup_pb2.DOMAIN_SURFACE
        numbers = chosen.surface_samples != 0 and chosen.volume_samples != 0
        usual = setup_pb2.DOMAIN_CONNECTED if numbers else setup_pb2.DOMAIN_BODY
        chosen.domain = setup_pb2.DOMAIN_DEFAULT if surface else chosen.domain or usual
        instead_of_zero(chosen, "cubature", 4)
        instead_of_zero(chosen, "cover", 12 if surface else 20)
        for weights in chosen.weights:
            canonical_region(weights.region)
    met = kind != "shell" and chosen.energy.handles == setup_pb2.HANDLES_HARD and not at_centres
    if kind == "ffd" and chosen.control != setup_pb2.ENERGY:
        met = False
    chosen.energy.misfit = setup_pb2.MISFIT_AT_JOINS if met else setup_pb2.MISFIT_DEFAULT


def has_all_but_energy(kind, chosen):
    if kind == "subspace":
        return chosen.kernel != setup_pb2.SUBSPACE_DEFAULT and chosen.centres != 0
    if kind == "mls":
        return chosen.cubature != 0 and chosen.cover != 0
    return kind == "ffd" and chosen.control != setup_pb2.FFD_CONTROL_DEFAULT and chosen.lattice.basis != setup_pb2.LATTICE_BASIS_DEFAULT


def canonical_constraint(constraint):
    for region in constraint.regions:
        canonical_region(region)
    kind = constraint.WhichOneof("kind")
    shape = getattr(constraint, kind)
    if kind in ("circular", "cylindrical", "spherical"):
        instead_of_zero(shape, "radius", setup_pb2.FREE)
    elif kind == "conical":
        instead_of_zero(shape, "angle", setup_pb2.FREE)
    elif kind == "symmetric":
        instead_of_zero(shape, "tolerance", 1e-3)
    elif kind == "distance":
        instead_of_zero(shape, "bound", setup_pb2.EQUAL)
    elif kind == "extent":
        instead_of_zero(shape, "bound", setup_pb2.MINIMUM)
        if not shape.HasField("ends"):
            shape.ends = 0.01


def canonical_constraint_options(setup):
    """To be called before the defaults of the method are filled in."""
    if not setup.constraints:
        setup.ClearField("constraint_options")
        return
    options = setup.constraint_options
    kind = setup.method.WhichOneof("kind")
    energy = getattr(setup.method, kind).energy if kind in ("shell", "subspace", "mls", "ffd") else None
    # How setups were stored before there was exact_steps.
    stored = (options.exact_steps == setup_pb2.EXACT_STEPS_DEFAULT and options.tolerance != 0 and options.iterations != 0
              and energy is not None and energy.HasField("bending") and energy.handles != setup_pb2.HANDLES_DEFAULT)
    at_centres = stored or options.exact_steps == setup_pb2.EXACT_STEPS_AT_CENTRES
    named = any(constraint.exact for constraint in setup.constraints) and not at_centres
    options.exact_steps = setup_pb2.EXACT_STEPS_AT_JOINS if named else setup_pb2.EXACT_STEPS_DEFAULT
    instead_of_zero(options, "tolerance", 1e-7)
    instead_of_zero(options, "iterations", 3000)


def canonical_setup(setup, geometry, flat):
    """flat: all points of the geometry have the same z, to 1e-9 of the diagonal of their box."""
    canonical = setup_pb2.Setup()
    canonical.CopyFrom(setup)
    canonical.DiscardUnknownFields()
    canonical.geometry = geometry
    canonical_constraint_options(canonical)
    canonical_method(canonical.method, flat)
    for handle in canonical.handles:
        canonical_region(handle.region)
    for region in canonical.fixed:
        canonical_region(region)
    for stage in canonical.then:
        canonical_method(stage.method, flat)
        for handle in stage.handles:
            canonical_region(handle.region)
        for region in stage.fixed:
            canonical_region(region)
    for plane in canonical.symmetry:
        if plane.HasField("region"):
            canonical_region(plane.region)
        if plane.HasField("sector"):
            if not plane.sector.origin:
                plane.sector.origin.extend([0, 0, 0])
            for region in plane.sector.periodic:
                canonical_region(region)
    for constraint in canonical.constraints:
        canonical_constraint(constraint)
    for moved in [each for variable in canonical.variables for each in [variable, *variable.also]]:
        for kind in ("rotate", "scale"):
            if moved.HasField(kind) and not getattr(moved, kind).centre:
                getattr(moved, kind).centre.extend([0, 0, 0])
        if moved.HasField("rotate") and moved.rotate.unit == setup_pb2.RADIANS:
            moved.rotate.unit = setup_pb2.ANGLE_UNIT_DEFAULT
    return canonical


def canonical_bytes(canonical):
    return canonical.SerializeToString(deterministic=True)


def system_id(canonical):
    return hashlib.sha256(b"deform.setup.1\0" + canonical_bytes(canonical)).hexdigest()

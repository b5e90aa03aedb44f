#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""Writes small valid mesh files, one per feature of each format, as starting points for the fuzz_read_* targets.

usage: make_read_seeds.py CORPUS_FOLDER      (writes CORPUS_FOLDER/fuzz_read_FORMAT/NAME)
"""
import base64
import pathlib
import struct
import sys
import zlib

POINTS = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (1.0, 1.0, 0.25), (0.0, 1.0, 0.5)]
FACES = [(0, 1, 2), (0, 2, 3)]


def lines(*rows):
    return "\n".join(rows).encode() + b"\n"


def obj_seeds():
    v = [f"v {x} {y} {z}" for x, y, z in POINTS]
    yield "plain", lines(*v, "f 1 2 3 4")
    yield "relative", lines(*v, "vt 0 0", "vn 0 0 1", "f -4/1/1 -3/1/1 -2/1/1", "f 1//1 3//1 4//1", "f 1/1 2/1 3/1")
    yield "names", lines("# c", "mtllib m.mtl", "o body", *v, "g left right", "usemtl steel", "s 1", "f 1 2 3", "g left", "f 1 3 4", "p 1", "l 1 2")
    yield "continued", b"v 0 0 \\\n 0\r\nv 1 0 0 1.0\r\nv 0 1 0 0.5 0.5 0.5\r\nf 1 \\\r\n 2 3\r\n"
    yield "carriage_returns", b"v 0 0 0\rv 1 0 0\rv 0 1 0\rf 1 2 3\r"


def off_seeds():
    v = [f"{x} {y} {z}" for x, y, z in POINTS]
    f = [f"3 {a} {b} {c}" for a, b, c in FACES]
    yield "plain", lines("OFF", "4 2 0", *v, *f)
    yield "comments", lines("# c", "OFF4 2 5 # c", "", *v, "# c", *[row + " 255 0 0" for row in f])
    yield "colours", lines("COFF", "4 2", *[row + " 1 2 3 255" for row in v], *f)
    yield "all_extras", lines("STCNOFF 4 2 0", *[row + " 0 0 1  1 1 1 1  0.5 0.5" for row in v], *f)
    yield "one_line", lines("OFF 4 2 0 " + " ".join(v), *f)
    for order, mark in (("big", ">"), ("little", "<")):
        for colours in (b"", struct.pack(mark + "i", 0)):
            data = struct.pack(mark + "3i", 4, 2, 0) + b"".join(struct.pack(mark + "3f", *p) for p in POINTS)
            data += b"".join(struct.pack(mark + "4i", 3, *face) + colours for face in FACES)
            yield f"binary_{order}_{len(colours)}", b"OFF BINARY\n" + data


def ply_seeds():
    header = ["element vertex 4", "property float x", "property float y", "property float z", "element face 2",
              "property list uchar int vertex_indices", "end_header"]
    v = [f"{x} {y} {z}" for x, y, z in POINTS]
    f = [f"3 {a} {b} {c}" for a, b, c in FACES]
    yield "ascii", lines("ply", "format ascii 1.0", "comment c", *header, *v, *f)
    extra = ["element edge 1", "property short a", "property list ushort double b", "element vertex 4", "property uchar red",
             "property double z", "property list uint8 float32 weights", "property double x", "property double y",
             "element tristrips 1", "property list int int vertex_indices", "end_header"]
    yield "ascii_extra", lines("ply", "format ascii 1.0", *extra, "1 2 0.5 0.5", *[f"7 {z} 1 0.5 {x} {y}" for x, y, z in POINTS], "5 0 1 2 -1 3")
    for order, mark in (("big", ">"), ("little", "<")):
        data = b"".join(struct.pack(mark + "3f", *p) for p in POINTS)
        data += b"".join(struct.pack(mark + "B3i", 3, *face) for face in FACES)
        yield f"binary_{order}", lines("ply", f"format binary_{order}_endian 1.0", *header) + data
        data = struct.pack(mark + "hH2d", 1, 2, 0.5, 0.5)
        data += b"".join(struct.pack(mark + "BdBf2d", 7, z, 1, 0.5, x, y) for x, y, z in POINTS)
        data += struct.pack(mark + "6i", 5, 0, 1, 2, -1, 3)
        yield f"binary_{order}_extra", lines("ply", f"format binary_{order}_endian 1.0", *extra) + data


def stl_seeds():
    def solid(name, faces):
        rows = ["solid " + name]
        for face in faces:
            rows += ["facet normal 0 0 nan", "outer loop", *["vertex {} {} {}".format(*POINTS[i]) for i in face], "endloop", "endfacet"]
        return rows + ["endsolid " + name]

    yield "text", lines(*solid("a", FACES))
    yield "two_solids", lines(*solid("a", FACES[:1]), *solid("", FACES[1:])).upper()
    data = b"".join(struct.pack("<12fH", 0, 0, 1, *(c for i in face for c in POINTS[i]), 0) for face in FACES)
    yield "binary", b"solid but binary".ljust(80) + struct.pack("<I", 2) + data


def medit_seeds():
    v = [f"{x} {y} {z} 1" for x, y, z in POINTS]
    head = ["MeshVersionFormatted 2", "# c", "Dimension 3"]
    yield "volume", lines(*head, "Vertices 4", *v, "Triangles 2", "1 2 3 5", "2 3 4 6", "Tangents 1", "0 0 1", "Tetrahedra 1", "1 2 3 4 1", "End")
    yield "surface", lines(*head, "Vertices", "4", *v, "Quadrilaterals 1", "1 2 3 4 1", "Hexahedra 1", "1 2 3 4 1 2 3 4 2", "Prisms 1",
                           "1 2 3 4 1 2 0", "Pyramids 0", "End")


def abaqus_seeds():
    v = [f"{i + 1},{x}, {y},{z}" for i, (x, y, z) in enumerate(POINTS)]
    mesh = ["*NODE, NSET=all", *v, "*ELEMENT,TYPE=C3D4,ELSET=e", "1,1,2,", "3,4", "*ELEMENT,TYPE=S3", "2,1,3,2"]
    yield "sets", lines("*HEADING", "** c", *mesh, "*NSET,NSET=a,GENERATE", "1,3,2", "*NSET,NSET=b,", "UNSORTED", "a,4", "*NSET,NSET=c,ELSET=e",
                        "*ELSET,ELSET=\"f g\"", "e,2", "*STEP")
    yield "surfaces", lines(*mesh, "*SURFACE,NAME=s", "e,S2", "2,SPOS", "2,E1", "*SURFACE,NAME=t", "e,", "*SURFACE,NAME=n,TYPE=NODE", "all,1.", "3")
    yield "parts", lines("*PART,NAME=P", *mesh, "*END PART", "*ASSEMBLY", "*INSTANCE,NAME=I,PART=P", "1.,0,0", "*END INSTANCE", "*NSET,NSET=x,INSTANCE=I",
                         "1", "*ELSET,ELSET=y,INTERNAL", "I.e", "*SURFACE,NAME=z", "I.1,S1", "y,S3", "*END ASSEMBLY")
    yield "short", b"*NODE\r\n1\r\n2,\r\n3,1.D0,,\r\n4,,2.e-3\r\n5 , 1 , 2 , 3 , 0 , 1\r\n*ELEMENT,TYPE=B31\r\n1,1,2\r\n"
    yield "quadratic", lines("*NODE", *[f"{i}" for i in range(1, 21)], "*ELEMENT,TYPE=C3D20R", "1,1,2,3,4,5,6,7,8,9,10,11,12,13,14,15,",
                             "16,17,18,19,20", "*ELEMENT,TYPE=CPE8", "2,1,2,3,4,5,6,7,8", "*SURFACE,NAME=s", "1,S6", "2,S4")


def gmsh_seeds():
    """A tetrahedron and one of its faces in all versions."""
    points, names = POINTS, ["$PhysicalNames", "2", '2 1 "wall"', '3 2 "box"', "$EndPhysicalNames"]
    flat = [c for p in points for c in p]
    yield "text_22", lines("$MeshFormat", "2.2 0 8", "$EndMeshFormat", *names, "$Comments", "x", "$EndComments", "$Nodes", "4",
                           *[f"{9 - i} {x} {y} {z}" for i, (x, y, z) in enumerate(points)], "$EndNodes", "$Elements", "4",
                           "1 2 2 1 1 9 8 7", "2 2 2 3 1 9 8 7", "3 4 2 2 1 9 8 7 6", "4 15 0 9", "$EndElements")
    yield "parametric_22", lines("$MeshFormat", "2.2 0 8", "$EndMeshFormat", "$ParametricNodes", "2", "1 0 0 0 0 1", "2 1 0 0 2 1 0.5 0.5",
                                 "$EndParametricNodes")
    entities = ["$Entities", "0 0 1 1", "1 0 0 0 1 1 1 1 1 0", "1 0 0 0 1 1 1 1 -2 1 1", "$EndEntities"]
    yield "text_40", lines("$MeshFormat", "4 0 8", "$EndMeshFormat", *names, *entities, "$Nodes", "2 4", "1 2 1 3",
                           *[f"{i + 1} {x} {y} {z} 0.5 0.5" for i, (x, y, z) in enumerate(points[:3])], "1 3 0 1", "4 0 1 0.5", "$EndNodes",
                           "$Elements", "2 2", "1 2 2 1", "1 1 2 3", "1 3 4 1", "2 1 2 3 4", "$EndElements")
    parts = ["$PartitionedEntities", "1", "0", "0 0 1 0", "2 2 1 1 1 0 0 0 1 1 1 1 1 0", "$EndPartitionedEntities"]
    yield "text_41", lines("$MeshFormat", "4.1 0 8", "$EndMeshFormat", *names, *entities, *parts, "$Nodes", "1 4 1 4", "2 1 1 4", "1", "2", "3", "4",
                           *[f"{x} {y} {z} 0 0" for x, y, z in points], "$EndNodes",
                           "$Elements", "2 2 1 2", "2 2 2 1", "1 1 2 3", "3 1 4 1", "2 1 2 3 4", "$EndElements")
    for order, mark in (("big", ">"), ("little", "<")):
        head = struct.pack(mark + "i", 1) + b"\n$EndMeshFormat\n"
        nodes = b"".join(struct.pack(mark + "i3d", i + 1, *p) for i, p in enumerate(points))
        yield f"binary_22_{order}", (b"$MeshFormat\n2.2 1 8\n" + head + b"$Nodes\n4\n" + nodes + b"\n$EndNodes\n$Elements\n2\n" +
                                     struct.pack(mark + "19i", 2, 1, 2, 1, 1, 1, 1, 2, 3, 4, 1, 2, 2, 2, 1, 1, 2, 3, 4) + b"\n$EndElements\n")
        yield f"binary_40_{order}", (b"$MeshFormat\n4 1 8\n" + head + b"$Nodes\n" + struct.pack(mark + "2Q3iQ", 1, 4, 1, 3, 0, 4) + nodes +
                                     b"\n$EndNodes\n$Elements\n" + struct.pack(mark + "2Q3iQ5i", 1, 1, 1, 3, 4, 1, 1, 1, 2, 3, 4) + b"\n$EndElements\n")
        for size, letter in ((4, "I"), (8, "Q")):
            entity = struct.pack(f"{mark}4{letter}i6d{letter}i{letter}", 0, 0, 0, 1, 1, *[0.0] * 6, 1, 2, 0)
            yield f"binary_41_{order}_{size}", (
                f"$MeshFormat\n4.1 1 {size}\n".encode() + head + b"$Entities\n" + entity + b"\n$EndEntities\n$Nodes\n" +
                struct.pack(f"{mark}4{letter}3i{letter}4{letter}12d", 1, 4, 1, 4, 3, 1, 0, 4, 1, 2, 3, 4, *flat) + b"\n$EndNodes\n$Elements\n" +
                struct.pack(f"{mark}4{letter}3i{letter}5{letter}", 1, 1, 1, 1, 3, 1, 4, 1, 1, 1, 2, 3, 4) + b"\n$EndElements\n")


def nastran_seeds():
    small = [f"GRID    {i + 1:8d}        {x:8.3f}{y:8.3f}{z:8.3f}" for i, (x, y, z) in enumerate(POINTS)]
    yield "small", lines("SOL 101", "CEND", "BEGIN BULK", "$ c", *small, "CTETRA         1       7       1       2       3       4",
                         "CTRIA3  2       8       1       3       2     .01", "CBAR    3       1       1       2", "ENDDATA", "x")
    large = [f"GRID*   {i + 1:16d}{'':16}{x:16.9f}{y:16.9f}*A{i}\n*A{i:<6d}{z:16.9f}" for i, (x, y, z) in enumerate(POINTS)]
    yield "large", lines(*large, "CQUAD4* 1                              9               1               2", "*       3               4")
    free = [f"GRID,{i + 1},0,{x},{y},{z}" for i, (x, y, z) in enumerate(POINTS)]
    yield "free", lines(*free, "GRID,5,,1.5-3,-.5D+1", "GRID*,6,,1.,2.,*", "*,3.", "CTRIA6,1,2,1,2,3,4,5,6", "CHEXA,2,2,1,2,3,4,5,6,+A", "+A,1,2",
                        "CORD2R,1,0,0.,0.,0.,0.,0.,1.,+", "+,1.,0.,0.")
    yield "short", lines("GRID    1", "GRID    2               1.", "GRID*   3", "GRID,4", "GRID    5\r")


def su2_seeds():
    yield "plane", lines("% c", "NDIME= 2", "NELEM= 2", "5 0 1 2 0", "5 0 2 3 1", "NPOIN= 4 4", *[f"{x} {y} {i}" for i, (x, y, _) in enumerate(POINTS)],
                         "NMARK= 2", "MARKER_TAG= a", "MARKER_ELEMS= 2", "3 0 1", "3 1 2", "MARKER_TAG= SEND_RECEIVE", "MARKER_ELEMS= 1",
                         "SEND_RECV= 1", "1 3 0")
    v = [f"{x} {y} {z}" for x, y, z in POINTS + [(0.5, 0.5, 2.0), (0.5, 1.0, 2.0)]]
    yield "solid", lines("NELEM= 2", "13 0 1 2 3 4 5", "10 0 1 2 4", "NPOIN= 6", *v, "NDIME= 3", "NMARK= 1", "MARKER_TAG= b", "MARKER_ELEMS= 2",
                         "9 0 1 4 3", "5 0 1 2")


def vtk_seeds():
    v = [f"{x} {y} {z}" for x, y, z in POINTS + [(0.5, 0.5, 2.0), (0.5, 1.0, 2.0)]]
    data = ["CELL_DATA 2", "FIELD f 2", "names 1 2 string", "a", "b", "METADATA", "INFORMATION 0", "", "ids 1 2 int", "3 4"]
    yield "old", lines("# vtk DataFile Version 3.0", "t", "ASCII", "DATASET UNSTRUCTURED_GRID", "POINTS 6 float", *v, "CELLS 2 11", "6 0 1 2 3 4 5",
                       "3 0 1 2", "CELL_TYPES 2", "13 5", *data)
    yield "new", lines("# vtk DataFile Version 5.1", "t", "ASCII", "DATASET UNSTRUCTURED_GRID", "POINTS 6 double", *v, "CELLS 3 9",
                       "OFFSETS vtktypeint64", "0 6 9", "CONNECTIVITY vtktypeint64", "0 1 2 3 4 5 0 1 2", "CELL_TYPES 2", "13 5", *data)
    yield "polyhedron", lines("# vtk DataFile Version 4.2", "t", "ASCII", "DATASET UNSTRUCTURED_GRID", "POINTS 6 double", *v, "CELLS 1 18",
                              "17 4 3 0 2 1 3 0 1 3 3 1 2 3 3 2 0 3", "CELL_TYPES 1", "42")
    yield "surface", lines("# vtk DataFile Version 2.0", "t", "ASCII", "DATASET POLYDATA", "POINTS 6 double", *v, "POLYGONS 1 5", "4 0 1 2 3",
                           "TRIANGLE_STRIPS 1 5", "4 0 1 2 3", "LINES 1 3", "2 0 1", "VERTICES 1 2", "1 0", "POINT_DATA 6", "VECTORS v float", *v,
                           "CELL_DATA 4", "SCALARS s int", "LOOKUP_TABLE t", "1 2 3 4", "LOOKUP_TABLE t 1", "0 0 0 0")
    yield "lattice", lines("# vtk DataFile Version 3.0", "t", "ASCII", "DATASET STRUCTURED_GRID", "DIMENSIONS 3 2 1", "POINTS 6 double", *v)
    numbers = [c for p in POINTS for c in p]
    binary = lines("# vtk DataFile Version 3.0", "t", "BINARY", "DATASET UNSTRUCTURED_GRID", "POINTS 4 float") + struct.pack(">12f", *numbers)
    binary += b"\nCELLS 1 5\n" + struct.pack(">5i", 4, 0, 1, 2, 3) + b"\nCELL_TYPES 1\n" + struct.pack(">i", 10)
    yield "binary", binary + b"\nCELL_DATA 1\nSCALARS s short\nLOOKUP_TABLE t\n" + struct.pack(">h", 7) + b"\nCOLOR_SCALARS c 1\n\x80\n"


def vtu_seeds():
    """The tetrahedron of POINTS and one of its faces."""
    def file(forms, compressor="", mark="<", appended=""):
        """`forms` stores one array after another: it gives what stands behind the attributes."""
        arrays = [("Points", 'Float64" NumberOfComponents="3', "d", [c for p in POINTS for c in p]), ("connectivity", "Int32", "i", [0, 1, 2, 3, 0, 1, 2]),
                  ("offsets", "Int64", "q", [4, 7]), ("types", "UInt8", "B", [10, 5]), ("part", "Int32", "i", [1, 2])]
        nodes = [f'<DataArray Name="{name}" type="{kind}" ' + forms(struct.pack(f"{mark}{len(values)}{code}", *values), values) + "</DataArray>"
                 for name, kind, code, values in arrays]
        order = "LittleEndian" if mark == "<" else "BigEndian"
        return (f'<?xml version="1.0"?><VTKFile type="UnstructuredGrid" byte_order="{order}" {compressor}><UnstructuredGrid><!-- c -->'
                f'<Piece NumberOfPoints="4" NumberOfCells="2"><Points>{nodes[0]}</Points><Cells>{"".join(nodes[1:4])}</Cells>'
                f"<CellData>{nodes[4]}</CellData></Piece></UnstructuredGrid>{appended}</VTKFile>").encode()

    def text(_, values):
        return 'format="ascii" RangeMin="0" RangeMax="1">' + " ".join(map(str, values))

    def packed(data, size):
        block = zlib.compress(data)
        return struct.pack(f"<4{size}", 1, 32768, len(data), len(block)), block

    def base64_of(*parts):
        return "".join(base64.b64encode(part).decode() for part in parts)

    zlib_compressor = 'compressor="vtkZLibDataCompressor" '
    yield "text", file(text)
    yield "base64", file(lambda data, _: 'format="binary">' + base64_of(struct.pack(">I", len(data)) + data), mark=">")
    yield "packed", file(lambda data, _: 'format="binary">' + base64_of(*packed(data, "Q")), zlib_compressor + 'header_type="UInt64"')

    def appended(store, encoding, compressor=""):
        parts = []

        def form(data, _):
            parts.append(store(data))
            return f'format="appended" offset="{sum(map(len, parts[:-1]))}">'

        whole = file(form, compressor)
        end = whole.index(b"</VTKFile>")
        return whole[:end] + f'<AppendedData encoding="{encoding}">_'.encode() + b"".join(parts) + b"</AppendedData></VTKFile>"

    yield "raw", appended(lambda data: struct.pack("<I", len(data)) + data, "raw")
    yield "raw_packed", appended(lambda data: b"".join(packed(data, "I")), "raw", zlib_compressor)
    yield "base64_packed", appended(lambda data: base64_of(*packed(data, "I")).encode(), "base64", zlib_compressor)


def openfoam_seeds():
    """A tetrahedron; see fuzz_read_openfoam.cpp."""
    def head(form):
        return f'FoamFile {{ version 2.0; format {form}; arch "LSB;label=32;scalar=64"; class a; }} // c\n'.encode()

    def labels(values):
        return b"%d\n(" % len(values) + struct.pack(f"<{len(values)}I", *values) + b")\n"

    faces = [(0, 2, 1), (0, 1, 3), (1, 2, 3), (2, 0, 3)]
    corners = [c for face in faces for c in face]
    boundary = b"2(a{type patch;nFaces 1;startFace 0;inGroups 1(g);}b{type wall;nFaces 3;startFace 1;})"
    zones = [b"1(p{pointLabels 2(0 1);})", b"1(f{faceLabels List<label> 1(2);flipMap List<bool> 1(0);})", b"1(c{cellLabels 1{0};})"]
    points = b"4((0 0 0)(1 0 0)(0 1 0.5)(0 0 1))"
    text = b"4(" + b"".join(b"3(%d %d %d)" % face for face in faces) + b")"
    yield "text", b"\x1f".join([head("ascii") + points, head("ascii") + text, b"4{0}", b"0()", boundary, *zones])
    raw = b"4(" + struct.pack("<12d", *[c for p in POINTS for c in p]) + b")"
    offsets = labels([0, 3, 6, 9, 12])
    yield "binary", b"\x1f".join([head("binary") + raw, head("binary") + offsets + labels(corners), b"4(0 0 0 0)", b"0()", boundary])


def openfoam_parts_seeds():
    """Two tetrahedra that share a face, each in a part; see fuzz_read_openfoam_parts.cpp."""
    def part(points, faces, addresses):
        boundary = b"2(a{type patch;nFaces 3;startFace 0;}s{type processor;nFaces 1;startFace 3;})"
        text = b"4(" + b"".join(b"3(%d %d %d)" % face for face in faces) + b")"
        zones = [b"1(p{pointLabels 1(3);})", b"1(f{faceLabels 1(3);})", b"1(c{cellLabels 1(0);})"]
        return [b"4(" + b"".join(points) + b")", text, b"4{0}", b"0()", boundary, *zones, *addresses]

    points = [b"(0 0 0)", b"(1 0 0)", b"(0 1 0)", b"(0 0 1)", b"(1 1 1)"]
    yield "text", b"\x1f".join(part(points[:4], [(0, 2, 1), (0, 1, 3), (2, 0, 3), (1, 2, 3)], [b"4(0 1 2 3)", b"4(2 3 4 1)", b"1(0)"]) +
                               part(points[1:], [(0, 1, 3), (0, 3, 2), (1, 2, 3), (0, 2, 1)], [b"4(1 2 3 4)", b"4(5 6 7 -1)", b"1(1)"]))


def collated_seeds():
    """The points of two tetrahedra, each of a part; see fuzz_read_collated.cpp."""
    points = b"4((0 0 0)(1 0 0)(0 1 0.5)(0 0 1))"
    raw = b"4(" + struct.pack("<12d", *[c for p in POINTS for c in p]) + b")"

    def file(around, *blocks):
        head = b'FoamFile\n{\n    version 2.0;\n    ' + around + b"\n    class decomposedBlockData;\n    location \"c\";\n    object points;\n}\n// c\n"
        return bytes([len(blocks)]) + head + b"".join(b"\n// Processor%d\n\n%d(%s)\n" % (i, len(b), b) for i, b in enumerate(blocks))

    own = b'FoamFile { version 2.0; format ascii; class vectorField; object points; }\n'
    form = b'format binary; arch "LSB;label=32;scalar=64";'
    yield "text", file(b"format ascii;", own + points, points)
    yield "binary", file(form, b"FoamFile { " + form + b" class vectorField; }\n" + raw, raw)
    yield "new", file(b"format ascii; data.format binary; arch \"LSB;label=32;scalar=64\";", raw, raw, raw)
    yield "one_headless", file(b"format ascii;", points)
    yield "leading_zeros", file(b"format ascii;", points).replace(b"%d(" % len(points), b"00%d(" % len(points))


def netcdf_header_seeds():
    """Two dimensions, an attribute, a variable of doubles and one of records."""
    for version in (1, 2, 5):
        count = lambda n: struct.pack(">q" if version == 5 else ">i", n)
        offset = lambda n: struct.pack(">i" if version == 1 else ">q", n)
        tag = lambda n: struct.pack(">i", n)

        def name(text):
            return count(len(text)) + text + bytes(-len(text) % 4)

        dimensions = tag(10) + count(2) + name(b"num_nodes") + count(4) + name(b"time") + count(0)
        attributes = tag(12) + count(1) + name(b"title") + tag(2) + count(5) + b"a cat" + bytes(3)
        none = bytes(4) + count(0)
        for begin in (400, 1 << 20):
            variables = tag(11) + count(2) + name(b"coordx") + count(1) + count(0) + attributes + tag(6) + count(32) + offset(begin)
            variables += name(b"step") + count(1) + count(1) + none + tag(5) + count(4) + offset(432)
            header = b"CDF" + bytes([version]) + count(1) + dimensions + attributes + variables
            yield f"cdf{version}_{begin}", header.ljust(440, b"\0")


def main():
    corpus = pathlib.Path(sys.argv[1])
    for name, seeds in (("abaqus", abaqus_seeds()), ("collated", collated_seeds()), ("gmsh", gmsh_seeds()), ("medit", medit_seeds()), ("nastran", nastran_seeds()),
                        ("netcdf_header", netcdf_header_seeds()), ("obj", obj_seeds()), ("off", off_seeds()),
                        ("openfoam", openfoam_seeds()), ("openfoam_parts", openfoam_parts_seeds()), ("ply", ply_seeds()),
                        ("stl", stl_seeds()), ("su2", su2_seeds()), ("vtk", vtk_seeds()), ("vtu", vtu_seeds())):
        folder = corpus / f"fuzz_read_{name}"
        folder.mkdir(parents=True, exist_ok=True)
        for seed, data in seeds:
            (folder / seed).write_bytes(data)


main()

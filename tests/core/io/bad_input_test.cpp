// SPDX-License-Identifier: GPL-3.0-or-later
// What every reader must refuse, and how: file, line or byte, and what was expected.

#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <bit>

#include "core/io/binary/byte_order.h"
#include "core/io/mesh_file.h"
#include "tests/support/expect_error.h"

namespace deform::io::bad_input_test {
namespace {

struct BadInput {
  std::string test_name;
  std::string file_name;
  std::string bytes;
  std::vector<const char*> message;
};

std::ostream& operator<<(std::ostream& out, const BadInput& input) { return out << input.test_name; }

class BadInputTest : public testing::TestWithParam<BadInput> {};

TEST_P(BadInputTest, IsRefusedWithFilePlaceAndExpectation) {
  std::vector<const char*> parts = GetParam().message;
  parts.push_back(GetParam().file_name.c_str());
  test::expect_error(ErrorCode::invalid_argument, parts, [] { parse_mesh(GetParam().bytes, GetParam().file_name); });
}

const auto name_of_case = [](const auto& tested) { return tested.param.test_name; };

std::string raw(const std::string& text, std::initializer_list<std::uint32_t> words, std::endian order = std::endian::little) {
  std::string bytes = text;
  for (const std::uint32_t word : words) {
    bytes.resize(bytes.size() + 4);
    store_scalar(bytes.data() + bytes.size() - 4, word, order);
  }
  return bytes;
}

constexpr std::uint32_t nan_bits = 0x7fc00000, inf_bits = 0x7f800000;

// ---- names ----

INSTANTIATE_TEST_SUITE_P(
    Names, BadInputTest,
    testing::Values(
        BadInput{"CgnsEmpty", "a.cgns", "", {"a.cgns", "expected a CGNS file"}},
        BadInput{"CgnsText", "a.CGNS", "CGNS\n", {"a.CGNS", "expected a CGNS file"}}, BadInput{"ExodusEmpty", "a.e", "", {"a.e"}},
        BadInput{"ExodusText", "a.exo", "EXODUS, an epic", {"a.exo", "Unknown file format"}},
        BadInput{
            "ExodusHeader", "a.g", std::string("CDF\1\0\0\0\0\0\0\0\12\0\0\0\11", 16), {"a.g: byte 16", "a list of 9 entries"}},
        BadInput{"UnknownExtension", "car.step", "x", {".obj, .off, .ply, .stl", ".cgns", ".vtk, .vtu, .vtp", ".nas"}},
        BadInput{"NoExtension", "car", "x", {"unknown mesh format"}},
        BadInput{"OnlyGzip", "car.gz", "x", {"unknown mesh format"}},
        BadInput{"DamagedGzip", "car.obj", std::string("\x1f\x8b\x08\0\0\0\0\0\0\0\xff\xff", 12), {"gzip data"}},
        BadInput{"TruncatedGzip", "car.obj.gz", std::string("\x1f\x8b\x08\0\0\0\0\0\0\0", 10), {"gzip data is truncated"}}),
    name_of_case);

// ---- OBJ ----

const std::string v3 = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";

INSTANTIATE_TEST_SUITE_P(
    Limits, BadInputTest,
    testing::Values(BadInput{"Huge", "a.obj", v3 + "v 0 -1e308 0\nf 1 2 4\n", {"points[3]: coordinate y is -1e+308", "1e+40"}},
                    BadInput{"Tiny", "a.obj", "v 0 0 0\nv 1e-160 0 0\n", {"points: their bounding box is 1e-160 long", "1e-40"}},
                    BadInput{"HugeElements", "a.inp", "*NODE\n1, 0, 0, 1e41\n", {"points[0]: coordinate z is 1e+41"}}),
    name_of_case);

INSTANTIATE_TEST_SUITE_P(
    Obj, BadInputTest,
    testing::Values(BadInput{"ObjEmpty", "a.obj", "", {"line 1", "at least one vertex"}},
                    BadInput{"ObjNoVertices", "a.obj", "# nothing\n", {"at least one vertex"}},
                    BadInput{"ObjTooFewCoordinates", "a.obj", v3 + "v 1 2\n", {"line 4", "3 vertex coordinates, found 2"}},
                    BadInput{"ObjTruncatedVertex", "a.obj", v3 + "v 1 2", {"line 4", "3 vertex coordinates"}},
                    BadInput{"ObjWordAsCoordinate", "a.obj", v3 + "v 1 two 3\n", {"line 4", "number", "\"two\""}},
                    BadInput{"ObjCommaAsPoint", "a.obj", "v 1,5 0 0\n", {"line 1", "\"1,5\""}},
                    BadInput{"ObjHexadecimal", "a.obj", "v 0x10 0 0\n", {"\"0x10\""}},
                    BadInput{"ObjDoubleSign", "a.obj", "v +-1 0 0\n", {"\"+-1\""}},
                    BadInput{"ObjNaN", "a.obj", v3 + "v 0 nan 0\n", {"line 4", "\"nan\"", "finite"}},
                    BadInput{"ObjInfinite", "a.obj", "v -inf 0 0\n", {"\"-inf\"", "finite"}},
                    BadInput{"ObjOverflow", "a.obj", "v 0 0 1e999\n", {"\"1e999\"", "finite"}},
                    BadInput{"ObjIndexZero", "a.obj", v3 + "f 1 0 2\n", {"line 4", "index 0", "counts from 1"}},
                    BadInput{"ObjIndexTooLarge", "a.obj", v3 + "f 1 2 3\nf 1 2 4\n# end\n", {"line 5", "index 4", "3 vertices"}},
                    BadInput{"ObjIndexHuge", "a.obj", v3 + "f 1 2 4294967297\n", {"line 4", "4294967297", "4294967295"}},
                    BadInput{"ObjIndexOverflow", "a.obj", v3 + "f 1 2 99999999999999999999\n", {"line 4", "integer"}},
                    BadInput{"ObjRelativeTooFar", "a.obj", v3 + "f -1 -2 -4\nv 0 0 0\n", {"line 4", "-4", "only 3"}},
                    BadInput{
                        "ObjRelativeLowest", "a.obj", v3 + "f -9223372036854775808 1 2\n", {"line 4", "-9223372036854775808"}},
                    BadInput{"ObjFaceWithoutCorners", "a.obj", v3 + "f\n", {"line 4", "found none"}},
                    BadInput{"ObjWordAsIndex", "a.obj", v3 + "f 1 b 3\n", {"line 4", "integer", "\"b\""}},
                    BadInput{"ObjFractionAsIndex", "a.obj", v3 + "f 1 2.5 3\n", {"line 4", "face corner", "\"2.5\""}},
                    BadInput{"ObjTooManyParts", "a.obj", v3 + "f 1/1/1/1 2 3\n", {"line 4", "face corner", "\"1/1/1/1\""}},
                    BadInput{"ObjWordAsTexture", "a.obj", v3 + "f 1/x 2 3\n", {"line 4", "texture or normal"}},
                    BadInput{"ObjBinary", "a.obj", std::string("v \0\x01\x02\n", 6), {"line 1", "number"}},
                    BadInput{"ObjGroupFlood",
                             "a.obj",
                             [] {
                               std::string line = v3 + "g";
                               for (int i = 0; i < 65; ++i) line += " g" + std::to_string(i);
                               return line + "\nf 1 2 3\n";
                             }(),
                             {"line 4", "more than 64 group names"}}),
    name_of_case);

// ---- OFF ----

INSTANTIATE_TEST_SUITE_P(
    Off, BadInputTest,
    testing::Values(
        BadInput{"OffEmpty", "a.off", "", {"line 1", "OFF header", "empty"}},
        BadInput{"OffNoHeader", "a.off", "3 1 0\n0 0 0\n", {"line 1", "OFF header", "\"3\""}},
        BadInput{"OffOtherHeader", "a.off", "XOFF\n1 0 0\n", {"OFF header", "\"XOFF\""}},
        BadInput{"OffLongerHeader", "a.off", "OFFSET\n1 0 0\n", {"OFF header", "\"OFFSET\""}},
        BadInput{"OffFourDimensions", "a.off", "4OFF\n1 0 0\n0 0 0 1\n", {"4OFF", "only 3"}},
        BadInput{"OffAnyDimensions", "a.off", "nOFF\n5\n1 0 0\n", {"nOFF", "only 3"}},
        BadInput{"OffNoCounts", "a.off", "OFF\n# c\n", {"number of vertices", "end of the file"}},
        BadInput{"OffWordAsCount", "a.off", "OFF\nthree 1 0\n", {"line 2", "number of vertices", "\"three\""}},
        BadInput{"OffFractionAsCount", "a.off", "OFF\n3.5 1 0\n", {"line 2", "\"3.5\""}},
        BadInput{"OffNegativeCount", "a.off", "OFF\n3 -1 0\n", {"line 2", "number of faces is -1"}},
        BadInput{"OffCountTooLarge", "a.off", "OFF\n4294967296 0 0\n", {"4294967296", "4294967295"}},
        BadInput{"OffMoreVerticesThanBytes", "a.off", "OFF\n1000000 0 0\n0 0 0\n", {"line 2", "1000000 vertices", "are left"}},
        BadInput{"OffMoreFacesThanBytes", "a.off", "OFF\n1 4000000000 0\n0 0 0\n", {"4000000000 faces", "are left"}},
        BadInput{"OffNoVertices", "a.off", "OFF\n0 0 0\n", {"line 2", "no vertices"}},
        BadInput{"OffTruncatedVertices", "a.off", "OFF\n3 0 0\n0.5 0.5 0.5\n1 0 0\n", {"ends in vertex 2 of 3"}},
        BadInput{"OffTruncatedVertex", "a.off", "OFF\n2 0 0\n0.5 0.5 0.5\n1 0", {"ends in vertex 1 of 2"}},
        BadInput{"OffTruncatedFaces", "a.off", "OFF\n1 3 0\n0.5 0.5 0.5\n3 0 0 0\n1 0\n", {"ends in face 2 of 3"}},
        BadInput{"OffTruncatedFace", "a.off", "OFF\n1 1 0\n0.5 0.5 0.5\n3 0 0", {"line 4", "corners"}},
        BadInput{"OffWordAsCoordinate", "a.off", "OFF\n2 0 0\n0 0 0\n0 x 0\n", {"line 4", "number", "\"x\""}},
        BadInput{"OffNaN", "a.off", "OFF\n2 0 0\n0 0 0\n0 NaN 0\n", {"line 4", "\"NaN\"", "finite"}},
        BadInput{"OffIndexTooLarge", "a.off", "OFF\n2 1 0\n0 0 0\n1 1 1\n3 0 1 2\n", {"line 5", "index 2", "0..1"}},
        BadInput{"OffIndexNegative", "a.off", "OFF\n2 1 0\n0 0 0\n1 1 1\n2 0 -1\n", {"line 5", "index -1", "0..1"}},
        BadInput{"OffFractionAsIndex", "a.off", "OFF\n2 1 0\n0 0 0\n1 1 1\n2 0 0.5\n", {"line 5", "integer", "\"0.5\""}},
        BadInput{"OffEmptyFace", "a.off", "OFF\n2 1 0\n0 0 0\n1 1 1\n0 1 1 1\n", {"line 5", "0 corners"}},
        BadInput{"OffHugeFace", "a.off", "OFF\n2 1 0\n0 0 0\n1 1 1\n4000000000 0 1\n", {"line 5", "4000000000 corners"}},
        BadInput{"OffNegativeFace", "a.off", "OFF\n2 1 0\n0 0 0\n1 1 1\n-3 0 1 1\n", {"line 5", "-3 corners"}},
        BadInput{
            "OffMoreThanCounted", "a.off", "OFF\n2 1 0\n0 0 0\n1 1 1\n2 0 1\n2 1 0\n", {"line 6", "end of the file", "\"2\""}},
        BadInput{"OffBinaryEmpty", "a.off", "OFF BINARY\n", {"binary OFF", "12 bytes"}},
        BadInput{"OffBinaryCounts", "a.off", raw("OFF BINARY\n", {1000, 1000, 0, 1, 2, 3}), {"binary OFF", "but only 12"}},
        BadInput{"OffBinaryNoVertices", "a.off", raw("OFF BINARY\n", {0, 0, 0}), {"binary OFF", "no vertices"}},
        BadInput{"OffBinaryIndex",
                 "a.off",
                 raw("OFF BINARY\n", {1, 1, 0, 0, 0, 0, 1, 1}),
                 {"binary OFF", "face 0", "index 1", "0..0"}},
        BadInput{
            "OffBinaryFaceTooLong", "a.off", raw("OFF BINARY\n", {1, 1, 0, 0, 0, 0, 99, 0}), {"binary OFF", "face 0 claims 99"}},
        BadInput{"OffBinaryEmptyFace", "a.off", raw("OFF BINARY\n", {1, 1, 0, 0, 0, 0, 0, 0}), {"face 0 has no corners"}},
        BadInput{"OffBinaryTrailing", "a.off", raw("OFF BINARY\n", {1, 1, 0, 0, 0, 0, 1, 0, 0, 5, 5}), {"8 bytes are left"}},
        BadInput{"OffBinaryNaN",
                 "a.off",
                 raw("OFF BINARY\n", {1, 0, 0, 0, nan_bits, 0}),
                 {"byte 27", "coordinate y of vertex 0", "finite"}}),
    name_of_case);

// ---- PLY ----

std::string ply(const std::string& elements, const std::string& data, const std::string& format = "ascii") {
  return "ply\nformat " + format + " 1.0\n" + elements + "end_header\n" + data;
}
const std::string vertices = "element vertex 2\nproperty float x\nproperty float y\nproperty float z\n";
const std::string faces = "element face 1\nproperty list uchar int vertex_indices\n";
const std::string little = "binary_little_endian";
const std::string two_points = raw("", {0, 0, 0, 0, 0, 0});

INSTANTIATE_TEST_SUITE_P(
    PlyHeader, BadInputTest,
    testing::Values(
        BadInput{"PlyEmpty", "a.ply", "", {"line 1", "end of the file"}},
        BadInput{"PlyNoMagic", "a.ply", "plx\n", {"line 1", "expected \"ply\""}},
        BadInput{"PlyNoFormat", "a.ply", "ply\nelement vertex 1\n", {"line 2", "format"}},
        BadInput{"PlyUnknownFormat", "a.ply", "ply\nformat utf8 1.0\n", {"line 2", "binary_little_endian"}},
        BadInput{"PlyOtherVersion", "a.ply", "ply\nformat ascii 2.0\n", {"line 2", "version 1.0"}},
        BadInput{"PlyUnended", "a.ply", "ply\nformat ascii 1.0\nelement vertex 1\n", {"line 4", "end_header", "end of the file"}},
        BadInput{"PlyUnknownStatement", "a.ply", "ply\nformat ascii 1.0\nfoo\n", {"line 3", "\"foo\""}},
        BadInput{"PlyWordAsCount", "a.ply", ply("element vertex many\n", ""), {"line 3", "count of element vertex", "\"many\""}},
        BadInput{"PlyNegativeCount", "a.ply", ply("element vertex -1\n", ""), {"line 3", "\"-1\""}},
        BadInput{"PlyCountOverflow", "a.ply", ply("element vertex 99999999999999999999999\n", ""), {"line 3", "count"}},
        BadInput{"PlyUnknownType",
                 "a.ply",
                 ply("element vertex 1\nproperty real x\n", ""),
                 {"line 4", "unknown property type", "real"}},
        BadInput{"PlyPropertyFirst", "a.ply", ply("property float x\n", ""), {"line 3", "expected an element"}},
        BadInput{"PlyPropertyTwice", "a.ply", ply(vertices + "property float x\n", ""), {"line 7", "property x", "twice"}},
        BadInput{"PlyElementTwice", "a.ply", ply(vertices + vertices, ""), {"line 7", "element vertex", "twice"}},
        BadInput{
            "PlyFloatListLength", "a.ply", ply(vertices + "property list float int a\n", ""), {"line 7", "list a", "integer"}},
        BadInput{"PlyShortProperty", "a.ply", ply(vertices + "property float\n", ""), {"line 7", "property TYPE NAME"}},
        BadInput{"PlyNoVertexElement", "a.ply", ply(faces, "3 0 0 0\n"), {"no element vertex"}},
        BadInput{"PlyNoZ",
                 "a.ply",
                 ply("element vertex 1\nproperty float x\nproperty float y\n", "0 0\n"),
                 {"line 3", "no property z"}},
        BadInput{"PlyIntegerCoordinates",
                 "a.ply",
                 ply("element vertex 1\nproperty int x\nproperty int y\nproperty int z\n", "0 0 0\n"),
                 {"line 3", "property x", "type int", "float or double"}},
        BadInput{"PlyMixedCoordinates",
                 "a.ply",
                 ply("element vertex 1\nproperty float x\nproperty double y\nproperty float z\n", "0 0 0\n"),
                 {"differ in type"}},
        BadInput{"PlyListCoordinate",
                 "a.ply",
                 ply("element vertex 1\nproperty list uchar float x\nproperty float y\nproperty float z\n", ""),
                 {"property x", "list"}},
        BadInput{"PlyFloatIndices",
                 "a.ply",
                 ply(vertices + "element face 1\nproperty list uchar float vertex_indices\n", "0 0 0\n1 1 1\n3 0 0 0\n"),
                 {"vertex_indices", "integers"}}),
    name_of_case);

INSTANTIATE_TEST_SUITE_P(
    PlyData, BadInputTest,
    testing::Values(
        BadInput{"PlyNoVertices",
                 "a.ply",
                 ply("element vertex 0\nproperty float x\nproperty float y\nproperty float z\n", ""),
                 {"no vertices"}},
        BadInput{"PlyCountBeyondBytes",
                 "a.ply",
                 ply("element vertex 1000000000\nproperty float x\nproperty float y\nproperty float z\n", "0 0 0\n"),
                 {"element vertex", "1000000000", "only 6 bytes"}},
        BadInput{"PlyCountBeyondIds",
                 "a.ply",
                 ply("element vertex 18446744073709551615\nproperty float x\nproperty float y\nproperty float z\n", "0 0 0\n"),
                 {"18446744073709551615", "4294967295"}},
        BadInput{"PlyTruncated", "a.ply", ply(vertices, "0.125 0.125 0.125\n1 1"), {"line 9", "end of the file"}},
        BadInput{"PlyTooManyValues", "a.ply", ply(vertices, "0 0 0 7\n1 1 1\n"), {"line 8", "end of the line", "\"7\""}},
        BadInput{"PlyWordAsCoordinate", "a.ply", ply(vertices, "0 0 0\n1 one 1\n"), {"line 9", "\"one\""}},
        BadInput{"PlyNaN", "a.ply", ply(vertices, "0 0 0\n1 nan 1\n"), {"line 9", "finite"}},
        BadInput{"PlyIndexTooLarge", "a.ply", ply(vertices + faces, "0 0 0\n1 1 1\n3 0 1 2\n"), {"line 12", "index 2", "0..1"}},
        BadInput{"PlyIndexNegative", "a.ply", ply(vertices + faces, "0 0 0\n1 1 1\n3 0 1 -1\n"), {"line 12", "index -1", "0..1"}},
        BadInput{"PlyFractionAsIndex", "a.ply", ply(vertices + faces, "0 0 0\n1 1 1\n2 0 0.5\n"), {"line 12", "integer"}},
        BadInput{"PlyNegativeLength", "a.ply", ply(vertices + faces, "0 0 0\n1 1 1\n-3 0 1 1\n"), {"line 12", "claims -3"}},
        BadInput{"PlyHugeLength", "a.ply", ply(vertices + faces, "0 0 0\n1 1 1\n99999 0 1 1\n"), {"line 12", "claims 99999"}},
        BadInput{"PlyEmptyFace", "a.ply", ply(vertices + faces, "0 0 0\n1 1 1\n0\n"), {"face 0", "no corners"}},
        BadInput{"PlyTrailing", "a.ply", ply(vertices, "0 0 0\n1 1 1\n2 2 2\n"), {"line 10", "end of the file"}},
        BadInput{"PlyBinaryTruncated",
                 "a.ply",
                 ply(vertices, two_points.substr(0, 23), little),
                 {"byte 115", "element vertex", "only 23 bytes"}},
        BadInput{"PlyBinaryTruncatedFace",
                 "a.ply",
                 ply(vertices + faces, two_points + raw("\x03", {0, 1}), little),
                 {"list vertex_indices claims 3"}},
        BadInput{"PlyBinaryNoFace", "a.ply", ply(vertices + faces, two_points, little), {"element face", "only 0 bytes"}},
        BadInput{"PlyBinaryIndex",
                 "a.ply",
                 ply(vertices + faces, two_points + raw("\x03", {0, 1, 2}), little),
                 {"byte ", "index 2", "0..1"}},
        BadInput{"PlyBinaryNegativeIndex",
                 "a.ply",
                 ply(vertices + faces, two_points + raw("\x03", {0, 1, ~0U}), little),
                 {"index -1", "0..1"}},
        BadInput{"PlyBinaryInfinite", "a.ply", ply(vertices, raw("", {0, inf_bits, 0, 0, 0, 0}), little), {"byte 119", "finite"}},
        BadInput{"PlyBinaryTrailing", "a.ply", ply(vertices, two_points + "xx", little), {"end of the file"}}),
    name_of_case);

// ---- STL ----

std::string stl(const std::string& facets) { return "solid s\n" + facets + "endsolid s\n"; }
const std::string good = "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n";

std::string binary_stl(std::uint32_t claimed, std::size_t triangles, std::uint32_t bits) {
  std::string bytes = raw(std::string(80, 'h'), {claimed});
  for (std::size_t i = 0; i < triangles; ++i) bytes += raw("", {0, 0, 0, 0, 0, 0, 0, bits, 0, 0, 0, 0}) + std::string(2, '\0');
  return bytes;
}

INSTANTIATE_TEST_SUITE_P(
    Stl, BadInputTest,
    testing::Values(
        BadInput{"StlEmpty", "a.stl", "", {"the file is empty"}},
        BadInput{"StlNeither", "a.stl", "hello", {"expected \"solid\"", "84 bytes", "5 bytes"}},
        BadInput{"StlNoFacets", "a.stl", "solid a\nendsolid a\n", {"at least one facet"}},
        BadInput{"StlUnended", "a.stl", "solid a\n" + good, {"line 9", "\"facet\" or \"endsolid\"", "end of the file"}},
        BadInput{"StlTruncatedFacet",
                 "a.stl",
                 "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0",
                 {"line 5", "coordinate", "end of the file"}},
        BadInput{"StlTruncatedLoop",
                 "a.stl",
                 "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\n",
                 {"expected \"vertex\"", "end of the file"}},
        BadInput{"StlTwoVertices",
                 "a.stl",
                 stl("facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nendloop\nendfacet\n"),
                 {"line 6", "expected \"vertex\"", "\"endloop\""}},
        BadInput{
            "StlFourVertices",
            "a.stl",
            stl("facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 1 1 0\nvertex 0 1 0\nendloop\nendfacet\n"),
            {"line 7", "more than 3 vertices"}},
        BadInput{"StlNoLoop", "a.stl", stl("facet normal 0 0 1\nvertex 0 0 0\n"), {"line 3", "outer loop"}},
        BadInput{"StlNoEndfacet",
                 "a.stl",
                 stl("facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 1 1 0\nendloop\n"),
                 {"line 8", "\"endfacet\""}},
        BadInput{
            "StlWordAsCoordinate", "a.stl", stl("facet normal 0 0 1\nouter loop\nvertex 0 zero 0\n"), {"line 4", "\"zero\""}},
        BadInput{"StlNaN", "a.stl", stl("facet normal 0 0 1\nouter loop\nvertex 0 0 nan\n"), {"line 4", "\"nan\"", "finite"}},
        BadInput{"StlWordBetweenSolids", "a.stl", stl(good) + "color 1 0 0\n", {"line 10", "expected \"solid\"", "\"color\""}},
        BadInput{"StlBinaryNoTriangles", "a.stl", binary_stl(0, 0, 0), {"byte 80", "0 triangles"}},
        BadInput{"StlBinaryTruncated", "a.stl", binary_stl(3, 2, 0), {"byte 80", "3 triangles need 234 bytes, found 184"}},
        BadInput{"StlBinaryCut", "a.stl", binary_stl(1, 1, 0).substr(0, 100), {"1 triangles need 134 bytes, found 100"}},
        BadInput{"StlBinaryTrailing", "a.stl", binary_stl(1, 1, 0) + "x", {"1 triangles need 134 bytes, found 135"}},
        BadInput{"StlBinaryHugeCount", "a.stl", binary_stl(~0U, 1, 0), {"4294967295 triangles need 214748364834 bytes"}},
        BadInput{"StlBinaryNaN", "a.stl", binary_stl(2, 2, nan_bits), {"byte 112", "coordinate y of triangle 0", "finite"}}),
    name_of_case);

// ---- Gmsh, Abaqus, Nastran; more in their own tests ----

const std::string msh =
    "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n2\n1 0 0 0\n2 1 0 0\n$EndNodes\n$Elements\n1\n1 1 0 1 2\n$EndElements\n";
const std::string inp = "*NODE\n1,0,0,0\n2,1,0,0\n3,0,1,0\n*ELEMENT,TYPE=S3,ELSET=e\n1,1,2,\n3\n*NSET,NSET=n,GENERATE\n1,3,2\n";
const std::string bdf =
    "BEGIN BULK\nGRID*                  1                              0.              0.\n*                     0.\nGRID,2\n"
    "GRID    3       0       1.\nCTRIA3,1,1,1,2,3\nENDDATA\n";

INSTANTIATE_TEST_SUITE_P(
    Decks, BadInputTest,
    testing::Values(
        BadInput{"GmshEmpty", "a.msh", "", {"line 1", "$MeshFormat"}},
        BadInput{"GmshCount", "a.msh", msh.substr(0, 42) + "18446744073709551615\n", {"line 5", "the number of nodes"}},
        BadInput{"GmshBinaryCount",
                 "a.msh",
                 raw("$MeshFormat\n4.1 1 8\n", {1}) + "\n$EndMeshFormat\n" + raw("$Nodes\n", {~0u, ~0u, 1, 0, 1, 0, 1, 0}),
                 {"byte 47", "18446744073709551615", "bytes left"}},
        BadInput{"AbaqusBinary", "a.inp", std::string("*NODE\n\0\x01,2\n", 11), {"line 2", "number of a node"}},
        BadInput{"AbaqusLabelTooLong", "a.inp", "*NODE\n99999999999999999999,0,0,0\n", {"line 2", "number of a node"}},
        BadInput{"NastranBinary", "a.bdf", std::string("GRID,\0\x01\n", 8), {"line 1", "number of a grid point"}},
        BadInput{"NastranNumber", "a.dat", "GRID,1,,1.0.0\n", {"line 1", "\"1.0.0\""}}),
    name_of_case);

// ---- every shorter file ----

std::string vtk(const std::string& version, const std::string& form) {
  return "# vtk DataFile Version " + version + "\ntitle\n" + form + "\nDATASET UNSTRUCTURED_GRID\n";
}

/// A point, and a vertex there.
std::string vtu(const std::string& points, const std::string& corners, const std::string& types) {
  const auto array = [](const std::string& head, const std::string& content) {
    return "<DataArray " + head + " format=\"" + content + "</DataArray>";
  };
  return "<VTKFile type=\"UnstructuredGrid\"><UnstructuredGrid><Piece NumberOfPoints=\"1\" NumberOfCells=\"1\"><Points>" +
         array("type=\"Float32\" NumberOfComponents=\"3\"", points) + "</Points><Cells>" +
         array("type=\"Int32\" Name=\"connectivity\"", corners) + array("type=\"Int32\" Name=\"offsets\"", "ascii\">1") +
         array("type=\"UInt8\" Name=\"types\"", types) + "</Cells></Piece></UnstructuredGrid>";
}

/// Whatever is cut off, a reader gives a mesh or an Error(invalid_argument), and never reads past the end (the sanitizers see
/// that).
TEST(TruncationTest, EveryPrefixIsReadOrRefused) {
  const std::pair<const char*, std::string> files[] = {
      {"a.obj", v3 + "g a\nusemtl b\nf 1/1/1 2/2/2 -1\n"},
      {"a.msh", msh},
      {"a.inp", inp},
      {"a.bdf", bdf},
      {"a.off", "NOFF\n2 1 0\n0 0 0 0 0 1\n1 1 1 0 0 1\n2 0 1 255 255 255\n"},
      {"b.off", raw("OFF BINARY\n", {1, 1, 0, 0, 0, 0, 1, 0, 0})},
      {"a.ply", ply(vertices + faces, "0 0 0\n1 1 1\n3 0 1 1\n")},
      {"b.ply", ply(vertices + faces, two_points + raw("\x03", {0, 1, 1}), little)},
      {"a.stl", stl(good)},
      {"b.stl", binary_stl(2, 2, 0)},
      {"a.su2",
       "NDIME= 2\nNELEM= 1\n5 0 1 2 0\nNPOIN= 3\n0 0 0\n1 0 1\n0 1 2\nNMARK= 1\nMARKER_TAG= a\nMARKER_ELEMS= 1\n3 0 1\n"},
      {"a.vtk", vtk("3.0", "ASCII") + "POINTS 3 float\n0 0 0 1 0 0 0 1 0\nCELLS 1 4\n3 0 1 2\nCELL_TYPES 1\n5\n"},
      {"b.vtk", raw(raw(raw(vtk("2.0", "BINARY") + "POINTS 1 float\n", {0, 0, 0}, std::endian::big) + "\nCELLS 1 2\n", {1, 0},
                        std::endian::big) +
                        "\nCELL_TYPES 1\n",
                    {1}, std::endian::big) +
                    "\nCELL_DATA 1\nSCALARS a int\nLOOKUP_TABLE b\n    "},
      {"a.vtu", vtu("ascii\">0 0 0", "ascii\">0", "ascii\">1") + "</VTKFile>"},
      {"b.vtu", vtu("binary\">DAAAAAAAAAAAAAAAAAAAAA==", "binary\">BAAAAAAAAAA=", "binary\">AQAAAAE=") + "</VTKFile>"},
      {"c.vtu", vtu("appended\" offset=\"0\">", "ascii\">0", "ascii\">1") +
                    raw("<AppendedData encoding=\"raw\">_", {12, 0, 0, 0}) + "</AppendedData></VTKFile>"},
  };
  for (const auto& [name, bytes] : files) {
    ASSERT_NO_THROW(parse_mesh(bytes, name)) << name;
    for (std::size_t size = 0; size < bytes.size(); ++size) {
      try {
        parse_mesh(bytes.substr(0, size), name)->mesh()->validate();
      } catch (const Error& error) {
        EXPECT_EQ(error.code(), ErrorCode::invalid_argument) << name << " cut at " << size << ": " << error.what();
      }
    }
  }
}

// ---- what messages say ----

TEST(BadInputWords, OfMoreThan24CharactersAreCut) {
  const auto expect_found = [](const std::string& word, const std::string& quoted) {
    test::expect_error(ErrorCode::invalid_argument, {"line 1", ("found " + quoted).c_str()},
                       [&] { parse_mesh("v 1 2 " + word + "\n", "a.obj"); });
  };
  expect_found(std::string(24, 'x'), "\"" + std::string(24, 'x') + "\"");
  expect_found(std::string(25, 'x'), "\"" + std::string(24, 'x') + "...\"");
  expect_found("x\xfft", "\"x?t\"");
}

// ---- coordinates to write ----

class BadPointsTest : public testing::Test {
 protected:
  void expect_refused(const Points& points, const std::vector<const char*>& parts) {
    test::expect_error(ErrorCode::invalid_argument, parts, [&] { text_->with_points(points); });
    test::expect_error(ErrorCode::invalid_argument, parts, [&] { binary_->with_points(points); });
  }
  const std::unique_ptr<MeshFile> text_ = parse_mesh(v3, "a.obj");
  const std::unique_ptr<MeshFile> binary_ = parse_mesh(raw("OFF BINARY\n", {3, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0}), "a.off");
};

TEST_F(BadPointsTest, WrongNumber) { expect_refused(Points(4), {"there are 4", "has 3"}); }

TEST_F(BadPointsTest, NotFinite) {
  Points points(3);
  points[1][2] = std::numeric_limits<double>::quiet_NaN();
  expect_refused(points, {"points[1]", "coordinate z", "finite"});
  points[1][2] = std::numeric_limits<double>::infinity();
  expect_refused(points, {"points[1]", "coordinate z", "finite"});
}

TEST_F(BadPointsTest, BeyondTheRangeOfFloats) {
  Points points(3);
  points[2][0] = 1e39;
  EXPECT_NO_THROW(text_->with_points(points));
  test::expect_error(ErrorCode::invalid_argument, {"points[2]", "coordinate x", "32-bit floats"},
                     [&] { binary_->with_points(points); });
}

}  // namespace
}  // namespace deform::io::bad_input_test

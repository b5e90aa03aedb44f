// SPDX-License-Identifier: GPL-3.0-or-later
// VTK's XML files: one tetrahedron and a face of it, in every kind of storage; files of several pieces, polyhedra, surfaces.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>
#include <zlib.h>

#include <bit>

#include "core/base/base64.h"
#include "core/io/binary/byte_order.h"
#include "core/io/mesh_file.h"
#include "tests/support/expect_error.h"

namespace deform::io::vtu_test {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

std::string spoilt(std::string bytes, const std::string& from, const std::string& to) {
  return bytes.replace(bytes.find(from), from.size(), to);
}

const std::string text = R"(<?xml version="1.0"?>
<!-- a comment > with <signs> -->
<VTKFile type="UnstructuredGrid" version="1.0" byte_order="LittleEndian" header_type="UInt64" compressor="vtkLZ4DataCompressor">
  <UnstructuredGrid>
    <FieldData><Array type="String" Name="who" NumberOfTuples="1" format="ascii">97 0</Array></FieldData>
    <Piece NumberOfPoints="4" NumberOfCells='2'>
      <PointData/>
      <CellData Scalars="a &amp; b">
        <DataArray type="Float64" Name="quality" format="ascii">nan 1</DataArray>
        <DataArray type="Int32" Name="a &amp; b" format="ascii">3 4</DataArray>
        <DataArray type="Int32" Name="pairs" NumberOfComponents="2" format="ascii">3 4 5 6</DataArray>
      </CellData>
      <Points>
        <DataArray type="Float64" Name="Points" NumberOfComponents="3" format="ascii" RangeMin="0" RangeMax="2">
          0 0 0   1.0 0 0
          0 +1 0  0 0 2e0
          <InformationKey name="L2_NORM_RANGE" location="vtkDataArray" length="2">
            <Value index="0"> 0 </Value><Value index="1">2.0</Value>
          </InformationKey>
          <InformationKey name="UNITS_LABEL" location="vtkDataArray" length="1"><Value index="0">1</Value></InformationKey>
        </DataArray>
      </Points>
      <Cells>
        <DataArray type="Int64" Name="connectivity" format="ascii" RangeMin="0" RangeMax="3">0 1 2 3 0 2 1</DataArray>
        <DataArray type="Int64" Name="offsets" format="ascii">4 7</DataArray>
        <DataArray type="UInt8" Name="types" format="ascii">10 5</DataArray>
      </Cells>
    </Piece>
  </UnstructuredGrid>
</VTKFile>
)";

void expect_tetrahedron(const MeshFile& file, const std::string& group) {
  const auto mesh = file.mesh();
  EXPECT_EQ(mesh->points, (Points{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 2}}));
  ASSERT_NE(file.elements(), nullptr);
  EXPECT_THAT(file.elements()->nodes(0), ElementsAre(0, 1, 2, 3));
  EXPECT_EQ(mesh->face_count(), 4u);
  ASSERT_NE(mesh->find_group(group), nullptr);
  EXPECT_THAT(mesh->find_group(group)->faces, ElementsAre(0));
}

TEST(Vtu, BlanksAndEndsOfLinesMayStandAroundEqualSigns) {
  const std::string apart =
      spoilt(spoilt(text, "NumberOfPoints=\"4\"", "NumberOfPoints =\n \"4\""), "NumberOfCells='2'", "NumberOfCells\t= '2'");
  const auto file = parse_mesh(apart, "a.vtu");
  expect_tetrahedron(*file, "a & b_4");
  EXPECT_EQ(file->with_points(file->mesh()->points), apart);
}

TEST(Vtu, TextChangesInPlace) {
  const auto file = parse_mesh(text, "a.vtu");
  EXPECT_EQ(file->format(), Format::vtu);
  expect_tetrahedron(*file, "a & b_4");
  EXPECT_EQ(file->with_points(file->mesh()->points), text);
  Points moved = file->mesh()->points;
  for (Vec3& p : moved) p[2] = p[2] == 2 ? 4 : 3;
  std::string expected = spoilt(spoilt(text, "RangeMin=\"0\" RangeMax=\"2\"", "RangeMin=\"3\" RangeMax=\"4\""),
                                "0 0 0   1.0 0 0\n", "0 0 3   1.0 0 3\n");
  expected = spoilt(spoilt(expected, "0 +1 0  0 0 2e0", "0 +1 3  0 0 4"), "> 0 <", "> 3 <");
  EXPECT_EQ(file->with_points(moved), spoilt(expected, ">2.0<", ">4<"));
}

// ---- storage ----

struct Storage {
  std::string name;
  std::endian order;
  std::size_t header_bytes;
  bool compressed, doubles;
  std::string form;        // binary, raw, base64
  bool one_block = false;  // compressed: one block, said to be larger than the others
};
std::ostream& operator<<(std::ostream& out, const Storage& storage) { return out << storage.name; }

class Writer {
 public:
  explicit Writer(const Storage& storage) : storage_(storage) {}

  std::string file() {
    const std::string points = storage_.doubles ? reals<double, std::uint64_t>() : reals<float, std::uint32_t>();
    std::string out = "<VTKFile type=\"UnstructuredGrid\" byte_order=\"";
    out += storage_.order == std::endian::big ? "BigEndian\"" : "LittleEndian\"";
    if (storage_.header_bytes == 8) out += " header_type=\"UInt64\"";
    if (storage_.compressed) out += " compressor=\"vtkZLibDataCompressor\"";
    out += ">\n<UnstructuredGrid><Piece NumberOfPoints=\"4\" NumberOfCells=\"2\">\n<CellData>";
    out += array("Int16", "material", integers<std::int16_t, std::uint16_t>({-3, -4})) + "</CellData>\n<Points>";
    out += array(storage_.doubles ? "Float64" : "Float32", "Points\" NumberOfComponents=\"3", points) + "</Points>\n<Cells>";
    out += array("UInt32", "connectivity", integers<std::uint32_t, std::uint32_t>({0, 1, 2, 3, 0, 2, 1}));
    out += array("Int64", "offsets", integers<std::int64_t, std::uint64_t>({4, 7}));
    out += array("UInt8", "types", "\x0a\x05") + "</Cells></Piece>\n</UnstructuredGrid>\n";
    if (storage_.form != "binary")
      out += "<AppendedData encoding=\"" + storage_.form + "\">\n  _" + appended_ + "\n </AppendedData>\n";
    return out + "</VTKFile>";
  }

 private:
  template <typename T, typename Bits>
  std::string reals() const {
    std::string bytes;
    for (const T value : std::initializer_list<T>{0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 2}) append(bytes, std::bit_cast<Bits>(value));
    return bytes;
  }
  template <typename T, typename Bits>
  std::string integers(std::initializer_list<T> values) const {
    std::string bytes;
    for (const T value : values) append(bytes, static_cast<Bits>(value));
    return bytes;
  }
  template <typename Bits>
  void append(std::string& out, Bits value) const {
    char raw[sizeof(Bits)];
    store_scalar(raw, value, storage_.order);
    out.append(raw, sizeof raw);
  }
  void append_header(std::string& out, std::size_t value) const {
    storage_.header_bytes == 8 ? append(out, std::uint64_t{value}) : append(out, static_cast<std::uint32_t>(value));
  }

  /// Blocks of 40 bytes, the last one smaller; or one block.
  std::string stored(const std::string& values) const {
    const std::size_t block = storage_.one_block ? std::max<std::size_t>(values.size(), 1) : 40;
    std::string header, packed;
    if (storage_.compressed) {
      append_header(header, (values.size() + block - 1) / block);
      append_header(header, storage_.one_block ? 24 : block);
      append_header(header, storage_.one_block ? values.size() : values.size() % block);
      for (std::size_t at = 0; at < values.size(); at += block) {
        const std::string part = values.substr(at, block);
        uLongf size = compressBound(part.size());
        std::string out(size, '\0');
        compress(reinterpret_cast<Bytef*>(out.data()), &size, reinterpret_cast<const Bytef*>(part.data()), part.size());
        append_header(header, size);
        packed += out.substr(0, size);
      }
      return storage_.form == "raw" ? header + packed : base64_encoded(header) + base64_encoded(packed);
    }
    append_header(header, values.size());
    return storage_.form == "raw" ? header + values : base64_encoded(header + values);
  }

  std::string array(const std::string& type, const std::string& name, const std::string& values) {
    const std::string start = "<DataArray type=\"" + type + "\" Name=\"" + name + "\" format=\"";
    if (storage_.form == "binary") return start + "binary\">\n" + stored(values) + "\n</DataArray>\n";
    const std::string offset = std::to_string(appended_.size());
    appended_ += stored(values);
    return start + "appended\" offset=\"" + offset + "\" />\n";
  }

  const Storage& storage_;
  std::string appended_;
};

class VtuStorageTest : public testing::TestWithParam<Storage> {};

TEST_P(VtuStorageTest, IsReadAndWrittenBack) {
  const std::string bytes = Writer(GetParam()).file();
  const auto file = parse_mesh(bytes, "a.vtu");
  expect_tetrahedron(*file, "material_-4");
  EXPECT_EQ(file->with_points(file->mesh()->points), bytes);

  Points moved = file->mesh()->points;
  moved[3] = {0.1, -1e-20, 1.0 / 3};
  Points expected = moved;
  if (!GetParam().doubles) expected[3] = {static_cast<double>(0.1F), static_cast<double>(-1e-20F), static_cast<double>(1 / 3.0F)};
  const std::string written = file->with_points(moved);
  const auto again = parse_mesh(written, "a.vtu");
  EXPECT_EQ(again->mesh()->points, expected);
  EXPECT_EQ(again->mesh()->face_points, file->mesh()->face_points) << "arrays behind the points are found again";
  EXPECT_EQ(again->mesh()->find_group("material_-4")->faces, file->mesh()->find_group("material_-4")->faces);
  EXPECT_EQ(again->with_points(expected), written);
  if (!GetParam().compressed) {
    EXPECT_EQ(written.size(), bytes.size());
    std::size_t changed = 0;
    for (std::size_t i = 0; i < bytes.size(); ++i) changed += bytes[i] != written[i] ? 1 : 0;
    EXPECT_LE(changed, GetParam().form == "raw" ? 24u : 36u);
  }
}

std::vector<Storage> storages() {
  std::vector<Storage> all;
  for (const char* form : {"binary", "raw", "base64"}) {
    for (const bool compressed : {false, true}) {
      for (const std::size_t header : {4, 8}) {
        for (const std::endian order : {std::endian::little, std::endian::big}) {
          const bool doubles = (header == 8) == (order == std::endian::little);
          all.push_back({std::string(form) + (compressed ? "Zlib" : "") + std::to_string(8 * header) +
                             (order == std::endian::big ? "Big" : "Little"),
                         order, header, compressed, doubles, form});
        }
      }
    }
  }
  return all;
}
INSTANTIATE_TEST_SUITE_P(All, VtuStorageTest, testing::ValuesIn(storages()),
                         [](const auto& tested) { return tested.param.name; });

const Storage plain{"", std::endian::little, 4, false, false, "base64"};
const Storage inline_zlib{"", std::endian::little, 4, true, true, "binary"};
const Storage raw_zlib{"", std::endian::little, 4, true, true, "raw"};

TEST(Vtu, Base64OfOtherPrograms) {
  const Storage storage{"", std::endian::little, 4, false, false, "binary"};
  const std::string bytes = Writer(storage).file();
  const std::size_t begin = bytes.find("NumberOfComponents=\"3\" format=\"binary\">\n") + 40, end = bytes.find('\n', begin);
  const std::string joint = bytes.substr(begin, end - begin), values = *base64_decoded(joint);
  // The header as a text of its own, and lines of 20 characters.
  std::string apart = base64_encoded(values.substr(0, 4)) + base64_encoded(values.substr(4));
  for (std::size_t at = 20; at < apart.size(); at += 21) apart.insert(at, 1, '\n');
  const std::string other = std::string(bytes).replace(begin, end - begin, apart);
  const auto file = parse_mesh(other, "a.vtu");
  expect_tetrahedron(*file, "material_-4");
  EXPECT_EQ(file->with_points(file->mesh()->points), other);
  Points moved = file->mesh()->points;
  moved[0][0] = 0.5;
  const std::string written = file->with_points(moved);
  EXPECT_THAT(written, HasSubstr(base64_encoded(values.substr(0, 4)) + "AAAAPw"));
  EXPECT_EQ(parse_mesh(written, "a.vtu")->mesh()->points, moved);
}

TEST(Vtu, TheLastBlockMayBeLargerThanTheOthers) {
  Storage storage = inline_zlib;
  storage.one_block = true;
  const std::string bytes = Writer(storage).file();
  const auto file = parse_mesh(bytes, "a.vtu");
  EXPECT_EQ(file->with_points(file->mesh()->points), bytes);
  Points moved = file->mesh()->points;
  moved[3] = {7, 8, 9};
  EXPECT_EQ(parse_mesh(file->with_points(moved), "a.vtu")->mesh()->points, moved);
}

TEST(Vtu, PiecesFollowEachOther) {
  const std::size_t begin = text.find("    <Piece"), end = text.find("  </UnstructuredGrid>");
  const std::string piece = text.substr(begin, end - begin);
  const std::string bytes = std::string(text).insert(end, piece + "<Piece NumberOfPoints=\"0\" NumberOfCells=\"0\"></Piece>\n");
  const auto file = parse_mesh(bytes, "a.vtu");
  EXPECT_EQ(file->mesh()->point_count(), 8u);
  EXPECT_THAT(file->elements()->nodes(1), ElementsAre(4, 5, 6, 7));
  EXPECT_THAT(file->mesh()->find_group("a & b_4")->faces, ElementsAre(0, 4));
  Points moved = file->mesh()->points;
  moved[5] = {7, 0, 0};
  std::string second = spoilt(spoilt(spoilt(piece, "1.0 0 0", "7 0 0"), "RangeMax=\"2\"", "RangeMax=\"7\""), ">2.0<", ">7<");
  EXPECT_EQ(file->with_points(moved), spoilt(bytes, piece + "<Piece", second + "<Piece"));
}

// ---- polyhedra, surfaces ----

std::string one_polyhedron(const std::string& faces) {
  std::string bytes = spoilt(text, "NumberOfCells='2'", "NumberOfCells='1'");
  const std::size_t begin = bytes.find("<CellData"), end = bytes.find("<Points>");
  bytes.erase(begin, end - begin);
  bytes = spoilt(spoilt(spoilt(bytes, ">0 1 2 3 0 2 1<", ">0 1 2 3<"), ">4 7<", ">4<"), ">10 5<", ">42<");
  return spoilt(bytes, "</Cells>", faces + "</Cells>");
}
std::string ints(const std::string& name, const std::string& values) {
  return "<DataArray type=\"Int64\" Name=\"" + name + "\" format=\"ascii\">" + values + "</DataArray>\n";
}

TEST(Vtu, PolyhedraOfOldAndNewFiles) {
  const std::string old = ints("faces", "4 3 0 2 1 3 0 1 3 3 1 2 3 3 2 0 3") + ints("faceoffsets", "17");
  const std::string now = ints("face_connectivity", "0 1 3 0 2 1 1 2 3 2 0 3") + ints("face_offsets", "3 6 9 12") +
                          ints("polyhedron_to_faces", "1 0 2 3") + ints("polyhedron_offsets", "4");
  for (const std::string& faces : {old, now, spoilt(now, "3 6 9 12", "0 3 6 9 12")}) {
    const auto file = parse_mesh(one_polyhedron(faces), "a.vtu");
    ASSERT_NE(file->cells(), nullptr);
    EXPECT_EQ(file->cells()->cell_count, 1u);
    EXPECT_THAT(file->mesh()->face_points, ElementsAre(0, 2, 1, 0, 1, 3, 1, 2, 3, 2, 0, 3));
  }
}

const std::string surface = R"(<VTKFile type="PolyData" byte_order="LittleEndian"><PolyData>
<Piece NumberOfPoints="4" NumberOfVerts="1" NumberOfLines="1" NumberOfStrips="1" NumberOfPolys="1">
<CellData><DataArray type="UInt8" Name="part" format="ascii">1 2 3 4</DataArray></CellData>
<Points><DataArray type="Float32" NumberOfComponents="3" format="ascii">0 0 0 1 0 0 1 1 0 0 1 0</DataArray></Points>
<Verts><DataArray type="Int32" Name="connectivity" format="ascii">3</DataArray>
<DataArray type="Int32" Name="offsets" format="ascii">1</DataArray></Verts>
<Lines><DataArray type="Int32" Name="connectivity" format="ascii">0 2</DataArray>
<DataArray type="Int32" Name="offsets" format="ascii">2</DataArray></Lines>
<Strips><DataArray type="Int32" Name="connectivity" format="ascii">0 1 3 2</DataArray>
<DataArray type="Int32" Name="offsets" format="ascii">4</DataArray></Strips>
<Polys><DataArray type="Int32" Name="connectivity" format="ascii">0 1 2 3</DataArray>
<DataArray type="Int32" Name="offsets" format="ascii">4</DataArray></Polys>
</Piece></PolyData></VTKFile>
)";

TEST(Vtu, PolyData) {
  const auto file = parse_mesh(surface, "a.vtp");
  EXPECT_EQ(file->format(), Format::vtp);
  const auto mesh = file->mesh();
  EXPECT_THAT(mesh->face_sizes, ElementsAre(4, 3, 3));
  EXPECT_THAT(mesh->find_group("part_1")->points, ElementsAre(3));
  EXPECT_THAT(mesh->find_group("part_3")->faces, ElementsAre(0));
  EXPECT_THAT(mesh->find_group("part_4")->faces, ElementsAre(1, 2));
  Points moved = mesh->points;
  moved[2][2] = -0.5;
  EXPECT_EQ(file->with_points(moved), spoilt(surface, "1 1 0 0 1 0<", "1 1 -0.5 0 1 0<"));
}

// ---- what is wrong ----

struct Refusal {
  std::string bytes;
  std::vector<const char*> message;
};

void expect_refused(const std::vector<Refusal>& table) {
  for (const auto& [bytes, message] : table) {
    SCOPED_TRACE(std::string(message[0]).append(1, ' ').append(message.back()));
    test::expect_error(ErrorCode::invalid_argument, message, [&, &input = bytes] { parse_mesh(input, "a.vtu"); });
  }
}

TEST(Vtu, RefusesWhatIsNoSuchFile) {
  expect_refused({
      {"", {"a.vtu: line 1", "begins with <"}},
      {"<?xml ?>\n<!-- ", {"line 2", "-->"}},
      {"<a", {"line 1", "name of an attribute"}},
      {"<a><b></a>", {"expected </b>"}},
      {"<a>\n<b>", {"line 2", "<b> is not closed"}},
      {"<a x></a>", {"expected = behind"}},
      {"<a x=1></a>", {"quotes"}},
      {"<a x='1></a>", {"closing quote"}},
      {"<a x='1' x='2'></a>", {"\"x\"", "twice"}},
      {"<a><![CDATA[1]]></a>", {"CDATA"}},
      {"<a/>b", {"end of the file"}},
      {surface, {"line 1", "type=\"UnstructuredGrid\""}},
      {"<VTKFile type='UnstructuredGrid'></VTKFile>", {"there is no <UnstructuredGrid>"}},
      {"<VTKFile type='UnstructuredGrid'><UnstructuredGrid/></VTKFile>", {"there is no <Piece>"}},
      {"<VTKFile type='UnstructuredGrid'><UnstructuredGrid><Piece/></UnstructuredGrid></VTKFile>", {"there are no points"}},
      {spoilt(text, "LittleEndian", "Middle"), {"line 3", "byte_order \"Middle\""}},
      {spoilt(text, "UInt64", "Int32"), {"line 3", "header_type \"Int32\""}},
  });
  std::string deep;
  for (int i = 0; i < 100; ++i) deep += "<a>";
  expect_refused({{deep, {"more than 64 deep"}}});
}

TEST(Vtu, RefusesIntegersOfWhichAPartIsMissing) {
  const std::string bytes = Writer({"", std::endian::little, 4, false, false, "binary"}).file();
  const std::size_t begin = bytes.find(">\n", bytes.find("connectivity")) + 2, end = bytes.find('\n', begin);
  std::string values = *base64_decoded(bytes.substr(begin, end - begin));
  values.pop_back();
  --values[0];  // the number of bytes, as it says itself
  expect_refused({{std::string(bytes).replace(begin, end - begin, base64_encoded(values)),
                   {"connectivity", "bytes are no whole number of values"}}});
}

TEST(Vtu, RefusesWrongPointsAndCells) {
  expect_refused({
      {spoilt(text, "NumberOfPoints=\"4\"", "NumberOfPoints=\"four\""), {"line 6", "NumberOfPoints=\"four\""}},
      {spoilt(text, "NumberOfPoints=\"4\"", "NumberOfPoints=\"5\""), {"line 14", "15 numbers, found 12"}},
      {spoilt(text, "NumberOfPoints=\"4\"", "NumberOfPoints=\"3\""), {"line 14", "9 numbers, found more"}},
      {spoilt(text, "NumberOfPoints=\"4\"", "NumberOfPoints=\"400000\""), {"1200000 numbers", "characters"}},
      {spoilt(text, "1.0 0 0", "1.0 x 0"), {"line 15", "\"x\""}},
      {spoilt(text, "1.0 0 0", "1.0 inf 0"), {"line 15", "finite"}},
      {spoilt(text, "Points\" NumberOfComponents=\"3", "Points\" NumberOfComponents=\"2"), {"line 14", "3 components"}},
      {spoilt(text, "\"Float64\" Name=\"Points", "\"Int32\" Name=\"Points"), {"line 14", "Float32 or Float64"}},
      {spoilt(text, "\"Float64\" Name=\"Points", "\"Real\" Name=\"Points"), {"line 14", "unknown type \"Real\""}},
      {spoilt(text, "</Points>", "<DataArray/></Points>"), {"second array of points", "time steps"}},
      {spoilt(text, "format=\"ascii\" RangeMin=\"0\" RangeMax=\"2\"", "format=\"hex\""), {"format \"hex\""}},
      {spoilt(text, "format=\"ascii\" RangeMin=\"0\" RangeMax=\"2\"", "format=\"appended\""), {"no AppendedData"}},
      {spoilt(text, "format=\"ascii\" RangeMin=\"0\" RangeMax=\"2\"", "format=\"binary\""), {"vtkLZ4DataCompressor", "vtkZLib"}},
      {spoilt(text, ">3 4<", ">3<"), {"\"a & b\"", "1 values", "2 cells"}},
      {spoilt(text, "NumberOfCells='2'", "NumberOfCells='3'"), {"types has 2 values", "3 cells"}},
      {spoilt(text, ">10 5<", ">10 256<"), {"type 256"}},
      {spoilt(text, ">10 5<", ">10 13<"), {"cells[1]", "type 13 has 6 points"}},
      {spoilt(text, ">4 7<", ">4 3<"), {"offsets[1] is 3", "4..7"}},
      {spoilt(text, ">4 7<", ">4 8<"), {"offsets[1] is 8", "4..7"}},
      {spoilt(text, ">4 7<", ">7<"), {"offsets has 1 values"}},
      {spoilt(text, ">0 1 2 3 0 2 1<", ">0 1 2 4 0 2 1<"), {"point 4", "the piece has 4 points"}},
      {spoilt(text, ">0 1 2 3 0 2 1<", ">0 1 2 3 0 2 -1<"), {"point -1"}},
      {spoilt(text, "\"connectivity\"", "\"corners\""), {"there is no DataArray \"connectivity\""}},
      {one_polyhedron(""), {"there is no DataArray \"faces\""}},
      {one_polyhedron(ints("faces", "4 3 0 2 1 3 0 1 3 3 1 2 3 3 2 0") + ints("faceoffsets", "17")),
       {"faceoffsets[0] is 17", "0..16"}},
      {one_polyhedron(ints("faces", "5 3 0 2 1 3 0 1 3 3 1 2 3 3 2 0 3") + ints("faceoffsets", "17")),
       {"cells[0]", "face 4 of 5"}},
      {one_polyhedron(ints("faces", "4 3 0 2 1 3 0 1 3 3 1 2 3 3 2 0 4") + ints("faceoffsets", "17")), {"point 4"}},
      {one_polyhedron(ints("faces", "4 3 0 2 1") + ints("faceoffsets", "5 5")), {"for 2 of 1 cells"}},
  });
}

TEST(Vtu, RefusesDamagedStorage) {
  const std::string base64 = Writer(plain).file(), zlib = Writer(inline_zlib).file(), raw = Writer(raw_zlib).file();
  std::string header;
  for (const char size : {3, 40, 16}) header += std::string{size, 0, 0, 0};
  std::string bomb = raw;
  bomb.replace(bomb.find(header) + 4, 4, std::string("\xff\xff\xff\x7f", 4));
  std::string blocks = raw;
  blocks.replace(blocks.find(header), 4, std::string("\xff\xff\xff\x7f", 4));
  const std::string points = *base64_decoded(base64.substr(base64.find("\n  _") + 4 + 12, 72));
  ASSERT_EQ(points.substr(0, 4), std::string("\x30\0\0\0", 4));
  expect_refused({
      {spoilt(base64, "encoding=\"base64\"", "encoding=\"hex\""), {"encoding \"hex\""}},
      {spoilt(base64, "\n  _", "\n"), {"without the _"}},
      {spoilt(base64, "</AppendedData>", ""), {"<AppendedData> is not closed"}},
      {spoilt(base64, "offset=\"0\"", "offset=\"9999\""), {"offset 9999", "bytes of appended data"}},
      {spoilt(base64, "offset=\"0\"", "offset=\"12\""), {"\"material\"", "24 values", "2 cells"}},
      {spoilt(base64, "offset=\"0\"", ""), {"no offset"}},
      {spoilt(base64, "\n  _", "\n  _~"), {"base64"}},
      {spoilt(base64, "NumberOfPoints=\"4\"", "NumberOfPoints=\"5\""), {"15 numbers", "48 bytes of 4"}},
      {spoilt(base64, "<CellData>", "<PointData><DataArray Name=\"a\" format=\"appended\" offset=\"80\"/></PointData><CellData>"),
       {"another array shares"}},
      {bomb, {"\"Points\"", "block 0 claims 2147483647 bytes"}},
      {blocks, {"\"Points\"", "2147483647 blocks"}},
      {spoilt(zlib, "eJ", "eK"), {"block 0 is damaged"}},
      {spoilt(zlib, "\n</DataArray>", "AAAA\n</DataArray>"), {"4 characters too many"}},
      {spoilt(zlib, "\n</DataArray>", "A\n</DataArray>"), {"1 characters too many"}},
  });
}

}  // namespace
}  // namespace deform::io::vtu_test

// SPDX-License-Identifier: GPL-3.0-or-later
// Exodus files made by libnetcdf in every container, with blocks of all types, side sets and node sets.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <atomic>
#include <cmath>
#include <numeric>
#include <random>
#include <thread>

#include "core/io/mesh_file.h"
#include "core/quality/element_quality.h"
#include "tests/core/io/exodus_writer.h"
#include "tests/core/mesh/straight_elements.h"
#include "tests/support/expect_error.h"

namespace deform::io::exodus_test {
namespace {

using test::ExodusWriter;
using testing::ElementsAre;
using Coordinates = ExodusWriter::Coordinates;

const Points house{{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}, {0, 0, 1}, {1, 0, 1}, {1, 1, 1}, {0, 1, 1}, {0.5, 0.5, 1.75}};

/// A cube with a pyramid on top, a shell on the floor and a beam.
ExodusWriter house_writer(Coordinates coordinates) {
  ExodusWriter writer(house, 3, coordinates);
  writer.block("HEX8", 8, {1, 2, 3, 4, 5, 6, 7, 8});
  writer.block("pyramid", 5, {5, 6, 7, 8, 9});
  writer.block("SHELL4", 4, {1, 4, 3, 2});
  writer.block("BEAM", 2, {1, 9});
  writer.side_set({1, 1, 2}, {1, 5, 1});
  writer.side_set({1, 3, 3, 4}, {6, 2, 3, 1});
  writer.node_set({9, 1});
  writer.names("eb", {"body", "roof", "floor", ""}, {10, 20, 30, 40});
  writer.names("ss", {"front", ""}, {7, 8});
  writer.names("ns", {"body"}, {1});
  return writer;
}

const Group& group(const Mesh& mesh, const std::string& name) {
  const Group* found = mesh.find_group(name);
  if (found == nullptr) throw Error(ErrorCode::not_found, "no group " + name);
  return *found;
}

struct Container {
  const char* name;
  int mode;
  nc_type integer = NC_INT, real = NC_DOUBLE;
  Coordinates coordinates = Coordinates::apart;
  bool compressed = false;
};
std::ostream& operator<<(std::ostream& out, const Container& container) { return out << container.name; }

class ExodusContainer : public testing::TestWithParam<Container> {
 protected:
  ExodusContainer() {
    ExodusWriter writer = house_writer(GetParam().coordinates);
    writer.compressed = GetParam().compressed;
    bytes_ = writer.bytes(GetParam().mode, GetParam().integer, GetParam().real);
  }
  std::string bytes_;
};

TEST_P(ExodusContainer, BoundaryGroupsAndElements) {
  const auto file = parse_mesh(bytes_, "a.e");
  EXPECT_EQ(file->format(), Format::exodus);
  const auto mesh = file->mesh();
  EXPECT_EQ(mesh->points, house);
  ASSERT_NE(file->elements(), nullptr);
  EXPECT_EQ(file->elements()->types, (std::vector<ElementType>{ElementType::hexahedron, ElementType::pyramid}));
  EXPECT_EQ(element_quality(mesh->points, *file->elements()).inverted_elements, 0u);
  EXPECT_EQ(mesh->face_count(), 9u);
  // Sides 1 and 5 of the cube are those at y = 0 and z = 0; the first of the pyramid is at y = 0 too.
  EXPECT_THAT(group(*mesh, "front").faces, ElementsAre(0, 1, 5));
  EXPECT_THAT(group(*mesh, "side_set_8").faces, ElementsAre(0));
  EXPECT_THAT(group(*mesh, "side_set_8").points, ElementsAre(0, 3, 4, 5, 6, 7, 8)) << "inside, an edge of the shell, the beam";
  EXPECT_THAT(group(*mesh, "body").points, ElementsAre(0, 8));
  EXPECT_THAT(group(*mesh, "cellZone:body").points, ElementsAre(0, 1, 2, 3, 4, 5, 6, 7));
  EXPECT_THAT(group(*mesh, "roof").points, ElementsAre(4, 5, 6, 7, 8));
  EXPECT_THAT(group(*mesh, "floor").faces, ElementsAre(0));
  EXPECT_THAT(group(*mesh, "block_40").points, ElementsAre(0, 8));
}

TEST_P(ExodusContainer, OnlyCoordinatesChange) {
  const auto file = parse_mesh(bytes_, "a.exo");
  EXPECT_EQ(file->with_points(file->mesh()->points), bytes_);
  Points moved = file->mesh()->points;
  moved[8] = {0.5, 0.25, 2};
  const std::string written = file->with_points(moved);
  const auto back = parse_mesh(written, "a.exo")->mesh();
  EXPECT_EQ(back->points, moved);
  EXPECT_EQ(back->face_points, file->mesh()->face_points);
  EXPECT_EQ(back->groups.size(), file->mesh()->groups.size());
  if (GetParam().compressed) return;
  ASSERT_EQ(written.size(), bytes_.size());
  std::size_t changed = 0;
  for (std::size_t i = 0; i < bytes_.size(); ++i) changed += bytes_[i] != written[i];
  EXPECT_GT(changed, 0u);
  EXPECT_LE(changed, GetParam().real == NC_DOUBLE ? 16u : 8u) << "two numbers";
}

TEST_P(ExodusContainer, RefusesToWrite) {
  const auto file = parse_mesh(bytes_, "a.e");
  Points moved = file->mesh()->points;
  moved[3][1] = 1e39;
  if (GetParam().real == NC_FLOAT) {
    test::expect_error(ErrorCode::invalid_argument, {"points[3]", "coordinate y", "32-bit"}, [&] { file->with_points(moved); });
  } else {
    EXPECT_EQ(parse_mesh(file->with_points(moved), "a.e")->mesh()->points, moved);
  }
  moved[3][1] = std::nan("");
  test::expect_error(ErrorCode::invalid_argument, {"points[3]", "finite"}, [&] { file->with_points(moved); });
  moved.pop_back();
  test::expect_error(ErrorCode::invalid_argument, {"there are 8", "has 9"}, [&] { file->with_points(moved); });
}

// Whatever is cut off is missed. (A damaged HDF5 file can crash libhdf5 itself, see exodus_file.cpp: bits of those are not
// flipped.)
TEST_P(ExodusContainer, TruncatedFiles) {
  for (unsigned part = 0; part < 100; ++part) {
    const std::string cut = bytes_.substr(0, bytes_.size() * part / 100);
    try {
      EXPECT_EQ(parse_mesh(cut, "a.e")->mesh()->points, house) << part;
    } catch (const Error& error) {
      EXPECT_EQ(error.code(), ErrorCode::invalid_argument) << part << ": " << error.what();
    }
  }
}

INSTANTIATE_TEST_SUITE_P(All, ExodusContainer,
                         testing::Values(Container{"classic", 0}, Container{"classic_float", 0, NC_INT, NC_FLOAT},
                                         Container{"classic_together", 0, NC_INT, NC_DOUBLE, Coordinates::together},
                                         Container{"offset64", NC_64BIT_OFFSET}, Container{"data64", NC_64BIT_DATA, NC_INT64},
                                         Container{"netcdf4", NC_NETCDF4},
                                         Container{"netcdf4_float64", NC_NETCDF4, NC_INT64, NC_FLOAT, Coordinates::together},
                                         Container{"netcdf4_compressed", NC_NETCDF4, NC_INT, NC_DOUBLE, Coordinates::together,
                                                   true}),
                         [](const auto& tested) { return std::string(tested.param.name); });

TEST(Exodus, DamagedClassicFiles) {
  const std::string bytes = house_writer(Coordinates::apart).bytes(NC_64BIT_OFFSET);
  std::size_t read = 0, refused = 0;
  for (unsigned seed = 0; seed < 400; ++seed) {
    std::mt19937 random(seed);
    std::string damaged = bytes;
    for (unsigned i = 0; i < 1u << (seed % 5); ++i) damaged[random() % bytes.size()] ^= static_cast<char>(1 << random() % 8);
    try {
      const auto file = parse_mesh(damaged, "a.e");
      Points moved = file->mesh()->points;
      moved[0][0] += 1;
      EXPECT_EQ(file->with_points(moved).size(), bytes.size());
      ++read;
    } catch (const Error& error) {
      EXPECT_EQ(error.code(), ErrorCode::invalid_argument) << seed << ": " << error.what();
      ++refused;
    }
  }
  EXPECT_GT(read, 20u);
  EXPECT_GT(refused, 100u);
}

std::vector<long long> counted(std::size_t n) {
  std::vector<long long> numbers(n);
  std::iota(numbers.begin(), numbers.end(), 1);
  return numbers;
}

TEST(Exodus, EveryElementType) {
  const std::vector<std::tuple<const char*, ElementType>> types{
      {"TETRA", ElementType::tetrahedron}, {"tet4", ElementType::tetrahedron},    {"TETRA10", ElementType::tetrahedron10},
      {"PYRAMID5", ElementType::pyramid},  {"PYRAMID13", ElementType::pyramid13}, {"pyra14", ElementType::pyramid14},
      {"WEDGE", ElementType::prism},       {"WEDGE15", ElementType::prism15},     {"WEDGE18", ElementType::prism18},
      {"HEX", ElementType::hexahedron},    {"HEX20", ElementType::hexahedron20},  {"HEX27", ElementType::hexahedron27}};
  const std::map<std::size_t, double> volumes{{4, 8.0 / 6}, {5, 8.0 / 3}, {6, 4}, {8, 8}};
  for (const auto& [name, type] : types) {
    SCOPED_TRACE(name);
    Points points = straight_elements().at(type);
    if (type == ElementType::hexahedron27) {
      // Figure of the manual: 21 in the middle, then those amid -z, +z, -x, +x, -y, +y.
      const Points last{{1, 1, 1}, {1, 1, 0}, {1, 1, 2}, {0, 1, 1}, {2, 1, 1}, {1, 0, 1}, {1, 2, 1}};
      std::copy(last.begin(), last.end(), points.begin() + 20);
    }
    ExodusWriter writer(points, 3, Coordinates::apart);
    writer.block(name, points.size(), counted(points.size()));
    const std::size_t sides = shape(type).faces.size();
    for (std::size_t side = 1; side <= sides; ++side) writer.side_set({1}, {static_cast<long long>(side)});
    writer.finish();
    const auto file = parse_mesh(writer.bytes(0), "a.e");
    ASSERT_EQ(file->elements()->types, std::vector<ElementType>{type});
    const ElementQuality q = element_quality(file->mesh()->points, *file->elements());
    EXPECT_NEAR(q.total_volume, volumes.at(shape(type).corners), 1e-13);
    EXPECT_EQ(q.inverted_elements, 0u);
    EXPECT_EQ(file->mesh()->points, points) << "never reordered";
    std::set<FaceId> faces;
    for (const Group& g : file->mesh()->groups) faces.insert(g.faces.begin(), g.faces.end());
    EXPECT_EQ(faces.size(), file->mesh()->face_count()) << "every side is one of the boundary";
  }
}

/// The corners of the sides in the tables of the manual, from 1.
TEST(Exodus, SidesAreThoseOfTheManual) {
  const std::vector<std::tuple<const char*, ElementType, std::vector<std::set<PointId>>>> table{
      {"HEX8", ElementType::hexahedron, {{1, 2, 5, 6}, {2, 3, 6, 7}, {3, 4, 7, 8}, {1, 4, 5, 8}, {1, 2, 3, 4}, {5, 6, 7, 8}}},
      {"TETRA4", ElementType::tetrahedron, {{1, 2, 4}, {2, 3, 4}, {1, 3, 4}, {1, 2, 3}}},
      {"WEDGE6", ElementType::prism, {{1, 2, 4, 5}, {2, 3, 5, 6}, {1, 3, 4, 6}, {1, 2, 3}, {4, 5, 6}}},
      {"PYRAMID5", ElementType::pyramid, {{1, 2, 5}, {2, 3, 5}, {3, 4, 5}, {1, 4, 5}, {1, 2, 3, 4}}}};
  for (const auto& [name, type, sides] : table) {
    const Points& points = straight_elements().at(type);
    ExodusWriter writer(points, 3, Coordinates::apart);
    writer.block(name, points.size(), counted(points.size()));
    for (std::size_t side = 1; side <= sides.size(); ++side) writer.side_set({1}, {static_cast<long long>(side)});
    writer.finish();
    const auto mesh = parse_mesh(writer.bytes(0), "a.g")->mesh();
    const auto offsets = mesh->face_offsets();
    for (std::size_t side = 1; side <= sides.size(); ++side) {
      const FaceId face = group(*mesh, "side_set_" + std::to_string(side)).faces.at(0);
      std::set<PointId> corners;
      for (std::uint64_t c = offsets[face]; c < offsets[face + 1]; ++c) corners.insert(mesh->face_points[c] + 1);
      EXPECT_EQ(corners, sides[side - 1]) << name << " side " << side;
    }
  }
}

// Neither libnetcdf nor libhdf5 below it has locks: readers and writers wait for each other.
TEST(Exodus, ManyThreads) {
  const std::string classic = house_writer(Coordinates::apart).bytes(0),
                    netcdf4 = house_writer(Coordinates::together).bytes(NC_NETCDF4);
  std::vector<std::thread> threads;
  std::atomic<int> good = 0;
  for (int t = 0; t < 8; ++t) {
    threads.emplace_back([&, t] {
      for (int i = 0; i < 10; ++i) {
        const auto file = parse_mesh(t % 2 == 0 ? classic : netcdf4, "a.e");
        Points moved = house;
        moved[0][0] = t + i;
        good += parse_mesh(file->with_points(moved), "a.e")->mesh()->points == moved;
      }
    });
  }
  for (auto& thread : threads) thread.join();
  EXPECT_EQ(good, 80);
}

TEST(Exodus, TwoDimensions) {
  const Points points{{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}, {2, 0, 0}, {0.5, 0, 0}};
  ExodusWriter writer(points, 2, Coordinates::apart);
  writer.block("QUAD4", 4, {1, 2, 3, 4});
  writer.block("TRI3", 3, {2, 5, 3});
  writer.side_set({1, 2}, {1, 2});
  writer.finish();
  const auto file = parse_mesh(writer.bytes(0), "a.ex2");
  EXPECT_EQ(file->elements(), nullptr);
  EXPECT_EQ(file->mesh()->points, points);
  EXPECT_EQ(file->mesh()->face_count(), 2u);
  EXPECT_THAT(group(*file->mesh(), "side_set_1").points, ElementsAre(0, 1, 2, 4)) << "edges";
  EXPECT_THAT(group(*file->mesh(), "block_2").faces, ElementsAre(1));
  Points moved = points;
  moved[2] = {1.5, 1.25, 1e-13};
  moved[2][2] = 0;
  EXPECT_EQ(parse_mesh(file->with_points(moved), "a.e")->mesh()->points, moved);
  EXPECT_TRUE(file->two_dimensional());
  moved[2][2] = 1e-13;
  EXPECT_NO_THROW(file->with_points(moved)) << "rounding";
  moved[2][2] = 1e-9;
  test::expect_error(ErrorCode::invalid_argument, {"points[2]", "two-dimensional"}, [&] { file->with_points(moved); });
}

TEST(Exodus, EmptyBlocksKeepTheirNumbers) {
  ExodusWriter writer(house, 3, Coordinates::apart);
  writer.block("HEX8", 8, {1, 2, 3, 4, 5, 6, 7, 8});
  writer.block("PYRAMID", 5, {5, 6, 7, 8, 9});
  writer.side_set({2}, {1});
  writer.finish();
  for (auto& [name, length] : writer.dimensions) {
    if (name == "num_el_blk") length = 3;  // and no connect3
  }
  const auto file = parse_mesh(writer.bytes(0), "a.e");
  EXPECT_EQ(file->elements()->size(), 2u);
  EXPECT_EQ(group(*file->mesh(), "side_set_1").faces.size(), 1u);
}

/// The bytes with the variable or dimension changed by `change`.
template <typename Change>
std::string changed(const Change& change) {
  ExodusWriter writer = house_writer(Coordinates::apart);
  change(writer);
  return writer.bytes(0);
}

test::NetcdfWriter::Variable& variable(ExodusWriter& writer, const std::string& name) {
  for (auto& v : writer.variables) {
    if (v.name == name) return v;
  }
  throw std::runtime_error("no variable " + name);
}

TEST(Exodus, RefusesWhatIsWrong) {
  const std::string bytes = house_writer(Coordinates::apart).bytes(0);
  const auto dimension = [](ExodusWriter& w, const std::string& name, std::size_t length) {
    for (auto& d : w.dimensions) {
      if (d.first == name) d.second = length;
    }
  };
  std::string far = bytes;  // a dimension whose variables would not fit, as bytes
  const std::size_t at = far.find("num_nodes");
  far.replace(at + 12, 4, std::string("\x7f\0\0\0", 4));
  const std::pair<std::string, std::vector<const char*>> table[] = {
      {"", {"a.e"}},
      {"not a container", {"a.e", "Unknown file format"}},
      {bytes.substr(0, bytes.size() - 8), {"a.e: byte", "the file has only"}},
      {bytes.substr(0, 100), {"a.e: byte", "a list of 17 entries", "bytes left"}},
      {far, {"a.e: byte", "the file has only"}},
      {changed([](ExodusWriter& w) {
         w.dimensions[1].first = "n_dim";
         w.variables.clear();
       }),
       {"num_dim", "missing"}},
      {changed([&](ExodusWriter& w) { dimension(w, "num_dim", 1); }), {"1 dimensions of space"}},
      {changed([](ExodusWriter& w) { variable(w, "coordz").name = "coordw"; }), {"coordz", "missing"}},
      {changed([](ExodusWriter& w) { variable(w, "coordz").dimensions = {"num_dim"}; }), {"coordz", "3 coordinates, expected 9"}},
      {changed([](ExodusWriter& w) {
         variable(w, "coordz").integers = {0, 0, 0, 0, 0, 0, 0, 0, 0};
         variable(w, "coordz").reals.clear();
       }),
       {"coordz", "float or double"}},
      {changed([](ExodusWriter& w) { variable(w, "coordz").reals[4] = std::nan(""); }), {"points[4]", "finite"}},
      {changed([](ExodusWriter& w) { variable(w, "connect1").elem_type = "SUPER"; }), {"connect1", "\"SUPER\" of 8 nodes"}},
      {changed([](ExodusWriter& w) { variable(w, "connect1").elem_type = "TETRA8"; }), {"connect1", "\"TETRA8\" of 8 nodes"}},
      {changed([](ExodusWriter& w) { variable(w, "connect1").integers[3] = 10; }), {"connect1", "node 10", "1..9"}},
      {changed([](ExodusWriter& w) { variable(w, "connect1").integers[3] = 0; }), {"connect1", "node 0", "1..9"}},
      {changed([](ExodusWriter& w) { variable(w, "connect1").name = "facconn1"; }), {"polyhedra"}},
      {changed([](ExodusWriter& w) { variable(w, "elem_ss1").integers[0] = 5; }), {"elem_ss1", "element 5"}},
      {changed([](ExodusWriter& w) { variable(w, "side_ss1").integers[0] = 7; }), {"elem_ss1", "side 7 of element 1"}},
      {changed([](ExodusWriter& w) { variable(w, "side_ss2").integers[1] = 0; }), {"elem_ss2", "side 0 of element 3"}},
      {changed([](ExodusWriter& w) {
         variable(w, "side_ss1").dimensions = {"num_dim"}, w.dimensions.emplace_back("x", 1),
                     variable(w, "side_ss1").dimensions = {"x"};
       }),
       {"elem_ss1", "3 elements for 1 sides"}},
      {changed([](ExodusWriter& w) { variable(w, "node_ns1").integers[1] = -1; }), {"node_ns1", "node -1", "1..9"}},
      {changed([](ExodusWriter& w) {
         variable(w, "connect1").reals.assign(8, 1.0);
         variable(w, "connect1").integers.clear();
       }),
       {"connect1", "int or int64"}},
  };
  for (const auto& [input, message] : table) {
    SCOPED_TRACE(message.back());
    test::expect_error(ErrorCode::invalid_argument, message, [&, &text = input] { parse_mesh(text, "a.e"); });
  }
}

}  // namespace
}  // namespace deform::io::exodus_test

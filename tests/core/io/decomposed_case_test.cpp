// SPDX-License-Identifier: GPL-3.0-or-later
// Decomposed OpenFOAM cases: a grid of hexahedra is cut into parts here by the conventions of decomposePar, and has to come back.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cstring>
#include <filesystem>
#include <map>
#include <numeric>
#include <random>

#include "core/io/formats/openfoam/collated_file.h"
#include "core/io/mesh_file.h"
#include "tests/support/expect_error.h"

namespace deform::io::decomposed_case_test {
namespace {

namespace fs = std::filesystem;

using Labels = std::vector<std::int64_t>;

struct Patch {
  std::string name, entries;
  std::size_t first = 0, count = 0;
};

/// A polyMesh as its files have it.
struct Case {
  Points points;
  std::vector<Labels> faces;
  Labels owner, neighbour;
  std::vector<Patch> patches;
  std::map<std::string, Labels> point_zones, face_zones, cell_zones;
};

constexpr std::int64_t nx = 4, ny = 3, nz = 2;

/// Cells and points in rows along x; internal faces by owner and neighbour, then one patch for each side.
Case grid() {
  Case grid;
  const auto point = [](std::int64_t i, std::int64_t j, std::int64_t k) { return i + (nx + 1) * (j + (ny + 1) * k); };
  const auto cell = [](std::int64_t i, std::int64_t j, std::int64_t k) { return i + nx * (j + ny * k); };
  for (int k = 0; k <= nz; ++k) {
    for (int j = 0; j <= ny; ++j) {
      for (int i = 0; i <= nx; ++i) grid.points.push_back({0.1 * i, 0.3 * j + 0.01 * i * k, 0.7 * k});
    }
  }
  const auto across = [&](int axis, std::int64_t i, std::int64_t j, std::int64_t k) -> Labels {  // at the lower side of a cell
    if (axis == 0) return {point(i, j, k), point(i, j + 1, k), point(i, j + 1, k + 1), point(i, j, k + 1)};
    if (axis == 1) return {point(i, j, k), point(i, j, k + 1), point(i + 1, j, k + 1), point(i + 1, j, k)};
    return {point(i, j, k), point(i + 1, j, k), point(i + 1, j + 1, k), point(i, j + 1, k)};
  };
  for (std::int64_t c = 0; c < nx * ny * nz; ++c) {
    const std::int64_t i = c % nx, j = c / nx % ny, k = c / nx / ny;
    for (int axis = 0; axis < 3; ++axis) {
      const std::int64_t a = i + (axis == 0), b = j + (axis == 1), d = k + (axis == 2);
      if (a == nx || b == ny || d == nz) continue;
      grid.faces.push_back(across(axis, a, b, d));
      grid.owner.push_back(c);
      grid.neighbour.push_back(cell(a, b, d));
    }
  }
  const char* names[] = {"inlet", "outlet", "front", "back", "floor", "roof"};
  for (int side = 0; side < 6; ++side) {
    Patch patch{names[side], side < 2 ? "type patch;" : "type wall; inGroups 1(walls);", grid.faces.size(), 0};
    for (std::int64_t c = 0; c < nx * ny * nz; ++c) {
      const std::int64_t at[] = {c % nx, c / nx % ny, c / nx / ny}, size[] = {nx, ny, nz};
      const int axis = side / 2;
      if (at[axis] != (side % 2 == 0 ? 0 : size[axis] - 1)) continue;
      std::int64_t to[] = {at[0], at[1], at[2]};
      to[axis] += side % 2;
      grid.faces.push_back(across(axis, to[0], to[1], to[2]));
      if (side % 2 == 0) std::reverse(grid.faces.back().begin() + 1, grid.faces.back().end());
      grid.owner.push_back(c);
      ++patch.count;
    }
    grid.patches.push_back(patch);
  }
  grid.point_zones["probe"] = {3, 17, 30};
  grid.face_zones["middle"] = {0, 5, 6, 20, 50};
  grid.cell_zones["core"] = {1, 2, 9, 14, 22};
  return grid;
}

std::string header(const std::string& type, bool binary = false) {
  return "FoamFile { version 2.0; format " + std::string(binary ? "binary" : "ascii") +
         "; arch \"LSB;label=64;scalar=64\"; class " + type + "; }\n";
}

std::string text(const Labels& labels) {
  std::string all = std::to_string(labels.size()) + "(";
  for (const auto label : labels) all += std::to_string(label) + " ";
  return all + ")\n";
}

std::string zones(const std::map<std::string, Labels>& all, const std::string& key) {
  std::string out = header("regIOobject") + std::to_string(all.size()) + "(";
  for (const auto& [name, members] : all) out += name + " { type zone; " + key + " List<label> " + text(members) + "; }\n";
  return out + ")\n";
}

void write_case(const Case& mesh, const fs::path& folder) {
  fs::create_directories(folder);
  std::string points = header("vectorField") + std::to_string(mesh.points.size()) + "\n(\n";
  for (const Vec3& p : mesh.points) {
    char line[128];
    std::snprintf(line, sizeof line, "(%.17g %.17g %.17g)\n", p[0], p[1], p[2]);
    points += line;
  }
  write_file(folder / "points", points + ")\n");
  std::string faces = header("faceList") + std::to_string(mesh.faces.size()) + "(\n";
  for (const Labels& face : mesh.faces) faces += text(face);
  write_file(folder / "faces", faces + ")\n");
  write_file(folder / "owner", header("labelList") + text(mesh.owner));
  write_file(folder / "neighbour", header("labelList") + text(mesh.neighbour));
  std::string boundary = header("polyBoundaryMesh") + std::to_string(mesh.patches.size()) + "(\n";
  for (const Patch& patch : mesh.patches) {
    boundary += patch.name + " { " + patch.entries + " nFaces " + std::to_string(patch.count) + "; startFace " +
                std::to_string(patch.first) + "; }\n";
  }
  write_file(folder / "boundary", boundary + ")\n");
  write_file(folder / "pointZones", zones(mesh.point_zones, "pointLabels"));
  write_file(folder / "faceZones", zones(mesh.face_zones, "faceLabels"));
  write_file(folder / "cellZones", zones(mesh.cell_zones, "cellLabels"));
}

void write_addresses(const fs::path& file, const Labels& labels, bool binary) {
  if (!binary) return write_file(file, header("labelList") + text(labels));
  std::string bytes = header("labelList", true) + std::to_string(labels.size()) + "(";
  bytes.append(reinterpret_cast<const char*>(labels.data()), 8 * labels.size());
  write_file(file, bytes + ")\n");
}

/// Writes one part: cells and points in their order, internal faces, the faces of each patch, then those shared with each other
/// part, which run the other way round where the owner is elsewhere.
void write_part(const Case& whole, const std::vector<int>& part_of, int part, int parts, const fs::path& folder, bool binary) {
  const auto at = [&](const Labels& cells, std::size_t f) { return part_of[static_cast<std::size_t>(cells[f])]; };
  std::map<std::int64_t, std::int64_t> cells, points;
  Labels cell_addresses, point_addresses, face_addresses;
  for (std::size_t c = 0; c < part_of.size(); ++c) {
    if (part_of[c] != part) continue;
    cells[static_cast<std::int64_t>(c)] = static_cast<std::int64_t>(cell_addresses.size());
    cell_addresses.push_back(static_cast<std::int64_t>(c));
  }
  const auto add = [&](std::size_t f, bool turned) {
    face_addresses.push_back((turned ? -1 : 1) * static_cast<std::int64_t>(f + 1));
  };
  Case mesh;
  for (std::size_t f = 0; f < whole.neighbour.size(); ++f) {
    if (at(whole.owner, f) == part && at(whole.neighbour, f) == part) add(f, false);
  }
  const std::size_t internal = face_addresses.size();
  for (Patch patch : whole.patches) {
    const std::size_t first = patch.first, end = patch.first + patch.count;
    patch.first = face_addresses.size();
    for (std::size_t f = first; f < end; ++f) {
      if (at(whole.owner, f) == part) add(f, false);
    }
    patch.count = face_addresses.size() - patch.first;
    mesh.patches.push_back(patch);
  }
  for (int other = 0; other < parts; ++other) {
    if (other == part) continue;
    Patch patch{"procBoundary" + std::to_string(part) + "to" + std::to_string(other), "type processor; inGroups 1(processor);",
                face_addresses.size(), 0};
    for (std::size_t f = 0; f < whole.neighbour.size(); ++f) {
      if (at(whole.owner, f) == part && at(whole.neighbour, f) == other) add(f, false);
      if (at(whole.owner, f) == other && at(whole.neighbour, f) == part) add(f, true);
    }
    patch.count = face_addresses.size() - patch.first;
    mesh.patches.push_back(patch);
  }
  std::vector<char> used(whole.points.size());
  for (const auto face : face_addresses) {
    for (const auto p : whole.faces[static_cast<std::size_t>(std::abs(face) - 1)]) used[static_cast<std::size_t>(p)] = 1;
  }
  for (std::size_t p = 0; p < used.size(); ++p) {
    if (!used[p]) continue;
    points[static_cast<std::int64_t>(p)] = static_cast<std::int64_t>(point_addresses.size());
    point_addresses.push_back(static_cast<std::int64_t>(p));
    mesh.points.push_back(whole.points[p]);
  }
  std::map<std::int64_t, std::int64_t> faces;
  for (std::size_t i = 0; i < face_addresses.size(); ++i) {
    const auto f = static_cast<std::size_t>(std::abs(face_addresses[i]) - 1);
    const bool turned = face_addresses[i] < 0;
    faces[static_cast<std::int64_t>(f)] = static_cast<std::int64_t>(i);
    Labels corners;
    for (const auto p : whole.faces[f]) corners.push_back(points.at(p));
    if (turned) std::reverse(corners.begin() + 1, corners.end());
    mesh.faces.push_back(corners);
    mesh.owner.push_back(cells.at(turned ? whole.neighbour[f] : whole.owner[f]));
    if (i < internal) mesh.neighbour.push_back(cells.at(whole.neighbour[f]));
  }
  const auto mine = [](const auto& zones, const auto& local) {
    std::map<std::string, Labels> part_zones;
    for (const auto& [name, members] : zones) {
      part_zones[name];
      for (const auto member : members) {
        if (local.contains(member)) part_zones[name].push_back(local.at(member));
      }
    }
    return part_zones;
  };
  mesh.point_zones = mine(whole.point_zones, points);
  mesh.face_zones = mine(whole.face_zones, faces);
  mesh.cell_zones = mine(whole.cell_zones, cells);
  write_case(mesh, folder);
  write_addresses(folder / "pointProcAddressing", point_addresses, binary);
  write_addresses(folder / "faceProcAddressing", face_addresses, binary);
  write_addresses(folder / "cellProcAddressing", cell_addresses, binary);
}

class DecomposedCase : public testing::Test {
 protected:
  DecomposedCase() : base_(fs::path(testing::TempDir()) / ("decomposed_" + std::to_string(::getpid()))), case_(base_ / "parts") {
    fs::remove_all(base_);
    fs::create_directories(case_ / "constant");
    write_case(grid(), base_ / "whole" / "constant" / "polyMesh");
  }
  ~DecomposedCase() override { fs::remove_all(base_); }

  /// Every cell goes to one of the parts, by chance.
  void decompose(int parts, unsigned seed, bool binary = false) {
    std::mt19937 random(seed);
    std::vector<int> part_of;
    for (int c = 0; c < nx * ny * nz; ++c)
      part_of.push_back(c < parts ? c : static_cast<int>(random() % static_cast<unsigned>(parts)));
    for (int part = 0; part < parts; ++part) write_part(grid(), part_of, part, parts, mesh_of(part), binary);
  }
  /// The same parts as the file handler "collated" writes them, in folders of so many parts each; the folders of the parts go.
  /// Sizes of odd parts have a leading zero, which must stay where they hold.
  void collate(const std::vector<int>& folders) {
    int parts = 0, first = 0;
    for (const int count : folders) parts += count;
    for (const int count : folders) {
      std::string name = "processors" + std::to_string(parts);
      if (folders.size() > 1) name += "_" + std::to_string(first) + "-" + std::to_string(first + count - 1);
      fs::create_directories(case_ / name / "constant" / "polyMesh");
      for (const auto& file : fs::directory_iterator(mesh_of(first))) {
        std::string all = "// from decomposePar\nFoamFile { version 2.0; format binary; class decomposedBlockData; object x; }\n";
        for (int part = first; part < first + count; ++part) {
          std::string content = read_file(mesh_of(part) / file.path().filename());
          if (part > first) content = "\n" + content.substr(content.find("}\n") + 2);
          all += "\n// Processor" + std::to_string(part) + "\n\n" + (part % 2 == 1 ? "0" : "") + std::to_string(content.size()) +
                 "\n(" + content + ")\n";
        }
        write_file(case_ / name / "constant" / "polyMesh" / file.path().filename(), all);
      }
      first += count;
    }
    for (int part = 0; part < parts; ++part) fs::remove_all(case_ / ("processor" + std::to_string(part)));
  }
  fs::path mesh_of(int part) const { return case_ / ("processor" + std::to_string(part)) / "constant" / "polyMesh"; }
  std::string bytes(int part, const char* name) const { return read_file(mesh_of(part) / name); }

  void expect_refused(ErrorCode code, const std::vector<const char*>& words) const {
    test::expect_error(code, words, [&] { read_mesh_file(case_); });
  }

  const fs::path base_, case_;
};

void expect_same(const Mesh& whole, const Mesh& parts) {
  EXPECT_EQ(parts.points, whole.points);
  EXPECT_EQ(parts.face_sizes, whole.face_sizes);
  EXPECT_EQ(parts.face_points, whole.face_points);
  EXPECT_EQ(parts.cells->cell_count, whole.cells->cell_count);
  EXPECT_EQ(parts.cells->owner, whole.cells->owner);
  EXPECT_EQ(parts.cells->neighbour, whole.cells->neighbour);
  EXPECT_EQ(parts.cells->face_offsets, whole.cells->face_offsets);
  EXPECT_EQ(parts.cells->face_points, whole.cells->face_points);
  ASSERT_EQ(parts.groups.size(), whole.groups.size());
  for (std::size_t g = 0; g < whole.groups.size(); ++g) {
    EXPECT_EQ(parts.groups[g].name, whole.groups[g].name);
    EXPECT_EQ(parts.groups[g].faces, whole.groups[g].faces) << whole.groups[g].name;
    EXPECT_EQ(parts.groups[g].points, whole.groups[g].points) << whole.groups[g].name;
  }
}

TEST_F(DecomposedCase, PartsAreOneMeshAsBeforeBitForBit) {
  const auto whole = read_mesh_file(base_ / "whole");
  ASSERT_EQ(whole->mesh()->groups.size(), 10u);
  for (const int parts : {1, 2, 4, 7}) {
    SCOPED_TRACE(parts);
    fs::remove_all(case_);
    decompose(parts, static_cast<unsigned>(parts), parts == 4);
    const auto file = read_mesh_file(case_);
    EXPECT_EQ(file->case_parts(), static_cast<std::size_t>(parts));
    expect_same(*whole->mesh(), *file->mesh());
  }
}

TEST_F(DecomposedCase, AnotherMeshInConstantIsThatOfTheCase) {
  decompose(3, 1);
  fs::copy(base_ / "whole" / "constant", case_ / "constant", fs::copy_options::recursive);
  EXPECT_EQ(read_mesh_file(case_)->case_parts(), 0u);
  EXPECT_EQ(read_mesh_file(case_ / "processor*")->case_parts(), 3u);
  EXPECT_EQ(read_mesh_file(case_ / "processor*" / "constant")->case_parts(), 3u);
  EXPECT_EQ(read_mesh_file(case_ / "processor1")->case_parts(), 0u);
}

TEST_F(DecomposedCase, EveryPartGetsItsPoints) {
  decompose(4, 5);
  const auto file = read_mesh_file(case_);
  Points moved = file->mesh()->points;
  for (Vec3& p : moved) p[2] += p[0] * p[1];
  write_mesh_file(*file, moved, case_ / "0.5");
  EXPECT_EQ(read_mesh_file(case_ / "processor*" / "0.5")->mesh()->points, moved);
  EXPECT_TRUE(fs::exists(case_ / "processor3" / "0.5" / "polyMesh" / "points"));
  EXPECT_FALSE(fs::exists(case_ / "0.5"));
  for (const fs::path& written : {case_ / "0.5", case_ / "0.5" / "", case_ / "." / "0.5"}) {
    EXPECT_EQ(read_mesh_file(written)->mesh()->points, moved) << "by the name it was given: " << written;
  }
  test::expect_error(ErrorCode::not_found, {"0.7", "no such file or folder"}, [&] { read_mesh_file(case_ / "0.7"); });
  EXPECT_EQ(read_mesh_file(case_)->mesh()->points, file->mesh()->points) << "the original stays";
  write_mesh_file(*file, moved, base_ / "elsewhere");
  write_mesh_file(*file, moved, case_ / "processor*" / "1");
  for (int part = 0; part < 4; ++part) {
    const fs::path name = "processor" + std::to_string(part);
    const std::string points = read_file(case_ / name / "0.5" / "polyMesh" / "points");
    EXPECT_EQ(read_file(base_ / "elsewhere" / name / "polyMesh" / "points"), points);
    EXPECT_EQ(read_file(case_ / name / "1" / "polyMesh" / "points"), points);
  }
  write_mesh_file(*file, file->mesh()->points, case_ / "2");
  EXPECT_EQ(read_file(case_ / "processor2" / "2" / "polyMesh" / "points"), bytes(2, "points")) << "byte for byte";
  test::expect_error(ErrorCode::failed_precondition, {"4 parts"}, [&] { file->with_points(moved); });
}

TEST_F(DecomposedCase, OutputsThatReplaceOrHideThePartsAreRefused) {
  decompose(2, 3);
  for (const fs::path& output : {case_ / "processor*" / "constant", case_ / "constant", case_ / "processor*"}) {
    EXPECT_TRUE(replaced_source(case_, output)) << output;
  }
  for (const fs::path& output : {case_ / "1", case_ / "processor*" / "1", base_ / "elsewhere"}) {
    EXPECT_FALSE(replaced_source(case_, output)) << output;
    EXPECT_NO_THROW(check_output(case_, output)) << output;
  }
  test::expect_error(ErrorCode::invalid_argument, {"is a decomposed OpenFOAM case", "parts/1"},
                     [&] { check_output(case_, case_); });
  test::expect_error(ErrorCode::invalid_argument, {"one part", "all its parts"},
                     [&] { check_output(case_, case_ / "processor0" / "1"); });
  test::expect_error(ErrorCode::invalid_argument, {"is one file", "2 parts"},
                     [&] { check_output(case_, base_ / "elsewhere" / "points"); });
  EXPECT_EQ(source_file(case_), fs::canonical(case_) / "processor*" / "constant" / "polyMesh" / "points");
  EXPECT_TRUE(mesh_exists(case_ / "processor*"));
  const auto file = read_mesh_file(case_);
  Points moved = file->mesh()->points;
  moved[7][1] += 0.25;
  write_mesh_file(*file, moved, source_file(case_));
  EXPECT_EQ(read_mesh_file(case_)->mesh()->points, moved) << "in place";
}

TEST_F(DecomposedCase, RefusesAddressesThatDoNotFit) {
  const auto spoil = [&](const char* name, const auto& change) {
    fs::remove_all(case_);
    decompose(2, 3);
    std::string content = bytes(1, name);
    change(content);
    write_file(mesh_of(1) / name, content);
  };
  const auto replace_list = [&](const auto& change) {
    return [change](std::string& content) {
      const std::size_t open = content.find('(');
      std::vector<std::string> words;
      std::istringstream in(content.substr(open + 1, content.size() - open - 3));
      for (std::string word; in >> word;) words.push_back(word);
      change(words);
      content = header("labelList") + std::to_string(words.size()) + "(";
      for (const auto& word : words) content += word + " ";
      content += ")\n";
    };
  };
  spoil("pointProcAddressing", replace_list([](auto& words) { words.pop_back(); }));
  expect_refused(ErrorCode::invalid_argument, {"processor1", "pointProcAddressing", "entries for the", "reconstructParMesh"});
  spoil("cellProcAddressing", replace_list([](auto& words) { words.push_back("1"); }));
  expect_refused(ErrorCode::invalid_argument, {"cellProcAddressing", "entries for the"});
  spoil("faceProcAddressing", replace_list([](auto& words) { words[2] = "0"; }));
  expect_refused(ErrorCode::invalid_argument, {"faceProcAddressing", "entry 2 is 0", "counted from 1"});
  spoil("faceProcAddressing", replace_list([](auto& words) { words[2] = "4000000000"; }));
  expect_refused(ErrorCode::invalid_argument, {"faceProcAddressing", "entry 2 is 4000000000", "together"});
  spoil("pointProcAddressing", replace_list([](auto& words) { words[2] = "4000000000"; }));
  expect_refused(ErrorCode::invalid_argument, {"pointProcAddressing", "entry 2 is 4000000000", "together"});
  spoil("faceProcAddressing", replace_list([](auto& words) { words[1] = words[0]; }));
  expect_refused(ErrorCode::invalid_argument, {"faceProcAddressing", "entry 1", "same side"});
  spoil("faceProcAddressing", replace_list([](auto& words) { words.back() = std::to_string(-std::stoll(words.back())); }));
  expect_refused(ErrorCode::invalid_argument, {"faceProcAddressing"});
  spoil("pointProcAddressing", replace_list([](auto& words) { std::swap(words[0], words[5]); }));
  expect_refused(ErrorCode::invalid_argument, {"processor1", "point", "is not where", "processor0"});
  spoil("points", [](std::string& content) { content.replace(content.find("(0 "), 3, "(5 "); });
  expect_refused(ErrorCode::invalid_argument, {"processor1", "is not where"});
}

TEST_F(DecomposedCase, SaysWhichPartIsMissing) {
  decompose(3, 3);
  fs::remove_all(case_ / "processor1");
  expect_refused(ErrorCode::not_found, {"processor1", "2 folders"});
  test::expect_error(ErrorCode::not_found, {"no folder", "processor0"}, [&] { read_mesh_file(base_ / "whole" / "processor*"); });
  fs::rename(case_ / "processor2", case_ / "processor1");
  expect_refused(ErrorCode::invalid_argument, {"Addressing"});
  fs::remove_all(case_);
  decompose(2, 3);
  fs::remove(mesh_of(1) / "cellProcAddressing");
  expect_refused(ErrorCode::not_found, {"processor1", "cellProcAddressing", "reconstructParMesh"});
  fs::remove_all(case_);
  fs::create_directories(case_ / "processors4" / "constant" / "polyMesh");
  expect_refused(ErrorCode::invalid_argument, {"without a mesh in its collated parts", "processors4"});
}

// ---- collated ----

TEST_F(DecomposedCase, CollatedPartsAreOneMeshAsBeforeBitForBit) {
  const auto whole = read_mesh_file(base_ / "whole");
  for (const std::vector<int>& folders : std::vector<std::vector<int>>{{1}, {4}, {2, 2}, {3, 1, 3}}) {
    for (const bool binary : {false, true}) {
      SCOPED_TRACE(testing::PrintToString(folders) + (binary ? " binary" : ""));
      fs::remove_all(case_);
      const int parts = std::accumulate(folders.begin(), folders.end(), 0);
      decompose(parts, static_cast<unsigned>(parts), binary);
      collate(folders);
      const auto file = read_mesh_file(case_);
      EXPECT_EQ(file->case_parts(), static_cast<std::size_t>(parts));
      expect_same(*whole->mesh(), *file->mesh());
    }
  }
  for (const char* place : {"processor*", "processors7_3-3", "processor*/constant", "processors7_0-2/constant"}) {
    EXPECT_EQ(read_mesh_file(case_ / place)->case_parts(), 7u) << place;
  }
}

TEST_F(DecomposedCase, EveryFolderOfCollatedPartsGetsItsPoints) {
  for (const std::vector<int>& folders : std::vector<std::vector<int>>{{4}, {1, 3}}) {
    SCOPED_TRACE(testing::PrintToString(folders));
    fs::remove_all(base_);
    decompose(4, 5);
    collate(folders);
    const std::string last = folders.size() == 1 ? "processors4" : "processors4_1-3";
    const std::string before = read_file(case_ / last / "constant" / "polyMesh" / "points");
    const auto file = read_mesh_file(case_);
    Points moved = file->mesh()->points;
    for (Vec3& p : moved) p[2] += p[0] * p[1] / 3;
    write_mesh_file(*file, moved, case_ / "0.5");
    EXPECT_EQ(read_mesh_file(case_ / "processor*" / "0.5")->mesh()->points, moved);
    EXPECT_EQ(read_mesh_file(case_ / last / "0.5")->mesh()->points, moved);
    EXPECT_EQ(read_mesh_file(case_ / "0.5")->mesh()->points, moved);
    EXPECT_FALSE(fs::exists(case_ / "0.5"));
    EXPECT_EQ(read_mesh_file(case_)->mesh()->points, file->mesh()->points) << "the original stays";
    write_mesh_file(*file, moved, base_ / "elsewhere");
    write_mesh_file(*file, moved, case_ / "processor*" / "1");
    write_mesh_file(*file, moved, case_ / last / "3");
    const std::string points = read_file(case_ / last / "0.5" / "polyMesh" / "points");
    EXPECT_NE(points.size(), before.size()) << "blocks have other sizes";
    EXPECT_EQ(read_file(base_ / "elsewhere" / last / "polyMesh" / "points"), points);
    for (const char* time : {"1", "3"}) EXPECT_EQ(read_file(case_ / last / time / "polyMesh" / "points"), points);
    write_mesh_file(*file, file->mesh()->points, case_ / "2");
    EXPECT_EQ(read_file(case_ / last / "2" / "polyMesh" / "points"), before) << "byte for byte";
    EXPECT_EQ(source_file(case_), fs::canonical(case_) / "processor*" / "constant" / "polyMesh" / "points");
    write_mesh_file(*file, moved, source_file(case_));
    EXPECT_EQ(read_mesh_file(case_)->mesh()->points, moved) << "in place";
  }
}

TEST_F(DecomposedCase, OutputsThatReplaceOrHideCollatedPartsAreRefused) {
  decompose(2, 3);
  collate({2});
  for (const fs::path& output : {case_ / "processor*" / "constant", case_ / "processors2" / "constant", case_ / "processors2"}) {
    EXPECT_TRUE(replaced_source(case_, output)) << output;
  }
  for (const fs::path& output : {case_ / "1", case_ / "processors2" / "1", base_ / "elsewhere"}) {
    EXPECT_FALSE(replaced_source(case_, output)) << output;
    EXPECT_NO_THROW(check_output(case_, output)) << output;
  }
  test::expect_error(ErrorCode::invalid_argument, {"is a decomposed OpenFOAM case", "parts/1"},
                     [&] { check_output(case_, case_); });
  test::expect_error(ErrorCode::invalid_argument, {"one part", "all its parts"},
                     [&] { check_output(case_, case_ / "processors4" / "1"); });
}

TEST_F(DecomposedCase, RefusesCollatedPartsThatDoNotFit) {
  const auto spoiled = [&](const char* name, const auto& change, const std::vector<const char*>& words) {
    fs::remove_all(case_);
    decompose(3, 3);
    collate({3});
    const fs::path path = case_ / "processors3" / "constant" / "polyMesh" / name;
    std::string content = read_file(path);
    change(content);
    write_file(path, content);
    expect_refused(ErrorCode::invalid_argument, words);
  };
  const auto replace = [](const char* from, const char* to) {
    return [from, to](std::string& content) { content.replace(content.find(from), std::strlen(from), to); };
  };
  spoiled("points", replace("decomposedBlockData", "vectorField"), {"processors3", "points", "decomposedBlockData"});
  spoiled("faces", [](std::string& content) { content.resize(content.size() - 9); }, {"faces", "the size of a part is", "left"});
  spoiled("owner", [](std::string& content) { content.resize(content.find("// Processor2")); }, {"owner", "has 2 parts", "of 3"});
  spoiled("owner", [](std::string& content) { content += "4\n(abcd)"; }, {"owner", "has 4 parts", "of 3"});
  spoiled("points", replace("// Processor1\n\n", "// Processor1\n\n1"), {"points", "the size of a part is"});
  spoiled("pointProcAddressing", replace("\n// Processor1", "\n// Processor1\n5\n(\n1(0))\n//"), {"pointProcAddressing"});
  spoiled("pointProcAddressing",
          [](std::string& content) {
            const std::size_t list = content.find('(', content.find("// Processor1"));
            content[content.find(' ', list)] = '_';
          },
          {"pointProcAddressing (part 1)"});
  fs::remove_all(case_);
  decompose(3, 3);
  collate({2, 1});
  fs::rename(case_ / "processors3_0-1", case_ / "processors3_1-1");
  expect_refused(ErrorCode::not_found, {"part 0 of the 3"});
  fs::rename(case_ / "processors3_1-1", case_ / "processors3_0-1");
  fs::create_directories(case_ / "processors3_1-2");
  expect_refused(ErrorCode::not_found, {"part 2 of the 3"});
  fs::remove(case_ / "processors3_1-2");
  fs::create_directories(case_ / "processors5");
  expect_refused(ErrorCode::invalid_argument, {"processors3_0-1", "processors5", "name one"});
  EXPECT_EQ(read_mesh_file(case_ / "processors3_0-1")->case_parts(), 3u);
  fs::remove(case_ / "processors3_2-2" / "constant" / "polyMesh" / "cellProcAddressing");
  test::expect_error(ErrorCode::not_found, {"processors3_2-2", "cellProcAddressing", "reconstructParMesh"},
                     [&] { read_mesh_file(case_ / "processors3_0-1"); });
}

TEST(CollatedFile, IsToldByItsClass) {
  const auto header = [](const std::string& type) { return "FoamFile { version 2.0; format ascii; class " + type + "; }\n2\n"; };
  EXPECT_TRUE(is_collated(header("decomposedBlockData")));
  EXPECT_FALSE(is_collated(header("vectorField")));
  EXPECT_FALSE(is_collated("2((0 0 0) (1 0 0))"));
  EXPECT_FALSE(is_collated("FoamFile { class decomposedBlockData"));
  EXPECT_FALSE(is_collated(""));
}

}  // namespace
}  // namespace deform::io::decomposed_case_test

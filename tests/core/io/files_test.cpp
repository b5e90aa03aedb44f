// SPDX-License-Identifier: GPL-3.0-or-later
// Files on disk: reading, packing, replacing, new files.

#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>

#include "core/io/gzip.h"
#include "core/io/mesh_file.h"
#include "core/mesh/ahmed.h"
#include "tests/support/expect_error.h"

namespace deform::io::files_test {
namespace {

namespace fs = std::filesystem;

class FilesTest : public testing::Test {
 protected:
  FilesTest()
      : folder_(fs::path(testing::TempDir()) / ("files_test_" + std::to_string(::getpid()) + "_" +
                                                std::string(testing::UnitTest::GetInstance()->current_test_info()->name()))) {
    fs::remove_all(folder_);
    fs::create_directories(folder_);
  }
  ~FilesTest() override { fs::remove_all(folder_); }

  fs::path path(const std::string& name) const { return folder_ / name; }
  std::vector<std::string> listing() const {
    std::vector<std::string> names;
    for (const auto& entry : fs::directory_iterator(folder_)) names.push_back(entry.path().filename());
    return names;
  }
  static std::string stored(const fs::path& file) {
    std::ifstream in(file, std::ios::binary);
    return {std::istreambuf_iterator<char>(in), {}};
  }
  const fs::path folder_;
};

const std::string text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";

TEST_F(FilesTest, WhatIsWrittenIsRead) {
  bool was_gzip = true;
  write_file(path("a.obj"), text);
  EXPECT_EQ(read_file(path("a.obj"), &was_gzip), text);
  EXPECT_FALSE(was_gzip);
  write_file(path("empty"), "");
  EXPECT_EQ(read_file(path("empty")), "");
}

TEST_F(FilesTest, GzipByExtensionWhenWritingAndByContentWhenReading) {
  write_file(path("a.obj.gz"), text);
  EXPECT_TRUE(is_gzip(stored(path("a.obj.gz"))));
  fs::rename(path("a.obj.gz"), path("b.obj"));
  bool was_gzip = false;
  EXPECT_EQ(read_file(path("b.obj"), &was_gzip), text);
  EXPECT_TRUE(was_gzip);
  EXPECT_TRUE(read_mesh_file(path("b.obj"))->compressed);
  fs::rename(path("b.obj"), path("c.obj.gz"));
  write_file(path("c.obj"), text);
  fs::rename(path("c.obj"), path("plain.obj.gz"));
  EXPECT_FALSE(read_mesh_file(path("plain.obj.gz"))->compressed);
  EXPECT_EQ(read_mesh_file(path("plain.obj.gz"))->mesh()->point_count(), 3U);
}

TEST_F(FilesTest, GzipMembersFollowOneAnother) {
  write_file(path("two"), gzip(text) + gzip("v 5 5 5\n") + std::string(100, '\0'));
  EXPECT_EQ(read_file(path("two")), text + "v 5 5 5\n");
  write_file(path("junk"), gzip(text) + "junk");
  test::expect_error(ErrorCode::invalid_argument, {"junk", "something else"}, [&] { read_file(path("junk")); });
}

TEST_F(FilesTest, DamagedGzipIsRefused) {
  const std::string packed = gzip(std::string(100000, 'x') + text);
  for (std::size_t size = 10; size < packed.size(); size += 7) {
    write_file(path("cut.obj"), packed.substr(0, size));
    test::expect_error(ErrorCode::invalid_argument, {"cut.obj", "gzip data is truncated"}, [&] { read_file(path("cut.obj")); });
  }
  std::string flipped = packed;
  flipped[packed.size() - 6] ^= 1;  // checksum
  write_file(path("flipped.obj"), flipped);
  test::expect_error(ErrorCode::invalid_argument, {"flipped.obj", "damaged"}, [&] { read_file(path("flipped.obj")); });
}

TEST_F(FilesTest, AGzipBombStopsAtTheLimit) {
  const std::size_t size = 50'000'000;
  write_file(path("bomb.gz"), std::string(size, 'x'));
  ASSERT_LT(fs::file_size(path("bomb.gz")), 100'000U);
  test::expect_error(ErrorCode::out_of_budget, {"bomb.gz", "1000000 bytes"},
                     [&] { read_file(path("bomb.gz"), nullptr, 1'000'000); });
  test::expect_error(ErrorCode::out_of_budget, {"bomb.gz"}, [&] { read_file(path("bomb.gz"), nullptr, size - 1); });
  EXPECT_EQ(read_file(path("bomb.gz"), nullptr, size).size(), size);
}

TEST_F(FilesTest, PlainFilesHaveTheSameLimit) {
  write_file(path("a"), text);
  EXPECT_EQ(read_file(path("a"), nullptr, text.size()), text);
  test::expect_error(ErrorCode::out_of_budget, {"a", std::to_string(text.size() - 1).c_str()},
                     [&] { read_file(path("a"), nullptr, text.size() - 1); });
}

TEST_F(FilesTest, WhatCannotBeOpenedIsNotFound) {
  test::expect_error(ErrorCode::not_found, {"missing.obj", "No such file"}, [&] { read_mesh_file(path("missing.obj")); });
  test::expect_error(ErrorCode::not_found, {"Is a directory"}, [&] { read_file(folder_); });
}

TEST_F(FilesTest, WhatCannotBeWrittenLeavesNothing) {
  test::expect_error(ErrorCode::failed_precondition, {"cannot write", "nowhere"},
                     [&] { write_file(path("nowhere") / "a.obj", text); });
  fs::create_directories(path("folder.obj"));
  test::expect_error(ErrorCode::failed_precondition, {"cannot write", "folder.obj"},
                     [&] { write_file(path("folder.obj"), text); });
  EXPECT_THAT(listing(), testing::ElementsAre("folder.obj"));
}

TEST_F(FilesTest, ReplacingKeepsPermissionsAndLeavesNoTemporaryFile) {
  write_file(path("a.obj"), "old");
  fs::permissions(path("a.obj"), fs::perms::owner_read | fs::perms::owner_write | fs::perms::group_write);
  write_file(path("a.obj"), text);
  EXPECT_EQ(stored(path("a.obj")), text);
  EXPECT_EQ(fs::status(path("a.obj")).permissions(), fs::perms::owner_read | fs::perms::owner_write | fs::perms::group_write);
  EXPECT_THAT(listing(), testing::ElementsAre("a.obj"));
}

TEST_F(FilesTest, SpecialFilesAreWrittenNotReplaced) {
  ASSERT_NO_THROW(write_file("/dev/null", text));
  EXPECT_TRUE(fs::is_character_file("/dev/null"));
}

TEST_F(FilesTest, AMeshFileIsWrittenInItsOwnFormatOnly) {
  const auto file = parse_mesh(text, "a.obj");
  const Points moved{{0, 0, 0}, {2, 0, 0}, {0, 1, 0}};
  write_mesh_file(*file, moved, path("out.OBJ"));
  EXPECT_EQ(stored(path("out.OBJ")), "v 0 0 0\nv 2 0 0\nv 0 1 0\nf 1 2 3\n");
  write_mesh_file(*file, moved, path("out.obj.gz"));
  EXPECT_EQ(read_mesh_file(path("out.obj.gz"))->mesh()->points, moved);
  test::expect_error(ErrorCode::invalid_argument, {"out.stl", "OBJ", "STL"},
                     [&] { write_mesh_file(*file, moved, path("out.stl")); });
}

Mesh grouped_triangles() {
  Mesh mesh;
  mesh.points = {{0, 0, 0}, {1.0 / 3, 0, 0}, {0, 1, 0}, {1, 1, 1e-9}};
  mesh.face_sizes = {3, 3, 3};
  mesh.face_points = {0, 1, 2, 1, 3, 2, 0, 2, 1};
  mesh.groups = {{"front", {}, {0, 1}}, {"back", {}, {2}}};
  return mesh;
}

TEST_F(FilesTest, ANewObjKeepsPointsFacesAndGroups) {
  Mesh mesh = grouped_triangles();
  mesh.groups = {{"front", {}, {0, 1}}, {"both of them", {3}, {1, 2}}, {"probes", {0, 2}, {}}};
  write_new_file(mesh, path("new.obj"));
  const auto back = read_mesh_file(path("new.obj"))->mesh();
  EXPECT_EQ(back->points, mesh.points);
  EXPECT_EQ(back->face_sizes, mesh.face_sizes);
  EXPECT_EQ(back->face_points, mesh.face_points);
  ASSERT_EQ(back->groups.size(), 3U);
  EXPECT_EQ(back->find_group("front")->faces, mesh.groups[0].faces);
  EXPECT_EQ(back->find_group("both_of_them")->faces, mesh.groups[1].faces);
  EXPECT_EQ(back->find_group("both_of_them")->points, mesh.groups[1].points);
  EXPECT_EQ(back->find_group("probes")->points, mesh.groups[2].points);
}

TEST_F(FilesTest, ANewStlWithGroupsIsTextWithSolids) {
  Mesh mesh = grouped_triangles();
  mesh.groups.pop_back();
  write_new_file(mesh, path("new.stl"));
  const auto back = read_mesh_file(path("new.stl"))->mesh();
  EXPECT_EQ(back->points, mesh.points);  // doubles, exactly
  EXPECT_EQ(back->face_points, mesh.face_points);
  ASSERT_EQ(back->groups.size(), 2U);
  EXPECT_EQ(back->find_group("front")->faces, mesh.groups[0].faces);
  EXPECT_EQ(back->find_group("solid_2")->faces, (std::vector<FaceId>{2}));
}

TEST_F(FilesTest, ANewStlWithoutGroupsIsBinary) {
  Mesh mesh = grouped_triangles();
  mesh.groups.clear();
  write_new_file(mesh, path("new.stl.gz"));
  EXPECT_EQ(read_file(path("new.stl.gz")).size(), 84U + 50 * 3);
  const auto back = read_mesh_file(path("new.stl.gz"))->mesh();
  EXPECT_EQ(back->points[1][0], 1.F / 3);
  EXPECT_EQ(back->face_points, mesh.face_points);
}

TEST_F(FilesTest, NamesThatTheFormatCannotHoldStayDifferent) {
  Mesh mesh = grouped_triangles();
  mesh.groups = {{"a b", {}, {0}}, {"a_b", {}, {1}}, {"a#b", {}, {2}}};
  write_new_file(mesh, path("new.obj"));
  const auto obj = read_mesh_file(path("new.obj"))->mesh();
  ASSERT_EQ(obj->groups.size(), 3U);
  EXPECT_EQ(obj->find_group("a_b")->faces, mesh.groups[0].faces);
  EXPECT_EQ(obj->find_group("a_b_2")->faces, mesh.groups[1].faces);
  EXPECT_EQ(obj->find_group("a_b_3")->faces, mesh.groups[2].faces);
  mesh.groups[2].name = "line\nend";
  write_new_file(mesh, path("new.stl"));
  const auto stl = read_mesh_file(path("new.stl"))->mesh();
  ASSERT_EQ(stl->groups.size(), 3U);
  EXPECT_EQ(stl->find_group("a b")->faces, mesh.groups[0].faces);
  EXPECT_EQ(stl->find_group("line_end")->faces, mesh.groups[2].faces);
}

TEST_F(FilesTest, NewFilesOfOtherKindsAreRefused) {
  const Mesh mesh = grouped_triangles();
  test::expect_error(ErrorCode::invalid_argument, {"new.off", ".obj or .stl", "not as OFF"},
                     [&] { write_new_file(mesh, path("new.off")); });
  try {
    write_new_file(mesh, path("new.txt"));
    FAIL() << "of no format";
  } catch (const Error& error) {
    EXPECT_EQ(error.code(), ErrorCode::invalid_argument);
    EXPECT_EQ(error.what(), path("new.txt").string() + ": new files are written as .obj or .stl, optionally with .gz");
  }
  Mesh quad = mesh;
  quad.face_sizes = {4, 4, 1};
  test::expect_error(ErrorCode::invalid_argument, {"new.stl", "face 0 has 4 corners"},
                     [&] { write_new_file(quad, path("new.stl")); });
  Mesh broken = mesh;
  broken.face_points[0] = 9;
  test::expect_error(ErrorCode::invalid_argument, {"face_points[0]"}, [&] { write_new_file(broken, path("new.obj")); });
}

TEST_F(FilesTest, TheAhmedBodyGoesThroughBothFormats) {
  const Mesh body = ahmed_body({25, 3000});
  for (const char* name : {"ahmed.obj", "ahmed.stl", "ahmed.stl.gz"}) {
    write_new_file(body, path(name));
    const auto back = read_mesh_file(path(name))->mesh();
    ASSERT_EQ(back->point_count(), body.point_count()) << name;
    ASSERT_EQ(back->groups.size(), body.groups.size()) << name;
    for (const Group& group : body.groups) EXPECT_EQ(back->find_group(group.name)->faces.size(), group.faces.size()) << name;
  }
  const auto obj = read_mesh_file(path("ahmed.obj"))->mesh();
  EXPECT_EQ(obj->points, body.points);
  EXPECT_EQ(obj->face_points, body.face_points);
}

}  // namespace
}  // namespace deform::io::files_test

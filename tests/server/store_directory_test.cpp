// SPDX-License-Identifier: GPL-3.0-or-later
// Which folders become a store, and that any other is left alone.
#include "server/store/store_directory.h"

#include <gtest/gtest.h>
#include <sys/stat.h>

#include "core/base/error.h"
#include "core/codec/geometry_id.h"
#include "server/store/sqlite.h"
#include "server/store/store_commands.h"
#include "tests/server/store_contents.h"

namespace deform::server::store_directory_test {
namespace {

namespace fs = std::filesystem;

class StoreFolder : public StoreTest {
 protected:
  /// The store refuses the folder and nothing in it has changed.
  void expect_left_alone(const fs::path& folder, const std::string& says) {
    const auto before = tree_of(folder);
    struct stat status_before {
    }, status_after{};
    ::stat(folder.c_str(), &status_before);
    try {
      open(folder);
      ADD_FAILURE() << "was accepted";
    } catch (const Error& error) {
      EXPECT_EQ(error.code(), ErrorCode::failed_precondition) << error.what();
      EXPECT_NE(std::string(error.what()).find(says), std::string::npos) << error.what();
    }
    ::stat(folder.c_str(), &status_after);
    EXPECT_EQ(tree_of(folder), before);
    EXPECT_EQ(status_before.st_mode, status_after.st_mode);
  }
};

TEST_F(StoreFolder, a_new_folder_is_marked_and_for_nobody_else) {
  const fs::path folder = directory.path() / "some" / "where";
  open(folder);
  EXPECT_EQ(file_content(folder / "deformd-store"), "deformd store, format 3\n");
  struct stat status {};
  ASSERT_EQ(::stat(folder.c_str(), &status), 0);
  EXPECT_EQ(status.st_mode & 0777, 0700u);
}

TEST_F(StoreFolder, a_folder_with_nothing_but_lost_and_found_is_empty) {
  fs::create_directories(data / "lost+found");
  open(data);
  EXPECT_TRUE(has_mark(data));
  EXPECT_TRUE(fs::exists(data / "lost+found"));
}

TEST_F(StoreFolder, a_folder_of_something_else_is_refused_and_left_untouched) {
  fs::create_directories(data / "tmp" / "thesis");
  fs::create_directories(data / "geometries");
  write_file(data / "tmp" / "thesis" / "chapter1.tex", "years of work");
  write_file(data / "geometries" / "car.obj", "v 0 0 0");
  expect_left_alone(data, "not a store of deformd");
}

TEST_F(StoreFolder, a_catalog_of_another_program_makes_no_store) {
  fs::create_directories(data);
  {
    const auto db = sqlite::open(data / "catalog.sqlite", SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE);
    sqlite::execute(db.get(), "CREATE TABLE books (title TEXT); PRAGMA user_version = 1;");
  }
  expect_left_alone(data, "not a store of deformd");
}

TEST_F(StoreFolder, a_store_of_a_later_version_is_refused) {
  open(data);
  const std::string mark = "deformd store, format 4\n";
  codec::Sha256 digest;
  digest.add(mark.data(), mark.size());
  write_file(data / "deformd-store", mark + digest.hex() + "\n");
  expect_left_alone(data, "another version");
}

TEST_F(StoreFolder, a_damaged_mark_is_written_anew_by_hand) {
  StoreContents contents;
  {
    const auto store = open(data);
    contents.add_setup(*store, contents.add_geometry(*store, sheet_mesh(4, 4), "a.obj"), -0.1);
  }
  for (const char* damaged :
       {"deformd stnre, format 3\n", "deformd store, format s\n", "deformd store, format 7\n", "deformd store, format 3", ""}) {
    write_file(data / "deformd-store", damaged);
    expect_left_alone(data, "deformd store rebuild");
    write_file(data / "holiday.jpg", "");
    EXPECT_EQ(code_of([&] { rebuild_store(data); }), ErrorCode::failed_precondition) << "not all of it is a store's";
    fs::remove(data / "holiday.jpg");
    EXPECT_EQ(rebuild_store(data).outcome, StoreReport::Outcome::well);
    contents.expect_all_of(*open(data));
  }
}

TEST_F(StoreFolder, what_an_operator_put_beside_the_files_stays) {
  open(data);
  fs::create_directories(data / "backup of monday");
  write_file(data / "README", "ours");
  open(data);
  EXPECT_EQ(file_content(data / "README"), "ours");
  EXPECT_TRUE(fs::exists(data / "backup of monday"));
}

TEST_F(StoreFolder, a_start_that_was_interrupted_before_the_mark_is_taken_up_again) {
  fs::create_directories(data);
  write_file(data / "lock", "");
  write_file(data / "deformd-store.part", "deformd st");
  open(data);
  EXPECT_TRUE(has_mark(data));
}

TEST_F(StoreFolder, without_its_mark_a_store_is_refused_until_it_is_rebuilt_by_hand) {
  StoreContents contents;
  {
    const auto store = open(data);
    contents.add_setup(*store, contents.add_geometry(*store, sheet_mesh(4, 4), "a.obj"), -0.1);
  }
  fs::remove(data / "deformd-store");
  expect_left_alone(data, "deformd store rebuild");
  EXPECT_EQ(rebuild_store(data).outcome, StoreReport::Outcome::well);
  contents.expect_all_of(*open(data));
  write_file(data / "holiday.jpg", "");
  fs::remove(data / "deformd-store");
  EXPECT_EQ(code_of([&] { rebuild_store(data); }), ErrorCode::failed_precondition) << "not all of it looks like a store";
}

}  // namespace
}  // namespace deform::server::store_directory_test

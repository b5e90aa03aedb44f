// SPDX-License-Identifier: GPL-3.0-or-later
// Which outputs would overwrite, or hide, the mesh they are made from.
#include <gtest/gtest.h>

#include <unistd.h>

#include <filesystem>
#include <fstream>

#include "core/io/mesh_file.h"

namespace deform::replaced_source_test {
namespace {

namespace fs = std::filesystem;

class ReplacedSource : public testing::Test {
 protected:
  ReplacedSource() : folder_(fs::temp_directory_path() / ("deform_replaced_" + std::to_string(::getpid()))) {
    fs::remove_all(folder_);
    fs::create_directories(folder_);
  }
  ~ReplacedSource() override { fs::remove_all(folder_); }

  fs::path file(const std::string& name) const {
    const fs::path path = folder_ / name;
    fs::create_directories(path.parent_path());
    std::ofstream(path) << "x";
    return path;
  }
  /// A case whose points lie in constant and, moved, in a time folder.
  void make_case(const std::string& points) const {
    for (const char* name : {"faces", "owner", "neighbour", "boundary"}) file(std::string("case/constant/polyMesh/") + name);
    file("case/constant/polyMesh/" + points);
    file("case/0.15/polyMesh/points");
  }
  bool replaced(const std::string& source, const std::string& output) const {
    return io::replaced_source(folder_ / source, folder_ / output).has_value();
  }

  const fs::path folder_;
};

TEST_F(ReplacedSource, UnderEveryNameOfAFile) {
  file("car.obj");
  file("other.obj");
  fs::create_symlink(folder_ / "car.obj", folder_ / "symbolic.obj");
  fs::create_hard_link(folder_ / "car.obj", folder_ / "hard.obj");
  fs::create_directory(folder_ / "sub");
  for (const char* output : {"car.obj", "./car.obj", "sub/../car.obj", "symbolic.obj", "hard.obj", "car.obj.gz"}) {
    EXPECT_TRUE(replaced("car.obj", output)) << output;
  }
  for (const char* output : {"other.obj", "new.obj", "sub/car.obj", "other.obj.gz"}) {
    EXPECT_FALSE(replaced("car.obj", output)) << output;
  }
  EXPECT_TRUE(replaced("symbolic.obj", "car.obj"));
  file("packed.obj.gz");
  EXPECT_TRUE(replaced("packed.obj.gz", "packed.obj"));
  EXPECT_EQ(io::source_file(folder_ / "symbolic.obj"), fs::canonical(folder_ / "car.obj"));
}

TEST_F(ReplacedSource, InAnOpenFoamCase) {
  for (const char* points : {"points", "points.gz"}) {
    fs::remove_all(folder_ / "case");
    make_case(points);
    for (const char* source : {"case", "case/constant", "case/constant/polyMesh", "case/0.15", "case/0.15/polyMesh/points"}) {
      for (const char* output : {"case", "case/", "case/constant", "case/constant/", "case/constant/polyMesh",
                                 "case/constant/polyMesh/points", "case/constant/polyMesh/points.gz", "case/0.15/../constant"}) {
        EXPECT_TRUE(replaced(source, output)) << source << ' ' << output << ' ' << points;
      }
      for (const char* output : {"case/1", "other/points", "case/2/polyMesh/points", "other"}) {
        EXPECT_FALSE(replaced(source, output)) << source << ' ' << output;
      }
    }
    EXPECT_TRUE(replaced("case/0.15", "case/0.15"));
    EXPECT_TRUE(replaced("case/0.15", "case/0.15/polyMesh/points.gz"));
    EXPECT_FALSE(replaced("case", "case/0.15")) << "a result of before";
    EXPECT_EQ(io::source_file(folder_ / "case"), fs::canonical(folder_ / "case/constant/polyMesh" / points));
  }
}

TEST_F(ReplacedSource, ThroughLinksToAnOpenFoamMesh) {
  make_case("points");
  fs::create_directories(folder_ / "linked/constant");
  fs::create_directory_symlink(folder_ / "case/constant/polyMesh", folder_ / "linked/constant/polyMesh");
  EXPECT_TRUE(replaced("linked", "linked"));
  EXPECT_TRUE(replaced("linked", "case/constant"));
  EXPECT_TRUE(replaced("case", "linked/constant"));
  EXPECT_FALSE(replaced("linked", "linked/1"));
}

}  // namespace
}  // namespace deform::replaced_source_test

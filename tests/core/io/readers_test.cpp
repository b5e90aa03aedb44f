// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/io/readers.h"

#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <set>

#include "core/base/text.h"
#include "tests/support/expect_error.h"

namespace deform::io::readers_test {
namespace {

using testing::HasSubstr;

TEST(Readers, HaveFormatsNamesAndExtensionsOfTheirOwn) {
  std::set<Format> formats;
  std::set<std::string> names, extensions;
  std::size_t count = 0;
  for (const Reader& reader : readers()) {
    EXPECT_TRUE(formats.insert(reader.format).second) << reader.name;
    EXPECT_TRUE(names.insert(reader.name).second) << reader.name;
    EXPECT_NE(reader.parse != nullptr, reader.library != nullptr) << reader.name << ": a parser or a library";
    extensions.insert(reader.extensions.begin(), reader.extensions.end());
    count += reader.extensions.size();
    EXPECT_EQ(&reader_of(reader.format), &reader);
  }
  EXPECT_EQ(extensions.size(), count);
}

TEST(Readers, AreFoundByExtensionInAnyCase) {
  for (const Reader& reader : readers()) {
    for (const std::string& extension : reader.extensions) {
      EXPECT_EQ(extension, lower_case(extension));
      for (const std::string& name : {"car" + extension, "a.b/CAR" + upper_case(extension), "car" + extension + ".gz"}) {
        EXPECT_EQ(&reader_of(name), &reader) << name;
      }
    }
  }
  EXPECT_EQ(reader_of("points").format, Format::openfoam);
  EXPECT_EQ(reader_of("case/0.5/polyMesh/points.gz").format, Format::openfoam);
}

TEST(Readers, RefuseOtherNamesAndListWhatThereIs) {
  for (const char* name : {"car", "car.gz", "obj", "car.obj.zip", "viewpoints", ""}) {
    test::expect_error(ErrorCode::invalid_argument, {name, "unknown mesh format", ".obj", ".ex2", ".dat", "OpenFOAM"},
                       [&] { reader_of(std::string(name)); });
  }
}

TEST(Readers, AreListedForHelp) {
  for (const Reader& reader : readers()) {
    if (reader.extensions.empty()) continue;
    EXPECT_THAT(mesh_file_names(), HasSubstr(reader.extensions.front() + ", "));
  }
  EXPECT_THAT(mesh_file_names(), HasSubstr("OpenFOAM"));
}

}  // namespace
}  // namespace deform::io::readers_test

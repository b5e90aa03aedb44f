// Labels of points by the regions of a setup.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "client/cli/region_points.h"
#include "client/cli/yaml_message.h"
#include "tests/support/expect_error.h"

namespace deform::cli {
namespace {

using testing::ElementsAre;

v1::Setup setup(const std::string& text) {
  v1::Setup setup;
  parse_yaml(text, "setup.yaml", setup);
  return setup;
}

Mesh line() {
  Mesh mesh;
  for (int i = 0; i < 6; ++i) mesh.points.push_back({double(i), 0, 0});
  return mesh;
}

TEST(RegionLabels, HandlesFixedAndTheRest) {
  EXPECT_THAT(region_labels(setup("handles: [{name: a, region: {ids: [5]}}, {name: b, region: {ids: [3, 4]}}]\n"
                                  "fixed: [{ids: [0]}, {box: {min: [0.5, 0, 0], max: [1.5, 0, 0]}}]\n"),
                            line()),
              ElementsAre(1, 1, 0, 3, 3, 2));
  EXPECT_THAT(region_labels(setup("handles: [{name: a, region: {ids: [0]}}, {name: b, region: {ids: [0, 1]}}]\n"
                                  "fixed: [{ids: [1, 2]}]\n"),
                            line()),
              ElementsAre(2, 3, 1, 0, 0, 0))
      << "where regions overlap";
}

TEST(RegionLabels, NamesTheRegionThatCannotBeSelected) {
  test::expect_error(ErrorCode::invalid_argument, {"handle \"roof\"", "group \"top\""},
                     [] { region_labels(setup("handles: [{name: roof, region: {group: top}}]\n"), line()); });
  test::expect_error(ErrorCode::invalid_argument, {"fixed[0]", "6"},
                     [] { region_labels(setup("fixed: [{ids: [6]}]\n"), line()); });
}

}  // namespace
}  // namespace deform::cli

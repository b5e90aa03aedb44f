// SPDX-License-Identifier: GPL-3.0-or-later
// Messages to designs and what is asked of a request: paths of fields in refusals.
#include <gtest/gtest.h>

#include <functional>
#include <limits>

#include "core/base/error.h"
#include "proto/convert/base/block.h"
#include "proto/convert/design.h"
#include "proto/convert/report.h"
#include "tests/server/refusal.h"
#include "tests/server/test_mesh.h"

namespace deform::convert::design_test {
namespace {

using server::raw_bytes;
using server::refusal;
using server::sheet_setup;

const std::string geometry(64, 'a');
constexpr double nan = std::numeric_limits<double>::quiet_NaN();
constexpr double infinite = std::numeric_limits<double>::infinity();

class ConvertDesign : public testing::Test {
 protected:
  ConvertDesign() {
    *info.mutable_setup() = sheet_setup(geometry);
    auto* handle = info.add_handles();
    handle->set_name("right");
    handle->set_points(4);
  }
  static std::string numbers(std::size_t points, double value = 1) {
    return raw_bytes(std::vector<Vec3>(points, {value, 2, 3}), 0, points);
  }
  std::vector<Design> convert(const v1::DeformRequest& request) {
    check_designs(request, 10);
    return designs_from_proto(request, info);
  }
  std::string refuse(const std::function<void(v1::Design&)>& fill) {
    v1::DeformRequest request;
    request.add_designs();
    fill(*request.add_designs());
    return refusal([&] { convert(request); });
  }
  v1::SystemInfo info;
};

TEST_F(ConvertDesign, everything_arrives) {
  v1::DeformRequest request;
  request.set_solver_tolerance(1e-3);
  request.add_designs()->add_variables(0.1);
  request.mutable_designs(0)->add_variables(0.2);
  auto* motion = request.add_designs()->add_motions();
  motion->set_handle("right");
  for (int k = 0; k < 12; ++k) motion->add_affine(k);
  auto* field = request.add_designs()->add_motions();
  field->set_handle("right");
  auto* second = field->add_displacements();  // in any order
  second->set_first(3);
  second->set_xyz(numbers(1, 9));
  auto* first = field->add_displacements();
  first->set_xyz(numbers(3, 7));
  const std::vector<Design> designs = convert(request);
  ASSERT_EQ(designs.size(), 3u);
  EXPECT_EQ(designs[0].variables, (std::vector<double>{0.1, 0.2}));
  EXPECT_EQ(designs[0].tolerance, 1e-3);
  EXPECT_EQ(std::get<Affine>(designs[1].motions[0].value)[11], 11);
  const auto& displacements = std::get<std::vector<Vec3>>(designs[2].motions[0].value);
  EXPECT_EQ(displacements[2][0], 7);
  EXPECT_EQ(displacements[3][0], 9);
}

TEST_F(ConvertDesign, refusals_name_the_field) {
  const auto motion = [](v1::Design& design) {
    auto* result = design.add_motions();
    result->set_handle("right");
    return result;
  };
  const auto piece = [&](v1::Design& design, std::uint64_t first, std::size_t points) {
    auto* result = motion(design)->add_displacements();
    result->set_first(first);
    result->set_xyz(numbers(points));
  };
  struct Row {
    const char* expected;
    std::function<void(v1::Design&)> fill;
  };
  const Row table[] = {
      {"designs[1].variables: expected none or 2 values, got 1", [](auto& d) { d.add_variables(0); }},
      {"designs[1].variables[1]: must be a finite number",
       [](auto& d) {
         d.add_variables(0);
         d.add_variables(nan);
       }},
      {"designs[1].continues", [](auto& d) { d.set_continues(true); }},
      {"designs[1].motions[0].handle: must not be empty", [](auto& d) { d.add_motions(); }},
      {"designs[1].motions[0]: expected exactly one of affine and displacements", [&](auto& d) { motion(d); }},
      {"designs[1].motions[0].affine: expected 12 numbers, got 3",
       [&](auto& d) {
         auto* m = motion(d);
         for (int k = 0; k < 3; ++k) m->add_affine(k);
       }},
      {"designs[1].motions[0].affine[4]: must be a finite number",
       [&](auto& d) {
         auto* m = motion(d);
         for (int k = 0; k < 12; ++k) m->add_affine(k == 4 ? infinite : 0);
       }},
      {"the setup has no handle \"rigth\"; did you mean \"right\"?",
       [](auto& d) {
         auto* m = d.add_motions();
         m->set_handle("rigth");
         for (int k = 0; k < 12; ++k) m->add_affine(k);
       }},
      {"displacements[0].xyz: 25 bytes are not a multiple of 24",
       [&](auto& d) { motion(d)->add_displacements()->set_xyz(std::string(25, '\0')); }},
      {"displacements: 3 displacements for the 4 points", [&](auto& d) { piece(d, 0, 3); }},
      {"displacements[0]: points 2 to 6 are out of range", [&](auto& d) { piece(d, 2, 4); }},
      {"are out of range", [&](auto& d) { piece(d, ~0ull, 1); }},
      {"are out of range", [&](auto& d) { piece(d, 0, 5); }},
      {"point 1 of the handle is given twice",
       [&](auto& d) {
         piece(d, 0, 4);
         auto* again = d.mutable_motions(0)->add_displacements();
         again->set_first(1);
         again->set_xyz(numbers(1));
       }},
      {"point 0 of the handle: must be finite", [&](auto& d) { motion(d)->add_displacements()->set_xyz(numbers(4, nan)); }},
  };
  for (const auto& row : table) {
    const std::string message = refuse(row.fill);
    EXPECT_NE(message.find(row.expected), std::string::npos) << "expected \"" << row.expected << "\", got \"" << message << "\"";
  }
}

TEST_F(ConvertDesign, number_of_designs) {
  v1::DeformRequest request;
  EXPECT_NE(refusal([&] { check_designs(request, 10); }).find("designs: at least one"), std::string::npos);
  request.add_designs();
  for (const double bad : {-1e-3, 1e-11, 0.1, nan}) {
    request.set_solver_tolerance(bad);
    EXPECT_NE(refusal([&] { check_designs(request, 10); }).find("solver_tolerance: must be"), std::string::npos) << bad;
  }
  request.set_solver_tolerance(1e-3);
  EXPECT_EQ(refusal([&] { check_designs(request, 10); }), "");
  for (int i = 0; i < 10; ++i) request.add_designs();
  EXPECT_NE(refusal([&] { check_designs(request, 10); }).find("11 designs are more than the limit of 10"), std::string::npos);
}

TEST(ConvertOutput, tolerances_and_encodings) {
  v1::Output output;
  EXPECT_EQ(encode_options(output, 5).encoding, codec::Encoding::draco);
  EXPECT_DOUBLE_EQ(encode_options(output, 5).tolerance, 5e-6);
  EXPECT_GT(encode_options(output, 0).tolerance, 0);
  output.set_tolerance(0.25);
  output.set_encoding(v1::DELTA_ZSTD);
  EXPECT_EQ(encode_options(output, 5).tolerance, 0.25);
  EXPECT_EQ(encode_options(output, 5).encoding, codec::Encoding::delta_zstd);
  for (const double bad : {-1.0, nan, infinite}) {
    output.set_tolerance(bad);
    EXPECT_NE(refusal([&] { encode_options(output, 5); }).find("output.tolerance"), std::string::npos);
  }
  output.set_tolerance(0);
  output.set_encoding(static_cast<v1::Encoding>(9));
  EXPECT_NE(refusal([&] { encode_options(output, 5); }).find("output.encoding: unknown value 9"), std::string::npos);
  EXPECT_NE(refusal([&] { path_from_proto(static_cast<v1::EvaluationPath>(3)); }).find("path: unknown value 3"),
            std::string::npos);
}

}  // namespace
}  // namespace deform::convert::design_test

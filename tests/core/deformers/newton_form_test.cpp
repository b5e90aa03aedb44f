// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/constrained/newton_form.h"

#include <gtest/gtest.h>

namespace deform::newton_form_test {
namespace {

/// The form of a set of 100 points, each with one distance from a plane.
NewtonSizes sizes_of(std::size_t functions, bool dense) {
  NewtonSizes sizes;
  sizes.points = sizes.rows = sizes.touched = 100;
  sizes.parameters = 3;
  sizes.functions = functions;
  sizes.dense = dense;
  sizes.factor_bytes = 8 * functions;
  sizes.factor_operations = 1;
  return sizes;
}

TEST(NewtonForm, IsThatOfTheFewestOperations) {
  // 3 r + 3 unknowns, or 100 distances.
  EXPECT_EQ(cheapest_newton(sizes_of(20, true), 0).form, NewtonForm::full);
  EXPECT_EQ(cheapest_newton(sizes_of(1000, true), 0).form, NewtonForm::forces);
  EXPECT_EQ(cheapest_newton(sizes_of(1000, false), 0).form, NewtonForm::sparse);
  EXPECT_LT(cheapest_newton(sizes_of(20, true), 0).operations, cheapest_newton(sizes_of(1000, true), 0).operations);
}

TEST(NewtonForm, DenseFormsHaveLimits) {
  NewtonSizes sizes = sizes_of(1000, true);
  sizes.rows = most_forces + 1;
  EXPECT_EQ(cheapest_newton(sizes, 0).form, NewtonForm::full);
  sizes.functions = most_full;
  EXPECT_EQ(cheapest_newton(sizes, 0).form, NewtonForm::none);
  sizes = sizes_of(1000, true);
  const std::size_t matrices = 2 * 100 * 100 * sizeof(double);
  EXPECT_EQ(cheapest_newton(sizes, 2 * matrices).form, NewtonForm::forces);
  EXPECT_EQ(cheapest_newton(sizes, 2 * matrices - 2).form, NewtonForm::full);
  sizes.factor_bytes = static_cast<std::size_t>(affordable_compliance);  // costs too much for every point
  EXPECT_EQ(cheapest_newton(sizes, 0).form, NewtonForm::full);
  sizes = sizes_of(1000, false);
  sizes.factor_operations = affordable_newton;
  sizes.rows = most_forces + 1;
  EXPECT_EQ(cheapest_newton(sizes, 0).form, NewtonForm::none);
}

}  // namespace
}  // namespace deform::newton_form_test

// SPDX-License-Identifier: GPL-3.0-or-later
// Sectors of wheels: they deform as the whole wheel does, periodic boundaries stay periodic, and what does not fit is refused.
#include "core/deformers/handles/sector.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>

#include "core/deformers/system.h"
#include "tests/core/deformers/shapes.h"
#include "tests/core/deformers/wheel.h"
#include "tests/support/expect_error.h"

namespace deform {
namespace {

using test::SectorModel;
using test::SectorShape;
using test::WholeWheel;

double distance_of_first(const Points& sector, const Points& whole) {
  return test::distance(sector, Points(whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(sector.size())));
}

double diagonal(const Mesh& mesh) { return bounding_box(mesh.points).diagonal(); }

RbfOptions& options(deform::Setup& setup) { return std::get<RbfOptions>(setup.method); }

struct Method {
  Kernel kernel;
  int degree;
};
const std::vector<Method> sector_methods = {{Kernel::triharmonic, 1}, {Kernel::triharmonic, 2}, {Kernel::biharmonic, 0},
                                            {Kernel::biharmonic, 1},  {Kernel::quintic, 2},     {Kernel::wendland_c2, -1}};

void use_method(deform::Setup& setup, const Method& method) {
  options(setup).kernel = method.kernel;
  options(setup).polynomial_degree = method.degree;
  options(setup).reduction = CentreReduction::off;
  if (method.kernel == Kernel::wendland_c2) options(setup).shape = 0.4;
}

TEST(Sector, DeformsAsTheWholeWheel) {
  for (const auto& frame : {test::Frame{}, test::oblique()}) {
    for (const std::size_t count : {2, 3, 4, 7, 36}) {
      for (const double hub : {0.4, 0.0}) {
        for (const Method& method : sector_methods) {
          if (count == 36 && method.kernel != Kernel::triharmonic) continue;
          SectorModel model({count, hub, count, count == 36 ? 2u : 3u, 3, 2}, frame);
          use_method(model.setup, method);
          const WholeWheel whole(model);
          const auto system = prepare(model.sector, model.setup);
          const auto wheel = prepare(whole.wheel, whole.setup);
          const double D = diagonal(*model.sector);
          SCOPED_TRACE(std::to_string(count) + " sectors, hub " + std::to_string(hub) + ", " + properties(method.kernel).name +
                       " " + std::to_string(method.degree));
          for (const bool affine : {false, true}) {
            const Points got = system->evaluate(affine ? model.affine_design() : model.design());
            const Points expected = wheel->evaluate(affine ? whole.affine_design : whole.design);
            EXPECT_LT(distance_of_first(got, expected), 1e-10 * D);
            EXPECT_GT(test::distance(got, model.sector->points), 0.02);
            EXPECT_LE(model.out_of_turn(got), 1e-14 * (D + norm(frame.origin)));
          }
        }
      }
    }
  }
}

}  // namespace
}  // namespace deform

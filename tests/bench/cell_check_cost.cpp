// SPDX-License-Identifier: GPL-3.0-or-later
#include "tests/bench/cell_check_cost.h"

#include <algorithm>
#include <cstdio>
#include <ctime>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "core/base/parallel.h"
#include "core/base/stopwatch.h"
#include "core/deformers/system.h"
#include "core/io/mesh_file.h"
#include "core/quality/field_bounds.h"
#include "core/quality/motion_certificate.h"
#include "core/quality/safe_amplitude.h"
#include "tests/bench/foam_case.h"

namespace deform::bench {

namespace {

constexpr double largest_lift = 3;  // metres, far beyond what the mesh bears
constexpr int repetitions = 25;

Design lifted(double by) {
  Design design;
  design.motions.push_back({0, Affine{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, by}});
  return design;
}

Setup roof_setup(const Mesh& mesh) {
  Setup setup;
  setup.handles = {{"roof", roof_patch(mesh)}};
  for (const char* patch : {"inlet", "outlet", "lowerWall", "upperWall", "frontAndBack"}) {
    setup.fixed.push_back({Region::GroupName{patch}});
  }
  setup.method = RbfOptions{};
  return setup;
}

/// The time of one thread, as the processor counts it, the least of many: what else the machine does counts little.
template <typename Work>
double least_seconds(int times, const Work& work) {
  RunContext alone;
  alone.threads = 1;
  double least = std::numeric_limits<double>::infinity();
  for (int k = 0; k < times; ++k) {
    const std::clock_t begin = std::clock();
    work(alone);
    least = std::min(least, static_cast<double>(std::clock() - begin) / CLOCKS_PER_SEC);
  }
  return least;
}

/// Every cell on its own, by roots; none is inverted at rest.
struct CellByCell {
  double amplitude = 1, least = 1, seconds = 0;
  std::size_t inverted = 0;
};

CellByCell cell_by_cell(const Mesh& mesh, const PolyhedralCells& polyhedra, const Points& to) {
  constexpr std::size_t grain = 1024;
  const auto cells = quality::moving_polyhedra(polyhedra, mesh.points.size());
  std::vector<quality::MovingCells::State> states(cells->size());
  std::vector<double> first(cells->size());
  CellByCell result;
  RunContext alone;
  alone.threads = 1;
  const std::clock_t begun = std::clock();
  parallel_for(alone, cells->size(), grain, [&](std::size_t begin, std::size_t end) {
    double bound = 1;
    for (std::size_t c = begin; c < end; ++c) {
      states[c] = cells->state(to, c);
      first[c] = cells->first_inversion(mesh.points, to, c, bound);
      bound = std::min(bound, first[c]);
    }
  });
  for (std::size_t c = 0; c < cells->size(); ++c) {
    result.amplitude = std::min(result.amplitude, first[c]);
    result.least = std::min(result.least, states[c].determinant);
    result.inverted += states[c].inverted;
  }
  result.seconds = static_cast<double>(std::clock() - begun) / CLOCKS_PER_SEC;
  return result;
}

/// The certificates of a mesh, and the pass over all cells: without exact states and roots.
class Certificates {
 public:
  Certificates(const Mesh& mesh, const PolyhedralCells& polyhedra, const DisplacementFields& fields)
      : cells_(quality::moving_polyhedra(polyhedra, mesh.points.size())) {
    cells_->list_nodes();
    const std::size_t count = cells_->size();
    std::vector<double> determinants(count);
    for (std::size_t c = 0; c < count; ++c) determinants[c] = cells_->state(mesh.points, c).determinant;
    const std::vector<char> none(count);
    worst_ = static_cast<std::size_t>(std::min_element(determinants.begin(), determinants.end()) - determinants.begin());
    certificate_.emplace(mesh.points, *cells_, none, determinants, RunContext{});
    bounds_.emplace(mesh.points, *certificate_, fields, RunContext{});
  }

  double seconds_by_coefficients(const FieldMotion& motion, const Points& to) const {
    return least_seconds(repetitions, [&](const RunContext&) {
      const double floor = cells_->state(to, worst_).determinant;
      quality::FieldBounds::Doubtful doubtful;
      bounds_->doubtful(motion, floor, 0, bounds_->cluster_count(), doubtful);
      for (const std::uint32_t c : doubtful.unproven) certificate_->bound(c, certificate_->stretch(to, c));
    });
  }

  double seconds_by_points(const Points& to) const {
    constexpr std::size_t grain = 32;  // blocks
    return least_seconds(repetitions, [&](const RunContext& context) {
      const double floor = cells_->state(to, worst_).determinant;
      parallel_for(context, certificate_->block_count(), grain, [&](std::size_t begin, std::size_t end) {
        std::vector<std::uint32_t> doubtful;
        certificate_->doubtful(to, floor, begin, end, doubtful);
        for (const std::uint32_t c : doubtful) certificate_->bound(c, certificate_->stretch(to, c));
      });
    });
  }

  double open_share(const FieldMotion& motion, const Points& to) const {
    const double floor = cells_->state(to, worst_).determinant;
    quality::FieldBounds::Doubtful doubtful;
    bounds_->doubtful(motion, floor, 0, bounds_->cluster_count(), doubtful);
    return static_cast<double>(doubtful.size()) / static_cast<double>(cells_->size());
  }

 private:
  std::unique_ptr<quality::MovingCells> cells_;
  std::optional<quality::MotionCertificate> certificate_;
  std::optional<quality::FieldBounds> bounds_;
  std::size_t worst_ = 0;
};

}  // namespace

void cell_check_cost(const std::filesystem::path& car_case, Report& report) {
  const auto file = io::read_mesh_file(car_case);
  const auto mesh = file->mesh();
  const PolyhedralCells& cells = *file->cells();
  const auto system = prepare(mesh, roof_setup(*mesh));
  Stopwatch watch;
  const auto fields = system->displacement_fields();
  const InversionCheck check(mesh->points, &cells, *fields);
  const double made = watch.lap();
  const Certificates certificates(*mesh, cells, *fields);
  const double bears = check.amplitude(mesh->points, system->evaluate(lifted(largest_lift))).amplitude;
  report.open();
  const std::string name = "Check of " + std::to_string(cells.cell_count) + " cells, ";
  report.info(name + "made once",
              Report::text(made) + " s, " +
                  Report::text(static_cast<double>(InversionCheck::bytes_for(&cells, mesh->point_count(), fields->count())) /
                               static_cast<double>(cells.cell_count)) +
                  " bytes a cell");
  report.info(name + "roof lift that inverts the first", Report::text(bears * largest_lift) + " m");
  for (const double share : {0.1, 0.01, 0.3, 1.1}) {
    const Design design = lifted(share * bears * largest_lift);
    const double evaluated = least_seconds(repetitions, [&](const RunContext& context) { system->evaluate(design, context); });
    const Points to = system->evaluate(design);
    const FieldMotion motion = *system->bind({&design, 1}, EvaluationPath::basis, {})->field_motion(0);
    SafeAmplitude found, by_points;
    const double whole = least_seconds(share < 1 ? repetitions : 1,
                                       [&](const RunContext& context) { found = check.amplitude(to, motion, context); });
    const double pointwise = least_seconds(
        share < 1 ? repetitions : 1, [&](const RunContext& context) { by_points = check.amplitude(mesh->points, to, context); });
    const CellByCell expected = cell_by_cell(*mesh, cells, to);
    const std::string at = name + Report::text(share) + " t*: ";
    const double suspects = static_cast<double>(found.suspects) / static_cast<double>(cells.cell_count);
    report.info(at + "cells that the coefficients do not clear", Report::text(certificates.open_share(motion, to)));
    report.info(at + "design / check / check without coefficients / every cell on its own, one thread",
                Report::text(1e3 * evaluated) + " / " + Report::text(1e3 * whole) + " / " + Report::text(1e3 * pointwise) +
                    " / " + Report::text(1e3 * expected.seconds) + " ms");
    double wrong = 0;
    for (const SafeAmplitude& answer : {found, by_points}) {
      wrong += static_cast<double>((answer.amplitude != std::min(1.0, expected.amplitude)) +
                                   (answer.inverted.count != expected.inverted) +
                                   (answer.inverted.least_determinant.value != expected.least));
    }
    report.at_most(at + "answers other than those of every cell", wrong, 0, "");
    if (share != 0.1) {
      report.info(at + "whole check / design, suspects", Report::text(whole / evaluated) + ", " + Report::text(suspects));
      continue;
    }
    report.at_most(at + "certificate / design", certificates.seconds_by_coefficients(motion, to) / evaluated, 0.5, "");
    report.info(at + "certificate without coefficients / design", Report::text(certificates.seconds_by_points(to) / evaluated));
    report.at_most(at + "whole check / design", whole / evaluated, 3, "");
    report.at_most(at + "share of suspects", suspects, 0.01, "");
  }
}

}  // namespace deform::bench

// SPDX-License-Identifier: GPL-3.0-or-later
// Thesis 4.5 and 7.3.1: what a method makes of all that it is given.
#include <algorithm>
#include <cmath>
#include <numeric>

#include "core/base/error.h"
#include "core/base/vectors.h"
#include "core/quality/element_quality.h"
#include "tests/bench/methods/methods.h"

namespace deform::bench {

namespace {

/// A handle of some points that go one by one.
Setup point_handle(std::vector<PointId> ids) {
  Setup setup;
  setup.handles = {{"points", {Region::Ids{std::move(ids)}}}};
  return setup;
}

Design to(std::vector<Vec3> displacements) {
  Design design;
  design.motions.push_back({0, std::move(displacements)});
  return design;
}

struct MatchError {
  double largest = 0, mean = 0;
  std::size_t worst = 0;
};

MatchError error_of(const Points& points, const Points& target) {
  MatchError error;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const double d = distance(points[i], target[i]);
    error.mean += d * d;
    if (d > error.largest) {
      error.largest = d;
      error.worst = i;
    }
  }
  error.mean = std::sqrt(error.mean / static_cast<double>(points.size()));
  return error;
}

Json row_of(std::size_t unknowns, const MatchError& error, double D) {
  Json row;
  row["unknowns"] = unknowns;
  row["largest"] = error.largest / D;
  row["rms"] = error.mean / D;
  return row;
}

}  // namespace

Json adaptivity(bool quick) {
  // A plate of 961 points; the upper right corner rises by a step that is one edge wide.
  const std::size_t n = quick ? 16 : 31;
  const auto mesh = std::make_shared<const Mesh>(plate(n, n, 1, 1));
  const double D = std::sqrt(2.0);
  Points target = mesh->points;
  for (Vec3& x : target) {
    const double from = std::hypot(x[0] - 0.72, x[1] - 0.72);
    if (from < 0.17) x[2] += from < 0.07 ? 0.3 : 0.15;
  }
  std::vector<PointId> all(mesh->point_count());
  std::iota(all.begin(), all.end(), PointId{0});
  std::vector<Vec3> displacements;
  for (const PointId id : all) displacements.push_back(target[id] - mesh->points[id]);
  Json result;
  result["points"] = mesh->point_count();

  // RBF: kernels are added where the error is largest (Schaback and Wendland 2000).
  Json rbf = Json::array();
  std::vector<PointId> centres;
  for (std::size_t j = 0; j < n; j += (n - 1) / 3) {
    for (std::size_t i = 0; i < n; i += (n - 1) / 3) centres.push_back(static_cast<PointId>(j * n + i));
  }
  while (true) {
    std::sort(centres.begin(), centres.end());
    Setup setup = point_handle(centres);
    RbfOptions options;
    options.reduction = CentreReduction::off;
    options.kernel = Kernel::triharmonic;
    setup.method = options;
    std::vector<Vec3> prescribed;
    for (const PointId id : centres) prescribed.push_back(displacements[id]);
    const Points points = prepare(mesh, setup)->evaluate(to(std::move(prescribed)));
    const MatchError error = error_of(points, target);
    rbf.push_back(row_of(centres.size(), error, D));
    if (centres.size() == all.size()) break;
    std::vector<PointId> rest;
    for (const PointId id : all) {
      if (!std::binary_search(centres.begin(), centres.end(), id)) rest.push_back(id);
    }
    std::stable_sort(rest.begin(), rest.end(),
                     [&](PointId a, PointId b) { return distance(points[a], target[a]) > distance(points[b], target[b]); });
    const std::size_t more = std::max<std::size_t>(8, centres.size() / 4);
    rest.resize(std::min(rest.size(), more));
    centres.insert(centres.end(), rest.begin(), rest.end());
  }
  result["RBF"] = std::move(rbf);

  // DM-FFD: planes of control points along x and y, four along z.
  Json ffd = Json::array();
  for (const std::size_t m : {4, 6, 8, 10, 12, 15}) {
    Setup setup = point_handle(all);
    FfdOptions options;
    options.control = FfdControl::mesh;
    options.lattice.frame = LatticeFrame{{-0.01, -0.01, -0.2}, {{{1.02, 0, 0}, {0, 1.02, 0}, {0, 0, 0.4}}}};
    options.lattice.points = {m, m, 4};
    setup.method = options;
    const Points points = prepare(mesh, setup)->evaluate(to(displacements));
    ffd.push_back(row_of(m * m * 4, error_of(points, target), D));
  }
  result["DM-FFD"] = std::move(ffd);

  // DM-cage: finer boxes.
  Json cages = Json::array();
  for (const std::size_t m : {4, 7, 10, 13, 16, 21}) {
    Setup setup = point_handle(all);
    const CageShape shape = box_cage({-0.05, -0.05, -0.1}, {1.05, 1.05, 0.1}, {m, m, 2});
    CageOptions options;
    options.control = CageControl::mesh;
    options.vertices = shape.vertices;
    options.triangles = shape.triangles;
    setup.method = options;
    const Points points = prepare(mesh, setup)->evaluate(to(displacements));
    cages.push_back(row_of(shape.vertices.size(), error_of(points, target), D));
  }
  result["DM-cage"] = std::move(cages);
  return result;
}

Json pipe(bool quick) {
  const Pipe pipe = quick ? bent_pipe(12, 12, 4) : bent_pipe(36, 36, 8);
  const auto mesh = std::make_shared<const Mesh>(pipe.mesh);
  const double D = bounding_box(mesh->points).diagonal();
  Json result;
  result["cells"] = mesh->elements->size();
  result["points"] = mesh->point_count();
  result["boundary"] = pipe.boundary.size();
  result["at_rest"] = element_quality(mesh->points, *mesh->elements).least_scaled_jacobian.value;
  const auto measure = [&](const std::string& name, auto options) {
    Json row;
    row["method"] = name;
    try {
      Setup setup = point_handle(pipe.boundary);
      setup.method = options;
      std::shared_ptr<const System> system;
      row["prepare"] = seconds_of([&] { system = prepare(mesh, setup); }, 1);
      for (int step = 1; step <= 10; ++step) {
        std::vector<Vec3> displacements;
        for (const Vec3& change : pipe.change) displacements.push_back((step / 10.0) * change);
        const Points points = system->evaluate(to(displacements));
        double missed = 0;
        for (std::size_t k = 0; k < pipe.boundary.size(); ++k) {
          const PointId id = pipe.boundary[k];
          missed = std::max(missed, distance(points[id], mesh->points[id] + displacements[k]));
        }
        const ElementQuality quality = element_quality(points, *mesh->elements);
        row["least_scaled_jacobian"].push_back(quality.least_scaled_jacobian.value);
        row["inverted"].push_back(quality.inverted_elements);
        row["missed"].push_back(missed / D);
      }
    } catch (const Error& error) {
      row["refused"] = error.what();
    }
    result["rows"].push_back(std::move(row));
  };
  RbfOptions rbf;
  rbf.reduction = CentreReduction::off;
  measure("RBF", rbf);
  for (const std::size_t n : {5, 10, 15, 25}) {
    FfdOptions options;
    options.control = FfdControl::mesh;
    options.lattice.points = {n, n, n};
    measure("DM-FFD-" + std::to_string(n), options);
  }
  MlsOptions mls;
  measure("MLS", mls);
  return result;
}

}  // namespace deform::bench

// SPDX-License-Identifier: GPL-3.0-or-later
#include "tests/bench/param_case.h"

#include <algorithm>
#include <charconv>
#include <chrono>
#include <cmath>
#include <limits>
#include <string_view>

#include "core/base/error.h"
#include "core/base/parallel.h"
#include "core/io/mesh_file.h"
#include "core/quality/element_quality.h"
#include "tests/bench/harmonic_baseline.h"

namespace deform::bench {

namespace {

double distance(const Vec3& a, const Vec3& b) { return std::hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]); }

Vec3 between(const Vec3& from, const Vec3& to) { return {to[0] - from[0], to[1] - from[1], to[2] - from[2]}; }

[[noreturn]] void bad_row(const std::string& name, std::size_t row, const std::string& reason) {
  throw Error(ErrorCode::invalid_argument, name + ", row " + std::to_string(row) + ": " + reason);
}

/// Takes the text up to the next comma.
std::string_view next_field(std::string_view& line) {
  const std::size_t end = std::min(line.find(','), line.size());
  const std::string_view field = line.substr(0, end);
  line.remove_prefix(std::min(end + 1, line.size()));
  return field;
}

template <typename T>
T number(std::string_view field, const std::string& name, std::size_t row) {
  T value{};
  const auto [end, error] = std::from_chars(field.data(), field.data() + field.size(), value);
  if (error != std::errc() || end != field.data() + field.size())
    bad_row(name, row, std::string("'").append(field) + "' is no number");
  return value;
}

/// node,patches,x0,y0,z0,...,x20,y20,z20
void read_steps(const std::filesystem::path& path, ParamCase& param) {
  const std::string name = path.filename().string(), text = io::read_file(path);
  param.places.assign(ParamCase::steps + 1, {});
  std::string_view rest = text;
  for (std::size_t row = 0; !rest.empty(); ++row) {
    const std::size_t end = std::min(rest.find('\n'), rest.size());
    std::string_view line = rest.substr(0, end);
    rest.remove_prefix(std::min(end + 1, rest.size()));
    if (row == 0 || line.empty()) continue;
    const auto id = number<PointId>(next_field(line), name, row);
    if (id >= param.mesh->point_count()) bad_row(name, row, "the mesh has no point " + std::to_string(id));
    if (!param.boundary.empty() && id <= param.boundary.back()) bad_row(name, row, "the nodes do not ascend");
    param.boundary.push_back(id);
    next_field(line);
    for (Points& places : param.places) {
      Vec3 x{};
      for (double& coordinate : x) coordinate = number<double>(next_field(line), name, row);
      places.push_back(x);
    }
    const Vec3& at_rest = param.mesh->points[id];
    if (distance(at_rest, param.places[0].back()) > 1e-6 * param.diagonal) bad_row(name, row, "step 0 is not the mesh at rest");
    param.places[0].back() = at_rest;  // the table has nine digits only
  }
}

Kernel kernel_of(Method method) {
  if (method == Method::biharmonic) return Kernel::biharmonic;
  return method == Method::quintic ? Kernel::quintic : Kernel::triharmonic;
}

/// One system at a time: from where the mesh is to other places of its boundary.
class Mover {
 public:
  Mover(const ParamCase& param, Method method, std::shared_ptr<const Mesh> mesh) : param_(param), mesh_(std::move(mesh)) {
    if (method == Method::harmonic) {
      harmonic_ = std::make_unique<HarmonicBaseline>(mesh_->points, *param.elements, param.boundary);
    } else {
      rbf_ = prepare(mesh_, boundary_setup(param, kernel_of(method)));
    }
  }

  Points to(const Points& places, Series& series) const {
    Points from;
    for (const PointId id : param_.boundary) from.push_back(mesh_->points[id]);
    const Design design = boundary_motion(from, places);
    if (harmonic_) return harmonic_->deformed(std::get<std::vector<Vec3>>(design.motions[0].value));
    series.condition = std::max(series.condition, rbf_->info().condition);
    const auto evaluation = rbf_->bind({&design, 1}, EvaluationPath::direct, {});
    series.residual = std::max(series.residual, evaluation->report(0).interpolation_residual / param_.diagonal);
    Points result(mesh_->point_count());
    parallel_for({}, result.size(), 1024, [&](std::size_t begin, std::size_t end) {
      Vec3* out = result.data() + begin;
      evaluation->evaluate(begin, end, 0, std::span<Vec3* const>(&out, 1));
    });
    return result;
  }

 private:
  const ParamCase& param_;
  std::shared_ptr<const Mesh> mesh_;
  std::shared_ptr<const System> rbf_;
  std::unique_ptr<const HarmonicBaseline> harmonic_;
};

void measure(const ParamCase& param, const Points& points, std::size_t step, Series& series) {
  const ElementQuality quality = element_quality(points, *param.elements);
  series.least.push_back(quality.least_scaled_jacobian.value);
  series.inverted.push_back(quality.inverted_elements);
  for (std::size_t i = 0; i < param.boundary.size(); ++i) {
    series.boundary = std::max(series.boundary, distance(points[param.boundary[i]], param.places[step][i]) / param.diagonal);
  }
}

}  // namespace

ParamCase read_param_case(const std::filesystem::path& folder, const std::string& name) {
  const std::string file = name + (name == "pipe_hex" ? "_p0.vtu" : name == "pipe_tet" ? "_p0.su2.gz" : "_p0.e");
  const auto source = io::read_mesh_file(folder / file);
  ParamCase param;
  param.name = name;
  param.mesh = source->mesh();
  param.elements = source->elements();
  if (!param.elements) throw Error(ErrorCode::invalid_argument, file + ": has no elements");
  param.diagonal = bounding_box(param.mesh->points).diagonal();
  read_steps(folder / (name + "_boundary_steps.csv.gz"), param);
  return param;
}

Setup boundary_setup(const ParamCase& param, Kernel kernel) {
  Setup setup;
  setup.handles = {{"boundary", {Region::Ids{param.boundary}}}};
  RbfOptions options;
  options.kernel = kernel;
  options.reduction = CentreReduction::off;
  options.basis = BasisMode::never;
  setup.method = options;
  return setup;
}

Design boundary_motion(const Points& from, const Points& to) {
  std::vector<Vec3> displacements(from.size());
  for (std::size_t i = 0; i < from.size(); ++i) displacements[i] = between(from[i], to[i]);
  Design design;
  design.motions.push_back({0, std::move(displacements)});
  return design;
}

const char* to_string(Method method) {
  static constexpr const char* names[] = {"r", "r^3", "r^5", "harmonic"};
  return names[static_cast<std::size_t>(method)];
}

Series walk(const ParamCase& param, Method method, Walk mode, std::size_t stride) {
  Series series;
  const auto start = std::chrono::steady_clock::now();
  measure(param, param.mesh->points, 0, series);
  try {
    auto mover = std::make_unique<Mover>(param, method, param.mesh);
    for (std::size_t step = stride; step <= ParamCase::steps; step += stride) {
      if (mode == Walk::relative && step > stride) {
        Mesh moved = *param.mesh;
        moved.points = series.last;
        mover = std::make_unique<Mover>(param, method, std::make_shared<const Mesh>(std::move(moved)));
      }
      series.last = mover->to(param.places[step], series);
      measure(param, series.last, step, series);
    }
  } catch (const Error& error) {
    if (error.code() != ErrorCode::numerical_failure) throw;
    series.failure = error.what();
  }
  series.least.resize(ParamCase::steps / stride + 1, std::numeric_limits<double>::quiet_NaN());
  series.inverted.resize(ParamCase::steps / stride + 1, param.elements->size());
  series.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  return series;
}

Comparison compare(const Series& ours, const Series& theirs) {
  Comparison result;
  for (std::size_t k = 1; k < ours.least.size(); ++k) {
    ++result.steps;
    if (ours.least[k] >= theirs.least[k] - 1e-9 || (std::isnan(theirs.least[k]) && !std::isnan(ours.least[k]))) {
      ++result.at_least;
    } else {
      result.last_below = k;
      result.shortfall = std::max(result.shortfall, theirs.least[k] - ours.least[k]);
    }
  }
  return result;
}

InnerSphere read_inner_sphere(const std::filesystem::path& file, double shift) {
  const auto source = io::read_mesh_file(file);
  InnerSphere ball{source->mesh(), source->elements(), {}, {}};
  if (!ball.elements) throw Error(ErrorCode::invalid_argument, file.filename().string() + ": has no elements");
  const Box box = bounding_box(ball.mesh->points);
  Vec3 centre{};
  for (std::size_t k = 0; k < 3; ++k) centre[k] = 0.5 * (box.min[k] + box.max[k]);
  const double radius = 0.5 * (box.max[0] - box.min[0]);
  const BoundaryFaces surface = boundary_faces(*ball.elements);
  ball.setup.handles = {{"inner", {Region::InSphere{centre, 0.35 * radius}}}};
  ball.setup.fixed = {{Region::Ids{surface.points}}};
  RbfOptions options;
  options.reduction = CentreReduction::off;
  ball.setup.method = options;
  ball.design.motions.push_back({0, Affine{1, 0, 0, shift * radius, 0, 1, 0, 0, 0, 0, 1, 0}});
  return ball;
}

}  // namespace deform::bench

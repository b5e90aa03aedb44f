// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/cage/green_evaluation.h"

#include <algorithm>
#include <string>

#include "core/base/vectors.h"
#include "core/deformers/cage/green_scratch.h"

namespace deform {

namespace {

constexpr std::size_t green_places_per_task = 1024;

}  // namespace

GreenEvaluation::GreenEvaluation(std::shared_ptr<const GreenSystem> system, std::span<const Design> designs, EvaluationPath path,
                                 const RunContext& context)
    : HandleEvaluation(system, designs, path, context),
      system_(*system),
      changes_(3 * system_.columns_.size() * designs.size(), 0.0) {
  for_each_direct(context, [&](std::size_t i) {
    const std::vector<Vec3> displacements = system_.displacements(designs_[i], MotionKind::position);
    const std::vector<Vec3> moved = system_.moved(system_.in_model(displacements), "designs[" + std::to_string(i) + "]");
    double farthest = 0, stretched = 0;
    for (const Vec3& u : displacements) farthest = std::max(farthest, norm(u));
    set_vertices(i, displacements);
    for (std::size_t t = 0; t < system_.normals_.size(); ++t) {
      const Vec3 change = system_.normals_[t].change(system_.corners(system_.columns_.triangles()[t], moved));
      set_rows(system_.columns_.of_triangle(t), i, system_.in_frame(change));
      stretched = std::max(stretched, norm(change));
    }
    reports_[i].control_displacement = reports_[i].prescribed_displacement;
    set_error(i, system_.rounding_ * (farthest + system_.cage_.diagonal() * stretched));
  });
  find_moving_rows();
}

GreenEvaluation::GreenEvaluation(std::shared_ptr<const GreenSystem> system, std::span<const double> variables,
                                 const std::vector<Affine>& derivatives)
    : HandleEvaluation(system, derivatives), system_(*system), changes_(3 * system_.columns_.size(), 0.0) {
  const std::vector<Vec3> moved = system_.moved_by(variables);
  const std::vector<Vec3> rates = system_.displacements(designs_[0], MotionKind::derivative);
  const std::vector<Vec3> in_model = system_.in_model(rates);
  set_vertices(0, rates);
  for (std::size_t t = 0; t < system_.normals_.size(); ++t) {
    const std::size_t triangle = system_.columns_.triangles()[t];
    const Vec3 rate = system_.normals_[t].rate(system_.corners(triangle, moved), system_.corners(triangle, in_model));
    set_rows(system_.columns_.of_triangle(t), 0, system_.in_frame(rate));
  }
  find_moving_rows();
}

void GreenEvaluation::set_vertices(std::size_t design, std::span<const Vec3> displacements) {
  const std::vector<std::uint32_t>& vertices = system_.columns_.vertices();
  for (std::size_t v = 0; v < vertices.size(); ++v) set_rows(system_.columns_.of_vertex(v), design, displacements[vertices[v]]);
}

void GreenEvaluation::set_rows(std::size_t first, std::size_t design, const Vec3& value) {
  for (const ComponentPart& part : system_.columns_.parts()) {
    const Vec3 taken = part.taken(value);
    std::copy(taken.begin(), taken.end(),
              changes_.begin() + static_cast<std::ptrdiff_t>(3 * (first++ * designs_.size() + design)));
  }
}

void GreenEvaluation::find_moving_rows() {
  const std::size_t width = 3 * designs_.size();
  for (std::size_t row = 0; row < system_.columns_.size(); ++row) {
    const auto begin = changes_.begin() + static_cast<std::ptrdiff_t>(row * width);
    const bool still = std::all_of(begin, begin + static_cast<std::ptrdiff_t>(width), [](double c) { return c == 0; });
    if (!still) moving_rows_.push_back(static_cast<std::uint32_t>(row));
  }
}

void GreenEvaluation::direct_tile(std::size_t tile, std::size_t first, std::size_t count, double* values) const {
  std::fill_n(values, 3 * count * tile_size, 0.0);
  if (moving_rows_.empty()) return;
  GreenSystem::Scratch scratch;
  const double* const coordinates = system_.tile(tile, scratch);
  tile_product(coordinates, system_.columns_.size(), moving_rows_, changes_.data() + 3 * first, 3 * designs_.size(), 3 * count,
               values);
  const Sector& sector = system_.symmetry().sector();
  if (sector.count() == 0) return;
  const std::size_t begin = tile * tile_size, end = std::min(begin + tile_size, system_.mesh_->point_count());
  for (std::size_t i = begin; i < end; ++i) {
    for (std::size_t d = 0; d < count; ++d) {
      double* const at = values + 3 * d * tile_size + i - begin;
      const Vec3 u = sector.from_first(static_cast<PointId>(i), {at[0], at[tile_size], at[2 * tile_size]});
      for (std::size_t k = 0; k < 3; ++k) at[k * tile_size] = u[k];
    }
  }
}

SpaceMap::Found GreenEvaluation::displacements_at(std::span<const Vec3> points, std::uint64_t first, std::span<Vec3> out,
                                                  const RunContext& context) const {
  parallel_for(context, points.size(), green_places_per_task, [&](std::size_t begin, std::size_t end) {
    GreenSystem::Scratch scratch;
    scratch.values.resize(system_.columns_.size() * tile_size);
    double values[3 * tile_size];
    for (std::size_t at = begin; at < end; at += tile_size) {
      const std::size_t count = std::min(tile_size, end - at);
      system_.compute_places(points.subspan(at, count), first + at, scratch, scratch.values.data());
      std::fill_n(values, 3 * tile_size, 0.0);
      if (!moving_rows_.empty()) {
        tile_product(scratch.values.data(), system_.columns_.size(), moving_rows_, changes_.data(), 3 * designs_.size(), 3,
                     values);
      }
      for (std::size_t i = 0; i < count; ++i) {
        for (std::size_t k = 0; k < 3; ++k) out[at + i][k] = values[k * tile_size + i];
      }
    }
  });
  return {};
}

}  // namespace deform

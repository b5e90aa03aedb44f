// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/handles/control_evaluation.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <numeric>
#include <string>
#include <utility>

#include "core/base/number_text.h"
#include "core/base/vectors.h"

namespace deform {

namespace {

constexpr std::size_t places_per_task = 1024;
constexpr std::size_t designs_at_once = 16;  // that share the weights of a point
constexpr double least_jump = 1e-9;          // of D: what rounding does is less

}  // namespace

ControlEvaluation::ControlEvaluation(std::shared_ptr<const ControlSystem> system, std::span<const Design> designs,
                                     EvaluationPath path, const RunContext& context)
    : HandleEvaluation(system, designs, path, context), system_(*system), controls_(designs.size()) {
  move_controls(context);
  for (std::size_t i = 0; i < designs_.size(); ++i) {
    reports_[i].control_displacement = reports_[i].prescribed_displacement;
    if (system_.model_.crossings) add_jump_warning(i);
  }
}

ControlEvaluation::ControlEvaluation(std::shared_ptr<const ControlSystem> system, const std::vector<Affine>& derivatives,
                                     const RunContext& context)
    : HandleEvaluation(system, derivatives), system_(*system), controls_(1) {
  move_controls(context);
}

void ControlEvaluation::move_controls(const RunContext& context) {
  for_each_direct(context, [&](std::size_t i) {
    controls_[i] = system_.displacements(designs_[i], kind_);
    double largest = 0;
    for (const Vec3& u : controls_[i]) largest = std::max(largest, norm(u));
    set_error(i, system_.rounding() * largest);
  });
}

void ControlEvaluation::add_jump_warning(std::size_t design) {
  const std::vector<Vec3> controls = is_direct(design) ? controls_[design] : system_.displacements(designs_[design], kind_);
  const ControlFunctions& crossings = *system_.model_.crossings;
  const Vec3* const vectors = controls.data();
  std::size_t torn = 0;
  double largest = 0;
  for (PointId e = 0; e < crossings.rows(); ++e) {
    Vec3 jump{};
    crossings.sums({&e, 1}, {&vectors, 1}, &jump);
    const double length = norm(jump);
    torn += length > least_jump * held_.diagonal ? 1 : 0;
    largest = std::max(largest, length);
  }
  if (torn == 0) return;
  reports_[design].torn_edges = torn;
  reports_[design].warnings.push_back(
      "the deformation ends at the boundary of the lattice while control points near it move: " +
      std::to_string(system_.model_.outside.size()) + " points outside stay, and of the " + std::to_string(crossings.rows()) +
      " edges that cross the boundary " + std::to_string(torn) + " are torn there by up to " + scientific(largest) +
      "; leave the two or three layers of control points next to the boundary where they are, or make the lattice larger");
}

void ControlEvaluation::direct_tile(std::size_t tile, std::size_t first, std::size_t count, double* values) const {
  const std::vector<ControlImage>& images = system_.model_.images;
  // Without symmetry the displacements are what the only image has. The tile at the end is not full.
  const bool plain = system_.regions_.symmetry.empty() && images.size() == 1 && images[0].rows;
  const std::size_t points = std::min(tile_size, system_.following().size() - tile * tile_size);
  if (!plain || points < tile_size) std::fill_n(values, 3 * count * tile_size, 0.0);
  for (std::size_t d = 0; d < count; d += designs_at_once) {
    if (plain) {
      std::array<const Vec3*, designs_at_once> vectors;
      const std::size_t some = std::min(designs_at_once, count - d);
      for (std::size_t i = 0; i < some; ++i) vectors[i] = controls_[first + d + i].data();
      const std::span<const PointId> ids(system_.following().data() + tile * tile_size, points);
      images[0].rows->tile_sums(ids, {vectors.data(), some}, values + 3 * d * tile_size);
      continue;
    }
    add_tile(tile, first + d, std::min(designs_at_once, count - d), values + 3 * d * tile_size);
  }
}

void ControlEvaluation::add_tile(std::size_t tile, std::size_t first, std::size_t count, double* values) const {
  const std::vector<PointId>& ids = system_.following();
  const Symmetry& symmetry = system_.regions_.symmetry;
  const std::size_t begin = tile * tile_size, points = std::min(tile_size, ids.size() - begin);
  std::array<const Vec3*, designs_at_once> vectors;
  for (std::size_t d = 0; d < count; ++d) vectors[d] = controls_[first + d].data();
  std::array<PointId, tile_size> places;
  for (std::size_t i = 0; i < points; ++i) places[i] = symmetry.sector().first_of(ids[begin + i]);
  std::array<Vec3, designs_at_once * tile_size> sums;
  for (const ControlImage& image : system_.model_.images) {
    if (!image.rows) continue;
    image.rows->sums({places.data(), points}, {vectors.data(), count}, sums.data());
    for (std::size_t i = 0; i < points; ++i) {
      const PointId at = places[i];
      const std::size_t components = symmetry.sector().on_axis(at) ? 1 : 3;  // across the axis they add up to rounding
      const unsigned number = symmetry.empty() ? 0 : symmetry.composed(image.image_of(at), at == ids[begin + i] ? 0 : 1);
      for (std::size_t d = 0; d < count; ++d) {
        const Vec3& sum = sums[i * count + d];
        const Vec3 u = number == 0 ? sum : symmetry.components_in(sum, number);
        for (std::size_t k = 0; k < components; ++k) values[(3 * d + k) * tile_size + i] += u[k];
      }
    }
  }
}

SpaceMap::Found ControlEvaluation::displacements_at(std::span<const Vec3> points, std::uint64_t first, std::span<Vec3> out,
                                                    const RunContext& context) const {
  std::atomic<std::size_t> still = 0;
  parallel_for(context, points.size(), places_per_task, [&](std::size_t begin, std::size_t end) {
    still += add_images(points.subspan(begin, end - begin), first + begin, out.subspan(begin, end - begin));
  });
  return {still, 0};
}

/// The first of the images in matched planes in which a place has functions counts, as for points of the mesh.
std::size_t ControlEvaluation::add_images(std::span<const Vec3> points, std::uint64_t first, std::span<Vec3> out) const {
  const ControlModel& model = system_.model_;
  const Symmetry& symmetry = system_.regions_.symmetry;
  // Only planes: all of the wheel's control points reach wherever one of their images does.
  const std::vector<unsigned> matched = model.matches.matched_planes();
  std::fill(out.begin(), out.end(), Vec3{});
  std::vector<bool> reached(points.size(), false);
  for (const ControlImage& image : model.images) {
    std::vector<std::size_t> left(points.size());
    std::iota(left.begin(), left.end(), std::size_t{0});
    for (const unsigned planes : matched) {
      if (left.empty()) break;
      const unsigned number = symmetry.composed(planes, image.image), back = symmetry.inverse(number);
      // With their numbers in messages: runs of places that follow each other.
      std::vector<std::size_t> outside;
      for (std::size_t at = 0; at < left.size();) {
        std::size_t run = at + 1;
        while (run < left.size() && left[run] == left[run - 1] + 1) ++run;
        std::vector<Vec3> places, sums(run - at);
        for (std::size_t i = at; i < run; ++i) places.push_back(symmetry.image(points[left[i]], back));
        std::vector<bool> none(run - at, false);
        for (const std::size_t i : model.in_space->sums(places, first + left[at], controls_[0].data(), sums.data())) {
          none[i] = true;
          outside.push_back(left[at + i]);
        }
        for (std::size_t i = at; i < run; ++i) {
          if (none[i - at]) continue;
          reached[left[i]] = true;
          out[left[i]] = out[left[i]] + symmetry.components_in(sums[i - at], number);
        }
        at = run;
      }
      left = std::move(outside);
    }
  }
  return static_cast<std::size_t>(std::count(reached.begin(), reached.end(), false));
}

}  // namespace deform

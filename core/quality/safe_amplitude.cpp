// SPDX-License-Identifier: Apache-2.0
#include "core/quality/safe_amplitude.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <string>

#include "core/base/checks.h"
#include "core/base/error.h"
#include "core/base/number_text.h"
#include "core/base/parallel.h"
#include "core/quality/moving_cells.h"

namespace deform {

namespace {

using quality::MovingCells;

constexpr std::size_t grain = 1024;
constexpr std::size_t most_listed = 100;
constexpr double flatness = 1e-9;  // of the diagonal: how far points of a mesh in the plane may lie off it

bool empty(const CellSet& cells) {
  return std::visit([](const auto* borrowed) { return borrowed == nullptr; }, cells);
}

std::unique_ptr<const MovingCells> moving(const CellSet& cells, std::span<const Vec3> rest) {
  if (const auto* elements = std::get_if<const Elements*>(&cells)) return quality::moving_elements(**elements, rest.size());
  if (const auto* mesh = std::get_if<const Mesh*>(&cells)) return quality::moving_faces(**mesh, rest);
  return quality::moving_polyhedra(*std::get<const PolyhedralCells*>(cells), rest.size());
}

void lower(std::atomic<double>& bound, double value) {
  double old = bound.load(std::memory_order_relaxed);
  while (value < old && !bound.compare_exchange_weak(old, value, std::memory_order_relaxed)) {
  }
}

}  // namespace

class InversionCheck::Impl {
 public:
  Impl(std::span<const Vec3> rest, const CellSet& cells, const RunContext& context) : points_(rest.size()) {
    if (std::holds_alternative<const Mesh*>(cells) && !rest.empty()) {
      const Box box = bounding_box(rest);
      plane_ = 0.5 * (box.min[2] + box.max[2]);
      off_plane_ = flatness * box.diagonal();
    }
    check(rest);
    if (empty(cells)) throw Error(ErrorCode::invalid_argument, "the mesh has no cells");
    cells_ = moving(cells, rest);
    if (cells_->size() == 0) throw Error(ErrorCode::invalid_argument, "the mesh has no cells");
    const auto all = states(rest, context);
    excluded_.resize(all.size());
    at_rest_ = summary(all);
    for (std::size_t c = 0; c < all.size(); ++c) excluded_[c] = all[c].inverted;
  }

  std::size_t size() const { return cells_->size(); }

  /// What is wrong with points, as far as it concerns whoever looks at them.
  void check(std::span<const Vec3> points) const {
    if (points.size() != points_) {
      throw Error(ErrorCode::invalid_argument,
                  "points: expected " + std::to_string(points_) + ", as many as at rest, got " + std::to_string(points.size()));
    }
    check_finite(points, "points");
    for (std::size_t i = 0; i < points.size(); ++i) {
      if (std::abs(points[i][2] - plane_) <= off_plane_) continue;
      throw Error(ErrorCode::invalid_argument, "points[" + std::to_string(i) + "]: z = " + number_digits(points[i][2]) +
                                                   ", but faces can be used as cells only in a plane z = constant, here " +
                                                   number_digits(plane_));
    }
  }

  const Inversions& at_rest() const { return at_rest_; }

  Inversions inversions(std::span<const Vec3> points, const RunContext& context) const {
    return summary(states(points, context));
  }

  /// The first inversion of all, and whose it is. `bound` only saves work: no cell with a smaller or equal one is passed over.
  Extreme first(std::span<const Vec3> from, std::span<const Vec3> to, const RunContext& context) const {
    std::vector<Extreme> of_range((size() + grain - 1) / grain, Extreme{std::numeric_limits<double>::infinity(), 0});
    std::atomic<double> bound{1};
    parallel_for(context, size(), grain, [&](std::size_t begin, std::size_t end) {
      Extreme& least = of_range[begin / grain];
      for (std::size_t c = begin; c < end; ++c) {
        if (excluded_[c]) continue;
        const double s = cells_->first_inversion(from, to, c, bound.load(std::memory_order_relaxed));
        if (s < least.value) least = {s, c};
        lower(bound, s);
      }
    });
    return *std::min_element(of_range.begin(), of_range.end(),
                             [](const Extreme& a, const Extreme& b) { return a.value < b.value; });
  }

 private:
  std::vector<MovingCells::State> states(std::span<const Vec3> points, const RunContext& context) const {
    std::vector<MovingCells::State> all(size());
    parallel_for(context, all.size(), grain, [&](std::size_t begin, std::size_t end) {
      for (std::size_t c = begin; c < end; ++c) all[c] = cells_->state(points, c);
    });
    return all;
  }

  /// Of the cells that are not excluded.
  Inversions summary(const std::vector<MovingCells::State>& all) const {
    Inversions result;
    for (std::size_t c = 0; c < all.size(); ++c) {
      if (excluded_[c]) continue;
      if (all[c].inverted) result.worst.push_back({all[c].determinant, c});
      if (all[c].determinant < result.least_determinant.value) result.least_determinant = {all[c].determinant, c};
    }
    result.count = result.worst.size();
    const auto listed = static_cast<std::ptrdiff_t>(std::min(result.count, most_listed));
    std::partial_sort(result.worst.begin(), result.worst.begin() + listed, result.worst.end(),
                      [](const Extreme& a, const Extreme& b) { return a.value != b.value ? a.value < b.value : a.id < b.id; });
    result.worst.resize(static_cast<std::size_t>(listed));
    return result;
  }

  std::size_t points_;
  double plane_ = 0, off_plane_ = std::numeric_limits<double>::infinity();
  std::unique_ptr<const MovingCells> cells_;
  std::vector<char> excluded_;
  Inversions at_rest_;
};

InversionCheck::InversionCheck(std::span<const Vec3> rest, const CellSet& cells, const RunContext& context)
    : impl_(std::make_unique<const Impl>(rest, cells, context)) {}
InversionCheck::~InversionCheck() = default;
InversionCheck::InversionCheck(InversionCheck&&) noexcept = default;
InversionCheck& InversionCheck::operator=(InversionCheck&&) noexcept = default;

std::size_t InversionCheck::cell_count() const { return impl_->size(); }
const Inversions& InversionCheck::at_rest() const { return impl_->at_rest(); }

Inversions InversionCheck::inverted(std::span<const Vec3> points, const RunContext& context) const {
  impl_->check(points);
  return impl_->inversions(points, context);
}

SafeAmplitude InversionCheck::amplitude(std::span<const Vec3> from, std::span<const Vec3> to, const RunContext& context) const {
  impl_->check(from);
  SafeAmplitude result;
  result.inverted = inverted(to, context);
  Extreme first = impl_->first(from, to, context);
  // The tolerance on the way is half of that at its end.
  if (first.value > 1 && result.inverted.count > 0) first = {1, result.inverted.worst.front().id};
  if (first.value > 1) return result;
  result.amplitude = std::min(first.value, std::nextafter(1.0, 0.0));
  result.first_cell = first.id;
  return result;
}

std::size_t InversionCheck::bytes_for(const CellSet& cells) {
  if (empty(cells)) return 0;
  // Excluded or not, where its sides begin, and while looking the states and the inverted ones among them.
  constexpr std::size_t each = 1 + sizeof(std::uint64_t) + sizeof(MovingCells::State) + sizeof(Extreme), side = 16;
  if (const auto* elements = std::get_if<const Elements*>(&cells)) return each * (*elements)->size();
  if (const auto* mesh = std::get_if<const Mesh*>(&cells)) return each * (*mesh)->face_count();
  const PolyhedralCells& polyhedra = *std::get<const PolyhedralCells*>(cells);
  return each * polyhedra.cell_count + side * (polyhedra.face_count() + polyhedra.internal_faces());
}

MotionSafety safe_amplitude(std::span<const Vec3> X, std::span<const Vec3> Y, const CellSet& cells, const RunContext& context) {
  const InversionCheck check(X, cells, context);
  return {check.amplitude(X, Y, context), check.at_rest()};
}

}  // namespace deform

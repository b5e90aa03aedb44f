// SPDX-License-Identifier: Apache-2.0
#include "core/quality/safe_amplitude.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <iterator>
#include <limits>
#include <string>

#include "core/base/checks.h"
#include "core/base/error.h"
#include "core/base/number_text.h"
#include "core/base/parallel.h"
#include "core/quality/field_bounds.h"
#include "core/quality/motion_certificate.h"
#include "core/quality/moving_cells.h"
#include "core/quality/summary.h"

namespace deform {

namespace {

using quality::FieldBounds;
using quality::MotionCertificate;
using quality::MovingCells;

constexpr std::size_t cells_per_range = 1024;
constexpr std::size_t blocks_grain = 32;
constexpr std::size_t clusters_grain = 1024;
constexpr std::size_t few = 4;              // of the cells one: fewer are looked at one by one
constexpr std::size_t suspects_grain = 16;  // each takes long
constexpr double surely_finite = 1e100;
constexpr double flatness = 1e-9;  // of the diagonal: how far points of a mesh in the plane may lie off it

bool empty(const CellSet& cells) {
  return std::visit([](const auto* borrowed) { return borrowed == nullptr; }, cells);
}

std::unique_ptr<MovingCells> moving(const CellSet& cells, std::size_t points) {
  if (const auto* elements = std::get_if<const Elements*>(&cells)) return quality::moving_elements(**elements, points);
  if (const auto* mesh = std::get_if<const Mesh*>(&cells)) return quality::moving_faces(**mesh);
  return quality::moving_polyhedra(*std::get<const PolyhedralCells*>(cells), points);
}

std::size_t cell_count(const CellSet& cells) {
  if (const auto* elements = std::get_if<const Elements*>(&cells)) return (*elements)->size();
  if (const auto* mesh = std::get_if<const Mesh*>(&cells)) return (*mesh)->face_count();
  return std::get<const PolyhedralCells*>(cells)->cell_count;
}

std::size_t side_count(const CellSet& cells) {
  if (const auto* mesh = std::get_if<const Mesh*>(&cells)) return (*mesh)->face_points.size();
  if (const auto* polyhedra = std::get_if<const PolyhedralCells*>(&cells)) return (*polyhedra)->internal_faces();
  const Elements& elements = *std::get<const Elements*>(cells);
  std::size_t sides = 0;
  for (const ElementType type : elements.types) sides += shape(type).faces.size();
  return sides;
}

/// An upper bound of the sum of the numbers of nodes of all cells. A node of a polyhedron is a corner of three of its faces, if
/// it is closed.
std::size_t node_count(const CellSet& cells) {
  if (const auto* elements = std::get_if<const Elements*>(&cells)) return (*elements)->points.size();
  if (const auto* mesh = std::get_if<const Mesh*>(&cells)) return (*mesh)->face_points.size();
  const PolyhedralCells& polyhedra = *std::get<const PolyhedralCells*>(cells);
  const std::uint64_t inner = polyhedra.face_offsets[polyhedra.internal_faces()];
  return static_cast<std::size_t>(inner + polyhedra.face_points.size()) / 3 + polyhedra.cell_count;
}

/// The first point that is not at the height of the first one; their number when there is none.
std::size_t first_off_plane(std::span<const Vec3> points) {
  const double allowed = flatness * bounding_box(points).diagonal();
  const auto off = [&](const Vec3& p) { return !(std::abs(p[2] - points[0][2]) <= allowed); };
  return static_cast<std::size_t>(std::find_if(points.begin(), points.end(), off) - points.begin());
}

/// As rest has them; nothing to do where no cell is other than the format wants it.
std::vector<char> left_handed(const MovingCells& cells, std::span<const Vec3> rest, const RunContext& context) {
  std::vector<quality::Orientation> orientations(cells.size());
  parallel_for(context, cells.size(), cells_per_range, [&](std::size_t begin, std::size_t end) {
    for (std::size_t c = begin; c < end; ++c) orientations[c] = cells.orientation(rest, c);
  });
  const auto mirrored = std::count(orientations.begin(), orientations.end(), quality::Orientation::mirrored);
  if (mirrored == 0) return {};
  return quality::left_handed_cells(orientations, cells.links());
}

/// The results of the ranges of a loop, in their order.
template <typename T>
std::vector<T> joined(std::vector<std::vector<T>> ranges) {
  std::size_t size = 0;
  for (const auto& range : ranges) size += range.size();
  std::vector<T> all;
  all.reserve(size);
  for (const auto& range : ranges) all.insert(all.end(), range.begin(), range.end());
  return all;
}

void lower(std::atomic<double>& bound, double value) {
  double old = bound.load(std::memory_order_relaxed);
  while (value < old && !bound.compare_exchange_weak(old, value, std::memory_order_relaxed)) {
  }
}

struct Look {
  std::size_t cell;
  MovingCells::State state;
};

/// A cell that may be inverted on the way, as far as bounds can tell: its deformation at the end.
struct Suspect {
  std::size_t cell;
  MotionCertificate::Stretch to;
};

}  // namespace

class InversionCheck::Impl {
 public:
  Impl(std::span<const Vec3> rest, const CellSet& cells, const DisplacementFields* fields, const RunContext& context)
      : rest_(rest.begin(), rest.end()), plane_(std::holds_alternative<const Mesh*>(cells)) {
    check(rest);
    if (empty(cells)) throw Error(ErrorCode::invalid_argument, "the mesh has no cells");
    auto all_cells = moving(cells, rest.size());
    if (all_cells->size() == 0) throw Error(ErrorCode::invalid_argument, "the mesh has no cells");
    auto left = deform::left_handed(*all_cells, rest, context);
    left_handed_ = static_cast<std::size_t>(std::count(left.begin(), left.end(), 1));
    all_cells->take_as_left_handed(std::move(left));
    all_cells->list_nodes();
    cells_ = std::move(all_cells);
    std::vector<Look> all(size());
    parallel_for(context, size(), cells_per_range, [&](std::size_t begin, std::size_t end) {
      for (std::size_t c = begin; c < end; ++c) all[c] = {c, cells_->state(rest_, c)};
    });
    at_rest_ = summary(all);
    excluded_.resize(size());
    std::vector<double> determinants(size());
    for (std::size_t c = 0; c < size(); ++c) {
      excluded_[c] = all[c].state.inverted;
      determinants[c] = all[c].state.determinant;
      if (!excluded_[c] && !(determinants[c] >= determinants[worst_] && !excluded_[worst_])) worst_ = c;
    }
    certificate_.emplace(rest_, *cells_, excluded_, determinants, context);
    if (fields != nullptr) bounds_.emplace(rest_, *certificate_, *fields, context);
  }

  std::size_t size() const { return cells_->size(); }

  /// Checks points before any evaluation.
  void check(std::span<const Vec3> points) const {
    if (points.size() != rest_.size()) {
      throw Error(ErrorCode::invalid_argument, "points: expected " + std::to_string(rest_.size()) + ", as many as at rest, got " +
                                                   std::to_string(points.size()));
    }
    check_finite(points, "points");
    if (!plane_ || in_one_plane(points)) return;
    const std::size_t i = first_off_plane(points);
    throw Error(ErrorCode::invalid_argument, "points[" + std::to_string(i) + "]: z = " + number_digits(points[i][2]) +
                                                 ", but faces can be used as cells only in a plane z = constant, points[0] has " +
                                                 number_digits(points[0][2]));
  }

  std::size_t fields() const { return bounds_ ? bounds_->fields() : 0; }
  const Inversions& at_rest() const { return at_rest_; }
  std::size_t left_handed() const { return left_handed_; }

  Inversions inversions(std::span<const Vec3> points, const RunContext& context) const {
    return at_end(points, nullptr, context).inverted;
  }

  std::size_t below(double margin, std::span<const Vec3> rest, std::span<const Vec3> points, const RunContext& context) const {
    std::atomic<std::size_t> count{0};
    parallel_for(context, size(), cells_per_range, [&](std::size_t begin, std::size_t end) {
      std::size_t of_range = 0;
      for (std::size_t c = begin; c < end; ++c) {
        if (excluded_[c] || cells_->state(points, c).determinant >= margin) continue;
        of_range += cells_->state(rest, c).determinant >= margin;
      }
      count += of_range;
    });
    return count;
  }

  bool is_rest(std::span<const Vec3> points) const {
    return std::equal(points.begin(), points.end(), rest_.begin(), rest_.end());
  }

  SafeAmplitude amplitude(std::span<const Vec3> from, bool from_rest, std::span<const Vec3> to, const RunContext& context) const {
    End end = at_end(to, nullptr, context);
    if (from_rest) return safety({rest_, {}}, to, std::move(end), context);
    std::vector<std::uint32_t> cells, either;
    for (const Suspect& suspect : end.suspects) cells.push_back(static_cast<std::uint32_t>(suspect.cell));
    const auto others = doubtful(from, -std::numeric_limits<double>::infinity(), context);
    std::set_union(cells.begin(), cells.end(), others.begin(), others.end(), std::back_inserter(either));
    end.suspects = stretched(to, either, context);
    return safety({from, from}, to, std::move(end), context);
  }

  SafeAmplitude amplitude(std::span<const Vec3> to, const FieldMotion& motion, const RunContext& context) const {
    if (!bounds_) throw Error(ErrorCode::invalid_argument, "motion: the check was made without displacement fields");
    if (to.size() != rest_.size() || !(bounds_->reach(motion) < surely_finite)) check(to);
    End end = at_end(to, &motion, context);
    return safety({rest_, {}}, to, std::move(end), context);
  }

 private:
  /// What is found at the end of a motion, and the cells that bounds from rest to there do not clear, ascending.
  struct End {
    Inversions inverted;
    std::vector<Suspect> suspects;
  };

  /// Where a motion begins.
  struct Start {
    std::span<const Vec3> points;
    std::span<const Vec3> moved;  ///< the same, if it is not at rest
  };

  SafeAmplitude safety(const Start& start, std::span<const Vec3> to, End end, const RunContext& context) const {
    SafeAmplitude result;
    result.inverted = std::move(end.inverted);
    const std::vector<Suspect> suspects = most_deformed_first(start, std::move(end.suspects), context);
    result.suspects = suspects.size();
    Extreme first = first_inversion(start, to, suspects, context);
    // The tolerance on the way is half of that at its end.
    if (first.value > 1 && result.inverted.count > 0) first = {1, result.inverted.worst.front().id};
    if (first.value > 1) return result;
    result.amplitude = std::min(first.value, std::nextafter(1.0, 0.0));
    result.first_cell = first.id;
    return result;
  }

  /// The cells that are not excluded and that the bounds of blocks do not prove to be sound and above `floor`; ascending.
  std::vector<std::uint32_t> doubtful(std::span<const Vec3> points, double floor, const RunContext& context) const {
    std::vector<std::vector<std::uint32_t>> of_range((certificate_->block_count() + blocks_grain - 1) / blocks_grain);
    parallel_for(context, certificate_->block_count(), blocks_grain, [&](std::size_t begin, std::size_t end) {
      certificate_->doubtful(points, floor, begin, end, of_range[begin / blocks_grain]);
    });
    auto all = joined(std::move(of_range));
    std::sort(all.begin(), all.end());
    return all;
  }

  /// The same for a motion from rest, most of it by its coefficients. Where these clear few cells, those of the blocks do it at
  /// less cost than one by one; then all of them are unproven.
  FieldBounds::Doubtful doubtful(std::span<const Vec3> points, const FieldMotion& motion, double floor,
                                 const RunContext& context) const {
    const std::size_t clusters = bounds_->cluster_count();
    std::vector<FieldBounds::Doubtful> of_range((clusters + clusters_grain - 1) / clusters_grain);
    parallel_for(context, clusters, clusters_grain, [&](std::size_t begin, std::size_t end) {
      bounds_->doubtful(motion, floor, begin, end, of_range[begin / clusters_grain]);
    });
    FieldBounds::Doubtful all;
    for (const auto& range : of_range) {
      all.unproven.insert(all.unproven.end(), range.unproven.begin(), range.unproven.end());
      all.low.insert(all.low.end(), range.low.begin(), range.low.end());
    }
    if (all.size() > size() / few) return {doubtful(points, floor, context), {}};
    std::sort(all.unproven.begin(), all.unproven.end());
    return all;
  }

  /// Passes over the cells that are sound at a place and better than one that has been looked at: none of them is in the summary.
  /// A `motion`, if any, is from rest to the place.
  End at_end(std::span<const Vec3> points, const FieldMotion* motion, const RunContext& context) const {
    std::atomic<double> least{1};
    if (!excluded_[worst_]) lower(least, cells_->state(points, worst_).determinant);
    const FieldBounds::Doubtful cells = motion == nullptr ? FieldBounds::Doubtful{doubtful(points, least.load(), context), {}}
                                                          : doubtful(points, *motion, least.load(), context);
    const std::vector<std::uint32_t>& unproven = cells.unproven;
    std::vector<std::vector<Look>> looks((unproven.size() + cells_per_range - 1) / cells_per_range);
    std::vector<std::vector<Suspect>> suspects(looks.size());
    parallel_for(context, unproven.size(), cells_per_range, [&](std::size_t begin, std::size_t end) {
      for (std::size_t i = begin; i < end; ++i) {
        const std::size_t c = unproven[i];
        const MotionCertificate::Stretch stretch = certificate_->stretch(points, c);
        const auto bound = certificate_->bound(c, stretch);
        if (!bound.sound) suspects[begin / cells_per_range].push_back({c, stretch});
        if (bound.sound && bound.determinant > least.load(std::memory_order_relaxed)) continue;
        looks[begin / cells_per_range].push_back({c, cells_->state(points, c)});
        lower(least, looks[begin / cells_per_range].back().state.determinant);
      }
    });
    // A bound of their deformation would take as long as their state and hardly ever save it.
    std::vector<Look> low(cells.low.size());
    parallel_for(context, low.size(), cells_per_range, [&](std::size_t begin, std::size_t end) {
      for (std::size_t i = begin; i < end; ++i) low[i] = {cells.low[i], cells_->state(points, cells.low[i])};
    });
    std::vector<Look> all = joined(std::move(looks));
    all.insert(all.end(), low.begin(), low.end());
    std::sort(all.begin(), all.end(), [](const Look& a, const Look& b) { return a.cell < b.cell; });
    return {summary(all), joined(std::move(suspects))};
  }

  /// These cells with their deformation at the end.
  std::vector<Suspect> stretched(std::span<const Vec3> to, std::span<const std::uint32_t> cells,
                                 const RunContext& context) const {
    std::vector<Suspect> all(cells.size());
    parallel_for(context, cells.size(), cells_per_range, [&](std::size_t begin, std::size_t end) {
      for (std::size_t i = begin; i < end; ++i) all[i] = {cells[i], certificate_->stretch(to, cells[i])};
    });
    return all;
  }

  /// Those that the bounds of their deformation do not clear.
  std::vector<Suspect> most_deformed_first(const Start& start, std::vector<Suspect> suspects, const RunContext& context) const {
    std::vector<char> clear(suspects.size());
    parallel_for(context, suspects.size(), cells_per_range, [&](std::size_t begin, std::size_t end) {
      for (std::size_t i = begin; i < end; ++i) clear[i] = cleared(start, suspects[i], 1) ? 1 : 0;
    });
    std::size_t left = 0;
    for (std::size_t i = 0; i < suspects.size(); ++i) {
      if (clear[i] == 0) suspects[left++] = suspects[i];
    }
    suspects.resize(left);
    std::stable_sort(suspects.begin(), suspects.end(),
                     [](const Suspect& a, const Suspect& b) { return a.to.gradient > b.to.gradient; });
    return suspects;
  }

  /// Not inverted on the way as far as `share` of it.
  bool cleared(const Start& start, const Suspect& suspect, double share) const {
    const MotionCertificate::Stretch from =
        start.moved.empty() ? MotionCertificate::Stretch{} : certificate_->stretch(start.moved, suspect.cell);
    return certificate_->bound(suspect.cell, MotionCertificate::Stretch::between(from, suspect.to, share)).sound &&
           certificate_->bound(suspect.cell, from).sound;
  }

  /// The first inversion of all, and whose it is. `bound` only saves work: no cell with a smaller or equal one is passed over.
  Extreme first_inversion(const Start& start, std::span<const Vec3> to, const std::vector<Suspect>& suspects,
                          const RunContext& context) const {
    const Extreme none{std::numeric_limits<double>::infinity(), 0};
    std::vector<Extreme> of_range((suspects.size() + suspects_grain - 1) / suspects_grain, none);
    std::atomic<double> bound{1};
    parallel_for(context, suspects.size(), suspects_grain, [&](std::size_t begin, std::size_t end) {
      Extreme& least = of_range[begin / suspects_grain];
      for (std::size_t i = begin; i < end; ++i) {
        const double share = bound.load(std::memory_order_relaxed);
        if (cleared(start, suspects[i], share)) continue;
        const Extreme found{cells_->first_inversion(start.points, to, suspects[i].cell, share), suspects[i].cell};
        if (before(found, least)) least = found;
        lower(bound, found.value);
      }
    });
    const auto first = std::min_element(of_range.begin(), of_range.end(), before);
    return first == of_range.end() ? none : *first;
  }

  static bool before(const Extreme& a, const Extreme& b) { return a.value != b.value ? a.value < b.value : a.id < b.id; }

  /// Summarizes the states of checked cells, in ascending order, without the excluded ones.
  Inversions summary(const std::vector<Look>& looks) const {
    Inversions result;
    for (const auto& [c, state] : looks) {
      if (!excluded_.empty() && excluded_[c]) continue;
      if (state.inverted) result.worst.push_back({state.determinant, c});
      result.without_volume += state.without_volume;
      result.wrong_pyramid += state.wrong_pyramid;
      if (state.determinant < result.least_determinant.value) result.least_determinant = {state.determinant, c};
    }
    result.count = result.worst.size();
    const auto listed = static_cast<std::ptrdiff_t>(std::min(result.count, quality::most_listed));
    std::partial_sort(result.worst.begin(), result.worst.begin() + listed, result.worst.end(),
                      [](const Extreme& a, const Extreme& b) { return a.value != b.value ? a.value < b.value : a.id < b.id; });
    result.worst.resize(static_cast<std::size_t>(listed));
    return result;
  }

  const Points rest_;
  const bool plane_;
  std::size_t left_handed_ = 0;
  std::unique_ptr<const MovingCells> cells_;
  std::vector<char> excluded_;
  std::size_t worst_ = 0;  ///< of the cells that are not excluded the one of least determinant at rest
  Inversions at_rest_;
  std::optional<MotionCertificate> certificate_;
  std::optional<FieldBounds> bounds_;  ///< for motions of known fields
};

InversionCheck::InversionCheck(std::span<const Vec3> rest, const CellSet& cells, const RunContext& context)
    : impl_(std::make_unique<const Impl>(rest, cells, nullptr, context)) {}
InversionCheck::InversionCheck(std::span<const Vec3> rest, const CellSet& cells, const DisplacementFields& fields,
                               const RunContext& context)
    : impl_(std::make_unique<const Impl>(rest, cells, &fields, context)) {}
InversionCheck::~InversionCheck() = default;
InversionCheck::InversionCheck(InversionCheck&&) noexcept = default;
InversionCheck& InversionCheck::operator=(InversionCheck&&) noexcept = default;

std::size_t InversionCheck::cell_count() const { return impl_->size(); }
std::size_t InversionCheck::fields() const { return impl_->fields(); }
const Inversions& InversionCheck::at_rest() const { return impl_->at_rest(); }
std::size_t InversionCheck::left_handed() const { return impl_->left_handed(); }

Inversions InversionCheck::inverted(std::span<const Vec3> points, const RunContext& context) const {
  impl_->check(points);
  return impl_->inversions(points, context);
}

std::size_t InversionCheck::below(double margin, std::span<const Vec3> rest, std::span<const Vec3> points,
                                  const RunContext& context) const {
  impl_->check(rest);
  impl_->check(points);
  return impl_->below(margin, rest, points, context);
}

SafeAmplitude InversionCheck::amplitude(std::span<const Vec3> from, std::span<const Vec3> to, const RunContext& context) const {
  const bool at_rest = impl_->is_rest(from);
  if (!at_rest) impl_->check(from);
  impl_->check(to);
  return impl_->amplitude(from, at_rest, to, context);
}

SafeAmplitude InversionCheck::amplitude(std::span<const Vec3> to, const FieldMotion& motion, const RunContext& context) const {
  return impl_->amplitude(to, motion, context);
}

std::size_t InversionCheck::bytes_for(const CellSet& cells, std::size_t points, std::size_t fields) {
  if (empty(cells)) return 0;
  // Excluded and left-handed or not, where its sides and its nodes begin; and while looking what is found out about it.
  constexpr std::size_t each = 2 + 2 * sizeof(std::uint64_t),
                        looking = 4 * sizeof(std::uint32_t) + 2 * sizeof(Look) + sizeof(Extreme);
  constexpr std::size_t side = 16;
  const auto* polyhedra = std::get_if<const PolyhedralCells*>(&cells);
  const std::size_t count = deform::cell_count(cells), nodes = node_count(cells);
  const std::size_t kept = each * count + sizeof(Vec3) * points + MotionCertificate::bytes_for(count, nodes) +
                           (fields > 0 ? FieldBounds::bytes_for(count, fields) : 0);
  if (polyhedra == nullptr) return kept + looking * count;
  return kept + looking * count + side * ((*polyhedra)->face_count() + (*polyhedra)->internal_faces()) + sizeof(PointId) * nodes;
}

std::size_t InversionCheck::bytes_to_make(const CellSet& cells, std::size_t points, std::size_t fields) {
  if (empty(cells)) return 0;
  // Orientations, sets of cells and their votes; later determinants and what the certificate takes beside what it keeps.
  constexpr std::size_t each = 1 + 2 * sizeof(std::uint32_t) + 4 * sizeof(std::uint64_t);
  const std::size_t count = deform::cell_count(cells), nodes = node_count(cells);
  const std::size_t values =
      fields > 0 ? FieldBounds::bytes_to_make(count, points, fields) - FieldBounds::bytes_for(count, fields) : 0;
  return bytes_for(cells, points, fields) + each * count + quality::SideLinks::bytes_for(side_count(cells)) + values +
         MotionCertificate::bytes_to_make(count, points, nodes) - MotionCertificate::bytes_for(count, nodes);
}

std::optional<CellSet> cell_set(const Mesh& mesh) {
  if (mesh.elements) return CellSet(mesh.elements.get());
  if (mesh.cells) return CellSet(mesh.cells.get());
  const bool plane =
      mesh.face_count() > 0 && in_one_plane(mesh.points) &&
      std::all_of(mesh.face_sizes.begin(), mesh.face_sizes.end(), [](auto size) { return size == 3 || size == 4; });
  return plane ? std::optional<CellSet>(&mesh) : std::nullopt;
}

bool in_one_plane(std::span<const Vec3> points) { return first_off_plane(points) == points.size(); }

std::vector<char> left_handed_cells(std::span<const Vec3> points, const CellSet& cells, const RunContext& context) {
  return empty(cells) ? std::vector<char>{} : left_handed(*moving(cells, points.size()), points, context);
}

MotionSafety safe_amplitude(std::span<const Vec3> X, std::span<const Vec3> Y, const CellSet& cells, const RunContext& context) {
  const InversionCheck check(X, cells, context);
  return {check.amplitude(X, Y, context), check.at_rest()};
}

}  // namespace deform

// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/handles/handle_evaluation.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

#include "core/base/error.h"
#include "core/base/vectors.h"

namespace deform {

void place_components(const std::vector<std::size_t>& components, std::size_t designs, const double* part, double* values) {
  const std::size_t width = components.size();
  for (std::size_t i = 0; i < designs; ++i) {
    for (std::size_t c = 0; c < width; ++c) {
      std::copy_n(part + (i * width + c) * tile_size, tile_size, values + (3 * i + components[c]) * tile_size);
    }
  }
}

HandleEvaluation::HandleEvaluation(std::shared_ptr<const HandleSystem> system, std::span<const Design> designs,
                                   EvaluationPath path, const RunContext& context)
    : held_(system->held()), reports_(designs.size()), system_(std::move(system)), slot_(designs.size()) {
  designs_.reserve(designs.size());
  for (std::size_t i = 0; i < designs.size(); ++i) {
    context.check();
    designs_.push_back(held_.bound(designs[i], i));
    system_->check(designs_[i], i);
    reports_[i].prescribed_displacement = held_.largest_displacement(designs_[i]);
  }
  choose_paths(path);
  set_basis_coefficients();
}

HandleEvaluation::HandleEvaluation(std::shared_ptr<const HandleSystem> system, const std::vector<Affine>& derivatives)
    : held_(system->held()), kind_(MotionKind::derivative), reports_(1), system_(std::move(system)), slot_(1) {
  designs_.push_back({derivatives, std::vector<std::vector<Vec3>>(derivatives.size()), 0});
  choose_paths(EvaluationPath::automatic);
  set_basis_coefficients();
}

void HandleEvaluation::choose_paths(EvaluationPath path) {
  const bool has_basis = system_->has_basis();
  for (std::size_t i = 0; i < designs_.size(); ++i) {
    const bool affine = designs_[i].is_affine();
    const bool other_tolerance = designs_[i].tolerance != 0 && designs_[i].tolerance != system_->info_.tolerance;
    const char* refusal = !has_basis        ? "the system was prepared without a basis"
                          : !affine         ? "a handle has displacements per point"
                          : other_tolerance ? "the basis was made with the tolerance of the setup"
                                            : nullptr;
    if (path == EvaluationPath::basis && refusal != nullptr) {
      throw Error(ErrorCode::invalid_argument, "designs[" + std::to_string(i) + "]: path BASIS, but " + refusal);
    }
    const bool direct = path == EvaluationPath::direct || refusal != nullptr;
    slot_[i] = direct ? direct_designs_++ : basis_designs_++;
    reports_[i].path = direct ? EvaluationPath::direct : EvaluationPath::basis;
  }
}

void HandleEvaluation::set_basis_coefficients() {
  if (basis_designs_ == 0) return;
  const Symmetry& symmetry = system_->regions_.symmetry;
  const auto& bases = system_->basis_;
  const std::size_t handles = system_->frames_.size();
  for (const HandleBasis& basis : bases) {
    coefficients_.emplace_back(4 * handles * basis_designs_ * basis.components.size(), 0.0);
  }
  double block[12];
  for (std::size_t i = 0; i < designs_.size(); ++i) {
    if (is_direct(i)) continue;
    Vec3 bound{};
    for (std::size_t h = 0; h < handles; ++h) {
      field_coefficients(designs_[i].affine[h], kind_, system_->frames_[h], system_->box_, block);
      for (std::size_t f = 0; f < 4; ++f) {
        Vec3 row{block[3 * f], block[3 * f + 1], block[3 * f + 2]};
        if (!symmetry.empty()) row = symmetry.to_frame(row);
        for (std::size_t b = 0; b < bases.size(); ++b) {
          const auto& components = bases[b].components;
          double* out = coefficients_[b].data() + ((4 * h + f) * basis_designs_ + slot_[i]) * components.size();
          for (const std::size_t k : components) {
            *out++ = row[k];
            bound[k] += bases[b].residuals[4 * h + f] * std::abs(row[k]);
          }
        }
      }
    }
    reports_[i].interpolation_residual = norm(bound);
  }
}

Vec3 HandleEvaluation::prescribed_displacement(const BoundDesign& design, PointId id) const {
  Vec3 u = held_.place(design, id, kind_);
  if (kind_ == MotionKind::position) u = u - held_.mesh.points[id];
  const Symmetry& symmetry = held_.regions.symmetry;
  return symmetry.empty() ? u : system_->components(symmetry.to_frame(u), id);
}

void HandleEvaluation::evaluate(std::size_t begin, std::size_t end, std::size_t first, std::span<Vec3* const> out) const {
  for (std::size_t i = begin; i < end; ++i) {
    const auto id = static_cast<PointId>(i);
    if (!system_->is_prescribed(id)) continue;
    for (std::size_t k = 0; k < out.size(); ++k) out[k][i - begin] = held_.place(designs_[first + k], id, kind_);
  }
  evaluate_following(begin, end, first, out);
  replace_points(begin, end, first, out);
}

void HandleEvaluation::replace_points(std::size_t, std::size_t, std::size_t, std::span<Vec3* const>) const {}

/// For designs on one path, as direct_tile().
void HandleEvaluation::fill_tile(std::size_t tile, std::size_t first, std::size_t count, double* values) const {
  if (is_direct(first)) return direct_tile(tile, first, count, values);
  std::fill_n(values, 3 * count * tile_size, 0.0);
  const auto product = [&](std::size_t b, double* to) {
    const HandleBasis& basis = system_->basis_[b];
    const std::size_t width = basis.components.size();
    tile_product(basis.tiles.tile(tile), basis.tiles.fields(), coefficients_[b].data() + width * slot_[first],
                 width * basis_designs_, width * count, to);
  };
  if (system_->regions_.symmetry.empty()) return product(0, values);
  std::vector<double> part(3 * count * tile_size);
  for (std::size_t b = 0; b < system_->basis_.size(); ++b) {
    std::fill(part.begin(), part.end(), 0.0);
    product(b, part.data());
    place_components(system_->basis_[b].components, count, part.data(), values);
  }
}

void HandleEvaluation::evaluate_following(std::size_t begin, std::size_t end, std::size_t first,
                                          std::span<Vec3* const> out) const {
  const std::vector<PointId>& ids = system_->following();
  const Symmetry& symmetry = system_->regions_.symmetry;
  const auto position = [&](std::size_t id) {
    return static_cast<std::size_t>(std::lower_bound(ids.begin(), ids.end(), static_cast<std::uint64_t>(id)) - ids.begin());
  };
  const std::size_t low = position(begin), high = position(end);
  const double keep = kind_ == MotionKind::position ? 1.0 : 0.0;
  std::vector<double> values(low == high ? 0 : 3 * out.size() * tile_size);
  for (std::size_t t = low / tile_size; t * tile_size < high && low < high; ++t) {
    // Runs of designs on one path share a pass over the tile.
    for (std::size_t k = 0; k < out.size();) {
      std::size_t last = k + 1;
      while (last < out.size() && is_direct(first + last) == is_direct(first + k)) ++last;
      fill_tile(t, first + k, last - k, values.data() + 3 * k * tile_size);
      k = last;
    }
    for (std::size_t s = std::max(low, t * tile_size); s < std::min(high, (t + 1) * tile_size); ++s) {
      const Vec3& x = held_.mesh.points[ids[s]];
      const double* value = values.data() + s % tile_size;
      for (std::size_t k = 0; k < out.size(); ++k) {
        Vec3 u;
        for (std::size_t c = 0; c < 3; ++c) u[c] = value[(3 * k + c) * tile_size];
        if (!symmetry.empty()) u = symmetry.from_frame(system_->components(u, ids[s]));
        Vec3& y = out[k][ids[s] - begin];
        for (std::size_t c = 0; c < 3; ++c) y[c] = keep * x[c] + u[c];
      }
    }
  }
}

}  // namespace deform

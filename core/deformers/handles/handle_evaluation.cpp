// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/handles/handle_evaluation.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <string>
#include <utility>

#include "core/base/error.h"
#include "core/base/vectors.h"
#include "core/deformers/handles/handle_fields.h"
#include "core/numerics/interpolation/interpolator.h"

namespace deform {

namespace {

constexpr std::size_t streams_of_results = 4;

}  // namespace

void add_components(const std::vector<std::size_t>& components, std::size_t designs, const double* part, double* values) {
  const std::size_t width = components.size();
  for (std::size_t i = 0; i < designs; ++i) {
    for (std::size_t c = 0; c < width; ++c) {
      const double* const from = part + (i * width + c) * tile_size;
      double* const to = values + (3 * i + components[c]) * tile_size;
      for (std::size_t s = 0; s < tile_size; ++s) to[s] += from[s];
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
  const bool converged = std::all_of(bases.begin(), bases.end(), [](const HandleBasis& basis) { return basis.converged; });
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
          const Vec3 taken = bases[b].turned ? Vec3{0, -row[2], row[1]} : row;
          double* out = coefficients_[b].data() + ((4 * h + f) * basis_designs_ + slot_[i]) * components.size();
          for (const std::size_t k : components) {
            *out++ = taken[k];
            bound[k] += bases[b].residuals[4 * h + f] * std::abs(taken[k]);
          }
        }
      }
    }
    reports_[i].interpolation_residual = measures_misfits() ? largest_checked(i) : norm(bound);
    set_error(i, basis_error(i, error_margin) + compression_error(i));
    reports_[i].converged = converged;
  }
  choose_fields();
}

void HandleEvaluation::choose_fields() {
  for (const std::vector<double>& coefficients : coefficients_) {
    std::vector<std::uint32_t>& moving = moving_fields_.emplace_back();
    const std::size_t fields = system_->fields(), width = coefficients.size() / fields;
    for (std::size_t f = 0; f < fields; ++f) {
      const auto row = coefficients.begin() + static_cast<std::ptrdiff_t>(f * width);
      const bool still = std::all_of(row, row + static_cast<std::ptrdiff_t>(width), [](double c) { return c == 0; });
      if (!still) moving.push_back(static_cast<std::uint32_t>(f));
    }
  }
}

void HandleEvaluation::set_error(std::size_t design, double error) {
  const double rounded = system_->largest_coordinate_ + largest_terms(design);
  reports_[design].error = error + std::numeric_limits<double>::epsilon() * rounded;
}

double HandleEvaluation::largest_terms(std::size_t design) const {
  return held_.largest_terms(designs_[design], system_->largest_coordinate_);
}

const double* HandleEvaluation::coefficients(std::size_t basis, std::size_t field, std::size_t design) const {
  return coefficients_[basis].data() + (field * basis_designs_ + slot_[design]) * system_->basis_[basis].components.size();
}

bool HandleEvaluation::measures_misfits() const {
  return !system_->basis_.empty() && system_->basis_[0].checked == HandleBasis::Checked::held;
}

double HandleEvaluation::largest_checked(std::size_t design) const {
  const auto& bases = system_->basis_;
  const std::size_t fields = system_->fields();
  const std::size_t places = bases.empty() ? 0 : bases[0].errors.size() / fields;
  double largest = 0;
  for (std::size_t s = 0; s < places; ++s) {
    Vec3 error{};
    for (std::size_t b = 0; b < bases.size(); ++b) {
      for (std::size_t f = 0; f < fields; ++f) {
        const double* row = coefficients(b, f, design);
        for (const std::size_t k : bases[b].components) error[k] += bases[b].errors[s * fields + f] * *row++;
      }
    }
    const double length = norm(error);
    if (!std::isfinite(length)) return std::numeric_limits<double>::infinity();
    largest = std::max(largest, length);
  }
  return largest;
}

double HandleEvaluation::basis_error(std::size_t design, double margin) const {
  const auto& bases = system_->basis_;
  double largest = 0;
  if (!measures_misfits()) {
    largest = margin * largest_checked(design);
  } else if (system_->hard_handles()) {
    largest = reports_[design].interpolation_residual;
  }
  Vec3 sums{};
  for (std::size_t b = 0; b < bases.size(); ++b) {
    for (std::size_t f = 0; f < bases[b].more.size(); ++f) {
      const double* row = coefficients(b, f, design);
      for (const std::size_t k : bases[b].components) sums[k] += bases[b].more[f] * std::abs(*row++);
    }
  }
  return largest + norm(sums);
}

double HandleEvaluation::compression_error(std::size_t design) const {
  if (is_direct(design)) return 0;
  Vec3 sums{};
  for (std::size_t b = 0; b < system_->basis_.size(); ++b) {
    const HandleBasis& basis = system_->basis_[b];
    if (!basis.compressed) continue;
    for (std::size_t f = 0; f < system_->fields(); ++f) {
      const double* row = coefficients(b, f, design);
      for (const std::size_t k : basis.components) sums[k] += basis.compressed->errors()[f] * std::abs(*row++);
    }
  }
  return norm(sums);
}

double HandleEvaluation::allowed_error(std::size_t design) const {
  const SystemInfo& info = system_->info_;
  const double tolerance = designs_[design].tolerance > 0 ? designs_[design].tolerance : info.tolerance;
  return tolerance * std::max(info.diagonal, reports_[design].prescribed_displacement);
}

void HandleEvaluation::judge() {
  if (system_->info_.solver != Solver::iterative) return;
  // Not (error > allowed), so that NaN counts as an error. The compression error of a basis is not an error of the solver.
  for (std::size_t i = 0; i < designs_.size(); ++i) {
    reports_[i].converged = reports_[i].error - compression_error(i) <= allowed_error(i);
  }
}

/// Roundings: of a coefficient those of field_coefficients() and one for each term of the sums; of the points those of handle
/// points, of their fields and of the last addition. A few times what they amount to.
std::optional<FieldMotion> HandleEvaluation::field_motion(std::size_t design) const {
  if (is_direct(design) || kind_ != MotionKind::position || !system_->setup_.constraints.empty()) return std::nullopt;
  constexpr double unit = std::numeric_limits<double>::epsilon();
  const double reach = 2 * system_->largest_coordinate_;
  std::vector<double> of_handle;
  double places = 0, sizes = 0;
  for (std::size_t h = 0; h < system_->frames_.size(); ++h) {
    const Affine& map = designs_[design].affine[h];
    double linear = 0, off = 0;
    for (std::size_t i = 0; i < 3; ++i) {
      off += std::abs(map[4 * i + 3]);
      for (std::size_t j = 0; j < 3; ++j) linear += std::abs(map[4 * i + j]);
    }
    const double centre = norm(system_->box_.to_model(system_->frames_[h].reference));
    of_handle.push_back(map == identity_affine ? 0 : off + (3 + linear) * (reach + centre + system_->box_.scale));
    places = std::max(places, of_handle.back());
  }
  FieldMotion motion;
  const auto terms = static_cast<double>(system_->fields() + 16);
  for (const HandleFields::Entry& entry : HandleFields::entries(*system_)) {
    const auto& components = system_->basis_[entry.basis].components;
    const double* row = coefficients(entry.basis, entry.field, design);
    Vec3 c{};
    for (std::size_t k = 0; k < components.size(); ++k) {
      const bool applies = std::count(entry.components.begin(), entry.components.end(), components[k]) > 0;
      if (applies) c[components[k]] = row[k];
    }
    if (!system_->regions_.symmetry.empty()) c = system_->regions_.symmetry.from_frame(c);
    motion.coefficients.push_back(c);
    const double size = norm(c);
    motion.uncertainties.push_back(unit * (terms * size + 16 * of_handle[entry.field / 4]));
    sizes += size;
  }
  motion.rounding = 16 * unit * (reach + places + sizes);
  return motion;
}

Vec3 HandleEvaluation::prescribed_displacement(const BoundDesign& design, PointId id) const {
  const Vec3 u = held_.displacement(design, id, kind_);
  const Symmetry& symmetry = held_.symmetry;
  return symmetry.empty() ? u : system_->components(symmetry.to_frame(u), id);
}

void HandleEvaluation::evaluate(std::size_t begin, std::size_t end, std::size_t first, std::span<Vec3* const> out) const {
  evaluate_prescribed(begin, end, first, out);
  const std::size_t pass = designs_in_pass(first, out.size());
  for (std::size_t k = 0; k < out.size(); k += pass) {
    evaluate_following(begin, end, first + k, out.subspan(k, std::min(pass, out.size() - k)));
  }
  replace_points(begin, end, first, out);
}

/// The number of designs on stored bases that share a pass: more streams of results than a few are slower to write than the bases
/// of these points to read again. What is computed for a tile, or decoded, is for all designs.
std::size_t HandleEvaluation::designs_in_pass(std::size_t first, std::size_t count) const {
  const bool compressed = system_->has_basis() && system_->basis_.front().compressed;
  bool direct = false;
  for (std::size_t i = first; i < first + count; ++i) direct = direct || is_direct(i);
  return compressed || direct ? std::max<std::size_t>(1, count) : streams_of_results;
}

SpaceMap::Found HandleEvaluation::displacements_at(std::span<const Vec3>, std::uint64_t, std::span<Vec3>,
                                                   const RunContext&) const {
  throw Error(ErrorCode::internal, "this deformation is defined at the points of its mesh only");
}

void HandleEvaluation::replace_points(std::size_t, std::size_t, std::size_t, std::span<Vec3* const>) const {}

namespace {

/// Where points from `id` on begin among ascending ids.
std::size_t position(const std::vector<PointId>& ids, std::size_t id) {
  return static_cast<std::size_t>(std::lower_bound(ids.begin(), ids.end(), static_cast<std::uint64_t>(id)) - ids.begin());
}

/// Whether a tile's ids from a position on follow one another.
bool is_run(const std::vector<PointId>& ids, std::size_t from) {
  return from + tile_size <= ids.size() && ids[from + tile_size - 1] == ids[from] + (tile_size - 1);
}

}  // namespace

/// The points between those that follow.
void HandleEvaluation::evaluate_prescribed(std::size_t begin, std::size_t end, std::size_t first,
                                           std::span<Vec3* const> out) const {
  const std::vector<PointId>& ids = system_->following();
  std::size_t next = position(ids, begin);
  for (std::size_t i = begin; i < end;) {
    if (next < ids.size() && ids[next] == i) {
      const std::size_t run = is_run(ids, next) ? tile_size : 1;
      next += run;
      i += run;
      continue;
    }
    for (std::size_t k = 0; k < out.size(); ++k) {
      out[k][i - begin] = held_.place(designs_[first + k], static_cast<PointId>(i), kind_);
    }
    ++i;
  }
}

/// The working data of one call of evaluate().
struct HandleEvaluation::Pass {
  std::size_t first_slot = 0;          ///< of the designs on the basis path
  std::vector<CompressedSums> sums;    ///< per basis, if they are compressed
  std::vector<double> values;          ///< of a tile: [design][component][16]
  std::vector<double> part;            ///< the same of one basis, with symmetry planes
  std::size_t low = 0, high = 0;       ///< the tile's points among those that follow
  const Vec3* places = nullptr;        ///< of these points, model units
  bool run = false;                    ///< whether their ids are those of a whole tile and follow one another
  std::array<Vec3, tile_size> x{};     ///< the places where they do not
  std::array<Vec3, tile_size> unit{};  ///< the same in unit coordinates, for compressed bases
};

/// For designs on one path, as direct_tile(), into pass.values from its beginning.
void HandleEvaluation::fill_tile(std::size_t tile, std::size_t first, std::size_t count, Pass& pass) const {
  if (is_direct(first)) return direct_tile(tile, first, count, pass.values.data());
  std::fill_n(pass.values.data(), 3 * count * tile_size, 0.0);
  const auto product = [&](std::size_t b, double* to) {
    const HandleBasis& basis = system_->basis_[b];
    const std::size_t width = basis.components.size();
    if (moving_fields_[b].empty()) return;
    if (basis.compressed) {
      const std::span<const Vec3> places(pass.unit.data(), pass.high - pass.low);
      return pass.sums[b].add_tile(tile, places, width * (slot_[first] - pass.first_slot), width * count, to);
    }
    const double* coefficients = coefficients_[b].data() + width * slot_[first];
    tile_product(basis.tiles.tile(tile), basis.tiles.fields(), moving_fields_[b], coefficients, width * basis_designs_,
                 width * count, to);
  };
  if (system_->regions_.symmetry.empty()) return product(0, pass.values.data());
  pass.part.resize(3 * count * tile_size);
  for (std::size_t b = 0; b < system_->basis_.size(); ++b) {
    std::fill(pass.part.begin(), pass.part.end(), 0.0);
    product(b, pass.part.data());
    add_components(system_->basis_[b].components, count, pass.part.data(), pass.values.data());
  }
}

/// Points [low, high) of those that follow, of one tile, from its displacements.
void HandleEvaluation::place_tile(std::size_t low, std::size_t high, std::size_t begin, const Pass& pass,
                                  std::span<Vec3* const> out) const {
  const std::vector<PointId>& ids = system_->following();
  const Symmetry& symmetry = system_->regions_.symmetry;
  const double keep = kind_ == MotionKind::position ? 1.0 : 0.0;
  const bool whole = pass.run && high - low == tile_size && symmetry.empty();
  for (std::size_t k = 0; k < out.size(); ++k) {
    const double* const values = pass.values.data() + 3 * k * tile_size;
    if (whole) {
      tile_positions(pass.places, keep, values, out[k] + (ids[low] - begin));
      continue;
    }
    for (std::size_t s = low; s < high; ++s) {
      const std::size_t i = s - pass.low;
      Vec3 u{values[i], values[tile_size + i], values[2 * tile_size + i]};
      if (!symmetry.empty()) u = symmetry.from_frame(system_->components(u, ids[s]));
      const Vec3& x = pass.places[i];
      out[k][ids[s] - begin] = {keep * x[0] + u[0], keep * x[1] + u[1], keep * x[2] + u[2]};
    }
  }
}

void HandleEvaluation::evaluate_following(std::size_t begin, std::size_t end, std::size_t first,
                                          std::span<Vec3* const> out) const {
  const std::vector<PointId>& ids = system_->following();
  const std::size_t low = position(ids, begin), high = position(ids, end);
  if (low == high || out.empty()) return;
  const Points& rest = system_->mesh_->points;
  Pass pass;
  pass.values.resize(3 * out.size() * tile_size);
  const bool compressed = system_->has_basis() && system_->basis_.front().compressed;
  if (compressed) start_sums(first, out.size(), pass);
  for (std::size_t t = low / tile_size; t * tile_size < high; ++t) {
    pass.low = t * tile_size;
    pass.high = std::min(ids.size(), pass.low + tile_size);
    pass.run = is_run(ids, pass.low);
    pass.places = pass.run ? &rest[ids[pass.low]] : pass.x.data();
    for (std::size_t s = pass.low; s < pass.high && !pass.run; ++s) pass.x[s - pass.low] = rest[ids[s]];
    for (std::size_t i = 0; i < pass.high - pass.low && compressed; ++i) pass.unit[i] = system_->box_.to_unit(pass.places[i]);
    // Runs of designs on one path share a pass over the tile.
    for (std::size_t k = 0; k < out.size();) {
      std::size_t last = k + 1;
      while (last < out.size() && is_direct(first + last) == is_direct(first + k)) ++last;
      fill_tile(t, first + k, last - k, pass);
      place_tile(std::max(low, pass.low), std::min(high, pass.high), begin, pass, out.subspan(k, last - k));
      k = last;
    }
  }
}

/// The sums of the designs of a call that are on the basis path.
void HandleEvaluation::start_sums(std::size_t first, std::size_t count, Pass& pass) const {
  std::size_t designs = 0;
  for (std::size_t i = first; i < first + count; ++i) {
    if (is_direct(i)) continue;
    if (designs++ == 0) pass.first_slot = slot_[i];
  }
  for (std::size_t b = 0; b < system_->basis_.size() && designs > 0; ++b) {
    const std::size_t width = system_->basis_[b].components.size();
    pass.sums.emplace_back(*system_->basis_[b].compressed, moving_fields_[b], coefficients_[b].data() + width * pass.first_slot,
                           width * basis_designs_, width * designs);
  }
}

}  // namespace deform

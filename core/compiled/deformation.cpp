// SPDX-License-Identifier: Apache-2.0
#include "core/compiled/deformation.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <exception>
#include <limits>
#include <thread>
#include <utility>

#include "core/base/bounds.h"
#include "core/base/error.h"
#include "core/base/number_text.h"
#include "core/base/reduction_error.h"
#include "core/base/vectors.h"
#include "core/compiled/field_sums.h"
#include "core/compiled/reader.h"

namespace deform::compiled {

namespace {

constexpr double agreement = 1e-10;          // of D: how far apart coincident points may be sent
constexpr std::size_t designs_per_pass = 4;  // more streams of results than that are slower to write than the bases to read again
constexpr std::size_t tiles_per_sum = 64;    // of a pull-back: the parts whose sums are added in order
constexpr std::size_t least_per_thread = 4096;  // points
constexpr std::size_t held_per_pass = 512;      // points
constexpr const char* only_slides =
    "; points on a symmetry plane only slide in it: take them out of the handle with `difference`";

[[noreturn]] void refuse(const std::string& message) { throw Error(ErrorCode::invalid_argument, message); }

void check_size(std::size_t size, std::size_t expected, const char* name, const char* of) {
  if (size == expected) return;
  refuse(std::string(name) + ": expected " + std::to_string(expected) + " numbers, " + of + ", got " + std::to_string(size));
}

/// work(begin, end, part) for `parts` parts of [0, count), each on a thread of its own but the first.
template <typename Work>
void in_parts(std::size_t count, int threads, std::size_t least, const Work& work) {
  std::size_t parts = threads > 0 ? static_cast<std::size_t>(threads) : std::max(1u, std::thread::hardware_concurrency());
  parts = std::max<std::size_t>(1, std::min(parts, count / std::max<std::size_t>(1, least)));
  const auto begin = [&](std::size_t part) { return count * part / parts; };
  std::vector<std::exception_ptr> errors(parts);
  const auto run = [&](std::size_t part) {
    try {
      work(begin(part), begin(part + 1));
    } catch (...) {
      errors[part] = std::current_exception();
    }
  };
  std::vector<std::jthread> others;
  for (std::size_t part = 1; part < parts; ++part) others.emplace_back(run, part);
  run(0);
  others.clear();
  for (const auto& error : errors) {
    if (error) std::rethrow_exception(error);
  }
}

/// The file has no offsets of planes, but says which points lie on them.
PlaneSides sides_of(const Content& content) {
  constexpr double tolerance = 1e-9;  // fraction of D, of the points of a plane
  std::vector<PlaneSides::Side> sides;
  for (std::uint32_t k = 0; k < content.planes; ++k) {
    const Vec3& normal = content.plane_axes[k];
    double least = std::numeric_limits<double>::infinity(), greatest = -least;
    for (std::size_t i = 0; i < content.points(); ++i) {
      if ((content.on_planes[i] >> k & 1u) == 0) continue;
      const double coordinate = dot(normal, content.rest[i]);
      least = std::min(least, coordinate);
      greatest = std::max(greatest, coordinate);
    }
    if (least <= greatest) sides.push_back({normal, -(least + greatest) / 2, content.reach[k] + tolerance * content.diagonal});
  }
  return PlaneSides(std::move(sides));
}

}  // namespace

/// Designs whose coefficients are there.
struct Deformation::Bound {
  std::vector<Maps> motions;  ///< per design
  double keep = 1;            ///< 1: positions; 0: rates
  /// Per basis: 4H x (its components, of each design), row by row.
  std::vector<std::vector<double>> coefficients;
  /// Per basis: the fields that have a coefficient other than 0 in any design, ascending.
  std::vector<std::vector<std::uint32_t>> moving;
};

Deformation::Deformation(Content content) : content_(std::move(content)) {
  const std::size_t n = content_.points();
  for (std::size_t i = 0; i < n; ++i) {
    const auto id = static_cast<std::uint32_t>(i);
    const std::uint32_t region = content_.regions[i];
    (content_.held && region != following_region ? held_ : following_).push_back(id);
    if (region < content_.handles.size() && content_.planes > 0 && content_.on_planes[i] != 0) sliding_.push_back(id);
  }
  drives_.resize(content_.handles.size());
  for (std::size_t k = 0; k < content_.variables.size(); ++k) {
    const Variable& variable = content_.variables[k];
    drives_[variable.handle].push_back({k, variable.motion});
    for (const Driven& driven : variable.also) drives_[driven.handle].push_back({k, driven.motion});
  }
  for (const Basis& basis : content_.bases) {
    std::vector<std::size_t>& components = components_.emplace_back();
    for (std::size_t k = 0; k < 3; ++k) {
      if ((basis.components >> k & 1u) != 0) components.push_back(k);
    }
    turned_.push_back(basis.components == turned_components);
  }
  sides_ = sides_of(content_);
  size_ = model_size(content_.rest);
}

Deformation Deformation::load(const std::filesystem::path& file) { return Deformation(read_content(file)); }

// ---- from variables to motions ----

/// Those beside a bound moved onto it.
std::vector<double> Deformation::checked_values(std::span<const double> variables, const std::string& what) const {
  const std::size_t count = this->variables();
  if (variables.size() != count) {
    refuse(what + "variables: expected " + std::to_string(count) + " values, one per design variable, got " +
           std::to_string(variables.size()));
  }
  std::vector<double> values;
  for (std::size_t k = 0; k < count; ++k) {
    const Variable& variable = content_.variables[k];
    const auto name = [&] { return what + "variables[" + std::to_string(k) + "] (\"" + variable.name + "\")"; };
    if (!std::isfinite(variables[k])) refuse(name() + ": must be finite");
    const auto value = within_bounds(variables[k], variable.lower, variable.upper);
    if (!value) {
      refuse(name() + ": " + number_digits(variables[k]) + " is outside of its bounds [" + number_digits(variable.lower) + ", " +
             number_digits(variable.upper) + "]");
    }
    const auto usable = [&](const VariableMotion& motion) {
      const std::string problem = unusable_value(motion, *value);
      if (!problem.empty()) refuse(name() + ": " + number_digits(*value) + " " + problem);
    };
    usable(variable.motion);
    for (const Driven& driven : variable.also) usable(driven.motion);
    values.push_back(*value);
  }
  return values;
}

Deformation::Maps Deformation::motions(std::span<const double> values) const {
  Maps motions(content_.handles.size(), identity_affine);
  for (std::size_t h = 0; h < motions.size(); ++h) {
    for (const Drive& drive : drives_[h]) motions[h] = compose(motion_at(drive.motion, values[drive.variable]), motions[h]);
  }
  return motions;
}

/// The derivative of the motion of a handle with respect to a variable that moves it.
Affine Deformation::handle_derivative(std::span<const double> values, std::size_t variable, std::uint32_t handle) const {
  Affine before = identity_affine, result{};
  for (const Drive& drive : drives_[handle]) {
    const double v = values[drive.variable];
    if (drive.variable < variable) before = compose(motion_at(drive.motion, v), before);
    if (drive.variable == variable) result = chained(motion_rate(drive.motion, v), before, 1);
    if (drive.variable > variable) result = chained(motion_at(drive.motion, v), result, 0);
  }
  return result;
}

Deformation::Maps Deformation::motion_derivative(std::span<const double> values, std::size_t variable) const {
  Maps derivatives(content_.handles.size(), Affine{});
  const Variable& moving = content_.variables[variable];
  derivatives[moving.handle] = handle_derivative(values, variable, moving.handle);
  for (const Driven& driven : moving.also) derivatives[driven.handle] = handle_derivative(values, variable, driven.handle);
  return derivatives;
}

// ---- points of handles and fixed regions ----

Vec3 Deformation::to_frame(const Vec3& vector) const {
  const auto& axes = content_.plane_axes;
  return {dot(axes[0], vector), dot(axes[1], vector), dot(axes[2], vector)};
}

Vec3 Deformation::from_frame(const Vec3& components) const {
  Vec3 vector{};
  for (std::size_t k = 0; k < 3; ++k) vector = vector + components[k] * content_.plane_axes[k];
  return vector;
}

/// `to` without what it is away from x along the normals of the planes that x lies on.
Vec3 Deformation::slid(const Vec3& x, const Vec3& to, unsigned mask) const {
  Vec3 result = to;
  for (std::size_t k = 0; k < content_.planes; ++k) {
    const Vec3& normal = content_.plane_axes[k];
    if ((mask >> k & 1u) != 0) result = result - dot(normal, result - x) * normal;
  }
  return result;
}

/// Where a point of a handle or fixed region goes (keep 1), or at what rate (keep 0).
Vec3 Deformation::place(const Maps& motions, std::uint32_t id, double keep) const {
  const Vec3& x = content_.rest[id];
  const Vec3 still = keep != 0 ? x : Vec3{};
  const std::uint32_t region = content_.regions[id];
  Vec3 to = still;
  // At rest exactly, not up to the rounding of 1 x + 0 y + 0 z + 0 with huge coordinates.
  if (region != fixed_region) to = motions[region] == identity_affine ? x : transformed(motions[region], x);
  const unsigned on = content_.planes == 0 ? 0u : content_.on_planes[id];
  return on == 0 ? to : slid(still, to, on);
}

void Deformation::check_design(const Maps& motions, const std::string& what) const {
  const auto name = [&](std::uint32_t id) {
    const std::uint32_t region = content_.regions[id];
    return std::to_string(id) + (region == fixed_region ? " (fixed)" : " (handle \"" + content_.handles[region].name + "\")");
  };
  for (std::size_t h = 0; h < motions.size(); ++h) {
    if (std::all_of(motions[h].begin(), motions[h].end(), [](double entry) { return std::isfinite(entry); })) continue;
    refuse(what + "variables: they move handle \"" + content_.handles[h].name + "\" farther than a number can say");
  }
  for (const Pair& pair : content_.coincident) {
    const double apart = distance(place(motions, pair.second, 1), place(motions, pair.first, 1));
    if (apart <= agreement * content_.diagonal) continue;
    refuse(what + "points " + name(pair.first) + " and " + name(pair.second) + " coincide but are sent to places a distance of " +
           number_digits(apart) + " apart");
  }
  for (const std::uint32_t id : sliding_) {
    const Vec3& x = content_.rest[id];
    const Affine& motion = motions[content_.regions[id]];
    const Vec3 u = to_frame((motion == identity_affine ? x : transformed(motion, x)) - x);
    for (std::size_t k = 0; k < content_.planes; ++k) {
      if ((content_.on_planes[id] >> k & 1u) == 0 || std::abs(u[k]) <= content_.reach[k]) continue;
      refuse(what + "point " + name(id) + " lies on symmetry[" + std::to_string(k) + "] but is sent a distance of " +
             number_digits(u[k]) + " out of it" + only_slides);
    }
  }
}

void Deformation::check_sliding(const Maps& derivative, const std::string& what) const {
  for (const std::uint32_t id : sliding_) {
    const Affine& m = derivative[content_.regions[id]];
    if (m == Affine{}) continue;
    const Vec3& x = content_.rest[id];
    double size = 0;  // of the terms of the rate
    for (std::size_t i = 0; i < 12; ++i) size = std::max(size, std::abs(m[i] * (i % 4 == 3 ? 1.0 : x[i % 4])));
    const Vec3 across = to_frame(transformed(m, x));
    for (std::size_t k = 0; k < content_.planes; ++k) {
      const bool on = (content_.on_planes[id] >> k & 1u) != 0;
      if (!on || std::abs(across[k]) * content_.diagonal <= content_.reach[k] * size) continue;
      refuse(what + ": moves point " + std::to_string(id) + " out of symmetry[" + std::to_string(k) + "] at a rate of " +
             number_digits(across[k]) + only_slides);
    }
  }
}

// ---- from motions to points ----

FieldFrame Deformation::frame(std::size_t handle) const {
  return {content_.origin, content_.scale, content_.handles[handle].reference, content_.handles[handle].axes};
}

Deformation::Bound Deformation::bound(std::vector<Maps> motions, double keep) const {
  Bound result{std::move(motions), keep, {}, {}};
  const std::size_t designs = result.motions.size(), handles = content_.handles.size();
  for (const auto& components : components_) result.coefficients.emplace_back(4 * handles * designs * components.size());
  double block[12];
  for (std::size_t i = 0; i < designs; ++i) {
    for (std::size_t h = 0; h < handles; ++h) {
      field_coefficients(result.motions[i][h], keep, frame(h), block);
      for (std::size_t f = 0; f < 4; ++f) {
        Vec3 row{block[3 * f], block[3 * f + 1], block[3 * f + 2]};
        if (content_.framed()) row = to_frame(row);
        for (std::size_t b = 0; b < components_.size(); ++b) {
          const Vec3 taken = turned_[b] ? Vec3{0, -row[2], row[1]} : row;
          double* out = result.coefficients[b].data() + ((4 * h + f) * designs + i) * components_[b].size();
          for (const std::size_t k : components_[b]) *out++ = taken[k];
        }
      }
    }
  }
  for (const std::vector<double>& coefficients : result.coefficients) {
    std::vector<std::uint32_t>& moving = result.moving.emplace_back();
    const std::size_t width = coefficients.size() / content_.fields();
    for (std::size_t f = 0; f < content_.fields(); ++f) {
      const auto row = coefficients.begin() + static_cast<std::ptrdiff_t>(f * width);
      if (std::any_of(row, row + static_cast<std::ptrdiff_t>(width), [](double c) { return c != 0; })) {
        moving.push_back(static_cast<std::uint32_t>(f));
      }
    }
  }
  return result;
}

/// Positions [begin, end) among the held points.
template <typename T>
void Deformation::fill_held(const Bound& bound, std::size_t begin, std::size_t end, T* out) const {
  const std::size_t stride = 3 * points();
  for (std::size_t low = begin; low < end; low += held_per_pass) {
    const std::size_t high = std::min(end, low + held_per_pass);
    for (std::size_t k = 0; k < bound.motions.size(); ++k) {
      T* const design = out + k * stride;
      for (std::size_t s = low; s < high; ++s) {
        const Vec3 to = place(bound.motions[k], held_[s], bound.keep);
        for (std::size_t c = 0; c < 3; ++c) design[std::size_t{3} * held_[s] + c] = static_cast<T>(to[c]);
      }
    }
  }
}

/// What one range of tiles works with.
struct Deformation::Pass {
  std::vector<double> values;               ///< of a tile: [design][component][16]
  std::vector<double> part;                 ///< the same of one basis
  std::array<double, 3 * tile_points> x{};  ///< places at rest, as the tile has its values
};

/// Tiles [begin, end) of the points that follow.
template <typename T>
void Deformation::fill_following(const Bound& bound, std::size_t begin, std::size_t end, T* out) const {
  const std::size_t designs = bound.motions.size(), fields = content_.fields(), stride = 3 * points();
  Pass pass;
  pass.values.resize(3 * designs * tile_points);
  if (components_.size() > 1) pass.part.resize(3 * designs * tile_points);
  const auto sums = [&](std::size_t b, std::size_t t, double* to) {
    const std::size_t columns = components_[b].size() * designs;
    field_sums(content_.bases[b].values.data() + t * fields * tile_points, bound.moving[b], bound.coefficients[b].data(), columns,
               columns, to);
  };
  for (std::size_t t = begin; t < end; ++t) {
    const std::size_t low = t * tile_points, count = std::min(tile_points, following_.size() - low);
    const std::uint32_t* const ids = following_.data() + low;
    for (std::size_t i = 0; i < count; ++i) {
      for (std::size_t c = 0; c < 3; ++c) pass.x[3 * i + c] = bound.keep * content_.rest[ids[i]][c];
    }
    if (components_.size() == 1) {
      sums(0, t, pass.values.data());
    } else {
      std::fill(pass.values.begin(), pass.values.end(), 0.0);
      for (std::size_t b = 0; b < components_.size(); ++b) {
        sums(b, t, pass.part.data());
        const std::size_t width = components_[b].size();
        for (std::size_t k = 0; k < designs; ++k) {
          for (std::size_t c = 0; c < width; ++c) {
            const double* const from = pass.part.data() + (k * width + c) * tile_points;
            double* const to = pass.values.data() + (3 * k + components_[b][c]) * tile_points;
            for (std::size_t i = 0; i < tile_points; ++i) to[i] += from[i];
          }
        }
      }
    }
    for (std::size_t k = 0; k < designs; ++k) {
      const double* const u = pass.values.data() + 3 * k * tile_points;
      T* const design = out + k * stride;
      if (!content_.framed()) {
        for (std::size_t i = 0; i < count; ++i) {
          T* const to = design + std::size_t{3} * ids[i];
          for (std::size_t c = 0; c < 3; ++c) to[c] = static_cast<T>(pass.x[3 * i + c] + u[c * tile_points + i]);
        }
        continue;
      }
      for (std::size_t i = 0; i < count; ++i) {
        Vec3 components{u[i], u[tile_points + i], u[2 * tile_points + i]};
        for (std::size_t c = 0; c < content_.planes; ++c) {
          if ((content_.on_planes[ids[i]] >> c & 1u) != 0) components[c] = 0;
        }
        const Vec3 moved = from_frame(components);
        T* const to = design + std::size_t{3} * ids[i];
        for (std::size_t c = 0; c < 3; ++c) to[c] = static_cast<T>(pass.x[3 * i + c] + moved[c]);
      }
    }
  }
}

template <typename T>
void Deformation::fill(const Bound& bound, T* out, int threads) const {
  const std::size_t tiles = (following_.size() + tile_points - 1) / tile_points;
  in_parts(tiles, threads, least_per_thread / tile_points, [&](std::size_t begin, std::size_t end) {
    // The held points go along in the same shares.
    fill_held(bound, held_.size() * begin / std::max<std::size_t>(1, tiles), held_.size() * end / std::max<std::size_t>(1, tiles),
              out);
    fill_following(bound, begin, end, out);
  });
  if (tiles == 0) fill_held(bound, 0, held_.size(), out);
}

namespace {

/// Calls work(first, count) for designs in passes.
template <typename Work>
void in_passes(std::size_t designs, const Work& work) {
  for (std::size_t first = 0; first < designs; first += designs_per_pass) {
    work(first, std::min(designs_per_pass, designs - first));
  }
}

}  // namespace

template <typename T>
void Deformation::evaluate_designs(std::span<const double> designs, std::span<T> points, int threads) const {
  const std::size_t k = variables();
  if (k == 0 || designs.size() % k != 0) {
    refuse("designs: " + std::to_string(designs.size()) + " numbers are no whole number of designs of " + std::to_string(k) +
           " variables");
  }
  const std::size_t count = designs.size() / k, stride = 3 * this->points();
  check_size(points.size(), count * stride, "points", "x, y, z of every point of every design");
  in_passes(count, [&](std::size_t first, std::size_t pass) {
    std::vector<Maps> motions;
    for (std::size_t i = first; i < first + pass; ++i) {
      const std::string what = "designs[" + std::to_string(i) + "].";
      motions.push_back(this->motions(checked_values(designs.subspan(i * k, k), what)));
      check_design(motions.back(), "designs[" + std::to_string(i) + "]: ");
    }
    fill(bound(std::move(motions), 1), points.data() + first * stride, threads);
  });
}

void Deformation::evaluate(std::span<const double> designs, std::span<double> points, int threads) const {
  evaluate_designs(designs, points, threads);
}

void Deformation::evaluate(std::span<const double> designs, std::span<float> points, int threads) const {
  evaluate_designs(designs, points, threads);
}

// ---- derivatives ----

template <typename T>
void Deformation::derive(std::span<const double> variables, std::span<const double> direction, std::span<T> vectors,
                         int threads) const {
  const std::vector<double> values = checked_values(variables, "");
  check_size(direction.size(), values.size(), "direction", "one per design variable");
  check_size(vectors.size(), 3 * points(), "vectors", "x, y, z of every point");
  Maps derivative(content_.handles.size(), Affine{});
  for (std::size_t k = 0; k < values.size(); ++k) {
    if (!std::isfinite(direction[k])) refuse("direction[" + std::to_string(k) + "]: must be finite");
    const Maps rate = motion_derivative(values, k);
    for (std::size_t h = 0; h < derivative.size(); ++h) {
      for (std::size_t j = 0; j < 12; ++j) derivative[h][j] += direction[k] * rate[h][j];
    }
  }
  check_sliding(derivative, "direction");
  fill(bound({std::move(derivative)}, 0), vectors.data(), threads);
}

void Deformation::jacobian_vector(std::span<const double> variables, std::span<const double> direction, std::span<double> vectors,
                                  int threads) const {
  derive(variables, direction, vectors, threads);
}

void Deformation::jacobian_vector(std::span<const double> variables, std::span<const double> direction, std::span<float> vectors,
                                  int threads) const {
  derive(variables, direction, vectors, threads);
}

/// The transposed product of the bases with a cotangent field: 4H x 3, row by row, model coordinates. Sums over 64 tiles are
/// taken point by point of a tile, their 16 parts are added in order, and these sums are added in the order of the points.
template <typename T>
std::vector<double> Deformation::field_moments(std::span<const T> cotangent, int threads) const {
  const std::size_t fields = content_.fields(), tiles = (following_.size() + tile_points - 1) / tile_points;
  const std::size_t sums = (tiles + tiles_per_sum - 1) / tiles_per_sum, bases = components_.size();
  std::vector<double> partial(sums * bases * fields * 3);
  in_parts(sums, threads, 1, [&](std::size_t begin, std::size_t end) {
    std::vector<double> products(bases * fields * 3 * tile_points);
    double columns[3 * tile_points];
    for (std::size_t s = begin; s < end; ++s) {
      std::fill(products.begin(), products.end(), 0.0);
      for (std::size_t t = s * tiles_per_sum; t < std::min(tiles, (s + 1) * tiles_per_sum); ++t) {
        for (std::size_t i = 0; i < tile_points; ++i) {
          Vec3 w{};
          if (t * tile_points + i < following_.size()) {
            const std::uint32_t id = following_[t * tile_points + i];
            for (std::size_t c = 0; c < 3; ++c) w[c] = static_cast<double>(cotangent[std::size_t{3} * id + c]);
            if (content_.framed()) w = to_frame(w);
            for (std::size_t c = 0; c < content_.planes; ++c) {
              if ((content_.on_planes[id] >> c & 1u) != 0) w[c] = 0;
            }
          }
          for (std::size_t c = 0; c < 3; ++c) columns[c * tile_points + i] = w[c];
        }
        for (std::size_t b = 0; b < bases; ++b) {
          add_products(content_.bases[b].values.data() + t * fields * tile_points, fields, columns,
                       products.data() + b * fields * 3 * tile_points);
        }
      }
      double* const to = partial.data() + s * bases * fields * 3;
      for (std::size_t j = 0; j < bases * fields * 3; ++j) {
        double sum = 0;
        for (std::size_t i = 0; i < tile_points; ++i) sum += products[j * tile_points + i];
        to[j] = sum;
      }
    }
  });
  std::vector<double> result(fields * 3, 0.0);
  for (std::size_t s = 0; s < sums; ++s) {
    for (std::size_t b = 0; b < bases; ++b) {
      const double* const from = partial.data() + (s * bases + b) * fields * 3;
      for (std::size_t f = 0; f < fields; ++f) {
        const Vec3 sum{from[3 * f], from[3 * f + 1], from[3 * f + 2]};
        const Vec3 back = turned_[b] ? Vec3{0, sum[2], -sum[1]} : sum;
        for (const std::size_t k : components_[b]) result[3 * f + k] += back[k];
      }
    }
  }
  for (std::size_t f = 0; f < fields && content_.framed(); ++f) {
    const Vec3 back = from_frame({result[3 * f], result[3 * f + 1], result[3 * f + 2]});
    std::copy(back.begin(), back.end(), result.begin() + static_cast<std::ptrdiff_t>(3 * f));
  }
  return result;
}

template <typename T>
void Deformation::pull_back(std::span<const double> variables, std::span<const T> cotangent, std::span<double> gradient,
                            int threads) const {
  const std::vector<double> values = checked_values(variables, "");
  check_size(cotangent.size(), 3 * points(), "cotangent", "x, y, z of every point");
  check_size(gradient.size(), values.size(), "gradient", "one per design variable");
  for (std::size_t i = 0; i < cotangent.size(); ++i) {
    if (!std::isfinite(cotangent[i])) refuse("cotangent[" + std::to_string(i / 3) + "]: must be finite");
  }
  const std::size_t handles = content_.handles.size();
  const std::vector<double> fields = field_moments(cotangent, threads);
  // Moments of the cotangent over the handle points: what an affine derivative there is multiplied with.
  Maps moments(handles, Affine{});
  for (const std::uint32_t id : held_) {
    const std::uint32_t region = content_.regions[id];
    if (region == fixed_region) continue;
    Vec3 along;
    for (std::size_t c = 0; c < 3; ++c) along[c] = static_cast<double>(cotangent[std::size_t{3} * id + c]);
    const unsigned on = content_.planes == 0 ? 0u : content_.on_planes[id];
    if (on != 0) along = slid({}, along, on);
    const Vec3& x = content_.rest[id];
    for (std::size_t i = 0; i < 3; ++i) {
      for (std::size_t j = 0; j < 3; ++j) moments[region][4 * i + j] += along[i] * x[j];
      moments[region][4 * i + 3] += along[i];
    }
  }
  double block[12];
  for (std::size_t k = 0; k < values.size(); ++k) {
    const Maps derivative = motion_derivative(values, k);
    check_sliding(derivative, "variable \"" + content_.variables[k].name + "\"");
    double sum = 0;
    for (std::size_t h = 0; h < handles; ++h) {
      if (derivative[h] == Affine{}) continue;
      field_coefficients(derivative[h], 0, frame(h), block);
      for (std::size_t j = 0; j < 12; ++j) {
        sum += block[j] * fields[std::size_t{12} * h + j] + derivative[h][j] * moments[h][j];
      }
    }
    gradient[k] = sum;
  }
}

void Deformation::vector_jacobian(std::span<const double> variables, std::span<const double> cotangent,
                                  std::span<double> gradient, int threads) const {
  pull_back(variables, cotangent, gradient, threads);
}

void Deformation::vector_jacobian(std::span<const double> variables, std::span<const float> cotangent, std::span<double> gradient,
                                  int threads) const {
  pull_back(variables, cotangent, gradient, threads);
}

// ---- what is known of a design ----

double Deformation::largest_displacement(const Maps& motions) const {
  double largest = 0;
  for (std::size_t i = 0; i < points(); ++i) {
    const std::uint32_t region = content_.regions[i];
    if (region >= motions.size() || motions[region] == identity_affine) continue;
    largest = std::max(largest, distance(place(motions, static_cast<std::uint32_t>(i), 1), content_.rest[i]));
  }
  for (const Control& control : content_.controls) {
    const Affine& motion = motions[control.handle];
    if (motion != identity_affine) largest = std::max(largest, distance(transformed(motion, control.place), control.place));
  }
  return largest;
}

double Deformation::largest_misfit(std::span<const double> variables, std::span<const double> deformed) const {
  const Maps maps = motions(checked_values(variables, ""));
  if (deformed.size() != 3 * points()) {
    throw Error(ErrorCode::invalid_argument, "points: has " + std::to_string(deformed.size()) + " numbers, must have " +
                                                 std::to_string(3 * points()) + ", three of each point");
  }
  double largest = 0;
  for (std::size_t i = 0; i < points(); ++i) {
    const std::uint32_t region = content_.regions[i];
    if (region == following_region) continue;
    const Vec3 to = region < maps.size() ? place(maps, static_cast<std::uint32_t>(i), 1) : content_.rest[i];
    largest = std::max(largest, distance({deformed[3 * i], deformed[3 * i + 1], deformed[3 * i + 2]}, to));
  }
  return largest;
}

std::vector<std::string> Deformation::doubts(const Maps& maps, std::span<const double> values) const {
  std::vector<std::string> found;
  for (std::size_t h = 0; h < maps.size(); ++h) {
    if (shape_under(maps[h]) == Shape::kept) continue;
    std::vector<Scale> scales;
    for (const Drive& drive : drives_[h]) {
      const double value = values[drive.variable];
      if (drive.motion.kind == MotionKind::scaling && value != 0) {
        scales.push_back({content_.variables[drive.variable].name, value});
      }
    }
    found.push_back(shape_doubt(content_.handles[h].name, maps[h], scales));
  }
  return first_doubts(std::move(found));
}

Report Deformation::report(std::span<const double> variables) const {
  const std::vector<double> values = checked_values(variables, "");
  const Maps maps = motions(values);
  check_design(maps, "");
  Report report;
  report.doubts = doubts(maps, values);
  if (!size_.stray.empty()) report.doubts.push_back(size_.stray);
  if (std::string reduced = reduction_doubt(content_.reduction_error); !reduced.empty())
    report.doubts.push_back(std::move(reduced));
  report.prescribed_displacement = largest_displacement(maps);
  const Bound design = bound({maps}, 1);
  const std::size_t fields = content_.fields();
  Vec3 residual{}, more{}, compression{};
  for (std::size_t b = 0; b < components_.size(); ++b) {
    const Basis& basis = content_.bases[b];
    for (std::size_t f = 0; f < fields; ++f) {
      const double* row = design.coefficients[b].data() + f * components_[b].size();
      for (const std::size_t k : components_[b]) {
        const double size = std::abs(*row++);
        residual[k] += basis.residuals[f] * size;
        more[k] += basis.more[f] * size;
        compression[k] += basis.compression[f] * size;
      }
    }
  }
  double largest = 0;
  const std::size_t places = content_.bases[0].errors.size() / fields;
  for (std::size_t s = 0; s < places && std::isfinite(largest); ++s) {
    Vec3 error{};
    for (std::size_t b = 0; b < components_.size(); ++b) {
      for (std::size_t f = 0; f < fields; ++f) {
        const double* row = design.coefficients[b].data() + f * components_[b].size();
        for (const std::size_t k : components_[b]) error[k] += content_.bases[b].errors[s * fields + f] * *row++;
      }
    }
    const double length = norm(error);
    largest = std::isfinite(length) ? std::max(largest, length) : std::numeric_limits<double>::infinity();
  }
  report.interpolation_residual = content_.misfits ? largest : norm(residual);
  const double checked = content_.misfits ? (content_.held ? largest : 0) : content_.error_margin * largest;
  const double basis_error = checked + norm(more);
  double rounded = 0;
  for (const Affine& map : maps) {
    if (map != identity_affine) rounded = std::max(rounded, largest_terms(map, content_.largest_coordinate));
  }
  const double rounding = std::numeric_limits<double>::epsilon() * (content_.largest_coordinate + rounded);
  report.error = basis_error + norm(compression) + rounding;
  report.converged = content_.converged;
  if (content_.allowed_error > 0) {
    const double allowed = content_.allowed_error * std::max(content_.diagonal, report.prescribed_displacement);
    report.converged = report.error - norm(compression) <= allowed;
  }
  return report;
}

}  // namespace deform::compiled

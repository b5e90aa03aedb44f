// SPDX-License-Identifier: Apache-2.0
#include "core/quality/motion_certificate.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "core/base/parallel.h"
#include "core/base/vectors.h"
#include "core/quality/four_floats.h"
#include "core/quality/infinity.h"
#include "core/quality/linear_fit.h"

namespace deform::quality {

namespace {

// Those of FourFloats hide those of Vec3.
using deform::operator+;
using deform::operator-;
using deform::operator*;
using quality::operator+;
using quality::operator-;
using quality::operator*;

constexpr std::size_t tolerances_per_range = 4096;
constexpr double half_float_ulp = 0x1p-24;
constexpr double determinant_rounding = 1e-9;  // far more than exact states have
constexpr std::size_t most_local = 0xffff;     // nodes in a block

/// The least-squares linear map from places to displacements, both relative to their means. Any map would be valid; this one
/// leaves small residuals.
class LinearFit {
 public:
  void add(const Vec3& x, const Vec3& d) {
    places_ = places_ + x;
    displacements_ = displacements_ + d;
    add_product(spread_, x, x);
    add_product(product_, d, x);
    ++count_;
  }
  Matrix gradient() const {
    const double share = 1 / static_cast<double>(count_);
    Matrix spread = spread_, product = product_;
    add_product(spread, -share * places_, places_);
    add_product(product, -share * displacements_, places_);
    const Matrix inverse = inverse_of_symmetric(spread);
    Matrix result;
    for (std::size_t i = 0; i < 3; ++i) result[i] = times(inverse, product[i]);
    return result;
  }

 private:
  std::size_t count_ = 0;
  Vec3 places_{}, displacements_{};
  Matrix spread_{}, product_{};
};

/// The symmetric part of a matrix: its eigenvalues are mean + 2 size cos((angle + 2 pi k) / 3) with cos(angle) = half, and its
/// size and half are those of the part without trace.
struct SymmetricPart {
  double mean = 0, size = 0, half = 0;
  double square = 0;  ///< of the Frobenius norm of the matrix itself

  explicit SymmetricPart(const Matrix& a) {
    mean = (a[0][0] + a[1][1] + a[2][2]) / 3;
    Matrix b;
    double deviator = 0;
    for (std::size_t i = 0; i < 3; ++i) {
      for (std::size_t k = 0; k < 3; ++k) b[i][k] = 0.5 * (a[i][k] + a[k][i]);
      b[i][i] -= mean;
      deviator += dot(b[i], b[i]);
      square += dot(a[i], a[i]);
    }
    size = std::sqrt(deviator / 6);
    if (size > 0) half = std::clamp(dot(b[0], cross(b[1], b[2])) / (2 * size * size * size), -1.0, 1.0);
  }
  double off() const { return 1e-6 * size + 1e-12 * std::abs(mean); }  ///< what the rounding of eigenvalues may be
};

/// An upper bound of cos(acos(half) / 3), which is concave (it is the inverse of 4 u^3 - 3 u, convex for u >= 1/2): tangents.
double largest_cosine(double half) { return std::min({1.0, 0.8660255 + half * 0.1666667, 0.6241 + (half + 0.9) * 0.59753}); }

/// Every third bit.
std::uint64_t spread_bits(std::uint64_t x) {
  x &= 0x1fffff;
  x = (x | x << 32) & 0x1f00000000ffff;
  x = (x | x << 16) & 0x1f0000ff0000ff;
  x = (x | x << 8) & 0x100f00f00f00f00f;
  x = (x | x << 4) & 0x10c30c30c30c30c3;
  return (x | x << 2) & 0x1249249249249249;
}

/// Half the diagonal of a box, with the rounding of its computation.
double half_diagonal(const FourFloats& low, const FourFloats& high) {
  double square = 0;
  for (std::size_t i = 0; i < 3; ++i) {
    const double side = static_cast<double>(high[i]) - static_cast<double>(low[i]);
    square += side * side;
  }
  return 0.5 * std::sqrt(square) * (1 + 1e-6);
}

/// Half the diagonal of the box around some of the places: all of them are within that distance of its centre.
double half_diagonal(const std::vector<FourFloats>& places, std::span<const std::uint16_t> nodes) {
  FourFloats low = places[nodes[0]], high = low;
  for (std::size_t k = 1; k < nodes.size(); ++k) {
    low = least(low, places[nodes[k]]);
    high = greatest(high, places[nodes[k]]);
  }
  return half_diagonal(low, high);
}

/// The result of LinearFit in floats.
struct LinearPart {
  std::array<FourFloats, 3> columns;
  double size = 0;  ///< Frobenius norm
};

LinearPart linear_part(const std::vector<FourFloats>& at_rest, const std::vector<FourFloats>& moved,
                       std::span<const std::uint16_t> nodes) {
  const FourFloats start = at_rest[nodes[0]], moved_start = moved[nodes[0]];
  std::array<FourFloats, 3> spread{}, product{};  // sums of x x^T and d x^T by columns
  FourFloats places{}, displacements{};
  for (std::size_t k = 1; k < nodes.size(); ++k) {
    const FourFloats x = at_rest[nodes[k]] - start, d = moved[nodes[k]] - moved_start;
    places = places + x;
    displacements = displacements + d;
    for (std::size_t i = 0; i < 3; ++i) {
      spread[i] = spread[i] + x[i] * x;
      product[i] = product[i] + x[i] * d;
    }
  }
  const float share = 1 / static_cast<float>(nodes.size());
  Matrix symmetric;
  for (std::size_t i = 0; i < 3; ++i) {
    const FourFloats column = spread[i] - (share * places[i]) * places;
    product[i] = product[i] - (share * places[i]) * displacements;
    symmetric[i] = {column[0], column[1], column[2]};
  }
  const Matrix inverse = inverse_of_symmetric(symmetric);
  LinearPart result;
  double square = 0;
  for (std::size_t i = 0; i < 3; ++i) {
    for (std::size_t k = 0; k < 3; ++k) {
      result.columns[i] = result.columns[i] + static_cast<float>(inverse[i][k]) * product[k];
    }
    for (std::size_t k = 0; k < 3; ++k)
      square += static_cast<double>(result.columns[i][k]) * static_cast<double>(result.columns[i][k]);
  }
  result.size = std::sqrt(square) * (1 + 1e-6);
  return result;
}

FourFloats times(const std::array<FourFloats, 3>& columns, const FourFloats& x) {
  return x[0] * columns[0] + x[1] * columns[1] + x[2] * columns[2];
}

}  // namespace

/// The working data of a block; one per thread.
struct MotionCertificate::Block {
  std::vector<FourFloats> at_rest;  ///< from the first node
  std::vector<FourFloats> left;     ///< of the displacements, without their affine part
  Stretch stretch;                  ///< residual: what rounding takes from `left` in any direction
  Affinity affinity{};
  double reach = 0;  ///< largest coordinate of at_rest
};

MotionCertificate::MotionCertificate(std::span<const Vec3> rest, const MovingCells& cells, std::span<const char> left_out,
                                     std::span<const double> determinants, const RunContext& context)
    : rest_(rest), nodes_(cells.nodes()), distortion_(cells.distortion()), tolerances_(cells.size(), kept({})) {
  parallel_for(context, tolerances_.size(), tolerances_per_range, [&](std::size_t begin, std::size_t end) {
    for (std::size_t c = begin; c < end; ++c) {
      if (left_out[c]) continue;
      const CellTolerance found = cells.motion_tolerance(rest_, c, determinants[c]);
      tolerances_[c] = kept(found);
    }
  });
  order_cells(left_out, context);
  list_blocks();
}

MotionCertificate::Tolerance MotionCertificate::kept(const CellTolerance& found) {
  constexpr float none = std::numeric_limits<float>::infinity();
  const bool any = found.radius > 0 && found.condition > 1 && found.determinant > 0;
  if (!any) return {none, none, 0, none, none};
  return {rounded_up(1 / found.radius), rounded_up(1 / (found.condition - 1)), rounded_down(found.determinant),
          rounded_up(found.loss), rounded_up(found.warp_loss)};
}

/// Along a curve through space (Morton), so that a block is small.
void MotionCertificate::order_cells(std::span<const char> left_out, const RunContext& context) {
  const Box box = bounding_box(rest_);
  const double side = std::max({box.side(0), box.side(1), box.side(2)});
  std::vector<std::pair<std::uint64_t, std::uint32_t>> keys(tolerances_.size());
  parallel_for(context, keys.size(), tolerances_per_range, [&](std::size_t begin, std::size_t end) {
    for (std::size_t c = begin; c < end; ++c) {
      std::uint64_t key = 0;
      for (std::size_t k = 0; !left_out[c] && k < 3; ++k) {
        double mean = 0;
        for (const PointId p : nodes_.of(c)) mean += (rest_[p][k] - box.min[k]) / static_cast<double>(nodes_.count(c));
        const double share = std::clamp(mean / side, 0.0, 1.0);
        key |= spread_bits(share > 0 ? static_cast<std::uint64_t>(share * 0x1fffff) : 0) << k;
      }
      keys[c] = {key, static_cast<std::uint32_t>(c)};
    }
  });
  std::erase_if(keys, [&](const auto& key) { return left_out[key.second] != 0; });
  std::sort(keys.begin(), keys.end());
  order_.reserve(keys.size());
  for (const auto& [key, cell] : keys) order_.push_back(cell);
}

void MotionCertificate::list_blocks() {
  std::vector<std::uint32_t> number(rest_.size());  // within the block, for those that `in_block` has
  std::vector<std::uint32_t> in_block(rest_.size(), std::numeric_limits<std::uint32_t>::max());
  in_order_.reserve(order_.size());
  cell_ends_.reserve(order_.size());
  for (std::size_t block = 0; block < block_count(); ++block) {
    const std::size_t begin = block * block_size, end = std::min(order_.size(), begin + block_size);
    std::uint32_t count = 0;
    for (std::size_t i = begin; i < end; ++i) {
      const auto nodes = nodes_.of(order_[i]);
      in_order_.push_back(tolerances_[order_[i]]);
      if (count + nodes.size() > most_local) {
        in_order_.back() = kept({});  // decided on its own
      } else {
        for (const PointId p : nodes) {
          if (in_block[p] != block) {
            in_block[p] = static_cast<std::uint32_t>(block);
            number[p] = count++;
            block_nodes_.push_back(p);
            const Vec3 place = rest_[p] - rest_[block_nodes_[block_nodes_begin_.back()]];
            for (const double x : place) block_places_.push_back(static_cast<float>(x));
          }
          local_.push_back(static_cast<std::uint16_t>(number[p]));
        }
      }
      cell_ends_.push_back(static_cast<std::uint32_t>(local_.size() - local_begin_.back()));
    }
    block_nodes_begin_.push_back(block_nodes_.size());
    local_begin_.push_back(local_.size());
  }
  block_nodes_.shrink_to_fit();
  block_places_.push_back(0);  // four are read at once
  block_places_.shrink_to_fit();
  local_.shrink_to_fit();
}

/// Single precision for what is small.
void MotionCertificate::take(std::span<const Vec3> points, std::size_t block, Block& work) const {
  const auto first = static_cast<std::size_t>(block_nodes_begin_[block]);
  const std::size_t count = static_cast<std::size_t>(block_nodes_begin_[block + 1]) - first;
  if (count == 0) return;
  if (work.left.size() < count) {
    work.left.resize(count);
    work.at_rest.resize(count);
  }
  const PointId* nodes = block_nodes_.data() + first;
  const float* places = block_places_.data() + 3 * first;
  const Vec3 end = points[nodes[0]];
  FourFloats reach, displacement;
  constexpr std::size_t ahead =
      32;  // waiting for points that lie anywhere took more than half of the time; also of the next block
  const std::size_t following = block_nodes_.size() - first;
  for (std::size_t k = 0; k < count; ++k) {
    if (k + ahead < following) __builtin_prefetch(&points[nodes[k + ahead]]);
    const FourFloats x = FourFloats::load(places + 3 * k);
    const Vec3& y = points[nodes[k]];
    const auto moved = [&](std::size_t i) { return static_cast<float>((y[i] - end[i]) - static_cast<double>(x[i])); };
    const FourFloats d(moved(0), moved(1), moved(2));
    work.at_rest[k] = x;
    work.left[k] = d;
    reach = greatest(reach, magnitude(x));
    displacement = greatest(displacement, magnitude(d));
  }
  constexpr std::size_t samples = 24;
  LinearFit fit;
  for (std::size_t k = 0; k < count; k += std::max<std::size_t>(1, count / samples)) {
    const FourFloats &x = work.at_rest[k], &d = work.left[k];
    fit.add({x[0], x[1], x[2]}, {d[0], d[1], d[2]});
  }
  Matrix gradient = fit.gradient();
  std::array<FourFloats, 3> columns{};
  for (std::size_t k = 0; k < 3; ++k) {
    columns[k] = {static_cast<float>(gradient[0][k]), static_cast<float>(gradient[1][k]), static_cast<float>(gradient[2][k])};
    for (std::size_t i = 0; i < 3; ++i) gradient[i][k] = columns[k][i];
  }
  for (std::size_t k = 0; k < count; ++k) work.left[k] = work.left[k] - times(columns, work.at_rest[k]);
  work.reach = reach.largest();
  work.stretch = Stretch::of(gradient, 0);
  // A dozen roundings of numbers up to these; below the least float, of fewer digits.
  work.stretch.residual = 16 * half_float_ulp * (displacement.largest() + (1 + 2 * work.stretch.gradient) * work.reach) +
                          std::numeric_limits<float>::min();
  work.affinity = affinity(work.stretch);
}

bool MotionCertificate::proven(const Tolerance& tolerance, std::span<const std::uint16_t> nodes, double floor,
                               const Block& block) const {
  if (!(tolerance.inverse_radius < std::numeric_limits<float>::infinity())) return false;
  const double rounding = 2 * block.stretch.residual;
  const Bound alike = bound(tolerance, block.affinity, half_diagonal(block.left, nodes) + rounding);
  if (alike.sound && alike.determinant > floor) return true;
  // Without the linear part that this cell has beside that of its block.
  const LinearPart own = linear_part(block.at_rest, block.left, nodes);
  const FourFloats start = block.at_rest[nodes[0]];
  FourFloats low = block.left[nodes[0]], high = low;
  for (std::size_t k = 1; k < nodes.size(); ++k) {
    const FourFloats q = block.left[nodes[k]] - times(own.columns, block.at_rest[nodes[k]] - start);
    low = least(low, q);
    high = greatest(high, q);
  }
  Stretch stretch = block.stretch;
  stretch.least -= own.size;
  stretch.largest += own.size;
  stretch.gradient += own.size;
  const double more = 32 * half_float_ulp * own.size * block.reach;
  const Bound found = bound(tolerance, affinity(stretch), half_diagonal(low, high) + rounding + 2 * more);
  return found.sound && found.determinant > floor;
}

void MotionCertificate::doubtful(std::span<const Vec3> points, double floor, std::size_t begin_block, std::size_t end_block,
                                 std::vector<std::uint32_t>& cells) const {
  Block work;
  for (std::size_t block = begin_block; block < end_block; ++block) {
    take(points, block, work);
    const std::uint16_t* local = local_.data() + local_begin_[block];
    std::uint32_t from = 0;
    for (std::size_t i = block * block_size; i < std::min(order_.size(), (block + 1) * block_size); ++i) {
      const std::uint32_t to = cell_ends_[i];
      if (!proven(in_order_[i], std::span(local + from, to - from), floor, work)) cells.push_back(order_[i]);
      from = to;
    }
  }
}

MotionCertificate::Stretch MotionCertificate::Stretch::of(const Matrix& gradient, double residual) {
  const SymmetricPart part(gradient);
  const double angle = std::acos(part.half) / 3, twice = 2 * part.size;
  return {part.mean + twice * std::cos(angle + 2 * M_PI / 3) - part.off(), part.mean + twice * std::cos(angle) + part.off(),
          std::sqrt(part.square) * (1 + 1e-12), residual};
}

MotionCertificate::Stretch MotionCertificate::Stretch::about(const Matrix& gradient, double deviation) {
  const SymmetricPart part(gradient);
  const double wider = deviation + part.off(), twice = 2 * part.size;
  return {part.mean - twice * largest_cosine(-part.half) - wider, part.mean + twice * largest_cosine(part.half) + wider,
          std::sqrt(part.square) * (1 + 1e-12) + deviation, 0};
}

MotionCertificate::Stretch MotionCertificate::Stretch::between(const Stretch& from, const Stretch& to, double share) {
  const auto mean = [&](double a, double b) { return (1 - share) * a + share * b; };
  return {mean(from.least, to.least), mean(from.largest, to.largest), mean(from.gradient, to.gradient),
          mean(from.residual, to.residual)};
}

MotionCertificate::Stretch MotionCertificate::stretch(std::span<const Vec3> points, std::size_t cell) const {
  const auto nodes = nodes_.of(cell);
  const Vec3 &start = rest_[nodes[0]], &end = points[nodes[0]];
  const auto displaced = [&](PointId p, const Vec3& x) { return (points[p] - end) - x; };
  LinearFit fit;
  for (const PointId p : nodes) {
    const Vec3 x = rest_[p] - start;
    fit.add(x, displaced(p, x));
  }
  const Matrix gradient = fit.gradient();
  Vec3 low{}, high{};
  for (const PointId p : nodes) {
    const Vec3 x = rest_[p] - start, q = displaced(p, x) - times(gradient, x);
    for (std::size_t k = 0; k < 3; ++k) {
      low[k] = std::min(low[k], q[k]);
      high[k] = std::max(high[k], q[k]);
    }
  }
  return Stretch::of(gradient, 0.5 * length(high - low) * (1 + 1e-12));
}

MotionCertificate::Affinity MotionCertificate::affinity(const Stretch& stretch) const {
  constexpr double least_known = 0.3;
  const double least = 1 + std::min(0.0, stretch.least);
  if (!(least > least_known)) return {infinity, infinity, 0};
  const double condition = std::sqrt(1 + 2 * std::max(0.0, stretch.largest) + stretch.gradient * stretch.gradient) / least;
  return {condition - 1, 1 / least, 1 / (distortion_ == 2 ? condition * condition : condition)};
}

/// Not a number, which infinities may become, proves nothing.
MotionCertificate::Bound MotionCertificate::bound(const Tolerance& tolerance, const Affinity& affinity, double residual) {
  const double r = residual * affinity.inverse_least * static_cast<double>(tolerance.inverse_radius);
  const double x = affinity.excess * static_cast<double>(tolerance.inverse_condition);
  if (!(r <= 1 && x <= 1)) return {};
  const auto loss = static_cast<double>(tolerance.loss), warp_loss = static_cast<double>(tolerance.warp_loss);
  const double left =
      static_cast<double>(tolerance.determinant) - std::min(loss * std::max(x, r), warp_loss + (loss - warp_loss) * r);
  return {true, (left > 0 ? left * affinity.inverse_falling : left) - determinant_rounding};
}

MotionCertificate::Bound MotionCertificate::bound(std::size_t cell, const Stretch& stretch) const {
  return bound(tolerances_[cell], affinity(stretch), stretch.residual);
}

std::size_t MotionCertificate::bytes_to_make(std::size_t cells, std::size_t points, std::size_t nodes) {
  // Lists of blocks while they grow, keys of the order, numbers of points within a block.
  const std::size_t growing = nodes * (sizeof(PointId) + 3 * sizeof(float) + sizeof(std::uint16_t));
  return bytes_for(cells, nodes) + growing + cells * sizeof(std::pair<std::uint64_t, std::uint32_t>) +
         points * 2 * sizeof(std::uint32_t);
}

std::size_t MotionCertificate::bytes_for(std::size_t cells, std::size_t nodes) {
  const std::size_t blocks = cells / block_size + 1;
  return cells * (2 * sizeof(Tolerance) + 2 * sizeof(std::uint32_t)) + (blocks + 1) * 2 * sizeof(std::uint64_t) +
         nodes * (sizeof(PointId) + 3 * sizeof(float) + sizeof(std::uint16_t));
}

}  // namespace deform::quality

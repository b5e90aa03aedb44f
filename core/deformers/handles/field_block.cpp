// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/handles/field_block.h"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <limits>

#include "core/base/vectors.h"
#include "core/numerics/dense/decompositions.h"
#include "core/numerics/kernels/coded_tiles.h"

namespace deform {

namespace {

using Eigen::Index;
using Eigen::MatrixXd;

constexpr double flat_block = 1e-6;  // extent of a block across a plane that counts as none
constexpr double truncation = 0.5;   // of the bound: what the directions that are left out may amount to
constexpr double coarsest = 1.5;     // of the bound: step of the codes that is tried first
constexpr double finer = 0.75;       // and then, until the errors are small enough
constexpr unsigned first_bits = 16;  // of a column in two parts
constexpr int most_trials = 12;
constexpr std::size_t more_columns = 16;  // than fields: directions are rounded to floats, so that a few more may be needed

Index index(std::size_t i) { return static_cast<Index>(i); }

/// The points of a block x fields.
MatrixXd values_of(const FieldTiles& fields, std::size_t first, std::size_t count) {
  MatrixXd values(index(count), index(fields.fields()));
  for (std::size_t f = 0; f < fields.fields(); ++f) {
    for (std::size_t i = 0; i < count; ++i) values(index(i), index(f)) = fields.at(first + i, f);
  }
  return values;
}

void set_frame(std::span<const Vec3> places, FieldBlock& block) {
  Box box;
  for (const Vec3& place : places) box.add(place);
  double radius = 0;
  for (std::size_t k = 0; k < 3; ++k) {
    block.centre[k] = 0.5 * (box.min[k] + box.max[k]);
    radius = std::max(radius, 0.5 * (box.max[k] - box.min[k]));
  }
  block.inverse_radius = radius > 0 ? 1 / radius : 1;
}

MatrixXd affine_matrix(const FieldBlock& block, std::span<const Vec3> places) {
  MatrixXd A(index(places.size()), index(FieldBlock::affine_terms));
  double rows[FieldBlock::affine_terms * tile_size];
  for (std::size_t i = 0; i < places.size(); i += tile_size) {
    const std::size_t count = std::min(tile_size, places.size() - i);
    block.affine_rows(places.subspan(i, count), rows);
    for (std::size_t t = 0; t < FieldBlock::affine_terms; ++t) {
      for (std::size_t j = 0; j < count; ++j) A(index(i + j), index(t)) = rows[t * tile_size + j];
    }
  }
  return A;
}

/// The fields without their affine parts as U V^T with V in floats. Each direction is the row of the point with the
/// largest remainder.
struct Factors {
  MatrixXd U;  ///< points x columns
  MatrixXd V;  ///< fields x columns
};

Factors factored(const MatrixXd& values, double left) {
  MatrixXd rest = values.transpose();  // the fields of a point side by side: one pass through memory per direction
  const Index fields = rest.rows(), points = rest.cols(), most = fields + index(more_columns);
  Factors factors{MatrixXd(points, most), MatrixXd(fields, most)};
  Eigen::VectorXd squares = rest.colwise().squaredNorm().transpose();
  Index columns = 0;
  for (; columns < most; ++columns) {
    Index point = 0;
    const double length = std::sqrt(squares.maxCoeff(&point));
    // No value is larger than the length, nor all of them smaller than this share of it.
    if (length <= left * std::sqrt(static_cast<double>(fields)) && rest.cwiseAbs().maxCoeff() <= left) break;
    const Eigen::VectorXd v = (rest.col(point) / length).cast<float>().cast<double>();
    const double square = v.squaredNorm();
    factors.V.col(columns) = v;
    for (Index i = 0; i < points; ++i) {
      const double u = rest.col(i).dot(v) / square;
      factors.U(i, columns) = u;
      rest.col(i) -= u * v;
      squares[i] = rest.col(i).squaredNorm();
    }
  }
  factors.U.conservativeResize(Eigen::NoChange, columns);
  factors.V.conservativeResize(Eigen::NoChange, columns);
  return factors;
}

/// Whole numbers for columns, each over all of its range.
struct Quantized {
  MatrixXd U;  ///< as decoded
  MatrixXd V;  ///< the direction of each
  std::vector<double> steps, offsets;
  std::vector<std::uint8_t> bits;

  void add(const Eigen::VectorXd& u, const Eigen::VectorXd& v, unsigned width) {
    const Index k = index(bits.size());
    const double least = u.minCoeff(), range = u.maxCoeff() - least;
    const double most = width == 32 ? double{largest_code} : static_cast<double>((1u << width) - 1);
    const double step = width == 0 ? 0 : range / most;
    steps.push_back(step);
    offsets.push_back(least);
    bits.push_back(static_cast<std::uint8_t>(width));
    V.col(k) = v;
    for (Index i = 0; i < u.size(); ++i) U(i, k) = step > 0 ? least + step * std::rint((u[i] - least) / step) : least;
  }
};

/// Quantizes with steps of at most `step`. A column that needs more than 31 bits becomes two, the second one for the remainder of
/// the first.
Quantized quantized(const Factors& factors, double step) {
  Quantized result;
  const Index most = 2 * factors.U.cols();
  result.U.resize(factors.U.rows(), most);
  result.V.resize(factors.V.rows(), most);
  for (Index k = 0; k < factors.U.cols(); ++k) {
    Eigen::VectorXd u = factors.U.col(k);
    double needed = std::ceil((u.maxCoeff() - u.minCoeff()) / step);
    if (needed > largest_code) {
      result.add(u, factors.V.col(k), first_bits);
      u -= result.U.col(index(result.bits.size()) - 1);
      needed = std::min(std::ceil((u.maxCoeff() - u.minCoeff()) / step), double{largest_code});
    }
    result.add(u, factors.V.col(k), code_bits(static_cast<std::uint32_t>(needed)));
  }
  result.U.conservativeResize(Eigen::NoChange, index(result.bits.size()));
  result.V.conservativeResize(Eigen::NoChange, index(result.bits.size()));
  return result;
}

/// A bound of the rounding error of sums of the parts in any order, for each field and unit of its coefficient: for n terms, n
/// roundings of the sum of their magnitudes (Higham, Accuracy and Stability of Numerical Algorithms, 4.2), doubled.
Eigen::VectorXd rounding_of(const MatrixXd& affine, const MatrixXd& U, const MatrixXd& V) {
  Eigen::VectorXd sizes = affine.cwiseAbs().colwise().sum().transpose();
  for (Index k = 0; k < U.cols(); ++k) {
    sizes += (2 * U.col(k).cwiseAbs().maxCoeff() + U.col(k).maxCoeff() - U.col(k).minCoeff()) * V.col(k).cwiseAbs();
  }
  const auto terms = static_cast<double>(affine.cols() + U.cols() + 16);
  return terms * std::numeric_limits<double>::epsilon() * sizes;
}

void store_codes(const Quantized& quantized, std::size_t count, FieldBlock& block) {
  for (const std::uint8_t bits : block.bits) block.tile_bytes += coded_bytes(bits);
  block.codes.resize(tile_count(count) * block.tile_bytes);
  std::uint32_t values[tile_size];
  for (std::size_t t = 0; t < tile_count(count); ++t) {
    std::uint8_t* to = block.codes.data() + t * block.tile_bytes;
    for (std::size_t k = 0; k < block.columns(); ++k) {
      for (std::size_t i = 0; i < tile_size; ++i) {
        const std::size_t point = t * tile_size + i;
        const bool real = point < count && block.steps[k] > 0;
        const double code = real ? (quantized.U(index(point), index(k)) - block.offsets[k]) / block.steps[k] : 0;
        values[i] = static_cast<std::uint32_t>(std::llround(code));
      }
      encode_column(values, block.bits[k], to);
      to += coded_bytes(block.bits[k]);
    }
  }
}

void store(const MatrixXd& affine, Quantized&& quantized, std::size_t count, FieldBlock& block) {
  const MatrixXd& V = quantized.V;
  const auto fields = static_cast<std::size_t>(V.rows()), columns = static_cast<std::size_t>(V.cols());
  for (Index f = 0; f < affine.cols(); ++f) {
    for (Index t = 0; t < affine.rows(); ++t) block.affine.push_back(affine(t, f));
  }
  block.stride = (columns + 3) / 4 * 4;
  block.directions.resize(fields * block.stride);
  for (std::size_t f = 0; f < fields; ++f) {
    for (std::size_t k = 0; k < columns; ++k) {
      block.directions[f * block.stride + k] = static_cast<float>(V(index(f), index(k)));
    }
  }
  block.steps = std::move(quantized.steps);
  block.offsets = std::move(quantized.offsets);
  block.bits = std::move(quantized.bits);
  store_codes(quantized, count, block);
}

FieldBlock exact_block(const FieldTiles& fields, std::size_t first, std::size_t count, std::span<double> errors) {
  FieldBlock block;
  const double* from = fields.tile(first / tile_size);
  block.exact.assign(from, from + tile_count(count) * fields.fields() * tile_size);
  std::fill(errors.begin(), errors.end(), 0.0);
  return block;
}

}  // namespace

void FieldBlock::affine_rows(std::span<const Vec3> places, double* rows) const {
  std::fill_n(rows, affine_terms * tile_size, 0.0);
  for (std::size_t i = 0; i < places.size(); ++i) {
    rows[i] = 1;
    for (std::size_t k = 0; k < 3; ++k) rows[(k + 1) * tile_size + i] = (places[i][k] - centre[k]) * inverse_radius;
  }
}

std::size_t FieldBlock::bytes() const {
  return sizeof(FieldBlock) + (affine.size() + steps.size() + offsets.size() + exact.size()) * sizeof(double) + bits.size() +
         directions.size() * sizeof(float) + codes.size();
}

FieldBlock compress_block(const FieldTiles& fields, std::size_t first, std::span<const Vec3> places, double bound,
                          std::span<double> errors) {
  const std::size_t count = std::min(FieldBlock::points, fields.points() - first);
  const MatrixXd values = values_of(fields, first, count);
  if (!values.allFinite()) return exact_block(fields, first, count, errors);
  const std::span<const Vec3> own = places.subspan(first, count);
  FieldBlock block;
  set_frame(own, block);
  const MatrixXd A = affine_matrix(block, own);
  const MatrixXd affine = least_solution(A, values, flat_block);
  const MatrixXd rest = values - A * affine;
  const Factors factors = factored(rest, truncation * bound);
  double step = coarsest * bound;
  for (int trial = 0; trial < most_trials; ++trial, step *= finer) {
    Quantized quantities = quantized(factors, step);
    const MatrixXd off = rest - quantities.U * quantities.V.transpose();
    const Eigen::VectorXd largest =
        off.cwiseAbs().colwise().maxCoeff().transpose() + rounding_of(affine, quantities.U, quantities.V);
    if (!(largest.maxCoeff() <= bound)) continue;
    store(affine, std::move(quantities), count, block);
    if (block.bytes() >= tile_count(count) * tile_size * fields.fields() * sizeof(double)) break;
    for (std::size_t f = 0; f < fields.fields(); ++f) errors[f] = largest[index(f)];
    return block;
  }
  return exact_block(fields, first, count, errors);
}

}  // namespace deform

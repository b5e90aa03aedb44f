// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/constrained/gauss_newton.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "core/base/error.h"
#include "core/base/parallel.h"
#include "core/base/vectors.h"
#include "core/numerics/dense/lapack.h"

namespace deform {

namespace {

using Entry = Eigen::Triplet<double, std::int64_t>;
constexpr std::size_t few_points = 64;  // of a set whose parameters are eliminated first
constexpr double damping = 1e-9;        // of the diagonal: parameters of shapes that change nothing stay
constexpr std::size_t columns_per_task = 16, rows_per_task = 32;
constexpr std::size_t permuted_and_factored = 2;  // copies of a sparse matrix, in factors
// An entry of the linearized distances is in a list that grows, in a matrix, in its transpose, and twice in what Eigen reserves
// for their product.
constexpr std::size_t bytes_of_row_entry = 3 * sizeof(Entry) + 4 * (sizeof(double) + sizeof(std::int64_t));

}  // namespace

GaussNewton::GaussNewton(const ConstrainedPoints& points, const ReducedEnergy& energy, const SparseCholesky& global_step,
                         std::size_t memory_limit, const RunContext& context)
    : points_(points), energy_(energy) {
  NewtonSizes sizes;
  for (const ConstraintSet& set : points_.sets()) sizes.add(set.solved_projection(), set.solved_rest());
  sizes.functions = energy_.size();
  sizes.dense = energy_.dense();
  sizes.factor_bytes = global_step.bytes();
  sizes.factor_operations = global_step.flops();
  if (const DenseRows* rows = points_.dense()) sizes.dense_points = static_cast<std::size_t>(rows->values().rows());
  const NewtonChoice choice = cheapest_newton(sizes, memory_limit);
  form_ = choice.form;
  operations_ = choice.operations;
  const std::size_t size = 3 * sizes.functions + sizes.parameters;
  const std::size_t entries = form_ == NewtonForm::forces   ? sizes.rows * (sizes.rows + 2 * sizes.parameters)
                              : form_ == NewtonForm::full   ? size * size
                              : form_ == NewtonForm::sparse ? permuted_and_factored * 9 * sizes.factor_bytes / sizeof(double)
                                                            : 0;
  matrix_bytes_ = entries * sizeof(double);
  if (form_ == NewtonForm::sparse) {
    const std::size_t cover = points_.phi().nonZeros() / std::max<std::size_t>(1, points_.count()) + 1;
    matrix_bytes_ = std::max(matrix_bytes_, (3 * sizes.touched * cover + sizes.jacobian) * bytes_of_row_entry);
  }
  if (form_ == NewtonForm::sparse) order_ = energy_.order();
  if (form_ == NewtonForm::forces) prepare_compliance(context);
}

/// Columns are independent of each other: the same for any number of threads.
void GaussNewton::prepare_compliance(const RunContext& context) {
  if (const DenseRows* rows = points_.dense()) {
    const Eigen::MatrixXd across_rows = rows->values().transpose();
    Eigen::MatrixXd X = across_rows;
    parallel_for(context, static_cast<std::size_t>(X.cols()), columns_per_task, [&](std::size_t begin, std::size_t end) {
      for (std::size_t i = begin; i < end; ++i) energy_.solve_in_place(X.col(static_cast<Eigen::Index>(i)));
    });
    const Eigen::MatrixXd at_rows = transposed_product(across_rows, X);
    const SparseMatrix across = rows->spread().transpose();
    const Eigen::MatrixXd spread = rows->spread() * at_rows;
    compliance_ = spread * across;
    return;
  }
  const SparseRows& phi = points_.phi();
  const auto N = static_cast<Eigen::Index>(points_.count());
  compliance_.resize(N, N);
  parallel_for(context, points_.count(), columns_per_task, [&](std::size_t begin, std::size_t end) {
    for (auto i = static_cast<Eigen::Index>(begin); i < static_cast<Eigen::Index>(end); ++i) {
      Eigen::VectorXd b = Eigen::VectorXd::Zero(phi.cols());
      for (SparseRows::InnerIterator it(phi, i); it; ++it) b[it.col()] = it.value();
      energy_.solve_in_place(b);
      compliance_.col(i) = phi * b;
    }
  });
}

std::shared_ptr<const GaussNewton::Matrix> GaussNewton::at(const std::vector<Vec3>& points,
                                                           const std::vector<ShapeParameters>& shapes,
                                                           const RunContext& context) const {
  if (form_ == NewtonForm::none) return nullptr;
  try {
    return std::make_shared<const Matrix>(*this, points, shapes, context);
  } catch (const Error& error) {
    if (error.code() != ErrorCode::numerical_failure) throw;
    return nullptr;
  }
}

GaussNewton::Matrix::Matrix(const GaussNewton& common, const std::vector<Vec3>& points,
                            const std::vector<ShapeParameters>& shapes, const RunContext& context)
    : common_(common), points_(common.points_), functions_(3 * static_cast<std::int64_t>(common.energy_.size())) {
  linearize(points, shapes, context);
  if (common_.form_ == NewtonForm::forces) {
    make_forces(context);
  } else if (common_.form_ == NewtonForm::full) {
    make_full(context);
  } else {
    make_sparse(context);
  }
}

void GaussNewton::Matrix::linearize(const std::vector<Vec3>& points, const std::vector<ShapeParameters>& shapes,
                                    const RunContext& context) {
  linear_.resize(shapes.size());
  parallel_for(context, shapes.size(), 64, [&](std::size_t begin, std::size_t end) {
    for (std::size_t t = begin; t < end; ++t) {
      linear_[t] =
          points_.sets()[t].solved_projection().linearize({points.data() + points_.first(t), points_.size(t)}, shapes[t]);
    }
  });
  size_ = functions_;
  for (const Linearization& linear : linear_) {
    first_column_.push_back(size_);
    size_ += linear.parameters.cols();
  }
}

void GaussNewton::Matrix::add_point(std::size_t point, double root, const Vec3& normal, Row& row) const {
  for (SparseRows::InnerIterator it(points_.phi(), static_cast<std::int64_t>(point)); it; ++it) {
    for (std::int64_t a = 0; a < 3; ++a) {
      row.columns.push_back(3 * it.col() + a);
      row.values.push_back(root * it.value() * normal[static_cast<std::size_t>(a)]);
    }
  }
}

/// Zeros stay in the rows, so that their pattern does not depend on the state.
template <typename Use>
void GaussNewton::Matrix::for_each_row(const Use& use) const {
  Row row;
  for (std::size_t t = 0; t < linear_.size(); ++t) {
    const Linearization& linear = linear_[t];
    const double root = std::sqrt(points_.weight_per_point(t));
    for (std::size_t r = 0; r < linear.normals.size(); ++r) {
      row.columns.clear();
      row.values.clear();
      add_point(points_.first(t) + r / linear.rows_per_point, root, linear.normals[r], row);
      if (!linear.partners.empty()) add_point(points_.first(t) + linear.partners[r], root, linear.partner_normals[r], row);
      const auto at = static_cast<Eigen::Index>(r);
      for (Eigen::Index q = 0; q < linear.parameters.cols(); ++q) {
        row.columns.push_back(first_column_[t] + q);
        row.values.push_back(root * linear.parameters(at, q));
      }
      use(row);
    }
  }
}

void GaussNewton::Matrix::factor_full() {
  lapack::use_one_thread();
  const auto n = static_cast<int>(full_.rows());
  int info = 0;
  dpotrf_("L", &n, full_.data(), &n, &info);
  if (info == 0) return;
  throw Error(ErrorCode::numerical_failure, "the constraints leave the deformation undetermined at unknown " +
                                                std::to_string(info) + " of " + std::to_string(n));
}

void GaussNewton::Matrix::make_full(const RunContext& context) {
  context.check();
  full_ = Eigen::MatrixXd::Zero(size_, size_);
  if (points_.dense() != nullptr) {
    add_dense_rows(context);
  } else {
    for_each_row([&](const Row& row) {
      for (std::size_t j = 0; j < row.columns.size(); ++j) {
        if (row.values[j] == 0) continue;
        double* column = full_.col(row.columns[j]).data();
        for (std::size_t i = 0; i < row.columns.size(); ++i) column[row.columns[i]] += row.values[i] * row.values[j];
      }
    });
  }
  const double largest = std::max(full_.diagonal().maxCoeff(), 1e-300);
  for (std::int64_t q = functions_; q < size_; ++q) full_(q, q) += damping * largest;
  const SparseMatrix& S = common_.energy_.matrix();
  for (std::int64_t j = 0; j < S.cols(); ++j) {
    for (SparseMatrix::InnerIterator it(S, j); it; ++it) {
      for (std::int64_t a = 0; a < 3; ++a) full_(3 * it.row() + a, 3 * j + a) += it.value();
    }
  }
  factor_full();
  context.check();
}

/// With Phi = P V and the distances N of points along their normals, weighted: V^T Q_ab V for all pairs of coordinates, where
/// Q_ab = (N_a P)^T N_b P is sparse, and V^T (N_a P)^T times the derivatives with respect to the parameters. Lower triangle.
void GaussNewton::Matrix::add_dense_rows(const RunContext& context) {
  const DenseRows& phi = *points_.dense();
  const std::int64_t parameters = size_ - functions_;
  std::array<std::vector<Entry>, 3> along;
  std::vector<Entry> shapes;
  std::int64_t row = 0;
  for_each_distance([&](std::size_t t, std::size_t r, Eigen::Index) {
    const Linearization& linear = linear_[t];
    const double root = std::sqrt(points_.weight_per_point(t));
    const auto add = [&](std::size_t point, const Vec3& normal) {
      for (SparseRows::InnerIterator it(phi.spread(), static_cast<std::int64_t>(point)); it; ++it) {
        for (std::size_t a = 0; a < 3; ++a) {
          if (normal[a] != 0) along[a].emplace_back(row, it.col(), root * it.value() * normal[a]);
        }
      }
    };
    add(points_.first(t) + r / linear.rows_per_point, linear.normals[r]);
    if (!linear.partners.empty()) add(points_.first(t) + linear.partners[r], linear.partner_normals[r]);
    for (Eigen::Index q = 0; q < linear.parameters.cols(); ++q) {
      const double value = root * linear.parameters(static_cast<Eigen::Index>(r), q);
      if (value != 0) shapes.emplace_back(row, first_column_[t] - functions_ + q, value);
    }
    ++row;
  });
  SparseMatrix by_shapes(row, parameters);
  by_shapes.setFromTriplets(shapes.begin(), shapes.end());
  std::array<SparseMatrix, 3> J;
  for (std::size_t a = 0; a < 3; ++a) {
    J[a].resize(row, phi.values().rows());
    J[a].setFromTriplets(along[a].begin(), along[a].end());
  }
  using Stride = Eigen::Stride<Eigen::Dynamic, Eigen::Dynamic>;
  const Eigen::Index r = functions_ / 3, size = full_.rows();
  for (std::size_t a = 0; a < 3; ++a) {
    context.check();
    const SparseMatrix across = J[a].transpose();
    for (std::size_t b = 0; b < 3; ++b) {
      const auto i = static_cast<Eigen::Index>(a), j = static_cast<Eigen::Index>(b);
      Eigen::Map<Eigen::MatrixXd, 0, Stride> block(full_.data() + i + j * size, r, r, Stride(3 * size, 3));
      if (b < a) {
        block = Eigen::Map<Eigen::MatrixXd, 0, Stride>(full_.data() + j + i * size, r, r, Stride(3 * size, 3)).transpose();
      } else {
        block = phi.product(SparseMatrix(across * J[b]));
      }
    }
    const Eigen::MatrixXd mixed = transposed_product(phi.values(), Eigen::MatrixXd(SparseMatrix(across * by_shapes)));
    for (Eigen::Index j = 0; j < r; ++j) {
      full_.row(3 * j + static_cast<Eigen::Index>(a)).tail(parameters) = mixed.row(j);
      full_.col(3 * j + static_cast<Eigen::Index>(a)).tail(parameters) = mixed.row(j).transpose();
    }
  }
  full_.bottomRightCorner(parameters, parameters) = Eigen::MatrixXd(SparseMatrix(by_shapes.transpose()) * by_shapes);
}

void GaussNewton::Matrix::make_sparse(const RunContext& context) {
  std::vector<Entry> entries;
  std::int64_t rows = 0;
  for_each_row([&](const Row& row) {
    for (std::size_t e = 0; e < row.columns.size(); ++e) entries.emplace_back(rows, row.columns[e], row.values[e]);
    ++rows;
  });
  SparseMatrix J(rows, size_);
  J.setFromTriplets(entries.begin(), entries.end());
  SparseMatrix H = SparseMatrix(SparseMatrix(J.transpose()) * J).triangularView<Eigen::Lower>();
  entries.clear();
  const SparseMatrix& S = common_.energy_.matrix();
  for (std::int64_t j = 0; j < S.cols(); ++j) {
    for (SparseMatrix::InnerIterator it(S, j); it; ++it) {
      for (std::int64_t a = 0; a < 3; ++a) entries.emplace_back(3 * it.row() + a, 3 * j + a, it.value());
    }
  }
  const double largest = std::max(H.diagonal().size() > 0 ? H.diagonal().maxCoeff() : 0.0, 1e-300);
  for (std::int64_t q = functions_; q < size_; ++q) entries.emplace_back(q, q, damping * largest);
  SparseMatrix energy(size_, size_);
  energy.setFromTriplets(entries.begin(), entries.end());
  H += energy;
  H.makeCompressed();
  // Eliminate parameters of small sets first, as they couple functions that are coupled already, and those of large sets last, as
  // they would couple everything.
  std::vector<std::int64_t> order, last;
  for (std::size_t t = 0; t < linear_.size(); ++t) {
    std::vector<std::int64_t>& place = points_.size(t) <= few_points ? order : last;
    for (Eigen::Index q = 0; q < linear_[t].parameters.cols(); ++q) place.push_back(first_column_[t] + q);
  }
  for (std::int64_t i = 0; i < functions_ / 3; ++i) {
    const std::int64_t j = common_.order_.empty() ? i : common_.order_[static_cast<std::size_t>(i)];
    for (std::int64_t a = 0; a < 3; ++a) order.push_back(3 * j + a);
  }
  order.insert(order.end(), last.begin(), last.end());
  sparse_ = std::make_unique<const SparseCholesky>(H, order, context);
}

/// Row by row: the point, its normal and the partner's. Calls use(set, row of the set, row of all).
template <typename Use>
void GaussNewton::Matrix::for_each_distance(const Use& use) const {
  Eigen::Index all = 0;
  for (std::size_t t = 0; t < linear_.size(); ++t) {
    for (std::size_t r = 0; r < linear_[t].normals.size(); ++r) use(t, r, all++);
  }
}

void GaussNewton::Matrix::make_forces(const RunContext& context) {
  context.check();
  Eigen::Index rows = 0;
  for (const Linearization& linear : linear_) rows += linear.residual.size();
  const Eigen::Index parameters = size_ - functions_;
  struct Part {
    Eigen::Index point;
    Vec3 normal;
  };
  std::vector<Part> parts;  // two per row; the second may be nothing
  shapes_ = Eigen::MatrixXd::Zero(rows, parameters);
  full_.resize(rows, rows);
  Eigen::VectorXd softness(rows);  // of the diagonal: 1 / weight
  for_each_distance([&](std::size_t t, std::size_t r, Eigen::Index row) {
    const Linearization& linear = linear_[t];
    const auto at = static_cast<Eigen::Index>(r);
    const auto point = static_cast<Eigen::Index>(points_.first(t) + r / linear.rows_per_point);
    parts.push_back({point, linear.normals[r]});
    const bool two = !linear.partners.empty();
    parts.push_back({two ? static_cast<Eigen::Index>(points_.first(t) + linear.partners[r]) : point,
                     two ? linear.partner_normals[r] : Vec3{}});
    softness[row] = 1 / points_.weight_per_point(t);
    const Eigen::Index q = first_column_[t] - functions_;
    shapes_.row(row).segment(q, linear.parameters.cols()) = linear.parameters.row(at);
  });
  const Eigen::MatrixXd& C = common_.compliance_;
  const bool pairs = std::any_of(linear_.begin(), linear_.end(), [](const Linearization& l) { return !l.partners.empty(); });
  parallel_for(context, static_cast<std::size_t>(rows), rows_per_task, [&](std::size_t begin, std::size_t end) {
    for (std::size_t j = begin; j < end; ++j) {
      const Part &a = parts[2 * j], &b = parts[2 * j + 1];
      for (auto i = j; i < static_cast<std::size_t>(rows); ++i) {
        const Part &c = parts[2 * i], &d = parts[2 * i + 1];
        double value = dot(a.normal, c.normal) * C(c.point, a.point);
        if (pairs) {
          value += dot(a.normal, d.normal) * C(d.point, a.point) + dot(b.normal, c.normal) * C(c.point, b.point) +
                   dot(b.normal, d.normal) * C(d.point, b.point);
        }
        full_(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(j)) = value;
      }
    }
  });
  full_.diagonal() += softness;
  factor_full();
  by_shapes_ = shapes_;
  for (Eigen::Index q = 0; q < parameters; ++q) by_shapes_.col(q) = inverse_full(by_shapes_.col(q));
  Eigen::MatrixXd B = shapes_.transpose() * by_shapes_;
  if (parameters > 0) B.diagonal().array() += damping * std::max(B.diagonal().maxCoeff(), 1e-300);
  of_shapes_.compute(B);
  context.check();
}

Eigen::VectorXd GaussNewton::Matrix::inverse_full(Eigen::VectorXd b) const {
  lapack::use_one_thread();
  const auto n = static_cast<int>(full_.rows());
  for (const CBLAS_TRANSPOSE side : {CblasNoTrans, CblasTrans}) {
    cblas_dtrsv(CblasColMajor, CblasLower, side, CblasNonUnit, n, full_.data(), n, b.data(), 1);
  }
  return b;
}

Eigen::VectorXd GaussNewton::Matrix::forces_of(Eigen::VectorXd distances) const {
  Eigen::VectorXd forces = inverse_full(std::move(distances));
  if (shapes_.cols() == 0) return forces;
  return forces - by_shapes_ * of_shapes_.solve(shapes_.transpose() * forces);
}

Eigen::MatrixXd GaussNewton::Matrix::pushed_by(const Eigen::VectorXd& forces) const {
  Eigen::MatrixXd b = Eigen::MatrixXd::Zero(functions_ / 3, 3);
  std::vector<Vec3> at_points(points_.dense() != nullptr ? points_.count() : 0, Vec3{});
  const auto add = [&](std::size_t point, const Vec3& normal, double force) {
    if (points_.dense() != nullptr) {
      at_points[point] = at_points[point] + force * normal;
      return;
    }
    for (SparseRows::InnerIterator it(points_.phi(), static_cast<std::int64_t>(point)); it; ++it) {
      for (Eigen::Index k = 0; k < 3; ++k) b(it.col(), k) += it.value() * force * normal[static_cast<std::size_t>(k)];
    }
  };
  for_each_distance([&](std::size_t t, std::size_t r, Eigen::Index row) {
    const Linearization& linear = linear_[t];
    add(points_.first(t) + r / linear.rows_per_point, linear.normals[r], forces[row]);
    if (!linear.partners.empty()) add(points_.first(t) + linear.partners[r], linear.partner_normals[r], forces[row]);
  });
  if (points_.dense() != nullptr) b = points_.dense()->transposed_times(at_points);
  common_.energy_.solve_in_place(b);
  return b;
}

Eigen::VectorXd GaussNewton::Matrix::distances_of(const Eigen::MatrixXd& v) const {
  const std::vector<Vec3> moved = points_.displacements(v);
  Eigen::VectorXd result(shapes_.rows());
  for_each_distance([&](std::size_t t, std::size_t r, Eigen::Index row) {
    const Linearization& linear = linear_[t];
    result[row] = dot(linear.normals[r], moved[points_.first(t) + r / linear.rows_per_point]);
    if (!linear.partners.empty()) {
      result[row] += dot(linear.partner_normals[r], moved[points_.first(t) + linear.partners[r]]);
    }
  });
  return result;
}

Eigen::MatrixXd GaussNewton::Matrix::inverse(const Eigen::MatrixXd& b) const {
  if (common_.form_ == NewtonForm::forces) {
    Eigen::MatrixXd y = b;
    common_.energy_.solve_in_place(y);
    return y - pushed_by(forces_of(distances_of(y)));
  }
  Eigen::VectorXd x = Eigen::VectorXd::Zero(size_);
  for (std::int64_t j = 0; j < b.rows(); ++j) x.segment<3>(3 * j) = b.row(j).transpose();
  if (sparse_) {
    sparse_->solve_in_place(x);
  } else {
    x = inverse_full(std::move(x));
  }
  Eigen::MatrixXd result(b.rows(), 3);
  for (std::int64_t j = 0; j < b.rows(); ++j) result.row(j) = x.segment<3>(3 * j).transpose();
  return result;
}

}  // namespace deform

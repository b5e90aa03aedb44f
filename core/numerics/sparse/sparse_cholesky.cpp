// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/numerics/sparse/sparse_cholesky.h"

#include <cholmod.h>

// Declared by libgomp, to which CHOLMOD is linked; not every compiler has omp.h.
extern "C" {
int omp_get_max_active_levels(void);
void omp_set_max_active_levels(int levels);
}

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>

#include "core/base/error.h"
#include "core/numerics/dense/lapack.h"

namespace deform {

namespace {

static_assert(sizeof(SuiteSparse_long) == sizeof(SparseMatrix::StorageIndex));

/// CHOLMOD's loops ask for a fixed number of OpenMP threads, which wait for each other longer than they work and take the cores
/// from other requests. While this lives, loops of this thread run on it alone.
class LoopsOnThisThread {
 public:
  LoopsOnThisThread() : before_(omp_get_max_active_levels()) { omp_set_max_active_levels(0); }
  ~LoopsOnThisThread() { omp_set_max_active_levels(before_); }
  LoopsOnThisThread(const LoopsOnThisThread&) = delete;
  LoopsOnThisThread& operator=(const LoopsOnThisThread&) = delete;

 private:
  int before_;
};

/// The library's parameters, statistics and scratch memory: one for each thread that calls it.
class Common {
 public:
  Common() {
    lapack::use_one_thread();
    cholmod_l_start(&common_);
    common_.print = 0;
    common_.supernodal = CHOLMOD_SUPERNODAL;
    common_.final_ll = 1;
    common_.useGPU = 0;
    // AMD, then METIS where AMD's factor is large; which one wins depends on counts only.
    common_.nmethods = 0;
    common_.error_handler = nullptr;
  }
  ~Common() { cholmod_l_finish(&common_); }
  Common(const Common&) = delete;
  Common& operator=(const Common&) = delete;

  cholmod_common* get() { return &common_; }
  /// Without postordering, because the last columns must stay last.
  void take_given_order() {
    common_.nmethods = 1;
    common_.method[0].ordering = CHOLMOD_GIVEN;
    common_.postorder = 0;
  }
  void free_scratch() { cholmod_l_free_work(&common_); }
  int status() const { return common_.status; }
  double flops() const { return common_.fl; }

 private:
  cholmod_common common_{};
};

/// Borrows a compressed Eigen matrix; cholmod does not write to it.
cholmod_sparse view(const SparseMatrix& lower) {
  cholmod_sparse A{};
  A.nrow = static_cast<std::size_t>(lower.rows());
  A.ncol = static_cast<std::size_t>(lower.cols());
  A.nzmax = static_cast<std::size_t>(lower.nonZeros());
  A.p = const_cast<std::int64_t*>(lower.outerIndexPtr());
  A.i = const_cast<std::int64_t*>(lower.innerIndexPtr());
  A.x = const_cast<double*>(lower.valuePtr());
  A.stype = -1;
  A.itype = CHOLMOD_LONG;
  A.xtype = CHOLMOD_REAL;
  A.dtype = CHOLMOD_DOUBLE;
  A.sorted = 1;
  A.packed = 1;
  return A;
}

void check_shape(const SparseMatrix& lower) {
  if (lower.rows() != lower.cols() || !lower.isCompressed()) {
    throw Error(ErrorCode::internal, "sparse Cholesky: the matrix must be square and compressed");
  }
}

[[noreturn]] void fail(int status, const char* stage, std::size_t n) {
  if (status == CHOLMOD_OUT_OF_MEMORY || status == CHOLMOD_TOO_LARGE) {
    throw Error(ErrorCode::out_of_budget,
                std::string("sparse Cholesky: memory ran out in ") + stage + " of a matrix of " + std::to_string(n) + " rows");
  }
  throw Error(ErrorCode::internal, std::string("sparse Cholesky: ") + stage + " failed with status " + std::to_string(status));
}

/// An analysis, perhaps with numbers.
class Analysis {
 public:
  /// order: empty, or the one to take.
  Analysis(cholmod_sparse* A, std::span<const std::int64_t> order, Common& common) : common_(common) {
    if (order.empty()) {
      L_ = cholmod_l_analyze(A, common.get());
    } else {
      std::vector<SuiteSparse_long> given(order.begin(), order.end());
      common.take_given_order();
      L_ = cholmod_l_analyze_p(A, given.data(), nullptr, 0, common.get());
    }
    if (L_ == nullptr || common.status() < CHOLMOD_OK) {
      const int status = common.status();
      cholmod_l_free_factor(&L_, common.get());
      fail(status, "analysis", A->nrow);
    }
  }
  ~Analysis() { cholmod_l_free_factor(&L_, common_.get()); }
  Analysis(const Analysis&) = delete;
  Analysis& operator=(const Analysis&) = delete;
  cholmod_factor* get() const { return L_; }

  std::vector<std::int64_t> order() const {
    const auto* order = static_cast<const SuiteSparse_long*>(L_->Perm);
    return {order, order + L_->n};
  }
  std::size_t bytes() const {
    const std::size_t indices = 3 * (L_->n + 1) + (L_->is_super != 0 ? L_->ssize + 3 * (L_->nsuper + 1) : L_->nzmax);
    return sizeof(double) * (L_->is_super != 0 ? L_->xsize : L_->nzmax) + sizeof(SuiteSparse_long) * indices;
  }

 private:
  Common& common_;
  cholmod_factor* L_ = nullptr;
};

}  // namespace

struct SparseCholesky::Factor {
  Factor(cholmod_sparse matrix, std::span<const std::int64_t> order, const RunContext& context);
  void measure_diagonal();

  Common common;
  Analysis analysis;
  double flops;
  double smallest = 0, largest = 0;  ///< of the diagonal of L
};

SparseCholesky::Factor::Factor(cholmod_sparse matrix, std::span<const std::int64_t> order, const RunContext& context)
    : analysis(&matrix, order, common), flops(common.flops()) {
  context.check();
  {
    const LoopsOnThisThread alone;
    cholmod_l_factorize(&matrix, analysis.get(), common.get());
  }
  const cholmod_factor* L = analysis.get();
  if (common.status() < CHOLMOD_OK) fail(common.status(), "factorization", L->n);
  // The failing column is that of the permuted matrix.
  if (common.status() == CHOLMOD_NOT_POSDEF || L->minor < L->n) {
    const auto* rows = static_cast<const SuiteSparse_long*>(L->Perm);
    const std::size_t column = std::min<std::size_t>(L->minor, L->n - 1);
    throw Error(ErrorCode::numerical_failure, "sparse Cholesky: the matrix is not positive definite, column " +
                                                  std::to_string(rows[column]) + " of " + std::to_string(L->n) +
                                                  " has no positive pivot");
  }
  common.free_scratch();  // it lives as long as the factor, and its size is that of a dozen vectors
  measure_diagonal();
  context.check();
}

void SparseCholesky::Factor::measure_diagonal() {
  smallest = std::numeric_limits<double>::infinity();
  largest = 0;
  const cholmod_factor* L = analysis.get();
  const auto* x = static_cast<const double*>(L->x);
  const auto add = [&](double value) {
    smallest = std::min(smallest, std::abs(value));
    largest = std::max(largest, std::abs(value));
  };
  if (L->is_super == 0) {
    const auto* p = static_cast<const SuiteSparse_long*>(L->p);
    for (std::size_t j = 0; j < L->n; ++j) add(x[p[j]]);
    return;
  }
  // Each supernode is a dense block of all its rows by its columns, whose diagonal comes first.
  const auto* super = static_cast<const SuiteSparse_long*>(L->super);
  const auto* rows = static_cast<const SuiteSparse_long*>(L->pi);
  const auto* block = static_cast<const SuiteSparse_long*>(L->px);
  for (std::size_t s = 0; s < L->nsuper; ++s) {
    const SuiteSparse_long height = rows[s + 1] - rows[s];
    for (SuiteSparse_long j = 0; j < super[s + 1] - super[s]; ++j) add(x[block[s] + j * height + j]);
  }
}

SparseCholesky::Estimate SparseCholesky::estimate(const SparseMatrix& lower, std::span<const std::int64_t> order) {
  check_shape(lower);
  if (lower.rows() == 0) return {};
  Common common;
  cholmod_sparse A = view(lower);
  const Analysis analysis(&A, order, common);
  Estimate result;
  result.flops = common.flops();
  result.factor_bytes = analysis.bytes();
  // Beside the factor: a permuted copy of the matrix and the update of the largest supernode.
  const cholmod_factor* L = analysis.get();
  result.peak_bytes = result.factor_bytes + 2 * A.nzmax * (sizeof(double) + sizeof(SuiteSparse_long)) +
                      sizeof(double) * L->maxcsize + 8 * sizeof(SuiteSparse_long) * L->n;
  return result;
}

std::vector<std::int64_t> SparseCholesky::fill_reducing_order(const SparseMatrix& lower) {
  check_shape(lower);
  if (lower.rows() == 0) return {};
  Common common;
  cholmod_sparse A = view(lower);
  return Analysis(&A, {}, common).order();
}

SparseCholesky::SparseCholesky(const SparseMatrix& lower, const RunContext& context) : SparseCholesky(lower, {}, context) {}

SparseCholesky::SparseCholesky(const SparseMatrix& lower, std::span<const std::int64_t> order, const RunContext& context) {
  check_shape(lower);
  if (!order.empty() && order.size() != static_cast<std::size_t>(lower.rows())) {
    throw Error(ErrorCode::internal, "sparse Cholesky: the order must name every row");
  }
  context.check();
  if (lower.rows() == 0) return;
  factor_ = std::make_unique<Factor>(view(lower), order, context);
}

SparseCholesky::~SparseCholesky() = default;
SparseCholesky::SparseCholesky(SparseCholesky&&) noexcept = default;
SparseCholesky& SparseCholesky::operator=(SparseCholesky&&) noexcept = default;

std::size_t SparseCholesky::size() const { return factor_ ? factor_->analysis.get()->n : 0; }
std::size_t SparseCholesky::bytes() const { return factor_ ? factor_->analysis.bytes() : 0; }

double SparseCholesky::flops() const { return factor_ ? factor_->flops : 0; }
std::vector<std::int64_t> SparseCholesky::order() const {
  return factor_ ? factor_->analysis.order() : std::vector<std::int64_t>();
}

Eigen::MatrixXd SparseCholesky::trailing(std::size_t count) const {
  const auto size_wanted = static_cast<Eigen::Index>(count);
  Eigen::MatrixXd result = Eigen::MatrixXd::Zero(size_wanted, size_wanted);
  if (count > size()) throw Error(ErrorCode::internal, "sparse Cholesky: more trailing rows than rows");
  if (count == 0) return result;
  const cholmod_factor* L = factor_->analysis.get();
  const auto* x = static_cast<const double*>(L->x);
  const auto first = static_cast<SuiteSparse_long>(L->n - count);
  const auto put = [&](SuiteSparse_long row, SuiteSparse_long column, double value) {
    if (column >= first && row >= column) result(row - first, column - first) = value;
  };
  if (L->is_super == 0) {
    const auto *p = static_cast<const SuiteSparse_long*>(L->p), *i = static_cast<const SuiteSparse_long*>(L->i);
    const auto* entries = static_cast<const SuiteSparse_long*>(L->nz);
    for (auto j = first; j < static_cast<SuiteSparse_long>(L->n); ++j) {
      for (SuiteSparse_long k = p[j]; k < p[j] + entries[j]; ++k) put(i[k], j, x[k]);
    }
    return result;
  }
  const auto* super = static_cast<const SuiteSparse_long*>(L->super);
  const auto* starts = static_cast<const SuiteSparse_long*>(L->pi);
  const auto* blocks = static_cast<const SuiteSparse_long*>(L->px);
  const auto* rows = static_cast<const SuiteSparse_long*>(L->s);
  for (std::size_t s = 0; s < L->nsuper; ++s) {
    const SuiteSparse_long height = starts[s + 1] - starts[s];
    for (SuiteSparse_long j = std::max(super[s], first); j < super[s + 1]; ++j) {
      for (SuiteSparse_long k = 0; k < height; ++k) put(rows[starts[s] + k], j, x[blocks[s] + (j - super[s]) * height + k]);
    }
  }
  return result;
}

double SparseCholesky::reciprocal_condition() const {
  if (!factor_) return 1;
  const double ratio = factor_->smallest / factor_->largest;
  return ratio * ratio;
}

Eigen::MatrixXd SparseCholesky::solve(const Eigen::Ref<const Eigen::MatrixXd>& b) const {
  Eigen::MatrixXd x = b;
  solve_in_place(x);
  return x;
}

/// Column by column: BLAS sums in another order for another number of right-hand sides, and a column must not depend on others.
void SparseCholesky::solve_in_place(Eigen::Ref<Eigen::MatrixXd> b) const { solve_in_place(b, 1); }

void SparseCholesky::solve_together_in_place(Eigen::Ref<Eigen::MatrixXd> b) const {
  solve_in_place(b, std::max<Eigen::Index>(1, b.cols()));
}

void SparseCholesky::solve_in_place(Eigen::Ref<Eigen::MatrixXd> b, Eigen::Index at_once) const {
  const std::size_t n = size();
  if (static_cast<std::size_t>(b.rows()) != n) {
    throw Error(ErrorCode::internal,
                "sparse Cholesky: right-hand side has " + std::to_string(b.rows()) + " rows instead of " + std::to_string(n));
  }
  if (n == 0) return;
  Common common;
  cholmod_dense *X = nullptr, *Y = nullptr, *E = nullptr;
  int status = CHOLMOD_OK;
  for (Eigen::Index c = 0; c < b.cols() && status == CHOLMOD_OK; c += at_once) {
    cholmod_dense B{};
    B.nrow = n;
    B.ncol = static_cast<std::size_t>(std::min(at_once, b.cols() - c));
    B.d = static_cast<std::size_t>(b.outerStride());
    B.nzmax = B.d * B.ncol;
    B.x = b.col(c).data();
    B.xtype = CHOLMOD_REAL;
    B.dtype = CHOLMOD_DOUBLE;
    // The factor is only read: it is in its final form, and the solve writes only to X, Y, E and its own common.
    cholmod_l_solve2(CHOLMOD_A, factor_->analysis.get(), &B, nullptr, &X, nullptr, &Y, &E, common.get());
    status = common.status();
    for (std::size_t j = 0; j < B.ncol && status == CHOLMOD_OK; ++j) {
      std::copy_n(static_cast<const double*>(X->x) + j * X->d, n, b.col(c + static_cast<Eigen::Index>(j)).data());
    }
  }
  cholmod_l_free_dense(&X, common.get());
  cholmod_l_free_dense(&Y, common.get());
  cholmod_l_free_dense(&E, common.get());
  if (status < CHOLMOD_OK) fail(status, "solution", n);
}

}  // namespace deform

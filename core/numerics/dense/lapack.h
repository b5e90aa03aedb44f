// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cblas.h>

#include <complex>

namespace deform::lapack {

/// Makes OpenBLAS single-threaded. The callers parallelize (core/base/parallel.h), so that requests share the cores without
/// oversubscription and results do not depend on the number of threads. Call it before any use of BLAS or LAPACK; cheap,
/// any thread.
void use_one_thread();

}  // namespace deform::lapack

extern "C" {
void dpotrf_(const char* uplo, const int* n, double* a, const int* lda, int* info);
void dpstrf_(const char* uplo, const int* n, double* a, const int* lda, int* piv, int* rank, const double* tol, double* work,
             int* info);
void dsytrf_(const char* uplo, const int* n, double* a, const int* lda, int* ipiv, double* work, const int* lwork, int* info);
void dsptrs_(const char* uplo, const int* n, const int* nrhs, const double* ap, const int* ipiv, double* b, const int* ldb,
             int* info);
void zhetrf_(const char* uplo, const int* n, std::complex<double>* a, const int* lda, int* ipiv, std::complex<double>* work,
             const int* lwork, int* info);
void zhptrs_(const char* uplo, const int* n, const int* nrhs, const std::complex<double>* ap, const int* ipiv,
             std::complex<double>* b, const int* ldb, int* info);
void dgesdd_(const char* jobz, const int* m, const int* n, double* a, const int* lda, double* s, double* u, const int* ldu,
             double* vt, const int* ldvt, double* work, const int* lwork, int* iwork, int* info);
void dgeqrt3_(const int* m, const int* n, double* a, const int* lda, double* t, const int* ldt, int* info);
void dlarfb_(const char* side, const char* trans, const char* direct, const char* storev, const int* m, const int* n,
             const int* k, const double* v, const int* ldv, const double* t, const int* ldt, double* c, const int* ldc,
             double* work, const int* ldwork);
}

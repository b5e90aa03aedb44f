// SPDX-License-Identifier: Apache-2.0
#include "core/base/reduction_error.h"

#include "core/base/number_text.h"

namespace deform {

std::string reduction_doubt(double error) {
  if (!(error > doubtful_reduction)) return {};
  return "not all handle and fixed points are centres: points may be " + three_digits(error) +
         " of the largest prescribed displacement from where they would be if all were; take REDUCTION_TOLERANCE with a smaller "
         "reduction_tolerance, or REDUCTION_OFF";
}

}  // namespace deform

// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <functional>
#include <map>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "core/base/error.h"
#include "core/deformers/system.h"
#include "deform/v1/deformation.pb.h"

namespace deform::server {

struct ResidentSystem;

/// What becomes of a request with a design that cannot be evaluated.
enum class Failures {
  fail_request,
  per_design,  ///< the design fails alone, the others are answered as if it had not been there
};

/// Throws Error(invalid_argument) for an unknown value.
Failures failures_from_proto(const v1::DeformRequest& request);

/// An error that is the fault of one design and says nothing about the others: not those of time, memory and the machine.
bool fails_alone(const Error& error);

/// Why a design has no deformation. The message names the field within the design.
v1::RequestError failure_to_proto(const Error& error);

/// Errors of designs by their number in the request.
using DesignErrors = std::map<std::size_t, Error>;

/// The designs of a request, each converted for itself. One that cannot be is at rest and has an error.
struct ConvertedDesigns {
  std::vector<Design> designs;
  DesignErrors failed;
};
ConvertedDesigns convert_each(const v1::DeformRequest& request, const ResidentSystem& system);

/// Designs of a request that were bound together, and those that could not be.
struct BoundDesigns {
  BoundDesigns() = default;
  /// All of a request.
  BoundDesigns(std::unique_ptr<const Evaluation> all);  // NOLINT(google-explicit-constructor): what binding them returns

  std::unique_ptr<const Evaluation> evaluation;  ///< of the good ones, in their order; null when there are none
  std::vector<std::size_t> numbers;              ///< of these, in the request
  DesignErrors failed;
  std::vector<std::vector<std::string>> doubts{};  ///< of the good ones, see handle_shape_doubts(); or empty
};

/// Binds all designs at once that can be. Where that throws what fails alone, each is bound for itself to find out which it is.
/// Throws what `bind` throws else, and when no single one is to blame.
BoundDesigns bind_each(ConvertedDesigns converted,
                       const std::function<std::unique_ptr<const Evaluation>(std::span<const Design>)>& bind);

}  // namespace deform::server

// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/engine/design_failures.h"

#include <cctype>
#include <numeric>
#include <string_view>
#include <utility>

#include "proto/convert/base/error.h"
#include "proto/convert/base/fields.h"
#include "proto/convert/design.h"
#include "server/engine/system_cache.h"

namespace deform::server {

namespace {

/// "designs[3].variables[0]: ..." without the number: it is that of the design, and another one where designs are bound for
/// themselves.
std::string within_design(std::string_view text) {
  constexpr std::string_view start = "designs[";
  if (!text.starts_with(start)) return std::string(text);
  std::size_t end = start.size();
  while (end < text.size() && std::isdigit(static_cast<unsigned char>(text[end])) != 0) ++end;
  if (end == text.size() || text[end] != ']') return std::string(text);
  text.remove_prefix(end + 1);
  for (const std::string_view separator : {std::string_view("."), std::string_view(": ")}) {
    if (text.starts_with(separator)) return std::string(text.substr(separator.size()));
  }
  return std::string(text);
}

}  // namespace

Failures failures_from_proto(const v1::DeformRequest& request) {
  return convert::known(request.failures(), "failures") == v1::FAILURES_PER_DESIGN ? Failures::per_design
                                                                                   : Failures::fail_request;
}

bool fails_alone(const Error& error) {
  return error.code() == ErrorCode::invalid_argument || error.code() == ErrorCode::failed_precondition ||
         error.code() == ErrorCode::numerical_failure;
}

v1::RequestError failure_to_proto(const Error& error) {
  return convert::error_to_proto({error.code(), within_design(error.public_message()), error.retry_after_ms()});
}

ConvertedDesigns convert_each(const v1::DeformRequest& request, const ResidentSystem& system) {
  ConvertedDesigns converted;
  converted.designs.resize(static_cast<std::size_t>(request.designs_size()));
  for (std::size_t d = 0; d < converted.designs.size(); ++d) {
    try {
      convert::check_design(request, d);
      Design design = convert::design_from_proto(request, d, system.info);
      // What most bad designs are refused for, found without solving anything.
      if (!design.variables.empty()) handle_motions(system.setup, design.variables);
      converted.designs[d] = std::move(design);
    } catch (const Error& error) {
      if (!fails_alone(error)) throw;
      converted.failed.emplace(d, error);
    }
  }
  return converted;
}

BoundDesigns::BoundDesigns(std::unique_ptr<const Evaluation> all) : evaluation(std::move(all)) {
  numbers.resize(evaluation->design_count());
  std::iota(numbers.begin(), numbers.end(), std::size_t{0});
}

BoundDesigns bind_each(ConvertedDesigns converted,
                       const std::function<std::unique_ptr<const Evaluation>(std::span<const Design>)>& bind) {
  BoundDesigns bound;
  bound.failed = std::move(converted.failed);
  std::vector<Design>& good = converted.designs;
  bound.numbers.resize(good.size());
  std::iota(bound.numbers.begin(), bound.numbers.end(), std::size_t{0});
  const auto drop_failed = [&] {
    std::size_t kept = 0;
    for (std::size_t k = 0; k < good.size(); ++k) {
      if (bound.failed.contains(bound.numbers[k])) continue;
      bound.numbers[kept] = bound.numbers[k];
      if (kept != k) good[kept] = std::move(good[k]);
      ++kept;
    }
    good.resize(kept);
    bound.numbers.resize(kept);
  };
  drop_failed();
  if (good.empty()) return bound;
  try {
    bound.evaluation = bind(good);
    return bound;
  } catch (const Error& error) {
    if (!fails_alone(error)) throw;
    const std::size_t before = bound.failed.size();
    for (std::size_t k = 0; k < good.size(); ++k) {
      try {
        bind({&good[k], 1});
      } catch (const Error& alone) {
        if (!fails_alone(alone)) throw;
        bound.failed.emplace(bound.numbers[k], alone);
      }
    }
    if (bound.failed.size() == before) throw;
  }
  drop_failed();
  if (!good.empty()) bound.evaluation = bind(good);
  return bound;
}

}  // namespace deform::server

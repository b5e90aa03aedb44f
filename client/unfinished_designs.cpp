// SPDX-License-Identifier: Apache-2.0
#include "client/unfinished_designs.h"

#include <algorithm>
#include <charconv>
#include <numeric>
#include <string_view>
#include <utility>

#include "client/call_error.h"

namespace deform::client {

UnfinishedDesigns::UnfinishedDesigns(const v1::DeformRequest& request, const DesignSink& sink, const DesignMemory& memory)
    : request_(request),
      sink_(sink),
      memory_(memory),
      left_(static_cast<std::size_t>(request.designs_size())),
      taken_(left_.size(), 0) {
  std::iota(left_.begin(), left_.end(), std::size_t{0});
}

DeformOutcome UnfinishedDesigns::ask(const Send& send) {
  std::size_t k = 0;
  std::erase_if(left_, [&](std::size_t) { return taken_[k++] != 0; });
  taken_.assign(left_.size(), 0);
  if (left_.size() < static_cast<std::size_t>(request_.designs_size()))
    return left_.empty() ? DeformOutcome() : ask_for_rest(send);
  if (!sink_) return send(request_, {}, memory_);
  const DesignSink sink = [this](std::size_t design, DeformedDesign&& deformed) {
    hand_over(design, design, std::move(deformed));
  };
  return send(request_, sink, memory_);
}

DeformOutcome UnfinishedDesigns::ask_for_rest(const Send& send) {
  v1::DeformRequest part = request_;
  part.clear_designs();
  for (const std::size_t place : left_) *part.add_designs() = request_.designs(static_cast<int>(place));
  const DesignSink sink = [this](std::size_t design, DeformedDesign&& deformed) {
    deformed.result.set_design(static_cast<std::uint32_t>(left_[design]));
    if (deformed.error) {
      const Error& error = *deformed.error;
      deformed.error.emplace(error.code(), with_places(error.what(), left_), error.retry_after_ms());
    }
    hand_over(design, left_[design], std::move(deformed));
  };
  const DesignMemory memory = !memory_ ? DesignMemory() : [this](std::size_t design) { return memory_(left_[design]); };
  try {
    return send(part, sink, memory);
  } catch (const Error& error) {
    const std::string message = with_places(error.what(), left_);
    if (message == error.what()) throw;
    throw_reworded(error, message);
  }
}

void UnfinishedDesigns::hand_over(std::size_t sent, std::size_t place, DeformedDesign&& deformed) {
  taken_[sent] = 1;
  refused_ = true;
  sink_(place, std::move(deformed));
  refused_ = false;
}

Repeat UnfinishedDesigns::repeat() const {
  if (refused_) return Repeat::no;
  const bool some = std::find(taken_.begin(), taken_.end(), 1) != taken_.end();
  const bool rest = left_.size() < static_cast<std::size_t>(request_.designs_size());
  if ((some || rest) && request_.warm_start()) return Repeat::no;
  return some ? Repeat::afresh : Repeat::yes;
}

std::string with_places(const std::string& message, const std::vector<std::size_t>& places) {
  constexpr std::string_view start = "designs[";
  const auto found = message.find(start);
  if (found == std::string::npos) return message;
  const char* digits = message.data() + found + start.size();
  std::size_t design = 0;
  const auto [end, failure] = std::from_chars(digits, message.data() + message.size(), design);
  if (failure != std::errc() || design >= places.size()) return message;
  const std::size_t place = places[design];
  return message.substr(0, found + start.size()) + std::to_string(place) + std::string(end, message.data() + message.size());
}

}  // namespace deform::client

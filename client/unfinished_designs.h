// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <functional>
#include <string>
#include <vector>

#include "client/client.h"
#include "client/retry.h"

namespace deform::client {

/// The designs of a request that its sink has not taken yet. An attempt after the first one asks for these only, by their places
/// among them, which remain internal: sink, memory and errors see the places in the request. One thread.
class UnfinishedDesigns {
 public:
  /// All of it. What it is given must outlive it; without a sink nothing is ever taken.
  UnfinishedDesigns(const v1::DeformRequest& request, const DesignSink& sink, const DesignMemory& memory);

  /// One attempt: sends what is left, whose designs go to the sink and, with memory, into it.
  using Send = std::function<DeformOutcome(const v1::DeformRequest& part, const DesignSink& sink, const DesignMemory& memory)>;
  /// Makes one. Nothing left (the connection was lost before the summary): an outcome without a summary.
  DeformOutcome ask(const Send& send);
  /// What follows an attempt that failed. Designs that depend on those before them are not taken out of their row.
  Repeat repeat() const;

 private:
  DeformOutcome ask_for_rest(const Send& send);
  void hand_over(std::size_t sent, std::size_t place, DeformedDesign&& deformed);

  const v1::DeformRequest& request_;
  const DesignSink& sink_;
  const DesignMemory& memory_;
  std::vector<std::size_t> left_;  ///< places in the request
  std::vector<char> taken_;        ///< of left_, by this attempt; the sink is called from one thread at a time
  bool refused_ = false;           ///< the sink threw: its error is the end
};

/// The message with the places of designs in the whole request, in place of those among the ones that were sent ("designs[0]").
std::string with_places(const std::string& message, const std::vector<std::size_t>& places);

}  // namespace deform::client

#include <cstring>

#include "client/client.h"
#include "client/connection.h"
#include "client/retry.h"
#include "core/base/error.h"

namespace deform::client {

namespace {

void append(const std::string& bytes, std::vector<std::uint32_t>& ids) {
  if (bytes.size() % sizeof(std::uint32_t) != 0) throw Error(ErrorCode::data_loss, "detect: ids are cut off");
  const std::size_t before = ids.size();
  ids.resize(before + bytes.size() / sizeof(std::uint32_t));
  if (!bytes.empty()) std::memcpy(ids.data() + before, bytes.data(), bytes.size());
}

/// Puts replies together in the order of detection.proto.
class Collector {
 public:
  void take(v1::DetectReply& reply) {
    if (complete_) throw Error(ErrorCode::data_loss, "detect: something came after the summary");
    switch (reply.part_case()) {
      case v1::DetectReply::kPrimitive:
        detected_.primitives.push_back({std::move(*reply.mutable_primitive()), {}, {}});
        return;
      case v1::DetectReply::kEdge:
        detected_.edges.push_back({std::move(*reply.mutable_edge()), {}});
        return;
      case v1::DetectReply::kIds:
        return take_ids(reply.ids());
      case v1::DetectReply::kSummary:
        detected_.summary = std::move(*reply.mutable_summary());
        complete_ = true;
        return;
      case v1::DetectReply::PART_NOT_SET:
        return;  // of a newer server
    }
  }

  Detected result() {
    if (!complete_) throw Error(ErrorCode::data_loss, "detect: the reply has no summary");
    for (const auto& primitive : detected_.primitives) {
      check(primitive.about.name(), primitive.faces.size(), primitive.about.faces());
      check(primitive.about.name(), primitive.points.size(), primitive.about.points());
    }
    for (const auto& edge : detected_.edges) check(edge.about.name(), edge.points.size(), edge.about.points());
    return std::move(detected_);
  }

 private:
  void take_ids(const v1::DetectedIds& ids) {
    const bool faces = ids.of() == v1::DetectedIds::FACES;
    if (!detected_.edges.empty() && !faces) return append(ids.ids(), detected_.edges.back().points);
    if (detected_.primitives.empty() || !detected_.edges.empty()) {
      throw Error(ErrorCode::data_loss, "detect: ids of nothing");
    }
    append(ids.ids(), faces ? detected_.primitives.back().faces : detected_.primitives.back().points);
  }

  static void check(const std::string& name, std::size_t arrived, std::uint64_t announced) {
    if (arrived == announced) return;
    throw Error(ErrorCode::data_loss,
                "detect: " + std::to_string(arrived) + " of " + std::to_string(announced) + " ids of " + name + " arrived");
  }

  Detected detected_;
  bool complete_ = false;
};

}  // namespace

Detected Client::detect(const v1::DetectRequest& request, const CallOptions& call) {
  return with_retries(*impl_, call, Retry::safe, [&](Attempt& attempt, const RunContext&) {
    const auto stream = impl_->stub->Detect(&attempt.context, request);
    Collector collector;
    v1::DetectReply reply;
    while (stream->Read(&reply)) collector.take(reply);
    attempt.check(stream->Finish());
    return collector.result();
  });
}

}  // namespace deform::client

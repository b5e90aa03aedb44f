#include "proto/convert/detection.h"
#include "server/engine/engine_impl.h"
#include "server/engine/outcome_call.h"
#include "server/store/geometry_file.h"

namespace deform::server {

namespace {

/// What detecting on a mesh takes at most beside the mesh.
std::size_t detect_bytes(const Mesh& mesh) {
  return 600 * mesh.face_count() + 200 * mesh.point_count() + 64 * mesh.face_points.size();
}

}  // namespace

void EngineImpl::detect(const v1::DetectRequest& request, const CallContext& call,
                        std::function<void(Outcome<DetectReplies>)> on_done) {
  check_open();
  const DetectOptions options = convert::detect_options(request);
  if (request.geometry_id().empty()) throw Error(ErrorCode::invalid_argument, "geometry_id: must not be empty");
  const std::string geometry = store_.resolve_geometry(request.geometry_id());
  OutcomeCall<DetectReplies>::Task task;
  task.compute = [this, options, geometry](const SystemCache::Handle&, const RunContext& context) -> DetectReplies {
    const auto from = RunContext::Clock::now();
    const auto mesh = meshes_.get(geometry);
    const Charge charge = memory_.charge(detect_bytes(*mesh), {"detecting primitives of geometry " + geometry.substr(0, 16),
                                                               "raise the server's memory budget", mesh_bytes(*mesh)});
    std::vector<v1::DetectReply> replies = convert::detect_replies(deform::detect(*mesh, options, context));
    replies.back().mutable_summary()->set_seconds(elapsed_ms(from) * 1e-3);
    return std::make_shared<const std::vector<v1::DetectReply>>(std::move(replies));
  };
  task.on_done = std::move(on_done);
  using DetectCall = OutcomeCall<DetectReplies>;
  std::make_shared<DetectCall>(DetectCall::Parts{&scheduler_, cache_.get(), &calls_}, std::move(task), call)->begin();
}

}  // namespace deform::server

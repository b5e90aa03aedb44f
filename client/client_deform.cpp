#include <algorithm>
#include <atomic>
#include <future>
#include <utility>

#include "client/client.h"
#include "client/connection.h"
#include "client/decoder.h"
#include "client/session.h"
#include "client/upload.h"

namespace deform::client {

namespace {

/// A running reply stream of Deform or JacobianVector, read to its end into a decoder.
template <typename Reader>
DeformOutcome read_replies(Attempt& attempt, Reader& stream, ReplyDecoder& decoder, std::future<DeformOutcome> done) {
  v1::DeformReply reply;
  std::exception_ptr error;
  while (!error && stream.Read(&reply)) {
    try {
      decoder.add(std::move(reply));
    } catch (...) {
      error = std::current_exception();
      attempt.context.TryCancel();
    }
  }
  while (error && stream.Read(&reply)) {  // to the end: Finish() wants nothing unread
  }
  const grpc::Status status = stream.Finish();
  try {
    if (error) std::rethrow_exception(error);
    attempt.check(status);
    if (!decoder.complete()) throw Error(ErrorCode::data_loss, "reply of the server: it ends before its summary");
  } catch (...) {
    decoder.fail(std::current_exception());
  }
  return done.get();
}

struct Decoding {
  std::shared_ptr<ReplyDecoder> decoder;
  std::future<DeformOutcome> done;
};

Decoding start_decoding(ReplyDecoder::Options options, Attempt& attempt, DecodePool& pool) {
  auto promise = std::make_shared<std::promise<DeformOutcome>>();
  Decoding result;
  result.done = promise->get_future();
  options.on_failed = [&attempt] { attempt.context.TryCancel(); };
  options.on_done = [promise](DeformOutcome&& outcome, const std::exception_ptr& error) {
    error ? promise->set_exception(error) : promise->set_value(std::move(outcome));
  };
  result.decoder = std::make_shared<ReplyDecoder>(std::move(options), pool);
  return result;
}

}  // namespace

DeformOutcome Client::deform(const v1::DeformRequest& request, const CallOptions& call, const DesignSink& sink) {
  std::atomic<bool> delivered{false};
  const auto may_repeat = [&] { return !delivered; };
  const DesignSink watched = !sink ? DesignSink() : [&](std::size_t design, DeformedDesign&& deformed) {
    delivered = true;
    sink(design, std::move(deformed));
  };
  if (request.ByteSizeLong() > message_payload) {
    return with_retries(
        *impl_, call, Retry::safe,
        [&](Attempt&, const RunContext& limits) {
          Session::Impl session(impl_, remaining(limits));
          auto future = session.submit(request, watched);
          session.finish();
          return future.get();
        },
        may_repeat);
  }
  return with_retries(
      *impl_, call, Retry::safe,
      [&](Attempt& attempt, const RunContext& limits) {
        ReplyDecoder::Options options;
        options.designs = static_cast<std::size_t>(request.designs_size());
        options.encoding = request.output().encoding();
        options.failures = request.failures();
        options.sink = watched;
        options.points_of = [&](const std::string& id) { return impl_->registered_points(id, limits); };
        Decoding decoding = start_decoding(std::move(options), attempt, impl_->pool);
        const auto stream = impl_->stub->Deform(&attempt.context, request);
        return read_replies(attempt, *stream, *decoding.decoder, std::move(decoding.done));
      },
      may_repeat);
}

Points Client::jacobian_vector(const v1::JacobianVectorRequest& request, const CallOptions& call) {
  return with_retries(*impl_, call, Retry::safe, [&](Attempt& attempt, const RunContext& limits) {
    ReplyDecoder::Options options;
    options.encoding = v1::RAW_F64;
    options.points_of = [&](const std::string& id) { return impl_->registered_points(id, limits); };
    Decoding decoding = start_decoding(std::move(options), attempt, impl_->pool);
    const auto stream = impl_->stub->JacobianVector(&attempt.context, request);
    DeformOutcome outcome = read_replies(attempt, *stream, *decoding.decoder, std::move(decoding.done));
    return std::move(outcome.designs.at(0).points);
  });
}

namespace {

bool write_cotangent(grpc::ClientWriterInterface<v1::VectorJacobianRequest>& stream, std::span<const Vec3> cotangent) {
  constexpr std::size_t points = message_payload / sizeof(Vec3);
  v1::VectorJacobianRequest message;
  for (std::size_t first = 0; first < cotangent.size(); first += points) {
    const auto piece = cotangent.subspan(first, std::min(points, cotangent.size() - first));
    message.mutable_cotangent()->assign(reinterpret_cast<const char*>(piece.data()), piece.size_bytes());
    if (!stream.Write(message)) return false;
  }
  return true;
}

}  // namespace

std::vector<double> Client::vector_jacobian(const std::string& system_id, std::span<const double> variables,
                                            std::span<const Vec3> cotangent, const CallOptions& call) {
  return with_retries(*impl_, call, Retry::safe, [&](Attempt& attempt, const RunContext&) {
    v1::VectorJacobianReply reply;
    const auto stream = impl_->stub->VectorJacobian(&attempt.context, &reply);
    v1::VectorJacobianRequest message;
    message.mutable_header()->set_system_id(system_id);
    message.mutable_header()->mutable_variables()->Add(variables.begin(), variables.end());
    if (stream->Write(message)) write_cotangent(*stream, cotangent);
    stream->WritesDone();
    attempt.check(stream->Finish());
    return std::vector<double>(reply.gradient().begin(), reply.gradient().end());
  });
}

}  // namespace deform::client

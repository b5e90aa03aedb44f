// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <future>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "client/call_error.h"
#include "core/base/error.h"
#include "core/base/run_context.h"
#include "core/base/types.h"
#include "core/codec/geometry_id.h"
#include "deform/v1/service.pb.h"

namespace grpc {
class ChannelInterface;
}

namespace deform::client {

/// TLS to a server. Files in PEM, read when the client is made.
struct TlsOptions {
  std::filesystem::path ca;    ///< authorities to trust; empty: those that this machine trusts
  std::filesystem::path cert;  ///< the client's certificate, and then those between it and its authority; empty: none
  std::filesystem::path key;   ///< its private key, without a passphrase
  std::string server_name;     ///< that the server's certificate must have; empty: the host of the address
};

/// How to reach a server.
struct ClientOptions {
  /// HOST:PORT, [IPv6]:PORT or unix:PATH. Several with commas: each geometry and its systems are on one of them, and on the next
  /// one when that cannot be reached; the client keeps the arrays that it has registered and the setups that it has prepared, and
  /// brings them to a server that lacks them.
  std::string address = "127.0.0.1:50051";
  /// One address stands for several servers: a proxy before them, or a name of many machines. The client keeps copies and brings
  /// them to a server that lacks them, as with several addresses.
  bool replicas = false;
  std::chrono::milliseconds connect_timeout{5000};  ///< of one attempt to connect; with several addresses at most 2 s
  /// Attempts of calls that are safe to retry, for UNAVAILABLE and for RESOURCE_EXHAUSTED with a retry hint; of any call to
  /// connect. With several servers UNAVAILABLE counts when all of them have been tried. With `replicas` twice as many: the proxy
  /// has to notice first that a server is gone.
  int max_attempts = 4;
  /// How long, from the first failure of a call, attempts go on beyond max_attempts while no server can be reached, or it refuses
  /// and says when to come back. Absent: 30 s once this client has had an answer, so that a restart of the server ends nothing,
  /// and 0 before, so that a wrong address is an error at once. At most a week.
  std::optional<std::chrono::milliseconds> patience = std::nullopt;
  /// Called with why before a call waits for a server that cannot be reached, by its thread, so several may at once. Must not
  /// throw.
  std::function<void(const Error&)> on_wait = {};
  int decode_threads = 0;  ///< 0 = all cores
  /// The encoding of requests that name none (their tolerance applies to it). ENCODING_DEFAULT: RAW_F64 when `address` is a unix
  /// socket or a loopback address (each of several), else DELTA_ZSTD.
  v1::Encoding encoding = v1::ENCODING_DEFAULT;
  int max_in_flight = 16;                        ///< open requests of one Session; submit() blocks beyond it
  std::optional<TlsOptions> tls = std::nullopt;  ///< absent: plain text
  /// File with a token that says who calls, sent with every call and read for each, so that it may be replaced. Without TLS only
  /// to a unix socket or a loopback address.
  std::filesystem::path token_file = {};
  std::uint64_t retry_seed = 1;  ///< of the jitter in waiting times before another attempt; give clients different ones

  /// Throws Error(invalid_argument) naming the option and its limits.
  void validate() const;
};

/// Per call. The deadline travels to the server and reaches its computations; so does a stop.
struct CallOptions {
  std::optional<std::chrono::milliseconds> timeout;  ///< of the whole call, all attempts together; absent: no limit
  std::stop_token stop;                              ///< ends the call with Error(cancelled) when stopped
};

/// Whether SystemInfo::setup is wanted: in canonical form, and about as large as the setup that was sent.
enum class SetupInInfo {
  include,  ///< of setups above about 1 MB by a call of its own
  omit      ///< less to send
};

/// Plain arrays of a geometry; must stay alive during the call.
struct GeometryArrays {
  std::span<const Vec3> points;                ///< n x 3
  std::span<const std::uint32_t> face_sizes;   ///< f
  std::span<const std::uint32_t> face_points;  ///< sum of face_sizes
  std::vector<codec::GroupView> groups;        ///< named points and faces
  std::string name;                            ///< label
  CellsView cells = {};                        ///< of a volume mesh
};

/// One deformed design.
struct DeformedDesign {
  Points points;            ///< n x 3, registered order; empty when there is an error
  v1::DesignResult result;  ///< the server's report on the design
  /// Why there is no deformation: of requests with FAILURES_PER_DESIGN only, whose sender looks here. Without, a design that
  /// cannot be evaluated fails its request, and the call throws.
  std::optional<Error> error = std::nullopt;
};

/// The answer to one request.
struct DeformOutcome {
  std::vector<DeformedDesign> designs;  ///< in order of the request; empty when a sink took them
  v1::DeformSummary summary;            ///< the server's times and notes
  double decode_ms = 0;                 ///< core time
  double wall_ms = 0;                   ///< from the call to the last decoded point
};

/// Called once per finished design, from one thread at a time, in order of completion; may move the points out.
using DesignSink = std::function<void(std::size_t design, DeformedDesign&& deformed)>;

/// Memory for the points of a design, one for each registered point, which stays valid until the call ends; another one of the
/// same design may be asked for when the call is repeated. Called from any thread, of several designs at once.
using DesignMemory = std::function<std::span<Vec3>(std::size_t design)>;

/// Fills the block with points and returns their number; 0: there are no more. Called from a thread of its own.
using PointSource = std::function<std::size_t(std::span<Vec3> block)>;
/// Points in the order of the source; `first` is the number of the first one. Called from the thread that made the call.
using PointSink = std::function<void(std::uint64_t first, std::span<const Vec3> points)>;

/// Primitives and edges of a geometry. Ids as they came; those of an edge in order along it.
struct Detected {
  /// A plane, cylinder, sphere or cone.
  struct Primitive {
    v1::DetectedPrimitive about;  ///< kind, parameters and residuals
    std::vector<FaceId> faces;    ///< that lie on it
    std::vector<PointId> points;  ///< corners of these faces
  };
  /// A straight or circular stretch of sharp edges.
  struct Edge {
    v1::DetectedEdge about;       ///< kind, parameters and residuals
    std::vector<PointId> points;  ///< in order along it
  };
  std::vector<Primitive> primitives;  ///< in the order of the server
  std::vector<Edge> edges;            ///< in the order of the server
  v1::DetectSummary summary;          ///< what the automatic options became, and how much of the surface was covered
};

class Session;
class RequestSession;

/// A connection to deformd, or to several. Thread-safe: any number of threads may call at once. All errors are deform::Error with
/// the server's message. Checksums of blocks and designs are always verified.
///
///   register_geometry -> prepare -> deform ... deform -> release_system
class Client {
 public:
  /// Connects with the first call. Throws Error(invalid_argument) for options and the files they name.
  explicit Client(const ClientOptions& options = {});
  /// Over an existing channel (in-process tests, own credentials). The address of the options is not connected to, but `encoding`
  /// still follows it.
  Client(std::shared_ptr<grpc::ChannelInterface> channel, const ClientOptions& options);
  ~Client();
  /// Moves the connection; a client that was moved from may only be destroyed or assigned to.
  Client(Client&&) noexcept;
  /// Moves the connection, as the constructor does.
  Client& operator=(Client&&) noexcept;

  /// Uploads unless the server already has it. on_progress: fraction sent.
  v1::GeometryInfo register_geometry(const GeometryArrays& arrays, const CallOptions& call = {},
                                     const std::function<void(double)>& on_progress = {});
  /// One geometry by its id or a unique prefix of at least 8 digits. Throws Error(not_found).
  v1::GeometryInfo get_geometry(const std::string& id, const CallOptions& call = {});
  /// All geometries, the newest first; of several servers one after the other, and each once. Throws Error(unavailable) when one
  /// of them cannot be reached.
  std::vector<v1::GeometryInfo> list_geometries(const CallOptions& call = {});
  /// Deletes a geometry, at all servers that have it. Throws Error(failed_precondition) when setups refer to it and are not to be
  /// deleted too.
  v1::DeleteGeometryReply delete_geometry(const v1::DeleteGeometryRequest& request, const CallOptions& call = {});
  /// The registered points, n x 3, in order.
  Points get_points(const std::string& geometry_id, const CallOptions& call = {});

  /// Planes, cylinders, spheres, cones and sharp edges of a registered geometry.
  Detected detect(const v1::DetectRequest& request, const CallOptions& call = {});

  /// Validates a setup and says what preparing it would cost; allocates nothing large on the server.
  v1::EstimateReply estimate(const v1::Setup& setup, const CallOptions& call = {});
  /// The same, with the options of the request.
  v1::EstimateReply estimate(const v1::EstimateRequest& request, const CallOptions& call = {});
  /// Stores the setup and prepares its system, or answers at once when it is in memory. on_progress: stage and fraction of it.
  v1::SystemInfo prepare(const v1::Setup& setup, const CallOptions& call = {},
                         const std::function<void(const std::string& stage, double fraction)>& on_progress = {},
                         SetupInInfo in_info = SetupInInfo::include);
  /// One system by its id or a unique prefix of at least 8 digits. Throws Error(not_found).
  v1::SystemInfo get_system(const std::string& id, const CallOptions& call = {}, SetupInInfo in_info = SetupInInfo::include);
  /// The canonical setup of a system. Throws Error(not_found).
  v1::Setup get_setup(const std::string& system_id, const CallOptions& call = {});
  /// All systems whose setups are stored, in memory or not.
  std::vector<v1::SystemInfo> list_systems(const CallOptions& call = {}, SetupInInfo in_info = SetupInInfo::include);
  /// Gives the memory of a system back, and deletes its setup when the request says so; at all servers that have it.
  v1::ReleaseSystemReply release_system(const v1::ReleaseSystemRequest& request, const CallOptions& call = {});

  /// What requests that name no encoding are sent with: never ENCODING_DEFAULT.
  v1::Encoding encoding() const;

  /// Deforms. With request.failures() = FAILURES_PER_DESIGN a bad design has an error of its own (DeformedDesign::error) and the
  /// others are there; else it is thrown, and there are none. The registered points are needed to decode: they are fetched once
  /// per geometry and kept, unless given through keep_points(). Requests above 1 MiB go over a stream of their own. With `memory`
  /// points are decoded into it, and DeformedDesign::points stays empty; Error(invalid_argument) when it is of another size.
  DeformOutcome deform(const v1::DeformRequest& request, const CallOptions& call = {}, const DesignSink& sink = {},
                       const DesignMemory& memory = {});

  /// Hands over registered points, so that they need not be fetched.
  void keep_points(const std::string& geometry_id, std::shared_ptr<const Points> points);

  /// Holds the copies of geometries and setups that another client holds now, in the same memory: for several connections of a
  /// process, of which one registers and prepares. Without `replicas` or several addresses there are none.
  void share_copies(const Client& from);

  /// One design at points that were never registered (deformation.proto, Evaluate): model units, n x 3 in and out. `out` has the
  /// size of `points` and may be the same memory. Throws Error(failed_precondition) with the reason for methods that are defined
  /// at the points of their geometry only, Error(invalid_argument) naming points[i].
  v1::EvaluateResult evaluate(const v1::EvaluateHeader& header, std::span<const Vec3> points, std::span<Vec3> out,
                              const CallOptions& call = {});
  /// The same for points that come in blocks, of which a few are in memory at once. The source is asked
  /// when the server has accepted the design; after that the call is not repeated. What source or sink throws cancels the call
  /// and is thrown.
  v1::EvaluateResult evaluate(const v1::EvaluateHeader& header, const PointSource& source, const PointSink& sink,
                              const CallOptions& call = {});

  /// d(points)/d(variables) times a direction: n x 3.
  Points jacobian_vector(const v1::JacobianVectorRequest& request, const CallOptions& call = {});
  /// d(points)/d(variables)^T times a field on the points (n x 3): one value per variable.
  std::vector<double> vector_jacobian(const std::string& system_id, std::span<const double> variables,
                                      std::span<const Vec3> cotangent, const CallOptions& call = {});

  /// The same for many fields, one after the other (each n x 3), with one solution of the adjoint equations: for each of them one
  /// value per variable, row by row. Throws Error(invalid_argument) if `cotangents` is not a multiple of `count`.
  std::vector<double> vector_jacobians(const std::string& system_id, std::span<const double> variables,
                                       std::span<const Vec3> cotangents, std::size_t count, const CallOptions& call = {});

  /// The bytes of the compiled deformation of a system, in order, as they arrive: pieces that hold whole records (see
  /// core/compiled/reader.h for what checks them). Throws Error(failed_precondition) with the reason where a system cannot be
  /// compiled, and does not repeat the call once a piece has been handed over.
  v1::BasisHeader get_basis(const std::string& system_id, const std::function<void(std::span<const std::byte>)>& sink,
                            const CallOptions& call = {});
  /// The same, with the name of the mesh that is to stand in it.
  v1::BasisHeader get_basis(const v1::GetBasisRequest& request, const std::function<void(std::span<const std::byte>)>& sink,
                            const CallOptions& call = {});

  /// Version, load, memory, cache, store and limits of the server; of several, the first one that answers.
  v1::ServerInfo server_info(const CallOptions& call = {});

  /// The pipelined stream for optimizers.
  std::unique_ptr<Session> open_session(const CallOptions& call = {});

 private:
  friend class Admin;
  friend class Session;
  struct Impl;
  std::shared_ptr<Impl> impl_;
};

/// Requests over one bidirectional stream (to each of several servers): submit as many as wanted, answers come in any order.
/// Thread-safe. Destroying the session cancels what is still open.
class Session {
 public:
  ~Session();
  /// Returns at once (or blocks while `max_in_flight` requests are open). The future throws Error.
  std::future<DeformOutcome> submit(const v1::DeformRequest& request);
  /// Half-closes and waits for the open requests.
  void finish();

 private:
  friend class Client;
  explicit Session(std::unique_ptr<RequestSession> requests);
  std::unique_ptr<RequestSession> requests_;
};

/// Whether gRPC is at work in this process, as it is while there is a Client or a session of one. It does not survive fork(): a
/// child that is forked meanwhile must not use gRPC, nor destroy what uses it. Thread-safe.
bool grpc_at_work();

}  // namespace deform::client

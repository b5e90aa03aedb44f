// SPDX-License-Identifier: Apache-2.0
// The parent sends a request through a file in memory, which becomes the child's standard input, and reads the answer from a
// pipe. The mesh file itself is the temporary file that the libraries need anyway: the child opens it by its name.

#include "core/io/formats/containers/isolated_library.h"

#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <functional>
#include <limits>
#include <new>

#include "core/base/error.h"
#include "core/io/assembly/mesh_stream.h"
#include "core/io/binary/byte_stream.h"
#include "core/io/formats/containers/isolated_process.h"

namespace deform::io {

namespace {

constexpr std::uint64_t request_mark = 0x6465666f726d2031;  // first word of requests and answers
constexpr std::uint64_t answer_mark = 0x6465666f726d2032, end_mark = 0x6465666f726d2033;
enum Task : std::uint64_t { task_read, task_overwrite };
enum Outcome : std::uint64_t { done, failed };

/// The limits for a file of this size: far more than any mesh needs, but not the whole machine.
struct Limits {
  std::uint64_t memory_bytes, processor_seconds;

  static Limits of(std::size_t bytes) {
    constexpr std::uint64_t room = std::uint64_t{2} << 30, per_byte = 64;  // for compressed arrays and the mesh built from them
    constexpr std::uint64_t seconds = 60, bytes_per_second = 1 << 18;
    const auto machine =
        static_cast<std::uint64_t>(::sysconf(_SC_PHYS_PAGES)) * static_cast<std::uint64_t>(::sysconf(_SC_PAGESIZE));
    return {std::min(machine, room + per_byte * bytes), seconds + bytes / bytes_per_second};
  }
};

struct Request {
  Task task = task_read;
  Format format{};
  std::string name, path;
  std::size_t bytes = 0;
  Limits limits{};
  std::string layout;
  Points points;
};

const ContainerLibrary& library_of(const Request& request) { return *reader_of(request.format).library; }

std::string task_text(const Request& request) {
  return request.task == task_read ? "while reading it" : "while writing its points";
}

void write_all(int descriptor, std::string_view bytes) {
  while (!bytes.empty()) {
    const ssize_t written = ::write(descriptor, bytes.data(), bytes.size());
    if (written < 0 && errno == EINTR) continue;
    if (written < 0) throw Error(ErrorCode::out_of_budget, std::string("passing on a mesh: ") + std::strerror(errno));
    bytes.remove_prefix(static_cast<std::size_t>(written));
  }
}

// ---- the parent ----

/// A request as a file without a name.
class RequestFile {
 public:
  RequestFile(const Request& request, std::span<const Vec3> points) : descriptor_(::memfd_create("deform-request", MFD_CLOEXEC)) {
    if (descriptor_ < 0) throw Error(ErrorCode::out_of_budget, std::string("passing on a request: ") + std::strerror(errno));
    ByteWriter to([this](std::string_view bytes) { write_all(descriptor_, bytes); });
    for (const std::uint64_t number :
         {request_mark, std::uint64_t{request.task}, static_cast<std::uint64_t>(request.format), std::uint64_t{request.bytes},
          request.limits.memory_bytes, request.limits.processor_seconds}) {
      to.number(number);
    }
    to.text(request.name);
    to.text(request.path);
    to.text(request.layout);
    to.array(points);
    to.flush();
    ::lseek(descriptor_, 0, SEEK_SET);
  }
  ~RequestFile() { ::close(descriptor_); }
  RequestFile(const RequestFile&) = delete;
  RequestFile& operator=(const RequestFile&) = delete;
  int descriptor() const { return descriptor_; }

 private:
  const int descriptor_;
};

/// Why there is no whole answer.
[[noreturn]] void explain(const Request& request, const std::optional<int>& status, const std::string& found) {
  const std::string begin = request.name + ": ", library = library_of(request).name;
  if (status && WIFSIGNALED(*status)) {
    const int signal = WTERMSIG(*status);
    const std::string number = " (signal " + std::to_string(signal) + ")";
    if (signal == SIGINT || signal == SIGTERM || signal == SIGHUP || signal == SIGQUIT) {
      throw Error(ErrorCode::cancelled, begin + "interrupted");
    }
    if (signal == SIGXCPU) {
      throw Error(ErrorCode::invalid_argument, begin + library + " took more than " +
                                                   std::to_string(request.limits.processor_seconds) + " s of processor time " +
                                                   task_text(request) + "; the file is damaged");
    }
    if (signal == SIGKILL && found.empty()) {
      throw Error(ErrorCode::out_of_budget, begin + "the process of " + library + " was killed " + task_text(request) + number +
                                                "; perhaps there was not enough memory");
    }
    if (signal != SIGKILL) {
      throw Error(ErrorCode::invalid_argument,
                  begin + library + " crashed " + task_text(request) + number + "; the file is damaged");
    }
  }
  if (status && WIFEXITED(*status) && WEXITSTATUS(*status) != 0) {
    throw Error(ErrorCode::internal, begin + "the process of " + library + " ended " + task_text(request) + " (exit code " +
                                         std::to_string(WEXITSTATUS(*status)) + ")");
  }
  throw Error(ErrorCode::data_loss,
              begin + "the process of " + library + " gave no mesh " + task_text(request) + (found.empty() ? "" : ": " + found));
}

/// Sends a request, passes the answer to `receive`, and rethrows the error of the child.
void ask(const Request& request, std::span<const Vec3> points, const ReadOptions& options,
         const std::function<void(ByteReader&)>& receive) {
  const RequestFile file(request, points);
  IsolatedProcess process(options.isolated_reader, file.descriptor());
  bool ended = false;
  ByteReader answer(
      [&](char* to, std::size_t size) {
        const std::size_t got = process.read(to, size, options.stop);
        ended = got == 0;
        return got;
      },
      request.limits.memory_bytes);
  std::optional<Error> thrown;
  try {
    if (answer.number() != answer_mark) throw Error(ErrorCode::data_loss, "it does not begin as an answer");
    if (answer.number() == failed) {
      const std::uint64_t code = std::min<std::uint64_t>(answer.number(), static_cast<std::uint64_t>(ErrorCode::internal));
      thrown.emplace(static_cast<ErrorCode>(code), answer.text());
    } else {
      receive(answer);
    }
    if (answer.number() != end_mark) throw Error(ErrorCode::data_loss, "it does not end as an answer");
  } catch (const Error& error) {
    if (error.code() == ErrorCode::cancelled) throw Error(ErrorCode::cancelled, request.name + ": " + error.what());
    explain(request, process.end(), ended ? "" : error.what());
  }
  if (thrown) throw Error(*thrown);
}

// ---- the child ----

Request received() {
  ByteReader from(
      [](char* to, std::size_t size) {
        const ssize_t got = ::read(STDIN_FILENO, to, size);
        return got > 0 ? static_cast<std::size_t>(got) : 0;
      },
      std::numeric_limits<std::uint64_t>::max());
  Request request;
  if (from.number() != request_mark) throw Error(ErrorCode::data_loss, "this is no request");
  request.task = static_cast<Task>(from.number());
  request.format = static_cast<Format>(from.number());
  request.bytes = static_cast<std::size_t>(from.number());
  request.limits.memory_bytes = from.number();
  request.limits.processor_seconds = from.number();
  request.name = from.text();
  request.path = from.text();
  request.layout = from.text();
  request.points = from.array<Vec3>();
  return request;
}

void limit(__rlimit_resource resource, std::uint64_t soft, std::uint64_t hard) {
  rlimit allowed{};
  ::getrlimit(resource, &allowed);
  allowed.rlim_max = std::min<rlim_t>(allowed.rlim_max, hard);
  allowed.rlim_cur = std::min<rlim_t>(allowed.rlim_max, soft);
  ::setrlimit(resource, &allowed);
}

/// The address space of the program with its libraries, in bytes.
std::uint64_t address_space() {
  std::uint64_t pages = 0;
  if (std::FILE* file = std::fopen("/proc/self/statm", "r")) {
    unsigned long long size = 0;
    if (std::fscanf(file, "%llu", &size) == 1) pages = size;
    std::fclose(file);
  }
  return pages * static_cast<std::uint64_t>(::sysconf(_SC_PAGESIZE));
}

void limit_this_process(const Request& request) {
  ::prctl(PR_SET_PDEATHSIG, SIGKILL);  // no one is waiting for the answer then
  std::signal(SIGXFSZ, SIG_IGN);       // an error of writing instead
  constexpr std::uint64_t grace_seconds = 5;
  const std::uint64_t space = address_space() + request.limits.memory_bytes;
  const std::uint64_t seconds = request.limits.processor_seconds, file = largest_rewritten(request.bytes);
  limit(RLIMIT_AS, space, space);
  limit(RLIMIT_CPU, seconds, seconds + grace_seconds);
  limit(RLIMIT_FSIZE, file, file);
  limit(RLIMIT_CORE, 0, 0);
}

void answer(const Request& request, ByteWriter& to) {
  ContainerFile file = ContainerFile::of_other_process(request.path);
  ContainerMesh content;
  if (request.task == task_read) {
    content = library_of(request).read(file, request.bytes, request.name);
  } else {
    library_of(request).overwrite(file, request.bytes, request.name, request.layout, request.points);
  }
  to.number(answer_mark);
  to.number(done);
  if (request.task == task_read) {
    write_mesh(*content.mesh, to);
    to.text(content.layout);
    to.number(content.flat ? 1 : 0);
  }
}

void answer_with_error(ErrorCode code, const std::string& message, ByteWriter& to) {
  to.number(answer_mark);
  to.number(failed);
  to.number(static_cast<std::uint64_t>(code));
  to.text(message);
}

}  // namespace

ContainerMesh IsolatedLibrary::read(const ContainerFile& file, std::size_t bytes, const std::string& name) const {
  ContainerMesh content;
  ask({task_read, format_, name, file.path(), bytes, Limits::of(bytes), {}, {}}, {}, options_, [&](ByteReader& from) {
    content.mesh = std::make_shared<const Mesh>(read_mesh(from));
    content.layout = from.text();
    content.flat = from.number() != 0;
  });
  return content;
}

void IsolatedLibrary::overwrite(const ContainerFile& file, std::size_t bytes, const std::string& name, const std::string& layout,
                                std::span<const Vec3> points) const {
  ask({task_overwrite, format_, name, file.path(), bytes, Limits::of(bytes + points.size_bytes()), layout, {}}, points, options_,
      [](ByteReader&) {});
}

int serve_isolated_reader() {
  Request request;
  try {
    request = received();
  } catch (const Error&) {
    return 2;
  }
  limit_this_process(request);
  ByteWriter to([](std::string_view bytes) { write_all(STDOUT_FILENO, bytes); });
  try {
    answer(request, to);
  } catch (const Error& error) {
    answer_with_error(error.code(), error.what(), to);
  } catch (const std::bad_alloc&) {
    answer_with_error(ErrorCode::invalid_argument,
                      request.name + ": reading it takes more than " + std::to_string(request.limits.memory_bytes >> 20) +
                          " MiB of memory; the file is damaged",
                      to);
  }
  to.number(end_mark);
  to.flush();
  return 0;
}

}  // namespace deform::io

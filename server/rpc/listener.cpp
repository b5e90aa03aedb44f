// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/rpc/listener.h"

#include <fcntl.h>
#include <netdb.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <spdlog/spdlog.h>
#include <sys/eventfd.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cstring>
#include <memory>
#include <span>
#include <utility>
#include <vector>

#include "core/base/error.h"
#include "server/rpc/peers.h"
#include "server/rpc/socket_traffic.h"

namespace deform::server {

namespace {

constexpr char unix_prefix[] = "unix:";
constexpr char abstract_prefix[] = "unix-abstract:";
constexpr std::size_t usual_connections = 4096;
constexpr std::size_t connections_per_free = 4;  ///< of one host, for each that is free
constexpr std::size_t own_files = 256;           ///< for the store, the log, listening sockets and pollers
constexpr std::chrono::milliseconds count_interval{20};
constexpr std::chrono::milliseconds pause_without_files{10};
constexpr std::chrono::seconds complaint_interval{10};
constexpr std::chrono::seconds turn_interval{1};  ///< the thread comes round at least so often
constexpr std::chrono::seconds turn_patience{10};

Error cannot_listen(const std::string& address, const std::string& why) {
  return {ErrorCode::unavailable, "cannot listen on " + address + ": " + why};
}

/// Closed at the end unless released.
class OwnedFile {
 public:
  explicit OwnedFile(int fd) : fd_(fd) {}
  ~OwnedFile() {
    if (fd_ >= 0) close(fd_);
  }
  OwnedFile(const OwnedFile&) = delete;
  OwnedFile& operator=(const OwnedFile&) = delete;
  int fd() const { return fd_; }
  int release() { return std::exchange(fd_, -1); }

 private:
  int fd_;
};

int new_socket(int family) { return socket(family, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0); }

void set_number(int fd, int level, int option, int value) { setsockopt(fd, level, option, &value, sizeof(value)); }

int port_of(int fd) {
  sockaddr_storage address{};
  socklen_t size = sizeof(address);
  if (getsockname(fd, reinterpret_cast<sockaddr*>(&address), &size) != 0) return 0;
  return ntohs(address.ss_family == AF_INET6 ? reinterpret_cast<const sockaddr_in6&>(address).sin6_port
                                             : reinterpret_cast<const sockaddr_in&>(address).sin_port);
}

void set_port(sockaddr* address, int port) {
  const auto number = htons(static_cast<std::uint16_t>(port));
  if (address->sa_family == AF_INET6) {
    reinterpret_cast<sockaddr_in6*>(address)->sin6_port = number;
  } else {
    reinterpret_cast<sockaddr_in*>(address)->sin_port = number;
  }
}

/// A socket that listens there; -1 with errno.
int listening_socket(const sockaddr* address, socklen_t size) {
  OwnedFile socket(new_socket(address->sa_family));
  if (socket.fd() < 0) return -1;
  set_number(socket.fd(), SOL_SOCKET, SO_REUSEADDR, 1);  // a port may be taken up again at once after a restart
  if (address->sa_family == AF_INET6) {
    const bool every = IN6_IS_ADDR_UNSPECIFIED(&reinterpret_cast<const sockaddr_in6*>(address)->sin6_addr);
    set_number(socket.fd(), IPPROTO_IPV6, IPV6_V6ONLY, every ? 0 : 1);
  }
  if (bind(socket.fd(), address, size) != 0 || listen(socket.fd(), SOMAXCONN) != 0) return -1;
  return socket.release();
}

/// The inode of an open socket, 0 when it is closed or something else by now.
std::uint64_t socket_inode(int fd) {
  struct stat about {};
  return fstat(fd, &about) == 0 && S_ISSOCK(about.st_mode) ? about.st_ino : 0;
}

/// The other end as gRPC writes it, but with the brackets of IPv6 as they are; empty for unix sockets and what is closed.
std::string peer_of(int fd) {
  sockaddr_storage address{};
  socklen_t size = sizeof(address);
  if (getpeername(fd, reinterpret_cast<sockaddr*>(&address), &size) != 0) return {};
  char host[NI_MAXHOST], port[NI_MAXSERV];
  const auto* name = reinterpret_cast<const sockaddr*>(&address);
  // A socket for both families gives addresses of IPv4 in the form of IPv6.
  if (const auto* v6 = reinterpret_cast<const sockaddr_in6*>(name);
      name->sa_family == AF_INET6 && IN6_IS_ADDR_V4MAPPED(&v6->sin6_addr)) {
    sockaddr_in v4{};
    v4.sin_family = AF_INET;
    v4.sin_port = v6->sin6_port;
    std::memcpy(&v4.sin_addr, &v6->sin6_addr.s6_addr[12], sizeof(v4.sin_addr));
    std::memcpy(&address, &v4, sizeof(v4));
    size = sizeof(v4);
  }
  if (getnameinfo(name, size, host, sizeof(host), port, sizeof(port), NI_NUMERICHOST | NI_NUMERICSERV) != 0) return {};
  if (name->sa_family == AF_INET) return std::string("ipv4:") + host + ":" + port;
  if (name->sa_family == AF_INET6) return std::string("ipv6:[") + host + "]:" + port;
  return {};
}

/// With the brackets of IPv6 as gRPC writes them, or as they are.
std::string with_escaped_brackets(std::string peer, bool escaped) {
  for (auto [written, plain] : {std::pair{"%5B", "["}, std::pair{"%5D", "]"}}) {
    const char* const from = escaped ? plain : written;
    if (const auto at = peer.find(from); at != std::string::npos) peer.replace(at, std::strlen(from), escaped ? written : plain);
  }
  return peer;
}

bool out_of_files(int error) { return error == EMFILE || error == ENFILE || error == ENOBUFS || error == ENOMEM; }

/// What accept4() says of the listening socket; all else is of a connection that is gone already.
bool is_for_good(int error) { return error == EBADF || error == EINVAL || error == ENOTSOCK || error == EOPNOTSUPP; }

int open_spare() { return open("/dev/null", O_RDONLY | O_CLOEXEC); }

}  // namespace

bool is_unix(const std::string& address) { return address.starts_with(unix_prefix) || address.starts_with(abstract_prefix); }

bool beyond_loopback(const std::string& address) {
  if (address.empty() || is_unix(address)) return false;
  const std::string host = split_address(address).host;
  if (host == "localhost" || host == "::1") return false;
  // Only a dotted number is known to stay here: "127.example.org" may be anywhere.
  const bool dotted =
      std::count(host.begin(), host.end(), '.') == 3 && host.find_first_not_of("0123456789.") == std::string::npos;
  return !(dotted && host.starts_with("127."));
}

HostPort split_address(const std::string& address) {
  HostPort out;
  const std::size_t colon = address.rfind(':');
  if (colon == std::string::npos) return {address, -1};
  out.host = address.substr(0, colon);
  if (out.host.size() >= 2 && out.host.front() == '[' && out.host.back() == ']') {
    out.host = out.host.substr(1, out.host.size() - 2);
  }
  const char* first = address.data() + colon + 1;
  const char* last = address.data() + address.size();
  int port = 0;
  const auto [end, failure] = std::from_chars(first, last, port);
  if (failure == std::errc() && end == last && first != last && port >= 0 && port <= 65535) out.port = port;
  return out;
}

void check_address(const std::string& address) {
  if (is_unix(address)) return;
  const HostPort parts = split_address(address);
  if (parts.host.empty() || parts.port < 0) {
    throw Error(ErrorCode::invalid_argument,
                "option address: \"" + address + "\" is not HOST:PORT, [IPV6]:PORT or unix:PATH with a port of 0 to 65535");
  }
}

std::size_t connection_limit(std::size_t wanted) {
  struct rlimit files {};
  getrlimit(RLIMIT_NOFILE, &files);
  const std::size_t all = files.rlim_cur;
  const std::size_t most = all - std::min(own_files, all / 2);
  if (wanted > most) {
    throw Error(ErrorCode::invalid_argument, "option max_connections: " + std::to_string(wanted) + ", but at most " +
                                                 std::to_string(all) + " files may be open (ulimit -n), which leaves " +
                                                 std::to_string(most) + " for connections");
  }
  return wanted != 0 ? wanted : std::min(usual_connections, most);
}

Listener::Listener(const Options& options) : options_(options) {
  try {
    if (is_unix(options.address)) {
      bind_unix();
    } else {
      bind_tcp();
    }
  } catch (...) {
    stop();
    throw;
  }
}

Listener::~Listener() { stop(); }

void Listener::bind_unix() {
  const std::string& address = options_.address;
  const bool abstract = address.starts_with(abstract_prefix);
  const std::string path =
      abstract ? '\0' + address.substr(sizeof(abstract_prefix) - 1) : address.substr(sizeof(unix_prefix) - 1);
  sockaddr_un name{};
  name.sun_family = AF_UNIX;
  if (path.empty() || path.size() >= sizeof(name.sun_path)) {
    throw cannot_listen(address, "the path must have 1 to " + std::to_string(sizeof(name.sun_path) - 1) + " bytes");
  }
  std::memcpy(name.sun_path, path.data(), path.size());
  struct stat left {};
  if (!abstract && lstat(path.c_str(), &left) == 0 && S_ISSOCK(left.st_mode)) unlink(path.c_str());
  OwnedFile socket(new_socket(AF_UNIX));
  const auto size = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + path.size() + (abstract ? 0 : 1));
  // Nobody can connect before listen(), so that the mode holds from the beginning.
  if (socket.fd() < 0 || bind(socket.fd(), reinterpret_cast<const sockaddr*>(&name), size) != 0 ||
      (!abstract && chmod(path.c_str(), 0660) != 0) || listen(socket.fd(), SOMAXCONN) != 0) {
    throw cannot_listen(address, std::strerror(errno));
  }
  listening_.push_back(socket.release());
}

void Listener::bind_tcp() {
  const HostPort parts = split_address(options_.address);
  addrinfo hints{};
  hints.ai_socktype = SOCK_STREAM;
  hints.ai_flags = AI_PASSIVE;
  addrinfo* found = nullptr;
  // 0.0.0.0 means every address of this machine, those of IPv6 included where it has them.
  const bool every = parts.host == "0.0.0.0" || parts.host == "::";
  const char* hosts[] = {every ? "::" : parts.host.c_str(), every ? "0.0.0.0" : nullptr};
  int error = 0;
  for (const char* host : hosts) {
    if (host == nullptr || !listening_.empty()) break;
    if (const int code = getaddrinfo(host, std::to_string(parts.port).c_str(), &hints, &found); code != 0) {
      throw cannot_listen(options_.address, gai_strerror(code));
    }
    const std::unique_ptr<addrinfo, decltype(&freeaddrinfo)> owner(found, &freeaddrinfo);
    for (const addrinfo* one = found; one != nullptr; one = one->ai_next) {
      if (port_ != 0) set_port(one->ai_addr, port_);  // all on the port that the first one got
      const int fd = listening_socket(one->ai_addr, one->ai_addrlen);
      if (fd < 0) {
        error = errno;
        if (error == EADDRINUSE) throw cannot_listen(options_.address, std::strerror(error));
        continue;  // a name may have addresses that this machine does not
      }
      listening_.push_back(fd);
      port_ = port_of(fd);
    }
  }
  if (listening_.empty()) throw cannot_listen(options_.address, std::strerror(error));
}

void Listener::start(std::function<void(int)> take) {
  take_ = std::move(take);
  wake_ = eventfd(0, EFD_CLOEXEC);
  spare_ = open_spare();
  if (wake_ < 0) throw cannot_listen(options_.address, std::strerror(errno));
  thread_ = std::thread([this] { run(); });
}

void Listener::stop() {
  if (thread_.joinable()) {
    eventfd_write(wake_, 1);
    thread_.join();
  }
  for (const int fd : listening_) close(fd);
  for (const int fd : {wake_, spare_}) {
    if (fd >= 0) close(fd);
  }
  listening_.clear();
  wake_ = spare_ = -1;
}

void Listener::run() {
  std::vector<pollfd> wanted;
  for (const int fd : listening_) wanted.push_back({fd, POLLIN, 0});
  wanted.push_back({wake_, POLLIN, 0});
  for (;;) {
    ++turns_;
    const int ready = poll(wanted.data(), wanted.size(), static_cast<int>(std::chrono::milliseconds(turn_interval).count()));
    if (ready < 0) {
      if (errno == EINTR || errno == EAGAIN || errno == ENOMEM) {
        std::this_thread::sleep_for(pause_without_files);
        continue;
      }
      return give_up("cannot wait for connections", errno);
    }
    if (wanted.back().revents != 0) return;
    for (pollfd& one : std::span(wanted).first(wanted.size() - 1)) {
      if (one.revents != 0 && !accept_from(one.fd)) one.fd = -1;  // which poll() leaves out
    }
  }
}

std::string Listener::trouble(std::chrono::steady_clock::time_point now) {
  {
    const std::lock_guard lock(mutex_);
    if (!broken_.empty()) return broken_;
  }
  const std::uint64_t turns = turns_;
  const auto since = now - std::exchange(asked_, now);
  if (std::exchange(turns_then_, turns) != turns || turns == 0) {  // 0: not started
    silent_ = {};
    return {};
  }
  silent_ += std::min<std::chrono::steady_clock::duration>(since, turn_interval);
  if (silent_ <= turn_patience) return {};
  return "the thread that accepts connections has not come round for " +
         std::to_string(std::chrono::duration_cast<std::chrono::seconds>(silent_).count()) + " s";
}

void Listener::give_up(const char* what, int error) {
  const std::lock_guard lock(mutex_);
  broken_ = std::string(what) + ": " + std::strerror(error);
  spdlog::error("connections: {}", broken_);
}

bool Listener::accept_from(int listening) {
  sockaddr_storage peer{};
  socklen_t size = sizeof(peer);
  OwnedFile connection(accept4(listening, reinterpret_cast<sockaddr*>(&peer), &size, SOCK_NONBLOCK | SOCK_CLOEXEC));
  if (connection.fd() < 0) {
    const int error = errno;
    if (out_of_files(error)) without_files(listening);
    if (!is_for_good(error)) return true;
    give_up("nothing can be accepted from a socket that is listened on", error);
    return false;
  }
  const std::string host = host_of(peer);
  if (const Room room = room_for(host); room != Room::yes) {
    note_refusal(room == Room::none ? "as many connections are open as --max-connections allows"
                                    : "their address has most of the connections that --max-connections allows");
    return true;
  }
  if (port_ != 0) {
    set_number(connection.fd(), IPPROTO_TCP, TCP_NODELAY, 1);
    set_number(connection.fd(), IPPROTO_TCP, TCP_USER_TIMEOUT, static_cast<int>(options_.unacknowledged.count()));
  }
  {
    const std::lock_guard lock(mutex_);
    const auto known = open_.find(connection.fd());
    if (known != open_.end()) leave(known->second.host);  // it is closed, and its descriptor this one's
    open_[connection.fd()] = {socket_inode(connection.fd()), host};
    ++of_hosts_[host];
  }
  take_(connection.release());
  return true;
}

/// Closes a connection that would wait for ever, by means of the spare file.
void Listener::without_files(int listening) {
  if (spare_ >= 0) close(std::exchange(spare_, -1));
  { const OwnedFile refused(accept4(listening, nullptr, nullptr, SOCK_CLOEXEC)); }
  spare_ = open_spare();
  note_refusal("no more files can be opened");
  std::this_thread::sleep_for(pause_without_files);  // others may be waiting for a file, too
}

Listener::Room Listener::room_for(const std::string& host) {
  const std::lock_guard lock(mutex_);
  const Room room = room_now(host);
  const auto now = std::chrono::steady_clock::now();
  if (room == Room::yes || now - counted_ < count_interval) return room;
  counted_ = now;
  forget_closed();
  return room_now(host);
}

Listener::Room Listener::room_now(const std::string& host) const {
  const std::size_t most = max_connections_;
  if (open_.size() >= most) return Room::none;
  const auto own = host.empty() ? of_hosts_.end() : of_hosts_.find(host);
  const bool greedy = own != of_hosts_.end() && own->second > connections_per_free * (most - open_.size());
  return greedy ? Room::none_for_host : Room::yes;
}

void Listener::forget_closed() {
  std::erase_if(open_, [this](const auto& one) {
    const bool closed = socket_inode(one.first) != one.second.inode;
    if (closed) leave(one.second.host);
    return closed;
  });
}

void Listener::leave(const std::string& host) {
  const auto found = of_hosts_.find(host);
  if (found != of_hosts_.end() && --found->second == 0) of_hosts_.erase(found);
}

void Listener::note_refusal(const char* why) {
  ++refused_;
  const auto now = std::chrono::steady_clock::now();
  if (complained_at_ != 0 && now - complained_ < complaint_interval) return;
  const std::lock_guard lock(mutex_);
  spdlog::warn("connections: {} refused: {} (now {})", refused_ - complained_at_, why, open_.size());
  complained_ = now;
  complained_at_ = refused_;
}

void Listener::cut_off(const std::string& peer, const char* why) {
  const std::string wanted = with_escaped_brackets(peer, false);
  const std::lock_guard lock(mutex_);
  for (auto& [fd, connection] : open_) {
    if (socket_inode(fd) == connection.inode && peer_of(fd) == wanted) close_now(fd, connection, why);
  }
}

std::vector<Listener::Connected> Listener::connections() {
  std::vector<Connected> open;
  {
    const std::lock_guard lock(mutex_);
    for (const auto& [fd, connection] : open_) {
      if (socket_inode(fd) == connection.inode) open.push_back({peer_of(fd), connection.since});
    }
  }
  std::sort(open.begin(), open.end(), [](const Connected& a, const Connected& b) { return a.since < b.since; });
  return open;
}

std::size_t Listener::open_count() {
  const std::lock_guard lock(mutex_);
  return static_cast<std::size_t>(
      std::count_if(open_.begin(), open_.end(), [](const auto& one) { return socket_inode(one.first) == one.second.inode; }));
}

std::vector<Listener::Busy> Listener::busy() {
  constexpr std::uint64_t much = 8 << 10;  // so that nobody suffers who sends little
  const std::lock_guard lock(mutex_);
  std::vector<Busy> out;
  for (auto& [fd, connection] : open_) {
    if (socket_inode(fd) != connection.inode) continue;
    const std::uint64_t received = received_bytes(fd);
    const std::uint64_t bytes = received - std::exchange(connection.received, received);
    if (bytes >= much) out.push_back({with_escaped_brackets(peer_of(fd), true), bytes, fd, connection.inode});
  }
  return out;
}

void Listener::cut_off(const Busy& connection, const char* why) {
  const std::lock_guard lock(mutex_);
  const auto found = open_.find(connection.fd);
  if (found == open_.end() || found->second.inode != connection.inode) return;
  if (socket_inode(connection.fd) == connection.inode) close_now(connection.fd, found->second, why);
}

/// gRPC closes what has been shut down, after it has read what had come: that is dropped. Should it have closed the connection
/// already and another one have its descriptor, that one connects again.
void Listener::close_now(int fd, Open& connection, const char* why) {
  if (std::exchange(connection.cut_off, true)) return;  // gRPC has not come to it yet
  spdlog::warn("connections: {} is closed: {}", peer_of(fd), why);
  ++cut_off_;
  shutdown(fd, SHUT_RDWR);
  while (recv(fd, nullptr, std::size_t{1} << 30, MSG_TRUNC | MSG_DONTWAIT) > 0) {
  }
}

}  // namespace deform::server

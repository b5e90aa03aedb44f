// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <atomic>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <mutex>
#include <string>
#include <thread>
#include <unordered_map>
#include <vector>

namespace deform::server {

/// May other machines connect to this address? False for 127.0.0.0/8, ::1, localhost, unix sockets and the empty address.
bool beyond_loopback(const std::string& address);
/// unix:PATH or unix-abstract:NAME.
bool is_unix(const std::string& address);
/// Throws Error(invalid_argument) "option address: ..." for what is no HOST:PORT, [IPV6]:PORT or unix:PATH; nothing is looked up.
void check_address(const std::string& address);

struct HostPort {
  std::string host;  ///< without the brackets of IPv6
  int port = -1;     ///< -1: no number in 0..65535
};
/// The parts of HOST:PORT or [IPV6]:PORT, as they are written.
HostPort split_address(const std::string& address);

/// As many connections as the limit of open files allows beside the files that the server itself needs, at most 4096; `wanted`
/// instead when it is not 0. Throws Error(invalid_argument) when there are not so many.
std::size_t connection_limit(std::size_t wanted);

/// Accepts connections and hands them on, up to a limit: more are closed at once. gRPC's own listener has no limit, and stops for
/// good when the process has no file left. It is not notified of the end of connections; it checks which of them are still open.
///
/// Nor does one host get all of them: it may have four times as many as are free, by the rule that the queue has for clients
/// (Scheduler::enter), so that there is room for the next one. Hosts are those of host_of(); a unix socket, which has clients of
/// this machine alone and no addresses, has no such limit.
///
///   bound --start()--> accepting --stop()--> closed
class Listener {
 public:
  struct Options {
    std::string address;                               ///< that check_address() accepts
    std::size_t max_connections = 1;                   ///< open at once
    std::chrono::milliseconds unacknowledged{20'000};  ///< a connection whose peer acknowledges nothing for so long is closed
  };

  /// Binds and listens; a unix socket gets the mode 0660, and one that was left behind is replaced. Throws Error(unavailable).
  explicit Listener(const Options& options);
  ~Listener();
  Listener(const Listener&) = delete;
  Listener& operator=(const Listener&) = delete;

  /// The port that is listened on; 0 for a unix socket.
  int port() const { return port_; }

  /// take(fd) gets each connection, non-blocking, to keep and close. Called by a thread of the listener. Once.
  void start(std::function<void(int fd)> take);
  /// Accepts no more. Idempotent, not thread-safe.
  void stop();

  /// Closes the connection of this peer, as gRPC writes it, and says why in the log, once. Not those of unix sockets, which have
  /// no address. Any thread.
  void cut_off(const std::string& peer, const char* why);
  /// A connection that sends much.
  struct Busy {
    std::string peer;         ///< as gRPC writes it; empty for unix sockets
    std::uint64_t bytes = 0;  ///< that it has received since the last call of busy(), or in all
    int fd = -1;
    std::uint64_t inode = 0;
  };
  /// Those that have received at least 8 KiB since the last call. Not those of unix sockets, which count no bytes. Any thread.
  std::vector<Busy> busy();
  /// Closes it and says why in the log, unless it is closed already. Any thread.
  void cut_off(const Busy& connection, const char* why);

  /// Why no connection is accepted any more; empty while they are. For one thread that asks again and again: the thread of the
  /// listener hangs when it has not come round for 10 s in which whoever asks has. A process that was stopped and goes on is
  /// given that time anew.
  std::string trouble(std::chrono::steady_clock::time_point now = std::chrono::steady_clock::now());

  /// More than so many are closed at once from now on; those that are open stay.
  void set_limit(std::size_t connections) { max_connections_ = connections; }
  struct Connected {
    std::string peer;  ///< as gRPC writes it, but with the brackets of IPv6 as they are; empty for unix sockets
    std::chrono::steady_clock::time_point since;
  };
  /// Those that are open, the oldest first. Any thread.
  std::vector<Connected> connections();

  std::size_t open_count();
  std::uint64_t refused() const { return refused_; }        ///< connections beyond the limit so far
  std::uint64_t cut_off_count() const { return cut_off_; }  ///< connections that cut_off() closed so far

 private:
  void bind_unix();
  void bind_tcp();
  void run();
  /// False when nothing is ever accepted from this socket again.
  bool accept_from(int listening);
  void give_up(const char* what, int error);
  void without_files(int listening);
  enum class Room { yes, none, none_for_host };
  Room room_for(const std::string& host);
  /// Those that are open, of all and of the host. With mutex_ held.
  Room room_now(const std::string& host) const;
  void forget_closed();
  void leave(const std::string& host);
  void note_refusal(const char* why);

  const Options options_;
  std::atomic<std::size_t> max_connections_{options_.max_connections};
  std::vector<int> listening_;
  int port_ = 0;
  int wake_ = -1;
  int spare_ = -1;  ///< given up for a moment to close a connection that there is no file for
  std::function<void(int)> take_;
  std::atomic<std::uint64_t> refused_{0};
  std::atomic<std::uint64_t> cut_off_{0};
  std::atomic<std::uint64_t> turns_{0};  ///< of the thread
  std::thread thread_;
  /// A connection that was handed on.
  struct Open {
    std::uint64_t inode = 0;     ///< of the socket: its descriptor may mean something else by now
    std::string host;            ///< empty for unix sockets
    std::uint64_t received = 0;  ///< bytes, when last asked
    bool cut_off = false;        ///< closed here; its descriptor stays until gRPC closes it
    std::chrono::steady_clock::time_point since = std::chrono::steady_clock::now();
  };
  void close_now(int fd, Open& connection, const char* why);
  std::mutex mutex_;
  // under mutex_
  std::unordered_map<int, Open> open_;                     ///< by file descriptor
  std::unordered_map<std::string, std::size_t> of_hosts_;  ///< how many of these are of a host
  std::string broken_;                                     ///< why a socket is of no use any more
  // of whoever asks for trouble()
  std::chrono::steady_clock::time_point asked_{};
  std::chrono::steady_clock::duration silent_{0};
  std::uint64_t turns_then_ = 0;
  // of the thread
  std::chrono::steady_clock::time_point counted_{}, complained_{};
  std::uint64_t complained_at_ = 0;  ///< refused() then
};

}  // namespace deform::server

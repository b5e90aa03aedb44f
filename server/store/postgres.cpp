// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/store/postgres.h"

#include <poll.h>

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cstring>
#include <utility>

namespace deform::server::postgres {

namespace {

constexpr std::uint32_t database_retry_ms = 1000;

/// One line, without the name of the severity and without what could follow.
std::string first_line(const char* message) {
  std::string text = message == nullptr ? "" : message;
  text = text.substr(0, text.find('\n'));
  return text.empty() ? "no answer" : text;
}

Error meaning(const PGresult* result, const std::string& message) {
  const char* field = PQresultErrorField(result, PG_DIAG_SQLSTATE);
  const std::string state = field == nullptr ? "" : field;
  const std::string kind = state.substr(0, 2);
  const std::string what = "catalog: " + message;
  if (state == "53100") return Error(ErrorCode::out_of_budget, what).refused_for(Refusal::disk);
  if (state == "42501") return {ErrorCode::failed_precondition, what};  // the role may not
  // The tables are not ours, or what is in them cannot be read any more.
  if (kind == "XX" || kind == "42" || kind == "3F") return {ErrorCode::data_loss, what};
  // A resource is short, it is shutting down, it is a standby that cannot be written, two transactions were in each other's way.
  return {ErrorCode::unavailable, what, database_retry_ms};
}

/// Its session is over, or will be.
bool ends_session(const PGresult* result) {
  const char* state = PQresultErrorField(result, PG_DIAG_SQLSTATE);
  return state != nullptr && (std::strncmp(state, "57P", 3) == 0 || std::strncmp(state, "08", 2) == 0 ||
                              std::strncmp(state, "25006", 5) == 0);  // read only: a standby now
}

}  // namespace

LostConnection::LostConnection(std::string why)
    : Error(ErrorCode::unavailable, "catalog: the database cannot be reached", database_retry_ms), why_(std::move(why)) {}

std::string Result::text(int row, int column) const {
  return {PQgetvalue(result_.get(), row, column), static_cast<std::size_t>(PQgetlength(result_.get(), row, column))};
}

std::int64_t Result::number(int row, int column) const {
  const std::string text = this->text(row, column);
  std::int64_t value = 0;
  const auto [end, failure] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (failure != std::errc() || end != text.data() + text.size()) {
    throw Error(ErrorCode::data_loss, "catalog: \"" + text.substr(0, 40) + "\" is not a number");
  }
  return value;
}

std::string Result::bytes(int row, int column) const {
  std::size_t size = 0;
  const std::unique_ptr<unsigned char, decltype(&PQfreemem)> bytes(
      PQunescapeBytea(reinterpret_cast<const unsigned char*>(PQgetvalue(result_.get(), row, column)), &size), &PQfreemem);
  if (!bytes) throw std::bad_alloc();
  return {reinterpret_cast<const char*>(bytes.get()), size};
}

std::int64_t Result::affected() const {
  std::int64_t value = 0;
  const std::string_view text = PQcmdTuples(result_.get());
  std::from_chars(text.data(), text.data() + text.size(), value);
  return value;
}

Connection::Connection(const std::string& uri, Clock::duration limit) {
  const auto end = Clock::now() + limit;
  // What the URI says wins: expand_dbname takes it apart after what stands before it.
  const char* const names[] = {"application_name", "client_encoding",  "keepalives_idle", "keepalives_interval",
                               "keepalives_count", "tcp_user_timeout", "dbname",          nullptr};
  const char* const values[] = {"deformd", "UTF8", "10", "5", "3", "15000", uri.c_str(), nullptr};
  connection_.reset(PQconnectStartParams(names, values, 1));
  if (!connection_) throw std::bad_alloc();
  if (PQstatus(connection_.get()) == CONNECTION_BAD) lose(first_line(PQerrorMessage(connection_.get())));
  for (PostgresPollingStatusType state = PGRES_POLLING_WRITING; state != PGRES_POLLING_OK;) {
    wait_for(state == PGRES_POLLING_READING ? POLLIN : POLLOUT, end);
    state = PQconnectPoll(connection_.get());
    if (state == PGRES_POLLING_FAILED) lose(first_line(PQerrorMessage(connection_.get())));
  }
  if (PQsetnonblocking(connection_.get(), 1) != 0) lose(first_line(PQerrorMessage(connection_.get())));
  PQsetNoticeProcessor(
      connection_.get(), [](void*, const char*) {}, nullptr);
  // Acknowledged is durable, whatever the database's default; and its side of a connection that was cut off ends, too, with the
  // locks that it holds.
  run("SELECT set_config('synchronous_commit', 'on', false) WHERE current_setting('synchronous_commit') = 'off'");
  run("SET tcp_keepalives_idle = 10");
  run("SET tcp_keepalives_interval = 5");
  run("SET tcp_keepalives_count = 3");
  run("SET idle_in_transaction_session_timeout = '60s'");
}

void Connection::lose(const std::string& why) {
  lost_ = true;
  throw LostConnection(why);
}

void Connection::wait_for(short events, Clock::time_point end) {
  for (;;) {
    const auto left = std::chrono::duration_cast<std::chrono::milliseconds>(end - Clock::now()).count();
    if (left <= 0) lose("PostgreSQL does not answer");
    struct pollfd socket {
      PQsocket(connection_.get()), events, 0
    };
    const int ready = ::poll(&socket, 1, static_cast<int>(std::min<std::int64_t>(left, 60'000)));
    if (ready > 0) return;
    if (ready < 0 && errno != EINTR) lose(std::strerror(errno));
  }
}

Result Connection::run(const char* sql, std::initializer_list<Parameter> parameters, Clock::duration limit) {
  if (is_lost()) lose("the connection to PostgreSQL is lost");
  const auto end = Clock::now() + limit;
  std::vector<const char*> values;
  std::vector<int> sizes, formats;
  for (const Parameter& parameter : parameters) {
    values.push_back(parameter.value.c_str());
    sizes.push_back(static_cast<int>(parameter.value.size()));
    formats.push_back(parameter.binary ? 1 : 0);
  }
  if (PQsendQueryParams(connection_.get(), sql, static_cast<int>(values.size()), nullptr, values.data(), sizes.data(),
                        formats.data(), 0) != 1) {
    lose(first_line(PQerrorMessage(connection_.get())));
  }
  for (int left = PQflush(connection_.get()); left != 0; left = PQflush(connection_.get())) {
    if (left < 0) lose(first_line(PQerrorMessage(connection_.get())));
    wait_for(POLLIN | POLLOUT, end);
    if (PQconsumeInput(connection_.get()) != 1) lose(first_line(PQerrorMessage(connection_.get())));
  }
  Result last(nullptr);
  for (bool any = false;;) {
    while (PQisBusy(connection_.get()) == 1) {
      wait_for(POLLIN, end);
      if (PQconsumeInput(connection_.get()) != 1) lose(first_line(PQerrorMessage(connection_.get())));
    }
    PGresult* const result = PQgetResult(connection_.get());
    if (result == nullptr) {
      if (!any) lose("the connection to PostgreSQL is lost");
      return last;
    }
    any = true;
    last = Result(result);
    const ExecStatusType status = PQresultStatus(result);
    if (status == PGRES_COMMAND_OK || status == PGRES_TUPLES_OK) continue;
    const std::string message = first_line(PQresultErrorMessage(result));
    if (PQstatus(connection_.get()) != CONNECTION_OK || ends_session(result)) lose(message);
    const Error error = meaning(result, message);
    while (PGresult* const more = PQgetResult(connection_.get())) PQclear(more);
    throw error;
  }
}

std::vector<Notification> Connection::wait(Clock::duration limit, int wake) {
  const auto end = Clock::now() + limit;
  std::vector<Notification> found;
  for (;;) {
    if (PQconsumeInput(connection_.get()) != 1) lose(first_line(PQerrorMessage(connection_.get())));
    while (PGnotify* const notification = PQnotifies(connection_.get())) {
      found.push_back({notification->relname, notification->extra});
      PQfreemem(notification);
    }
    const auto left = std::chrono::duration_cast<std::chrono::milliseconds>(end - Clock::now()).count();
    if (!found.empty() || left <= 0) return found;
    struct pollfd both[] = {{PQsocket(connection_.get()), POLLIN, 0}, {wake, POLLIN, 0}};
    if (::poll(both, 2, static_cast<int>(std::min<std::int64_t>(left, 60'000))) < 0 && errno != EINTR) lose(std::strerror(errno));
    if ((both[1].revents & POLLIN) != 0) return found;
  }
}

Transaction::~Transaction() {
  if (done_ || connection_.is_lost()) return;
  try {
    connection_.run("ROLLBACK");
  } catch (const Error&) {
    // A connection that is not idle is not used again.
  }
}

void check_uri(const std::string& uri) {
  if (!uri.starts_with("postgresql://") && !uri.starts_with("postgres://")) {
    throw Error(ErrorCode::invalid_argument, "expected postgresql://HOST/DATABASE");
  }
  char* why = nullptr;
  const std::unique_ptr<PQconninfoOption, decltype(&PQconninfoFree)> parts(PQconninfoParse(uri.c_str(), &why), &PQconninfoFree);
  PQfreemem(why);  // it repeats parts of what may be a secret
  if (!parts) throw Error(ErrorCode::invalid_argument, "not a URI of PostgreSQL");
  for (const PQconninfoOption* part = parts.get(); part->keyword != nullptr; ++part) {
    const bool secret = std::strcmp(part->keyword, "password") == 0 || std::strcmp(part->keyword, "sslpassword") == 0;
    if (secret && part->val != nullptr && *part->val != '\0') {
      throw Error(ErrorCode::invalid_argument,
                  "it has a password, which all who list processes could see; give it in a file (passfile=PATH in the URI, or "
                  "~/.pgpass), in a service file, or in the environment variable PGPASSWORD");
    }
  }
}

}  // namespace deform::server::postgres

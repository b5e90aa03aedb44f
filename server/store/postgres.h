// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <libpq-fe.h>

#include <chrono>
#include <cstdint>
#include <functional>
#include <initializer_list>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "core/base/error.h"

/// PostgreSQL with the Error of this project. Needs no table of anybody: what is asked is up to the caller.
namespace deform::server::postgres {

using Clock = std::chrono::steady_clock;

/// The connection is gone or could not be made: what was asked for has been done or has not. Error(unavailable) with a retry
/// hint. Its message is for clients; why, with addresses, is for the log.
class LostConnection : public Error {
 public:
  explicit LostConnection(std::string why);
  const std::string& why() const { return why_; }

 private:
  std::string why_;
};

/// Rows of one statement, as text.
class Result {
 public:
  explicit Result(PGresult* result) : result_(result, &PQclear) {}
  int rows() const { return PQntuples(result_.get()); }
  std::string text(int row, int column) const;
  std::int64_t number(int row, int column) const;
  /// The value of a bytea.
  std::string bytes(int row, int column) const;
  /// Rows that were inserted, updated or deleted.
  std::int64_t affected() const;

 private:
  std::unique_ptr<PGresult, decltype(&PQclear)> result_;
};

/// One parameter of a statement.
struct Parameter {
  Parameter(const std::string& text) : value(text) {}
  Parameter(const char* text) : value(text) {}
  Parameter(std::int64_t number) : value(std::to_string(number)) {}
  static Parameter bytes(const std::string& value) {
    Parameter parameter(value);
    parameter.binary = true;
    return parameter;
  }
  std::string value;
  bool binary = false;
};

/// A notification that another session, or this one, has sent.
struct Notification {
  std::string channel, payload;
};

/// For one thread at a time. Nothing waits beyond its limit: a server that takes a question and never answers, or a
/// network that drops everything, ends as LostConnection.
class Connection {
 public:
  Connection(const std::string& uri, Clock::duration limit);
  Connection(const Connection&) = delete;
  Connection& operator=(const Connection&) = delete;

  /// One statement. Throws LostConnection, and the Error that stands for what PostgreSQL says.
  Result run(const char* sql, std::initializer_list<Parameter> parameters = {}, Clock::duration limit = answer_limit);
  bool is_lost() const { return lost_ || PQstatus(connection_.get()) != CONNECTION_OK; }
  bool is_idle() const { return PQtransactionStatus(connection_.get()) == PQTRANS_IDLE; }

  /// Waits for notifications until there is one, the time is over or `wake` (a descriptor) can be read.
  std::vector<Notification> wait(Clock::duration limit, int wake);

  static constexpr std::chrono::seconds answer_limit{5};

 private:
  void wait_for(short events, Clock::time_point end);
  [[noreturn]] void lose(const std::string& why);

  std::unique_ptr<PGconn, decltype(&PQfinish)> connection_{nullptr, &PQfinish};
  bool lost_ = false;
};

/// Rolled back unless committed.
class Transaction {
 public:
  explicit Transaction(Connection& connection) : connection_(connection) { connection_.run("BEGIN"); }
  ~Transaction();
  Transaction(const Transaction&) = delete;
  Transaction& operator=(const Transaction&) = delete;
  void commit() {
    connection_.run("COMMIT");
    done_ = true;
  }

 private:
  Connection& connection_;
  bool done_ = false;
};

/// Throws Error(invalid_argument) for what is no URI of PostgreSQL, and for one with a password.
void check_uri(const std::string& uri);

}  // namespace deform::server::postgres

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "core/base/error.h"

namespace deform::client {

/// An Error of a call that was sent, with the id under which whoever looks after the server finds it in the server's log
/// (`client_request`), and a proxy in its own. All attempts of a call have one id.
class CallError : public Error {
 public:
  /// That error, of the call with this id.
  CallError(const Error& error, std::string request_id);
  /// The id of the call; never empty.
  const std::string& request_id() const { return *request_id_; }

 private:
  std::shared_ptr<const std::string> request_id_;  // shared, so that copying cannot fail
};

/// The id of the call that this error is about; empty where nothing was sent.
std::string request_id_of(const Error& error);

/// Throws the error with another message, the rest as it is.
[[noreturn]] void throw_reworded(const Error& error, const std::string& message);

}  // namespace deform::client

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <grpcpp/security/credentials.h>

#include <chrono>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>

#include "client/client.h"

namespace deform::client {

/// The credentials of a channel: TLS with the files of the options, which are read now, or plain text. Throws
/// Error(invalid_argument) naming the option and its file, or because a token would travel in plain text to another machine.
std::shared_ptr<grpc::ChannelCredentials> channel_credentials(const ClientOptions& options);

/// The name that a certificate must have to be this server's: the one given, or the host of the address.
std::string expected_name(const std::string& address, const TlsOptions& tls);

/// The token in a file, without the blanks around it. Throws Error(invalid_argument) naming the file, never what is in it.
std::string read_token(const std::filesystem::path& file);

/// Connects once more, by itself, to tell why TLS with this server fails: a sentence that names certificate, date, names and
/// option, or nothing when TLS is not the reason. Trusts and sends nothing. Takes up to about three times `timeout`.
std::string tls_failure(const std::string& address, const std::optional<TlsOptions>& tls, std::chrono::milliseconds timeout);

}  // namespace deform::client

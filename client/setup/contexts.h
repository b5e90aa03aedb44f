// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <map>
#include <string>

namespace deform::client {

/// A server and how to be let in, under a name.
struct Context {
  std::string server;       ///< HOST:PORT or unix:PATH, several with commas; empty: the usual one of this machine
  bool replicas = false;    ///< as ClientOptions
  bool tls = false;         ///< encrypt, also where nothing below says so
  std::string ca;           ///< file
  std::string cert;         ///< file
  std::string key;          ///< file
  std::string server_name;  ///< as TlsOptions
  std::string token_file;   ///< file
  bool operator==(const Context&) const = default;
};

/// The servers that a user knows, in a file of YAML:
///
///   current: cluster-a
///   contexts:
///     cluster-a: {server: a.example.org:50051, ca: /home/alice/ca.pem, token_file: /home/alice/a.token}
struct Contexts {
  std::string current;                     ///< name in `known`, or empty: none
  std::map<std::string, Context> known{};  ///< by name
  std::filesystem::path file{};            ///< where they were read, for errors

  /// Throws Error(not_found) with the names that there are.
  const Context& find(const std::string& name) const;
};

/// The environment variable DEFORM_CONFIG, or deform/contexts.yaml in the folder XDG_CONFIG_HOME or ~/.config; empty where none
/// of these is set.
std::filesystem::path contexts_file();

/// None where the file does not exist. Relative names of files in it start at its folder. Throws Error(invalid_argument) with
/// file, line and key.
Contexts read_contexts(const std::filesystem::path& file);

/// The text of such a file.
std::string to_yaml(const Contexts& contexts);

/// Letters, digits, '-', '_' and '.', at most 64. Throws Error(invalid_argument).
void check_context_name(const std::string& name);

}  // namespace deform::client

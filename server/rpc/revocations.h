// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <openssl/types.h>

#include <cstddef>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace deform::server {

/// Certificates of clients that their authorities have revoked before their end (lists of RFC 5280 in PEM). Immutable.
class Revocations {
 public:
  /// One file with any number of lists, each signed by an authority in `authorities`. A list that should have been renewed by now
  /// is logged and stays in force. Throws Error(invalid_argument) naming option, file and list.
  static Revocations read(const std::filesystem::path& lists, const std::filesystem::path& authorities);

  /// The name of the first certificate of a chain in PEM that its issuer has revoked. Any thread.
  std::optional<std::string> revoked(const std::string& chain) const;

  std::size_t lists() const { return lists_.size(); }  ///< in the file
  std::size_t certificates() const;                    ///< revoked by all of them

 private:
  struct FreeList {
    void operator()(X509_CRL* list) const;
  };
  std::vector<std::unique_ptr<X509_CRL, FreeList>> lists_;
};

}  // namespace deform::server

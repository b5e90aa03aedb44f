// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <openssl/types.h>

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

namespace deform::codec {

/// Frees what its pointer owns.
struct FreeCertificate {
  void operator()(X509* certificate) const;  ///< as OpenSSL does
};
/// A certificate of OpenSSL, or null.
using Certificate = std::unique_ptr<X509, FreeCertificate>;

/// The first certificate of a text in PEM; null if there is none. Any thread.
Certificate first_certificate(const std::string& pem);

/// All certificates of a text in PEM, in order; what cannot be read ends them. Any thread.
std::vector<Certificate> all_certificates(const std::string& pem);

/// A callback of OpenSSL (pem_password_cb) that gives none: its own would ask a terminal for a passphrase. Any thread.
int no_passphrase(char* buffer, int size, int writing, void* data);

/// A name in a certificate as RFC 2253 writes it, escaped and cut to 200 bytes. Any thread.
std::string name_text(const X509_NAME& name);

/// A file in PEM with what errors call it.
struct PemFile {
  std::string option;          ///< errors begin with "OPTION: PATH: "
  std::filesystem::path path;  ///< where it was read
  std::string text;            ///< all of it
};

/// Throws the errors of read_small_file(). Any thread.
PemFile read_pem_file(const std::string& option, const std::filesystem::path& path);

/// Throws Error(invalid_argument) if there is no certificate in the file. Any thread.
void check_certificates(const PemFile& file);

/// Throws Error(invalid_argument) if `certificate` has no certificate, `key` no private key without a passphrase, or the key is
/// not that of the first certificate. Any thread.
void check_key_pair(const PemFile& certificate, const PemFile& key);

}  // namespace deform::codec

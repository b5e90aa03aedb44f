// SPDX-License-Identifier: Apache-2.0
#include "core/codec/pem.h"

#include <openssl/pem.h>
#include <openssl/x509.h>

#include "core/base/error.h"
#include "core/base/small_file.h"
#include "core/base/text.h"

namespace deform::codec {

namespace {

constexpr std::size_t longest_name = 200;

struct FreeBio {
  void operator()(BIO* bio) const { BIO_free_all(bio); }
};
using Bio = std::unique_ptr<BIO, FreeBio>;

struct FreeKey {
  void operator()(EVP_PKEY* key) const { EVP_PKEY_free(key); }
};
using PrivateKey = std::unique_ptr<EVP_PKEY, FreeKey>;

Bio reader_of(const std::string& pem) { return Bio(BIO_new_mem_buf(pem.data(), static_cast<int>(pem.size()))); }

Error bad_file(const PemFile& file, const std::string& why) {
  return {ErrorCode::invalid_argument, file.option + ": " + file.path.string() + ": " + why};
}

Certificate certificate_of(const PemFile& file) {
  Certificate certificate = first_certificate(file.text);
  if (!certificate) throw bad_file(file, "no certificate in PEM");
  return certificate;
}

}  // namespace

void FreeCertificate::operator()(X509* certificate) const { X509_free(certificate); }

int no_passphrase(char*, int, int, void*) { return 0; }

Certificate first_certificate(const std::string& pem) {
  return Certificate(PEM_read_bio_X509(reader_of(pem).get(), nullptr, nullptr, nullptr));
}

std::vector<Certificate> all_certificates(const std::string& pem) {
  std::vector<Certificate> out;
  const Bio text = reader_of(pem);
  while (X509* next = PEM_read_bio_X509(text.get(), nullptr, nullptr, nullptr)) out.emplace_back(next);
  return out;
}

std::string name_text(const X509_NAME& name) {
  const Bio out(BIO_new(BIO_s_mem()));
  X509_NAME_print_ex(out.get(), &name, 0, XN_FLAG_RFC2253);
  char* text = nullptr;
  const long size = BIO_get_mem_data(out.get(), &text);
  return escaped({text, static_cast<std::size_t>(size)}, longest_name);
}

PemFile read_pem_file(const std::string& option, const std::filesystem::path& path) {
  return {option, path, read_small_file(path, option)};
}

void check_certificates(const PemFile& file) { certificate_of(file); }

void check_key_pair(const PemFile& certificate, const PemFile& key) {
  const Certificate first = certificate_of(certificate);
  const PrivateKey pair(PEM_read_bio_PrivateKey(reader_of(key.text).get(), nullptr, no_passphrase, nullptr));
  if (!pair) throw bad_file(key, "no private key in PEM without a passphrase");
  if (X509_check_private_key(first.get(), pair.get()) != 1) {
    throw bad_file(key, "does not belong to the certificate in " + certificate.path.string());
  }
}

}  // namespace deform::codec

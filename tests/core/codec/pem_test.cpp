// SPDX-License-Identifier: GPL-3.0-or-later
// Certificates and keys that the tests make themselves.
#include "core/codec/pem.h"

#include <gtest/gtest.h>
#include <openssl/ec.h>
#include <openssl/evp.h>
#include <openssl/pem.h>
#include <openssl/x509.h>

#include <memory>
#include <string>

#include "tests/support/expect_error.h"

namespace deform::codec::pem_test {
namespace {

using test::expect_error;

using Key = std::unique_ptr<EVP_PKEY, decltype(&EVP_PKEY_free)>;
Key new_key() { return {EVP_EC_gen("P-256"), &EVP_PKEY_free}; }

/// What `write` puts into a buffer of OpenSSL.
template <typename Write>
std::string written(const Write& write) {
  const std::unique_ptr<BIO, decltype(&BIO_free_all)> out(BIO_new(BIO_s_mem()), &BIO_free_all);
  EXPECT_EQ(write(out.get()), 1);
  char* text = nullptr;
  const long size = BIO_get_mem_data(out.get(), &text);
  return {text, static_cast<std::size_t>(size)};
}

/// A certificate of the key, signed by itself.
std::string certificate_pem(EVP_PKEY* key, const std::string& name) {
  const Certificate certificate(X509_new());
  X509_gmtime_adj(X509_getm_notBefore(certificate.get()), 0);
  X509_gmtime_adj(X509_getm_notAfter(certificate.get()), 3600);
  X509_set_pubkey(certificate.get(), key);
  X509_NAME* const subject = X509_get_subject_name(certificate.get());
  X509_NAME_add_entry_by_txt(subject, "CN", MBSTRING_UTF8, reinterpret_cast<const unsigned char*>(name.data()),
                             static_cast<int>(name.size()), -1, 0);
  X509_set_issuer_name(certificate.get(), subject);
  X509_sign(certificate.get(), key, EVP_sha256());
  return written([&](BIO* out) { return PEM_write_bio_X509(out, certificate.get()); });
}

std::string key_pem(EVP_PKEY* key, const char* passphrase = nullptr) {
  return written([&](BIO* out) {
    return PEM_write_bio_PrivateKey(out, key, passphrase != nullptr ? EVP_aes_128_cbc() : nullptr, nullptr, 0, nullptr,
                                    const_cast<char*>(passphrase));
  });
}

std::string subject(const X509* certificate) { return name_text(*X509_get_subject_name(certificate)); }

TEST(Pem, AKeyIsThatOfTheFirstCertificate) {
  const Key own = new_key(), other = new_key();
  const std::string first = certificate_pem(own.get(), "own"), second = certificate_pem(other.get(), "other");
  const PemFile chain{"--cert", "chain.pem", first + second};
  EXPECT_NO_THROW(check_key_pair(chain, {"--key", "own.pem", key_pem(own.get())}));
  expect_error(ErrorCode::invalid_argument, {"--key: other.pem: does not belong to the certificate in chain.pem"}, [&] {
    check_key_pair(chain, {"--key", "other.pem", key_pem(other.get())});
  });
}

TEST(Pem, AKeyThatCannotBeReadIsRefused) {
  const Key key = new_key();
  const std::string certificate = certificate_pem(key.get(), "own");
  const PemFile good{"--cert", "cert.pem", certificate};
  for (const std::string& text : {std::string(), certificate, key_pem(key.get(), "secret")}) {
    expect_error(ErrorCode::invalid_argument, {"--key: key.pem: no private key in PEM without a passphrase"}, [&] {
      check_key_pair(good, {"--key", "key.pem", text});
    });
  }
  expect_error(ErrorCode::invalid_argument, {"--cert: cert.pem: no certificate in PEM"}, [&] {
    check_key_pair({"--cert", "cert.pem", key_pem(key.get())}, {"--key", "key.pem", key_pem(key.get())});
  });
}

TEST(Pem, AFileWithoutACertificateIsRefused) {
  const Key key = new_key();
  const std::string certificate = certificate_pem(key.get(), "own");
  EXPECT_NO_THROW(check_certificates({"--ca", "ca.pem", "some words\n" + certificate}));
  for (const std::string& text : {std::string(), key_pem(key.get()), certificate.substr(0, certificate.size() / 2)}) {
    expect_error(ErrorCode::invalid_argument, {"--ca: ca.pem: no certificate in PEM"}, [&] {
      check_certificates({"--ca", "ca.pem", text});
    });
  }
}

TEST(Pem, AllCertificatesAreThoseBeforeDamage) {
  const Key key = new_key();
  const std::string a = certificate_pem(key.get(), "a"), b = certificate_pem(key.get(), "b");
  std::string damaged = certificate_pem(key.get(), "c");
  damaged[damaged.size() / 2] = '*';
  const std::vector<Certificate> all = all_certificates(a + "between\n" + b + damaged + a);
  ASSERT_EQ(all.size(), 2u);
  EXPECT_EQ(subject(all[0].get()), "CN=a");
  EXPECT_EQ(subject(all[1].get()), "CN=b");
  EXPECT_EQ(subject(first_certificate(b + a).get()), "CN=b");
  EXPECT_FALSE(first_certificate("none"));
  EXPECT_TRUE(all_certificates("").empty());
}

TEST(Pem, NamesAreEscapedAndShort) {
  const Key key = new_key();
  EXPECT_EQ(subject(first_certificate(certificate_pem(key.get(), "Smith, John")).get()), "CN=Smith\\x5c, John");
  const std::string long_name = subject(first_certificate(certificate_pem(key.get(), std::string(64, '\x01'))).get());
  EXPECT_LE(long_name.size(), 200u);
  EXPECT_TRUE(long_name.starts_with("CN=") && long_name.ends_with("...")) << long_name;
}

}  // namespace
}  // namespace deform::codec::pem_test

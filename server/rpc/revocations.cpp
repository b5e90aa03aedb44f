// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/rpc/revocations.h"

#include <openssl/pem.h>
#include <openssl/x509.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <utility>

#include "core/base/error.h"
#include "core/base/text.h"
#include "core/codec/pem.h"

namespace deform::server {

namespace {

bool signed_by(X509_CRL* list, const std::vector<codec::Certificate>& authorities) {
  return std::any_of(authorities.begin(), authorities.end(), [&](const codec::Certificate& authority) {
    EVP_PKEY* key = X509_get0_pubkey(authority.get());
    return X509_NAME_cmp(X509_get_subject_name(authority.get()), X509_CRL_get_issuer(list)) == 0 && key != nullptr &&
           X509_CRL_verify(list, key) == 1;
  });
}

}  // namespace

void Revocations::FreeList::operator()(X509_CRL* list) const { X509_CRL_free(list); }

Revocations Revocations::read(const std::filesystem::path& lists, const std::filesystem::path& authorities) {
  const codec::PemFile file = codec::read_pem_file("option tls-client-crl", lists);
  const auto known = codec::all_certificates(codec::read_pem_file("option tls-client-ca", authorities).text);
  const auto wrong = [&](const std::string& why) {
    return Error(ErrorCode::invalid_argument, file.option + ": " + file.path.string() + ": " + why);
  };
  Revocations out;
  const std::unique_ptr<BIO, decltype(&BIO_free_all)> text(BIO_new_mem_buf(file.text.data(), static_cast<int>(file.text.size())),
                                                           BIO_free_all);
  while (X509_CRL* list = PEM_read_bio_X509_CRL(text.get(), nullptr, nullptr, nullptr)) {
    out.lists_.emplace_back(list);
    const std::string issuer = codec::name_text(*X509_CRL_get_issuer(list));
    if (!signed_by(list, known)) {
      throw wrong("list " + std::to_string(out.lists_.size()) + ", of " + issuer + ": no authority in " + authorities.string() +
                  " has signed it");
    }
    const ASN1_TIME* renewal = X509_CRL_get0_nextUpdate(list);
    if (renewal != nullptr && X509_cmp_current_time(renewal) < 0) {
      spdlog::warn("revocations: the list of {} in {} should have been renewed; it stays in force", issuer,
                   escaped(lists.string(), 300));
    }
  }
  if (out.lists_.empty() || file.text.find("BEGIN X509 CRL", file.text.rfind("END X509 CRL")) != std::string::npos) {
    throw wrong(out.lists_.empty() ? "no list of revoked certificates in PEM"
                                   : "list " + std::to_string(out.lists_.size() + 1) + " cannot be read");
  }
  return out;
}

std::optional<std::string> Revocations::revoked(const std::string& chain) const {
  for (const codec::Certificate& certificate : codec::all_certificates(chain)) {
    for (const auto& list : lists_) {
      X509_REVOKED* entry = nullptr;
      if (X509_NAME_cmp(X509_get_issuer_name(certificate.get()), X509_CRL_get_issuer(list.get())) == 0 &&
          X509_CRL_get0_by_cert(list.get(), &entry, certificate.get()) == 1) {
        return codec::name_text(*X509_get_subject_name(certificate.get()));
      }
    }
  }
  return std::nullopt;
}

std::size_t Revocations::certificates() const {
  std::size_t count = 0;
  for (const auto& list : lists_) {
    const STACK_OF(X509_REVOKED)* entries = X509_CRL_get_REVOKED(list.get());
    if (entries != nullptr) count += static_cast<std::size_t>(sk_X509_REVOKED_num(entries));
  }
  return count;
}

}  // namespace deform::server

// SPDX-License-Identifier: Apache-2.0
#include "core/codec/geometry_id.h"

#include <openssl/evp.h>

#include <bit>
#include <string>

#include "core/base/error.h"

namespace deform::codec {

static_assert(std::endian::native == std::endian::little, "ids and blocks are written little endian as they lie in memory");

namespace {

EVP_MD_CTX* digest(void* context) { return static_cast<EVP_MD_CTX*>(context); }

void check_digest(int ok) {
  if (ok != 1) throw Error(ErrorCode::internal, "SHA-256 failed in the cryptography library");
}

void visit_count(const ByteSink& sink, std::uint64_t count) { sink(&count, sizeof(count)); }

template <typename T>
void visit_array(const ByteSink& sink, std::span<const T> array) {
  visit_count(sink, array.size());
  if (!array.empty()) sink(array.data(), array.size_bytes());
}

}  // namespace

Sha256::Sha256() : context_(EVP_MD_CTX_new()) {
  if (context_ == nullptr) throw std::bad_alloc();
  if (EVP_DigestInit_ex(digest(context_), EVP_sha256(), nullptr) != 1) {
    EVP_MD_CTX_free(digest(context_));
    throw Error(ErrorCode::internal, "SHA-256 is not available in the cryptography library");
  }
}

Sha256::~Sha256() { EVP_MD_CTX_free(digest(context_)); }

void Sha256::add(const void* data, std::size_t size) { check_digest(EVP_DigestUpdate(digest(context_), data, size)); }

std::string Sha256::hex() {
  unsigned char bytes[EVP_MAX_MD_SIZE];
  unsigned int size = 0;
  check_digest(EVP_DigestFinal_ex(digest(context_), bytes, &size));
  std::string text;
  text.reserve(2 * size);
  for (unsigned int i = 0; i < size; ++i) {
    text += "0123456789abcdef"[bytes[i] >> 4];
    text += "0123456789abcdef"[bytes[i] & 15];
  }
  return text;
}

void visit_geometry_bytes(const GeometryView& geometry, const ByteSink& sink) {
  char tag[] = "deform.geometry.1";  // with its terminating zero
  if (geometry.cells.any()) tag[sizeof(tag) - 2] = '2';
  sink(tag, sizeof(tag));
  visit_array(sink, geometry.points);
  visit_array(sink, geometry.face_sizes);
  visit_array(sink, geometry.face_points);
  visit_count(sink, geometry.groups.size());
  for (const auto& group : geometry.groups) {
    visit_array(sink, std::span<const char>(group.name.data(), group.name.size()));
    visit_array(sink, group.points);
    visit_array(sink, group.faces);
  }
  if (!geometry.cells.any()) return;
  visit_array(sink, geometry.cells.element_types);
  visit_array(sink, geometry.cells.element_points);
  visit_count(sink, geometry.cells.cell_count);
  visit_array(sink, geometry.cells.face_offsets);
  visit_array(sink, geometry.cells.face_points);
  visit_array(sink, geometry.cells.owner);
  visit_array(sink, geometry.cells.neighbour);
  visit_array(sink, geometry.cells.empty_faces);
}

std::string geometry_id(const GeometryView& geometry) {
  Sha256 hash;
  visit_geometry_bytes(geometry, [&](const void* data, std::size_t size) { hash.add(data, size); });
  return hash.hex();
}

}  // namespace deform::codec

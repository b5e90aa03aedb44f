// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/store/catalog_records.h"

#include <fcntl.h>

#include <charconv>
#include <cstdint>
#include <cstring>

#include "core/codec/geometry_id.h"
#include "proto/convert/setup.h"
#include "server/store/file.h"

namespace deform::server {

namespace {

constexpr char record_tag[] = "deform.record.1";  // with its terminating zero
constexpr std::size_t digest_digits = 64;
/// No record comes near; a file that claims to be longer is none.
constexpr std::size_t largest_file = std::size_t{1} << 30;

using Fields = std::vector<std::string>;

std::string joined(const Fields& fields) {
  std::string text;
  for (const auto& field : fields) {
    const std::uint64_t size = field.size();
    text.append(reinterpret_cast<const char*>(&size), sizeof(size));
    text += field;
  }
  return text;
}

std::string digest(const std::string& text) {
  codec::Sha256 hash;
  hash.add(text.data(), text.size());
  return hash.hex();
}

std::string sealed(const Fields& fields) {
  const std::string text = joined(fields);
  return std::string(record_tag, sizeof(record_tag)) + text + digest(text);
}

[[noreturn]] void damaged(const std::string& what) { throw Error(ErrorCode::data_loss, "store: " + what + " is damaged"); }

Fields unsealed(const std::string& text, const std::string& what) {
  if (text.size() < sizeof(record_tag) + digest_digits || std::memcmp(text.data(), record_tag, sizeof(record_tag)) != 0)
    damaged(what);
  const std::string body = text.substr(sizeof(record_tag), text.size() - sizeof(record_tag) - digest_digits);
  if (digest(body) != text.substr(text.size() - digest_digits)) damaged(what);
  Fields fields;
  for (std::size_t at = 0; at < body.size();) {
    std::uint64_t size = 0;
    if (body.size() - at < sizeof(size)) damaged(what);
    std::memcpy(&size, body.data() + at, sizeof(size));
    at += sizeof(size);
    if (body.size() - at < size) damaged(what);
    fields.push_back(body.substr(at, size));
    at += size;
  }
  return fields;
}

std::int64_t number(const std::string& text, const std::string& what) {
  std::int64_t value = 0;
  const auto [end, failure] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (failure != std::errc() || end != text.data() + text.size()) damaged(what);
  return value;
}

/// The tenant comes last, and for the default one not at all: what was stored before there were tenants is its own as it stands.
Fields with_tenant(Fields fields, const std::string& tenant) {
  if (tenant != default_tenant) fields.push_back(tenant);
  return fields;
}

Fields fields_of(const GeometryRecord& record) {
  return with_tenant({"geometry", record.id, record.info, std::to_string(record.created_ms)}, record.tenant);
}

Fields fields_of(const SetupRecord& record) {
  return with_tenant({"setup", record.id, record.geometry_id, record.setup, record.info, std::to_string(record.created_ms)},
                     record.tenant);
}

void write_sealed(const Fields& fields, const std::filesystem::path& path, Sync sync, FileSystem& files) {
  const std::string text = sealed(fields);
  const File file(files, path, O_WRONLY | O_CREAT | O_EXCL);
  try {
    file.write(text.data(), text.size());
    if (sync == Sync::now) file.sync();
  } catch (...) {
    try_remove(files, path);
    throw;
  }
}

/// `count`: of the fields without the tenant.
Fields read_sealed(const std::filesystem::path& path, const char* kind, std::size_t count, const OwnedId& id, FileSystem& files) {
  const std::string what = std::string("the stored record of ") + kind + " " + key_of(id);
  if (!is_file(files, path)) damaged(what);
  const std::size_t size = file_size(files, path);
  if (size > largest_file) damaged(what);
  std::string text(size, '\0');
  const File file(files, path, O_RDONLY);
  text.resize(file.read(text.data(), size));
  Fields fields = unsealed(text, what);
  const bool for_default = id.tenant == default_tenant;
  if (fields.size() != count + (for_default ? 0 : 1) || fields[0] != kind || fields[1] != id.id) damaged(what);
  if (!for_default && fields[count] != id.tenant) damaged(what);
  return fields;
}

}  // namespace

GeometryRecord geometry_record(v1::GeometryInfo info, std::int64_t registered_ms, const std::string& tenant) {
  info.set_registered_unix_ms(registered_ms);
  return {info.id(), info.SerializeAsString(), registered_ms, Integrity::intact, tenant};
}

v1::GeometryInfo recorded_info(const GeometryRecord& record) {
  v1::GeometryInfo info;
  info.ParseFromString(record.info);
  return info;
}

Error unknown_geometry(const std::string& id) { return {ErrorCode::not_found, "geometry " + id + ": unknown id"}; }

std::uint64_t content_bytes(const v1::GeometryInfo& info) {
  std::uint64_t bytes = 24 * info.points() + 4 * (info.faces() + info.corners()) + info.cell_bytes();
  for (const auto& group : info.groups()) bytes += group.name().size() + 4 * (group.points() + group.faces());
  return bytes;
}

std::uint64_t stored_bytes(const GeometryRecord& record) {
  v1::GeometryInfo info;
  if (record.integrity == Integrity::damaged || !info.ParseFromString(record.info)) return 0;
  return content_bytes(info) + record.info.size();
}

std::uint64_t stored_bytes(const SetupRecord& record) { return record.setup.size() + record.info.size(); }

std::string checksum(const GeometryRecord& record) { return digest(joined(fields_of(record))); }
std::string checksum(const SetupRecord& record) { return digest(joined(fields_of(record))); }

void write_record(const GeometryRecord& record, const std::filesystem::path& file, Sync sync, FileSystem& files) {
  write_sealed(fields_of(record), file, sync, files);
}

void write_record(const SetupRecord& record, const std::filesystem::path& file, Sync sync, FileSystem& files) {
  write_sealed(fields_of(record), file, sync, files);
}

GeometryRecord read_geometry_record(const std::filesystem::path& file, const OwnedId& id, FileSystem& files) {
  const Fields fields = read_sealed(file, "geometry", 4, id, files);
  return {fields[1], fields[2], number(fields[3], "the stored record of geometry " + key_of(id)), Integrity::intact, id.tenant};
}

SetupRecord read_setup_record(const std::filesystem::path& file, const OwnedId& id, FileSystem& files) {
  const Fields fields = read_sealed(file, "setup", 6, id, files);
  return {fields[1],         fields[2], fields[3], fields[4], number(fields[5], "the stored record of setup " + key_of(id)),
          Integrity::intact, id.tenant};
}

void verify(const SetupRecord& record) {
  v1::Setup setup;
  if (!setup.ParseFromString(record.setup) || convert::system_id(setup) != record.id || setup.geometry() != record.geometry_id) {
    damaged("the setup of system " + record.id);
  }
}

std::string encode(const Intent& intent) {
  Fields fields = {intent.kind == Intent::Kind::put ? "put" : "remove"};
  for (const auto& entry : intent.entries) {
    const char* what = entry.what == Intent::What::geometry ? "geometry" : "setup";
    fields.insert(fields.end(), {what, key_of({entry.tenant, entry.id}), std::to_string(entry.created_ms), entry.info});
  }
  return sealed(fields);
}

Intent decode_intent(const std::string& text) {
  const Fields fields = unsealed(text, "an intent");
  if (fields.size() % 4 != 1) damaged("an intent");
  Intent intent;
  intent.kind = fields[0] == "put" ? Intent::Kind::put : Intent::Kind::remove;
  for (std::size_t i = 1; i < fields.size(); i += 4) {
    const auto what = fields[i] == "geometry" ? Intent::What::geometry : Intent::What::setup;
    const auto named = owned_id(fields[i + 1]);
    if (!named) damaged("an intent");  // it becomes the name of a file
    intent.entries.push_back({what, named->id, number(fields[i + 2], "an intent"), fields[i + 3], named->tenant});
  }
  return intent;
}

}  // namespace deform::server

// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "core/base/error.h"
#include "deform/v1/geometry.pb.h"
#include "server/store/catalog.h"
#include "server/store/file_system.h"

namespace deform::server {

/// Records as bytes: for checksums, and as the small files from which a catalog is rebuilt. Such a file is a tag, the fields of
/// the record, each after its length, and the SHA-256 of the fields in hexadecimal digits.

/// The record of a geometry that a tenant registered at that time (milliseconds since 1970).
GeometryRecord geometry_record(v1::GeometryInfo info, std::int64_t registered_ms, const std::string& tenant);

/// The error for a tenant that does not have the geometry.
Error unknown_geometry(const std::string& id);
/// What an intact row says.
v1::GeometryInfo recorded_info(const GeometryRecord& record);

/// About what a record takes on the disk, the content of a geometry included. 0 for a geometry whose record is damaged.
std::uint64_t stored_bytes(const GeometryRecord& record);
std::uint64_t stored_bytes(const SetupRecord& record);
/// The bytes of the content of a geometry, by its description.
std::uint64_t content_bytes(const v1::GeometryInfo& info);

/// SHA-256 of all fields, in hexadecimal digits.
std::string checksum(const GeometryRecord& record);
std::string checksum(const SetupRecord& record);

/// For writing many files and syncing once.
enum class Sync { now, later };

/// Writes a new file, which is removed again when that fails.
void write_record(const GeometryRecord& record, const std::filesystem::path& file, Sync sync, FileSystem& files);
void write_record(const SetupRecord& record, const std::filesystem::path& file, Sync sync, FileSystem& files);

/// Throws Error(data_loss) when the file is not a whole record of that id and tenant, and as a File does.
GeometryRecord read_geometry_record(const std::filesystem::path& file, const OwnedId& id, FileSystem& files);
SetupRecord read_setup_record(const std::filesystem::path& file, const OwnedId& id, FileSystem& files);

/// Throws Error(data_loss) unless the id is the hash of the setup and the setup is one of its geometry.
void verify(const SetupRecord& record);

/// An intent as one string that notices damage. decode throws Error(data_loss).
std::string encode(const Intent& intent);
Intent decode_intent(const std::string& text);

}  // namespace deform::server

#include "server/geometry_store.h"

#include <fcntl.h>
#include <spdlog/spdlog.h>
#include <sys/file.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <chrono>
#include <cstring>

#include "core/base/error.h"
#include "core/mesh/cells.h"
#include "core/mesh/elements.h"
#include "core/mesh/inspect.h"
#include "server/geometry_file.h"
#include "server/sqlite_catalog.h"

namespace deform::server {

namespace {

constexpr std::size_t id_digits = 64;
constexpr std::size_t shortest_prefix = 8;
constexpr std::size_t largest_page = 1000;

bool is_hexadecimal(const std::string& text) {
  return std::all_of(text.begin(), text.end(), [](char c) { return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'f'); });
}

void check_id(const char* what, const std::string& id) {
  if (id.size() >= shortest_prefix && id.size() <= id_digits && is_hexadecimal(id)) return;
  throw Error(ErrorCode::invalid_argument, std::string(what) + " id \"" + id.substr(0, id_digits + 8) +
                                               "\": expected 64 lower-case hexadecimal digits or the first 8 or more of them");
}

std::string only_one(const char* what, const std::string& id, const std::vector<std::string>& found) {
  if (found.empty()) throw Error(ErrorCode::not_found, std::string(what) + " " + id + ": unknown id");
  if (found.size() > 1) {
    throw Error(ErrorCode::invalid_argument, std::string(what) + " " + id + ": several ids start so (" + found[0].substr(0, 16) +
                                                 ", " + found[1].substr(0, 16) + "); give more digits");
  }
  return found[0];
}

v1::GeometryInfo describe(const Mesh& mesh, const std::string& id, const std::string& name) {
  v1::GeometryInfo info;
  info.set_id(id);
  info.set_name(name);
  info.set_points(mesh.point_count());
  info.set_faces(mesh.face_count());
  info.set_corners(mesh.face_points.size());
  const auto group_points = group_point_counts(mesh);
  for (std::size_t g = 0; g < mesh.groups.size(); ++g) {
    auto* entry = info.add_groups();
    entry->set_name(mesh.groups[g].name);
    entry->set_points(mesh.groups[g].points.size());
    entry->set_faces(mesh.groups[g].faces.size());
    entry->set_all_points(group_points[g]);
  }
  info.set_cells(mesh.cell_count());
  if (mesh.elements) info.set_cell_bytes(mesh.elements->bytes());
  if (mesh.cells) info.set_cell_bytes(mesh.cells->bytes());
  const Box box = bounding_box(mesh.points);
  for (int k = 0; k < 3; ++k) {
    info.add_box_min(box.min[k]);
    info.add_box_max(box.max[k]);
  }
  info.set_diagonal(box.diagonal());
  return info;
}

v1::GeometryInfo parse_info(const GeometryRecord& record) {
  v1::GeometryInfo info;
  if (!info.ParseFromString(record.info)) {
    throw Error(ErrorCode::data_loss, "catalog: the entry of geometry " + record.id + " is damaged");
  }
  return info;
}

int lock_directory(const std::filesystem::path& directory) {
  const std::filesystem::path file = directory / "lock";
  const int descriptor = ::open(file.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0640);
  if (descriptor < 0) {
    throw Error(ErrorCode::unavailable, "store: cannot open " + file.string() + ": " + std::strerror(errno));
  }
  if (::flock(descriptor, LOCK_EX | LOCK_NB) != 0) {
    ::close(descriptor);
    throw Error(ErrorCode::unavailable, "store: the data directory " + directory.string() + " is in use by another process");
  }
  return descriptor;
}

}  // namespace

GeometryStore::GeometryStore(const std::filesystem::path& directory) : directory_(directory) {
  std::error_code error;
  for (const auto& path : {directory, directory / "geometries", directory / "tmp"}) {
    std::filesystem::create_directories(path, error);
    if (error) throw Error(ErrorCode::unavailable, "store: cannot create " + path.string() + ": " + error.message());
  }
  lock_descriptor_ = lock_directory(directory);
  try {
    sync_directory(directory);
    catalog_ = open_sqlite_catalog(directory / "catalog.sqlite");
    collect_orphans();
  } catch (...) {
    ::close(lock_descriptor_);
    throw;
  }
}

GeometryStore::~GeometryStore() {
  catalog_.reset();
  ::close(lock_descriptor_);
}

void GeometryStore::collect_orphans() {
  std::size_t removed = 0;
  for (const auto& entry : std::filesystem::directory_iterator(directory_ / "tmp")) {
    removed += std::filesystem::remove_all(entry.path());
  }
  for (const auto& entry : std::filesystem::directory_iterator(directory_ / "geometries")) {
    if (catalog_->find_geometry(entry.path().filename().string())) continue;
    removed += std::filesystem::remove_all(entry.path());
  }
  if (removed > 0) spdlog::info("store: removed {} files that interrupted uploads left behind", removed);
}

std::filesystem::path GeometryStore::file_of(const std::string& id) const { return directory_ / "geometries" / id; }

v1::GeometryInfo GeometryStore::put(const Mesh& mesh, const std::string& id, const std::string& name) {
  if (contains(id)) {
    v1::GeometryInfo info = this->info(id);
    info.set_existed(true);
    return info;
  }
  v1::GeometryInfo info = describe(mesh, id, name);
  info.set_registered_unix_ms(unix_ms());
  const std::filesystem::path temporary = directory_ / "tmp" / (id + "." + std::to_string(next_temporary_++));
  write_geometry_file(mesh, temporary);

  bool added = false;
  {
    const std::lock_guard lock(visibility_);
    std::error_code error;
    std::filesystem::rename(temporary, file_of(id), error);
    if (error) throw Error(ErrorCode::unavailable, "store: cannot move " + temporary.string() + ": " + error.message());
    sync_directory(directory_ / "geometries");
    added = catalog_->add_geometry({id, info.SerializeAsString(), info.registered_unix_ms()});
  }
  if (added) return info;
  info = this->info(id);
  info.set_existed(true);
  return info;
}

bool GeometryStore::contains(const std::string& id) {
  std::error_code error;
  return catalog_->find_geometry(id).has_value() && std::filesystem::exists(file_of(id), error);
}

v1::GeometryInfo GeometryStore::info(const std::string& id) {
  const auto record = catalog_->find_geometry(id);
  if (!record) throw Error(ErrorCode::not_found, "geometry " + id + ": unknown id");
  v1::GeometryInfo info = parse_info(*record);
  info.set_setups(static_cast<std::uint32_t>(catalog_->setup_count(id)));
  return info;
}

Mesh GeometryStore::load(const std::string& id) {
  if (!catalog_->find_geometry(id)) throw Error(ErrorCode::not_found, "geometry " + id + ": unknown id");
  std::error_code error;
  if (!std::filesystem::exists(file_of(id), error)) {
    throw Error(ErrorCode::data_loss, "geometry " + id + ": the stored file is missing; register the geometry again");
  }
  try {
    return read_geometry_file(file_of(id), id);
  } catch (const Error& damage) {
    if (damage.code() == ErrorCode::data_loss) quarantine(id);
    throw;
  }
}

// Out of the way, so that registering again stores a good file.
void GeometryStore::quarantine(const std::string& id) {
  const std::lock_guard lock(visibility_);
  std::error_code error;
  std::filesystem::rename(file_of(id), directory_ / "tmp" / (id + ".damaged"), error);
  spdlog::error("store: the file of geometry {} is damaged and was set aside", id);
}

std::vector<std::string> GeometryStore::remove(const std::string& id, WithSetups policy) {
  const std::lock_guard lock(visibility_);
  std::vector<std::string> setups = catalog_->remove_geometry(id, policy);
  std::error_code error;
  std::filesystem::remove(file_of(id), error);  // left behind, it is an orphan that the next start collects
  return setups;
}

v1::ListGeometriesReply GeometryStore::list(const v1::ListGeometriesRequest& request) {
  const std::size_t limit = page_size(request.page_size());
  const auto records = catalog_->list_geometries(parse_page_token(request.page_token()), limit);
  v1::ListGeometriesReply reply;
  for (const auto& record : records) {
    *reply.add_geometries() = parse_info(record);
    reply.mutable_geometries(reply.geometries_size() - 1)
        ->set_setups(static_cast<std::uint32_t>(catalog_->setup_count(record.id)));
  }
  if (records.size() == limit) reply.set_next_page_token(page_token(records.back().created_ms, records.back().id));
  return reply;
}

std::string GeometryStore::resolve_geometry(const std::string& id) {
  check_id("geometry", id);
  return only_one("geometry", id, catalog_->geometry_ids(id, 2));
}

std::string GeometryStore::resolve_setup(const std::string& id) {
  check_id("system", id);
  return only_one("system", id, catalog_->setup_ids(id, 2));
}

std::string page_token(std::int64_t created_ms, const std::string& id) { return std::to_string(created_ms) + ":" + id; }

std::optional<PageStart> parse_page_token(const std::string& token) {
  if (token.empty()) return std::nullopt;
  PageStart start;
  const std::size_t colon = token.find(':');
  const auto [end, error] = std::from_chars(token.data(), token.data() + token.size(), start.created_ms);
  if (colon == std::string::npos || error != std::errc() || end != token.data() + colon) {
    throw Error(ErrorCode::invalid_argument, "page_token: not one that a listing returned");
  }
  start.id = token.substr(colon + 1);
  if (start.id.size() != id_digits || !is_hexadecimal(start.id)) {
    throw Error(ErrorCode::invalid_argument, "page_token: not one that a listing returned");
  }
  return start;
}

std::size_t page_size(std::uint32_t requested) {
  if (requested > largest_page) {
    throw Error(ErrorCode::invalid_argument,
                "page_size: " + std::to_string(requested) + " is more than " + std::to_string(largest_page));
  }
  return requested == 0 ? largest_page : requested;
}

std::int64_t unix_ms() {
  return std::chrono::duration_cast<std::chrono::milliseconds>(std::chrono::system_clock::now().time_since_epoch()).count();
}

}  // namespace deform::server

// SPDX-License-Identifier: GPL-3.0-or-later
// SQLite on a simulated disk, with the syncs and locks of SQLite's own VFS for Unix.
#include <fcntl.h>
#include <sqlite3.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <new>
#include <string>

#include "tests/server/simulated_disk.h"

namespace deform::server {

namespace {

struct VfsFile {
  sqlite3_file base;
  SimulatedDisk* disk;
  std::uint64_t node;
  int descriptor, level;
  bool syncs_name, maps;  ///< a new log: its name becomes durable with its first sync
  char path[256];
};

VfsFile& file_of(sqlite3_file* file) { return *reinterpret_cast<VfsFile*>(file); }
SimulatedDisk& disk_of(sqlite3_vfs* vfs) { return *static_cast<SimulatedDisk*>(vfs->pAppData); }

int sync_folder(SimulatedDisk& disk, const char* path) {
  const int directory = disk.open(FileSystem::Path(path).parent_path(), O_RDONLY | O_DIRECTORY);
  if (directory < 0) return -1;
  const int result = disk.sync(directory);
  disk.close(directory);
  return result;
}

int unlock(sqlite3_file* file, int level) {
  VfsFile& f = file_of(file);
  auto& shared = f.disk->shared(f.node);
  if (f.level <= level) return SQLITE_OK;
  if (shared.exclusive == file) shared.exclusive = nullptr;
  if (shared.reserved == file) shared.reserved = nullptr;
  if (level == SQLITE_LOCK_NONE && f.level > SQLITE_LOCK_NONE) --shared.readers;
  f.level = level;
  return SQLITE_OK;
}

int lock(sqlite3_file* file, int level) {
  VfsFile& f = file_of(file);
  auto& shared = f.disk->shared(f.node);
  if (f.level >= level) return SQLITE_OK;
  if (shared.exclusive != nullptr && shared.exclusive != file) return SQLITE_BUSY;
  if (level == SQLITE_LOCK_SHARED) {
    ++shared.readers;
  } else if (level == SQLITE_LOCK_RESERVED) {
    if (shared.reserved != nullptr) return SQLITE_BUSY;
    shared.reserved = file;
  } else {
    if (shared.reserved != nullptr && shared.reserved != file) return SQLITE_BUSY;
    if (level == SQLITE_LOCK_EXCLUSIVE && shared.readers > 1) return SQLITE_BUSY;
    shared.exclusive = file;
  }
  f.level = level;
  return SQLITE_OK;
}

int shm_unmap(sqlite3_file* file, int) {
  VfsFile& f = file_of(file);
  if (!f.maps) return SQLITE_OK;
  f.maps = false;
  auto& shared = f.disk->shared(f.node);
  if (--shared.connections == 0) shared.regions.clear();
  return SQLITE_OK;
}

int close(sqlite3_file* file) {
  VfsFile& f = file_of(file);
  shm_unmap(file, 0);
  unlock(file, SQLITE_LOCK_NONE);
  f.disk->close(f.descriptor);
  return SQLITE_OK;
}

int read(sqlite3_file* file, void* data, int size, sqlite3_int64 offset) {
  VfsFile& f = file_of(file);
  const ssize_t got = f.disk->read_at(f.node, data, static_cast<std::size_t>(size), static_cast<std::uint64_t>(offset));
  if (got < 0) return SQLITE_IOERR_READ;
  if (got == size) return SQLITE_OK;
  std::memset(static_cast<char*>(data) + got, 0, static_cast<std::size_t>(size - got));
  return SQLITE_IOERR_SHORT_READ;
}

int write(sqlite3_file* file, const void* data, int size, sqlite3_int64 offset) {
  VfsFile& f = file_of(file);
  const ssize_t written = f.disk->write_at(f.node, data, static_cast<std::size_t>(size), static_cast<std::uint64_t>(offset));
  if (written == size) return SQLITE_OK;
  return written >= 0 || errno == ENOSPC ? SQLITE_FULL : SQLITE_IOERR_WRITE;
}

int truncate(sqlite3_file* file, sqlite3_int64 size) {
  VfsFile& f = file_of(file);
  return f.disk->truncate_node(f.node, static_cast<std::uint64_t>(size)) == 0 ? SQLITE_OK : SQLITE_IOERR_TRUNCATE;
}

int sync(sqlite3_file* file, int) {
  VfsFile& f = file_of(file);
  if (f.disk->sync_node(f.node) != 0) return SQLITE_IOERR_FSYNC;
  if (f.syncs_name && sync_folder(*f.disk, f.path) != 0) return SQLITE_IOERR_DIR_FSYNC;
  f.syncs_name = false;
  return SQLITE_OK;
}

int size(sqlite3_file* file, sqlite3_int64* bytes) {
  *bytes = static_cast<sqlite3_int64>(file_of(file).disk->size_of(file_of(file).node));
  return SQLITE_OK;
}

int is_reserved(sqlite3_file* file, int* result) {
  const auto& shared = file_of(file).disk->shared(file_of(file).node);
  *result = shared.reserved != nullptr || shared.exclusive != nullptr ? 1 : 0;
  return SQLITE_OK;
}

int control(sqlite3_file*, int, void*) { return SQLITE_NOTFOUND; }
int sector_size(sqlite3_file*) { return 4096; }
int characteristics(sqlite3_file*) { return SQLITE_IOCAP_POWERSAFE_OVERWRITE; }

int shm_map(sqlite3_file* file, int region, int bytes, int extend, void volatile** memory) {
  VfsFile& f = file_of(file);
  auto& shared = f.disk->shared(f.node);
  if (!f.maps) {
    f.maps = true;
    ++shared.connections;
  }
  *memory = nullptr;
  const auto wanted = static_cast<std::size_t>(region) + 1;
  if (shared.regions.size() < wanted && extend == 0) return SQLITE_OK;
  while (shared.regions.size() < wanted) shared.regions.push_back(std::make_unique<char[]>(static_cast<std::size_t>(bytes)));
  *memory = shared.regions[wanted - 1].get();
  return SQLITE_OK;
}

int shm_lock(sqlite3_file* file, int first, int count, int flags) {
  auto& shared = file_of(file).disk->shared(file_of(file).node);
  const bool exclusive = (flags & SQLITE_SHM_EXCLUSIVE) != 0;
  if ((flags & SQLITE_SHM_LOCK) != 0) {
    for (int i = first; i < first + count; ++i) {
      if (shared.exclusive_locks[i] != nullptr || (exclusive && shared.shared_locks[i] > 0)) return SQLITE_BUSY;
    }
  }
  for (int i = first; i < first + count; ++i) {
    const bool takes = (flags & SQLITE_SHM_LOCK) != 0;
    if (exclusive) {
      if (takes || shared.exclusive_locks[i] == file) shared.exclusive_locks[i] = takes ? file : nullptr;
    } else if (takes || shared.shared_locks[i] > 0) {
      shared.shared_locks[i] += takes ? 1 : -1;
    }
  }
  return SQLITE_OK;
}

void shm_barrier(sqlite3_file*) {}

const sqlite3_io_methods methods = [] {
  sqlite3_io_methods m{};
  m.iVersion = 2;
  m.xClose = close;
  m.xRead = read;
  m.xWrite = write;
  m.xTruncate = truncate;
  m.xSync = sync;
  m.xFileSize = size;
  m.xLock = lock;
  m.xUnlock = unlock;
  m.xCheckReservedLock = is_reserved;
  m.xFileControl = control;
  m.xSectorSize = sector_size;
  m.xDeviceCharacteristics = characteristics;
  m.xShmMap = shm_map;
  m.xShmLock = shm_lock;
  m.xShmBarrier = shm_barrier;
  m.xShmUnmap = shm_unmap;
  return m;
}();

int open(sqlite3_vfs* vfs, const char* name, sqlite3_file* file, int flags, int* out_flags) {
  VfsFile& f = *new (file) VfsFile{};
  SimulatedDisk& disk = disk_of(vfs);
  const std::string path = name == nullptr ? "/temporary-" + std::to_string(disk.random()) : name;
  if (path.size() >= sizeof(f.path)) return SQLITE_CANTOPEN;
  struct stat status {};
  const bool there = disk.status(path, FileSystem::Links::follow, status) == 0;
  int how = (flags & SQLITE_OPEN_READWRITE) != 0 ? O_RDWR : O_RDONLY;
  if ((flags & SQLITE_OPEN_CREATE) != 0) how |= O_CREAT;
  const int descriptor = disk.open(path, how);
  if (descriptor < 0) return errno == ENOSPC ? SQLITE_FULL : SQLITE_CANTOPEN;
  f.disk = &disk;
  f.descriptor = descriptor;
  f.node = disk.node_of(descriptor);
  f.syncs_name = !there && (flags & (SQLITE_OPEN_WAL | SQLITE_OPEN_MAIN_JOURNAL | SQLITE_OPEN_SUPER_JOURNAL)) != 0;
  path.copy(f.path, sizeof(f.path) - 1);
  if (name == nullptr || (flags & SQLITE_OPEN_DELETEONCLOSE) != 0) disk.remove(path);
  f.base.pMethods = &methods;
  if (out_flags != nullptr) *out_flags = flags;
  return SQLITE_OK;
}

int remove(sqlite3_vfs* vfs, const char* name, int sync_it) {
  if (disk_of(vfs).remove(name) != 0) return errno == ENOENT ? SQLITE_IOERR_DELETE_NOENT : SQLITE_IOERR_DELETE;
  return sync_it != 0 && sync_folder(disk_of(vfs), name) != 0 ? SQLITE_IOERR_DIR_FSYNC : SQLITE_OK;
}

int access(sqlite3_vfs* vfs, const char* name, int flags, int* result) {
  struct stat status {};
  const bool there = disk_of(vfs).status(name, FileSystem::Links::follow, status) == 0;
  *result = there && (flags != SQLITE_ACCESS_EXISTS || status.st_size > 0 || !S_ISREG(status.st_mode)) ? 1 : 0;
  return SQLITE_OK;
}

int full_name(sqlite3_vfs*, const char* name, int size, char* full) {
  sqlite3_snprintf(size, full, "%s", name);
  return SQLITE_OK;
}

int random_bytes(sqlite3_vfs* vfs, int size, char* bytes) {
  for (int i = 0; i < size; ++i) bytes[i] = static_cast<char>(disk_of(vfs).random());
  return size;
}

int sleep(sqlite3_vfs*, int microseconds) { return microseconds; }

int now(sqlite3_vfs*, double* days) {
  *days = 2460000.5;
  return SQLITE_OK;
}

int last_error(sqlite3_vfs*, int, char*) { return 0; }

}  // namespace

std::unique_ptr<sqlite3_vfs> register_vfs(SimulatedDisk& disk, const char* name) {
  auto vfs = std::make_unique<sqlite3_vfs>();
  vfs->iVersion = 1;
  vfs->szOsFile = sizeof(VfsFile);
  vfs->mxPathname = 250;
  vfs->zName = name;
  vfs->pAppData = &disk;
  vfs->xOpen = open;
  vfs->xDelete = remove;
  vfs->xAccess = access;
  vfs->xFullPathname = full_name;
  vfs->xRandomness = random_bytes;
  vfs->xSleep = sleep;
  vfs->xCurrentTime = now;
  vfs->xGetLastError = last_error;
  sqlite3_vfs_register(vfs.get(), 0);
  return vfs;
}

}  // namespace deform::server

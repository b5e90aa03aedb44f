// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/store/store_commands.h"

#include <algorithm>
#include <set>
#include <utility>

#include "core/base/error.h"
#include "core/base/number_text.h"
#include "server/store/catalog_rebuild.h"
#include "server/store/catalog_records.h"
#include "server/store/file.h"
#include "server/store/geometry_file.h"
#include "server/store/sqlite_catalog.h"
#include "server/store/sqlite_files.h"
#include "server/store/store_copy.h"
#include "server/store/store_directory.h"

namespace deform::server {

namespace {

namespace fs = std::filesystem;

void say(StoreReport& report, const std::string& line) { report.lines.push_back(line); }

std::string counted(std::size_t count, const std::string& what) { return std::to_string(count) + " " + what; }

/// Runs `verify`; its Error becomes a line.
template <typename Verify>
void check_one(StoreReport& report, const std::string& what, Verify verify) {
  try {
    verify();
  } catch (const Error& error) {
    complain(report, what + ": " + error.public_message());
  } catch (const std::exception& error) {
    complain(report, what + ": " + error.what());
  }
}

bool is_empty_or_missing(FileSystem& files, const fs::path& file) { return !is_seen(files, file) || file_size(files, file) == 0; }

std::set<std::string> keys_of(const std::vector<OwnedId>& ids) {
  std::set<std::string> keys;
  for (const auto& id : ids) keys.insert(key_of(id));
  return keys;
}

void check_rows(StoreReport& report, const Catalog::Damaged& damaged) {
  for (const auto& record : damaged.geometries)
    complain(report, named("geometry", owned(record)) + ": its entry in the catalog is damaged");
  for (const auto& record : damaged.setups)
    complain(report, named("system", owned(record)) + ": its entry in the catalog is damaged");
}

void check_geometry(const StoreDirectory& directory, const OwnedId& id) {
  read_geometry_file(directory.geometries() / key_of(id), id.id, directory.files()).validate();
}

void check_setup(const StoreDirectory& directory, const OwnedId& id) {
  verify(read_setup_record(directory.setups() / key_of(id), id, directory.files()));
}

/// Files of a folder that no row names, which the next start would look at.
void check_strangers(StoreReport& report, FileSystem& files, const fs::path& folder, const std::vector<OwnedId>& ids) {
  const std::set<std::string> known = keys_of(ids);
  for (const fs::path& path : entries_of(files, folder)) {
    if (known.count(path.filename().string()) == 0) {
      complain(report, files.shown(path) + ": not in the catalog; the next start adopts it or moves it to unclaimed/");
    }
  }
}

/// Every file of the three folders that is there now. One that a server removes meanwhile is left out.
void take_files(FileSystem& files, const fs::path& from, StoreCopy& copy) {
  for (const char* folder : StoreCopy::folders) {
    for (const fs::path& path : entries_of(files, from / folder)) {
      const std::string name = path.filename().string();
      if (owned_id(name)) copy.take(path, folder, name);
    }
  }
}

/// Who has how much, where there is more than the default tenant.
void say_amounts(StoreReport& report, Catalog& catalog) {
  const auto amounts = catalog.amounts();
  if (amounts.empty() || (amounts.size() == 1 && amounts.begin()->first == default_tenant)) return;
  for (const auto& [tenant, amount] : amounts) {
    say(report, "tenant " + tenant + ": " + counted(amount.geometries, "geometries, ") + counted(amount.setups, "setups, ") +
                    mebibytes(amount.bytes));
  }
}

struct Ids {
  std::vector<OwnedId> geometries, setups;
};

Ids ids_of(FileSystem& files, const fs::path& catalog) {
  const auto opened = open_sqlite_catalog(catalog, files);
  return {opened->all_geometries(), opened->all_setups()};
}

/// Files of rows that are not there.
std::set<fs::path> missing(FileSystem& files, const fs::path& root, const Ids& ids) {
  std::set<fs::path> found;
  const auto look = [&](const char* folder, const std::vector<OwnedId>& owned) {
    for (const auto& name : keys_of(owned)) {
      if (!exists(files, root / folder / name)) found.insert(root / folder / name);
    }
  };
  look("geometries", ids.geometries);
  look("names", ids.geometries);
  look("setups", ids.setups);
  return found;
}

StoreReport copy_store(const fs::path& from, const fs::path& to, FileSystem& files) {
  if (is_interrupted_copy(from, files)) {
    throw Error(ErrorCode::failed_precondition,
                "store: " + files.shown(from) +
                    " has no mark; if a backup to it was interrupted, it lacks files: remove it and "
                    "make another one");
  }
  if (!has_mark(from, files)) {
    throw Error(ErrorCode::failed_precondition, "store: " + files.shown(from) +
                                                    " is not a store of deformd (it has no mark); one of 0.1 becomes one when a "
                                                    "server starts on it");
  }
  const fs::path source = fs::weakly_canonical(from), target = fs::weakly_canonical(to);
  if (std::mismatch(source.begin(), source.end(), target.begin(), target.end()).first == source.end()) {
    throw Error(ErrorCode::invalid_argument,
                "store: " + to.string() + " is inside " + files.shown(from) + "; name a folder elsewhere");
  }
  StoreCopy copy(to, "the store in " + source.string(), files);
  // Every file of a row is there when the row is: so files first, then the catalog, then what came in between. What came and went
  // in between is found in the next round; what is missing in two of them is missing in the original.
  Ids ids;
  std::set<fs::path> before;
  constexpr int rounds = 10;
  for (int round = 0;; ++round) {
    take_files(files, from, copy);
    copy.drop_catalog();
    copy_catalog(from / "catalog.sqlite", copy.catalog(), files);
    take_files(files, from, copy);
    ids = ids_of(files, copy.catalog());
    std::set<fs::path> now = missing(files, to, ids);
    if (now.empty() || (round > 0 && now == before)) break;
    if (round == rounds) throw Error(ErrorCode::unavailable, "store: " + files.shown(from) + " changes too fast to be copied");
    before = std::move(now);
  }
  // Files of what was deleted or not yet registered when the catalog was copied.
  for (const char* folder : {"geometries", "names"}) copy.drop_others(folder, keys_of(ids.geometries));
  copy.drop_others("setups", keys_of(ids.setups));
  copy.finish();
  StoreReport report;
  say(report, counted(ids.geometries.size(), "geometries, ") + counted(ids.setups.size(), "setups"));
  for (const auto& id : ids.geometries) {
    if (!exists(files, to / "geometries" / key_of(id)))
      complain(report, named("geometry", id) + ": its file is missing in " + files.shown(from));
  }
  return report;
}

/// With the errors of the file system as ours.
template <typename Work>
StoreReport guarded(Work work) {
  try {
    return work();
  } catch (const fs::filesystem_error& error) {
    throw Error(ErrorCode::unavailable, std::string("store: ") + error.what())
        .with_public_message("store: " + error.code().message());
  }
}

}  // namespace

void complain(StoreReport& report, const std::string& line) {
  report.outcome = StoreReport::Outcome::faults;
  say(report, line);
}

std::string named(const char* what, const OwnedId& id) {
  return std::string(what) + " " + id.id + (id.tenant == default_tenant ? "" : " of tenant " + id.tenant);
}

StoreReport check_store(const fs::path& data_dir, FileSystem& files) {
  return guarded([&] {
    const StoreDirectory directory(data_dir, StoreDirectory::Accept::existing, files);
    StoreReport report;
    std::unique_ptr<Catalog> catalog;
    Catalog::Damaged damaged;
    try {
      if (is_empty_or_missing(files, directory.catalog())) throw Error(ErrorCode::data_loss, "the catalog is missing or empty");
      catalog = open_sqlite_catalog(directory.catalog(), files);
      damaged = catalog->check();
    } catch (const Error& error) {
      if (error.code() != ErrorCode::data_loss) throw;
      complain(report, std::string(error.public_message()) +
                           "; the next start, or \"deformd store rebuild\", makes a new one of the files");
      return report;
    }
    check_rows(report, damaged);
    const auto geometries = catalog->all_geometries(), setups = catalog->all_setups();
    for (const auto& id : geometries) {
      check_one(report, named("geometry", id), [&] { check_geometry(directory, id); });
      check_one(report, named("geometry", id),
                [&] { read_geometry_record(directory.names() / key_of(id), id, directory.files()); });
    }
    for (const auto& id : setups) {
      check_one(report, named("system", id), [&] { check_setup(directory, id); });
    }
    check_strangers(report, files, directory.geometries(), geometries);
    check_strangers(report, files, directory.names(), geometries);
    check_strangers(report, files, directory.setups(), setups);
    const DiskSpace disk(directory.root(), directory.reserve(), {}, files);
    check_bases(report, BasisFiles(directory, disk, 0), {});
    const std::size_t intents = catalog->intents().size();
    if (intents > 0) say(report, counted(intents, "interrupted uploads or deletions, which the next start finishes"));
    say(report, counted(count_entries(directory.damaged(), files), "entries in damaged/, ") +
                    counted(count_entries(directory.unclaimed(), files), "in unclaimed/"));
    say(report, counted(geometries.size(), "geometries, ") + counted(setups.size(), "setups: ") +
                    (report.outcome == StoreReport::Outcome::well ? "every file is whole" : "see above"));
    say_amounts(report, *catalog);
    return report;
  });
}

void check_bases(StoreReport& report, const BasisFiles& bases, const RunContext& context) {
  const std::size_t count = bases.check(context, [&](const OwnedId& system, const std::string& why) {
    complain(report, named("basis of system", system) + ": " + why + "; a server that reads it sets it aside");
  });
  if (count > 0) say(report, counted(count, "bases, ") + mebibytes(bases.bytes()));
}

StoreReport check_open_store(const StoreDirectory& directory, Catalog& catalog, const BasisFiles& bases,
                             const RunContext& context, const RoomFor& room) {
  return guarded([&] {
    StoreReport report;
    try {
      check_rows(report, catalog.check());
    } catch (const Error& error) {
      if (error.code() != ErrorCode::data_loss) throw;
      complain(report, std::string(error.public_message()) + "; the next start makes a new one of the files");
      return report;
    }
    // A row that goes meanwhile takes its files along.
    const auto check_row = [&](const std::string& what, const auto& still_there, const auto& verify) {
      context.check();
      StoreReport one;
      check_one(one, what, verify);
      if (one.outcome == StoreReport::Outcome::faults && still_there()) complain(report, one.lines.front());
    };
    const auto geometries = catalog.all_geometries(), setups = catalog.all_setups();
    for (const auto& id : geometries) {
      const auto record = catalog.find_geometry(id);
      if (!record) continue;
      const auto held = room(*record);
      const auto still_there = [&] { return catalog.find_geometry(id).has_value(); };
      check_row(named("geometry", id), still_there, [&] { check_geometry(directory, id); });
      check_row(named("geometry", id), still_there,
                [&] { read_geometry_record(directory.names() / key_of(id), id, directory.files()); });
    }
    for (const auto& id : setups) {
      const auto still_there = [&] { return catalog.find_setup(id).has_value(); };
      check_row(named("system", id), still_there, [&] { check_setup(directory, id); });
    }
    check_bases(report, bases, context);
    say(report, counted(count_entries(directory.damaged(), directory.files()), "entries in damaged/, ") +
                    counted(count_entries(directory.unclaimed(), directory.files()), "in unclaimed/"));
    say(report, counted(geometries.size(), "geometries, ") + counted(setups.size(), "setups: ") +
                    (report.outcome == StoreReport::Outcome::well ? "every file is whole" : "see above"));
    say_amounts(report, catalog);
    return report;
  });
}

StoreReport rebuild_store(const fs::path& data_dir, FileSystem& files) {
  return guarded([&] {
    const StoreDirectory directory(data_dir, StoreDirectory::Accept::also_files, files);
    const OpenedCatalog opened = open_catalog(directory, OldCatalog::set_aside);
    const RebuildReport& done = opened.report;
    StoreReport report;
    if (!done.set_aside.empty()) say(report, "the catalog is kept as " + done.set_aside);
    const Catalog::Counts counts = opened.catalog->counts();
    say(report, counted(counts.geometries, "geometries, ") + counted(counts.setups, "setups are in the new one"));
    say_amounts(report, *opened.catalog);
    if (done.unclaimed > 0) complain(report, counted(done.unclaimed, "files were nothing of this store's and are in unclaimed/"));
    if (done.damaged > 0) complain(report, counted(done.damaged, "files were damaged and are in damaged/"));
    if (done.missing > 0) complain(report, counted(done.missing, "geometries have no file; register them again"));
    if (done.full) complain(report, "the disk was too full to finish");
    return report;
  });
}

StoreReport backup_store(const fs::path& data_dir, const fs::path& to, FileSystem& files) {
  return guarded([&] { return copy_store(data_dir, to, files); });
}

StoreReport restore_store(const fs::path& from, const fs::path& data_dir, FileSystem& files) {
  return guarded([&] { return copy_store(from, data_dir, files); });
}

}  // namespace deform::server

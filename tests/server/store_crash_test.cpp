// SPDX-License-Identifier: GPL-3.0-or-later
// Killed or failing after any step of what changes a store: it is before or after, never in between.
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include "core/base/error.h"
#include "server/store/store_commands.h"
#include "tests/server/store_contents.h"

namespace deform::server::store_crash_test {
namespace {

namespace fs = std::filesystem;

struct Change {
  const char* name;
  void (*prepare)(GeometryStore&, StoreContents&);
  void (*act)(GeometryStore&);
};

const Mesh& changed_mesh() {
  static const Mesh mesh = sheet_mesh(5, 5, 7);
  return mesh;
}
std::string changed_id() { return mesh_id(changed_mesh()); }
void put_changed(GeometryStore& store) { store.put(changed_mesh(), own(changed_id()), "changed.obj"); }
void put_changed_setups(GeometryStore& store) {
  for (const double lower : {-0.1, -0.2}) store.put_setup(setup_record(changed_id(), lower));
}

const Change changes[] = {
    {"register", [](GeometryStore&, StoreContents&) {}, put_changed},
    {"heal",
     [](GeometryStore& store, StoreContents&) {
       put_changed(store);
       write_file(fs::path(getenv("STORE_UNDER_TEST")) / "geometries" / changed_id(), "damaged");
       EXPECT_THROW(store.load(own(changed_id())), Error);
     },
     put_changed},
    {"remove",
     [](GeometryStore& store, StoreContents&) {
       put_changed(store);
       put_changed_setups(store);
     },
     [](GeometryStore& store) { store.remove(own(changed_id()), WithSetups::remove); }},
    {"register_what_others_have",
     [](GeometryStore& store, StoreContents& contents) {
       for (const char* tenant : StoreContents::tenants) {
         if (tenant != std::string(default_tenant)) contents.add_geometry(store, changed_mesh(), "theirs.obj", tenant);
       }
     },
     put_changed},
    {"remove_what_others_have",
     [](GeometryStore& store, StoreContents& contents) {
       contents.add_geometry(store, changed_mesh(), "theirs.obj", "acme");
       contents.add_setup(store, changed_id(), -0.1, "acme");
       put_changed(store);
       put_changed_setups(store);
     },
     [](GeometryStore& store) { store.remove(own(changed_id()), WithSetups::remove); }},
    {"put_setup", [](GeometryStore& store, StoreContents&) { put_changed(store); },
     [](GeometryStore& store) { store.put_setup(setup_record(changed_id(), -0.1)); }},
    {"put_setup_again",
     [](GeometryStore& store, StoreContents&) {
       put_changed(store);
       put_changed_setups(store);
     },
     [](GeometryStore& store) { store.put_setup(setup_record(changed_id(), -0.1)); }},
    {"remove_setup",
     [](GeometryStore& store, StoreContents&) {
       put_changed(store);
       put_changed_setups(store);
     },
     [](GeometryStore& store) { store.remove_setup(own(setup_record(changed_id(), -0.1).id)); }},
};

class Interrupted : public StoreTest, public testing::WithParamInterface<Change> {
 protected:
  Interrupted() {
    setenv("STORE_UNDER_TEST", data.c_str(), 1);
    const auto store = open(data);
    const std::string id = contents.add_geometry(*store, sheet_mesh(4, 4), "other.obj");
    contents.add_setup(*store, id, -0.3);
    GetParam().prepare(*store, contents);
  }
  /// Geometries and setups there are, as one string.
  static std::string visible(GeometryStore& store) {
    std::string text;
    for (const auto& id : store.catalog().all_geometries()) {
      text += id.tenant + ":" + id.id.substr(0, 8) + store.info(id).damage() + " ";
    }
    for (const auto& id : store.catalog().all_setups()) text += id.tenant + ":" + id.id.substr(0, 8) + " ";
    return text;
  }
  void expect_before_or_after(const fs::path& folder, const std::string& before, const std::string& after) {
    std::string now;
    {
      const auto store = open(folder);
      contents.expect_in(*store);
      now = visible(*store);
      EXPECT_TRUE(now == before || now == after) << now << "\nbefore: " << before << "\nafter:  " << after;
      for (const char* empty : {"tmp", "unclaimed"}) EXPECT_TRUE(fs::is_empty(folder / empty)) << empty;
      EXPECT_TRUE(store->catalog().intents().empty());
    }
    const StoreReport report = check_store(folder);
    const bool damage_was_there = now.find("damaged") != std::string::npos;
    EXPECT_EQ(report.outcome == StoreReport::Outcome::well, !damage_was_there) << testing::PrintToString(report.lines);
    const auto store = open(folder);
    if (now == before) GetParam().act(*store);
    EXPECT_EQ(visible(*store), after);
  }
  /// before and after the change; the store itself stays before it.
  std::pair<std::string, std::string> both_sides() {
    const fs::path copy = directory.path() / "both_sides";
    copy_folder(data, copy);
    const auto store = open(copy);
    const std::string before = visible(*store);
    GetParam().act(*store);
    return {before, visible(*store)};
  }
  fs::path fresh(int step) {
    const fs::path folder = directory.path() / ("step" + std::to_string(step));
    copy_folder(data, folder);
    return folder;
  }
  static constexpr int killed = 42;
  StoreContents contents;
};

TEST_P(Interrupted, a_kill_after_any_step_leaves_before_or_after) {
  const auto [before, after] = both_sides();
  int steps = 0;
  for (bool interrupted = true; interrupted; ++steps) {
    const fs::path folder = fresh(steps);
    const pid_t child = fork();
    if (child == 0) {
      int left = steps;
      StoreOptions options = small_store();
      options.on_step = [&](const char*) {
        if (left-- == 0) _exit(killed);
      };
      GeometryStore store(folder, options);
      GetParam().act(store);
      _exit(0);
    }
    int status = 0;
    ASSERT_EQ(waitpid(child, &status, 0), child);
    ASSERT_TRUE(WIFEXITED(status));
    interrupted = WEXITSTATUS(status) == killed;
    SCOPED_TRACE(std::string(GetParam().name) + " killed after step " + std::to_string(steps));
    expect_before_or_after(folder, before, after);
  }
  EXPECT_GE(steps, 4);
}

TEST_P(Interrupted, a_failure_after_any_step_leaves_before_or_after_and_a_store_that_works) {
  const auto [before, after] = both_sides();
  for (int step = 0;; ++step) {
    SCOPED_TRACE(std::string(GetParam().name) + " fails after step " + std::to_string(step));
    const fs::path folder = fresh(step);
    int left = step;
    {
      StoreOptions options = small_store();
      options.on_step = [&](const char*) {
        if (left-- == 0) throw Error(ErrorCode::out_of_budget, "no space left on device");
      };
      GeometryStore store(folder, options);
      try {
        GetParam().act(store);
      } catch (const Error& error) {
        EXPECT_EQ(error.code(), ErrorCode::out_of_budget);
      }
      if (left >= 0) break;  // all steps were taken
      const std::string now = visible(store);
      EXPECT_TRUE(now == before || now == after) << now;
      contents.expect_in(store);
      if (now == before) GetParam().act(store);
      EXPECT_EQ(visible(store), after);
    }
    EXPECT_EQ(visible(*open(folder)), after);
    EXPECT_EQ(check_store(folder).outcome, StoreReport::Outcome::well);
  }
}

INSTANTIATE_TEST_SUITE_P(Changes, Interrupted, testing::ValuesIn(changes),
                         [](const auto& instance) { return std::string(instance.param.name); });

}  // namespace
}  // namespace deform::server::store_crash_test

// SPDX-License-Identifier: GPL-3.0-or-later
// Detection through the engine: what comes, in pieces, and what is refused.
#include <atomic>
#include <cstring>
#include <set>
#include <string>

#include "tests/server/engine_fixture.h"
#include "tests/support/expect_error.h"

namespace deform::server::engine_detect_test {
namespace {

using test::expect_error;

/// [0, 1]^3 as n x n quads a side.
Mesh cube(std::size_t n) {
  Mesh mesh;
  std::map<std::array<std::size_t, 3>, PointId> ids;
  const auto at = [&](const std::array<std::size_t, 3>& i) {
    const auto [entry, added] = ids.emplace(i, static_cast<PointId>(mesh.points.size()));
    const auto size = static_cast<double>(n);
    if (added) mesh.points.push_back({double(i[0]) / size, double(i[1]) / size, double(i[2]) / size});
    return entry->second;
  };
  for (std::size_t axis = 0; axis < 3; ++axis) {
    for (const std::size_t side : {std::size_t{0}, n}) {
      for (std::size_t a = 0; a < n; ++a) {
        for (std::size_t b = 0; b < n; ++b) {
          std::array<PointId, 4> corners{};
          const std::size_t steps[4][2] = {{0, 0}, {1, 0}, {1, 1}, {0, 1}};
          for (std::size_t k = 0; k < 4; ++k) {
            std::array<std::size_t, 3> i{};
            i[axis] = side;
            i[(axis + 1) % 3] = a + steps[k][0];
            i[(axis + 2) % 3] = b + steps[k][1];
            corners[side == 0 ? 3 - k : k] = at(i);
          }
          mesh.face_sizes.push_back(4);
          mesh.face_points.insert(mesh.face_points.end(), corners.begin(), corners.end());
        }
      }
    }
  }
  return mesh;
}

class EngineDetect : public EngineFixture {
 protected:
  std::vector<v1::DetectReply> detect(const v1::DetectRequest& request, const CallContext& call = {}) {
    Waiter<Engine::DetectReplies> waiter;
    engine->detect(request, call, waiter.callback());
    return *waiter.value();
  }
};

TEST_F(EngineDetect, ACubeHasSixPlanes) {
  constexpr std::size_t n = 120;  // more ids than fit one message
  const Mesh mesh = cube(n);
  v1::DetectRequest request;
  options.max_faces = 1'000'000;
  reopen();
  request.set_geometry_id(register_mesh(mesh, "cube").id());
  const std::vector<v1::DetectReply> replies = detect(request);
  std::size_t planes = 0, faces = 0, points = 0;
  std::set<std::string> names;
  for (const auto& reply : replies) {
    EXPECT_LT(reply.ByteSizeLong(), std::size_t{1} << 20);
    if (reply.has_primitive()) {
      EXPECT_EQ(reply.primitive().kind(), v1::PRIMITIVE_PLANE);
      const std::string& name = reply.primitive().name();  // of the side of the cube
      EXPECT_TRUE(name.size() == 10 && name.starts_with("plane_") && name.ends_with("_1")) << name;
      EXPECT_TRUE(names.insert(name).second) << name;
      ++planes;
      EXPECT_EQ(reply.primitive().faces(), n * n);
      EXPECT_NEAR(reply.primitive().area(), 1, 1e-12);
      EXPECT_EQ(reply.primitive().constraint(), "planar");
    }
    if (reply.has_ids()) (reply.ids().of() == v1::DetectedIds::FACES ? faces : points) += reply.ids().ids().size() / 4;
  }
  EXPECT_EQ(planes, 6u);
  EXPECT_EQ(faces, mesh.face_count());
  EXPECT_GE(points, 6 * (n + 1) * (n + 1));  // those of edges in each plane, and of the lines found
  ASSERT_TRUE(replies.back().has_summary());
  EXPECT_NEAR(replies.back().summary().coverage(), 1, 1e-10);
  EXPECT_NEAR(replies.back().summary().area(), 6, 1e-10);
}

TEST_F(EngineDetect, KindsAndSeedCount) {
  v1::DetectRequest request;
  request.set_geometry_id(register_mesh(cube(8), "cube").id());
  request.add_kinds(v1::PRIMITIVE_CYLINDER);
  for (const auto& reply : detect(request)) EXPECT_FALSE(reply.has_primitive());
  request.clear_kinds();
  const auto once = detect(request), again = detect(request);
  ASSERT_EQ(once.size(), again.size());
  for (std::size_t i = 0; i + 1 < once.size(); ++i) EXPECT_EQ(once[i].SerializeAsString(), again[i].SerializeAsString());
}

TEST_F(EngineDetect, BadRequests) {
  v1::DetectRequest request;
  request.set_geometry_id(register_mesh(cube(4), "cube").id());
  const auto refused = [&](const std::vector<const char*>& parts, const std::function<void(v1::DetectRequest&)>& spoil) {
    v1::DetectRequest bad = request;
    spoil(bad);
    expect_error(ErrorCode::invalid_argument, parts, [&] { detect(bad); });
  };
  refused({"geometry_id"}, [](auto& r) { r.clear_geometry_id(); });
  refused({"tolerance"}, [](auto& r) { r.set_tolerance(-1); });
  refused({"tolerance"}, [](auto& r) { r.set_tolerance(std::nan("")); });
  refused({"minimum_area"}, [](auto& r) { r.set_minimum_area(1); });
  refused({"maximum_angle"}, [](auto& r) { r.set_maximum_angle(2); });
  refused({"kinds[0]", "77"}, [](auto& r) { r.add_kinds(static_cast<v1::PrimitiveKind>(77)); });
  request.set_geometry_id(std::string(64, 'f'));
  expect_error(ErrorCode::not_found, {}, [&] { detect(request); });
}

// With both threads for preparations busy: detections wait for one, and the only worker goes on with what is in memory.
TEST_F(EngineDetect, TakesATurnAmongPreparationsAndNoWorker) {
  options.workers = 1;
  reopen();
  const std::string geometry = register_mesh(sheet_mesh(30, 30)).id();
  const std::string system = prepare(sheet_setup(geometry)).id();
  StandingPreparations standing(*engine, options, geometry);
  v1::DetectRequest request;
  request.set_geometry_id(geometry);
  std::atomic<int> detected{0};
  std::stop_source stop;
  CallContext given_up;
  given_up.stop = stop.get_token();
  std::vector<Waiter<Engine::DetectReplies>> detections(3);
  for (std::size_t i = 0; i < detections.size(); ++i) {
    const auto note = [&, done = detections[i].callback()](Engine::Outcome<Engine::DetectReplies> outcome) {
      if (outcome.value) ++detected;
      done(std::move(outcome));
    };
    engine->detect(request, i == 0 ? given_up : CallContext(), note);
  }
  EXPECT_EQ(deform(request_for(system, {{0.1, 0.1}})).results.size(), 1u);
  EXPECT_EQ(detected, 0) << "a worker took it, before the design";
  stop.request_stop();
  expect_error(ErrorCode::cancelled, {}, [&] { detections[0].value(); });
  EXPECT_EQ(engine->info().queue_length(), 2 + 2u) << "what waits for a thread can be cancelled";
  standing.go_on();
  for (std::size_t i = 1; i < detections.size(); ++i) EXPECT_FALSE(detections[i].value()->empty());
  EXPECT_EQ(detected, 2);
}

TEST_F(EngineDetect, CancelledBeforeItStarts) {
  v1::DetectRequest request;
  request.set_geometry_id(register_mesh(cube(8), "cube").id());
  std::stop_source stop;
  CallContext call;
  call.stop = stop.get_token();
  stop.request_stop();
  expect_error(ErrorCode::cancelled, {}, [&] { detect(request, call); });
}

}  // namespace
}  // namespace deform::server::engine_detect_test

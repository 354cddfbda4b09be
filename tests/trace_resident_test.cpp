#include "trace/resident.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <memory>
#include <random>
#include <vector>

#include <glm/gtc/quaternion.hpp>

namespace cloudrenderer {
namespace {

// Arrays that own themselves, as a part file does.
struct Arrays {
  std::vector<Vec3> positions;
  std::vector<Triangle> triangles;
  std::vector<std::uint32_t> primitive_ids;
  std::vector<MeshChunk> chunks;
  std::vector<QuadricRecord> quadrics;
  std::vector<InstanceRecord> instances;
};

Part as_part(std::shared_ptr<Arrays> a) {
  a->positions.reserve(a->positions.size() + 2);  // readable bytes behind the last vertex
  Part p;
  p.positions = a->positions;
  p.triangles = a->triangles;
  p.primitive_ids = a->primitive_ids;
  p.chunks = a->chunks;
  p.quadrics = a->quadrics;
  p.instances = a->instances;
  p.owner = std::move(a);
  return p;
}

// A bumpy terrain: many shared edges. Triangles whose number has remainder r mod m, in reverse order if asked: the
// same surface cut and stored in different ways.
std::shared_ptr<Arrays> terrain(std::uint32_t n, std::uint32_t m, std::uint32_t r, bool reverse) {
  auto a = std::make_shared<Arrays>();
  for (std::uint32_t y = 0; y <= n; ++y)
    for (std::uint32_t x = 0; x <= n; ++x)
      a->positions.push_back({static_cast<float>(x), static_cast<float>((x * 7 + y * 13) % 5) * 0.2f, static_cast<float>(y)});
  std::vector<std::pair<std::uint32_t, Triangle>> all;
  for (std::uint32_t y = 0, i = 0; y < n; ++y)
    for (std::uint32_t x = 0; x < n; ++x) {
      const std::uint32_t p = y * (n + 1) + x;
      for (const Triangle t : {Triangle{p, p + 1, p + n + 1}, Triangle{p + n + 1, p + 1, p + n + 2}}) {
        if (i % m == r) all.emplace_back(i, t);
        ++i;
      }
    }
  if (reverse) std::reverse(all.begin(), all.end());
  for (const auto& [id, t] : all) {
    a->triangles.push_back(t);
    a->primitive_ids.push_back(id);
  }
  MeshChunk c;
  c.shape = 3;
  c.triangle_count = static_cast<std::uint32_t>(a->triangles.size());
  c.vertex_count = static_cast<std::uint32_t>(a->positions.size());
  c.primitive_ids = 0;
  a->chunks.push_back(c);
  return a;
}

std::vector<TraceRay> rays_at_terrain(std::uint32_t n) {
  std::mt19937 rng(11);
  std::uniform_real_distribution<float> u(0, 1);
  std::vector<TraceRay> rays;
  for (int i = 0; i < 80000; ++i) {
    TraceRay r;
    const float size = static_cast<float>(n);
    // Half of the rays aim at vertices and edges exactly, where triangles tie.
    Vec3 target{std::floor(u(rng) * size), 0, std::floor(u(rng) * size)};
    if (i % 2) target = {u(rng) * size, 0, u(rng) * size};
    target.y = 0;
    r.origin = Vec3(u(rng) * size, 5, u(rng) * size);
    if (i % 4 == 0) r.origin = target + Vec3(0.25f, 10, 0.5f);
    // Along one axis or in a plane across one, through vertices: on both sides are boxes that such a ray only touches.
    if (i % 16 == 4) r.origin = target + Vec3(0, 10, 0);
    if (i % 16 == 8) r.origin = target + Vec3(0, 10, 3.3f);
    if (i % 16 == 12) {
      target.z += u(rng);
      r.origin = target + Vec3(0, 10, 3.3f);
    }
    r.direction = glm::normalize(target - r.origin);
    if (i % 16 == 12) r.direction.x = 4e-7f * (u(rng) - 0.5f);
    rays.push_back(r);
  }
  return rays;
}

// Shadow rays that do so are traced one way only.
bool runs_along_an_axis(const TraceRay& r) { return std::abs(r.direction.x) < 0x1p-21f || std::abs(r.direction.z) < 0x1p-21f; }

void expect_same(const Hit& a, const Hit& b) {
  ASSERT_EQ(a.t, b.t);
  ASSERT_EQ(a.shape, b.shape);
  ASSERT_EQ(a.primitive, b.primitive);
  ASSERT_EQ(a.u, b.u);
  ASSERT_EQ(a.v, b.v);
}

TEST(Resident, SplitAndOrderOfPartsDoNotChangeTheHit) {
  prepare_compute_thread();
  const std::uint32_t n = 60;
  Resident whole({}), cut({});
  whole.load_part(PartId{1}, as_part(terrain(n, 1, 0, false)));
  for (std::uint32_t k = 0; k < 3; ++k) cut.load_part(PartId{k + 1}, as_part(terrain(n, 3, k, k == 1)));
  const auto a = whole.snapshot(), b = cut.snapshot();
  int hits = 0;
  for (const TraceRay& ray : rays_at_terrain(n)) {
    Hit one, forward, backward;
    a->intersect(1, ray, one);
    for (const std::uint32_t part : {1u, 2u, 3u}) b->intersect(part, ray, forward);
    for (const std::uint32_t part : {3u, 2u, 1u}) b->intersect(part, ray, backward);
    expect_same(one, forward);
    expect_same(one, backward);
    hits += one.part != kNone;
    ASSERT_TRUE(runs_along_an_axis(ray) || a->occluded(1, ray) == (one.part != kNone));
  }
  EXPECT_GT(hits, 30000);
}

TEST(Resident, FormsOfTheBvhFindTheSameBits) {
  prepare_compute_thread();
  const std::uint32_t n = 60;
  Resident fast({}), passing({});
  fast.load_part(PartId{1}, as_part(terrain(n, 1, 0, false)), BvhForm::fast);
  passing.load_part(PartId{1}, as_part(terrain(n, 1, 0, false)), BvhForm::passing);
  const auto a = fast.snapshot(), b = passing.snapshot();
  for (const TraceRay& ray : rays_at_terrain(n)) {
    Hit one, other;
    a->intersect(1, ray, one);
    b->intersect(1, ray, other);
    expect_same(one, other);
    ASSERT_TRUE(runs_along_an_axis(ray) || a->occluded(1, ray) == b->occluded(1, ray));
  }
}

// Joined under one tree, with what is known of a hit; one of the parts is an instance.
TEST(Resident, JoinedPartsFindTheBitsOfPartByPart) {
  prepare_compute_thread();
  const std::uint32_t n = 60, parts = 5;
  Resident resident({});
  auto object = terrain(n, parts + 1, parts, false);
  object->chunks[0].shape = 0;
  resident.load_prototype(0, as_part(object));
  for (std::uint32_t k = 0; k < parts; ++k) resident.load_part(PartId{k + 1}, as_part(terrain(n, parts + 1, k, k == 1)));
  auto instances = std::make_shared<Arrays>();
  InstanceRecord placed;
  placed.first_shape = 3;
  instances->instances.push_back(placed);
  resident.load_part(PartId{parts + 1}, as_part(instances));
  const auto set = resident.snapshot();
  EXPECT_EQ(set->joined_count(), parts + 1);
  EXPECT_TRUE(set->joined(1));
  EXPECT_FALSE(set->joined(0));
  EXPECT_TRUE(set->joined(parts + 1));
  EXPECT_FALSE(set->joined(parts + 2));

  const std::vector<TraceRay> rays = rays_at_terrain(n);
  std::mt19937 rng(3);
  int hits = 0;
  for (std::size_t i = 0; i + 8 <= rays.size(); i += 8) {
    std::array<Hit, 8> one_by_one, joined;
    RayPacket p;
    const auto active = static_cast<std::uint32_t>(rng() & 0xffu) | 1u;
    for (std::size_t k = 0; k < 8; ++k) {
      TraceRay ray = rays[i + k];
      if (rng() % 4 == 0) ray.t_max = 5;
      lanes::put(p.origin, k, ray.origin);
      lanes::put(p.direction, k, ray.direction);
      lanes::put(p.t_max, k, ray.t_max);
      if (rng() % 4 == 0) {  // somebody else's hit, now and then of the very triangle
        one_by_one[k].t = 5;
        one_by_one[k].shape = one_by_one[k].primitive = 1;
      } else if (rng() % 4 == 0) {
        set->intersect(static_cast<std::uint32_t>(1 + rng() % parts), ray, one_by_one[k]);
        one_by_one[k].part = kNone;
      }
      joined[k] = one_by_one[k];
    }
    for (std::uint32_t part = 1; part <= parts + 1; ++part)
      set->intersect8(part, p, active, Coherence::any, one_by_one.data());
    ASSERT_TRUE(set->may_join(p));
    set->intersect_joined8(p, active, i % 16 ? Coherence::alike : Coherence::any, joined.data());
    std::uint32_t blocked = 0;
    for (std::uint32_t part = 1; part <= parts + 1; ++part) blocked |= set->occluded8(part, p, active);
    ASSERT_EQ(set->occluded_joined8(p, active), blocked);
    for (std::size_t k = 0; k < 8; ++k) {
      expect_same(one_by_one[k], joined[k]);
      ASSERT_EQ(joined[k].part, one_by_one[k].part);
      ASSERT_EQ(joined[k].index, one_by_one[k].index);
      ASSERT_EQ(joined[k].instance, one_by_one[k].instance);
      hits += joined[k].part != kNone;
    }
  }
  EXPECT_GT(hits, 10000);

  RayPacket far;
  far.origin = Vec3x8(Float8(0.f));
  lanes::put(far.origin, 3, Vec3(0, 1000, 0));
  EXPECT_FALSE(set->may_join(far));

  // Batches under way keep what they began with.
  for (std::uint32_t k = 2; k <= parts + 1; ++k) resident.unload_part(PartId{k});
  EXPECT_EQ(resident.snapshot()->joined_count(), 0u);
  EXPECT_EQ(set->joined_count(), parts + 1);
}

// In every form of the BVH, and with what is known of other parts: the surface is one part, or three.
void expect_packets_like_single_rays(BvhForm form, std::uint32_t parts) {
  prepare_compute_thread();
  const std::uint32_t n = 60;
  Resident whole({}), cut({});
  whole.load_part(PartId{1}, as_part(terrain(n, 1, 0, false)));
  for (std::uint32_t k = 0; k < parts; ++k) cut.load_part(PartId{k + 1}, as_part(terrain(n, parts, k, k == 1)), form);
  const auto a = whole.snapshot(), b = cut.snapshot();
  const std::vector<TraceRay> rays = rays_at_terrain(n);
  for (std::size_t i = 0; i + 8 <= rays.size(); i += 8) {
    std::array<Hit, 8> single, packet, coherent;
    RayPacket p;
    for (std::size_t k = 0; k < 8; ++k) {
      lanes::put(p.origin, k, rays[i + k].origin);
      lanes::put(p.direction, k, rays[i + k].direction);
      lanes::put(p.t_max, k, rays[i + k].t_max);
      a->intersect(1, rays[i + k], single[k]);
    }
    const auto active = static_cast<std::uint32_t>(0xff & ~(i / 8 % 256)) | 1u;
    std::uint32_t blocked = 0;
    for (std::uint32_t part = 1; part <= parts; ++part) {
      b->intersect8(part, p, active, Coherence::any, packet.data());
      b->intersect8(parts + 1 - part, p, active, Coherence::alike, coherent.data());
      blocked |= b->occluded8(part, p, active);
    }
    for (std::size_t k = 0; k < 8; ++k) {
      if (!(active >> k & 1u)) {
        ASSERT_EQ(packet[k].part, kNone);
        continue;
      }
      expect_same(single[k], packet[k]);
      expect_same(single[k], coherent[k]);
      ASSERT_TRUE(runs_along_an_axis(rays[i + k]) || (blocked >> k & 1u) == (single[k].part != kNone));
    }
  }
}

TEST(Resident, PacketsFindTheSameBitsAsSingleRays) { expect_packets_like_single_rays(BvhForm::fast, 1); }
TEST(Resident, PacketsFindTheSameBitsInEveryFormOfTheBvh) { expect_packets_like_single_rays(BvhForm::passing, 1); }
TEST(Resident, PacketsFindTheSameBitsInSplitSurfaces) {
  expect_packets_like_single_rays(BvhForm::fast, 3);
  expect_packets_like_single_rays(BvhForm::passing, 3);
}

// A part of one lamp is asked through a float test first: what that leaves out must be a miss. Many rays here pass the
// rim by a millionth of the radius.
TEST(Resident, LampsLoseNoHitToTheTestAroundThem) {
  prepare_compute_thread();
  QuadricRecord ball;
  ball.quadric.radius = 3;
  const Vec3 center(150, 120, 20);
  ball.quadric.object_to_world = Transform(Mat4(1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, center.x, center.y, center.z, 1),
                                           Mat4(1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, -center.x, -center.y, -center.z, 1));
  ball.quadric.z_min = -3;
  ball.quadric.z_max = 3;
  auto lamp = std::make_shared<Arrays>();
  lamp->quadrics.push_back(ball);
  Resident resident({});
  resident.load_part(PartId{1}, as_part(lamp));
  const auto set = resident.snapshot();
  const std::uint32_t seed = 5;
  std::mt19937 rng(seed);
  std::uniform_real_distribution<float> u(-1, 1);
  int hits = 0, misses = 0;
  for (int i = 0; i < 200000; ++i) {
    const Vec3 origin(400 * u(rng), 400 * u(rng), 400 * u(rng));
    const Vec3 to_center = center - origin;
    const Vec3 aside = glm::normalize(glm::cross(to_center, Vec3(u(rng), u(rng), u(rng))));
    // Where a cone around the ball touches it, a little more or less.
    const float distance2 = glm::dot(to_center, to_center), sine = 3.f / std::sqrt(distance2);
    if (!(sine < 1.f)) continue;
    const float angle = std::asin(sine) * (1.f + (i % 3 == 0 ? 1.f : 2e-6f) * u(rng));
    const Vec3 direction = glm::normalize(std::cos(angle) * glm::normalize(to_center) + std::sin(angle) * aside);
    QuadricHit exact;
    const bool found = intersect(ball.quadric, origin, direction, 0.f, kInfinity, exact);
    Hit hit;
    ASSERT_EQ(set->intersect(1, {origin, kInfinity, direction}, hit), found) << "seed " << seed << " ray " << i;
    if (found) {
      ASSERT_EQ(hit.t, exact.t) << "seed " << seed << " ray " << i;
    }
    ++(found ? hits : misses);
  }
  EXPECT_GT(hits, 50000);
  EXPECT_GT(misses, 50000);
}

// Likewise of disks, which are flat: rays by their rims, nearly in their planes, and from nearly there.
TEST(Resident, DisksLoseNoHitToTheTestAroundThem) {
  prepare_compute_thread();
  const std::uint32_t seed = 6;
  std::mt19937 rng(seed);
  std::uniform_real_distribution<float> u(-1, 1);
  const auto point = [&] { return Vec3(u(rng), u(rng), u(rng)); };
  int hits = 0, misses = 0;
  for (int round = 0; round < 200; ++round) {
    QuadricRecord disk;
    disk.quadric.kind = QuadricKind::disk;
    disk.quadric.radius = 2;
    disk.quadric.height = disk.quadric.z_min = disk.quadric.z_max = 0.5f;
    const float far = round % 2 ? 1000.f : 3.f;
    const Vec3 place = far * point();
    const glm::mat3 turn(glm::mat3_cast(glm::normalize(glm::quat(1.f + u(rng), u(rng), u(rng), u(rng)))));
    const glm::mat3 m = turn * glm::mat3(std::exp(u(rng)), 0, 0, u(rng), std::exp(u(rng)), 0, u(rng), 0, 1);
    const Mat4 matrix(glm::vec4(m[0], 0), glm::vec4(m[1], 0), glm::vec4(m[2], 0), glm::vec4(place, 1));
    disk.quadric.object_to_world = Transform(matrix, glm::inverse(matrix));
    auto lamp = std::make_shared<Arrays>();
    lamp->quadrics.push_back(disk);
    Resident resident({});
    resident.load_part(PartId{1}, as_part(lamp));
    const auto set = resident.snapshot();
    const auto in_plane = [&](float radius) {
      const float angle = kPi * u(rng);
      return place + m * Vec3(radius * std::cos(angle), radius * std::sin(angle), 0.5f);
    };
    const Vec3 normal = glm::normalize(glm::cross(m[0], m[1]));
    for (int i = 0; i < 1000; ++i) {
      const Vec3 target = in_plane(2.f * (i % 3 == 0 ? std::sqrt(std::fabs(u(rng))) : 1.f + 1e-6f * u(rng)));
      const std::array<Vec3, 3> origins{place + 20.f * point(), in_plane(5.f * u(rng)) + 1e-4f * u(rng) * normal, in_plane(2.f * u(rng)) + 1e-6f * u(rng) * normal};
      const Vec3 origin = origins[static_cast<std::size_t>(i) % 3];
      const Vec3 direction = glm::normalize(i % 7 == 0 ? point() : target - origin);
      const float t_max = i % 5 == 0 ? 3.f * std::fabs(u(rng)) : kInfinity;
      QuadricHit exact;
      const bool found = intersect(disk.quadric, origin, direction, 0.f, t_max, exact);
      Hit hit;
      ASSERT_EQ(set->intersect(1, {origin, t_max, direction}, hit), found) << "seed " << seed << " disk " << round << " ray " << i;
      if (found) {
        ASSERT_EQ(hit.t, exact.t) << "seed " << seed << " disk " << round << " ray " << i;
      }
      ++(found ? hits : misses);
    }
  }
  EXPECT_GT(hits, 50000);
  EXPECT_GT(misses, 50000);
}

TEST(Resident, InstancesAndQuadricsReportGlobalIds) {
  prepare_compute_thread();
  auto prototype = terrain(4, 1, 0, false);
  QuadricRecord ball;
  ball.quadric.radius = 1;
  ball.quadric.object_to_world = Transform(Mat4(1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 2, 3, 2, 1), Mat4(1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, -2, -3, -2, 1));
  ball.shape = 4;
  prototype->quadrics.push_back(ball);
  auto world = std::make_shared<Arrays>();
  for (std::uint32_t i = 0; i < 3; ++i) {
    const float x = 100.f * static_cast<float>(i);
    world->instances.push_back({Transform(Mat4(1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, x, 0, 0, 1), Mat4(1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, -x, 0, 0, 1)), 0, 10 * i});
  }
  Resident resident({});
  resident.load_prototype(0, as_part(prototype));
  resident.load_part(PartId{1}, as_part(world));
  const auto set = resident.snapshot();
  for (std::uint32_t i = 0; i < 3; ++i) {
    const float x = 100.f * static_cast<float>(i);
    Hit on_ball, on_mesh;
    ASSERT_TRUE(set->intersect(1, {{x + 2, 10, 2}, kInfinity, {0, -1, 0}}, on_ball));
    EXPECT_EQ(on_ball.geometry, 1u);
    EXPECT_EQ(on_ball.instance, i);
    EXPECT_EQ(on_ball.shape, 10 * i + 4);
    EXPECT_FLOAT_EQ(on_ball.t, 6);
    ASSERT_TRUE(set->intersect(1, {{x + 0.3f, 10, 0.2f}, kInfinity, {0, -1, 0}}, on_mesh));
    EXPECT_EQ(on_mesh.geometry, 0u);
    EXPECT_EQ(on_mesh.shape, 10 * i + 3);
  }
}

TEST(Resident, AlphaCutsHolesForCameraAndShadowRays) {
  prepare_compute_thread();
  auto a = terrain(4, 1, 0, false);
  a->chunks[0].alpha_texture = 7;
  Resident resident({});
  resident.set_alpha([](std::uint32_t texture, const Vec2&, const Vec3& p) { return texture == 7 && p.x < 2.f ? 0.f : 1.f; });
  resident.load_part(PartId{1}, as_part(a));
  const auto set = resident.snapshot();
  for (const float x : {0.4f, 1.6f, 2.4f, 3.6f}) {
    const TraceRay ray{{x, 10, 1.3f}, kInfinity, {0, -1, 0}};
    Hit hit;
    EXPECT_EQ(set->intersect(1, ray, hit), x > 2.f) << x;
    EXPECT_EQ(set->occluded(1, ray), x > 2.f) << x;
  }
}

// A sphere with holes: its inside is seen through them, in a packet of rays and alone.
TEST(Resident, TheFarSideIsSeenThroughTheHolesOfASphere) {
  prepare_compute_thread();
  auto a = std::make_shared<Arrays>();
  QuadricRecord ball;
  ball.quadric.radius = 1;
  ball.quadric.z_min = -1;
  ball.quadric.z_max = 1;
  ball.alpha_texture = 7;
  a->quadrics.push_back(ball);
  Resident resident({});
  resident.set_alpha([](std::uint32_t, const Vec2&, const Vec3& p) { return p.x < 0.f || (p.y > 0.f && p.x < .5f) ? 0.f : 1.f; });
  resident.load_part(PartId{1}, as_part(a));
  const auto set = resident.snapshot();
  RayPacket packet, shorter;
  std::array<Hit, 8> alone, together;
  std::uint32_t blocked = 0, blocked_before = 0;
  for (std::size_t i = 0; i < 8; ++i) {
    const float x = -.875f + static_cast<float>(i) * .25f, depth = std::sqrt(1.f - x * x);
    const TraceRay ray{{x, 10, .01f}, kInfinity, {0, -1, 0}};
    lanes::put(packet.origin, i, ray.origin);
    lanes::put(packet.direction, i, ray.direction);
    lanes::put(packet.t_max, i, ray.t_max);
    EXPECT_EQ(set->intersect(1, ray, alone[i]), x > 0) << x;
    if (x > 0) {
      EXPECT_NEAR(alone[i].t, x < .5f ? 10 + depth : 10 - depth, 1e-3f) << x;
    }
    EXPECT_EQ(set->occluded(1, ray), x > 0) << x;
    blocked |= static_cast<std::uint32_t>(x > 0) << i;
    blocked_before |= static_cast<std::uint32_t>(x > .5f) << i;
  }
  shorter = packet;
  shorter.t_max = Float8(10.f);
  set->intersect8(1, packet, 0xff, Coherence::any, together.data());
  for (std::size_t i = 0; i < 8; ++i) EXPECT_EQ(alone[i].t, together[i].t) << i;
  EXPECT_EQ(set->occluded8(1, packet, 0xff), blocked);
  EXPECT_EQ(set->occluded8(1, shorter, 0xff), blocked_before);
}

// pbrt-v4: as many rays as alpha says meet the surface; the same ray always does the same.
TEST(Resident, AlphaByChance) {
  prepare_compute_thread();
  auto a = terrain(4, 1, 0, false);
  a->chunks[0].alpha_texture = 7;
  Resident resident({});
  resident.set_alpha([](std::uint32_t, const Vec2&, const Vec3& p) -> Alpha { return {p.x < 1.f ? 0.f : p.x < 2.f ? .3f : p.x < 3.f ? .8f : 1.f, true}; });
  resident.load_part(PartId{1}, as_part(a));
  const auto set = resident.snapshot();
  constexpr int kRays = 4000;
  std::array<int, 4> hits{}, blocked{}, again{};
  for (int i = 0; i < kRays; ++i)
    for (std::size_t column = 0; column < 4; ++column) {
      const float x = static_cast<float>(column) + (static_cast<float>(i % 63) + .5f) / 64;
      const TraceRay ray{{x, 10, 1.1f + static_cast<float>(i) * 1e-4f}, kInfinity, {0, -1, 0}};
      Hit hit, second;
      const bool found = set->intersect(1, ray, hit);
      hits[column] += found;
      again[column] += found == set->intersect(1, ray, second);
      blocked[column] += found == set->occluded(1, ray);
    }
  const std::array<double, 4> expected{0, .3, .8, 1};
  for (std::size_t column = 0; column < 4; ++column) {
    EXPECT_NEAR(static_cast<double>(hits[column]) / kRays, expected[column], 4 * std::sqrt(.25 / kRays) * (column % 3 ? 1 : 0) + 1e-9);
    EXPECT_EQ(again[column], kRays);
    EXPECT_EQ(blocked[column], kRays);
  }
}

TEST(Resident, CountsBytesAndForgetsUnloadedParts) {
  Resident resident({});
  EXPECT_FALSE(resident.snapshot()->has(1));
  const std::uint64_t before = resident.bytes();
  const std::uint64_t used = resident.load_part(PartId{1}, as_part(terrain(100, 1, 0, false)));
  EXPECT_GT(used, 20000u * 40u);
  const auto held = resident.snapshot();
  resident.unload_part(PartId{1});
  EXPECT_FALSE(resident.snapshot()->has(1));
  EXPECT_TRUE(held->has(1));  // a batch that still traces keeps what it has
  EXPECT_GT(resident.bytes(), before + used / 2);
  EXPECT_GE(resident.peak_bytes(), used);
}

TEST(Traceable, RefusesWhatWouldStopEmbree) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  EXPECT_TRUE(traceable<float>({1, 2, 3}, {0, 0, 1}));
  EXPECT_FALSE(traceable<float>({nan, 2, 3}, {0, 0, 1}));
  EXPECT_FALSE(traceable<float>({1, 2, 3}, {0, nan, 1}));
  EXPECT_FALSE(traceable<float>({1, 2, 3}, {0, 0, 0}));
  EXPECT_FALSE(traceable<float>({1e19f, 2, 3}, {0, 0, 1}));
  EXPECT_FALSE(traceable<float>({1, 2, 3}, {0, kInfinity, 1}));
}

}  // namespace
}  // namespace cloudrenderer

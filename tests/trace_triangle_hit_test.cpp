#include "shapes/triangle_hit.h"

#include <embree3/rtcore.h>
#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <vector>

#include "parts/part_builder.h"
#include "trace/resident.h"

namespace cloudrenderer {
namespace {

using Corners = std::array<Vec3, 3>;

struct Rng {
  std::mt19937 engine;
  float operator()(float low, float high) { return std::uniform_real_distribution<float>(low, high)(engine); }
  Vec3 vec(float size) { return {(*this)(-size, size), (*this)(-size, size), (*this)(-size, size)}; }
};

// Small and large, near and far, every third as thin as a hair.
Corners random_triangle(Rng& rng, int i) {
  const float size = std::exp2(rng(-12, 12));
  const Vec3 at = rng.vec(size * std::exp2(rng(-2, 6)));
  Corners c{at + rng.vec(size), at + rng.vec(size), at + rng.vec(size)};
  if (i % 3 == 0) c[2] = c[0] + rng(0.1f, 0.9f) * (c[1] - c[0]) + rng.vec(size * 1e-5f);
  return c;
}

// A ray at a random place of the triangle, every fourth nearly in its plane.
TraceRay ray_at(Rng& rng, int i, const Corners& c) {
  const float u = rng(0, 1), v = rng(0, 1 - u);
  const Vec3 target = c[0] + u * (c[1] - c[0]) + v * (c[2] - c[0]);
  TraceRay r;
  r.direction = rng.vec(1.f);
  if (i % 4 == 0) r.direction = (c[1] - target) + (c[2] - target) * rng(0, 1) + glm::length(c[1] - c[0]) * rng.vec(1e-4f);
  r.origin = target - r.direction * rng(0.1f, 20.f) * glm::length(c[1] - c[0]);
  return r;
}

Part part_of(const std::vector<Corners>& triangles, std::uint32_t shape = 0) {
  PartBuilder builder;
  for (const Corners& c : triangles) {
    MeshChunk chunk;
    chunk.material = 0;
    chunk.shape = shape++;
    const std::vector<Triangle> one{{0, 1, 2}};
    builder.add_chunk(chunk, {c, {}, {}, one, {}});
  }
  return builder.build();
}

RTCRayHit embree_ray(const TraceRay& r) {
  RTCRayHit h{};
  h.ray = {r.origin.x, r.origin.y, r.origin.z, 0, r.direction.x, r.direction.y, r.direction.z, 0, kInfinity, 0xffffffffu, 0, 0};
  h.hit.geomID = RTC_INVALID_GEOMETRY_ID;
  return h;
}

// What the filter relies on, also of the processors that nobody has tried yet.
TEST(TriangleHit, IsEmbreesUpToTheRoundingOfItsReciprocal) {
  prepare_compute_thread();
  Rng rng{std::mt19937(3)};
  const RTCDevice device = rtcNewDevice("threads=1,max_isa=avx2");
  double worst_t = 0, worst_uv = 0;
  int hits = 0;
  for (int i = 0; i < 20000; ++i) {
    const Corners c = random_triangle(rng, i);
    const RTCScene scene = rtcNewScene(device);
    rtcSetSceneFlags(scene, RTC_SCENE_FLAG_ROBUST);
    const RTCGeometry g = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
    auto* v = static_cast<Vec3*>(rtcSetNewGeometryBuffer(g, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, sizeof(Vec3), 3));
    auto* index = static_cast<unsigned*>(rtcSetNewGeometryBuffer(g, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, 12, 1));
    for (unsigned k = 0; k < 3; ++k) v[k] = c[k], index[k] = k;
    rtcCommitGeometry(g);
    rtcAttachGeometry(scene, g);
    rtcReleaseGeometry(g);
    rtcCommitScene(scene);
    for (int k = 0; k < 8; ++k) {
      const TraceRay ray = ray_at(rng, i + k, c);
      RTCRayHit h = embree_ray(ray);
      RTCIntersectContext context;
      rtcInitIntersectContext(&context);
      rtcIntersect1(scene, &context, &h);
      if (h.hit.geomID == RTC_INVALID_GEOMETRY_ID) continue;
      ++hits;
      const auto exact = triangle_hit<float>(c, ray.origin, ray.direction);
      worst_t = std::max(worst_t, std::fabs(double{exact.t} / h.ray.tfar - 1));
      worst_uv = std::max({worst_uv, std::fabs(double{exact.u} - h.hit.u), std::fabs(double{exact.v} - h.hit.v)});
    }
    rtcReleaseScene(scene);
  }
  rtcReleaseDevice(device);
  EXPECT_GT(hits, 50000);
  EXPECT_LT(worst_t, kEmbreeError / 2);
  EXPECT_LT(worst_uv, kEmbreeError / 2);
}

// Triangles in one plane, one over the other: by rounding now this one is nearer, now that. Which one is found, alone, in
// packets, in one part or in several, is that of the smallest distance as it is computed here.
TEST(TriangleHit, DecidesBetweenTrianglesThatEmbreeCannotTellApart) {
  prepare_compute_thread();
  Rng rng{std::mt19937(5)};
  int differ = 0;
  for (int i = 0; i < 2000; ++i) {
    const Corners c = random_triangle(rng, 1);
    const std::vector<Corners> all{c, {c[1], c[2], c[0]}, {c[2], c[0], c[1]}, {c[0], c[2], c[1]}};
    Resident together({}), apart({});
    together.load_part(PartId{0}, part_of(all));
    for (std::uint32_t k = 0; k < all.size(); ++k) apart.load_part(PartId{k}, part_of({all[k]}, k));
    const auto one = together.snapshot(), four = apart.snapshot();
    RayPacket packet;
    Hit in_packet[8];
    std::array<Hit, 8> expected;
    for (std::size_t k = 0; k < 8; ++k) {
      const TraceRay ray = ray_at(rng, 1, c);
      lanes::put(packet.origin, k, ray.origin);
      lanes::put(packet.direction, k, ray.direction);
      lanes::put(packet.t_max, k, kInfinity);
      Hit& best = expected[k];
      for (std::uint32_t s = 0; s < all.size(); ++s) {
        Hit single;
        if (!four->intersect(s, ray, single)) continue;
        const auto exact = triangle_hit<float>(all[s], ray.origin, ray.direction);
        ASSERT_EQ(single.t, exact.t);
        ASSERT_EQ(single.u, exact.u);
        ASSERT_EQ(single.v, exact.v);
        if (comes_before(single.t, single.shape, single.primitive, best)) best = single;
      }
      differ += best.part != kNone && best.shape != 0;
      for (const bool backward : {false, true}) {
        Hit found;
        for (std::uint32_t s = 0; s < all.size(); ++s) four->intersect(backward ? 3 - s : s, ray, found);
        ASSERT_EQ(found.shape, best.shape);
        ASSERT_EQ(found.t, best.t);
      }
      Hit found;
      one->intersect(0, ray, found);
      ASSERT_EQ(found.shape, best.shape);
      ASSERT_EQ(found.t, best.t);
      ASSERT_EQ(found.u, best.u);
    }
    one->intersect8(0, packet, 0xff, Coherence::any, in_packet);
    for (std::size_t k = 0; k < 8; ++k) {
      ASSERT_EQ(in_packet[k].shape, expected[k].shape);
      ASSERT_EQ(in_packet[k].t, expected[k].t);
      ASSERT_EQ(in_packet[k].v, expected[k].v);
    }
  }
  EXPECT_GT(differ, 1000);  // else no ray was a hard one
}

// What Embree may use of a processor is no matter: edges, thin triangles, several boxes deep.
TEST(TriangleHit, InstructionSetsFindTheSameBits) {
  prepare_compute_thread();
  Rng rng{std::mt19937(9)};
  std::vector<Corners> all;
  for (int i = 0; i < 3000; ++i) {
    const Vec3 at = rng.vec(10.f), a = at + rng.vec(1.f), b = at + rng.vec(1.f);
    // Two that share an edge, the second sometimes thin.
    all.push_back({a, b, at + rng.vec(1.f)});
    all.push_back({b, a, i % 3 ? at + rng.vec(1.f) : 0.5f * (a + b) + rng.vec(1e-5f)});
  }
  const Part part = part_of(all);
  std::vector<std::shared_ptr<const ResidentSet>> sets;
  std::vector<std::unique_ptr<Resident>> residents;
  for (const char* isa : {"avx2", "avx512"}) {
    residents.push_back(std::make_unique<Resident>(Resident::Options{1, isa, {}, {}}));
    residents.back()->load_part(PartId{0}, part);
    sets.push_back(residents.back()->snapshot());
  }
  int hits = 0;
  for (int i = 0; i < 200000; ++i) {
    const Corners& c = all[static_cast<std::size_t>(i) % all.size()];
    TraceRay ray = ray_at(rng, i, c);
    if (i % 2) ray.direction = c[0] + rng(0, 1) * (c[1] - c[0]) - ray.origin;  // at an edge
    if (i % 5 == 0) ray.t_max = glm::length(c[1] - c[0]);
    Hit one, other;
    ASSERT_EQ(sets[0]->intersect(0, ray, one), sets[1]->intersect(0, ray, other));
    ASSERT_EQ(one.t, other.t);
    ASSERT_EQ(one.u, other.u);
    ASSERT_EQ(one.v, other.v);
    ASSERT_EQ(one.shape, other.shape);
    ASSERT_EQ(sets[0]->occluded(0, ray), sets[1]->occluded(0, ray));
    hits += one.part != kNone;
  }
  EXPECT_GT(hits, 100000);
}

// A ray that ends at a triangle, or a few units in the last place beside it.
TEST(TriangleHit, DecidesWhereRaysEnd) {
  prepare_compute_thread();
  Rng rng{std::mt19937(7)};
  int inside = 0, blocked = 0, all = 0;
  for (int i = 0; i < 4000; ++i) {
    const Corners c = random_triangle(rng, i);
    Resident resident({});
    resident.load_part(PartId{0}, part_of({c}));
    const auto set = resident.snapshot();
    TraceRay ray = ray_at(rng, i, c);
    Hit found;
    if (!set->intersect(0, ray, found)) continue;
    for (int k = -12; k <= 12; ++k) {
      const float end = found.t * (1.f + static_cast<float>(k) * 0x1p-23f);
      ray.t_max = end;
      Hit limited;
      const bool met = set->intersect(0, ray, limited);
      ASSERT_EQ(met, found.t <= end) << "seed 7, triangle " << i << ", step " << k;
      ray.t_max = end * (1.f + 2 * kEmbreeError);
      const bool dark = set->occluded(0, ray);
      ASSERT_EQ(dark, found.t < ray.t_max * (1.f - 2 * kEmbreeError)) << "seed 7, triangle " << i << ", step " << k;
      RayPacket packet;
      for (std::size_t lane = 0; lane < 8; ++lane) {
        lanes::put(packet.origin, lane, ray.origin);
        lanes::put(packet.direction, lane, ray.direction);
        lanes::put(packet.t_max, lane, ray.t_max);
      }
      ASSERT_EQ(set->occluded8(0, packet, 0x0f), dark ? 0x0fu : 0u);
      inside += met;
      blocked += dark;
      ++all;
    }
  }
  EXPECT_GT(inside, all / 4);
  EXPECT_LT(inside, 3 * all / 4);
  EXPECT_GT(blocked, all / 4);
  EXPECT_LT(blocked, 3 * all / 4);
}

}  // namespace
}  // namespace cloudrenderer

// Instances that move: what rays find at a time is what stands there at that time.
#include <gtest/gtest.h>

#include <array>
#include <random>
#include <vector>

#include "parts/part_builder.h"
#include "shapes/triangle.h"
#include "trace/resident.h"

namespace cloudrenderer {
namespace {

constexpr unsigned kSeed = 5;

struct Random {
  std::mt19937 rng{kSeed};
  float number(float lo, float hi) { return std::uniform_real_distribution<float>(lo, hi)(rng); }
  Vec3 vector(float size) { return {number(-size, size), number(-size, size), number(-size, size)}; }
  Vec3 direction() { return glm::normalize(vector(1) + Vec3(1e-4f)); }
  Mat4 matrix(float offset) {
    const Frame f(direction());
    Mat4 m(1.f);
    m[0] = glm::vec4(f.s * number(0.5f, 2), 0);
    m[1] = glm::vec4(f.t * number(0.5f, 2), 0);
    m[2] = glm::vec4(f.n * number(0.5f, 2), 0);
    m[3] = glm::vec4(vector(offset), 1);
    return m;
  }
};

// A bumpy ball of triangles, and a quadric beside it.
PartBuilder ball(std::uint32_t n) {
  std::vector<Vec3> p;
  std::vector<Triangle> t;
  for (std::uint32_t i = 0; i <= n; ++i)
    for (std::uint32_t j = 0; j <= n; ++j) {
      const float a = kPi * static_cast<float>(i) / static_cast<float>(n), b = 2 * a * static_cast<float>(j);
      const Vec3 d(std::sin(a) * std::cos(b), std::sin(a) * std::sin(b), std::cos(a));
      p.push_back(d * (1 + 0.2f * std::sin(7 * d.x)));
    }
  for (std::uint32_t i = 0; i < n; ++i)
    for (std::uint32_t j = 0; j < n; ++j) {
      const std::uint32_t k = i * (n + 1) + j;
      t.push_back({k, k + 1, k + n + 1});
      t.push_back({k + n + 1, k + 1, k + n + 2});
    }
  PartBuilder b;
  b.add_chunk({}, {p, {}, {}, t, {}});
  QuadricRecord q;
  q.shape = 1;
  q.quadric.object_to_world = Transform(Mat4(1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 1.5f, 0, 0, 1));
  b.add_quadric(q);
  return b;
}

struct Instance {
  InstanceRecord record;
  std::vector<MotionRecord> motions;
};

std::vector<Instance> some_instances(Random& r, std::uint32_t count) {
  using Way = AnimatedTransform::Interpolates;
  std::vector<Instance> out;
  for (std::uint32_t i = 0; i < count; ++i) {
    Instance in{{Transform(), 0, 2 * i}, {}};
    if (i % 4 == 0) in.record.to_world = Transform(r.matrix(8));
    for (std::uint32_t k = 0; k < i % 4 && k < 2; ++k)
      in.motions.push_back({r.matrix(8), r.matrix(8), 0.25f, 2, 0, k == i % 2 ? Way::inverse : Way::forward});
    out.push_back(in);
  }
  return out;
}

// Those with remainder r mod m.
Part part_of(const std::vector<Instance>& all, std::size_t m, std::size_t r) {
  PartBuilder b;
  for (std::size_t i = r; i < all.size(); i += m) b.add_instance(all[i].record, all[i].motions);
  return b.build();
}

TraceRay some_ray(Random& r) {
  const Vec3 from = r.vector(30);
  return {from, kInfinity, glm::normalize(r.vector(6) - from), r.number(0, 2.5f)};
}

void expect_same(const Hit& a, const Hit& b) {
  ASSERT_EQ(a.t, b.t);
  ASSERT_EQ(a.shape, b.shape);
  ASSERT_EQ(a.primitive, b.primitive);
  ASSERT_EQ(a.u, b.u);
  ASSERT_EQ(a.v, b.v);
}

TEST(Motion, PacketsAndSplitsFindTheBitsOfSingleRays) {
  prepare_compute_thread();
  SCOPED_TRACE(testing::Message() << "seed " << kSeed);
  Random r;
  const std::vector<Instance> instances = some_instances(r, 40);
  Resident whole({}), cut({});
  for (Resident* resident : {&whole, &cut}) resident->load_prototype(0, ball(24).build());
  whole.load_part(PartId{1}, part_of(instances, 1, 0));
  for (std::uint32_t k = 0; k < 3; ++k) cut.load_part(PartId{k + 1}, part_of(instances, 3, k));
  const auto a = whole.snapshot(), b = cut.snapshot();
  int hits = 0, blocks = 0;
  for (int i = 0; i < 4000; ++i) {
    std::array<Hit, 8> single, packet, parts;
    std::array<float, 8> times;
    RayPacket p;
    p.times = times.data();
    std::uint32_t blocked = 0;
    std::array<TraceRay, 8> rays;
    for (std::size_t k = 0; k < 8; ++k) {
      rays[k] = some_ray(r);
      if (i % 2 && k) rays[k].origin = rays[0].origin + r.vector(0.5f), rays[k].direction = rays[0].direction;
      rays[k].t_max = i % 3 ? kInfinity : 20.f;
      lanes::put(p.origin, k, rays[k].origin);
      lanes::put(p.direction, k, rays[k].direction);
      lanes::put(p.t_max, k, rays[k].t_max);
      times[k] = rays[k].time;
      a->intersect(1, rays[k], single[k]);
      for (const std::uint32_t part : {3u, 1u, 2u}) b->intersect(part, rays[k], parts[k]);
      blocked |= static_cast<std::uint32_t>(a->occluded(1, rays[k])) << k;
    }
    a->intersect8(1, p, 0xff, i % 2 ? Coherence::alike : Coherence::any, packet.data());
    ASSERT_EQ(a->occluded8(1, p, 0xff), blocked);
    std::uint32_t apart = 0;
    for (const std::uint32_t part : {1u, 2u, 3u}) apart |= b->occluded8(part, p, 0xff);
    ASSERT_EQ(apart, blocked);
    for (std::size_t k = 0; k < 8; ++k) {
      expect_same(single[k], packet[k]);
      expect_same(single[k], parts[k]);
      ASSERT_EQ(single[k].part != kNone, (blocked >> k & 1u) != 0);
      hits += single[k].part != kNone;
    }
    blocks += std::popcount(blocked);
  }
  EXPECT_GT(hits, 5000);
  EXPECT_EQ(hits, blocks);
}

TEST(Motion, WhatMovesIsWhereItIsAtTheTimeOfTheRay) {
  prepare_compute_thread();
  SCOPED_TRACE(testing::Message() << "seed " << kSeed);
  Random r;
  const std::vector<Instance> instances = some_instances(r, 20);
  Resident moving({});
  moving.load_prototype(0, ball(12).build());
  moving.load_part(PartId{1}, part_of(instances, 1, 0));
  const auto a = moving.snapshot();
  int hits = 0;
  for (const float time : {-1.f, 0.25f, 0.6f, 1.4f, 2.f, 7.f}) {
    PartBuilder still;
    for (std::uint32_t i = 0; i < instances.size(); ++i) {
      Transform moved;
      still.add_instance({a->place(1, i, time, moved), 0, instances[i].record.first_shape});
    }
    Resident standing({});
    standing.load_prototype(0, ball(12).build());
    standing.load_part(PartId{1}, still.build());
    const auto b = standing.snapshot();
    int differ = 0;
    for (int i = 0; i < 4000; ++i) {
      TraceRay ray = some_ray(r);
      ray.time = time;
      Hit one, other;
      a->intersect(1, ray, one);
      b->intersect(1, ray, other);
      hits += one.part != kNone;
      if (one.shape != other.shape || (one.part != kNone && std::fabs(one.t - other.t) > 1e-4f * other.t)) ++differ;
    }
    EXPECT_LE(differ, 4) << time;  // rays that graze an outline
  }
  EXPECT_GT(hits, 5000);
}

// Convex things that are far away and turn fast: a ray that leaves one never finds it again, however flat.
TEST(Motion, GrazingRaysDoNotFindTheSurfaceThatTheyLeave) {
  prepare_compute_thread();
  SCOPED_TRACE(testing::Message() << "seed " << kSeed);
  Random r;
  PartBuilder sphere, plane;
  sphere.add_quadric({});
  const std::vector<Vec3> corners = {{-3, -3, 0.1f}, {3, -3, 0.1f}, {3, 3, 0.1f}, {-3, 3, 0.1f}};
  const std::vector<Triangle> triangles = {{0, 1, 2}, {2, 3, 0}};
  plane.add_chunk({}, {corners, {}, {}, triangles, {}});
  const Part prototypes[2] = {sphere.build(), plane.build()};
  int left = 0, acne = 0;
  for (std::uint32_t kind = 0; kind < 2; ++kind)
    for (int i = 0; i < 60; ++i) {
      Resident resident({});
      resident.load_prototype(0, prototypes[kind]);
      const float offset = std::array{1.f, 50.f, 3000.f}[static_cast<std::size_t>(i % 3)];
      const Mat4 start = r.matrix(offset), end = r.matrix(offset);
      PartBuilder b;
      b.add_instance({}, std::vector<MotionRecord>{{start, end, 0, 1, 0, static_cast<AnimatedTransform::Interpolates>(i % 2)}});
      resident.load_part(PartId{1}, b.build());
      const auto set = resident.snapshot();
      for (int k = 0; k < 200; ++k) {
        const float time = r.number(0, 1);
        Transform to_world;
        set->place(1, 0, time, to_world);
        const Vec3 from = to_world.point(r.direction() * 4.f), to = to_world.point(r.vector(0.7f));
        const TraceRay ray{from, kInfinity, glm::normalize(to - from), time};
        Hit hit;
        if (!set->intersect(1, ray, hit)) continue;
        SurfacePoint p;
        if (kind == 0) {
          const Transform inverse = to_world.inverse();
          p = surface_point(prototypes[0].quadrics[0].quadric, false, inverse.point(ray.origin), inverse.vector(ray.direction), hit.t);
        } else {
          TriangleVertices tri{};
          for (int c = 0; c < 3; ++c) tri.p[static_cast<std::size_t>(c)] = corners[triangles[hit.index][c]];
          p = triangle_point(tri, false, Dialect::v3, hit.u, hit.v);
        }
        p = transformed(p, to_world);
        p.p_error += inverse_error(p.p, to_world);
        for (const float rise : {1e-6f, 1e-4f, 1e-2f}) {
          const Frame frame(p.ng);
          const float turn = r.number(0, 2 * kPi);
          Vec3 d = frame.s * std::cos(turn) + frame.t * std::sin(turn) + p.ng * rise;
          if (kind == 1 && k % 2) d -= 2.f * rise * p.ng;  // a plane has two sides
          d = glm::normalize(d);
          ++left;
          acne += set->occluded(1, {offset_ray_origin(p.p, p.p_error, p.ng, d), 1e6f, d, time});
        }
      }
    }
  EXPECT_GT(left, 30000);
  EXPECT_EQ(acne, 0);
}

}  // namespace
}  // namespace cloudrenderer

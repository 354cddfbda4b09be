#pragma once
#include <cstring>
#include <vector>

#include "base/random.h"
#include "wire/codec.h"

namespace cloudrenderer::wire {

inline PathSegment some_segment(std::uint64_t i) {
  const auto u = [&](std::uint64_t k) {
    return to_unit(static_cast<std::uint32_t>(mix64(i * 64 + k) >> 32));
  };
  PathSegment s{};
  s.origin = Vec3(u(0) * 100.f, -u(1), u(2));
  s.direction = glm::normalize(Vec3(u(3) - 0.5f, u(4) - 0.5f, u(5) + 0.1f));
  s.throughput = Vec3(u(6), u(7), u(8));
  s.previous_pdf = u(9);
  s.radiance = {static_cast<std::int64_t>(mix64(i) >> 30),
                -static_cast<std::int64_t>(mix64(i + 1) >> 33), 0};
  s.previous_normal = Vec3(0, u(10), u(11));
  s.best = {i % 3 == 0 ? kInfinity : u(12) * 50.f, static_cast<std::uint32_t>(i), 7};
  s.tested = mix64(i + 5);
  s.task = static_cast<std::uint32_t>(i % 5);
  s.pixel = static_cast<std::uint32_t>(i * 3);
  s.sample = static_cast<std::uint32_t>(i % 64);
  s.owner = static_cast<std::uint16_t>(1 + i % 9);
  s.vertex = static_cast<std::uint16_t>(i % 6);
  s.flags = static_cast<std::uint16_t>(i % 4);
  s.window = static_cast<std::uint16_t>(i % 2);
  s.passed = static_cast<std::uint16_t>(i % 3);
  s.medium = static_cast<std::uint16_t>(i % 5);
  s.cone_width = u(13);
  s.cone_spread = u(14) - 0.5f;
  return s;
}

inline SegmentChunk some_segments(std::size_t n, std::uint64_t first = 0) {
  std::vector<PathSegment> v;
  for (std::size_t i = 0; i < n; ++i) v.push_back(some_segment(first + i));
  return std::make_shared<const std::vector<PathSegment>>(std::move(v));
}

inline SubmitTask some_block(std::size_t n, ColumnSet columns = kAllColumns) {
  SegmentBlock block;
  block.columns = columns;
  block.chunks = {some_segments(n)};
  return {{11, 22}, 3, 4, std::move(block)};
}

inline SubmitTask some_rays(std::size_t n) {
  std::vector<OcclusionRay> rays;
  for (std::size_t i = 0; i < n; ++i) {
    const PathSegment s = some_segment(i);
    rays.push_back({s.origin, s.direction, static_cast<float>(i)});
  }
  OcclusionBlock block;
  block.chunks = {std::make_shared<const std::vector<OcclusionRay>>(std::move(rays))};
  return {{1, 2}, 3, 4, std::move(block)};
}

inline AnsweredHit some_hit(std::uint32_t i, std::uint16_t flags) {
  AnsweredHit h;
  const auto number = [i](std::uint32_t k) { return static_cast<float>(i * 32 + k) / 64.f; };
  h.t = number(0);
  h.u = 0.25f;
  h.v = 0.5f;
  h.shape = i;
  h.primitive = i + 9;
  for (std::uint32_t c = 0; c < 3; ++c) {
    h.surface.p[c] = Vec3(number(c + 1), -number(c + 2), number(c));
    if (flags & kAnsweredNormals) h.surface.n[c] = Vec3(0, number(c + 4), 1);
    if (flags & kAnsweredUvs) h.surface.uv[c] = Vec2(number(c + 5), 0);
  }
  h.surface.material = i + 2;
  h.surface.flags = flags;
  return h;
}

// Of some_rays(70): two thirds are found.
inline NearestReply some_nearest(std::uint16_t flags) {
  NearestReply r;
  r.count = 70;
  r.found.resize(2);
  for (std::uint32_t i = 0; i < r.count; ++i) {
    if (i % 3 == 0) continue;
    r.found[i / 64] |= std::uint64_t{1} << (i % 64);
    r.hits.push_back(some_hit(i, static_cast<std::uint16_t>(i % 2 ? flags : flags & kAnsweredFlip)));
  }
  return r;
}

}  // namespace cloudrenderer::wire

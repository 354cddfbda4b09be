#include "cluster/fingerprint.h"

#include <xxhash.h>

#include <vector>

#include "base/portable_math.h"
#include "base/random.h"
#include "parts/part_builder.h"
#include "trace/resident.h"

namespace cloudrenderer {
namespace {

constexpr std::uint32_t kValues = 512, kGrid = 24, kRays = 2048;

float unit(std::uint32_t i) { return to_unit(static_cast<std::uint32_t>(mix64(i) >> 32)); }

void add_functions(std::vector<float>& out) {
  for (std::uint32_t i = 0; i < kValues; ++i) {
    const float x = 20.f * unit(2 * i) - 10.f, u = unit(2 * i + 1);
    for (const float v :
         {portable::sin(x), portable::cos(x), portable::exp(x), portable::log(u + 1e-3f),
          portable::pow(u, 2.2f), portable::acos(2.f * u - 1.f), portable::atan2(x, u)})
      out.push_back(v);
  }
}

// A bumpy terrain, and rays from above at random: many of them graze edges. A copy of it moves.
void add_rays(std::vector<float>& out) {
  std::vector<Vec3> positions;
  std::vector<Triangle> triangles;
  for (std::uint32_t y = 0; y < kGrid; ++y)
    for (std::uint32_t x = 0; x < kGrid; ++x)
      positions.emplace_back(static_cast<float>(x), static_cast<float>(y), unit(y * kGrid + x));
  for (std::uint32_t y = 0; y + 1 < kGrid; ++y)
    for (std::uint32_t x = 0; x + 1 < kGrid; ++x) {
      const std::uint32_t a = y * kGrid + x, b = a + kGrid;
      triangles.push_back({a, a + 1, b + 1});
      triangles.push_back({a, b + 1, b});
    }
  PartBuilder builder;
  MeshChunk chunk;
  chunk.material = 0;
  builder.add_chunk(chunk, {positions, {}, {}, triangles, {}});
  Resident resident(Resident::Options{});
  const Part terrain = builder.build();
  resident.load_prototype(0, terrain);
  resident.load_part(PartId{0}, terrain);
  PartBuilder moving;
  MotionRecord m{Mat4(1.f), Mat4(1.f), 0, 1, 0, AnimatedTransform::Interpolates::inverse};
  m.start[3] = {1, 2, 0.5f, 1};
  for (int c = 0; c < 3; ++c) m.end[c] = {unit(100 + 3 * c) - 0.5f, unit(101 + 3 * c) - 0.5f, unit(102 + 3 * c), 0};
  if (!AnimatedTransform::can_move(m.start, m.end)) m.end[0] = -m.end[0];
  moving.add_instance({}, std::span(&m, 1));
  resident.load_part(PartId{1}, moving.build());
  const auto set = resident.snapshot();
  for (std::uint32_t i = 0; i < kRays; ++i) {
    TraceRay ray;
    ray.origin = {(kGrid - 1) * unit(7000 + 4 * i), (kGrid - 1) * unit(7001 + 4 * i), 3.f};
    ray.direction = {unit(7002 + 4 * i) - 0.5f, unit(7003 + 4 * i) - 0.5f, -0.3f};
    ray.time = unit(9000 + i);
    Hit hit;
    bool found = set->intersect(0, ray, hit);
    if (i % 2) found = set->intersect(1, ray, hit) || found;
    if (!found) continue;
    for (const float v : {hit.t, hit.u, hit.v, static_cast<float>(hit.index)}) out.push_back(v);
  }
}

}  // namespace

std::uint64_t numeric_fingerprint() {
  // Once a process: a host of a pool introduces itself to many managers.
  static const std::uint64_t fingerprint = [] {
    std::vector<float> values;
    add_functions(values);
    add_rays(values);
    return XXH3_64bits(values.data(), values.size() * sizeof(float));
  }();
  return fingerprint;
}

}  // namespace cloudrenderer

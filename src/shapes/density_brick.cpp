#include "shapes/density_brick.h"

#include <algorithm>
#include <vector>

#include "base/portable_math.h"
#include "base/random.h"

namespace cloudrenderer {
namespace {

constexpr std::uint64_t kMostSteps = 1 << 20;

// Between 8 samples, at most at the last ones.
float interpolate(const DensityBrick& brick, std::span<const float> samples, const Vec3& p) {
  std::array<std::uint32_t, 3> cell{};
  Vec3 part;
  for (int a = 0; a < 3; ++a) {
    const auto i = static_cast<std::size_t>(a);
    const auto last = static_cast<float>(brick.size[i] - 1);
    const float at = std::min(std::max(0.f, (p[a] - brick.first[a]) * brick.scale[a]), last);  // NaN becomes 0
    cell[i] = std::min(static_cast<std::uint32_t>(at), brick.size[i] - 2);
    part[a] = at - static_cast<float>(cell[i]);
  }
  const std::size_t row = brick.size[0], slice = row * brick.size[1];
  const float* s = samples.data() + cell[0] + cell[1] * row + cell[2] * slice;
  const auto mix = [](float a, float b, float t) { return (1.f - t) * a + t * b; };
  const auto plane = [&](const float* q) {
    return mix(mix(q[0], q[1], part.x), mix(q[row], q[row + 1], part.x), part.y);
  };
  return mix(plane(s), plane(s + slice), part.z);
}

}  // namespace

void cut_grid(const glm::uvec3& size, const Vec3& p0, const Vec3& p1, bool clamped, const Transform& object_to_world,
              std::span<const float> density,
              const std::function<void(const DensityBrick&, std::uint32_t, std::span<const float>)>& sink) {
  // Cell c of an axis lies between samples c - 1 and c; the first and last reach half a cell into what is around the grid.
  const auto value = [&](std::int64_t x, std::int64_t y, std::int64_t z) {
    std::array<std::int64_t, 3> i{x, y, z};
    for (std::size_t a = 0; a < 3; ++a) {
      const std::int64_t last = std::int64_t{size[static_cast<int>(a)]} - 1;
      if (!clamped && (i[a] < 0 || i[a] > last)) return 0.f;
      i[a] = std::clamp<std::int64_t>(i[a], 0, last);
    }
    return density[(static_cast<std::size_t>(i[2]) * size.y + static_cast<std::size_t>(i[1])) * size.x + static_cast<std::size_t>(i[0])];
  };
  // Where cell c begins; the same number for both of the bricks that meet there.
  const auto plane = [&](int a, std::uint32_t c) {
    const double x = std::clamp((static_cast<double>(c) - 0.5) / static_cast<double>(size[a]), 0.0, 1.0);
    return static_cast<float>(static_cast<double>(p0[a]) + x * (static_cast<double>(p1[a]) - static_cast<double>(p0[a])));
  };
  const glm::uvec3 bricks = (size + kBrickCells) / kBrickCells;  // of size + 1 cells
  std::vector<float> samples;
  std::uint32_t number = 0;
  for (std::uint32_t bz = 0; bz < bricks.z; ++bz)
    for (std::uint32_t by = 0; by < bricks.y; ++by)
      for (std::uint32_t bx = 0; bx < bricks.x; ++bx, ++number) {
        const glm::uvec3 begin = glm::uvec3(bx, by, bz) * kBrickCells, end = glm::min(begin + kBrickCells, size + 1u);
        samples.clear();
        for (std::int64_t z = begin.z; z <= end.z; ++z)
          for (std::int64_t y = begin.y; y <= end.y; ++y)
            for (std::int64_t x = begin.x; x <= end.x; ++x) samples.push_back(value(x - 1, y - 1, z - 1));
        DensityBrick brick;
        brick.majorant = *std::max_element(samples.begin(), samples.end());
        if (!(brick.majorant > 0.f)) continue;
        brick.object_to_world = object_to_world;
        for (int a = 0; a < 3; ++a) {
          const float from = plane(a, begin[a]), to = plane(a, end[a]);
          const float width = p1[a] - p0[a];
          brick.low[a] = std::min(from, to);
          brick.high[a] = std::max(from, to);
          brick.scale[a] = static_cast<float>(size[a]) / width;
          brick.first[a] = p0[a] + width * ((static_cast<float>(begin[a]) - 0.5f) / static_cast<float>(size[a]));
          brick.size[static_cast<std::size_t>(a)] = end[a] - begin[a] + 1;
        }
        sink(brick, number, samples);
      }
}

float track(const DensityBrick& brick, std::span<const float> samples, const Vec3& origin, const Vec3& direction,
            float t_far, float rate, Vec2 first, std::uint64_t key) {
  const Transform to_object = brick.object_to_world.inverse();
  const Vec3 o = to_object.point(origin), d = to_object.vector(direction);
  double t = 0, end = static_cast<double>(kInfinity);
  for (int a = 0; a < 3; ++a) {
    if (d[a] == 0.f) {
      if (!(o[a] >= brick.low[a] && o[a] < brick.high[a])) return kInfinity;
      continue;
    }
    const double inverse = 1.0 / static_cast<double>(d[a]);
    double enter = (static_cast<double>(brick.low[a]) - static_cast<double>(o[a])) * inverse;
    double leave = (static_cast<double>(brick.high[a]) - static_cast<double>(o[a])) * inverse;
    if (enter > leave) std::swap(enter, leave);
    t = std::max(t, enter);
    end = std::min(end, leave);
  }
  const double step = 1.0 / (static_cast<double>(rate) * static_cast<double>(brick.majorant));
  if (!(step > 0 && step < static_cast<double>(kInfinity))) return kInfinity;
  end = std::min(end, static_cast<double>(t_far));
  for (std::uint64_t i = 1; t < end; ++i) {
    if (i > kMostSteps) return static_cast<float>(t);  // so dense that nothing comes through
    t -= portable::log(1.0 - static_cast<double>(first.x)) * step;
    if (!(t < end)) break;
    const Vec3 p = o + static_cast<float>(t) * d;
    if (first.y * brick.majorant < interpolate(brick, samples, p)) return static_cast<float>(t);
    const std::uint64_t bits = mix64(key + i * 0x9e3779b97f4a7c15u);
    first = {to_unit(static_cast<std::uint32_t>(bits >> 32)), to_unit(static_cast<std::uint32_t>(bits))};
  }
  return kInfinity;
}

}  // namespace cloudrenderer

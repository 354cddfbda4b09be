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

void cut_grid(const GridLayout& grid, const Voxels& voxels, const Transform& object_to_world,
              const std::function<void(const DensityBrick&, std::uint32_t, std::span<const float>)>& sink) {
  // Cell c of an axis lies between samples c - 1 and c; the first and last reach into what is around the grid.
  const float shift = grid.first_sample - 1;
  // Where cell c begins; the same number for both of the bricks that meet there.
  const auto plane = [&](int a, std::uint32_t c) {
    const double x = std::clamp((static_cast<double>(c) + static_cast<double>(shift)) / static_cast<double>(grid.size[a]), 0.0, 1.0);
    return static_cast<float>(static_cast<double>(grid.p0[a]) + x * (static_cast<double>(grid.p1[a]) - static_cast<double>(grid.p0[a])));
  };
  const glm::uvec3 bricks = (grid.size + kBrickCells) / kBrickCells;  // of size + 1 cells
  std::vector<float> samples;
  std::uint32_t number = 0;
  for (std::uint32_t bz = 0; bz < bricks.z; ++bz)
    for (std::uint32_t by = 0; by < bricks.y; ++by)
      for (std::uint32_t bx = 0; bx < bricks.x; ++bx, ++number) {
        const glm::uvec3 begin = glm::uvec3(bx, by, bz) * kBrickCells, end = glm::min(begin + kBrickCells, grid.size + 1u);
        const glm::ivec3 low = glm::ivec3(begin) - 1, high = glm::ivec3(end);
        DensityBrick brick;
        brick.channels = grid.channels;
        brick.densities = grid.densities;
        for (int a = 0; a < 3; ++a) brick.size[static_cast<std::size_t>(a)] = end[a] - begin[a] + 1;
        const std::size_t n = brick.channel_samples();
        samples.resize(n * grid.channels);
        for (std::uint32_t c = 0; c < grid.channels; ++c) {
          if (c == grid.densities) {
            brick.majorant = *std::max_element(samples.begin(), samples.begin() + static_cast<std::ptrdiff_t>(n * c));
            if (!(brick.majorant > 0.f)) break;
          }
          const std::span<float> channel(samples.data() + n * c, n);
          voxels.read(c, low, high, channel.data());
          if (c < grid.densities)
            for (float& d : channel) d = d > 0.f ? d : 0.f;
        }
        if (grid.channels == grid.densities) brick.majorant = *std::max_element(samples.begin(), samples.end());
        if (!(brick.majorant > 0.f)) continue;
        brick.object_to_world = object_to_world;
        for (int a = 0; a < 3; ++a) {
          const float from = plane(a, begin[a]), to = plane(a, end[a]);
          const float width = grid.p1[a] - grid.p0[a];
          brick.low[a] = std::min(from, to);
          brick.high[a] = std::max(from, to);
          brick.scale[a] = static_cast<float>(grid.size[a]) / width;
          brick.first[a] = grid.p0[a] + width * ((static_cast<float>(begin[a]) + shift) / static_cast<float>(grid.size[a]));
        }
        sink(brick, number, samples);
      }
}

float value_at(const DensityBrick& brick, std::span<const float> channel, const Vec3& p) {
  return interpolate(brick, channel, p);
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

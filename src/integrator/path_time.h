#pragma once
#include <cstdint>

#include "base/random.h"
#include "integrator/job.h"

namespace cloudrenderer {

// The dimension of a sample that its time is from: far from those of film, lens and vertices.
inline constexpr std::uint32_t kTimeDimension = 0x74696d65;

// A path has one time. It is computed anew wherever it is needed, so that nothing carries it.
inline float path_time(const JobSettings& job, const Shutter& shutter, std::uint32_t pixel, std::uint32_t sample) {
  const float u = SampleSequence(job.sequence, job.seed, pixel, sample).get_2d(kTimeDimension).x;
  return (1.f - u) * shutter.open + u * shutter.close;
}

}  // namespace cloudrenderer

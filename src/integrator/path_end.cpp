// What is asked where paths end up: how the film takes their light.
#include <cmath>

#include "integrator/path_tracer.h"

namespace cloudrenderer {

bool PathTracer::in_negative_lobe(std::uint32_t pixel, std::uint32_t sample, bool shares) const {
  return filter_->negative(SampleSequence(job_.sequence, job_.seed, pixel, shared_.ray_sample(sample, shares)).get_2d(0));
}

void PathTracer::limit(PathEnd& end) const {
  const auto limited = [&](Fixed3& light) {
    Rgb c;
    for (std::size_t i = 0; i < 3; ++i) c[static_cast<int>(i)] = static_cast<float>(static_cast<double>(light[i]) / fixed_units_);
    const double factor = sample_limit(job_.film, c);  // between 0 and 1
    if (factor < 1)
      for (std::int64_t& channel : light) channel = std::llrint(static_cast<double>(channel) * factor);
  };
  limited(end.radiance);
  if (end.target != kNone) limited(end.splat);
}

}  // namespace cloudrenderer

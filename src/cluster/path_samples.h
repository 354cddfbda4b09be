#pragma once
// Paths traced to see which parts they visit: what a simulation of larger clusters replays.
#include "integrator/job.h"
#include "parts/part.h"
#include "simulate/scene_model.h"

namespace cloudrenderer {

// About `count` of the job's paths, evenly over the picture. Loads the whole scene. Throws ClusterError.
sim::PathSamples sample_paths(const std::string& folder, const Manifest& manifest, const JobSettings& settings, std::uint32_t count);

}  // namespace cloudrenderer

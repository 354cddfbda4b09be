#include <algorithm>

#include "integrator/shared_rays.h"
#include "simulate/simulation.h"

namespace cloudrenderer::sim {
namespace {

constexpr double kPathsARun = 4e6;          // simulated ones, that a run takes on when nothing is said
// That one simulated stands for. A host has 131,072 under way: with 4096 each it had 32 simulated ones, too few to keep its threads at work,
// and a frame on 128 hosts took 76 s in place of 34 (with 16 each) and 41 (256).
constexpr double kMostPaths = 256;
constexpr std::uint32_t kRealRound = 16;  // samples

}  // namespace

Grain choose_grain(const SceneModel& model, const ClusterPlan& plan) {
  const double paths = static_cast<double>(model.width) * model.height * model.spp;
  const bool many = plan.hosts > 64;  // whose rounds are longer (ManagerCore::lengthen_rounds)
  const double wanted = plan.segment != 0 ? plan.segment : std::clamp(paths / kPathsARun, 1.0, kMostPaths);
  Grain g;
  // Samples first: tiles keep their pixels, and with them their share of the parts.
  // Groups of samples that share a camera ray stay groups.
  const std::uint32_t block = SharedRays(model.samples_per_ray, model.spp).block();
  while (g.paths() * 2 <= wanted && g.samples < (many ? 4 : 1) * kRealRound && g.samples * 2 * block <= model.spp) g.samples *= 2;
  while (g.paths() * 4 <= wanted && g.side < 8) g.side *= 2;
  return g;
}

}  // namespace cloudrenderer::sim

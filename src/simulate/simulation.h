#pragma once
// A whole render by a cluster in virtual time: the real manager and worker cores (placement, cover, tasks, failures)
// over a model of hosts, network and scene. A pure function of its arguments but for ManagerLoad::cpu_s and what
// follows from it, which are measured.
#include "simulate/cluster_plan.h"
#include "simulate/scene_model.h"

namespace cloudrenderer::sim {

// How many real paths a simulated one stands for: of tiles of `side` x `side` pixels one, of `samples` samples one.
struct Grain {
  std::uint32_t side = 1, samples = 1;
  std::uint32_t paths() const { return side * side * samples; }
};
// The largest grain of at most plan.segment paths; 0: so that a run takes about a minute here.
Grain choose_grain(const SceneModel& model, const ClusterPlan& plan);

Prediction simulate(const SceneModel& model, const ClusterPlan& plan);

}  // namespace cloudrenderer::sim

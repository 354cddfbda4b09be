#pragma once
// A host of the simulated cluster: the real core, parts that are only counted, lines and processors.
#include <memory>
#include <string>
#include <unordered_set>
#include <vector>

#include "simulate/cluster_plan.h"
#include "simulate/replay_engine.h"
#include "tasks/link.h"
#include "tasks/worker_core.h"

namespace cloudrenderer::sim {

inline constexpr double kEndOfTime = 30 * 86400;  // a render that takes longer is not simulated to its end

// A part's bytes as the real host's loader counts them.
class Store final : public PartLoader {
 public:
  Store(const SceneModel& model, std::uint64_t memory, std::uint32_t width, std::uint32_t height, std::uint32_t spp)
      : engine(model, width, height, spp), model_(model), memory_(memory) {
    engine.resident.insert(0);
    used_ = cost(0);
  }
  ReplayEngine engine;
  bool has_room(PartId p, BvhForm form) const override {
    const PlacementPart& part = model_.parts[p.value].placement;
    const std::uint64_t more = form == BvhForm::passing && part.page != 0 ? part.page : part.bytes + part.build;
    return used_ + more <= memory_;
  }
  std::string start_job(const wire::JobStart&) override { return {}; }
  std::string load(PartId p, BvhForm) override {
    if (engine.resident.insert(p.value).second) used_ += cost(p.value);
    return {};
  }
  void unload(PartId p) override {
    if (engine.resident.erase(p.value) != 0) used_ -= cost(p.value);
  }
  void end_job() override {}
  std::uint64_t bytes_used() const override { return used_; }

 private:
  std::uint64_t cost(std::uint32_t p) const { return model_.parts[p].placement.bytes; }
  const SceneModel& model_;
  std::uint64_t memory_, used_ = 0;
};

struct SimulatedHost {
  HostId id;
  const HostKind* kind = nullptr;
  std::unique_ptr<WorkerCore> core;
  std::unique_ptr<Store> store;
  std::unique_ptr<Link> link;  // to the manager
  std::unordered_set<std::uint32_t> peers;  // that it has had something for
  std::uint32_t busy = 0;
  bool alive = true;
  double joined = 0, left = 0;
  double wake = kEndOfTime;          // the next timer that is set
  double line_out = 0, line_in = 0;  // when it is free again
  double debt = 0;                   // processor seconds of talking that are not worked off yet
  double busy_s = 0, cpu_s = 0;
  double per_batch = 0;              // real segments and rays that leave after a batch, on average
  std::uint64_t in_flight = 0;       // messages that have not arrived
};

// The mixture of kinds is exact, whatever the number of hosts: each comes when it is most behind its share.
class KindMixer {
 public:
  explicit KindMixer(const std::vector<HostKind>& kinds) : kinds_(kinds), given_(kinds.size()) {
    for (const HostKind& k : kinds) all_ += k.weight;
  }
  const HostKind& next() {
    ++drawn_;
    std::size_t behind = 0;
    const auto lag = [&](std::size_t i) { return kinds_[i].weight / all_ * drawn_ - given_[i]; };
    for (std::size_t i = 1; i < kinds_.size(); ++i)
      if (lag(i) > lag(behind)) behind = i;
    ++given_[behind];
    return kinds_[behind];
  }

 private:
  const std::vector<HostKind>& kinds_;
  std::vector<double> given_;
  double all_ = 0, drawn_ = 0;
};

}  // namespace cloudrenderer::sim

#pragma once
// A host of the simulated cluster: the core, its links, and a store of made-up parts.
#include <cstdint>
#include <map>
#include <memory>
#include <set>
#include <string>

#include "cluster_sim.h"

namespace cloudrenderer::sim {

inline constexpr HostId kManager{0};

inline std::uint64_t incarnation_of(HostId h) { return 1000 + h.value; }

inline std::uint64_t part_bytes(const Scenario& s, std::uint32_t part) {
  return part == 0 ? 10 : kPartBytes + mix64(s.seed + part) % 20;
}

class Loader final : public PartLoader {
 public:
  explicit Loader(const Scenario& s) : engine(s.scene), s_(s) { engine.resident.insert(0); }
  MadeUpEngine engine;
  bool has_room(PartId p, BvhForm) const override { return bytes_used() + part_bytes(s_, p.value) <= s_.memory; }
  std::string start_job(const wire::JobStart&) override { return {}; }
  std::string load(PartId p, BvhForm) override {
    if (!engine.resident.insert(p.value).second) return "is there already";
    return {};
  }
  void unload(PartId p) override { unloaded += engine.resident.erase(p.value); }
  void end_job() override { engine.resident = {0}; }
  std::uint64_t bytes_used() const override {
    std::uint64_t bytes = 0;
    for (const std::uint32_t p : engine.resident) bytes += part_bytes(s_, p);
    return bytes;
  }
  std::uint64_t unloaded = 0;

 private:
  const Scenario& s_;
};

struct Node {
  explicit Node(HostId h) : id(h) {}
  HostId id;
  std::unique_ptr<WorkerCore> core;  // null: the manager
  std::unique_ptr<Loader> loader;
  std::map<HostId, Link> links;
  std::set<HostId> peers, gone;  // of the last host list; once there, now not
  std::uint64_t hosts_version = 0;
  std::uint32_t busy = 0;
  bool alive = true;
  bool traces = true;  // else it only intersects
  bool going = false;  // an event has struck it
  double slowness = 1;
  double wake = 0;     // the next timer that is set
};

}  // namespace cloudrenderer::sim

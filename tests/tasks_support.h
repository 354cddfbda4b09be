#pragma once
// A worker core with its own little scene, driven by hand.
#include <memory>
#include <set>
#include <utility>
#include <vector>

#include "sim/made_up_engine.h"
#include "tasks/worker_core.h"

namespace cloudrenderer {

inline constexpr HostId kManagerHost{0};

inline wire::SceneHostMap map_of(
    std::uint32_t epoch, std::uint32_t generation, std::uint32_t parts,
    const std::vector<std::pair<std::uint32_t, std::vector<std::uint32_t>>>& holders) {
  wire::SceneHostMap m;
  m.set_epoch(epoch);
  m.set_generation(generation);
  m.set_part_count(parts);
  for (const auto& [host, held] : holders) {
    m.add_hosts()->set_host(host);
    if (held.empty()) continue;
    auto& h = *m.add_holdings();
    h.set_host(host);
    for (const std::uint32_t p : held) h.add_parts(p);
  }
  return m;
}

class NoLoader final : public PartLoader {
 public:
  explicit NoLoader(std::set<std::uint32_t>& resident) : resident_(resident) {}
  std::string start_job(const wire::JobStart&) override { return error; }
  bool has_room(PartId, BvhForm) const override { return resident_.size() < room; }
  std::string load(PartId p, BvhForm) override {
    resident_.insert(p.value);
    return {};
  }
  void unload(PartId p) override { resident_.erase(p.value); }
  void end_job() override { ended = true; }
  std::uint64_t bytes_used() const override { return resident_.size(); }
  std::string error;
  bool ended = false;
  std::size_t room = 1000;

 private:
  std::set<std::uint32_t>& resident_;
};

struct TestHost {
  static constexpr std::uint32_t kParts = 9, kWidth = 8;

  explicit TestHost(std::uint32_t self, WorkerOptions options = {},
                    const sim::MadeUpScene& scene = {7, kParts, kWidth, 6, 5})
      : id(self), engine(scene), core(id, 1000 + self, options) {
    engine.resident.insert(0);
  }

  // Job, parts and map, as the manager would send them.
  void start(const std::vector<std::uint32_t>& parts, const wire::SceneHostMap& map) {
    wire::JobStart job;
    job.set_job(1);
    job.set_width(kWidth);
    job.set_height(8);
    job.set_columns(wire::kAllColumns);
    core.receive(kManagerHost, job, now);
    wire::LoadParts load;
    for (const std::uint32_t p : parts) load.add_parts(p);
    core.receive(kManagerHost, load, now);
    run_loader();
    core.receive(kManagerHost, map, now);
    (void)core.take_outbox();
  }
  void give_range(std::uint32_t task, std::uint32_t samples = 4) {
    core.receive(
        kManagerHost,
        wire::SubmitTask{{5, task}, 1, 1, RendererRange{task, 0, 0, kWidth, 4, 0, samples}}, now);
  }
  void run_loader() {
    while (auto w = core.take_load(now)) {
      WorkResult r = execute(loader, *w);
      core.finish(*w, r, now);
    }
  }
  // One piece of work, or false.
  bool step() {
    auto w = core.take(now);
    if (!w) return false;
    WorkResult r = execute(engine, *w);
    core.finish(*w, r, now);
    return true;
  }
  void run() {
    while (step()) {
    }
  }
  void tick_later(double seconds) {
    now += seconds;
    core.tick(now);
  }
  // What it has to say, but for heartbeats.
  WorkerCore::Outbox said() {
    auto out = core.take_outbox();
    std::erase_if(out,
                  [](const auto& m) { return std::holds_alternative<wire::Status>(m.second); });
    return out;
  }

  HostId id;
  double now = 0;
  sim::MadeUpEngine engine;
  NoLoader loader{engine.resident};
  WorkerCore core;
};

template <class T>
std::vector<std::pair<HostId, T>> only(const WorkerCore::Outbox& outbox) {
  std::vector<std::pair<HostId, T>> found;
  for (const auto& [to, m] : outbox)
    if (const auto* t = std::get_if<T>(&m)) found.emplace_back(to, *t);
  return found;
}

}  // namespace cloudrenderer

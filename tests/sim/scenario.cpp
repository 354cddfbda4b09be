// Which clusters are simulated, and what befalls them.
#include <algorithm>
#include <cmath>

#include "cluster_sim.h"

namespace cloudrenderer::sim {

Scenario random_scenario(std::uint64_t seed) {
  Dice d(seed);
  Scenario s;
  s.seed = seed;
  s.hosts = d.between(2, 9);
  s.threads = d.between(1, 3);
  s.scene.seed = d.bits();
  s.scene.parts = d.between(1, 24);
  s.scene.longest_list = d.between(1, 8);
  if (d.chance(0.05)) {  // more candidates than a mask has bits
    s.scene.parts = 300;
    s.scene.longest_list = 150;
  }
  s.scene.width = d.between(4, 12);
  s.scene.vertices = d.between(1, 6);
  s.height = d.between(4, 12);
  s.spp = d.between(1, 5);
  s.replication = d.between(1, 2);
  s.manager.tile = 8;
  s.manager.round_samples = d.between(1, 4);
  s.manager.heartbeat_s = 0.1;
  s.manager.lost_after_s = 1.5;
  s.worker.status_every_s = 0.1;
  s.worker.retry_s = 0.02;
  s.worker.path_credits = d.between(1, 300);
  s.worker.camera_batch = d.between(1, 100);
  s.worker.trace_batch = d.between(1, 200);
  s.worker.small_batch = d.between(1, 50);
  s.worker.low_mark = d.between(1, 400);
  s.worker.block_segments = d.between(1, 60);
  if (d.chance(0.15)) {  // room for two blocks only
    s.worker.block_segments = d.between(1, 4);
    s.worker.path_credits = s.worker.low_mark = 2 * s.worker.block_segments;
  }
  s.worker.block_age_s = 0.005;
  s.delay = 0.002 * d.real();
  s.jitter = d.chance(0.5) ? 0.01 * d.real() : 0;
  if (d.chance(0.6)) {
    s.loss = 0.1 * d.real();
    s.doubling = 0.1 * d.real();
  }
  std::uint32_t least = s.hosts;  // hosts that remain
  if (d.chance(0.5)) {
    using Kind = Scenario::Event::Kind;
    for (std::uint32_t i = d.between(1, 3); i > 0; --i) {
      const Kind kind = static_cast<Kind>(d.below(6));
      const bool passing = kind == Kind::cut && d.chance(0.5);
      if (kind != Kind::join && !passing && least > 1) --least;
      s.events.push_back({kind, 0.05 + 0.6 * d.real() * d.real(), passing ? 1.5 * d.real() : 0});
    }
  }
  // Enough for all that must be held by the hosts that remain, and rarely for everything
  // everywhere.
  if (d.chance(0.05)) s.events.push_back({Scenario::Event::Kind::cancel, 0.1 + d.real() * d.real()});
  if (d.chance(0.5)) s.unevenness = 20;
  s.seconds_per_segment = 1e-5 * std::pow(100, d.real());  // so that events strike at any stage
  if (d.chance(0.25)) s.restart_at = 0.03 + 0.3 * d.real() * d.real();
  const std::uint64_t all = s.scene.parts * (kPartBytes + 20) * std::min(s.replication, least);
  s.memory = d.chance(0.2) ? 100'000 : 10 + all * 13 / 10 / least + 3 * (kPartBytes + 20);
  if (s.replication == 1 && d.chance(0.3))  // hardly anything twice: losses make copies move
    s.memory = 10 + ((s.scene.parts + least - 1) / least + 1) * (kPartBytes + 20);
  // Too little for one copy: parts come and go.
  s.worker.paging_credits = s.worker.path_credits * d.between(1, 4);
  if (d.chance(0.2)) s.memory = 10 + (kPartBytes + 20) * d.between(1, 1 + s.scene.parts / s.hosts / 2);
  if (d.chance(0.25)) s.intersectors = d.between(1, 3);
  s.scene.features = d.chance(0.3);
  s.scene.negative_lobes = mix64(seed + 31) % 5 == 0;  // not drawn: other scenarios stay as they were
  s.manager.newcomers_wait_s = 0.2;
  if (d.chance(0.3)) {  // several teams, each with room for the scene twice
    s.hosts += d.between(2, 9);
    s.manager.team_hosts = d.between(1, 5);
    s.memory = std::max(s.memory, 10 + std::uint64_t{s.replication} * 2 * s.scene.parts * (kPartBytes + 20) / s.manager.team_hosts +
                                      4 * (kPartBytes + 20));
  }
  return s;
}

}  // namespace cloudrenderer::sim

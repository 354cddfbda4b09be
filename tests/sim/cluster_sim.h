#pragma once
// A whole cluster in virtual time in one thread: the real cores, links and codec, with a network
// that loses, doubles, delays and reorders frames, and hosts that join late, leave and die. A pure
// function of the seed.
#include <cstdint>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <vector>

#include "made_up_engine.h"
#include "simulate/dice.h"
#include "tasks/link.h"
#include "tasks/manager_core.h"
#include "tasks/worker_core.h"

namespace cloudrenderer::sim {

inline constexpr std::uint64_t kPartBytes = 100;  // a part has up to a fifth more

struct Scenario {
  std::uint64_t seed = 0;
  MadeUpScene scene;
  std::uint32_t height = 8, spp = 4;
  std::uint32_t hosts = 2;  // from the start
  std::uint32_t intersectors = 0;  // more of them, which only intersect
  std::uint32_t threads = 1;
  std::uint32_t replication = 1;
  std::uint64_t memory = 0;  // of each host; a part has about 100
  WorkerOptions worker;
  ManagerOptions manager;
  double loss = 0, doubling = 0, delay = 0.001, jitter = 0;
  double seconds_per_segment = 1e-5;
  double unevenness = 1;  // the fastest host's speed over the slowest's, at most
  struct Event {
    // cut: two hosts that live do not reach each other for `seconds` (0: for ever). cancel: the job.
    enum class Kind { kill, kill_silently, declare_lost, leave, join, cut, cancel } kind;
    double at;
    double seconds = 0;
  };
  std::vector<Event> events;
  // The manager dies with all hosts, and another cluster goes on from the journal; 0: never.
  double restart_at = 0;
};
Scenario random_scenario(std::uint64_t seed);

struct Outcome {
  std::string error;              // "": all is as it must be
  double seconds = 0;             // virtual
  std::size_t most_segments = 0;  // waiting in one host
  std::uint64_t paged_in = 0;
  std::size_t most_frames = 0;    // that one host keeps for another
  std::uint64_t cancelled = 0;    // second copies of renderer tasks that were not needed
  std::uint64_t unloaded = 0;     // parts, in the middle of a job
  std::uint64_t cut = 0;          // links between hosts that lived on
  std::uint64_t frames = 0, moved = 0, asked = 0, wasted = 0, dropped = 0;
  std::uint64_t nearest_asked = 0;  // segments, of hosts that only intersect
  std::uint32_t generations = 0;
  std::uint64_t restored = 0;  // paths, from the journal
  std::uint32_t teams = 0, teams_ended = 0;
};
Outcome run(const Scenario& s);

}  // namespace cloudrenderer::sim

#pragma once
// Which cluster is simulated, and what comes of it.
#include <cstdint>
#include <map>
#include <string>
#include <vector>

namespace cloudrenderer::sim {

struct HostKind {
  std::string name = "host";
  std::uint32_t threads = 2;
  std::uint64_t memory = std::uint64_t{4} << 30;  // for parts and textures
  double price = 0;   // an hour
  double speed = 1;   // of a thread, against the machine that the costs are of
  double weight = 1;  // share of the hosts that are of this kind
};

struct Network {
  double bandwidth = 125e6;           // bytes a second, of a host's line, each way
  double manager_bandwidth = 1.25e9;  // of the manager's
  double latency = 2e-4;              // seconds, one way
  double store_bandwidth = 0;         // of the store that parts come from, in all; 0: as fast as hosts take them
  bool parts_from_manager = false;    // there is no store
};

struct Trouble {
  double failures = 0;     // a host and hour: gone without a word
  double reclaims = 0;     // a host and hour: told so before, and leaves well if it can
  double notice_s = 120;   // ... by so much
  double replace_s = 0;    // until another host is there in its place; 0: none comes
};

struct ClusterPlan {
  std::uint32_t hosts = 1;
  std::vector<HostKind> kinds{HostKind{}};
  Network network;
  Trouble trouble;
  double start_s = 0;  // of a thread of a host, once as it begins to render: pages, connections, threads
  double boot_s = 0;  // hosts come evenly over this time; the render waits for all of them
  std::uint32_t replication = 1;
  double manager_price = 0;  // an hour
  std::uint32_t segment = 0;  // real paths that a simulated one stands for, at most; 0: as many as keep the run short
  std::uint64_t seed = 0;
};

struct ManagerLoad {
  double cpu_s = 0;       // measured while it was simulated, with what its sockets would take
  double cpu_share = 0;   // of a core while rendering
  std::map<std::string, double> share_of;  // of it: film, tasks, heartbeats, loading, maps, acknowledgements
  double peak_share = 0;  // in the busiest second
  double sent = 0, received = 0;  // bytes
  double out_share = 0;   // of its line, while rendering
  std::uint64_t messages = 0;
};

struct Prediction {
  std::string error;  // "": the job was done
  std::uint32_t hosts = 0, segment = 1;
  double paths = 0;
  double wall_s = 0, load_s = 0, render_s = 0;
  double cpu_s = 0;       // of the hosts, computing and talking, while rendering
  double bytes = 0;       // that hosts and manager send while rendering, parts left out
  double loaded_bytes = 0;  // parts fetched by all hosts
  double moves_per_path = 0, asks_per_path = 0;
  double cost = 0;
  double busy = 0;        // share of the processors while rendering
  double efficiency = 0;  // what one host that holds everything would have needed, over processors times time
  double tail = 0;        // share of the render for the last tenth of the paths
  double wasted = 0;      // paths made again, of all
  double copied = 0;      // paths made by two hosts at the end, of all
  std::uint32_t lost = 0, reclaimed = 0, joined = 0;
  std::uint32_t paged_parts = 0;
  std::uint32_t teams = 0;      // that hosts worked in, at the end
  double connections = 0;       // to other workers, of a host
  ManagerLoad manager;
  std::string bottleneck;  // what costs most of what is not efficient
  double bottleneck_share = 0;
  std::uint64_t events = 0;
};

}  // namespace cloudrenderer::sim

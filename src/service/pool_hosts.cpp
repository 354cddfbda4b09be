#include "service/pool_hosts.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <charconv>
#include <utility>

namespace cloudrenderer {
namespace {

// Frames are jobs to the pool: "SERVICE.17.3".
std::string name_of(const std::string& prefix, FrameRef ref) { return fmt::format("{}{}.{}", prefix, ref.job, ref.frame); }

std::optional<FrameRef> frame_of(const std::string& prefix, const std::string& name) {
  if (!name.starts_with(prefix)) return std::nullopt;
  FrameRef ref;
  const char* end = name.data() + name.size();
  const auto job = std::from_chars(name.data() + prefix.size(), end, ref.job);
  if (job.ec != std::errc{} || job.ptr == end || *job.ptr != '.') return std::nullopt;
  const auto frame = std::from_chars(job.ptr + 1, end, ref.frame);
  if (frame.ec != std::errc{} || frame.ptr != end) return std::nullopt;
  return ref;
}

}  // namespace

void PoolHosts::order(const std::vector<FrameOrder>& orders) {
  for (const auto& [id, host] : pool_.hosts()) {
    if (host.left_s) continue;
    std::vector<PoolOrder> own;
    for (const FrameOrder& o : orders) {
      if (o.least_memory > host.memory) continue;  // it could hold no part
      const double share = o.memory * static_cast<double>(host.memory);
      own.push_back({name_of(prefix_, o.frame), o.manager, o.weight, std::max(o.least_memory, static_cast<std::uint64_t>(share))});
    }
    pool_.order(id, std::move(own));
  }
}

std::map<std::uint64_t, ServiceHost> PoolWords::take(const std::map<std::uint64_t, PoolHost>& hosts) {
  std::map<std::uint64_t, ServiceHost> out;
  for (const auto& [id, host] : hosts) {
    ServiceHost& h = out[id];
    h.name = host.name;
    h.kind = host.kind;
    h.threads = host.threads;
    h.memory = host.memory;
    h.memory_used = host.memory_used;
    h.cpu_s = host.cpu_s;
    h.here = !host.left_s && !host.leaving;
    for (const auto& [name, use] : host.jobs) h.working += use.working;
    if (std::exchange(words_[id], host.words) == host.words) continue;
    for (const auto& [name, use] : host.jobs)
      if (const auto ref = frame_of(prefix_, name))
        h.used[*ref] = {use.cpu_s, use.memory_byte_s, static_cast<double>(use.bytes_sent), 0, use.host_s, 0};
  }
  std::erase_if(words_, [&](const auto& w) { return !out.contains(w.first); });
  return out;
}

}  // namespace cloudrenderer

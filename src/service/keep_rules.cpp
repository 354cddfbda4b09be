#include "service/keep_rules.h"

#include <algorithm>

namespace cloudrenderer {

bool needs_files(const Job& job) { return !is_final(job.state) || (job.over_budget && job.state != JobState::cancelled); }

std::vector<std::uint64_t> expired(const Scheduler& scheduler, const KeepRules& rules, double now) {
  std::vector<std::uint64_t> out;
  if (!rules.keep_s) return out;
  for (const auto& [id, job] : scheduler.jobs())
    if (scheduler.has_ended(id) && job.ended && *job.ended + *rules.keep_s <= now) out.push_back(id);
  return out;
}

std::vector<std::string> surplus(std::vector<SplitFolder> splits, const std::set<std::string>& needed, std::uint64_t bytes, std::uint64_t most) {
  std::vector<std::string> out;
  std::ranges::sort(splits, {}, &SplitFolder::used);
  for (const SplitFolder& s : splits) {
    if (bytes <= most) break;
    if (needed.contains(s.name)) continue;
    bytes -= std::min(bytes, s.bytes);
    out.push_back(s.name);
  }
  return out;
}

}  // namespace cloudrenderer

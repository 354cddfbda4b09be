#pragma once
// What a service keeps of what nobody needs any more: rules without files.
#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "service/scheduler.h"

namespace cloudrenderer {

struct KeepRules {
  std::optional<double> keep_s;       // jobs that have ended, scenes without jobs, unfinished uploads; none: for ever
  std::optional<std::uint64_t> disk;  // bytes of all files of the service, as far as splits that no job needs can go
};
// A submission uploads files, makes a scene of them and then a job: nothing younger is taken from under it.
constexpr double kLeastKept = 3600;

// Whether the job may yet run: it has not ended, or can be resumed.
bool needs_files(const Job& job);
// Jobs that are to be removed.
std::vector<std::uint64_t> expired(const Scheduler& scheduler, const KeepRules& rules, double now);

struct SplitFolder {
  std::string name;
  std::uint64_t bytes = 0;
  double used = 0;  // the last time
};
// Which of the splits are to go, so that all files, `bytes` in sum, are no more than `most`: those used longest ago, none
// that is `needed`.
std::vector<std::string> surplus(std::vector<SplitFolder> splits, const std::set<std::string>& needed, std::uint64_t bytes, std::uint64_t most);

}  // namespace cloudrenderer

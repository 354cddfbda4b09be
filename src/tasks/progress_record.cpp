#include "tasks/progress_record.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace cloudrenderer {
namespace {

constexpr std::size_t kMost = 8192;

}  // namespace

void ProgressRecord::add(double time, std::uint64_t paths) {
  const std::size_t n = entries_.size();
  if ((n >= 1 && time <= entries_[n - 1].time) ||
      (n >= 2 && time < entries_[n - 2].time + spacing_)) {
    entries_.back() = {std::max(time, entries_.back().time), paths};
    return;
  }
  entries_.push_back({time, paths});
  if (entries_.size() < kMost) return;
  spacing_ = 4 * (time - entries_.front().time) / static_cast<double>(kMost);
  for (const Entry& e : std::exchange(entries_, {})) add(e.time, e.paths);
}

double ProgressRecord::tail(double began, std::uint64_t before, double share) const {
  if (entries_.empty() || entries_.back().paths <= before || entries_.back().time <= began)
    return 0;
  const auto done = static_cast<double>(entries_.back().paths - before);
  const auto first = before + static_cast<std::uint64_t>(std::ceil((1 - share) * done));
  const auto at = std::lower_bound(entries_.begin(), entries_.end(), first,
                                   [](const Entry& e, std::uint64_t n) { return e.paths < n; });
  return (entries_.back().time - at->time) / (entries_.back().time - began);
}

}  // namespace cloudrenderer

#include "tasks/sample_set.h"

#include <algorithm>

namespace cloudrenderer {

bool SampleSet::add(SampleRange range) {
  if (range.begin >= range.end) return false;
  auto next = std::lower_bound(
      ranges_.begin(), ranges_.end(), range,
      [](const SampleRange& a, const SampleRange& b) { return a.begin < b.begin; });
  if (next != ranges_.end() && next->begin < range.end) return false;
  if (next != ranges_.begin() && std::prev(next)->end > range.begin) return false;
  if (next != ranges_.end() && next->begin == range.end) {
    next->begin = range.begin;
  } else {
    next = ranges_.insert(next, range);
  }
  if (next != ranges_.begin() && std::prev(next)->end == next->begin) {
    std::prev(next)->end = next->end;
    ranges_.erase(next);
  }
  return true;
}

std::vector<SampleRange> SampleSet::gaps(SampleRange within) const {
  std::vector<SampleRange> found;
  for (const SampleRange& r : ranges_) {
    if (r.end <= within.begin) continue;
    if (within.begin >= within.end || r.begin >= within.end) break;
    if (r.begin > within.begin) found.push_back({within.begin, r.begin});
    within.begin = r.end;
  }
  if (within.begin < within.end) found.push_back(within);
  return found;
}

}  // namespace cloudrenderer

#pragma once
#include <cstddef>
#include <cstdint>
#include <vector>

namespace cloudrenderer {

// How many paths were done when: of any length in bounded memory, for what is close in time is one
// entry.
class ProgressRecord {
 public:
  // Neither ever decreases.
  void add(double time, std::uint64_t paths);
  // Share of the time from `began` to the last entry that the last `share` of the paths took, those
  // beyond `before` counted. 0: nothing was done.
  double tail(double began, std::uint64_t before, double share) const;
  std::size_t size() const { return entries_.size(); }

 private:
  struct Entry {
    double time;
    std::uint64_t paths;
  };
  std::vector<Entry> entries_;
  double spacing_ = 0;  // of every second entry at least
};

}  // namespace cloudrenderer

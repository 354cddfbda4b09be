#pragma once
#include <cstdint>
#include <span>
#include <vector>

namespace cloudrenderer {

struct SampleRange {
  std::uint32_t begin = 0, end = 0;
  friend bool operator==(const SampleRange&, const SampleRange&) = default;
};

// Sample numbers, as ascending ranges that do not touch.
class SampleSet {
 public:
  // False, and nothing has changed: the range is empty, or some of it is already there.
  bool add(SampleRange range);
  std::vector<SampleRange> gaps(SampleRange within) const;  // what is missing, ascending
  std::span<const SampleRange> ranges() const { return ranges_; }

 private:
  std::vector<SampleRange> ranges_;
};

}  // namespace cloudrenderer

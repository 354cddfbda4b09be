#include "tasks/work.h"

namespace cloudrenderer {

RendererLedger::RendererLedger(const RendererRange& range, std::uint32_t film_width)
    : range_(range),
      film_width_(film_width),
      remaining_(range.paths()),
      bits_((range.paths() + 63) / 64),
      sums_(std::size_t{range.x1 - range.x0} * (range.y1 - range.y0)) {}

RendererLedger::Outcome RendererLedger::record(const PathEnd& e) {
  const std::uint32_t y = e.pixel / film_width_, x = e.pixel % film_width_;
  if (e.task != range_.task || x < range_.x0 || x >= range_.x1 || y < range_.y0 || y >= range_.y1 ||
      e.sample < range_.sample_begin || e.sample >= range_.sample_end)
    return Outcome::foreign;
  const std::size_t pixel = std::size_t{y - range_.y0} * (range_.x1 - range_.x0) + (x - range_.x0);
  const std::size_t bit =
      pixel * (range_.sample_end - range_.sample_begin) + (e.sample - range_.sample_begin);
  const std::uint64_t mask = std::uint64_t{1} << (bit % 64);
  if (bits_[bit / 64] & mask) return Outcome::duplicate;
  bits_[bit / 64] |= mask;
  --remaining_;
  if (e.flags & kEndClamped) ++clamped_;
  if (e.flags & kEndInvalid) {
    ++invalid_;  // the sample is dropped: it has arrived, but its pixel does not count it
  } else {
    sums_[pixel].add(e.radiance, e.sample);
  }
  return Outcome::counted;
}

std::vector<RendererLedger::Run> RendererLedger::missing() const {
  std::vector<Run> runs;
  for (std::uint64_t i = 0, n = range_.paths(); i < n;) {
    if (bits_[i / 64] == ~std::uint64_t{0}) {
      i = (i / 64 + 1) * 64;
    } else if (bits_[i / 64] >> (i % 64) & 1u) {
      ++i;
    } else if (!runs.empty() && runs.back().first + runs.back().count == i) {
      ++runs.back().count;
      ++i;
    } else {
      runs.push_back({i++, 1});
    }
  }
  return runs;
}

wire::RendererReply RendererLedger::reply() && {
  return {range_.task, std::move(sums_), invalid_, clamped_};
}

}  // namespace cloudrenderer

#include <algorithm>

#include "tasks/work.h"

namespace cloudrenderer {

namespace {
constexpr std::uint8_t kEnded = 4, kAll = kTellsHit | kTellsSurface | kEnded;
constexpr std::uint32_t kNoTarget = PathEnd().target;
}

RendererLedger::RendererLedger(const RendererRange& range, std::uint32_t film_width, bool features, bool negative_lobes)
    : range_(range),
      film_width_(film_width),
      sums_per_pixel_(negative_lobes ? 2 : 1),
      remaining_(range.paths()),
      bits_((range.paths() + 63) / 64),
      sums_(range.pixels() * sums_per_pixel_) {
  if (!features) return;
  arrived_.resize(range.paths());
  features_.resize(range.pixels());
}

std::optional<RendererLedger::Place> RendererLedger::place(std::uint32_t task, std::uint32_t pixel, std::uint32_t sample) const {
  const std::uint32_t y = pixel / film_width_, x = pixel % film_width_;
  if (task != range_.task || x < range_.x0 || x >= range_.x1 || y < range_.y0 || y >= range_.y1 ||
      sample < range_.sample_begin || sample >= range_.sample_end)
    return std::nullopt;
  const std::size_t i = std::size_t{y - range_.y0} * (range_.x1 - range_.x0) + (x - range_.x0);
  return Place{i, i * (range_.sample_end - range_.sample_begin) + (sample - range_.sample_begin)};
}

void RendererLedger::complete(const Place& at) {
  bits_[at.sample / 64] |= std::uint64_t{1} << (at.sample % 64);
  --remaining_;
}

void RendererLedger::arrived(const Place& at, std::uint8_t what) {
  arrived_[at.sample] |= what;
  if (arrived_[at.sample] != kAll) return;
  ++features_[at.pixel].samples;
  complete(at);
}

RendererLedger::Outcome RendererLedger::record(const PathEnd& e, bool negative_lobe) {
  const auto at = place(e.task, e.pixel, e.sample);
  if (!at) return Outcome::foreign;
  if (arrived_.empty()) {
    if (bits_[at->sample / 64] >> (at->sample % 64) & 1u) return Outcome::duplicate;
    complete(*at);
  } else {
    if (arrived_[at->sample] & kEnded) return Outcome::duplicate;
    const int nothing = (e.flags & kEndWithoutHit ? kTellsHit : 0) | (e.flags & kEndWithoutSurface ? kTellsSurface : 0);
    arrived(*at, static_cast<std::uint8_t>(kEnded | nothing));
  }
  if (e.flags & kEndClamped) ++clamped_;
  if (e.flags & kEndInvalid) {
    ++invalid_;  // the sample is dropped: it has arrived, but its pixel does not count it
  } else {
    sums_[at->pixel * sums_per_pixel_ + (negative_lobe ? 1 : 0)].add(e.radiance, e.sample);
    if (e.target != kNoTarget && e.splat != Fixed3{}) splats_[e.target].add(e.splat, e.sample);
  }
  return Outcome::counted;
}

RendererLedger::Outcome RendererLedger::record(const PathFeatures& f) {
  const auto at = place(f.task, f.pixel, f.sample);
  const int told = f.flags & (kTellsHit | kTellsSurface);
  if (!at || arrived_.empty() || told == 0) return Outcome::foreign;
  // A path that was made again tells the same again, in the same pieces.
  if (arrived_[at->sample] & told) return Outcome::duplicate;
  PixelFeatures& pixel = features_[at->pixel];
  for (std::size_t i = 0; i < f.values.size(); ++i) pixel.sum[i] += f.values[i];
  if (told & kTellsHit) {
    ++pixel.hits;
    if (f.sample == 0) pixel.ids = f.ids;
  }
  arrived(*at, static_cast<std::uint8_t>(told));
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
  std::vector<Splat> splats;
  splats.reserve(splats_.size());
  for (auto& [pixel, splat] : splats_) {
    splat.pixel = pixel;
    splats.push_back(splat);
  }
  std::ranges::sort(splats, {}, &Splat::pixel);
  return {range_.task, std::move(sums_), invalid_, clamped_, std::move(features_), sums_per_pixel_ > 1, std::move(splats)};
}

}  // namespace cloudrenderer

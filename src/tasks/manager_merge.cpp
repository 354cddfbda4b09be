// Sums of samples on their way into the film, from hosts and from checkpoints, and out of it.
#include <algorithm>
#include <array>

#include "tasks/manager_core.h"

namespace cloudrenderer {

// Whether a reply has sums for every pixel, and every sample once: counted or invalid.
bool ManagerCore::fits(const wire::RendererReply& r, const RendererRange& range) const {
  const std::size_t per_pixel = film_.sums_per_pixel();
  if (r.negative_lobes != (per_pixel > 1) || r.sums.size() != range.pixels() * per_pixel) return false;
  if (r.features.size() != (job_.start.features() ? range.pixels() : 0)) return false;
  if (!fits(r.splats) || r.splats.size() > range.paths()) return false;
  const std::uint32_t samples = range.sample_end - range.sample_begin;
  for (const PixelFeatures& p : r.features)
    if (p.samples != samples || p.hits > samples) return false;
  const std::uint32_t even = (range.sample_end + 1) / 2 - (range.sample_begin + 1) / 2;
  const std::uint32_t odd = range.sample_end / 2 - range.sample_begin / 2;
  std::uint64_t counted = 0;
  for (auto p = r.sums.begin(); p != r.sums.end();) {
    std::array<std::uint64_t, 2> count{};
    for (std::size_t i = 0; i < per_pixel; ++i, ++p)
      for (std::size_t half = 0; half < 2; ++half) count[half] += p->count[half];
    if (count[0] > even || count[1] > odd) return false;
    counted += count[0] + count[1];
  }
  return r.invalid == range.paths() - counted;
}

// By pixel, each once, and within the film.
bool ManagerCore::fits(std::span<const Splat> splats) const {
  if (job_.start.light_paths() == 0) return splats.empty();
  const auto within = [&](const Splat& s) { return Film::holds(job_.frame, s.pixel); };
  const auto not_after = [](const Splat& a, const Splat& b) { return a.pixel >= b.pixel; };
  return std::ranges::all_of(splats, within) && std::ranges::adjacent_find(splats, not_after) == splats.end();
}

bool ManagerCore::restore(const TileSums& t) {
  if (phase_ != Phase::gathering || !hosts_.empty() || covered_.empty()) return false;
  const FilmFrame& f = job_.frame;
  if (t.x0 < f.x0 || t.y0 < f.y0 || t.x0 >= f.x1 || t.y0 >= f.y1) return false;
  const std::size_t tile = (t.y0 - f.y0) / tile_ * std::size_t{tiles_x_} + (t.x0 - f.x0) / tile_;
  const RendererRange r = tile_range(tile);
  if (t.x0 != r.x0 || t.y0 != r.y0 || t.x1 != r.x1 || t.y1 != r.y1 ||
      t.sums.size() != r.pixels() * film_.sums_per_pixel() || t.samples.empty() ||
      t.features.size() != (job_.start.features() ? r.pixels() : 0) || !fits(t.splats))
    return false;
  SampleSet all = covered_[tile];
  for (const SampleRange& s : t.samples)
    if (s.end > job_.spp || !all.add(s)) return false;
  // An earlier run with fewer samples had no whole group at its end.
  const auto cuts_group = [&](std::uint32_t at) { return at < shared_rays().end && at % shared_rays().block() != 0; };
  if (std::ranges::any_of(t.samples, [&](const SampleRange& s) { return cuts_group(s.begin) || cuts_group(s.end); }))
    job_.samples_per_ray = 1;  // no sample shares any more
  const std::uint64_t before = progress_.paths_done;
  for (const SampleRange& s : t.samples) cover(tile, s);
  merge(r, t.sums, t.features, t.splats);
  progress_.invalid_samples += t.invalid;
  progress_.clamped_samples += t.clamped;
  progress_.paths_restored += progress_.paths_done - before;
  unassigned_paths_ -= progress_.paths_done - before;
  if (!t.exact) bit_exact_ = false;
  if (unassigned_paths_ == 0) phase_ = Phase::done;  // of the whole job: rounds are held later
  return true;
}

void ManagerCore::add_splats(std::size_t tile, std::vector<Splat>& to) const {
  const RendererRange r = tile_range(tile);
  for (std::uint32_t y = r.y0; y < r.y1; ++y) {
    const std::size_t row = std::size_t{y - job_.frame.y0} * job_.frame.crop_width() - job_.frame.x0;
    for (const Splat& s : film_.splats().subspan(row + r.x0, r.x1 - r.x0))
      if (s.sum != Splat().sum) to.push_back(s);
  }
}

std::optional<TileSums> ManagerCore::tile_sums(std::size_t tile) const {
  const auto ranges = covered_[tile].ranges();
  if (ranges.empty()) return std::nullopt;
  const RendererRange r = tile_range(tile);
  TileSums t{r.x0, r.y0, r.x1, r.y1, {ranges.begin(), ranges.end()}, 0, 0, bit_exact_, {}, {}, job_.start.light_paths() != 0};
  const std::uint32_t width = job_.frame.crop_width();
  for (std::uint32_t y = r.y0; y < r.y1; ++y) {
    const std::size_t row = std::size_t{y - job_.frame.y0} * width - job_.frame.x0;
    const std::size_t per_pixel = film_.sums_per_pixel();
    const auto sums = film_.sums().subspan((row + r.x0) * per_pixel, (r.x1 - r.x0) * per_pixel);
    t.sums.insert(t.sums.end(), sums.begin(), sums.end());
    if (features_.empty()) continue;
    const auto features = std::span(features_).subspan(row + r.x0, r.x1 - r.x0);
    t.features.insert(t.features.end(), features.begin(), features.end());
  }
  if (film_.splats().empty()) return t;
  add_splats(tile, t.splats);
  // The first tile that has a record says of those that have none, too.
  const auto is_covered = [](const SampleSet& s) { return !s.ranges().empty(); };
  if (static_cast<std::size_t>(std::ranges::find_if(covered_, is_covered) - covered_.begin()) != tile) return t;
  for (std::size_t other = tile + 1; other < covered_.size(); ++other)
    if (!is_covered(covered_[other])) add_splats(other, t.splats);
  for (std::size_t other = 0; other < tile; ++other) add_splats(other, t.splats);
  std::ranges::sort(t.splats, {}, &Splat::pixel);
  return t;
}

void ManagerCore::merge(const RendererRange& range, std::span<const PixelSums> sums, std::span<const PixelFeatures> features,
                        std::span<const Splat> splats) {
  auto sum = sums.begin();
  auto feature = features.begin();
  for (std::uint32_t y = range.y0; y < range.y1; ++y)
    for (std::uint32_t x = range.x0; x < range.x1; ++x) {
      for (std::size_t i = 0; i < film_.sums_per_pixel(); ++i) film_.at(x, y, i != 0).merge(*sum++);
      if (!features_.empty())
        features_[std::size_t{y - job_.frame.y0} * job_.frame.crop_width() + (x - job_.frame.x0)].merge(*feature++);
    }
  if (job_.start.light_paths() == 0) return;
  std::array<std::uint64_t, 2> counted{};
  for (const PixelSums& p : sums)
    for (std::size_t half = 0; half < 2; ++half) counted[half] += p.count[half];
  film_.count_light_paths(counted);
  for (const Splat& s : splats) film_.add(s);
}

void ManagerCore::merge(const Outstanding& o, wire::RendererReply& r) {
  const RendererRange& range = o.range;
  if (range.trial) {
    trial_->merge(range, r.sums);
    if (!trial_->pending()) end_trial();
    return;
  }
  const FilmFrame& f = job_.frame;
  merge(range, r.sums, r.features, r.splats);
  progress_.invalid_samples += r.invalid;
  progress_.clamped_samples += r.clamped;
  const SampleRange samples{range.sample_begin, range.sample_end};
  cover((range.y0 - f.y0) / tile_ * std::size_t{tiles_x_} + (range.x0 - f.x0) / tile_, samples);
  if (options_.keep_merged)
    merged_.push_back({range.x0, range.y0, range.x1, range.y1, {samples}, r.invalid, r.clamped, bit_exact_,
                       std::move(r.sums), std::move(r.features), job_.start.light_paths() != 0, std::move(r.splats)});
}

}  // namespace cloudrenderer

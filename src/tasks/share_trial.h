#pragma once
// Whether it pays that samples share camera rays is tried before a frame: some squares of its pixels, spread evenly, are rendered
// with a few samples that share rays and with as many that do not, and the variances are compared. These samples count for nothing
// else. A pure function of the frame, so that any cluster, and a run that goes on from a checkpoint, decides alike.
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "film/film.h"
#include "integrator/path_segment.h"

namespace cloudrenderer {

class ShareTrial {
 public:
  // sums_per_pixel: of the film, see FilterLobes.
  ShareTrial(const FilmFrame& frame, std::size_t sums_per_pixel);

  // A task to be rendered (without a number), or none: all are given out.
  std::optional<RendererRange> next();
  void give_back(const RendererRange& range) { open_.push_back(range); }  // of a host that was lost
  // The sums of a task that next() gave, row by row. Each task once.
  void merge(const RendererRange& range, std::span<const PixelSums> sums);
  bool pending() const { return left_ > 0; }
  // When nothing is pending: the variance of samples that share rays over that of others, relative to the squared pixels; the
  // worst of them, of both together, are left out. None: nothing is known.
  std::optional<double> ratio() const;

 private:
  struct Pixel {
    PixelSums sums[2];  // alone, shared
  };

  std::size_t sums_per_pixel_;
  std::vector<RendererRange> squares_;
  std::vector<RendererRange> open_;
  std::vector<Pixel> pixels_;  // square by square, kSide * kSide each
  std::size_t left_ = 0;
};

// As much more variance as samples may have that share rays: they take 0.8 to 0.9 of the time (src/README.md, decision 63).
constexpr double kSharedVariance = 1.2;

}  // namespace cloudrenderer

#include "cluster/ticker.h"

#include <algorithm>
#include <asio/post.hpp>
#include <cmath>
#include <limits>

namespace cloudrenderer {
namespace {

constexpr double kNever = std::numeric_limits<double>::infinity();
// A core that names a deadline in the past again and again must not keep the thread busy.
constexpr double kShortest = 0.0002;

}  // namespace

Ticker::Ticker(asio::io_context& io, const Clock& clock, std::function<double()> tick)
    : clock_(clock), tick_(std::move(tick)), timer_(io), armed_(kNever) {}

void Ticker::at(double deadline) {
  double armed = armed_;
  while (deadline < armed && !armed_.compare_exchange_weak(armed, deadline)) {
  }
  if (deadline < armed)
    asio::post(timer_.get_executor(), [self = shared_from_this()] { self->arm(self->armed_); });
}

void Ticker::arm(double deadline) {
  if (stopped_ || !std::isfinite(deadline)) return;
  const double wait = std::max(deadline - clock_.now(), kShortest);
  timer_.expires_after(
      std::chrono::duration_cast<std::chrono::nanoseconds>(std::chrono::duration<double>(wait)));
  timer_.async_wait([weak = weak_from_this()](const std::error_code& cancelled) {
    const auto self = weak.lock();
    if (cancelled || !self || self->stopped_) return;
    self->armed_ = kNever;
    self->at(self->tick_());
  });
}

void Ticker::stop() {
  stopped_ = true;
  timer_.cancel();
  tick_ = nullptr;
}

}  // namespace cloudrenderer

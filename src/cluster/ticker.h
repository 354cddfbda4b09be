#pragma once
#include <asio/io_context.hpp>
#include <asio/steady_timer.hpp>
#include <atomic>
#include <functional>
#include <memory>

#include "cluster/clock.h"

namespace cloudrenderer {

// Calls a function at the deadline that a core names, on the I/O thread, and sleeps in between.
class Ticker : public std::enable_shared_from_this<Ticker> {
 public:
  // `tick` returns the next deadline (infinity: none).
  Ticker(asio::io_context& io, const Clock& clock, std::function<double()> tick);
  void at(double deadline);  // any thread: not later than this
  void stop();               // on the I/O thread: no more calls

 private:
  void arm(double deadline);

  const Clock& clock_;
  std::function<double()> tick_;
  asio::steady_timer timer_;
  std::atomic<double> armed_;
  bool stopped_ = false;
};

}  // namespace cloudrenderer

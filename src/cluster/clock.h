#pragma once
#include <chrono>

namespace cloudrenderer {

// Seconds since it was made; the `now` of the cores.
class Clock {
 public:
  double now() const {
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count();
  }

 private:
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

}  // namespace cloudrenderer

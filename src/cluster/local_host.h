#pragma once
#include <memory>

#include "cluster/manager.h"
#include "cluster/worker_node.h"

namespace cloudrenderer {

// A worker inside the manager's process: messages are handed over as they are, parts are mapped
// from the split.
class LocalHost {
 public:
  struct Config {
    std::string name;
    std::uint64_t memory = 0;
    unsigned threads = 1;
    float alpha = 0.25f;
    std::shared_ptr<const Manifest> manifest;
    std::function<void(const std::string&)> failed;  // on the I/O thread
  };
  // Joins at once. Throws ClusterError when the manager refuses.
  LocalHost(asio::io_context& io, const Clock& clock, Manager& manager, Config config);
  ~LocalHost();

  void stop() { ticker_->stop(); }  // no more timers, so that the io_context can run dry
  std::array<double, 4> engine_seconds() const {
    return engine_seconds_;
  }  // once the job has ended

 private:
  SceneLoader loader_;
  std::shared_ptr<Ticker> ticker_;
  std::atomic<std::uint64_t> memory_peak_ = 0;
  std::array<double, 4> engine_seconds_{};
  std::unique_ptr<WorkerNode> node_;  // last: its threads use the rest
};

}  // namespace cloudrenderer

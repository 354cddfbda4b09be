#pragma once
#include <chrono>
#include <condition_variable>
#include <memory>
#include <mutex>
#include <optional>
#include <string>

#include "web/job_view.h"
#include "web/tiles.h"

namespace cloudrenderer {

// Between the render's thread, which shows what there is, and the threads of viewers.
class Hub {
 public:
  using Time = std::chrono::steady_clock::time_point;
  // All viewers together get at most this (the contract of the window: 200 KB/s).
  static constexpr std::size_t kBytesPerSecond = 180'000;
  static constexpr std::size_t kMaxViewers = 8;

  explicit Hub(std::string scene) : scene_(std::move(scene)) {}

  // The render's thread. Makes a new view once a second; tiles only while somebody looks.
  void look(const RenderView& view, Time now);
  void close();  // nothing more comes

  std::shared_ptr<const JobView> job() const;  // null before the first

  // A viewer of the stream; none: there are too many. Frames are a length (32 bits, little-endian, of what follows it),
  // a kind (1: the job as JSON; 2: a tile as TileBoard has it), and the body.
  class Viewer {
   public:
    explicit Viewer(Hub& hub) : hub_(hub) {}
    ~Viewer();
    // Waits for frames, a quarter of a second at most; may be empty. None: the stream has ended.
    std::optional<std::string> next();

   private:
    friend class Hub;
    Hub& hub_;
    TileBoard::Viewer tiles_;
    std::shared_ptr<const JobView> job_;
    Time due_{};  // of the next frames
    Time job_due_{};
  };
  std::shared_ptr<Viewer> join();

 private:
  const std::string scene_;
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::shared_ptr<const JobView> job_;
  TileBoard board_;
  std::size_t viewers_ = 0;
  bool closed_ = false;

  // Of the render's thread.
  TileWatch watch_;
  std::vector<CostPoint> history_;
  Time viewed_{};
};

}  // namespace cloudrenderer

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

  // All of the picture at one time.
  struct Picture {
    Image image;
    FilmFrame frame;
    double spp = 0;
  };
  // What there is now, or was a moment ago; waits for the render's thread. Null: there is nothing yet, or no more.
  std::shared_ptr<const Picture> picture(std::chrono::milliseconds patience);

  // A viewer of the stream; none: there are too many. It gets append_frame's frames: the job as JSON, all of the
  // picture coarsely, and tiles.
  class Viewer {
   public:
    explicit Viewer(Hub& hub) : hub_(hub) {}
    ~Viewer();
    // Waits for frames, a quarter of a second at most; may be empty. None: the stream has ended.
    std::optional<std::string> next();

   private:
    friend class Hub;
    Hub& hub_;
    std::uint64_t joined_ = 0;  // as the hub counts
    bool began_ = false;        // it has the coarse picture
    std::size_t owed_ = 0;      // bytes that it has had too early
    TileBoard::Viewer tiles_;
    std::shared_ptr<const JobView> job_;
    Time due_{};  // of the next frames
    Time job_due_{};
  };
  std::shared_ptr<Viewer> join();

 private:
  void take_picture(const RenderView& view, Time now);

  const std::string scene_;
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::shared_ptr<const JobView> job_;
  TileBoard board_;
  std::size_t viewers_ = 0;
  // Who joins first gets all of the picture coarsely: its tiles take a while.
  std::uint64_t joins_ = 0, coarse_joins_ = 0;  // ever; when the coarse picture was made
  std::shared_ptr<const std::string> coarse_;
  bool closed_ = false;
  std::shared_ptr<const Picture> picture_;
  bool picture_wanted_ = false;
  Time picture_due_{};  // not before, however many ask

  // Of the render's thread.
  TileWatch watch_;
  std::vector<CostPoint> history_;
  Time viewed_{};
};

}  // namespace cloudrenderer

#pragma once
#include <condition_variable>
#include <map>
#include <mutex>
#include <string>
#include <thread>

#include "service/elastic_input.h"
#include "service/job_json.h"

namespace cloudrenderer {

// Of what a frame's manager tells in its window.
FrameProgress frame_progress(const Json& job);

// Asks the managers of running frames every second how far they are, on a thread of its own: what is asked answers late,
// or never.
class ProgressWatch {
 public:
  explicit ProgressWatch(std::string token);  // of the cluster
  ~ProgressWatch();
  ProgressWatch(const ProgressWatch&) = delete;
  ProgressWatch& operator=(const ProgressWatch&) = delete;

  void set_windows(std::map<FrameRef, std::string> urls);  // all that there are; others' progress is forgotten
  ProgressOf progress() const;

 private:
  void run();

  const std::string token_;
  mutable std::mutex mutex_;
  std::condition_variable wake_;
  bool ending_ = false;
  std::map<FrameRef, std::string> windows_;
  ProgressOf progress_;
  std::thread thread_;  // the last: it uses the others
};

}  // namespace cloudrenderer

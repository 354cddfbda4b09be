#pragma once
// The service's window: its page, and what is pushed to those who look on.
#include <httplib.h>

#include <atomic>
#include <condition_variable>
#include <map>
#include <memory>
#include <mutex>
#include <string>

#include "service/service.h"

namespace cloudrenderer {

// Streams that are open, so many together and of a user at most. Any thread.
class Seats {
 public:
  Seats(std::size_t most, std::size_t most_of_user);
  // Free again when the value dies; null: there is none.
  std::shared_ptr<void> take(const std::string& user);

 private:
  struct Taken;
  const std::size_t most_, most_of_user_;
  const std::shared_ptr<Taken> taken_;
};

// A request of a user who may be told only what is his.
struct Look {
  const Caller& caller;
  const std::string& token;  // asked for again while a stream goes on
  std::uint64_t job = 0, frame = 0;
  httplib::Response& response;
};

class ServiceWindow {
 public:
  static constexpr std::size_t kMostStreams = 64;  // each holds a thread of the server
  static constexpr std::size_t kMostOfUser = 16;
  // What a stream of jobs may take; a frame's has its own limit (Hub), and both together stay within 200 KB/s.
  static constexpr std::size_t kJobBytesPerSecond = 16'000, kJobBytesAtOnce = 48'000;

  explicit ServiceWindow(Service& service);
  ~ServiceWindow();
  ServiceWindow(const ServiceWindow&) = delete;
  ServiceWindow& operator=(const ServiceWindow&) = delete;
  void close();  // streams end; nobody who waits in one is left when the server has ended

  // All throw ApiError.
  void send_jobs(const Look& look);      // a line of JSON whenever there is news
  void send_stream(const Look& look);    // as src/web/README.md has it
  void send_preview(const Look& look, bool png);
  void send_progress(const Look& look);  // of a frame that runs

 private:
  struct JobStream;
  bool still_may(const Caller& caller, const std::string& token) const;

  Service& service_;
  Seats seats_, frame_seats_;  // of users, of frames
  std::mutex reading_;  // one finished picture at a time
  std::atomic<bool> closing_ = false;

  std::mutex mutex_;
  std::condition_variable changed_;
};

}  // namespace cloudrenderer

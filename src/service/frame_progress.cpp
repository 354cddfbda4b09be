#include "service/frame_progress.h"

#include <chrono>

#include "base/log.h"
#include "service/manager_client.h"

namespace cloudrenderer {
namespace {

constexpr auto kEvery = std::chrono::seconds(1);
constexpr time_t kPatience = 2;

}  // namespace

FrameProgress frame_progress(const Json& job) {
  FrameProgress out;
  out.paths_done = job.at("paths_done");
  out.paths_total = job.at("paths_total");
  std::map<std::uint64_t, int> holders;
  const auto holds = [](const Json& host) { return host.at("left_s").is_null(); };
  out.phase = job.at("phase");
  if (const Json& error = job.at("estimated_relmse"); !error.is_null()) out.estimated_relmse = error.get<double>();
  for (const Json& host : job.at("hosts")) {
    if (!holds(host)) continue;
    ++out.hosts;
    for (const Json& part : host.at("parts")) ++holders[part.get<std::uint64_t>()];
  }
  for (const Json& host : job.at("hosts"))
    if (holds(host))
      for (const Json& part : host.at("parts"))
        if (holders.at(part.get<std::uint64_t>()) == 1) ++out.lone_parts[host.at("name").get<std::string>()];
  return out;
}

ProgressWatch::ProgressWatch(std::string token) : token_(std::move(token)), thread_([this] { run(); }) {}

ProgressWatch::~ProgressWatch() {
  {
    const std::lock_guard lock(mutex_);
    ending_ = true;
  }
  wake_.notify_all();
  thread_.join();
}

void ProgressWatch::set_windows(std::map<FrameRef, std::string> urls) {
  const std::lock_guard lock(mutex_);
  windows_ = std::move(urls);
  std::erase_if(progress_, [&](const auto& p) { return !windows_.contains(p.first); });
}

ProgressOf ProgressWatch::progress() const {
  const std::lock_guard lock(mutex_);
  return progress_;
}

void ProgressWatch::run() {
  std::unique_lock lock(mutex_);
  while (!wake_.wait_for(lock, kEvery, [this] { return ending_; })) {
    const std::map<FrameRef, std::string> windows = windows_;
    for (const auto& [ref, url] : windows) {
      if (ending_) return;
      lock.unlock();
      std::optional<FrameProgress> got;
      try {
        const auto client = manager_client(url, token_);
        client->set_connection_timeout(kPatience);
        client->set_read_timeout(kPatience);
        if (const auto answer = client->Get("/api/jobs/1"); answer && answer->status == 200) got = frame_progress(Json::parse(answer->body));
      } catch (const std::exception& e) {  // then it is asked again
        spdlog::debug("job {}: no progress: {}", ref.job, e.what());
      }
      lock.lock();
      if (got && windows_.contains(ref)) progress_[ref] = *got;
    }
  }
}

}  // namespace cloudrenderer

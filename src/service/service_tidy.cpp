// What the service removes from its folder: jobs that users want gone, and by rules what nobody needs any more.
#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <filesystem>

#include "base/log.h"
#include "service/service.h"

namespace cloudrenderer {
namespace {

namespace fs = std::filesystem;

constexpr double kTidyEvery = 60, kMetersEvery = 86400;
constexpr double kMeterKept = 7 * 86400;  // what hosts have said that are silent since

double unix_time_of(const fs::path& path) {
  std::error_code gone;
  const auto written = fs::last_write_time(path, gone);
  if (gone) return 0;
  return std::chrono::duration<double>(std::chrono::file_clock::to_sys(written).time_since_epoch()).count();
}

std::uint64_t bytes_below(const fs::path& folder) {
  std::uint64_t sum = 0;
  std::error_code gone;
  for (fs::recursive_directory_iterator it(folder, gone), end; !gone && it != end; it.increment(gone)) {
    std::error_code other;
    if (const auto bytes = it->is_regular_file(other) ? it->file_size(other) : 0; !other) sum += bytes;
  }
  return sum;
}

std::vector<fs::path> entries(const fs::path& folder) {
  std::vector<fs::path> out;
  std::error_code gone;
  for (fs::directory_iterator it(folder, gone), end; !gone && it != end; it.increment(gone)) out.push_back(it->path());
  return out;
}

}  // namespace

Json Service::remove(const Caller& caller, std::uint64_t id) {
  const std::lock_guard lock(mutex_);
  const Job& job = job_of(caller, id);
  if (!is_final(job.state)) throw ApiError(409, fmt::format("the job has not ended: it is {}; cancel it first", name(job.state)));
  if (!scheduler_.has_ended(id)) throw ApiError(409, "the job's last frames are just being ended; ask again in a moment");
  Json was = to_json(job);
  remove_job(id);
  return was;
}

// With the mutex.
void Service::remove_job(std::uint64_t id) {
  const std::string user = scheduler_.find(id)->request.user;
  scheduler_.remove(id);
  store_.remove_job(id, user, scheduler_.accounts().at(user));
  dirty_.erase(id);
  states_.erase(id);
  versions_.erase(id);
  trash_.take(fmt::format("{}/jobs/{}", config_.folder, id));
  spdlog::info("job {} of {} is removed", id, user);
}

// On the service's thread: nothing is started meanwhile.
void Service::tidy(double now) {
  const double every = config_.rules.keep_s ? std::clamp(*config_.rules.keep_s / 4, 1.0, kTidyEvery) : kTidyEvery;
  if (now < tidied_ + every) return;
  tidied_ = now;
  std::set<std::string> needed;
  {
    const std::lock_guard lock(mutex_);
    if (now >= meters_tidied_ + kMetersEvery && newly_metered_.empty()) {
      meters_tidied_ = now;
      store_.forget_meters(now - kMeterKept);
      metered_ = store_.meters();
    }
    for (const std::uint64_t id : expired(scheduler_, config_.rules, now)) remove_job(id);
    for (const fs::path& folder : entries(config_.folder + "/jobs"))  // of jobs whose removal was not finished
      if (!scheduler_.find(std::strtoull(folder.filename().c_str(), nullptr, 10))) trash_.take(folder);
    for (const auto& [id, job] : scheduler_.jobs())
      if (needs_files(job))
        for (const JobFrame& f : job.frames) needed.insert(fs::path(split_folder(job, f)).filename());
    if (config_.rules.keep_s) tidy_scenes(now);
  }
  tidy_splits(needed, now);
}

// Scenes without jobs, and files without scenes. With the mutex.
void Service::tidy_scenes(double now) {
  const double before = now - std::max(*config_.rules.keep_s, kLeastKept);
  std::set<std::string> used, there;
  for (const auto& [id, job] : scheduler_.jobs()) used.insert(job.request.scene);
  std::map<std::string, std::set<std::string>> kept, gone;  // files by user
  for (const SceneRecord& scene : store_.all_scenes()) {
    const bool stays = used.contains(scene.id) || scene.used > before;
    auto& files = (stays ? kept : gone)[scene.user];
    const Json manifest = Json::parse(scene.manifest);
    for (const Json& file : manifest.at("files")) files.insert(file.at("sha256").get<std::string>());
    if (stays) {
      there.insert(scene.id);
      continue;
    }
    store_.remove_scene(scene.user, scene.id);
    spdlog::info("scene {} of {} is removed: no job needs it", scene.id, scene.user);
  }
  for (const auto& [user, files] : gone)
    for (const std::string& file : files)
      if (!kept[user].contains(file) && store_.remove_blob(user, file)) trash_.take(blobs_.path(file));
  for (const fs::path& folder : entries(config_.folder + "/scenes"))
    if (!there.contains(folder.filename())) trash_.take(folder);
  blobs_.forget_uploads(before);
}

void Service::tidy_splits(const std::set<std::string>& needed, double now) {
  std::vector<SplitFolder> splits;
  std::uint64_t sum = 0;
  std::set<std::string> being_made;
  for (const auto& [ref, child] : children_)
    if (const Job* job = scheduler_.find(ref.job); child.splits && job)
      being_made.insert(fs::path(split_folder(*job, job->frames[ref.frame])).filename().string() + ".tmp");
  for (const fs::path& folder : entries(config_.folder + "/splits")) {
    const std::string name = folder.filename();
    if (folder.extension() == ".tmp") {
      if (!being_made.contains(name)) trash_.take(folder);
      continue;
    }
    const double used = unix_time_of(folder);
    if (config_.rules.keep_s && !needed.contains(name) && used + *config_.rules.keep_s <= now) {
      trash_.take(folder);
      continue;
    }
    if (!config_.rules.disk) continue;
    splits.push_back({name, bytes_below(folder), used});
    sum += splits.back().bytes;
  }
  if (!config_.rules.disk) return;
  for (const char* others : {"blobs", "uploads", "jobs"}) sum += bytes_below(config_.folder + "/" + others);
  for (const std::string& name : surplus(splits, needed, sum, *config_.rules.disk)) {
    trash_.take(config_.folder + "/splits/" + name);
    sum -= std::ranges::find(splits, name, &SplitFolder::name)->bytes;
  }
  const bool full = sum > *config_.rules.disk;
  if (full && !std::exchange(disk_is_full_, full))
    spdlog::warn("the service's folder has {} bytes, more than --disk {}: all of it is needed by jobs, or kept for users", sum, *config_.rules.disk);
  disk_is_full_ = full;
}

}  // namespace cloudrenderer

#include "service/service.h"

#include <fcntl.h>
#include <signal.h>
#include <spdlog/fmt/fmt.h>
#include <sys/file.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <thread>

#include "base/error.h"
#include "base/log.h"
#include "cluster/processes.h"

namespace cloudrenderer {
namespace {

namespace fs = std::filesystem;

constexpr double kStopPatience = 20;   // between asking a child for a checkpoint and killing it
constexpr double kUsersEvery = 1;      // between looks at the users' file
constexpr double kKeepEvery = 2;
constexpr auto kGoodbye = std::chrono::seconds(10);
constexpr std::size_t kLogShown = 1 << 20;
constexpr int kSplitNice = 10;  // it would take the processors of managers, for which hosts wait

int lock_folder(const std::string& folder) {
  fs::create_directories(folder);
  const std::string path = folder + "/lock";
  const int fd = ::open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0600);
  if (fd < 0) throw UsageError("cannot write to the service's folder " + folder);
  if (flock(fd, LOCK_EX | LOCK_NB) == 0) return fd;
  ::close(fd);
  throw UsageError("another service works with the folder " + folder);
}

ServiceConfig with_absolute_folder(ServiceConfig c) {
  fs::create_directories(c.folder);
  c.folder = fs::canonical(c.folder).string();
  return c;
}

std::string tail_of(const std::string& path, std::size_t from, std::size_t most) {
  std::ifstream file(path, std::ios::binary | std::ios::ate);
  if (!file) return "";
  const auto end = static_cast<std::size_t>(file.tellg());
  const std::size_t start = std::max(std::min(from, end), end > most ? end - most : 0);
  std::string text(end - start, '\0');
  file.seekg(static_cast<std::streamoff>(start));
  file.read(text.data(), static_cast<std::streamsize>(text.size()));
  return text;
}

// What a person wants to know of a process that has failed: its last line with an error, or its last line.
std::string last_words(const std::string& log) {
  const std::string ours = "cloudrenderer: ";
  std::string error, last;
  for (std::size_t at = 0; at < log.size();) {
    const std::size_t end = std::min(log.find('\n', at), log.size());
    const std::string line = log.substr(at, std::min<std::size_t>(end - at, 1000));
    if (line.find("error: ") != std::string::npos) error = line;
    if (line.starts_with(ours)) error = line.substr(ours.size());
    if (!line.empty()) last = line;
    at = end + 1;
  }
  return error.empty() ? last : error;
}

std::string file_text(const std::string& path) { return tail_of(path, 0, std::size_t{64} << 20); }

}  // namespace

Service::Service(ServiceConfig config, Users users, std::optional<PriceTable> prices, const MakeHosts& hosts)
    : config_(with_absolute_folder(std::move(config))),
      lock_(lock_folder(config_.folder)),
      users_(std::move(users)),
      prices_(std::move(prices)),
      blobs_(config_.folder),
      store_(config_.folder + "/service.db"),
      scheduler_(config_.scheduler),
      hosts_(hosts(store_.identity())),
      steady_hosts_(config_.elastic),
      watch_(config_.token),
      trash_(config_.folder + "/trash") {
  for (const char* name : {"scenes", "splits", "jobs"}) fs::create_directories(config_.folder + "/" + name);
  for (Job& job : store_.jobs()) scheduler_.restore(std::move(job));
  scheduler_.restore(store_.accounts(), store_.next_id());
  metered_ = store_.meters();  // hosts outlive the service, and go on with their sums
}

Service::~Service() {
  for (const auto& [ref, child] : children_) kill(child.pid, child.splits ? SIGKILL : SIGINT);
  const auto deadline = std::chrono::steady_clock::now() + kGoodbye;
  while (!children_.empty()) {
    std::erase_if(children_, [](const auto& c) { return waitpid(c.second.pid, nullptr, WNOHANG) == c.second.pid; });
    if (std::chrono::steady_clock::now() > deadline)
      for (const auto& [ref, child] : children_) kill(child.pid, SIGKILL);
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
  ::close(lock_);
}

std::string Service::frame_folder(FrameRef ref) const { return fmt::format("{}/jobs/{}/{:04}", config_.folder, ref.job, ref.frame); }

std::string Service::split_folder(const Job& job, const JobFrame& frame) const {
  const RenderSettings& s = job.request.settings;
  return config_.folder + "/splits/" + sha256(fmt::format("{}\n{}\n{}\n{}", job.request.scene, s.part_size, s.dialect, frame.file)).substr(0, 40);
}

std::string Service::shown(const std::string& text) const {
  const std::string ours = config_.folder + "/", scenes = "scenes/";
  std::string out;
  for (std::size_t at = 0;;) {
    const std::size_t found = text.find(ours, at);
    out += text.substr(at, found - at);
    if (found == std::string::npos) return out;
    at = found + ours.size();
    if (text.compare(at, scenes.size(), scenes) == 0) {
      const std::size_t slash = text.find('/', at + scenes.size());
      if (slash != std::string::npos) at = slash + 1;
    }
  }
}

void Service::note(std::uint64_t job, const std::string& text, double now) {
  spdlog::info("job {}: {}", job, text);
  store_.add_event(now, job, text);
}

void Service::step(double now) {
  tidy(now);
  const std::lock_guard lock(mutex_);
  if (now >= users_read_ + kUsersEvery) {
    users_read_ = now;
    if (const std::string fault = users_.refresh(); !fault.empty()) spdlog::error("{}", fault);
  }
  if (users_.changed_since_last_asked()) scheduler_.set_users(users_.limits());
  host_view_ = hosts_->hosts();
  meter_children(now);
  collect(now);
  meter();
  std::vector<std::uint64_t> memory;
  for (const auto& [id, host] : host_view_)
    if (host.here) memory.push_back(host.memory);
  scheduler_.set_hosts(std::move(memory));
  plan_hosts(now);
  scheduler_.tick(now);
  keep(now);  // before what follows from it: a service that dies here knows what it was about to do
  for (const Scheduler::Action& action : scheduler_.take_actions()) act(action, now);
  give_orders();
}

void Service::act(const Scheduler::Action& action, double now) {
  using What = Scheduler::Action::What;
  try {
    if (action.what == What::split) return start_split(action.frame, now);
    if (action.what == What::start) return start_frame(action.frame, now);
  } catch (const std::exception& e) {
    spdlog::error("job {}: {}", action.frame.job, e.what());
    const FrameEnd end{FrameEnd::How::failed, e.what()};
    if (action.what == What::split)
      scheduler_.split_ended(action.frame, end, {}, now);
    else
      scheduler_.frame_ended(action.frame, end, now);
    return;
  }
  const auto child = children_.find(action.frame);
  if (child == children_.end()) return;
  child->second.asked = true;
  child->second.killed_at = action.what == What::kill ? now : now + kStopPatience;
  kill(child->second.pid, action.what == What::kill ? SIGKILL : SIGINT);
}

void Service::start_split(FrameRef ref, double now) {
  const Job& job = *scheduler_.find(ref.job);
  const JobFrame& frame = job.frames[ref.frame];
  const std::string folder = frame_folder(ref), out = split_folder(job, frame), log = folder + "/log";
  fs::create_directories(folder);
  Child child;
  child.splits = true;
  child.started = now;
  std::error_code none;
  child.log_offset = fs::file_size(log, none);
  if (none) child.log_offset = 0;
  if (fs::exists(out)) return split_ended(ref, child, 0, now);  // another frame was the same
  const std::string scene = config_.folder + "/scenes/" + job.request.scene, unfinished = out + ".tmp";
  fs::remove_all(unfinished);
  std::vector<std::string> arguments{"split", scene + "/" + frame.file, "-o", unfinished, "--confine", scene, "--report",
                                     unfinished + "/needs.json", "--parent", std::to_string(getpid())};
  const RenderSettings& s = job.request.settings;
  if (s.part_size != 0) arguments.insert(arguments.end(), {"--part-size", std::to_string(s.part_size)});
  if (!s.dialect.empty()) arguments.insert(arguments.end(), {"--dialect", s.dialect});
  child.pid = spawn_self(arguments, {folder, log, {}, config_.child_memory, config_.child_disk, kSplitNice});
  children_[ref] = child;
}

// Throws ClusterError.
std::uint16_t Service::choose_port() const {
  if (!config_.manager_ports) return 0;
  const auto taken = [&](std::uint16_t port) { return std::ranges::any_of(children_, [&](const auto& c) { return c.second.port == port; }); };
  if (const auto port = free_port(*config_.manager_ports, config_.managers.host, taken)) return *port;
  throw ClusterError("none of the ports " + config_.manager_ports->to_string() + " (--ports) is free at " + config_.managers.host +
                     " for the frame's manager");
}

void Service::start_frame(FrameRef ref, double now) {
  const Job& job = *scheduler_.find(ref.job);
  const JobFrame& frame = job.frames[ref.frame];
  const RenderSettings& s = job.request.settings;
  const std::string folder = frame_folder(ref), log = folder + "/log";
  const std::uint16_t port = choose_port();
  std::error_code ignored;
  fs::last_write_time(split_folder(job, frame), fs::file_time_type::clock::now(), ignored);  // those used longest ago go first
  std::vector<std::string> arguments{"manager", fs::relative(split_folder(job, frame), folder).string(), "-o", "picture.exr",
                                     "--listen", Address{config_.managers.host, port}.to_string(), "--checkpoint", "checkpoint",
                                     "--resume", "--report", "report.json", "--web", "127.0.0.1:0", "--quiet",
                                     "--parent", std::to_string(getpid())};
  const auto option = [&](const char* name, const auto& value) {
    if (value) arguments.insert(arguments.end(), {name, fmt::format("{}", *value)});
  };
  option("--spp", s.spp);
  option("--max-depth", s.max_depth);
  option("--seed", s.seed);
  option("--max-error", s.max_error);
  if (s.width && s.height) arguments.insert(arguments.end(), {"--resolution", fmt::format("{}x{}", *s.width, *s.height)});
  if (s.crop) arguments.insert(arguments.end(), {"--crop", fmt::format("{}", fmt::join(*s.crop, ","))});
  if (!s.integrator.empty()) arguments.insert(arguments.end(), {"--integrator", s.integrator});
  if (!s.light_paths.empty()) arguments.insert(arguments.end(), {"--light-paths", s.light_paths});
  if (config_.tls.mode != TlsMode::automatic) arguments.insert(arguments.end(), {"--tls", config_.tls.mode == TlsMode::on ? "on" : "off"});
  const auto pem = [&](const char* name, const std::string& file) {
    if (!file.empty()) arguments.insert(arguments.end(), {name, fs::absolute(file).string()});
  };
  pem("--tls-cert", config_.tls.certificate);
  pem("--tls-key", config_.tls.key);
  pem("--tls-ca", config_.tls.authority);
  if (config_.allow_inexact) arguments.emplace_back("--allow-inexact");
  Child child;
  child.started = now;
  child.port = port;
  std::error_code none;
  child.log_offset = fs::file_size(log, none);
  if (none) child.log_offset = 0;
  std::vector<std::string> environment;
  if (!config_.token.empty()) environment.push_back("CLOUDRENDERER_TOKEN=" + config_.token);
  child.pid = spawn_self(arguments, {folder, log, environment, config_.child_memory, config_.child_disk});
  children_[ref] = child;
}

// A manager says where it listens, and where its window is.
void Service::read_addresses(Child& child, FrameRef ref) {
  const std::string log = tail_of(frame_folder(ref) + "/log", child.log_offset, kLogShown);
  const auto line_with = [&](const std::string& words) -> std::string {
    const std::size_t found = log.find(words);
    if (found == std::string::npos || log.find('\n', found) == std::string::npos) return "";
    const std::size_t start = log.rfind('\n', found) + 1;  // npos + 1 is 0
    return log.substr(start, log.find('\n', found) - start);
  };
  const std::string listening = "listening on ", shows = " shows the render";
  if (const std::string line = line_with(shows); line.ends_with(shows)) child.window = line.substr(0, line.size() - shows.size());
  const std::string line = line_with(listening);
  if (!line.starts_with(listening)) return;
  try {
    child.manager = Address{config_.managers_host, Address::parse(line.substr(listening.size())).port};
  } catch (const UsageError& e) {
    spdlog::error("job {}: its manager says '{}': {}", ref.job, line, e.what());
  }
}

void Service::collect(double now) {
  for (auto it = children_.begin(); it != children_.end();) {
    auto& [ref, child] = *it;
    int status = 0;
    rusage used{};
    if (wait4(child.pid, &status, WNOHANG, &used) != child.pid) {
      if (!child.splits && !child.manager) read_addresses(child, ref);
      if (child.splits && !child.killed_at && now > child.started + config_.split_timeout_s) child.killed_at = now;
      if (child.killed_at && now >= *child.killed_at) kill(child.pid, SIGKILL);
      ++it;
      continue;
    }
    const auto seconds = [](const timeval& t) { return static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_usec); };
    meter_child(ref, child, seconds(used.ru_utime) + seconds(used.ru_stime));
    const FrameRef ended = ref;
    const Child was = child;
    it = children_.erase(it);
    if (was.splits)
      split_ended(ended, was, status, now);
    else
      frame_ended(ended, was, status, now);
  }
}

namespace {

// How a child process has ended, and why, from its last words.
FrameEnd end_of(int status, const std::string& log) {
  using How = FrameEnd::How;
  if (WIFSIGNALED(status)) return {How::failed, fmt::format("its process was ended by signal {}", WTERMSIG(status))};
  const std::string words = last_words(log);
  switch (WEXITSTATUS(status)) {  // the exit codes of every command
    case 0:
      return {How::done, ""};
    case 1:
      return {How::done, "the error is larger than asked for"};
    case 2:
    case 3:
      return {How::hopeless, words};
    case 5:
      return {How::interrupted, "interrupted"};
    default:
      return {How::failed, words.empty() ? fmt::format("its process ended with code {}", WEXITSTATUS(status)) : words};
  }
}

}  // namespace

void Service::split_ended(FrameRef ref, const Child& child, int status, double now) {
  const Job& job = *scheduler_.find(ref.job);
  const std::string out = split_folder(job, job.frames[ref.frame]), unfinished = out + ".tmp";
  FrameEnd end = end_of(status, tail_of(frame_folder(ref) + "/log", child.log_offset, kLogShown));
  end.reason = shown(end.reason);
  if (end.how == FrameEnd::How::failed && child.killed_at && !child.asked)
    end = {FrameEnd::How::hopeless, fmt::format("splitting it took longer than {:g} s", config_.split_timeout_s)};
  FrameNeeds needs;
  if (end.how == FrameEnd::How::done) {
    try {
      if (!fs::exists(out)) fs::rename(unfinished, out);
      needs = needs_from_json(parse_json(file_text(out + "/needs.json")));
    } catch (const std::exception& e) {
      end = {FrameEnd::How::failed, std::string("its split cannot be used: ") + e.what()};
    }
  }
  std::error_code ignored;
  if (end.how != FrameEnd::How::done) fs::remove_all(unfinished, ignored);
  scheduler_.split_ended(ref, end, needs, now);
}

void Service::frame_ended(FrameRef ref, const Child& child, int status, double now) {
  const std::string folder = frame_folder(ref);
  FrameEnd end = end_of(status, tail_of(folder + "/log", child.log_offset, kLogShown));
  end.reason = shown(end.reason);
  if (end.how == FrameEnd::How::done || end.how == FrameEnd::How::interrupted) {
    try {
      const Json rays = Json::parse(file_text(folder + "/report.json")).at("rays");
      Usage usage;
      for (const char* kind : {"camera", "bounce", "shadow"}) usage.rays += rays.at(kind).get<double>();
      scheduler_.used(ref, usage);
    } catch (const std::exception& e) {
      spdlog::warn("job {}: no report: {}", ref.job, e.what());
    }
  }
  std::error_code ignored;
  scheduler_.frame_ended(ref, end, now);
  const Job& job = *scheduler_.find(ref.job);
  if (end.how == FrameEnd::How::done || (is_final(job.frames[ref.frame].state) && !needs_files(job)))
    fs::remove(folder + "/checkpoint", ignored);
}

void Service::give_orders() {
  std::set<FrameRef> at_work;
  for (const auto& [ref, child] : children_)
    if (child.manager && !child.asked) at_work.insert(ref);
  std::vector<FrameOrder> orders;
  for (const auto& [ref, portion] : scheduler_.portions(&at_work))
    orders.push_back({ref, *children_.at(ref).manager, portion.weight, portion.memory, portion.least_memory});
  hosts_->order(orders);
}

void Service::keep(double now) {
  std::set<std::uint64_t> changed_now = scheduler_.take_changed();
  for (const std::uint64_t id : changed_now) versions_[id] = ++version_;
  dirty_.merge(changed_now);
  bool news = now > kept_ + kKeepEvery;  // sums alone can wait: hosts say them again
  std::vector<const Job*> changed;
  for (const std::uint64_t id : dirty_) {
    const Job* job = scheduler_.find(id);
    changed.push_back(job);
    std::string state = name(job->state) + (job->reason.empty() ? "" : ": " + job->reason);
    for (std::size_t i = 0; i < job->frames.size(); ++i) {
      const JobFrame& f = job->frames[i];
      if (f.state != FrameState::waiting)
        state += fmt::format("\nframe {} ({}) {}{}", i, f.file, name(f.state), f.reason.empty() ? "" : ": " + f.reason);
    }
    std::string& noted = states_[id];
    if (noted == state) continue;
    news = true;
    for (std::size_t at = 0; at < state.size();) {  // only the lines that are new
      const std::size_t end = std::min(state.find('\n', at), state.size());
      const std::string line = state.substr(at, end - at);
      if (("\n" + noted + "\n").find("\n" + line + "\n") == std::string::npos) note(id, line, now);
      at = end + 1;
    }
    noted = std::move(state);
  }
  if (!news) return;
  store_.save(changed, newly_metered_, scheduler_.accounts(), scheduler_.next_id(), now);
  newly_metered_.clear();
  dirty_.clear();
  kept_ = now;
}

}  // namespace cloudrenderer

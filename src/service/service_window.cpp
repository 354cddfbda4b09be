#include "service/service_window.h"

#include <algorithm>
#include <chrono>
#include <fstream>
#include <iterator>

#include "base/log.h"
#include "film/encode_image.h"
#include "service/finished_frame.h"
#include "service/manager_client.h"
#include "web/http_server.h"
#include "web/hub.h"

namespace cloudrenderer {
namespace {

using namespace std::chrono_literals;
using SteadyClock = std::chrono::steady_clock;

constexpr auto kBeat = 1s;           // between words of a stream of jobs
constexpr auto kHostsEvery = 5s;     // hosts, and what the user has used
constexpr auto kSilence = 5s;        // after which an empty line is sent: is anybody there?
constexpr auto kSlice = 200ms;       // of waiting, between looks whether all ends
constexpr auto kTokenEvery = 1s;     // whether who looks on still may
constexpr auto kManagerPatience = 3s;  // a manager's stream has news every second
constexpr std::size_t kHostsTold = 64;

std::string read_file(const std::string& path) {
  std::ifstream file(path);
  return {std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
}

// Of the pool, the first hosts and the sums of all.
Json pool_view(const Json& hosts) {
  double threads = 0, memory = 0, used = 0;
  Json some = Json::array();
  for (const Json& h : hosts) {
    threads += h.at("threads").get<double>();
    memory += h.at("memory").get<double>();
    used += h.at("memory_used").get<double>();
    if (some.size() < kHostsTold)
      some.push_back({{"name", h.at("name")}, {"kind", h.at("kind")}, {"threads", h.at("threads")}, {"memory", h.at("memory")}, {"memory_used", h.at("memory_used")}});
  }
  return {{"count", hosts.size()}, {"threads", threads}, {"memory", memory}, {"memory_used", used}, {"some", std::move(some)}};
}

}  // namespace

struct Seats::Taken {
  std::mutex mutex;
  std::size_t all = 0;
  std::map<std::string, std::size_t> of_user;
};

Seats::Seats(std::size_t most, std::size_t most_of_user) : most_(most), most_of_user_(most_of_user), taken_(std::make_shared<Taken>()) {}

std::shared_ptr<void> Seats::take(const std::string& user) {
  const std::lock_guard lock(taken_->mutex);
  const auto own = taken_->of_user.find(user);
  if (taken_->all >= most_ || (own != taken_->of_user.end() && own->second >= most_of_user_)) return nullptr;
  ++taken_->all;
  ++taken_->of_user[user];
  return {taken_.get(), [taken = taken_, user](void*) {
            const std::lock_guard back(taken->mutex);
            --taken->all;
            if (--taken->of_user[user] == 0) taken->of_user.erase(user);
          }};
}

// What one who looks on at the jobs has been told, and may be told when.
struct ServiceWindow::JobStream {
  Caller caller;
  std::string token;
  std::shared_ptr<void> seat;
  WatchedJobs seen;
  std::string pool, usage;  // told last
  bool greeted = false;
  double room = kJobBytesAtOnce;  // bytes
  SteadyClock::time_point told = SteadyClock::now(), due{}, hosts_due{}, spoke{};

  // A line, or nothing.
  std::string news(Service& service) {
    const auto now = SteadyClock::now();
    room = std::min<double>(kJobBytesAtOnce, room + kJobBytesPerSecond * std::chrono::duration<double>(now - told).count());
    told = now;
    Json line = Json::object();
    if (now >= hosts_due) {
      hosts_due = now + kHostsEvery;
      Json hosts = pool_view(service.hosts()), used = service.usage({caller.name, false});
      if (dump(hosts) != pool) line["hosts"] = std::move(hosts);
      if (dump(used) != usage) line["usage"] = std::move(used);
      if (line.contains("hosts")) pool = dump(line["hosts"]);
      if (line.contains("usage")) usage = dump(line["usage"]);
    }
    if (room > 0) {
      Json jobs = service.changed_jobs(caller, seen, static_cast<std::size_t>(room));
      for (const char* key : {"jobs", "gone"})
        if (!jobs[key].empty()) line[key] = std::move(jobs[key]);
    }
    if (line.empty() && greeted) {
      if (now < spoke + kSilence) return "";
      spoke = now;
      return "\n";
    }
    if (!greeted) line["caller"] = {{"name", caller.name}, {"admin", caller.admin}};
    greeted = true;
    line["now"] = std::chrono::duration<double>(std::chrono::system_clock::now().time_since_epoch()).count();
    spoke = now;
    std::string text = dump(line) + "\n";
    room -= static_cast<double>(text.size());
    return text;
  }
};

ServiceWindow::ServiceWindow(Service& service) : service_(service), seats_(kMostStreams, kMostOfUser), frame_seats_(kMostStreams, Hub::kMaxViewers) {}

ServiceWindow::~ServiceWindow() { close(); }

void ServiceWindow::close() {
  closing_ = true;
  const std::lock_guard lock(mutex_);
  changed_.notify_all();
}

bool ServiceWindow::still_may(const Caller& caller, const std::string& token) const {
  const auto found = service_.users().find(token);
  return found && found->name == caller.name && found->admin == caller.admin;
}

void ServiceWindow::send_jobs(const Look& look) {
  const auto stream = std::make_shared<JobStream>();
  stream->caller = look.caller;
  stream->token = look.token;
  stream->seat = seats_.take(look.caller.name);
  if (!stream->seat) throw ApiError(429, "there are viewers enough");
  look.response.set_chunked_content_provider("application/x-ndjson", [this, stream](std::size_t, httplib::DataSink& sink) {
    {
      std::unique_lock lock(mutex_);
      changed_.wait_until(lock, std::min(stream->due, SteadyClock::now() + kSlice), [&] { return closing_.load(); });
    }
    if (closing_ || !still_may(stream->caller, stream->token)) {
      sink.done();
      return true;
    }
    if (SteadyClock::now() < stream->due) return sink.is_writable();
    stream->due = SteadyClock::now() + kBeat;
    const std::string news = stream->news(service_);
    return news.empty() ? sink.is_writable() : sink.write(news.data(), news.size());
  });
}

void ServiceWindow::send_stream(const Look& look) {
  const FrameView view = service_.frame_view(look.caller, look.job, look.frame);
  const auto seat = seats_.take(look.caller.name), frame_seat = frame_seats_.take(std::to_string(look.job) + "." + std::to_string(look.frame));
  if (!seat || !frame_seat) throw ApiError(429, "there are viewers enough");
  const char* type = "application/octet-stream";
  if (view.window.empty()) {
    const Json job = service_.job(look.caller, look.job), frame = job.at("frames").at(look.frame);
    const Json report = Json::parse(read_file(view.folder + "/report.json"), nullptr, false);
    std::shared_ptr<const std::string> bytes;
    try {
      const std::lock_guard lock(reading_);
      bytes = std::make_shared<const std::string>(
          stream_of_picture(view.folder + "/picture.exr", view_of_report(report, frame.at("file"), frame.at("state") == "done")));
    } catch (const std::runtime_error& e) {
      spdlog::warn("job {}: {}", look.job, e.what());
      throw ApiError(404, "the picture cannot be read");
    }
    look.response.set_content_provider(bytes->size(), type, [bytes, seat](std::size_t offset, std::size_t length, httplib::DataSink& sink) {
      return sink.write(bytes->data() + offset, std::min<std::size_t>(length, 1 << 16));
    });
    return;
  }
  look.response.set_chunked_content_provider(
      type, [this, seat, frame_seat, url = view.window, caller = look.caller, token = look.token](std::size_t, httplib::DataSink& sink) {
        const auto client = manager_client(url, service_.token());
        client->set_read_timeout(kManagerPatience);
        auto asked = SteadyClock::now();
        bool there = true;
        const auto status = [](const httplib::Response& r) { return r.status == 200; };
        client->Get("/api/jobs/1/stream", status, [&](const char* data, std::size_t n) {
          if (const auto now = SteadyClock::now(); now > asked + kTokenEvery) {
            asked = now;
            if (!still_may(caller, token)) return false;
          }
          return !closing_ && (there = sink.write(data, n));
        });
        if (there) sink.done();
        return there;
      });
}

void ServiceWindow::send_preview(const Look& look, bool png) {
  const FrameView view = service_.frame_view(look.caller, look.job, look.frame);
  const char* type = png ? "image/png" : "image/x-exr";
  if (!view.window.empty()) {
    const auto client = manager_client(view.window, service_.token());
    client->set_read_timeout(10s);
    const auto got = client->Get(png ? "/api/jobs/1/picture.png" : "/api/jobs/1/picture.exr");
    if (!got || got->status != 200) throw ApiError(404, "there is no picture yet");
    look.response.set_content(got->body, type);
    return;
  }
  const std::string exr = view.folder + "/picture.exr";
  if (!png) {
    if (!send_file(look.response, exr, type)) throw ApiError(404, "there is no such file any more");
    return;
  }
  try {
    const std::lock_guard lock(reading_);
    const Image image = read_image(exr);
    const std::vector<unsigned char> bytes = encode_image("preview.png", image, {image.width, image.height, 0, 0, image.width, image.height});
    look.response.set_content(reinterpret_cast<const char*>(bytes.data()), bytes.size(), type);
  } catch (const std::runtime_error& e) {
    spdlog::warn("job {}: {}", look.job, e.what());
    throw ApiError(404, "the picture cannot be read");
  }
}

void ServiceWindow::send_progress(const Look& look) {
  const auto client = manager_client(service_.frame_window(look.caller, look.job, look.frame), service_.token());
  client->set_read_timeout(5s);
  const auto got = client->Get("/api/jobs/1");
  if (!got || got->status != 200) throw ApiError(404, "the frame does not run yet, or no more");
  look.response.set_content(got->body, "application/json");
}

}  // namespace cloudrenderer

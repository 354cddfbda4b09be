#include "service/api.h"

#include <httplib.h>
#include <spdlog/fmt/fmt.h>
#include <strings.h>

#include <algorithm>
#include <charconv>
#include <filesystem>
#include <fstream>
#include <functional>
#include <semaphore>
#include <thread>

#include "base/log.h"
#include "film/film.h"
#include "service/service_window.h"
#include "service/upload_request.h"
#include "web/http_server.h"
#include "web/page.h"

namespace cloudrenderer {
namespace {

namespace fs = std::filesystem;
using httplib::ContentReader, httplib::Request, httplib::Response;

constexpr std::size_t kThreads = 32, kLongestPath = 1024;
constexpr std::size_t kLargestBody = std::size_t{32} << 20;  // of JSON: a manifest of 100,000 files
constexpr std::size_t kDrained = 1'000'000;  // of a body that nobody wants
constexpr std::time_t kPatience = 30;
constexpr double kLongestCheck = 5;  // seconds that an answer may wait, and
constexpr int kMostChecks = 8;        // how many answers at once: others must find a thread

// One request on its way to its answer.
struct Call {
  Service& service;
  ServiceWindow& window;
  Caller caller;
  std::string token;  // the caller's
  std::vector<std::string> names;  // what stands for the {..} of the route
  const Request& request;
  Response& response;
  const ContentReader* content;  // null: there is none
};

std::uint64_t number_of(const std::string& text) {
  std::uint64_t value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc{} || end != text.data() + text.size()) throw ApiError(404, "there is nothing here");
  return value;
}

void answer(const Call& call, const Json& json, int status = 200) {
  call.response.status = status;
  answer_json(call.response, json);
}

// The body as JSON. What is longer than may be is thrown away while it comes.
Json body_of(const Call& call) {
  std::string text;
  bool long_body = false;
  if (call.content && !(*call.content)([&](const char* data, std::size_t n) {
        long_body = long_body || text.size() + n > kLargestBody;
        if (!long_body) text.append(data, n);
        return true;
      }))
    throw ApiError(400, "the body did not come as it was announced");
  if (long_body) throw ApiError(413, fmt::format("the body is larger than {} bytes", kLargestBody));
  return parse_json(text);
}

// A request without a body that may have one all the same.
Json optional_body(const Call& call) {
  if (!call.content || call.request.get_header_value("Content-Length") == "0") return Json::object();
  return body_of(call);
}

void send_file(const Call& call, const std::string& path, const char* type) {
  if (!cloudrenderer::send_file(call.response, path, type)) throw ApiError(404, "there is no such file any more");
}

void send_picture(const Call& call, const char* name) {
  send_file(call, call.service.frame_file(call.caller, number_of(call.names[0]), number_of(call.names[1]), name), "image/x-exr");
}

// Made of the .exr for those who want it.
void send_png(const Call& call) {
  const std::string exr = call.service.frame_file(call.caller, number_of(call.names[0]), number_of(call.names[1]), "picture.exr");
  const std::string png = fs::path(exr).replace_extension(".png").string();
  if (!fs::exists(png)) {
    const Image image = read_image(exr);
    write_image(png, image, {image.width, image.height, 0, 0, image.width, image.height});
  }
  send_file(call, png, "image/png");
}

// ?check_s=, how long the answer may wait until it is known whether the job can fit.
double check_seconds(const Call& call) {
  if (!call.request.has_param("check_s")) return 0;
  const std::string given = call.request.get_param_value("check_s");
  double seconds = 0;
  const auto [end, error] = std::from_chars(given.data(), given.data() + given.size(), seconds);
  if (error != std::errc{} || end != given.data() + given.size() || !(seconds >= 0 && seconds <= kLongestCheck))
    throw ApiError(400, fmt::format("check_s must be a number from 0 to {:g}, got '{}'", kLongestCheck, given.substr(0, 20)));
  return seconds;
}

Json checked(const Call& call, Json job, double seconds) {
  static std::counting_semaphore<kMostChecks> places(kMostChecks);
  if (seconds == 0 || !places.try_acquire()) return job;
  const std::unique_ptr<decltype(places), void (*)(decltype(places)*)> place(&places, [](decltype(places)* p) { p->release(); });
  using Clock = std::chrono::steady_clock;
  try {
    for (const auto until = Clock::now() + std::chrono::duration<double>(seconds); job.at("state") == "checking" && Clock::now() < until;) {
      std::this_thread::sleep_for(std::chrono::milliseconds(50));
      job = call.service.job(call.caller, job.at("id"));
    }
  } catch (const ApiError&) {  // somebody has removed it
  }
  return job;
}

void send_job(const Call& call) {
  const double seconds = check_seconds(call);
  answer(call, checked(call, call.service.job(call.caller, number_of(call.names[0])), seconds));
}

void submit_job(const Call& call) {
  const double seconds = check_seconds(call);
  answer(call, checked(call, call.service.submit(call.caller, body_of(call)), seconds), 201);
}

Look look_of(const Call& call) { return {call.caller, call.token, number_of(call.names[0]), number_of(call.names[1]), call.response}; }

void send_frame(const Call& call) {
  const Json job = call.service.job(call.caller, number_of(call.names[0]));
  const std::uint64_t frame = number_of(call.names[1]);
  if (frame >= job.at("frames").size()) throw ApiError(404, fmt::format("the job has no frame {}", frame));
  answer(call, job.at("frames")[frame]);
}

struct Route {
  const char* method;
  const char* path;
  void (*handle)(const Call&);
};

const std::vector<Route>& table() {
  static const std::vector<Route> kRoutes{
      {"GET", "/v1/openapi.json", [](const Call& c) { c.response.set_content(kOpenApi.data(), kOpenApi.size(), "application/json"); }},
      {"GET", "/v1/blobs/{sha256}", [](const Call& c) { send_blob_state(c.service, c.caller, c.names[0], c.response); }},
      {"PUT", "/v1/blobs/{sha256}", [](const Call& c) { take_blob(c.service, c.caller, c.names[0], c.request, c.response, c.content); }},
      {"GET", "/v1/scenes", [](const Call& c) { answer(c, c.service.scenes(c.caller)); }},
      {"POST", "/v1/scenes", [](const Call& c) { answer(c, c.service.add_scene(c.caller, body_of(c)), 201); }},
      {"GET", "/v1/scenes/{scene}", [](const Call& c) { answer(c, c.service.scene(c.caller, c.names[0])); }},
      {"GET", "/v1/jobs", [](const Call& c) { answer(c, c.service.jobs(c.caller)); }},
      {"POST", "/v1/jobs", submit_job},
      {"GET", "/v1/jobs/{job}", send_job},
      {"PATCH", "/v1/jobs/{job}", [](const Call& c) { answer(c, c.service.change(c.caller, number_of(c.names[0]), body_of(c))); }},
      {"DELETE", "/v1/jobs/{job}", [](const Call& c) { optional_body(c); answer(c, c.service.remove(c.caller, number_of(c.names[0]))); }},
      {"POST", "/v1/jobs/{job}/cancel", [](const Call& c) { optional_body(c); answer(c, c.service.cancel(c.caller, number_of(c.names[0]))); }},
      {"POST", "/v1/jobs/{job}/resume", [](const Call& c) { answer(c, c.service.resume(c.caller, number_of(c.names[0]), optional_body(c))); }},
      {"GET", "/v1/jobs/{job}/events", [](const Call& c) { answer(c, c.service.events(c.caller, number_of(c.names[0]))); }},
      {"GET", "/v1/jobs/{job}/frames/{frame}", send_frame},
      {"GET", "/v1/jobs/{job}/frames/{frame}/log",
       [](const Call& c) {
         c.response.set_content(c.service.frame_log(c.caller, number_of(c.names[0]), number_of(c.names[1])), "text/plain; charset=utf-8");
       }},
      {"GET", "/v1/jobs/{job}/frames/{frame}/progress", [](const Call& c) { c.window.send_progress(look_of(c)); }},
      {"GET", "/v1/jobs/{job}/frames/{frame}/stream", [](const Call& c) { c.window.send_stream(look_of(c)); }},
      {"GET", "/v1/jobs/{job}/frames/{frame}/preview.exr", [](const Call& c) { c.window.send_preview(look_of(c), false); }},
      {"GET", "/v1/jobs/{job}/frames/{frame}/preview.png", [](const Call& c) { c.window.send_preview(look_of(c), true); }},
      {"GET", "/v1/watch", [](const Call& c) { c.window.send_jobs({c.caller, c.token, 0, 0, c.response}); }},
      {"GET", "/v1/jobs/{job}/frames/{frame}/report",
       [](const Call& c) {
         send_file(c, c.service.frame_file(c.caller, number_of(c.names[0]), number_of(c.names[1]), "report.json"), "application/json");
       }},
      {"GET", "/v1/jobs/{job}/frames/{frame}/picture.exr", [](const Call& c) { send_picture(c, "picture.exr"); }},
      {"GET", "/v1/jobs/{job}/frames/{frame}/picture.png", send_png},
      {"GET", "/v1/hosts", [](const Call& c) { answer(c, c.service.hosts()); }},
      {"GET", "/v1/hosts/wanted", [](const Call& c) { answer(c, c.service.hosts_wanted(c.caller)); }},
      {"GET", "/v1/usage", [](const Call& c) { answer(c, c.service.usage(c.caller)); }},
      {"GET", "/v1/metrics",
       [](const Call& c) { c.response.set_content(c.service.metrics(c.caller), "text/plain; version=0.0.4; charset=utf-8"); }},
  };
  return kRoutes;
}

// What stands for the {..} of the route, or nothing: it is another path.
std::optional<std::vector<std::string>> match(std::string_view route, std::string_view path) {
  std::vector<std::string> names;
  while (true) {
    const std::size_t r = std::min(route.find('/'), route.size()), p = std::min(path.find('/'), path.size());
    if (route.starts_with('{')) {
      if (p == 0) return std::nullopt;
      names.emplace_back(path.substr(0, p));
    } else if (route.substr(0, r) != path.substr(0, p)) {
      return std::nullopt;
    }
    if ((r == route.size()) != (p == path.size())) return std::nullopt;
    if (r == route.size()) return names;
    route.remove_prefix(r + 1);
    path.remove_prefix(p + 1);
  }
}

}  // namespace

struct Api::Server {
  Server(Service& s, const Address& address, const TlsOptions& tls)
      : service(s), listen(address), encrypted(encrypts(tls, address)), window(s), http(make_http_server(tls, encrypted, kThreads + ServiceWindow::kMostStreams, "--api")) {
    http->set_read_timeout(kPatience);
    http->set_write_timeout(kPatience);
    http->set_keep_alive_max_count(10'000);
    http->set_payload_max_length(std::size_t{1} << 41);  // handlers read what they take
    http->set_pre_routing_handler([this](const Request& request, Response& response) {
      const bool may_have_body = request.method == "POST" || request.method == "PUT" || request.method == "PATCH" || request.method == "DELETE";
      if (may_have_body && request.path.size() <= kLongestPath) return httplib::Server::HandlerResponse::Unhandled;
      dispatch(request, response, nullptr);
      if (may_have_body) end_connection(response);
      return httplib::Server::HandlerResponse::Handled;
    });
    // Paths are matched by our own table: the library's regular expressions only pass all on.
    const auto pass = [this](const Request& request, Response& response, const ContentReader& content) {
      dispatch(request, response, &content);
    };
    http->Post("[^]*", pass);
    http->Put("[^]*", pass);
    http->Patch("[^]*", pass);
    http->Delete("[^]*", pass);
    http->set_exception_handler([](const Request&, Response& response, std::exception_ptr) { refuse(response, 500, "the service has failed"); });
    port = bind_http(*http, listen, "--api");
    thread = std::thread([this] { http->listen_after_bind(); });
  }
  ~Server() {
    window.close();
    http->stop();
    thread.join();
  }

  void dispatch(const Request& request, Response& response, const ContentReader* content) {
    // Without a length there is no body: the library would wait for the connection's end.
    if (!request.has_header("Content-Length") && strcasecmp(request.get_header_value("Transfer-Encoding").c_str(), "chunked") != 0) content = nullptr;
    enum class Body : std::uint8_t { unread, broken, read } body = content ? Body::unread : Body::read;
    const ContentReader noted([&](httplib::ContentReceiver receiver) {
      body = Body::broken;  // unless it ends
      if ((*content)(std::move(receiver))) body = Body::read;
      return body == Body::read;
    }, {});
    try {
      if (request.path.size() > kLongestPath) throw ApiError(414, "the path is too long");
      if (request.is_multipart_form_data()) throw ApiError(415, "forms are not taken: send JSON, or the bytes of a file");
      handle(request, response, content ? &noted : nullptr);
    } catch (const ApiError& e) {
      Json json = {{"error", e.what()}};
      for (const auto& [key, value] : e.more.items()) json[key] = value;
      response.status = e.status;
      answer_json(response, json);
    } catch (const std::exception& e) {
      spdlog::error("{} {}: {}", request.method, request.path, e.what());
      refuse(response, 500, "the service has failed");
    }
    // A short body that nobody wanted is read, so that who sends it gets to see the answer.
    const int status = response.status;
    std::size_t drained = 0;
    const auto drain = [&](const char*, std::size_t n) { return (drained += n) <= kDrained; };
    const bool is_short = request.get_header_value("Content-Length").size() <= 6 && !request.is_multipart_form_data();
    if (body == Body::unread && is_short) noted(drain);
    if (body != Body::read) end_connection(response);
    response.status = status;
  }

  void handle(const Request& request, Response& response, const ContentReader* content) {
    const std::string method = request.method == "HEAD" ? "GET" : request.method;
    if (request.path == "/" && method == "GET") return response.set_content(kServicePage.data(), kServicePage.size(), "text/html; charset=utf-8");
    std::string allowed;
    for (const Route& route : table()) {
      auto names = match(route.path, request.path);
      if (!names) continue;
      allowed += (allowed.empty() ? "" : ", ") + std::string(route.method);
      if (route.method != method) continue;
      Caller caller;
      if (route.path != std::string_view("/v1/openapi.json")) caller = authenticate(request, response);
      return route.handle({service, window, caller, token_of(request), std::move(*names), request, response, content});
    }
    authenticate(request, response);
    if (allowed.empty()) throw ApiError(404, "there is nothing here");
    response.set_header("Allow", allowed);
    throw ApiError(405, request.method.substr(0, 20) + " is not for this; there is " + allowed);
  }

  static std::string token_of(const Request& request) {
    const std::string given = request.get_header_value("Authorization"), scheme = "Bearer ";
    return given.starts_with(scheme) ? given.substr(scheme.size()) : "";
  }

  Caller authenticate(const Request& request, Response& response) const {
    const std::string token = token_of(request);
    if (!token.empty())
      if (auto caller = service.users().find(token)) return *caller;
    response.set_header("WWW-Authenticate", "Bearer");
    throw ApiError(401, "a user's token is needed: Authorization: Bearer TOKEN");
  }

  Service& service;
  const Address listen;
  const bool encrypted;
  ServiceWindow window;  // outlives the server's threads
  std::unique_ptr<httplib::Server> http;
  int port = 0;
  std::thread thread;
};

Api::Api(Service& service, const Address& listen, const TlsOptions& tls) : server_(std::make_unique<Server>(service, listen, tls)) {}
Api::~Api() = default;

std::string Api::url(const std::string& name) const {
  const std::string& host = server_->listen.is_wildcard() ? name : server_->listen.host;
  return (server_->encrypted ? "https://" : "http://") + Address{host, static_cast<std::uint16_t>(server_->port)}.to_string();
}

std::vector<std::string> Api::routes() {
  std::vector<std::string> out;
  for (const Route& route : table()) out.push_back(std::string(route.method) + " " + route.path);
  return out;
}

}  // namespace cloudrenderer

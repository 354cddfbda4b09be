#include "web/window.h"

#include <nlohmann/json.hpp>
#include <thread>

#include "base/error.h"
#include "base/log.h"
#include "film/encode_image.h"
#include "web/http_server.h"
#include "web/hub.h"
#include "web/page.h"

namespace cloudrenderer {
namespace {

constexpr std::size_t kThreads = Hub::kMaxViewers + 4;
constexpr std::size_t kLargestRequest = 64 * 1024;
// What keeps other pages of the viewer's browser from asking in their name: they cannot set it.
constexpr const char* kOwnHeader = "X-Cloudrenderer";
constexpr std::chrono::seconds kPicturePatience{5};

}  // namespace

struct Window::Server {
  Server(const WindowOptions& o, std::function<void()> cancel_job)
      : options(o),
        encrypted(encrypts(o.tls, o.listen)),
        hub(o.scene),
        http(make_http_server(o.tls, encrypted, kThreads, "--web")),
        cancel(std::move(cancel_job)) {}

  // Who may ask at all. Without a token only names of the loopback are answered to: a page elsewhere that has its own
  // name point here gets nothing.
  bool admits(const httplib::Request& request, httplib::Response& response) const {
    if (request.path == "/") return true;
    if (options.token.empty()) {
      if (Address{host_of(request.get_header_value("Host")), 0}.is_loopback()) return true;
      refuse(response, 403, "without a token this page is for the machine itself");
      return false;
    }
    const std::string given = request.get_header_value("Authorization");
    if (same_secret(given, "Bearer " + options.token)) return true;
    response.set_header("WWW-Authenticate", "Bearer");
    refuse(response, 401, "the cluster's token is needed");
    return false;
  }

  void route() {
    using httplib::Request, httplib::Response;
    http->set_payload_max_length(kLargestRequest);
    http->set_pre_routing_handler([this](const Request& request, Response& response) {
      if (admits(request, response)) return httplib::Server::HandlerResponse::Unhandled;
      end_connection(response);  // its body, if it has one, is unread
      return httplib::Server::HandlerResponse::Handled;
    });
    http->Get("/", [](const Request&, Response& r) { r.set_content(kPage.data(), kPage.size(), "text/html; charset=utf-8"); });
    http->Get("/api/jobs", [this](const Request&, Response& r) {
      nlohmann::ordered_json jobs = nlohmann::ordered_json::array();
      if (const auto job = hub.job()) jobs.push_back(to_json(*job));
      answer_json(r, jobs);
    });
    http->Get("/api/jobs/1", [this](const Request&, Response& r) {
      if (const auto job = hub.job()) return answer_json(r, to_json(*job));
      refuse(r, 503, "the scene is still being read");
    });
    http->Get("/api/jobs/1/stream", [this](const Request&, Response& r) { stream(r); });
    http->Get("/api/jobs/1/picture.exr", [this](const Request&, Response& r) { picture(r, "picture.exr", "image/x-exr"); });
    http->Get("/api/jobs/1/picture.png", [this](const Request&, Response& r) { picture(r, "picture.png", "image/png"); });
    http->Post("/api/jobs/1/cancel", [this](const Request& request, Response& r) {
      if (!request.has_header(kOwnHeader)) return refuse(r, 403, std::string("the header ") + kOwnHeader + " is missing");
      spdlog::warn("a viewer has ended the job");
      cancel();
      r.status = 202;
      answer_json(r, {{"cancelled", true}});
    });
    http->Get("/metrics", [this](const Request&, Response& r) {
      const auto job = hub.job();
      r.set_content(job ? metrics_text(*job) : "", "text/plain; version=0.0.4; charset=utf-8");
    });
  }

  // As it is now.
  void picture(httplib::Response& response, const char* name, const char* type) {
    const auto picture = hub.picture(kPicturePatience);
    if (!picture) return refuse(response, 503, "there is no picture yet");
    const ImageHeader header{{{"Software", "cloudrenderer"}, {"cloudrenderer:spp_so_far", std::to_string(picture->spp)}}, {}};
    const std::vector<unsigned char> bytes = encode_image(name, picture->image, picture->frame, header);
    response.set_content(reinterpret_cast<const char*>(bytes.data()), bytes.size(), type);
  }

  void stream(httplib::Response& response) {
    const std::shared_ptr<Hub::Viewer> viewer = hub.join();
    if (!viewer) return refuse(response, 503, "there are viewers enough");
    response.set_chunked_content_provider("application/octet-stream", [viewer](std::size_t, httplib::DataSink& sink) {
      const std::optional<std::string> frames = viewer->next();
      if (!frames) {
        sink.done();
        return true;
      }
      return frames->empty() ? sink.is_writable() : sink.write(frames->data(), frames->size());
    });
  }

  const WindowOptions options;
  const bool encrypted;
  Hub hub;
  std::unique_ptr<httplib::Server> http;
  const std::function<void()> cancel;
  int port = 0;
  std::thread thread;
};

Window::Window(const WindowOptions& o, std::function<void()> cancel) {
  if (!o.listen.is_loopback() && o.token.empty())
    throw UsageError("--web " + o.listen.to_string() +
                     ": anybody could look; it needs a token (CLOUDRENDERER_TOKEN) or an address of the loopback");
  server_ = std::make_unique<Server>(o, std::move(cancel));
  Server& s = *server_;
  s.route();
  s.port = bind_http(*s.http, o.listen, "--web");
  s.thread = std::thread([&s] { s.http->listen_after_bind(); });
}

Window::~Window() {
  server_->hub.close();
  server_->http->stop();
  server_->thread.join();
}

std::string Window::url() const {
  const std::string host = server_->options.listen.host.empty() ? "localhost" : server_->options.listen.host;
  return (server_->encrypted ? "https://" : "http://") + Address{host, static_cast<std::uint16_t>(server_->port)}.to_string() + "/";
}

void Window::look(const RenderView& view) { server_->hub.look(view, std::chrono::steady_clock::now()); }

}  // namespace cloudrenderer

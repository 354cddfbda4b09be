#include "service/client.h"

#include <httplib.h>
#include <spdlog/fmt/fmt.h>

#include <filesystem>
#include <fstream>
#include <thread>

#include "base/error.h"

namespace cloudrenderer {
namespace {

constexpr std::time_t kPatience = 300;  // the service reads a file once more when all of it has come
constexpr int kTries = 5;               // of an upload that breaks off
constexpr std::uint64_t kPiece = std::uint64_t{64} << 20;  // sent at once: what a broken connection costs at most

std::string why_of(const httplib::Response& response) {
  try {
    return Json::parse(response.body).at("error");
  } catch (const Json::exception&) {
    return fmt::format("the service answers {}", response.status);
  }
}

std::string why_of(httplib::Error error) {
  switch (error) {
    case httplib::Error::SSLServerVerification:
      return "its certificate is none that this machine trusts for that name; --service-ca FILE, or CLOUDRENDERER_SERVICE_CA, says "
             "which one it must have (certificate.pem in the service's folder, unless it was given another one)";
    case httplib::Error::SSLLoadingCerts:
      return "the file of --service-ca, or CLOUDRENDERER_SERVICE_CA, has no certificate";
    case httplib::Error::Connection:
      return "nobody answers there";
    default:
      return httplib::to_string(error);
  }
}

}  // namespace

struct ServiceClient::Connection {
  explicit Connection(const ServiceAddress& address) : http(address.url), url(address.url) {
    if (!http.is_valid()) throw UsageError("'" + url + "' is no address of a service; it should be http://host:port or https://host:port");
    http.set_read_timeout(kPatience);
    http.set_write_timeout(kPatience);
    http.set_keep_alive(true);
    http.set_bearer_token_auth(address.token.c_str());
    if (address.authority.empty()) return;
    if (!std::ifstream(address.authority)) throw UsageError("--service-ca: " + address.authority + " cannot be read");
    http.set_ca_cert_path(address.authority.c_str());
  }
  // Throws for everything that is no success.
  httplib::Response check(const httplib::Result& result) const {
    if (!result) throw ClusterError("the service at " + url + " cannot be reached: " + why_of(result.error()));
    if (result->status == 401) throw ClusterError("the service at " + url + " refuses the token");
    if (result->status >= 500) throw ClusterError("the service at " + url + ": " + why_of(*result));
    if (result->status >= 400) throw UsageError(why_of(*result));
    return *result;
  }
  httplib::Client http;
  const std::string url;
};

ServiceClient::ServiceClient(const ServiceAddress& address) : connection_(std::make_unique<Connection>(address)) {}
ServiceClient::~ServiceClient() = default;

Json ServiceClient::get(const std::string& path) { return Json::parse(text(path)); }

std::string ServiceClient::text(const std::string& path) { return connection_->check(connection_->http.Get(path)).body; }

Json ServiceClient::post(const std::string& path, const Json& body, int* status) {
  const auto result = connection_->http.Post(path, dump(body), "application/json");
  if (status && result && result->status >= 400 && result->status < 500 && result->status != 401) {
    *status = result->status;
    return Json::parse(result->body);
  }
  const httplib::Response response = connection_->check(result);
  if (status) *status = response.status;
  return Json::parse(response.body);
}

Json ServiceClient::patch(const std::string& path, const Json& body) {
  return Json::parse(connection_->check(connection_->http.Patch(path, dump(body), "application/json")).body);
}

Json ServiceClient::remove(const std::string& path) { return Json::parse(connection_->check(connection_->http.Delete(path)).body); }

void ServiceClient::upload(const std::string& sha256, const std::string& path, const std::function<void(std::uint64_t)>& progress) {
  const std::uint64_t total = std::filesystem::file_size(path);
  const std::string blob = "/v1/blobs/" + sha256;
  std::ifstream file(path, std::ios::binary);
  if (!file) throw UsageError("cannot read " + path);
  for (int attempt = 0;;) {
    const Json state = get(blob);
    std::uint64_t offset = state.at("offset");
    progress(offset);
    if (state.at("complete")) return;
    const std::uint64_t length = std::min(kPiece, total - std::min(offset, total));
    httplib::Headers headers;
    if (length > 0) headers.emplace("Content-Range", fmt::format("bytes {}-{}/{}", offset, offset + length - 1, total));
    const auto send = [&](std::size_t at, std::size_t wanted, httplib::DataSink& sink) {
      std::string buffer(std::min<std::size_t>(wanted, 1 << 18), '\0');
      file.clear();
      file.seekg(static_cast<std::streamoff>(offset + at));
      file.read(buffer.data(), static_cast<std::streamsize>(buffer.size()));
      return file.gcount() > 0 && sink.write(buffer.data(), static_cast<std::size_t>(file.gcount()));
    };
    const auto result = length > 0 ? connection_->http.Put(blob, headers, length, send, "application/octet-stream")
                                   : connection_->http.Put(blob, std::string(), "application/octet-stream");
    const bool broken = !result || result->status == 409;  // or an earlier connection has not ended there yet
    if (!broken) {
      connection_->check(result);
      continue;
    }
    if (++attempt == kTries) connection_->check(result);
    std::this_thread::sleep_for(std::chrono::seconds(attempt));
  }
}

bool ServiceClient::download(const std::string& path, const std::string& to) {
  const std::string unfinished = to + ".part";
  std::ofstream file(unfinished, std::ios::binary);
  if (!file) throw UsageError("cannot write " + to);
  std::string refused;
  int status = 0;
  const auto result = connection_->http.Get(
      path, [&](const httplib::Response& r) { return status = r.status, true; },
      [&](const char* data, std::size_t n) {
        if (status == 200)
          file.write(data, static_cast<std::streamsize>(n));
        else
          refused.append(data, n);
        return file.good();
      });
  file.close();
  std::error_code ignored;
  if (!result || status != 200 || !file) std::filesystem::remove(unfinished, ignored);
  if (result && status == 404) return false;
  if (result && status != 200) throw ClusterError("the service does not give " + path + ": " + refused);
  connection_->check(result);
  if (!file) throw UsageError("cannot write " + to);
  std::filesystem::rename(unfinished, to);
  return true;
}

}  // namespace cloudrenderer

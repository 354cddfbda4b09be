#include "web/http_server.h"

#include <openssl/crypto.h>
#include <openssl/ssl.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <utility>

#include "base/error.h"
#include "net/own_certificate.h"

namespace cloudrenderer {
namespace {

// Whether bytes of the request's body may be left when it is answered. The library reads no body where it expects none, and
// takes chunks and lengths as they come: what it leaves it would take for the next request, and answer that, too.
bool may_leave_some(const httplib::Request& request) {
  const auto has_space = [](const auto& header) { return header.first.find_first_of(" \t") != std::string::npos; };
  if (request.has_header("Transfer-Encoding") || request.get_header_value_count("Content-Length") > 1) return true;
  if (std::ranges::any_of(request.headers, has_space)) return true;  // "Content-Length : 5" is a length to others
  const std::string length = request.get_header_value("Content-Length");
  if (length.find_first_not_of("0123456789") != std::string::npos) return true;
  const bool is_read = request.method == "POST" || request.method == "PUT" || request.method == "PATCH" || request.method == "DELETE";
  return !is_read && length.find_first_not_of('0') != std::string::npos;
}

// The library goes on with a connection whatever its answer says, unless a body could not be written. So all of it is
// written, and then said to have failed.
void end_after(const httplib::Request& request, httplib::Response& response) {
  if (request.method == "HEAD") {  // has no body that could fail; the library's own request is not const
    const_cast<httplib::Request&>(request).method = "GET";
    response.body.clear();
    response.content_provider_ = nullptr;
  }
  if (!response.content_provider_) {
    response.content_provider_ = [body = std::exchange(response.body, {})](std::size_t, std::size_t, httplib::DataSink& sink) {
      sink.write(body.data(), body.size());
      return false;
    };
    response.content_length_ = 0;  // its header stands already
    response.is_chunked_content_provider_ = false;
    return;
  }
  response.content_provider_ = [provide = std::move(response.content_provider_)](std::size_t offset, std::size_t length, httplib::DataSink& sink) {
    httplib::DataSink seen;
    bool ended = false;
    std::size_t written = 0;
    seen.write = [&](const char* data, std::size_t n) { return written += n, sink.write(data, n); };
    seen.is_writable = sink.is_writable;
    seen.done = [&] { ended = true, sink.done(); };
    return provide(offset, length, seen) && !ended && (length == 0 || written < length);
  };
}

}  // namespace

bool encrypts(const TlsOptions& tls, const Address& listen) {
  return tls.mode == TlsMode::on || (tls.mode == TlsMode::automatic && !listen.is_loopback());
}

std::unique_ptr<httplib::Server> make_http_server(const TlsOptions& tls, bool encrypted, std::size_t threads, const std::string& option) {
  std::unique_ptr<httplib::Server> http;
  if (!encrypted)
    http = std::make_unique<httplib::Server>();
  else
    http = std::make_unique<httplib::SSLServer>([&](SSL_CTX& context) {
      SSL_CTX_set_min_proto_version(&context, TLS1_2_VERSION);
      if (tls.certificate.empty()) {
        const OwnCertificate own;
        own.use(&context);
        return true;
      }
      return SSL_CTX_use_certificate_chain_file(&context, tls.certificate.c_str()) == 1 &&
             SSL_CTX_use_PrivateKey_file(&context, tls.key.c_str(), SSL_FILETYPE_PEM) == 1;
    });
  if (!http->is_valid()) throw UsageError(option + ": the certificate " + tls.certificate + " and its key cannot be used");
  http->new_task_queue = [threads] { return new httplib::ThreadPool(threads); };
  http->set_socket_options([](socket_t socket) {  // the library's own would share the port with another process
    const int yes = 1;
    setsockopt(socket, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
  });
  http->set_default_headers({{"Cache-Control", "no-store"},
                             {"X-Content-Type-Options", "nosniff"},
                             {"Content-Security-Policy", "default-src 'self' 'unsafe-inline' data:; frame-ancestors 'none'"}});
  http->set_error_handler([](const httplib::Request&, httplib::Response& response) {
    if (!response.body.empty()) return;  // it is our own
    refuse(response, response.status, response.status == 404 ? "there is nothing here" : "the request cannot be taken");
    end_connection(response);  // nobody knows what has been read of it
  });
  http->set_post_routing_handler([](const httplib::Request& request, httplib::Response& response) {
    if (may_leave_some(request)) end_connection(response);
    if (response.get_header_value("Connection") != "close") return;
    response.headers.erase("Keep-Alive");
    end_after(request, response);
  });
  return http;
}

int bind_http(httplib::Server& server, const Address& listen, const std::string& option) {
  const std::string host = listen.host.empty() ? "0.0.0.0" : listen.host;
  const int port = listen.port == 0 ? server.bind_to_any_port(host) : server.bind_to_port(host, listen.port) ? listen.port : -1;
  if (port <= 0) throw UsageError(option + " " + listen.to_string() + ": cannot listen there");
  return port;
}

void answer_json(httplib::Response& response, const nlohmann::ordered_json& json) {
  response.set_content(json.dump(-1, ' ', false, nlohmann::ordered_json::error_handler_t::replace), "application/json");
}

bool send_file(httplib::Response& response, const std::string& path, const char* type) {
  const auto file = std::make_shared<std::ifstream>(path, std::ios::binary);
  std::error_code gone;
  const std::uintmax_t bytes = std::filesystem::file_size(path, gone);
  if (gone || !*file) return false;
  response.set_content_provider(bytes, type, [file](std::size_t offset, std::size_t length, httplib::DataSink& sink) {
    std::string buffer(std::min<std::size_t>(length, 1 << 16), '\0');
    file->clear();
    file->seekg(static_cast<std::streamoff>(offset));
    file->read(buffer.data(), static_cast<std::streamsize>(buffer.size()));
    return file->gcount() > 0 && sink.write(buffer.data(), static_cast<std::size_t>(file->gcount()));
  });
  return true;
}

void refuse(httplib::Response& response, int status, const std::string& why) {
  response.status = status;
  answer_json(response, {{"error", why}});
}

void end_connection(httplib::Response& response) {
  response.headers.erase("Connection");
  response.set_header("Connection", "close");
}

bool same_secret(const std::string& a, const std::string& b) {
  return a.size() == b.size() && CRYPTO_memcmp(a.data(), b.data(), a.size()) == 0;
}

std::string host_of(const std::string& header) {
  const std::size_t bracket = header.find(']');
  if (!header.empty() && header.front() == '[') return header.substr(1, bracket == std::string::npos ? bracket : bracket - 1);
  return header.substr(0, header.find(':'));
}

}  // namespace cloudrenderer

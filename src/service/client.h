#pragma once
#include <functional>
#include <memory>
#include <string>

#include "service/job_json.h"

namespace cloudrenderer {

struct ServiceAddress {
  std::string url;        // "http://host:port"
  std::string token;      // the user's
  std::string authority;  // PEM file that the service's certificate must lead to; "": the system's
};

// What the commands of users say to a service. Throws ClusterError: it cannot be reached or refuses the token;
// UsageError: it refuses the request.
class ServiceClient {
 public:
  explicit ServiceClient(const ServiceAddress& address);
  ~ServiceClient();

  Json get(const std::string& path);
  std::string text(const std::string& path);
  Json post(const std::string& path, const Json& body, int* status = nullptr);  // with `status`: 4xx are the caller's
  Json patch(const std::string& path, const Json& body);
  Json remove(const std::string& path);
  // Goes on with what is there of the file; `progress` gets the bytes that the service has.
  void upload(const std::string& sha256, const std::string& path, const std::function<void(std::uint64_t)>& progress);
  bool download(const std::string& path, const std::string& to);  // false: there is none (yet)

 private:
  struct Connection;
  std::unique_ptr<Connection> connection_;
};

}  // namespace cloudrenderer

// A service in small, for pool_test.py: a pool whose orders come from standard input, one JSON list a line
// ([{"job": "a", "manager": "127.0.0.1:77", "weight": 1, "memory": 0}, ...]). Prints a JSON object a line: first where
// it listens, then its hosts and what each job has used, whenever these change. Ends with the input.
#include <asio/io_context.hpp>
#include <asio/posix/stream_descriptor.hpp>
#include <asio/read_until.hpp>
#include <asio/streambuf.hpp>
#include <iostream>
#include <nlohmann/json.hpp>
#include <spdlog/sinks/stdout_sinks.h>
#include <spdlog/spdlog.h>

#include "cluster/pool.h"

namespace {

using namespace cloudrenderer;
using Json = nlohmann::json;

Json json_of(const PoolUsage& u) {
  return {{"cpu_s", u.cpu_s}, {"memory_byte_s", u.memory_byte_s}, {"host_s", u.host_s}, {"bytes_sent", u.bytes_sent},
          {"bytes_received", u.bytes_received}, {"batches", u.batches}, {"loaded_bytes", u.loaded_bytes},
          {"shared_bytes", u.shared_bytes}, {"memory_used", u.memory_used}, {"working", u.working}};
}

Json json_of(const std::map<std::string, PoolUsage>& jobs) {
  Json all = Json::object();
  for (const auto& [job, usage] : jobs) all[job] = json_of(usage);
  return all;
}

class Driver {
 public:
  Driver() : input_(io_, 0), pool_(io_, clock_, {"", nullptr, 3, false, [this] { print(); }}) {
    std::cout << Json{{"listening", pool_.listen(Address::parse("127.0.0.1:0")).to_string()}} << std::endl;
    read();
  }
  void run() { io_.run(); }

 private:
  void read() {
    asio::async_read_until(input_, buffer_, '\n', [this](const std::error_code& end, std::size_t) {
      if (end) return pool_.shut();
      std::istream in(&buffer_);
      std::string line;
      std::getline(in, line);
      std::vector<PoolOrder> orders;
      for (const Json& o : Json::parse(line))
        orders.push_back({o.at("job"), Address::parse(o.at("manager")), o.at("weight"), o.at("memory")});
      pool_.order(std::move(orders));
      read();
    });
  }

  void print() {
    Json hosts = Json::array();
    for (const auto& [id, h] : pool_.hosts())
      hosts.push_back({{"name", h.name}, {"kind", h.kind}, {"cpu_s", h.cpu_s}, {"memory", h.memory},
                       {"memory_used", h.memory_used}, {"memory_peak", h.memory_peak}, {"leaving", h.leaving},
                       {"left", h.left_s.has_value()}, {"jobs", json_of(h.jobs)}});
    std::cout << Json{{"at", clock_.now()}, {"hosts", hosts}, {"usage", json_of(pool_.usage())}} << std::endl;
  }

  asio::io_context io_{1};
  Clock clock_;
  asio::posix::stream_descriptor input_;
  asio::streambuf buffer_;
  Pool pool_;
};

}  // namespace

int main() {
  spdlog::set_default_logger(spdlog::stderr_logger_mt("pool"));
  try {
    Driver().run();
    return 0;
  } catch (const std::exception& e) {
    std::cerr << e.what() << '\n';
    return 1;
  }
}

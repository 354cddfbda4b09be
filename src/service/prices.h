#pragma once
#include <cstdint>
#include <map>
#include <optional>
#include <string>

namespace cloudrenderer {

// Hosts by their kind: {"currency": "EUR", "kinds": {"small": 0.04, "big": {"price": 0.3, "threads": 8, "memory_gib": 16,
// "speed": 1.2, "min": 0, "max": 10}}, "other": 0.1}. Prices are money an hour; what is not said of a kind is learned
// from the first of its hosts.
class PriceTable {
 public:
  struct Kind {
    double price = 0;
    std::optional<std::uint32_t> threads;
    std::optional<std::uint64_t> memory;  // bytes
    double speed = 1;                     // of a thread, against the other kinds
    std::uint32_t least = 0;              // hosts to be kept, and to be had at most
    std::optional<std::uint32_t> most;
  };
  static PriceTable read(const std::string& path);  // throws UsageError
  double an_hour(const std::string& kind) const;
  const std::string& currency() const { return currency_; }
  const std::map<std::string, Kind>& kinds() const { return kinds_; }

 private:
  std::string currency_;
  std::map<std::string, Kind> kinds_;
  double other_ = 0;
};

}  // namespace cloudrenderer

#pragma once
#include <map>
#include <string>

namespace cloudrenderer {

// What hosts cost by their kind: {"currency": "EUR", "kinds": {"small": 0.04}, "other": 0.1}, money an hour.
class PriceTable {
 public:
  static PriceTable read(const std::string& path);  // throws UsageError
  double an_hour(const std::string& kind) const;
  const std::string& currency() const { return currency_; }

 private:
  std::string currency_;
  std::map<std::string, double> kinds_;
  double other_ = 0;
};

}  // namespace cloudrenderer

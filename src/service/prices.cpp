#include "service/prices.h"

#include <fstream>
#include <sstream>

#include "base/error.h"
#include "service/job_json.h"

namespace cloudrenderer {
namespace {

constexpr double kLargest = 1e9;
constexpr std::uint64_t kMostHosts = 1'000'000;

PriceTable::Kind kind_from(const Json& json, const std::string& name) {
  PriceTable::Kind kind;
  Fields f(json, "kinds." + name);
  const auto price = f.number("price", 0, kLargest);
  if (!price) throw ApiError(422, "kinds." + name + ".price is missing: money an hour");
  kind.price = *price;
  if (const auto n = f.whole("threads", 1, 1 << 16)) kind.threads = static_cast<std::uint32_t>(*n);
  if (const auto n = f.number("memory_gib", 0.001, 1e6)) kind.memory = static_cast<std::uint64_t>(*n * (1 << 30));
  kind.speed = f.number("speed", 1e-3, 1e3).value_or(1);
  kind.least = static_cast<std::uint32_t>(f.whole("min", 0, kMostHosts).value_or(0));
  if (const auto n = f.whole("max", 0, kMostHosts)) kind.most = static_cast<std::uint32_t>(*n);
  f.finish();
  if (kind.most && *kind.most < kind.least) throw ApiError(422, "kinds." + name + ".max must be at least min");
  return kind;
}

}  // namespace

PriceTable PriceTable::read(const std::string& path) {
  std::ifstream file(path);
  if (!file) throw UsageError("cannot read the price table " + path);
  std::ostringstream text;
  text << file.rdbuf();
  PriceTable out;
  try {
    const Json json = parse_json(text.str());
    Fields f(json, "");
    out.currency_ = f.text("currency", 16).value_or("");
    out.other_ = f.number("other", 0, kLargest).value_or(0);
    if (const Json* kinds = f.any("kinds")) {
      if (!kinds->is_object()) throw ApiError(422, "kinds must be an object of prices an hour, or of kinds with a price");
      Fields k(*kinds, "kinds");
      for (const auto& [kind, said] : kinds->items()) {
        if (said.is_object())
          out.kinds_[kind] = kind_from(said, kind);
        else
          out.kinds_[kind].price = k.number(kind.c_str(), 0, kLargest).value_or(0);
      }
    }
    f.finish();
  } catch (const ApiError& e) {
    throw UsageError("the price table " + path + ": " + e.what());
  }
  return out;
}

double PriceTable::an_hour(const std::string& kind) const {
  const auto found = kinds_.find(kind);
  return found == kinds_.end() ? other_ : found->second.price;
}

}  // namespace cloudrenderer

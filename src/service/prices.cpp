#include "service/prices.h"

#include <fstream>
#include <sstream>

#include "base/error.h"
#include "service/job_json.h"

namespace cloudrenderer {

PriceTable PriceTable::read(const std::string& path) {
  std::ifstream file(path);
  if (!file) throw UsageError("cannot read the price table " + path);
  std::ostringstream text;
  text << file.rdbuf();
  constexpr double kLargest = 1e9;
  PriceTable out;
  try {
    const Json json = parse_json(text.str());
    Fields f(json, "");
    out.currency_ = f.text("currency", 16).value_or("");
    out.other_ = f.number("other", 0, kLargest).value_or(0);
    if (const Json* kinds = f.any("kinds")) {
      if (!kinds->is_object()) throw ApiError(422, "kinds must be an object of prices an hour");
      Fields k(*kinds, "kinds");
      for (const auto& [kind, price] : kinds->items()) out.kinds_[kind] = k.number(kind.c_str(), 0, kLargest).value_or(0);
    }
    f.finish();
  } catch (const ApiError& e) {
    throw UsageError("the price table " + path + ": " + e.what());
  }
  return out;
}

double PriceTable::an_hour(const std::string& kind) const {
  const auto found = kinds_.find(kind);
  return found == kinds_.end() ? other_ : found->second;
}

}  // namespace cloudrenderer

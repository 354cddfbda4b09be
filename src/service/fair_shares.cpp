#include "service/fair_shares.h"

#include <algorithm>
#include <cmath>

namespace cloudrenderer {
namespace {

constexpr double kMakeUpIn = 5;    // seconds; hosts say what was used once a second
constexpr double kMostFactor = 4;  // nobody is shut out for what others have missed
constexpr double kMostLag = (kMostFactor - 1) * kMakeUpIn;  // in seconds of a user's part

}  // namespace

void FairShares::used(const std::string& user, double cpu_s) { used_[user] += cpu_s; }

void FairShares::tick(double now, const std::map<std::string, double>& parts) {
  const double seconds = now - at_;
  if (seconds <= 0) return;
  at_ = now;
  double whole = 0, all_used = 0;
  std::erase_if(users_, [&](const auto& u) { return !parts.contains(u.first); });
  for (const auto& [user, part] : parts) whole += part;
  for (const auto& [user, part] : parts) {
    users_[user].part = whole > 0 ? part / whole : 0;
    if (const auto found = used_.find(user); found != used_.end()) all_used += found->second;
  }
  rate_ += (1 - std::exp(-seconds / kMakeUpIn)) * (all_used / seconds - rate_);
  for (auto& [user, u] : users_) {
    const auto found = used_.find(user);
    const double most = kMostLag * rate_ * u.part;
    u.lag_s = std::clamp(u.lag_s + all_used * u.part - (found == used_.end() ? 0 : found->second), -most, most);
  }
  used_.clear();
}

double FairShares::factor(const std::string& user) const {
  const auto found = users_.find(user);
  if (found == users_.end() || found->second.part <= 0 || rate_ <= 0) return 1;
  const double behind_s = found->second.lag_s / (rate_ * found->second.part);
  return std::clamp(1 + behind_s / kMakeUpIn, 1 / kMostFactor, kMostFactor);
}

}  // namespace cloudrenderer

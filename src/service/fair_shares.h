#pragma once
#include <map>
#include <string>

namespace cloudrenderer {

// Who has had less of the processors than is theirs, and is to get more now. Hosts share by weights among those that
// compute just now; a user whose frame is being started, or that a host has not loaded yet, loses its part meanwhile
// though it has work. What it misses is its lag, as in fair queueing (the service that a fluid sharing would have given,
// less what was given), and raises its weight until it is made up for. Nothing is kept of who has no work: nobody saves
// up. A value: no clock.
class FairShares {
 public:
  void used(const std::string& user, double cpu_s);
  // `parts`: the users that have work, and how much of the processors is to be theirs, in any unit.
  void tick(double now, const std::map<std::string, double>& parts);
  // That the user's weight is to be multiplied by.
  double factor(const std::string& user) const;

 private:
  struct State {
    double part = 0;   // of 1
    double lag_s = 0;  // processor seconds
  };
  std::map<std::string, State> users_;  // that have work
  std::map<std::string, double> used_;  // since the last tick
  double rate_ = 0;                     // processors that are used, lately
  double at_ = 0;
};

}  // namespace cloudrenderer

#pragma once
#include <cstdio>
#include <string>

#include "cluster/render.h"

namespace cloudrenderer {

// Shows how a render goes: one line that is rewritten on a terminal, else a plain line now and
// then.
class ProgressDisplay {
 public:
  ProgressDisplay(std::FILE* out, bool quiet);
  void show(const RenderProgress& progress);
  void finish();  // the terminal's line is cleared

 private:
  std::FILE* out_;
  bool quiet_, terminal_;
  double next_ = 0;
  bool line_open_ = false;
};

// "12.3 %  0:05 done, 0:36 to go, 1.2 M samples/s, 2 hosts, relMSE about 0.012 (0.011 to 0.014)"
std::string describe(const RenderProgress& progress);

}  // namespace cloudrenderer
